//! A Lambertian base under a rough coat; without a base, a rough conductor.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::gloss::{Gloss, GlossAt};
use super::{Lobes, Scattered, cosine_hemisphere};

/// A Lambertian base under a GGX coat, coupled as Kelemen and Szirmay-Kalos (2001): the base receives what the coat
/// does not reflect, `ρ (1 − E(θi)) (1 − E(θo)) / (π (1 − Ē))` with `E` the directional albedo of the coat and `Ē` its
/// cosine-weighted mean. Reciprocal, and of albedo one where ρ is one, whatever the roughness.
///
/// What is partly metal is the linear mix of a metal and such a base. Schlick's term is linear in the reflectance at normal
/// incidence, so one lobe has the reflection of both (glTF 2.0, appendix B.3.5); the base is under its own coat alone.
#[derive(Clone, Copy, Debug)]
pub struct Coated {
    reflectance: Vec3,
    gloss: Gloss,
    /// The coat over the base, where that is not all of the gloss.
    over_base: Option<Gloss>,
}

/// Bounds of the probability with which the coat is sampled, so that every highlight and every base is.
const CHANCES: (f32, f32) = (0.1, 0.9);

impl Coated {
    pub(super) const LOBES: Lobes = Lobes::DIFFUSE_REFLECTION.and(Lobes::GLOSSY_REFLECTION);

    /// A base of an albedo under a coat that reflects `specular` at normal incidence.
    #[inline(always)]
    pub fn new(reflectance: Vec3, specular: Vec3, alpha: f32) -> Self {
        Self { reflectance, gloss: Gloss::new(specular, alpha), over_base: None }
    }

    /// A mix of a share of metal and of a base under a coat that reflects `specular`.
    #[inline(always)]
    pub fn mixed(base: Vec3, specular: Vec3, metal: f32, alpha: f32) -> Self {
        let coat = Gloss::new(specular, alpha);
        if metal == 0.0 {
            return Self { reflectance: base, gloss: coat, over_base: None };
        }
        let gloss = coat.mixed(&Gloss::of_metal(base, alpha), metal);
        Self { reflectance: base * (1.0 - metal), gloss, over_base: Some(coat) }
    }

    /// The same with another albedo of the base.
    #[inline(always)]
    pub(super) fn with_base(self, reflectance: Vec3) -> Self {
        Self { reflectance, ..self }
    }

    /// The gloss, where there is nothing else.
    #[inline(always)]
    pub(super) fn bare_gloss(&self) -> Option<Gloss> {
        (self.reflectance == Vec3::ZERO).then_some(self.gloss)
    }

    /// The base's light: a factor on `cos θi / π` of a base of albedo 1.
    #[inline(always)]
    pub(super) fn passed(&self, [o, i]: [f32; 2]) -> Vec3 {
        let coat = self.over_base.as_ref().unwrap_or(&self.gloss);
        let kept = (Vec3::ONE - coat.mean()).max(Vec3::splat(1e-6));
        (Vec3::ONE - coat.at(o).whole) * (Vec3::ONE - coat.at(i).whole) / kept
    }

    /// What the coat does not reflect.
    #[inline(always)]
    pub(super) fn entered(&self, cosine: f32) -> Vec3 {
        Vec3::ONE - self.over_base.as_ref().unwrap_or(&self.gloss).at(cosine).whole
    }

    /// `f cos θi` and the density of [`Self::sample`].
    #[inline(always)]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let (single, diffuse, pdf) = self.parts(wo, wi);
        (single + diffuse, pdf)
    }

    /// The same, of one facet of the coat apart from all else.
    #[inline(always)]
    pub(super) fn parts(&self, wo: Vec3, wi: Vec3) -> (Vec3, Vec3, f32) {
        let (o, i) = (self.gloss.at(wo.z), self.gloss.at(wi.z));
        let (coat, visible) = self.gloss.single(wo, wi);
        let base = self.reflectance * self.passed([wo.z, wi.z]) * (FRAC_1_PI * wi.z);
        let chance = self.chance(&o, wo.z);
        let pdf = chance * visible + (1.0 - chance) * FRAC_1_PI * wi.z;
        (coat, self.gloss.several(&o, &i, wi.z) + base, pdf)
    }

    #[inline(always)]
    pub(super) fn sample(&self, wo: Vec3, pair: Vec2, choice: f32) -> Option<Scattered> {
        let of_coat = choice < self.chance(&self.gloss.at(wo.z), wo.z);
        let wi = if of_coat { self.gloss.sample(wo, pair) } else { cosine_hemisphere(pair) };
        if wi.z > 0.0 { Scattered::drawn(wi, self.eval(wo, wi)) } else { None }
    }

    #[inline(always)]
    pub(super) fn albedo(&self, cosine: f32) -> Vec3 {
        self.gloss.at(cosine).whole + self.reflectance * self.entered(cosine)
    }

    /// Probability to sample a facet's reflection: its share of the reflected light.
    #[inline(always)]
    fn chance(&self, o: &GlossAt, cosine: f32) -> f32 {
        let coat = o.single.element_sum();
        let all = (o.whole + self.reflectance * self.entered(cosine)).element_sum();
        // Without a base, what meets several facets alone is drawn by the cosine, and may be as little as it is.
        let most = if self.reflectance == Vec3::ZERO { 1.0 } else { CHANCES.1 };
        (coat / all.max(1e-6)).clamp(CHANCES.0, most)
    }
}
