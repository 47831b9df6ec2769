//! What surfaces are made of, as descriptions; `trace::bsdf` gives them their behaviour.

use std::ops::RangeInclusive;

use glam::{Vec2, Vec3};

/// Index of refraction of surfaces that state none: ordinary glass and lacquer.
pub(super) const USUAL_IOR: f32 = 1.5;
/// Indices of refraction that are taken.
pub(super) const IORS: RangeInclusive<f32> = 0.1..=10.0;

/// Reflectance at normal incidence of a boundary with this index of refraction (Fresnel).
pub(super) fn normal_reflectance(ior: f32) -> f32 {
    ((ior - 1.0) / (ior + 1.0)).powi(2)
}

/// Index into [`Scene::textures`](super::Scene::textures).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TextureId(pub u32);

/// An RGB image over texture coordinates, repeated in both directions, linear Rec. 709.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Its origin, for messages.
    pub name: String,
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// RGBA texels, row by row from the top (v = 1).
    pub texels: Vec<[f32; 4]>,
}

/// A colour that may vary over the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Paint {
    /// One value for the whole surface.
    Constant(Vec3),
    /// A texture times a factor.
    Textured(TextureId, Vec3),
}

/// How a surface scatters light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Surface {
    /// Lambertian reflection on both sides.
    Lambert {
        /// Albedo.
        reflectance: Paint,
    },
    /// Perfect mirror on both sides.
    Mirror {
        /// Reflectance at every angle.
        reflectance: Paint,
    },
    /// Rough conductor: GGX microfacets, Schlick Fresnel from `specular`.
    RoughConductor {
        /// Reflectance at normal incidence.
        specular: Paint,
        /// GGX α, the square of the perceptual roughness.
        alpha: f32,
    },
    /// Smooth dielectric boundary with Fresnel reflection and refraction.
    Dielectric {
        /// Index of refraction inside (behind the front side) over outside.
        ior: f32,
        /// Colour of transmitted light, applied at each crossing.
        transmittance: Vec3,
    },
    /// Thin sheet: light passes straight, Fresnel reflection of both faces summed; transparent to shadow rays.
    ThinDielectric {
        /// Index of refraction of the sheet.
        ior: f32,
        /// Colour of transmitted light.
        transmittance: Vec3,
    },
    /// A Lambertian base under a rough dielectric coat (GGX).
    Coated {
        /// Albedo of the base.
        reflectance: Paint,
        /// Reflectance of the coat at normal incidence.
        specular: Vec3,
        /// GGX α of the coat.
        alpha: f32,
    },
    /// Absorbs everything: the surface of most lamps.
    Black,
}

/// A material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name in the MTL file.
    pub name: String,
    /// Its scattering.
    pub surface: Surface,
    /// Cut-out: where the texture's alpha (its fourth channel) is below one half, the surface is not there.
    pub cutout: Option<TextureId>,
    /// Share of what falls on the surface that meets it; the rest passes straight through as if it were not there. From 0 to 1.
    pub opacity: f32,
}

impl Texture {
    /// Bilinear look-up of RGBA at `uv`, repeating; v points up.
    pub fn sample(&self, uv: Vec2) -> [f32; 4] {
        let wrap = |i: i64, n: u32| i.rem_euclid(i64::from(n)) as usize;
        let x = uv.x * self.width as f32 - 0.5;
        let y = (1.0 - uv.y) * self.height as f32 - 0.5;
        let (fx, fy) = (x - x.floor(), y - y.floor());
        let (x0, x1) = (wrap(x.floor() as i64, self.width), wrap(x.floor() as i64 + 1, self.width));
        let (y0, y1) = (wrap(y.floor() as i64, self.height), wrap(y.floor() as i64 + 1, self.height));
        let at = |x: usize, y: usize| self.texels[y * self.width as usize + x];
        std::array::from_fn(|c| {
            let top = at(x0, y0)[c] * (1.0 - fx) + at(x1, y0)[c] * fx;
            let bottom = at(x0, y1)[c] * (1.0 - fx) + at(x1, y1)[c] * fx;
            top * (1.0 - fy) + bottom * fy
        })
    }
}

impl Paint {
    /// The colour at `uv`.
    pub fn at(self, textures: &[Texture], uv: Vec2) -> Vec3 {
        match self {
            Self::Constant(colour) => colour,
            Self::Textured(id, factor) => {
                let [r, g, b, _] = textures[id.0 as usize].sample(uv);
                Vec3::new(r, g, b) * factor
            }
        }
    }
}
