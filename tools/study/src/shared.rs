//! A basis of columns shared by a group of blocks, compared with each block's own factors.
//!
//! Neighbouring blocks see the same lights, and with many columns (4,096 and more) a right factor `R` is as large as a
//! left one. So a group may store one basis `V`, and each of its blocks `L M` with a small `M`, `R ≈ M V`. The best `V`
//! of its size for `Σ ‖(R − M V) K^½‖²` over the blocks consists of singular vectors of all their `R` under the prior
//! `K`, from the eigenvectors of `[R] K [R]ᵀ`. Its size follows from the rule of ranks (`src/compress/cut.rs`).
//!
//! `L`, `M` and `V` go through the container's codec with the steps of the same slope, so that all bytes are those of
//! chunks; 48 bytes for each block and group are added for the index. Groups are squares of neighbours, or come from
//! k-means over the row spaces of blocks, one block at a time: each joins the group whose basis represents it best.

use std::time::Instant;

use faer::{Mat, MatRef};
use rayon::prelude::*;

use super::bench::{Bench, Wanted};
use super::chart::{Axis, Chart, Line, Panel};
use super::factors::{assemble, relit_factors};
use super::measured::Summary;
use super::reference::{Judged, LIGHTINGS_NOTE};
use super::table::{Cell, Table};
use super::{StudyReport, curve, svd};
use ltm::compress::{Candidate, CompressSettings, Compressor, Target, component_bits};
use ltm::container::codec::{CodecSettings, LayerPart, decode_layer, encode_layer};
use ltm::container::{BlockLayout, LightLayout};
use ltm::error::{Error, Result};
use ltm::light::{Light, LightBasis, LightKind, LightingPrior};
use ltm::matrix::{BlockId, BlockSource, FactoredBlock, MatrixShape, TracedBlock};
use ltm::store::StoreReader;

/// Bytes of a block's and its one layer's record in the index.
const INDEX_BYTES: usize = 48;
/// Components that a group's basis holds while blocks are assigned to it.
const ASSIGNED_RANK: usize = 24;

/// How blocks are put together.
#[derive(Clone, Copy, Debug)]
enum Grouping {
    Alone,
    /// Squares of so many blocks a side.
    Squares(u32),
    /// By their row spaces, into so many groups.
    Means(usize),
}

const GROUPINGS: [(&str, Grouping); 4] = [
    ("each block its own", Grouping::Alone),
    ("2 × 2 blocks", Grouping::Squares(2)),
    ("4 × 4 blocks", Grouping::Squares(4)),
    ("4 groups by k-means", Grouping::Means(4)),
];

struct Plan {
    scenes: &'static [&'static str],
    size: (u32, u32),
    texels: u32,
    samples: u32,
    block_side: u32,
    /// PSNR in dB; the last is more than the noise allows.
    targets_db: &'static [f64],
}

const QUICK: Plan =
    Plan { scenes: &["diffuse"], size: (64, 48), texels: 16, samples: 16, block_side: 16, targets_db: &[30.0, 40.0] };

const FULL: Plan = Plan {
    scenes: &["diffuse", "caustics", "mixed"],
    size: (128, 128),
    texels: 64,
    samples: 256,
    block_side: 32,
    targets_db: &[25.0, 30.0, 35.0, 50.0],
};

/// A matrix whose blocks are packed in several ways.
struct Subject {
    shape: MatrixShape,
    lights: LightLayout,
    prior: LightingPrior,
    /// What columns of the blocks are divided by.
    scales: Vec<f32>,
    judged: Judged,
}

/// What one way of packing gives.
#[derive(Clone, Copy)]
struct Outcome {
    bytes: usize,
    /// Of right sides, or of bases and what refers to them.
    right_bytes: usize,
    /// Mean components of a group's basis, or of a block.
    rank: f64,
    seconds: f64,
    summary: Summary,
}

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let plan = if bench.quick { &QUICK } else { &FULL };
    let note = "Factors as `ltm-pack` cuts them at targets of several dB PSNR, noise heeded; bytes of all chunks in one layer each and \
of the index. Right: bytes of right sides, or of shared bases and the blocks' coordinates in them. Smaller: bytes saved \
against each block its own, at equal PSNR lin, interpolated over log bytes. Seconds: grouping, bases and coding, without \
the analysis of blocks. Images against those of the raw matrix, mean over the lightings.";
    let mut table = Table::new(
        "One basis of columns for several blocks",
        bench.notes(&[note, LIGHTINGS_NOTE]),
        &[
            ("scene", 0),
            ("groups", 0),
            ("rows", 0),
            ("columns", 0),
            ("block_px", 0),
            ("samples_per_px", 0),
            ("target_db", 0),
            ("mean_rank", 1),
            ("bytes", 0),
            ("right_bytes", 0),
            ("psnr_lin_db", 2),
            ("psnr_clip_db", 2),
            ("smaller_percent", 1),
            ("seconds", 2),
        ],
    );
    let mut panels = Vec::new();
    let scenes = bench.with_conference(plan.scenes);
    bench.watch.begin("shared", (scenes.len() * plan.targets_db.len()) as u64, "targets");
    for &scene in &scenes {
        let Plan { size, texels, samples, block_side, .. } = *plan;
        let matrix = bench.matrix(Wanted { scene, size, texels, samples, seed: 0, block_side })?;
        let basis = &matrix.job().basis;
        let subject = Subject {
            shape: matrix.shape(),
            lights: LightLayout::of(basis),
            prior: LightingPrior::of_basis(basis),
            scales: basis.column_scales().to_vec(),
            judged: Judged::of(&matrix)?,
        };
        let mut outcomes: Vec<Vec<Outcome>> = vec![Vec::new(); GROUPINGS.len()];
        let (compressor, candidates) = analysed(bench, &matrix)?;
        for &db in plan.targets_db {
            bench.stop_if_interrupted()?;
            let settings = CompressSettings { target: Target::PsnrDb(db), ..compressor.settings().clone() };
            let cut =
                Compressor::new(basis, subject.shape, settings)?.choose(candidates.iter().map(Candidate::summary));
            let blocks: Vec<FactoredBlock> = candidates.iter().map(|candidate| candidate.cut(&cut)).collect();
            for (outcomes, (_, grouping)) in outcomes.iter_mut().zip(GROUPINGS) {
                outcomes.push(subject.pack(&blocks, grouping)?);
            }
            bench.watch.advance(1, 0, "B");
        }
        let curves: Vec<Vec<(f64, f64)>> = outcomes.iter().map(|of| of.iter().map(Outcome::point).collect()).collect();
        for (i, (name, _)) in GROUPINGS.iter().enumerate() {
            for (outcome, target) in outcomes[i].iter().zip(plan.targets_db) {
                let (log_bytes, db) = outcome.point();
                let alone: Vec<(f64, f64)> = curves[0].iter().map(|&(bytes, db)| (db, bytes)).collect();
                let saved = curve::at(&alone, db).map(|alone| 100.0 * (1.0 - (log_bytes - alone).exp()));
                table.push(vec![
                    scene.into(),
                    (*name).into(),
                    subject.shape.rows().into(),
                    subject.shape.columns().into(),
                    block_side.into(),
                    samples.into(),
                    Cell::from(*target),
                    outcome.rank.into(),
                    outcome.bytes.into(),
                    outcome.right_bytes.into(),
                    db.into(),
                    outcome.summary.mean.psnr_clipped.into(),
                    saved.into(),
                    outcome.seconds.into(),
                ]);
            }
        }
        let line = |(points, (name, _)): (&Vec<(f64, f64)>, &(&str, Grouping))| Line {
            name: (*name).into(),
            points: points.iter().map(|&(bytes, db)| (bytes.exp(), db)).collect(),
        };
        let lines = curves.iter().zip(&GROUPINGS).map(line).collect();
        panels.push(Panel { title: format!("{scene}, {} columns", subject.shape.columns()), lines });
    }
    bench.watch.end();
    let chart = Chart {
        title: "One basis of columns for several blocks".into(),
        caption: bench.caption(&format!("{} spp, blocks of {} px", plan.samples, plan.block_side)),
        x: Axis::logarithmic("bytes"),
        y: Axis::linear("PSNR lin (dB)"),
        panels,
    };
    let mut report = StudyReport::default();
    report.add_table(&bench.out, "shared", &table)?;
    report.add_chart(&bench.out, "shared", &chart)?;
    Ok(report)
}

/// Every block's candidate.
fn analysed(bench: &Bench<'_>, matrix: &StoreReader) -> Result<(Compressor, Vec<Candidate>)> {
    let compressor = Compressor::new(&matrix.job().basis, matrix.shape(), CompressSettings::default())?;
    let blocks: Vec<BlockId> = matrix.shape().blocks().collect();
    let candidates = blocks.par_iter().map_init(TracedBlock::default, |traced, &id| {
        bench.stop_if_interrupted()?;
        matrix.read_block(id, traced)?;
        traced.divide_columns(matrix.job().basis.column_scales());
        Ok(compressor.analyse(id, traced.block.view(), traced.noise.as_ref()))
    });
    let candidates = candidates.collect::<Result<Vec<_>>>()?;
    Ok((compressor, candidates))
}

impl Outcome {
    /// Logarithm of the bytes, and PSNR lin in dB.
    fn point(&self) -> (f64, f64) {
        ((self.bytes as f64).ln(), self.summary.mean.psnr_linear)
    }
}

impl Subject {
    fn pack(&self, blocks: &[FactoredBlock], grouping: Grouping) -> Result<Outcome> {
        let begun = Instant::now();
        let group_of = self.groups(blocks, grouping);
        let mut stored: Vec<FactoredBlock> = vec![FactoredBlock::default(); blocks.len()];
        let (mut bytes, mut right_bytes, mut ranks) = (0, 0, Vec::new());
        for group in 0..group_of.iter().max().map_or(0, |last| last + 1) {
            let members: Vec<usize> = (0..blocks.len()).filter(|&i| group_of[i] == group).collect();
            if let Grouping::Alone = grouping {
                for &i in &members {
                    let layout = self.layout(i, self.lights.clone());
                    let plain = FactoredBlock { sparse: Vec::new(), ..blocks[i].clone() };
                    let (encoded, decoded) = through(&layout, &plain)?;
                    bytes += encoded;
                    right_bytes += encoded - self.left_bytes(i, &plain)?;
                    ranks.push(plain.rank());
                    stored[i] = decoded;
                }
                continue;
            }
            let basis = self.basis_of(&members.iter().map(|&i| &blocks[i]).collect::<Vec<_>>());
            let rank = basis.vectors.nrows();
            let (basis_bytes, vectors) = self.coded_basis(&basis)?;
            bytes += basis_bytes + INDEX_BYTES;
            right_bytes += basis_bytes;
            ranks.push(rank);
            let mut first = 0;
            for &i in &members {
                let (block, k) = (&blocks[i], blocks[i].rank());
                let wide = rank.max(k).max(1);
                let mut plain =
                    FactoredBlock { columns: wide, sparse: Vec::new(), right: vec![0.0; k * wide], ..block.clone() };
                for (c, g) in (0..k).flat_map(|c| (0..rank).map(move |g| (c, g))) {
                    plain.right[c * wide + g] = basis.coordinates[(first + c, g)] as f32;
                }
                first += k;
                let (encoded, decoded) = through(&self.layout(i, lamps(wide)?), &plain)?;
                bytes += encoded;
                right_bytes += encoded - self.left_bytes(i, &plain)?;
                let right = MatRef::from_row_major_slice(&decoded.right, k, wide).subcols(0, rank) * &vectors;
                stored[i] = FactoredBlock {
                    columns: block.columns,
                    right: (0..k).flat_map(|c| (0..block.columns).map(move |j| (c, j))).map(|at| right[at]).collect(),
                    ..decoded
                };
            }
        }
        for (i, (block, stored)) in blocks.iter().zip(&mut stored).enumerate() {
            bytes += INDEX_BYTES;
            if !block.sparse.is_empty() {
                let alone = FactoredBlock {
                    rows: block.rows,
                    columns: block.columns,
                    sparse: block.sparse.clone(),
                    ..Default::default()
                };
                let (encoded, decoded) = through(&self.layout(i, self.lights.clone()), &alone)?;
                bytes += encoded;
                stored.sparse = decoded.sparse;
            }
        }
        let seconds = begun.elapsed().as_secs_f64();
        stored.iter_mut().for_each(|block| block.scale_columns(&self.scales));
        let lightings = &self.judged.lightings;
        let relit: Vec<_> = stored.par_iter().map(|block| relit_factors(block, lightings)).collect();
        let images = assemble(self.shape, lightings.len(), &relit);
        Ok(Outcome {
            bytes,
            right_bytes,
            rank: ranks.iter().sum::<usize>() as f64 / ranks.len().max(1) as f64,
            seconds,
            summary: Summary::of(&images, &self.judged.references),
        })
    }

    fn layout(&self, block: usize, lights: LightLayout) -> BlockLayout {
        BlockLayout::new(self.shape.rect(BlockId(block as u32)), lights)
    }

    /// Bytes of a block whose right side is nothing.
    fn left_bytes(&self, i: usize, block: &FactoredBlock) -> Result<usize> {
        let columns = block.rank().max(1);
        let left = FactoredBlock { columns, right: vec![0.0; block.rank() * columns], ..block.clone() };
        Ok(through(&self.layout(i, lamps(columns)?), &left)?.0)
    }

    /// The group of each block.
    fn groups(&self, blocks: &[FactoredBlock], grouping: Grouping) -> Vec<usize> {
        let (across, side) = (self.shape.width().div_ceil(self.shape.block_side()), self.shape.block_side());
        match grouping {
            Grouping::Alone => vec![0; blocks.len()],
            Grouping::Squares(of) => {
                let square = |id: BlockId| {
                    let rect = self.shape.rect(id);
                    (rect.y / side / of * across.div_ceil(of) + rect.x / side / of) as usize
                };
                self.shape.blocks().map(square).collect()
            }
            Grouping::Means(count) => {
                let rows: Vec<Mat<f64>> = blocks.iter().map(right_of).collect();
                let count = count.min(blocks.len());
                let mut bases: Vec<Basis> =
                    (0..count).map(|g| self.leading(rows[g * blocks.len() / count].as_ref())).collect();
                for right in &rows {
                    let nearest = self.nearest(&bases, right.as_ref());
                    let kept = &bases[nearest];
                    let scaled = Mat::from_fn(kept.vectors.nrows(), right.ncols(), |g, j| {
                        kept.vectors[(g, j)] * kept.energies[g].sqrt()
                    });
                    bases[nearest] = self.leading(stacked(&[scaled, right.clone()]).as_ref());
                }
                rows.iter().map(|right| self.nearest(&bases, right.as_ref())).collect()
            }
        }
    }

    /// The basis that holds most of the energy of these rows.
    fn nearest(&self, bases: &[Basis], right: MatRef<'_, f64>) -> usize {
        let held = |basis: &Basis| self.inner(right, basis.vectors.as_ref()).squared_norm_l2();
        let held: Vec<f64> = bases.iter().map(held).collect();
        (0..bases.len()).max_by(|&a, &b| held[a].total_cmp(&held[b])).unwrap_or(0)
    }

    /// The first directions of these rows under the prior.
    fn leading(&self, rows: MatRef<'_, f64>) -> Basis {
        let (energies, turn) = self.directions(rows);
        let kept = energies.iter().take(ASSIGNED_RANK).take_while(|&&e| e > 1e-10 * energies[0]).count();
        basis_from(rows, energies, turn, kept, 0.0)
    }

    /// The basis of a group: as many directions as are worth their bits at the slope that the blocks' steps are of.
    fn basis_of(&self, blocks: &[&FactoredBlock]) -> Basis {
        let rows = stacked(&blocks.iter().map(|block| right_of(block)).collect::<Vec<_>>());
        let steps = blocks.iter().flat_map(|block| &block.right_step).map(|&step| f64::from(step).powi(2));
        let square_step = steps.sum::<f64>() / rows.nrows().max(1) as f64;
        let (energies, turn) = self.directions(rows.as_ref());
        let worth = |energy: f64| {
            let entries = |count: usize| (count as f64, energy / count as f64, square_step.sqrt());
            let bits = component_bits(entries(rows.ncols()), entries(rows.nrows()));
            energy > square_step * std::f64::consts::LN_2 / 6.0 * bits
        };
        let kept = energies.iter().take_while(|&&energy| energy > 1e-10 * energies[0] && worth(energy)).count();
        basis_from(rows.as_ref(), energies, turn, kept, square_step)
    }

    /// Eigenvalues of `rows K rowsᵀ`, largest first, and its eigenvectors.
    fn directions(&self, rows: MatRef<'_, f64>) -> (Vec<f64>, Mat<f64>) {
        match rows.nrows() {
            0 => (Vec::new(), Mat::zeros(0, 0)),
            _ => svd::eigen(self.inner(rows, rows).as_ref()),
        }
    }

    /// `a K bᵀ`.
    fn inner(&self, a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
        let n = self.prior.columns();
        let factor = Mat::from_fn(n, self.prior.width(), |j, w| f64::from(self.prior.factor()[w * n + j]));
        let scaled = Mat::from_fn(b.nrows(), n, |k, j| b[(k, j)] * f64::from(self.prior.independent()[j]));
        (a * &factor) * (b * &factor).transpose() + a * scaled.transpose()
    }

    /// Bytes of a basis, and what a reader gets of it. Its chunk is that of a block without an image.
    fn coded_basis(&self, basis: &Basis) -> Result<(usize, Mat<f32>)> {
        let (rank, n) = basis.vectors.shape();
        let side = ((rank as f64 / 3.0).sqrt().ceil() as u32).max(1);
        let rect = MatrixShape::new(side, side, n as u32, side)?.rect(BlockId(0));
        let block = FactoredBlock {
            rows: rect.rows(),
            columns: n,
            left: vec![0.0; rank * rect.rows()],
            right: (0..rank).flat_map(|g| (0..n).map(move |j| (g, j))).map(|at| basis.vectors[at] as f32).collect(),
            left_step: vec![1.0; rank],
            right_step: basis.energies.iter().map(|energy| (basis.square_step / energy).sqrt() as f32).collect(),
            ..Default::default()
        };
        let (bytes, decoded) = through(&BlockLayout::new(rect, self.lights.clone()), &block)?;
        Ok((bytes, MatRef::from_row_major_slice(&decoded.right, rank, n).to_owned()))
    }
}

/// Directions of unit energy under the prior, and what rows are in them.
struct Basis {
    /// Rank × columns.
    vectors: Mat<f64>,
    /// Energy of all rows in each.
    energies: Vec<f64>,
    /// All rows × rank.
    coordinates: Mat<f64>,
    /// Mean square of the steps of the rows' entries.
    square_step: f64,
}

/// The first `kept` eigenvectors of `rows K rowsᵀ`, as directions.
fn basis_from(rows: MatRef<'_, f64>, mut energies: Vec<f64>, turn: Mat<f64>, kept: usize, square_step: f64) -> Basis {
    energies.truncate(kept);
    let turn = turn.as_ref().subcols(0, kept);
    let unit = Mat::from_fn(turn.nrows(), kept, |i, g| turn[(i, g)] / energies[g].sqrt());
    let coordinates = Mat::from_fn(turn.nrows(), kept, |i, g| turn[(i, g)] * energies[g].sqrt());
    Basis { vectors: unit.transpose() * rows, energies, coordinates, square_step }
}

fn right_of(block: &FactoredBlock) -> Mat<f64> {
    Mat::from_fn(block.rank(), block.columns, |k, j| f64::from(block.right_component(k)[j]))
}

fn stacked(parts: &[Mat<f64>]) -> Mat<f64> {
    let columns = parts.first().map_or(0, Mat::ncols);
    let mut all = Mat::zeros(parts.iter().map(Mat::nrows).sum(), columns);
    let mut first = 0;
    for part in parts {
        all.subrows_mut(first, part.nrows()).copy_from(part);
        first += part.nrows();
    }
    all
}

/// A layout of columns that are not transformed.
fn lamps(count: usize) -> Result<LightLayout> {
    let mut basis = LightBasis::new();
    for i in 0..count {
        basis.push(Light::unplaced(format!("{i}"), LightKind::Point))?;
    }
    Ok(LightLayout::of(&basis))
}

/// Bytes of a chunk, and what comes back out of it.
fn through(layout: &BlockLayout, block: &FactoredBlock) -> Result<(usize, FactoredBlock)> {
    let failed = |problem: String| Error::input("factors", problem, "");
    let bytes = encode_layer(layout, block, LayerPart::default(), &CodecSettings::default()).map_err(failed)?;
    let decoded = decode_layer(layout, &bytes, None).map_err(failed)?;
    Ok((bytes.len(), decoded))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ltm::matrix::PixelRect;

    /// Two blocks whose right sides mix the same two rows, and a third with another.
    fn subject() -> (Subject, Vec<FactoredBlock>) {
        let shape = MatrixShape::new(12, 4, 64, 4).unwrap();
        let mut basis = LightBasis::new();
        basis.push(Light::unplaced("panel", LightKind::AreaTexels { across: 8, down: 8 })).unwrap();
        let wave = |f: usize, j: usize| ((f * j) as f32 * 0.05).sin() + 1.5;
        let block = |id: usize, rows: [[f32; 2]; 2], waves: [usize; 2]| {
            let PixelRect { width, height, .. } = shape.rect(BlockId(id as u32));
            let m = (3 * width * height) as usize;
            FactoredBlock {
                rows: m,
                columns: 64,
                left: (0..2 * m).map(|i| ((i * (id + 2)) as f32 * 0.1).sin() / (m as f32).sqrt()).collect(),
                right: rows
                    .iter()
                    .flat_map(|mix| (0..64).map(move |j| mix[0] * wave(waves[0], j) + mix[1] * wave(waves[1], j)))
                    .collect(),
                left_step: vec![1e-3; 2],
                right_step: vec![1e-2; 2],
                ..Default::default()
            }
        };
        let blocks = vec![
            block(0, [[1.0, 0.2], [0.1, -0.5]], [1, 2]),
            block(1, [[0.3, 0.9], [0.7, 0.1]], [1, 2]),
            block(2, [[1.0, 0.0], [0.3, 0.6]], [5, 9]),
        ];
        let judged = Judged { names: Vec::new(), lightings: Vec::new(), references: Vec::new() };
        let subject = Subject {
            shape,
            lights: LightLayout::of(&basis),
            prior: LightingPrior::of_basis(&basis),
            scales: Vec::new(),
            judged,
        };
        (subject, blocks)
    }

    #[test]
    fn a_group_of_one_row_space_needs_no_more_than_it_and_loses_a_step_at_most() {
        let (subject, blocks) = subject();
        let basis = subject.basis_of(&[&blocks[0], &blocks[1]]);
        assert_eq!(basis.vectors.nrows(), 2);
        let (_, vectors) = subject.coded_basis(&basis).unwrap();
        let coordinates = Mat::from_fn(4, 2, |i, g| basis.coordinates[(i, g)] as f32);
        let held = coordinates * vectors;
        let rows = stacked(&[right_of(&blocks[0]), right_of(&blocks[1])]);
        let worst = (0..4).flat_map(|i| (0..64).map(move |j| (i, j)));
        let worst = worst.map(|at| (f64::from(held[at]) - rows[at]).abs()).fold(0.0, f64::max);
        // A coordinate of a row is at most the root of its energy, and steps fall with it: two halves of a step, and the
        // codec's dead zone.
        assert!(worst < 0.04, "{worst}");
    }

    #[test]
    fn blocks_of_one_row_space_come_into_one_group() {
        let (subject, blocks) = subject();
        let groups = subject.groups(&blocks, Grouping::Means(2));
        assert!(groups[0] == groups[1] && groups[1] != groups[2], "{groups:?}");
    }
}
