//! A matrix as a web page; `formats/share.md` defines every byte.
//!
//! The page is one HTML file that needs only its data file. The data come in the order in which a browser needs them: a
//! header, a small *preview* of the whole image, the base layers of all blocks, and their refinements. Chunks are those
//! of the container, byte for byte, since no compression built into browsers comes near their size; the page decodes
//! them in a worker. Preview and image are two [`Level`]s of one kind.
//!
//! The page's sources are plain JavaScript modules, with types in comments that the TypeScript compiler checks, so that
//! building needs no Node; [`page()`] joins them into one script.

mod base64;
mod head;
mod level;
mod page;

pub use head::{SharedLook, SharedPicture, head_json};
pub use level::Level;
pub use page::{page, page_with_data};

use std::io::Write;

use flate2::Compression;
use flate2::write::DeflateEncoder;

use crate::error::{Error, Result};

/// First bytes of a file of shared data.
pub const MAGIC: [u8; 8] = *b"\x89LTS\r\n\x1a\n";
/// Version of the format.
pub const FORMAT_VERSION: u32 = 1;
/// Bytes before the head: magic, version, length and checksum of the head.
const START_BYTES: usize = 20;

/// Sizes of what was written, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SharedBytes {
    /// The whole file.
    pub total: u64,
    /// From its start to the end of the preview's base layers: what a first whole picture takes.
    pub to_preview: u64,
    /// From its start to the end of the base layers.
    pub to_base: u64,
}

/// Writes the data of a page: head, preview, and the layers of the picture. `advance` hears of each chunk's bytes.
///
/// # Errors
/// Those of reading the levels and of writing; a chunk of more than 2³² bytes.
pub fn write_data(
    picture: &SharedPicture<'_>,
    preview: &Level<'_>,
    whole: &Level<'_>,
    out: &mut dyn Write,
    failed: &dyn Fn(std::io::Error) -> Error,
    advance: &mut dyn FnMut(u64) -> Result<()>,
) -> Result<SharedBytes> {
    let head = deflate(head_json(picture, preview, whole).as_bytes());
    let mut start = MAGIC.to_vec();
    start.extend(FORMAT_VERSION.to_le_bytes());
    start.extend((head.len() as u32).to_le_bytes());
    start.extend(crc32fast::hash(&head).to_le_bytes());
    debug_assert_eq!(start.len(), START_BYTES);
    out.write_all(&start).and_then(|()| out.write_all(&head)).map_err(failed)?;
    let mut bytes = SharedBytes { total: (START_BYTES + head.len()) as u64, to_preview: 0, to_base: 0 };
    for (level, is_preview) in [(preview, true), (whole, false)] {
        for (index, layer) in level.layers().iter().enumerate() {
            out.write_all(&layer.index).map_err(failed)?;
            bytes.total += layer.index.len() as u64;
            level.chunks(index as u32, &mut |chunk| {
                out.write_all(chunk).map_err(failed)?;
                bytes.total += chunk.len() as u64;
                advance(chunk.len() as u64)
            })?;
            if index == 0 {
                *(if is_preview { &mut bytes.to_preview } else { &mut bytes.to_base }) = bytes.total;
            }
        }
    }
    Ok(bytes)
}

/// Deflated without a header, as `DecompressionStream("deflate-raw")` reads it.
fn deflate(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).and_then(|()| encoder.finish()).expect("memory takes all that is written to it")
}
