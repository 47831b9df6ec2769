//! Storages that hold everything in memory, tear, freeze and count.

use std::io;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use ltm::store::Storage;

/// What was asked of a storage, in order.
#[derive(Clone, Debug)]
pub(crate) enum Operation {
    Write(u64, Vec<u8>),
    Clear(u64, u64),
    Length(u64),
    Sync,
}

/// A file in memory that remembers what was done to it.
#[derive(Default)]
pub(crate) struct Memory {
    pub(crate) bytes: Mutex<Vec<u8>>,
    pub(crate) operations: Mutex<Vec<Operation>>,
}

impl Memory {
    pub(crate) fn holding(bytes: Vec<u8>) -> Self {
        Self { bytes: Mutex::new(bytes), operations: Mutex::default() }
    }

    pub(crate) fn content(&self) -> Vec<u8> {
        self.bytes.lock().unwrap().clone()
    }

    fn note(&self, operation: Operation) {
        self.operations.lock().unwrap().push(operation);
    }
}

pub(crate) fn apply(bytes: &mut Vec<u8>, operation: &Operation) {
    match operation {
        Operation::Write(offset, written) => {
            let end = *offset as usize + written.len();
            bytes.resize(bytes.len().max(end), 0);
            bytes[*offset as usize..end].copy_from_slice(written);
        }
        Operation::Clear(offset, length) => bytes[*offset as usize..][..*length as usize].fill(0),
        Operation::Length(length) => bytes.resize(*length as usize, 0),
        Operation::Sync => {}
    }
}

impl Storage for Memory {
    fn length(&self) -> io::Result<u64> {
        Ok(self.bytes.lock().unwrap().len() as u64)
    }

    fn set_length(&self, length: u64) -> io::Result<()> {
        self.note(Operation::Length(length));
        self.bytes.lock().unwrap().resize(length as usize, 0);
        Ok(())
    }

    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> io::Result<usize> {
        let all = self.bytes.lock().unwrap();
        let there = all.get(offset as usize..).unwrap_or_default();
        let read = there.len().min(bytes.len());
        bytes[..read].copy_from_slice(&there[..read]);
        Ok(read)
    }

    fn write_at(&self, offset: u64, bytes: &[u8]) -> io::Result<usize> {
        let operation = Operation::Write(offset, bytes.to_vec());
        apply(&mut self.bytes.lock().unwrap(), &operation);
        self.note(operation);
        Ok(bytes.len())
    }

    fn sync(&self) -> io::Result<()> {
        self.note(Operation::Sync);
        Ok(())
    }

    fn reserve(&self, _offset: u64, _length: u64) -> io::Result<()> {
        Ok(())
    }

    fn clear(&self, offset: u64, length: u64) -> io::Result<()> {
        let operation = Operation::Clear(offset, length);
        apply(&mut self.bytes.lock().unwrap(), &operation);
        self.note(operation);
        Ok(())
    }
}

/// Counts, and fails on demand.
#[derive(Default)]
pub(crate) struct Watched {
    pub(crate) inner: Memory,
    /// Most bytes that one call reads or writes; 0: as many as asked for. Every second call is interrupted.
    pub(crate) at_most: usize,
    /// Number of changing calls (write, clear, length, sync) after which each fails; 0: never.
    pub(crate) freezes_after: u64,
    pub(crate) calls: AtomicU64,
    pub(crate) reads: AtomicU64,
    pub(crate) read_bytes: AtomicU64,
    pub(crate) writes: AtomicU64,
    pub(crate) written_bytes: AtomicU64,
    pub(crate) syncs: AtomicU64,
    pub(crate) changes: AtomicU64,
}

impl Watched {
    fn limit(&self, asked: usize) -> io::Result<usize> {
        let call = self.calls.fetch_add(1, Ordering::Relaxed);
        match self.at_most {
            0 => Ok(asked),
            _ if call.is_multiple_of(2) => Err(io::ErrorKind::Interrupted.into()),
            most => Ok(asked.min(most)),
        }
    }

    fn change(&self) -> io::Result<()> {
        let changes = self.changes.fetch_add(1, Ordering::Relaxed);
        let frozen = self.freezes_after > 0 && changes >= self.freezes_after;
        if frozen { Err(io::ErrorKind::StorageFull.into()) } else { Ok(()) }
    }

    /// Forgets the counts.
    pub(crate) fn restart(&self) {
        [&self.reads, &self.read_bytes, &self.writes, &self.written_bytes, &self.syncs]
            .iter()
            .for_each(|count| count.store(0, Ordering::Relaxed));
    }
}

impl Storage for Watched {
    fn length(&self) -> io::Result<u64> {
        self.inner.length()
    }

    fn set_length(&self, length: u64) -> io::Result<()> {
        self.change()?;
        self.inner.set_length(length)
    }

    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> io::Result<usize> {
        let asked = self.limit(bytes.len())?;
        let read = self.inner.read_at(offset, &mut bytes[..asked])?;
        self.reads.fetch_add(1, Ordering::Relaxed);
        self.read_bytes.fetch_add(read as u64, Ordering::Relaxed);
        Ok(read)
    }

    fn write_at(&self, offset: u64, bytes: &[u8]) -> io::Result<usize> {
        let asked = self.limit(bytes.len())?;
        self.change()?;
        self.writes.fetch_add(1, Ordering::Relaxed);
        self.written_bytes.fetch_add(asked as u64, Ordering::Relaxed);
        self.inner.write_at(offset, &bytes[..asked])
    }

    fn sync(&self) -> io::Result<()> {
        self.change()?;
        self.syncs.fetch_add(1, Ordering::Relaxed);
        self.inner.sync()
    }

    fn reserve(&self, offset: u64, length: u64) -> io::Result<()> {
        self.inner.reserve(offset, length)
    }

    fn clear(&self, offset: u64, length: u64) -> io::Result<()> {
        self.change()?;
        self.inner.clear(offset, length)
    }
}
