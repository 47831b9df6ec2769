//! Several lightings of one block, `L (R ℓ) + S ℓ`: its factors are turned into f32 once for all of them. Sums are made in
//! the order in which one lighting makes them, so that the bits are the same.

use super::compact::{CompactBlock, Factor, Part, Quantum};
use super::project::{PlanarLighting, project};
use super::scatter::scatter;
use crate::matrix::CHANNELS;

/// Rows that are finished together under [`PAIR`] lightings: their sums stay in registers while the components pass by.
const TILE: usize = 64;
const PAIR: usize = 2;

/// Lightings that are worked on before their rows are used: these stay in the second-level cache.
const GROUP: usize = 8;

/// Gives `each` the index of every lighting with the rows of the block under it, channel-planar.
pub(super) fn relit_batch(block: &CompactBlock, lightings: &[PlanarLighting], each: &mut dyn FnMut(usize, &[f32])) {
    let arch = pulp::Arch::new();
    let right = arch.dispatch(Widen(&block.right));
    let rows = block.left.length;
    let mut planes = vec![0.0; GROUP.min(lightings.len()) * rows];
    for (group, lightings) in lightings.chunks(GROUP).enumerate() {
        let planes = &mut planes[..lightings.len() * rows];
        arch.dispatch(Group { block, right: &right, lightings, planes });
        for (i, planes) in planes.chunks_exact(rows).enumerate() {
            each(group * GROUP + i, planes);
        }
    }
}

/// See [`Factor::widen`]; compiled for the vectors that the machine has. Not a closure: what wraps one is compiled without
/// them.
struct Widen<'a>(&'a Factor);

impl pulp::NullaryFnOnce for Widen<'_> {
    type Output = Factor<f32, f32>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        self.0.widen()
    }
}

/// Some lightings of a block; compiled as [`Widen`].
struct Group<'a> {
    block: &'a CompactBlock,
    right: &'a Factor<f32, f32>,
    lightings: &'a [PlanarLighting],
    /// Lightings × rows.
    planes: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Group<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { block, right, lightings, planes } = self;
        let left = &block.left;
        // Components in the order in which their values lie in `L`.
        let order: Vec<u32> = left.narrow.components.iter().chain(&left.wide.components).copied().collect();
        let mut of_component = Vec::new();
        let mut projected = Vec::with_capacity(lightings.len() * order.len());
        for lighting in lightings {
            project(right, &block.scales, lighting, &mut of_component);
            projected.extend(order.iter().map(|&k| of_component[k as usize]));
        }
        reconstruct(left, &projected, order.len(), planes);
        for (lighting, planes) in lightings.iter().zip(planes.chunks_exact_mut(left.length)) {
            scatter(block, lighting, planes);
        }
    }
}

/// Sets `planes` (lightings × rows) to `L y`; `projected` is lightings × components.
#[inline(always)]
fn reconstruct(left: &Factor, projected: &[[f32; CHANNELS]], components: usize, planes: &mut [f32]) {
    let (rows, pixels) = (left.length, left.length / CHANNELS);
    let mut tile: Vec<[f32; TILE]> = Vec::with_capacity(components);
    for channel in 0..CHANNELS {
        for first in (0..pixels).step_by(TILE) {
            let (first, count) = (channel * pixels + first, TILE.min(pixels - first));
            tile.clear();
            widen_tile(&left.narrow, rows, (first, count), &mut tile);
            widen_tile(&left.wide, rows, (first, count), &mut tile);
            for (pair, planes) in planes.chunks_mut(PAIR * rows).enumerate() {
                let of = |i: usize| &projected[(PAIR * pair + i) * components..][..components];
                // The second of a pair that lacks one is worked out and left.
                let sums = sum_components(&tile, [of(0), of(planes.len() / rows - 1)], channel);
                for (sums, planes) in sums.iter().zip(planes.chunks_exact_mut(rows)) {
                    planes[first..][..count].copy_from_slice(&sums[..count]);
                }
            }
        }
    }
}

/// Adds the components' values in some rows, given as (first, count), to `tile`; what is beyond them is 0.
#[inline(always)]
fn widen_tile<Q: Quantum>(part: &Part<Q>, rows: usize, (first, count): (usize, usize), tile: &mut Vec<[f32; TILE]>) {
    for values in part.values.chunks_exact(rows) {
        let mut wide = [0.0f32; TILE];
        match values[first..][..count].as_array::<TILE>() {
            Some(values) => (0..TILE).for_each(|i| wide[i] = values[i].to_f32()),
            None => wide.iter_mut().zip(&values[first..][..count]).for_each(|(wide, value)| *wide = value.to_f32()),
        }
        tile.push(wide);
    }
}

#[inline(always)]
fn sum_components(tile: &[[f32; TILE]], projected: [&[[f32; CHANNELS]]; PAIR], channel: usize) -> [[f32; TILE]; PAIR] {
    let mut sums = [[0.0f32; TILE]; PAIR];
    for (values, (a, b)) in tile.iter().zip(projected[0].iter().zip(projected[1])) {
        let (a, b) = (a[channel], b[channel]);
        for i in 0..TILE {
            sums[0][i] += values[i] * a;
            sums[1][i] += values[i] * b;
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::super::random::{Random, random_lighting};
    use super::super::{CpuRelighter, relight_region_streaming};
    use crate::matrix::{MatrixShape, PixelRect};

    #[test]
    fn a_batch_has_the_bits_of_its_lightings_one_by_one() {
        // Blocks of every kind of edge; batches that are no whole number of groups or pairs.
        for (width, height, columns, count) in [(37, 21, 7, 2), (40, 20, 70, 19), (64, 33, 32, 8)] {
            let shape = MatrixShape::new(width, height, columns, 16).unwrap();
            let source = Random(shape);
            let relighter = CpuRelighter::load(&source).unwrap();
            let lightings: Vec<_> = (0..count).map(|seed| random_lighting(shape, seed)).collect();
            let region = PixelRect { x: 0, y: 0, width, height };
            let mut pixels = vec![[9.0; 3]; lightings.len() * region.pixels()];
            relighter.relight_region(&lightings, region, &mut pixels).unwrap();
            for (lighting, pixels) in lightings.iter().zip(pixels.chunks_exact(region.pixels())) {
                assert_eq!(relighter.relight(lighting).unwrap().pixels, pixels);
            }
            let mut streamed = vec![[8.0; 3]; pixels.len()];
            relight_region_streaming(&source, &lightings, region, &mut streamed).unwrap();
            assert_eq!(streamed, pixels);
        }
    }
}
