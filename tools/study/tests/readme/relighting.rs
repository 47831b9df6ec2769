//! Relighting, of real matrices and of a synthetic one.

use super::page::Figure;
use super::published::{Csv, dashed};
use super::words::{cells, list};

const OWN: &[&str] = &["bench-relight-own.csv"];
const FIGURES_PAGE: &str = "docs/figures.md";

pub(crate) const FIGURES: &[Figure] = &[
    Figure { page: "README.md", heading: "### Relighting", files: OWN, table: in_short, says: says_of_own },
    Figure { page: FIGURES_PAGE, heading: "## Relighting", files: OWN, table: relighting, says: says_of_own },
    Figure {
        page: FIGURES_PAGE,
        heading: "### A synthetic matrix",
        files: &["bench-relight.csv"],
        table: relighting,
        says: |_| Vec::new(),
    },
];

/// What each matrix is called on the pages.
const MATRICES: [(&str, &str); 3] =
    [("twenty", "20 lamps"), ("panel", "1,047 columns"), ("synthetic", "synthetic, 1,024 columns")];

fn matrix_name(case: &str) -> String {
    MATRICES.iter().find(|(name, _)| *name == case).map_or(case, |(_, told)| told).to_owned()
}

/// What is told of a matrix as a whole.
fn whole(figure: &str) -> Option<(&'static str, usize)> {
    Some(match figure {
        "mean_rank" => ("mean rank", 1),
        "lin_db" => ("lin against the raw matrix, dB", 1),
        "clip_db" => ("clip against the raw matrix, dB", 1),
        "factor_megabytes" => ("factors, MB", 1),
        "stored_gigabytes" => ("raw matrix on disk, with its noise statistics, GB", 2),
        "entries_gigabytes" => ("its entries alone, without columns of zeros, GB", 2),
        _ => return None,
    })
}

/// A way without the blocks that it decoded, which differ between matrices, and without the adapter's version.
fn way_of(case: &str) -> Option<String> {
    let way = case.split_once(": ")?.1;
    let parts: Vec<&str> = way.split(", ").filter(|part| !part.ends_with(" blocks decoded")).collect();
    let way = parts.join(", ");
    Some(way.strip_prefix("llvmpipe (").map_or(way.clone(), |rest| {
        format!("software GPU (llvmpipe), {}", rest.rsplit_once("), ").map_or(rest, |told| told.1))
    }))
}

fn matrices(csv: &Csv) -> Vec<&str> {
    csv.each("case").into_iter().filter(|case| !case.contains(": ")).collect()
}

/// A figure of one way with one matrix.
fn of_way(csv: &Csv, matrix: &str, way: &str, figure: &str) -> Option<f64> {
    let is_it = |case: &&str| case.starts_with(&format!("{matrix}: ")) && way_of(case).as_deref() == Some(way);
    csv.maybe_figure(csv.each("case").into_iter().find(is_it)?, figure)
}

const FULL: &str = "cpu, full";
const CHANGE: &str = "cpu, one light changed";
const NOTHING: &str = "cpu, nothing in memory";
const COLD: &str = "cpu, cold: the container from disk";

/// What the README leaves out: ways that differ little from those beside them.
fn in_short(files: &[Csv]) -> Vec<Vec<String>> {
    let kept = [COLD, FULL, CHANGE, "cpu, the chunks and half of the factors in memory", NOTHING];
    let is_kept = |row: &Vec<String>| kept.contains(&row[0].as_str()) || row[0].starts_with("software GPU, read");
    let is_way = |row: &Vec<String>| row[0].starts_with("cpu") || row[0].contains("GPU") || row[0].contains('(');
    relighting(files).into_iter().filter(|row| !is_way(row) || is_kept(row)).collect()
}

/// The direct products, which the times-signs of all other lines are against: cold lines against the cold one, changes of one light
/// against the raw one.
const DIRECT: [(&str, &str); 3] = [
    ("cold", "**direct product, cold**: a file of its entries alone"),
    ("warm", "**direct product, warm**: in memory"),
    ("change", "**one light changed** by its raw column in memory"),
];

/// How much faster a way is than the direct product that is like it: `3.3 × warm`.
fn over_direct(csv: &Csv, matrix: &str, way: &str) -> String {
    let over = |(told, _): &(&str, &str)| {
        let ratio = of_way(csv, matrix, way, &format!("{told}_direct_over_it"))?;
        Some(format!("{} × {told}", short(ratio)))
    };
    DIRECT.iter().find_map(over).unwrap_or_default()
}

/// A number with the digits that it needs.
fn short(number: f64) -> String {
    match number {
        large if large >= 9.95 => format!("{large:.0}"),
        small if small < 0.095 => format!("{small:.2}"),
        some => format!("{some:.1}"),
    }
}

/// A ratio of seconds, in words.
fn faster(ratio: f64) -> String {
    if ratio < 1.0 { format!("{} times slower", short(1.0 / ratio)) } else { format!("{} times faster", short(ratio)) }
}

fn of_bandwidth(part: Option<f64>) -> String {
    part.map_or(String::new(), |part| format!("; {part:.2} of the bandwidth"))
}

fn relighting(files: &[Csv]) -> Vec<Vec<String>> {
    let csv = &files[0];
    let matrices = matrices(csv);
    let mut table = vec![cells(&["what"])];
    table[0].extend(matrices.iter().map(|matrix| matrix_name(matrix)));
    let figures: Vec<&str> = csv.each("figure").into_iter().filter(|figure| whole(figure).is_some()).collect();
    for figure in figures {
        let (name, digits) = whole(figure).expect("it was asked");
        let mut row = vec![name.to_owned()];
        row.extend(matrices.iter().map(|matrix| dashed(csv.maybe_figure(matrix, figure), digits)));
        table.push(row);
    }
    for (told, name) in DIRECT {
        let secs = |matrix: &str| csv.maybe_figure(matrix, &format!("direct_{told}_milliseconds"));
        if matrices.iter().all(|matrix| secs(matrix).is_none()) {
            continue;
        }
        let mut row = vec![name.to_owned()];
        row.extend(matrices.iter().map(|matrix| {
            let part = csv.maybe_figure(matrix, &format!("direct_{told}_of_bandwidth"));
            secs(matrix).map_or("–".to_owned(), |ms| format!("{} ms{}", short(ms), of_bandwidth(part)))
        }));
        table.push(row);
    }
    let mut ways: Vec<String> = Vec::new();
    for way in csv.each("case").into_iter().filter_map(way_of) {
        if !ways.contains(&way) {
            ways.push(way);
        }
    }
    for way in ways {
        let mut row = vec![way.clone()];
        row.extend(matrices.iter().map(|matrix| {
            of_way(csv, matrix, &way, "milliseconds").map_or("–".to_owned(), |ms| {
                let part = of_way(csv, matrix, &way, "of_bandwidth");
                format!("{ms:.2} ms: {}{}", over_direct(csv, matrix, &way), of_bandwidth(part))
            })
        }));
        table.push(row);
    }
    table
}

fn says_of_own(files: &[Csv]) -> Vec<String> {
    let csv = &files[0];
    let matrices = matrices(csv);
    let told = |of: &dyn Fn(&str) -> String| list(&matrices.iter().map(|matrix| of(matrix)).collect::<Vec<_>>());
    let all = |way: &str, figure: &str, digits: usize| -> String {
        told(&|matrix| dashed(of_way(csv, matrix, way, figure), digits))
    };
    let over = |way: &str, direct: &str| {
        told(&|matrix| of_way(csv, matrix, way, &format!("{direct}_direct_over_it")).map_or("–".to_owned(), faster))
    };
    let names = told(&|matrix| matrix_name(matrix));
    let mut says = vec![
        format!(
            "With all factors in memory an image under all lamps takes {} ms ({names}), at {} of the memory bandwidth that was read in the \
same run: {} than the direct product with all raw entries in memory.",
            all(FULL, "milliseconds", 1),
            all(FULL, "of_bandwidth", 2),
            over(FULL, "warm"),
        ),
        format!(
            "From disk the first image takes {} ms, with opening the container: {} than the direct product that reads a file of the raw \
entries and nothing else.",
            all(COLD, "milliseconds", 0),
            over(COLD, "cold"),
        ),
        format!(
            "With nothing in memory each block is read and decoded for each image, which takes {} ms. That is {} than the direct product in \
memory, which needs {} GB of it.",
            all(NOTHING, "milliseconds", 0),
            over(NOTHING, "warm"),
            told(&|matrix| dashed(csv.maybe_figure(matrix, "entries_gigabytes"), 2)),
        ),
    ];
    // Earlier runs did not compare it.
    if matrices.iter().all(|matrix| of_way(csv, matrix, CHANGE, "change_direct_over_it").is_some()) {
        says.push(format!(
            "With one light changed an image takes {} ms: {} than adding that light's raw column, where all raw entries are in memory.",
            all(CHANGE, "milliseconds", 1),
            over(CHANGE, "change"),
        ));
    }
    says
}
