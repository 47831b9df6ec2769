//! Places of the sun, each of one column that has what comes straight from there.
//!
//! They are asked for one by one and not drawn at random: a place is in view of a surface or not, and of thousands a draw would find
//! each hardly ever.

use glam::{Vec2, Vec3};

use super::super::segment::End;
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
    /// The disc, about +z.
    disc: PointLight,
    radius: f32,
    first_column: u32,
}

/// The share of the places that one sample asks for.
#[derive(Clone, Copy, Debug)]
pub(in crate::trace) struct SunShare {
    /// The first place and the step to the next.
    first: usize,
    step: usize,
}

impl SunShare {
    /// The share of a sample of several of a pixel. Two samples in a row, one of each half, have the same, so that both halves see
    /// each place equally often.
    pub(in crate::trace) fn of_sample(sample: u32, samples: u32) -> Self {
        let step = ((samples / 2) / (RAYS_OF_PIXEL / 2)).max(1);
        // What does not fill a whole turn is left to the last places: every place has the same number of rays only where `step` divides the
        // number of pairs.
        let step = if (samples / 2).is_multiple_of(step) { step } else { 1 };
        Self { first: (sample / 2 % step) as usize, step: step as usize }
    }
}

impl Suns {
    pub(super) fn new(places: &SunPlaces, first_column: u32) -> Self {
        let radius = places.angular_radius_radians;
        let disc = PointLight::new(PointEmitter::Sun { towards: Vec3::Z, angular_radius_radians: radius });
        Self { towards: places.towards.clone(), disc, radius, first_column }
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
            let sample = if self.radius > 0.0 {
                let frame = super::ShadingFrame::around(towards);
                let drawn = self.disc.sample(Vec3::ZERO, pair(place as u32))?;
                let towards = frame.to_world(drawn.towards).normalize();
                LightSample { towards, end: End::Beyond(towards), ..drawn }
            } else {
                LightSample { towards, end: End::Beyond(towards), column: 0, weight: Vec3::ONE, pdf: 0.0 }
            };
            let weight = sample.weight * share.step as f32;
            Some(LightSample { column: self.first_column + place as u32, weight, pdf: 0.0, ..sample })
        })
    }
}
