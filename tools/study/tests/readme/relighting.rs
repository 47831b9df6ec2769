//! Relighting, of real matrices and of a synthetic one.

use super::page::Figure;
use super::published::{Csv, dashed};
use super::words::{cells, list};

const OWN: &[&str] = &["bench-relight-own.csv"];
const FIGURES_PAGE: &str = "formats/figures.md";

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
        "direct_gigabytes" => ("raw matrix on disk, GB", 2),
        "direct_milliseconds" => ("direct product, ms", 0),
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
const NOTHING: &str = "cpu, nothing in memory";

/// What the README leaves out: ways that differ little from those beside them.
fn in_short(files: &[Csv]) -> Vec<Vec<String>> {
    let kept = [FULL, "cpu, one light changed", "cpu, the chunks and half of the factors in memory", NOTHING];
    let is_kept = |row: &Vec<String>| kept.contains(&row[0].as_str()) || row[0].starts_with("software GPU, read");
    let is_way = |row: &Vec<String>| row[0].starts_with("cpu") || row[0].contains("GPU") || row[0].contains('(');
    relighting(files).into_iter().filter(|row| !is_way(row) || is_kept(row)).collect()
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
                let over = of_way(csv, matrix, &way, "direct_over_it").expect("it is told with the time");
                // Only this way reads all factors once, as the figure supposes.
                let bandwidth = of_way(csv, matrix, &way, "of_bandwidth").filter(|_| way == FULL);
                let bandwidth = bandwidth.map_or(String::new(), |part| format!(", {part:.2} of the bandwidth"));
                format!("{ms:.2} ms, {over:.0} ×{bandwidth}")
            })
        }));
        table.push(row);
    }
    table
}

fn says_of_own(files: &[Csv]) -> Vec<String> {
    let csv = &files[0];
    let matrices = matrices(csv);
    let all = |way: &str, figure: &str, digits: usize| -> String {
        let of = |matrix: &&str| dashed(of_way(csv, matrix, way, figure), digits);
        list(&matrices.iter().map(of).collect::<Vec<_>>())
    };
    let names: Vec<String> = matrices.iter().map(|matrix| matrix_name(matrix)).collect();
    vec![
        format!(
            "With all factors in memory an image under all lamps takes {} ms ({}), at {} of the memory bandwidth that was read in the same \
run.",
            all(FULL, "milliseconds", 1),
            list(&names),
            all(FULL, "of_bandwidth", 2)
        ),
        format!(
            "Where we lose: with nothing in memory each block is read and decoded for each image, which takes {} ms, and is {} times faster \
than the direct product.",
            all(NOTHING, "milliseconds", 0),
            all(NOTHING, "direct_over_it", 1)
        ),
    ]
}
