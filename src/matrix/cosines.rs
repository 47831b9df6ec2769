//! The orthonormal cosine transform (DCT-II) of little images, in tiles, and the zones of frequency that tiles fall in.
//!
//! Being orthonormal, the transform keeps squared error: a step on the coefficients is a step on the values. And it keeps
//! products: that of two images is that of their coefficients.

use std::sync::OnceLock;

/// Largest side of a tile.
pub(crate) const MAX_TILE: usize = 32;
/// Number of zones of frequency.
pub(crate) const ZONES: usize = 10;
/// Zone `z` holds the frequencies with `u² + v²` below `ZONE_LIMITS[z]` and not below the limit before.
const ZONE_LIMITS: [usize; ZONES] = [1, 2, 6, 16, 36, 72, 144, 256, 484, usize::MAX];

/// The zone of the frequency `(u, v)`.
pub(crate) fn zone_of(u: usize, v: usize) -> usize {
    ZONE_LIMITS.iter().position(|&limit| u * u + v * v < limit).expect("the last limit is above everything")
}

/// The coefficients of a tile in the order of coding: by zone, in each by v, then u. In a row of a tile, those of one zone
/// are neighbours.
pub(crate) struct Scan {
    /// First place, `v · width + u`, and length of each run of neighbours, in coding order.
    runs: Vec<(u16, u16)>,
    /// End of each zone in `runs`.
    run_ends: [usize; ZONES],
    /// Coefficients of each zone.
    counts: [usize; ZONES],
}

impl Scan {
    fn new(width: usize, height: usize) -> Self {
        let mut scan = Self { runs: Vec::new(), run_ends: [0; ZONES], counts: [0; ZONES] };
        for zone in 0..ZONES {
            for v in 0..height {
                let here = (0..width).filter(|&u| zone_of(u, v) == zone);
                if let Some(first) = here.clone().next() {
                    let length = here.count();
                    scan.runs.push(((v * width + first) as u16, length as u16));
                    scan.counts[zone] += length;
                }
            }
            scan.run_ends[zone] = scan.runs.len();
        }
        scan
    }

    /// The runs of a zone, as places.
    #[inline(always)]
    pub(crate) fn runs(&self, zone: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
        let begin = if zone == 0 { 0 } else { self.run_ends[zone - 1] };
        let place = |&(first, length): &(u16, u16)| usize::from(first)..usize::from(first) + usize::from(length);
        self.runs[begin..self.run_ends[zone]].iter().map(place)
    }

    /// Runs of all zones.
    #[inline(always)]
    pub(crate) fn all_runs(&self) -> impl Iterator<Item = std::ops::Range<usize>> {
        self.runs.iter().map(|&(first, length)| usize::from(first)..usize::from(first) + usize::from(length))
    }

    /// Coefficients of a zone.
    pub(crate) fn count(&self, zone: usize) -> usize {
        self.counts[zone]
    }

    /// The scan of a tile of `width × height`, at most [`MAX_TILE`] each.
    pub(crate) fn of(width: usize, height: usize) -> &'static Self {
        static SCANS: [OnceLock<Scan>; MAX_TILE * MAX_TILE] = [const { OnceLock::new() }; MAX_TILE * MAX_TILE];
        SCANS[(width - 1) * MAX_TILE + height - 1].get_or_init(|| Self::new(width, height))
    }
}

/// The basis functions: row `u` is the `u`-th cosine over `n` places.
pub(crate) fn cosines(n: usize) -> &'static [f32] {
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

/// The basis functions place by place: row `x` is the value of every cosine there.
fn cosines_by_place(n: usize) -> &'static [f32] {
    static COSINES: [OnceLock<Vec<f32>>; MAX_TILE + 1] = [const { OnceLock::new() }; MAX_TILE + 1];
    COSINES[n].get_or_init(|| (0..n * n).map(|at| cosines(n)[at % n * n + at / n]).collect())
}

/// Transforms a tile of `width × height` values, row by row, in place. To be inlined, as [`inverse`].
#[inline(always)]
pub(crate) fn forward(tile: &mut [f32], width: usize, height: usize) {
    match width {
        4 => forward_of::<4>(tile, height),
        8 => forward_of::<8>(tile, height),
        16 => forward_of::<16>(tile, height),
        32 => forward_of::<32>(tile, height),
        _ => forward_of_any(tile, width, height),
    }
}

/// The transform of a tile of a width that vectors have: all frequencies of a row side by side. The same bits as [`forward_of_any`], since the
/// products of each sum are added in the same order.
#[inline(always)]
fn forward_of<const WIDTH: usize>(tile: &mut [f32], height: usize) {
    let (across, down) = (cosines_by_place(WIDTH).as_chunks::<WIDTH>().0, cosines(height));
    let mut rows = [[0.0f32; WIDTH]; MAX_TILE];
    for (v, out) in rows.iter_mut().take(height).enumerate() {
        let mut sum = [0.0f32; WIDTH];
        for (row, cosine) in tile.as_chunks::<WIDTH>().0.iter().zip(&down[v * height..][..height]) {
            for i in 0..WIDTH {
                sum[i] += row[i] * cosine;
            }
        }
        *out = sum;
    }
    for (row, out) in rows.iter().zip(tile.as_chunks_mut::<WIDTH>().0) {
        let mut total = [0.0f32; WIDTH];
        for lane in 0..WIDTH.min(8) {
            let mut sum = [0.0f32; WIDTH];
            for x in (lane..WIDTH).step_by(8) {
                for u in 0..WIDTH {
                    sum[u] += row[x] * across[x][u];
                }
            }
            for u in 0..WIDTH {
                total[u] += sum[u];
            }
        }
        *out = total;
    }
}

#[inline(always)]
fn forward_of_any(tile: &mut [f32], width: usize, height: usize) {
    let (across, down) = (cosines(width), cosines(height));
    let mut rows = [0.0f32; MAX_TILE * MAX_TILE];
    for (v, out) in rows.chunks_exact_mut(width).take(height).enumerate() {
        for (y, row) in tile.chunks_exact(width).enumerate() {
            add_scaled(out, row, down[v * height + y]);
        }
    }
    for (row, out) in rows.chunks_exact(width).zip(tile.chunks_exact_mut(width)) {
        for (cosine, out) in across.chunks_exact(width).zip(out) {
            *out = dot(row, cosine);
        }
    }
}

/// Eight sums side by side, so that it runs on vector units and gives the same bits on all of them.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let mut sums = [0.0f32; 8];
    for (a, b) in a.iter().zip(b) {
        for i in 0..8 {
            sums[i] += a[i] * b[i];
        }
    }
    sums.iter().sum::<f32>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f32>()
}

/// Transforms back in place. Rows and columns of coefficients that are all zero at the high end cost nothing.
///
/// Sums run in one fixed order, so that the bits do not depend on the vector units; to be inlined into a function that is
/// compiled for them. `rows` is room for [`MAX_TILE`]² values, whatever they are: to clear it for each small tile took a fifth of decoding.
#[inline(always)]
pub(crate) fn inverse(tile: &mut [f32], width: usize, height: usize, rows: &mut [f32]) {
    let (used_rows, used_columns) = used(tile, width);
    match used_columns {
        0 => return tile.fill(0.0),
        1..=4 if width >= 4 => inverse_down::<4>(tile, width, height, used_rows, rows),
        5..=8 if width >= 8 => inverse_down::<8>(tile, width, height, used_rows, rows),
        9..=16 if width >= 16 => inverse_down::<16>(tile, width, height, used_rows, rows),
        17..=32 if width >= 32 => inverse_down::<32>(tile, width, height, used_rows, rows),
        _ => inverse_down::<1>(tile, width, height, used_rows, rows),
    }
    match width {
        4 => inverse_across::<4>(tile, used_columns, rows),
        8 => inverse_across::<8>(tile, used_columns, rows),
        16 => inverse_across::<16>(tile, used_columns, rows),
        32 => inverse_across::<32>(tile, used_columns, rows),
        _ => {
            let across = cosines(width);
            for (out, row) in tile.chunks_exact_mut(width).zip(rows.chunks_exact(width)) {
                out.fill(0.0);
                for (&c, cosine) in row[..used_columns].iter().zip(across.chunks_exact(width)) {
                    add_scaled(out, cosine, c);
                }
            }
        }
    }
}

/// Rows and columns of coefficients up to the last that is not all zero. Without a branch for each value: that took a tenth of decoding.
#[inline(always)]
fn used(tile: &[f32], width: usize) -> (usize, usize) {
    let (mut rows, mut columns) = (0, [0u32; MAX_TILE]);
    for (row, end) in tile.chunks_exact(width).zip(1..) {
        let mut any = 0;
        for (column, value) in columns.iter_mut().zip(row) {
            // Zero of either sign.
            let bits = value.to_bits() << 1;
            *column |= bits;
            any |= bits;
        }
        if any != 0 {
            rows = end;
        }
    }
    (rows, columns.iter().rposition(|&column| column != 0).map_or(0, |last| last + 1))
}

/// The transform of columns, as many at a time as `LANES`, from the first `used_rows` rows of coefficients. Cosines of
/// even index are symmetric about the middle and those of odd index antisymmetric, so two rows share their sums.
#[inline(always)]
fn inverse_down<const LANES: usize>(tile: &[f32], width: usize, height: usize, used_rows: usize, rows: &mut [f32]) {
    let down = cosines(height);
    // One lane: as many as there are, one by one.
    let lanes_end = if LANES == 1 { width } else { LANES };
    for x in (0..lanes_end).step_by(LANES) {
        let coefficients = CoefficientStrip { tile: &tile[..used_rows * width], down, width, height, x };
        for y in 0..height.div_ceil(2) {
            let (even, odd) = (coefficients.sum::<LANES>(y, 0), coefficients.sum::<LANES>(y, 1));
            let out: &mut [f32; LANES] = (&mut rows[y * width + x..][..LANES]).try_into().expect("LANES values");
            for i in 0..LANES {
                out[i] = even[i] + odd[i];
            }
            let out: &mut [f32; LANES] =
                (&mut rows[(height - 1 - y) * width + x..][..LANES]).try_into().expect("LANES values");
            // The middle row of an odd number is its own mirror image, and has no odd part.
            for i in 0..LANES {
                out[i] = even[i] - odd[i];
            }
        }
    }
}

/// Neighbouring columns of a tile of coefficients, from `x` on.
struct CoefficientStrip<'a> {
    /// The rows that are used.
    tile: &'a [f32],
    /// Cosines over the height.
    down: &'a [f32],
    width: usize,
    height: usize,
    x: usize,
}

impl CoefficientStrip<'_> {
    /// What every second row from `first` on adds to row `y`.
    #[inline(always)]
    fn sum<const LANES: usize>(&self, y: usize, first: usize) -> [f32; LANES] {
        let mut sum = [0.0f32; LANES];
        for v in (first..self.tile.len() / self.width).step_by(2) {
            let values: &[f32; LANES] = self.tile[v * self.width + self.x..][..LANES].try_into().expect("LANES values");
            let cosine = self.down[v * self.height + y];
            for i in 0..LANES {
                sum[i] += values[i] * cosine;
            }
        }
        sum
    }
}

/// The transform of rows of `WIDTH`, from their first `used_columns` coefficients.
#[inline(always)]
fn inverse_across<const WIDTH: usize>(tile: &mut [f32], used_columns: usize, rows: &[f32]) {
    let across = cosines(WIDTH).as_chunks::<WIDTH>().0;
    for (out, row) in tile.as_chunks_mut::<WIDTH>().0.iter_mut().zip(rows.as_chunks::<WIDTH>().0) {
        let mut sum = [0.0f32; WIDTH];
        for (&c, cosine) in row[..used_columns].iter().zip(across) {
            for i in 0..WIDTH {
                sum[i] += cosine[i] * c;
            }
        }
        *out = sum;
    }
}

#[inline(always)]
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
            inverse(&mut tile, width, height, &mut [f32::NAN; MAX_TILE * MAX_TILE]);
            // Rounding of two passes of at most 32 products.
            assert!(tile.iter().zip(&values).all(|(a, b)| (a - b).abs() < 1e-5), "{width}×{height}");
        }
    }

    #[test]
    fn tiles_of_usual_widths_have_the_bits_of_any() {
        for (width, height) in [(4, 4), (8, 3), (16, 16), (32, 32), (32, 5)] {
            let values: Vec<f32> =
                (0..width * height).map(|i| if i % 5 == 0 { 0.0 } else { (i as f32 * 0.37).sin() * 1e3 }).collect();
            for values in [values.clone(), vec![-0.0; values.len()]] {
                let [mut usual, mut any] = [values.clone(), values];
                forward(&mut usual, width, height);
                forward_of_any(&mut any, width, height);
                assert!(usual.iter().zip(&any).all(|(a, b)| a.to_bits() == b.to_bits()), "{width}×{height}");
            }
        }
    }

    #[test]
    fn zones_cover_every_tile() {
        for (width, height) in [(1, 1), (8, 8), (32, 32), (5, 7)] {
            let scan = Scan::of(width, height);
            let mut places: Vec<usize> = (0..ZONES).flat_map(|zone| scan.runs(zone)).flatten().collect();
            let zones = (0..ZONES).flat_map(|zone| scan.runs(zone).flatten().map(move |place| (zone, place)));
            assert!(zones.into_iter().all(|(zone, place)| zone_of(place % width, place / width) == zone));
            places.sort_unstable();
            assert!(places.into_iter().eq(0..width * height));
            assert_eq!((0..ZONES).map(|zone| scan.count(zone)).sum::<usize>(), width * height);
        }
    }
}
