//! Lights without extent: points, spots, photometric luminaires; and suns, which are discs of directions.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{Vec2, Vec3};

use super::super::cap::cap_direction;
use super::super::photon_targets::Targets;
use super::super::segment::{End, OFF_LIGHT};
use super::{Emitted, EmitterHit, LightSample, SeenLight};
use crate::scene::{IesProfile, PointEmitter, SpotCone};

/// A point-like light of one column.
#[derive(Debug)]
pub(super) struct PointLight {
    emitter: PointEmitter,
}

impl PointLight {
    pub(super) fn new(emitter: PointEmitter) -> Self {
        Self { emitter }
    }

    /// Its position; `None` for suns.
    pub(super) fn position(&self) -> Option<Vec3> {
        match self.emitter {
            PointEmitter::Point { position }
            | PointEmitter::Spot { position, .. }
            | PointEmitter::Ball { position, .. }
            | PointEmitter::Ies { position, .. } => Some(position),
            PointEmitter::Sun { .. } => None,
        }
    }

    /// Its radius; 0 of points and suns.
    pub(super) fn radius(&self) -> f32 {
        if let PointEmitter::Ball { radius, .. } = self.emitter { radius } else { 0.0 }
    }

    /// Whether rays that leave the scene can hit it.
    pub(super) fn is_disc(&self) -> bool {
        matches!(self.emitter, PointEmitter::Sun { angular_radius_radians, .. } if angular_radius_radians > 0.0)
    }

    pub(super) fn sample(&self, position: Vec3, pair: Vec2) -> Option<LightSample> {
        match self.emitter {
            PointEmitter::Point { position: light }
            | PointEmitter::Spot { position: light, .. }
            | PointEmitter::Ies { position: light, .. } => from_point(light, position, |away| self.intensity(away)),
            PointEmitter::Ball { position: centre, radius, .. } => self.sample_ball(centre, radius, position, pair),
            PointEmitter::Sun { towards, angular_radius_radians } => {
                if angular_radius_radians <= 0.0 {
                    let end = End::Beyond(towards);
                    return Some(LightSample { towards, end, column: 0, weight: Vec3::ONE, pdf: 0.0 });
                }
                let direction = cap_direction(towards, cap_height(angular_radius_radians), pair);
                let found = self.found_inside(angular_radius_radians);
                let weight = found.radiance / found.pdf;
                let end = End::Beyond(direction);
                Some(LightSample { towards: direction, end, column: 0, weight, pdf: found.pdf })
            }
        }
    }

    /// A direction to the ball, uniform over the cone that it fills. Its surface has the radiance `I(ω) / (π r²)`.
    fn sample_ball(&self, centre: Vec3, radius: f32, position: Vec3, pair: Vec2) -> Option<LightSample> {
        let offset = centre - position;
        let square = offset.length_squared();
        let sine2 = radius * radius / square;
        if sine2 >= 1.0 {
            return None;
        }
        let height = sine2 / (1.0 + (1.0 - sine2).sqrt());
        let towards = cap_direction(offset / square.sqrt(), height, pair);
        // The nearer point of the ball along the direction.
        let along = offset.dot(towards);
        let across2 = (offset - along * towards).length_squared();
        let near = (along - (radius * radius - across2).max(0.0).sqrt()).max(0.0);
        let intensity = self.intensity(-towards);
        let weight = Vec3::splat(intensity * TAU * height / (PI * radius * radius));
        let end = End::At(position + towards * near);
        (intensity > 0.0).then_some(LightSample { towards, end, column: 0, weight, pdf: 0.0 })
    }

    /// Relative intensity along `away`; 0 for suns, which are at infinity.
    fn intensity(&self, away: Vec3) -> f32 {
        match self.emitter {
            PointEmitter::Point { .. } | PointEmitter::Ball { cone: None, .. } => 1.0,
            PointEmitter::Spot { direction, inner_radians, outer_radians, .. } => {
                within(SpotCone { direction, inner_radians, outer_radians }, away)
            }
            PointEmitter::Ball { cone: Some(cone), .. } => within(cone, away),
            PointEmitter::Ies { world_from_luminaire, ref profile, .. } => {
                intensity(profile, world_from_luminaire.transpose() * away)
            }
            PointEmitter::Sun { .. } => 0.0,
        }
    }

    /// Emits a photon towards the targets.
    pub(super) fn emit(&self, targets: &Targets, [place, way]: [Vec2; 2]) -> Option<Emitted> {
        match self.emitter {
            PointEmitter::Point { position }
            | PointEmitter::Spot { position, .. }
            | PointEmitter::Ies { position, .. } => {
                let (direction, density) = targets.sample_direction(position, None, way)?;
                let power = Vec3::splat(self.intensity(direction) / density);
                let lit = power.x > 0.0;
                lit.then_some(Emitted { origin: position, direction, column: 0, power, density: 0.0 })
            }
            PointEmitter::Ball { position, radius, .. } => {
                let normal = cap_direction(Vec3::Z, 2.0, place);
                let origin = position + radius * normal;
                let (direction, density) = targets.sample_direction(origin, Some(normal), way)?;
                let cosine = direction.dot(normal);
                // Radiance over the density of the point, 1 / (4 π r²), and of the direction.
                let power = Vec3::splat(4.0 * self.intensity(direction) * cosine / density);
                let lit = power.x > 0.0;
                lit.then_some(Emitted { origin, direction, column: 0, power, density: 0.0 })
            }
            PointEmitter::Sun { .. } => {
                let LightSample { towards, weight, pdf, .. } = self.sample(Vec3::ZERO, place)?;
                let (origin, across) = targets.sample_beam(towards, way)?;
                let power = weight / across;
                Some(Emitted { origin, direction: -towards, column: 0, power, density: pdf * across })
            }
        }
    }

    /// Density of photons along a ray that has left the scene: over directions and the area across them.
    pub(super) fn emitted_density(&self, targets: &Targets, hit: &EmitterHit) -> f32 {
        self.found(hit.direction).map_or(0.0, |found| found.pdf * targets.beam_density(hit.position, hit.direction))
    }

    /// Emission found by a ray that leaves the scene along `direction`.
    pub(super) fn found(&self, direction: Vec3) -> Option<SeenLight> {
        match self.emitter {
            PointEmitter::Sun { towards, angular_radius_radians } => {
                // The chord between unit vectors is exact where a cosine near one is not.
                let inside = (direction - towards).length() <= 2.0 * (0.5 * angular_radius_radians).sin();
                (self.is_disc() && inside).then(|| self.found_inside(angular_radius_radians))
            }
            PointEmitter::Point { .. }
            | PointEmitter::Spot { .. }
            | PointEmitter::Ball { .. }
            | PointEmitter::Ies { .. } => None,
        }
    }

    fn found_inside(&self, radius: f32) -> SeenLight {
        // Irradiance 1 on a facing plane: L ∫ cos θ dω = L π sin² r = 1.
        let radiance = 1.0 / (PI * radius.sin().powi(2));
        SeenLight { source: 0, column: 0, radiance: Vec3::splat(radiance), pdf: 1.0 / (TAU * cap_height(radius)) }
    }
}

/// Relative intensity of a spot along `away`.
fn within(SpotCone { direction, inner_radians, outer_radians }: SpotCone, away: Vec3) -> f32 {
    let (inner, outer) = (inner_radians.cos(), outer_radians.cos());
    let t = ((away.dot(direction) - outer) / (inner - outer).max(1e-6)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// `1 − cos r`, without cancellation for small caps.
fn cap_height(radius: f32) -> f32 {
    2.0 * (0.5 * radius).sin().powi(2)
}

fn from_point(light: Vec3, position: Vec3, intensity: impl Fn(Vec3) -> f32) -> Option<LightSample> {
    let offset = light - position;
    let distance2 = offset.length_squared();
    let distance = distance2.sqrt();
    let towards = offset / distance;
    let intensity = intensity(-towards);
    // A light in a surface must be seen from in front of it; its rounded position alone decides the side.
    let short = 2.0 * OFF_LIGHT * (light.abs() + position.abs()).max_element();
    (intensity > 0.0 && distance2 > 0.0).then(|| LightSample {
        towards,
        end: End::At(light - towards * short.min(distance)),
        column: 0,
        weight: Vec3::splat(intensity / distance2),
        pdf: 0.0,
    })
}

/// Relative intensity along `away` in the luminaire's own axes, bilinear in both angles. Profiles over a quarter or a
/// half of the horizontal circle are mirrored, as IES LM-63 says; one horizontal angle means rotational symmetry.
fn intensity(profile: &IesProfile, away: Vec3) -> f32 {
    let vertical = (-away.z).clamp(-1.0, 1.0).acos();
    let turn = away.y.atan2(away.x).rem_euclid(TAU);
    let last = profile.horizontal_radians.last().copied().unwrap_or(0.0);
    let near = |angle: f32| (last - angle).abs() < 1e-3;
    let horizontal = match () {
        () if near(FRAC_PI_2) => FRAC_PI_2 - ((turn % PI) - FRAC_PI_2).abs(),
        () if near(PI) => PI - (turn - PI).abs(),
        () => turn,
    };
    let (&first_v, &last_v) = match (profile.vertical_radians.first(), profile.vertical_radians.last()) {
        (Some(first), Some(last)) => (first, last),
        _ => return 0.0,
    };
    if vertical < first_v - 1e-4 || vertical > last_v + 1e-4 {
        return 0.0;
    }
    let (v, fv) = bracket(&profile.vertical_radians, vertical);
    let (h, fh) = bracket(&profile.horizontal_radians, horizontal);
    let count = profile.vertical_radians.len();
    let at = |h: usize, v: usize| {
        let h = h.min(profile.horizontal_radians.len().saturating_sub(1));
        profile.intensity.get(h * count + v.min(count - 1)).copied().unwrap_or(0.0)
    };
    let row = |h: usize| at(h, v) * (1.0 - fv) + at(h, v + 1) * fv;
    row(h) * (1.0 - fh) + row(h + 1) * fh
}

/// The interval of increasing `angles` that contains `x`, and the position in it from 0 to 1.
fn bracket(angles: &[f32], x: f32) -> (usize, f32) {
    let above = angles.partition_point(|&a| a <= x);
    if above == 0 || above == angles.len() {
        return (above.saturating_sub(1), 0.0);
    }
    let (low, high) = (angles[above - 1], angles[above]);
    (above - 1, (x - low) / (high - low))
}
