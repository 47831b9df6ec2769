//! Feature distances: how far two pixels see the same surface, whatever the light.

use pulp::Simd;

use super::constants::{ALBEDO_WIDTH, DEPTH_WIDTH, FEATURE_NOISE, MIN_ALBEDO, NORMAL_WIDTH, SHARE_WIDTH};
use super::image_rows::{ImageRows, Pool, Region};

use super::pixel_tile::Offset;
use super::pixel_tile::{PixelTile, TILE_PIXELS, TILE_WIDTH, TileWindow};
use super::row_stages::{Stage, Step, Track};

const NORMAL: usize = 3;
const DEPTH: usize = 6;
pub(super) const SPECULAR: usize = 8;
const SURFACE: usize = 9;

/// Number of planes compared: normal, albedo, shares.
const COMPARED: usize = 8;
const WIDTHS: [f32; COMPARED] =
    [NORMAL_WIDTH, NORMAL_WIDTH, NORMAL_WIDTH, ALBEDO_WIDTH, ALBEDO_WIDTH, ALBEDO_WIDTH, SHARE_WIDTH, SHARE_WIDTH];

/// Features prepared for comparison. The compared planes come in units of their widths; then the variance of their sum,
/// scaled by [`FEATURE_NOISE`]; then inverse depth, its slope across and down, and its variance. A plane in space is a
/// plane in inverse depth, whatever its tilt. Last comes the mean over channels of the albedo that light was divided
/// by.
pub(super) struct Surfaces {
    planes: ImageRows,
    track: Track,
}

const NOISE: usize = COMPARED;
const INVERSE_DEPTH: usize = COMPARED + 1;
const SLOPE_ACROSS: usize = COMPARED + 2;
const SLOPE_DOWN: usize = COMPARED + 3;
const INVERSE_DEPTH_NOISE: usize = COMPARED + 4;
const ALBEDO: usize = COMPARED + 5;
/// Number of planes held.
pub(super) const PLANES: usize = COMPARED + 6;

impl Surfaces {
    /// No rows yet.
    pub(super) fn begin(stage: Stage, region: &Region, size: (usize, usize), step: usize) -> Self {
        let (track, planes) = Track::begin(stage, region, size, step);
        Self { planes, track }
    }

    /// Prepares the rows that a step needs. It reads one more row of features and variance to either side.
    pub(super) fn advance(&mut self, features: &ImageRows, variance: &ImageRows, step: &Step<'_>, pool: &Pool) {
        let region = Region { x: 0..features.width(), ..self.track.advance(&mut self.planes, step) };
        let order = [NORMAL, NORMAL + 1, NORMAL + 2, 0, 1, 2, SPECULAR, SURFACE];
        let around = region.grown(1, features);
        let mut inverse = pool.rows_like(features, 1, around.y.clone());
        inverse.fill_rows(&around, |y, _, out| {
            let pairs = features.row(DEPTH, y).iter().zip(features.row(SURFACE, y));
            out.iter_mut()
                .zip(pairs)
                .for_each(|(o, (depth, share))| *o = if *depth > 0.0 { share / depth } else { 0.0 });
        });
        let inverse_noise = |x: usize, y: usize| {
            let depth = features.row(DEPTH, y)[x];
            if depth > 0.0 { variance.row(DEPTH, y)[x] * (inverse.row(0, y)[x] / depth).powi(2) } else { 0.0 }
        };
        let height = features.height();
        self.planes.fill_rows(&region, |y, plane, out| {
            let row = inverse.row(0, y);
            match plane {
                NOISE => {
                    for (plane, width) in order.iter().zip(WIDTHS) {
                        let scale = 1.0 / (width * width);
                        out.iter_mut().zip(variance.row(*plane, y)).for_each(|(o, v)| *o += v * scale);
                    }
                    let specular = features.row(SPECULAR, y);
                    out.iter_mut()
                        .zip(specular)
                        .for_each(|(o, share)| *o *= 1.0 + (FEATURE_NOISE - 1.0) * (1.0 - share));
                }
                INVERSE_DEPTH => out.copy_from_slice(row),
                SLOPE_ACROSS => {
                    for (x, out) in out.iter_mut().enumerate() {
                        let (left, right) = (x.checked_sub(1).map(|x| row[x]), row.get(x + 1).copied());
                        *out = certain(gentle(left, row[x], right), inverse_noise(x, y));
                    }
                }
                SLOPE_DOWN => {
                    let above = (y > 0).then(|| inverse.row(0, y - 1));
                    let below = (y + 1 < height).then(|| inverse.row(0, y + 1));
                    for (x, out) in out.iter_mut().enumerate() {
                        let slope = gentle(above.map(|row| row[x]), row[x], below.map(|row| row[x]));
                        *out = certain(slope, inverse_noise(x, y));
                    }
                }
                ALBEDO => {
                    for channel in 0..3 {
                        let albedo = features.row(channel, y);
                        out.iter_mut().zip(albedo).for_each(|(o, albedo)| *o += albedo.max(MIN_ALBEDO) / 3.0);
                    }
                }
                INVERSE_DEPTH_NOISE => out.iter_mut().enumerate().for_each(|(x, out)| *out = inverse_noise(x, y)),
                _ => {
                    let width = WIDTHS[plane];
                    out.iter_mut().zip(features.row(order[plane], y)).for_each(|(o, v)| *o = v / width);
                }
            }
        });
        pool.keep(inverse);
    }

    #[cfg(test)]
    pub(super) fn rows(&self) -> &ImageRows {
        &self.planes
    }

    /// Fills `around` with the features around a tile.
    pub(super) fn cut(&self, tile: PixelTile, reach: usize, around: &mut SurfacesCut) {
        around.0.fill(&self.planes, 0..PLANES, tile, reach);
    }
}

/// The features around a tile.
#[derive(Default)]
pub(super) struct SurfacesCut(TileWindow);

impl SurfacesCut {
    /// A row of a tile's width that begins at the given pixel.
    #[inline(always)]
    fn row(&self, plane: usize, begin: Offset) -> &[f32] {
        self.0.pixels(plane, begin, TILE_WIDTH)
    }

    /// Multiplies the weights of the neighbours at one offset by their albedo. What is averaged is light over albedo.
    /// So weighted, the mean is total light over total albedo: a ratio estimator (Cochran, *Sampling Techniques*, 3rd
    /// edition, §6.2). A pixel on a nearly black surface, which says little of the light, then has little weight.
    #[inline(always)]
    pub(super) fn times_albedo(&self, (across, down): Offset, out: &mut [f32; TILE_PIXELS]) {
        for (row, out) in out.chunks_exact_mut(TILE_WIDTH).enumerate() {
            let albedo = self.row(ALBEDO, (across, row as isize + down));
            out.iter_mut().zip(albedo).for_each(|(weight, albedo)| *weight *= albedo);
        }
    }

    /// Adds the feature distances between the pixels of a tile and their neighbours at one offset.
    #[inline(always)]
    pub(super) fn add_distances<S: Simd>(&self, simd: S, (across, down): Offset, out: &mut [f32; TILE_PIXELS]) {
        let mut sums = [0.0f32; TILE_WIDTH];
        for (row, out) in out.chunks_exact_mut(TILE_WIDTH).enumerate() {
            let y = row as isize;
            self.0.squared_differences(simd, COMPARED, (0, y), (across, down), &mut sums);
            let (here, there) = ((0, y), (across, y + down));
            let (noise, other_noise) = (self.row(NOISE, here), self.row(NOISE, there));
            let (depth, other_depth) = (self.row(INVERSE_DEPTH, here), self.row(INVERSE_DEPTH, there));
            let (slope_across, slope_down) = (self.row(SLOPE_ACROSS, here), self.row(SLOPE_DOWN, here));
            let (depth_noise, other_depth_noise) =
                (self.row(INVERSE_DEPTH_NOISE, here), self.row(INVERSE_DEPTH_NOISE, there));
            for (i, out) in out.iter_mut().enumerate() {
                let noises = noise[i] + other_noise[i];
                let off = (sums[i] - noises).max(0.0) / (1.0 + noises);
                let expected = depth[i] + slope_across[i] * across as f32 + slope_down[i] * down as f32;
                let depth_off = expected - other_depth[i];
                let width = DEPTH_WIDTH * depth[i].max(other_depth[i]);
                let noises = depth_noise[i] + other_depth_noise[i];
                *out += off + (depth_off * depth_off - noises).max(0.0) / (width * width + noises + 1e-24);
            }
        }
    }
}

/// A slope, shrunk by its noise.
fn certain(slope: f32, noise: f32) -> f32 {
    let square = slope * slope;
    if square > 0.0 { slope * square / (square + 8.0 * noise) } else { 0.0 }
}

/// The smaller of two one-sided slopes.
fn gentle(before: Option<f32>, here: f32, after: Option<f32>) -> f32 {
    match (before, after) {
        (Some(before), Some(after)) if (here - before).abs() < (after - here).abs() => here - before,
        (_, Some(after)) => after - here,
        (Some(before), None) => here - before,
        (None, None) => 0.0,
    }
}
