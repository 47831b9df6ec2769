//! Resistance to noise: how far images are from a converged reference before and after compression.

use super::StudyReport;
use super::bench::{Bench, Wanted};
use super::chart::{Axis, Chart, Line, Panel};
use super::measured::Summary;
use super::reference::{Judged, LIGHTINGS_NOTE};
use super::rivals::packed;
use super::table::Table;
use ltm::compress::{CompressSettings, Method, PriorChoice};
use ltm::error::Result;
use ltm::matrix::BlockSource;
use ltm::pipeline::PackOptions;
use ltm::relight::relight_raw;

struct Plan {
    scenes: &'static [&'static str],
    size: (u32, u32),
    texels: u32,
    samples: &'static [u32],
    /// Of the reference, which has another seed.
    converged: u32,
}

const QUICK: Plan = Plan { scenes: &["diffuse"], size: (48, 32), texels: 8, samples: &[16, 64], converged: 1024 };

const FULL: Plan = Plan {
    scenes: &["diffuse", "reflections", "caustics", "mixed", "environment"],
    size: (64, 64),
    texels: 16,
    samples: &[4, 16, 64, 256],
    converged: 2048,
};

const RAW: &str = "raw matrix";

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let plan = if bench.quick { &QUICK } else { &FULL };
    let note = format!(
        "Images against those of a matrix of {} samples per pixel and another seed, mean over the lightings (worst \
where it says so). Gain: PSNR lin of the packed image over that of the raw matrix it was packed from. Ours: as `ltm-pack` \
chooses by itself, and with `--denoise off`. lin: peak = the reference's largest value; clip: exposed to its 95th luminance percentile, clipped.",
        plan.converged
    );
    let mut table = Table::new(
        "Error against a converged reference, before and after compression",
        bench.notes(&[&note, LIGHTINGS_NOTE]),
        &[
            ("scene", 0),
            ("samples_per_px", 0),
            ("method", 0),
            ("rows", 0),
            ("columns", 0),
            ("block_px", 0),
            ("mean_rank", 2),
            ("bytes", 0),
            ("psnr_lin_db", 2),
            ("psnr_lin_worst_db", 2),
            ("psnr_clip_db", 2),
            ("psnr_clip_worst_db", 2),
            ("relative_l2", 4),
            ("flip", 4),
            ("flip_worst", 4),
            ("gain_lin_db", 2),
        ],
    );
    let flat = CompressSettings { prior: PriorChoice::Flat, ..CompressSettings::default() };
    let fixed = |method| CompressSettings { rank: 8, ..CompressSettings::of_method(method) };
    let options =
        |compress, denoise| PackOptions { allow_lost_lights: true, compress, denoise, ..PackOptions::default() };
    let methods = [
        ("ours", options(CompressSettings::default(), true)),
        ("ours (not cleaned)", options(CompressSettings::default(), false)),
        ("ours (not cleaned, flat prior)", options(flat, false)),
        ("block SVD (rank 8)", options(fixed(Method::BlockSvd), false)),
        ("Algorithm 4 (rank 8)", options(fixed(Method::Algorithm4), false)),
    ];
    let mut panels = Vec::new();
    let steps = plan.scenes.len() * plan.samples.len() * (methods.len() + 1);
    bench.watch.begin("noise", steps as u64, "points");
    for &scene in plan.scenes {
        let wanted =
            Wanted { scene, size: plan.size, texels: plan.texels, samples: plan.converged, seed: 1, block_side: 32 };
        let converged = bench.matrix(wanted)?;
        let Judged { lightings, references, .. } = Judged::of(&converged)?;
        let mut lines: Vec<Line> = std::iter::once(RAW)
            .chain(methods.iter().map(|m| m.0))
            .map(|name| Line { name: name.into(), points: Vec::new() })
            .collect();
        for &samples in plan.samples {
            let matrix = bench.matrix(Wanted { samples, seed: 0, ..wanted })?;
            let shape = matrix.shape();
            let raw = Summary::of(&relight_raw(&matrix, &lightings)?, &references);
            let mut results = vec![(RAW, None, shape.raw_bytes(), raw)];
            for (name, options) in &methods {
                let packed = packed(bench, &matrix, options.clone(), &lightings)?;
                results.push((name, packed.rank, packed.bytes, Summary::of(&packed.images, &references)));
                bench.watch.advance(1, packed.bytes, "B");
            }
            for ((method, rank, bytes, summary), line) in results.into_iter().zip(&mut lines) {
                line.points.push((f64::from(samples), summary.mean.psnr_linear));
                table.push(vec![
                    scene.into(),
                    samples.into(),
                    method.into(),
                    shape.rows().into(),
                    shape.columns().into(),
                    shape.block_side().into(),
                    rank.into(),
                    bytes.into(),
                    summary.mean.psnr_linear.into(),
                    summary.worst.psnr_linear.into(),
                    summary.mean.psnr_clipped.into(),
                    summary.worst.psnr_clipped.into(),
                    summary.mean.relative_l2.into(),
                    summary.mean.flip.into(),
                    summary.worst.flip.into(),
                    (summary.mean.psnr_linear - raw.mean.psnr_linear).into(),
                ]);
            }
            bench.watch.advance(1, shape.raw_bytes(), "B");
        }
        panels.push(Panel { title: scene.to_owned(), lines });
    }
    bench.watch.end();
    let chart = Chart {
        title: "PSNR (lin) against a converged reference".into(),
        caption: bench.caption(&format!("reference {} spp, blocks of 32 px", plan.converged)),
        x: Axis::logarithmic("samples per pixel of the matrix"),
        y: Axis::linear("PSNR lin (dB)"),
        panels,
    };
    let mut report = StudyReport::default();
    report.add_table(&bench.out, "noise", &table)?;
    report.add_chart(&bench.out, "noise", &chart)?;
    Ok(report)
}
