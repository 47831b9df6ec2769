//! Several lightings and a part of the picture in one pass over the factors: each block is relit under all lightings while
//! it is at hand.

use rayon::prelude::*;

use super::compact::CompactBlock;
use super::cpu::{CpuRelighter, check_columns, relit_planes};
use super::damage::read_undamaged;
use super::lighting::LightingCoefficients;
use super::raw::relit_rows;
use crate::error::{Error, Result};
use crate::light::Lighting;
use crate::matrix::{
    BlockId, BlockSource, CHANNELS, ColumnTransform, FactorSource, MatrixShape, PixelRect, TracedBlock,
};

impl CpuRelighter {
    /// The pixels of `region` under each lighting, one image after the other, each row by row. The bits are those of
    /// [`relight`](Self::relight). A block of which nothing could be read stays as it is in `pixels`.
    ///
    /// # Errors
    /// A lighting with another number of columns than the matrix; a region that is empty or not inside the image;
    /// another number of pixels than lightings × region.
    pub fn relight_region(
        &self,
        lightings: &[Lighting],
        region: PixelRect,
        pixels: &mut [[f32; CHANNELS]],
    ) -> Result<()> {
        let shape = self.shape();
        let planar = planar(shape, lightings, self.column_scales(), self.column_transform())?;
        for_each_part(pixels, lightings.len(), shape, region, |part| {
            if let Some(block) = self.block(part.id) {
                relight_part(block, &planar, part);
            }
            Ok(())
        })
    }
}

/// As [`CpuRelighter::relight_region`], without keeping factors: each thread holds one block at a time.
///
/// # Errors
/// Those of [`CpuRelighter::relight_region`] and of reading, damage among them.
pub fn relight_region_streaming(
    source: &dyn FactorSource,
    lightings: &[Lighting],
    region: PixelRect,
    pixels: &mut [[f32; CHANNELS]],
) -> Result<()> {
    let shape = source.shape();
    let transform = source.column_transform();
    let planar = planar(shape, lightings, source.column_scales(), &transform)?;
    for_each_part(pixels, lightings.len(), shape, region, |part| {
        relight_part(&read_undamaged(source, &transform, part.id)?, &planar, part);
        Ok(())
    })
}

/// As [`CpuRelighter::relight_region`], from the entries of a raw matrix.
///
/// # Errors
/// Those of [`CpuRelighter::relight_region`] and of reading.
pub fn relight_region_raw(
    source: &dyn BlockSource,
    lightings: &[Lighting],
    region: PixelRect,
    pixels: &mut [[f32; CHANNELS]],
) -> Result<()> {
    let shape = source.shape();
    lightings.iter().try_for_each(|lighting| check_columns(shape, lighting))?;
    for_each_part(pixels, lightings.len(), shape, region, |part| {
        let rows = relit_rows(source, part.id, lightings, &mut TracedBlock::default())?;
        rows.iter().enumerate().for_each(|(image, rows)| part.set(image, rows));
        Ok(())
    })
}

fn planar(
    shape: MatrixShape,
    lightings: &[Lighting],
    scales: &[f32],
    transform: &ColumnTransform,
) -> Result<Vec<LightingCoefficients>> {
    lightings.iter().try_for_each(|lighting| check_columns(shape, lighting))?;
    Ok(lightings.iter().map(|lighting| LightingCoefficients::new(lighting, scales, transform)).collect())
}

fn relight_part(block: &CompactBlock, lightings: &[LightingCoefficients], part: &mut RegionPart) {
    let black = vec![0.0; if block.is_empty() { part.rect.rows() } else { 0 }];
    for (image, lighting) in lightings.iter().enumerate() {
        if block.is_empty() {
            part.set(image, &black);
        } else {
            part.set(image, &relit_planes(block, lighting));
        }
    }
}

/// The pixels of one block inside the region, in every image.
struct RegionPart<'a> {
    id: BlockId,
    /// The block's pixels.
    rect: PixelRect,
    /// Where the region's part of it begins, counted in the block.
    x: usize,
    y: usize,
    /// For each image, one slice for each pixel row.
    images: Vec<Vec<&'a mut [[f32; CHANNELS]]>>,
}

impl RegionPart<'_> {
    /// Sets the pixels of one image from the rows of the whole block, channel-planar.
    fn set(&mut self, image: usize, planes: &[f32]) {
        let (width, rows) = (self.rect.width as usize, &mut self.images[image]);
        pulp::Arch::new().dispatch(Interleave { planes, width, x: self.x, y: self.y, rows });
    }
}

/// Sets pixels from planes; compiled for the vectors that the machine has. Not a closure: what wraps one is compiled without
/// them.
struct Interleave<'a, 'b> {
    planes: &'a [f32],
    /// Of the planes, and where in them the pixels begin.
    width: usize,
    x: usize,
    y: usize,
    rows: &'a mut [&'b mut [[f32; CHANNELS]]],
}

impl pulp::NullaryFnOnce for Interleave<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let pixels = self.planes.len() / CHANNELS;
        let (red, rest) = self.planes.split_at(pixels);
        let (green, blue) = rest.split_at(pixels);
        for (y, row) in self.rows.iter_mut().enumerate() {
            let start = (self.y + y) * self.width + self.x;
            let range = start..start + row.len();
            let channels = red[range.clone()].iter().zip(&green[range.clone()]).zip(&blue[range]);
            for (pixel, ((&red, &green), &blue)) in row.iter_mut().zip(channels) {
                *pixel = [red, green, blue];
            }
        }
    }
}

/// Runs `work` on every block that the region touches, on all threads.
fn for_each_part(
    pixels: &mut [[f32; CHANNELS]],
    images: usize,
    shape: MatrixShape,
    region: PixelRect,
    work: impl Fn(&mut RegionPart) -> Result<()> + Sync,
) -> Result<()> {
    let ends = |at: u32, size: u32, limit: u32| size > 0 && at.checked_add(size).is_some_and(|end| end <= limit);
    if !ends(region.x, region.width, shape.width()) || !ends(region.y, region.height, shape.height()) {
        let problem = format!("is not inside the {} × {} pixels", shape.width(), shape.height());
        let place = format!("region {},{},{}x{}", region.x, region.y, region.width, region.height);
        return Err(Error::input(place, problem, ""));
    }
    if pixels.len() != images * region.pixels() {
        let problem = format!("has {} pixels, {} are needed", pixels.len(), images * region.pixels());
        return Err(Error::input("target image", problem, ""));
    }
    let side = shape.block_side();
    // The pixels of each row of blocks, in every image.
    let first = region.y / side;
    let downs = first..(region.y + region.height).div_ceil(side);
    let mut bands: Vec<Vec<&mut [[f32; CHANNELS]]>> = downs.clone().map(|_| Vec::with_capacity(images)).collect();
    for image in pixels.chunks_exact_mut(region.pixels()) {
        let mut rest = image;
        for (down, band) in downs.clone().zip(&mut bands) {
            let rows = ((down + 1) * side).min(region.y + region.height) - (down * side).max(region.y);
            let (these, others) = rest.split_at_mut(rows as usize * region.width as usize);
            band.push(these);
            rest = others;
        }
    }
    let bands: Vec<_> = downs.zip(bands).collect();
    bands.into_par_iter().try_for_each(|(down, band)| {
        parts_of_band(down, band, shape, region).into_par_iter().try_for_each(|mut part| work(&mut part))
    })
}

/// The parts of a row of blocks; `band` has its pixels in every image.
fn parts_of_band<'a>(
    down: u32,
    band: Vec<&'a mut [[f32; CHANNELS]]>,
    shape: MatrixShape,
    region: PixelRect,
) -> Vec<RegionPart<'a>> {
    let side = shape.block_side();
    let part = |across: u32| {
        let id = BlockId(down * shape.blocks_across() + across);
        let rect = shape.rect(id);
        let begin = |at: u32, block: u32| at.saturating_sub(block) as usize;
        let images = band.iter().map(|_| Vec::with_capacity(side as usize)).collect();
        RegionPart { id, rect, x: begin(region.x, rect.x), y: begin(region.y, rect.y), images }
    };
    let mut parts: Vec<RegionPart> = (region.x / side..(region.x + region.width).div_ceil(side)).map(part).collect();
    for (i, image) in band.into_iter().enumerate() {
        for mut row in image.chunks_exact_mut(region.width as usize) {
            for part in &mut parts {
                let end = (part.rect.x + part.rect.width).min(region.x + region.width);
                let (these, rest) = row.split_at_mut((end - part.rect.x.max(region.x)) as usize);
                part.images[i].push(these);
                row = rest;
            }
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::super::random::{Random, random_lighting};
    use super::*;
    use crate::matrix::{ColumnIndex, FactoredBlock, SparseEntry};

    /// Blocks that tell themselves, rows and columns apart.
    struct Source(MatrixShape);

    impl FactorSource for Source {
        fn shape(&self) -> MatrixShape {
            self.0
        }

        fn layer_count(&self, _: BlockId) -> u32 {
            1
        }

        fn encoded_bytes(&self, _: BlockId, _: std::ops::Range<u32>) -> u64 {
            0
        }

        fn read_layers(&self, id: BlockId, _: std::ops::Range<u32>) -> Result<FactoredBlock> {
            let (rows, columns) = (self.0.rect(id).rows(), self.0.columns());
            let left = (0..rows).map(|row| (row + 100 * id.index()) as f32).collect();
            let right = (1..=columns).map(|column| column as f32).collect();
            let sparse = vec![SparseEntry { column: ColumnIndex(1), row: 5, value: -9.0 }];
            Ok(FactoredBlock { rows, columns, left, right, sparse, ..Default::default() })
        }
    }

    impl BlockSource for Source {
        fn shape(&self) -> MatrixShape {
            self.0
        }

        fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> Result<()> {
            target.block = self.read_layers(id, 0..1)?.expand();
            Ok(())
        }
    }

    #[test]
    fn a_region_under_several_lightings_is_cut_out_of_the_images() {
        let shape = MatrixShape::new(29, 22, 3, 8).unwrap();
        let source = Source(shape);
        let lighting = |a: f32| Lighting::new(vec![[a, 1.0, 0.5], [0.0, a, 2.0], [-1.0, 0.25, a]]).unwrap();
        let lightings: Vec<Lighting> = (0..19).map(|i| lighting(1.0 + i as f32 / 7.0)).collect();
        let relighter = CpuRelighter::load(&source).unwrap();
        let raw = super::super::relight_raw(&source, &lightings).unwrap();
        for (x, y, width, height) in [(0, 0, 29, 22), (3, 9, 13, 11), (8, 8, 8, 8), (28, 21, 1, 1), (5, 0, 1, 22)] {
            let region = PixelRect { x, y, width, height };
            let mut pixels = [vec![[9.0; 3]; lightings.len() * region.pixels()], vec![], vec![]];
            pixels[1] = pixels[0].clone();
            pixels[2] = pixels[0].clone();
            relighter.relight_region(&lightings, region, &mut pixels[0]).unwrap();
            relight_region_streaming(&source, &lightings, region, &mut pixels[1]).unwrap();
            relight_region_raw(&source, &lightings, region, &mut pixels[2]).unwrap();
            for (i, lighting) in lightings.iter().enumerate() {
                let whole = relighter.relight(lighting).unwrap();
                for at in 0..region.pixels() {
                    let (from_x, from_y) = (x as usize + at % width as usize, y as usize + at / width as usize);
                    let from = from_y * 29 + from_x;
                    let at = i * region.pixels() + at;
                    assert_eq!(pixels[0][at], whole.pixels[from], "{region:?} {from_x} {from_y}");
                    assert_eq!(pixels[1][at], whole.pixels[from]);
                    assert_eq!(pixels[2][at], raw[i].pixels[from]);
                }
            }
        }
    }

    #[test]
    fn regions_and_targets_that_do_not_fit_are_refused() {
        let shape = MatrixShape::new(20, 10, 3, 8).unwrap();
        let relighter = CpuRelighter::load(&Source(shape)).unwrap();
        let lighting = [Lighting::uniform(3, [1.0; 3]).unwrap()];
        let refused = |x, y, width, height, pixels: usize| {
            let region = PixelRect { x, y, width, height };
            relighter.relight_region(&lighting, region, &mut vec![[0.0; 3]; pixels]).is_err()
        };
        assert!(!refused(0, 0, 20, 10, 200));
        assert!(refused(1, 0, 20, 10, 200) && refused(0, 0, 0, 10, 0) && refused(u32::MAX, 0, 2, 1, 2));
        assert!(refused(0, 0, 20, 10, 199));
        let other = [Lighting::uniform(4, [1.0; 3]).unwrap()];
        let region = PixelRect { x: 0, y: 0, width: 1, height: 1 };
        assert!(relighter.relight_region(&other, region, &mut [[0.0; 3]]).is_err());
    }

    #[test]
    fn a_batch_has_the_bits_of_its_lightings_one_by_one() {
        // Blocks of every kind of edge.
        for (width, height, columns, count) in [(37, 21, 7, 2), (40, 20, 70, 19), (64, 33, 32, 8)] {
            let shape = MatrixShape::new(width, height, columns, 16).unwrap();
            let source = Random(shape);
            let relighter = CpuRelighter::load(&source).unwrap();
            let lightings: Vec<_> = (0..count).map(|seed| random_lighting(shape, seed)).collect();
            let region = PixelRect { x: 0, y: 0, width, height };
            let mut pixels = vec![[9.0; 3]; lightings.len() * region.pixels()];
            relighter.relight_region(&lightings, region, &mut pixels).unwrap();
            for (lighting, pixels) in lightings.iter().zip(pixels.chunks_exact(region.pixels())) {
                assert_eq!(relighter.relight(lighting).unwrap().pixels, pixels);
            }
            let mut streamed = vec![[8.0; 3]; pixels.len()];
            relight_region_streaming(&source, &lightings, region, &mut streamed).unwrap();
            assert_eq!(streamed, pixels);
        }
    }
}
