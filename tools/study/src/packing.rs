//! What packing itself costs: bytes, and what is seen of them, against the same denoised matrix hardly compressed.

use std::path::PathBuf;

use rayon::prelude::*;

use super::StudyReport;
use super::bench::Bench;
use super::rivals::{Packed, packed};
use super::table::{Cell, Table};
use super::visual_metrics::Seen;
use ltm::compress::{CompressSettings, Target};
use ltm::error::{Error, Result};
use ltm::image::LinearImage;
use ltm::light::{LightBasis, Lighting};
use ltm::matrix::BlockSource;
use ltm::pipeline::PackOptions;
use ltm::relight::relight_raw;
use ltm::scene::{self, BuiltIn, LoadOptions, LoadedScene};
use ltm::store::StoreReader;

struct Plan {
    /// Pixels of the longer side of a picture.
    longer_side: u32,
    samples: u32,
    /// Of the matrix whose images the truth is; 0 for none.
    converged: u32,
    built_in: &'static [&'static str],
    with_files: bool,
    targets: &'static [Packing],
}

/// One way to pack.
struct Packing {
    name: &'static str,
    target: Target,
    rank: Option<usize>,
}

const DEFAULT: Packing = Packing { name: "default", target: Target::Automatic, rank: None };
const QUICK: Plan = Plan {
    longer_side: 64,
    samples: 16,
    converged: 64,
    built_in: &["mixed"],
    with_files: false,
    targets: &[DEFAULT, Packing { name: "50 dB", target: Target::PsnrDb(50.0), rank: None }],
};
const FULL: Plan = Plan {
    longer_side: 256,
    samples: 64,
    converged: 1024,
    built_in: &["mixed", "environment"],
    with_files: true,
    targets: &[
        DEFAULT,
        Packing { name: "48 dB", target: Target::PsnrDb(48.0), rank: None },
        Packing { name: "54 dB", target: Target::PsnrDb(54.0), rank: None },
        Packing { name: "60 dB", target: Target::PsnrDb(60.0), rank: None },
        Packing { name: "72 dB", target: Target::PsnrDb(72.0), rank: Some(256) },
    ],
};

/// Hardly compressed: where no entry that matters is left out.
const WHOLE: Packing = Packing { name: "whole", target: Target::PsnrDb(120.0), rank: Some(512) };

/// Lights looked at alone, at most; of more, so many spread evenly.
const MOST_LIGHTS: usize = 8;

const NOTE: &str = "Scenes: built-in ones and those of the folder that `LTM_CORPUS` names. Each default container, and some by a PSNR, \
against the same denoised matrix hardly compressed (120 dB, rank 512). Lightings: all on; up to eight lights, each alone and exposed for \
itself; of a light of texels also one texel alone and a spot of a tenth of its width. A light whose image has a thousandth of the \
mean of that with all on, or less, is left out. ꟻLIP and seams as `ltm study picture` has them.";

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let plan = if bench.quick { &QUICK } else { &FULL };
    let mut table = Table::new(
        "What packing costs, and what is seen of it",
        bench.notes(&[NOTE]),
        &[
            ("scene", 0),
            ("samples_per_px", 0),
            ("rows", 0),
            ("columns", 0),
            ("packed", 0),
            ("mean_rank", 2),
            ("bytes", 0),
            ("ratio", 1),
            ("flip", 4),
            ("flip_worst", 4),
            ("worst_lighting", 0),
            ("seams", 3),
            ("seams_worst", 3),
            ("flip_truth", 4),
            ("seconds", 2),
        ],
    );
    let scenes = scenes(plan)?;
    bench.watch.begin("packing", (scenes.len() * (1 + plan.targets.len())) as u64, "containers");
    for (name, loaded) in scenes {
        measure(bench, plan, &name, loaded, &mut table)?;
    }
    bench.watch.end();
    let mut report = StudyReport::default();
    report.add_table(&bench.out, "packing", &table)?;
    Ok(report)
}

/// The rows of one scene.
fn measure(bench: &Bench<'_>, plan: &Plan, name: &str, loaded: LoadedScene, table: &mut Table) -> Result<()> {
    let sized = |samples: u32, seed: u64| {
        let (width, height) = size_of(&loaded, plan.longer_side);
        let mut loaded = loaded.clone().sized(width, height);
        loaded.settings.samples_per_pixel = samples;
        loaded.settings.seed = seed;
        loaded
    };
    let file = |samples: u32| format!("packing-{name}-{}-{samples}.ltm", plan.longer_side);
    let matrix = bench.rendered(&file(plan.samples), sized(plan.samples, 0))?;
    let (names, lightings) = lit(&matrix)?;
    let truth = match plan.converged {
        0 => None,
        samples => Some(relight_raw(&bench.rendered(&file(samples), sized(samples, 1))?, &lightings)?),
    };
    let raw = relight_raw(&matrix, &lightings)?;
    let pack = |packing: &Packing| {
        let compress = CompressSettings { target: packing.target, ..CompressSettings::default() };
        let compress = CompressSettings { rank: packing.rank.unwrap_or(compress.rank), ..compress };
        let options = PackOptions { allow_lost_lights: true, denoise: true, compress, ..PackOptions::default() };
        packed(bench, &matrix, options, &lightings)
    };
    let whole = pack(&WHOLE)?;
    bench.watch.advance(1, matrix.shape().raw_bytes(), "B");
    let side = matrix.shape().block_side();
    for packing in [&WHOLE].into_iter().chain(plan.targets) {
        let packed = if packing.name == WHOLE.name { None } else { Some(pack(packing)?) };
        let packed = packed.as_ref().unwrap_or(&whole);
        let beside = |references: &[LinearImage]| -> Vec<Seen> {
            let all = packed.images.par_iter().zip(references).zip(&raw);
            all.map(|((image, reference), raw)| Seen::of(image, reference, raw, side)).collect()
        };
        let (seen, true_seen) = (beside(&whole.images), truth.as_deref().map(beside));
        table.push(row(name, &matrix, plan.samples, packing, packed, &names, &seen, true_seen.as_deref()));
        bench.watch.advance(1, matrix.shape().raw_bytes(), "B");
    }
    Ok(())
}

#[allow(clippy::too_many_arguments, reason = "the parts of one row")]
fn row(
    name: &str,
    matrix: &StoreReader,
    samples: u32,
    packing: &Packing,
    packed: &Packed,
    names: &[String],
    seen: &[Seen],
    truth: Option<&[Seen]>,
) -> Vec<Cell> {
    let mean = |seen: &[Seen], part: fn(&Seen) -> f64| seen.iter().map(part).sum::<f64>() / seen.len() as f64;
    let worst = |part: fn(&Seen) -> f64| {
        let by = |a: &usize, b: &usize| part(&seen[*a]).total_cmp(&part(&seen[*b]));
        (0..seen.len()).max_by(by).unwrap_or(0)
    };
    let (of_flip, of_seams) = (worst(|s| s.flip), worst(|s| s.seams));
    let shape = matrix.shape();
    vec![
        name.into(),
        samples.into(),
        shape.rows().into(),
        shape.columns().into(),
        packing.name.into(),
        packed.rank.into(),
        packed.bytes.into(),
        (shape.raw_bytes() as f64 / packed.bytes as f64).into(),
        mean(seen, |s| s.flip).into(),
        seen[of_flip].flip.into(),
        names[of_flip].as_str().into(),
        mean(seen, |s| s.seams).into(),
        seen[of_seams].seams.into(),
        truth.map(|seen| mean(seen, |s| s.flip)).into(),
        packed.seconds.into(),
    ]
}

/// Scenes by name.
fn scenes(plan: &Plan) -> Result<Vec<(String, LoadedScene)>> {
    let built_in = plan.built_in.iter().map(|&name| {
        let size = BuiltIn { width: plan.longer_side, height: plan.longer_side * 3 / 4, texels: 8 };
        Ok((name.to_owned(), size.named(name)?))
    });
    let files = if plan.with_files { corpus()? } else { Vec::new() };
    // People's materials name maps that are not there.
    let options = LoadOptions { allow_missing: true, ..LoadOptions::default() };
    let files = files.into_iter().map(|(name, path)| Ok((name, scene::load_with(&path, options.clone())?)));
    built_in.chain(files).collect()
}

/// Scene files of the folder that `LTM_CORPUS` names, by folder, in the order of names.
fn corpus() -> Result<Vec<(String, PathBuf)>> {
    let Some(folder) = std::env::var_os("LTM_CORPUS").map(PathBuf::from) else { return Ok(Vec::new()) };
    let list = |folder: &PathBuf| -> Result<Vec<PathBuf>> {
        let entries = std::fs::read_dir(folder).map_err(Error::io(folder, "list"))?;
        let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        paths.sort();
        Ok(paths)
    };
    let mut found = Vec::new();
    for path in list(&folder)?.into_iter().filter(|path| path.is_dir()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let files = list(&path)?;
        let by = |extension: &str| files.iter().find(|file| file.extension().is_some_and(|e| e == extension));
        if let Some(file) = by("toml").or_else(|| by("glb")) {
            found.push((name, file.clone()));
        }
    }
    Ok(found)
}

fn size_of(loaded: &LoadedScene, longer: u32) -> (u32, u32) {
    let (width, height) = (loaded.scene.camera.width, loaded.scene.camera.height);
    let scale = f64::from(longer) / f64::from(width.max(height));
    let scaled = |side: u32| (f64::from(side) * scale).round().max(1.0) as u32;
    (scaled(width), scaled(height))
}

/// Lightings that are looked at, and their names: those that light something.
fn lit(matrix: &StoreReader) -> Result<(Vec<String>, Vec<Lighting>)> {
    let wanted = lightings(&matrix.job().basis)?;
    let (names, lightings): (Vec<_>, Vec<_>) = wanted.into_iter().unzip();
    let images = relight_raw(matrix, &lightings)?;
    let mean = |image: &LinearImage| image.luminances().map(f64::from).sum::<f64>() / image.pixels.len() as f64;
    let least = 1e-3 * mean(&images[0]);
    let all = names.into_iter().zip(lightings).zip(images);
    Ok(all.filter(|(_, image)| mean(image) > least).map(|(lighting, _)| lighting).unzip())
}

fn lightings(basis: &LightBasis) -> Result<Vec<(String, Lighting)>> {
    let columns = basis.column_count();
    let of = |weight: &dyn Fn(usize) -> f32| Lighting::new((0..columns).map(|j| [weight(j); 3]).collect());
    let mut all = vec![("all on".to_owned(), of(&|_| 1.0)?)];
    let lights = basis.lights();
    for light in lights.iter().step_by(lights.len().div_ceil(MOST_LIGHTS)) {
        let its = light.columns();
        let its = its.start as usize..its.end as usize;
        all.push((light.name.clone(), of(&|j| f32::from(its.contains(&j)))?));
        if its.len() < 2 {
            continue;
        }
        let (across, down) = light.layout();
        // Off the middle, so that it is not symmetric; of a sky it is above the horizon.
        let (u, v) = (0.3 * f64::from(across), 0.3 * f64::from(down));
        let texel = its.start + v as usize * across as usize + u as usize;
        let spot = |j: usize| {
            if !its.contains(&j) {
                return 0.0;
            }
            let at = ((j - its.start) as u32 % across, (j - its.start) as u32 / across);
            let off = [(f64::from(at.0) + 0.5 - u) / f64::from(across), (f64::from(at.1) + 0.5 - v) / f64::from(down)];
            (-0.5 * (off[0].powi(2) + off[1].powi(2)) / 0.01).exp() as f32
        };
        all.push((format!("{}: spot", light.name), of(&spot)?));
        all.push((format!("{}: texel", light.name), of(&|j| f32::from(j == texel))?));
    }
    Ok(all)
}
