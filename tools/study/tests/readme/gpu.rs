//! Relighting on a GPU.

use super::page::Figure;
use super::published::{Csv, dashed};
use super::words::{cells, list, thousands};

pub(crate) const FIGURES: &[Figure] = &[Figure {
    page: "docs/figures.md",
    heading: "### On a GPU",
    files: &["bench-gpu.csv"],
    table: relighting,
    says,
}];

/// What matrices are called on the page.
const NAMES: [(&str, &str); 5] = [
    ("twenty", "20 lamps"),
    ("panel", "1,047 columns"),
    ("random 1024", "random, 1,024 columns"),
    ("random 4096", "random, 4,096 columns"),
    ("random 4096, 4K", "random, 4,096 columns, 3840 × 2160 pixels"),
];
pub(crate) const STAYS: &str = "relit, stays there";
const BACK: &str = "relit and read back";
pub(crate) const PASSES: &str = "relit through a tenth of the memory, read back";
const CPU: &str = "relit on the CPU";

/// The adapter, which all other cases begin with.
fn adapter(csv: &Csv) -> &str {
    csv.each("case")[0]
}

fn matrices(csv: &Csv) -> Vec<&'static str> {
    let cases = csv.each("case");
    let is_there = |name: &&str| cases.contains(&format!("{}: {name}", adapter(csv)).as_str());
    NAMES.iter().map(|(name, _)| *name).filter(is_there).collect()
}

fn of(csv: &Csv, matrix: &str, way: &str, figure: &str) -> Option<f64> {
    csv.maybe_figure(&format!("{}: {matrix}: {way}", adapter(csv)), figure)
}

/// A figure of one way, of all matrices.
pub(crate) fn of_all(csv: &Csv, way: &str, figure: &str) -> Vec<f64> {
    matrices(csv).into_iter().filter_map(|matrix| of(csv, matrix, way, figure)).collect()
}

fn relighting(files: &[Csv]) -> Vec<Vec<String>> {
    let csv = &files[0];
    let matrices = matrices(csv);
    let mut table = vec![cells(&["what"])];
    table[0].extend(matrices.iter().map(|matrix| name_of(matrix).to_owned()));
    for (figure, name, digits) in [("rows", "rows", 0), ("mean_rank", "mean rank", 1)] {
        let mut row = vec![name.to_owned()];
        row.extend(matrices.iter().map(|matrix| {
            let value = csv.figure(&format!("{}: {matrix}", adapter(csv)), figure);
            if digits == 0 { thousands(value) } else { format!("{value:.digits$}") }
        }));
        table.push(row);
    }
    for (way, rate, rate_name) in [
        (CPU, "", ""),
        (STAYS, "of_memory", "of its memory's rate"),
        (BACK, "of_back", "of the rate back"),
        (PASSES, "of_sent", "of the rate of sending"),
    ] {
        let mut row = vec![way.to_owned()];
        row.extend(matrices.iter().map(|matrix| {
            let share = of(csv, matrix, way, rate).map_or(String::new(), |share| format!("; {share:.2} {rate_name}"));
            format!("{} ms{share}", dashed(of(csv, matrix, way, "milliseconds"), 2))
        }));
        table.push(row);
    }
    table
}

fn says(files: &[Csv]) -> Vec<String> {
    let csv = &files[0];
    let matrices = matrices(csv);
    let rate = |figure: &str| csv.figure(adapter(csv), figure);
    let each = |way: &str, figure: &str, digits: usize| {
        list(&matrices.iter().map(|matrix| dashed(of(csv, matrix, way, figure), digits)).collect::<Vec<_>>())
    };
    let errors =
        matrices.iter().flat_map(|matrix| [STAYS, BACK, PASSES].map(|way| of(csv, matrix, way, "relative_l2")));
    let worst = errors.flatten().fold(0.0, f64::max);
    let ms = |matrix: &str, way: &str| of(csv, matrix, way, "milliseconds").expect("a time");
    let slower: Vec<String> = matrices
        .iter()
        .filter(|matrix| ms(matrix, BACK) > ms(matrix, CPU))
        .map(|matrix| format!("{} ({:.2} and {:.2} ms)", name_of(matrix), ms(matrix, BACK), ms(matrix, CPU)))
        .collect();
    let mut says = vec![
        format!(
            "The adapter: {}. In the same run a kernel read {:.0} GB of its memory a second, {:.1} GB were sent to it a second through \
mapped buffers that all threads fill, and {:.1} GB came back by copying.",
            adapter(csv),
            rate("memory_gb_per_s"),
            rate("sent_gb_per_s"),
            rate("back_gb_per_s")
        ),
        format!(
            "An image that stays on the GPU takes {} ms. What does not grow with the matrix is submitting and waiting: the share of the \
memory's rate is {}.",
            each(STAYS, "milliseconds", 2),
            each(STAYS, "of_memory", 2)
        ),
        format!(
            "With a tenth of its memory, {} MB are sent for each image. Relative L2 to the CPU's image is at most {worst:.1e} in all ways.",
            each(PASSES, "megabytes_moved", 0)
        ),
    ];
    if !slower.is_empty() {
        says.push(format!(
            "Where we lose: an image that is read back takes longer than one that the processors of that machine relight: {}. Through a \
tenth of the memory, what each bank costs beside its bytes is most of the time of small matrices.",
            list(&slower)
        ));
    }
    says
}

/// The sentence of the README.
pub(crate) fn in_short() -> String {
    let csv = Csv::published("bench-gpu.csv");
    let adapter = adapter(&csv).split(" (").next().unwrap_or_default().to_owned();
    format!(
        "On one ({adapter}) a picture of {} rows × 1,047 columns, mean rank {:.1}, takes {:.2} ms and stays in its memory, or {:.2} ms with \
reading it back; the processors of that machine take {:.2} ms.",
        thousands(csv.figure(&format!("{}: panel", self::adapter(&csv)), "rows")),
        csv.figure(&format!("{}: panel", self::adapter(&csv)), "mean_rank"),
        of(&csv, "panel", STAYS, "milliseconds").expect("a time"),
        of(&csv, "panel", BACK, "milliseconds").expect("a time"),
        of(&csv, "panel", CPU, "milliseconds").expect("a time")
    )
}

fn name_of(matrix: &str) -> &'static str {
    NAMES.iter().find(|(name, _)| *name == matrix).expect("it has a name").1
}
