//! `.ltc`, whole files: whatever the bytes are, opening and reading them ends, without a panic and without memory that they
//! have not earned.
//!
//! An input is a list of changes to a sound file, (offset, byte) in three bytes each, whose checksums are then made to hold,
//! so that changes get past them; its first byte chooses the file. An input that begins with an odd byte is taken as the file
//! itself. Shared by the fuzz target and by `tests/fuzz.rs`, which needs no fuzzer.

use std::path::Path;
use std::sync::LazyLock;

use ltm::container::ContainerReader;
use ltm::matrix::FactorSource;

/// A file of each coding and version, its metadata laid open so that changes in it are not stopped by its compression.
pub(crate) static SOUND: LazyLock<[Vec<u8>; 6]> = LazyLock::new(|| {
    let files: [&[u8]; 6] = [
        include_bytes!("../../../formats/golden/v1.ltc"),
        include_bytes!("../../../formats/golden/v1-coding-2.ltc"),
        include_bytes!("../../../formats/golden/v1-coding-3.ltc"),
        include_bytes!("../../../formats/golden/v1-coding-4.ltc"),
        include_bytes!("../../../formats/golden/v2.ltc"),
        include_bytes!("../../../formats/golden/v2-column-scales.ltc"),
    ];
    files.map(laid_open)
});
/// Bytes of header and trailer, of a block's record, of a layer's.
pub(crate) const ENDS: usize = 64;
const BLOCK_RECORD: usize = 32;
const LAYER_RECORD: usize = 16;

/// Reads what an input stands for, all of it, through a file at `path`. Returns whether it opened.
pub(crate) fn look(input: &[u8], path: &Path) -> bool {
    let bytes = match input.split_first() {
        Some((kind, rest)) if kind % 2 == 1 => rest.to_vec(),
        Some((kind, rest)) => {
            let mut bytes = SOUND[usize::from(kind / 2) % SOUND.len()].clone();
            for change in rest.chunks_exact(3) {
                let offset = usize::from(u16::from_le_bytes([change[0], change[1]]));
                if let Some(byte) = bytes.get_mut(offset) {
                    *byte = change[2];
                }
            }
            seal(&mut bytes);
            bytes
        }
        None => return false,
    };
    std::fs::write(path, &bytes).expect("the folder can be written");
    let Ok(reader) = ContainerReader::open(path) else { return false };
    let records = reader.shape().blocks().filter(|&id| reader.has_block(id)).count();
    assert!(records <= bytes.len() / BLOCK_RECORD && reader.base_bytes() <= bytes.len() as u64);
    let found = reader.verify(|_| true);
    assert!(found.blocks as usize == records && found.faults.len() <= records + 1);
    for id in reader.shape().blocks() {
        let _ = (reader.block_report(id), reader.rank(id), reader.sparse_entries(id));
        for layer in 0..reader.layer_count(id) {
            if let Ok(block) = reader.read_layers(id, layer..layer + 1) {
                assert_eq!((block.rows, block.columns), (reader.shape().rect(id).rows(), reader.shape().columns()));
            }
        }
    }
    true
}

/// Offsets of the metadata, the block records and the layer records, as the trailer has them.
pub(crate) fn parts(bytes: &[u8]) -> [usize; 3] {
    let trailer = bytes.len() - ENDS;
    let metadata = number(bytes, trailer + 24);
    let blocks = metadata.saturating_add(number(bytes, trailer + 20));
    [metadata, blocks, blocks.saturating_add(number(bytes, trailer + 12).saturating_mul(BLOCK_RECORD))]
}

fn number(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().expect("4 bytes")) as usize
}

/// The file with its metadata unpacked. Before them stand, in version 1, the lengths of job and report, in version 2 the length of
/// all sections, and then whether they are compressed.
fn laid_open(file: &[u8]) -> Vec<u8> {
    let [metadata, blocks, _] = parts(file);
    let trailer = file.len() - ENDS;
    let lengths = if number(file, 8) == 1 { 8 } else { 4 };
    let (flag, body) = (metadata + lengths, metadata + lengths + 4);
    let mut bytes = file[..body].to_vec();
    match number(file, flag) {
        1 => {
            let unpacked = (metadata..flag).step_by(4).map(|at| number(file, at)).sum();
            bytes.extend(zstd::bulk::decompress(&file[body..blocks], unpacked).expect("the file is sound"));
        }
        _ => bytes.extend(&file[body..blocks]),
    }
    bytes[flag] = 0;
    let metadata_bytes = (bytes.len() - metadata) as u32;
    bytes.extend(&file[blocks..]);
    let (end, length) = (bytes.len() - (file.len() - trailer), bytes.len() as u64);
    bytes[end + 20..end + 24].copy_from_slice(&metadata_bytes.to_le_bytes());
    bytes[end + 32..end + 40].copy_from_slice(&length.to_le_bytes());
    seal(&mut bytes);
    bytes
}

/// Makes the checksums of the header, the chunks, the index and the trailer hold, as far as the parts are inside the file.
fn seal(bytes: &mut [u8]) {
    let trailer = bytes.len() - ENDS;
    let put = |bytes: &mut [u8], at: usize, crc: u32| bytes[at..at + 4].copy_from_slice(&crc.to_le_bytes());
    let header = crc32fast::hash(&bytes[..60]);
    put(bytes, 60, header);
    put(bytes, trailer + 44, header);
    let [metadata, _, layers] = parts(bytes);
    for record in (layers..trailer.saturating_sub(LAYER_RECORD - 1)).step_by(LAYER_RECORD) {
        let (offset, length) = (number(bytes, record), number(bytes, record + 8));
        if let Some(chunk) = bytes.get(offset..offset.saturating_add(length)) {
            let crc = crc32fast::hash(chunk);
            put(bytes, record + 12, crc);
        }
    }
    if let Some(tail) = bytes.get(metadata..trailer) {
        let crc = crc32fast::hash(tail);
        put(bytes, trailer + 40, crc);
    }
    let crc = crc32fast::hash(&bytes[trailer..trailer + 60]);
    put(bytes, trailer + 60, crc);
}
