//! The value of each technique: from a plain block SVD to what `ltm-pack` does today, one more technique in each row,
//! all at the same bytes. Algorithm 4 and general codecs, each at its best, are listed as well.

use std::path::{Path, PathBuf};

use super::bench::{Bench, CLASSROOM, CORNELL, Wanted, file_bytes};
use super::chart::{Axis, Chart, Line, Panel};
use super::interval::{half_interval, mean};
use super::measured::Summary;
use super::python::Python;
use super::reference::{APART_NOTE, Judged, LIGHTINGS_SEED};
use super::rivals::{BlockSvd, Packed, Ranks, packed, product};
use super::table::{Cell, Table};
use super::{StudyReport, codecs, curve, dct, zfp};
use ltm::compress::{CompressSettings, Method, Ranks as Kept, Target};
use ltm::container::ContainerReader;
use ltm::error::Result;
use ltm::image::LinearImage;
use ltm::light::{Lighting, LightingPrior};
use ltm::matrix::BlockSource;
use ltm::pipeline::{PackOptions, UnpackOptions, pack, unpack_to_store};
use ltm::relight::relight_raw;
use ltm::store::StoreReader;

/// A method, and whether it stops by itself before it has taken the bytes that it is given.
type Way = (&'static str, bool);

const PLAIN: Way = ("block SVD, one rank, f16 + zstd", false);
const PRIOR: Way = ("+ weighted by the prior", false);
const SLOPE: Way = ("+ ranks by one slope", false);
const CODER: Way = ("+ our steps, transform and coder", false);
const SKETCH: Way = ("+ sketched range, all-on exact", false);
const DARK: Way = ("+ dark blocks weigh more", false);
const SPARSE: Way = ("+ sparse entries (`--keep-noise`)", false);
const NOISE: Way = ("+ noise left out (`--denoise off`)", true);
const CLEANED: Way = ("+ cleaned (the default)", true);
const FLAT: Way = ("block SVD in our coder, no prior", false);
const PAPER: Way = ("Algorithm 4, one rank", false);
const PAPER_SLOPE: Way = ("Algorithm 4, ranks by one slope, our coder", false);
const DCT: Way = ("DCT + zstd", false);
const ZFP: Way = ("zfp + zstd", false);
/// Rivals that are given the matrix that the default's denoising makes.
const CLEANED_CODER: Way = ("cleaned, then block SVD in our coder, prior", false);
const CLEANED_ZFP: Way = ("cleaned, then zfp + zstd", false);
const CLEANED_TUCKER: Way = ("cleaned, then Tucker", false);

/// All, in the order of the tables; general codecs that a Python has come behind.
const WAYS: [Way; 16] = [
    PLAIN,
    PRIOR,
    SLOPE,
    CODER,
    SKETCH,
    DARK,
    SPARSE,
    NOISE,
    CLEANED,
    FLAT,
    PAPER,
    PAPER_SLOPE,
    CLEANED_CODER,
    CLEANED_ZFP,
    DCT,
    ZFP,
];

/// Components of the file through which rivals get the denoised matrix, and the PSNR in dB that it keeps: more than shows.
const HARDLY_COMPRESSED: (usize, f64) = (64, 120.0);

struct Plan {
    /// With whether it took part in choosing constants.
    scenes: &'static [(&'static str, bool)],
    size: (u32, u32),
    /// Columns in all; lights are squares of texels.
    columns: u32,
    samples: u32,
    /// Of the matrix that stands for the truth, which has another seed.
    converged: u32,
    seeds: u64,
    /// The matrix over the bytes that are asked for where bytes can be asked for.
    ratios: &'static [f64],
    /// The same where bytes are only expected, from the entropy of factors.
    expected_ratios: &'static [f64],
    ranks: &'static [usize],
    mean_ranks: &'static [f64],
    /// The matrix over the bytes at which all are read off.
    fixed: &'static [f64],
}

const QUICK: Plan = Plan {
    scenes: &[("mixed", true)],
    size: (64, 32),
    columns: 64,
    samples: 16,
    converged: 128,
    seeds: 2,
    ratios: &[160.0, 60.0, 20.0],
    expected_ratios: &[160.0, 60.0, 20.0],
    ranks: &[1, 2, 4],
    mean_ranks: &[0.5, 1.0, 2.0, 4.0],
    fixed: &[40.0],
};

const FULL: Plan = Plan {
    scenes: &[("mixed", true), (CLASSROOM, false), (CORNELL, false)],
    size: (128, 128),
    columns: 256,
    samples: 256,
    converged: 2048,
    seeds: 5,
    ratios: &[500.0, 300.0, 90.0],
    expected_ratios: &[1000.0, 400.0, 150.0, 60.0],
    ranks: &[1, 2, 4, 8, 16, 32],
    mean_ranks: &[0.5, 1.0, 2.0, 4.0, 8.0, 16.0],
    fixed: &[400.0, 100.0],
};

/// Exponents of two between which the DCT's steps lie under its scale, and zfp's tolerances over the largest entry.
const STEPS: (f64, f64) = (-24.0, 2.0);
const TOLERANCES: (f64, f64) = (-24.0, 12.0);

/// What is read off a file: name, digits, how.
type Value = (&'static str, usize, fn(&Point) -> f64);

const VALUES: [Value; 8] = [
    ("psnr_lin_db", 1, |p| p.of_matrix.mean.psnr_linear),
    ("psnr_lin_worst_db", 1, |p| p.of_matrix.worst.psnr_linear),
    ("psnr_clip_db", 1, |p| p.of_matrix.mean.psnr_clipped),
    ("psnr_clip_worst_db", 1, |p| p.of_matrix.worst.psnr_clipped),
    ("truth_clip_db", 1, |p| p.of_truth.mean.psnr_clipped),
    ("truth_clip_worst_db", 1, |p| p.of_truth.worst.psnr_clipped),
    ("truth_flip", 3, |p| p.of_truth.mean.flip),
    ("truth_flip_worst", 3, |p| p.of_truth.worst.flip),
];

/// One file.
struct Point {
    scene: &'static str,
    seed: u64,
    way: Way,
    bytes: u64,
    /// Bytes of its matrix.
    raw_bytes: u64,
    /// Against the matrix that was packed, and against that of many samples.
    of_matrix: Summary,
    of_truth: Summary,
}

const NOTE: &str = "Each row has one idea more than the row above, up to the default; below are others. Every file where it has the \
bytes of the matrix over the ratio, on the straight lines between points over the logarithm of the bytes; a method that stops by \
itself at fewer bytes as it is; – where a method has no file on one side in any scene and seed. lin: PSNR with the peak at the \
reference's largest value; clip: exposed to its 95th luminance percentile, clipped; ꟻLIP: of the same, as 8-bit sRGB, at 67 pixels a \
degree. Without more: against the raw matrix, noise and all; truth: against a matrix of many more samples and another seed. Mean over \
lightings, seeds and scenes; worst: the worst lighting of all of them; interval: half of that of 95 % of the mean over scenes, by the \
seeds, which change samples, lightings and the draws of methods.";

const FORMS_NOTE: &str = "f16 + zstd: factors as 16-bit floats, byte planes, zstd 12. The SVD is exact to a few parts in a thousand. Slope: \
components that are worth their bits, with one slope for all blocks. DCT, zfp: as `ltm study fig9`. SZ3: whole colours in four \
dimensions, one absolute bound; SPERR: in three, one mean squared error; Tucker: all five dimensions, core and factors quantised by one \
slope, xz. DCT, zfp and these three: at steps and bounds on both sides of each ratio, found by bisection. Cleaned, then: the same \
methods, given the matrix that the default's cleaning makes, by way of a file that keeps 120 dB of it. \
Algorithm 4 by one slope takes 64 rows and columns of a block; what these do not span is \
lost, in larger files too.";

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let plan = if bench.quick { &QUICK } else { &FULL };
    let scenes: Vec<(&str, bool)> = plan.scenes.iter().copied().filter(|(name, _)| bench.has(name)).collect();
    let (there, absent): (Vec<_>, Vec<_>) = codecs::CODECS.iter().partition(|(_, python)| python.is_there());
    let mut notes = bench.notes(&[NOTE, APART_NOTE, FORMS_NOTE]);
    notes.push(format!(
        "{} × {} pixels, {} samples per pixel, truth {}, blocks of 32 pixels, f32, {} seeds. Tuned on: constants were chosen on it.",
        plan.size.0, plan.size.1, plan.samples, plan.converged, plan.seeds
    ));
    notes.extend(absent.iter().map(|(name, python)| {
        format!("{name} was not compared: no Python with {} (`{}` names one).", python.package, python.variable)
    }));
    let mut points = Vec::new();
    bench.watch.begin("ablation", scenes.len() as u64 * plan.seeds, "matrices");
    for &(scene, _) in &scenes {
        let truth = bench.matrix(wanted(bench, plan, scene, plan.converged, 1000)?)?;
        for seed in 0..plan.seeds {
            let matrix = bench.matrix(wanted(bench, plan, scene, plan.samples, seed)?)?;
            let judged = Judged::apart(&matrix, LIGHTINGS_SEED + seed)?;
            let truths = relight_raw(&truth, &judged.lightings)?;
            let raw_bytes = matrix.shape().raw_bytes();
            let on = Measured { bench, plan, matrix: &matrix, lightings: &judged.lightings };
            measure(on, seed, &there, &mut |way, packed| {
                points.push(Point {
                    scene,
                    seed,
                    way,
                    bytes: packed.bytes,
                    raw_bytes,
                    of_matrix: Summary::of(&packed.images, &judged.references),
                    of_truth: Summary::of(&packed.images, &truths),
                });
            })?;
            bench.watch.advance(1, raw_bytes, "B");
        }
    }
    bench.watch.end();
    let ways: Vec<Way> = WAYS
        .into_iter()
        .chain(there.iter().map(|(name, _)| (*name, false)))
        .chain(tucker_of(&there).map(|_| CLEANED_TUCKER))
        .collect();
    let mut report = StudyReport::default();
    let mut all = table("Ideas at equal bytes", notes.clone(), "scenes");
    let mut each = table("Ideas at equal bytes, scene by scene", notes, "scene");
    for &ratio in plan.fixed {
        for (group, tuned) in [("tuned on", true), ("judged", false)] {
            let members: Vec<&str> = scenes.iter().filter(|scene| scene.1 == tuned).map(|scene| scene.0).collect();
            for &way in ways.iter().filter(|_| !members.is_empty()) {
                all.push(row(group, ratio, way, &members, &points, plan.seeds));
            }
        }
        for &(scene, _) in &scenes {
            for &way in &ways {
                each.push(row(scene, ratio, way, &[scene], &points, plan.seeds));
            }
        }
    }
    report.add_table(&bench.out, "ablation", &all)?;
    report.add_table(&bench.out, "ablation-scenes", &each)?;
    let chart = Chart {
        title: "PSNR clip against the raw matrix, by idea".into(),
        caption: bench.caption(&format!("{} spp, seed 0, blocks of 32 px", plan.samples)),
        x: Axis::logarithmic("bytes of the file"),
        y: Axis::linear("PSNR clip (dB)"),
        panels: scenes.iter().map(|&(scene, _)| panel(scene, &points)).collect(),
    };
    report.add_chart(&bench.out, "ablation", &chart)?;
    Ok(report)
}

/// The matrix of a scene, its lights as fine as the columns allow.
fn wanted(bench: &Bench<'_>, plan: &Plan, scene: &'static str, samples: u32, seed: u64) -> Result<Wanted> {
    let of = |texels| Wanted { scene, size: plan.size, texels, samples, seed, block_side: 32 };
    let one = bench.loaded(of(1))?.scene.basis.column_count() as u32;
    Ok(of((plan.columns / one).isqrt()))
}

/// What every method is measured on.
#[derive(Clone, Copy)]
struct Measured<'a> {
    bench: &'a Bench<'a>,
    plan: &'a Plan,
    matrix: &'a StoreReader,
    lightings: &'a [Lighting],
}

/// Gives `keep` the files of every method.
fn measure(
    on: Measured<'_>,
    seed: u64,
    there: &[&'static (&'static str, Python)],
    keep: &mut dyn FnMut(Way, Packed),
) -> Result<()> {
    let Measured { bench, plan, matrix, lightings } = on;
    svd_ways(on, keep)?;
    let raw_bytes = matrix.shape().raw_bytes() as f64;
    let least =
        CompressSettings { noise_factor: None, sparse: None, exposure_exponent: 0.0, seed, ..Default::default() };
    let dark = CompressSettings { exposure_exponent: CompressSettings::default().exposure_exponent, ..least.clone() };
    let sparse = CompressSettings { sparse: CompressSettings::default().sparse, ..dark.clone() };
    let noise = CompressSettings { noise_factor: CompressSettings::default().noise_factor, ..sparse.clone() };
    let of_paper =
        CompressSettings { rank: 64, ranks: Kept::ByRate, seed, ..CompressSettings::of_method(Method::Algorithm4) };
    let of_paper = CompressSettings { noise_factor: None, exposure_exponent: 0.0, ..of_paper };
    for ratio in plan.ratios {
        let target = Target::Bytes((raw_bytes / ratio) as u64);
        for (way, settings, denoise) in [
            (SKETCH, &least, false),
            (DARK, &dark, false),
            (SPARSE, &sparse, false),
            (NOISE, &noise, false),
            (CLEANED, &noise, true),
            (PAPER_SLOPE, &of_paper, false),
        ] {
            let compress = CompressSettings { target, ..settings.clone() };
            keep(
                way,
                packed(
                    bench,
                    matrix,
                    PackOptions { allow_lost_lights: true, compress, denoise, ..Default::default() },
                    lightings,
                )?,
            );
        }
    }
    for &rank in plan.ranks {
        let settings = CompressSettings { rank, seed, ..CompressSettings::of_method(Method::Algorithm4) };
        keep(PAPER, product(bench, matrix, &settings, lightings)?);
    }
    dct_files(on, keep)?;
    zfp_files(on, ZFP, keep)?;
    for codec in there {
        python_files(on, codec, (codec.0, false), keep)?;
    }
    let cleaned = cleaned(bench, matrix)?;
    let on = Measured { matrix: &cleaned, ..on };
    let weighted = weighted_svd(&cleaned)?;
    for ratio in plan.expected_ratios {
        keep(CLEANED_CODER, weighted.pack_coded(bench, &cleaned, raw_bytes / ratio, lightings)?);
    }
    zfp_files(on, CLEANED_ZFP, keep)?;
    if let Some(tucker) = tucker_of(there) {
        python_files(on, tucker, CLEANED_TUCKER, keep)?;
    }
    Ok(())
}

/// Tucker, where what runs it is there.
fn tucker_of(there: &[&'static (&'static str, Python)]) -> Option<&'static (&'static str, Python)> {
    there.iter().copied().find(|(name, _)| *name == codecs::TUCKER)
}

/// What the default's denoising makes of a matrix.
fn cleaned(bench: &Bench<'_>, matrix: &StoreReader) -> Result<StoreReader> {
    let (rank, decibels) = HARDLY_COMPRESSED;
    let compress = CompressSettings { target: Target::PsnrDb(decibels), rank, ..CompressSettings::default() };
    let mut options = PackOptions { allow_lost_lights: true, compress, denoise: true, ..PackOptions::default() };
    options.container.overwrite = true;
    let (packed, path, silent) = (bench.cached("cleaned.ltc"), bench.cached("cleaned.ltm"), bench.silent());
    pack(matrix, matrix.job(), &packed, &options, &silent)?;
    let options = UnpackOptions { overwrite: true, ..UnpackOptions::default() };
    unpack_to_store(&ContainerReader::open(&packed)?, &path, &options, &silent)?;
    StoreReader::open(&path)
}

fn svd_ways(on: Measured<'_>, keep: &mut dyn FnMut(Way, Packed)) -> Result<()> {
    let Measured { bench, plan, matrix, lightings } = on;
    let raw_bytes = matrix.shape().raw_bytes() as f64;
    let plain = BlockSvd::new(matrix, CompressSettings::default().rank, None)?;
    let weighted = weighted_svd(matrix)?;
    for &rank in plan.ranks {
        keep(PLAIN, plain.pack(bench, matrix, Ranks::Fixed(rank), lightings)?);
        keep(PRIOR, weighted.pack(bench, matrix, Ranks::Fixed(rank), lightings)?);
    }
    for &rank in plan.mean_ranks {
        keep(SLOPE, weighted.pack(bench, matrix, Ranks::Mean(rank), lightings)?);
    }
    for ratio in plan.expected_ratios {
        keep(CODER, weighted.pack_coded(bench, matrix, raw_bytes / ratio, lightings)?);
        keep(FLAT, plain.pack_coded(bench, matrix, raw_bytes / ratio, lightings)?);
    }
    Ok(())
}

/// Of as many components as ours looks at.
fn weighted_svd(matrix: &StoreReader) -> Result<BlockSvd> {
    BlockSvd::new(matrix, CompressSettings::default().rank, Some(&LightingPrior::of_basis(&matrix.job().basis)))
}

fn dct_files(on: Measured<'_>, keep: &mut dyn FnMut(Way, Packed)) -> Result<()> {
    let Measured { bench, matrix, lightings, .. } = on;
    let scale = dct::scale(matrix)?;
    let step = |exponent: f64| scale * exponent.exp2() as f32;
    let write = |exponent| Ok(dct::write(matrix, &[step(exponent)], &bench.cached("dct"))?.remove(0));
    let read = |path: &Path, exponent| dct::read(path, step(exponent), matrix.shape(), &matrix.job().basis, lightings);
    at_sizes(on, STEPS, &write, &read, &mut |packed| keep(DCT, packed))
}

fn zfp_files(on: Measured<'_>, way: Way, keep: &mut dyn FnMut(Way, Packed)) -> Result<()> {
    let Measured { bench, matrix, lightings, .. } = on;
    let largest = zfp::scale(matrix)?;
    let tolerance = |exponent: f64| largest * exponent.exp2() as f32;
    let path = bench.cached("zfp");
    let write = |exponent| zfp::write(matrix, tolerance(exponent), &path).map(|()| path.clone());
    let read =
        |path: &Path, exponent| zfp::read(path, tolerance(exponent), matrix.shape(), &matrix.job().basis, lightings);
    at_sizes(on, TOLERANCES, &write, &read, &mut |packed| keep(way, packed))
}

/// Gives `keep` the files of a codec on both sides of each size, of which the exponents lie between `ends`.
fn at_sizes(
    on: Measured<'_>,
    ends: (f64, f64),
    write: &dyn Fn(f64) -> Result<PathBuf>,
    read: &dyn Fn(&Path, f64) -> Result<Vec<LinearImage>>,
    keep: &mut dyn FnMut(Packed),
) -> Result<()> {
    let write = |exponent| on.bench.stop_if_interrupted().and_then(|()| write(exponent));
    for ratio in on.plan.fixed {
        let bytes = on.matrix.shape().raw_bytes() as f64 / ratio;
        for exponent in curve::bracket(ends, bytes, &mut |exponent| file_bytes(&write(exponent)?))? {
            let path = write(exponent)?;
            let images = read(&path, exponent)?;
            keep(Packed { bytes: file_bytes(&path)?, rank: None, seconds: 0.0, images });
        }
    }
    Ok(())
}

fn python_files(on: Measured<'_>, codec: &(&str, Python), way: Way, keep: &mut dyn FnMut(Way, Packed)) -> Result<()> {
    let raw_bytes = on.matrix.shape().raw_bytes() as f64;
    let sizes = on.plan.fixed.iter().map(|ratio| raw_bytes / ratio);
    let (fewest, most) =
        sizes.fold((f64::INFINITY, 0.0f64), |(fewest, most), bytes| (fewest.min(bytes), most.max(bytes)));
    for packed in codecs::code(on.bench, on.matrix, codec, (fewest, most), on.lightings)? {
        keep(way, packed);
    }
    Ok(())
}

fn table(title: &str, notes: Vec<String>, first: &'static str) -> Table {
    let mut columns = vec![(first, 0), ("ratio", 0), ("method", 0)];
    columns.extend(VALUES.iter().map(|&(name, digits, _)| (name, digits)));
    columns.extend([("psnr_lin_interval_db", 1), ("psnr_clip_interval_db", 1), ("truth_clip_interval_db", 1)]);
    Table::new(title, notes, &columns)
}

/// A method at a ratio over some scenes and all seeds.
fn row(name: &str, ratio: f64, way: Way, scenes: &[&str], points: &[Point], seeds: u64) -> Vec<Cell> {
    let over_seeds = |value: &Value| -> Option<Vec<Vec<f64>>> {
        (0..seeds)
            .map(|seed| scenes.iter().map(|scene| at(points, (scene, seed, way), ratio, value.2)).collect())
            .collect()
    };
    let all: Vec<Option<Vec<Vec<f64>>>> = VALUES.iter().map(over_seeds).collect();
    let mut cells: Vec<Cell> = vec![name.into(), ratio.into(), way.0.into()];
    for ((name, ..), by_seed) in VALUES.iter().zip(&all) {
        let values = by_seed.iter().flatten().flatten().copied();
        let of_all = match (by_seed, name.contains("worst"), name.contains("flip")) {
            (None, ..) => None,
            (Some(_), true, true) => values.reduce(f64::max),
            (Some(_), true, false) => values.reduce(f64::min),
            (Some(_), false, _) => Some(mean(values)),
        };
        cells.push(of_all.into());
    }
    for of in [0, 2, 4] {
        let by_seed =
            all[of].as_ref().map(|by_seed| by_seed.iter().map(|values| mean(values.iter().copied())).collect());
        cells.push(by_seed.and_then(|means: Vec<f64>| half_interval(&means)).into());
    }
    cells
}

/// A value of a method on one matrix, where its file has the bytes of the ratio.
fn at(points: &[Point], (scene, seed, way): (&str, u64, Way), ratio: f64, value: fn(&Point) -> f64) -> Option<f64> {
    let own: Vec<&Point> = points.iter().filter(|p| p.scene == scene && p.seed == seed && p.way == way).collect();
    let last = own.iter().max_by_key(|point| point.bytes)?;
    let bytes = last.raw_bytes as f64 / ratio;
    if way.1 && bytes > last.bytes as f64 {
        return Some(value(last));
    }
    let line: Vec<(f64, f64)> = own.iter().map(|point| ((point.bytes as f64).ln(), value(point))).collect();
    curve::at(&line, bytes.ln())
}

/// Of the methods as many as a chart has colours for.
fn panel(scene: &str, points: &[Point]) -> Panel {
    let line = |name: &str| {
        let own = points.iter().filter(|p| p.scene == scene && p.seed == 0 && p.way.0 == name);
        Line {
            name: name.replace('`', ""),
            points: own.map(|p| (p.bytes as f64, p.of_matrix.mean.psnr_clipped)).collect(),
        }
    };
    let shown = [PLAIN.0, PRIOR.0, CODER.0, SPARSE.0, CLEANED.0, FLAT.0, PAPER_SLOPE.0, "Tucker"];
    Panel {
        title: scene.to_owned(),
        lines: shown.into_iter().map(line).filter(|line| !line.points.is_empty()).collect(),
    }
}
