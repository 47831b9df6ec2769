//! Writing: one slot per block, data first, then its commit record.

use std::fs::{self, File};
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicU8, Ordering};

use crate::error::{Error, Hint, Result};
use crate::files::{ContinuationFile, check_free_space, open_locked, publish, sync_folder};
use crate::light::Job;
use crate::matrix::{BlockId, BlockSink, CHANNELS, MatrixShape, TracedBlock};

use super::header::{EncodedHeader, StoreHeader, UnverifiedHeader};
use super::layout::STAGING_BYTES;
use super::place::{StorePaths, check_output, claim_origin, partial_path};
use super::record::{TileRecord, UnverifiedRecord};
use super::space::crowds_out;
use super::storage::{FileStorage, Storage, read_exact, write_all};
use super::tile_writer::TileWriter;
use super::{PAGE_BYTES, RECORD_BYTES, StoreLayout, StoreOptions, StoreReader};

/// Summary of a finished file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoreSummary {
    /// Blocks of the matrix.
    pub blocks: u32,
    /// Blocks that were never committed: empty unless only some were asked for.
    pub missing: Vec<BlockId>,
    /// Bytes of the committed tiles: what the matrix takes without the zero columns and blocks.
    pub stored_bytes: u64,
}

/// Writes blocks into a `.ltm`, from any thread, in any order.
///
/// Dropped without [`finish`](Self::finish) it leaves the partial file, to be continued, unless nothing was committed.
pub struct StoreWriter<S: Storage = FileStorage> {
    storage: S,
    layout: StoreLayout,
    /// For each block one of `EMPTY`, `BUSY`, `DONE`.
    states: Vec<AtomicU8>,
    /// Whether the slots hold no bytes of an earlier run.
    fresh: bool,
    /// Whether written pages leave the page cache once they are durable.
    releases: bool,
    place: StorePaths,
}

const EMPTY: u8 = 0;
const BUSY: u8 = 1;
const DONE: u8 = 2;

impl StoreWriter<FileStorage> {
    /// Begins the file `path` under its partial name.
    ///
    /// # Errors
    /// The file or a partial one is there and may not be overwritten, another process is writing it, the disk
    /// has no room, the folder cannot be written.
    pub fn create(path: &Path, job: &Job, options: StoreOptions) -> Result<Self> {
        let partial = partial_path(path);
        check_output(path, options.overwrite)?;
        let existed = partial.exists();
        if existed && !options.overwrite {
            return Err(Error::input(partial.display().to_string(), "exists already", Hint::BeginAnew));
        }
        let held = match existed {
            true => {
                let storage = FileStorage::new(open_locked(&partial, false)?);
                refuse_foreign(&storage, &partial, job, options)?;
                Some(storage.into_file())
            }
            false => None,
        };
        // Before the file is made: one without this note would be taken for a renderer's.
        let origin = claim_origin(path, options.origin, true)?;
        let file = match held {
            Some(file) => {
                file.set_len(0).map_err(Error::io(&partial, "empty"))?;
                file
            }
            None => open_locked(&partial, true)?,
        };
        Self::begin(path, file, job, options, origin)
    }

    /// Continues the partial file of `path`, which must be of the same job and precision.
    ///
    /// Blocks whose commit record is damaged count as not committed and are to be written again.
    ///
    /// # Errors
    /// There is no partial file, another program holds it, or it is of another job or precision; those of the system.
    pub fn resume(path: &Path, job: &Job, options: StoreOptions) -> Result<Self> {
        let partial = partial_path(path);
        check_output(path, options.overwrite)?;
        let origin = claim_origin(path, options.origin, false)?;
        let storage = FileStorage::new(open_locked(&partial, false)?);
        if UnverifiedHeader::is_blank(&storage).map_err(Error::io(&partial, "read the header"))? {
            refuse_foreign(&storage, &partial, job, options)?;
            // Stopped before its header was written: there is nothing to keep.
            storage.set_length(0).map_err(Error::io(&partial, "empty"))?;
            return Self::begin(path, storage.into_file(), job, options, origin);
        }
        let place = StorePaths {
            grows: partial,
            becomes: Some(path.to_owned()),
            overwrite: options.overwrite,
            remove_if_empty: false,
            origin,
        };
        Self::continue_over(storage, place, job, options)
    }

    /// Continues the partial file of `path` if there is one, else begins it: what a command does that may be run again
    /// after it was stopped. With `overwrite` it begins anew.
    ///
    /// # Errors
    /// As [`create`](Self::create) and [`resume`](Self::resume).
    pub fn create_or_resume(path: &Path, job: &Job, options: StoreOptions) -> Result<Self> {
        if partial_path(path).exists() && !options.overwrite {
            Self::resume(path, job, options)
        } else {
            Self::create(path, job, options)
        }
    }

    /// Opens the finished file `path` in place, to fill in missing blocks or to replace damaged ones (see
    /// [`discard`](Self::discard)). It is a valid file at every instant.
    ///
    /// # Errors
    /// There is no such file, another program holds it, or it is of another job or precision; those of the system.
    pub fn reopen(path: &Path, job: &Job, options: StoreOptions) -> Result<Self> {
        let storage = FileStorage::new(open_locked(path, false)?);
        let place =
            StorePaths { grows: path.to_owned(), becomes: None, overwrite: true, remove_if_empty: false, origin: None };
        Self::continue_over(storage, place, job, options)
    }

    fn begin(
        path: &Path,
        file: File,
        job: &Job,
        options: StoreOptions,
        origin: Option<ContinuationFile>,
    ) -> Result<Self> {
        let grows = partial_path(path);
        let place = StorePaths {
            becomes: Some(path.to_owned()),
            overwrite: options.overwrite,
            remove_if_empty: true,
            origin,
            grows: grows.clone(),
        };
        if options.reserve
            && let Err(error) = check_free_space(path, super::requirements(job, &options).disk_bytes)
        {
            let _ = fs::remove_file(&grows);
            return Err(error);
        }
        let begun = Self::begin_over(FileStorage::new(file), place, job, options);
        match &begun {
            Ok(_) => sync_folder(path)?,
            Err(_) => drop(fs::remove_file(&grows)),
        }
        begun
    }
}

/// Refuses a partial file that no writer of this program began: it has neither a header nor, where it has none yet, the length that
/// this job's file would have.
fn refuse_foreign(storage: &FileStorage, path: &Path, job: &Job, options: StoreOptions) -> Result<()> {
    let failed = || Error::io(path, "read the header");
    let length = storage.length().map_err(failed())?;
    let is_blank = UnverifiedHeader::is_blank(storage).map_err(failed())?;
    let begun = StoreHeader::encode(job, &options).layout.file_bytes();
    if (is_blank && (length == 0 || length == begun)) || UnverifiedHeader::is_ours(storage).map_err(failed())? {
        return Ok(());
    }
    let hint = "move it away, or choose another name for the output";
    Err(Error::input(path.display().to_string(), "was made by another program", hint))
}

impl<S: Storage> StoreWriter<S> {
    /// Begins a file over an empty storage.
    ///
    /// # Errors
    /// The storage is not empty; those of the storage.
    pub fn create_over(storage: S, job: &Job, options: StoreOptions) -> Result<Self> {
        Self::begin_over(storage, StorePaths::unnamed(), job, options)
    }

    /// Continues a file over a storage that holds one.
    ///
    /// # Errors
    /// The storage holds another job or precision; those of the storage.
    pub fn resume_over(storage: S, job: &Job, options: StoreOptions) -> Result<Self> {
        Self::continue_over(storage, StorePaths::unnamed(), job, options)
    }

    /// The header page is written last, so that a file with a header is complete up to its slots.
    fn begin_over(storage: S, place: StorePaths, job: &Job, options: StoreOptions) -> Result<Self> {
        let EncodedHeader { layout, page, description } = StoreHeader::encode(job, &options);
        let failed = |action: &str| Error::io(&place.grows, action.to_owned());
        storage.set_length(layout.file_bytes()).map_err(failed("set the length"))?;
        if options.reserve {
            storage.reserve(0, layout.file_bytes()).map_err(failed("reserve disk space"))?;
        }
        write_all(&storage, layout.job_offset(), &description).map_err(failed("write the job description"))?;
        storage.sync().map_err(failed("sync"))?;
        write_all(&storage, 0, &page).map_err(failed("write the header"))?;
        storage.sync().map_err(failed("sync"))?;
        let states = job.shape.blocks().map(|_| AtomicU8::new(EMPTY)).collect();
        Ok(Self { storage, layout, states, fresh: true, releases: crowds_out(layout.file_bytes()), place })
    }

    fn continue_over(storage: S, place: StorePaths, job: &Job, options: StoreOptions) -> Result<Self> {
        let path = &place.grows;
        let found = StoreHeader::read(&storage, path)?;
        let refuse = |problem: String| {
            let hint = "choose another name, or overwrite it";
            Err(Error::input(path.display().to_string(), problem, hint))
        };
        if found.job.hash() != job.hash() {
            return refuse(format!("holds blocks of another job ({}, not {})", found.job.hash(), job.hash()));
        }
        if found.layout.precision != options.precision {
            return refuse(format!("is stored as {}, not {}", found.layout.precision, options.precision));
        }
        if found.layout.has_planes() && !found.planes_known {
            return refuse("sums its light over groups of columns as an earlier program did".to_owned());
        }
        let layout = found.layout;
        let length = storage.length().map_err(Error::io(path, "ask for the length"))?;
        if length != layout.file_bytes() {
            // Cut short or grown: blocks that reached beyond the end are forgotten below.
            storage.set_length(layout.file_bytes()).map_err(Error::io(path, "set the length"))?;
        }
        let states: Vec<_> = job.shape.blocks().map(|_| AtomicU8::new(EMPTY)).collect();
        let writer = Self { storage, layout, states, fresh: false, releases: crowds_out(layout.file_bytes()), place };
        let damaged = writer.scan_records(|id, record| {
            let whole = record
                .is_ok_and(|record| writer.layout.slot_offset(id) + record.length <= length || record.length == 0);
            if whole {
                writer.states[id.index()].store(DONE, Ordering::Relaxed);
            }
            !whole
        })?;
        for id in damaged {
            writer.clear_record(id)?;
        }
        Ok(writer)
    }

    /// Goes through all records but the blank ones and returns the blocks for which `visit` says so.
    fn scan_records(&self, visit: impl Fn(BlockId, Result<TileRecord, String>) -> bool) -> Result<Vec<BlockId>> {
        let mut chosen = Vec::new();
        let mut table = vec![0; 1 << 16];
        let count = self.layout.shape.block_count();
        let per_read = (table.len() as u64 / RECORD_BYTES) as u32;
        for first in (0..count).step_by(per_read as usize) {
            let here = per_read.min(count - first);
            let bytes = &mut table[..here as usize * RECORD_BYTES as usize];
            read_exact(&self.storage, self.layout.record_offset(BlockId(first)), bytes)
                .map_err(Error::io(&self.place.grows, "read the commit table"))?;
            for (i, bytes) in bytes.chunks_exact(RECORD_BYTES as usize).enumerate() {
                let id = BlockId(first + i as u32);
                let record = UnverifiedRecord(bytes.try_into().expect("a record's bytes")).verify(&self.layout, id);
                if let Some(record) = record.transpose()
                    && visit(id, record)
                {
                    chosen.push(id);
                }
            }
        }
        Ok(chosen)
    }

    /// Reserves disk space for a range of blocks. A writer opened without [`reserve`](StoreOptions::reserve), or over a
    /// file that released its unused space, needs this.
    ///
    /// # Errors
    /// The disk has no room for them, or there are no such blocks.
    pub fn reserve(&self, blocks: Range<u32>) -> Result<()> {
        let bytes = self.layout.slots_of(blocks)?;
        self.storage
            .reserve(bytes.start, bytes.end - bytes.start)
            .map_err(Error::io(&self.place.grows, "reserve disk space"))
    }

    /// Shape of the matrix.
    pub fn shape(&self) -> MatrixShape {
        self.layout.shape
    }

    /// The file that is being written.
    pub fn path(&self) -> &Path {
        &self.place.grows
    }

    /// Whether a block is committed: there is no need to make it again.
    pub fn is_committed(&self, id: BlockId) -> bool {
        self.states[id.index()].load(Ordering::Acquire) == DONE
    }

    /// Number of committed blocks.
    pub fn committed_count(&self) -> u32 {
        self.states.iter().filter(|state| state.load(Ordering::Acquire) == DONE).count() as u32
    }

    /// Forgets a committed block, durably, so that it can be written again: the first step of mending it.
    ///
    /// # Errors
    /// The system refuses to write.
    pub fn discard(&self, id: BlockId) -> Result<()> {
        self.clear_record(id)?;
        self.states[id.index()].store(EMPTY, Ordering::Release);
        Ok(())
    }

    /// Makes a hole of everything in which nothing is stored.
    pub(super) fn clear_unused(&self, record: impl Fn(BlockId) -> Result<Option<TileRecord>>) -> Result<()> {
        let failed = || Error::io(&self.place.grows, "clear what is not used");
        let shape = self.layout.shape;
        let table_end = self.layout.record_offset(BlockId(shape.block_count()));
        self.storage.clear(table_end, self.layout.slots_offset() - table_end).map_err(failed())?;
        for id in shape.blocks() {
            let length = record(id)?.map_or(0, |record| record.length);
            self.clear_rest(id, length).map_err(failed())?;
        }
        Ok(())
    }

    fn clear_record(&self, id: BlockId) -> Result<()> {
        let failed = |action: String| Error::io(&self.place.grows, action);
        write_all(&self.storage, self.layout.record_offset(id), &[0; RECORD_BYTES as usize])
            .and_then(|()| self.storage.sync())
            .map_err(failed(format!("discard {id}")))
    }

    /// Writes a block's tile. `commit` has made sure that nobody else does.
    fn write_tile(&self, id: BlockId, block: &TracedBlock) -> std::io::Result<TileRecord> {
        let tile = TileWriter { storage: &self.storage, layout: &self.layout };
        let record = tile.write(self.layout.slot_offset(id), block)?;
        self.clear_rest(id, record.length)?;
        Ok(record)
    }

    /// Makes a hole of what is left of a slot. In a fresh file it reads as zero as it is, and only whole pages are
    /// worth giving back.
    fn clear_rest(&self, id: BlockId, length: u64) -> std::io::Result<()> {
        let from = if self.fresh { length.next_multiple_of(PAGE_BYTES) } else { length };
        self.storage.clear(self.layout.slot_offset(id) + from, self.layout.slot_bytes(id) - from)
    }

    fn check_block(&self, id: BlockId, block: &TracedBlock) -> Result<()> {
        let refuse = |problem: String| Err(Error::input(format!("{id}"), problem, "this is a fault of the program"));
        let shape = self.layout.shape;
        if id.0 >= shape.block_count() {
            return refuse(format!("the matrix has {} blocks", shape.block_count()));
        }
        let (rows, columns) = (shape.rect(id).rows(), shape.columns());
        if (block.block.rows(), block.block.columns()) != (rows, columns) {
            let (r, c) = (block.block.rows(), block.block.columns());
            return refuse(format!("has {r} × {c} entries, but {rows} × {columns} belong there"));
        }
        if let Some(noise) = &block.noise {
            let most = rows * self.layout.max_probes as usize;
            let fits = noise.row_variance.len() == rows
                && noise.column_variance.len() == columns
                && noise.probes.len().is_multiple_of(rows)
                && noise.probes.len() <= most;
            if !fits {
                return refuse("has noise of another shape, or with too many probes".into());
            }
        }
        if let Some(planes) = block.planes.as_ref().filter(|_| self.layout.has_planes()) {
            let pixels = rows / CHANNELS;
            let fits = (planes.pixels(), planes.clusters()) == (pixels, self.layout.clusters as usize)
                && planes.feature_variance.len() == planes.features.len()
                && planes.direct.iter().chain(&planes.indirect).all(|light| light.len() == planes.direct[0].len())
                && planes.emission.len() as u64 <= self.layout.most_seen(rows as u64);
            if !fits {
                return refuse("has planes of another shape, or with too many emitters".into());
            }
        }
        Ok(())
    }

    /// Finishes the file: releases the space of blocks that were not committed, makes everything durable, and renames
    /// it to its final name.
    ///
    /// # Errors
    /// The system refuses to write or to rename; the partial file is kept.
    pub fn finish(mut self) -> Result<StoreSummary> {
        let failed = |action: &str| Error::io(&self.place.grows, action.to_owned());
        let blocks = self.layout.shape.block_count();
        let missing: Vec<_> = self.layout.shape.blocks().filter(|&id| !self.is_committed(id)).collect();
        for &id in &missing {
            self.storage
                .clear(self.layout.slot_offset(id), self.layout.slot_bytes(id))
                .map_err(failed("give back unused space"))?;
        }
        let stored = std::cell::Cell::new(0);
        self.scan_records(|_, record| {
            stored.set(stored.get() + record.map_or(0, |record| record.length));
            false
        })?;
        self.storage.sync().map_err(failed("sync"))?;
        self.check_length().map_err(failed("finish"))?;
        self.place.remove_if_empty = false;
        if let Some(path) = self.place.becomes.clone() {
            publish(&self.place.grows, &path, self.place.overwrite)?;
            if let Some(origin) = self.place.origin.take() {
                origin.remove()?;
            }
        }
        Ok(StoreSummary { blocks, missing, stored_bytes: stored.get() })
    }
}

impl<S: Storage> StoreWriter<S> {
    /// Copies a tile of the same job from another file, where it was found good.
    pub(super) fn copy_tile(
        &self,
        id: BlockId,
        record: &TileRecord,
        from: &StoreReader<impl Storage>,
        scratch: &mut Vec<u8>,
    ) -> Result<()> {
        self.commit(id, || {
            let (slot, slot_there) = (self.layout.slot_offset(id), from.layout().slot_offset(id));
            for start in (0..record.length).step_by(STAGING_BYTES) {
                scratch.resize((record.length - start).min(STAGING_BYTES as u64) as usize, 0);
                read_exact(from.storage(), slot_there + start, scratch)?;
                write_all(&self.storage, slot + start, scratch)?;
            }
            self.clear_rest(id, record.length)?;
            Ok(*record)
        })
    }

    /// Errors: another program has cut the file short, and blocks with it: writing on would hide that under a hole of zeros.
    fn check_length(&self) -> std::io::Result<()> {
        let (length, whole) = (self.storage.length()?, self.layout.file_bytes());
        if length == whole {
            return Ok(());
        }
        let problem = format!("another program changed its length from {whole} to {length} bytes; begin again");
        Err(std::io::Error::other(problem))
    }

    /// Runs `write_tile` on a block that nobody else is writing, makes what it wrote durable, then its record.
    fn commit(&self, id: BlockId, write_tile: impl FnOnce() -> std::io::Result<TileRecord>) -> Result<()> {
        let state = &self.states[id.index()];
        if state.compare_exchange(EMPTY, BUSY, Ordering::AcqRel, Ordering::Acquire).is_err() {
            return Err(Error::input(format!("{id}"), "was written before", "this is a fault of the program"));
        }
        let committed = self.check_length().and_then(|()| write_tile()).and_then(|record| {
            if record.length > 0 {
                self.storage.sync()?;
                if self.releases {
                    self.storage.release(self.layout.slot_offset(id), record.length);
                }
            }
            write_all(&self.storage, self.layout.record_offset(id), &record.encode(&self.layout, id))
        });
        state.store(if committed.is_ok() { DONE } else { EMPTY }, Ordering::Release);
        committed.map_err(Error::io(&self.place.grows, format!("write {id}")))
    }
}

impl<S: Storage> BlockSink for StoreWriter<S> {
    fn write_block(&self, id: BlockId, block: &TracedBlock) -> Result<()> {
        self.check_block(id, block)?;
        self.commit(id, || self.write_tile(id, block))
    }
}

impl<S: Storage> Drop for StoreWriter<S> {
    fn drop(&mut self) {
        if self.place.remove_if_empty && self.committed_count() == 0 {
            let _ = fs::remove_file(&self.place.grows);
            let _ = self.place.origin.take().map(ContinuationFile::remove);
        }
    }
}
