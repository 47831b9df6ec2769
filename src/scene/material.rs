//! What surfaces are made of, as descriptions; `trace::bsdf` gives them their behaviour.

use std::ops::RangeInclusive;
use std::sync::LazyLock;

use glam::{Vec2, Vec3};

use crate::image::decode_srgb;

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

/// An image over texture coordinates.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Its origin, for messages.
    pub name: String,
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// RGBA texels, row by row from the top (v = 1).
    pub texels: Texels,
    /// How it lies on the texture coordinates.
    pub placing: Placing,
}

/// How a texture lies on the texture coordinates of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placing {
    /// Factor on the texture coordinates.
    pub scale: Vec2,
    /// Added after the factor.
    pub offset: Vec2,
    /// Whether it ends at its edges, whose texels go on beyond; otherwise it repeats.
    pub is_clamped: bool,
}

impl Placing {
    /// On the coordinates themselves, repeating.
    pub const PLAIN: Self = Self { scale: Vec2::ONE, offset: Vec2::ZERO, is_clamped: false };
}

/// Texels as their file has them.
#[derive(Clone, Debug, PartialEq)]
pub enum Texels {
    /// Eight bits, colours encoded by sRGB's curve of Rec. 709, alpha linear.
    Colours8(Vec<[u8; 4]>),
    /// Eight bits that mean numbers from 0 to 1.
    Numbers8(Vec<[u8; 4]>),
    /// Linear Rec. 709, or numbers.
    Floats(Vec<[f32; 4]>),
}

/// A colour that may vary over the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Paint {
    /// One value for the whole surface.
    Constant(Vec3),
    /// A texture times a factor.
    Textured(TextureId, Vec3),
}

/// A number that may vary over the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FloatTexture {
    /// One value for the whole surface.
    Constant(f32),
    /// A channel of a texture, 0 to 3, times a factor.
    Textured(TextureId, u8, f32),
}

/// How the normal varies over the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Relief {
    /// Normals in tangent space, each channel from −1 to 1 as 0 to 1, with a factor on what lies along the surface.
    Normals(TextureId, f32),
    /// Heights in the first channel, with a factor: by how much of the texture's own unit (its width) they rise.
    Heights(TextureId, f32),
}

/// A surface of several kinds at once, of which textures may say where: the metallic-roughness model of glTF 2.0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipledSurface {
    /// Albedo of what is diffuse, reflectance of what is metal, colour of what is transmitted: by a sheet, or by a body, of which each
    /// crossing has the root.
    pub base: Paint,
    /// Share that is metal.
    pub metallic: FloatTexture,
    /// Perceptual roughness, the root of GGX α.
    pub roughness: FloatTexture,
    /// Reflectance of what is no metal, at normal incidence.
    pub specular: Paint,
    /// Share of what is no metal that is glass.
    pub transmission: FloatTexture,
    /// Index of refraction of the glass.
    pub ior: f32,
    /// Whether the glass is a sheet that light passes straight, and no body.
    pub is_thin: bool,
    /// Share of what is diffuse that leaves on the other side.
    pub translucency: FloatTexture,
    /// Colour of that.
    pub translucent: Paint,
    /// Share that a clear coat of index 1.5 covers, and its perceptual roughness.
    pub coat: (f32, f32),
    /// Colour of a sheen of fibres, and its perceptual roughness.
    pub sheen: (Vec3, f32),
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
    /// Several kinds at once, or with textures of more than its colour.
    Principled(PrincipledSurface),
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
    /// Whose alpha is a factor on that.
    pub opacity_map: Option<TextureId>,
    /// Absorption per unit length behind its front, of a body (Beer–Lambert).
    pub absorption: Vec3,
    /// How its normal varies.
    pub relief: Option<Relief>,
}

impl Material {
    /// A material of a surface alone.
    pub fn new(name: impl Into<String>, surface: Surface) -> Self {
        let (name, absorption) = (name.into(), Vec3::ZERO);
        Self { name, surface, cutout: None, opacity: 1.0, opacity_map: None, absorption, relief: None }
    }
}

impl Texels {
    /// Number of texels.
    pub fn count(&self) -> usize {
        match self {
            Self::Colours8(texels) | Self::Numbers8(texels) => texels.len(),
            Self::Floats(texels) => texels.len(),
        }
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        let texel = if matches!(self, Self::Floats(_)) { size_of::<[f32; 4]>() } else { size_of::<[u8; 4]>() };
        (self.count() * texel) as u64
    }

    /// Numbers of eight bits, or floats, with a function on each channel but alpha.
    pub(super) fn mapped(self, of: impl Fn(f32) -> f32) -> Self {
        match self {
            Self::Colours8(mut texels) | Self::Numbers8(mut texels) => {
                let codes: [u8; 256] =
                    std::array::from_fn(|code| (of(code as f32 / 255.0).clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
                texels.iter_mut().flat_map(|texel| &mut texel[..3]).for_each(|v| *v = codes[usize::from(*v)]);
                Self::Numbers8(texels)
            }
            Self::Floats(mut texels) => {
                texels.iter_mut().flat_map(|texel| &mut texel[..3]).for_each(|v| *v = of(*v));
                Self::Floats(texels)
            }
        }
    }

    /// Whether they look like normals in tangent space: blue, of length one, and no grey.
    pub(super) fn are_normals(&self) -> bool {
        let step = (self.count() / 4096).max(1);
        let (mut like, mut all) = (0, 0);
        for index in (0..self.count()).step_by(step) {
            let [r, g, b, _] = self.at(index);
            let length = (Vec3::new(r, g, b) * 2.0 - 1.0).length();
            like += usize::from(b > 0.5 && (length - 1.0).abs() < 0.15 && (r - b).abs() > 0.1);
            all += 1;
        }
        2 * like > all
    }

    /// A texel, decoded.
    #[inline(always)]
    pub fn at(&self, index: usize) -> [f32; 4] {
        let number = |byte: u8| f32::from(byte) / 255.0;
        match self {
            Self::Colours8(texels) => {
                let [r, g, b, a] = texels[index];
                [SRGB[usize::from(r)], SRGB[usize::from(g)], SRGB[usize::from(b)], number(a)]
            }
            Self::Numbers8(texels) => texels[index].map(number),
            Self::Floats(texels) => texels[index],
        }
    }
}

/// The values of sRGB's 256 codes.
static SRGB: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|code| decode_srgb(code as f32 / 255.0)));

impl Texture {
    /// Bilinear look-up of RGBA at `uv`; v points up.
    #[inline]
    pub fn sample(&self, uv: Vec2) -> [f32; 4] {
        let (corners, fx, fy) = self.around(uv);
        let [a, b, c, d] = corners.map(|corner| self.texels.at(corner));
        std::array::from_fn(|channel| {
            let top = a[channel] * (1.0 - fx) + b[channel] * fx;
            let bottom = c[channel] * (1.0 - fx) + d[channel] * fx;
            top * (1.0 - fy) + bottom * fy
        })
    }

    /// The four texels around `uv`, the upper left one first, and the place between them.
    #[inline(always)]
    fn around(&self, uv: Vec2) -> ([usize; 4], f32, f32) {
        let Placing { scale, offset, is_clamped } = self.placing;
        let uv = if self.placing == Placing::PLAIN { uv } else { uv * scale + offset };
        let wrap = |i: i64, n: u32| match is_clamped {
            true => i.clamp(0, i64::from(n) - 1) as usize,
            false => i.rem_euclid(i64::from(n)) as usize,
        };
        let x = uv.x * self.width as f32 - 0.5;
        let y = (1.0 - uv.y) * self.height as f32 - 0.5;
        let (fx, fy) = (x - x.floor(), y - y.floor());
        let (x0, x1) = (wrap(x.floor() as i64, self.width), wrap(x.floor() as i64 + 1, self.width));
        let (y0, y1) = (wrap(y.floor() as i64, self.height), wrap(y.floor() as i64 + 1, self.height));
        let at = |x: usize, y: usize| y * self.width as usize + x;
        ([at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1)], fx, fy)
    }

    /// A map of normals at `uv`: red along u and green along v, each from −1 to 1 as 0 to 1.
    pub fn normal(&self, uv: Vec2) -> [f32; 4] {
        let [r, g, b, a] = self.sample(uv);
        let turned = |value: f32, scale: f32| if scale < 0.0 { 1.0 - value } else { value };
        [turned(r, self.placing.scale.x), turned(g, self.placing.scale.y), b, a]
    }

    /// How the first channel grows along u and v at `uv`, for each width of the texture.
    pub fn slope(&self, uv: Vec2) -> Vec2 {
        let (corners, fx, fy) = self.around(uv);
        let [a, b, c, d] = corners.map(|corner| self.texels.at(corner)[0]);
        let across = (b - a) * (1.0 - fy) + (d - c) * fy;
        let down = (c - a) * (1.0 - fx) + (d - b) * fx;
        let scale = self.placing.scale;
        Vec2::new(across * self.width as f32, -down * self.height as f32) * scale / scale.x.abs()
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

impl FloatTexture {
    /// The number at `uv`.
    #[inline(always)]
    pub fn at(self, textures: &[Texture], uv: Vec2) -> f32 {
        match self {
            Self::Constant(value) => value,
            Self::Textured(id, channel, factor) => {
                textures[id.0 as usize].sample(uv)[usize::from(channel & 3)] * factor
            }
        }
    }

    /// Whether it is this number everywhere.
    pub fn is(self, value: f32) -> bool {
        self == Self::Constant(value)
    }
}

impl PrincipledSurface {
    /// A white surface that is neither metal nor glass, smooth but without a reflection.
    pub fn opaque(ior: f32) -> Self {
        let (white, none) = (Paint::Constant(Vec3::ONE), FloatTexture::Constant(0.0));
        Self {
            base: white,
            metallic: none,
            roughness: none,
            specular: Paint::Constant(Vec3::ZERO),
            transmission: none,
            ior,
            is_thin: true,
            translucency: none,
            translucent: white,
            coat: (0.0, 0.0),
            sheen: (Vec3::ZERO, 0.0),
        }
    }

    /// Whether its glass may be smooth somewhere: where a texture says how rough it is, or a roughness below
    /// [`SMOOTH_GLASS`](Self::SMOOTH_GLASS).
    pub fn may_be_smooth(&self) -> bool {
        match self.roughness {
            FloatTexture::Constant(roughness) => roughness * roughness < Self::SMOOTH_GLASS,
            FloatTexture::Textured(..) => true,
        }
    }

    /// GGX α below which glass is smooth: light is then found by photons and along delta branches, which is better.
    pub const SMOOTH_GLASS: f32 = 0.005;

    /// Share of the light that meets glass at `uv`.
    pub fn glass_at(&self, textures: &[Texture], uv: Vec2) -> f32 {
        let at = |level: FloatTexture| level.at(textures, uv).clamp(0.0, 1.0);
        at(self.transmission) * (1.0 - at(self.metallic))
    }

    /// Whether it is glass in part, so that a path draws whether it meets the glass.
    #[inline(always)]
    pub fn is_mixed(&self) -> bool {
        !(self.transmission.is(0.0) || self.transmission.is(1.0) && self.metallic.is(0.0))
    }
}
