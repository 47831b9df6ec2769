//! A photon's way by mirrors and glass.

use glam::{Vec2, Vec3};

use super::super::integrator::Vertex;
use super::super::lights::Emitted;
use super::super::sampler::{Sampler, Use};
use super::super::world::{MAX_PASSES, World};
use super::{Photon, fold};

/// Most that a photon gains where the shading normal stands across the surface's own: at the rims of coarse meshes.
const MOST_GAIN: f32 = 4.0;

/// Follows a photon to the first surface that scatters. None where it comes there straight, which light samples see to, or
/// not at all. `share` is that of its light's flux; `rays` counts those that it takes.
pub(super) fn follow(
    world: &World,
    max_depth: u32,
    emitted: Emitted,
    sampler: &Sampler,
    share: f32,
    rays: &mut u64,
) -> Option<Photon> {
    let Emitted { mut origin, mut direction, column, mut power, density } = emitted;
    let (mut segments, mut passes) = (1, 0);
    // The camera's path to where it rests has one segment at least.
    while segments < max_depth && passes < MAX_PASSES {
        let point = world.intersect(origin, direction, rays)?;
        let at = Vertex::new(world, point, direction);
        let mut choice = sampler.pair(Use::Choice, segments + passes);
        if choice.x >= at.opacity {
            passes += 1;
            origin = at.point.start(direction);
            continue;
        }
        choice.x /= at.opacity;
        if at.bsdf.is_spread() {
            let folded = (fold(direction), fold(at.normal));
            let rests = segments > 1 && power.is_finite();
            return rests.then_some(Photon {
                position: at.point.position,
                power: power * share,
                column,
                density,
                direction: folded.0,
                normal: folded.1,
                segments,
            });
        }
        let next = at.bsdf.sample(at.wo, Vec2::splat(0.5), choice.x)?;
        // What is carried is flux, which the index of a medium does not change.
        power *= next.weight * next.compression;
        if next.straight {
            passes += 1;
        } else {
            let leaving = at.leaving(&next)?;
            power *= gain(&at, direction, leaving, next.wi.z.abs());
            direction = leaving;
            segments += 1;
        }
        if power == Vec3::ZERO {
            return None;
        }
        origin = at.point.start(direction);
    }
    None
}

/// What light gains beside what a camera path does, where shading normals are not the surface's own: `|ωi·Ns| |ωo·Ng| /
/// (|ωi·Ng| |ωo·Ns|)` (Veach 1997, §5.3.2).
fn gain(at: &Vertex, direction: Vec3, leaving: Vec3, cosine: f32) -> f32 {
    let gain = at.wo.z * leaving.dot(at.normal).abs() / (direction.dot(at.normal).abs() * cosine);
    if gain.is_finite() { gain.min(MOST_GAIN) } else { 1.0 }
}
