//! OpenEXR files.

use std::io::{Seek, Write};
use std::path::Path;

use exr::block::writer::ChunksWriter;
use exr::block::{self, UncompressedBlock};
use exr::compression::Compression;
use exr::image::Encoding;
use exr::meta::BlockDescription;
use exr::meta::attribute::{ChannelDescription, LineOrder, SampleType, Text};
use exr::meta::header::Header;
use rayon::prelude::*;

use super::LinearImage;
use crate::error::{Error, Result};
use crate::files::replace;

/// Writes 32-bit linear RGB; a file of that name is replaced, whole.
///
/// # Errors
/// The system refuses to write; then the old file stands.
pub fn write_exr(path: &Path, image: &LinearImage) -> Result<()> {
    let width = image.width as usize;
    let pixel = |x: usize, y: usize| {
        let [r, g, b] = image.pixels[y * width + x];
        (r, g, b)
    };
    let channels = exr::prelude::SpecificChannels::rgb(|at: exr::prelude::Vec2<usize>| pixel(at.x(), at.y()));
    // In this order, for the same bytes however many threads compress.
    let encoding = Encoding { line_order: LineOrder::Increasing, ..Encoding::FAST_LOSSLESS };
    let whole = exr::prelude::Image::from_encoded_channels((width, image.height as usize), encoding, channels);
    replace(path, true, |file| {
        use exr::prelude::WritableImage;
        whole.write().to_buffered(file).map_err(|e| Error::io(path, "write the image")(into_io(e)))
    })
}

/// Size of an image in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageSize {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
}

/// Bytes of memory that [`write_exr_rows`] takes at most: for each thread a chunk as it is read, and as its encoder turns it
/// over.
pub fn exr_rows_need_bytes(layers: usize, size: ImageSize) -> u64 {
    let (lines, _) = chunking(layers * 3, size);
    (lines * line_bytes(layers * 3, size) * 6 * rayon::current_num_threads()) as u64
}

fn line_bytes(channels: usize, size: ImageSize) -> usize {
    size.width * 4 * channels
}

/// Lines of a chunk, and its encoding.
fn chunking(channels: usize, size: ImageSize) -> (usize, Compression) {
    let is_large = 16 * line_bytes(channels, size) > LARGE_CHUNK_BYTES;
    if is_large { (1, Compression::ZIP1) } else { (16, Compression::ZIP16) }
}

/// Gives row `y` of a channel of an image: `(image, channel, y, row)`.
pub type FetchRow<'a> = dyn FnMut(usize, usize, usize, &mut [f32]) -> Result<()> + 'a;

/// Gives row `y` of a channel: `(channel, y, row)`.
pub type FetchChannel<'a> = dyn FnMut(usize, usize, &mut [f32]) -> Result<()> + 'a;

/// Bytes of the longest name of a channel.
const MAX_NAME_BYTES: usize = 255;
/// Chunks of more bytes than this are cut down to one line.
const LARGE_CHUNK_BYTES: usize = 32 << 20;

/// Writes 32-bit linear RGB images as the layers of one part; `fetch` gives their rows as they are needed. A layer's
/// channels are `NAME.R`, `NAME.G`, `NAME.B`, or `R`, `G`, `B` for an empty name, which all programs read. `overwrite`:
/// an existing file is replaced, as a whole.
///
/// # Errors
/// No layers, or two of one name; the file exists and may not be replaced; the system refuses to write; errors of
/// `fetch`. The old file then stays.
pub fn write_exr_rows(
    path: &Path,
    overwrite: bool,
    layers: &[String],
    size: ImageSize,
    fetch: &mut FetchRow<'_>,
) -> Result<()> {
    let mut names = Vec::new();
    for layer in layers {
        let dot = if layer.is_empty() { "" } else { "." };
        names.extend(["R", "G", "B"].map(|colour| format!("{layer}{dot}{colour}")));
    }
    let mut fetch = |channel, y, row: &mut [f32]| fetch(channel / 3, channel % 3, y, row);
    replace(path, overwrite, |file| encode_channels(file, path, &names, size, &mut fetch))
}

/// Writes 32-bit channels of the given names as one part, asking `fetch` for their rows as they are needed.
///
/// A file of that name is replaced, whole.
///
/// # Errors
/// No channels, two of one name; the system refuses to write; those of `fetch`. Then the old file stands.
pub fn write_exr_channels(path: &Path, names: &[String], size: ImageSize, fetch: &mut FetchChannel<'_>) -> Result<()> {
    replace(path, true, |file| encode_channels(file, path, names, size, fetch))
}

fn encode_channels(
    file: impl Write + Seek,
    path: &Path,
    names: &[String],
    size: ImageSize,
    fetch: &mut FetchChannel<'_>,
) -> Result<()> {
    let mut channels: Vec<(&str, usize)> = names.iter().map(String::as_str).zip(0..).collect();
    channels.sort();
    if channels.is_empty() || channels.windows(2).any(|w| w[0].0 == w[1].0) {
        return Err(Error::input(path.display().to_string(), "its layers have no names of their own", ""));
    }
    let described = channels.iter().map(|&(name, _)| {
        // Names are UTF-8, which ends with its first zero.
        let fits = (1..=MAX_NAME_BYTES).contains(&name.len()) && !name.contains('\0');
        let problem = format!("OpenEXR cannot name it so: a name has 1 to {MAX_NAME_BYTES} bytes");
        let refused = || Error::input(format!("layer '{}'", name.escape_debug()), problem, "shorten its name");
        let text = fits.then(|| Text::from_slice_unchecked(name.as_bytes())).ok_or_else(refused)?;
        Ok(ChannelDescription::named(text, SampleType::F32))
    });
    let header = Header::new("".into(), (size.width, size.height), described.collect::<Result<_>>()?);
    let (_, compression) = chunking(channels.len(), size);
    let mut header = header.with_encoding(compression, BlockDescription::ScanLines, LineOrder::Increasing);
    // A single part has no name.
    header.own_attributes.layer_name = None;
    header.own_attributes.software_name = Some(concat!("ltm ", env!("CARGO_PKG_VERSION")).into());
    let mut refused = None;
    let result = block::write(file, [header].into_iter().collect(), true, |meta, writer| {
        let blocks: Vec<_> = block::enumerate_ordered_header_block_indices(&meta.headers).collect();
        // As many chunks at a time as there are threads to compress them.
        for batch in blocks.chunks(rayon::current_num_threads()) {
            let mut raw = Vec::with_capacity(batch.len());
            for &(index, place) in batch {
                let mut row = vec![0.0; size.width];
                let block = UncompressedBlock::from_lines(&meta.headers[0].channels, place, |line| {
                    let (_, channel) = channels[line.location.channel];
                    let fetched = fetch(channel, line.location.position.y(), &mut row);
                    if let Err(error) = fetched {
                        refused.get_or_insert(error);
                    }
                    line.write_samples_from_slice(&row).expect("a row fills its line");
                });
                raw.push((index, block));
            }
            if refused.is_some() {
                return Err(exr::error::Error::Aborted);
            }
            let packed: Vec<_> =
                raw.into_par_iter().map(|(index, block)| (index, block.compress_to_chunk(&meta.headers))).collect();
            for (index, chunk) in packed {
                writer.write_chunk(index, chunk?)?;
            }
        }
        Ok(())
    });
    match refused {
        Some(error) => Err(error),
        None => result.map_err(|e| Error::io(path, "write the image")(into_io(e))),
    }
}

/// Writes one layer for each named image, as [`write_exr_rows`] does.
///
/// # Panics
/// If there are no images; all must have the same size.
///
/// # Errors
/// As [`write_exr_rows`].
pub fn write_exr_layers(path: &Path, images: &[(&str, &LinearImage)]) -> Result<()> {
    let layers: Vec<String> = images.iter().map(|(name, _)| (*name).to_owned()).collect();
    let size = ImageSize { width: images[0].1.width as usize, height: images[0].1.height as usize };
    write_exr_rows(path, true, &layers, size, &mut |image, channel, y, row| {
        let pixels = images[image].1.pixels[y * size.width..].iter();
        row.iter_mut().zip(pixels).for_each(|(value, pixel)| *value = pixel[channel]);
        Ok(())
    })
}

fn into_io(error: exr::error::Error) -> std::io::Error {
    match error {
        exr::error::Error::Io(io) => io,
        other => std::io::Error::other(other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bytes_do_not_depend_on_threads() {
        let pixels = (0..300 * 200u64).map(|i| [i as f32, (i * i % 997) as f32, 0.5]).collect();
        let image = LinearImage { width: 300, height: 200, pixels };
        let folder = tempfile::tempdir().unwrap();
        let written = [1, 3, 3].map(|threads| {
            let path = folder.path().join("image.exr");
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| write_exr(&path, &image)).unwrap();
            std::fs::read(&path).unwrap()
        });
        assert!(written[0] == written[1] && written[1] == written[2]);
    }
}
