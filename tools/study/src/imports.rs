//! Matrices of another renderer: arrays of lights of which nothing is known but their images, as `ltm-pack` takes them.

use std::path::{Path, PathBuf};

use super::StudyReport;
use super::bench::{Bench, Wanted, file_bytes};
use super::measured::{Measured, Summary};
use super::mitsuba::{self, MITSUBA};
use super::reference::Judged;
use super::table::{Cell, Table};
use ltm::compress::{CompressSettings, PriorChoice, Target};
use ltm::container::ContainerReader;
use ltm::error::Result;
use ltm::image::{ImageSize, LightSet, write_npy};
use ltm::light::{Job, Light, LightBasis, LightKind, Lighting};
use ltm::matrix::{BlockSource, MatrixShape};
use ltm::pipeline::{self, ImportedMatrix, PackOptions};
use ltm::relight::{CpuRelighter, relight_raw};

struct Plan {
    /// With whether constants may be tuned on it.
    scenes: &'static [(&'static str, bool)],
    size: (u32, u32),
    texels: u32,
    samples: u32,
    /// The matrix over the bytes of the file; of skies, which have half the columns.
    ratios: (f64, f64),
}

/// Traced by us: what is tested is the study.
const QUICK: Plan = Plan { scenes: &[("diffuse", true)], size: (64, 48), texels: 8, samples: 64, ratios: (60.0, 60.0) };

const FULL: Plan = Plan {
    scenes: &[
        ("diffuse-a", true),
        ("reflections-a", true),
        ("caustics-a", true),
        ("mixed-a", true),
        ("environment-a", true),
        ("diffuse-b", false),
        ("reflections-b", false),
        ("caustics-b", false),
        ("mixed-b", false),
        ("environment-b", false),
    ],
    size: (128, 96),
    texels: 32,
    samples: 240,
    ratios: (1000.0, 400.0),
};

/// Single columns that are lit one by one, at most.
const SINGLE: usize = 64;

const NOTE: &str = "Images of the packed file against those of the array, noise and all. Lightings: twelve (all on, gradients, spots of several \
widths, a pattern, one column, columns at random), placed as the lights are; worst: the worst of them; one light: 64 single columns, the \
mean and the worst of those that are lit. lin: PSNR with the peak at the reference's largest value; clip: exposed to its 95th luminance \
percentile, clipped; ꟻLIP at 67 pixels a degree. Bytes: of the whole file, the largest that is not larger than the matrix over the \
ratio. From the images: what `ltm-pack` does with an array, which looks which lights are alike; nothing of places: all lights but the first stand at \
one place, as before that; places told: lights are given as the texels that they are, as by `--texels` and `--sky`; no prior: plain \
least squares. Blocks have 24 components at most, or 64 where it says so.";

/// What packing is told of the lights.
const WAYS: [&str; 6] = [FROM_IMAGES, NOTHING, TOLD, NO_PRIOR, FROM_IMAGES_64, TOLD_64];
const FROM_IMAGES: &str = "from the images";
const NOTHING: &str = "nothing of places";
const TOLD: &str = "places told";
const NO_PRIOR: &str = "no prior";
const FROM_IMAGES_64: &str = "from the images, --rank 64";
const TOLD_64: &str = "places told, --rank 64";

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let plan = if bench.quick { &QUICK } else { &FULL };
    let mut notes = bench.notes(&[NOTE]);
    notes.push(format!(
        "{} × {} pixels, {} samples per pixel of which each column has its share, blocks of 32 pixels, f32, factors quantised; scenes of \
tools/study/src/render_columns_with_mitsuba.py{}.",
        plan.size.0,
        plan.size.1,
        plan.samples,
        if bench.quick { ", but here one of ours, traced by us" } else { ", rendered by Mitsuba 3 (llvm_ad_rgb)" },
    ));
    let is_there = bench.quick || MITSUBA.is_there();
    if !is_there {
        notes.push("Nothing was measured: no Python with Mitsuba (`LTM_MITSUBA` names one, else `python3`).".into());
    }
    let mut table = Table::new(
        "Matrices of another renderer",
        notes,
        &[
            ("scene", 0),
            ("tuned_on", 0),
            ("lights", 0),
            ("rows", 0),
            ("columns", 0),
            ("mean_rank", 2),
            ("sparse_entries", 0),
            ("bytes", 0),
            ("ratio", 1),
            ("all_on_lin_db", 2),
            ("psnr_lin_db", 2),
            ("psnr_lin_worst_db", 2),
            ("psnr_clip_db", 2),
            ("psnr_clip_worst_db", 2),
            ("one_light_lin_db", 2),
            ("one_light_lin_worst_db", 2),
            ("flip", 4),
            ("flip_worst", 4),
        ],
    );
    let scenes: Vec<_> = plan.scenes.iter().filter(|_| is_there).collect();
    bench.watch.begin("imports", scenes.len() as u64, "matrices");
    for &&(scene, tuned_on) in &scenes {
        bench.stop_if_interrupted()?;
        let array = array(bench, plan, scene)?;
        measure(bench, plan, (scene, tuned_on), &array, &mut table)?;
        bench.watch.advance(1, file_bytes(&array)?, "B");
    }
    bench.watch.end();
    let mut report = StudyReport::default();
    report.add_table(&bench.out, "imports", &table)?;
    Ok(report)
}

/// The array of a scene: rendered by Mitsuba, or where that is quick by us.
fn array(bench: &Bench<'_>, plan: &Plan, scene: &'static str) -> Result<PathBuf> {
    let Plan { size, texels, samples, .. } = *plan;
    if !bench.quick {
        return mitsuba::columns(scene, &bench.cached(""), size, texels, samples, 0);
    }
    let matrix = bench.matrix(Wanted { scene, size, texels, samples, seed: 0, block_side: 32 })?;
    let columns = matrix.shape().columns();
    let single = (0..columns).map(|column| one_light(columns, column)).collect::<Result<Vec<_>>>()?;
    let images = relight_raw(&matrix, &single)?;
    let path = bench.cached(&format!("{scene}.npy"));
    let (width, height) = (size.0 as usize, size.1 as usize);
    write_npy(&path, true, columns, ImageSize { width, height }, &mut |image, channel, y, row| {
        let pixels = &images[image].pixels[y * width..][..width];
        row.iter_mut().zip(pixels).for_each(|(to, pixel)| *to = pixel[channel]);
        Ok(())
    })?;
    Ok(path)
}

fn one_light(columns: usize, column: usize) -> Result<Lighting> {
    let mut weights = vec![[0.0; 3]; columns];
    weights[column] = [1.0; 3];
    Lighting::new(weights)
}

fn measure(
    bench: &Bench<'_>,
    plan: &Plan,
    (scene, tuned_on): (&str, bool),
    array: &Path,
    table: &mut Table,
) -> Result<()> {
    let set = LightSet::open(array, None)?;
    let path = bench.cached("imports.ltc");
    let (side, silent) = (MatrixShape::DEFAULT_BLOCK_SIDE, bench.silent());
    let matrix = ImportedMatrix::read(
        &set,
        pipeline::ImageNoise::Unknown,
        scene,
        &path,
        side,
        &PackOptions::default(),
        &silent,
    )?;
    let shape = matrix.shape();
    let is_sky = shape.columns() as u32 != plan.texels * plan.texels;
    let ratio = if is_sky { plan.ratios.1 } else { plan.ratios.0 };
    let texels = match is_sky {
        true => LightKind::LatLong { across: plan.texels, down: plan.texels / 2 },
        false => LightKind::AreaTexels { across: plan.texels, down: plan.texels },
    };
    let told = basis_of(texels)?;
    let judged = Judged::of_lights(&matrix, &told)?;
    let apart = shape.columns().div_ceil(SINGLE);
    let single = (0..shape.columns()).step_by(apart).map(|column| one_light(shape.columns(), column));
    let single = Judged::lit(&matrix, single.collect::<Result<_>>()?, &judged.references[0])?;
    for lights in WAYS {
        bench.stop_if_interrupted()?;
        let basis = match lights {
            TOLD | TOLD_64 => told.clone(),
            NOTHING => first_apart(&matrix.job().basis)?,
            _ => matrix.job().basis.clone(),
        };
        let job = Job { basis, ..matrix.job().clone() };
        let prior = if lights == NO_PRIOR { PriorChoice::Flat } else { PriorChoice::Lighting };
        let target = Target::Bytes((shape.raw_bytes() as f64 / ratio) as u64);
        let rank = if [FROM_IMAGES_64, TOLD_64].contains(&lights) { 64 } else { CompressSettings::default().rank };
        let compress = CompressSettings { target, prior, rank, ..CompressSettings::default() };
        let mut options = PackOptions { allow_lost_lights: true, compress, ..PackOptions::default() };
        options.container.overwrite = true;
        let packed = pipeline::pack(&matrix, &job, &path, &options, &silent)?;
        let relighter = CpuRelighter::load(&ContainerReader::open(&path)?)?;
        let summary = |judged: &Judged| -> Result<Summary> {
            let images = judged.lightings.iter().map(|lighting| relighter.relight(lighting));
            Ok(Summary::of(&images.collect::<Result<Vec<_>>>()?, &judged.references))
        };
        let (all, one) = (summary(&judged)?, summary(&single)?);
        let all_on = Measured::of(&relighter.relight(&judged.lightings[0])?, &judged.references[0]);
        let cells: Vec<Cell> = vec![
            scene.into(),
            tuned_on.into(),
            lights.into(),
            shape.rows().into(),
            shape.columns().into(),
            packed.mean_rank.into(),
            packed.sparse_entries.into(),
            packed.packed_bytes.into(),
            (shape.raw_bytes() as f64 / packed.packed_bytes as f64).into(),
            all_on.psnr_linear.into(),
            all.mean.psnr_linear.into(),
            all.worst.psnr_linear.into(),
            all.mean.psnr_clipped.into(),
            all.worst.psnr_clipped.into(),
            one.mean.psnr_linear.into(),
            one.worst.psnr_linear.into(),
            all.mean.flip.into(),
            all.worst.flip.into(),
        ];
        table.push(cells);
    }
    Ok(())
}

/// One light of texels.
fn basis_of(texels: LightKind) -> Result<LightBasis> {
    let mut light = Light::unplaced("texels", texels);
    if let LightKind::LatLong { across, down } = texels {
        let direction = |texel: u32| {
            let turn = (f64::from(texel % across) + 0.5) / f64::from(across) * std::f64::consts::TAU;
            let tilt = (f64::from(texel / across) + 0.5) / f64::from(down) * std::f64::consts::PI;
            [turn.cos() * tilt.sin(), turn.sin() * tilt.sin(), tilt.cos()].map(|v| v as f32)
        };
        light.places = (0..across * down).map(direction).collect();
    }
    let mut basis = LightBasis::new();
    basis.push(light)?;
    Ok(basis)
}

/// The lights with the first elsewhere, so that nobody takes them for lights whose places are to be found.
fn first_apart(lights: &LightBasis) -> Result<LightBasis> {
    let mut basis = LightBasis::new();
    for (index, light) in lights.lights().iter().enumerate() {
        let mut light = light.clone();
        light.places[0][0] = if index == 0 { 1.0 } else { 0.0 };
        basis.push(light)?;
    }
    Ok(basis)
}
