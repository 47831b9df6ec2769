//! Materials as a glTF file describes them; `looks` makes surfaces of them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{Mat2, Vec2, Vec3};
use gltf::material::AlphaMode;
use gltf::texture::{Info, WrappingMode};
use gltf::{Document, Material, texture};

use super::super::Texture;
use super::super::import::{Description, SourceMaterial};
use super::buffers::{Buffers, Uri, uri};
use super::plain;
use crate::error::{Error, Result};

/// Where an image's bytes are.
#[derive(Clone, Debug)]
pub(in super::super) enum ImageSource {
    /// In a file beside the glTF file: its folder and its name there.
    File(PathBuf, String),
    /// In the glTF file: a name for messages, and the bytes.
    Embedded(PathBuf, Arc<[u8]>),
    /// In the vertices of a mesh: the texture that they make.
    Colours(Arc<Texture>),
}

/// An image that a material names.
pub(in super::super) type SourceImage = Option<ImageSource>;

/// What a material's alpha means here.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in super::super) enum Alpha {
    /// Nothing.
    Opaque,
    /// Where the texture's alpha times this is below one half, the surface is not there.
    Cut(f32),
    /// A sheet through which all light passes but this share, which it colours.
    Sheet(f32),
}

/// A material of the metallic-roughness kind, with the extensions that are read.
#[derive(Clone, Debug)]
pub(in super::super) struct GltfMaterial {
    pub(in super::super) base: Vec3,
    pub(in super::super) base_image: SourceImage,
    pub(in super::super) alpha: Alpha,
    pub(in super::super) metallic: f32,
    pub(in super::super) roughness: f32,
    /// Blue multiplies `metallic`, green `roughness`.
    pub(in super::super) metallic_roughness_image: SourceImage,
    pub(in super::super) ior: f32,
    /// Colour and strength of the reflection at normal incidence, over that of `ior`.
    pub(in super::super) specular: Vec3,
    /// A clear coat over all: its strength and its roughness.
    pub(in super::super) clear_coat: [f32; 2],
    pub(in super::super) transmission: f32,
    /// Whether it bounds a body, which refracts; otherwise it is a sheet.
    pub(in super::super) is_body: bool,
    pub(in super::super) emission: Vec3,
    pub(in super::super) emission_image: SourceImage,
    pub(in super::super) two_sided: bool,
}

/// All materials of a file, and one more for meshes without.
pub(super) fn describe(
    path: &Path,
    document: &Document,
    buffers: &Buffers,
    warnings: &mut Vec<String>,
) -> Result<Vec<SourceMaterial>> {
    let mut images = Images { path, document, buffers, known: vec![None; document.images().len()] };
    let mut described = Vec::new();
    let mut unused: Vec<(&str, Vec<String>)> = Vec::new();
    for (index, material) in document.materials().enumerate() {
        let name = material.name().filter(|name| !name.is_empty());
        let name = name.map_or_else(|| format!("material {index}"), plain);
        let place = format!("{}, material '{name}'", path.display());
        for what in not_used(&material) {
            match unused.iter_mut().find(|(known, _)| *known == what) {
                Some((_, names)) => names.push(name.clone()),
                None => unused.push((what, vec![name.clone()])),
            }
        }
        let description = images.material(&material, &place)?;
        described.push(SourceMaterial { name, description: Description::Gltf(Box::new(description)) });
    }
    for (what, names) in unused {
        let more = names.len() - 1;
        let others = if more > 0 { format!(" and {more} more") } else { String::new() };
        warnings.push(format!("{}: {what} (material '{}'{others})", path.display(), names[0]));
    }
    // The format says what a mesh without a material has: all of the defaults.
    let default = GltfMaterial {
        base: Vec3::ONE,
        base_image: None,
        alpha: Alpha::Opaque,
        metallic: 1.0,
        roughness: 1.0,
        metallic_roughness_image: None,
        ior: 1.5,
        specular: Vec3::ONE,
        clear_coat: [0.0; 2],
        transmission: 0.0,
        is_body: false,
        emission: Vec3::ZERO,
        emission_image: None,
        two_sided: false,
    };
    described.push(SourceMaterial { name: "unnamed".into(), description: Description::Gltf(Box::new(default)) });
    Ok(described)
}

/// What of a material is left out or simplified, in words.
fn not_used(material: &Material<'_>) -> Vec<&'static str> {
    let pbr = material.pbr_metallic_roughness();
    let mut lines = Vec::new();
    let mut say = |applies: bool, what: &'static str| {
        if applies {
            lines.push(what);
        }
    };
    say(material.normal_texture().is_some(), "normal maps are not used");
    let metallic = pbr.metallic_factor();
    let mapped = pbr.metallic_roughness_texture().is_some();
    say(mapped, "of metallic-roughness textures the average is used");
    say(!mapped && metallic > 0.05 && metallic < 0.95, "what is half metal is taken as the nearer of metal and none");
    say(
        material.alpha_mode() == AlphaMode::Blend,
        "alpha blending is not traced: a texture's alpha cuts out at one half, an even alpha below one half makes a sheet",
    );
    let glass = material.transmission().is_some_and(|t| t.transmission_factor() >= 0.5);
    say(glass && pbr.roughness_factor() > 0.1, "rough glass is taken as smooth");
    say(glass && pbr.base_color_texture().is_some(), "textures on glass are not used");
    say(
        material
            .transmission()
            .is_some_and(|t| t.transmission_texture().is_some() || (0.01..0.5).contains(&t.transmission_factor())),
        "transmission is taken as whole from one half on, and its textures are not used",
    );
    let attenuates = material.volume().is_some_and(|v| v.attenuation_distance().is_finite());
    say(attenuates, "bodies that absorb are taken as clear");
    let specular_maps =
        material.specular().is_some_and(|s| s.specular_texture().is_some() || s.specular_color_texture().is_some());
    say(specular_maps, "textures of the specular extension are not used");
    let coat = clear_coat(material)[0] > 0.0;
    say(coat && (mapped || metallic >= 0.5), "the clear coat of metals is not used");
    let coat_maps = ["clearcoatTexture", "clearcoatRoughnessTexture", "clearcoatNormalTexture"];
    let maps_coat = |coat: &gltf::json::Value| coat_maps.iter().any(|key| coat.get(*key).is_some());
    let mapped_coat = material.extension_value("KHR_materials_clearcoat").is_some_and(maps_coat);
    say(mapped_coat, "textures of clear coats are not used");
    let (base, emissive) = (pbr.base_color_texture(), material.emissive_texture());
    let differ = matches!((base, emissive), (Some(b), Some(e)) if placement(&b) != placement(&e));
    say(differ, "the emissive texture is laid as the base colour texture is");
    lines
}

/// Strength and roughness of `KHR_materials_clearcoat`, which the crate leaves as it is written.
fn clear_coat(material: &Material<'_>) -> [f32; 2] {
    let number = |key: &str| {
        let found = material.extension_value("KHR_materials_clearcoat").and_then(|coat| coat.get(key));
        found.and_then(|value| value.as_f64()).unwrap_or(0.0) as f32
    };
    ["clearcoatFactor", "clearcoatRoughnessFactor"].map(number)
}

/// Whether nothing of a material is there: masked, and its even alpha is below the cut-off.
pub(super) fn is_absent(material: &Material<'_>) -> bool {
    let pbr = material.pbr_metallic_roughness();
    let cutoff = material.alpha_cutoff().unwrap_or(0.5);
    material.alpha_mode() == AlphaMode::Mask
        && pbr.base_color_texture().is_none()
        && pbr.base_color_factor()[3] < cutoff
}

struct Images<'a> {
    path: &'a Path,
    document: &'a Document,
    buffers: &'a Buffers,
    known: Vec<SourceImage>,
}

impl Images<'_> {
    fn material(&mut self, material: &Material<'_>, place: &str) -> Result<GltfMaterial> {
        let pbr = material.pbr_metallic_roughness();
        let [r, g, b, alpha] = pbr.base_color_factor();
        let [metallic, roughness] = [pbr.metallic_factor(), pbr.roughness_factor()];
        let ior = material.ior().unwrap_or(1.5);
        let specular = material.specular();
        let strength = specular.as_ref().map_or(1.0, |s| s.specular_factor());
        let tint = specular.as_ref().map_or(Vec3::ONE, |s| Vec3::from(s.specular_color_factor()));
        let transmission = material.transmission().map_or(0.0, |t| t.transmission_factor());
        let emission = Vec3::from(material.emissive_factor()) * material.emissive_strength().unwrap_or(1.0);
        let clear_coat = clear_coat(material);
        let fractions = [r, g, b, alpha, metallic, roughness, strength, tint.x, tint.y, tint.z, transmission];
        let fractions = fractions.into_iter().chain(clear_coat);
        let numbers = fractions.chain(emission.to_array()).chain([material.alpha_cutoff().unwrap_or(0.5)]);
        if !numbers.into_iter().all(|v| v >= 0.0 && v.is_finite()) {
            return Err(Error::input(place, "has a factor that is negative or not finite", "mend the material"));
        }
        // 0 is how the format says that it reflects wholly; no index of refraction is below 0.1.
        if !(ior == 0.0 || (0.1..=10.0).contains(&ior)) {
            return Err(Error::input(place, format!("ior {ior}"), "give a number from 0.1 to 10, 1.5 for glass"));
        }
        let image = pbr.base_color_texture();
        let alpha = match material.alpha_mode() {
            AlphaMode::Opaque => Alpha::Opaque,
            AlphaMode::Mask => match material.alpha_cutoff().unwrap_or(0.5) {
                cutoff if cutoff > 0.0 && image.is_some() => Alpha::Cut(0.5 * alpha / cutoff),
                _ => Alpha::Opaque,
            },
            AlphaMode::Blend if image.is_some() => Alpha::Cut(alpha),
            AlphaMode::Blend if alpha < 0.5 => Alpha::Sheet(alpha),
            AlphaMode::Blend => Alpha::Opaque,
        };
        let mut of = |texture: Option<texture::Texture<'_>>| match texture {
            Some(texture) => self.image(&texture, place).map(Some),
            None => Ok(None),
        };
        Ok(GltfMaterial {
            base: Vec3::new(r, g, b),
            base_image: of(image.map(|info| info.texture()))?,
            alpha,
            metallic,
            roughness,
            metallic_roughness_image: of(pbr.metallic_roughness_texture().map(|info| info.texture()))?,
            ior: if ior == 0.0 { 10.0 } else { ior },
            specular: tint * strength,
            clear_coat,
            transmission,
            is_body: material.volume().is_some_and(|v| v.thickness_factor() > 0.0),
            emission,
            emission_image: of(material.emissive_texture().map(|info| info.texture()))?,
            two_sided: material.double_sided(),
        })
    }

    fn image(&mut self, texture: &texture::Texture<'_>, place: &str) -> Result<ImageSource> {
        let image = texture.source();
        if let Some(known) = &self.known[image.index()] {
            return Ok(known.clone());
        }
        let source = image_source(self.path, self.document, self.buffers, image.index(), place)?;
        self.known[image.index()] = Some(source.clone());
        Ok(source)
    }
}

/// Where the bytes of an image are. Errors: nowhere, or where they may not be; `place` names who wants them.
pub(super) fn image_source(
    path: &Path,
    document: &Document,
    buffers: &Buffers,
    index: usize,
    place: &str,
) -> Result<ImageSource> {
    // Told apart from the others of the file, for messages and for what is read once.
    let name = format!("{}, image {index}", path.display());
    let embedded = |bytes: &[u8]| ImageSource::Embedded(name.clone().into(), bytes.into());
    // As it is written: the crate's own way to it panics where an image has neither, or a view without a MIME type.
    let written = &document.as_json().images[index];
    let view = written.buffer_view.and_then(|view| document.views().nth(view.value()));
    let refuse = |problem: String| Error::input(place, problem, "export the file again with its images");
    match (view, &written.uri) {
        (Some(view), _) => Ok(embedded(buffers.view(&view)?)),
        (None, None) => Err(refuse(format!("image {index} has no data"))),
        (None, Some(text)) => match uri(text) {
            Ok(Uri::Data(bytes)) => Ok(embedded(&bytes)),
            Ok(Uri::File(file)) => {
                Ok(ImageSource::File(path.parent().unwrap_or(Path::new("")).to_owned(), plain(&file)))
            }
            Err(problem) => Err(refuse(format!("image {index} {problem}"))),
        },
    }
}

/// How texture coordinates become ours.
pub(super) struct Mapping {
    /// Which texture coordinates are used.
    pub(super) set: u32,
    /// Whether there is a texture.
    pub(super) is_used: bool,
    /// Whether the texture repeats both ways, as all do here.
    pub(super) repeats: bool,
    matrix: Mat2,
    offset: Vec2,
}

/// Set, offset, rotation and scale of a texture.
fn placement(info: &Info<'_>) -> (u32, [f32; 2], f32, [f32; 2]) {
    let transform = info.texture_transform();
    let set = transform.as_ref().and_then(|t| t.tex_coord()).unwrap_or(info.tex_coord());
    let (offset, rotation, scale) =
        transform.map_or(([0.0; 2], 0.0, [1.0; 2]), |t| (t.offset(), t.rotation(), t.scale()));
    (set, offset, rotation, scale)
}

impl Mapping {
    /// That of a material's base colour or, without, of what it emits.
    pub(super) fn of(material: &Material<'_>) -> Self {
        let info = material.pbr_metallic_roughness().base_color_texture().or(material.emissive_texture());
        let Some(info) = info else {
            return Self { set: 0, is_used: false, repeats: true, matrix: Mat2::IDENTITY, offset: Vec2::ZERO };
        };
        let (set, offset, rotation, scale) = placement(&info);
        let sampler = info.texture().sampler();
        let (sin, cos) = rotation.sin_cos();
        let turn = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
        Self {
            set,
            is_used: true,
            repeats: sampler.wrap_s() == WrappingMode::Repeat && sampler.wrap_t() == WrappingMode::Repeat,
            matrix: turn * Mat2::from_diagonal(Vec2::from(scale)),
            offset: offset.into(),
        }
    }

    /// Coordinates of the texture, whose v points up here and down in the file.
    pub(super) fn apply(&self, uv: Vec2) -> Vec2 {
        let uv = self.matrix * uv + self.offset;
        Vec2::new(uv.x, 1.0 - uv.y)
    }
}
