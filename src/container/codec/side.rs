//! What the side stream says of each component: tiles, steps, rotation, classes.

use super::adaptive::{BitCoder, Context, SignedContexts};
use super::classes::CLASSES;
use super::rotation::ROTATION_BITS;
use super::step::{STEP_BITS, STEP_LIMIT};
use crate::matrix::cosines::ZONES;

/// Bits of the index of a tile's side.
pub(super) const TILE_BITS: u32 = 2;

/// Parameters of a component that come before its classes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct ComponentHead {
    /// Index of the side of its tiles of pixels.
    pub(super) tile: u32,
    /// Indices of its steps.
    pub(super) left_step: i32,
    pub(super) right_step: i32,
    /// Bits of its rotation.
    pub(super) rotation: u32,
}

/// Contexts for heads, and the head before.
#[derive(Default)]
pub(super) struct Heads {
    before: Option<ComponentHead>,
    tile: Context,
    steps: [SignedContexts; 2],
    rotation: Context,
}

impl Heads {
    /// Codes a head: the first one plainly, then what differs from the one before.
    pub(super) fn code(&mut self, coder: &mut impl BitCoder, head: ComponentHead) -> ComponentHead {
        let Some(before) = self.before else {
            let head = ComponentHead {
                tile: coder.bits(head.tile, TILE_BITS),
                left_step: code_step(coder, head.left_step),
                right_step: code_step(coder, head.right_step),
                rotation: coder.bits(head.rotation, ROTATION_BITS),
            };
            self.before = Some(head);
            return head;
        };
        let is_same = coder.bit(&mut self.tile, head.tile == before.tile);
        let tile = if is_same { before.tile } else { coder.bits(head.tile, TILE_BITS) };
        let [left, right] = &mut self.steps;
        let left_step = before.left_step.saturating_add(coder.signed(left, head.left_step - before.left_step));
        let right_step = before.right_step.saturating_add(coder.signed(right, head.right_step - before.right_step));
        let is_same = coder.bit(&mut self.rotation, head.rotation == before.rotation);
        let rotation = if is_same { before.rotation } else { coder.bits(head.rotation, ROTATION_BITS) };
        let inside = |step: i32| step.clamp(-STEP_LIMIT, STEP_LIMIT);
        let head = ComponentHead { tile, left_step: inside(left_step), right_step: inside(right_step), rotation };
        self.before = Some(head);
        head
    }
}

/// Codes the index of a step plainly.
pub(super) fn code_step(coder: &mut impl BitCoder, step: i32) -> i32 {
    coder.bits((step + STEP_LIMIT) as u32, STEP_BITS) as i32 - STEP_LIMIT
}

/// Codes how much finer bands are, each as its difference from the one before.
pub(super) fn code_band_steps(coder: &mut impl BitCoder, band_steps: &mut [i8]) {
    let mut contexts = SignedContexts::default();
    let mut before = 0;
    for finer in band_steps {
        let difference = coder.signed(&mut contexts, i32::from(*finer) - before);
        before = before.saturating_add(difference).clamp(i32::from(i8::MIN), i32::from(i8::MAX));
        *finer = before as i8;
    }
}

/// The statistics that an image's classes share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PlaneKind {
    /// The strongest colour axis.
    Strong = 0,
    /// The other colour axes.
    Weak = 1,
    /// A light.
    Right = 2,
}

impl PlaneKind {
    pub(super) fn left(channel: usize) -> Self {
        if channel == 0 { Self::Strong } else { Self::Weak }
    }
}

/// Contexts and predictions for classes.
#[derive(Default)]
pub(super) struct ClassContexts {
    contexts: [[SignedContexts; 2]; 3],
    before: [[i32; ZONES]; 3],
}

impl ClassContexts {
    /// Codes the classes of an image as differences: from the same zone of the last image of this kind, moved by as
    /// much as the zone before differed.
    pub(super) fn code(&mut self, coder: &mut impl BitCoder, kind: PlaneKind, classes: [u32; ZONES]) -> [u32; ZONES] {
        let kind = kind as usize;
        let mut shift = 0;
        std::array::from_fn(|zone| {
            let before = &mut self.before[kind][zone];
            let guess = (*before + shift).clamp(0, CLASSES as i32 - 1);
            let context = &mut self.contexts[kind][usize::from(guess == 0)];
            let class = guess.saturating_add(coder.signed(context, classes[zone] as i32 - guess));
            let class = class.clamp(0, CLASSES as i32);
            shift = class - *before;
            *before = class;
            class as u32
        })
    }

    /// Reads classes. Errors: one that there is not.
    pub(super) fn read(&mut self, coder: &mut impl BitCoder, kind: PlaneKind) -> Result<[u32; ZONES], String> {
        let classes = self.code(coder, kind, [0; ZONES]);
        if classes.iter().all(|&class| class < CLASSES) {
            Ok(classes)
        } else {
            Err("a band has an unknown class".into())
        }
    }
}
