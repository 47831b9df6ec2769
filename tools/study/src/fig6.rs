//! Figure 6 of the paper: PSNR against the number of columns kept, for Algorithms 1 to 4, ours, and the bound that no
//! approximation of that rank passes.

use rayon::prelude::*;

use super::bench::{Bench, Wanted};
use super::chart::{Axis, Chart, Line, Panel};
use super::factors::{Relit, assemble, relit_factors};
use super::measured::Summary;
use super::table::Table;
use super::{StudyReport, svd};
use ltm::compress::{CompressSettings, Compressor, Method, Target};
use ltm::error::Result;
use ltm::files::write_file;
use ltm::light::Lighting;
use ltm::look;
use ltm::matrix::{BlockId, BlockSource, FactoredBlock, TracedBlock};
use ltm::relight::relight_raw;
use ltm::store::StoreReader;

/// The light set, a look file.
const LIGHTS: &str = include_str!("fig6-lights.toml");

const BOUND: &str = "SVD (bound on the matrix)";

/// Methods with a rank: name, method, sparse entries beside it.
const METHODS: [(&str, Method, bool); 6] = [
    ("ours (low rank alone)", Method::Auto, false),
    ("ours (with sparse entries)", Method::Auto, true),
    ("Algorithm 1", Method::Algorithm1, false),
    ("Algorithm 2", Method::Algorithm2, false),
    ("Algorithm 3", Method::Algorithm3, false),
    ("Algorithm 4", Method::Algorithm4, false),
];

/// Columns kept, numbers kept, and what the blocks show.
type Kept = (usize, f64, Relit);

struct Plan {
    scenes: &'static [&'static str],
    size: (u32, u32),
    texels: u32,
    samples: u32,
    counts: &'static [usize],
    /// Name of the scope, side of its blocks.
    scopes: &'static [(&'static str, u32)],
}

const QUICK: Plan = Plan {
    scenes: &["diffuse", "mixed"],
    size: (48, 36),
    texels: 8,
    samples: 64,
    counts: &[2, 8, 16],
    scopes: &[("blocks of 16 px", 16)],
};

const FULL: Plan = Plan {
    scenes: &["diffuse", "reflections", "caustics", "mixed"],
    size: (128, 96),
    texels: 32,
    samples: 512,
    counts: &[2, 4, 8, 16, 32, 64],
    scopes: &[("blocks of 32 px", 32), ("whole image", 128)],
};

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let plan = if bench.quick { &QUICK } else { &FULL };
    let scenes = bench.with_conference(plan.scenes);
    let lights = bench.out.join("fig6-lights.toml");
    write_file(&lights, true, LIGHTS.as_bytes())?;
    let note = "Images of the factors, not quantised, against those of the raw matrix; mean and worst over the light set \
(`fig6-lights.toml`). lin: peak = the reference's largest value; clip: exposed to the 95th luminance percentile, clipped. \
Numbers kept: of a block's factors and sparse entries (two each) over (rows + columns), so that it equals the rank \
where there are no sparse entries. Algorithms 1 to 4 read twice as many rows as columns.";
    let mut table = Table::new(
        "PSNR against the number of columns kept",
        bench.notes(&[note]),
        &[
            ("scene", 0),
            ("scope", 0),
            ("method", 0),
            ("rows", 0),
            ("columns", 0),
            ("block_px", 0),
            ("samples_per_px", 0),
            ("precision", 0),
            ("columns_kept", 0),
            ("numbers_kept", 2),
            ("psnr_lin_db", 2),
            ("psnr_lin_worst_db", 2),
            ("psnr_clip_db", 2),
            ("psnr_clip_worst_db", 2),
        ],
    );
    let steps = plan.scopes.len() * scenes.len() * plan.counts.len() * (METHODS.len() + 1);
    bench.watch.begin("fig6", steps as u64, "points");
    let mut report = StudyReport::default();
    for &(scope, block_side) in plan.scopes {
        let (mut mean, mut worst) = (Vec::new(), Vec::new());
        for &scene in &scenes {
            let Plan { size, texels, samples, .. } = *plan;
            let matrix = bench.matrix(Wanted { scene, size, texels, samples, seed: 0, block_side })?;
            let set = look::load(&lights, &matrix.job().basis)?;
            let lightings = set.names().map(|name| set.named(name).cloned()).collect::<Result<Vec<_>>>()?;
            let references = relight_raw(&matrix, &lightings)?;
            let shape = matrix.shape();
            let mut lines: Vec<(Line, Line)> = Vec::new();
            let mut add = |method: &str, points: Vec<Kept>| {
                let named = || Line { name: method.to_owned(), points: Vec::new() };
                let (mut mean, mut worst) = (named(), named());
                for (count, numbers, relit) in points {
                    let summary = Summary::of(&assemble(shape, lightings.len(), &relit), &references);
                    mean.points.push((numbers, summary.mean.psnr_linear));
                    worst.points.push((numbers, summary.worst.psnr_linear));
                    table.push(vec![
                        scene.into(),
                        scope.into(),
                        method.into(),
                        shape.rows().into(),
                        shape.columns().into(),
                        block_side.into(),
                        samples.into(),
                        "f32".into(),
                        count.into(),
                        numbers.into(),
                        summary.mean.psnr_linear.into(),
                        summary.worst.psnr_linear.into(),
                        summary.mean.psnr_clipped.into(),
                        summary.worst.psnr_clipped.into(),
                    ]);
                    bench.watch.advance(1, 1, "points");
                }
                lines.push((mean, worst));
            };
            for (name, method, sparse) in METHODS {
                let points = plan.counts.iter().map(|&count| {
                    bench.stop_if_interrupted()?;
                    let (numbers, relit) = kept(&matrix, method, sparse, count, &lightings)?;
                    Ok((count, numbers, relit))
                });
                add(name, points.collect::<Result<Vec<_>>>()?);
            }
            add(BOUND, bound(&matrix, plan.counts, &lightings)?);
            let title = format!("{scene}, {} × {}", shape.rows(), shape.columns());
            let (of_mean, of_worst) = lines.into_iter().unzip();
            mean.push(Panel { title: title.clone(), lines: of_mean });
            worst.push(Panel { title, lines: of_worst });
        }
        let stem = scope.split(' ').next().unwrap_or(scope);
        for (panels, what) in [(mean, "mean"), (worst, "worst")] {
            let chart = Chart {
                title: format!("{what} PSNR (lin) of the light set against columns kept, {scope}"),
                caption: bench.caption(&format!("{} spp, f32 factors", plan.samples)),
                x: Axis::logarithmic("numbers kept / (rows + columns) of a block"),
                y: Axis::linear("PSNR lin (dB)"),
                panels,
            };
            report.add_chart(&bench.out, &format!("fig6-{stem}-{what}"), &chart)?;
        }
    }
    bench.watch.end();
    report.add_table(&bench.out, "fig6", &table)?;
    Ok(report)
}

/// Relit rows of all blocks with so many columns kept, and the mean of numbers over rows + columns.
fn kept(
    matrix: &StoreReader,
    method: Method,
    sparse: bool,
    count: usize,
    lightings: &[Lighting],
) -> Result<(f64, Relit)> {
    let standard = CompressSettings::of_method(method);
    let settings = CompressSettings {
        rank: count,
        // Everything that was found is kept, at full precision.
        target: Target::Slope(0.0),
        noise_factor: None,
        sparse: standard.sparse.filter(|_| sparse),
        ..standard
    };
    let compressor = Compressor::new(&matrix.job().basis, matrix.shape(), settings)?;
    let blocks: Vec<BlockId> = matrix.shape().blocks().collect();
    let all = blocks.par_iter().map_init(TracedBlock::default, |traced, &id| {
        matrix.read_block(id, traced)?;
        let candidate = compressor.analyse(id, traced.block.view(), None);
        let cut = compressor.choose(std::iter::once(candidate.summary()));
        let factored = candidate.cut(&cut);
        let width = (factored.rows + factored.columns) as f64;
        let numbers = factored.rank() as f64 + 2.0 * factored.sparse.len() as f64 / width;
        Ok((numbers, relit_factors(&factored, lightings)))
    });
    let (numbers, relit): (Vec<f64>, Vec<_>) = all.collect::<Result<Vec<_>>>()?.into_iter().unzip();
    Ok((numbers.iter().sum::<f64>() / blocks.len() as f64, relit))
}

/// The best approximation of the matrix (Eckart and Young 1936), exactly, by the eigenvectors `V` of `AᵀA`: `A V Vᵀ`.
fn bound(matrix: &StoreReader, counts: &[usize], lightings: &[Lighting]) -> Result<Vec<Kept>> {
    let most = counts.iter().copied().max().unwrap_or(1);
    let blocks: Vec<BlockId> = matrix.shape().blocks().collect();
    let parts = blocks.par_iter().map_init(TracedBlock::default, |traced, &id| {
        matrix.read_block(id, traced)?;
        let a = svd::to_f64(traced.block.view());
        let (_, v) = svd::eigen((a.transpose() * &a).as_ref());
        let v = v.as_ref().subcols(0, most.min(a.ncols()));
        let left = &a * v;
        Ok(FactoredBlock {
            rows: a.nrows(),
            columns: a.ncols(),
            left: (0..v.ncols()).flat_map(|k| left.col(k).iter().map(|v| *v as f32).collect::<Vec<_>>()).collect(),
            right: (0..v.ncols()).flat_map(|k| v.col(k).iter().map(|v| *v as f32).collect::<Vec<_>>()).collect(),
            ..Default::default()
        })
    });
    let parts = parts.collect::<Result<Vec<_>>>()?;
    let cut = |count: usize| -> Relit {
        let first = |block: &FactoredBlock| {
            let mut block = block.clone();
            block.left.truncate(count * block.rows);
            block.right.truncate(count * block.columns);
            relit_factors(&block, lightings)
        };
        parts.par_iter().map(first).collect()
    };
    Ok(counts.iter().map(|&count| (count, count as f64, cut(count))).collect())
}
