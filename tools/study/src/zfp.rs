//! zfp (Lindstrom 2014) as a general-purpose rival: each colour of each block is an array over pixels and texels, in four
//! dimensions, of one absolute tolerance; zstd takes what zfp leaves of empty cells.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::Path;

use zfp_rs::{ZfpBitStream, ZfpBitStreamRef, ZfpConfig, ZfpField, ZfpFieldMut, ZfpScalarType};

use super::dct::grids;
use super::factors::{assemble, relit_block};
use super::rivals::ZSTD_LEVEL;
use ltm::error::{Error, Result};
use ltm::image::LinearImage;
use ltm::light::{LightBasis, Lighting};
use ltm::matrix::{BlockSource, BlockView, CHANNELS, MatrixShape, PixelRect, TracedBlock};
use ltm::store::StoreReader;

/// One colour of a block's columns under one grid of texels.
#[derive(Clone, Copy)]
struct Part {
    rect: PixelRect,
    /// Texels across and down.
    grid: (usize, usize),
    /// Of its first entry in the block.
    first: usize,
}

/// Every colour of a block under every grid.
fn parts(rect: PixelRect, lights: &LightBasis) -> Vec<Part> {
    let mut parts = Vec::new();
    let mut column = 0;
    for grid in grids(lights) {
        for channel in 0..CHANNELS {
            parts.push(Part { rect, grid, first: column * rect.rows() + channel * rect.pixels() });
        }
        column += grid.0 * grid.1;
    }
    parts
}

impl Part {
    /// Along the image, down it, along the light, and down it where it has more than a row.
    fn dimensions(self) -> usize {
        if self.grid.1 > 1 { 4 } else { 3 }
    }

    fn sizes(self) -> [usize; 4] {
        [self.rect.width as usize, self.rect.height as usize, self.grid.0, self.grid.1]
    }

    fn strides(self) -> [isize; 4] {
        let rows = self.rect.rows();
        [1, self.rect.width as usize, rows, rows * self.grid.0].map(|n| n as isize)
    }

    /// `None` where the library refuses, which no block of a matrix makes it do.
    fn encode(self, entries: &[f32], config: &ZfpConfig) -> Option<Vec<u8>> {
        let (entries, sizes, strides) = (&entries[self.first..], self.sizes(), self.strides());
        let (field, most) = match self.dimensions() {
            4 => (ZfpField::new_strided(entries, sizes, strides), config.maximum_size(ZfpScalarType::F32, sizes)),
            _ => {
                let (sizes, strides) = ([sizes[0], sizes[1], sizes[2]], [strides[0], strides[1], strides[2]]);
                (ZfpField::new_strided(entries, sizes, strides), config.maximum_size(ZfpScalarType::F32, sizes))
            }
        };
        let mut stream = ZfpBitStream::new(most?).ok()?;
        stream.compress(config, &field.ok()?).ok()?;
        Some(stream.as_bytes().to_vec())
    }

    /// `None` where the bytes are not such a part's.
    fn decode(self, bytes: &[u8], entries: &mut [f32], config: &ZfpConfig) -> Option<()> {
        let (entries, sizes, strides) = (&mut entries[self.first..], self.sizes(), self.strides());
        let mut words = vec![0u64; bytes.len().div_ceil(8)];
        bytemuck::cast_slice_mut(&mut words)[..bytes.len()].copy_from_slice(bytes);
        let field = match self.dimensions() {
            4 => ZfpFieldMut::new_strided(entries, sizes, strides),
            _ => {
                ZfpFieldMut::new_strided(entries, [sizes[0], sizes[1], sizes[2]], [strides[0], strides[1], strides[2]])
            }
        };
        ZfpBitStreamRef::from_words(&words).decompress(config, &mut field.ok()?).ok().map(drop)
    }
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
        for part in parts(source.shape().rect(id), &source.job().basis) {
            let bytes = part
                .encode(traced.block.entries(), &config)
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
        for part in parts(rect, lights) {
            let mut length = [0; 4];
            file.read_exact(&mut length).map_err(failed())?;
            let mut bytes = vec![0; u32::from_le_bytes(length) as usize];
            file.read_exact(&mut bytes).map_err(failed())?;
            part.decode(&bytes, &mut entries, &config)
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
        lights.push(Light::unplaced("panel", LightKind::AreaTexels { across: 6, down: 4 })).unwrap();
        for name in ["a", "b", "c", "d", "e", "f"] {
            lights.push(Light::unplaced(name, LightKind::Point)).unwrap();
        }
        let rect = PixelRect { x: 0, y: 0, width: 7, height: 3 };
        let entries: Vec<f32> = (0..63 * 30).map(|i| (i as f32 * 0.37).sin() + (i / 63) as f32).collect();
        let config = ZfpConfig::fixed_accuracy(tolerance);
        let mut back = vec![f32::NAN; entries.len()];
        for part in parts(rect, &lights) {
            let bytes = part.encode(&entries, &config).unwrap();
            part.decode(&bytes, &mut back, &config).unwrap();
        }
        entries.iter().zip(&back).for_each(|(a, b)| assert!(f64::from((a - b).abs()) <= tolerance, "{a} {b}"));
    }
}
