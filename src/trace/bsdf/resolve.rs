//! From the description of a surface to its scattering at a point.

use glam::{Vec2, Vec3};

use super::{
    Bsdf, Coated, Conductor, Dielectric, Lambert, Layered, Mirror, RoughDielectric, RoughSheet, ThinDielectric,
    Translucent,
};
use crate::scene::{FloatTexture, PrincipledSurface, Surface, Texture};

/// An index of refraction this near to 1 bends no light.
const NO_REFRACTION: f32 = 3e-3;

impl Bsdf {
    /// Resolves a description at texture coordinates `uv`; `front` says which side the viewer is on. `chance` is a uniform
    /// number, by which a surface that is glass in part is glass or not.
    #[inline(always)]
    pub fn resolve(surface: &Surface, textures: &[Texture], uv: Vec2, front: bool, chance: f32) -> Self {
        match *surface {
            Surface::Lambert { reflectance } => Self::Lambert(Lambert { reflectance: reflectance.at(textures, uv) }),
            Surface::Mirror { reflectance } => Self::Mirror(Mirror { reflectance: reflectance.at(textures, uv) }),
            Surface::RoughConductor { specular, alpha } => {
                Self::Conductor(Conductor::new(specular.at(textures, uv), alpha))
            }
            Surface::Dielectric { ior, transmittance } => {
                Self::Dielectric(Dielectric { ior: if front { ior } else { 1.0 / ior }, transmittance })
            }
            Surface::ThinDielectric { ior, transmittance } => {
                Self::ThinDielectric(ThinDielectric { ior, transmittance })
            }
            Surface::Coated { reflectance, specular, alpha } => {
                Self::Coated(Coated::new(reflectance.at(textures, uv), specular, alpha))
            }
            Surface::Principled(ref surface) => Self::of_principled(surface, textures, uv, front, chance),
            Surface::Black => Self::Black,
        }
    }

    fn of_principled(surface: &PrincipledSurface, textures: &[Texture], uv: Vec2, front: bool, chance: f32) -> Self {
        let base = surface.base.at(textures, uv).clamp(Vec3::ZERO, Vec3::ONE);
        let at = |level: FloatTexture| level.at(textures, uv).clamp(0.0, 1.0);
        let (metal, alpha) = (at(surface.metallic), at(surface.roughness).powi(2));
        let glass = at(surface.transmission) * (1.0 - metal);
        if glass > 0.0 && chance < glass {
            let ior = if front || surface.is_thin { surface.ior } else { 1.0 / surface.ior };
            // Straight on, whatever its roughness.
            let is_smooth = alpha < PrincipledSurface::SMOOTH_GLASS || (ior - 1.0).abs() < NO_REFRACTION;
            // Light crosses a body's surface twice.
            let base = if surface.is_thin { base } else { base.map(f32::sqrt) };
            return match (surface.is_thin, is_smooth) {
                (true, true) => Self::ThinDielectric(ThinDielectric { ior, transmittance: base }),
                (true, false) => Self::RoughSheet(RoughSheet::new(ior, base, alpha)),
                (false, true) => Self::Dielectric(Dielectric { ior, transmittance: base }),
                (false, false) => Self::RoughDielectric(RoughDielectric::new(ior, base, alpha)),
            };
        }
        // Of what is no glass.
        let metal = (metal / (1.0 - glass)).min(1.0);
        let specular = surface.specular.at(textures, uv).clamp(Vec3::ZERO, Vec3::ONE);
        let mixed = Coated::mixed(base, specular, metal, alpha);
        let through = at(surface.translucency);
        if through > 0.0 {
            let colour = surface.translucent.at(textures, uv).clamp(Vec3::ZERO, Vec3::ONE);
            let front = mixed.with_base(base * ((1.0 - metal) * (1.0 - through)));
            return Self::Translucent(Translucent::of(front, colour * ((1.0 - metal) * through)));
        }
        let (coat, sheen) = (surface.coat, surface.sheen);
        if coat.0 > 0.0 || sheen.0 != Vec3::ZERO {
            let [coat_alpha, sheen_alpha] = [coat.1, sheen.1].map(|roughness| roughness * roughness);
            return Self::Layered(Layered::new(mixed, (coat.0, coat_alpha), (sheen.0, sheen_alpha)));
        }
        if metal == 0.0 && specular == Vec3::ZERO {
            return Self::Lambert(Lambert { reflectance: base });
        }
        mixed.bare_gloss().map_or(Self::Coated(mixed), |gloss| Self::Conductor(Conductor::of(gloss)))
    }
}
