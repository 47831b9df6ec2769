//! What packing itself costs: bytes, and what is seen of them, against the same denoised matrix hardly compressed.

use rayon::prelude::*;

use super::StudyReport;
use super::bench::Bench;
use super::corpus::{Entry, entries, matrix};
use super::rivals::{Packed, packed};
use super::table::{Cell, Table};
use super::visual_metrics::Seen;
use ltm::compress::{CompressSettings, Target};
use ltm::error::Result;
use ltm::image::LinearImage;
use ltm::light::{LightBasis, Lighting};
use ltm::matrix::BlockSource;
use ltm::pipeline::PackOptions;
use ltm::relight::relight_raw;
use ltm::store::StoreReader;

/// One way to pack.
struct Packing {
    name: &'static str,
    target: Target,
    rank: Option<usize>,
}

const QUICK: &[Packing] = &[DEFAULT, Packing { name: "50 dB", target: Target::PsnrDb(50.0), rank: None }];
const FULL: &[Packing] = &[
    DEFAULT,
    Packing { name: "48 dB", target: Target::PsnrDb(48.0), rank: None },
    Packing { name: "54 dB", target: Target::PsnrDb(54.0), rank: None },
    Packing { name: "60 dB", target: Target::PsnrDb(60.0), rank: None },
    Packing { name: "72 dB", target: Target::PsnrDb(72.0), rank: Some(256) },
];
const DEFAULT: Packing = Packing { name: "default", target: Target::Automatic, rank: None };

/// Hardly compressed: where no entry that matters is left out.
const WHOLE: Packing = Packing { name: "whole", target: Target::PsnrDb(120.0), rank: Some(512) };

/// Lights looked at alone, at most; of more, so many spread evenly.
const MOST_LIGHTS: usize = 8;

const NOTE: &str = "Scenes: those of the folder that `LTM_CORPUS` names. Each default container, and some by a PSNR, \
against the same denoised matrix hardly compressed (120 dB, rank 512). Lightings: all on; up to eight lights, each alone and exposed for \
itself; of a light of texels also one texel alone and a spot of a tenth of its width. A light whose image has a thousandth of the \
mean of that with all on, or less, is left out. ꟻLIP and seams as `ltm study picture` has them.";

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let packings = if bench.quick { QUICK } else { FULL };
    let samples = if bench.quick { &[16][..] } else { &bench.corpus.samples };
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
            ("seconds", 2),
        ],
    );
    let scenes = entries(bench)?;
    if scenes.is_empty() {
        bench.watch.note("packing: no folder of scenes (LTM_CORPUS), nothing was measured");
        return Ok(StudyReport::default());
    }
    bench.watch.begin("packing", (scenes.len() * samples.len() * (1 + packings.len())) as u64, "containers");
    for entry in &scenes {
        for &samples in samples {
            measure(bench, packings, entry, samples, &mut table)?;
        }
    }
    bench.watch.end();
    let mut report = StudyReport::default();
    report.add_table(&bench.out, "packing", &table)?;
    Ok(report)
}

/// The rows of one scene.
fn measure(bench: &Bench<'_>, packings: &[Packing], entry: &Entry, samples: u32, table: &mut Table) -> Result<()> {
    let (matrix, _) = matrix(bench, entry, (samples, 0))?;
    let (names, lightings) = lit(&matrix)?;
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
    for packing in [&WHOLE].into_iter().chain(packings) {
        let packed = if packing.name == WHOLE.name { None } else { Some(pack(packing)?) };
        let packed = packed.as_ref().unwrap_or(&whole);
        let all = packed.images.par_iter().zip(&whole.images).zip(&raw);
        let seen: Vec<Seen> = all.map(|((image, whole), raw)| Seen::of(image, whole, raw, side)).collect();
        table.push(row((entry, samples), &matrix, (packing, packed), &names, &seen));
        bench.watch.advance(1, matrix.shape().raw_bytes(), "B");
    }
    Ok(())
}

fn row(
    (entry, samples): (&Entry, u32),
    matrix: &StoreReader,
    (packing, packed): (&Packing, &Packed),
    names: &[String],
    seen: &[Seen],
) -> Vec<Cell> {
    let mean = |part: fn(&Seen) -> f64| seen.iter().map(part).sum::<f64>() / seen.len() as f64;
    let worst = |part: fn(&Seen) -> f64| {
        let by = |a: &usize, b: &usize| part(&seen[*a]).total_cmp(&part(&seen[*b]));
        (0..seen.len()).max_by(by).unwrap_or(0)
    };
    let (of_flip, of_seams) = (worst(|s| s.flip), worst(|s| s.seams));
    let shape = matrix.shape();
    vec![
        entry.name.as_str().into(),
        samples.into(),
        shape.rows().into(),
        shape.columns().into(),
        packing.name.into(),
        packed.rank.into(),
        packed.bytes.into(),
        (shape.raw_bytes() as f64 / packed.bytes as f64).into(),
        mean(|s| s.flip).into(),
        seen[of_flip].flip.into(),
        names[of_flip].as_str().into(),
        mean(|s| s.seams).into(),
        seen[of_seams].seams.into(),
        packed.seconds.into(),
    ]
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
