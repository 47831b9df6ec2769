//! Look-up in tables over even nodes from 0 to 1.

/// The node below a value, of `count` nodes, and how far towards the next it lies.
#[inline(always)]
pub(super) fn node_below(value: f32, count: usize) -> (usize, f32) {
    let x = value.clamp(0.0, 1.0) * (count - 1) as f32;
    let node = (x as usize).min(count - 2);
    (node, x - node as f32)
}
