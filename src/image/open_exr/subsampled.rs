//! Channels with fewer samples than pixels, which the decoding library does not support. The library gets a header in
//! which all channels have a sample for each pixel, and their chunks are unpacked here.

use std::io::{BufRead, BufReader, Read, Result as IoResult, Seek, SeekFrom};

use exr::block::chunk::{Chunk, CompressedBlock};
use exr::compression::Compression;
use exr::error::{Error, Result};
use exr::meta::MetaData;
use exr::meta::attribute::{ChannelList, IntegerBounds};
use exr::meta::header::Header;
use exr::prelude::Vec2;

/// Whether a part has subsampled channels.
pub(super) fn is_subsampled(header: &Header) -> bool {
    header.channels.list.iter().any(|channel| channel.sampling != Vec2(1, 1))
}

/// Bytes of the sampling of a channel in the file: two numbers, 1 and 1.
const ONE_EACH: [u8; 8] = [1, 0, 0, 0, 1, 0, 0, 0];
/// Longest name, as in the format, and most parts and attributes that are looked through.
const MAX_NAME_BYTES: u64 = 256;
const MAX_ATTRIBUTES: usize = 1 << 16;
/// Bit of the version of files of several parts.
const SEVERAL_PARTS: u32 = 1 << 12;

/// A file whose channels seem to have a sample for each pixel.
pub(super) struct FullySampled<R> {
    inner: R,
    at: u64,
    /// Offsets of the sampling fields of channels.
    places: Vec<u64>,
}

impl<R: Read + Seek> FullySampled<R> {
    /// Looks through the headers of a file.
    ///
    /// # Errors
    /// They cannot be read.
    pub(super) fn new(mut inner: R) -> IoResult<Self> {
        let places = samplings(&mut BufReader::new(&mut inner))?;
        inner.seek(SeekFrom::Start(0))?;
        Ok(Self { inner, at: 0, places })
    }
}

impl<R: Read> Read for FullySampled<R> {
    fn read(&mut self, buffer: &mut [u8]) -> IoResult<usize> {
        let count = self.inner.read(buffer)?;
        let first = self.places.partition_point(|place| place + 8 <= self.at);
        for place in self.places[first..].iter().take_while(|place| **place < self.at + count as u64) {
            for (offset, byte) in (0..).zip(ONE_EACH) {
                let inside = (place + offset).checked_sub(self.at).map(|at| at as usize).filter(|at| *at < count);
                inside.into_iter().for_each(|at| buffer[at] = byte);
            }
        }
        self.at += count as u64;
        Ok(count)
    }
}

impl<R: Seek> Seek for FullySampled<R> {
    fn seek(&mut self, to: SeekFrom) -> IoResult<u64> {
        self.at = self.inner.seek(to)?;
        Ok(self.at)
    }
}

/// Where the samplings of all channels stand in a file.
fn samplings(file: &mut (impl BufRead + Seek)) -> IoResult<Vec<u64>> {
    let mut places = Vec::new();
    // Magic and version, then headers up to an empty one; a file of one part has one.
    file.seek(SeekFrom::Start(4))?;
    let has_parts = number(file)? & SEVERAL_PARTS != 0;
    let mut is_empty = !has_parts;
    for _ in 0..MAX_ATTRIBUTES {
        if name(file)?.is_empty() {
            if is_empty {
                break;
            }
            is_empty = true;
            continue;
        }
        is_empty &= !has_parts;
        let kind = name(file)?;
        let size = u64::from(number(file)?);
        let start = file.stream_position()?;
        if kind == b"chlist" {
            while !name(file)?.is_empty() {
                file.seek_relative(8)?;
                places.push(file.stream_position()?);
                file.seek_relative(8)?;
            }
        }
        file.seek(SeekFrom::Start(start + size))?;
    }
    Ok(places)
}

/// A text up to its zero.
fn name(file: &mut impl BufRead) -> IoResult<Vec<u8>> {
    let mut bytes = Vec::new();
    file.take(MAX_NAME_BYTES).read_until(0, &mut bytes)?;
    if bytes.pop() == Some(0) { Ok(bytes) } else { Err(std::io::ErrorKind::InvalidData.into()) }
}

fn number(file: &mut impl Read) -> IoResult<u32> {
    let mut bytes = [0; 4];
    file.read_exact(&mut bytes)?;
    Ok(u32::from_le_bytes(bytes))
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
