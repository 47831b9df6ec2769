//! zfp (Lindstrom 2014) as a general-purpose rival: each colour of each block is an array over pixels and texels, in four
//! dimensions, of one absolute tolerance; zstd takes what zfp leaves of empty cells.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::Path;

use zfp_rs::{ZfpBitStream, ZfpBitStreamRef, ZfpConfig, ZfpField, ZfpFieldMut, ZfpScalarType};

use super::dct::layout;
use super::factors::{assemble, relit_block};
use super::rivals::ZSTD_LEVEL;
use ltm::error::{Error, Result};
use ltm::image::LinearImage;
use ltm::light::{LightBasis, Lighting};
use ltm::matrix::{BlockSource, BlockView, CHANNELS, MatrixShape, PixelRect, TracedBlock};
use ltm::store::StoreReader;

/// Sizes and strides of one colour of a block: along the image, down it, along the light, down it.
fn array(rect: PixelRect, lights: &LightBasis) -> ([usize; 4], [isize; 4]) {
    let (across, down) = layout(lights);
    let (width, rows) = (rect.width as usize, rect.rows());
    ([width, rect.height as usize, across, down], [1, width, rows, rows * across].map(|n| n as isize))
}

/// One colour of a block, coded. `None` where the library refuses, which no block of a matrix makes it do.
fn encode(
    entries: &[f32],
    channel: usize,
    rect: PixelRect,
    lights: &LightBasis,
    config: &ZfpConfig,
) -> Option<Vec<u8>> {
    let (sizes, strides) = array(rect, lights);
    let field = ZfpField::new_strided(&entries[channel * rect.pixels()..], sizes, strides).ok()?;
    let mut stream = ZfpBitStream::new(config.maximum_size(ZfpScalarType::F32, sizes)?).ok()?;
    stream.compress(config, &field).ok()?;
    Some(stream.as_bytes().to_vec())
}

/// Sets one colour of a block. `None` where the bytes are not such a colour's.
fn decode(
    bytes: &[u8],
    entries: &mut [f32],
    channel: usize,
    rect: PixelRect,
    lights: &LightBasis,
    config: &ZfpConfig,
) -> Option<()> {
    let (sizes, strides) = array(rect, lights);
    let mut words = vec![0u64; bytes.len().div_ceil(8)];
    bytemuck::cast_slice_mut(&mut words)[..bytes.len()].copy_from_slice(bytes);
    let mut field = ZfpFieldMut::new_strided(&mut entries[channel * rect.pixels()..], sizes, strides).ok()?;
    ZfpBitStreamRef::from_words(&words).decompress(config, &mut field).ok().map(drop)
}

/// Writes `source` with an absolute `tolerance`.
pub(super) fn write(source: &StoreReader, tolerance: f32, path: &Path) -> Result<()> {
    let failed = || Error::io(path, "write");
    let file = BufWriter::new(File::create(path).map_err(Error::io(path, "create"))?);
    let mut file = zstd::Encoder::new(file, ZSTD_LEVEL).map_err(failed())?;
    let config = ZfpConfig::fixed_accuracy(f64::from(tolerance));
    let mut traced = TracedBlock::default();
    for id in source.shape().blocks() {
        source.read_block(id, &mut traced)?;
        let rect = source.shape().rect(id);
        for channel in 0..CHANNELS {
            let bytes = encode(traced.block.entries(), channel, rect, &source.job().basis, &config)
                .ok_or_else(|| Error::input(id.to_string(), "zfp refuses it", "this is a fault of the program"))?;
            file.write_all(&(bytes.len() as u32).to_le_bytes()).map_err(failed())?;
            file.write_all(&bytes).map_err(failed())?;
        }
    }
    file.finish().and_then(|mut file| file.flush()).map_err(failed())
}

/// The images of a file under lightings.
pub(super) fn read(
    path: &Path,
    tolerance: f32,
    shape: MatrixShape,
    lights: &LightBasis,
    lightings: &[Lighting],
) -> Result<Vec<LinearImage>> {
    let failed = || Error::io(path, "read");
    let file = File::open(path).map_err(failed())?;
    let mut file = zstd::Decoder::new(BufReader::new(file)).map_err(failed())?;
    let config = ZfpConfig::fixed_accuracy(f64::from(tolerance));
    let mut relit = Vec::new();
    for id in shape.blocks() {
        let rect = shape.rect(id);
        let mut entries = vec![0.0f32; rect.rows() * shape.columns()];
        for channel in 0..CHANNELS {
            let mut length = [0; 4];
            file.read_exact(&mut length).map_err(failed())?;
            let mut bytes = vec![0; u32::from_le_bytes(length) as usize];
            file.read_exact(&mut bytes).map_err(failed())?;
            decode(&bytes, &mut entries, channel, rect, lights, &config)
                .ok_or_else(|| Error::damaged(path, "does not decode", "run the study again"))?;
        }
        relit.push(relit_block(BlockView::new(rect.rows(), shape.columns(), &entries), lightings));
    }
    Ok(assemble(shape, lightings.len(), &relit))
}

/// The largest entry of a matrix: what tolerances are measured by.
pub(super) fn scale(source: &StoreReader) -> Result<f32> {
    let mut traced = TracedBlock::default();
    let mut largest = 0.0f32;
    for id in source.shape().blocks() {
        source.read_block(id, &mut traced)?;
        largest = traced.block.entries().iter().fold(largest, |most, v| most.max(v.abs()));
    }
    Ok(largest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ltm::light::{Light, LightKind};

    #[test]
    fn every_entry_is_within_the_tolerance() {
        let tolerance = 0.01;
        let mut lights = LightBasis::new();
        lights.push(Light::unplaced("panel", LightKind::AreaTexels { across: 6, down: 5 })).unwrap();
        let rect = PixelRect { x: 0, y: 0, width: 7, height: 3 };
        let entries: Vec<f32> = (0..63 * 30).map(|i| (i as f32 * 0.37).sin() + (i / 63) as f32).collect();
        let config = ZfpConfig::fixed_accuracy(tolerance);
        let mut back = vec![f32::NAN; entries.len()];
        for channel in 0..CHANNELS {
            let bytes = encode(&entries, channel, rect, &lights, &config).unwrap();
            decode(&bytes, &mut back, channel, rect, &lights, &config).unwrap();
        }
        entries.iter().zip(&back).for_each(|(a, b)| assert!(f64::from((a - b).abs()) <= tolerance, "{a} {b}"));
    }
}
