//! Directions within a spherical cap.

use glam::{Vec2, Vec3};

use super::bsdf::concentric_disc;
use super::frame::ShadingFrame;

/// Uniform over the directions whose cosine with `axis` is at least `1 − height`.
pub(super) fn cap_direction(axis: Vec3, height: f32, pair: Vec2) -> Vec3 {
    // The squared radius on the disc becomes the height above the cap's base.
    let disc = concentric_disc(pair);
    let r2 = disc.length_squared().min(1.0);
    let drop = r2 * height;
    let ring = (drop * (2.0 - drop)).max(0.0).sqrt();
    let flat = if r2 > 0.0 { disc / r2.sqrt() * ring } else { Vec2::ZERO };
    ShadingFrame::around(axis).to_world(Vec3::new(flat.x, flat.y, 1.0 - drop))
}

/// `1 − cos` between unit vectors, without cancellation for small angles.
pub(super) fn cap_height_of(axis: Vec3, direction: Vec3) -> f32 {
    0.5 * (direction - axis).length_squared()
}
