//! A file written again with other values in some of its channels, and all else as it is.

use std::collections::HashMap;
use std::io::BufReader;
use std::path::Path;

use exr::block::chunk::Chunk;
use exr::block::reader::ChunksReader;
use exr::block::writer::ChunksWriter;
use exr::block::{self, UncompressedBlock};
use exr::meta::MetaData;
use exr::meta::attribute::SampleType;
use exr::prelude::f16;
use rayon::prelude::*;

use super::channels::ChannelPlace;
use super::subsampled::is_subsampled;
use super::{failed, read_meta};
use crate::error::{Error, Hint, Result};
use crate::files::{open_input, replace};

/// Gives new values of a piece of a row of a channel, whose column and row are counted from the corner of the data window; what is
/// not set stays as it is.
pub(in crate::image) type NewLine<'a> = dyn FnMut(ChannelPlace, (usize, usize), &mut [f32]) -> Result<()> + 'a;

/// The numbers of the chunks of a part, by their tile and its level of detail.
type Order = HashMap<[usize; 4], usize>;

/// Writes the file at `from` again at `to`, with the values that `fill` gives of the channels that `is_changed` chooses. Parts without
/// such a channel are copied as they are stored; names, types, compression, tiles and attributes of all parts stay.
///
/// # Errors
/// A file that cannot be read or has changed; channels to be changed that have levels of detail, are subsampled, or hold integers; a
/// file with deep or subsampled parts; a compression that is not known; those of `fill`; the system refuses to write.
pub(in crate::image) fn rewrite_lines(
    from: &Path,
    to: &Path,
    overwrite: bool,
    is_changed: &dyn Fn(ChannelPlace) -> bool,
    fill: &mut NewLine<'_>,
) -> Result<()> {
    let meta = read_meta(from)?;
    let parts = changed_parts(from, &meta, is_changed)?;
    let reader = block::read(BufReader::new(open_input(from, "open")?), false).map_err(|e| failed(from, e))?;
    if reader.headers().len() != meta.headers.len() {
        return Err(Error::input(from.display().to_string(), "changed while it was read", Hint::Repeat));
    }
    let mut chunks = reader.all_chunks(false).map_err(|e| failed(from, e))?;
    let meta = chunks.meta_data().clone();
    let orders: Vec<Order> = meta.headers.iter().map(order_of).collect();
    let mut refused = None;
    replace(to, overwrite, |file| {
        let written = block::write(file, meta.headers.clone(), false, |_, writer| {
            loop {
                let batch: Vec<_> = chunks.by_ref().take(rayon::current_num_threads()).collect();
                if batch.is_empty() {
                    return Ok(());
                }
                let unpacked = |chunk| unpack(chunk, &meta, &orders, &parts);
                let mut unpacked: Vec<_> =
                    batch.into_par_iter().map(unpacked).collect::<exr::error::Result<Vec<_>>>()?;
                for block in unpacked.iter_mut().filter_map(|(_, content)| content.as_mut().err()) {
                    if let Err(error) = change(&meta, block, is_changed, fill) {
                        refused = Some(error);
                        return Err(exr::error::Error::Aborted);
                    }
                }
                let packed: Vec<_> = unpacked
                    .into_par_iter()
                    .map(|(index, content)| {
                        let chunk = content.or_else(|block| block.compress_to_chunk(&meta.headers))?;
                        Ok((index, chunk))
                    })
                    .collect::<exr::error::Result<_>>()?;
                packed.into_iter().try_for_each(|(index, chunk)| writer.write_chunk(index, chunk))?;
            }
        });
        match refused.take() {
            Some(error) => Err(error),
            None => written.map_err(|e| failed(from, e)),
        }
    })
}

/// The errors of [`rewrite_lines`] that are known from the file's header.
///
/// # Errors
/// Those of reading the header; what cannot be written.
pub(in crate::image) fn check_lines(from: &Path, is_changed: &dyn Fn(ChannelPlace) -> bool) -> Result<()> {
    changed_parts(from, &read_meta(from)?, is_changed).map(drop)
}

/// Which parts have channels that are changed.
fn changed_parts(from: &Path, meta: &MetaData, is_changed: &dyn Fn(ChannelPlace) -> bool) -> Result<Vec<bool>> {
    let refuse = |problem: &str, hint: &str| Err(Error::input(from.display().to_string(), problem, hint));
    let mut parts = Vec::new();
    for (part, header) in meta.headers.iter().enumerate() {
        let list = &header.channels.list;
        let changed: Vec<_> = (0..list.len()).filter(|&channel| is_changed((part, channel))).collect();
        if header.deep || is_subsampled(header) {
            return refuse("has deep or subsampled parts, which are not written", "leave them out of the file");
        }
        if changed.iter().any(|&channel| list[channel].sample_type == SampleType::U32) {
            return refuse("holds lights in integers", "write them as floats");
        }
        if !changed.is_empty() && header.blocks.has_tiles() && header.chunk_count != finest(header) {
            return refuse("has levels of detail, which would show the old picture", "write it without mip maps");
        }
        parts.push(!changed.is_empty());
    }
    Ok(parts)
}

/// Number of chunks of the finest level of a part.
fn finest(header: &exr::meta::header::Header) -> usize {
    header.blocks_increasing_y_order().filter(|tile| tile.location.level_index == exr::prelude::Vec2(0, 0)).count()
}

fn order_of(header: &exr::meta::header::Header) -> Order {
    let tiles = header.blocks_increasing_y_order().map(|tile| {
        let (at, level) = (tile.location.tile_index, tile.location.level_index);
        [at.0, at.1, level.0, level.1]
    });
    tiles.zip(0..).collect()
}

/// A chunk's number in its part; the chunk itself where it stays as it is, else its values.
type Unpacked = (usize, Result<Chunk, UncompressedBlock>);

fn unpack(
    chunk: exr::error::Result<Chunk>,
    meta: &MetaData,
    orders: &[Order],
    parts: &[bool],
) -> exr::error::Result<Unpacked> {
    let chunk = chunk?;
    let part = chunk.layer_index;
    let invalid = || exr::error::Error::Invalid("chunk of a part that is not there".into());
    let (header, order) = meta.headers.get(part).zip(orders.get(part)).ok_or_else(invalid)?;
    let place = header.get_block_data_indices(&chunk.compressed_block)?;
    let (at, level) = (place.tile_index, place.level_index);
    let index = *order.get(&[at.0, at.1, level.0, level.1]).ok_or_else(invalid)?;
    if !parts[part] {
        return Ok((index, Ok(chunk)));
    }
    Ok((index, Err(UncompressedBlock::decompress_chunk(chunk, meta, false)?)))
}

/// Puts the new values into a block.
fn change(
    meta: &MetaData,
    block: &mut UncompressedBlock,
    is_changed: &dyn Fn(ChannelPlace) -> bool,
    fill: &mut NewLine<'_>,
) -> Result<()> {
    let part = block.index.layer;
    let list = &meta.headers[part].channels.list;
    let (corner, size) = (block.index.pixel_position, block.index.pixel_size);
    let mut values = vec![0.0; size.0];
    let mut begin = 0;
    for y in 0..size.1 {
        for (channel, description) in list.iter().enumerate() {
            let each = description.sample_type.bytes_per_sample();
            let bytes = begin..begin + each * size.0;
            begin = bytes.end;
            let place = (part, channel);
            if !is_changed(place) {
                continue;
            }
            let stored = &mut block.data[bytes];
            let is_half = description.sample_type == SampleType::F16;
            for (value, word) in values.iter_mut().zip(stored.chunks_exact(each)) {
                *value = match *word {
                    [a, b] => f16::from_ne_bytes([a, b]).to_f32(),
                    [a, b, c, d] => f32::from_ne_bytes([a, b, c, d]),
                    _ => unreachable!("values have two or four bytes"),
                };
            }
            fill(place, (corner.0, corner.1 + y), &mut values)?;
            for (value, word) in values.iter().zip(stored.chunks_exact_mut(each)) {
                if is_half {
                    word.copy_from_slice(&f16::from_f32(*value).to_ne_bytes());
                } else {
                    word.copy_from_slice(&value.to_ne_bytes());
                }
            }
        }
    }
    Ok(())
}
