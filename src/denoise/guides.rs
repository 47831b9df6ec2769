//! Guides: a few images that represent all, by which pixels are compared.

use pulp::Simd;

use super::constants::CHROMA;
use super::image_rows::{ImageRows, Pool, Region};

use super::pixel_tile::Offset;
use super::pixel_tile::{PixelTile, TILE_HEIGHT, TILE_PIXELS, TILE_WIDTH, TileWindow, load, whole_vectors};

/// Number of planes for the chroma of the first guide.
const COLOURS: usize = 2;

/// The guides of each part. Two more planes hold the sum of their variances, averaged over the patch around each pixel,
/// and that of their squares.
pub(super) struct Guide {
    rows: ImageRows,
    of: GuideOf,
    /// Number of guides of a part.
    guides: usize,
    patch: usize,
}

/// Which samples guides are computed from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GuideOf {
    /// All samples: one part.
    All,
    /// Each half of the samples by itself: two parts.
    EachHalf,
}

impl GuideOf {
    pub(super) fn parts(self) -> usize {
        match self {
            Self::All => 1,
            Self::EachHalf => 2,
        }
    }
}

pub(super) struct GuideWidths {
    /// Range-weight width in units of the noise's σ. A larger width averages more.
    pub(super) noise: f32,
    /// Relative differences of values below this count as none.
    pub(super) relative: f32,
}

/// Radii, in pixels: of the box over which a guide's noise is averaged, and of the patches that are compared.
#[derive(Clone, Copy, Debug)]
pub(super) struct GuideReach {
    pub(super) noise: usize,
    pub(super) patch: usize,
}

impl GuideReach {
    /// Radius, in pixels, within which the halves are read around pixels that are compared.
    pub(super) fn read(self) -> usize {
        self.noise + self.patch
    }
}

impl Guide {
    /// A guide without any pixels yet. Rows have `guides + 2` planes, or `2 · guides + 2` for guides of each half.
    pub(super) fn over(rows: ImageRows, patch: usize, of: GuideOf) -> Self {
        let guides = (rows.planes() - 2) / of.parts();
        Self { rows, of, guides, patch }
    }

    /// Which samples it is computed from.
    pub(super) fn of(&self) -> GuideOf {
        self.of
    }

    /// Fills the guides of a region. `halves` has two halves, one after the other. A guide is their mean or each of
    /// them, with the variance of that. The rows of the patches around the region must be held.
    pub(super) fn fill(&mut self, halves: &ImageRows, reach: GuideReach, region: &Region, pool: &Pool) {
        let (of, guides) = (self.of, self.guides);
        // Variance from the squared difference of the halves: of their mean, and of one half.
        let of_square = 0.25 * of.parts() as f32;
        let pairs = |y: usize, plane: usize, region: &Region| {
            let [a, b] = [plane, guides + plane].map(|plane| &halves.row(plane, y)[region.x.clone()]);
            a.iter().zip(b)
        };
        let patches = region.grown(reach.patch, halves);
        let around = patches.grown(reach.noise, halves);
        let mut differences = pool.rows_like(halves, 1, around.y.clone());
        differences.fill_rows(&around, |y, _, out| {
            for plane in 0..guides {
                let pairs = out.iter_mut().zip(pairs(y, plane, &around));
                pairs.for_each(|(o, (a, b))| *o += of_square * (a - b) * (a - b));
            }
        });
        let variance = differences.box_mean(reach.noise, &patches, pool);
        let mut squares = differences;
        squares.fill_rows(&patches, |y, _, out| {
            for plane in 0..guides {
                let pairs = out.iter_mut().zip(pairs(y, plane, &patches));
                pairs.for_each(|(o, (a, b))| *o += 0.25 * (a + b) * (a + b));
            }
        });
        let of_patches = [&variance, &squares].map(|terms| terms.box_mean(reach.patch, region, pool));
        self.rows.change_rows(&patches, |y, plane, out| match plane.checked_sub(of.parts() * guides) {
            None if of == GuideOf::EachHalf => out.copy_from_slice(&halves.row(plane, y)[patches.x.clone()]),
            None => {
                out.iter_mut().zip(pairs(y, plane, &patches)).for_each(|(o, (a, b))| *o = 0.5 * (a + b));
            }
            // Rows that are complete are kept.
            Some(term) if region.y.contains(&y) => {
                out.copy_from_slice(&of_patches[term].row(0, y)[patches.x.clone()]);
            }
            Some(_) => {}
        });
        let [of_variance, of_squares] = of_patches;
        [variance, squares, of_variance, of_squares].into_iter().for_each(|done| pool.keep(done));
    }

    #[cfg(test)]
    pub(super) fn rows(&self) -> &ImageRows {
        &self.rows
    }

    pub(super) fn rows_mut(&mut self) -> &mut ImageRows {
        &mut self.rows
    }

    pub(super) fn into_rows(self) -> ImageRows {
        self.rows
    }

    /// Fills `around` with the guides of one part that the neighbours of a tile are compared by.
    pub(super) fn cut(&self, part: usize, tile: PixelTile, reach: usize, around: &mut GuideCut) {
        (around.guides, around.patch) = (self.guides, self.patch);
        let noise = self.of.parts() * self.guides;
        let planes = (part * self.guides..(part + 1) * self.guides).chain(noise..noise + 2);
        around.cut.fill(&self.rows, planes, tile, reach + self.patch);
    }
}

/// The guides around a tile.
#[derive(Default)]
pub(super) struct GuideCut {
    cut: TileWindow,
    guides: usize,
    patch: usize,
    /// Squared differences for the tile and the patches around its pixels, row by row.
    squares: Vec<f32>,
}

impl GuideCut {
    /// The squared distance of the patches around two pixels, summed over guides, less its noise, in units of the
    /// noise.
    #[inline(always)]
    pub(super) fn distances<S: Simd>(
        &mut self,
        simd: S,
        (across, down): Offset,
        widths: &GuideWidths,
        out: &mut [f32; TILE_PIXELS],
    ) {
        let (patch, side) = (self.patch as isize, 2 * self.patch + 1);
        let length = whole_vectors::<S>(TILE_WIDTH + 2 * self.patch);
        self.squares.resize((TILE_HEIGHT + 2 * self.patch) * length, 0.0);
        for (row, squares) in self.squares.chunks_exact_mut(length).enumerate() {
            let begin = (-patch, row as isize - patch);
            self.cut.squared_differences(simd, self.guides, begin, (across, down), squares);
            // Sums along rows; each replaces its first term.
            for x in (0..TILE_WIDTH).step_by(S::F32_LANES) {
                let mut sum = load::<S>(squares, x);
                for next in x + 1..x + side {
                    sum = simd.add_f32s(sum, load::<S>(squares, next));
                }
                S::as_mut_simd_f32s(&mut squares[x..x + S::F32_LANES]).0[0] = sum;
            }
        }
        let scale = simd.splat_f32s(1.0 / (side * side) as f32);
        let noise = simd.splat_f32s(widths.noise * widths.noise);
        let relative = simd.splat_f32s(widths.relative * widths.relative);
        let least = simd.splat_f32s(1e-12);
        // No closures: these would not be compiled for the chosen instruction set.
        let values = self.cut.values();
        let (noise_plane, plane) = (self.guides * self.cut.plane_length(), self.cut.plane_length());
        for (row, out) in out.chunks_exact_mut(TILE_WIDTH).enumerate() {
            let (here, there) = (self.cut.at((0, row as isize)), self.cut.at((across, row as isize + down)));
            for (vector, out) in S::as_mut_simd_f32s(out).0.iter_mut().enumerate() {
                let x = vector * S::F32_LANES;
                let mut sum = load::<S>(&self.squares, row * length + x);
                for y in row + 1..row + side {
                    sum = simd.add_f32s(sum, load::<S>(&self.squares, y * length + x));
                }
                let at = noise_plane + x;
                let noises = simd.add_f32s(load::<S>(values, here + at), load::<S>(values, there + at));
                let at = at + plane;
                let sizes = simd.add_f32s(load::<S>(values, here + at), load::<S>(values, there + at));
                let width = simd.add_f32s(simd.mul_f32s(noise, noises), simd.mul_f32s(relative, sizes));
                let over = simd.sub_f32s(simd.mul_f32s(scale, sum), noises);
                *out = simd.div_f32s(over, simd.add_f32s(width, least));
            }
        }
    }
}

/// Mixtures of the clusters' images, summed over channels, for each half. `mix` is clusters × guides, guide by guide.
/// Two more planes hold the chroma of the first: red and blue less green, times [`CHROMA`].
pub(super) fn fill_mixtures(halves: &ImageRows, mix: &[f32], region: &Region, images: &mut ImageRows) {
    let clusters = halves.planes() / 6;
    let guides = mix.len() / clusters;
    let chroma: [[f32; 3]; COLOURS] = [[CHROMA, -CHROMA, 0.0], [0.0, -CHROMA, CHROMA]];
    images.fill_rows(region, |y, plane, out| {
        let (half, guide) = (plane / (guides + chroma.len()), plane % (guides + chroma.len()));
        let (guide, channels) = match guide.checked_sub(guides) {
            Some(colour) => (0, chroma[colour]),
            None => (guide, [1.0; 3]),
        };
        for (cluster, weight) in mix[guide * clusters..][..clusters].iter().enumerate() {
            for (channel, share) in channels.iter().enumerate().filter(|(_, share)| **share != 0.0) {
                let row = &halves.row((half * clusters + cluster) * 3 + channel, y)[region.x.clone()];
                out.iter_mut().zip(row).for_each(|(o, v)| *o += weight * share * v);
            }
        }
    });
}

/// Number of planes of `mixtures` guides with the chroma of the first, for two halves.
pub(super) fn mixture_planes(mixtures: usize) -> usize {
    2 * (mixtures + COLOURS)
}

/// Turns distances into weights.
#[inline(always)]
pub(super) fn weights(distances: &mut [f32]) {
    // (1 − d/8)⁸ approximates exp(−d) without a table, and is 0 from d = 8 on.
    for d in distances {
        let base = (1.0 - d.max(0.0) * 0.125).max(0.0);
        let square = base * base;
        let fourth = square * square;
        *d = fourth * fourth;
    }
}
