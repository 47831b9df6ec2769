//! A clear coat and a sheen over a base.

use std::f32::consts::{FRAC_1_PI, PI};
use std::sync::LazyLock;

use glam::{Vec2, Vec3};

use super::coated::Coated;
use super::gloss::Gloss;
use super::nodes::node_below;
use super::{Lobes, Scattered, cosine_hemisphere};

/// A base under a sheen of fibres under a clear coat, as glTF layers them (the Khronos group, `KHR_materials_sheen` and
/// `KHR_materials_clearcoat`). What a layer reflects is taken from those below it for both directions, so that it is reciprocal.
#[derive(Clone, Copy, Debug)]
pub struct Layered {
    base: Coated,
    /// Share of the surface that has the coat.
    share: f32,
    coat: Gloss,
    /// Colour of the sheen, and its roughness α.
    sheen: Vec3,
    sheen_alpha: f32,
}

/// What a clear coat reflects at normal incidence: that of index 1.5.
const CLEAR_COAT: f32 = 0.04;
/// Probability to sample the sheen's directions where there is one.
const SHEEN_CHANCE: f32 = 0.3;
/// Least probability of the coat and of the base.
const LEAST_CHANCE: f32 = 0.1;

impl Layered {
    pub(super) const LOBES: Lobes = Lobes::DIFFUSE_REFLECTION.and(Lobes::GLOSSY_REFLECTION);

    /// A base under a coat of a share and a roughness α, and a sheen of a colour and a roughness α.
    #[inline(always)]
    pub fn new(base: Coated, (share, alpha): (f32, f32), (sheen, sheen_alpha): (Vec3, f32)) -> Self {
        let coat = Gloss::new(Vec3::splat(CLEAR_COAT), alpha);
        Self { base, share, coat, sheen, sheen_alpha: sheen_alpha.max(LEAST_SHEEN) }
    }

    /// `f cos θi` and the density of [`Self::sample`].
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let (o, i) = (self.coat.at(wo.z), self.coat.at(wi.z));
        let (to, ti) = (1.0 - self.share * o.whole.x, 1.0 - self.share * i.whole.x);
        let (coat, coat_pdf) = self.coat.single(wo, wi);
        let (single, diffuse, base_pdf) = self.base.parts(wo, wi);
        let kept = to * ti / (1.0 - self.share * self.coat.mean().x);
        // Of a mirror direction both cosines are the same.
        let below = single * to.min(ti) + diffuse * kept;
        let most = self.sheen.max_element();
        let passed = if most > 0.0 { 1.0 - most * self.sheen_at(wo.z).max(self.sheen_at(wi.z)) } else { 1.0 };
        let mut value = self.share * (coat + self.coat.several(&o, &i, wi.z)) + below * passed;
        if most > 0.0 {
            value += self.sheen * (to.min(ti) * fibres(self.sheen_alpha, wo, wi) * wi.z);
        }
        let [coated, based, sheened] = self.chances(wo.z);
        (value, coated * coat_pdf + based * base_pdf + sheened * FRAC_1_PI * wi.z)
    }

    pub(super) fn sample(&self, wo: Vec3, pair: Vec2, choice: f32) -> Option<Scattered> {
        let [coated, based, _] = self.chances(wo.z);
        let wi = if choice < coated {
            self.coat.sample(wo, pair)
        } else if choice < coated + based {
            self.base.sample(wo, pair, ((choice - coated) / based).min(0.999_999_9))?.wi
        } else {
            cosine_hemisphere(pair)
        };
        if wi.z > 0.0 { Scattered::drawn(wi, self.eval(wo, wi)) } else { None }
    }

    pub(super) fn albedo(&self, cosine: f32) -> Vec3 {
        let coat = self.share * self.coat.at(cosine).whole.x;
        let sheen = self.sheen_at(cosine);
        coat + (1.0 - coat) * (self.sheen * sheen + self.base.albedo(cosine) * (1.0 - self.sheen.max_element() * sheen))
    }

    /// Probabilities of the coat, the base and the sheen.
    fn chances(&self, cosine: f32) -> [f32; 3] {
        let coat = self.share * self.coat.at(cosine).whole.x;
        let all = coat + (1.0 - coat) * self.base.albedo(cosine).element_sum() / 3.0;
        let coated = if self.share > 0.0 { (coat / all).clamp(LEAST_CHANCE, 1.0 - LEAST_CHANCE) } else { 0.0 };
        let sheened = if self.sheen == Vec3::ZERO { 0.0 } else { SHEEN_CHANCE };
        [coated * (1.0 - sheened), (1.0 - coated) * (1.0 - sheened), sheened]
    }

    /// Directional albedo of a white sheen.
    #[inline(always)]
    fn sheen_at(&self, cosine: f32) -> f32 {
        if self.sheen == Vec3::ZERO {
            return 0.0;
        }
        let (row, r) = node_below(self.sheen_alpha.sqrt(), SHEEN_ROWS);
        let (node, c) = node_below(cosine, SHEEN_COSINES);
        let along = |row: usize| SHEEN[row][node] + (SHEEN[row][node + 1] - SHEEN[row][node]) * c;
        along(row) + (along(row + 1) - along(row)) * r
    }
}

const SHEEN_ROWS: usize = 16;
const SHEEN_COSINES: usize = 32;
/// Least roughness α of a sheen.
const LEAST_SHEEN: f32 = 0.01;

static SHEEN: LazyLock<Vec<[f32; SHEEN_COSINES]>> = LazyLock::new(|| {
    let row = |row: usize| {
        let alpha = (row as f32 / (SHEEN_ROWS - 1) as f32).powi(2).max(LEAST_SHEEN);
        std::array::from_fn(|node| albedo_of_fibres(alpha, (node as f32 / (SHEEN_COSINES - 1) as f32).max(1e-3)))
    };
    (0..SHEEN_ROWS).map(row).collect()
});

/// Fibres that stand up (Estevez and Kulla 2017, *Production friendly microfacet sheen BRDF*), with the visibility of Neubelt and
/// Pettineo (2013).
fn fibres(alpha: f32, wo: Vec3, wi: Vec3) -> f32 {
    let half = (wo + wi).normalize();
    let sine2 = (half.x * half.x + half.y * half.y).clamp(1e-8, 1.0);
    let normals = (2.0 + 1.0 / alpha) * sine2.powf(0.5 / alpha) / (2.0 * PI);
    normals / (4.0 * (wo.z + wi.z - wo.z * wi.z)).max(1e-6)
}

fn albedo_of_fibres(alpha: f32, cosine: f32) -> f32 {
    let (rings, turns) = (48, 32);
    let wo = Vec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
    let mut sum = 0.0;
    for i in 0..rings * turns {
        let s = ((i % rings) as f32 + 0.5) / rings as f32;
        let (z, dz) = (s * s, 2.0 * s / rings as f32);
        let (sin, cos) = (((i / rings) as f32 + 0.5) / turns as f32 * PI).sin_cos();
        let ring = (1.0 - z * z).sqrt();
        sum += fibres(alpha, wo, Vec3::new(ring * cos, ring * sin, z)) * z * dz * 2.0 * PI / turns as f32;
    }
    sum.min(1.0)
}
