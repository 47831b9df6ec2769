//! One little image of a factor: transform, quantisation by rate and distortion, classes.

use super::classes::{CLASSES, MAX_MAGNITUDE, cost};
use super::rans::{RansDecoder, RansEncoder};
use super::step::step_of;
use super::transform::{MAX_TILE, Scan, ZONES, forward, inverse};

/// How an image is cut and transformed.
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
    /// Squared error in units of squared steps, plus λ times bits.
    pub(super) cost: f32,
}

#[derive(Clone, Copy)]
struct Tile {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
}

impl PlaneShape {
    fn tiles(self) -> impl Iterator<Item = Tile> {
        let side = self.tile;
        (0..self.height).step_by(side).flat_map(move |y| {
            (0..self.width).step_by(side).map(move |x| Tile {
                x,
                y,
                width: side.min(self.width - x),
                height: side.min(self.height - y),
            })
        })
    }

    fn values(self) -> usize {
        self.width * self.height
    }
}

/// Transforms and quantises an image with the step of an index. `lambda` is the squared error, in squared steps, that a bit is worth.
pub(super) fn plan(values: &[f32], shape: PlaneShape, step: i32, lambda: f32) -> PlanePlan {
    let mut bands = pulp::Arch::new().dispatch(Bands { values, shape });
    let mut plan = PlanePlan { classes: [0; ZONES], bands: Default::default(), cost: 0.0 };
    let inverse_step = 1.0 / step_of(step);
    for (zone, band) in bands.iter_mut().enumerate() {
        band.iter_mut().for_each(|c| *c *= inverse_step);
        let (class, quantised, cost) = quantise(band, lambda);
        plan.classes[zone] = class;
        plan.bands[zone] = quantised;
        plan.cost += cost;
    }
    plan
}

/// The coefficients of an image by zone: a call that is compiled for each vector unit.
struct Bands<'a> {
    values: &'a [f32],
    shape: PlaneShape,
}

impl pulp::NullaryFnOnce for Bands<'_> {
    type Output = [Vec<f32>; ZONES];

    #[inline(always)]
    fn call(self) -> Self::Output {
        bands(self.values, self.shape)
    }
}

#[inline(always)]
fn bands(values: &[f32], shape: PlaneShape) -> [Vec<f32>; ZONES] {
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
            let mut start = 0;
            for (band, &end) in bands.iter_mut().zip(&scan.ends) {
                band.extend(scan.order[start..end].iter().map(|&place| buffer[usize::from(place)]));
                start = end;
            }
        }
    }
    bands
}

/// Quantises a band: the class and values of least `error + λ · bits`.
fn quantise(band: &[f32], lambda: f32) -> (u32, Vec<i32>, f32) {
    let zero_cost: f32 = band.iter().map(|c| c * c).sum();
    let mut values: Vec<i32> = band.iter().map(|&c| round(c)).collect();
    if values.iter().all(|&v| v == 0) {
        return (0, values, zero_cost);
    }
    let mut class = best_class(&values);
    for _ in 0..2 {
        for (value, &c) in values.iter_mut().zip(band) {
            *value = best_value(c, class, lambda);
        }
        if values.iter().all(|&v| v == 0) {
            return (0, values, zero_cost);
        }
        class = best_class(&values);
    }
    let error: f32 = values.iter().zip(band).map(|(&v, c)| (c - v as f32).powi(2)).sum();
    let bits: f32 = values.iter().map(|&v| cost(class, v)).sum();
    let total = error + lambda * bits;
    if total < zero_cost { (class, values, total) } else { (0, vec![0; band.len()], zero_cost) }
}

fn round(c: f32) -> i32 {
    (c.round() as i32).clamp(-MAX_MAGNITUDE, MAX_MAGNITUDE)
}

/// Of the nearest value, the next one towards zero, and zero: the one of least `error + λ · bits`.
fn best_value(c: f32, class: u32, lambda: f32) -> i32 {
    let nearest = round(c);
    if nearest == 0 {
        return 0;
    }
    let weigh = |value: i32| (c - value as f32).powi(2) + lambda * cost(class, value);
    let mut best = (weigh(nearest), nearest);
    for value in [nearest - nearest.signum(), 0] {
        let weight = weigh(value);
        if weight < best.0 {
            best = (weight, value);
        }
    }
    best.1
}

fn best_class(values: &[i32]) -> u32 {
    // The cost is unimodal in the class, near the mean magnitude.
    let mean = values.iter().map(|v| f64::from(v.unsigned_abs())).sum::<f64>() / values.len() as f64;
    let guess = ((mean.max(0.01) / 0.15).log2() * 2.0) as i32 + 1;
    let range = (guess - 4).clamp(1, CLASSES as i32 - 1)..=(guess + 4).clamp(1, CLASSES as i32 - 1);
    let total = |class: u32| values.iter().map(|&v| cost(class, v)).sum::<f32>();
    range
        .map(|class| (total(class as u32), class as u32))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .expect("the range is not empty")
        .1
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
    step: f32,
    scratch: &mut Scratch,
    out: &mut [f32],
) {
    debug_assert_eq!(out.len(), shape.values());
    let zones = if shape.tile == 0 { 1 } else { ZONES };
    if classes[..zones].iter().all(|&class| class == 0) {
        return out.fill(0.0);
    }
    let Scratch { integers, tiles, scans } = scratch;
    if shape.tile == 0 {
        integers.resize(shape.values(), 0);
        decoder.read_band(classes[0], integers);
        out.iter_mut().zip(integers).for_each(|(out, &mut q)| *out = q as f32 * step);
        return;
    }
    tiles.clear();
    tiles.resize(shape.values(), 0.0);
    scans.clear();
    scans.extend(shape.tiles().map(|tile| Scan::of(tile.width, tile.height)));
    for (zone, &class) in classes.iter().enumerate().filter(|(_, class)| **class != 0) {
        integers.resize(scans.iter().map(|scan| scan.zone(zone).len()).sum(), 0);
        decoder.read_band(class, integers);
        let (mut values, mut buffer) = (integers.as_slice(), tiles.as_mut_slice());
        for scan in scans.iter() {
            let tile;
            (tile, buffer) = buffer.split_at_mut(scan.order.len());
            let places = scan.zone(zone);
            let here;
            (here, values) = values.split_at(places.len());
            for (&place, &q) in places.iter().zip(here) {
                tile[usize::from(place)] = q as f32 * step;
            }
        }
    }
    let mut start = 0;
    for tile in shape.tiles() {
        let buffer = &mut tiles[start..start + tile.width * tile.height];
        inverse(buffer, tile.width, tile.height);
        for (row, y) in buffer.chunks_exact(tile.width).zip(tile.y..) {
            out[y * shape.width + tile.x..][..tile.width].copy_from_slice(row);
        }
        start += buffer.len();
    }
}

/// Buffers that reading reuses.
#[derive(Default)]
pub(super) struct Scratch {
    integers: Vec<i32>,
    tiles: Vec<f32>,
    scans: Vec<&'static Scan>,
}
