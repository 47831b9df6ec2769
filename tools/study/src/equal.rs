//! Equal error: how many samples, and how much time, the raw matrix takes to be as near to the truth as what is packed.

use super::bench::{Bench, CONFERENCE, CONFERENCE_LAMPS, Wanted};
use super::measured::Summary;
use super::oidn::{self, Surfaces};
use super::reference::{HALF_NARROW_NOTE, Judged};
use super::table::{Cell, Table};
use super::timing::{Clock, Took};
use super::{StudyReport, curve};
use ltm::container::ContainerReader;
use ltm::error::Result;
use ltm::image::LinearImage;
use ltm::matrix::{BlockSource, MatrixShape};
use ltm::pipeline::{self, PackOptions, RenderOptions};
use ltm::relight::{CpuRelighter, relight_raw};
use ltm::store::StoreReader;

struct Plan {
    scenes: &'static [PlannedScene],
    /// Samples of what is packed.
    packed: &'static [u32],
    /// Samples of the raw matrix.
    raw: &'static [u32],
}

struct PlannedScene {
    name: &'static str,
    size: (u32, u32),
    texels: u32,
    /// Samples of the reference, which has another seed.
    converged: u32,
}

const QUICK: Plan = Plan {
    scenes: &[PlannedScene { name: "diffuse", size: (64, 48), texels: 4, converged: 1024 }],
    packed: &[8],
    raw: &[8, 64, 512],
};

const FULL: Plan = Plan {
    scenes: &[
        PlannedScene { name: CONFERENCE_LAMPS, size: (256, 192), texels: 1, converged: 3072 },
        PlannedScene { name: CONFERENCE, size: (192, 144), texels: 32, converged: 2048 },
        PlannedScene { name: "diffuse", size: (256, 192), texels: 16, converged: 2048 },
        PlannedScene { name: "reflections", size: (192, 144), texels: 16, converged: 2048 },
        PlannedScene { name: "mixed", size: (256, 192), texels: 16, converged: 2048 },
        PlannedScene { name: "caustics", size: (192, 144), texels: 16, converged: 2048 },
    ],
    packed: &[16, 64],
    raw: &[16, 64, 256, 1024],
};

const NOTE: &str = "Images against those of a matrix of another seed, mean over the lightings. Packed: rendered, cleaned and packed in one, \
as `ltm render --pack` does. Raw: the matrix rendered into a file, and relit from it. Denoised: Intel's Open Image Denoise on each image \
of the raw matrix, high quality, with the reference's albedo and normals as noise-free guides; its own time, which each image takes anew, is \
not in the seconds. secs: from the scene to the file, best of two but for the \
raw matrices of most samples; cpu: processors' seconds of all threads. Raw samples and seconds at the error of the packed images: on the line \
between the two measured numbers of samples around it, on logarithmic axes (clip: dB against the logarithm of samples); none where all \
numbers of samples are on one side.";

/// A number of samples, one way.
struct Point {
    samples: u32,
    took: Took,
    bytes: u64,
    summary: Summary,
}

/// What is read off a point.
type Read = fn(&Point) -> f64;

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let plan = if bench.quick { &QUICK } else { &FULL };
    let with_denoiser = oidn::OIDN.is_there();
    let mut notes = bench.notes(&[NOTE, HALF_NARROW_NOTE]);
    if !with_denoiser {
        notes.push("The denoiser was not measured: no Python with `pyoidn` was found.".into());
    }
    let (mut points, mut ratios) = (points_table(notes.clone()), ratios_table(notes));
    let has = |scene: &&PlannedScene| bench.loaded(scene.wanted()).is_ok();
    let scenes: Vec<_> = plan.scenes.iter().filter(has).collect();
    bench.watch.begin("equal error", (scenes.len() * (plan.packed.len() + plan.raw.len())) as u64, "matrices");
    for scene in scenes {
        let reference = bench.matrix(scene.wanted())?;
        let (shape, judged) = (reference.shape(), Judged::half_narrow(&reference)?);
        let surfaces = if with_denoiser { Surfaces::of(&reference)? } else { None };
        let mut tell = |way: &str, point: &Point| points.push(point_row(scene, shape, way, point));
        let mut of_packed = Vec::new();
        for &samples in plan.packed {
            bench.stop_if_interrupted()?;
            let point = packed(bench, scene, samples, &judged)?;
            tell("packed", &point);
            bench.watch.advance(1, point.bytes, "B");
            of_packed.push(point);
        }
        let (mut of_raw, mut of_denoised) = (Vec::new(), Vec::new());
        for &samples in plan.raw {
            bench.stop_if_interrupted()?;
            let times = if Some(&samples) == plan.raw.iter().max() { 1 } else { 2 };
            let (point, denoised) = raw(bench, scene, samples, times, (&judged, surfaces.as_ref()))?;
            tell("raw matrix", &point);
            denoised.iter().for_each(|denoised| tell("raw matrix, each image denoised", denoised));
            bench.watch.advance(1, point.bytes, "B");
            of_raw.push(point);
            of_denoised.extend(denoised);
        }
        of_packed.iter().for_each(|packed| ratios.push(ratio_row(scene, shape, packed, [&of_raw, &of_denoised])));
    }
    bench.watch.end();
    let mut report = StudyReport::default();
    report.add_table(&bench.out, "equal", &ratios)?;
    report.add_table(&bench.out, "equal-points", &points)?;
    Ok(report)
}

impl PlannedScene {
    /// The reference.
    fn wanted(&self) -> Wanted {
        let Self { name, size, texels, converged, .. } = *self;
        Wanted { scene: name, size, texels, samples: converged, seed: 1, block_side: 32 }
    }
}

fn points_table(notes: Vec<String>) -> Table {
    Table::new(
        "Error and time of packed images and of raw matrices",
        notes,
        &[
            ("scene", 0),
            ("way", 0),
            ("samples_per_px", 0),
            ("rows", 0),
            ("columns", 0),
            ("bytes", 0),
            ("secs", 2),
            ("cpu_secs", 2),
            ("flip", 4),
            ("flip_worst", 4),
            ("psnr_clip_db", 2),
            ("psnr_clip_worst_db", 2),
        ],
    )
}

fn ratios_table(notes: Vec<String>) -> Table {
    Table::new(
        "What the raw matrix takes to be as near as packed images",
        notes,
        &[
            ("scene", 0),
            ("samples_per_px", 0),
            ("rows", 0),
            ("columns", 0),
            ("flip", 4),
            ("psnr_clip_db", 2),
            ("cpu_secs", 1),
            ("raw_samples_at_flip", 0),
            ("raw_samples_at_clip", 0),
            ("raw_cpu_over_ours_at_flip", 1),
            ("raw_cpu_over_ours_at_clip", 1),
            ("denoised_samples_at_flip", 0),
            ("denoised_samples_at_clip", 0),
            ("denoised_cpu_over_ours_at_flip", 1),
            ("denoised_cpu_over_ours_at_clip", 1),
        ],
    )
}

fn point_row(scene: &PlannedScene, shape: MatrixShape, way: &str, point: &Point) -> Vec<Cell> {
    let Point { samples, took, bytes, summary } = point;
    vec![
        scene.name.into(),
        way.into(),
        (*samples).into(),
        shape.rows().into(),
        shape.columns().into(),
        (*bytes).into(),
        took.secs.into(),
        took.cpu_secs.into(),
        summary.mean.flip.into(),
        summary.worst.flip.into(),
        summary.mean.psnr_clipped.into(),
        summary.worst.psnr_clipped.into(),
    ]
}

/// A row for what is packed, beside the raw matrix and its denoised images.
fn ratio_row(scene: &PlannedScene, shape: MatrixShape, packed: &Point, others: [&[Point]; 2]) -> Vec<Cell> {
    // What grows with samples, at the error of the packed images.
    let at = |others: &[Point], error: Read, cost: Read| {
        let line: Vec<(f64, f64)> = others.iter().map(|point| (error(point), cost(point).ln())).collect();
        curve::at(&line, error(packed)).map(f64::exp)
    };
    let [flip, clip]: [Read; 2] = [|p| p.summary.mean.flip.ln(), |p| p.summary.mean.psnr_clipped];
    let [samples, seconds]: [Read; 2] = [|p| f64::from(p.samples), |p| p.took.cpu_secs];
    let over = |other: Option<f64>| Cell::from(other.map(|other| other / seconds(packed)));
    let mut cells = vec![
        scene.name.into(),
        packed.samples.into(),
        shape.rows().into(),
        shape.columns().into(),
        packed.summary.mean.flip.into(),
        packed.summary.mean.psnr_clipped.into(),
        packed.took.cpu_secs.into(),
    ];
    for other in others {
        cells.extend([flip, clip].map(|error| Cell::from(at(other, error, samples))));
        cells.extend([flip, clip].map(|error| over(at(other, error, seconds))));
    }
    cells
}

/// Runs something so many times, at least once: the last result and the least time.
fn best_of<T>(times: u32, run: impl Fn() -> Result<T>) -> Result<(T, Took)> {
    let timed = || -> Result<(T, Took)> {
        let clock = Clock::start();
        let result = run()?;
        Ok((result, clock.stop()))
    };
    (1..times).try_fold(timed()?, |(_, least), _| timed().map(|(result, took)| (result, took.least(least))))
}

fn packed(bench: &Bench<'_>, scene: &PlannedScene, samples: u32, judged: &Judged) -> Result<Point> {
    let path = bench.cached("equal.ltc");
    let mut options = PackOptions { allow_lost_lights: true, denoise: true, ..PackOptions::default() };
    options.container.overwrite = true;
    let wanted = Wanted { samples, seed: 0, ..scene.wanted() };
    let ((_, report), took) =
        best_of(2, || pipeline::render_packed(bench.loaded(wanted)?, &path, &options, &bench.silent()))?;
    let relighter = CpuRelighter::load(&ContainerReader::open(&path)?)?;
    let images = judged.lightings.iter().map(|lighting| relighter.relight(lighting)).collect::<Result<Vec<_>>>()?;
    Ok(Point { samples, took, bytes: report.packed_bytes, summary: Summary::of(&images, &judged.references) })
}

/// The raw matrix, and its images denoised where surfaces are given.
fn raw(
    bench: &Bench<'_>,
    scene: &PlannedScene,
    samples: u32,
    times: u32,
    (judged, surfaces): (&Judged, Option<&Surfaces>),
) -> Result<(Point, Option<Point>)> {
    let path = bench.cached("equal.ltm");
    let mut options = RenderOptions::default();
    options.store.overwrite = true;
    let wanted = Wanted { samples, seed: 0, ..scene.wanted() };
    let (_, took) =
        best_of(times, || pipeline::render(bench.loaded(wanted)?, &path, &options, &bench.silent()).map(drop))?;
    let matrix = StoreReader::open(&path)?;
    let images = relight_raw(&matrix, &judged.lightings)?;
    let bytes = matrix.tally()?.stored_bytes;
    let point =
        |images: &[LinearImage]| Point { samples, took, bytes, summary: Summary::of(images, &judged.references) };
    let denoised = surfaces.map(|surfaces| oidn::denoise(&images, surfaces, &bench.cached("oidn"))).transpose()?;
    Ok((point(&images), denoised.as_deref().map(point)))
}
