//! The compressors that are compared, each as bytes in a file and the images that come back out of it.

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use faer::Mat;
use half::f16;
use rayon::prelude::*;

use super::bench::{Bench, file_bytes};
use super::factors::{assemble, relit_block, relit_factors};
use super::{kernel_nystrom, svd};
use ltm::compress::{CompressSettings, component_bits};
use ltm::container::codec::band_steps;
use ltm::container::{ContainerOptions, ContainerReader, ContainerWriter, LightLayout};
use ltm::error::{Error, Result};
use ltm::files::write_file;
use ltm::image::LinearImage;
use ltm::light::{Lighting, LightingPrior};
use ltm::matrix::BlockReport;
use ltm::matrix::{BlockId, BlockSource, FactoredBlock, TracedBlock};
use ltm::pipeline::{self, PackOptions};
use ltm::relight::CpuRelighter;
use ltm::store::StoreReader;

/// Effort of zstd behind every rival: high, as a rival's should be; its time is not compared.
pub(super) const ZSTD_LEVEL: i32 = 12;

/// Name of the file that [`packed`] leaves.
pub(super) const PACKED: &str = "packed.ltc";

/// What a compressor made of a matrix.
pub(super) struct Packed {
    /// Bytes of its file.
    pub(super) bytes: u64,
    /// Mean components of a block, where it has components.
    pub(super) rank: Option<f64>,
    /// Seconds from the stored matrix to the file.
    pub(super) seconds: f64,
    /// One for each lighting, from the file.
    pub(super) images: Vec<LinearImage>,
}

/// The product: `ltm-pack` with these settings, and relighting on the CPU.
pub(super) fn product(
    bench: &Bench<'_>,
    matrix: &StoreReader,
    settings: &CompressSettings,
    lightings: &[Lighting],
) -> Result<Packed> {
    packed(
        bench,
        matrix,
        PackOptions { allow_lost_lights: true, compress: settings.clone(), ..Default::default() },
        lightings,
    )
}

/// `ltm-pack` with all its options, and relighting on the CPU.
pub(super) fn packed(
    bench: &Bench<'_>,
    matrix: &StoreReader,
    mut options: PackOptions,
    lightings: &[Lighting],
) -> Result<Packed> {
    bench.stop_if_interrupted()?;
    let path = bench.cached(PACKED);
    options.container.overwrite = true;
    let report = pipeline::pack(matrix, matrix.job(), &path, &options, &bench.silent())?;
    let relighter = CpuRelighter::load(&ContainerReader::open(&path)?)?;
    let images = lightings.iter().map(|lighting| relighter.relight(lighting)).collect::<Result<_>>()?;
    Ok(Packed { bytes: file_bytes(&path)?, rank: Some(report.mean_rank), seconds: report.seconds, images })
}

/// Kernel Nyström with the product's codec for its factors, and a few bytes a block for the way back.
pub(super) fn kernel(bench: &Bench<'_>, matrix: &StoreReader, rank: usize, lightings: &[Lighting]) -> Result<Packed> {
    bench.stop_if_interrupted()?;
    let begun = Instant::now();
    let path = bench.cached("kernel.ltc");
    let writer =
        ContainerWriter::create(&path, matrix.job(), ContainerOptions { overwrite: true, ..Default::default() })?;
    let shape = matrix.shape();
    let blocks: Vec<BlockId> = shape.blocks().collect();
    let ways_back: Vec<kernel_nystrom::Back> = blocks
        .par_iter()
        .map_init(TracedBlock::default, |traced, &id| {
            matrix.read_block(id, traced)?;
            let mapped = kernel_nystrom::decompose(traced.block.view(), rank, u64::from(id.0));
            writer.write_block(id, &mapped.factors, &BlockReport::default())?;
            Ok(mapped.back)
        })
        .collect::<Result<_>>()?;
    writer.finish()?;
    let seconds = begun.elapsed().as_secs_f64();
    let reader = ContainerReader::open(&path)?;
    let relit = blocks.par_iter().zip(&ways_back).map(|(&id, &back)| {
        let block = kernel_nystrom::reconstruct(&reader.read_block(id)?, back);
        Ok(relit_block(block.view(), lightings))
    });
    let relit = relit.collect::<Result<Vec<_>>>()?;
    Ok(Packed {
        bytes: file_bytes(&path)? + kernel_nystrom::Back::BYTES * blocks.len() as u64,
        rank: Some(rank as f64),
        seconds,
        images: assemble(shape, lightings.len(), &relit),
    })
}

/// The leading singular triples of every block, to be cut at several ranks.
pub(super) struct BlockSvd {
    parts: Vec<svd::Leading>,
    rows: Vec<usize>,
    columns: usize,
    /// How finely the product's codec stores right sides, by the prior; empty without one.
    band_steps: Arc<[i8]>,
    seconds: f64,
}

/// How the ranks of blocks are chosen.
#[derive(Clone, Copy, Debug)]
pub(super) enum Ranks {
    /// The same for all.
    Fixed(usize),
    /// One threshold on singular values for all blocks, such that this is the mean.
    Mean(f64),
}

impl BlockSvd {
    /// Weighted by a prior, or not.
    pub(super) fn new(matrix: &StoreReader, rank: usize, prior: Option<&LightingPrior>) -> Result<Self> {
        let begun = Instant::now();
        let root = prior.map(root_of);
        let blocks: Vec<BlockId> = matrix.shape().blocks().collect();
        let parts = blocks.par_iter().map_init(TracedBlock::default, |traced, &id| {
            matrix.read_block(id, traced)?;
            let (a, seed) = (svd::to_f64(traced.block.view()), u64::from(id.0));
            let part = match &root {
                Some(root) => svd::leading_weighted(a.as_ref(), root.as_ref(), rank, seed),
                None => svd::leading(a.as_ref(), rank, seed),
            };
            Ok((part, traced.block.rows()))
        });
        let (parts, rows): (Vec<_>, Vec<_>) = parts.collect::<Result<Vec<_>>>()?.into_iter().unzip();
        let lights = LightLayout::of(&matrix.job().basis);
        let band_steps = prior.map_or_else(Arc::default, |prior| band_steps(&lights, prior).into());
        let columns = matrix.shape().columns();
        Ok(Self { parts, rows, columns, band_steps, seconds: begun.elapsed().as_secs_f64() })
    }

    /// Rank of each block.
    fn ranks(&self, ranks: Ranks) -> Vec<usize> {
        match ranks {
            Ranks::Fixed(rank) => self.parts.iter().map(|part| rank.min(part.sigma.len())).collect(),
            Ranks::Mean(mean) => {
                let mut all: Vec<f64> = self.parts.iter().flat_map(|part| part.sigma.iter().copied()).collect();
                all.sort_by(|a, b| b.total_cmp(a));
                let kept = ((mean * self.parts.len() as f64) as usize).min(all.len());
                let least = if kept == 0 { f64::INFINITY } else { all[kept - 1].max(f64::MIN_POSITIVE) };
                self.parts.iter().map(|part| part.sigma.iter().take_while(|s| **s >= least).count()).collect()
            }
        }
    }

    /// Factors `U √σ`, `√σ Vᵀ` as 16-bit floats (scaled for each component), byte planes apart, zstd.
    pub(super) fn pack(
        &self,
        bench: &Bench<'_>,
        matrix: &StoreReader,
        ranks: Ranks,
        lightings: &[Lighting],
    ) -> Result<Packed> {
        bench.stop_if_interrupted()?;
        let path = bench.cached("svd.rival");
        let ranks = self.ranks(ranks);
        let mut bytes = Vec::new();
        for (index, &rank) in ranks.iter().enumerate() {
            let compressed = zstd::encode_all(self.half_bytes(index, rank).as_slice(), ZSTD_LEVEL)
                .map_err(Error::io(&path, "compress"))?;
            bytes.extend((compressed.len() as u32).to_le_bytes());
            bytes.extend((rank as u16).to_le_bytes());
            bytes.extend(compressed);
        }
        write_file(&path, true, &bytes)?;
        let relit = read_blocks(&path, &self.rows, self.columns)?;
        let relit: Vec<_> = relit.par_iter().map(|block| relit_factors(block, lightings)).collect();
        Ok(Packed {
            bytes: file_bytes(&path)?,
            rank: Some(ranks.iter().sum::<usize>() as f64 / ranks.len() as f64),
            seconds: self.seconds,
            images: assemble(matrix.shape(), lightings.len(), &relit),
        })
    }

    /// Ranks, steps, transform and coding as the product has them, at the one slope at which about so many bytes are expected.
    pub(super) fn pack_coded(
        &self,
        bench: &Bench<'_>,
        matrix: &StoreReader,
        bytes: f64,
        lightings: &[Lighting],
    ) -> Result<Packed> {
        bench.stop_if_interrupted()?;
        let path = bench.cached("svd.ltc");
        let options = ContainerOptions { overwrite: true, ..Default::default() };
        let writer = ContainerWriter::create(&path, matrix.job(), options)?;
        let slope = self.slope(bytes);
        let blocks: Vec<BlockId> = matrix.shape().blocks().collect();
        let ranks = blocks.par_iter().map(|&id| {
            let block = self.cut(id, slope);
            writer.write_block(id, &block, &BlockReport::default())?;
            Ok(block.rank())
        });
        let ranks: Vec<usize> = ranks.collect::<Result<_>>()?;
        writer.finish()?;
        let relighter = CpuRelighter::load(&ContainerReader::open(&path)?)?;
        let images = lightings.iter().map(|lighting| relighter.relight(lighting)).collect::<Result<_>>()?;
        Ok(Packed {
            bytes: file_bytes(&path)?,
            rank: Some(ranks.iter().sum::<usize>() as f64 / ranks.len() as f64),
            seconds: self.seconds,
            images,
        })
    }

    /// Squared radiance per bit at which so many bytes are expected, by bisection.
    fn slope(&self, bytes: f64) -> f64 {
        let energy: f64 = self.parts.iter().flat_map(|part| &part.sigma).map(|sigma| sigma * sigma).sum();
        let expected = |slope: f64| -> f64 {
            let of_block = |index| self.kept(index, slope).iter().map(|kept| kept.bits).sum::<f64>();
            (0..self.parts.len()).map(of_block).sum::<f64>() / 8.0
        };
        let (mut low, mut high) = (energy.log2() - 70.0, energy.log2());
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if expected(middle.exp2()) > bytes { low = middle } else { high = middle }
        }
        high.exp2()
    }

    /// The components of a block that are worth their bits, with the steps of the slope: the rule of
    /// `src/compress/cut.rs` if noise is ignored and all blocks have the same weight.
    fn kept(&self, index: usize, slope: f64) -> Vec<Kept> {
        let (part, m, n) = (&self.parts[index], self.rows[index] as f64, self.columns as f64);
        let allowed = 6.0 * slope / std::f64::consts::LN_2;
        let kept = part.sigma.iter().enumerate().filter(|(_, sigma)| **sigma > 0.0).map(|(component, sigma)| {
            let gain = sigma * sigma;
            let mean_square = gain * part.v.col(component).squared_norm_l2() / n;
            let (left, right) = ((allowed / gain).sqrt(), allowed.sqrt());
            let bits = component_bits((m, 1.0 / m, left), (n, mean_square, right));
            let worth = gain - (m + n) * allowed / 12.0 > slope * bits;
            worth.then_some(Kept { component, bits, left, right })
        });
        kept.flatten().collect()
    }

    fn cut(&self, id: BlockId, slope: f64) -> FactoredBlock {
        let index = id.index();
        let part = &self.parts[index];
        let right_band_steps = Arc::clone(&self.band_steps);
        let (rows, columns) = (self.rows[index], self.columns);
        let mut block = FactoredBlock { rows, columns, right_band_steps, ..Default::default() };
        for Kept { component: k, left, right, .. } in self.kept(index, slope) {
            block.left.extend((0..block.rows).map(|i| part.u[(i, k)] as f32));
            block.right.extend((0..block.columns).map(|j| (part.v[(j, k)] * part.sigma[k]) as f32));
            block.left_step.push(left as f32);
            block.right_step.push(right as f32);
        }
        block
    }

    /// For each component a scale, then the 16-bit floats of both its factors; low bytes first, then high bytes.
    fn half_bytes(&self, index: usize, rank: usize) -> Vec<u8> {
        let part = &self.parts[index];
        let mut scales = Vec::new();
        let mut halves: Vec<f16> = Vec::new();
        for k in 0..rank {
            let root = part.sigma[k].sqrt();
            for factor in [&part.u, &part.v] {
                let values: Vec<f64> = (0..factor.nrows()).map(|i| factor[(i, k)] * root).collect();
                let scale = values.iter().fold(0.0f64, |s, v| s.max(v.abs())).max(1e-30);
                scales.extend((scale as f32).to_le_bytes());
                halves.extend(values.iter().map(|v| f16::from_f64(v / scale)));
            }
        }
        let planes = halves.iter().map(|h| h.to_le_bytes()[0]).chain(halves.iter().map(|h| h.to_le_bytes()[1]));
        scales.into_iter().chain(planes).collect()
    }
}

/// A component that is kept.
struct Kept {
    component: usize,
    /// That it is expected to take.
    bits: f64,
    /// Steps of its two sides.
    left: f64,
    right: f64,
}

/// `S` with `S Sᵀ = K`: columns × any.
fn root_of(prior: &LightingPrior) -> Mat<f64> {
    let (n, width) = (prior.columns(), prior.width());
    Mat::from_fn(n, width + n, |j, w| match w.checked_sub(width) {
        None => f64::from(prior.factor()[w * n + j]),
        Some(own) if own == j => f64::from(prior.independent()[j]).sqrt(),
        Some(_) => 0.0,
    })
}

/// Reads back what [`BlockSvd::pack`] wrote.
fn read_blocks(path: &Path, rows: &[usize], columns: usize) -> Result<Vec<FactoredBlock>> {
    let bytes = fs::read(path).map_err(Error::io(path, "read"))?;
    let mut rest = bytes.as_slice();
    let mut take = |count: usize| -> &[u8] {
        let (taken, left) = rest.split_at(count);
        rest = left;
        taken
    };
    let mut blocks = Vec::new();
    for &rows in rows {
        let length = u32::from_le_bytes(take(4).try_into().expect("4 bytes")) as usize;
        let rank = u16::from_le_bytes(take(2).try_into().expect("2 bytes")) as usize;
        let plain = zstd::decode_all(take(length)).map_err(Error::io(path, "decompress"))?;
        let (scales, planes) = plain.split_at(8 * rank);
        let (low, high) = planes.split_at(planes.len() / 2);
        let scale = |i: usize| f32::from_le_bytes(scales[4 * i..][..4].try_into().expect("4 bytes"));
        let mut values = low.iter().zip(high).map(|(l, h)| f16::from_le_bytes([*l, *h]).to_f32());
        let mut block = FactoredBlock { rows, columns, ..Default::default() };
        for k in 0..rank {
            block.left.extend(values.by_ref().take(rows).map(|v| v * scale(2 * k)));
            block.right.extend(values.by_ref().take(columns).map(|v| v * scale(2 * k + 1)));
        }
        blocks.push(block);
    }
    Ok(blocks)
}
