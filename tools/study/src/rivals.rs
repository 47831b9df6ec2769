//! The compressors that are compared, each as bytes in a file and the images that come back out of it.

use std::fs;
use std::path::Path;
use std::time::Instant;

use half::f16;
use rayon::prelude::*;

use super::bench::{Bench, file_bytes};
use super::factors::{assemble, relit_block, relit_factors};
use super::{kernel_nystrom, svd};
use ltm::compress::CompressSettings;
use ltm::container::{ContainerOptions, ContainerReader, ContainerWriter};
use ltm::error::{Error, Result};
use ltm::files::write_file;
use ltm::image::LinearImage;
use ltm::light::Lighting;
use ltm::matrix::BlockReport;
use ltm::matrix::{BlockId, BlockSource, FactoredBlock, TracedBlock};
use ltm::pipeline::{self, PackOptions};
use ltm::relight::CpuRelighter;
use ltm::store::StoreReader;

/// Effort of zstd behind every rival: high, as a rival's should be; its time is not compared.
pub(super) const ZSTD_LEVEL: i32 = 12;

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
    packed(bench, matrix, PackOptions { compress: settings.clone(), ..Default::default() }, lightings)
}

/// `ltm-pack` with all its options, and relighting on the CPU.
pub(super) fn packed(
    bench: &Bench<'_>,
    matrix: &StoreReader,
    mut options: PackOptions,
    lightings: &[Lighting],
) -> Result<Packed> {
    bench.stop_if_interrupted()?;
    let path = bench.cached("packed.ltc");
    options.container.overwrite = true;
    let report = pipeline::pack(matrix, matrix.job(), &path, &options, &bench.silent())?;
    let relighter = CpuRelighter::load(&ContainerReader::open(&path)?)?;
    let images = lightings.iter().map(|lighting| relighter.relight(lighting)).collect::<Result<_>>()?;
    Ok(Packed { bytes: file_bytes(&path)?, rank: Some(report.mean_rank), seconds: report.seconds, images })
}

/// Kernel Nyström with the product's codec for its factors, and a byte a block for its exponent.
pub(super) fn kernel(bench: &Bench<'_>, matrix: &StoreReader, rank: usize, lightings: &[Lighting]) -> Result<Packed> {
    bench.stop_if_interrupted()?;
    let begun = Instant::now();
    let path = bench.cached("kernel.ltc");
    let writer =
        ContainerWriter::create(&path, matrix.job(), ContainerOptions { overwrite: true, ..Default::default() })?;
    let shape = matrix.shape();
    let blocks: Vec<BlockId> = shape.blocks().collect();
    let exponents: Vec<f64> = blocks
        .par_iter()
        .map_init(TracedBlock::default, |traced, &id| {
            matrix.read_block(id, traced)?;
            let mapped = kernel_nystrom::decompose(traced.block.view(), rank, u64::from(id.0));
            writer.write_block(id, &mapped.factors, &BlockReport::default())?;
            Ok(mapped.exponent)
        })
        .collect::<Result<_>>()?;
    writer.finish()?;
    let seconds = begun.elapsed().as_secs_f64();
    let reader = ContainerReader::open(&path)?;
    let relit = blocks.par_iter().zip(&exponents).map(|(&id, &exponent)| {
        let block = kernel_nystrom::reconstruct(&reader.read_block(id)?, exponent);
        Ok(relit_block(block.view(), lightings))
    });
    let relit = relit.collect::<Result<Vec<_>>>()?;
    Ok(Packed {
        bytes: file_bytes(&path)? + blocks.len() as u64,
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
    pub(super) fn new(matrix: &StoreReader, rank: usize) -> Result<Self> {
        let begun = Instant::now();
        let blocks: Vec<BlockId> = matrix.shape().blocks().collect();
        let parts = blocks.par_iter().map_init(TracedBlock::default, |traced, &id| {
            matrix.read_block(id, traced)?;
            Ok((svd::leading(svd::to_f64(traced.block.view()).as_ref(), rank, u64::from(id.0)), traced.block.rows()))
        });
        let (parts, rows): (Vec<_>, Vec<_>) = parts.collect::<Result<Vec<_>>>()?.into_iter().unzip();
        Ok(Self { parts, rows, columns: matrix.shape().columns(), seconds: begun.elapsed().as_secs_f64() })
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
