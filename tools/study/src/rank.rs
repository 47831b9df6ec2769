//! Rank against the resolution of the light, for signal and noise separately (the paper, §4: "increasing the resolution
//! of the light source does not lead to the increase of the matrix rank").
//!
//! Two renders `A`, `B` with different seeds have the same signal and independent noise. With `A = Σ σₖ uₖ vₖᵀ`, the
//! rank of the matrix is the least `k` for which the rest, `Σ_{i>k} σᵢ²`, is below a share of `‖A‖²`. The rank of the
//! signal is the least `k` for which `Σ_{i>k} σᵢ uᵢᵀ B vᵢ` is below that share of `⟨A, B⟩`, in which noise has mean
//! zero.

use rayon::prelude::*;

use super::bench::{Bench, Wanted};
use super::chart::{Axis, Chart, Line, Panel};
use super::table::Table;
use super::{StudyReport, svd};
use ltm::error::Result;
use ltm::matrix::{BlockId, BlockSource, TracedBlock};

/// Relative error at which ranks are read.
const ERROR: f64 = 0.05;

/// Mean over blocks.
#[derive(Clone, Copy, Default)]
struct Found {
    matrix: f64,
    signal: f64,
    /// Share of the matrix's energy that is noise.
    noise: f64,
}

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let (scenes, size, sides, samples): (&[&'static str], _, &[u32], _) = match bench.quick {
        true => (&["diffuse"], (32, 32), &[4, 8], 64),
        false => (&["diffuse", "reflections", "caustics", "mixed"], (96, 64), &[8, 16, 32], 512),
    };
    let note = "Smallest rank of a block at which 5 % (relative L2) is left of the matrix, and of its signal (from two renders \
with different seeds); mean over blocks. Noise: its share of the matrix's energy.";
    let mut table = Table::new(
        "Rank against the resolution of the light",
        bench.notes(&[note]),
        &[
            ("scene", 0),
            ("texels", 0),
            ("rows", 0),
            ("columns", 0),
            ("block_px", 0),
            ("samples_per_px", 0),
            ("precision", 0),
            ("rank_of_matrix", 1),
            ("rank_of_signal", 1),
            ("noise_share", 4),
        ],
    );
    let mut panels = Vec::new();
    bench.watch.begin("rank", (scenes.len() * sides.len()) as u64, "matrices");
    for &scene in scenes {
        let mut of_matrix = Line { name: "the matrix".into(), points: Vec::new() };
        let mut of_signal = Line { name: "its signal".into(), points: Vec::new() };
        for &texels in sides {
            let wanted = Wanted { scene, size, texels, samples, seed: 0, block_side: 32 };
            let (a, b) = (bench.matrix(wanted)?, bench.matrix(Wanted { seed: 1, ..wanted })?);
            let shape = a.shape();
            let blocks: Vec<BlockId> = shape.blocks().collect();
            let found = blocks.par_iter().map(|&id| {
                let (mut first, mut second) = (TracedBlock::default(), TracedBlock::default());
                a.read_block(id, &mut first)?;
                b.read_block(id, &mut second)?;
                Ok(ranks(&first, &second))
            });
            let found = found.collect::<Result<Vec<_>>>()?;
            let mean = |part: fn(&Found) -> f64| found.iter().map(part).sum::<f64>() / found.len() as f64;
            let (matrix, signal) = (mean(|f| f.matrix), mean(|f| f.signal));
            of_matrix.points.push((shape.columns() as f64, matrix));
            of_signal.points.push((shape.columns() as f64, signal));
            table.push(vec![
                scene.into(),
                format!("{texels} × {texels}").into(),
                shape.rows().into(),
                shape.columns().into(),
                shape.block_side().into(),
                samples.into(),
                "f32".into(),
                matrix.into(),
                signal.into(),
                mean(|f| f.noise).into(),
            ]);
            bench.watch.advance(1, shape.raw_bytes(), "B");
        }
        panels.push(Panel { title: scene.to_owned(), lines: vec![of_matrix, of_signal] });
    }
    bench.watch.end();
    let chart = Chart {
        title: "Rank at 5 % error of a block against columns".into(),
        caption: bench.caption(&format!("{samples} spp, blocks of 32 px, f32")),
        x: Axis::logarithmic("columns (texels of the light)"),
        y: Axis::logarithmic("mean rank"),
        panels,
    };
    let mut report = StudyReport::default();
    report.add_table(&bench.out, "rank", &table)?;
    report.add_chart(&bench.out, "rank", &chart)?;
    Ok(report)
}

fn ranks(first: &TracedBlock, second: &TracedBlock) -> Found {
    let (a, b) = (svd::to_f64(first.block.view()), svd::to_f64(second.block.view()));
    let (squares, v) = svd::eigen((a.transpose() * &a).as_ref());
    // σᵢ uᵢᵀ B vᵢ = (A vᵢ)ᵀ (B vᵢ).
    let (along, across) = (&a * &v, &b * &v);
    let shared: Vec<f64> = (0..v.ncols()).map(|k| along.col(k).transpose() * across.col(k)).collect();
    let (energy, signal): (f64, f64) = (squares.iter().sum(), shared.iter().sum());
    if energy <= 0.0 || signal <= 0.0 {
        return Found::default();
    }
    Found {
        matrix: rank_of(&squares, energy) as f64,
        signal: rank_of(&shared, signal) as f64,
        noise: (1.0 - signal / energy).max(0.0),
    }
}

/// The smallest rank from which on no more than the share of the total is left.
fn rank_of(parts: &[f64], total: f64) -> usize {
    let mut left = 0.0;
    let mut rank = parts.len();
    for (k, part) in parts.iter().enumerate().rev() {
        left += part;
        if left > ERROR * ERROR * total {
            break;
        }
        rank = k;
    }
    rank
}

#[cfg(test)]
mod tests {
    use super::*;
    use ltm::matrix::Block;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    /// A rank-1 signal under noise of a tenth of its norm: the matrix needs many columns for 5 %, its signal one.
    #[test]
    fn noise_raises_the_rank_of_the_matrix_and_not_that_of_the_signal() {
        let (m, n) = (96, 48);
        let render = |seed| {
            let mut random = Pcg64Mcg::seed_from_u64(seed);
            let entry = |e: usize| 1.0 + 0.3 * ((e % m) as f32 * 0.1).sin();
            let entries = (0..m * n).map(|e| entry(e) + 0.35 * (random.random::<f32>() - 0.5)).collect();
            TracedBlock { block: Block::from_entries(m, n, entries), noise: None, planes: None }
        };
        let found = ranks(&render(1), &render(2));
        assert_eq!(found.signal, 1.0);
        assert!(found.matrix > 10.0, "{}", found.matrix);
        // Variance of the noise 0.35² / 12 over a mean square of about 1.05.
        assert!((found.noise - 0.0097).abs() < 0.002, "{}", found.noise);
    }
}
