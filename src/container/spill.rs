//! Where encoded blocks wait until the container is assembled: a file beside the final one, `NAME.part`, to which each
//! block is appended as one checked record. A killed pack continues from it.

use std::fs::{File, OpenOptions};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use super::format::{BLOCK_RECORD_BYTES, BlockRecord, MAX_LAYERS, u32_at};
use crate::error::{Error, Result};
use crate::matrix::BlockId;

const MAGIC: [u8; 8] = *b"LTCpart1";
/// What stands before the records of a file of [`open_marked`].
pub(crate) const MARK_BYTES: u64 = 40;
/// Block id, lengths of the layers, the block's record, CRC-32 of the layers, CRC-32 of all this.
const RECORD_BYTES: usize = 4 + 4 * MAX_LAYERS + BLOCK_RECORD_BYTES + 4 + 4;

/// One block in the spill file.
#[derive(Clone, Debug)]
pub(super) struct Spilled {
    pub(super) record: BlockRecord,
    /// Bytes of each layer.
    pub(super) layer_bytes: Vec<u32>,
    /// Offset of the first layer in the spill file.
    pub(super) offset: u64,
}

/// The spill file, locked for this process while it is open.
#[derive(Debug)]
pub(super) struct Spill {
    path: PathBuf,
    file: File,
    end: u64,
    blocks: Vec<Option<Spilled>>,
}

impl Spill {
    /// Opens the spill file for a container at `path`, continuing an earlier one if it was begun with the same
    /// `fingerprint`, and starting anew otherwise. Errors: another process writes it.
    pub(super) fn open(path: &Path, fingerprint: [u8; 32], block_count: usize) -> Result<Self> {
        let mut name = path.as_os_str().to_owned();
        name.push(".part");
        let path = PathBuf::from(name);
        let (file, continued) = open_marked(&path, MAGIC, fingerprint, "another process is packing into it")?;
        let mut spill = Self { path, file, end: MARK_BYTES, blocks: vec![None; block_count] };
        if continued {
            spill.recover()?;
        }
        Ok(spill)
    }

    /// Takes up every whole record and cuts off what follows the last of them.
    fn recover(&mut self) -> Result<()> {
        let length = self.file.metadata().map_err(self.failed("read"))?.len();
        let mut bytes = [0; RECORD_BYTES];
        while self.end + RECORD_BYTES as u64 <= length {
            self.file.read_exact_at(&mut bytes, self.end).map_err(self.failed("read"))?;
            let Some((id, spilled, crc)) = decode_record(&bytes, self.end) else { break };
            let payload_bytes = spilled.layer_bytes.iter().map(|&b| u64::from(b)).sum::<u64>();
            if id.index() >= self.blocks.len() || spilled.offset + payload_bytes > length {
                break;
            }
            let mut payload = vec![0; payload_bytes as usize];
            self.file.read_exact_at(&mut payload, spilled.offset).map_err(self.failed("read"))?;
            if crc32fast::hash(&payload) != crc {
                break;
            }
            self.end = spilled.offset + payload_bytes;
            self.blocks[id.index()] = Some(spilled);
        }
        self.file.set_len(self.end).map_err(self.failed("shorten"))
    }

    /// Appends a block. A block that is written again replaces the earlier one.
    pub(super) fn append(&mut self, id: BlockId, record: BlockRecord, layers: &[Vec<u8>]) -> Result<()> {
        let mut bytes = vec![0; RECORD_BYTES];
        bytes[..4].copy_from_slice(&id.0.to_le_bytes());
        for (place, layer) in bytes[4..].chunks_exact_mut(4).zip(layers) {
            place.copy_from_slice(&(layer.len() as u32).to_le_bytes());
        }
        let at = 4 + 4 * MAX_LAYERS;
        bytes[at..at + BLOCK_RECORD_BYTES].copy_from_slice(&record.encode());
        let payload = layers.concat();
        bytes[RECORD_BYTES - 8..RECORD_BYTES - 4].copy_from_slice(&crc32fast::hash(&payload).to_le_bytes());
        let crc = crc32fast::hash(&bytes[..RECORD_BYTES - 4]);
        bytes[RECORD_BYTES - 4..].copy_from_slice(&crc.to_le_bytes());
        bytes.extend(payload);
        self.file.write_all_at(&bytes, self.end).map_err(self.failed("write"))?;
        let layer_bytes = layers.iter().map(|layer| layer.len() as u32).collect();
        let offset = self.end + RECORD_BYTES as u64;
        self.blocks[id.index()] = Some(Spilled { record, layer_bytes, offset });
        self.end += bytes.len() as u64;
        Ok(())
    }

    /// The blocks, in order.
    pub(super) fn blocks(&self) -> &[Option<Spilled>] {
        &self.blocks
    }

    /// Reads bytes of the spill file.
    pub(super) fn read(&self, offset: u64, bytes: usize) -> Result<Vec<u8>> {
        let mut buffer = vec![0; bytes];
        self.file.read_exact_at(&mut buffer, offset).map_err(self.failed("read"))?;
        Ok(buffer)
    }

    /// Removes the file.
    pub(super) fn remove(self) -> Result<()> {
        std::fs::remove_file(&self.path).map_err(Error::io(&self.path, "remove"))
    }

    fn failed(&self, action: &str) -> impl FnOnce(std::io::Error) -> Error + use<> {
        Error::io(self.path.clone(), action.to_owned())
    }
}

impl Drop for Spill {
    fn drop(&mut self) {
        // Nobody would continue from nothing.
        if self.blocks.iter().all(Option::is_none) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Opens a file that a stopped job continues from, locked for this process: as it is, and `true`, if it begins with this
/// mark and fingerprint, else emptied and begun with them.
///
/// Errors: the folder cannot be written; another process holds the file (`held` says so).
pub(crate) fn open_marked(path: &Path, mark: [u8; 8], fingerprint: [u8; 32], held: &str) -> Result<(File, bool)> {
    let file = OpenOptions::new()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .open(path)
        .map_err(Error::io(path, "create"))?;
    file.try_lock().map_err(|_| Error::input(path.display().to_string(), held, "wait for it or stop it"))?;
    let mut header = [0; MARK_BYTES as usize];
    header[..8].copy_from_slice(&mark);
    header[8..].copy_from_slice(&fingerprint);
    let mut found = [0; MARK_BYTES as usize];
    let continued = file.read_exact_at(&mut found, 0).is_ok() && found == header;
    if !continued {
        file.set_len(0).and_then(|()| file.write_all_at(&header, 0)).map_err(Error::io(path, "write"))?;
    }
    Ok((file, continued))
}

fn decode_record(bytes: &[u8; RECORD_BYTES], at: u64) -> Option<(BlockId, Spilled, u32)> {
    if crc32fast::hash(&bytes[..RECORD_BYTES - 4]) != u32_at(bytes, RECORD_BYTES - 4) {
        return None;
    }
    let record = BlockRecord::decode(&bytes[4 + 4 * MAX_LAYERS..][..BLOCK_RECORD_BYTES])?;
    let layer_bytes = (0..usize::from(record.layers)).map(|i| u32_at(bytes, 4 + 4 * i)).collect();
    let spilled = Spilled { record, layer_bytes, offset: at + RECORD_BYTES as u64 };
    Some((BlockId(u32_at(bytes, 0)), spilled, u32_at(bytes, RECORD_BYTES - 8)))
}
