//! Reading: the committed blocks of a file, finished or still growing.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use sha2::{Digest, Sha256};

use crate::error::{Error, Hint, Result};
use crate::files::open_input;
use crate::light::{DescribedSource, Job};
use crate::matrix::{
    Block, BlockId, BlockNoise, BlockPlanes, BlockSource, BlockView, ColumnIndex, LentBlock, MatrixShape, TracedBlock,
};
use crate::resources::MemoryNeed;

use super::header::StoreHeader;
use super::layout::READING_BYTES;
use super::planes::decode_planes;
use super::record::{TileRecord, UnverifiedRecord};
use super::space::crowds_out;
use super::storage::{FileStorage, Storage, read_exact};
use super::tile::SideData;
use super::{Access, MappedStorage};
use super::{NOISE_NONE, NOISE_ZERO, Precision, RECORD_BYTES, StoreLayout, StoreOptions, partial_path};

/// Reads a `.ltm`. Everything that it returns has passed its checksum.
pub struct StoreReader<S: Storage = MappedStorage> {
    storage: S,
    path: PathBuf,
    header: StoreHeader,
    /// Whether pages that were read leave the page cache.
    releases: bool,
    /// By block, whether all its columns have passed their checksums where they lie: once for each opening.
    checked: Vec<AtomicBool>,
}

/// Counts from a file's commit records.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StoreCounts {
    /// Blocks with a sound record.
    pub committed: u32,
    /// Blocks whose record is damaged.
    pub damaged: u32,
    /// Bytes of the committed tiles: what the matrix takes without its zero columns and blocks.
    pub stored_bytes: u64,
}

const REPAIR: &str = "repair it, or render it again";

impl StoreReader<MappedStorage> {
    /// Opens a finished file, or one that is still growing under its partial name, to read whole blocks.
    ///
    /// # Errors
    /// Not there, not ours, of a newer version, or damaged before the first block. A file that is cut short further on
    /// opens, and the blocks that are whole can be read.
    pub fn open(path: &Path) -> Result<Self> {
        Self::open_for(path, Access::Blocks)
    }

    /// As [`open`](Self::open), for what will be read of it.
    ///
    /// # Errors
    /// Those of [`open`](Self::open).
    pub fn open_for(path: &Path, access: Access) -> Result<Self> {
        let file = open_file(path)?;
        // Where a writer is at work, the file changes all the time.
        let storage = match path.extension() {
            Some(extension) if extension == "part" => Ok(MappedStorage::without_map(file)),
            _ => MappedStorage::new(file, access),
        };
        Self::over(storage.map_err(Error::io(path, "ask for the length"))?, path)
    }
}

impl StoreReader<FileStorage> {
    /// As [`open`](StoreReader::open), but without a memory map: for files that others are writing, and to compare.
    ///
    /// # Errors
    /// Those of [`open`](StoreReader::open).
    pub fn open_positioned(path: &Path) -> Result<Self> {
        Self::over(FileStorage::new(open_file(path)?), path)
    }
}

fn open_file(path: &Path) -> Result<File> {
    if !path.exists() && partial_path(path).exists() {
        let hint = Hint::Unfinished { partial: partial_path(path) };
        return Err(Error::input(path.display().to_string(), "is not finished", hint));
    }
    open_input(path, "open")
}

impl<S: Storage> StoreReader<S> {
    /// Reads from any storage; `path` is for messages.
    ///
    /// # Errors
    /// The storage cannot be read, holds no stored matrix, or a damaged header.
    pub fn over(storage: S, path: &Path) -> Result<Self> {
        let header = StoreHeader::read(&storage, path)?;
        let (length, needed) =
            (storage.length().map_err(Error::io(path, "ask for the length"))?, header.layout.slots_offset());
        if length < needed {
            let problem = format!("the file is cut short before its blocks: {length} bytes of at least {needed}");
            return Err(Error::damaged(path, problem, "render it again, or take it from a copy"));
        }
        let releases = crowds_out(header.layout.file_bytes());
        let checked = header.layout.shape.blocks().map(|_| AtomicBool::new(false)).collect();
        Ok(Self { storage, path: path.to_owned(), header, releases, checked })
    }

    /// The job of the matrix.
    pub fn job(&self) -> &Job {
        &self.header.job
    }

    /// Distinguishes this matrix from any other of its job: a hash of its precision and of the record of each block,
    /// which has the checksums of the stored data.
    ///
    /// # Errors
    /// The system refuses to read.
    pub fn fingerprint(&self) -> Result<[u8; 32]> {
        let mut hash = Sha256::new();
        hash.update(self.job().hash().0);
        hash.update(self.precision().to_string());
        let mut record = [0; RECORD_BYTES as usize];
        for id in self.shape().blocks() {
            self.read(id, "commit record", self.header.layout.record_offset(id), &mut record)?;
            hash.update(record);
        }
        Ok(hash.finalize().into())
    }

    /// How entries are stored.
    pub fn precision(&self) -> Precision {
        self.header.layout.precision
    }

    /// The options with which another file of the same layout is made.
    pub fn options(&self) -> StoreOptions {
        let StoreLayout { precision, max_probes, .. } = self.header.layout;
        StoreOptions { precision, max_probes, planes: self.header.layout.has_planes(), ..StoreOptions::default() }
    }

    /// The layout of the file.
    pub fn layout(&self) -> &StoreLayout {
        &self.header.layout
    }

    pub(super) fn storage(&self) -> &S {
        &self.storage
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Whether a block is committed, now: in a growing file it may be later. A block whose record is damaged counts as
    /// committed; reading it says what is wrong.
    pub fn is_committed(&self, id: BlockId) -> bool {
        !matches!(self.record(id), Ok(None))
    }

    /// Counts the committed blocks and their bytes from their commit records. Damaged records are counted as such and
    /// do not affect the others.
    ///
    /// # Errors
    /// The system refuses to read.
    pub fn tally(&self) -> Result<StoreCounts> {
        let mut tally = StoreCounts::default();
        for id in self.shape().blocks() {
            match self.record(id) {
                Ok(None) => {}
                Ok(Some(record)) => {
                    tally.committed += 1;
                    tally.stored_bytes += record.length;
                }
                Err(Error::Damaged { .. }) => tally.damaged += 1,
                Err(other) => return Err(other),
            }
        }
        Ok(tally)
    }

    /// The believed record of a block.
    pub(super) fn record(&self, id: BlockId) -> Result<Option<TileRecord>> {
        let mut verdict = Ok(None);
        // A record may be caught while a writer puts it there: look again before calling it damaged.
        for _ in 0..3 {
            let mut record = UnverifiedRecord([0; RECORD_BYTES as usize]);
            self.read(id, "commit record", self.header.layout.record_offset(id), &mut record.0)?;
            verdict = record.verify(&self.header.layout, id);
            if verdict.is_ok() {
                break;
            }
        }
        verdict.map_err(|problem| self.damaged(id, problem))
    }

    fn check_id(&self, id: BlockId) -> Result<()> {
        if id.0 >= self.shape().block_count() {
            let problem = format!("has {} blocks, there is no {id}", self.shape().block_count());
            return Err(Error::input(self.path.display().to_string(), problem, ""));
        }
        Ok(())
    }

    /// The record of a block that must be there.
    fn committed_record(&self, id: BlockId) -> Result<TileRecord> {
        self.check_id(id)?;
        self.record(id)?.ok_or_else(|| {
            let problem = format!("{id} is not committed");
            Error::input(self.path.display().to_string(), problem, "make the file again")
        })
    }

    fn damaged(&self, id: BlockId, problem: impl std::fmt::Display) -> Error {
        Error::damaged(&self.path, format!("{id}: {problem}"), REPAIR)
    }

    fn read(&self, id: BlockId, what: &str, offset: u64, bytes: &mut [u8]) -> Result<()> {
        read_exact(&self.storage, offset, bytes).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => self.damaged(id, format!("its {what} is cut off: {error}")),
            _ => Error::io(&self.path, format!("read the {what} of {id}"))(error),
        })
    }

    /// The believed side data of a block that has a tile.
    pub(super) fn side_data(&self, id: BlockId, record: &TileRecord) -> Result<SideData> {
        let layout = &self.header.layout;
        let rows = layout.shape.rect(id).rows();
        let columns = layout.column_bytes(rows as u64, record.stored());
        let planes = record.planes_bytes(layout, rows as u64);
        let mut bytes = vec![0; (record.length - columns - planes) as usize];
        self.read(id, "side data", layout.slot_offset(id) + columns, &mut bytes)?;
        if crc32fast::hash(&bytes) != record.side_checksum {
            return Err(self.damaged(id, "its side data's checksum does not hold"));
        }
        SideData::decode(&bytes, layout, rows, record).map_err(|problem| self.damaged(id, problem))
    }

    /// The checked bytes of a block's planes; `scratch` is reused. None where it stores none.
    fn planes_of<'a>(&self, id: BlockId, record: &TileRecord, scratch: &'a mut Vec<u8>) -> Result<Option<&'a [u8]>> {
        let Some(planes) = record.planes else { return Ok(None) };
        let layout = &self.header.layout;
        let bytes = record.planes_bytes(layout, layout.shape.rect(id).rows() as u64);
        scratch.resize(bytes as usize, 0);
        self.read(id, "planes", layout.slot_offset(id) + record.length - bytes, scratch)?;
        match crc32fast::hash(scratch) == planes.checksum {
            true => Ok(Some(scratch)),
            false => Err(self.damaged(id, "the checksum of its planes does not hold")),
        }
    }

    /// Reads what the samples of a block are into `target`, whose allocations are reused, without its entries. None
    /// where the file does not tell.
    ///
    /// # Errors
    /// The block is missing or damaged, or cannot be read.
    pub fn read_planes(&self, id: BlockId, target: Option<BlockPlanes>) -> Result<Option<BlockPlanes>> {
        self.decode_planes(id, &self.committed_record(id)?, target)
    }

    fn decode_planes(
        &self,
        id: BlockId,
        record: &TileRecord,
        target: Option<BlockPlanes>,
    ) -> Result<Option<BlockPlanes>> {
        if !self.header.planes_known {
            return Ok(None);
        }
        let (mut scratch, mut target) = (Vec::new(), target.unwrap_or_default());
        let (Some(bytes), Some(said)) = (self.planes_of(id, record, &mut scratch)?, record.planes) else {
            return Ok(None);
        };
        let rows = self.shape().rect(id).rows();
        decode_planes(bytes, &self.header.layout, rows, said, &mut target)
            .map_err(|problem| self.damaged(id, problem))?;
        Ok(Some(target))
    }

    /// Reads, checks and decodes stored columns `stored` (counting stored columns and probes only) into `target`.
    fn read_stored(&self, id: BlockId, side: &SideData, stored: Range<usize>, target: &mut [f32]) -> Result<()> {
        let layout = &self.header.layout;
        let rows = layout.shape.rect(id).rows();
        let precision = layout.precision;
        let column_bytes = rows * precision.entry_bytes();
        let at_once = (READING_BYTES / column_bytes).max(1);
        let mut staging = Vec::new();
        let mut first = stored.start;
        for target in target.chunks_mut(at_once * rows) {
            let offset = layout.slot_offset(id) + (first * column_bytes) as u64;
            let bytes: &mut [u8] = if precision == Precision::F32 {
                bytemuck::cast_slice_mut(target)
            } else {
                staging.resize(target.len() * precision.entry_bytes(), 0);
                &mut staging
            };
            self.read(id, "columns", offset, bytes)?;
            for (i, bytes) in bytes.chunks_exact(column_bytes).enumerate() {
                if crc32fast::hash(bytes) != side.checksums[first + i] {
                    return Err(self.damaged(id, self.name_stored(side, first + i)));
                }
            }
            if precision != Precision::F32 {
                for (i, (bytes, column)) in
                    staging.chunks_exact(column_bytes).zip(target.chunks_exact_mut(rows)).enumerate()
                {
                    precision.decode(bytes, side.scales.get(first + i).copied().unwrap_or(1.0), column);
                }
            }
            first += target.len() / rows;
        }
        Ok(())
    }

    /// Reads the noise of a block that has a tile; what `noise` has allocated is used again.
    fn read_noise(
        &self,
        id: BlockId,
        record: &TileRecord,
        side: &SideData,
        noise: &mut Option<BlockNoise>,
    ) -> Result<()> {
        let (rows, columns, stored) = (self.shape().rect(id).rows(), self.shape().columns(), side.columns.len());
        *noise = if record.noise == super::NOISE_STORED {
            let mut found = noise.take().unwrap_or_default();
            found.probes.resize(record.probes as usize * rows, 0.0);
            self.read_stored(id, side, stored..stored + record.probes as usize, &mut found.probes)?;
            found.row_variance.clone_from(&side.row_variance);
            found.column_variance.clone_from(&side.column_variance);
            Some(found)
        } else {
            zero_noise(record, rows, columns)
        };
        Ok(())
    }

    fn name_stored(&self, side: &SideData, stored: usize) -> String {
        match side.columns.get(stored) {
            Some(column) => format!("the checksum of column {column} does not hold"),
            None => format!("the checksum of noise probe {} does not hold", stored - side.columns.len()),
        }
    }

    /// Gives stored columns `stored` (counting as in `read_stored`) to `work`, from where the storage keeps them or read
    /// a few at a time, decoded one by one.
    fn each_stored(
        &self,
        id: BlockId,
        side: &SideData,
        stored: Range<usize>,
        work: &mut dyn FnMut(usize, &[f32]),
    ) -> Result<()> {
        let layout = &self.header.layout;
        let rows = layout.shape.rect(id).rows();
        let column_bytes = rows * layout.precision.entry_bytes();
        let offset = |column: usize| layout.slot_offset(id) + (column * column_bytes) as u64;
        let mut column = vec![0.0; rows];
        let mut give = |bytes: &[u8], first: usize, is_checked: bool| -> Result<()> {
            for (i, bytes) in bytes.chunks_exact(column_bytes).enumerate() {
                let i = first + i;
                if !is_checked && crc32fast::hash(bytes) != side.checksums[i] {
                    return Err(self.damaged(id, self.name_stored(side, i)));
                }
                match bytemuck::try_cast_slice(bytes) {
                    Ok(entries) if layout.precision == Precision::F32 => work(i, entries),
                    _ => {
                        let scale = side.scales.get(i).copied().unwrap_or(1.0);
                        layout.precision.decode(bytes, scale, &mut column);
                        work(i, &column);
                    }
                }
            }
            Ok(())
        };
        let length = (stored.len() * column_bytes) as u64;
        if let Some(bytes) = self.storage.lend(offset(stored.start), length) {
            let given = give(bytes, stored.start, self.is_checked(id));
            self.give_back(id, offset(stored.start), length)?;
            given?;
            if stored == (0..side.columns.len()) {
                self.checked[id.index()].store(true, Ordering::Relaxed);
            }
            return Ok(());
        }
        let at_once = (READING_BYTES / column_bytes).max(1);
        let mut staging = vec![0.0f32; (at_once.min(stored.len()) * column_bytes).div_ceil(size_of::<f32>())];
        for first in stored.clone().step_by(at_once) {
            let count = at_once.min(stored.end - first);
            let bytes = &mut bytemuck::cast_slice_mut(&mut staging)[..count * column_bytes];
            self.read(id, "columns", offset(first), bytes)?;
            give(bytes, first, false)?;
        }
        Ok(())
    }

    fn is_checked(&self, id: BlockId) -> bool {
        self.checked[id.index()].load(Ordering::Relaxed)
    }

    fn give_back(&self, id: BlockId, offset: u64, length: u64) -> Result<()> {
        self.storage.give_back(offset, length).map_err(|problem| self.damaged(id, problem))
    }

    /// The stored columns (counting stored ones only) of a range of columns.
    fn stored_of(side: &SideData, columns: &Range<u32>) -> Range<usize> {
        side.columns.partition_point(|&c| c < columns.start)..side.columns.partition_point(|&c| c < columns.end)
    }

    fn check_columns(&self, columns: &Range<u32>) -> Result<()> {
        if columns.start > columns.end || columns.end as usize > self.shape().columns() {
            let problem = format!("has {} columns, not {} to {}", self.shape().columns(), columns.start, columns.end);
            return Err(Error::input(self.path.display().to_string(), problem, ""));
        }
        Ok(())
    }

    /// Reads a range of columns of a block, without the rest of it and without its noise.
    ///
    /// # Errors
    /// No such block or columns; a block that is not committed, or a column of the range that is damaged.
    pub fn read_columns(&self, id: BlockId, columns: Range<u32>) -> Result<Block> {
        self.check_id(id)?;
        self.check_columns(&columns)?;
        let mut block = Block::zeros(self.shape().rect(id).rows(), columns.len());
        let first = columns.start;
        self.visit_columns(id, columns, &mut TracedBlock::default(), &mut |column, entries| {
            block.column_mut(ColumnIndex(column.0 - first)).copy_from_slice(entries);
        })?;
        Ok(block)
    }

    /// Checks every byte that a committed block stores, without decoding it. `scratch` is reused.
    pub(super) fn check_block(&self, id: BlockId, record: &TileRecord, scratch: &mut Vec<u8>) -> Result<()> {
        if record.length == 0 {
            return Ok(());
        }
        let layout = &self.header.layout;
        self.storage.expect(layout.slot_offset(id), record.length);
        let rows = layout.shape.rect(id).rows();
        if self.planes_of(id, record, scratch)?.is_some() {
            self.decode_planes(id, record, None)?;
        }
        if !record.has_main(layout, rows) {
            return Ok(());
        }
        let side = self.side_data(id, record)?;
        let column_bytes = rows * layout.precision.entry_bytes();
        let at_once = (READING_BYTES / column_bytes).max(1);
        let mut offset = layout.slot_offset(id);
        for (part, checksums) in side.checksums.chunks(at_once).enumerate() {
            scratch.resize(checksums.len() * column_bytes, 0);
            self.read(id, "columns", offset, scratch)?;
            for (i, (bytes, &checksum)) in scratch.chunks_exact(column_bytes).zip(checksums).enumerate() {
                if crc32fast::hash(bytes) != checksum {
                    return Err(self.damaged(id, self.name_stored(&side, part * at_once + i)));
                }
            }
            offset += scratch.len() as u64;
        }
        Ok(())
    }
}

impl<S: Storage> DescribedSource for StoreReader<S> {
    fn job(&self) -> &Job {
        Self::job(self)
    }
}

impl<S: Storage> MemoryNeed for StoreReader<S> {
    /// What reading a block takes beside it.
    fn thread_bytes(&self) -> u64 {
        super::requirements(self.job(), &self.options()).memory_bytes
    }
}

impl<S: Storage> BlockSource for StoreReader<S> {
    fn shape(&self) -> MatrixShape {
        self.header.layout.shape
    }

    fn variant(&self) -> Result<Vec<u8>> {
        Ok(self.fingerprint()?.to_vec())
    }

    fn visit_block(
        &self,
        id: BlockId,
        scratch: &mut TracedBlock,
        work: &mut dyn FnMut(LentBlock<'_>) -> Result<()>,
    ) -> Result<()> {
        let record = self.committed_record(id)?;
        let (rows, columns) = (self.shape().rect(id).rows(), self.shape().columns());
        let (offset, length) = (self.header.layout.slot_offset(id), (rows * columns * size_of::<f32>()) as u64);
        let is_whole = self.precision() == Precision::F32 && record.stored_columns as usize == columns;
        let lent = if is_whole { self.storage.lend(offset, length) } else { None };
        let Some(entries) = lent.and_then(|bytes| bytemuck::try_cast_slice::<u8, f32>(bytes).ok()) else {
            self.read_block(id, scratch)?;
            return work(LentBlock::Scratch(scratch));
        };
        self.storage.expect(offset, record.length);
        let side = self.side_data(id, &record)?;
        let mut borrow = || {
            if !self.is_checked(id) {
                for (i, column) in entries.chunks_exact(rows).enumerate() {
                    if crc32fast::hash(bytemuck::cast_slice(column)) != side.checksums[i] {
                        return Err(self.damaged(id, self.name_stored(&side, i)));
                    }
                }
                self.checked[id.index()].store(true, Ordering::Relaxed);
            }
            self.read_noise(id, &record, &side, &mut scratch.noise)?;
            scratch.planes = self.decode_planes(id, &record, scratch.planes.take())?;
            let TracedBlock { block: spare, noise, planes } = &mut *scratch;
            let (noise, planes) = (noise.as_ref(), planes.as_ref());
            work(LentBlock::Source { block: BlockView::new(rows, columns, entries), noise, planes, spare })
        };
        let done = borrow();
        self.give_back(id, offset, length)?;
        if self.releases {
            self.storage.release(offset, record.length);
        }
        done
    }

    fn visit_columns(
        &self,
        id: BlockId,
        columns: Range<u32>,
        _scratch: &mut TracedBlock,
        work: &mut dyn FnMut(ColumnIndex, &[f32]),
    ) -> Result<()> {
        self.check_columns(&columns)?;
        let record = self.committed_record(id)?;
        if !record.has_main(&self.header.layout, self.shape().rect(id).rows()) {
            return Ok(());
        }
        let offset = self.header.layout.slot_offset(id);
        let is_whole = columns.len() == self.shape().columns();
        if is_whole {
            // Not its probes and planes, which take more than the columns where these are few.
            let columns = u64::from(record.stored_columns);
            self.storage.expect(offset, self.header.layout.column_bytes(self.shape().rect(id).rows() as u64, columns));
        }
        let side = self.side_data(id, &record)?;
        let stored = Self::stored_of(&side, &columns);
        self.each_stored(id, &side, stored, &mut |stored, entries| work(ColumnIndex(side.columns[stored]), entries))?;
        if self.releases && is_whole {
            self.storage.release(offset, record.length);
        }
        Ok(())
    }

    fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> Result<()> {
        let record = self.committed_record(id)?;
        let (rows, columns) = (self.shape().rect(id).rows(), self.shape().columns());
        self.storage.expect(self.header.layout.slot_offset(id), record.length);
        target.planes = self.decode_planes(id, &record, target.planes.take())?;
        if !record.has_main(&self.header.layout, rows) {
            target.block.reset(rows, columns);
            target.noise = zero_noise(&record, rows, columns);
            return Ok(());
        }
        let side = self.side_data(id, &record)?;
        if (target.block.rows(), target.block.columns()) != (rows, columns) {
            target.block.reset(rows, columns);
        }
        let stored = side.columns.len();
        self.read_stored(id, &side, 0..stored, &mut target.block.entries_mut()[..stored * rows])?;
        spread(target.block.entries_mut(), rows, &side.columns);
        self.read_noise(id, &record, &side, &mut target.noise)?;
        if self.releases {
            self.storage.release(self.header.layout.slot_offset(id), record.length);
        }
        Ok(())
    }
}

/// The noise of a block that stores none.
fn zero_noise(record: &TileRecord, rows: usize, columns: usize) -> Option<BlockNoise> {
    debug_assert!(record.noise == NOISE_NONE || record.noise == NOISE_ZERO);
    (record.noise == NOISE_ZERO).then(|| BlockNoise {
        row_variance: vec![0.0; rows],
        column_variance: vec![0.0; columns],
        probes: vec![0.0; rows * record.probes as usize],
    })
}

/// Moves columns that stand at the front of `entries` to their `places` (ascending), and zeros all others.
fn spread(entries: &mut [f32], rows: usize, places: &[u32]) {
    let mut end = entries.len();
    for (from, &to) in places.iter().enumerate().rev() {
        let (from, to) = (from * rows, to as usize * rows);
        if from != to {
            entries.copy_within(from..from + rows, to);
        }
        entries[to + rows..end].fill(0.0);
        end = to;
    }
    entries[..end].fill(0.0);
}
