//! One little image of a factor: transform, quantisation by rate and distortion, classes.

use super::classes::{CLASSES, ESCAPE, LARGEST, MAX_MAGNITUDE, MIN_SCALE, SYMBOLS, coding_of, escape_bits, symbol_of};
use super::rans::{RansDecoder, RansEncoder};
use super::step::Steps;
use crate::matrix::cosines::{MAX_TILE, Scan, ZONES, forward, inverse};

/// Tiling and transform of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PlaneShape {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Side of a full tile; 0: the values are coded as they are.
    pub(super) tile: usize,
}

/// A quantised image.
#[derive(Clone, Debug)]
pub(super) struct PlanePlan {
    /// Class of each zone.
    pub(super) classes: [u32; ZONES],
    /// Values of each zone.
    pub(super) bands: [Vec<i32>; ZONES],
}

#[derive(Clone, Copy)]
struct CoefficientTile {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
}

impl PlaneShape {
    fn tiles(self) -> impl Iterator<Item = CoefficientTile> {
        let side = self.tile;
        (0..self.height).step_by(side).flat_map(move |y| {
            (0..self.width).step_by(side).map(move |x| CoefficientTile {
                x,
                y,
                width: side.min(self.width - x),
                height: side.min(self.height - y),
            })
        })
    }

    /// Bands with steps of their own.
    pub(super) fn bands(self) -> usize {
        if self.tile == 0 { self.values() } else { ZONES }
    }

    pub(super) fn values(self) -> usize {
        self.width * self.height
    }
}

/// Transforms and quantises an image with the steps of its bands. `lambda` is the squared error, in squared steps, that a bit is worth.
pub(super) fn plan(values: &[f32], shape: PlaneShape, steps: Steps<'_>, lambda: f32) -> PlanePlan {
    pulp::Arch::new().dispatch(Planning { values, shape, steps, lambda })
}

/// A call that is compiled for each vector unit.
struct Planning<'a> {
    values: &'a [f32],
    shape: PlaneShape,
    steps: Steps<'a>,
    lambda: f32,
}

impl pulp::NullaryFnOnce for Planning<'_> {
    type Output = PlanePlan;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let mut plan = PlanePlan { classes: [0; ZONES], bands: Default::default() };
        for (zone, mut band) in bands(self.values, self.shape).into_iter().enumerate() {
            if self.shape.tile == 0 && !self.steps.are_even() {
                band.iter_mut().enumerate().for_each(|(i, c)| *c *= 1.0 / self.steps.of(i));
            } else {
                let inverse_step = 1.0 / self.steps.of(zone);
                band.iter_mut().for_each(|c| *c *= inverse_step);
            }
            (plan.classes[zone], plan.bands[zone]) = quantise(&band, self.lambda);
        }
        plan
    }
}

/// Sides of tiles that a block's pixels may be cut into, by stored index.
pub(super) const TILES: [usize; 4] = [32, 16, 8, 4];

/// How much finer than its component's step each zone of a left side is stored, in half octaves, by the stored index of
/// its tile: so that errors are seen alike at all frequencies.
///
/// At 67 pixels a degree, contrast sensitivity (Andersson et al. 2020, after Johnson and Fairchild 2003) falls to a third
/// from an eighth to a quarter of a cycle a pixel, and to nothing at a half. Steps follow it down to an eighth of the
/// finest, not farther, as images are magnified. Towards the lowest frequencies steps become finer than it asks for: what is
/// left of them are steps at the borders of tiles and blocks, which are seen best. Tuned: decision 70. Images divided by the
/// brightness of their pixels take as many bits: decision 72.
const ZONE_STEPS: [[i8; ZONES]; TILES.len()] = [
    [6, 3, 2, 1, 1, 0, -1, -2, -4, -5],
    [3, 2, 1, 0, -1, -3, -4, -5, -6, -6],
    [2, 1, 0, -2, -4, -6, -6, -6, -6, -6],
    [0, -1, -3, -5, -6, -6, -6, -6, -6, -6],
];

/// The step of a component over that of the finest of its zones.
pub(super) const FINEST_ZONE: f32 = 8.0;

/// [`Steps::band_steps`] of a left side whose tiles have this stored index: of their zones, or all alike.
pub(super) fn zone_steps(tile: usize, by_eye: bool) -> &'static [i8] {
    if by_eye { &ZONE_STEPS[tile] } else { &[] }
}

/// About what coding an image would cost: squared error in squared steps plus `lambda` times bits, from the mean
/// magnitudes of its zones.
pub(super) fn estimate(values: &[f32], shape: PlaneShape, steps: Steps<'_>, lambda: f32) -> f32 {
    pulp::Arch::new().dispatch(Estimating { values, shape, steps, lambda })
}

struct Estimating<'a> {
    values: &'a [f32],
    shape: PlaneShape,
    steps: Steps<'a>,
    lambda: f32,
}

impl pulp::NullaryFnOnce for Estimating<'_> {
    type Output = f32;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let cost = |(zone, band): (usize, &Vec<f32>)| {
            let inverse_step = 1.0 / self.steps.of(zone);
            let (mut magnitudes, mut squares) = ([0.0f32; 16], [0.0f32; 16]);
            let (groups, rest) = band.as_chunks::<16>();
            for group in groups {
                for i in 0..16 {
                    magnitudes[i] += group[i].abs();
                    squares[i] += group[i] * group[i];
                }
            }
            let rest_sum = |part: fn(f32) -> f32| rest.iter().map(|&c| part(c)).sum::<f32>();
            let magnitude = (magnitudes.iter().sum::<f32>() + rest_sum(f32::abs)) * inverse_step;
            let zero = (squares.iter().sum::<f32>() + rest_sum(|c| c * c)) * inverse_step * inverse_step;
            let count = band.len() as f32;
            let bits = laplace_bits(magnitude / count) * count + CLASS_BITS;
            zero.min(zero.min(count / 12.0) + self.lambda * bits)
        };
        bands(self.values, self.shape).iter().enumerate().filter(|(_, band)| !band.is_empty()).map(cost).sum()
    }
}

/// Bits that the class of a band takes, about.
const CLASS_BITS: f32 = 2.0;

/// Entropy in bits of a Laplace variable of this mean magnitude, rounded to whole numbers.
fn laplace_bits(mean: f32) -> f32 {
    let two_sided = |p: f32| if p <= 0.0 || p >= 1.0 { 0.0 } else { -p * p.log2() - (1.0 - p) * (1.0 - p).log2() };
    // P(0) = 1 − r, and the magnitudes above fall by r² each: see `guess_class`.
    let root = (-0.5 / mean.max(1e-3)).exp();
    let ratio = (root * root).min(0.999_999);
    two_sided(root) + root * (1.0 + two_sided(ratio) / (1.0 - ratio))
}

/// The coefficients of an image by zone.
#[inline(always)]
pub(super) fn bands(values: &[f32], shape: PlaneShape) -> [Vec<f32>; ZONES] {
    let mut bands: [Vec<f32>; ZONES] = Default::default();
    if shape.tile == 0 {
        bands[0].extend(values);
    } else {
        let mut buffer = [0.0; MAX_TILE * MAX_TILE];
        for tile in shape.tiles() {
            let buffer = &mut buffer[..tile.width * tile.height];
            for (row, y) in buffer.chunks_exact_mut(tile.width).zip(tile.y..) {
                row.copy_from_slice(&values[y * shape.width + tile.x..][..tile.width]);
            }
            forward(buffer, tile.width, tile.height);
            let scan = Scan::of(tile.width, tile.height);
            for (zone, band) in bands.iter_mut().enumerate() {
                scan.runs(zone).for_each(|run| band.extend_from_slice(&buffer[run]));
            }
        }
    }
    bands
}

/// Quantises a band: the class and values of about the least `error + λ · bits`.
#[inline(always)]
fn quantise(band: &[f32], lambda: f32) -> (u32, Vec<i32>) {
    let mut values = vec![0; band.len()];
    let mut total = round(band, Rounding::NEAREST, &mut values);
    for _ in 0..2 {
        if total == 0 {
            return (0, values);
        }
        let (class, _) = best_class(&values, guess_class(total, band.len()));
        let rounding = Rounding::of(class, lambda);
        total = round(band, rounding, &mut values);
    }
    if total == 0 {
        return (0, values);
    }
    let (class, bits) = best_class(&values, guess_class(total, band.len()));
    let error: f32 = values.iter().zip(band).map(|(&v, c)| (c - v as f32).powi(2)).sum();
    let zero_cost: f32 = band.iter().map(|c| c * c).sum();
    if error + lambda * bits < zero_cost {
        return (class, values);
    }
    values.fill(0);
    (0, values)
}

/// Rounding of coefficients to integers.
#[derive(Clone, Copy)]
struct Rounding {
    /// Magnitudes below this become 0.
    zero: f32,
    /// Is added to the others before their fraction is cut off.
    offset: f32,
}

impl Rounding {
    const NEAREST: Self = Self { zero: 0.5, offset: 0.5 };

    /// The next smaller number is taken where it saves `λ` times more bits than it adds squared error. Between
    /// neighbours of a Laplace distribution that saving is the same everywhere but at 0.
    fn of(class: u32, lambda: f32) -> Self {
        let (table, shift) = coding_of(class);
        let centre = LARGEST as usize;
        let bits = |n: usize| table.bits[centre + n];
        let slope = (bits(3) - bits(2)) / (1 << shift) as f32;
        let from_zero = if shift == 0 { bits(1) - bits(0) } else { slope };
        Self { zero: 0.5 + 0.5 * lambda * from_zero, offset: 0.5 - 0.5 * lambda * slope }
    }
}

/// Rounds a band. Returns the sum of the magnitudes.
#[inline(always)]
fn round(band: &[f32], rounding: Rounding, values: &mut [i32]) -> u64 {
    let one = |c: f32| {
        let magnitude = c.abs();
        let whole = if magnitude < rounding.zero { 0.0 } else { magnitude + rounding.offset };
        let whole = whole.min(MAX_MAGNITUDE as f32) as i32;
        (whole, if c < 0.0 { -whole } else { whole })
    };
    let mut sums = [0u64; 8];
    let (groups, rest) = band.as_chunks::<8>();
    let (places, rest_places) = values.as_chunks_mut::<8>();
    for (group, places) in groups.iter().zip(places) {
        for i in 0..8 {
            let (magnitude, value) = one(group[i]);
            places[i] = value;
            sums[i] += u64::from(magnitude as u32);
        }
    }
    let mut sum: u64 = sums.iter().sum();
    for (&c, place) in rest.iter().zip(rest_places) {
        let (magnitude, value) = one(c);
        *place = value;
        sum += u64::from(magnitude as u32);
    }
    sum
}

/// The class whose distribution has this mean magnitude. With scale `b` and `r = exp(−1 / 2b)`, the mean magnitude of a
/// Laplace variable rounded to whole numbers is `r / (1 − r²)`.
fn guess_class(total: u64, count: usize) -> u32 {
    let mean = total as f32 / count as f32;
    let root = ((1.0 + 4.0 * mean * mean).sqrt() - 1.0) / (2.0 * mean);
    let scale = -0.5 / root.clamp(1e-12, 1.0 - 1e-7).ln();
    (2.0 * (scale / MIN_SCALE).log2()).round().clamp(0.0, CLASSES as f32 - 2.0) as u32 + 1
}

/// The class near a guess that codes the values in the fewest bits, and these.
#[inline(always)]
fn best_class(values: &[i32], guess: u32) -> (u32, f32) {
    // Two classes share each shift, and all without one theirs.
    let mut counted: Option<SymbolCounts> = None;
    let mut total = |class: u32| {
        let (table, shift) = coding_of(class);
        let SymbolCounts { symbols, escape_bits, .. } = match counted {
            Some(counts) if counts.shift == shift => counts,
            _ => *counted.insert(SymbolCounts::of(values, shift)),
        };
        let coded: f32 = symbols.iter().zip(&table.bits).map(|(&n, &bits)| n as f32 * bits).sum();
        coded + (escape_bits + shift * values.len() as u32) as f32
    };
    // Real bands have heavier tails than the distributions, but the bits have one minimum.
    let mut best = (guess, total(guess));
    for step in [1, -1] {
        let from = best.0;
        loop {
            let class = best.0 as i32 + step;
            if !(1..CLASSES as i32).contains(&class) {
                break;
            }
            let bits = total(class as u32);
            if bits >= best.1 {
                break;
            }
            best = (class as u32, bits);
        }
        if best.0 != from {
            break;
        }
    }
    best
}

/// What the symbols of some values cost.
#[derive(Clone, Copy)]
struct SymbolCounts {
    shift: u32,
    /// How often each symbol comes after the shift.
    symbols: [u32; SYMBOLS],
    /// Bits behind the escapes.
    escape_bits: u32,
}

impl SymbolCounts {
    #[inline(always)]
    fn of(values: &[i32], shift: u32) -> Self {
        // Neighbours are often alike: adding to one counter again and again would wait for itself.
        let mut counts = [[0u32; SYMBOLS]; 4];
        let mut escapes = 0;
        let mut add = |counts: &mut [u32; SYMBOLS], value: i32| {
            let high = value >> shift;
            let symbol = symbol_of(high);
            counts[symbol] += 1;
            if symbol == ESCAPE {
                escapes += escape_bits(high);
            }
        };
        let (groups, rest) = values.as_chunks::<4>();
        for group in groups {
            counts.iter_mut().zip(group).for_each(|(counts, &value)| add(counts, value));
        }
        rest.iter().for_each(|&value| add(&mut counts[0], value));
        let [mut sum, others @ ..] = counts;
        others.iter().flatten().enumerate().for_each(|(i, n)| sum[i % SYMBOLS] += n);
        Self { shift, symbols: sum, escape_bits: escapes }
    }
}

/// Puts the values of an image into the stream.
pub(super) fn push(encoder: &mut RansEncoder, plan: &PlanePlan) {
    for (&class, band) in plan.classes.iter().zip(&plan.bands) {
        if class != 0 {
            encoder.push_band(class, band);
        }
    }
}

/// Reads an image back into `out`.
#[inline(always)]
pub(super) fn read(
    decoder: &mut RansDecoder<'_>,
    classes: &[u32; ZONES],
    shape: PlaneShape,
    steps: Steps<'_>,
    scratch: &mut Scratch,
    out: &mut [f32],
) {
    debug_assert_eq!(out.len(), shape.values());
    let zones = if shape.tile == 0 { 1 } else { ZONES };
    if classes[..zones].iter().all(|&class| class == 0) {
        return out.fill(0.0);
    }
    let Scratch { integers, coefficients, rows, .. } = scratch;
    if shape.tile == 0 {
        integers.resize(shape.values(), 0);
        decoder.read_band(classes[0], integers);
        let values = out.iter_mut().zip(integers);
        if steps.are_even() {
            let step = steps.of(0);
            values.for_each(|(out, &mut q)| *out = q as f32 * step);
        } else {
            values.enumerate().for_each(|(i, (out, &mut q))| *out = q as f32 * steps.of(i));
        }
        return;
    }
    rows.resize(MAX_TILE * MAX_TILE, 0.0);
    coefficients.clear();
    coefficients.resize(shape.values(), 0.0);
    let tiles = scratch.tiles.of(shape);
    for (zone, &class) in classes.iter().enumerate().filter(|(_, class)| **class != 0) {
        integers.resize(tiles.iter().map(|(_, scan)| scan.count(zone)).sum(), 0);
        decoder.read_band(class, integers);
        let step = steps.of(zone);
        let (mut values, mut buffer) = (integers.as_slice(), coefficients.as_mut_slice());
        for (tile, scan) in tiles {
            let of_tile;
            (of_tile, buffer) = buffer.split_at_mut(tile.width * tile.height);
            for run in scan.runs(zone) {
                let here;
                (here, values) = values.split_at(run.len());
                of_tile[run].iter_mut().zip(here).for_each(|(value, &q)| *value = q as f32 * step);
            }
        }
    }
    let mut start = 0;
    for (tile, _) in tiles {
        let buffer = &mut coefficients[start..start + tile.width * tile.height];
        inverse(buffer, tile.width, tile.height, rows);
        for (row, y) in buffer.chunks_exact(tile.width).zip(tile.y..) {
            out[y * shape.width + tile.x..][..tile.width].copy_from_slice(row);
        }
        start += buffer.len();
    }
}

/// Reads the numbers of an image into `out`, where zeros stand: tile by tile, in each in the order of coding.
#[inline(always)]
pub(super) fn read_numbers(
    decoder: &mut RansDecoder<'_>,
    classes: &[u32; ZONES],
    shape: PlaneShape,
    scratch: &mut Scratch,
    out: &mut [i32],
) {
    debug_assert_eq!(out.len(), shape.values());
    if shape.tile == 0 {
        if classes[0] != 0 {
            decoder.read_band(classes[0], out);
        }
        return;
    }
    let Scratch { integers, ends, .. } = scratch;
    let tiles = scratch.tiles.of(shape);
    // Of each tile the end of what was read of it.
    ends.clear();
    let mut end = 0;
    for (tile, _) in tiles {
        ends.push(end);
        end += tile.width * tile.height;
    }
    for (zone, &class) in classes.iter().enumerate() {
        if class != 0 {
            integers.resize(tiles.iter().map(|(_, scan)| scan.count(zone)).sum(), 0);
            decoder.read_band(class, integers);
        }
        let mut rest = integers.as_slice();
        for ((_, scan), end) in tiles.iter().zip(&mut *ends) {
            let count = scan.count(zone);
            if class != 0 {
                let here;
                (here, rest) = rest.split_at(count);
                out[*end..*end + count].copy_from_slice(here);
            }
            *end += count;
        }
    }
}

/// Buffers that reading reuses.
#[derive(Default)]
pub(super) struct Scratch {
    integers: Vec<i32>,
    /// Tile by tile.
    coefficients: Vec<f32>,
    tiles: CutTiles,
    ends: Vec<usize>,
    /// Scratch memory of the transform.
    rows: Vec<f32>,
}

/// The tiles of an image: the next image is often cut like it.
#[derive(Default)]
struct CutTiles {
    shape: Option<PlaneShape>,
    tiles: Vec<(CoefficientTile, &'static Scan)>,
}

impl CutTiles {
    fn of(&mut self, shape: PlaneShape) -> &[(CoefficientTile, &'static Scan)] {
        if self.shape != Some(shape) {
            self.shape = Some(shape);
            self.tiles.clear();
            self.tiles.extend(shape.tiles().map(|tile| (tile, Scan::of(tile.width, tile.height))));
        }
        &self.tiles
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The page's decoder and the document of the format have them again.
    #[test]
    fn steps_of_zones_are_those_of_the_page_and_of_the_document() {
        let (page, document) =
            (include_str!("../../../page/src/codec.js"), include_str!("../../../formats/ltc.md").replace('−', "-"));
        for (steps, tile) in ZONE_STEPS.iter().zip(TILES) {
            let list = |separator: &str| steps.map(|step| step.to_string()).join(separator);
            assert!(page.contains(&format!("  [{}],\n", list(", "))), "{steps:?}");
            assert!(document.contains(&format!("| {tile} | {} |\n", list(" | "))), "{steps:?}");
            let finest = steps.iter().max().copied().unwrap_or(0);
            assert!((f32::from(finest) / 2.0).exp2() <= FINEST_ZONE);
        }
    }
}
