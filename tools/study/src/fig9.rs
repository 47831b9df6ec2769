//! Figure 9 of the paper: PSNR against the bytes of a file, for every compressor, on every kind of scene.

use super::bench::{Bench, Wanted};
use super::chart::{Axis, Chart, Line, Panel};
use super::dct;
use super::measured::Summary;
use super::reference::{Judged, LIGHTINGS_NOTE};
use super::rivals::{BlockSvd, Packed, Ranks, kernel, product};
use super::table::{Cell, Table};
use super::{StudyReport, curve, zfp};
use ltm::compress::{CompressSettings, Method, Target};
use ltm::error::Result;
use ltm::image::LinearImage;
use ltm::matrix::BlockSource;
use ltm::store::StoreReader;

pub(super) const OURS: &str = "ours (auto)";
/// Ours without stopping at the noise: follows the matrix as it is.
const NOISE_KEPT: &str = "ours (noise kept)";
pub(super) const ALGORITHM4: &str = "Algorithm 4";
const SVD: &str = "block SVD (one threshold)";
const SVD_FIXED: &str = "block SVD (fixed rank)";

/// Matrices of one resolution of the light.
struct Matrices {
    /// Texels along a side of the light.
    texels: u32,
    size: (u32, u32),
    scenes: &'static [&'static str],
}

struct Plan {
    matrices: &'static [Matrices],
    samples: u32,
    /// Bytes that ours is asked for: the matrix over these.
    ratios: &'static [f64],
    /// Ranks of the methods that have one.
    ranks: &'static [usize],
    /// Exponents of two of the DCT's steps under its scale.
    steps: &'static [i32],
    /// Exponents of two of zfp's tolerances over the largest entry, which are kept by far.
    tolerances: &'static [i32],
    /// The matrix over the bytes at which all are read off; of the environment, which has fewer columns.
    fixed: (f64, f64),
}

const QUICK: Plan = Plan {
    matrices: &[Matrices { texels: 16, size: (64, 48), scenes: &["diffuse", "mixed"] }],
    samples: 64,
    ratios: &[400.0, 150.0, 50.0],
    ranks: &[2, 6, 16],
    steps: &[-5, -7, -9],
    tolerances: &[2, -2],
    fixed: (60.0, 60.0),
};

const FULL: Plan = Plan {
    matrices: &[Matrices {
        texels: 32,
        size: (64, 64),
        scenes: &["diffuse", "reflections", "caustics", "mixed", "environment"],
    }],
    samples: 256,
    ratios: &[4000.0, 1500.0, 600.0, 350.0, 200.0, 100.0],
    ranks: &[1, 2, 4, 8, 16, 32],
    steps: &[-2, -3, -4, -6, -7, -8, -10],
    tolerances: &[8, 6, 4, 2, 0, -2, -5],
    fixed: (1000.0, 400.0),
};

/// Fidelity that was set as the goal for 1,024 columns (512 of the environment): scene, ratio, lin and clip in dB.
const GOALS: [(&str, f64, f64, f64); 5] = [
    ("diffuse", 500.0, 47.0, 42.0),
    ("reflections", 600.0, 54.0, 29.0),
    ("caustics", 600.0, 54.0, 33.0),
    ("mixed", 600.0, 66.0, 33.0),
    ("environment", 220.0, 47.0, 41.0),
];

const COLUMNS: &[(&str, usize)] = &[
    ("scene", 0),
    ("method", 0),
    ("rows", 0),
    ("columns", 0),
    ("block_px", 0),
    ("samples_per_px", 0),
    ("precision", 0),
    ("mean_rank", 2),
    ("bytes", 0),
    ("ratio", 1),
    ("psnr_lin_db", 2),
    ("psnr_lin_worst_db", 2),
    ("psnr_clip_db", 2),
    ("psnr_clip_worst_db", 2),
    ("relative_l2", 4),
    ("rel_mse", 5),
    ("flip", 4),
    ("seconds", 2),
];

pub(super) const METRIC_NOTE: &str = "Images of the packed file against those of the raw matrix, mean over the lightings \
(worst where it says so). lin: PSNR with the peak at the reference's largest value; clip: PSNR after exposing the \
reference's 95th luminance percentile to 1 and clipping to [0, 1]; relMSE: (a − b)² / (b² + 0.01) after that exposure; \
ꟻLIP: mean, of the exposed 8-bit sRGB images, at 67 pixels a degree.";

const FORMS_NOTE: &str = "Bytes are those of whole files. Algorithm 4, the proposed method: `ltm-pack` with its codec at a fixed \
rank. Kernel Nyström: the same codec, rows and columns as Algorithm 4, the power map that suits each block best, kept within \
its entries. Block SVD: 16-bit floats, byte planes, zstd 12. DCT: over pixels and texels, one step, zstd 12. zfp: each colour of a \
block over pixels and texels, one absolute tolerance, zstd 12. Both in four dimensions, light by light; lamps of one column are one row.";

/// What is read off a summary.
type Value = fn(&Summary) -> f64;

/// One point of one method.
struct Point {
    method: &'static str,
    precision: &'static str,
    packed: Packed,
    summary: Summary,
}

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let plan = if bench.quick { &QUICK } else { &FULL };
    let mut report = StudyReport::default();
    let points_per_scene = 2 * plan.ratios.len() + 4 * plan.ranks.len() + plan.steps.len() + plan.tolerances.len();
    let files = |scenes: &[&str]| points_per_scene * scenes.len();
    let total: usize = plan.matrices.iter().map(|m| files(&bench.with_conference(m.scenes))).sum();
    bench.watch.begin("fig9", total as u64, "files");
    for &Matrices { texels, size, scenes } in plan.matrices {
        let notes = bench.notes(&[METRIC_NOTE, LIGHTINGS_NOTE, FORMS_NOTE]);
        let mut table = Table::new(format!("PSNR against bytes, light of {texels} × {texels}"), notes, COLUMNS);
        let mut panels = (Vec::new(), Vec::new());
        let mut gains = gain_table(bench, texels);
        let mut fixed = fixed_table(bench, texels);
        for scene in bench.with_conference(scenes) {
            let wanted = Wanted { scene, size, texels, samples: plan.samples, seed: 0, block_side: 32 };
            let matrix = bench.matrix(wanted)?;
            let points = measure(bench, plan, &matrix)?;
            for point in &points {
                table.push(row(&matrix, scene, point));
            }
            let lines = |value: Value| curves(&points, value);
            let title = format!("{scene}, {} columns", matrix.shape().columns());
            panels.0.push(Panel { title: title.clone(), lines: lines(|s| s.mean.psnr_linear) });
            panels.1.push(Panel { title, lines: lines(|s| s.mean.psnr_clipped) });
            let ratio = if scene == "environment" { plan.fixed.1 } else { plan.fixed.0 };
            fixed_rows(&mut fixed, &matrix, (scene, ratio), &points);
            for ours in [OURS, NOISE_KEPT] {
                gain_row(&mut gains, &matrix, scene, ours, &points);
            }
        }
        let caption = bench.caption(&format!("{} spp, blocks of 32 px, mean of the lightings", plan.samples));
        report.add_table(&bench.out, &format!("fig9-{texels}"), &table)?;
        report.add_table(&bench.out, &format!("fig9-{texels}-gain"), &gains)?;
        report.add_table(&bench.out, &format!("fig9-{texels}-fixed"), &fixed)?;
        for (panels, name, what) in [(panels.0, "PSNR lin (dB)", "lin"), (panels.1, "PSNR clip (dB)", "clip")] {
            let chart = Chart {
                title: format!("PSNR ({what}) against bytes on disk, light of {texels} × {texels} texels"),
                caption: caption.clone(),
                x: Axis::logarithmic("bytes of the file"),
                y: Axis::linear(name),
                panels,
            };
            report.add_chart(&bench.out, &format!("fig9-{texels}-{what}"), &chart)?;
        }
    }
    bench.watch.end();
    Ok(report)
}

fn measure(bench: &Bench<'_>, plan: &Plan, matrix: &StoreReader) -> Result<Vec<Point>> {
    let shape = matrix.shape();
    let Judged { lightings, references, .. } = Judged::of(matrix)?;
    let mut points = Vec::new();
    let mut keep = |method, precision, packed: Packed| {
        let summary = Summary::of(&packed.images, &references);
        bench.watch.advance(1, packed.bytes, "B");
        points.push(Point {
            method,
            precision,
            packed: Packed { images: Vec::<LinearImage>::new(), ..packed },
            summary,
        });
    };
    for ratio in plan.ratios {
        let target = Target::Bytes((shape.raw_bytes() as f64 / ratio) as u64);
        let settings = CompressSettings { target, ..CompressSettings::default() };
        keep(OURS, "chosen steps", product(bench, matrix, &settings, &lightings)?);
        let settings = CompressSettings { noise_factor: None, ..settings };
        keep(NOISE_KEPT, "chosen steps", product(bench, matrix, &settings, &lightings)?);
    }
    for &rank in plan.ranks {
        let settings = CompressSettings { rank, ..CompressSettings::of_method(Method::Algorithm4) };
        keep(ALGORITHM4, "16 bits coded", product(bench, matrix, &settings, &lightings)?);
    }
    for &rank in plan.ranks {
        keep("kernel Nyström", "16 bits coded", kernel(bench, matrix, rank, &lightings)?);
    }
    let largest_rank = plan.ranks.iter().copied().max().unwrap_or(1);
    // A threshold for all wants more than the mean in some blocks.
    let svd = BlockSvd::new(matrix, 3 * largest_rank, None)?;
    for &rank in plan.ranks {
        keep(SVD, "f16 + zstd", svd.pack(bench, matrix, Ranks::Mean(rank as f64), &lightings)?);
        keep(SVD_FIXED, "f16 + zstd", svd.pack(bench, matrix, Ranks::Fixed(rank), &lightings)?);
    }
    drop(svd);
    let scale = dct::scale(matrix)?;
    let steps: Vec<f32> = plan.steps.iter().map(|e| scale * (*e as f32).exp2()).collect();
    bench.stop_if_interrupted()?;
    let begun = std::time::Instant::now();
    let files = dct::write(matrix, &steps, &bench.cached("dct"))?;
    let seconds = begun.elapsed().as_secs_f64() / steps.len() as f64;
    for (path, step) in files.iter().zip(steps) {
        let images = dct::read(path, step, shape, &matrix.job().basis, &lightings)?;
        let packed = Packed { bytes: super::bench::file_bytes(path)?, rank: None, seconds, images };
        keep("DCT", "one step + zstd", packed);
    }
    let largest = zfp::scale(matrix)?;
    for &exponent in plan.tolerances {
        bench.stop_if_interrupted()?;
        let (path, tolerance) = (bench.cached("zfp"), largest * (exponent as f32).exp2());
        let begun = std::time::Instant::now();
        zfp::write(matrix, tolerance, &path)?;
        let seconds = begun.elapsed().as_secs_f64();
        let images = zfp::read(&path, tolerance, shape, &matrix.job().basis, &lightings)?;
        let packed = Packed { bytes: super::bench::file_bytes(&path)?, rank: None, seconds, images };
        keep("zfp", "one tolerance + zstd", packed);
    }
    Ok(points)
}

fn row(matrix: &StoreReader, scene: &str, point: &Point) -> Vec<Cell> {
    let (shape, Summary { mean, worst }) = (matrix.shape(), &point.summary);
    vec![
        scene.into(),
        point.method.into(),
        shape.rows().into(),
        shape.columns().into(),
        shape.block_side().into(),
        matrix.job().provenance.samples_per_pixel.into(),
        point.precision.into(),
        point.packed.rank.into(),
        point.packed.bytes.into(),
        (shape.raw_bytes() as f64 / point.packed.bytes as f64).into(),
        mean.psnr_linear.into(),
        worst.psnr_linear.into(),
        mean.psnr_clipped.into(),
        worst.psnr_clipped.into(),
        mean.relative_l2.into(),
        mean.rel_mse.into(),
        mean.flip.into(),
        point.packed.seconds.into(),
    ]
}

/// A line for each method, in the order of their first points.
fn curves(points: &[Point], value: Value) -> Vec<Line> {
    let mut lines: Vec<Line> = Vec::new();
    for point in points {
        let at = (point.packed.bytes as f64, value(&point.summary));
        match lines.iter_mut().find(|line| line.name == point.method) {
            Some(line) => line.points.push(at),
            None => lines.push(Line { name: point.method.into(), points: vec![at] }),
        }
    }
    lines
}

fn fixed_table(bench: &Bench<'_>, texels: u32) -> Table {
    let note = "Each method where its file has the bytes of the matrix over the ratio, on the straight lines between its points over the \
logarithm of the bytes; – where it has no point on one side.";
    Table::new(
        format!("All methods at one size, light of {texels} × {texels}"),
        bench.notes(&[METRIC_NOTE, LIGHTINGS_NOTE, FORMS_NOTE, note]),
        &[
            ("scene", 0),
            ("columns", 0),
            ("ratio", 0),
            ("method", 0),
            ("psnr_lin_db", 1),
            ("psnr_clip_db", 1),
            ("psnr_lin_worst_db", 1),
            ("psnr_clip_worst_db", 1),
        ],
    )
}

/// A row for each method.
fn fixed_rows(table: &mut Table, matrix: &StoreReader, (scene, ratio): (&str, f64), points: &[Point]) {
    const VALUES: [Value; 4] =
        [|s| s.mean.psnr_linear, |s| s.mean.psnr_clipped, |s| s.worst.psnr_linear, |s| s.worst.psnr_clipped];
    let (shape, bytes) = (matrix.shape(), matrix.shape().raw_bytes() as f64 / ratio);
    for method in curves(points, VALUES[0]).into_iter().map(|line| line.name) {
        let mut cells: Vec<Cell> = vec![scene.into(), shape.columns().into(), ratio.into(), method.clone().into()];
        for value in VALUES {
            let of = points.iter().filter(|point| point.method == method);
            let line: Vec<_> = of.map(|p| ((p.packed.bytes as f64).ln(), value(&p.summary))).collect();
            cells.push(curve::at(&line, bytes.ln()).into());
        }
        table.push(cells);
    }
}

fn gain_table(bench: &Bench<'_>, texels: u32) -> Table {
    let note = "Least and mean gain of ours in dB at the other's byte sizes (interpolated over log bytes; where ours took fewer bytes \
than it was given, as it is); – where ours has no file as small. Reached: ours at the goal's ratio, interpolated.";
    Table::new(
        format!("Ours against the others at equal bytes, light of {texels} × {texels}"),
        bench.notes(&[note]),
        &[
            ("scene", 0),
            ("ours", 0),
            ("columns", 0),
            ("algorithm4_least_lin_db", 1),
            ("algorithm4_mean_lin_db", 1),
            ("algorithm4_least_clip_db", 1),
            ("svd_least_lin_db", 1),
            ("svd_mean_lin_db", 1),
            ("svd_least_clip_db", 1),
            ("goal_ratio", 0),
            ("goal_lin_db", 0),
            ("reached_lin_db", 1),
            ("goal_clip_db", 0),
            ("reached_clip_db", 1),
        ],
    )
}

fn gain_row(table: &mut Table, matrix: &StoreReader, scene: &str, ours: &str, points: &[Point]) {
    let line = |method: &str, value: Value| -> Vec<(f64, f64)> {
        let of = points.iter().filter(|p| p.method == method);
        of.map(|p| ((p.packed.bytes as f64).ln(), value(&p.summary))).collect()
    };
    let gain = |method: &str, value| curve::gain(&line(ours, value), &line(method, value));
    let lin: Value = |s| s.mean.psnr_linear;
    let clip: Value = |s| s.mean.psnr_clipped;
    let mut cells: Vec<Cell> = vec![scene.into(), ours.into(), matrix.shape().columns().into()];
    for method in [ALGORITHM4, SVD] {
        let (in_lin, in_clip) = (gain(method, lin), gain(method, clip));
        cells.extend([in_lin.map(|g| g.least).into(), in_lin.map(|g| g.mean).into(), in_clip.map(|g| g.least).into()]);
    }
    let columns = matrix.shape().columns();
    match GOALS.iter().find(|g| g.0 == scene && columns == if scene == "environment" { 512 } else { 1024 }) {
        Some(&(_, ratio, goal_lin, goal_clip)) => {
            let at = (matrix.shape().raw_bytes() as f64 / ratio).ln();
            let reached = |value| Cell::from(curve::at(&line(ours, value), at));
            cells.extend([ratio.into(), goal_lin.into(), reached(lin), goal_clip.into(), reached(clip)]);
        }
        None => cells.extend((0..5).map(|_| Cell::Missing)),
    }
    table.push(cells);
}
