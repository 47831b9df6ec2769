//! Benchmarks, whose tables have a line for each figure of each case.

use super::page::Figure;
use super::published::{Csv, dashed};
use super::words::{bytes, cells, list, listed, rounded, span, thousands};

pub(crate) const FIGURES: &[Figure] = &[
    figure("## Compressing one block", &["bench-compress.csv"], compress, compress_says),
    figure("## Coding factors", &["bench-container.csv"], coding, coding_says),
    figure("### The beginning of a file", &["bench-container.csv"], beginning, beginning_says),
    figure("## Packing and unpacking whole files", &["bench-throughput.csv"], throughput, |_| Vec::new()),
    figure("## Storing the matrix", &["bench-store.csv"], storing, storing_says),
    figure("### Rendering with a store", &["bench-store-render.csv"], store_render, store_render_says),
    figure("## Rendering all columns at once", &["bench-tax.csv"], tax, tax_says),
    figure("## Memory, counted by the allocator", &["bench-memory.csv"], memory, memory_says),
    figure("## Rays a second", &["bench-rays.csv", "bench-rays-epyc.csv"], rays, rays_says),
    figure("## The window", &["bench-view.csv"], window, window_says),
];

const fn figure(
    heading: &'static str,
    files: &'static [&'static str],
    table: fn(&[Csv]) -> Vec<Vec<String>>,
    says: fn(&[Csv]) -> Vec<String>,
) -> Figure {
    Figure { page: "docs/figures.md", heading, files, table, says }
}

/// A case with its numbers as `1,024`.
fn with_thousands(case: &str) -> String {
    let told = |word: &str| word.parse().map_or(word.to_owned(), thousands);
    case.split(' ').map(told).collect::<Vec<_>>().join(" ")
}

/// The methods and numbers of columns of `auto, 1024 columns`.
fn compress_cases(csv: &Csv) -> Vec<(&str, &str)> {
    let split = |case| csv_case(case, ", ");
    csv.each("case").into_iter().map(split).collect()
}

/// A case before and behind its last comma.
fn csv_case<'a>(case: &'a str, at: &str) -> (&'a str, &'a str) {
    case.rsplit_once(at).unwrap_or_else(|| panic!("'{case}' has no '{at}'"))
}

fn compress(files: &[Csv]) -> Vec<Vec<String>> {
    let csv = &files[0];
    let mut table = vec![cells(&["columns", "method", "rank", "ms, one thread", "matrix error", "image error"])];
    for (method, columns) in compress_cases(csv) {
        let value = |figure: &str| csv.figure(&format!("{method}, {columns}"), figure);
        table.push(vec![
            with_thousands(columns).replace(" columns", ""),
            method.to_owned(),
            format!("{:.0}", value("rank")),
            format!("{:.2}", value("milliseconds")),
            format!("{:.4}", value("matrix_error")),
            format!("{:.4}", value("image_error")),
        ]);
    }
    table
}

fn compress_says(files: &[Csv]) -> Vec<String> {
    let csv = &files[0];
    let mut columns: Vec<&str> = compress_cases(csv).into_iter().map(|case| case.1).collect();
    columns.dedup();
    let mut says = Vec::new();
    for columns in columns {
        for (method, name) in [("svd", "the full SVD"), ("svd, randomized, a power iteration", "the randomized one")] {
            let over = |figure: &str| {
                csv.figure(&format!("{method}, {columns}"), figure) / csv.figure(&format!("auto, {columns}"), figure)
            };
            says.push(format!(
                "With {} {name} takes {:.1} times our time, and has {:.2} times our error of images and {:.2} times our error of the \
matrix: below 1 it is the better one.",
                with_thousands(columns),
                over("milliseconds"),
                over("image_error"),
                over("matrix_error")
            ));
        }
    }
    says
}

/// The scenes of `mixed at 30 dB`, with both targets.
const TARGETS: [&str; 2] = ["30 dB", "45 dB"];

fn scenes(csv: &Csv) -> Vec<&str> {
    csv.each("case").into_iter().filter(|case| !case.contains(" at ")).collect()
}

fn codings(csv: &Csv) -> Vec<&str> {
    let mut found = Vec::new();
    for coding in csv.each("case").into_iter().filter_map(|case| Some(case.split_once(": ")?.1)) {
        if !found.contains(&coding) {
            found.push(coding);
        }
    }
    found
}

fn coding(files: &[Csv]) -> Vec<Vec<String>> {
    let csv = &files[0];
    let scenes = scenes(csv);
    let mut table = vec![cells(&["bytes over ours at 30 / 45 dB"])];
    table[0].extend(scenes.iter().map(|scene| (*scene).to_owned()));
    for coding in codings(csv) {
        let mut row = vec![coding.to_owned()];
        row.extend(scenes.iter().map(|scene| {
            let at = |target| csv.maybe_figure(&format!("{scene} at {target}: {coding}"), "bytes_over_ours");
            TARGETS.map(|target| dashed(at(target), 2)).join(" / ")
        }));
        table.push(row);
    }
    for (label, figure) in [("ours: encoded, GB/s", "encoded_gb_per_s"), ("ours: decoded, GB/s", "decoded_gb_per_s")] {
        let mut row = vec![label.to_owned()];
        row.extend(scenes.iter().map(|scene| {
            TARGETS.map(|target| format!("{:.2}", csv.figure(&format!("{scene} at {target}"), figure))).join(" / ")
        }));
        table.push(row);
    }
    table
}

fn coding_says(files: &[Csv]) -> Vec<String> {
    let csv = &files[0];
    let ratios = csv.figures("bytes_over_ours");
    let (nearest, least) = ratios.iter().min_by(|a, b| a.1.total_cmp(&b.1)).expect("a rival");
    let smaller: Vec<String> =
        ratios.iter().filter(|(_, ratio)| *ratio < 1.0).map(|(case, ratio)| format!("{case} ({ratio:.2})")).collect();
    vec![
        format!("The nearest rival takes {least:.2} times our bytes: {nearest}."),
        listed("Where a rival is smaller", &smaller),
        "A dash: at none of its tried steps does the coding have our error on both sides.".to_owned(),
    ]
}

/// Kinds of lightings, and what a table and a sentence call them.
const KINDS: [(&str, &str, &str); 4] = [
    ("all_on", "all on", "all lights on"),
    ("half", "half of the light", "half of the light"),
    ("spot", "a sixteenth", "a sixteenth of it"),
    ("single", "one texel", "one texel"),
];

fn beginning(files: &[Csv]) -> Vec<Vec<String>> {
    let csv = &files[0];
    let mut table = vec![cells(&["scene", "base layers, of the file"])];
    table[0].extend(KINDS.map(|(_, name, _)| format!("{name}: base / whole, dB")));
    for scene in scenes(csv) {
        let mut row = vec![scene.to_owned(), format!("{:.1} %", 100.0 * csv.figure(scene, "base_share"))];
        row.extend(KINDS.map(|(kind, ..)| {
            let [base, whole] =
                ["base", "whole"].map(|part| format!("{:.1}", csv.figure(scene, &format!("{kind}_{part}_clip_db"))));
            format!("{base} / {whole}")
        }));
        table.push(row);
    }
    table
}

fn beginning_says(files: &[Csv]) -> Vec<String> {
    let csv = &files[0];
    let shares = span(scenes(csv).into_iter().map(|scene| 100.0 * csv.figure(scene, "base_share")), 0);
    let behind = |(kind, _, name): (&str, &str, &str)| {
        let lacks = scenes(csv).into_iter().map(|scene| {
            csv.figure(scene, &format!("{kind}_whole_clip_db")) - csv.figure(scene, &format!("{kind}_base_clip_db"))
        });
        format!("{} dB with {name}", span(lacks, if kind == "all_on" { 2 } else { 1 }))
    };
    vec![format!("The first {shares} % of a file are behind the whole by {}.", list(&KINDS.map(behind)))]
}

fn throughput(files: &[Csv]) -> Vec<Vec<String>> {
    let csv = &files[0];
    let mut table = vec![cells(&["rows × columns", "`ltm-pack`", "`ltm-unpack`", "container"])];
    for case in csv.each("case") {
        table.push(vec![
            with_thousands(case).replace(" x ", " × "),
            format!("{:.2} GB/s", csv.figure(case, "pack_gb_per_s")),
            format!("{:.2} GB/s", csv.figure(case, "unpack_gb_per_s")),
            bytes(csv.figure(case, "container_bytes")),
        ]);
    }
    table
}

fn storing(files: &[Csv]) -> Vec<Vec<String>> {
    let csv = &files[0];
    let mut table = vec![cells(&["what", "written over plain", "read cold over plain", "read warm over plain"])];
    for case in csv.each("case") {
        let of = |figure: &str| dashed(csv.maybe_figure(case, figure), 2);
        let name = case
            .replace("store, ", "read ")
            .replace("Nothing", "whole blocks")
            .replace("Columns", "column by column")
            .replace("Positioned", "positioned")
            .replace("Mapped", "mapped")
            .replace(", 1", ", one thread")
            .replace(", 2", ", two threads");
        table.push(vec![name, of("written_over_plain"), of("cold_over_plain"), of("warm_over_plain")]);
    }
    table
}

fn storing_says(files: &[Csv]) -> Vec<String> {
    let csv = &files[0];
    let errors: Vec<String> = ["f32", "f16", "bf16"]
        .iter()
        .map(|precision| match csv.figure(precision, "largest_relative_error") {
            0.0 => format!("{precision} none"),
            error => format!("{precision} {error:.1e}"),
        })
        .collect();
    let reads = |figure: &str| {
        let reads = csv.each("case").into_iter().filter_map(|case| csv.maybe_figure(case, figure));
        reads.fold(f64::INFINITY, f64::min)
    };
    vec![
        format!("Largest error of an entry, relative to it: {}.", list(&errors)),
        format!(
            "Where we lose: reading costs more than plain reads of as many bytes; the slowest way here has {:.2} of the plain rate with \
the file on disk, and {:.2} with it in the system's cache, where checksums and conversion are all that is left to wait for.",
            reads("cold_over_plain"),
            reads("warm_over_plain")
        ),
    ]
}

const QUARTILES: [&str; 3] =
    ["store_over_memory_median", "store_over_memory_lower_quartile", "store_over_memory_upper_quartile"];

fn store_render(files: &[Csv]) -> Vec<Vec<String>> {
    let csv = &files[0];
    let mut table = vec![cells(&["with a store over into memory only", "median", "quartiles", "rounds"])];
    for case in csv.each("case") {
        let [median, low, high] = QUARTILES.map(|figure| format!("{:.3}", csv.figure(case, figure)));
        let rounds = format!("{:.0}", csv.figure(case, "rounds"));
        table.push(vec![case.to_owned(), median, format!("{low} to {high}"), rounds]);
    }
    table
}

fn store_render_says(files: &[Csv]) -> Vec<String> {
    let csv = &files[0];
    let says = |case: &&str| {
        let [median, low, high] = QUARTILES.map(|figure| 100.0 * (csv.figure(case, figure) - 1.0));
        let beginning = format!("In {case} writing adds {} % in the median", rounded(median, 1));
        if low > 0.0 {
            format!("{beginning}, and the quartiles of the rounds are {} to {} %.", rounded(low, 1), rounded(high, 1))
        } else {
            format!(
                "{beginning}, which is less than the rounds differ among themselves: their quartiles are {} to {} %.",
                rounded(low, 1),
                rounded(high, 1)
            )
        }
    };
    csv.each("case").iter().map(says).collect()
}

const COLUMNS: [&str; 3] = ["64", "1024", "4096"];

fn tax(files: &[Csv]) -> Vec<Vec<String>> {
    let csv = &files[0];
    let mut table = vec![cells(&["time over that of one column", "64 columns", "1,024 columns", "4,096 columns"])];
    for case in csv.each("case") {
        let mut row = vec![case.to_owned()];
        row.extend(COLUMNS.map(|columns| format!("{:.2}", csv.figure(case, &format!("{columns}_columns_over_one")))));
        table.push(row);
    }
    table
}

fn tax_says(files: &[Csv]) -> Vec<String> {
    let csv = &files[0];
    let cases = csv.each("case");
    let most = |case: &str| 100.0 * (csv.figure(case, "4096_columns_over_one") - 1.0);
    let told: Vec<String> = cases.iter().map(|case| format!("{:.0} % at {case}", most(case))).collect();
    vec![format!("Where it costs: 4,096 columns take {} more time than one.", list(&told))]
}

const STAGES: [(&str, &str); 6] = [
    ("raw matrix", "raw_bytes"),
    ("render", "render_bytes"),
    ("pack", "pack_bytes"),
    ("load factors", "load_bytes"),
    ("relight", "relight_bytes"),
    ("relight, streaming", "streaming_bytes"),
];

fn memory(files: &[Csv]) -> Vec<Vec<String>> {
    let csv = &files[0];
    let mut table = vec![cells(&["what"])];
    table[0].extend(STAGES.map(|(name, _)| name.to_owned()));
    for case in csv.each("case") {
        let mut row = vec![with_thousands(case)];
        row.extend(STAGES.map(|(_, figure)| bytes(csv.figure(case, figure))));
        table.push(row);
    }
    table
}

fn memory_says(files: &[Csv]) -> Vec<String> {
    let csv = &files[0];
    let cases = csv.each("case");
    let (first, last) = (cases[0], cases[cases.len() - 1]);
    let grown = |figure: &str| csv.figure(last, figure) / csv.figure(first, figure);
    vec![format!(
        "While the matrix grows {:.0} times, what rendering allocates grows {:.1} times, and what packing allocates {:.1} times.",
        grown("raw_bytes"),
        grown("render_bytes"),
        grown("pack_bytes")
    )]
}

/// Mesh, set of rays and what is asked of them, of `conference, 283268: primary (closest)`.
fn ray_case(case: &str) -> [String; 3] {
    let (mesh, set) = csv_case(case, ": ");
    let (set, kind) = csv_case(set, " (");
    [with_thousands(mesh), set.to_owned(), kind.trim_end_matches(')').to_owned()]
}

/// What the machine of a file is called, without its threads.
fn processor(csv: &Csv) -> &str {
    csv.machine.split(',').next().unwrap_or_default()
}

/// Rates on the machine of the first file, and beside them the ratios on that of the second.
fn rays(files: &[Csv]) -> Vec<Vec<String>> {
    let (csv, other) = (&files[0], &files[1]);
    let beside = format!("ours over Embree, {}", processor(other));
    let head = ["mesh, triangles", "rays", "hit", "ours, M rays/s", "Embree, M rays/s", "ours over Embree", &beside];
    let mut table = vec![cells(&head)];
    for case in csv.each("case") {
        let mut row = ray_case(case).to_vec();
        row.extend(
            ["million_rays_a_second", "embree_million_rays_a_second", "ours_over_embree"]
                .map(|figure| dashed(csv.maybe_figure(case, figure), 2)),
        );
        row.push(dashed(other.maybe_figure(case, "ours_over_embree"), 2));
        table.push(row);
    }
    table
}

fn rays_says(files: &[Csv]) -> Vec<String> {
    files.iter().flat_map(ratios_say).collect()
}

fn ratios_say(csv: &Csv) -> Vec<String> {
    let ratios = csv.figures("ours_over_embree");
    if ratios.is_empty() {
        return Vec::new();
    }
    let of = |wanted: &str| {
        let of = ratios.iter().filter(|(case, _)| ray_case(case)[2] == wanted).map(|(_, ratio)| *ratio);
        span(of, 2)
    };
    let slower = ratios.iter().filter(|(_, ratio)| *ratio < 1.0).map(|(case, ratio)| {
        let [mesh, set, _] = ray_case(case);
        format!("{mesh}, {set} ({ratio:.2})")
    });
    let (on, closest, any) = (processor(csv), of("closest"), of("any"));
    vec![
        format!("{on}: closest hits come at {closest} of Embree's rate, any hits at {any}."),
        listed(&format!("{on}: where Embree is faster"), &slower.collect::<Vec<_>>()),
    ]
}

fn window(files: &[Csv]) -> Vec<Vec<String>> {
    let csv = &files[0];
    let mut table = vec![cells(&[
        "container",
        "pixels × columns",
        "file",
        "first frame, cold / warm",
        "first picture, cold / warm",
        "base layers, cold / warm",
        "whole picture, cold / warm",
        "a fader's movement to its picture: median, 95th percentile",
        "pictures a second in a drag",
    ])];
    for case in csv.each("case") {
        let value = |figure: &str| csv.figure(case, figure);
        let moment = |name: &str| {
            let at = |kind: &str| dashed(csv.maybe_figure(case, &format!("{kind}_{name}_milliseconds")), 0);
            format!("{} / {} ms", at("cold"), at("warm"))
        };
        table.push(vec![
            format!("`{case}.ltc`"),
            format!("{} × {}", thousands(value("pixels")), thousands(value("columns"))),
            bytes(value("file_bytes")),
            moment("window"),
            moment("first_picture"),
            moment("base_layers"),
            moment("whole_picture"),
            format!("{:.1} ms, {:.1} ms", value("milliseconds_median"), value("milliseconds_95th")),
            format!("{:.0}", value("pictures_a_second")),
        ]);
    }
    table
}

fn window_says(files: &[Csv]) -> Vec<String> {
    let csv = &files[0];
    let [cold, warm] = ["cold", "warm"].map(|kind| csv.figures(&format!("{kind}_first_picture_milliseconds")));
    if cold.is_empty() {
        return Vec::new();
    }
    vec![format!(
        "The first picture stands {} ms after the start of the program with the container on disk, and {} ms with it in the system's \
cache.",
        span(cold.into_iter().map(|(_, time)| time), 0),
        span(warm.into_iter().map(|(_, time)| time), 0)
    )]
}
