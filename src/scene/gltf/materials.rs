//! Materials as a glTF file describes them; `looks` makes surfaces of them.

use std::path::Path;

use glam::{Mat2, Vec2, Vec3};

use super::super::source::{Alpha, Description, GltfMaterial, ImageSource, SourceImage, SourceMaterial};
use super::buffers::{Buffers, Uri, uri};
use super::plain;
use super::tree::{JsonItem, JsonTree};
use crate::error::{Error, Result, Warnings};

/// Extensions that give a texture images of kinds that are not read.
const NOT_READ: [(&str, &str); 3] =
    [("KHR_texture_basisu", "KTX2"), ("MSFT_texture_dds", "DDS"), ("EXT_texture_avif", "AVIF")];
/// How a sampler says that a texture is clamped or mirrored.
const NOT_REPEATED: [usize; 2] = [33_071, 33_648];
/// Reflectance at normal incidence of index 1.5, which the factors of glTF refer to.
const USUAL_REFLECTANCE: f32 = 0.04;
/// Reflectance at normal incidence above which only metals are.
const MIN_METAL: f32 = 0.25;
/// Roughness where a texture states it that is not read.
const MAPPED_ROUGHNESS: f32 = 0.5;

/// All materials of a file, and one more for meshes without.
pub(super) fn describe(path: &Path, buffers: &Buffers<'_>, warnings: &mut Warnings) -> Result<Vec<SourceMaterial>> {
    let tree = buffers.tree;
    let mut images =
        TextureImages { path, buffers, known: vec![None; tree.count("images")], warnings: Warnings::new() };
    let mut described = Vec::new();
    let mut unused: Vec<(&str, Vec<String>)> = Vec::new();
    for index in 0..tree.count("materials") {
        let item = tree.item("materials", index)?;
        let name = item.name().map_or_else(|| format!("material {index}"), plain);
        let place = format!("{}, material '{name}'", path.display());
        let stated = Stated::of(&item)?;
        for what in stated.not_used(tree)? {
            match unused.iter_mut().find(|(known, _)| *known == what) {
                Some((_, names)) => names.push(name.clone()),
                None => unused.push((what, vec![name.clone()])),
            }
        }
        let description = images.material(&stated, &place)?;
        described.push(SourceMaterial { name, description: Description::Gltf(Box::new(description)) });
    }
    warnings.append(&mut images.warnings);
    for (what, names) in unused {
        let more = names.len() - 1;
        let others = if more > 0 { format!(" and {more} more") } else { String::new() };
        warnings.push(format!("{}: {what} (material '{}'{others})", path.display(), names[0]));
    }
    // The format says what a mesh without a material has: all of the defaults.
    let default = images.material(&Stated::default(), "")?;
    described.push(SourceMaterial { name: "unnamed".into(), description: Description::Gltf(Box::new(default)) });
    Ok(described)
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum AlphaMode {
    Opaque,
    Mask,
    Blend,
}

/// A material as it is stated, with the format's values for what is not.
struct Stated<'a> {
    base: [f32; 4],
    base_texture: Option<JsonItem<'a>>,
    metallic: f32,
    roughness: f32,
    metallic_roughness_texture: Option<JsonItem<'a>>,
    normal_texture: Option<JsonItem<'a>>,
    emission: Vec3,
    emission_texture: Option<JsonItem<'a>>,
    alpha_mode: AlphaMode,
    cutoff: f32,
    two_sided: bool,
    ior: f32,
    specular: Vec3,
    has_specular_maps: bool,
    /// Whether a texture says what reflects and how rough it is, in the way of specular and glossiness.
    has_glossiness_map: bool,
    clear_coat: [f32; 2],
    has_coat_maps: bool,
    sheen: ([f32; 3], f32),
    has_sheen_maps: bool,
    transmission: f32,
    transmission_texture: Option<JsonItem<'a>>,
    thickness: f32,
    attenuation: (Vec3, f32),
    translucency: f32,
    translucency_texture: Option<JsonItem<'a>>,
    translucent: [f32; 3],
    translucent_texture: Option<JsonItem<'a>>,
}

impl Default for Stated<'_> {
    fn default() -> Self {
        Self {
            base: [1.0; 4],
            base_texture: None,
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            emission: Vec3::ZERO,
            emission_texture: None,
            alpha_mode: AlphaMode::Opaque,
            cutoff: 0.5,
            two_sided: false,
            ior: 1.5,
            specular: Vec3::ONE,
            has_specular_maps: false,
            has_glossiness_map: false,
            clear_coat: [0.0; 2],
            has_coat_maps: false,
            sheen: ([0.0; 3], 0.0),
            has_sheen_maps: false,
            transmission: 0.0,
            transmission_texture: None,
            thickness: 0.0,
            attenuation: (Vec3::ONE, f32::INFINITY),
            translucency: 0.0,
            translucency_texture: None,
            translucent: [1.0; 3],
            translucent_texture: None,
        }
    }
}

impl<'a> Stated<'a> {
    fn of(item: &JsonItem<'a>) -> Result<Self> {
        let mut stated = Self::default();
        let pbr = item.object("pbrMetallicRoughness")?.filter(|pbr| pbr.keys().next().is_some());
        if let Some(pbr) = &pbr {
            stated.base = pbr.numbers("baseColorFactor")?.unwrap_or(stated.base);
            stated.base_texture = pbr.object("baseColorTexture")?;
            stated.metallic = pbr.number("metallicFactor")?.unwrap_or(stated.metallic);
            stated.roughness = pbr.number("roughnessFactor")?.unwrap_or(stated.roughness);
            stated.metallic_roughness_texture = pbr.object("metallicRoughnessTexture")?;
        }
        if let Some(glossy) = item.extension("KHR_materials_pbrSpecularGlossiness")?.filter(|_| pbr.is_none()) {
            stated.take_glossy(&glossy)?;
        }
        stated.normal_texture = item.object("normalTexture")?;
        let strength = match item.extension("KHR_materials_emissive_strength")? {
            Some(stated) => stated.number("emissiveStrength")?.unwrap_or(1.0),
            None => 1.0,
        };
        stated.emission = Vec3::from(item.numbers("emissiveFactor")?.unwrap_or([0.0; 3])) * strength;
        stated.emission_texture = item.object("emissiveTexture")?;
        stated.alpha_mode = match item.text("alphaMode")? {
            None | Some("OPAQUE") => AlphaMode::Opaque,
            Some("MASK") => AlphaMode::Mask,
            Some("BLEND") => AlphaMode::Blend,
            Some(_) => return Err(item.refuse("alphaMode", "is none that there is")),
        };
        stated.cutoff = item.number("alphaCutoff")?.unwrap_or(stated.cutoff);
        stated.two_sided = item.flag("doubleSided")?.unwrap_or(false);
        if let Some(ior) = item.extension("KHR_materials_ior")? {
            stated.ior = ior.number("ior")?.unwrap_or(stated.ior);
        }
        if let Some(specular) = item.extension("KHR_materials_specular")? {
            let colour = Vec3::from(specular.numbers("specularColorFactor")?.unwrap_or([1.0; 3]));
            stated.specular = colour * specular.number("specularFactor")?.unwrap_or(1.0);
            stated.has_specular_maps = specular.has("specularTexture") || specular.has("specularColorTexture");
        }
        if let Some(coat) = item.extension("KHR_materials_clearcoat")? {
            let number = |key: &str| Ok(coat.number(key)?.unwrap_or(0.0));
            stated.clear_coat = [number("clearcoatFactor")?, number("clearcoatRoughnessFactor")?];
            let maps = ["clearcoatTexture", "clearcoatRoughnessTexture", "clearcoatNormalTexture"];
            stated.has_coat_maps = maps.iter().any(|key| coat.has(key));
        }
        if let Some(sheen) = item.extension("KHR_materials_sheen")? {
            let colour = sheen.numbers("sheenColorFactor")?.unwrap_or([0.0; 3]);
            stated.sheen = (colour, sheen.number("sheenRoughnessFactor")?.unwrap_or(0.0));
            stated.has_sheen_maps = sheen.has("sheenColorTexture") || sheen.has("sheenRoughnessTexture");
        }
        if let Some(transmission) = item.extension("KHR_materials_transmission")? {
            stated.transmission = transmission.number("transmissionFactor")?.unwrap_or(0.0);
            stated.transmission_texture = transmission.object("transmissionTexture")?;
        }
        if let Some(volume) = item.extension("KHR_materials_volume")? {
            stated.thickness = volume.number("thicknessFactor")?.unwrap_or(0.0);
            let distance = volume.number("attenuationDistance")?.unwrap_or(f32::INFINITY);
            stated.attenuation = (Vec3::from(volume.numbers("attenuationColor")?.unwrap_or([1.0; 3])), distance);
        }
        if let Some(diffuse) = item.extension("KHR_materials_diffuse_transmission")? {
            stated.translucency = diffuse.number("diffuseTransmissionFactor")?.unwrap_or(0.0);
            stated.translucency_texture = diffuse.object("diffuseTransmissionTexture")?;
            stated.translucent = diffuse.numbers("diffuseTransmissionColorFactor")?.unwrap_or([1.0; 3]);
            stated.translucent_texture = diffuse.object("diffuseTransmissionColorTexture")?;
        }
        Ok(stated)
    }

    /// A material of specular colour and glossiness: metal where it reflects more in its specular colour than diffusely, as
    /// nothing but metal does.
    fn take_glossy(&mut self, glossy: &JsonItem<'a>) -> Result<()> {
        self.base = glossy.numbers("diffuseFactor")?.unwrap_or(self.base);
        self.base_texture = glossy.object("diffuseTexture")?;
        self.metallic = 0.0;
        self.has_glossiness_map = glossy.has("specularGlossinessTexture");
        if self.has_glossiness_map {
            self.roughness = MAPPED_ROUGHNESS;
            return Ok(());
        }
        self.roughness = 1.0 - glossy.number("glossinessFactor")?.unwrap_or(1.0);
        let specular = Vec3::from(glossy.numbers("specularFactor")?.unwrap_or([1.0; 3]));
        let [r, g, b, alpha] = self.base;
        let reflected = specular.max_element();
        if reflected > MIN_METAL && reflected > Vec3::new(r, g, b).max_element() * (1.0 - reflected) {
            self.base = specular.extend(alpha).to_array();
            (self.base_texture, self.metallic) = (None, 1.0);
        } else {
            self.specular = specular / USUAL_REFLECTANCE;
        }
        Ok(())
    }

    /// Its textures that are used, in the order of which the first says how all lie.
    fn textures(&self) -> [Option<&JsonItem<'a>>; 7] {
        [
            &self.base_texture,
            &self.metallic_roughness_texture,
            &self.normal_texture,
            &self.transmission_texture,
            &self.translucency_texture,
            &self.translucent_texture,
            &self.emission_texture,
        ]
        .map(Option::as_ref)
    }

    /// Properties that are left out or simplified, for messages.
    fn not_used(&self, tree: &JsonTree) -> Result<Vec<&'static str>> {
        let used: Vec<_> = self.textures().into_iter().flatten().collect();
        let mut differ = false;
        let mut without_image = false;
        for texture in &used {
            differ |= Placement::of(texture)? != Placement::of(used[0])?;
            without_image |= image_of(texture, tree)?.is_none();
        }
        let lines = [
            (self.has_specular_maps, "textures of the specular extension are not used"),
            (
                self.has_glossiness_map,
                "textures of specular colour and glossiness are not used: taken as satin lacquer",
            ),
            (self.has_coat_maps, "textures of clear coats are not used"),
            (self.has_sheen_maps, "textures of sheens are not used"),
            (
                differ,
                "its textures lie differently; all lie as the first of them does (base colour, roughness, normals …)",
            ),
            (without_image, "textures without an image are left out"),
        ];
        Ok(lines.into_iter().filter(|(applies, _)| *applies).map(|(_, what)| what).collect())
    }
}

/// Whether nothing of a material is there: masked, and its even alpha is below the cut-off.
pub(super) fn is_absent(material: &JsonItem<'_>) -> bool {
    Stated::of(material).is_ok_and(|stated| {
        stated.alpha_mode == AlphaMode::Mask && stated.base_texture.is_none() && stated.base[3] < stated.cutoff
    })
}

struct TextureImages<'a> {
    path: &'a Path,
    buffers: &'a Buffers<'a>,
    known: Vec<SourceImage>,
    warnings: Warnings,
}

impl TextureImages<'_> {
    fn material(&mut self, stated: &Stated<'_>, place: &str) -> Result<GltfMaterial> {
        let &Stated { base: [r, g, b, alpha], metallic, roughness, ior, specular, transmission, emission, .. } = stated;
        let &Stated { clear_coat, cutoff, translucency, translucent, attenuation: (colour, distance), .. } = stated;
        let fractions =
            [r, g, b, alpha, metallic, roughness, transmission, cutoff, translucency].into_iter().chain(clear_coat);
        let numbers = fractions.chain(specular.to_array()).chain(emission.to_array()).chain(translucent);
        let numbers = numbers.chain(stated.sheen.0).chain([stated.sheen.1]);
        if !numbers.chain(colour.to_array()).all(|v| v >= 0.0 && v.is_finite()) || distance.is_nan() {
            return Err(Error::input(place, "has a factor that is negative or not finite", "mend the material"));
        }
        // 0 is how the format says that it reflects wholly; no index of refraction is below 0.1.
        if !(ior == 0.0 || (0.1..=10.0).contains(&ior)) {
            return Err(Error::input(place, format!("ior {ior}"), "give a number from 0.1 to 10, 1.5 for glass"));
        }
        let base_image = self.image(stated.base_texture.as_ref(), place)?;
        let alpha = match stated.alpha_mode {
            AlphaMode::Mask if cutoff > 0.0 && base_image.is_some() => Alpha::Cut(0.5 * alpha / cutoff),
            AlphaMode::Opaque | AlphaMode::Mask => Alpha::Opaque,
            AlphaMode::Blend => Alpha::Blend(alpha.min(1.0)),
        };
        Ok(GltfMaterial {
            base: Vec3::new(r, g, b),
            base_image,
            alpha,
            metallic,
            roughness,
            metallic_roughness_image: self.image(stated.metallic_roughness_texture.as_ref(), place)?,
            normal_image: self.image(stated.normal_texture.as_ref(), place)?,
            normal_scale: match &stated.normal_texture {
                Some(info) => info.number("scale")?.filter(|scale| scale.is_finite()).unwrap_or(1.0),
                None => 1.0,
            },
            ior: if ior == 0.0 { 10.0 } else { ior },
            specular,
            clear_coat,
            sheen: (Vec3::from(stated.sheen.0), stated.sheen.1),
            transmission,
            transmission_image: self.image(stated.transmission_texture.as_ref(), place)?,
            attenuation: stated.attenuation,
            translucency,
            translucency_image: self.image(stated.translucency_texture.as_ref(), place)?,
            translucent: Vec3::from(translucent),
            translucent_image: self.image(stated.translucent_texture.as_ref(), place)?,
            is_body: stated.thickness > 0.0,
            emission,
            emission_image: self.image(stated.emission_texture.as_ref(), place)?,
            two_sided: stated.two_sided,
        })
    }

    fn image(&mut self, texture: Option<&JsonItem<'_>>, place: &str) -> Result<SourceImage> {
        let Some(index) = texture.map(|info| image_of(info, self.buffers.tree)).transpose()?.flatten() else {
            return Ok(None);
        };
        if self.known[index].is_none() {
            let source = image_source(self.path, self.buffers, index, place, &mut self.warnings)?;
            self.known[index] = Some(source);
        }
        Ok(self.known[index].clone())
    }
}

/// The image of a texture that a material names; none where it has none. Errors: images of a kind that is not read.
fn image_of(info: &JsonItem<'_>, tree: &JsonTree) -> Result<Option<usize>> {
    let index = info.index("index", "textures")?.ok_or_else(|| info.refuse("index", "is missing"))?;
    let texture = tree.item("textures", index)?;
    if let Some(webp) = texture.extension("EXT_texture_webp")? {
        return webp.index("source", "images");
    }
    let image = texture.index("source", "images")?;
    for (extension, kind) in NOT_READ {
        if image.is_none() && texture.extension(extension)?.is_some() {
            let problem = format!("texture {index} is {kind} ({extension}), which is not read");
            return Err(Error::input(tree.place(), problem, "export it with textures as PNG, JPEG or WebP"));
        }
    }
    Ok(image)
}

/// Where the bytes of an image are. Errors: nowhere, or where they may not be; `place` names who wants them.
pub(super) fn image_source(
    path: &Path,
    buffers: &Buffers<'_>,
    index: usize,
    place: &str,
    warnings: &mut Warnings,
) -> Result<ImageSource> {
    // Told apart from the others of the file, for messages and for what is read once.
    let name = format!("{}, image {index}", path.display());
    let embedded = |bytes: &[u8]| ImageSource::Embedded(name.clone().into(), bytes.into());
    let image = buffers.tree.item("images", index)?;
    let refuse = |problem: String| Error::input(place, problem, "export the file again with its images");
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    match (image.index("bufferView", "bufferViews")?, image.text("uri")?) {
        (Some(view), _) => Ok(embedded(buffers.view(view)?)),
        (None, None) => Err(refuse(format!("image {index} has no data"))),
        (None, Some(text)) => match uri(text) {
            Ok(Uri::Data(bytes)) => Ok(embedded(&bytes)),
            Ok(Uri::File(file)) => Ok(ImageSource::File(folder, plain(&file))),
            // The exporter's own folders are not here; the images may have come along.
            Err(problem) => {
                let last = plain(text.rsplit(['/', '\\']).next().unwrap_or_default());
                match uri(&last) {
                    Ok(Uri::File(file)) if folder.join(&file).is_file() => {
                        let found = folder.join(&file);
                        let found = found.display();
                        warnings.push(format!("{}: image {index} {problem}; {found} is taken", path.display()));
                        Ok(ImageSource::File(folder, file))
                    }
                    _ => Err(refuse(format!("image {index} {problem}"))),
                }
            }
        },
    }
}

/// Transform of texture coordinates.
pub(super) struct Mapping {
    /// Index of the set of texture coordinates.
    pub(super) set: usize,
    /// Whether any texture uses it.
    pub(super) is_used: bool,
    /// Whether the texture repeats both ways, as all do here.
    pub(super) repeats: bool,
    matrix: Mat2,
    offset: Vec2,
}

/// How a texture lies on a surface.
#[derive(PartialEq)]
struct Placement {
    /// Index of the set of texture coordinates.
    set: usize,
    offset: [f32; 2],
    rotation: f32,
    scale: [f32; 2],
}

impl Placement {
    fn of(info: &JsonItem<'_>) -> Result<Self> {
        let set = info.whole("texCoord")?.unwrap_or(0);
        let Some(stated) = info.extension("KHR_texture_transform")? else {
            return Ok(Self { set, offset: [0.0; 2], rotation: 0.0, scale: [1.0; 2] });
        };
        let offset = stated.numbers("offset")?.unwrap_or([0.0; 2]);
        let scale = stated.numbers("scale")?.unwrap_or([1.0; 2]);
        let set = stated.whole("texCoord")?.unwrap_or(set);
        Ok(Self { set, offset, rotation: stated.number("rotation")?.unwrap_or(0.0), scale })
    }
}

impl Mapping {
    /// That of a material's first texture.
    pub(super) fn of(material: Option<&JsonItem<'_>>, tree: &JsonTree) -> Result<Self> {
        let stated = material.map(Stated::of).transpose()?.unwrap_or_default();
        let Some(info) = stated.textures().into_iter().flatten().next() else {
            return Ok(Self { set: 0, is_used: false, repeats: true, matrix: Mat2::IDENTITY, offset: Vec2::ZERO });
        };
        let Placement { set, offset, rotation, scale } = Placement::of(info)?;
        let index = info.index("index", "textures")?.ok_or_else(|| info.refuse("index", "is missing"))?;
        let mut repeats = true;
        if let Some(sampler) = tree.item("textures", index)?.index("sampler", "samplers")? {
            let sampler = tree.item("samplers", sampler)?;
            for key in ["wrapS", "wrapT"] {
                repeats &= !sampler.whole(key)?.is_some_and(|wrap| NOT_REPEATED.contains(&wrap));
            }
        }
        let (sin, cos) = rotation.sin_cos();
        let turn = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
        let matrix = turn * Mat2::from_diagonal(Vec2::from(scale));
        Ok(Self { set, is_used: true, repeats, matrix, offset: offset.into() })
    }

    /// Coordinates of the texture, whose v points up here and down in the file.
    pub(super) fn apply(&self, uv: Vec2) -> Vec2 {
        let uv = self.matrix * uv + self.offset;
        Vec2::new(uv.x, 1.0 - uv.y)
    }
}
