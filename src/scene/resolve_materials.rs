//! From material descriptions to surfaces: what the MTL fields mean here, and what the scene file overrides.
//!
//! `formats/scene.md` states the mapping in a table.

use std::collections::BTreeMap;
use std::path::Path;

use glam::Vec3;

use super::file::{MaterialEntry, SurfaceEntry};
use super::folders::Folders;
use super::material::{IORS, USUAL_IOR, normal_reflectance};
use super::mtl::{self, MaterialShape, MtlLook, MtlMap, MtlMaterial, ShownLook, Through, Writer};
use super::source::{Alpha, Description, GltfMaterial, SourceMaterial};
use super::textures::{TextureUse, Textures};
use super::{FloatTexture, Material, Paint, Placing, PrincipledSurface, Relief, Surface, TextureId};
use crate::decimal::{list, of_f32};
use crate::error::{Error, Result, Warnings};
use crate::light::names::fits;

/// Names that a line about many materials shows.
const NAMES_SHOWN: usize = 4;

/// Grey values of `Kd` that programs write whatever is mapped: Blender's 0.8 at intensity 1, 0.8, 0.64, 0.512, and 3ds Max' 150 of 255.
const WRITTEN_GREYS: [f32; 5] = [0.8, 0.64, 0.512, 0.4096, 0.588];

/// Largest Phong exponent of the format, where a map of exponents has no factor.
const MAX_SHININESS: f32 = 1000.0;

/// How high white stands above black in a map of heights, in units of its width.
const HEIGHT: f32 = 0.01;

/// Index of refraction this near to 1 means a sheet without thickness.
const NO_REFRACTION: f32 = 1e-3;

/// Smallest GGX α that is told from a perfect mirror.
const MIN_ALPHA: f32 = 1e-3;

/// Emission of a material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Emission {
    pub(super) radiance: Vec3,
    pub(super) pattern: Option<Paint>,
}

/// A material as it is known before it becomes a [`Surface`]: every property, whether its kind uses it or not.
#[derive(Clone, Copy, Debug)]
struct SurfaceParams {
    kind: SurfaceEntry,
    /// Albedo, or what a mirror or metal reflects.
    reflectance: Paint,
    /// Reflectance of a coat at normal incidence.
    specular: Vec3,
    alpha: f32,
    ior: f32,
    transmittance: Vec3,
    /// GGX α of glass.
    glass_alpha: f32,
    /// What it is while no kind is given: several at once.
    several: Option<PrincipledSurface>,
}

/// A material before the scene file's overrides.
struct UnresolvedMaterial {
    look: SurfaceParams,
    cutout: Option<TextureId>,
    opacity: f32,
    opacity_map: Option<TextureId>,
    absorption: Vec3,
    relief: Option<Relief>,
    /// The surface without its transparency.
    opaque: SurfaceEntry,
    /// The colour that its file gives beside a map, whether it multiplies that or not.
    beside_map: Vec3,
    radiance: Vec3,
    pattern: Option<Paint>,
}

/// Builds materials; textures and warnings gather in it.
pub(super) struct MaterialResolver<'a> {
    pub(super) textures: Textures,
    pub(super) warnings: Warnings,
    pub(super) overrides: &'a [MaterialEntry],
    pub(super) folders: &'a Folders,
    /// Name of the scene file, for messages.
    pub(super) place: &'a str,
    /// Materials of which a rule said more than their files do, for one line each.
    pub(super) decided: Decided,
}

/// Names of materials by the rule that decided about them.
#[derive(Debug, Default)]
pub(super) struct Decided(BTreeMap<&'static str, Vec<String>>);

impl Decided {
    fn note(&mut self, rule: &'static str, name: &str) {
        let names = self.0.entry(rule).or_default();
        if names.iter().all(|known| known != name) {
            names.push(name.to_owned());
        }
    }

    /// One line for each rule.
    pub(super) fn report(&self, warnings: &mut Warnings) {
        for (rule, names) in &self.0 {
            let (shown, more) = names.split_at(names.len().min(NAMES_SHOWN));
            let list = shown.iter().map(|name| format!("'{name}'")).collect::<Vec<_>>().join(", ");
            let more = if more.is_empty() { String::new() } else { format!(" and {} more", more.len()) };
            let materials = if names.len() == 1 { "material" } else { "materials" };
            warnings.push(format!("{materials} {list}{more}: {rule}"));
        }
    }
}

impl MaterialResolver<'_> {
    /// The material that a description and the scene file's overrides make.
    pub(super) fn make(&mut self, source: &SourceMaterial) -> Result<(Material, Option<Emission>)> {
        let draft = match &source.description {
            Description::Mtl(mtl, folder, shape) => self.of_mtl(mtl, folder, *shape)?,
            Description::Gltf(gltf) => self.of_gltf(gltf, &source.name)?,
        };
        self.finish(draft, &source.name)
    }

    /// Converts a glTF material, as `formats/scene.md` states.
    fn of_gltf(&mut self, source: &GltfMaterial, name: &str) -> Result<UnresolvedMaterial> {
        let asked_by = format!("material '{name}'");
        let usage = match source.alpha {
            Alpha::Cut(scale) => TextureUse::Masked(scale.to_bits()),
            Alpha::Opaque | Alpha::Blend(_) => TextureUse::Reflectance,
        };
        let mut map = |image: &Option<_>, usage: TextureUse| match image {
            Some(image) => self.textures.source(image, usage, &asked_by, &mut self.warnings),
            None => Ok(None),
        };
        let base_map = map(&source.base_image, usage)?;
        let emission_map = map(&source.emission_image, TextureUse::Emission)?;
        let mixed_map = map(&source.metallic_roughness_image, TextureUse::Numbers)?;
        let normal_map = map(&source.normal_image, TextureUse::Numbers)?;
        let transmission_map = map(&source.transmission_image, TextureUse::Numbers)?;
        let translucency_map = map(&source.translucency_image, TextureUse::Numbers)?;
        let translucent_map = map(&source.translucent_image, TextureUse::Reflectance)?;
        let level = |map: Option<TextureId>, channel: u8, factor: f32| match map {
            Some(id) if factor != 0.0 => FloatTexture::Textured(id, channel, factor),
            _ => FloatTexture::Constant(factor.min(1.0)),
        };
        let paint = |map: Option<TextureId>, colour: Vec3| {
            map.map_or(Paint::Constant(colour), |id| Paint::Textured(id, colour))
        };
        let specular = (source.specular * normal_reflectance(source.ior)).min(Vec3::ONE);
        let [coat, coat_roughness] = source.clear_coat.map(|v| v.min(1.0));
        let several = PrincipledSurface {
            base: paint(base_map, source.base),
            metallic: level(mixed_map, 2, source.metallic),
            roughness: level(mixed_map, 1, source.roughness),
            specular: Paint::Constant(specular),
            transmission: level(transmission_map, 0, source.transmission),
            ior: source.ior,
            is_thin: !source.is_body,
            translucency: level(translucency_map, 3, source.translucency),
            translucent: paint(translucent_map, source.translucent),
            coat: (coat, coat_roughness),
            sheen: (source.sheen.0.min(Vec3::ONE), source.sheen.1.min(1.0)),
        };
        let look = SurfaceParams::of_several(several);
        let (mut cutout, mut opacity, mut opacity_map) = (None, 1.0, None);
        match source.alpha {
            Alpha::Opaque => {}
            Alpha::Cut(_) => cutout = base_map,
            // What emits is there or not.
            Alpha::Blend(_) if source.emission != Vec3::ZERO => cutout = base_map,
            Alpha::Blend(share) => (opacity, opacity_map) = (share, base_map),
        }
        let (colour, distance) = source.attenuation;
        let pattern = emission_map.map(|id| Paint::Textured(id, Vec3::ONE));
        Ok(UnresolvedMaterial {
            look,
            cutout,
            opacity,
            opacity_map,
            absorption: if source.is_body { absorption(colour, distance) } else { Vec3::ZERO },
            relief: normal_map.map(|id| Relief::Normals(id, source.normal_scale)),
            opaque: SurfaceEntry::Coated,
            beside_map: source.base,
            radiance: source.emission,
            pattern,
        })
    }

    /// What an MTL description means here, on surfaces of a shape. `folder` holds its textures.
    fn of_mtl(&mut self, source: &MtlMaterial, folder: &Path, shape: MaterialShape) -> Result<UnresolvedMaterial> {
        let asked_by = format!("material '{}'", source.name);
        let mut map = |map: &Option<MtlMap>, usage: TextureUse| match map {
            Some(map) => {
                let (named, placing) = ((folder, map.file.as_str()), source.placing(map));
                self.textures.placed(named, placing, usage, &asked_by, &mut self.warnings)
            }
            None => Ok(None),
        };
        let diffuse_map = map(&source.diffuse_map, TextureUse::Reflectance)?;
        let holes = map(&source.dissolve_map, TextureUse::Opacity)?;
        // What emits is there or not.
        let (cutout, opacity_map) = if source.emission.is_some() { (holes, None) } else { (None, holes) };
        let emission_map = map(&source.emission_map, TextureUse::Emission)?;
        let [roughness_map, metallic_map, normal_map, bump_map] = {
            let maps = [&source.roughness_map, &source.metallic_map, &source.normal_map, &source.bump_map];
            let mut found = [None; 4];
            for (found, named) in found.iter_mut().zip(maps) {
                *found = map(named, TextureUse::Numbers)?;
            }
            found
        };
        // Blender names maps of roughness so.
        let is_roughness = source.writer == Writer::Blender;
        let most = source.shininess_factor().unwrap_or(MAX_SHININESS);
        let shininess = if is_roughness { TextureUse::Numbers } else { TextureUse::Shininess(most.to_bits()) };
        let gloss = GlossMaps {
            specular: map(&source.specular_map, TextureUse::Reflectance)?,
            roughness: map(&source.shininess_map, shininess)?,
        };
        let diffuse = source.diffuse.unwrap_or(Vec3::splat(if source.emission.is_some() { 0.0 } else { 0.5 }));
        let base = match diffuse_map {
            Some(id) => Paint::Textured(id, self.beside_map(source)),
            // The map is missing: black would not be what is meant.
            None if source.diffuse_map.is_some() && diffuse == Vec3::ZERO => Paint::Constant(Vec3::splat(0.5)),
            None => Paint::Constant(diffuse),
        };
        self.note_maps(source);
        let without;
        let source = if source.specular_map.is_some() && gloss.specular.is_none() {
            // A map that is missing says nothing.
            without = MtlMaterial { specular_map: None, ..source.clone() };
            &without
        } else {
            source
        };
        let ShownLook { look, opacity, through } = mtl::look_of(source, shape);
        let is_bent = matches!(look.kind, SurfaceEntry::Dielectric | SurfaceEntry::ThinDielectric);
        if let Some(ior) = source.ior.filter(|ior| !IORS.contains(ior) && (is_bent || ior > IORS.end())) {
            self.warnings.push(format!("{asked_by}: 'Ni' {ior} is no index of refraction; taken as {USUAL_IOR}"));
        }
        if through != Through::Stated
            && !self.says(&source.name, |entry| entry.kind.is_some() || entry.opacity.is_some())
        {
            self.decided.note(through.words(), &source.name);
        }
        let pattern = emission_map.map(|id| Paint::Textured(id, Vec3::ONE));
        let mut radiance = source.emission.unwrap_or(Vec3::ZERO);
        if pattern.is_some() && radiance == Vec3::ZERO {
            radiance = Vec3::ONE;
        }
        let opaque = if is_bent { SurfaceEntry::Coated } else { look.kind };
        let is_pbr = look.is_pbr;
        let mut look = SurfaceParams::of_mtl(&look, base);
        let metal = source.metallic.unwrap_or(0.0).min(1.0);
        if is_pbr && (roughness_map.is_some() || metallic_map.is_some() || metal > 0.0) {
            let level = |map: Option<TextureId>, stated: Option<f32>, usual: f32| match map {
                Some(id) => FloatTexture::Textured(id, 0, stated.filter(|factor| *factor > 0.0).unwrap_or(1.0)),
                None => FloatTexture::Constant(stated.unwrap_or(usual).clamp(0.0, 1.0)),
            };
            look.several = Some(PrincipledSurface {
                base: look.reflectance,
                metallic: level(metallic_map, source.metallic, 0.0),
                roughness: level(roughness_map, source.roughness, 0.5),
                specular: Paint::Constant(look.specular),
                ..PrincipledSurface::opaque(look.ior)
            });
        }
        if !is_pbr {
            look.vary(gloss);
        }
        let bump = bump_map.map(|id| self.relief_of(id, source.bump_map.as_ref().map_or(1.0, |map| map.raised)));
        let (absorption, relief) = (Vec3::ZERO, normal_map.map(|id| Relief::Normals(id, 1.0)).or(bump));
        let beside_map = diffuse;
        Ok(UnresolvedMaterial {
            look,
            cutout,
            opacity,
            opacity_map,
            absorption,
            relief,
            opaque,
            beside_map,
            radiance,
            pattern,
        })
    }

    /// What a map of `map_Bump` means: normals where it looks like them, else heights.
    fn relief_of(&self, id: TextureId, factor: f32) -> Relief {
        if self.textures.list[id.0 as usize].texels.are_normals() {
            return Relief::Normals(id, factor);
        }
        Relief::Heights(id, HEIGHT * factor)
    }

    /// The colour that multiplies `map_Kd`: `Kd`, but for what programs write there without meaning it.
    fn beside_map(&mut self, source: &MtlMaterial) -> Vec3 {
        // Exporters write a black Kd, or none, beside a map that is meant to be seen.
        let Some(diffuse) = source.diffuse.filter(|kd| *kd != Vec3::ZERO && *kd != Vec3::ONE) else { return Vec3::ONE };
        let is_written = |grey: f32| diffuse.abs_diff_eq(Vec3::splat(grey), 1e-3);
        let (factor, rule) = if source.writer == Writer::Blender {
            (Vec3::ONE, "map_Kd stands alone: Blender does not mean Kd beside it (colour_times_map = true multiplies)")
        } else if WRITTEN_GREYS.into_iter().any(is_written) {
            (
                Vec3::ONE,
                "map_Kd stands alone: Kd is a grey that exporters write beside any (colour_times_map = true multiplies)",
            )
        } else {
            (diffuse, "map_Kd times Kd, as the format says (colour_times_map = false shows the map alone)")
        };
        if !self.says(&source.name, |entry| entry.colour_times_map.is_some()) {
            self.decided.note(rule, &source.name);
        }
        factor
    }

    /// Whether the scene file overrides a property of a material.
    fn says(&self, name: &str, what: impl Fn(&MaterialEntry) -> bool) -> bool {
        self.overrides.iter().any(|entry| fits(&entry.pattern, name) && what(entry))
    }

    /// Says what of a material's maps is not as it is stated.
    fn note_maps(&mut self, source: &MtlMaterial) {
        let name = &source.name;
        if source.maps().any(|map| map.scale.x == 0.0 || map.scale.y == 0.0) {
            self.decided.note("a map is scaled by 0 (-s), which leaves no place for it", name);
        }
    }

    /// Applies the scene file's overrides.
    fn finish(&mut self, draft: UnresolvedMaterial, name: &str) -> Result<(Material, Option<Emission>)> {
        let UnresolvedMaterial { mut look, mut cutout, mut opacity, mut opacity_map, .. } = draft;
        let UnresolvedMaterial { mut absorption, relief, opaque, beside_map, mut radiance, pattern, .. } = draft;
        let asked_by = format!("material '{name}'");
        for entry in self.overrides.iter().filter(|entry| fits(&entry.pattern, name)) {
            let place = format!("{}, material \"{}\"", self.place, entry.pattern);
            look.change(entry, &place)?;
            if let Some(share) = entry.opacity {
                if !(0.0..=1.0).contains(&share) {
                    return Err(Error::input(place, format!("opacity {share}"), "give a number from 0 to 1"));
                }
                if entry.kind.is_none() && matches!(look.kind, SurfaceEntry::Dielectric | SurfaceEntry::ThinDielectric)
                {
                    look.kind = opaque;
                }
                opacity = share;
            } else if entry.kind.is_some() {
                opacity = 1.0;
            }
            if let (Some(times), Paint::Textured(id, _)) = (entry.colour_times_map, look.reflectance) {
                look.colour(Paint::Textured(id, if times { beside_map } else { Vec3::ONE }));
            }
            if let Some(found) = entry.absorption(&place)? {
                absorption = found;
            }
            let mut map = |name: &Option<String>, usage: TextureUse| {
                let Some(name) = name else { return Ok(None) };
                match self.folders.look_up(name, &place)? {
                    Some(path) => self.textures.get(&path, Placing::PLAIN, usage, &mut self.warnings).map(Some),
                    None => self.textures.named(self.folders.own(), name, usage, &place, &mut self.warnings),
                }
            };
            if let Some(id) = map(&entry.reflectance_map, TextureUse::Reflectance)? {
                look.colour(Paint::Textured(id, entry.reflectance.map_or(Vec3::ONE, Vec3::from)));
            }
            if let Some(id) = map(&entry.cutout_map, TextureUse::Opacity)? {
                (cutout, opacity_map) = (Some(id), None);
            }
            if let Some(emission) = entry.emission {
                radiance = colour(emission, "emission", f32::MAX, &place)?;
            }
        }
        if look.conserve_energy() {
            self.warnings.push(format!("{asked_by}: reflects or transmits more than it receives; clamped to 1"));
        }
        let emission = (radiance != Vec3::ZERO).then_some(Emission { radiance, pattern });
        let surface = look.surface();
        let name = name.to_owned();
        Ok((Material { name, surface, cutout, opacity, opacity_map, absorption, relief }, emission))
    }
}

/// Maps of what a coat or a metal reflects and of how rough it is.
#[derive(Clone, Copy, Debug)]
struct GlossMaps {
    specular: Option<TextureId>,
    roughness: Option<TextureId>,
}

impl SurfaceParams {
    /// Lets the reflection of a coat, a mirror or a metal vary as maps say.
    fn vary(&mut self, GlossMaps { specular, roughness }: GlossMaps) {
        let is_metal = match self.kind {
            SurfaceEntry::Coated => false,
            SurfaceEntry::Mirror | SurfaceEntry::RoughConductor => true,
            _ => return,
        };
        if let (true, Some(id), Paint::Constant(colour)) = (is_metal, specular, self.reflectance) {
            self.reflectance = Paint::Textured(id, colour);
        }
        let coat = specular.filter(|_| !is_metal);
        if roughness.is_none() && coat.is_none() {
            return;
        }
        let alpha = if self.kind == SurfaceEntry::Mirror { 0.0 } else { self.alpha };
        self.several = Some(PrincipledSurface {
            base: self.reflectance,
            metallic: FloatTexture::Constant(if is_metal { 1.0 } else { 0.0 }),
            roughness: roughness.map_or(FloatTexture::Constant(alpha.sqrt()), |id| FloatTexture::Textured(id, 0, 1.0)),
            specular: coat.map_or(Paint::Constant(self.specular), |id| Paint::Textured(id, self.specular)),
            ..PrincipledSurface::opaque(self.ior)
        });
    }

    /// Converts an MTL material over this base colour.
    fn of_mtl(look: &MtlLook, base: Paint) -> Self {
        let &MtlLook { kind, reflectance, specular, alpha, ior, transmittance, is_pbr: _ } = look;
        let reflectance = reflectance.map_or(base, Paint::Constant);
        Self { kind, reflectance, specular, alpha, ior, transmittance, glass_alpha: 0.0, several: None }
    }

    /// What is several kinds at once, and what it is if one of them is asked for.
    fn of_several(several: PrincipledSurface) -> Self {
        let PrincipledSurface { base, roughness, ior, .. } = several;
        let (Paint::Constant(specular) | Paint::Textured(_, specular)) = several.specular;
        let transmittance = match base {
            Paint::Constant(colour) | Paint::Textured(_, colour) => colour,
        };
        let alpha = match roughness {
            FloatTexture::Constant(value) | FloatTexture::Textured(_, _, value) => value.clamp(0.0, 1.0).powi(2),
        };
        let kind = SurfaceEntry::Coated;
        Self { kind, reflectance: base, specular, alpha, ior, transmittance, glass_alpha: 0.0, several: Some(several) }
    }

    /// Sets what it reflects.
    fn colour(&mut self, reflectance: Paint) {
        self.reflectance = reflectance;
        if let Some(several) = &mut self.several {
            several.base = reflectance;
        }
    }

    fn change(&mut self, entry: &MaterialEntry, place: &str) -> Result<()> {
        if let Some(kind) = entry.kind {
            (self.kind, self.several) = (kind, None);
        }
        if let Some(reflectance) = entry.reflectance {
            self.colour(Paint::Constant(colour(reflectance, "reflectance", f32::MAX, place)?));
        }
        if let Some(specular) = entry.specular {
            self.specular = colour(specular, "specular", f32::MAX, place)?;
            self.several
                .iter_mut()
                .for_each(|several| several.specular = Paint::Constant(self.specular.min(Vec3::ONE)));
        }
        if let Some(transmittance) = entry.transmittance {
            self.transmittance = colour(transmittance, "transmittance", f32::MAX, place)?;
        }
        if let Some(roughness) = entry.roughness {
            if !(0.0..=1.0).contains(&roughness) {
                return Err(Error::input(place, format!("roughness {roughness}"), "give a number from 0 to 1"));
            }
            (self.alpha, self.glass_alpha) = (roughness * roughness, roughness * roughness);
            self.several.iter_mut().for_each(|several| several.roughness = FloatTexture::Constant(roughness));
        }
        if let Some(ior) = entry.ior {
            if !IORS.contains(&ior) {
                return Err(Error::input(place, format!("ior {ior}"), "give a number from 0.1 to 10, 1.5 for glass"));
            }
            self.ior = ior;
            self.several.iter_mut().for_each(|several| several.ior = ior);
        }
        Ok(())
    }

    /// Clamps what exceeds 1 and says whether anything did.
    fn conserve_energy(&mut self) -> bool {
        let mut clamped = false;
        let mut clamp = |colour: &mut Vec3| {
            clamped |= colour.max_element() > 1.0;
            *colour = colour.min(Vec3::ONE);
        };
        match &mut self.reflectance {
            Paint::Constant(colour) | Paint::Textured(_, colour) => clamp(colour),
        }
        clamp(&mut self.specular);
        clamp(&mut self.transmittance);
        if let Some(several) = &mut self.several {
            several.base = self.reflectance;
            match &mut several.specular {
                Paint::Constant(colour) | Paint::Textured(_, colour) => clamp(colour),
            }
        }
        clamped
    }

    /// The same as one of the plain kinds, where it is one everywhere.
    fn of_one_kind(&self, several: &PrincipledSurface) -> Option<Self> {
        let &PrincipledSurface { base, metallic, roughness, transmission, is_thin, translucency, .. } = several;
        let FloatTexture::Constant(roughness) = roughness else { return None };
        if !matches!(several.specular, Paint::Constant(_)) || several.coat.0 > 0.0 || several.sheen.0 != Vec3::ZERO {
            return None;
        }
        let is_plain = transmission.is(0.0) && translucency.is(0.0);
        let alpha = roughness.clamp(0.0, 1.0).powi(2);
        let kind = match base {
            _ if metallic.is(1.0) => SurfaceEntry::RoughConductor,
            _ if metallic.is(0.0) && is_plain => SurfaceEntry::Coated,
            Paint::Constant(_) if metallic.is(0.0) && transmission.is(1.0) => {
                if is_thin {
                    SurfaceEntry::ThinDielectric
                } else {
                    SurfaceEntry::Dielectric
                }
            }
            _ => return None,
        };
        let crossed = kind == SurfaceEntry::Dielectric;
        let transmittance = if crossed { self.transmittance.map(f32::sqrt) } else { self.transmittance };
        Some(Self { kind, transmittance, alpha, glass_alpha: alpha, several: None, ..*self })
    }

    fn surface(self) -> Surface {
        if let Some(several) = self.several {
            return self.of_one_kind(&several).map_or(Surface::Principled(several), Self::surface);
        }
        let Self { kind, reflectance, specular, alpha, ior, transmittance, glass_alpha, .. } = self;
        match kind {
            SurfaceEntry::Black => Surface::Black,
            SurfaceEntry::Coated if specular != Vec3::ZERO => {
                Surface::Coated { reflectance, specular, alpha: alpha.max(MIN_ALPHA) }
            }
            SurfaceEntry::Lambert | SurfaceEntry::Coated if reflectance == Paint::Constant(Vec3::ZERO) => {
                Surface::Black
            }
            SurfaceEntry::Lambert | SurfaceEntry::Coated => Surface::Lambert { reflectance },
            SurfaceEntry::RoughConductor if alpha >= MIN_ALPHA => {
                Surface::RoughConductor { specular: reflectance, alpha }
            }
            SurfaceEntry::Mirror | SurfaceEntry::RoughConductor => Surface::Mirror { reflectance },
            SurfaceEntry::Dielectric | SurfaceEntry::ThinDielectric
                if glass_alpha >= PrincipledSurface::SMOOTH_GLASS && (ior - 1.0).abs() > NO_REFRACTION =>
            {
                let is_thin = kind == SurfaceEntry::ThinDielectric;
                // Of a body, two crossings.
                let colour = if is_thin { transmittance } else { transmittance * transmittance };
                Surface::Principled(PrincipledSurface {
                    base: Paint::Constant(colour),
                    roughness: FloatTexture::Constant(glass_alpha.sqrt()),
                    transmission: FloatTexture::Constant(1.0),
                    is_thin,
                    ..PrincipledSurface::opaque(ior)
                })
            }
            SurfaceEntry::Dielectric if (ior - 1.0).abs() > NO_REFRACTION => Surface::Dielectric { ior, transmittance },
            SurfaceEntry::Dielectric | SurfaceEntry::ThinDielectric => Surface::ThinDielectric { ior, transmittance },
        }
    }
}

/// What absorbs so much on each unit of length that light has a colour after a distance: `−ln c / d`. None if that is
/// no distance.
fn absorption(colour: Vec3, distance: f32) -> Vec3 {
    if !(distance > 0.0 && distance.is_finite()) {
        return Vec3::ZERO;
    }
    // Black would be infinite.
    colour.clamp(Vec3::splat(1e-6), Vec3::ONE).map(|v| -v.ln() / distance)
}

impl MaterialEntry {
    /// The absorption that it states. Errors: one of its two keys alone, or out of range.
    fn absorption(&self, place: &str) -> Result<Option<Vec3>> {
        match (self.attenuation_colour, self.attenuation_distance) {
            (None, None) => Ok(None),
            (Some(values), Some(distance)) if distance > 0.0 => {
                Ok(Some(absorption(colour(values, "attenuation_colour", 1.0, place)?, distance)))
            }
            (Some(_), Some(distance)) => Err(Error::input(
                place,
                format!("attenuation_distance {distance}"),
                "give a length above 0, in the unit of the geometry",
            )),
            _ => Err(Error::input(
                place,
                "attenuation_colour and attenuation_distance go together",
                "give both: the colour that light has after that distance",
            )),
        }
    }
}

/// A colour from the scene file. Errors: values that are negative, not finite, or above `largest`.
pub(super) fn colour(values: [f32; 3], key: &str, largest: f32, place: &str) -> Result<Vec3> {
    if values.iter().all(|v| (0.0..=largest).contains(v)) {
        return Ok(values.into());
    }
    Err(Error::input(
        place,
        format!("{key} {} has a value out of range", list(values, of_f32)),
        "give finite numbers of at least 0",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surface(source: MtlMaterial) -> Surface {
        let look = mtl::look_of(&source, MaterialShape::Sheet).look;
        SurfaceParams::of_mtl(&look, Paint::Constant(source.diffuse.unwrap_or_default())).surface()
    }

    fn grey(v: f32) -> Option<Vec3> {
        Some(Vec3::splat(v))
    }

    #[test]
    fn an_exporters_white_highlight_is_lacquer_not_chrome() {
        let exported = MtlMaterial {
            diffuse: grey(0.6),
            specular: grey(1.0),
            shininess: Some(40.0),
            ior: Some(1.5),
            illumination: Some(2),
            ..Default::default()
        };
        match surface(exported) {
            Surface::Coated { reflectance, specular, alpha } => {
                assert_eq!(reflectance, Paint::Constant(Vec3::splat(0.6)));
                assert!((specular.x - 0.04).abs() < 1e-6 && (alpha - 0.218).abs() < 1e-3);
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn mirrors_glass_and_sheets_are_told_apart() {
        let mirror = MtlMaterial {
            diffuse: grey(0.01),
            specular: grey(0.95),
            shininess: Some(1000.0),
            illumination: Some(5),
            ..Default::default()
        };
        assert_eq!(surface(mirror.clone()), Surface::Mirror { reflectance: Paint::Constant(Vec3::splat(0.95)) });
        let brushed = MtlMaterial { shininess: Some(50.0), ..mirror };
        assert!(matches!(surface(brushed), Surface::RoughConductor { .. }));
        let glass = MtlMaterial { illumination: Some(7), ior: Some(1.5), ..Default::default() };
        assert_eq!(surface(glass.clone()), Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE });
        let pane = MtlMaterial { ior: Some(1.0), specular: grey(0.08), transmission: grey(0.88), ..glass.clone() };
        match surface(pane) {
            Surface::ThinDielectric { ior, transmittance } => {
                let face = normal_reflectance(ior);
                let reflected = 2.0 * face / (1.0 + face);
                assert!((reflected - 0.08).abs() < 1e-4 && ((1.0 - reflected) * transmittance.x - 0.88).abs() < 1e-4);
            }
            other => panic!("{other:?}"),
        }
        // Nobody would see it.
        let air = MtlMaterial { ior: Some(1.0), diffuse: grey(0.3), ..glass };
        assert_eq!(surface(air), Surface::Lambert { reflectance: Paint::Constant(Vec3::splat(0.3)) });
    }

    #[test]
    fn the_pbr_fields_come_first() {
        let metal = MtlMaterial { diffuse: grey(0.8), roughness: Some(0.5), metallic: Some(1.0), ..Default::default() };
        let specular = Paint::Constant(Vec3::splat(0.8));
        assert_eq!(surface(metal.clone()), Surface::RoughConductor { specular, alpha: 0.25 });
        let plastic = MtlMaterial { metallic: Some(0.0), ..metal.clone() };
        assert!(matches!(surface(plastic), Surface::Coated { alpha, .. } if alpha == 0.25));
        let polished = MtlMaterial { roughness: Some(0.0), ..metal };
        assert_eq!(surface(polished), Surface::Mirror { reflectance: specular });
    }

    #[test]
    fn plain_and_black_materials_stay_so() {
        let plain = MtlMaterial { diffuse: grey(0.7), specular: grey(0.0), ..Default::default() };
        assert_eq!(surface(plain), Surface::Lambert { reflectance: Paint::Constant(Vec3::splat(0.7)) });
        assert_eq!(surface(MtlMaterial { diffuse: grey(0.0), ..Default::default() }), Surface::Black);
    }
}
