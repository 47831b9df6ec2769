//! A file from which a stopped job goes on.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

use super::lock::{is_named, open_locked};
use super::system::PositionedFile;
use crate::error::{Error, Hint, Result};

/// What stands before the records: the mark, and the fingerprint of the job.
const HEAD_BYTES: usize = 40;
/// Of the mark these say whose the file is; the last byte is the version of what is in it.
const OWNER_BYTES: usize = 7;
/// Key, CRC-32 of the bytes, their number, CRC-32 of these three.
const RECORD_BYTES: usize = 20;
/// Largest time of work that a power failure may cost.
const SYNC_PERIOD: Duration = Duration::from_secs(5);

/// A file with one byte string for each key below a bound, appended from any thread, with checksums. Wherever the
/// process stopped, a job of the same mark and fingerprint continues with the complete strings.
///
/// The file is locked while it is open. It is [removed](Self::remove) once the result is complete, and when dropped
/// without a record.
#[derive(Debug)]
pub struct ContinuationFile {
    path: PathBuf,
    file: File,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    end: u64,
    places: Vec<Option<RecordSpan>>,
    synced: Instant,
}

#[derive(Clone, Copy, Debug)]
struct RecordSpan {
    offset: u64,
    bytes: u64,
    checksum: u32,
}

impl ContinuationFile {
    /// Opens the file of a job with `keys` keys: continues one of the same `mark` and `fingerprint`, or begins one. The
    /// first seven bytes of the mark identify the owner. A file of the same owner but another fingerprint is replaced
    /// only with `overwrite`. A file of any other owner is left as it is.
    ///
    /// # Errors
    /// The folder cannot be written; another process holds the file; it is of another job or of another program.
    pub fn open(path: &Path, mark: [u8; 8], fingerprint: [u8; 32], keys: u32, overwrite: bool) -> Result<Self> {
        let file = open_locked(path, true)?;
        let failed = |action: &str| Error::io(path, action.to_owned());
        let refuse = |problem: &str, hint: Hint| Err(Error::input(path.display().to_string(), problem, hint));
        let mut head = [0; HEAD_BYTES];
        head[..8].copy_from_slice(&mark);
        head[8..].copy_from_slice(&fingerprint);
        let mut found = [0; HEAD_BYTES];
        let length = file.metadata().map_err(failed("look at"))?.len();
        let start = length.min(HEAD_BYTES as u64) as usize;
        file.read_exact_at(&mut found[..start], 0).map_err(failed("read"))?;
        let owner = start.min(OWNER_BYTES);
        if found[..owner] != mark[..owner] {
            return refuse("was made by another program", "move it away, or choose another name for the output".into());
        }
        let continues = found == head;
        if !continues && length > HEAD_BYTES as u64 && !overwrite {
            return refuse("keeps the work of an interrupted job with other input or settings", Hint::BeginAnew);
        }
        if !continues {
            file.set_len(0).and_then(|()| file.write_all_at(&head, 0)).map_err(failed("write"))?;
        }
        Self::recovered(path, file, keys)
    }

    /// Removes the file of a job that was killed between renaming its result to `finished` and denoising up. It must
    /// have this mark and every key, be older than the result, and be locked by no process.
    pub fn remove_leftover(path: &Path, mark: [u8; 8], keys: u32, finished: &Path) {
        let written = |path: &Path| std::fs::metadata(path).and_then(|found| found.modified()).ok();
        let is_older = written(path).zip(written(finished)).is_some_and(|(left, finished)| left <= finished);
        if !is_older {
            return;
        }
        let Ok(file) = open_locked(path, false) else { return };
        let mut found = [0; 8];
        let is_ours = file.read_exact_at(&mut found, 0).is_ok() && found == mark;
        if is_ours
            && let Ok(left) = Self::recovered(path, file, keys)
            && left.count() == keys
        {
            let _ = left.remove();
        }
    }

    /// Over a file that begins with a mark.
    fn recovered(path: &Path, file: File, keys: u32) -> Result<Self> {
        let state = State { end: HEAD_BYTES as u64, places: vec![None; keys as usize], synced: Instant::now() };
        let continuation = Self { path: path.to_owned(), file, state: Mutex::new(state) };
        continuation.recover().map_err(Error::io(path, "read"))?;
        Ok(continuation)
    }

    /// Whether the bytes of a key are present.
    pub fn has(&self, key: u32) -> bool {
        self.lock().places[key as usize].is_some()
    }

    /// Number of keys whose bytes are there.
    pub fn count(&self) -> u32 {
        self.lock().places.iter().flatten().count() as u32
    }

    /// Appends the bytes of a key, one part after the other. Of a key that is written again the last bytes count.
    ///
    /// # Errors
    /// The system refuses to write.
    pub fn append(&self, key: u32, parts: &[&[u8]]) -> Result<()> {
        let bytes = parts.concat();
        let checksum = crc32fast::hash(&bytes);
        let mut record = [0; RECORD_BYTES];
        record[..4].copy_from_slice(&key.to_le_bytes());
        record[4..8].copy_from_slice(&checksum.to_le_bytes());
        record[8..16].copy_from_slice(&(bytes.len() as u64).to_le_bytes());
        let check = crc32fast::hash(&record[..16]);
        record[16..].copy_from_slice(&check.to_le_bytes());
        let failed = || Error::io(&self.path, "write");
        let sync_is_due = {
            // Written under the lock: a record that is not whole must be the last one.
            let mut state = self.lock();
            let offset = state.end + RECORD_BYTES as u64;
            self.file
                .write_all_at(&record, state.end)
                .and_then(|()| self.file.write_all_at(&bytes, offset))
                .map_err(failed())?;
            state.places[key as usize] = Some(RecordSpan { offset, bytes: bytes.len() as u64, checksum });
            state.end = offset + bytes.len() as u64;
            let due = state.synced.elapsed() > SYNC_PERIOD;
            if due {
                state.synced = Instant::now();
            }
            due
        };
        if sync_is_due { self.file.sync_data().map_err(failed()) } else { Ok(()) }
    }

    /// Reads the bytes of a key back.
    ///
    /// # Errors
    /// They are not there, cannot be read, or are not those that were written.
    pub fn read(&self, key: u32) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.read_into(key, &mut bytes)?;
        Ok(bytes)
    }

    /// Like [`read`](Self::read), into memory that was used before: fresh pages cost as much as what is read into them.
    ///
    /// # Errors
    /// As there.
    pub fn read_into(&self, key: u32, bytes: &mut Vec<u8>) -> Result<()> {
        let place = self.place(key)?;
        bytes.resize(place.bytes as usize, 0);
        self.read_exact(key, place.offset, bytes)?;
        if crc32fast::hash(bytes) != place.checksum {
            return Err(self.damaged(key, "its checksum does not hold"));
        }
        Ok(())
    }

    /// Length of the bytes of a key, and their CRC-32.
    ///
    /// # Errors
    /// They are not there.
    pub fn length_and_checksum(&self, key: u32) -> Result<(u64, u32)> {
        self.place(key).map(|place| (place.bytes, place.checksum))
    }

    /// Reads part of the bytes of a key. The caller knows the checksum of that part.
    ///
    /// # Errors
    /// They are missing, cannot be read, or fail the checksum.
    pub fn read_part(&self, key: u32, from: u64, bytes: usize, checksum: u32) -> Result<Vec<u8>> {
        let place = self.place(key)?;
        let mut part = vec![0; bytes];
        self.read_exact(key, place.offset + from, &mut part)?;
        if crc32fast::hash(&part) != checksum {
            return Err(self.damaged(key, "its checksum does not hold"));
        }
        Ok(part)
    }

    /// The error for bytes that came back other than they were written.
    pub fn damaged(&self, key: u32, problem: &str) -> Error {
        let hint = "check the disk, remove the file and begin again";
        Error::damaged(&self.path, format!("block {key}: {problem}"), hint)
    }

    /// Removes the file; no fault if it is gone, or another stands under its name by now.
    ///
    /// # Errors
    /// The system refuses.
    pub fn remove(self) -> Result<()> {
        if !is_named(&self.file, &self.path) {
            return Ok(());
        }
        std::fs::remove_file(&self.path).map_err(Error::io(&self.path, "remove"))
    }

    /// Takes up every whole record, and cuts off what follows the last of them.
    fn recover(&self) -> std::io::Result<()> {
        let mut state = self.lock();
        let length = self.file.metadata()?.len();
        let mut record = [0; RECORD_BYTES];
        let mut bytes = Vec::new();
        while state.end + RECORD_BYTES as u64 <= length {
            self.file.read_exact_at(&mut record, state.end)?;
            let word = |at: usize| u32::from_le_bytes(record[at..at + 4].try_into().expect("4 bytes"));
            let (key, checksum, count) = (word(0) as usize, word(4), u64::from(word(8)) | u64::from(word(12)) << 32);
            let offset = state.end + RECORD_BYTES as u64;
            let plausible = crc32fast::hash(&record[..16]) == word(16) && key < state.places.len();
            if !plausible || count > length - offset {
                break;
            }
            bytes.resize(count as usize, 0);
            self.file.read_exact_at(&mut bytes, offset)?;
            if crc32fast::hash(&bytes) != checksum {
                break;
            }
            state.places[key] = Some(RecordSpan { offset, bytes: count, checksum });
            state.end = offset + count;
        }
        self.file.set_len(state.end)
    }

    fn place(&self, key: u32) -> Result<RecordSpan> {
        self.lock().places[key as usize].ok_or_else(|| self.damaged(key, "it is not there"))
    }

    fn read_exact(&self, key: u32, offset: u64, bytes: &mut [u8]) -> Result<()> {
        self.file.read_exact_at(bytes, offset).map_err(|error| match error.kind() {
            std::io::ErrorKind::UnexpectedEof => self.damaged(key, "the file is cut short"),
            _ => Error::io(&self.path, format!("read block {key}"))(error),
        })
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // A panic while the lock was held leaves at worst an unfinished record at the end, which is overwritten.
        self.state.lock().unwrap_or_else(|e| e.into_inner())
    }
}

impl Drop for ContinuationFile {
    fn drop(&mut self) {
        // Nobody would continue from nothing.
        if self.lock().places.iter().all(Option::is_none) && is_named(&self.file, &self.path) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    const MARK: [u8; 8] = *b"LTMtest1";

    fn open(path: &Path, fingerprint: u8) -> Result<ContinuationFile> {
        ContinuationFile::open(path, MARK, [fingerprint; 32], 12, false)
    }

    fn text(key: u32) -> Vec<u8> {
        vec![key as u8; 3 * key as usize]
    }

    #[test]
    fn what_was_whole_when_a_job_was_stopped_is_taken_up_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.part");
        let file = open(&path, 1).unwrap();
        (0..10).for_each(|key| file.append(key, &[&text(key)]).unwrap());
        assert!(open(&path, 1).is_err(), "another process");
        drop(file);
        let whole = fs::read(&path).unwrap();
        for cut in HEAD_BYTES..=whole.len() {
            fs::write(&path, &whole[..cut]).unwrap();
            let file = open(&path, 1).unwrap();
            let kept = file.count();
            assert!((0..kept).all(|key| file.read(key).unwrap() == text(key)));
            assert!((kept..12).all(|key| !file.has(key)), "cut at {cut}");
            file.append(11, &[b"mo", b"re"]).unwrap();
            assert_eq!(file.read(11).unwrap(), b"more");
            assert_eq!(kept == 10, cut == whole.len());
        }
    }

    #[test]
    fn work_of_another_job_is_kept_unless_it_may_be_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.part");
        open(&path, 1).unwrap().append(3, &[b"three"]).unwrap();
        let whole = fs::read(&path).unwrap();
        let said = open(&path, 2).unwrap_err().to_string();
        assert!(said.contains("other input or settings"), "{said}");
        assert_eq!(fs::read(&path).unwrap(), whole);
        assert_eq!(open(&path, 1).unwrap().read(3).unwrap(), b"three");
        let anew = ContinuationFile::open(&path, MARK, [2; 32], 12, true).unwrap();
        assert_eq!(anew.count(), 0);
        drop(anew);
        assert!(!path.exists(), "a file without records is not worth continuing");
    }

    #[test]
    fn a_file_of_someone_else_is_never_touched() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.part");
        for foreign in [&b"a user's own words, more than forty bytes of them"[..], b"short", b"LTMtes"] {
            fs::write(&path, foreign).unwrap();
            for overwrite in [false, true] {
                let opened = ContinuationFile::open(&path, MARK, [1; 32], 12, overwrite);
                // Less than a mark, and all of it ours: a process that was killed in its first write.
                if foreign != b"LTMtes" {
                    assert!(opened.unwrap_err().to_string().contains("another program"));
                    assert_eq!(fs::read(&path).unwrap(), foreign);
                }
            }
        }
    }

    #[test]
    fn a_changed_byte_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let file = open(&folder.path().join("x"), 0).unwrap();
        file.append(0, &[&[7; 100]]).unwrap();
        let crc = crc32fast::hash(&[7; 10]);
        assert_eq!(file.read_part(0, 45, 10, crc).unwrap(), [7; 10]);
        file.file.write_all_at(&[8], (HEAD_BYTES + RECORD_BYTES + 50) as u64).unwrap();
        for error in [file.read(0).unwrap_err(), file.read_part(0, 45, 10, crc).unwrap_err()] {
            assert!(matches!(error, Error::Damaged { .. }) && error.to_string().contains("block 0"), "{error}");
        }
    }

    #[test]
    fn a_leftover_of_a_finished_job_is_told_from_work_that_goes_on() {
        let folder = tempfile::tempdir().unwrap();
        let (path, finished) = (folder.path().join("x.part"), folder.path().join("x"));
        let clean = |version: u8| {
            let mark = [&MARK[..7], &[version]].concat().try_into().unwrap();
            ContinuationFile::remove_leftover(&path, mark, 12, &finished);
            !path.exists()
        };
        let file = open(&path, 1).unwrap();
        (0..11).for_each(|key| file.append(key, &[&text(key)]).unwrap());
        fs::write(&finished, "result").unwrap();
        assert!(!clean(b'1'), "a process holds it");
        drop(file);
        assert!(!clean(b'1'), "a key is missing");
        open(&path, 1).unwrap().append(11, &[&text(11)]).unwrap();
        assert!(!clean(b'1'), "it is newer than the result");
        fs::write(&finished, "result").unwrap();
        assert!(!clean(b'2'), "another kind of file");
        assert!(clean(b'1'));
    }

    #[test]
    fn removing_spares_a_file_that_took_the_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x");
        let file = open(&path, 1).unwrap();
        file.append(0, &[b"a"]).unwrap();
        fs::remove_file(&path).unwrap();
        fs::write(&path, "another's").unwrap();
        file.remove().unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "another's");
    }
}
