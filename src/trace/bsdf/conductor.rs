//! Rough conductors.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::gloss::{Gloss, GlossAt};
use super::{Lobes, Scattered, cosine_hemisphere};

/// GGX reflection with Schlick's Fresnel term, and what is reflected by several facets.
#[derive(Clone, Copy, Debug)]
pub struct Conductor {
    gloss: Gloss,
}

impl Conductor {
    pub(super) const LOBES: Lobes = Lobes::GLOSSY_REFLECTION;

    /// A conductor that reflects `specular` at normal incidence.
    #[inline(always)]
    pub fn new(specular: Vec3, alpha: f32) -> Self {
        Self { gloss: Gloss::of_metal(specular, alpha) }
    }

    #[inline(always)]
    pub(super) fn of(gloss: Gloss) -> Self {
        Self { gloss }
    }

    /// `f cos θi` and the density of [`Self::sample`].
    #[inline(always)]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let (o, i) = (self.gloss.at(wo.z), self.gloss.at(wi.z));
        let (single, visible) = self.gloss.single(wo, wi);
        let chance = chance(&o);
        let pdf = chance * visible + (1.0 - chance) * FRAC_1_PI * wi.z;
        (single + self.gloss.several(&o, &i, wi.z), pdf)
    }

    #[inline(always)]
    pub(super) fn sample(&self, wo: Vec3, pair: Vec2, choice: f32) -> Option<Scattered> {
        let by_one = choice < chance(&self.gloss.at(wo.z));
        let wi = if by_one { self.gloss.sample(wo, pair) } else { cosine_hemisphere(pair) };
        if wi.z > 0.0 { Scattered::drawn(wi, self.eval(wo, wi)) } else { None }
    }

    #[inline(always)]
    pub(super) fn albedo(&self, cosine: f32) -> Vec3 {
        self.gloss.at(cosine).whole
    }
}

/// Probability to sample one facet's reflection: its share of the reflected light.
#[inline(always)]
fn chance(o: &GlossAt) -> f32 {
    o.single.element_sum() / o.whole.element_sum().max(1e-6)
}
