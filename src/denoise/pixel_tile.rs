//! Tiles of pixels that are filtered at once. Their weights and inputs fit the processor's caches.

use pulp::Simd;

use super::image_rows::ImageRows;

/// Offset in pixels, across and down.
pub(super) type Offset = (isize, isize);

/// Width of a tile in pixels; divisible by two vectors of any supported width.
pub(super) const TILE_WIDTH: usize = 32;
/// Height of a tile in pixels.
pub(super) const TILE_HEIGHT: usize = 32;
/// Pixels of a tile.
pub(super) const TILE_PIXELS: usize = TILE_WIDTH * TILE_HEIGHT;
/// Values after the last pixel that a vector load may touch.
const SLACK: usize = 16;

/// Origin of a tile in pixels. The tile may extend beyond the image.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PixelTile {
    pub(super) x: usize,
    pub(super) y: usize,
}

/// Pixels of several planes within a radius of a tile. Beyond the image and its held rows, the border values are
/// repeated.
#[derive(Default)]
pub(super) struct TileWindow {
    reach: usize,
    stride: usize,
    rows: usize,
    values: Vec<f32>,
}

impl TileWindow {
    /// Values from one row to the next.
    pub(super) fn stride(reach: usize) -> usize {
        TILE_WIDTH + 2 * reach + SLACK
    }

    /// Copies the pixels of `planes` within `reach` of a tile.
    pub(super) fn fill(
        &mut self,
        image: &ImageRows,
        planes: impl IntoIterator<Item = usize>,
        tile: PixelTile,
        reach: usize,
    ) {
        self.reach = reach;
        self.stride = Self::stride(reach);
        self.rows = TILE_HEIGHT + 2 * reach;
        self.values.clear();
        let (width, held) = (image.width(), image.held());
        // Pixel `i` of a row here is pixel `tile.x + i − reach` of the image.
        let before = reach.saturating_sub(tile.x);
        let first = (tile.x + before - reach).min(width - 1);
        let inside = (self.stride - before).min(width - first);
        let planes = planes.into_iter();
        self.values.reserve(planes.size_hint().0 * self.plane_length());
        for plane in planes {
            for y in 0..self.rows {
                let row = image.row(plane, (tile.y + y).saturating_sub(reach).clamp(held.start, held.end - 1));
                let begin = self.values.len();
                self.values.resize(begin + before, row[0]);
                self.values.extend_from_slice(&row[first..first + inside]);
                self.values.resize(begin + self.stride, row[width - 1]);
            }
        }
    }

    /// All values of one plane.
    #[inline(always)]
    pub(super) fn plane_length(&self) -> usize {
        self.rows * self.stride
    }

    /// Index in a plane of the pixel at `x`, `y` of the tile, which may lie outside of it by the radius.
    #[inline(always)]
    pub(super) fn at(&self, (x, y): Offset) -> usize {
        let reach = self.reach as isize;
        (y + reach) as usize * self.stride + (x + reach) as usize
    }

    /// The values of all planes.
    #[inline(always)]
    pub(super) fn values(&self) -> &[f32] {
        &self.values
    }

    /// `length` pixels of a plane, from the given pixel of the tile on.
    #[inline(always)]
    pub(super) fn pixels(&self, plane: usize, begin: Offset, length: usize) -> &[f32] {
        &self.values[plane * self.plane_length() + self.at(begin)..][..length]
    }

    /// Sums over the first `planes` planes of the squared differences between pixels and those at an offset. It starts
    /// at `begin` and fills `out`, a whole number of vectors.
    #[inline(always)]
    pub(super) fn squared_differences<S: Simd>(
        &self,
        simd: S,
        planes: usize,
        begin: Offset,
        (across, down): Offset,
        out: &mut [f32],
    ) {
        let here = &self.values[self.at(begin)..];
        let there = &self.values[self.at((begin.0 + across, begin.1 + down))..];
        for (vector, out) in S::as_mut_simd_f32s(out).0.iter_mut().enumerate() {
            let mut sum = simd.splat_f32s(0.0);
            let mut at = vector * S::F32_LANES;
            for _ in 0..planes {
                let difference = simd.sub_f32s(load::<S>(here, at), load::<S>(there, at));
                sum = simd.add_f32s(sum, simd.mul_f32s(difference, difference));
                at += self.plane_length();
            }
            *out = sum;
        }
    }
}

/// Loads the vector that begins there.
#[inline(always)]
pub(super) fn load<S: Simd>(values: &[f32], at: usize) -> S::f32s {
    S::as_simd_f32s(&values[at..at + S::F32_LANES]).0[0]
}

/// `pixels` rounded up to whole vectors.
#[inline(always)]
pub(super) fn whole_vectors<S: Simd>(pixels: usize) -> usize {
    pixels.next_multiple_of(S::F32_LANES)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_edge_of_the_image_goes_on_around_it() {
        let (width, height, reach) = (40, 9, 3);
        let mut image = ImageRows::zeros(width, height, 2);
        image.values_mut().iter_mut().enumerate().for_each(|(i, v)| *v = i as f32);
        for tile in [PixelTile { x: 0, y: 0 }, PixelTile { x: 32, y: 0 }, PixelTile { x: 1, y: 5 }] {
            let mut cut = TileWindow::default();
            cut.fill(&image, 1..2, tile, reach);
            for y in -(reach as isize)..(TILE_HEIGHT + reach) as isize {
                let row = image.row(1, (tile.y as isize + y).clamp(0, height as isize - 1) as usize);
                for (i, value) in cut.pixels(0, (-(reach as isize), y), TILE_WIDTH + 2 * reach).iter().enumerate() {
                    let x = (tile.x + i) as isize - reach as isize;
                    assert_eq!(*value, row[x.clamp(0, width as isize - 1) as usize], "{tile:?}, {x}, {y}");
                }
            }
        }
    }
}
