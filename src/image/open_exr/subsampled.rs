//! Chunks whose channels have fewer samples than pixels, which the decoder's library does not unpack by itself.

use exr::block::chunk::{Chunk, CompressedBlock};
use exr::compression::Compression;
use exr::error::{Error, Result};
use exr::meta::MetaData;
use exr::meta::attribute::{ChannelList, IntegerBounds};
use exr::meta::header::Header;
use exr::prelude::Vec2;

/// Whether a part has such channels.
pub(super) fn is_subsampled(header: &Header) -> bool {
    header.channels.list.iter().any(|channel| channel.sampling != Vec2(1, 1))
}

/// The rows of a chunk: for each row of its pixels, from the top, the samples of the channels that have some there.
///
/// # Errors
/// A chunk that is damaged or lies outside its part; a compression for which this is not known.
pub(super) fn decompress(chunk: Chunk, meta: &MetaData) -> Result<(IntegerBounds, Vec<u8>)> {
    let header = meta.headers.get(chunk.layer_index).ok_or_else(|| Error::Invalid("chunk layer index".into()))?;
    let place = header.get_block_data_indices(&chunk.compressed_block)?;
    let section = header.get_absolute_block_pixel_coordinates(place)?;
    section.validate(Some(header.layer_size))?;
    let CompressedBlock::ScanLine(block) = chunk.compressed_block else {
        return Err(Error::NotSupported("subsampled channels in tiles".into()));
    };
    let bytes = bytes_of(&header.channels, section);
    if bytes == 0 {
        return Ok((section, Vec::new()));
    }
    let mut header = header.clone();
    let (area, mut unpacked) = (section.size.area(), section);
    match header.compression {
        // These pack bytes of whatever meaning.
        Compression::Uncompressed | Compression::RLE | Compression::ZIP1 | Compression::ZIP16 => {
            (header.layer_size, header.channels.bytes_per_pixel) = (Vec2(bytes, header.layer_size.height()), 1);
            unpacked = IntegerBounds { position: Vec2(0, 0), size: Vec2(bytes, 1) };
        }
        // This goes by channels, and counts their samples.
        Compression::PIZ if bytes.is_multiple_of(area) => header.channels.bytes_per_pixel = bytes / area,
        other => return Err(Error::NotSupported(format!("subsampled channels with {other}").into())),
    }
    let compression = header.compression;
    let data = compression.decompress_image_section_from_le(&header, block.compressed_pixels_le, unpacked, false)?;
    Ok((section, data))
}

/// Samples of a channel in a row of a section; none where the row has none.
pub(super) fn samples_in_row(sampling: Vec2<usize>, section: IntegerBounds, row: usize) -> usize {
    let has_row = (section.position.y() as usize + row).is_multiple_of(sampling.y().max(1));
    if has_row { section.size.width() / sampling.x().max(1) } else { 0 }
}

fn bytes_of(channels: &ChannelList, section: IntegerBounds) -> usize {
    let rows = 0..section.size.height();
    let of_row = |row| {
        let channels = channels.list.iter();
        channels
            .map(move |c| samples_in_row(c.sampling, section, row) * c.sample_type.bytes_per_sample())
            .sum::<usize>()
    };
    rows.map(of_row).sum()
}
