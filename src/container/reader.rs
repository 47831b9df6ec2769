//! Reading a container.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::codec::{claims, stored_band_steps};
use super::format::{BlockRecord, ContainerHeader, HEADER_BYTES, HEADER_MAGIC, TRAILER_BYTES, Trailer};
use super::index::{Index, PIECE_BYTES};
use super::layers::{join_coded, join_layers};
use super::layout::{BlockLayout, LightLayout};
use super::metadata::{self, Metadata};
use super::report::ContainerReport;
use super::spill::Spill;
use crate::error::{Error, Hint, Result};
use crate::files::{Ranged, open_input};
use crate::light::{Job, StatedErrors};
use crate::matrix::{BlockId, BlockReport, CodedBlock, ColumnTransform, FactorSource, FactoredBlock, MatrixShape};
use crate::resources::MemoryNeed;

/// The first read takes this share of the file, within the two bounds. That covers the index of any container whose
/// blocks have 4 KiB and more in two layers; otherwise a second read follows.
const TAIL_SHARE: u64 = 64;
const TAIL_MIN: u64 = 1 << 16;
const TAIL_MAX: u64 = 1 << 26;

/// An index of more bytes than this must have been stored: of each byte on the disk, file systems that compress make no more
/// than so many. A file may claim any length without holding it.
const FREE_TAIL_BYTES: u64 = 64 << 20;
const EARNED_PER_STORED_BYTE: u64 = 64;

/// Memory of right sides for each byte that they have in the file, at most. A coefficient that is not 0 takes 2 bytes as an entry, and in
/// the file no less than 2.38 bits: its sign, and what the likeliest of the code's distributions has for ±1. Among zeros that are
/// kept with it it takes up to 3, and no less than 3.7 bits. A larger one takes as many bits more as it takes memory.
const RIGHT_BYTES_PER_STORED_BYTE: u64 = 7;

const CUT_SHORT: &str = "make it again, or fetch it again if it was copied";

/// An open container. Reading is thread-safe and holds no lock.
#[derive(Debug)]
pub struct ContainerReader {
    path: PathBuf,
    file: Box<dyn Ranged>,
    job: Job,
    report: ContainerReport,
    errors: StatedErrors,
    lights: LightLayout,
    index: Index,
    header_crc: u32,
    file_bytes: u64,
    transform: OnceLock<ReaderTransform>,
}

/// The transform of right sides, and how much finer each band of them is than its component's step: the units of their
/// coefficients. Those of a block that has others are coded anew.
#[derive(Debug)]
struct ReaderTransform {
    transform: Arc<ColumnTransform>,
    band_steps: Vec<i8>,
}

impl ContainerReader {
    /// Opens a container: one read at its end, checked by its checksums.
    ///
    /// # Errors
    /// The file is missing, is no container, is of another version, is cut short or damaged in its index.
    pub fn open(path: &Path) -> Result<Self> {
        Self::open_ranged(path, Box::new(open_input(path, "open")?))
    }

    /// Opens a container that lies anywhere; `path` is what messages call it.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_ranged(path: &Path, file: Box<dyn Ranged>) -> Result<Self> {
        let file_bytes = file.bytes().map_err(Error::io(path, "read"))?;
        let read = |offset: u64, bytes: usize| {
            let mut buffer = vec![0; bytes];
            let failed = || Error::io(path, format!("read {bytes} bytes at {offset}"));
            if bytes <= PIECE_BYTES {
                file.fill(&mut buffer, offset).map_err(failed())?;
            } else {
                // Most of the time goes into giving the memory out, which two threads do twice as fast.
                let places = (offset..).step_by(PIECE_BYTES);
                let pieces: Vec<_> = buffer.chunks_mut(PIECE_BYTES).zip(places).collect();
                pieces.into_par_iter().try_for_each(|(piece, at)| file.fill(piece, at)).map_err(failed())?;
            }
            Ok(buffer)
        };
        if file_bytes < (HEADER_BYTES + TRAILER_BYTES) as u64 {
            let start = read(0, (file_bytes as usize).min(HEADER_MAGIC.len()))?;
            return Err(if start.len() == HEADER_MAGIC.len() && start == HEADER_MAGIC {
                Error::damaged(path, "is cut short", CUT_SHORT)
            } else {
                not_ours(path)
            });
        }
        let first = (file_bytes / TAIL_SHARE).clamp(TAIL_MIN, TAIL_MAX).min(file_bytes);
        let mut end = read(file_bytes - first, first as usize)?;
        let trailer = match Trailer::decode(&end[end.len() - TRAILER_BYTES..], file_bytes) {
            Ok(trailer) => trailer,
            Err(problem) => {
                return Err(match ContainerHeader::decode(&read(0, HEADER_BYTES)?) {
                    Ok(_) => Error::damaged(path, format!("{problem}: it is cut short or damaged"), CUT_SHORT),
                    Err(_) if read(0, 8)? != HEADER_MAGIC => not_ours(path),
                    Err(problem) => Error::damaged(path, problem, CUT_SHORT),
                });
            }
        };
        let tail_bytes = trailer.tail_bytes();
        if tail_bytes > end.len() as u64 {
            if tail_bytes > FREE_TAIL_BYTES
                && tail_bytes / EARNED_PER_STORED_BYTE
                    > file.stored_bytes().map_err(Error::io(path, "ask for the size"))?
            {
                let problem =
                    format!("it claims an index of {tail_bytes} bytes, but the disk holds hardly any of them");
                return Err(Error::damaged(path, problem, CUT_SHORT));
            }
            end = read(trailer.metadata_offset, tail_bytes as usize)?;
        }
        let (index, (job, report, errors)) =
            decode_tail(end, &trailer).map_err(|problem| Error::damaged(path, problem, CUT_SHORT))?;
        Ok(Self {
            path: path.to_owned(),
            file,
            lights: LightLayout::of(&job.basis),
            job,
            report,
            errors,
            index,
            header_crc: trailer.header_crc,
            file_bytes,
            transform: OnceLock::new(),
        })
    }

    /// The job of the matrix.
    pub fn job(&self) -> &Job {
        &self.job
    }

    /// How the container was made.
    pub fn report(&self) -> &ContainerReport {
        &self.report
    }

    /// Errors over the whole picture, as far as they were measured, and for all blocks.
    pub fn errors(&self) -> &StatedErrors {
        &self.errors
    }

    /// Error and noise of a block, as measured when it was packed.
    pub fn block_report(&self, id: BlockId) -> BlockReport {
        self.record(id).report
    }

    /// Components of a block, over all layers.
    pub fn rank(&self, id: BlockId) -> usize {
        usize::from(self.record(id).rank)
    }

    /// Sparse entries of a block, over all layers.
    pub fn sparse_entries(&self, id: BlockId) -> usize {
        self.record(id).sparse_entries as usize
    }

    /// Whether the container holds the block; one of a block range does not hold all.
    pub fn has_block(&self, id: BlockId) -> bool {
        self.record(id).present
    }

    /// Bytes of the whole file.
    pub fn file_bytes(&self) -> u64 {
        self.file_bytes
    }

    /// Bytes from the start of the file to the end of the base layers of all blocks.
    pub fn base_bytes(&self) -> u64 {
        self.index.base_end()
    }

    /// Memory of all factors as they are held for relighting, at most: 16 bits a value of left sides, and of right ones
    /// seven times the bytes that the file has of them, beside a table.
    pub fn factors_bytes(&self) -> u64 {
        let shape = self.job.shape;
        let tiles = ColumnTransform::new(self.column_planes(), &[]).tiles().len();
        let block = |id| {
            let rank = self.rank(id);
            let stored = self.encoded_bytes(id, 0..self.layer_count(id));
            // The rows of two layers, and as many again for numbers that do not fit into one.
            let rows = 4 * rank * (4 * tiles + 16);
            let left = 2 * rank * shape.rect(id).rows();
            (left + rows + rank * 8 + self.sparse_entries(id) * 16 + 512) as u64 + RIGHT_BYTES_PER_STORED_BYTE * stored
        };
        shape.blocks().map(block).sum()
    }

    /// The planes that right sides are transformed in: across, down, and whether they are images.
    fn column_planes(&self) -> impl Iterator<Item = (usize, usize, bool)> {
        self.lights.planes().iter().map(|plane| (plane.across, plane.down, plane.is_image))
    }

    /// The whole of a block: all its layers.
    ///
    /// # Errors
    /// As [`read_layers`](FactorSource::read_layers).
    pub fn read_block(&self, id: BlockId) -> Result<FactoredBlock> {
        self.read_layers(id, 0..self.layer_count(id))
    }

    /// The bytes of one layer, checked against their checksum.
    pub(super) fn read_chunk(&self, id: BlockId, layer: usize) -> Result<Vec<u8>> {
        let record = self.index.layer(self.record(id).first_layer as usize + layer);
        let mut bytes = vec![0; record.bytes as usize];
        self.file
            .fill(&mut bytes, record.offset)
            .map_err(Error::io(&self.path, format!("read {id}, layer {layer}")))?;
        if crc32fast::hash(&bytes) != record.crc {
            return Err(self.bad_block(id, layer, "the checksum does not fit"));
        }
        Ok(bytes)
    }

    pub(super) fn record(&self, id: BlockId) -> BlockRecord {
        self.index.block(id.index())
    }

    /// What tells a block's stored bytes from any others: its record, and size and checksum of each layer.
    pub(super) fn stored_form(&self, id: BlockId) -> (Vec<u8>, Vec<(u32, u32)>) {
        let record = self.record(id);
        let layers = (0..usize::from(record.layers)).map(|layer| self.index.layer(record.first_layer as usize + layer));
        let layers = layers.map(|layer| (layer.bytes, layer.crc)).collect();
        (BlockRecord { first_layer: 0, ..record }.encode().to_vec(), layers)
    }

    /// What tells this container from any other of its job: a hash of what its index says of every chunk.
    pub fn fingerprint(&self) -> [u8; 32] {
        let mut hash = Sha256::new();
        hash.update(self.job.hash().0);
        self.index.record_bytes().iter().for_each(|bytes| hash.update(bytes));
        hash.finalize().into()
    }

    /// Removes what the pack that made this container left beside it, if it was killed after its last step.
    pub(crate) fn remove_leftover(&self) {
        Spill::remove_leftover(&self.path, self.job.shape.block_count());
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    fn bad_block(&self, id: BlockId, layer: usize, problem: &str) -> Error {
        let problem = format!("{}, layer {layer}: {problem}", self.place(id));
        Error::damaged(&self.path, problem, "the other blocks can still be read; make the container again")
    }

    /// A block, for people.
    fn place(&self, id: BlockId) -> String {
        let rect = self.job.shape.rect(id);
        format!("{id} (pixels from {}, {})", rect.x, rect.y)
    }

    /// Reads and decodes every byte, on the threads of the current pool. `goes_on` hears of each block how many bytes it
    /// has, and whether to go on is its answer.
    pub fn verify(&self, goes_on: impl Fn(u64) -> bool + Sync) -> Verification {
        let stopped = AtomicBool::new(false);
        let looked_at = |id: &BlockId| {
            if stopped.load(Ordering::Relaxed) {
                return None;
            }
            let layers = self.layer_count(*id);
            if !goes_on(self.encoded_bytes(*id, 0..layers)) {
                stopped.store(true, Ordering::Relaxed);
            }
            Some((layers, self.check_block(*id).err().map(|problem| BlockFault { block: Some(*id), problem })))
        };
        let blocks: Vec<_> = self.shape().blocks().filter(|&id| self.has_block(id)).collect();
        let looks: Vec<_> = blocks.par_iter().filter_map(looked_at).collect();
        let header = self.check_header().err().map(|problem| BlockFault { block: None, problem });
        Verification {
            blocks: looks.len() as u32,
            chunks: looks.iter().map(|(layers, _)| u64::from(*layers)).sum(),
            faults: header.into_iter().chain(looks.into_iter().filter_map(|(_, fault)| fault)).collect(),
        }
    }

    /// Reads and decodes a block and holds it to its record.
    fn check_block(&self, id: BlockId) -> Result<(), String> {
        let record = self.record(id);
        let block = self.read_block(id).map_err(|error| match error {
            Error::Damaged { problem, .. } => problem,
            other => other.to_string(),
        })?;
        let found = (block.rank(), block.sparse.len());
        match found == (usize::from(record.rank), record.sparse_entries as usize) {
            true => Ok(()),
            false => Err(format!("{}: its rank or number of sparse entries is not the index's", self.place(id))),
        }
    }

    /// Holds what the chunks of layers from `first` on claim to the index, by which memory is reckoned, before they are
    /// decoded.
    fn hold_to_index(&self, id: BlockId, first: u32, chunks: &[Vec<u8>]) -> Result<(), String> {
        let record = self.record(id);
        let (mut rank, mut sparse_entries) = (0, 0);
        for chunk in chunks {
            let claims = claims(chunk)?;
            rank = (rank + claims.components).max(claims.rank);
            sparse_entries += claims.sparse_entries;
        }
        let whole = first == 0 && chunks.len() == usize::from(record.layers);
        let known = (usize::from(record.rank), record.sparse_entries as usize);
        let fits = if whole { (rank, sparse_entries) == known } else { rank <= known.0 && sparse_entries <= known.1 };
        let (rank_there, entries_there) = known;
        if fits {
            return Ok(());
        }
        Err(format!(
            "it claims rank {rank} and {sparse_entries} sparse entries, the index rank {rank_there} and {entries_there}"
        ))
    }

    /// Reads and checks the header against the trailer.
    fn check_header(&self) -> Result<(), String> {
        let mut bytes = [0; HEADER_BYTES];
        self.file.fill(&mut bytes, 0).map_err(|e| e.to_string())?;
        let header = ContainerHeader::decode(&bytes)?;
        let fits = header.block_count == self.job.shape.block_count()
            && header.job_hash == self.job.hash().0
            && bytes[60..] == self.header_crc.to_le_bytes();
        if fits { Ok(()) } else { Err("header and index are not of the same container".into()) }
    }
}

impl MemoryNeed for ContainerReader {
    fn fixed_bytes(&self) -> u64 {
        self.index.bytes() + self.file.held_bytes()
    }

    /// The largest block while it is decoded: two copies in f32, and one in compact form.
    fn thread_bytes(&self) -> u64 {
        let shape = self.job.shape;
        let block = |id| {
            let values = self.rank(id) * (shape.rect(id).rows() + shape.columns());
            (values * 12 + self.sparse_entries(id) * 40) as u64 + self.encoded_bytes(id, 0..self.layer_count(id))
        };
        shape.blocks().map(block).max().unwrap_or(0)
    }
}

impl FactorSource for ContainerReader {
    fn shape(&self) -> MatrixShape {
        self.job.shape
    }

    fn layer_count(&self, id: BlockId) -> u32 {
        u32::from(self.record(id).layers)
    }

    fn encoded_bytes(&self, id: BlockId, layers: Range<u32>) -> u64 {
        let first = self.record(id).first_layer;
        layers.map(|layer| u64::from(self.index.layer((first + layer) as usize).bytes)).sum()
    }

    fn column_scales(&self) -> &[f32] {
        self.job.basis.column_scales()
    }

    fn read_layers(&self, id: BlockId, layers: Range<u32>) -> Result<FactoredBlock> {
        let divided = self.read_divided(id, layers.clone())?;
        usable(self.times_scales(divided)).map_err(|problem| self.bad_block(id, layers.start as usize, &problem))
    }

    fn stored_layer(&self, id: BlockId, layer: u32) -> Result<Vec<u8>> {
        self.read_chunk(id, layer as usize)
    }

    fn decode_layers(&self, id: BlockId, stored: &[Vec<u8>]) -> Result<FactoredBlock> {
        if !self.has_block(id) {
            return self.read_layers(id, 0..0);
        }
        let layout = BlockLayout::new(self.job.shape.rect(id), self.lights.clone());
        self.hold_to_index(id, 0, stored)
            .and_then(|()| join_layers(&layout, stored.iter().map(|chunk| Ok(chunk.as_slice())), None))
            .and_then(|divided| usable(self.times_scales(divided)))
            .map_err(|problem| self.bad_block(id, stored.len().saturating_sub(1), &problem))
    }

    fn column_transform(&self) -> Arc<ColumnTransform> {
        Arc::clone(&self.transform().transform)
    }

    fn read_coded(&self, id: BlockId, layers: u32) -> Result<CodedBlock> {
        let stored = (0..layers).map(|layer| self.read_chunk(id, layer as usize)).collect::<Result<Vec<_>>>()?;
        self.decode_coded(id, &stored)
    }

    fn decode_coded(&self, id: BlockId, stored: &[Vec<u8>]) -> Result<CodedBlock> {
        self.check_has(id)?;
        let layout = BlockLayout::new(self.job.shape.rect(id), self.lights.clone());
        self.hold_to_index(id, 0, stored)
            .and_then(|()| join_coded(&layout, stored))
            .and_then(|coded| match coded.filter(|coded| self.has_units(coded)) {
                Some(coded) => Ok(coded),
                None => {
                    let chunks = stored.iter().map(|chunk| Ok::<_, String>(chunk.as_slice()));
                    let values = join_layers(&layout, chunks, None)?;
                    Ok(CodedBlock::of(values, &[], &self.transform().transform))
                }
            })
            .and_then(usable_coded)
            .map_err(|problem| self.bad_block(id, stored.len().saturating_sub(1), &problem))
    }
}

impl ContainerReader {
    /// The factors as they are stored, of columns divided by their scales.
    fn read_divided(&self, id: BlockId, layers: Range<u32>) -> Result<FactoredBlock> {
        self.check_has(id)?;
        let layout = BlockLayout::new(self.job.shape.rect(id), self.lights.clone());
        // Later layers lean on the base layer.
        let base = if layers.start > 0 { Some(self.read_divided(id, 0..1)?) } else { None };
        let chunks = (layers.start..layers.end).map(|layer| self.read_chunk(id, layer as usize));
        let chunks = chunks.collect::<Result<Vec<_>>>()?;
        self.hold_to_index(id, layers.start, &chunks)
            .and_then(|()| join_layers(&layout, chunks.iter().map(|chunk| Ok(chunk.as_slice())), base.as_ref()))
            .map_err(|problem| self.bad_block(id, layers.start as usize, &problem))
    }

    fn check_has(&self, id: BlockId) -> Result<()> {
        if self.has_block(id) {
            return Ok(());
        }
        let problem = format!("holds a range of blocks only, without {id}");
        Err(Error::input(self.path.display().to_string(), problem, "merge it with the others first"))
    }

    /// The transform with the units of the first block that can be read: those of one job have the same.
    fn transform(&self) -> &ReaderTransform {
        self.transform.get_or_init(|| {
            let has_factors = |id: &BlockId| self.layer_count(*id) > 0 && self.rank(*id) > 0;
            let band_steps = self.job.shape.blocks().filter(has_factors).find_map(|id| {
                let layout = BlockLayout::new(self.job.shape.rect(id), self.lights.clone());
                stored_band_steps(&layout, &self.read_chunk(id, 0).ok()?)
            });
            let band_steps = band_steps.unwrap_or_default();
            let transform = ColumnTransform::new(self.column_planes(), &band_steps);
            ReaderTransform { transform: Arc::new(transform), band_steps }
        })
    }

    /// Whether a block's rows are in the units of the transform.
    fn has_units(&self, coded: &CodedBlock) -> bool {
        let (block, units) = (&*coded.factors.right_band_steps, &*self.transform().band_steps);
        let is_even = |steps: &[i8]| steps.iter().all(|&finer| finer == 0);
        coded.right.is_empty() || block == units || is_even(block) && is_even(units)
    }

    fn times_scales(&self, mut divided: FactoredBlock) -> FactoredBlock {
        divided.scale_columns(self.job.basis.column_scales());
        divided
    }
}

/// A decoded block, if its parts can be used together.
fn usable(block: FactoredBlock) -> Result<FactoredBlock, String> {
    let is_consistent = block.is_consistent();
    check_usable(is_consistent, &block, &block.right).map(|()| block)
}

/// As [`usable`].
fn usable_coded(block: CodedBlock) -> Result<CodedBlock, String> {
    let steps: Vec<f32> = block.right.iter().map(|row| row.step).collect();
    check_usable(block.is_consistent(block.factors.columns), &block.factors, &steps).map(|()| block)
}

fn check_usable(is_consistent: bool, block: &FactoredBlock, right: &[f32]) -> Result<(), String> {
    let is_finite = |values: &[f32]| values.iter().all(|v| v.is_finite());
    if !is_consistent {
        Err("its sparse entries overlap".into())
    } else if !is_finite(&block.left) || !is_finite(right) || !block.sparse.iter().all(|e| e.value.is_finite()) {
        Err("it holds values that are not finite".into())
    } else {
        Ok(())
    }
}

/// What the end of a file says.
fn decode_tail(end: Vec<u8>, trailer: &Trailer) -> Result<(Index, Metadata), String> {
    let (index, metadata) = Index::of(end, trailer)?;
    let metadata = metadata::decode(trailer.version, &metadata)?;
    let blocks = metadata.0.shape.block_count();
    if trailer.block_count != blocks {
        return Err(format!("the index has {} blocks, the job {blocks}", trailer.block_count));
    }
    Ok((index, metadata))
}

fn not_ours(path: &Path) -> Error {
    Error::input(path.display().to_string(), "is not a container (.ltc)", Hint::PackFirst)
}

/// A block that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockFault {
    /// The block; `None` for the header.
    pub block: Option<BlockId>,
    /// What does not hold, naming the block or the header.
    pub problem: String,
}

/// Result of [`ContainerReader::verify`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Verification {
    /// Blocks looked at.
    pub blocks: u32,
    /// Chunks looked at.
    pub chunks: u64,
    /// The faults found; empty for a sound file.
    pub faults: Vec<BlockFault>,
}

/// Opens a container, then reads and decodes every byte of it.
///
/// # Errors
/// It cannot even be opened; bad blocks are listed, not errors.
pub fn verify(path: &Path) -> Result<Verification> {
    Ok(ContainerReader::open(path)?.verify(|_| true))
}
