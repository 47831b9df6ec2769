//! A few images that stand for all: what pixels are compared by.

use pulp::Simd;

use super::constants::CHROMA;
use super::kernel::Offset;
use super::rows::{Pool, Region, Rows};
use super::tile::{Cut, TILE_HEIGHT, TILE_PIXELS, TILE_WIDTH, Tile, load, whole_vectors};

/// Guides, then the sum of their variances, then that of their squares.
pub(super) struct Guide {
    rows: Rows,
    guides: usize,
}

pub(super) struct GuideWidths {
    /// Of the noise: larger averages more.
    pub(super) noise: f32,
    /// Of the value itself: relative differences below this are none.
    pub(super) relative: f32,
}

impl Guide {
    /// In a region, of two halves, one after the other in `halves`: their mean, and its variance, averaged over squares.
    pub(super) fn of_halves(halves: &Rows, reach: usize, region: &Region, pool: &Pool) -> Self {
        let guides = halves.planes() / 2;
        let (width, height) = (halves.width(), halves.height());
        let pairs = |y: usize, plane: usize, region: &Region| {
            let [a, b] = [plane, guides + plane].map(|plane| &halves.row(plane, y)[region.x.clone()]);
            a.iter().zip(b)
        };
        let mut squares = pool.rows(width, height, 1);
        let around = region.grown(reach, halves);
        squares.fill_rows(&around, |y, _, out| {
            for plane in 0..guides {
                let pairs = out.iter_mut().zip(pairs(y, plane, &around));
                pairs.for_each(|(o, (a, b))| *o += 0.25 * (a - b) * (a - b));
            }
        });
        let variance = squares.box_mean(reach, region, pool);
        let mut rows = pool.rows(width, height, guides + 2);
        rows.fill_rows(region, |y, plane, out| {
            if plane < guides {
                out.iter_mut().zip(pairs(y, plane, region)).for_each(|(o, (a, b))| *o = 0.5 * (a + b));
            } else if plane == guides {
                out.copy_from_slice(&variance.row(0, y)[region.x.clone()]);
            } else {
                for guide in 0..guides {
                    let pairs = out.iter_mut().zip(pairs(y, guide, region));
                    pairs.for_each(|(o, (a, b))| *o += 0.25 * (a + b) * (a + b));
                }
            }
        });
        pool.keep(squares);
        pool.keep(variance);
        Self { rows, guides }
    }

    pub(super) fn into_rows(self) -> Rows {
        self.rows
    }

    /// What a tile's neighbours are compared by over patches of these pixels to each side.
    pub(super) fn around(&self, tile: Tile, reach: usize, patch: usize) -> GuideCut {
        let cut = Cut::of(&self.rows, 0..self.guides + 2, tile, reach + patch);
        GuideCut { cut, guides: self.guides, patch, distances: Vec::new() }
    }
}

/// The guides around a tile.
pub(super) struct GuideCut {
    cut: Cut,
    guides: usize,
    patch: usize,
    distances: Vec<f32>,
}

impl GuideCut {
    /// The sum over guides of the squared differences of pixels, less their noise, over the noise: the mean over a patch around
    /// both pixels.
    #[inline(always)]
    pub(super) fn distances<S: Simd>(
        &mut self,
        simd: S,
        (across, down): Offset,
        widths: &GuideWidths,
        out: &mut [f32; TILE_PIXELS],
    ) {
        let patch = self.patch;
        // Of the tile and what its patches reach, row by row.
        let length = whole_vectors::<S>(TILE_WIDTH + 2 * patch);
        self.distances.resize((TILE_HEIGHT + 2 * patch) * length, 0.0);
        let noise = simd.splat_f32s(widths.noise * widths.noise);
        let relative = simd.splat_f32s(widths.relative * widths.relative);
        let least = simd.splat_f32s(1e-12);
        let x = -(patch as isize);
        for (row, out) in self.distances.chunks_exact_mut(length).enumerate() {
            let y = row as isize - patch as isize;
            self.cut.squared_differences(simd, self.guides, (x, y), (across, down), out);
            let (here, there) = (self.cut.at((x, y)), self.cut.at((x + across, y + down)));
            // No closures: they would not be compiled for the vectors of the machine.
            let (values, noise_plane) = (self.cut.values(), self.guides * self.cut.plane_length());
            for (vector, out) in S::as_mut_simd_f32s(out).0.iter_mut().enumerate() {
                let at = noise_plane + vector * S::F32_LANES;
                let noises = simd.add_f32s(load::<S>(values, here + at), load::<S>(values, there + at));
                let at = at + self.cut.plane_length();
                let sizes = simd.add_f32s(load::<S>(values, here + at), load::<S>(values, there + at));
                let width = simd.add_f32s(simd.mul_f32s(noise, noises), simd.mul_f32s(relative, sizes));
                *out = simd.div_f32s(simd.sub_f32s(*out, noises), simd.add_f32s(width, least));
            }
        }
        let side = 2 * patch + 1;
        let scale = 1.0 / (side * side) as f32;
        // Sums across, each of which goes to all rows that it is near.
        out.fill(0.0);
        for (row, distances) in self.distances.chunks_exact(length).enumerate() {
            let mut across = [0.0; TILE_WIDTH];
            across.copy_from_slice(&distances[..TILE_WIDTH]);
            for x in 1..side {
                for (sum, d) in across.iter_mut().zip(&distances[x..x + TILE_WIDTH]) {
                    *sum += d;
                }
            }
            let (first, end) = ((row + 1).saturating_sub(side), (row + 1).min(TILE_HEIGHT));
            for out in out[first * TILE_WIDTH..end * TILE_WIDTH].chunks_exact_mut(TILE_WIDTH) {
                for (out, sum) in out.iter_mut().zip(&across) {
                    *out += scale * sum;
                }
            }
        }
    }
}

/// Mixtures of the clusters' images, summed over channels, of each half: `mix` is clusters × guides, guide by guide. Two more
/// say how the first of them is coloured: red and blue less green, [`CHROMA`] times.
pub(super) fn mixtures(halves: &Rows, mix: &[f32], region: &Region, pool: &Pool) -> Rows {
    let clusters = halves.planes() / 6;
    let guides = mix.len() / clusters;
    let chroma = [[CHROMA, -CHROMA, 0.0], [0.0, -CHROMA, CHROMA]];
    let mut images = pool.rows(halves.width(), halves.height(), 2 * (guides + chroma.len()));
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
    images
}

/// Weights from distances.
#[inline(always)]
pub(super) fn weights(distances: &mut [f32]) {
    // (1 − d/8)⁸ is near exp(−d) and needs no table; far distances count nothing.
    for d in distances {
        let base = (1.0 - d.max(0.0) * 0.125).max(0.0);
        let square = base * base;
        let fourth = square * square;
        *d = fourth * fourth;
    }
}
