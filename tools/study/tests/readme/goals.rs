//! What was aimed at in speed, beside what is reached.

use super::gpu;
use super::page::Figure;
use super::published::{Csv, number, text};
use super::words::{cells, rounded, span};
use Wanted::{AtLeast, AtMost};

pub(crate) const FIGURES: &[Figure] = &[Figure {
    page: "docs/figures.md",
    heading: "## Goals of speed",
    files: &[
        "large.csv",
        "bench-store.csv",
        "bench-store-render.csv",
        "bench-container.csv",
        "bench-relight-own.csv",
        "bench-view.csv",
        "bench-gpu.csv",
    ],
    table,
    says: |_| Vec::new(),
}];

/// A goal: what is measured, with its unit, and from where on it is reached.
struct Goal {
    what: &'static str,
    wanted: Wanted,
    digits: usize,
    measured: Vec<f64>,
}

enum Wanted {
    AtLeast(f64),
    AtMost(f64),
}

fn goal(what: &'static str, wanted: Wanted, digits: usize, measured: Vec<f64>) -> Goal {
    Goal { what, wanted, digits, measured }
}

impl Goal {
    fn row(&self) -> Vec<String> {
        let is_met = |value: &f64| match self.wanted {
            AtLeast(bound) => *value >= bound,
            AtMost(bound) => *value <= bound,
        };
        let (sign, bound) = match self.wanted {
            AtLeast(bound) => ("≥", bound),
            AtMost(bound) => ("≤", bound),
        };
        let met = self.measured.iter().filter(|value| is_met(value)).count();
        let told = match (met, self.measured.len()) {
            (0, _) => "missed".to_owned(),
            (met, all) if met == all => "reached".to_owned(),
            (met, all) => format!("reached in {met} of {all}"),
        };
        let measured = span(self.measured.iter().copied(), self.digits);
        vec![self.what.to_owned(), format!("{sign} {}", rounded(bound, self.digits)), measured, told]
    }
}

fn table(files: &[Csv]) -> Vec<Vec<String>> {
    let [large, store, render, coding, relight, window, gpu] = files else { panic!("seven tables") };
    let of = |csv: &Csv, figure: &str| csv.figures(figure).into_iter().map(|(_, value)| value).collect::<Vec<_>>();
    let packing = large.rows.iter().filter(|row| text(row, "stage") == "pack").map(|row| number(row, "raw_gb_per_s"));
    let written = |precision: &str| vec![store.figure(precision, "written_over_plain")];
    let added = 100.0 * (render.figure("seconds", "store_over_memory_median") - 1.0);
    let first = ["cold", "warm"].map(|kind| of(window, &format!("{kind}_first_picture_milliseconds"))).concat();
    let goals = [
        goal("packing, GB of raw matrix a second, of matrices larger than memory", AtLeast(1.0), 2, packing.collect()),
        goal("writing a store over plain writing, f32", AtLeast(0.95), 2, written("f32")),
        goal("writing a store over plain writing, f16", AtLeast(0.9), 2, written("f16")),
        goal("what writing a store adds to rendering, % of its seconds", AtMost(3.0), 1, vec![added]),
        goal(
            "decoding a container, GB of factors a second on one core",
            AtLeast(1.2),
            2,
            of(coding, "decoded_gb_per_s"),
        ),
        goal(
            "share of reading in bringing a container into memory",
            AtLeast(0.8),
            2,
            of(relight, "page_in_read_share"),
        ),
        goal("the window's first picture, ms after the start of the program", AtMost(300.0), 0, first),
        goal("on a GPU, an image that stays there, ms", AtMost(1.0), 2, gpu::of_all(gpu, gpu::STAYS, "milliseconds")),
        goal("on a GPU, the same, of its memory's rate", AtLeast(0.5), 2, gpu::of_all(gpu, gpu::STAYS, "of_memory")),
        goal(
            "on a GPU, through a tenth of its memory, of the rate of sending",
            AtLeast(0.8),
            2,
            gpu::of_all(gpu, gpu::PASSES, "of_sent"),
        ),
    ];
    let mut table = vec![cells(&["what", "wanted", "measured", ""])];
    // Tables of earlier runs may not have told one.
    table.extend(goals.iter().filter(|goal| !goal.measured.is_empty()).map(Goal::row));
    table
}
