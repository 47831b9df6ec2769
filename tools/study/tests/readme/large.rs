//! Matrices larger than memory, and how time and memory grow.

use super::page::Figure;
use super::published::{Csv, dashed, maybe, number, shown, text};
use super::tables::Row;
use super::words::{bytes, cells, shape, span, thousands};

const README: &str = "README.md";
const FIGURES_PAGE: &str = "docs/figures.md";

pub(crate) const FIGURES: &[Figure] = &[
    Figure { page: README, heading: "### Larger than memory", files: &["large.csv"], table: large, says: large_says },
    Figure {
        page: FIGURES_PAGE,
        heading: "## Larger than memory",
        files: &["large.csv"],
        table: large,
        says: large_says_more,
    },
    Figure {
        page: FIGURES_PAGE,
        heading: "## Growth",
        files: &["scaling.csv", "scaling-slopes.csv"],
        table: growth,
        says: growth_says,
    },
    Figure {
        page: FIGURES_PAGE,
        heading: "### Each size",
        files: &["scaling.csv"],
        table: sizes,
        says: |_| Vec::new(),
    },
];

const FUSED: &str = "render --pack";

fn large(files: &[Csv]) -> Vec<Vec<String>> {
    let large = &files[0];
    let sizes = large.each("columns");
    let of = |columns: &str, stage: &str| large.maybe(&[("columns", columns), ("stage", stage)]);
    let mut head = vec!["stage".to_owned()];
    head.extend(sizes.iter().map(|columns| {
        let row = of(columns, "render").expect("each size is rendered");
        format!("{}, {}", shape(row), bytes(number(row, "raw_bytes")))
    }));
    let mut table = vec![head];
    for stage in large.each("stage") {
        let mut row = vec![stage.to_owned()];
        row.extend(sizes.iter().map(|columns| {
            of(columns, stage).map_or("–".to_owned(), |found| {
                let peak = maybe(found, "peak_bytes").map_or("–".to_owned(), bytes);
                format!("{} s, {} GB/s, {peak}", shown(found, "stage_secs", 1), shown(found, "raw_gb_per_s", 2))
            })
        }));
        table.push(row);
        if stage == "pack" {
            let mut row = vec!["→ container".to_owned()];
            row.extend(sizes.iter().map(|columns| {
                of(columns, stage).map_or("–".to_owned(), |found| {
                    format!(
                        "{}, {} ×, mean rank {}, relative L2 {}",
                        bytes(number(found, "file_bytes")),
                        thousands(number(found, "ratio")),
                        shown(found, "mean_rank", 1),
                        shown(found, "relative_l2", 5)
                    )
                })
            }));
            table.push(row);
        }
    }
    table
}

fn large_says(files: &[Csv]) -> Vec<String> {
    let large = &files[0];
    let peak = |row: &&Row| maybe(row, "peak_bytes").expect("the system tells peaks");
    let most = large.rows.iter().max_by(|a, b| peak(a).total_cmp(&peak(b))).expect("rows");
    let allowed = number(most, "allowed_bytes");
    let mut says = vec![format!(
        "The largest peak of memory is {} of the {} that are allowed, in `{}`.",
        bytes(peak(&most)),
        bytes(allowed),
        text(most, "stage")
    )];
    let above: Vec<String> = large
        .rows
        .iter()
        .filter(|row| peak(row) > number(row, "allowed_bytes"))
        .map(|row| format!("`{}` at {} columns", text(row, "stage"), text(row, "columns")))
        .collect();
    if !above.is_empty() {
        says.push(format!("Where the promise is broken: {}.", above.join("; ")));
    }
    says.extend(
        large.notes.iter().filter(|note| note.contains(" left out: ")).map(|note| format!("Said by the run: {note}")),
    );
    says
}

fn large_says_more(files: &[Csv]) -> Vec<String> {
    let large = &files[0];
    let mut says = large_says(files);
    for columns in large.each("columns") {
        let secs = |stage: &str| number(large.find(&[("columns", columns), ("stage", stage)]), "stage_secs");
        says.push(format!(
            "At {} columns `{FUSED}` takes {:.1} times the seconds of rendering and packing one after the other, and writes no raw matrix.",
            thousands(columns.parse().expect("a number of columns")),
            secs(FUSED) / (secs("render") + secs("pack"))
        ));
    }
    says
}

/// The first row and the last of what was varied.
fn ends<'a>(scaling: &'a Csv, varied: &str) -> [&'a Row; 2] {
    let of: Vec<&Row> = scaling.rows.iter().filter(|row| text(row, "varied") == varied).collect();
    [of[0], of[of.len() - 1]]
}

fn growth(files: &[Csv]) -> Vec<Vec<String>> {
    let (scaling, slopes) = (&files[0], &files[1]);
    let mut table = vec![cells(&[
        "varied",
        "from – to",
        "render: slope, s",
        "pack: slope, s",
        "relight: slope, ms",
        "peak of render",
        "peak of pack",
    ])];
    for varied in scaling.each("varied") {
        let ends = ends(scaling, varied);
        let both = |told: &dyn Fn(&Row) -> String| format!("{} – {}", told(ends[0]), told(ends[1]));
        let stage = |stage: &str, column: &str, unit: f64| {
            let slope = shown(slopes.find(&[("varied", varied), ("stage", stage)]), "slope", 2);
            format!("{slope}, {}", both(&|row| format!("{:.2}", unit * number(row, column))))
        };
        let peak = |column: &str| both(&|row| maybe(row, column).map_or(dashed(None, 0), bytes));
        table.push(vec![
            varied.to_owned(),
            both(&|row| thousands(number(row, "value"))),
            stage("render", "render_secs", 1.0),
            stage("pack", "pack_secs", 1.0),
            stage("relight", "relight_secs", 1e3),
            peak("render_peak_bytes"),
            peak("pack_peak_bytes"),
        ]);
    }
    table
}

fn growth_says(files: &[Csv]) -> Vec<String> {
    let (scaling, slopes) = (&files[0], &files[1]);
    let [small, large] = ends(scaling, "pixels");
    let grown = |stage: &str, column: &str| {
        let slope = shown(slopes.find(&[("varied", "raw bytes"), ("stage", stage)]), "slope", 2);
        let [from, to] = [small, large].map(|row| maybe(row, column).map_or(dashed(None, 0), bytes));
        format!("from {from} to {to} (slope {slope})")
    };
    let points = scaling
        .each("varied")
        .into_iter()
        .map(|varied| number(slopes.find(&[("varied", varied), ("stage", "pack")]), "points"));
    vec![
        format!(
            "With pixels the matrix grows from {} to {}, and the peak of memory {} in rendering, {} in packing.",
            bytes(number(small, "raw_bytes")),
            bytes(number(large, "raw_bytes")),
            grown("render (peak)", "render_peak_bytes"),
            grown("pack (peak)", "pack_peak_bytes")
        ),
        format!("Each slope is of {} sizes, each the least of up to three runs, and has no interval.", span(points, 0)),
    ]
}

fn sizes(files: &[Csv]) -> Vec<Vec<String>> {
    let mut table = vec![cells(&[
        "varied",
        "rows × columns",
        "triangles",
        "mean rank (at most)",
        "raw",
        "render, s",
        "pack, s",
        "relight, ms",
        "peak of render",
        "peak of pack",
        "relative L2",
    ])];
    for row in &files[0].rows {
        let peak = |column: &str| maybe(row, column).map_or(dashed(None, 0), bytes);
        table.push(vec![
            format!("{}, {}", text(row, "varied"), thousands(number(row, "value"))),
            shape(row),
            thousands(number(row, "triangles")),
            format!("{} ({})", shown(row, "mean_rank", 1), text(row, "largest_rank")),
            bytes(number(row, "raw_bytes")),
            shown(row, "render_secs", 2),
            shown(row, "pack_secs", 2),
            format!("{:.3}", 1e3 * number(row, "relight_secs")),
            peak("render_peak_bytes"),
            peak("pack_peak_bytes"),
            shown(row, "relative_l2", 5),
        ]);
    }
    table
}
