//! From the description of a surface to its scattering at a point.

use glam::Vec2;

use super::{Bsdf, Coated, Conductor, Dielectric, Lambert, Mirror, ThinDielectric};
use crate::scene::{Surface, Texture};

impl Bsdf {
    /// Resolves a description at texture coordinates `uv`; `front` says which side the viewer is on.
    #[inline(always)]
    pub fn resolve(surface: &Surface, textures: &[Texture], uv: Vec2, front: bool) -> Self {
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
            Surface::Black => Self::Black,
        }
    }
}
