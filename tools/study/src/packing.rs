//! What packing itself costs: bytes, and what is seen of them, against the same denoised matrix hardly compressed.

use rayon::prelude::*;

use super::StudyReport;
use super::bench::Bench;
use super::corpus::{Entry, Shown, entries, lightings, matrix};
use super::interval::mean;
use super::rivals::{Packed, packed};
use super::table::{Cell, Table};
use super::visual_metrics::Seen;
use ltm::compress::{CompressSettings, Target};
use ltm::error::Result;
use ltm::light::Lighting;
use ltm::matrix::BlockSource;
use ltm::pipeline::PackOptions;
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

/// Hardly compressed, by a slope at which every bit is worth its cost.
const WHOLE: Packing = Packing { name: "whole", target: Target::Slope(1e-30), rank: Some(512) };

const NOTE: &str = "Scenes and lightings as in `corpus.csv`, without those that the matrix itself hardly shows. Each default container, and some by \
a PSNR, against the same denoised matrix hardly compressed (rank 512, steps as fine as 16-bit floats). ꟻLIP and seams as `ltm study picture` has them.";

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
    let shown = lightings(&matrix)?;
    let lightings: Vec<Lighting> = shown.iter().map(|shown| shown.lighting.clone()).collect();
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
        let all = packed.images.par_iter().zip(&whole.images).zip(&shown);
        let seen: Vec<Seen> =
            all.map(|((image, whole), shown)| Seen::of(image, whole, &shown.reference, side)).collect();
        table.push(row((entry, samples), &matrix, (packing, packed), &shown, &seen));
        bench.watch.advance(1, matrix.shape().raw_bytes(), "B");
    }
    Ok(())
}

fn row(
    (entry, samples): (&Entry, u32),
    matrix: &StoreReader,
    (packing, packed): (&Packing, &Packed),
    shown: &[Shown],
    seen: &[Seen],
) -> Vec<Cell> {
    let of_all = |part: fn(&Seen) -> f64| mean(seen.iter().map(part));
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
        of_all(|s| s.flip).into(),
        seen[of_flip].flip.into(),
        shown[of_flip].name.as_str().into(),
        of_all(|s| s.seams).into(),
        seen[of_seams].seams.into(),
        packed.seconds.into(),
    ]
}
