//! How surfaces scatter: each description of `scene::Surface` resolved at a hit, as functions of two directions.
//!
//! Directions point away from the surface, in a local frame whose z axis is the shading normal on the side of the
//! viewer: `wo.z > 0` always. Reflection has `wi.z > 0`, transmission `wi.z < 0`. `eval` gives `f · |cos θi|`.

mod fresnel;
mod microfacet;

use std::f32::consts::{FRAC_1_PI, PI};

use glam::{Vec2, Vec3};

use crate::scene::{Surface, Texture};
use fresnel::{dielectric_reflectance, schlick, thin_reflectance};
use microfacet::Ggx;

/// A surface at a point, its colours looked up.
#[derive(Clone, Copy, Debug)]
pub enum Bsdf {
    /// Lambertian reflection.
    Lambert {
        /// Albedo.
        reflectance: Vec3,
    },
    /// Perfect mirror.
    Mirror {
        /// Reflectance.
        reflectance: Vec3,
    },
    /// GGX conductor with Schlick's Fresnel term.
    RoughConductor {
        /// Reflectance at normal incidence.
        specular: Vec3,
        /// Roughness of the microfacets.
        alpha: f32,
    },
    /// Smooth boundary.
    Dielectric {
        /// Index of refraction on the far side over that on the viewer's.
        ior: f32,
        /// Colour of transmitted light.
        transmittance: Vec3,
    },
    /// Thin sheet.
    ThinDielectric {
        /// Index of refraction of the sheet.
        ior: f32,
        /// Colour of transmitted light.
        transmittance: Vec3,
    },
    /// Lambertian base under a GGX coat, coupled as Kelemen and Szirmay-Kalos (2001): the base receives what the coat
    /// does not reflect, `ρ (1 − E(θi)) (1 − E(θo)) / (π (1 − Ē))` with `E` Schlick's term and `Ē` its cosine mean.
    /// Reciprocal, and of albedo one under a smooth coat where ρ is one.
    Coated {
        /// Albedo of the base.
        reflectance: Vec3,
        /// Reflectance of the coat at normal incidence.
        specular: Vec3,
        /// Roughness of the coat's microfacets.
        alpha: f32,
    },
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

/// Below this a microfacet surface is a mirror: its highlight is narrower than f32 can integrate.
const MIN_ALPHA: f32 = 1e-3;

impl Bsdf {
    /// Resolves a description at texture coordinates `uv`; `front` says which side the viewer is on.
    #[inline(always)]
    pub fn resolve(surface: &Surface, textures: &[Texture], uv: Vec2, front: bool) -> Self {
        match *surface {
            Surface::Lambert { reflectance } => Self::Lambert { reflectance: reflectance.at(textures, uv) },
            Surface::Mirror { reflectance } => Self::Mirror { reflectance: reflectance.at(textures, uv) },
            Surface::RoughConductor { specular, alpha } => {
                Self::RoughConductor { specular: specular.at(textures, uv), alpha: alpha.max(MIN_ALPHA) }
            }
            Surface::Dielectric { ior, transmittance } => {
                Self::Dielectric { ior: if front { ior } else { 1.0 / ior }, transmittance }
            }
            Surface::ThinDielectric { ior, transmittance } => Self::ThinDielectric { ior, transmittance },
            Surface::Coated { reflectance, specular, alpha } => {
                Self::Coated { reflectance: reflectance.at(textures, uv), specular, alpha: alpha.max(MIN_ALPHA) }
            }
            Surface::Black => Self::Black,
        }
    }

    /// Whether the surface scatters over a solid angle, so that light samples can contribute.
    #[inline(always)]
    pub fn is_non_specular(&self) -> bool {
        matches!(self, Self::Lambert { .. } | Self::RoughConductor { .. } | Self::Coated { .. })
    }

    /// Whether the surface reflects mainly about the mirror direction, or only there.
    #[inline(always)]
    pub fn has_lobe(&self) -> bool {
        !matches!(self, Self::Lambert { .. } | Self::Black)
    }

    /// Whether rays may pass straight through.
    #[inline(always)]
    pub fn lets_pass(&self) -> bool {
        matches!(self, Self::ThinDielectric { .. })
    }

    /// `f(wo, wi) · |cos θi|` and the density with which [`Self::sample`] chooses `wi`; zeros for singular surfaces.
    #[inline(always)]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        if wi.z <= 0.0 || wo.z <= 0.0 {
            return (Vec3::ZERO, 0.0);
        }
        match *self {
            Self::Lambert { reflectance } => (reflectance * (FRAC_1_PI * wi.z), FRAC_1_PI * wi.z),
            Self::RoughConductor { specular, alpha } => {
                let ggx = Ggx { alpha };
                let half = (wo + wi).normalize();
                (schlick(specular, wi.dot(half)) * ggx.reflection(wo, wi, half), ggx.reflection_pdf(wo, half))
            }
            Self::Coated { reflectance, specular, alpha } => {
                let ggx = Ggx { alpha };
                let half = (wo + wi).normalize();
                let coat = schlick(specular, wi.dot(half)) * ggx.reflection(wo, wi, half);
                let base = coated_base(reflectance, specular, wo.z, wi.z) * (FRAC_1_PI * wi.z);
                let chance = coat_chance(reflectance, specular, wo.z);
                let pdf = chance * ggx.reflection_pdf(wo, half) + (1.0 - chance) * FRAC_1_PI * wi.z;
                (coat + base, pdf)
            }
            Self::Mirror { .. } | Self::Dielectric { .. } | Self::ThinDielectric { .. } | Self::Black => {
                (Vec3::ZERO, 0.0)
            }
        }
    }

    /// Albedo of the non-specular part: the part of uniform illumination that is reflected to `wo`. The light of a
    /// pixel is divided by it for denoising. Exact for diffuse surfaces and smooth coats; for rough ones it ignores
    /// multiple scattering between microfacets. Zero if the surface is purely specular.
    #[inline(always)]
    pub fn albedo(&self, wo: Vec3) -> Vec3 {
        match *self {
            Self::Lambert { reflectance } => reflectance,
            Self::RoughConductor { specular, .. } => schlick(specular, wo.z),
            Self::Coated { reflectance, specular, .. } => {
                let coat = schlick(specular, wo.z);
                coat + reflectance * (Vec3::ONE - coat)
            }
            Self::Mirror { .. } | Self::Dielectric { .. } | Self::ThinDielectric { .. } | Self::Black => Vec3::ZERO,
        }
    }

    /// Samples a direction from a pair of uniform numbers and one more for the choice of the lobe. `None` if the light
    /// is absorbed.
    #[inline(always)]
    pub fn sample(&self, wo: Vec3, pair: Vec2, choice: f32) -> Option<Scattered> {
        let mirror = Scattered {
            wi: Vec3::new(-wo.x, -wo.y, wo.z),
            weight: Vec3::ONE,
            pdf: 0.0,
            singular: true,
            pass_through: false,
            eta_scale: 1.0,
        };
        let wi = match *self {
            Self::Black => return None,
            Self::Mirror { reflectance } => return Some(Scattered { weight: reflectance, ..mirror }),
            Self::Dielectric { ior, transmittance } => {
                let (reflectance, cos_inside) = dielectric_reflectance(wo.z, ior);
                if choice < reflectance {
                    return Some(mirror);
                }
                // Radiance is compressed by the square of the index it enters (Veach 1997, §5.2); what is traced
                // here is radiance flowing back from the far side to the near one.
                let wi = Vec3::new(-wo.x / ior, -wo.y / ior, -cos_inside);
                let compression = ior * ior;
                return Some(Scattered { wi, weight: transmittance / compression, eta_scale: compression, ..mirror });
            }
            Self::ThinDielectric { ior, transmittance } => {
                let reflectance = thin_reflectance(wo.z, ior);
                if choice < reflectance {
                    return Some(mirror);
                }
                return Some(Scattered { wi: -wo, weight: transmittance, pass_through: true, ..mirror });
            }
            Self::Lambert { .. } => cosine_hemisphere(pair),
            Self::RoughConductor { alpha, .. } => Ggx { alpha }.sample_reflection(wo, pair),
            Self::Coated { reflectance, specular, alpha } => {
                if choice < coat_chance(reflectance, specular, wo.z) {
                    Ggx { alpha }.sample_reflection(wo, pair)
                } else {
                    cosine_hemisphere(pair)
                }
            }
        };
        let (value, pdf) = self.eval(wo, wi);
        (pdf > 0.0).then(|| Scattered { wi, weight: value / pdf, pdf, singular: false, ..mirror })
    }

    /// The branch of a boundary that [`Self::sample`] does not take for this choice, and its probability. `None` if
    /// there is only one.
    #[inline(always)]
    pub fn other_way(&self, wo: Vec3, choice: f32) -> Option<(Scattered, f32)> {
        let reflectance = match *self {
            Self::Dielectric { ior, .. } => dielectric_reflectance(wo.z, ior).0,
            Self::ThinDielectric { ior, .. } => thin_reflectance(wo.z, ior),
            _ => return None,
        };
        let (chance, other) = if choice < reflectance { (1.0 - reflectance, 1.0) } else { (reflectance, 0.0) };
        let way = if chance > 0.0 { self.sample(wo, Vec2::ZERO, other) } else { None };
        way.map(|way| (way, chance))
    }

    /// Transmittance for shadow rays that pass straight through: 0 for all surfaces but thin sheets.
    pub fn straight_transmittance(&self, cosine: f32) -> Vec3 {
        match *self {
            Self::ThinDielectric { ior, transmittance } => transmittance * (1.0 - thin_reflectance(cosine, ior)),
            _ => Vec3::ZERO,
        }
    }
}

/// The base of a coated surface, as an albedo that depends on both angles.
fn coated_base(reflectance: Vec3, specular: Vec3, cos_o: f32, cos_i: f32) -> Vec3 {
    // The cosine-weighted mean of Schlick's term: ∫ 2μ (F₀ + (1 − F₀)(1 − μ)⁵) dμ = F₀ + (1 − F₀)/21.
    let mean = specular + (Vec3::ONE - specular) / 21.0;
    let passed = (Vec3::ONE - schlick(specular, cos_o)) * (Vec3::ONE - schlick(specular, cos_i));
    reflectance * passed / (Vec3::ONE - mean).max(Vec3::splat(1e-6))
}

/// Probability to sample the coat: its share of the reflected light, bounded below so that every highlight is sampled.
fn coat_chance(reflectance: Vec3, specular: Vec3, cos_o: f32) -> f32 {
    let coat = schlick(specular, cos_o).element_sum();
    let base = (reflectance * (Vec3::ONE - schlick(specular, cos_o))).element_sum();
    (coat / (coat + base).max(1e-6)).clamp(0.1, 0.9)
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
