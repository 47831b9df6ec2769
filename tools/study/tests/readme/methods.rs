//! Methods of compression at equal bytes.

use super::page::Figure;
use super::published::{Csv, dashed, maybe, number, shown, text};
use super::tables::Row;
use super::words::{
    CLIP, CLIP_WORST, FLIP, LIN, LIN_WORST, Measure, cells, judging_in_bold, list, listed, losses, only, signed, span,
    thousands, two, wins,
};

pub(crate) const FIGURES: &[Figure] = &[
    figure("## Ideas at equal bytes", &["ablation.csv"], ablation, ablation_says),
    figure("### Ideas scene by scene", &["ablation-scenes.csv"], ablation_scenes, ablation_scenes_say),
    figure("## Matrices of another renderer", &["imports.csv"], imports, imports_say),
    figure("## Other methods at one size", &["fig9-32-fixed.csv"], at_one_size, at_one_size_says),
    figure("### Ours against each method's own sizes", &["fig9-32-gain.csv"], gains, gains_say),
    figure("### What was tried of each method", &["fig9-32.csv"], points, |_| Vec::new()),
];

const fn figure(
    heading: &'static str,
    files: &'static [&'static str],
    table: fn(&[Csv]) -> Vec<Vec<String>>,
    says: fn(&[Csv]) -> Vec<String>,
) -> Figure {
    Figure { page: "docs/figures.md", heading, files, table, says }
}

const KEPT: &str = "+ sparse entries (`--keep-noise`)";
const DEFAULT: &str = "+ cleaned (the default)";
/// Methods that get the matrix that the default's cleaning makes.
const GIVEN_CLEANED: &str = "cleaned, then ";
/// Codecs that know nothing of light.
const GENERAL: [&str; 5] = ["DCT + zstd", "zfp + zstd", "SZ3", "SPERR", "Tucker"];

const TRUTH_CLIP: Measure = Measure { column: "truth_clip_db", name: "clip", in_decibels: true };
const TRUTH_FLIP: Measure = Measure { column: "truth_flip", name: "ꟻLIP", in_decibels: false };

fn ablation(files: &[Csv]) -> Vec<Vec<String>> {
    let ablation = &files[0];
    let mut table = vec![cells(&[
        "at 400 ×, lin / clip in dB",
        "tuned on",
        "judged",
        "worst lighting",
        "truth: clip, ꟻLIP",
        "judged, at 100 ×",
    ])];
    for method in ablation.each("method") {
        let found =
            |scenes: &str, ratio: &str| ablation.find(&[("scenes", scenes), ("ratio", ratio), ("method", method)]);
        let (tuned, judged, fine) = (found("tuned on", "400"), found("judged", "400"), found("judged", "100"));
        let mean = |row| two(row, ("psnr_lin_db", 1), ("psnr_clip_db", 1));
        let with_interval = |value: &str, interval: &str| match maybe(judged, interval) {
            None => shown(judged, value, 1),
            Some(interval) => format!("{} ± {interval:.1}", shown(judged, value, 1)),
        };
        let is_there = maybe(judged, "psnr_lin_db").is_some();
        table.push(vec![
            method.to_owned(),
            mean(tuned),
            if is_there {
                let clip = with_interval("psnr_clip_db", "psnr_clip_interval_db");
                format!("{} / {clip}", with_interval("psnr_lin_db", "psnr_lin_interval_db"))
            } else {
                "–".to_owned()
            },
            two(judged, ("psnr_lin_worst_db", 1), ("psnr_clip_worst_db", 1)),
            match maybe(judged, "truth_clip_db") {
                None => "–".to_owned(),
                Some(clip) => format!("{clip:.1}, {}", shown(judged, "truth_flip", 3)),
            },
            mean(fine),
        ]);
    }
    table
}

/// A method's name without the plus of its row.
fn plain(method: &str) -> &str {
    method.strip_prefix("+ ").unwrap_or(method)
}

fn ablation_says(files: &[Csv]) -> Vec<String> {
    let ablation = &files[0];
    let methods = ablation.each("method");
    let clip_at = |ratio: &str, method: &str, column: &str| {
        maybe(ablation.find(&[("scenes", "judged"), ("ratio", ratio), ("method", method)]), column)
    };
    let clip = |method: &str, column: &str| clip_at("400", method, column);
    let chain: Vec<&str> =
        methods[..1].iter().chain(methods.iter().filter(|method| method.starts_with("+ "))).copied().collect();
    let added: Vec<String> = chain
        .windows(2)
        .filter_map(|pair| {
            let gain = clip(pair[1], "psnr_clip_db")? - clip(pair[0], "psnr_clip_db")?;
            let truth = clip(pair[1], "truth_clip_db")? - clip(pair[0], "truth_clip_db")?;
            Some(format!("{} {} ({})", plain(pair[1]), signed(gain), signed(truth)))
        })
        .collect();
    let behind: Vec<String> = methods
        .iter()
        .filter(|method| **method != DEFAULT)
        .flat_map(|method| {
            let pairs = ablation.pairs("method", DEFAULT, method, &["scenes", "ratio"]);
            losses(&pairs, &[TRUTH_CLIP, TRUTH_FLIP], |row| {
                format!("{}, {}, {} ×", plain(text(row, "method")), text(row, "scenes"), text(row, "ratio"))
            })
        })
        .collect();
    let general = GENERAL.iter().filter_map(|method| Some((method, clip(method, "psnr_clip_db")?)));
    let (nearest, reached) = general.max_by(|a, b| a.1.total_cmp(&b.1)).expect("a codec that was measured");
    let difference = |ours: &str, column: &str| clip(ours, column).unwrap() - clip(nearest, column).unwrap();
    let (kept, truth) = (difference(KEPT, "psnr_clip_db"), difference(DEFAULT, "truth_clip_db"));
    let lead = |ratio: &str, rival: &str| {
        let lead = clip_at(ratio, DEFAULT, "truth_clip_db")? - clip_at(ratio, rival, "truth_clip_db")?;
        Some(signed(lead))
    };
    let given_cleaned = methods.iter().filter_map(|method| {
        let rival = method.strip_prefix(GIVEN_CLEANED)?;
        Some(format!("{rival} {} and {}", lead("400", method)?, lead("100", method)?))
    });
    let given_cleaned: Vec<String> = given_cleaned.collect();
    let absent: Vec<&str> =
        methods.iter().copied().filter(|method| clip(method, "psnr_clip_db").is_none()).map(plain).collect();
    vec![
        format!(
            "What each idea adds in clip on the scenes that judge at 400 ×, in dB, and in brackets against the truth: {}.",
            added.join("; ")
        ),
        listed("Where others are nearer to the truth than the default", &behind),
        format!(
            "The nearest codec that knows nothing of light is {nearest}, with {reached:.1} dB in clip: {} dB from it to \
`--keep-noise`. Against the truth the default is {} dB ahead of it, which is more than compression: the codec keeps the noise.",
            signed(kept),
            signed(truth)
        ),
        format!(
            "What of that is compression: how far the default is ahead of methods that are given the cleaned matrix, against the truth on \
the scenes that judge, clip in dB at 400 × and 100 ×: {}.",
            given_cleaned.join("; ")
        ),
        format!(
            "A dash: in some scene or seed no file was made on one side of the size. That shows nothing of what a method can. At 400 ×: {}.",
            list(&absent)
        ),
    ]
}

fn ablation_scenes(files: &[Csv]) -> Vec<Vec<String>> {
    let ablation = &files[0];
    let scenes = ablation.each("scene");
    let mut head = vec!["method".to_owned()];
    for ratio in ["400", "100"] {
        head.extend(scenes.iter().map(|scene| format!("{scene}, {ratio} ×")));
    }
    let mut table = vec![head];
    for method in ablation.each("method") {
        let mut row = vec![method.to_owned()];
        for ratio in ["400", "100"] {
            row.extend(scenes.iter().map(|scene| {
                let found = ablation.find(&[("scene", scene), ("ratio", ratio), ("method", method)]);
                match maybe(found, "psnr_clip_db") {
                    None => "–".to_owned(),
                    Some(clip) => format!("{clip:.1}; {}", two(found, ("truth_clip_db", 1), ("truth_flip", 3))),
                }
            }));
        }
        table.push(row);
    }
    table
}

fn ablation_scenes_say(files: &[Csv]) -> Vec<String> {
    let ablation = &files[0];
    let ours: Vec<&Row> = ablation.rows.iter().filter(|row| text(row, "method") == DEFAULT).collect();
    let nearest = |measure: Measure| {
        let is_nearest = |ours: &&&Row| {
            let same = |row: &&Row| ["scene", "ratio"].iter().all(|column| text(row, column) == text(ours, column));
            let leads = ablation.rows.iter().filter(same).filter_map(|row| measure.lead(ours, row));
            leads.fold(f64::INFINITY, f64::min) >= 0.0
        };
        ours.iter().filter(is_nearest).count()
    };
    vec![
        format!(
            "Of these {} scenes and sizes the default is the nearest of all to the truth in clip at {}, in ꟻLIP at {}.",
            ours.len(),
            nearest(TRUTH_CLIP),
            nearest(TRUTH_FLIP)
        ) + &format!(" Where it stops by itself both sizes are the same file: {}.", list(&one_file_for_both(ablation))),
    ]
}

/// The scenes on which the default takes no more bytes than the smaller size.
fn one_file_for_both(ablation: &Csv) -> Vec<String> {
    let of = |scene: &str, ratio: &str| {
        let row = ablation.find(&[("scene", scene), ("ratio", ratio), ("method", DEFAULT)]);
        ["psnr_clip_db", "truth_clip_db", "truth_flip"].map(|column| text(row, column).to_owned())
    };
    let is_one = |scene: &&str| of(scene, "400") == of(scene, "100");
    ablation.each("scene").into_iter().filter(is_one).map(|scene| format!("`{scene}`")).collect()
}

const BY_IMAGES: &str = "from the images";
const ONE_PLACE: &str = "nothing of places";
const TOLD: &str = "places told";

fn imports(files: &[Csv]) -> Vec<Vec<String>> {
    let imports = &files[0];
    let mut table = vec![cells(&[
        "scene, columns",
        "lights at one place",
        "placed by their images (default)",
        "told (`--texels`, `--sky`)",
        "one light: no prior / default",
    ])];
    for scene in imports.each("scene") {
        let found = |lights: &str| imports.find(&[("scene", scene), ("lights", lights)]);
        let default = found(BY_IMAGES);
        let mut row = vec![format!("{}, {}", judging_in_bold(default), thousands(number(default, "columns")))];
        row.extend([ONE_PLACE, BY_IMAGES, TOLD].map(|lights| {
            let row = found(lights);
            let mean = two(row, ("psnr_lin_db", 1), ("psnr_clip_db", 1));
            format!("{mean}, {}, {}", shown(row, "psnr_lin_worst_db", 1), shown(row, "flip", 3))
        }));
        row.push(format!(
            "{} / {}",
            shown(found("no prior"), "one_light_lin_db", 1),
            shown(default, "one_light_lin_db", 1)
        ));
        table.push(row);
    }
    table
}

fn imports_say(files: &[Csv]) -> Vec<String> {
    const ONE_LIGHT: Measure = Measure { column: "one_light_lin_db", name: "single lights in lin", in_decibels: true };
    let imports = &files[0];
    let judged = |ours: &str, theirs: &str| only(&imports.pairs("lights", ours, theirs, &["scene"]), "tuned_on", "no");
    let scene = |row: &Row| format!("`{}`", text(row, "scene"));
    let (placed, told) = (judged(BY_IMAGES, ONE_PLACE), judged(TOLD, BY_IMAGES));
    let more = judged("from the images, --rank 64", BY_IMAGES);
    let worst_of = |when: &str, lights: &str| {
        let rows = || imports.rows.iter().filter(|row| text(row, "lights") == lights);
        format!(
            "The worst lighting is {} dB below the mean in lin {when}, and has {} dB in clip.",
            span(rows().map(|row| number(row, "psnr_lin_db") - number(row, "psnr_lin_worst_db")), 0),
            span(rows().map(|row| number(row, "psnr_clip_worst_db")), 0)
        )
    };
    let change = span(more.iter().map(|(ours, theirs)| ONE_LIGHT.lead(ours, theirs).expect("single lights")), 1);
    vec![
        format!(
            "On the scenes that judge, lights placed by their images are nearer than lights at one place: {}; {}; {}.",
            wins(&placed, FLIP),
            wins(&placed, LIN),
            wins(&placed, LIN_WORST)
        ),
        listed("Where placing by images loses to that", &losses(&placed, &[FLIP, LIN, LIN_WORST, CLIP], scene)),
        format!("Told places beside those: {}; {}.", wins(&told, FLIP), wins(&told, LIN)),
        listed(
            "Where told places lose to those from the images",
            &losses(&told, &[FLIP, LIN, LIN_WORST, CLIP, CLIP_WORST], scene),
        ),
        worst_of("by default", BY_IMAGES) + " " + &worst_of("where places are told", TOLD),
        listed(
            "Where least squares without a prior are nearer than the default",
            &losses(&judged(BY_IMAGES, "no prior"), &[ONE_LIGHT, LIN, FLIP], scene),
        ),
        format!("64 components a block in place of 24 change single lights by {change} dB."),
    ]
}

const NOISE_KEPT: &str = "ours (noise kept)";
const AUTO: &str = "ours (auto)";
const RIVALS: [&str; 5] = ["block SVD (one threshold)", "Algorithm 4", "kernel Nyström", "DCT", "zfp"];

fn at_one_size(files: &[Csv]) -> Vec<Vec<String>> {
    let fixed = &files[0];
    let mut table = vec![cells(&["scene, columns, ratio", "ours, `--keep-noise`", "its worst lighting"])];
    table[0].extend(RIVALS.iter().map(|rival| rival.replace(" (one threshold)", "")));
    for scene in fixed.each("scene") {
        let found = |method: &str| fixed.find(&[("scene", scene), ("method", method)]);
        let ours = found(NOISE_KEPT);
        let columns = thousands(number(ours, "columns"));
        let mut row = vec![
            format!("{scene}, {columns}, {} ×", text(ours, "ratio")),
            two(ours, ("psnr_lin_db", 1), ("psnr_clip_db", 1)),
            two(ours, ("psnr_lin_worst_db", 1), ("psnr_clip_worst_db", 1)),
        ];
        row.extend(RIVALS.map(|rival| two(found(rival), ("psnr_lin_db", 1), ("psnr_clip_db", 1))));
        table.push(row);
    }
    table
}

fn at_one_size_says(files: &[Csv]) -> Vec<String> {
    let fixed = &files[0];
    let mut behind = Vec::new();
    for rival in fixed.each("method").into_iter().filter(|method| !method.starts_with("ours")) {
        let pairs = fixed.pairs("method", NOISE_KEPT, rival, &["scene"]);
        behind.extend(losses(&pairs, &[LIN, LIN_WORST, CLIP, CLIP_WORST], |row| {
            format!("`{}`, {}", text(row, "scene"), text(row, "method"))
        }));
    }
    let empty = |method: &str| -> Vec<String> {
        let rows = fixed.rows.iter().filter(|row| text(row, "method") == method);
        rows.filter(|row| maybe(row, "psnr_lin_db").is_none()).map(|row| format!("`{}`", text(row, "scene"))).collect()
    };
    vec![
        listed("Where others are nearer", &behind),
        format!(
            "What leaves noise out (`--denoise off`) stops before it has so many bytes, and so has no value here, on: {}.",
            list(&empty(AUTO))
        ),
    ]
}

fn gains(files: &[Csv]) -> Vec<Vec<String>> {
    let gains = &files[0];
    let mut table = vec![cells(&[
        "scene, columns",
        "ours",
        "over block SVD: least lin",
        "mean lin",
        "least clip",
        "over Algorithm 4: least lin",
        "least clip",
        "goal: ratio, lin / clip",
        "reached",
    ])];
    for row in &gains.rows {
        let ours = if text(row, "ours") == AUTO { "noise left out" } else { "`--keep-noise`" };
        let goal = maybe(row, "goal_ratio").map_or("–".to_owned(), |ratio| {
            format!("{ratio:.0} ×, {}", two(row, ("goal_lin_db", 0), ("goal_clip_db", 0)))
        });
        table.push(vec![
            format!("{}, {}", text(row, "scene"), thousands(number(row, "columns"))),
            ours.to_owned(),
            shown(row, "svd_least_lin_db", 1),
            shown(row, "svd_mean_lin_db", 1),
            shown(row, "svd_least_clip_db", 1),
            shown(row, "algorithm4_least_lin_db", 1),
            shown(row, "algorithm4_least_clip_db", 1),
            goal,
            two(row, ("reached_lin_db", 1), ("reached_clip_db", 1)),
        ]);
    }
    table
}

fn gains_say(files: &[Csv]) -> Vec<String> {
    let gains = &files[0];
    let name = |row: &Row| {
        let ours = if text(row, "ours") == AUTO { "noise left out" } else { "`--keep-noise`" };
        format!("`{}`, {ours}", text(row, "scene"))
    };
    let behind = gains.rows.iter().filter_map(|row| {
        let of = |(column, what): (&str, &str)| {
            let least = maybe(row, column).filter(|least| *least < 0.0)?;
            Some(format!("{what} by up to {:.1} dB", -least))
        };
        let lost: Vec<String> =
            [("svd_least_lin_db", "lin"), ("svd_least_clip_db", "clip")].into_iter().filter_map(of).collect();
        (!lost.is_empty()).then(|| format!("{} ({})", name(row), lost.join(", ")))
    });
    let behind: Vec<String> = behind.collect();
    let missed: Vec<String> = gains
        .rows
        .iter()
        .flat_map(|row| {
            [("lin", "goal_lin_db", "reached_lin_db"), ("clip", "goal_clip_db", "reached_clip_db")]
                .into_iter()
                .filter_map(move |(what, goal, reached)| Some((row, what, maybe(row, goal)?, maybe(row, reached)?)))
        })
        .filter(|(.., goal, reached)| reached < goal)
        .map(|(row, what, goal, reached)| format!("{} ({what} {reached:.1} dB, wanted {goal:.0})", name(row)))
        .collect();
    vec![
        listed("Where we lose to the block SVD at some of its sizes", &behind),
        listed("Goals that are not reached", &missed),
    ]
}

fn points(files: &[Csv]) -> Vec<Vec<String>> {
    let points = &files[0];
    let mut table = vec![cells(&["method", "files in all scenes", "precision", "mean ranks", "ratios", "lin, dB"])];
    for method in points.each("method") {
        let of: Vec<&Row> = points.rows.iter().filter(|row| text(row, "method") == method).collect();
        let ranks: Vec<f64> = of.iter().filter_map(|row| maybe(row, "mean_rank")).collect();
        let mut precisions: Vec<&str> = of.iter().map(|row| text(row, "precision")).collect();
        precisions.sort_unstable();
        precisions.dedup();
        let values = |column: &str| of.iter().map(|row| number(row, column)).collect::<Vec<_>>();
        table.push(vec![
            method.to_owned(),
            of.len().to_string(),
            list(&precisions),
            if ranks.is_empty() { dashed(None, 0) } else { span(ranks, 0) },
            format!("{} ×", span(values("ratio"), 0)),
            span(values("psnr_lin_db"), 1),
        ]);
    }
    table
}
