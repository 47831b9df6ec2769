//! The values of channels, line by line, in the order of the file.

use std::io::{BufReader, Read, Seek};
use std::path::Path;

use exr::block::UncompressedBlock;
use exr::block::chunk::Chunk;
use exr::block::reader::ChunksReader;
use exr::meta::MetaData;
use exr::meta::attribute::SampleType;
use exr::prelude::f16;
use rayon::prelude::*;

use super::channels::ChannelPlace;
use super::subsampled::{FullySampled, decompress, is_subsampled, samples_in_row};
use super::{failed, read_meta};
use crate::error::{Error, Hint, Result};
use crate::files::open_input;
use crate::image::rgba::refuse;

/// A piece of a row of one channel.
pub(in crate::image) struct ExrLine<'a> {
    pub(in crate::image) place: ChannelPlace,
    /// Column of the first value and row, from the corner of the data window.
    pub(in crate::image) x: usize,
    pub(in crate::image) y: usize,
    pub(in crate::image) values: &'a [f32],
}

/// Bytes of the largest chunk of a file.
pub(in crate::image) fn chunk_bytes(meta: &MetaData) -> u64 {
    meta.headers.iter().map(|header| header.max_block_byte_size() as u64).max().unwrap_or(0)
}

/// Rows of pixels of a chunk: those of the library's layout, or of subsampled channels.
enum ChunkRows {
    Plain(UncompressedBlock),
    Subsampled(usize, exr::meta::attribute::IntegerBounds, Vec<u8>),
}

/// Hands over the lines of the channels that are wanted; of levels of detail the finest only. `counts` are the channels of
/// each part, as they were seen before.
///
/// # Errors
/// A file that cannot be read or has changed; those of `take`.
pub(in crate::image) fn read_lines(
    path: &Path,
    counts: &[usize],
    wanted: &dyn Fn(ChannelPlace) -> bool,
    take: &mut dyn FnMut(ExrLine<'_>) -> Result<()>,
) -> Result<()> {
    let sampled = read_meta(path)?;
    if sampled.headers.iter().any(is_subsampled) {
        let file = FullySampled::new(open_input(path, "open")?).map_err(Error::io(path, "read"))?;
        return read_from(BufReader::new(file), &sampled, path, counts, wanted, take);
    }
    read_from(BufReader::new(open_input(path, "open")?), &sampled, path, counts, wanted, take)
}

/// See [`read_lines`]; `sampled` has the samplings of the channels, and which parts and channels there are.
fn read_from(
    file: impl Read + Seek,
    sampled: &MetaData,
    path: &Path,
    counts: &[usize],
    wanted: &dyn Fn(ChannelPlace) -> bool,
    take: &mut dyn FnMut(ExrLine<'_>) -> Result<()>,
) -> Result<()> {
    let reader = exr::block::read(file, false).map_err(|e| failed(path, e))?;
    if reader.headers().iter().map(|h| h.channels.list.len()).ne(counts.iter().copied()) {
        return Err(Error::input(path.display().to_string(), "changed while it was read", Hint::Repeat));
    }
    let parts: Vec<bool> =
        counts.iter().enumerate().map(|(part, &count)| (0..count).any(|channel| wanted((part, channel)))).collect();
    let mut chunks = reader
        .filter_chunks(false, |_, tile, block| parts[block.layer] && (tile.level_index.0, tile.level_index.1) == (0, 0))
        .map_err(|e| failed(path, e))?;
    let mut meta = chunks.meta_data().clone();
    for (header, other) in meta.headers.iter_mut().zip(&sampled.headers) {
        let size = (header.layer_size.0, header.layer_size.1);
        for (channel, other) in header.channels.list.iter_mut().zip(&other.channels.list) {
            channel.sampling = other.sampling;
            let (across, down) = (channel.sampling.0.max(1), channel.sampling.1.max(1));
            if !size.0.is_multiple_of(across) || !size.1.is_multiple_of(down) {
                return Err(refuse(path, "its samples of chroma do not fill its data window"));
            }
        }
    }
    let subsampled: Vec<bool> = meta.headers.iter().map(is_subsampled).collect();
    let unpacked = |chunk: exr::error::Result<Chunk>| -> exr::error::Result<ChunkRows> {
        let chunk = chunk?;
        let part = chunk.layer_index;
        if subsampled.get(part).copied().unwrap_or(false) {
            return decompress(chunk, &meta).map(|(section, data)| ChunkRows::Subsampled(part, section, data));
        }
        UncompressedBlock::decompress_chunk(chunk, &meta, false).map(ChunkRows::Plain)
    };
    let mut values = Vec::new();
    // As many chunks at a time as there are threads. The library's own parallel decoder would start one thread for each
    // core, and hold more chunks than that, whatever the pool.
    loop {
        let batch: Vec<_> = chunks.by_ref().take(rayon::current_num_threads()).collect();
        if batch.is_empty() {
            return Ok(());
        }
        let blocks: Vec<_> = batch.into_par_iter().map(unpacked).collect();
        for block in blocks {
            let block = block.map_err(|e| failed(path, e))?;
            hand_over(&meta, &block, wanted, &mut values, take)?;
        }
    }
}

fn hand_over(
    meta: &MetaData,
    block: &ChunkRows,
    wanted: &dyn Fn(ChannelPlace) -> bool,
    values: &mut Vec<f32>,
    take: &mut dyn FnMut(ExrLine<'_>) -> Result<()>,
) -> Result<()> {
    match block {
        ChunkRows::Plain(block) => {
            let part = block.index.layer;
            let channels = &meta.headers[part].channels;
            for line in block.lines(channels) {
                let place = (part, line.location.channel);
                if wanted(place) {
                    decode(line.value, channels.list[place.1].sample_type, values);
                    let (x, y) = (line.location.position.x(), line.location.position.y());
                    take(ExrLine { place, x, y, values })?;
                }
            }
        }
        ChunkRows::Subsampled(part, section, data) => {
            let mut rest = data.as_slice();
            let (x, top) = (section.position.x() as usize, section.position.y() as usize);
            for row in 0..section.size.height() {
                for (channel, stored) in meta.headers[*part].channels.list.iter().enumerate() {
                    let samples = samples_in_row(stored.sampling, *section, row);
                    let (bytes, after) = rest.split_at(samples * stored.sample_type.bytes_per_sample());
                    rest = after;
                    if samples > 0 && wanted((*part, channel)) {
                        decode(bytes, stored.sample_type, values);
                        take(ExrLine { place: (*part, channel), x, y: top + row, values })?;
                    }
                }
            }
        }
    }
    Ok(())
}

fn decode(bytes: &[u8], kind: SampleType, values: &mut Vec<f32>) {
    values.clear();
    match kind {
        SampleType::F16 => values.extend(bytes.as_chunks::<2>().0.iter().map(|v| f16::from_ne_bytes(*v).to_f32())),
        SampleType::F32 => values.extend(bytes.as_chunks::<4>().0.iter().map(|v| f32::from_ne_bytes(*v))),
        SampleType::U32 => values.extend(bytes.as_chunks::<4>().0.iter().map(|v| u32::from_ne_bytes(*v) as f32)),
    }
}
