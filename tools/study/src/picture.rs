//! The picture: what one sees after relighting, beside a denoiser that denoises each relit image by itself.

use rayon::prelude::*;

use super::StudyReport;
use super::bench::{Bench, CLASSROOM, CONFERENCE_LAMPS, CORNELL, GLOSSY, MIRROR, SHIRLEY, WATER, Wanted};
use super::interval::{half_interval, mean};
use super::mosaic::Picture;
use super::oidn::{self, Surfaces};
use super::reference::{Judged, LIGHTINGS_NOTE};
use super::rivals::{Packed, packed};
use super::table::{Cell, Table};
use super::visual_metrics::Seen;
use ltm::compress::{CompressSettings, Target};
use ltm::error::Result;
use ltm::image::LinearImage;
use ltm::matrix::{BlockSource, MatrixShape};
use ltm::pipeline::PackOptions;
use ltm::relight::relight_raw;
use ltm::store::StoreReader;

struct Plan {
    scenes: &'static [PlannedScene],
    samples: &'static [u32],
    /// Of the matrices whose images are judged; the reference has seed 1.
    seeds: &'static [u64],
}

struct PlannedScene {
    name: &'static str,
    size: (u32, u32),
    texels: u32,
    /// Samples of the reference, which has another seed.
    converged: u32,
    /// It took part in choosing constants or ways of the denoising.
    tuned_on: bool,
}

const QUICK: Plan = Plan {
    scenes: &[PlannedScene { name: "mixed", size: (64, 48), texels: 4, converged: 256, tuned_on: true }],
    samples: &[16],
    seeds: &[0, 2],
};

const FULL: Plan = Plan {
    scenes: &[
        PlannedScene { name: "mixed", size: (256, 192), texels: 16, converged: 2048, tuned_on: true },
        PlannedScene { name: CONFERENCE_LAMPS, size: (256, 192), texels: 1, converged: 3072, tuned_on: true },
        PlannedScene { name: GLOSSY, size: (192, 192), texels: 16, converged: 2048, tuned_on: true },
        PlannedScene { name: WATER, size: (128, 128), texels: 16, converged: 3072, tuned_on: true },
        PlannedScene { name: SHIRLEY, size: (128, 128), texels: 16, converged: 3072, tuned_on: true },
        PlannedScene { name: MIRROR, size: (128, 128), texels: 16, converged: 2048, tuned_on: true },
        PlannedScene { name: CLASSROOM, size: (256, 192), texels: 8, converged: 2048, tuned_on: false },
        PlannedScene { name: CORNELL, size: (192, 192), texels: 16, converged: 2048, tuned_on: false },
        PlannedScene { name: "diffuse", size: (256, 192), texels: 16, converged: 2048, tuned_on: false },
    ],
    samples: &[16, 64, 256],
    seeds: &[0, 2, 3, 4, 5],
};

/// The lighting whose images are shown: a narrow one, where noise is worst.
const SHOWN: &str = "narrow spot";

const NOTE: &str = "Images against those of a matrix of another seed, mean \
over the lightings; worst where it says so. ꟻLIP: 67 pixels a degree, exposed to the reference's 95th luminance percentile, \
extended Reinhard (white at 4, times 1.6), sRGB. clip: PSNR after the same exposure, clipped. Seams: the error's mean jump across \
block edges over that inside, after a median of three along the edge. Glow: pixels where the raw matrix is exactly black and \
the image is above 1 % of that percentile; negative: pixels below −1 % of it; both in thousandths of all pixels. Denoiser: Intel's \
Open Image Denoise on each raw relit image, high quality, with the reference's own albedo and normals as noise-free guides. Ours: as \
`ltm-pack` chooses by itself; packing: ours against the cleaned images, hardly compressed (120 dB); without cleaning: `--denoise off`; these two of the first seed \
alone. Bytes and rank are means over the seeds, intervals half of those of 95 % of the mean by the seeds.";

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let plan = if bench.quick { &QUICK } else { &FULL };
    let with_denoiser = oidn::OIDN.is_there();
    let mut table = table(bench, with_denoiser);
    let mut each = each_table(bench);
    let scenes: Vec<_> = plan.scenes.iter().filter(|scene| bench.has(scene.name)).collect();
    let mut report = StudyReport::default();
    let mut pictures = Vec::new();
    bench.watch.begin("picture", (scenes.len() * plan.samples.len() * plan.seeds.len()) as u64, "matrices");
    for scene in scenes {
        let wanted = Wanted {
            scene: scene.name,
            size: scene.size,
            texels: scene.texels,
            samples: scene.converged,
            seed: 1,
            block_side: 32,
        };
        let reference = bench.matrix(wanted)?;
        let judged = Judged::of(&reference)?;
        let surfaces = Surfaces::of(&reference)?.filter(|_| with_denoiser);
        let mut rows = Vec::new();
        for &samples in plan.samples {
            let mut measured: Vec<Measured> = Vec::new();
            for &seed in plan.seeds {
                let is_first = seed == plan.seeds[0];
                let matrix = bench.matrix(Wanted { samples, seed, ..wanted })?;
                let rivals = rivals(bench, &matrix, &judged, surfaces.as_ref(), is_first)?;
                for rival in &rivals {
                    let seen = seen_beside(&judged.references, &matrix, &rival.images, &rivals);
                    let cleaned = rivals.iter().find(|other| other.method == CLEANED && rival.method == OURS);
                    let packing = cleaned.map(|cleaned| seen_beside(&cleaned.images, &matrix, &rival.images, &rivals));
                    if is_first {
                        each_rows(&mut each, scene, samples, rival, &judged, &seen);
                    }
                    Measured::add(&mut measured, rival, seen, packing);
                }
                if is_first {
                    rows.push(shown(scene, samples, &rivals, &judged));
                }
                bench.watch.advance(1, matrix.shape().raw_bytes(), "B");
            }
            measured.iter().for_each(|measured| table.push(row(scene, reference.shape(), samples, measured)));
        }
        pictures.push((format!("picture-{}", scene.name), rows));
    }
    bench.watch.end();
    report.add_table(&bench.out, "picture", &table)?;
    report.add_csv(&bench.out, "picture-lightings", &each)?;
    for (stem, rows) in &pictures {
        report.add_pictures(&bench.out, stem, rows, 1)?;
    }
    Ok(report)
}

fn table(bench: &Bench<'_>, with_denoiser: bool) -> Table {
    let absent = "The denoiser was not measured: no Python with `pyoidn` was found.";
    let notes = [NOTE, LIGHTINGS_NOTE, absent];
    Table::new(
        "The picture, beside a denoiser on each image",
        bench.notes(if with_denoiser { &notes[..2] } else { &notes }),
        &[
            ("scene", 0),
            ("tuned_on", 0),
            ("samples_per_px", 0),
            ("reference_samples_per_px", 0),
            ("method", 0),
            ("rows", 0),
            ("columns", 0),
            ("mean_rank", 2),
            ("bytes", 0),
            ("flip", 4),
            ("flip_worst", 4),
            ("psnr_clip_db", 2),
            ("psnr_clip_worst_db", 2),
            ("psnr_lin_db", 2),
            ("relative_l2", 4),
            ("seams", 3),
            ("glow_permille", 2),
            ("negative_permille", 2),
            ("packing_flip", 4),
            ("packing_flip_worst", 4),
            ("packing_seams", 3),
            ("seeds", 0),
            ("flip_interval", 4),
            ("psnr_clip_interval_db", 2),
        ],
    )
}

/// One way from samples to images.
struct Rival {
    method: &'static str,
    rank: Option<f64>,
    bytes: Option<u64>,
    /// One for each lighting.
    images: Vec<LinearImage>,
}

const RAW: &str = "raw matrix";
const OURS: &str = "ours";
/// Denoised and hardly compressed: what packing itself costs shows beside it, whatever the reference's noise.
const CLEANED: &str = "cleaned, hardly compressed";
/// Where no entry that matters is left out.
const MAX_DB: f64 = 120.0;

/// What one way reached with every seed.
struct Measured {
    method: &'static str,
    ranks: Vec<f64>,
    bytes: Vec<f64>,
    /// By seed, then by lighting.
    seen: Vec<Vec<Seen>>,
    packing: Option<Vec<Seen>>,
}

impl Measured {
    fn add(all: &mut Vec<Self>, rival: &Rival, seen: Vec<Seen>, packing: Option<Vec<Seen>>) {
        let method = rival.method;
        let at = all.iter().position(|measured| measured.method == method).unwrap_or_else(|| {
            all.push(Self { method, ranks: Vec::new(), bytes: Vec::new(), seen: Vec::new(), packing: None });
            all.len() - 1
        });
        let own = &mut all[at];
        own.ranks.extend(rival.rank);
        own.bytes.extend(rival.bytes.map(|bytes| bytes as f64));
        own.seen.push(seen);
        own.packing = own.packing.take().or(packing);
    }
}

/// Those that show what parts of ours do only where `with_parts` says so.
fn rivals(
    bench: &Bench<'_>,
    matrix: &StoreReader,
    judged: &Judged,
    surfaces: Option<&Surfaces>,
    with_parts: bool,
) -> Result<Vec<Rival>> {
    let lightings = &judged.lightings;
    let ours = |method, denoise, target| -> Result<Rival> {
        let compress = CompressSettings { target, ..CompressSettings::default() };
        let Packed { rank, bytes, images, .. } = packed(
            bench,
            matrix,
            PackOptions { allow_lost_lights: true, denoise, compress, ..PackOptions::default() },
            lightings,
        )?;
        Ok(Rival { method, rank, bytes: Some(bytes), images })
    };
    let mut rivals = vec![ours(OURS, true, Target::Automatic)?];
    if with_parts {
        rivals.push(ours(CLEANED, true, Target::PsnrDb(MAX_DB))?);
        rivals.push(ours("ours without cleaning", false, Target::Automatic)?);
    }
    let raw = relight_raw(matrix, lightings)?;
    if let Some(surfaces) = surfaces {
        let images = oidn::denoise(&raw, surfaces, &bench.cached("oidn"))?;
        rivals.push(Rival { method: "denoiser on each image", rank: None, bytes: None, images });
    }
    rivals.push(Rival { method: RAW, rank: None, bytes: Some(matrix.shape().raw_bytes()), images: raw });
    Ok(rivals)
}

/// What is seen of images beside those that they should be.
fn seen_beside(
    references: &[LinearImage],
    matrix: &StoreReader,
    images: &[LinearImage],
    rivals: &[Rival],
) -> Vec<Seen> {
    let raw = rivals.iter().find(|rival| rival.method == RAW).map_or(&[][..], |raw| &raw.images);
    images
        .par_iter()
        .zip(references)
        .zip(raw)
        .map(|((image, reference), raw)| Seen::of(image, reference, raw, matrix.shape().block_side()))
        .collect()
}

fn each_table(bench: &Bench<'_>) -> Table {
    Table::new(
        "The picture under each lighting",
        bench.notes(&["References and measures as in `picture.csv`."]),
        &[("scene", 0), ("samples_per_px", 0), ("lighting", 0), ("method", 0), ("flip", 4), ("psnr_clip_db", 2)],
    )
}

fn each_rows(table: &mut Table, scene: &PlannedScene, samples: u32, rival: &Rival, judged: &Judged, seen: &[Seen]) {
    for (name, seen) in judged.names.iter().zip(seen) {
        let who = [scene.name.into(), samples.into(), (*name).into(), rival.method.into()];
        table.push(who.into_iter().chain([seen.flip.into(), seen.psnr_clipped.into()]).collect());
    }
}

fn row(scene: &PlannedScene, shape: MatrixShape, samples: u32, measured: &Measured) -> Vec<Cell> {
    let all = || measured.seen.iter().flatten();
    let of_all = |part: fn(&Seen) -> f64| mean(all().map(part));
    let worst = |part: fn(&Seen) -> f64| all().map(part).fold(f64::NEG_INFINITY, f64::max);
    let interval = |part: fn(&Seen) -> f64| {
        let by_seed: Vec<f64> = measured.seen.iter().map(|seen| mean(seen.iter().map(part))).collect();
        half_interval(&by_seed)
    };
    let known = |values: &[f64]| (!values.is_empty()).then(|| mean(values.iter().copied()));
    let packing = |part: fn(&Seen) -> f64| measured.packing.as_ref().map(|seen| mean(seen.iter().map(part)));
    vec![
        scene.name.into(),
        scene.tuned_on.into(),
        samples.into(),
        scene.converged.into(),
        measured.method.into(),
        shape.rows().into(),
        shape.columns().into(),
        known(&measured.ranks).into(),
        known(&measured.bytes).into(),
        of_all(|s| s.flip).into(),
        worst(|s| s.flip).into(),
        of_all(|s| s.psnr_clipped).into(),
        (-worst(|s| -s.psnr_clipped)).into(),
        of_all(|s| s.psnr_linear).into(),
        of_all(|s| s.relative_l2).into(),
        of_all(|s| s.seams).into(),
        of_all(|s| 1e3 * s.glow).into(),
        of_all(|s| 1e3 * s.negative).into(),
        packing(|s| s.flip).into(),
        measured.packing.as_ref().map(|seen| seen.iter().map(|s| s.flip).fold(0.0, f64::max)).into(),
        packing(|s| s.seams).into(),
        measured.seen.len().into(),
        interval(|s| s.flip).into(),
        interval(|s| s.psnr_clipped).into(),
    ]
}

/// The images of one lighting by every way, and the reference.
fn shown(scene: &PlannedScene, samples: u32, rivals: &[Rival], judged: &Judged) -> Vec<Picture> {
    let at = judged.names.iter().position(|name| *name == SHOWN).unwrap_or(0);
    let reference = &judged.references[at];
    let picture = |rival: &Rival| {
        // A caption is as wide as its picture.
        let caption =
            if rival.method == OURS { format!("{}, {samples} samples", scene.name) } else { rival.method.into() };
        Picture::shown(&rival.images[at], reference, caption)
    };
    let rivals = rivals.iter().filter(|rival| rival.method != CLEANED);
    rivals.map(picture).chain([Picture::shown(reference, reference, "reference")]).collect()
}
