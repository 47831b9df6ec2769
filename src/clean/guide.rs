//! A few images that stand for all: what pixels are compared by.

use pulp::Simd;

use super::constants::CHROMA;
use super::kernel::Offset;
use super::rows::{Region, Rows};
use super::tile::{Cut, TILE_HEIGHT, TILE_PIXELS, TILE_WIDTH, Tile, whole_vectors};

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
    pub(super) fn of_halves(halves: &Rows, reach: usize, region: &Region) -> Self {
        let guides = halves.planes() / 2;
        let (width, height) = (halves.width(), halves.height());
        let pairs = |y: usize, plane: usize, region: &Region| {
            let [a, b] = [plane, guides + plane].map(|plane| &halves.row(plane, y)[region.x.clone()]);
            a.iter().zip(b)
        };
        let mut variance = Rows::zeros(width, height, 1);
        let around = region.grown(reach, halves);
        variance.fill_rows(&around, |y, _, out| {
            for plane in 0..guides {
                let pairs = out.iter_mut().zip(pairs(y, plane, &around));
                pairs.for_each(|(o, (a, b))| *o += 0.25 * (a - b) * (a - b));
            }
        });
        let variance = variance.box_mean(reach, region);
        let mut rows = Rows::zeros(width, height, guides + 2);
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
        Self { rows, guides }
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
        let (noise, relative) = (widths.noise * widths.noise, widths.relative * widths.relative);
        let x = -(patch as isize);
        for (row, out) in self.distances.chunks_exact_mut(length).enumerate() {
            let y = row as isize - patch as isize;
            self.cut.squared_differences(simd, self.guides, (x, y), (across, down), out);
            let here = |plane| self.cut.pixels(plane, (x, y), length);
            let there = |plane| self.cut.pixels(plane, (x + across, y + down), length);
            let (noise_here, noise_there) = (here(self.guides), there(self.guides));
            let (size_here, size_there) = (here(self.guides + 1), there(self.guides + 1));
            for i in 0..length {
                let noises = noise_here[i] + noise_there[i];
                let sizes = size_here[i] + size_there[i];
                out[i] = (out[i] - noises) / (noise * noises + relative * sizes + 1e-12);
            }
        }
        out.fill(0.0);
        let side = 2 * patch + 1;
        for (y, out) in out.chunks_exact_mut(TILE_WIDTH).enumerate() {
            for row in self.distances[y * length..][..side * length].chunks_exact(length) {
                for x in 0..side {
                    out.iter_mut().zip(&row[x..x + TILE_WIDTH]).for_each(|(o, d)| *o += d);
                }
            }
        }
        let scale = 1.0 / (side * side) as f32;
        out.iter_mut().for_each(|o| *o *= scale);
    }
}

/// Mixtures of the clusters' images, summed over channels, of each half: `mix` is clusters × guides, guide by guide. Two more
/// say how the first of them is coloured: red and blue less green, [`CHROMA`] times.
pub(super) fn mixtures(halves: &Rows, mix: &[f32], region: &Region) -> Rows {
    let clusters = halves.planes() / 6;
    let guides = mix.len() / clusters;
    let chroma = [[CHROMA, -CHROMA, 0.0], [0.0, -CHROMA, CHROMA]];
    let mut images = Rows::zeros(halves.width(), halves.height(), 2 * (guides + chroma.len()));
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
