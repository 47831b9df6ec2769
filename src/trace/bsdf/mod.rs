//! How surfaces scatter: each description of `scene::Surface` resolved at a hit, as functions of two directions.
//!
//! Directions point away from the surface, in a local frame whose z axis is the shading normal on the side of the
//! viewer: `wo.z > 0` always. Reflection has `wi.z > 0`, transmission `wi.z < 0`. `eval` gives `f · |cos θi|`.
//!
//! A lobe is one file: its value and density, its sampling, its [`Lobes`]. [`Bsdf`] tells them apart.

mod coated;
mod conductor;
mod dielectric;
mod energy;
mod fresnel;
mod glass_energy;
mod gloss;
mod lambert;
mod layered;
mod lobes;
mod microfacet;
mod mirror;
mod nodes;
mod resolve;
mod rough_dielectric;
mod rough_sheet;
mod translucent;

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

pub use coated::Coated;
pub use conductor::Conductor;
pub use dielectric::{Dielectric, ThinDielectric};
pub use lambert::Lambert;
pub use layered::Layered;
pub use lobes::Lobes;
pub use mirror::Mirror;
pub use rough_dielectric::RoughDielectric;
pub use rough_sheet::RoughSheet;
pub use translucent::Translucent;

/// A surface at a point, its colours looked up.
#[derive(Clone, Copy, Debug)]
pub enum Bsdf {
    /// Lambertian reflection.
    Lambert(Lambert),
    /// Perfect mirror.
    Mirror(Mirror),
    /// GGX conductor.
    Conductor(Conductor),
    /// Smooth boundary.
    Dielectric(Dielectric),
    /// Thin sheet.
    ThinDielectric(ThinDielectric),
    /// Rough boundary.
    RoughDielectric(RoughDielectric),
    /// Rough thin sheet.
    RoughSheet(RoughSheet),
    /// Lambertian base under a GGX coat.
    Coated(Coated),
    /// Base under a clear coat and a sheen.
    Layered(Layered),
    /// Base that scatters to both sides.
    Translucent(Translucent),
    /// Absorbs everything.
    Black,
}

/// A sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct Scattered {
    /// The direction, away from the surface.
    pub wi: Vec3,
    /// `f · |cos θi| / pdf`.
    pub weight: Vec3,
    /// Density over solid angle; 0 where [`Self::singular`].
    pub pdf: f32,
    /// Whether the direction is a delta direction (mirror, refraction), so that lights cannot be sampled for it.
    pub singular: bool,
    /// Whether the ray passes straight through.
    pub pass_through: bool,
    /// Squared relative index (η²), by which `weight` is below the light kept, since radiance changes with the medium.
    /// Russian roulette and photons take it out.
    pub eta_scale: f32,
}

impl Scattered {
    /// The mirror direction, with all of the light.
    #[inline(always)]
    fn mirrored(wo: Vec3) -> Self {
        let wi = Vec3::new(-wo.x, -wo.y, wo.z);
        Self { wi, weight: Vec3::ONE, pdf: 0.0, singular: true, pass_through: false, eta_scale: 1.0 }
    }

    /// A direction of a lobe's value and density. `None` if it cannot be drawn.
    #[inline(always)]
    fn drawn(wi: Vec3, (value, pdf): (Vec3, f32)) -> Option<Self> {
        let drawn = Self { wi, weight: value / pdf, pdf, singular: false, pass_through: false, eta_scale: 1.0 };
        (pdf > 0.0).then_some(drawn)
    }
}

impl Bsdf {
    /// The kinds of its lobes.
    #[inline(always)]
    pub fn lobes(&self) -> Lobes {
        match self {
            Self::Lambert(_) => Lambert::LOBES,
            Self::Mirror(_) => Mirror::LOBES,
            Self::Conductor(_) => Conductor::LOBES,
            Self::Dielectric(_) => Dielectric::LOBES,
            Self::ThinDielectric(_) => ThinDielectric::LOBES,
            Self::RoughDielectric(_) => RoughDielectric::LOBES,
            Self::RoughSheet(_) => RoughSheet::LOBES,
            Self::Coated(_) => Coated::LOBES,
            Self::Layered(_) => Layered::LOBES,
            Self::Translucent(_) => Translucent::LOBES,
            Self::Black => Lobes::NONE,
        }
    }

    /// `f(wo, wi) · |cos θi|` and the density with which [`Self::sample`] chooses `wi`; zeros for singular surfaces.
    #[inline(always)]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let nothing = (Vec3::ZERO, 0.0);
        if wo.z <= 0.0 || wi.z == 0.0 {
            return nothing;
        }
        match self {
            Self::RoughDielectric(lobe) => return lobe.eval(wo, wi),
            Self::RoughSheet(lobe) => return lobe.eval(wo, wi),
            Self::Translucent(lobe) => return lobe.eval(wo, wi),
            _ => {}
        }
        if wi.z < 0.0 {
            return nothing;
        }
        match self {
            Self::Lambert(lobe) => lobe.eval(wi),
            Self::Conductor(lobe) => lobe.eval(wo, wi),
            Self::Coated(lobe) => lobe.eval(wo, wi),
            Self::Layered(lobe) => lobe.eval(wo, wi),
            _ => nothing,
        }
    }

    /// The density of [`Self::sample`] over solid angle, on both sides; 0 for singular surfaces.
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.eval(wo, wi).1
    }

    /// Albedo of the non-specular part: the part of uniform illumination that is scattered to `wo`. The light of a
    /// pixel is divided by it for denoising. Zero if the surface is purely specular.
    #[inline(always)]
    pub fn albedo(&self, wo: Vec3) -> Vec3 {
        match self {
            Self::Lambert(lobe) => lobe.reflectance,
            Self::Conductor(lobe) => lobe.albedo(wo.z),
            Self::Coated(lobe) => lobe.albedo(wo.z),
            Self::Layered(lobe) => lobe.albedo(wo.z),
            Self::Translucent(lobe) => lobe.albedo(wo.z),
            Self::RoughDielectric(_) | Self::RoughSheet(_) => Vec3::ONE,
            Self::Mirror(_) | Self::Dielectric(_) | Self::ThinDielectric(_) | Self::Black => Vec3::ZERO,
        }
    }

    /// Samples a direction from a pair of uniform numbers and one more for the choice of the lobe. `None` if the light
    /// is absorbed.
    #[inline(always)]
    pub fn sample(&self, wo: Vec3, pair: Vec2, choice: f32) -> Option<Scattered> {
        match self {
            Self::Lambert(lobe) => lobe.sample(pair),
            Self::Mirror(lobe) => Some(lobe.sample(wo)),
            Self::Conductor(lobe) => lobe.sample(wo, pair, choice),
            Self::Dielectric(lobe) => Some(lobe.sample(wo, choice)),
            Self::ThinDielectric(lobe) => Some(lobe.sample(wo, choice)),
            Self::RoughDielectric(lobe) => lobe.sample(wo, pair, choice),
            Self::RoughSheet(lobe) => lobe.sample(wo, pair, choice),
            Self::Coated(lobe) => lobe.sample(wo, pair, choice),
            Self::Layered(lobe) => lobe.sample(wo, pair, choice),
            Self::Translucent(lobe) => lobe.sample(wo, pair, choice),
            Self::Black => None,
        }
    }

    /// The branch of a boundary that [`Self::sample`] does not take for this choice, and its probability. `None` if
    /// there is only one.
    #[inline(always)]
    pub fn other_way(&self, wo: Vec3, choice: f32) -> Option<(Scattered, f32)> {
        let reflectance = match self {
            Self::Dielectric(lobe) => lobe.reflectance(wo.z),
            Self::ThinDielectric(lobe) => lobe.reflectance(wo.z),
            _ => return None,
        };
        let (chance, other) = if choice < reflectance { (1.0 - reflectance, 1.0) } else { (reflectance, 0.0) };
        let way = if chance > 0.0 { self.sample(wo, Vec2::ZERO, other) } else { None };
        way.map(|way| (way, chance))
    }

    /// Transmittance for shadow rays that pass straight through: 0 for all surfaces but smooth thin sheets.
    pub fn straight_transmittance(&self, cosine: f32) -> Vec3 {
        match self {
            Self::ThinDielectric(lobe) => lobe.transmittance * (1.0 - lobe.reflectance(cosine)),
            _ => Vec3::ZERO,
        }
    }
}

/// Density `cos θ / π` over the upper hemisphere.
pub(super) fn cosine_hemisphere(pair: Vec2) -> Vec3 {
    let disc = concentric_disc(pair);
    Vec3::new(disc.x, disc.y, (1.0 - disc.length_squared()).max(1e-8).sqrt())
}

/// Uniform on the unit disc, keeping strata together (Shirley and Chiu 1997).
pub(super) fn concentric_disc(pair: Vec2) -> Vec2 {
    let p = 2.0 * pair - Vec2::ONE;
    if p == Vec2::ZERO {
        return p;
    }
    let (radius, angle) =
        if p.x.abs() > p.y.abs() { (p.x, 0.25 * PI * (p.y / p.x)) } else { (p.y, 0.5 * PI - 0.25 * PI * (p.x / p.y)) };
    radius * Vec2::new(angle.cos(), angle.sin())
}
