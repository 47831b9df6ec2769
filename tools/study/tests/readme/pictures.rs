//! Images beside others: a denoiser's, the raw matrix's, those of light groups.

use std::collections::BTreeSet;

use super::page::Figure;
use super::published::{Csv, number, shown, text};
use super::tables::Row;
use super::words::{
    CLIP, CLIP_WORST, FLIP, FLIP_WORST, LIN, LIN_WORST, RELATIVE, bytes, cells, flip_clip, judging_in_bold, listed,
    losses, only, rounded, scene_samples, shape, span, two, wins,
};

pub(crate) const FIGURES: &[Figure] = &[
    Figure {
        page: "README.md",
        heading: "### One lamp at full size",
        files: &["lamp.csv"],
        table: lamp,
        says: lamp_says,
    },
    Figure {
        page: "README.md",
        heading: "### The picture",
        files: &["picture.csv"],
        table: picture_in_short,
        says: picture_says,
    },
    Figure {
        page: "docs/figures.md",
        heading: "## The picture",
        files: &["picture.csv"],
        table: picture,
        says: picture_says_more,
    },
    Figure {
        page: "docs/figures.md",
        heading: "## Nearer to the truth than what was packed",
        files: &["noise.csv"],
        table: noise,
        says: noise_says,
    },
    Figure {
        page: "docs/figures.md",
        heading: "## Light groups of another renderer",
        files: &["light-groups.csv"],
        table: light_groups,
        says: light_groups_say,
    },
];

const OURS: &str = "ours";
const DENOISER: &str = "denoiser on each image";
const RAW: &str = "raw matrix";
/// What makes two rows of the pictures comparable.
const SAME: [&str; 2] = ["scene", "samples_per_px"];

/// What makes two rows of single lamps comparable.
const SAME_LAMP: [&str; 3] = ["scene", "lamp", "samples_per_px"];

/// The head of a table that begins with these columns and goes on with [`at_16_and_64`].
fn head(first: &[&str]) -> Vec<String> {
    let beside = ["packed, 16 samples", "denoiser", "raw", "packed, 64 samples", "denoiser", "raw"];
    cells(&[first, &beside].concat())
}

/// Packed, denoised and raw images at 16, then at 64 samples, of the rows that have these cells.
fn at_16_and_64(of: &Csv, rows: &[(&str, &str)]) -> Vec<String> {
    let found = |samples, method| of.find(&[rows, &[("samples_per_px", samples), ("method", method)]].concat());
    let at = |samples| [OURS, DENOISER, RAW].map(|method| flip_clip(found(samples, method)));
    ["16", "64"].map(at).concat()
}

fn lamp(files: &[Csv]) -> Vec<Vec<String>> {
    let lamps = &files[0];
    let mut table = vec![head(&["scene, lamp", "rows × columns"])];
    let first = |row: &&Row| text(row, "method") == OURS && text(row, "samples_per_px") == "16";
    for ours in lamps.rows.iter().filter(first) {
        let (scene, lamp) = (text(ours, "scene"), text(ours, "lamp"));
        let mut row = vec![format!("{}, {lamp}", judging_in_bold(ours)), shape(ours)];
        row.extend(at_16_and_64(lamps, &[("scene", scene), ("lamp", lamp)]));
        table.push(row);
    }
    table
}

fn lamp_says(files: &[Csv]) -> Vec<String> {
    let beside = files[0].pairs("method", OURS, DENOISER, &SAME_LAMP);
    let judged = only(&beside, "tuned_on", "no");
    let name =
        |row: &Row| format!("`{}` {}, {} samples", text(row, "scene"), text(row, "lamp"), text(row, "samples_per_px"));
    vec![
        format!(
            "Pictures where packed ones are nearer to the reference than the denoiser's: {}; {}. Of those in bold: {}; {}.",
            wins(&beside, FLIP),
            wins(&beside, CLIP),
            wins(&judged, FLIP),
            wins(&judged, CLIP)
        ),
        listed("Where the denoiser is nearer", &losses(&beside, &[FLIP, CLIP], name)),
    ]
}

fn picture_in_short(files: &[Csv]) -> Vec<Vec<String>> {
    let picture = &files[0];
    let mut table = vec![head(&["scene, rows × columns"])];
    for scene in picture.each("scene") {
        let ours = picture.find(&[("scene", scene), ("samples_per_px", "16"), ("method", OURS)]);
        let mut row = vec![format!("{}, {}", judging_in_bold(ours), shape(ours))];
        row.extend(at_16_and_64(picture, &[("scene", scene)]));
        table.push(row);
    }
    table
}

fn picture(files: &[Csv]) -> Vec<Vec<String>> {
    let picture = &files[0];
    let mut table = vec![cells(&[
        "scene",
        "samples (reference)",
        "mean rank",
        "container",
        "packed",
        "denoiser",
        "raw",
        "worst lighting: packed",
        "denoiser",
        "raw",
    ])];
    for ours in picture.rows.iter().filter(|row| text(row, "method") == OURS) {
        let other = |method: &str| {
            picture.find(&[
                ("scene", text(ours, "scene")),
                ("samples_per_px", text(ours, "samples_per_px")),
                ("method", method),
            ])
        };
        let all = [ours, other(DENOISER), other(RAW)];
        let mut row = vec![
            judging_in_bold(ours),
            format!("{} ({})", text(ours, "samples_per_px"), text(ours, "reference_samples_per_px")),
            shown(ours, "mean_rank", 1),
            bytes(number(ours, "bytes")),
        ];
        row.extend(all.map(flip_clip));
        row.extend(all.map(|row| two(row, ("flip_worst", 3), ("psnr_clip_worst_db", 1))));
        table.push(row);
    }
    table
}

fn picture_says(files: &[Csv]) -> Vec<String> {
    let picture = &files[0];
    let beside = picture.pairs("method", OURS, DENOISER, &SAME);
    let raw = picture.pairs("method", OURS, RAW, &SAME);
    let mut says: Vec<String> = picture
        .each("samples_per_px")
        .into_iter()
        .map(|samples| {
            let pairs = only(&beside, "samples_per_px", samples);
            let judged = only(&pairs, "tuned_on", "no");
            let of = |pairs: &[(&Row, &Row)]| format!("{}; {}", wins(pairs, FLIP), wins(pairs, CLIP));
            format!(
                "At {samples} samples packed images are nearer to the reference than the denoiser's: {}. Of those in bold: {}.",
                of(&pairs),
                of(&judged)
            )
        })
        .collect();
    // Runs of one seed have no intervals.
    if picture.rows[0].contains_key("seeds") {
        says.push(seeds_say(&beside));
    }
    says.extend([
        listed("Where the denoiser is nearer", &losses(&beside, &[FLIP, FLIP_WORST, CLIP, CLIP_WORST], scene_samples)),
        listed(
            "Where the raw matrix is nearer",
            &losses(&raw, &[FLIP, FLIP_WORST, CLIP, CLIP_WORST, LIN, RELATIVE], scene_samples),
        ),
    ]);
    says
}

/// How sure the means are, and how many of the differences are larger than that.
fn seeds_say(beside: &[(&Row, &Row)]) -> String {
    // What is no rival is measured with the first seed alone.
    let seeds: BTreeSet<&str> =
        beside.iter().flat_map(|(ours, theirs)| [text(ours, "seeds"), text(theirs, "seeds")]).collect();
    assert_eq!(seeds.len(), 1, "all of as many seeds");
    let largest = |name: &str, digits: usize| {
        let of_both = beside.iter().flat_map(|(ours, theirs)| [number(ours, name), number(theirs, name)]);
        rounded(of_both.fold(0.0, f64::max), digits)
    };
    let sure = |value: &str, interval: &str| {
        let is_sure = |(ours, theirs): &&(&Row, &Row)| {
            (number(ours, value) - number(theirs, value)).abs() > number(ours, interval) + number(theirs, interval)
        };
        beside.iter().filter(is_sure).count()
    };
    format!(
        "Means of {} seeds, the worst of all of them. Half of the interval of 95 % of a mean, by the seeds: ꟻLIP {} at most, clip {} dB at \
most. Of {} differences between packed images and the denoiser's, {} in ꟻLIP and {} in clip are larger than both intervals together.",
        seeds.into_iter().next().unwrap_or_default(),
        largest("flip_interval", 4),
        largest("psnr_clip_interval_db", 2),
        beside.len(),
        sure("flip", "flip_interval"),
        sure("psnr_clip_db", "psnr_clip_interval_db"),
    )
}

fn picture_says_more(files: &[Csv]) -> Vec<String> {
    let picture = &files[0];
    let of = |method: &str, column: &str| -> Vec<f64> {
        let rows = picture.rows.iter().filter(|row| text(row, "method") == method);
        rows.map(|row| number(row, column)).collect()
    };
    let mut says = picture_says(files);
    says.push(format!(
        "What packing itself changes, packed images beside cleaned ones that are hardly compressed: ꟻLIP {} in the mean, {} under the \
worst lighting. That error jumps {} times as far across edges of blocks as inside blocks.",
        span(of(OURS, "packing_flip"), 3),
        span(of(OURS, "packing_flip_worst"), 3),
        span(of(OURS, "packing_seams"), 1),
    ));
    says.push(format!(
        "The whole error of packed images jumps {} times as far across edges of blocks as inside, that of the raw matrix {} times.",
        span(of(OURS, "seams"), 1),
        span(of(RAW, "seams"), 1)
    ));
    says
}

fn noise(files: &[Csv]) -> Vec<Vec<String>> {
    let noise = &files[0];
    let mut table = vec![cells(&[
        "scene, rows × columns",
        "samples",
        "raw",
        "not cleaned (`--denoise off`)",
        "packed",
        "packed, worst lighting",
        "mean rank, container",
    ])];
    for ours in noise.rows.iter().filter(|row| text(row, "method") == OURS) {
        let other = |method: &str| {
            noise.find(&[
                ("scene", text(ours, "scene")),
                ("samples_per_px", text(ours, "samples_per_px")),
                ("method", method),
            ])
        };
        let told = |row| format!("{}, {}", two(row, ("psnr_lin_db", 1), ("psnr_clip_db", 1)), shown(row, "flip", 3));
        let worst = two(ours, ("psnr_lin_worst_db", 1), ("psnr_clip_worst_db", 1));
        table.push(vec![
            format!("{}, {}", text(ours, "scene"), shape(ours)),
            text(ours, "samples_per_px").to_owned(),
            told(other(RAW)),
            told(other("ours (not cleaned)")),
            told(ours),
            format!("{worst}, {}", shown(ours, "flip_worst", 3)),
            format!("{}, {}", shown(ours, "mean_rank", 1), bytes(number(ours, "bytes"))),
        ]);
    }
    table
}

fn noise_says(files: &[Csv]) -> Vec<String> {
    let noise = &files[0];
    let raw = noise.pairs("method", OURS, RAW, &SAME);
    let kept = noise.pairs("method", OURS, "ours (not cleaned)", &SAME);
    let all = [LIN, LIN_WORST, CLIP, CLIP_WORST, FLIP, FLIP_WORST];
    let grown = span(kept.iter().map(|(ours, kept)| number(ours, "bytes") / number(kept, "bytes")), 0);
    vec![
        format!(
            "Packed images are nearer to the truth than the raw matrix that they were packed from: {}; {}; {}.",
            wins(&raw, LIN),
            wins(&raw, CLIP),
            wins(&raw, FLIP)
        ),
        listed("Where the raw matrix is nearer", &losses(&raw, &all, scene_samples)),
        listed("Where packing without cleaning is nearer", &losses(&kept, &all, scene_samples)),
        format!("Cleaned containers take {grown} times the bytes of those that are not cleaned."),
    ]
}

const GROUP_WAYS: [&str; 4] = [
    "rendered twice, --second",
    "rendered once, --estimate-noise",
    "denoiser on each group",
    "rendered once, not cleaned",
];

fn light_groups(files: &[Csv]) -> Vec<Vec<String>> {
    let groups = &files[0];
    let mut table = vec![cells(&[
        "room",
        "rendered twice, `--second`",
        "rendered once, `--estimate-noise`",
        "denoiser on each group",
        "rendered once, not cleaned",
    ])];
    for room in groups.each("room") {
        // The one constant of `--estimate-noise` was chosen on this one.
        let name = if room == "lounge" { room.to_owned() } else { format!("**{room}**") };
        let ways = GROUP_WAYS.map(|way| {
            let row = groups.find(&[("room", room), ("method", way)]);
            format!("{} ({})", flip_clip(row), two(row, ("flip_worst", 3), ("psnr_clip_worst_db", 1)))
        });
        table.push([vec![name], ways.into()].concat());
    }
    table
}

fn light_groups_say(files: &[Csv]) -> Vec<String> {
    let groups = &files[0];
    let [twice, once, ..] = GROUP_WAYS;
    let against = |ours: &str| {
        let pairs = groups.pairs("method", ours, GROUP_WAYS[2], &["room"]);
        losses(&pairs, &[FLIP, FLIP_WORST, CLIP, CLIP_WORST], |row| format!("`{}`", text(row, "room")))
    };
    let sizes = groups.rows.iter().filter(|row| [twice, once].contains(&text(row, "method")));
    vec![
        listed(&format!("Where the denoiser is nearer than what was {}", in_code(twice)), &against(twice)),
        listed(&format!("Where the denoiser is nearer than what was {}", in_code(once)), &against(once)),
        format!("Containers have {} MB.", span(sizes.map(|row| number(row, "bytes") / 1e6), 1)),
    ]
}

/// `rendered twice, --second` with the option as code.
fn in_code(way: &str) -> String {
    match way.split_once(", ") {
        Some((how, option)) => format!("{how} (`{option}`)"),
        None => way.to_owned(),
    }
}
