//! Time from the scene to the image, and what it buys.

use ltm_study::curve;

use super::page::Figure;
use super::published::{Csv, maybe, number, shown, text};
use super::tables::Row;
use super::words::{
    CLIP, CLIP_WORST, FLIP, FLIP_WORST, bytes, cells, flip_clip, list, listed, losses, ratio, scene_samples, shape,
    span, thousands, two, wins,
};

const README: &str = "README.md";
const FIGURES_PAGE: &str = "docs/figures.md";
const EQUAL: &[&str] = &["equal.csv", "equal-points.csv"];

pub(crate) const FIGURES: &[Figure] = &[
    Figure { page: README, heading: "### Equal error", files: EQUAL, table: equal, says: equal_says },
    Figure { page: FIGURES_PAGE, heading: "## Equal error", files: EQUAL, table: equal, says: equal_says_more },
    Figure {
        page: FIGURES_PAGE,
        heading: "### Each number of samples",
        files: &["equal-points.csv"],
        table: equal_points,
        says: |_| Vec::new(),
    },
    Figure {
        page: README,
        heading: "### Speed against error, from the scene to the image",
        files: &["speed.csv"],
        table: speed_in_short,
        says: speed_says,
    },
    Figure {
        page: FIGURES_PAGE,
        heading: "## Speed against error, from the scene to the image",
        files: &["speed.csv"],
        table: speed,
        says: speed_says_more,
    },
];

const PACKED: &str = "packed";
const RAW_MATRIX: &str = "raw matrix";
const EACH_DENOISED: &str = "raw matrix, each image denoised";

/// The points of another way of a row's scene, from few samples to many.
fn points_of<'a>(points: &'a Csv, row: &Row, way: &str) -> Vec<&'a Row> {
    let is = |point: &&Row| text(point, "scene") == text(row, "scene") && text(point, "way") == way;
    let mut found: Vec<&Row> = points.rows.iter().filter(is).collect();
    found.sort_by(|a, b| number(a, "samples_per_px").total_cmp(&number(b, "samples_per_px")));
    found
}

/// A cost of another way at equal error, or the bound that is known of it.
fn at_equal_error(
    row: &Row,
    (points, way): (&Csv, &str),
    column: &str,
    cost: fn(&Row, &Row) -> f64,
    digits: usize,
) -> String {
    let is_clip = column.ends_with("_clip");
    let told = |value: f64| if digits == 0 { thousands(value) } else { format!("{value:.digits$}") };
    if let Some(value) = maybe(row, column) {
        return told(value);
    }
    let all = points_of(points, row, way);
    let (first, last) = (all[0], all[all.len() - 1]);
    let is_behind = |point: &Row| {
        let measure = if is_clip { CLIP } else { FLIP };
        measure.lead(row, point).expect("both were measured") > 0.0
    };
    match (is_behind(first), is_behind(last)) {
        (true, true) => format!("> {}", told(cost(last, row))),
        (false, false) => format!("< {}", told(cost(first, row))),
        // More samples are not nearer there.
        (false, true) => "–".to_owned(),
        _ => panic!("{row:?} lies between measured points, and has no value"),
    }
}

fn samples_of(raw: &Row, _: &Row) -> f64 {
    number(raw, "samples_per_px")
}

/// Bytes of a matrix's entries as f32 over those of a container.
fn entries_over(ours: &Row) -> f64 {
    4.0 * number(ours, "rows") * number(ours, "columns") / number(ours, "bytes")
}

fn time_over(raw: &Row, ours: &Row) -> f64 {
    ratio(raw, ours, "cpu_secs")
}

/// Whether a denoiser was at hand when they were measured.
fn has_denoised(points: &Csv) -> bool {
    points.each("way").contains(&EACH_DENOISED)
}

fn equal(files: &[Csv]) -> Vec<Vec<String>> {
    let (ratios, points) = (&files[0], &files[1]);
    let mut head = cells(&[
        "scene, rows × columns",
        "packed: samples",
        "ꟻLIP / clip",
        "processors' s",
        "raw samples at that ꟻLIP",
        "at that clip",
        "raw time over ours at that ꟻLIP",
        "at that clip",
    ]);
    if has_denoised(points) {
        head.extend(cells(&["each image denoised: samples at that ꟻLIP", "at that clip"]));
    }
    let row = |row: &Row| {
        let mut cells = vec![
            format!("{}, {}", text(row, "scene"), shape(row)),
            text(row, "samples_per_px").to_owned(),
            flip_clip(row),
            shown(row, "cpu_secs", 1),
        ];
        let raw = |column, cost: fn(&Row, &Row) -> f64, digits| {
            at_equal_error(row, (points, RAW_MATRIX), column, cost, digits)
        };
        cells.extend(["raw_samples_at_flip", "raw_samples_at_clip"].map(|column| raw(column, samples_of, 0)));
        cells
            .extend(["raw_cpu_over_ours_at_flip", "raw_cpu_over_ours_at_clip"].map(|column| raw(column, time_over, 1)));
        if has_denoised(points) {
            let samples = |column| at_equal_error(row, (points, EACH_DENOISED), column, samples_of, 0);
            cells.extend(["denoised_samples_at_flip", "denoised_samples_at_clip"].map(samples));
        }
        cells
    };
    [head].into_iter().chain(ratios.rows.iter().map(row)).collect()
}

fn equal_says(files: &[Csv]) -> Vec<String> {
    let (ratios, points) = (&files[0], &files[1]);
    let known = |column: &str| -> Vec<f64> { ratios.rows.iter().filter_map(|row| maybe(row, column)).collect() };
    let samples =
        ratios.rows.iter().filter_map(|row| Some(maybe(row, "raw_samples_at_flip")? / number(row, "samples_per_px")));
    let beside = points.pairs("way", PACKED, RAW_MATRIX, &["scene", "samples_per_px"]);
    let mut says = vec![
        format!(
            "To be as near in ꟻLIP the raw matrix takes {} times the samples, and {} times the processors' seconds that rendering and \
packing take together; to be as near in clip {} times the seconds: each where it is reached at all.",
            span(samples, 0),
            span(known("raw_cpu_over_ours_at_flip"), 1),
            span(known("raw_cpu_over_ours_at_clip"), 1)
        ),
        listed(
            "Where the raw matrix of the same samples is nearer",
            &losses(&beside, &[FLIP, FLIP_WORST, CLIP, CLIP_WORST], scene_samples),
        ),
    ];
    if has_denoised(points) {
        let denoised = points.pairs("way", PACKED, EACH_DENOISED, &["scene", "samples_per_px"]);
        says.extend([
            format!(
                "Beside images of the raw matrix of the same samples, each denoised anew, packed ones are nearer: {}; {}.",
                wins(&denoised, FLIP),
                wins(&denoised, CLIP)
            ),
            format!(
                "To render as many samples as denoised images need to be as near takes {} times our processors' seconds in ꟻLIP, and {} times \
in clip, where it is reached between those that were tried; each image is then denoised anew. Below 1 we take longer until the first image.",
                span(known("denoised_cpu_over_ours_at_flip"), 1),
                span(known("denoised_cpu_over_ours_at_clip"), 1)
            ),
            listed(
                "Where the denoised ones are nearer",
                &losses(&denoised, &[FLIP, FLIP_WORST, CLIP, CLIP_WORST], scene_samples),
            ),
        ]);
    }
    says
}

fn equal_says_more(files: &[Csv]) -> Vec<String> {
    let points = &files[1];
    let beside = points.pairs("way", PACKED, RAW_MATRIX, &["scene", "samples_per_px"]);
    let over = |column: &str| beside.iter().map(|(ours, raw)| ratio(ours, raw, column)).collect::<Vec<_>>();
    let mut says = equal_says(files);
    says.push(format!(
        "At the same samples rendering and packing take {} times the processors' seconds of rendering alone. The raw file, which has \
noise statistics and features as well, has {} times the bytes; the raw entries alone as f32 have {} times.",
        span(over("cpu_secs"), 1),
        span(over("bytes").into_iter().map(|over| 1.0 / over), 0),
        span(beside.iter().map(|(ours, _)| entries_over(ours)), 0)
    ));
    says
}

fn equal_points(files: &[Csv]) -> Vec<Vec<String>> {
    let mut table = vec![cells(&[
        "scene, rows × columns",
        "way",
        "samples",
        "bytes",
        "s (processors')",
        "ꟻLIP / clip",
        "worst lighting",
    ])];
    for row in &files[0].rows {
        table.push(vec![
            format!("{}, {}", text(row, "scene"), shape(row)),
            text(row, "way").to_owned(),
            thousands(number(row, "samples_per_px")),
            bytes(number(row, "bytes")),
            format!("{} ({})", shown(row, "secs", 1), shown(row, "cpu_secs", 1)),
            flip_clip(row),
            two(row, ("flip_worst", 3), ("psnr_clip_worst_db", 1)),
        ]);
    }
    table
}

const STORED: &str = "ours (stored)";
const AGAIN: &str = "rendering each lighting again";
const UNCOMPRESSED: &str = "uncompressed T from disk";
const LLVM: &str = "Mitsuba 3 (llvm_ad_rgb)";
const DENOISED: &str = "Mitsuba 3 (llvm_ad_rgb) and the denoiser";

/// Processors' seconds until so many images are there.
fn cpu_after(row: &Row, images: f64) -> f64 {
    number(row, "prepare_cpu_secs") + images * number(row, "relight_cpu_secs")
}

/// lin / clip, ꟻLIP of all lights on, or over twelve lightings.
fn error_of(row: &Row, is_all_on: bool) -> String {
    let [lin, clip, flip] = if is_all_on {
        ["all_on_lin_db", "all_on_clip_db", "all_on_flip"]
    } else {
        ["psnr_lin_db", "psnr_clip_db", "flip"]
    };
    match maybe(row, lin) {
        None => "–".to_owned(),
        Some(_) => format!("{}, {}", two(row, (lin, 1), (clip, 1)), shown(row, flip, 3)),
    }
}

fn stored_bytes(row: &Row) -> String {
    if number(row, "bytes") == 0.0 { "–".to_owned() } else { bytes(number(row, "bytes")) }
}

fn speed_in_short(files: &[Csv]) -> Vec<Vec<String>> {
    let speed = &files[0];
    let samples = speed.each("samples_per_px").pop().expect("a number of samples").to_owned();
    let mut table = vec![cells(&[
        &format!("{samples} samples"),
        "way",
        "stored",
        "1st / 100th image after, processors' s",
        "a further image, s",
        "pays off after",
        "all on: lin / clip, ꟻLIP",
        "twelve lightings",
    ])];
    for row in speed.rows.iter().filter(|row| text(row, "samples_per_px") == samples) {
        table.push(vec![
            format!("{}, {}", text(row, "scene"), shape(row)),
            text(row, "way").to_owned(),
            stored_bytes(row),
            format!("{:.1} / {:.1}", cpu_after(row, 1.0), cpu_after(row, 100.0)),
            shown(row, "relight_cpu_secs", 4),
            shown(row, "pays_off_after", 1),
            error_of(row, true),
            error_of(row, false),
        ]);
    }
    table
}

fn speed(files: &[Csv]) -> Vec<Vec<String>> {
    let mut table = vec![cells(&[
        "scene, rows × columns",
        "samples",
        "way",
        "stored",
        "prepare, s (processors')",
        "1st / 10th / 100th image after, s",
        "a relight, s (processors')",
        "pays off after",
        "100 images over rendering again",
        "all on: lin / clip, ꟻLIP",
        "twelve lightings",
    ])];
    for row in &files[0].rows {
        let both =
            |wall: &str, cpu: &str, digits| format!("{} ({})", shown(row, wall, digits), shown(row, cpu, digits));
        let after = ["first_image_secs", "ten_images_secs", "hundred_images_secs"].map(|column| shown(row, column, 1));
        table.push(vec![
            format!("{}, {}", text(row, "scene"), shape(row)),
            text(row, "samples_per_px").to_owned(),
            text(row, "way").to_owned(),
            stored_bytes(row),
            both("prepare_secs", "prepare_cpu_secs", 1),
            after.join(" / "),
            both("relight_secs", "relight_cpu_secs", 4),
            shown(row, "pays_off_after", 1),
            shown(row, "hundred_over_again", 3),
            error_of(row, true),
            error_of(row, false),
        ]);
    }
    table
}

fn speed_says(files: &[Csv]) -> Vec<String> {
    let mut says = speed_of_scenes(&files[0]);
    for scene in files[0].each("scene") {
        let samples = files[0].each("samples_per_px").pop().expect("a number of samples");
        says.extend(of_rival(&files[0], scene, samples).map(|rival| against_denoised(&files[0], rival)));
    }
    says
}

fn of_rival<'a>(speed: &'a Csv, scene: &str, samples: &str) -> Option<&'a Row> {
    speed.maybe(&[("scene", scene), ("way", DENOISED), ("samples_per_px", samples)])
}

fn speed_of_scenes(speed: &Csv) -> Vec<String> {
    let samples = speed.each("samples_per_px");
    let mut says = Vec::new();
    for scene in speed.each("scene") {
        let found =
            |way: &str, samples: &str| speed.find(&[("scene", scene), ("way", way), ("samples_per_px", samples)]);
        let pays: Vec<String> = samples.iter().map(|s| shown(found(STORED, s), "pays_off_after", 1)).collect();
        says.push(format!(
            "`{scene}`: against rendering each lighting again by the same tracer, rendering and packing all lights pays off after {} images at \
{} samples.",
            list(&pays),
            list(&samples)
        ));
        if speed.maybe(&[("scene", scene), ("way", LLVM), ("samples_per_px", samples[0])]).is_some() {
            let part = |s: &&str| ratio(found(LLVM, s), found(AGAIN, s), "relight_cpu_secs");
            let parts: Vec<f64> = samples.iter().map(part).collect();
            let told: Vec<String> = parts.iter().map(|part| format!("{part:.2}")).collect();
            let loses = if parts.iter().any(|part| *part < 1.0) { " (below 1 we lose)" } else { "" };
            says.push(format!(
                "`{scene}`: for one lighting Mitsuba's LLVM mode takes {} of the processors' seconds of our tracer at {} samples{loses}.",
                list(&told),
                list(&samples)
            ));
            says.push(as_near_without_denoiser(speed, scene, &samples));
        }
    }
    says
}

/// What our tracer takes for one lighting to be as near as a renderer without a denoiser.
fn as_near_without_denoiser(speed: &Csv, scene: &str, samples: &[&str]) -> String {
    let takes = |column: &str| -> Vec<String> {
        let of = |s: &&str| {
            let rival = speed.find(&[("scene", scene), ("way", LLVM), ("samples_per_px", s)]);
            let seconds = number(rival, "relight_cpu_secs");
            match seconds_at(speed, scene, column, number(rival, column)) {
                Ok(ours) => format!("{:.2}", ours / seconds),
                Err(bound) => format!("at most {:.2}", bound / seconds),
            }
        };
        samples.iter().map(of).collect()
    };
    format!(
        "`{scene}`: to be as near as Mitsuba's images of {} samples our tracer takes {} times Mitsuba's processors' seconds in clip, and {} \
times in ꟻLIP: below 1 ours is faster.",
        list(samples),
        list(&takes("all_on_clip_db")),
        list(&takes("all_on_flip"))
    )
}

/// Processors' seconds in which our tracer renders one lighting with an error, on the line between two measured numbers of samples on
/// logarithmic axes; those of the fewest samples, as a bound, where these are nearer already.
fn seconds_at(speed: &Csv, scene: &str, column: &str, error: f64) -> Result<f64, f64> {
    // Decibels are logarithms, smaller for a larger error.
    let size = |error: f64| if column.ends_with("_db") { -error } else { error.ln() };
    let ours = speed.rows.iter().filter(|row| text(row, "scene") == scene && text(row, "way") == AGAIN);
    let points: Vec<(f64, f64)> =
        ours.map(|row| (size(number(row, column)), number(row, "relight_cpu_secs").ln())).collect();
    let (fewest, seconds) = points[0];
    if fewest <= size(error) {
        return Err(seconds.exp());
    }
    Ok(curve::at(&points, size(error)).expect("a measured number of samples is as near").exp())
}

/// When ours is as near as a renderer with a denoiser, and after how many images it has taken less.
fn against_denoised(speed: &Csv, rival: &Row) -> String {
    let (each, flip) = (number(rival, "relight_cpu_secs"), number(rival, "all_on_flip"));
    let scene = text(rival, "scene");
    let told = format!(
        "`{scene}`: with the denoiser Mitsuba's image of {} samples stands after {each:.1} processors' seconds at a ꟻLIP of {flip:.3}",
        text(rival, "samples_per_px")
    );
    let is_as_near =
        |row: &&Row| text(row, "scene") == scene && text(row, "way") == STORED && number(row, "all_on_flip") <= flip;
    let ours = speed.rows.iter().filter(is_as_near);
    let Some(ours) = ours.min_by(|a, b| cpu_after(a, 1.0).total_cmp(&cpu_after(b, 1.0))) else {
        return format!("{told}; ours is at no measured number of samples as near.");
    };
    let images = (number(ours, "prepare_cpu_secs") / (each - number(ours, "relight_cpu_secs"))).floor() + 1.0;
    let from = if images > 0.0 {
        format!("and has taken less from image {images:.0} on")
    } else {
        "and never takes less".to_owned()
    };
    format!(
        "{told}; ours is as near ({:.3}) with {} samples after {:.1} s, {from}.",
        number(ours, "all_on_flip"),
        text(ours, "samples_per_px"),
        cpu_after(ours, 1.0)
    )
}

fn speed_says_more(files: &[Csv]) -> Vec<String> {
    let speed = &files[0];
    let pairs = speed.pairs("way", UNCOMPRESSED, STORED, &["scene", "samples_per_px"]);
    let mut says = speed_of_scenes(speed);
    for scene in speed.each("scene") {
        let rivals = speed.each("samples_per_px").into_iter().filter_map(|samples| of_rival(speed, scene, samples));
        says.extend(rivals.map(|rival| against_denoised(speed, rival)));
    }
    says.push(format!(
        "The uncompressed matrix on disk gives its first image after {} of our processors' seconds at the same samples, for there is \
nothing to clean and pack; each further image takes it {} times ours. Its file has {} times the bytes, its entries alone as f32 {} times.",
        span(pairs.iter().map(|(raw, ours)| cpu_after(raw, 1.0) / cpu_after(ours, 1.0)), 2),
        span(pairs.iter().map(|(raw, ours)| ratio(raw, ours, "relight_cpu_secs")), 0),
        span(pairs.iter().map(|(raw, ours)| ratio(raw, ours, "bytes")), 0),
        span(pairs.iter().map(|(_, ours)| entries_over(ours)), 0)
    ));
    let load = speed.notes.iter().find_map(|note| note.split_once("Load when it began: "));
    if let Some((_, load)) = load {
        says.push(format!(
            "The machine's load when this began was {}: seconds by the clock vary with what else runs, processors' seconds less.",
            load.trim_end_matches('.')
        ));
    }
    says
}
