//! Weighted means of neighbours, and values of planes laid through them: for each tile of pixels the weights of every offset,
//! then the same weights for every image.

use std::ops::Range;

use pulp::{Simd, WithSimd};

use super::constants::{BESIDE, MOST_LEVERAGE};
use super::rows::{Pool, Region, Rows};
use super::tile::{Cut, TILE_HEIGHT, TILE_PIXELS, TILE_WIDTH, Tile, load};

/// Planes that are summed at once.
const TOGETHER: usize = 4;
/// What weighs less is not there: sums of such have no inverse.
const LEAST_WEIGHT: f32 = 1e-20;

/// How much the neighbours of pixels weigh.
pub(super) trait Weigh: Sync {
    /// What is made ready for a tile.
    type Ready;

    /// Images that have weights of their own: each has as many planes, one image after the other.
    fn images(&self) -> usize {
        1
    }

    /// Makes ready what [`weigh`](Self::weigh) needs for the neighbours of a tile within a reach.
    fn ready(&self, tile: Tile, reach: usize) -> Self::Ready;

    /// The weights of neighbours of the pixels of a tile, row by row; of all images that are asked for the first comes first. What
    /// it says of neighbours beyond the image counts nothing. To be inlined, so that it is compiled for the vectors of the machine.
    fn weigh<S: Simd>(&self, simd: S, ready: &mut Self::Ready, of: Neighbours, out: &mut [f32; TILE_PIXELS]);
}

/// Those of which weights are asked for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Neighbours {
    /// Which of the images.
    pub(super) image: usize,
    /// How far they are.
    pub(super) offset: Offset,
    /// Which of the offsets that is.
    pub(super) index: usize,
}

/// Pixels across and down.
pub(super) type Offset = (isize, isize);

/// Offsets that a filter reads.
pub(super) struct Offsets {
    radius: usize,
    each: Vec<Offset>,
}

impl Offsets {
    /// A square of these pixels to each side, of which every `stride`th is read; the middle is among them.
    fn square(radius: usize, stride: usize) -> Self {
        debug_assert!(radius.is_multiple_of(stride));
        let steps = || (-(radius as isize)..=radius as isize).step_by(stride);
        Self { radius, each: steps().flat_map(|y| steps().map(move |x| (x, y))).collect() }
    }

    /// Those of a square that lie within a circle through the middle of its sides.
    pub(super) fn disc(radius: usize, stride: usize) -> Self {
        let Self { radius, mut each } = Self::square(radius, stride);
        let reach = radius as f32 + 0.5 * stride as f32;
        each.retain(|&(x, y)| (x as f32).hypot(y as f32) <= reach);
        Self { radius, each }
    }

    /// How far they are at most, across or down.
    pub(super) fn radius(&self) -> usize {
        self.radius
    }

    /// How many there are.
    pub(super) fn count(&self) -> usize {
        self.each.len()
    }

    /// A disc of which beyond `dense` pixels only one in `thin` is read: 2 as on a chessboard, 5 as a knight goes on it.
    pub(super) fn thinned(radius: usize, dense: usize, thin: usize) -> Self {
        let Self { radius, mut each } = Self::disc(radius, 1);
        let (dense, thin) = (dense as isize, thin as isize);
        each.retain(|&(x, y)| (x.abs() <= dense && y.abs() <= dense) || (x + (thin / 2) * y) % thin == 0);
        Self { radius, each }
    }
}

/// How far each is from a pixel in a plane of rows that are so far from one another.
fn taps(offsets: &[Offset], row: usize) -> Vec<isize> {
    offsets.iter().map(|(across, down)| down * row as isize + across).collect()
}

/// For each pixel of a region the mean of its neighbours in each plane of `images`, corrected for their slope as far as `slope`
/// allows ([`correct_slope`]). A pixel weighs for itself as much as the one most alike, so that one that is like no other, on
/// the edge of two surfaces say, does not keep its grain: it becomes what is beside it.
pub(super) fn weighted_means(
    images: &Rows,
    region: &Region,
    offsets: &Offsets,
    slope: f32,
    weigher: &impl Weigh,
    pool: &Pool,
) -> Rows {
    let (width, planes) = (images.width(), images.planes());
    // Those of tiles at the image's edge, and of others.
    let taps = [Cut::stride(offsets.radius), planes * width].map(|row| taps(&offsets.each, row));
    let taps = taps.each_ref().map(Vec::as_slice);
    let mut means = pool.rows(width, images.height(), planes);
    means.fill_strips(&region.y, TILE_HEIGHT, |y, strip| {
        let mut weights = vec![0.0f32; offsets.each.len() * TILE_PIXELS];
        for x in region.x.clone().step_by(TILE_WIDTH) {
            let tile = Tile { x, y };
            let out = Target { width, planes, columns: x..region.x.end.min(x + TILE_WIDTH), rows: strip };
            let weights = &mut weights;
            pulp::Arch::new().dispatch(TileOfMeans { images, tile, offsets, taps, slope, weigher, weights, out });
        }
    });
    means
}

/// The rows that a tile is a part of, and which of their columns are its own.
struct Target<'a> {
    width: usize,
    planes: usize,
    columns: Range<usize>,
    rows: &'a mut [f32],
}

struct TileOfMeans<'a, W> {
    images: &'a Rows,
    tile: Tile,
    offsets: &'a Offsets,
    /// How far each of those is in a plane of a cut, and of the images.
    taps: [&'a [isize]; 2],
    slope: f32,
    weigher: &'a W,
    /// [`TILE_PIXELS`] for each offset.
    weights: &'a mut [f32],
    out: Target<'a>,
}

impl<W: Weigh> WithSimd for TileOfMeans<'_, W> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let mut ready = self.weigher.ready(self.tile, self.offsets.radius);
        let images = self.weigher.images();
        for image in 0..images {
            self.weigh(simd, &mut ready, image);
            correct_slope(self.weights, &self.offsets.each, self.slope);
            let planes = self.out.planes / images;
            self.add_up_planes(simd, image * planes..(image + 1) * planes);
        }
    }
}

impl<W: Weigh> TileOfMeans<'_, W> {
    /// Adds up the weighted neighbours in some planes.
    #[inline(always)]
    fn add_up_planes<S: Simd>(&mut self, simd: S, some: Range<usize>) {
        let end = some.end;
        let four = |first: usize| first..end.min(first + TOGETHER);
        if self.is_inside() {
            let (Tile { x, y }, width, planes) = (self.tile, self.out.width, self.out.planes);
            for first in some.step_by(TOGETHER) {
                let begin = (y * planes + first) * width + x;
                let source = Source { values: self.images.values(), begin, row: planes * width, plane: width };
                self.add_up(simd, source, self.taps[1], four(first));
            }
            return;
        }
        let mut cut = Cut::default();
        for first in some.step_by(TOGETHER) {
            cut.fill(self.images, four(first), self.tile, self.offsets.radius);
            let row = Cut::stride(self.offsets.radius);
            let source = Source { values: cut.values(), begin: cut.at((0, 0)), row, plane: cut.plane_length() };
            self.add_up(simd, source, self.taps[0], four(first));
        }
    }

    /// Fills the weights in an image; they add up to 1 for each pixel.
    #[inline(always)]
    fn weigh<S: Simd>(&mut self, simd: S, ready: &mut W::Ready, image: usize) {
        let (mut sums, mut most) = ([0.0f32; TILE_PIXELS], [0.0f32; TILE_PIXELS]);
        let mut own = None;
        let all = self.offsets.each.iter().zip(self.weights.chunks_exact_mut(TILE_PIXELS));
        for (index, (&offset, weights)) in all.enumerate() {
            let Ok(weights) = <&mut [f32; TILE_PIXELS]>::try_from(weights) else { continue };
            if offset == (0, 0) {
                own = Some(weights);
                continue;
            }
            self.weigher.weigh(simd, ready, Neighbours { image, offset, index }, weights);
            if offset.0.abs() <= 1 && offset.1.abs() <= 1 {
                for w in weights.iter_mut() {
                    *w += BESIDE;
                }
            }
            forget_outside(self.images, self.tile, offset, weights);
            for i in 0..TILE_PIXELS {
                sums[i] += weights[i];
                most[i] = if weights[i] > most[i] { weights[i] } else { most[i] };
            }
        }
        if let Some(own) = own {
            for i in 0..TILE_PIXELS {
                // A pixel without any other keeps its value.
                own[i] = if most[i] > LEAST_WEIGHT { most[i] } else { 1.0 };
                sums[i] += own[i];
            }
        }
        for sum in &mut sums {
            *sum = 1.0 / *sum;
        }
        for weights in self.weights.chunks_exact_mut(TILE_PIXELS) {
            for (w, scale) in weights.iter_mut().zip(&sums) {
                *w *= scale;
            }
        }
    }

    /// Whether all that is read lies within the image, vectors that begin in it too.
    fn is_inside(&self) -> bool {
        let (Tile { x, y }, radius) = (self.tile, self.offsets.radius);
        let (right, bottom) = (x + TILE_WIDTH + radius, y + TILE_HEIGHT + radius);
        x >= radius && y >= radius && right <= self.out.width && bottom <= self.images.height()
    }

    /// Adds up the weighted neighbours in at most four planes.
    #[inline(always)]
    fn add_up<S: Simd>(&mut self, simd: S, source: Source<'_>, taps: &[isize], some: Range<usize>) {
        let Target { width, planes, columns, rows } = &mut self.out;
        // What is missing of four planes is summed again, and forgotten.
        let (first, together) = (some.start, some.len());
        let begins: [usize; TOGETHER] =
            std::array::from_fn(|plane| source.begin + plane.min(together - 1) * source.plane);
        let mut out = [[0.0f32; TILE_WIDTH]; TOGETHER];
        for (y, row) in rows.chunks_exact_mut(*planes * *width).enumerate() {
            for x in (0..TILE_WIDTH).step_by(2 * S::F32_LANES) {
                let weights = &self.weights[y * TILE_WIDTH + x..];
                let at = begins.map(|begin| begin + y * source.row + x);
                let sums = add_up_vectors(simd, source.values, at, weights, taps);
                for (out, sums) in out.iter_mut().zip(&sums) {
                    S::as_mut_simd_f32s(&mut out[x..x + 2 * S::F32_LANES]).0.copy_from_slice(sums);
                }
            }
            for (plane, out) in out.iter().enumerate().take(together) {
                let row = &mut row[(first + plane) * *width..][columns.clone()];
                row.copy_from_slice(&out[..row.len()]);
            }
        }
    }
}

/// Where the pixels of a tile are read.
struct Source<'a> {
    values: &'a [f32],
    /// The tile's first pixel in the first plane.
    begin: usize,
    /// From a row to the next.
    row: usize,
    /// From a plane to the next.
    plane: usize,
}

/// Weighted sums of two vectors of pixels in each of four planes, which begin there. `taps` says how far each neighbour is from them.
/// Written out, for the sums to stay in registers; fused on every machine, for the same bits.
#[inline(always)]
fn add_up_vectors<S: Simd>(
    simd: S,
    values: &[f32],
    [a, b, c, d]: [usize; TOGETHER],
    weights: &[f32],
    taps: &[isize],
) -> [[S::f32s; 2]; TOGETHER] {
    let zero = simd.splat_f32s(0.0);
    let add = |[low, high]: [S::f32s; 2], [w_low, w_high]: [S::f32s; 2], at: usize| {
        let values = [load::<S>(values, at), load::<S>(values, at + S::F32_LANES)];
        [simd.mul_add_f32s(w_low, values[0], low), simd.mul_add_f32s(w_high, values[1], high)]
    };
    let [mut of_a, mut of_b, mut of_c, mut of_d] = [[zero; 2]; TOGETHER];
    for (&tap, weights) in taps.iter().zip(weights.chunks(TILE_PIXELS)) {
        let weights = [load::<S>(weights, 0), load::<S>(weights, S::F32_LANES)];
        of_a = add(of_a, weights, a.wrapping_add_signed(tap));
        of_b = add(of_b, weights, b.wrapping_add_signed(tap));
        of_c = add(of_c, weights, c.wrapping_add_signed(tap));
        of_d = add(of_d, weights, d.wrapping_add_signed(tap));
    }
    [of_a, of_b, of_c, of_d]
}

/// Neighbours beyond the image weigh nothing.
#[inline(always)]
fn forget_outside(images: &Rows, tile: Tile, (across, down): Offset, weights: &mut [f32; TILE_PIXELS]) {
    let (width, height) = (images.width() as isize, images.height() as isize);
    let (x, y) = (tile.x as isize + across, tile.y as isize + down);
    if x >= 0 && y >= 0 && x + TILE_WIDTH as isize <= width && y + TILE_HEIGHT as isize <= height {
        return;
    }
    for (row, weights) in weights.chunks_exact_mut(TILE_WIDTH).enumerate() {
        let in_rows = (0..height).contains(&(y + row as isize));
        for (column, weight) in weights.iter_mut().enumerate() {
            if !in_rows || !(0..width).contains(&(x + column as isize)) {
                *weight = 0.0;
            }
        }
    }
}

/// Turns weights of a tile of pixels, which add up to 1 for each pixel, from those of a mean into those of the value at the
/// pixel of a plane laid through its neighbours by weighted least squares: local linear regression (Fan and Gijbels 1996,
/// section 2.2; Bitterli et al. 2016 for images of samples). A mean is wrong where neighbours lie to one side and light has a
/// slope, on the rim of a surface above all; the plane is not, but it has more noise: by the factor `1 + t`, where
/// `t = mᵀ C⁻¹ m` is the leverage of the mean offset `m` with the covariance `C` of the offsets. So the correction is scaled down
/// to a leverage of at most `slope` times the number of samples that a mean with these weights is worth, and never above
/// [`MOST_LEVERAGE`].
#[inline(always)]
fn correct_slope(weights: &mut [f32], offsets: &[Offset], slope: f32) {
    // Sums of: the offset, its products, the weights' squares.
    let mut moments = [[0.0f32; TILE_PIXELS]; 6];
    for (&(across, down), weights) in offsets.iter().zip(weights.chunks_exact(TILE_PIXELS)) {
        let (x, y) = (across as f32, down as f32);
        let terms = [x, y, x * x, x * y, y * y];
        // All sums in one pass over the weights, without closures: they would not be compiled for the vectors of the machine.
        for (i, w) in weights.iter().enumerate() {
            for moment in 0..5 {
                moments[moment][i] += w * terms[moment];
            }
            moments[5][i] += w * w;
        }
    }
    // Each weight is multiplied by `1 − (C⁻¹ m)ᵀ (offset − m)`, or by less of it.
    let mut tilts = [[0.0f32; TILE_PIXELS]; 3];
    for i in 0..TILE_PIXELS {
        let tilt = tilt(std::array::from_fn(|moment| moments[moment][i]), slope);
        tilts.iter_mut().zip(tilt).for_each(|(tilts, tilt)| tilts[i] = tilt);
    }
    let [tilt_x, tilt_y, constant] = &tilts;
    for (&(across, down), weights) in offsets.iter().zip(weights.chunks_exact_mut(TILE_PIXELS)) {
        let (x, y) = (across as f32, down as f32);
        for (i, w) in weights.iter_mut().enumerate() {
            *w *= constant[i] - x * tilt_x[i] - y * tilt_y[i];
        }
    }
}

/// What the offset across and the offset down are multiplied by, and what their sum is taken from.
#[inline(always)]
fn tilt([x, y, xx, xy, yy, squares]: [f32; 6], slope: f32) -> [f32; 3] {
    if squares <= 0.0 {
        return [0.0, 0.0, 1.0];
    }
    // Where all neighbours lie on a line the covariance has no inverse.
    let ridge = 1e-2 + 1e-3 * (xx + yy);
    let (a, b, c) = (xx - x * x + ridge, xy - x * y, yy - y * y + ridge);
    let determinant = a * c - b * b;
    let (tilt_x, tilt_y) = ((c * x - b * y) / determinant, (a * y - b * x) / determinant);
    let leverage = tilt_x * x + tilt_y * y;
    let most = (slope / squares).min(MOST_LEVERAGE);
    let scale = if leverage > most { (most / leverage).sqrt() } else { 1.0 };
    [scale * tilt_x, scale * tilt_y, 1.0 + scale * leverage]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Weights by the place of a pixel and its neighbour.
    struct ByPlace<F>(F);

    impl<F: Fn((usize, usize), Offset) -> f32 + Sync> Weigh for ByPlace<F> {
        type Ready = Tile;

        fn ready(&self, tile: Tile, _: usize) -> Tile {
            tile
        }

        fn weigh<S: Simd>(&self, _: S, tile: &mut Tile, of: Neighbours, out: &mut [f32; TILE_PIXELS]) {
            for (i, out) in out.iter_mut().enumerate() {
                *out = self.0((tile.x + i % TILE_WIDTH, tile.y + i / TILE_WIDTH), of.offset);
            }
        }
    }

    fn means(images: &Rows, region: &Region, offsets: &Offsets, slope: f32, weigher: &impl Weigh) -> Rows {
        weighted_means(images, region, offsets, slope, weigher, &Pool::default())
    }

    /// Light that rises from the rim of a surface: a mean brightens the rim, a plane does not.
    #[test]
    fn a_slope_at_the_rim_is_no_bias() {
        let (width, height) = (20, 3);
        let mut ramp = Rows::zeros(width, height, 1);
        (0..height).for_each(|y| (0..width).for_each(|x| ramp.row_mut(0, y)[x] = x as f32));
        let even = ByPlace(|_, _| 1.0);
        let rim = |slope: f32| means(&ramp, &ramp.whole(), &Offsets::square(5, 1), slope, &even).row(0, 1)[0];
        assert!((rim(0.0) - 2.5).abs() < 0.1, "{}", rim(0.0));
        assert!(rim(1.0).abs() < 0.05, "{}", rim(1.0));
        // What the mean of few samples is worth pays for a part of it only.
        assert!((0.5..2.0).contains(&rim(0.02)), "{}", rim(0.02));
    }

    fn uneven((x, y): (usize, usize), (across, down): Offset) -> f32 {
        1.0 / (1.0 + ((y * 7 + x * 3) as isize + across * 5 + down).unsigned_abs() as f32 % 4.0)
    }

    #[test]
    fn weights_of_a_plane_add_up_to_one() {
        let mut flat = Rows::zeros(20, 9, 1);
        flat.values_mut().fill(3.0);
        let means = means(&flat, &flat.whole(), &Offsets::square(4, 1), 1.0, &ByPlace(uneven));
        assert!(means.values().iter().all(|v| (v - 3.0).abs() < 1e-3), "{means:?}");
    }

    /// Weights that are hardly there have sums without an inverse.
    #[test]
    fn a_pixel_that_is_hardly_like_any_other_keeps_its_value() {
        let mut images = Rows::zeros(20, 9, 1);
        images.values_mut().iter_mut().enumerate().for_each(|(i, v)| *v = i as f32);
        let hardly = ByPlace(|_, _| 1e-42);
        let means = means(&images, &images.whole(), &Offsets::disc(6, 3), 1.0, &hardly);
        let is_kept = means.values().iter().zip(images.values()).all(|(mean, value)| (mean - value).abs() < 1e-6);
        assert!(is_kept, "{means:?}");
    }

    /// Against sums over neighbours pixel by pixel, for images of several planes that are larger than a tile, and regions.
    #[test]
    fn means_are_those_of_the_neighbours_with_their_weights() {
        let (width, height, planes) = (71, 19, 9);
        let mut images = Rows::zeros(width, height, planes);
        images.values_mut().iter_mut().enumerate().for_each(|(i, v)| *v = (i * i % 101) as f32);
        let offsets = Offsets::square(6, 3);
        for region in [images.whole(), Region { x: 3..50, y: 5..17 }] {
            let means = means(&images, &region, &offsets, 0.0, &ByPlace(uneven));
            for y in region.y.clone() {
                for x in region.x.clone() {
                    let inside = |&&(across, down): &&Offset| {
                        x.checked_add_signed(across).is_some_and(|x| x < width)
                            && y.checked_add_signed(down).is_some_and(|y| y < height)
                    };
                    let weight = |&offset: &Offset| uneven((x, y), offset);
                    let near: Vec<&Offset> = offsets.each.iter().filter(inside).collect();
                    let others = || near.iter().filter(|offset| ***offset != (0, 0));
                    let most = others().map(|offset| weight(offset)).fold(0.0, f32::max);
                    let sum = most + others().map(|offset| weight(offset)).sum::<f32>();
                    for plane in 0..planes {
                        let at = |(across, down): Offset| {
                            images.row(plane, y.strict_add_signed(down))[x.strict_add_signed(across)]
                        };
                        let of_others: f32 = others().map(|&&offset| weight(&offset) * at(offset)).sum();
                        let right = (of_others + most * at((0, 0))) / sum;
                        let found = means.row(plane, y)[x];
                        assert!((found - right).abs() < 1e-3 * right.max(1.0), "{x}, {y}: {found}, not {right}");
                    }
                }
            }
        }
    }
}
