//! One component of a block as it is to be coded: rotation, tiles and quantised images.

use super::classes::MAX_MAGNITUDE;
use super::planes::{FINEST_ZONE, PlanePlan, PlaneShape, TILES, estimate, plan, zone_steps};
use super::rotation::{ROTATION_BITS, Rotation, rotate, transposed};
use super::settings::CodecSettings;
use super::side::{ComponentHead, PlaneKind};
use super::step::{Steps, index_of};
use crate::container::layout::{BlockLayout, LightLayout};
use crate::matrix::cosines::MAX_TILE;
use crate::matrix::{CHANNELS, FactoredBlock};

/// Stored index of the tiles with which the cost of rotations is compared: of 16.
const USUAL_TILE: usize = 1;

/// A quantised component.
pub(super) struct QuantisedComponent {
    pub(super) head: ComponentHead,
    left: [PlanePlan; CHANNELS],
    right: Vec<PlanePlan>,
}

impl QuantisedComponent {
    /// Quantises component `k` with the steps that it asks for. `before` is the component before it.
    pub(super) fn new(
        layout: &BlockLayout,
        block: &FactoredBlock,
        k: usize,
        before: Option<&ComponentHead>,
        settings: &CodecSettings,
    ) -> Self {
        let (left, right) = (block.left_component(k), block.right_component(k));
        let finest = if block.by_eye { FINEST_ZONE } else { 1.0 };
        let left_step = index_of(allowed_step(&block.left_step, k, left, finest));
        let right_step = allowed_step(&block.right_step, k, right, 1.0).max(least_right_step(layout, block, right));
        let right_step = index_of(right_step);
        let shape = |tile: usize| PlaneShape { width: layout.width, height: layout.height, tile };
        let lambda = settings.lambda;
        let steps = |tile: usize| Steps { index: left_step, band_steps: zone_steps(tile, block.by_eye) };
        let cost = |plane: &[f32], tile: usize| estimate(plane, shape(TILES[tile]), steps(tile), lambda);
        let turned = |rotation: Rotation| {
            let mut planes = left.to_vec();
            rotate(&mut planes, rotation.matrix());
            planes
        };
        let mut rotation = Rotation::onto_axes(left);
        let mut planes = turned(rotation);
        if let Some(before) = before.map(|head| Rotation(head.rotation)).filter(|&before| before != rotation) {
            let other = turned(before);
            let total = |planes: &[f32]| -> f32 {
                planes.chunks_exact(layout.pixels()).map(|plane| cost(plane, USUAL_TILE)).sum()
            };
            if total(&other) < total(&planes) + lambda * ROTATION_BITS as f32 {
                (rotation, planes) = (before, other);
            }
        }
        // The strongest colour axis has most of the bits.
        let strong = &planes[..layout.pixels()];
        let costs: [f32; TILES.len()] = std::array::from_fn(|tile| cost(strong, tile));
        let tile = (0..TILES.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).expect("there are tiles");
        let image = |c: usize| &planes[c * layout.pixels()..][..layout.pixels()];
        let left = std::array::from_fn(|c| plan(image(c), shape(TILES[tile]), steps(tile), lambda));
        let mut rest = right;
        let right_plans = right_images(&layout.lights, &block.right_band_steps).map(|(shape, band_steps)| {
            let plane;
            (plane, rest) = rest.split_at(shape.values());
            plan(plane, shape, Steps { index: right_step, band_steps }, lambda)
        });
        let right = right_plans.collect();
        Self { head: ComponentHead { tile: tile as u32, left_step, right_step, rotation: rotation.0 }, left, right }
    }

    /// Its images in coding order.
    pub(super) fn planes(&self) -> impl Iterator<Item = (PlaneKind, &PlanePlan)> {
        let left = self.left.iter().enumerate().map(|(c, plane)| (PlaneKind::left(c), plane));
        left.chain(self.right.iter().map(|plane| (PlaneKind::Right, plane)))
    }
}

/// Turns the channels of a decoded left side back.
#[inline(always)]
pub(super) fn turn_back(left: &mut [f32], rotation: u32) {
    rotate(left, transposed(Rotation(rotation).matrix()));
}

/// The step that a component asks for, whose finest band has it divided by `finest`; where none is given, what a 16-bit float would keep of its largest value.
fn allowed_step(steps: &[f32], k: usize, values: &[f32], finest: f32) -> f32 {
    let largest = values.iter().fold(0.0f32, |m, v| m.max(v.abs()));
    // Coefficients are at most √1024 times larger than values; they must stay inside what is stored.
    let least = finest * largest * 1e-5;
    steps.get(k).map_or(largest / 2048.0, |&step| step).max(least)
}

/// Steps of a right side are at least this, so that the values of its finest bands stay inside what is stored.
fn least_right_step(layout: &BlockLayout, block: &FactoredBlock, values: &[f32]) -> f32 {
    let (mut rest, mut least) = (values, 0.0f32);
    for (shape, band_steps) in right_images(&layout.lights, &block.right_band_steps) {
        let plane;
        (plane, rest) = rest.split_at(shape.values());
        let largest = plane.iter().fold(0.0f32, |m, v| m.max(v.abs()));
        let finest = band_steps.iter().fold(0, |finest, &f| finest.max(f));
        // As in `allowed_step`; half a step of the index more, for rounding.
        let coefficient = largest * if shape.tile == 0 { 1.0 } else { shape.tile as f32 };
        least = least.max(1.05 * coefficient * (f32::from(finest) / 2.0).exp2() / MAX_MAGNITUDE as f32);
    }
    least
}

/// The images of a component of the right factor.
pub(super) fn right_shapes(lights: &LightLayout) -> impl Iterator<Item = PlaneShape> {
    lights.planes().iter().map(|plane| PlaneShape {
        width: plane.across,
        height: plane.down,
        tile: if plane.is_image { MAX_TILE } else { 0 },
    })
}

/// Bands of a right side, in all its images.
pub(super) fn right_bands(lights: &LightLayout) -> usize {
    right_shapes(lights).map(PlaneShape::bands).sum()
}

/// The images of a component of the right factor, each with how much finer its bands are.
pub(super) fn right_images<'a>(
    lights: &LightLayout,
    band_steps: &'a [i8],
) -> impl Iterator<Item = (PlaneShape, &'a [i8])> {
    let mut rest = band_steps;
    right_shapes(lights).map(move |shape| {
        let here;
        (here, rest) = rest.split_at(shape.bands().min(rest.len()));
        (shape, here)
    })
}
