//! Shards: a range of blocks built by one machine of a farm, as one file that never changes.
//!
//! For each block of its range a shard has one record or several, what the next round needs of the block: the inputs of the
//! denoiser ([`denoise`](crate::denoise)), denoised images, the analysed candidate ([`pipeline`](crate::pipeline)), or coded
//! layers. The first records of all blocks stand together, then the second ones, so that who needs one kind reads one stretch. A
//! summary of the range stands before them. `docs/guide/farm.md` has the bytes. The name states what the shard is made from, the
//! range and the content: `PLAN-FIRST-END-SHA256` with the extension of its round.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{Read, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use sha2::{Digest, Sha256};

use crate::error::{Error, Result};
use crate::files::{ContinuationFile, Ranged};

/// Magic bytes of a shard; the last is the version of the format.
const MARK: [u8; 8] = *b"LTMshrd2";
/// Written in the machine's byte order, to detect it when reading.
const BYTE_ORDER: u32 = 0x0102_0304;
const HEAD_BYTES: usize = 128;
const PLACE_BYTES: usize = 16;
/// Bytes read at a time for hashing.
const STEP_BYTES: usize = 1 << 18;

/// Head of a shard.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ShardHead {
    /// Hash of the job.
    pub(crate) job: [u8; 32],
    /// Hash of the job, the settings and the versions of everything that takes part.
    pub(crate) fingerprint: [u8; 32],
    pub(crate) blocks: Range<u32>,
    /// Records of each block.
    pub(crate) parts: u32,
    /// Rays traced, and contributions that were not finite.
    pub(crate) rays: u64,
    pub(crate) non_finite: u64,
}

/// What a shard is written of.
pub(crate) struct ShardContent<'a> {
    /// The record of part `p` of block `b` has the key `p · stride + b − first`.
    pub(crate) records: &'a ContinuationFile,
    pub(crate) stride: u32,
    pub(crate) first: u32,
    /// What is said of the range as a whole.
    pub(crate) summary: &'a [u8],
    /// Extension of the name.
    pub(crate) extension: &'a str,
}

/// Position of a record, or of the summary, in its shard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RecordPlace {
    offset: u64,
    bytes: u64,
    checksum: u32,
}

/// Prefix of the names of shards of a plan.
pub(crate) fn plan_prefix(fingerprint: &str) -> String {
    fingerprint.chars().take(16).collect::<String>() + "-"
}

/// Prefix of the names of shards of a range of a plan.
pub(crate) fn range_prefix(fingerprint: &str, blocks: &Range<u32>) -> String {
    format!("{}{:08}-{:08}-", plan_prefix(fingerprint), blocks.start, blocks.end)
}

impl ShardHead {
    /// Name of the shard that [`write`](Self::write) writes.
    ///
    /// # Errors
    /// Those of reading the records.
    pub(crate) fn name(&self, content: &ShardContent<'_>) -> Result<String> {
        let mut hash = Hasher(Sha256::new());
        self.write(content, "its name", &mut hash)?;
        Ok(range_prefix(&hex(&self.fingerprint), &self.blocks) + &hex(&hash.0.finalize()) + content.extension)
    }

    /// Writes the shard, called `name` in messages: the head, the places, the summary, and the records, part by part in the order
    /// of the blocks.
    ///
    /// # Errors
    /// Those of reading the records and of writing.
    pub(crate) fn write(&self, content: &ShardContent<'_>, name: &str, out: &mut dyn Write) -> Result<()> {
        let ShardContent { records, stride, first, summary, .. } = *content;
        let key_of = move |part: u32, block: u32| part * stride + (block - first);
        let keys = || (0..self.parts).flat_map(|part| self.blocks.clone().map(move |block| key_of(part, block)));
        let mut index = Vec::with_capacity(self.index_bytes() as usize);
        let mut file_bytes = HEAD_BYTES as u64 + self.index_bytes();
        let mut place = |bytes: u64, checksum: u32| {
            index.extend(bytes.to_ne_bytes());
            index.extend(checksum.to_ne_bytes());
            index.extend([0; 4]);
            file_bytes += bytes;
        };
        place(summary.len() as u64, crc32fast::hash(summary));
        for key in keys() {
            let (bytes, checksum) = records.length_and_checksum(key)?;
            place(bytes, checksum);
        }
        let failed = |error| Error::io(name, "write")(error);
        let before = [&self.encode(file_bytes, &index)[..], &index, summary];
        before.into_iter().try_for_each(|bytes| out.write_all(bytes)).map_err(failed)?;
        let mut bytes = Vec::new();
        for key in keys() {
            records.read_into(key, &mut bytes)?;
            out.write_all(&bytes).map_err(failed)?;
        }
        Ok(())
    }

    /// Bytes of the places: of the summary, and of each record.
    fn index_bytes(&self) -> u64 {
        let records = u64::from(self.parts).saturating_mul(u64::from(self.blocks.end - self.blocks.start));
        records.saturating_add(1).saturating_mul(PLACE_BYTES as u64)
    }

    fn encode(&self, file_bytes: u64, index: &[u8]) -> [u8; HEAD_BYTES] {
        let mut head = [0; HEAD_BYTES];
        let numbers = [self.rays, self.non_finite, file_bytes];
        let range = [self.blocks.start, self.blocks.end];
        let parts: [&[u8]; 7] = [
            &MARK,
            &BYTE_ORDER.to_ne_bytes(),
            &self.parts.to_ne_bytes(),
            &self.job,
            &self.fingerprint,
            bytemuck::bytes_of(&range),
            bytemuck::bytes_of(&numbers),
        ];
        let bytes = parts.concat();
        head[..bytes.len()].copy_from_slice(&bytes);
        let mut check = Sha256::new();
        check.update(&head[..bytes.len()]);
        check.update(index);
        head[bytes.len()..HEAD_BYTES].copy_from_slice(&check.finalize()[..HEAD_BYTES - bytes.len()]);
        head
    }

    /// Reads only the head of a shard. An invalid one gives its fault as text.
    ///
    /// # Errors
    /// It cannot be read.
    pub(crate) fn of(file: &dyn Ranged, place: &Path) -> Result<Result<Self, String>> {
        Ok(Reading::head(file, place)?.map(|(head, _)| head))
    }

    /// Reads head and positions. Invalid ones give their fault as text.
    fn read(file: &mut dyn Read, file_bytes: u64) -> Result<(Self, Vec<RecordPlace>), String> {
        let short = |_| "it is cut short".to_owned();
        let mut head = [0; HEAD_BYTES];
        file.read_exact(&mut head).map_err(short)?;
        if head[..7] != MARK[..7] {
            return Err("it is no shard".to_owned());
        }
        let word = |at: usize| u32::from_ne_bytes(head[at..at + 4].try_into().expect("4 bytes"));
        let long = |at: usize| u64::from_ne_bytes(head[at..at + 8].try_into().expect("8 bytes"));
        if head[7] != MARK[7] {
            return Err(format!("it is of version {} of the format, not of {}", head[7] as char, MARK[7] as char));
        }
        if word(8) != BYTE_ORDER {
            return Err("it was built on a machine of another byte order".to_owned());
        }
        let hash = |at: usize| head[at..at + 32].try_into().expect("32 bytes");
        let (parts, first, end) = (word(12), word(80), word(84));
        let this = Self {
            job: hash(16),
            fingerprint: hash(48),
            blocks: first..end.max(first),
            parts,
            rays: long(88),
            non_finite: long(96),
        };
        // Checked before memory is allocated for the positions.
        let index_bytes = this.index_bytes();
        if first >= end || parts == 0 || long(104) != file_bytes || index_bytes > file_bytes {
            return Err("its head does not fit its length".to_owned());
        }
        let mut index = vec![0; index_bytes as usize];
        file.read_exact(&mut index).map_err(short)?;
        if this.encode(file_bytes, &index) != head {
            return Err("the checksum of its head does not hold".to_owned());
        }
        let mut offset = HEAD_BYTES as u64 + index_bytes;
        let mut places = Vec::with_capacity(index.len() / PLACE_BYTES);
        for place in index.chunks_exact(PLACE_BYTES) {
            let bytes = u64::from_ne_bytes(place[..8].try_into().expect("8 bytes"));
            let checksum = u32::from_ne_bytes(place[8..12].try_into().expect("4 bytes"));
            places.push(RecordPlace { offset, bytes, checksum });
            offset = offset.checked_add(bytes).ok_or("its places do not fit its length")?;
        }
        if offset != file_bytes {
            return Err("its places do not fit its length".to_owned());
        }
        Ok((this, places))
    }
}

/// Hashes what is written to it.
struct Hasher(Sha256);

impl Write for Hasher {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// Bytes as hexadecimal digits.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Reads a ranged source sequentially.
struct Reading<'a> {
    file: &'a dyn Ranged,
    offset: u64,
    length: u64,
    /// Distinguishes a shard that cannot be read from one that is cut short.
    failed: Option<std::io::Error>,
}

impl<'a> Reading<'a> {
    /// Head and positions of a shard. An invalid one gives its fault as text.
    fn head(file: &'a dyn Ranged, place: &Path) -> Result<Result<(ShardHead, Vec<RecordPlace>), String>> {
        let length = file.bytes().map_err(Error::io(place, "look at"))?;
        let mut reading = Self { file, offset: 0, length, failed: None };
        let head = ShardHead::read(&mut reading, length);
        reading.failed.map_or(Ok(head), |error| Err(Error::io(place, "read")(error)))
    }
}

impl Read for Reading<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let step = (self.length - self.offset).min(buffer.len() as u64) as usize;
        if let Err(error) = self.file.fill(&mut buffer[..step], self.offset) {
            self.failed = Some(error);
            return Err(std::io::ErrorKind::Other.into());
        }
        self.offset += step as u64;
        Ok(step)
    }
}

/// A shard whose head was read.
pub(crate) struct Shard {
    /// What messages call it.
    place: PathBuf,
    /// Its name in a depot, where it is read there.
    name: Option<String>,
    pub(crate) head: ShardHead,
    /// Of the summary, then of the records.
    places: Vec<RecordPlace>,
}

impl Shard {
    /// Reads a local shard completely and checks it against its name. An invalid one gives its fault as text.
    ///
    /// # Errors
    /// The system refuses to read.
    pub(crate) fn open(path: &Path, name: &str) -> Result<Result<Self, String>> {
        let file = File::open(path).map_err(Error::io(path, "open"))?;
        Ok(Self::verify(&file, path, name)?.map(|shard| Self { name: None, ..shard }))
    }

    /// Reads the head of a shard of a depot. An invalid one gives its fault as text.
    ///
    /// # Errors
    /// It cannot be read.
    pub(crate) fn look(file: &dyn Ranged, place: &Path, name: &str) -> Result<Result<Self, String>> {
        let parts = Reading::head(file, place)?;
        Ok(parts.map(|(head, places)| Self { place: place.to_owned(), name: Some(name.to_owned()), head, places }))
    }

    /// Reads a shard completely, local or not, and checks it against its name. An invalid one gives its fault as text.
    /// `place` names it in messages.
    ///
    /// # Errors
    /// It cannot be read.
    pub(crate) fn verify(file: &dyn Ranged, place: &Path, name: &str) -> Result<Result<Self, String>> {
        let failed = || Error::io(place, "read");
        let length = file.bytes().map_err(failed())?;
        let shard = match Self::look(file, place, name)? {
            Ok(shard) => shard,
            Err(problem) => return Ok(Err(problem)),
        };
        let mut hash = Sha256::new();
        let (mut buffer, mut offset) = (vec![0; STEP_BYTES], 0);
        while offset < length {
            let step = (length - offset).min(STEP_BYTES as u64) as usize;
            file.fill(&mut buffer[..step], offset).map_err(failed())?;
            hash.update(&buffer[..step]);
            offset += step as u64;
        }
        let expected = range_prefix(&hex(&shard.head.fingerprint), &shard.head.blocks) + &hex(&hash.finalize());
        let is_named = name.strip_prefix(&expected).is_some_and(|rest| rest.starts_with('.'));
        if !is_named {
            return Ok(Err("its content is not that of its name: it was changed, or renamed".to_owned()));
        }
        Ok(Ok(shard))
    }

    /// The summary of its range.
    ///
    /// # Errors
    /// It cannot be read, or its checksum does not hold.
    pub(crate) fn summary(&self, file: &dyn Ranged) -> Result<Vec<u8>> {
        read_place(file, &self.place, "its summary", self.places[0])
    }
}

/// Reads what stands at a position; `what` is said in messages.
fn read_place(file: &dyn Ranged, path: &Path, what: &str, place: RecordPlace) -> Result<Vec<u8>> {
    let mut bytes = vec![0; place.bytes as usize];
    file.fill(&mut bytes, place.offset).map_err(Error::io(path, format!("read {what}")))?;
    match crc32fast::hash(&bytes) == place.checksum {
        true => Ok(bytes),
        false => Err(Error::damaged(path, format!("{what}: its checksum does not hold"), MERGE_AGAIN)),
    }
}

/// What helps against a shard that was changed.
const MERGE_AGAIN: &str = "merge again: what the shard lacks is listed then";

/// Opens a file of a depot by its name.
pub(crate) type Opener = Arc<dyn Fn(&str) -> Result<Box<dyn Ranged>> + Send + Sync>;

/// Files of a depot that are held open, the last used last: opening one is a request, and each keeps what it read ahead.
const HELD_OPEN: usize = 4;

/// Records of blocks of a matrix, each read from the first shard that has it.
pub(crate) struct ShardSet {
    /// Address of the depot, for messages.
    address: String,
    blocks: u32,
    shards: Vec<(PathBuf, Option<String>)>,
    /// For each key, `part · blocks + block`, the shard and the position in it.
    places: Vec<Option<(u32, RecordPlace)>>,
    opener: Option<Opener>,
    held: Mutex<VecDeque<(u32, Arc<dyn Ranged>)>>,
}

impl ShardSet {
    /// An empty set of local shards.
    pub(crate) fn new(address: &str, blocks: u32) -> Self {
        Self {
            address: address.to_owned(),
            blocks,
            shards: Vec::new(),
            places: vec![None; blocks as usize],
            opener: None,
            held: Mutex::default(),
        }
    }

    /// An empty set of shards that are read where they lie.
    pub(crate) fn in_depot(address: &str, blocks: u32, opener: Opener) -> Self {
        Self { opener: Some(opener), ..Self::new(address, blocks) }
    }

    /// Adds a shard of the same matrix. If its record of a block differs from that of an earlier shard, returns the
    /// block and that shard.
    pub(crate) fn add(&mut self, shard: Shard) -> Option<(u32, &Path)> {
        let number = self.shards.len() as u32;
        self.shards.push((shard.place, shard.name));
        let keys = (self.blocks as usize).saturating_mul(shard.head.parts as usize);
        self.places.resize(self.places.len().max(keys), None);
        let mut differs = None;
        let blocks = self.blocks;
        let keys =
            (0..shard.head.parts).flat_map(|part| shard.head.blocks.clone().map(move |b| (b, part * blocks + b)));
        for ((block, key), &place) in keys.zip(&shard.places[1..]) {
            match self.places.get_mut(key as usize) {
                Some(Some((other, known))) if (known.bytes, known.checksum) != (place.bytes, place.checksum) => {
                    differs = differs.or(Some((block, *other)));
                }
                Some(empty @ None) => *empty = Some((number, place)),
                _ => {}
            }
        }
        differs.map(|(key, other)| (key, &*self.shards[other as usize].0))
    }

    /// Address of the depot, for messages.
    pub(crate) fn address(&self) -> &str {
        &self.address
    }

    pub(crate) fn has(&self, key: u32) -> bool {
        self.places.get(key as usize).is_some_and(Option::is_some)
    }

    /// Blocks that no shard has, as ranges.
    pub(crate) fn missing(&self) -> Vec<Range<u32>> {
        let mut ranges: Vec<Range<u32>> = Vec::new();
        for key in (0..self.blocks).filter(|&key| !self.has(key)) {
            match ranges.last_mut() {
                Some(last) if last.end == key => last.end += 1,
                _ => ranges.push(key..key + 1),
            }
        }
        ranges
    }

    /// # Errors
    /// It is not there, cannot be read, or was changed since its shard was verified.
    pub(crate) fn read(&self, key: u32) -> Result<Vec<u8>> {
        let Some((shard, place)) = self.places.get(key as usize).copied().flatten() else {
            return Err(self.damaged(key, "it is not there"));
        };
        let (path, what) = (&self.shards[shard as usize].0, format!("block {}", key % self.blocks));
        let file = self.open(shard)?;
        read_place(&*file, path, &what, place)
    }

    fn open(&self, shard: u32) -> Result<Arc<dyn Ranged>> {
        let (path, name) = &self.shards[shard as usize];
        let (Some(opener), Some(name)) = (&self.opener, name) else {
            let file = File::open(path).map_err(Error::io(path, "open"))?;
            return Ok(Arc::new(file));
        };
        let lock = || self.held.lock().unwrap_or_else(PoisonError::into_inner);
        let find = |held: &VecDeque<(u32, Arc<dyn Ranged>)>| held.iter().position(|(number, _)| *number == shard);
        let mut held = lock();
        if let Some(found) = find(&held).and_then(|at| held.remove(at)) {
            held.push_back(found.clone());
            return Ok(found.1);
        }
        drop(held);
        let file: Arc<dyn Ranged> = Arc::from(opener(name)?);
        let mut held = lock();
        if held.len() >= HELD_OPEN {
            held.pop_front();
        }
        held.push_back((shard, Arc::clone(&file)));
        Ok(file)
    }

    /// The error for a record that differs from what was built.
    pub(crate) fn damaged(&self, key: u32, problem: &str) -> Error {
        let path = match self.places.get(key as usize).copied().flatten() {
            Some((shard, _)) => self.shards[shard as usize].0.clone(),
            None => PathBuf::from(&self.address),
        };
        Error::damaged(path, format!("block {}: {problem}", key % self.blocks), MERGE_AGAIN)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_head_is_as_documented() {
        let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/guide/farm.md")).unwrap();
        let rows = text.lines().skip_while(|line| *line != "| offset | size | field | value |").skip(2);
        let number = |cell: Option<&str>| cell.unwrap().trim().parse::<usize>().unwrap();
        let fields: Vec<(usize, usize, String)> = rows
            .take_while(|line| line.starts_with('|'))
            .map(|line| {
                let mut cells = line.split('|').skip(1);
                (number(cells.next()), number(cells.next()), cells.next().unwrap().trim().to_owned())
            })
            .collect();
        let end = fields.iter().fold(0, |end, (offset, size, field)| {
            assert_eq!(*offset, end, "{field}");
            offset + size
        });
        assert_eq!(end, HEAD_BYTES);
        let (job, fingerprint) = ([1; 32], [2; 32]);
        let head = ShardHead { job, fingerprint, blocks: 3..4, parts: 7, rays: 5 << 40, non_finite: 6 << 40 };
        // A place of the summary, and one for each record.
        let index = [0; 8 * PLACE_BYTES];
        let bytes = head.encode((HEAD_BYTES + index.len()) as u64, &index);
        let at = |name: &str| {
            let (offset, size, _) = fields.iter().find(|(_, _, field)| field == name).unwrap();
            &bytes[*offset..offset + size]
        };
        assert_eq!((at("mark"), at("byte order")), (&MARK[..], &BYTE_ORDER.to_ne_bytes()[..]));
        assert_eq!((at("job hash"), at("fingerprint")), (&[1; 32][..], &[2; 32][..]));
        assert_eq!((at("first block"), at("end of the blocks")), (&3u32.to_ne_bytes()[..], &4u32.to_ne_bytes()[..]));
        assert_eq!((at("rays"), at("not finite")), (&(5u64 << 40).to_ne_bytes()[..], &(6u64 << 40).to_ne_bytes()[..]));
        assert_eq!(at("parts"), &7u32.to_ne_bytes()[..]);
        assert_eq!(at("file bytes"), &((HEAD_BYTES + index.len()) as u64).to_ne_bytes()[..]);
        let file = [&bytes[..], &index].concat();
        let (read, places) = ShardHead::read(&mut &*file, file.len() as u64).unwrap();
        assert_eq!((read, places.len()), (head, 8));
        for cut in 0..file.len() {
            assert!(ShardHead::read(&mut &file[..cut], cut as u64).is_err());
        }
    }
}
