//! Light that reaches a vertex: by light samples and by photons, and how a path goes on from there.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use super::bsdf::{Bsdf, Lambert, Scattered};
use super::integrator::{Last, LightDraw, PathRecord};
use super::lights::{LightPmf, LightSample};
use super::photons::{GatheredWithin, LANES, PhotonGather, PhotonGroup, PhotonVisitor, Photons};
use super::planes::LightPath;
use super::vertex::{PathRay, PathVertex, power_heuristic};
use super::world::World;

impl PathVertex {
    /// One light sample.
    #[inline(always)]
    pub(super) fn sample_light(
        &self,
        world: &World,
        chances: &LightPmf,
        throughput: Vec3,
        LightDraw { pair, count }: LightDraw,
        layer: LightPath,
        record: &mut PathRecord<'_, '_>,
    ) {
        let receiver = self.receiver();
        let drawn = world.lights.sample(&world.scene, &receiver, &self.frame, chances, pair);
        if let Some(light) = drawn {
            self.add_light(world, throughput, (&light, count as f32), layer, record);
        }
    }

    /// Adds the light of one of `count` light samples.
    #[inline(always)]
    pub(super) fn add_light(
        &self,
        world: &World,
        throughput: Vec3,
        (light, count): (&LightSample, f32),
        layer: LightPath,
        record: &mut PathRecord<'_, '_>,
    ) {
        let receiver = self.receiver();
        let (above, wi) = (light.towards.dot(self.normal), self.frame.to_local(light.towards));
        // Of surfaces that scatter to both sides, the normals must agree about the side.
        if above <= 0.0 && !(receiver.two_sided && wi.z < 0.0) || above > 0.0 && wi.z <= 0.0 {
            return;
        }
        let (value, pdf) = self.bsdf.eval(self.wo, wi);
        let value = throughput * value * light.weight / count;
        if value == Vec3::ZERO {
            return;
        }
        let kept = world.transmittance(self.point.start(light.towards), light.end, &mut record.cost.rays);
        if kept != Vec3::ZERO {
            let weight = power_heuristic(count * light.pdf, pdf);
            let weight = if light.pdf > 0.0 { weight } else { 1.0 };
            record.add(layer, light.column, value * kept * weight);
        }
    }

    /// Gathers nearby photons whose paths have at most `most_segments` segments. Returns the radius.
    #[inline(always)]
    pub(super) fn gather(
        &self,
        photons: &Photons,
        map: u32,
        most_segments: u32,
        throughput: Vec3,
        record: &mut PathRecord<'_, '_>,
    ) -> f32 {
        let (position, normal) = (self.point.position, self.normal);
        let radius = photons.radius_at(position);
        if radius == 0.0 {
            return radius;
        }
        let two_sided = self.bsdf.lobes().is_two_sided();
        let at = PhotonGather { map, position, normal, radius, two_sided, most_segments };
        photons.gather(&at, &mut Lit { vertex: self, expected: photons.expected_of(radius), throughput, record });
        radius
    }

    /// This vertex as the last of a path that leaves it along a direction with a density and a cosine.
    #[inline(always)]
    pub(super) fn left_along(
        &self,
        direction: Vec3,
        (pdf, cosine): (f32, f32),
        light_samples: f32,
        radius: Option<f32>,
    ) -> Last {
        let spread = || pdf / direction.dot(self.normal).abs();
        let gathered = radius.map(|radius| GatheredWithin { radius, spread: spread() });
        Last { from: self.receiver(), pdf: Some(pdf), cosine, light_samples, guided: 0.0, gathered }
    }

    /// The ray of a scattered direction of a path that came along `ray`. `None` if it does not leave the surface.
    #[inline(always)]
    pub(super) fn onward(&self, world: &World, ray: &PathRay, next: &Scattered) -> Option<PathRay> {
        if next.pass_through {
            return Some(self.past(ray));
        }
        Some(self.ray(world, self.leaving(next)?))
    }
}

/// A surface that photons light.
struct Lit<'a, 'b, 'c> {
    vertex: &'a PathVertex,
    /// Number of photons of density 1 expected within the radius.
    expected: f32,
    throughput: Vec3,
    record: &'a mut PathRecord<'b, 'c>,
}

impl PhotonVisitor for Lit<'_, '_, '_> {
    #[inline(always)]
    fn take(&mut self, gathered: &PhotonGroup) {
        let vertex = self.vertex;
        let two_sided = vertex.bsdf.lobes().is_two_sided();
        let (mut values, mut pdfs) = ([[0.0f32; LANES]; 3], [0.0f32; LANES]);
        let along = |axis: Vec3, lane: usize| {
            let [x, y, z] = &gathered.towards;
            x[lane] * axis.x + y[lane] * axis.y + z[lane] * axis.z
        };
        if let Bsdf::Lambert(Lambert { reflectance }) = vertex.bsdf {
            // As `Bsdf::eval`, for all lanes at once.
            for lane in 0..LANES {
                let z = along(vertex.frame.z, lane);
                let pdf = if z > 0.0 && vertex.wo.z > 0.0 { FRAC_1_PI * z } else { 0.0 };
                pdfs[lane] = pdf;
                (0..3).for_each(|channel| values[channel][lane] = reflectance[channel] * pdf);
            }
        } else {
            for lane in (0..LANES).filter(|lane| gathered.mask >> lane & 1 == 1) {
                let [x, y, z] = gathered.towards.map(|axis| axis[lane]);
                let wi = vertex.frame.to_local(Vec3::new(x, y, z));
                if (wi.z > 0.0) != (along(vertex.normal, lane) > 0.0) {
                    continue;
                }
                let (value, pdf) = vertex.bsdf.eval(vertex.wo, wi);
                pdfs[lane] = pdf;
                (0..3).for_each(|channel| values[channel][lane] = value[channel]);
            }
        }
        // Photon cosines refer to the geometric normal, not to the shading normal.
        let (mut cosines, mut spread) = ([0.0f32; LANES], [0.0f32; LANES]);
        for lane in 0..LANES {
            let cosine = along(vertex.normal, lane);
            cosines[lane] = if two_sided { cosine.abs() } else { cosine };
            spread[lane] = pdfs[lane] / cosines[lane];
        }
        let weights = gathered.weights(self.expected, &spread);
        let mut light = [[0.0f32; LANES]; 3];
        for lane in 0..LANES {
            let weight = weights[lane] / cosines[lane];
            for channel in 0..3 {
                let value = self.throughput[channel] * values[channel][lane];
                light[channel][lane] = value * gathered.irradiance[channel][lane] * weight;
            }
        }
        let mut mask = gathered.mask;
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            let is_lit = values.iter().any(|channel| channel[lane] != 0.0);
            if is_lit && cosines[lane] > 0.0 {
                let value = Vec3::new(light[0][lane], light[1][lane], light[2][lane]);
                self.record.add(LightPath::Indirect, gathered.column[lane], value);
            }
        }
    }
}
