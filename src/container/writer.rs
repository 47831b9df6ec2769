//! Writing a container.

use std::io::Write;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::codec::CodecSettings;
use super::encoder::{BlockEncoder, EncodedBlock, EncodedSize};
use super::format::{
    BLOCK_RECORD_BYTES, BlockRecord, ContainerHeader, FORMAT_VERSION, HEADER_BYTES, LAYER_RECORD_BYTES, LayerRecord,
    TRAILER_BYTES, Trailer,
};
use super::metadata;
use super::report::ContainerReport;
use super::spill::Spill;
use crate::error::{Error, Result};
use crate::files::{check_output, replace};
use crate::light::{Job, StatedErrors};
use crate::matrix::{BlockId, BlockReport, FactoredBlock};

/// Bytes of [`StatedErrors`] in the file at most, without those of single lights: records of 53 and heads of four sections of 8,
/// which zstd may not make shorter, a length, and zstd's words for a second kind of data.
const ERRORS_BYTES: u64 = 109;
/// Bytes of them for each light.
const LIGHT_ERRORS_BYTES: u64 = 16;

/// Options of writing a container.
#[derive(Clone, Debug, Default)]
pub struct ContainerOptions {
    /// Settings of the codec.
    pub codec: CodecSettings,
    /// What is written into the file about how it was made.
    pub report: ContainerReport,
    /// Replace a file that exists.
    pub overwrite: bool,
    /// What the blocks are made from; the file does not say it. An unfinished file is continued only where this is the same.
    pub origin: [u8; 32],
    /// Allow [`ContainerWriter::finish`] with blocks missing: a container of a block range, to be merged later.
    pub partial: bool,
}

/// Statistics of a written block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WrittenBlock {
    /// Components of all its layers.
    pub rank: usize,
    /// Sparse entries of all its layers.
    pub sparse_entries: usize,
    /// Its error and noise, rounded to f32.
    pub report: BlockReport,
}

/// Result of [`ContainerWriter::finish`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContainerSummary {
    /// Bytes of the file.
    pub file_bytes: u64,
    /// Of these, the bytes of index, metadata, header and trailer.
    pub overhead_bytes: u64,
    /// Bytes from the start of the file to the end of the base layers.
    pub base_bytes: u64,
    /// Blocks in the file.
    pub blocks: u32,
    /// Components over all blocks.
    pub components: u64,
    /// Sparse entries over all blocks.
    pub sparse_entries: u64,
    /// Sum of the blocks' squared errors; NaN where one is unknown.
    pub squared_error: f64,
    /// Sum of the blocks' squared norms; NaN where one is unknown.
    pub squared_norm: f64,
}

/// Writes a container: blocks in any order, from any thread, and the same bytes whatever the order.
///
/// Encoded blocks wait in `PATH.part`. A killed pack that is started again with the same job, options and report
/// continues from there ([`written`](Self::written)); [`finish`](Self::finish) assembles the file under
/// a temporary name, renames it, and removes `PATH.part`.
#[derive(Debug)]
pub struct ContainerWriter {
    path: PathBuf,
    job: Job,
    encoder: BlockEncoder,
    options: ContainerOptions,
    errors: StatedErrors,
    spill: Spill,
}

impl ContainerWriter {
    /// Starts or continues a container at `path`. One of another job, report, codec or origin is not continued.
    ///
    /// # Errors
    /// The file exists and may not be replaced; its folder cannot be written; another process packs into it.
    pub fn create(path: &Path, job: &Job, options: ContainerOptions) -> Result<Self> {
        let mut hash = Sha256::new();
        hash.update(metadata::encode(job, &options.report, &StatedErrors::default()));
        hash.update(format!("{FORMAT_VERSION} {}", options.codec.identity()));
        hash.update(options.origin);
        let (fingerprint, blocks) = (hash.finalize().into(), job.shape.block_count());
        if let Err(error) = check_output(path, options.overwrite) {
            Spill::remove_leftover(path, blocks);
            return Err(error);
        }
        let spill = Spill::open(path, fingerprint, blocks, options.overwrite)?;
        let encoder = BlockEncoder::new(job, options.codec.clone());
        Ok(Self { path: path.to_owned(), job: job.clone(), encoder, options, errors: StatedErrors::default(), spill })
    }

    /// Has the file say what errors there are over the whole picture. Without it the file says nothing of them; those of
    /// denoising are said beside those of lights only, those of exposed images beside those of denoising.
    pub fn state_errors(&mut self, errors: StatedErrors) {
        self.errors = errors;
    }

    /// What is known of a block that is there already, written by this run or by the one that it continues.
    pub fn written(&self, id: BlockId) -> Option<WrittenBlock> {
        self.spill.blocks()[id.index()].as_ref().map(|block| WrittenBlock {
            rank: usize::from(block.record.rank),
            sparse_entries: block.record.sparse_entries as usize,
            report: block.record.report,
        })
    }

    /// Encodes a block without writing it, so that its real error can be measured first.
    ///
    /// # Errors
    /// A block that is not of this job's shape or whose parts do not fit each other.
    pub fn encode(&self, id: BlockId, block: &FactoredBlock) -> Result<EncodedBlock> {
        let scales = self.job.basis.column_scales();
        if scales.is_empty() {
            return self.encoder.encode_divided(id, block);
        }
        let mut divided = block.clone();
        divided.scale_columns(&scales.iter().map(|scale| scale.recip()).collect::<Vec<_>>());
        self.encoder.encode_divided(id, &divided)
    }

    /// What the file says about how it was made.
    pub fn report(&self) -> &ContainerReport {
        &self.options.report
    }

    /// What encodes its blocks.
    pub fn encoder(&self) -> &BlockEncoder {
        &self.encoder
    }

    /// Takes scales of columns that were not known when the writer was made, before any block is encoded.
    ///
    /// # Errors
    /// They are not those of the job's columns.
    pub fn set_column_scales(&mut self, scales: &[f32]) -> Result<()> {
        self.job.basis.set_column_scales(scales.to_vec())
    }

    /// Writes an encoded block. A block may be written again; the last one counts.
    ///
    /// # Errors
    /// A block that is larger than the format can say; the system refuses to write.
    pub fn write_encoded(&self, id: BlockId, block: &EncodedBlock, report: &BlockReport) -> Result<EncodedSize> {
        let written = WrittenBlock { rank: block.rank, sparse_entries: block.sparse_entries, report: *report };
        let record = record_of(id, &written, block.layers.len())?;
        self.spill.append(id, record, &block.layers)?;
        Ok(block.size())
    }

    /// Encodes and writes a block; encoding runs in the calling thread, outside any lock.
    ///
    /// # Errors
    /// A value that is not finite; as [`write_encoded`](Self::write_encoded).
    pub fn write_block(&self, id: BlockId, block: &FactoredBlock, report: &BlockReport) -> Result<EncodedSize> {
        self.write_encoded(id, &self.encode(id, block)?, report)
    }

    /// Assembles the file and gives it its final name.
    ///
    /// # Errors
    /// Blocks are missing (unless the options allow it); the system refuses to write.
    ///
    /// # Panics
    /// Never: only blocks that were written are asked for.
    pub fn finish(self) -> Result<ContainerSummary> {
        let blocks = self.spill.blocks().clone();
        let missing = blocks.iter().filter(|block| block.is_none()).count();
        if missing > 0 && !self.options.partial {
            let problem = format!("{missing} of {} blocks were not written", blocks.len());
            return Err(Error::input(self.path.display().to_string(), problem, "pack the other blocks first"));
        }
        let source = |id: BlockId, layer: usize| {
            let block = blocks[id.index()].as_ref().expect("only present blocks are asked for");
            self.spill.read(id, block, layer)
        };
        let records: Vec<BlockRecord> =
            blocks.iter().map(|b| b.as_ref().map_or(BlockRecord::default(), |b| b.record)).collect();
        let about = About { job: &self.job, report: &self.options.report, errors: &self.errors };
        let summary = assemble(&self.path, self.options.overwrite, about, records, source)?;
        self.spill.remove()?;
        Ok(summary)
    }
}

/// The record of a block of so many layers.
///
/// # Errors
/// It is larger than the format can say.
fn record_of(id: BlockId, written: &WrittenBlock, layers: usize) -> Result<BlockRecord> {
    let WrittenBlock { rank, sparse_entries, report } = *written;
    let too_large = || {
        let problem = format!("rank {rank} with {sparse_entries} sparse entries does not fit a record");
        Error::input(id.to_string(), problem, "compress it to a lower rank, or take smaller blocks")
    };
    Ok(BlockRecord {
        first_layer: 0,
        layers: layers as u8,
        present: true,
        rank: rank.try_into().map_err(|_| too_large())?,
        sparse_entries: sparse_entries.try_into().map_err(|_| too_large())?,
        report,
    })
}

/// Bytes at most of a file of a job with such a report beside its chunks, if all blocks together have so many layers.
pub fn overhead_bytes(job: &Job, report: &ContainerReport, layers: u64) -> u64 {
    let lights = job.basis.lights().len() as u64;
    let metadata = metadata::encode(job, report, &StatedErrors::default()).len() as u64;
    let errors = ERRORS_BYTES + LIGHT_ERRORS_BYTES * lights;
    let blocks = u64::from(job.shape.block_count());
    let records = blocks * BLOCK_RECORD_BYTES as u64 + layers * LAYER_RECORD_BYTES as u64;
    (HEADER_BYTES + TRAILER_BYTES) as u64 + metadata + errors + records
}

/// Writes a container of blocks that were encoded elsewhere: for each of the job's blocks, in order, what is known of it and the number
/// of its layers. `chunk` gives the bytes of a layer. The file is that of a [`ContainerWriter`] of the same blocks.
///
/// # Errors
/// A block that is larger than the format can say; the file exists and may not be replaced; those of `chunk`; the system refuses.
pub fn write_encoded_blocks(
    path: &Path,
    job: &Job,
    options: &ContainerOptions,
    errors: &StatedErrors,
    blocks: &[(WrittenBlock, usize)],
    chunk: impl Fn(BlockId, usize) -> Result<Vec<u8>>,
) -> Result<ContainerSummary> {
    let records = blocks.iter().zip(job.shape.blocks()).map(|((written, layers), id)| record_of(id, written, *layers));
    let about = About { job, report: &options.report, errors };
    assemble(path, options.overwrite, about, records.collect::<Result<_>>()?, chunk)
}

/// What a container says beside its blocks.
#[derive(Clone, Copy)]
pub(super) struct About<'a> {
    pub(super) job: &'a Job,
    pub(super) report: &'a ContainerReport,
    pub(super) errors: &'a StatedErrors,
}

/// Writes a whole container under a temporary name and renames it: header, base layers of all blocks, their second
/// layers, and so on, metadata, index, trailer. `chunk` gives the bytes of a layer.
pub(super) fn assemble(
    path: &Path,
    overwrite: bool,
    about: About<'_>,
    mut records: Vec<BlockRecord>,
    chunk: impl Fn(BlockId, usize) -> Result<Vec<u8>>,
) -> Result<ContainerSummary> {
    let mut layer_count = 0;
    for record in &mut records {
        record.first_layer = layer_count;
        layer_count += u32::from(record.layers);
    }
    let mut layers = vec![LayerRecord::default(); layer_count as usize];
    let mut summary = ContainerSummary::default();
    replace(path, overwrite, |file| {
        let failed = || Error::io(path, "write");
        let block_count = records.len() as u32;
        let header = ContainerHeader { version: FORMAT_VERSION, block_count, job_hash: about.job.hash().0 }.encode();
        file.write_all(&header).map_err(failed())?;
        let mut offset = HEADER_BYTES as u64;
        for layer in 0..records.iter().map(|r| usize::from(r.layers)).max().unwrap_or(0) {
            for (index, record) in records.iter().enumerate().filter(|(_, r)| layer < usize::from(r.layers)) {
                let bytes = chunk(BlockId(index as u32), layer)?;
                file.write_all(&bytes).map_err(failed())?;
                layers[record.first_layer as usize + layer] =
                    LayerRecord { offset, bytes: bytes.len() as u32, crc: crc32fast::hash(&bytes) };
                offset += bytes.len() as u64;
            }
            if layer == 0 {
                summary.base_bytes = offset;
            }
        }
        let mut tail = metadata::encode(about.job, about.report, about.errors);
        let mut trailer = Trailer {
            version: FORMAT_VERSION,
            metadata_offset: offset,
            metadata_bytes: tail.len() as u32,
            block_count,
            layer_count,
            tail_crc: 0,
            header_crc: u32::from_le_bytes(header[60..].try_into().expect("4 bytes")),
            file_bytes: 0,
        };
        records.iter().for_each(|record| tail.extend(record.encode()));
        layers.iter().for_each(|layer| tail.extend(layer.encode()));
        trailer.tail_crc = crc32fast::hash(&tail);
        trailer.file_bytes = offset + trailer.tail_bytes();
        tail.extend(trailer.encode());
        summary.file_bytes = trailer.file_bytes;
        summary.overhead_bytes = HEADER_BYTES as u64 + tail.len() as u64;
        file.write_all(&tail).map_err(failed())
    })?;
    for record in records.iter().filter(|record| record.present) {
        summary.blocks += 1;
        summary.components += u64::from(record.rank);
        summary.sparse_entries += u64::from(record.sparse_entries);
        summary.squared_error += record.report.squared_error;
        summary.squared_norm += record.report.squared_norm;
    }
    Ok(summary)
}
