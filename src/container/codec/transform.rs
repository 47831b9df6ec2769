//! The orthonormal cosine transform (DCT-II) of little images, in tiles, and the zones of frequency that tiles fall in.
//!
//! Being orthonormal, the transform keeps squared error: a step on the coefficients is a step on the values.

use std::sync::OnceLock;

/// Largest side of a tile.
pub(super) const MAX_TILE: usize = 32;
/// Number of zones of frequency.
pub(super) const ZONES: usize = 10;
/// Zone `z` holds the frequencies with `u² + v²` below `ZONE_LIMITS[z]` and not below the limit before.
const ZONE_LIMITS: [usize; ZONES] = [1, 2, 6, 16, 36, 72, 144, 256, 484, usize::MAX];

/// The zone of the frequency `(u, v)`.
pub(super) fn zone_of(u: usize, v: usize) -> usize {
    ZONE_LIMITS.iter().position(|&limit| u * u + v * v < limit).expect("the last limit is above everything")
}

/// The coefficients of a tile in the order of coding: by zone, in each by v, then u.
pub(super) struct Scan {
    /// `v · width + u` of each coefficient in coding order.
    pub(super) order: Vec<u16>,
    /// End of each zone in `order`.
    pub(super) ends: [usize; ZONES],
}

impl Scan {
    fn new(width: usize, height: usize) -> Self {
        let mut order: Vec<u16> = (0..(width * height) as u16).collect();
        let zone = |place: &u16| zone_of(usize::from(*place) % width, usize::from(*place) / width);
        order.sort_by_key(zone);
        let ends = std::array::from_fn(|z| order.partition_point(|place| zone(place) <= z));
        Self { order, ends }
    }

    /// The scan of a tile of `width × height`, at most [`MAX_TILE`] each.
    pub(super) fn of(width: usize, height: usize) -> &'static Self {
        static SCANS: [OnceLock<Scan>; MAX_TILE * MAX_TILE] = [const { OnceLock::new() }; MAX_TILE * MAX_TILE];
        SCANS[(width - 1) * MAX_TILE + height - 1].get_or_init(|| Self::new(width, height))
    }
}

/// The basis functions: row `u` is the `u`-th cosine over `n` places.
fn cosines(n: usize) -> &'static [f32] {
    static COSINES: [OnceLock<Vec<f32>>; MAX_TILE + 1] = [const { OnceLock::new() }; MAX_TILE + 1];
    COSINES[n].get_or_init(|| {
        let mut rows = Vec::with_capacity(n * n);
        for u in 0..n {
            let scale = (if u == 0 { 1.0 } else { 2.0 } / n as f64).sqrt();
            rows.extend((0..n).map(|x| {
                let angle = std::f64::consts::PI * (x as f64 + 0.5) * u as f64 / n as f64;
                (scale * angle.cos()) as f32
            }));
        }
        rows
    })
}

/// Transforms a tile of `width × height` values, row by row, in place.
pub(super) fn forward(tile: &mut [f32], width: usize, height: usize) {
    let (across, down) = (cosines(width), cosines(height));
    let mut rows = [0.0f32; MAX_TILE * MAX_TILE];
    for (row, out) in tile.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
        for (u, out) in out.iter_mut().enumerate() {
            *out = row.iter().zip(&across[u * width..]).map(|(a, b)| a * b).sum();
        }
    }
    tile.fill(0.0);
    for (v, out) in tile.chunks_exact_mut(width).enumerate() {
        for (y, row) in rows.chunks_exact(width).take(height).enumerate() {
            add_scaled(out, row, down[v * height + y]);
        }
    }
}

/// Transforms back in place. Rows and columns of coefficients that are all zero at the high end cost nothing.
pub(super) fn inverse(tile: &mut [f32], width: usize, height: usize) {
    let (across, down) = (cosines(width), cosines(height));
    let used_rows = tile.chunks_exact(width).rposition(|row| row.iter().any(|&c| c != 0.0)).map_or(0, |last| last + 1);
    let used_columns = tile
        .chunks_exact(width)
        .take(used_rows)
        .filter_map(|row| row.iter().rposition(|&c| c != 0.0))
        .max()
        .map_or(0, |last| last + 1);
    let mut rows = [0.0f32; MAX_TILE * MAX_TILE];
    for (v, row) in tile.chunks_exact(width).take(used_rows).enumerate() {
        for (out, &c) in rows.chunks_exact_mut(width).zip(&down[v * height..(v + 1) * height]) {
            add_scaled(&mut out[..used_columns], &row[..used_columns], c);
        }
    }
    for (out, row) in tile.chunks_exact_mut(width).zip(rows.chunks_exact(width)) {
        out.fill(0.0);
        for (&c, cosine) in row[..used_columns].iter().zip(across.chunks_exact(width)) {
            add_scaled(out, cosine, c);
        }
    }
}

fn add_scaled(out: &mut [f32], row: &[f32], scale: f32) {
    for (out, value) in out.iter_mut().zip(row) {
        *out += value * scale;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_transform_is_orthonormal_and_comes_back() {
        for (width, height) in [(1, 1), (8, 8), (32, 32), (5, 7), (16, 3), (1, 9)] {
            let values: Vec<f32> = (0..width * height).map(|i| ((i * 37) % 101) as f32 / 50.0 - 1.0).collect();
            let mut tile = values.clone();
            forward(&mut tile, width, height);
            let energy = |v: &[f32]| v.iter().map(|v| v * v).sum::<f32>();
            assert!((energy(&tile) - energy(&values)).abs() < 1e-4 * energy(&values));
            inverse(&mut tile, width, height);
            // Rounding of two passes of at most 32 products.
            assert!(tile.iter().zip(&values).all(|(a, b)| (a - b).abs() < 1e-5), "{width}×{height}");
        }
    }

    #[test]
    fn zones_cover_every_tile() {
        for (width, height) in [(1, 1), (8, 8), (32, 32), (5, 7)] {
            let scan = Scan::of(width, height);
            let mut places = scan.order.clone();
            places.sort_unstable();
            assert!(places.iter().enumerate().all(|(i, &place)| i == usize::from(place)));
            assert_eq!(*scan.ends.last().unwrap(), width * height);
        }
    }
}
