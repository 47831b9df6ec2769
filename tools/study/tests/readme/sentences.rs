//! Sentences in the prose of pages, and rows of tables that are otherwise written by hand.

use super::published::{Csv, maybe, number, text};
use super::words::{CLIP, FLIP, LIN, bytes, losses, only, span, thousands};

const GROWTH: &str = "docs/growth.md";

/// A sentence that a page is to have, as its tables say it today.
pub(crate) struct Sentence {
    pub(crate) page: &'static str,
    pub(crate) says: fn() -> String,
}

/// A row of a table by its first cell.
pub(crate) struct TableRow {
    pub(crate) page: &'static str,
    pub(crate) first: &'static str,
    /// The cells behind the first.
    pub(crate) cells: fn() -> Vec<String>,
}

/// Printed text between fences, as a run printed it.
pub(crate) struct PrintedText {
    pub(crate) page: &'static str,
    /// The line before the first fence and its empty line.
    pub(crate) after: &'static str,
    /// Its table, of a line in each row.
    pub(crate) file: &'static str,
    /// How the first line begins that is not shown.
    pub(crate) until: &'static str,
}

pub(crate) const PRINTED: &[PrintedText] = &[PrintedText {
    page: "README.md",
    after: "`ltm-pack` prints what it reached:",
    file: "example.csv",
    until: "the 48 blocks of largest relative error",
}];

pub(crate) const SENTENCES: &[Sentence] = &[
    Sentence { page: "README.md", says: compressed },
    Sentence { page: "README.md", says: many_samples },
    Sentence { page: "README.md", says: few_columns },
    Sentence { page: "README.md", says: many_columns },
    Sentence { page: "README.md", says: another_renderer },
    Sentence { page: "README.md", says: reading },
    Sentence { page: "README.md", says: decoding },
    Sentence { page: "README.md", says: super::gpu::in_short },
];

pub(crate) const ROWS: &[TableRow] = &[
    TableRow { page: GROWTH, first: "one block in memory", cells: growth_block },
    TableRow { page: GROWTH, first: "the container", cells: growth_container },
    TableRow { page: GROWTH, first: "factors in memory", cells: growth_factors },
    TableRow { page: GROWTH, first: "one relit picture", cells: growth_picture },
    TableRow { page: GROWTH, first: "one light changed", cells: growth_change },
    TableRow { page: GROWTH, first: "a thousand viewers", cells: growth_viewers },
];

fn compressed() -> String {
    let (example, large) = (Csv::published("example.csv"), Csv::published("large.csv"));
    let told = text(&example.rows[0], "line").split_once("ratio ").and_then(|(_, rest)| rest.split_once('×'));
    let (lamps, _) = told.expect("the first line says the ratio");
    let panel = large.find(&[("columns", "1047"), ("stage", "pack")]);
    let ratio = 4.0 * number(panel, "rows") * number(panel, "columns") / number(panel, "file_bytes");
    format!(
        "compresses it (the Conference Room at 1024 × 768 pixels {lamps} times with 24 lamps, {} times with a panel of 1,024 texels beside 23)",
        thousands(ratio)
    )
}

fn many_samples() -> String {
    let noise = Csv::published("noise.csv");
    let most = noise.each("samples_per_px").pop().expect("a number of samples").to_owned();
    let pairs = noise.pairs("method", "ours", "raw matrix", &["scene", "samples_per_px"]);
    let lost =
        losses(&only(&pairs, "samples_per_px", &most), &[FLIP, CLIP, LIN], |row| format!("`{}`", text(row, "scene")));
    match lost.as_slice() {
        [] => format!(
            "At {most} samples a pixel packed images are still nearer than raw ones on all scenes of the table of noise."
        ),
        lost => format!("At {most} samples a pixel the raw matrix is nearer to the truth on {}.", lost.join("; ")),
    }
}

fn few_columns() -> String {
    let points = Csv::published("equal-points.csv");
    let row = points.find(&[("scene", "conference-24"), ("way", "packed"), ("samples_per_px", "64")]);
    let ratio = 4.0 * number(row, "rows") * number(row, "columns") / number(row, "bytes");
    format!("24 lamps at 64 samples, 256 × 192 pixels, are packed {ratio:.0} times smaller than as f32.")
}

fn many_columns() -> String {
    let tax = Csv::published("bench-tax.csv").figure("64 samples", "4096_columns_over_one");
    format!("Rendering 4,096 columns takes {:.0} % more time than rendering one at 64 samples.", 100.0 * (tax - 1.0))
}

fn another_renderer() -> String {
    let speed = Csv::published("speed.csv");
    let found = |way: &str| {
        number(speed.find(&[("scene", "mixed"), ("way", way), ("samples_per_px", "64")]), "relight_cpu_secs")
    };
    format!(
        "for 64 samples of the built-in room it takes {:.1} processors' seconds, our tracer {:.1}.",
        found("Mitsuba 3 (llvm_ad_rgb)"),
        found("rendering each lighting again")
    )
}

fn reading() -> String {
    let (large, whole) = (Csv::published("large.csv"), Csv::published("bench-throughput.csv"));
    let packing = large.rows.iter().filter(|row| text(row, "stage") == "pack").map(|row| number(row, "raw_gb_per_s"));
    let program = whole.each("case").into_iter().map(|case| whole.figure(case, "pack_gb_per_s"));
    let example = Csv::published("example.csv");
    let lines = example.rows.iter().map(|row| text(row, "line"));
    let few = lines.filter_map(|line| line.split_once(" of raw input")?.0.rsplit_once(", ")).map(|(_, rate)| rate);
    let few: Vec<&str> = few.collect();
    let [few] = few[..] else { panic!("one rate, not {few:?}") };
    format!(
        "Packing reads {} GB of raw matrix a second on two cores where it has a thousand columns and more; the 24 lamps of the worked example, \
         which cleaning keeps waiting, are read at {few}.",
        span(packing.chain(program), 2)
    )
}

const PANEL: &str = "panel";

fn decoding() -> String {
    let own = Csv::published("bench-relight-own.csv");
    let is_it = |case: &&str| case.starts_with("panel: cpu, nothing in memory");
    let case = own.each("case").into_iter().find(is_it).expect("nothing in memory").to_owned();
    format!(
        "an image of 1,047 columns takes {:.0} ms in place of {:.0} ms",
        own.figure(&case, "milliseconds"),
        own.figure("panel: cpu, full", "milliseconds")
    )
}

/// Rows, columns and blocks of the picture that nobody has tried.
const ROWS_THERE: f64 = 8192.0 * 4096.0 * 3.0;
const COLUMNS_THERE: f64 = 65_536.0;
const BLOCKS_THERE: f64 = 32_768.0;

fn growth_block() -> Vec<String> {
    let scaling = Csv::published("scaling.csv");
    let row = scaling.find(&[("varied", "columns"), ("value", "16384")]);
    let [render, pack] = ["render_peak_bytes", "pack_peak_bytes"].map(|column| maybe(row, column).expect("a peak"));
    let times = COLUMNS_THERE / number(row, "columns");
    vec![
        format!(
            "16,384 columns: rendering peaks at {}, packing at {}, two threads (`docs/plots/scaling.csv`, 32 × 32 pixels); 65,559: 2.1 GiB \
(*Columns*)",
            bytes(render),
            bytes(pack)
        ),
        format!(
            "{} in proportion, 2.1 GiB measured; with blocks of 16 × 16 pixels half (`docs/guide/farm.md`)",
            bytes(times * render.max(pack))
        ),
        "machines of little memory: smaller blocks".to_owned(),
    ]
}

/// Containers of the Conference Room, and what one would have there.
struct Containers {
    /// At 1,047 columns and at 4,119: bytes a row, and the mean rank.
    each: [(f64, f64); 2],
    /// Times the bytes from 256 × 192 pixels to 1024 × 768, at 4,119 columns.
    larger: f64,
    /// Times the bytes from 4,119 columns to 65,559, at 256 × 192 pixels.
    wider: f64,
    there: f64,
}

/// Bytes at 256 × 192 pixels, of the table that the page has itself.
fn of_columns(columns: &str) -> f64 {
    let (page, begin) = (super::read(GROWTH), format!("| {columns} |"));
    let line = page.lines().find(|line| line.starts_with(&begin)).unwrap_or_else(|| panic!("{GROWTH}: no '{begin}'"));
    let cell = line.split('|').nth(3).unwrap_or_default().trim().replace(',', "");
    cell.parse().unwrap_or_else(|_| panic!("'{line}' has no bytes at 256 × 192"))
}

fn containers() -> Containers {
    let large = Csv::published("large.csv");
    let of = |columns| large.find(&[("columns", columns), ("stage", "pack")]);
    let rows = ["1047", "4119"].map(of);
    let each = rows.map(|row| (number(row, "file_bytes") / number(row, "rows"), number(row, "mean_rank")));
    let few = of_columns("4,119");
    let wider = of_columns("65,559") / few;
    Containers { each, larger: number(rows[1], "file_bytes") / few, wider, there: each[1].0 * wider * ROWS_THERE }
}

fn growth_container() -> Vec<String> {
    let Containers { each: [few, many], larger, wider, there } = containers();
    vec![
        format!(
            "{:.1} bytes a row at 1,047 columns, {:.1} at 4,119, mean rank {} (Conference Room, 1024 × 768 pixels, `docs/plots/large.csv`); \
65,559 columns take {wider:.1} times the bytes of 4,119 at 256 × 192 pixels (*Columns*)",
            few.0,
            many.0,
            span([few.1, many.1], 1)
        ),
        format!(
            "{:.0} MB, if the rank stays and bytes grow with pixels; from 256 × 192 to 1024 × 768, 16 times the pixels, they grew {larger:.1} times",
            there / 1e6
        ),
        "no".to_owned(),
    ]
}

fn growth_viewers() -> Vec<String> {
    let Containers { there, .. } = containers();
    vec![
        "each computes its own picture; the host gives files only, about the bytes of the container".to_owned(),
        format!(
            "{:.0} GB in all: {:.0} minutes of 1 Gbit/s when all come at once, nothing when they come over a day",
            1e3 * there / 1e9,
            1e3 * there / 125e6 / 60.0
        ),
        "no: any static host, or a cache in front of it".to_owned(),
    ]
}

/// The Conference Room with a panel, relit.
struct Relit {
    rank: f64,
    /// Bytes of one value of a factor.
    value_bytes: f64,
    /// Bytes of factors and picture that were moved a second.
    rate: f64,
    full_ms: f64,
    change_ms: f64,
    bandwidth_part: f64,
}

const CONFERENCE: (f64, f64, f64) = (2_359_296.0, 1047.0, 768.0);

fn relit() -> Relit {
    let own = Csv::published("bench-relight-own.csv");
    let (rows, columns, blocks) = CONFERENCE;
    let rank = own.figure(PANEL, "mean_rank");
    let factors = 1e6 * own.figure(PANEL, "factor_megabytes");
    let full_ms = own.figure("panel: cpu, full", "milliseconds");
    Relit {
        rank,
        value_bytes: factors / (rank * (rows + columns * blocks)),
        rate: (factors + 4.0 * rows) / (1e-3 * full_ms),
        full_ms,
        change_ms: own.figure("panel: cpu, one light changed", "milliseconds"),
        bandwidth_part: own.figure("panel: cpu, full", "of_bandwidth"),
    }
}

impl Relit {
    /// Bytes of left and right factors there.
    fn there(&self) -> [f64; 2] {
        let each = self.rank * self.value_bytes;
        [each * ROWS_THERE, each * COLUMNS_THERE * BLOCKS_THERE]
    }
}

fn growth_factors() -> Vec<String> {
    let relit = relit();
    let [left, right] = relit.there();
    vec![
        format!(
            "{:.1} bytes a value (Conference Room, 1,047 columns, rank {:.1}, `docs/plots/bench-relight-own.csv`)",
            relit.value_bytes, relit.rank
        ),
        format!(
            "at that rank left factors {:.1} GB; right ones, rank × columns for each block, {:.0} GB",
            left / 1e9,
            right / 1e9
        ),
        "**first of viewing**, see below".to_owned(),
    ]
}

fn growth_picture() -> Vec<String> {
    let relit = relit();
    let [left, right] = relit.there();
    let gpu = Csv::published("bench-gpu.csv");
    let adapter = gpu.each("case")[0];
    let (memory, largest) = (gpu.figure(adapter, "memory_gb_per_s"), format!("{adapter}: random 4096, 4K"));
    let share = gpu.figure(&format!("{largest}: {}", super::gpu::STAYS), "of_memory");
    let smaller = gpu.figures("of_memory").into_iter().map(|(_, other)| other).filter(|other| *other < share);
    vec![
        format!(
            "{:.1} ms for {} rows at rank {:.1} and 1,047 columns, {:.2} of the memory's bandwidth (`docs/plots/bench-relight-own.csv`)",
            relit.full_ms,
            thousands(CONFERENCE.0),
            relit.rank,
            relit.bandwidth_part
        ),
        format!(
            "at {:.0} GB/s, the rate of that run, {:.1} s for the left factors and {:.1} s for the right ones",
            relit.rate / 1e9,
            left / relit.rate,
            right / relit.rate
        ),
        format!(
            "not interactive on two cores; one {}: {:.0} ms, if it holds their {:.0} GB, at {share:.2} of the {} GB that it reads of its memory \
a second, as for {} rows × 4,096 columns; {} for less (`docs/plots/bench-gpu.csv`)",
            adapter.split(" (").next().unwrap_or_default(),
            1e3 * (left + right) / (1e9 * memory * share),
            (left + right) / 1e9,
            thousands(memory),
            thousands(gpu.figure(&largest, "rows")),
            span(smaller, 2)
        ),
    ]
}

fn growth_change() -> Vec<String> {
    let relit = relit();
    let [left, right] = relit.there();
    vec![
        format!(
            "{:.1} ms on the same matrix, {:.0} % of a whole picture: the left factors are read again, of the right ones that column \
(`docs/plots/bench-relight-own.csv`)",
            relit.change_ms,
            100.0 * relit.change_ms / relit.full_ms
        ),
        format!(
            "{:.0} ms, as it grows with rows, and one value a component of each block; a whole picture takes {:.1} s",
            relit.change_ms * ROWS_THERE / CONFERENCE.0,
            (left + right) / relit.rate
        ),
        "nearly".to_owned(),
    ]
}
