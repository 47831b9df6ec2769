//! A file for what does not fit in memory between two passes, and that a stopped job continues from.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

use crate::container::{MARK_BYTES, open_marked};
use crate::error::{Error, Result};
use crate::matrix::BlockId;

const MAGIC: [u8; 8] = *b"LTMspil1";
/// Block, CRC-32 of the bytes, their number, CRC-32 of these three.
const RECORD_BYTES: usize = 20;
/// What a loss of power may cost.
const SYNC_PERIOD: Duration = Duration::from_secs(5);

/// One byte string for each block, appended from any thread, in `NAME.spill` beside the result.
///
/// Every string is checked, so that whatever instant the process was stopped at, the whole ones are taken up again by a
/// job of the same fingerprint. [`remove`](Self::remove) it when the result stands.
pub(super) struct Spill {
    path: PathBuf,
    file: File,
    state: Mutex<State>,
}

struct State {
    end: u64,
    places: Vec<Option<Place>>,
    synced: Instant,
}

#[derive(Clone, Copy, Debug)]
struct Place {
    offset: u64,
    bytes: u64,
    checksum: u32,
}

impl Spill {
    /// The file's name for a result.
    pub(super) fn path_of(result: &Path) -> PathBuf {
        let mut name = result.as_os_str().to_owned();
        name.push(".spill");
        name.into()
    }

    /// Opens the spill file of `result`, going on with an earlier one of the same `fingerprint`, else anew.
    ///
    /// Errors: the folder cannot be written, another process is using the file.
    pub(super) fn open(result: &Path, fingerprint: [u8; 32], blocks: u32) -> Result<Self> {
        let path = Self::path_of(result);
        let (file, continued) = open_marked(&path, MAGIC, fingerprint, "another process is packing with it")?;
        let mut state = State { end: MARK_BYTES, places: vec![None; blocks as usize], synced: Instant::now() };
        if continued {
            recover(&file, &mut state).map_err(Error::io(&path, "read"))?;
        }
        Ok(Self { path, file, state: Mutex::new(state) })
    }

    /// Whether a block is there.
    pub(super) fn has(&self, id: BlockId) -> bool {
        self.lock().places[id.index()].is_some()
    }

    /// Appends a block's bytes.
    pub(super) fn append(&self, id: BlockId, bytes: &[u8]) -> Result<()> {
        let checksum = crc32fast::hash(bytes);
        let mut record = [0; RECORD_BYTES];
        record[..4].copy_from_slice(&id.0.to_le_bytes());
        record[4..8].copy_from_slice(&checksum.to_le_bytes());
        record[8..16].copy_from_slice(&(bytes.len() as u64).to_le_bytes());
        let check = crc32fast::hash(&record[..16]);
        record[16..].copy_from_slice(&check.to_le_bytes());
        let failed = || Error::io(&self.path, "write");
        let sync = {
            // Written under the lock: a record that is not whole must be the last one.
            let mut state = self.lock();
            let offset = state.end + RECORD_BYTES as u64;
            self.file
                .write_all_at(&record, state.end)
                .and_then(|()| self.file.write_all_at(bytes, offset))
                .map_err(failed())?;
            state.places[id.index()] = Some(Place { offset, bytes: bytes.len() as u64, checksum });
            state.end = offset + bytes.len() as u64;
            let due = state.synced.elapsed() > SYNC_PERIOD;
            if due {
                state.synced = Instant::now();
            }
            due
        };
        if sync { self.file.sync_data().map_err(failed()) } else { Ok(()) }
    }

    /// Reads a block's bytes back.
    pub(super) fn read(&self, id: BlockId) -> Result<Vec<u8>> {
        let place = self.lock().places[id.index()];
        let place = place.ok_or_else(|| self.damaged(id, "it is not there"))?;
        let mut bytes = vec![0; place.bytes as usize];
        self.file.read_exact_at(&mut bytes, place.offset).map_err(Error::io(&self.path, format!("read {id}")))?;
        if crc32fast::hash(&bytes) != place.checksum {
            return Err(self.damaged(id, "its checksum does not hold"));
        }
        Ok(bytes)
    }

    /// The error for bytes that came back other than they were written.
    pub(super) fn damaged(&self, id: BlockId, problem: &str) -> Error {
        Error::damaged(
            &self.path,
            format!("{id}: {problem}"),
            "check the disk, remove the file and run the command again",
        )
    }

    /// Removes the file.
    pub(super) fn remove(self) -> Result<()> {
        std::fs::remove_file(&self.path).map_err(Error::io(&self.path, "remove"))
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // A panic while the lock was held leaves at worst an unfinished record at the end, which is overwritten.
        self.state.lock().unwrap_or_else(|e| e.into_inner())
    }
}

impl Drop for Spill {
    fn drop(&mut self) {
        // Nobody would continue from nothing.
        if self.lock().places.iter().all(Option::is_none) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Takes up every whole record, up to the first that is not.
fn recover(file: &File, state: &mut State) -> std::io::Result<()> {
    let length = file.metadata()?.len();
    let mut record = [0; RECORD_BYTES];
    let mut bytes = Vec::new();
    while state.end + RECORD_BYTES as u64 <= length {
        file.read_exact_at(&mut record, state.end)?;
        let word = |at: usize| u32::from_le_bytes(record[at..at + 4].try_into().expect("4 bytes"));
        let (id, checksum, count) = (word(0) as usize, word(4), u64::from(word(8)) | u64::from(word(12)) << 32);
        let offset = state.end + RECORD_BYTES as u64;
        let plausible = crc32fast::hash(&record[..16]) == word(16) && id < state.places.len();
        if !plausible || count > length - offset {
            break;
        }
        bytes.resize(count as usize, 0);
        file.read_exact_at(&mut bytes, offset)?;
        if crc32fast::hash(&bytes) != checksum {
            break;
        }
        state.places[id] = Some(Place { offset, bytes: count, checksum });
        state.end = offset + count;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_whole_when_a_job_was_stopped_is_taken_up_again() {
        let folder = tempfile::tempdir().unwrap();
        let result = folder.path().join("x.ltc");
        let open = |fingerprint: u8| Spill::open(&result, [fingerprint; 32], 12).unwrap();
        let text = |i: u32| vec![i as u8; 3 * i as usize];
        let spill = open(1);
        (0..10).for_each(|i| spill.append(BlockId(i), &text(i)).unwrap());
        assert!(Spill::open(&result, [1; 32], 12).is_err(), "another process");
        drop(spill);
        let whole = std::fs::read(Spill::path_of(&result)).unwrap();
        for cut in MARK_BYTES as usize..=whole.len() {
            std::fs::write(Spill::path_of(&result), &whole[..cut]).unwrap();
            let spill = open(1);
            let kept = (0..12).take_while(|&i| spill.has(BlockId(i))).count() as u32;
            assert!((0..kept).all(|i| spill.read(BlockId(i)).unwrap() == text(i)));
            assert!((kept..12).all(|i| !spill.has(BlockId(i))), "cut at {cut}");
            spill.append(BlockId(11), b"more").unwrap();
            assert_eq!(spill.read(BlockId(11)).unwrap(), b"more");
            assert_eq!(kept == 10, cut == whole.len());
        }
        assert!(!open(2).has(BlockId(0)), "another job begins anew");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_changed_byte_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let spill = Spill::open(&folder.path().join("x"), [0; 32], 1).unwrap();
        spill.append(BlockId(0), &[7; 100]).unwrap();
        spill.file.write_all_at(&[8], MARK_BYTES + RECORD_BYTES as u64 + 50).unwrap();
        assert!(spill.read(BlockId(0)).unwrap_err().to_string().contains("block 0"));
    }
}
