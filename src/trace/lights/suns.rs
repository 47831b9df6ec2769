//! Places of the sun, each of one column that has what comes straight from there.
//!
//! They are asked for one by one and not drawn at random: a place is in view of a surface or not, and of thousands a draw would find
//! each hardly ever.

use glam::{Vec2, Vec3};

use super::point::PointLight;
use super::{LightSample, Receiver};
use crate::scene::{PointEmitter, SunPlaces};

/// Shadow rays that each place gets from a pixel, where the pixel has as many samples: it is even, as half of them are of each half of the
/// samples.
const RAYS_OF_PIXEL: u32 = 8;

/// The places of one light.
#[derive(Debug)]
pub(in crate::trace) struct Suns {
    towards: Vec<Vec3>,
    /// Angular radius in radians; 0 of parallel light.
    radius: f32,
    first_column: u32,
}

/// The share of the places that one sample asks for.
#[derive(Clone, Copy, Debug)]
pub(in crate::trace) struct SunShare {
    /// The first place and the step to the next.
    first: usize,
    step: usize,
    /// Samples of the sample's half over those of them that have this share.
    weight: f32,
}

impl SunShare {
    /// The share of a sample of several of a pixel. Two samples in a row, one of each half, have the same, so that both halves see
    /// each place.
    pub(in crate::trace) fn of_sample(sample: u32, samples: u32) -> Self {
        let step = (samples / 2 / (RAYS_OF_PIXEL / 2)).max(1);
        let first = sample / 2 % step;
        let of_half = (samples + 1 - sample % 2) / 2;
        let asked = (of_half - first).div_ceil(step);
        Self { first: first as usize, step: step as usize, weight: of_half as f32 / asked as f32 }
    }
}

impl Suns {
    pub(super) fn new(places: &SunPlaces, first_column: u32) -> Self {
        Self { towards: places.towards.clone(), radius: places.angular_radius_radians, first_column }
    }

    /// Light samples from the places of a share that a surface faces. `pair` is uniform over the unit square, for each place.
    #[inline(always)]
    pub(in crate::trace) fn samples(
        &self,
        at: Receiver,
        share: SunShare,
        pair: impl Fn(u32) -> Vec2,
    ) -> impl Iterator<Item = LightSample> {
        // A disc shines around the edge of the horizon as far as it reaches.
        let least = -self.radius.sin();
        let places = (share.first..self.towards.len()).step_by(share.step);
        places.filter_map(move |place| {
            let towards = self.towards[place];
            let cosine = at.normal.dot(towards);
            if cosine <= least && !(at.two_sided && cosine < -least) {
                return None;
            }
            let emitter = PointEmitter::Sun { towards, angular_radius_radians: self.radius };
            let sample = PointLight::new(emitter).sample(Vec3::ZERO, pair(place as u32))?;
            let weight = sample.weight * share.weight;
            Some(LightSample { column: self.first_column + place as u32, weight, pdf: 0.0, ..sample })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean of a half's samples is unbiased: the weights of a place sum to the samples of the half.
    #[test]
    fn each_place_counts_once_for_each_sample_of_a_half_whatever_their_number() {
        for samples in [1, 2, 3, 15, 16, 17, 81, 100, 4097] {
            for place in 0..600 {
                for half in 0..2.min(samples) {
                    let of_half = (half..samples).step_by(2);
                    let shares = of_half.clone().map(|sample| SunShare::of_sample(sample, samples));
                    let asked = shares.filter(|share| place % share.step == share.first);
                    let (rays, sum) =
                        asked.fold((0, 0.0), |(rays, sum), share| (rays + 1, sum + f64::from(share.weight)));
                    assert!((sum - of_half.count() as f64).abs() < 1e-3, "{samples} samples, place {place}: {sum}");
                    assert!(rays <= 2 * RAYS_OF_PIXEL, "{samples} samples: {rays} rays");
                }
            }
        }
    }
}
