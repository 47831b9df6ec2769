//! From material descriptions to surfaces: what the MTL fields mean here, and what the scene file overrides.
//!
//! `formats/scene.md` states the mapping in a table.

use std::ops::RangeInclusive;
use std::path::Path;

use glam::Vec3;

use super::file::{MaterialEntry, SurfaceEntry};
use super::folders::Folders;
use super::gltf::{Alpha, GltfMaterial};
use super::import::{Description, SourceMaterial};
use super::mtl::MtlMaterial;
use super::textures::{Textures, Use};
use super::{Material, Paint, Surface, TextureId};
use crate::error::{Error, Result};
use crate::light::names::fits;

/// Index of refraction of surfaces that state none: ordinary glass and lacquer.
const USUAL_IOR: f32 = 1.5;
/// Indices of refraction that are taken.
const IORS: RangeInclusive<f32> = 0.1..=10.0;

/// What a clear coat of glTF reflects at normal incidence: that of index 1.5.
const CLEAR_COAT: f32 = 0.04;

/// Index of refraction this near to 1 means a sheet without thickness.
const NO_REFRACTION: f32 = 1e-3;

/// Phong exponent from which a reflection counts as perfect.
const MIRROR_SHININESS: f32 = 1000.0;

/// Smallest GGX α that is told from a perfect mirror.
const SMALLEST_ALPHA: f32 = 1e-3;

/// What a material emits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Emission {
    pub(super) radiance: Vec3,
    pub(super) pattern: Option<Paint>,
}

/// A material as it is known before it becomes a [`Surface`]: every property, whether its kind uses it or not.
#[derive(Clone, Copy, Debug)]
struct Look {
    kind: SurfaceEntry,
    /// Albedo, or what a mirror or metal reflects.
    reflectance: Paint,
    /// Reflectance of a coat at normal incidence.
    specular: Vec3,
    alpha: f32,
    ior: f32,
    transmittance: Vec3,
}

/// A material before the scene file's overrides.
struct Draft {
    look: Look,
    cutout: Option<TextureId>,
    radiance: Vec3,
    pattern: Option<Paint>,
}

/// Builds materials; textures and warnings gather in it.
pub(super) struct Workshop<'a> {
    pub(super) textures: Textures,
    pub(super) warnings: Vec<String>,
    pub(super) overrides: &'a [MaterialEntry],
    pub(super) folders: &'a Folders,
    /// Name of the scene file, for messages.
    pub(super) place: &'a str,
}

impl Workshop<'_> {
    /// The material that a description and the scene file's overrides make.
    pub(super) fn make(&mut self, source: &SourceMaterial) -> Result<(Material, Option<Emission>)> {
        let draft = match &source.description {
            Description::Mtl(mtl, folder) => self.of_mtl(mtl, folder)?,
            Description::Gltf(gltf) => self.of_gltf(gltf, &source.name)?,
        };
        self.finish(draft, &source.name)
    }

    /// What a glTF material means here. `formats/scene.md` states it.
    fn of_gltf(&mut self, source: &GltfMaterial, name: &str) -> Result<Draft> {
        let asked_by = format!("material '{name}'");
        let usage = match source.alpha {
            Alpha::Cut(scale) => Use::Masked(scale.to_bits()),
            Alpha::Opaque | Alpha::Sheet(_) => Use::Reflectance,
        };
        let mut map = |image: &Option<_>, usage: Use| match image {
            Some(image) => self.textures.source(image, usage, &asked_by, &mut self.warnings),
            None => Ok(None),
        };
        let base_map = map(&source.base_image, usage)?;
        let emission_map = map(&source.emission_image, Use::Emission)?;
        let averages = match &source.metallic_roughness_image {
            Some(image) => self.textures.average(image, &asked_by)?,
            None => None,
        };
        let [_, roughness, metallic] = averages.unwrap_or([1.0; 3]);
        let (roughness, metallic) = (roughness * source.roughness, metallic * source.metallic);
        let mut look = Look {
            kind: SurfaceEntry::Coated,
            reflectance: base_map.map_or(Paint::Constant(source.base), |id| Paint::Textured(id, source.base)),
            specular: (source.specular * normal_reflectance(source.ior)).min(Vec3::ONE),
            alpha: roughness.clamp(0.0, 1.0).powi(2),
            ior: source.ior,
            transmittance: source.base,
        };
        let [coat, coat_roughness] = source.clear_coat.map(|v| v.min(1.0));
        if coat > 0.0 {
            look.specular = Vec3::ONE - (Vec3::ONE - look.specular) * (1.0 - coat * CLEAR_COAT);
        }
        if coat >= 0.5 && metallic < 0.5 {
            look.alpha = coat_roughness.powi(2);
        }
        if metallic >= 0.5 {
            look.kind = SurfaceEntry::RoughConductor;
        } else if source.transmission >= 0.5 {
            look.kind = if source.is_body { SurfaceEntry::Dielectric } else { SurfaceEntry::ThinDielectric };
        } else if let Alpha::Sheet(share) = source.alpha {
            look.kind = SurfaceEntry::ThinDielectric;
            look.transmittance = Vec3::ONE.lerp(source.base, share);
        }
        let cutout = matches!(source.alpha, Alpha::Cut(_)).then_some(base_map).flatten();
        let pattern = emission_map.map(|id| Paint::Textured(id, Vec3::ONE));
        Ok(Draft { look, cutout, radiance: source.emission, pattern })
    }

    /// What an MTL description means here. `folder` holds its textures.
    fn of_mtl(&mut self, source: &MtlMaterial, folder: &Path) -> Result<Draft> {
        let asked_by = format!("material '{}'", source.name);
        let mut map = |name: &Option<String>, usage: Use| match name {
            Some(name) => self.textures.named((folder, name), usage, &asked_by, &mut self.warnings),
            None => Ok(None),
        };
        let diffuse_map = map(&source.diffuse_map, Use::Reflectance)?;
        let cutout = map(&source.dissolve_map, Use::CutOut)?;
        let emission_map = map(&source.emission_map, Use::Emission)?;
        let diffuse = source.diffuse.unwrap_or(Vec3::splat(if source.emission.is_some() { 0.0 } else { 0.5 }));
        let base = match diffuse_map {
            // Exporters write a black Kd, or none, beside a map that is meant to be seen.
            Some(id) if diffuse == Vec3::ZERO || source.diffuse.is_none() => Paint::Textured(id, Vec3::ONE),
            Some(id) => Paint::Textured(id, diffuse),
            // The map is missing: black would not be what is meant.
            None if source.diffuse_map.is_some() && diffuse == Vec3::ZERO => Paint::Constant(Vec3::splat(0.5)),
            None => Paint::Constant(diffuse),
        };
        if source.has_placed_maps {
            self.warnings.push(format!(
                "{asked_by}: its maps are scaled, moved or clamped by -s, -o or -clamp, which is not read"
            ));
        }
        let look = look_of(source, base);
        let transparent = matches!(look.kind, SurfaceEntry::Dielectric | SurfaceEntry::ThinDielectric);
        if let Some(ior) = source.ior.filter(|ior| !IORS.contains(ior) && (transparent || ior > IORS.end())) {
            self.warnings.push(format!("{asked_by}: 'Ni' {ior} is no index of refraction; taken as {USUAL_IOR}"));
        }
        if source.dissolve.is_some_and(|d| d < 0.999) && !transparent {
            let advice = "a cut-out needs map_d, glass needs illum 4, 6, 7 or 9 or an override";
            self.warnings.push(format!("{asked_by}: 'd' below 1 is ignored; {advice}"));
        }
        let pattern = emission_map.map(|id| Paint::Textured(id, Vec3::ONE));
        let mut radiance = source.emission.unwrap_or(Vec3::ZERO);
        if pattern.is_some() && radiance == Vec3::ZERO {
            radiance = Vec3::ONE;
        }
        Ok(Draft { look, cutout, radiance, pattern })
    }

    /// Applies the scene file's overrides.
    fn finish(&mut self, draft: Draft, name: &str) -> Result<(Material, Option<Emission>)> {
        let Draft { mut look, mut cutout, mut radiance, pattern } = draft;
        let asked_by = format!("material '{name}'");
        for entry in self.overrides.iter().filter(|entry| fits(&entry.pattern, name)) {
            let place = format!("{}, material \"{}\"", self.place, entry.pattern);
            look.change(entry, &place)?;
            let mut map = |name: &Option<String>, usage: Use| {
                let Some(name) = name else { return Ok(None) };
                match self.folders.look_up(name, &place)? {
                    Some(path) => self.textures.get(&path, usage, &mut self.warnings).map(Some),
                    None => self.textures.named((self.folders.own(), name), usage, &place, &mut self.warnings),
                }
            };
            if let Some(id) = map(&entry.reflectance_map, Use::Reflectance)? {
                look.reflectance = Paint::Textured(id, entry.reflectance.map_or(Vec3::ONE, Vec3::from));
            }
            cutout = map(&entry.cutout_map, Use::CutOut)?.or(cutout);
            if let Some(emission) = entry.emission {
                radiance = colour(emission, "emission", f32::MAX, &place)?;
            }
        }
        if look.conserve_energy() {
            self.warnings.push(format!("{asked_by}: reflects or transmits more than it receives; clamped to 1"));
        }
        let emission = (radiance != Vec3::ZERO).then_some(Emission { radiance, pattern });
        Ok((Material { name: name.to_owned(), surface: look.surface(), cutout }, emission))
    }
}

/// Reflectance at normal incidence of a boundary with this index of refraction (Fresnel).
fn normal_reflectance(ior: f32) -> f32 {
    ((ior - 1.0) / (ior + 1.0)).powi(2)
}

/// GGX α of the lobe that a Blinn–Phong exponent means: `α = √(2 / (n + 2))` (Walter et al. 2007, §5.2).
fn alpha_of_shininess(exponent: f32) -> f32 {
    (2.0 / (exponent.max(0.0) + 2.0)).sqrt()
}

/// The mapping of MTL fields.
fn look_of(source: &MtlMaterial, base: Paint) -> Look {
    let specular = source.specular.unwrap_or(Vec3::ZERO);
    let diffuse = source.diffuse.unwrap_or(Vec3::ZERO);
    let ior = source.ior.filter(|ior| IORS.contains(ior)).unwrap_or(USUAL_IOR);
    let coat_ior = if ior > 1.0 + NO_REFRACTION { ior } else { USUAL_IOR };
    let illumination = source.illumination.unwrap_or(2);
    let mut look = Look {
        kind: SurfaceEntry::Lambert,
        reflectance: base,
        specular: Vec3::splat(normal_reflectance(coat_ior)),
        alpha: source.shininess.map_or(0.25, alpha_of_shininess),
        ior,
        transmittance: source.transmission.unwrap_or(Vec3::ONE),
    };
    match illumination {
        4 | 6 | 7 | 9 if (ior - 1.0).abs() > NO_REFRACTION => look.kind = SurfaceEntry::Dielectric,
        4 | 6 | 7 | 9 => {
            look.kind = SurfaceEntry::ThinDielectric;
            look.be_sheet(specular);
        }
        _ if source.roughness.is_some() || source.metallic.is_some() => {
            look.alpha = source.roughness.unwrap_or(0.5).clamp(0.0, 1.0).powi(2);
            let metal = source.metallic.unwrap_or(0.0) >= 0.5;
            look.kind = if metal { SurfaceEntry::RoughConductor } else { SurfaceEntry::Coated };
        }
        3 | 5 | 8 if specular.max_element() > 0.0 && specular.max_element() >= diffuse.max_element() => {
            look.reflectance = Paint::Constant(specular);
            let perfect = source.shininess.is_none_or(|n| n >= MIRROR_SHININESS);
            look.kind = if perfect { SurfaceEntry::Mirror } else { SurfaceEntry::RoughConductor };
        }
        3 | 5 | 8 if specular.max_element() > 0.0 => {
            look.kind = SurfaceEntry::Coated;
            look.specular = specular;
        }
        // A Phong highlight is a look, not a reflectance: Ks scales what a lacquer of index Ni reflects, so that the
        // `Ks 1 1 1` of many exporters becomes lacquer and not chrome.
        2 if specular.max_element() > 0.0 && source.shininess.is_none_or(|n| n > 1.0) => {
            look.kind = SurfaceEntry::Coated;
            look.specular = specular.min(Vec3::ONE) * normal_reflectance(coat_ior);
        }
        _ => {}
    }
    look
}

impl Look {
    /// Makes the sheet reflect `Ks` and pass `Tf` at normal incidence, where the two leave room for each other:
    /// a sheet of two faces reflects `R = 2F / (1 + F)`.
    fn be_sheet(&mut self, specular: Vec3) {
        let reflected = specular.max_element();
        if reflected + self.transmittance.max_element() > 1.001 || reflected >= 0.9 {
            self.ior = if reflected > 0.0 { USUAL_IOR } else { 1.0 };
            return;
        }
        let face = (reflected / (2.0 - reflected)).sqrt();
        self.ior = (1.0 + face) / (1.0 - face);
        self.transmittance /= 1.0 - reflected;
    }

    fn change(&mut self, entry: &MaterialEntry, place: &str) -> Result<()> {
        self.kind = entry.kind.unwrap_or(self.kind);
        if let Some(reflectance) = entry.reflectance {
            self.reflectance = Paint::Constant(colour(reflectance, "reflectance", f32::MAX, place)?);
        }
        if let Some(specular) = entry.specular {
            self.specular = colour(specular, "specular", f32::MAX, place)?;
        }
        if let Some(transmittance) = entry.transmittance {
            self.transmittance = colour(transmittance, "transmittance", f32::MAX, place)?;
        }
        if let Some(roughness) = entry.roughness {
            if !(0.0..=1.0).contains(&roughness) {
                return Err(Error::input(place, format!("roughness {roughness}"), "give a number from 0 to 1"));
            }
            self.alpha = roughness * roughness;
        }
        if let Some(ior) = entry.ior {
            if !IORS.contains(&ior) {
                return Err(Error::input(place, format!("ior {ior}"), "give a number from 0.1 to 10, 1.5 for glass"));
            }
            self.ior = ior;
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
        clamped
    }

    fn surface(self) -> Surface {
        let Self { kind, reflectance, specular, alpha, ior, transmittance } = self;
        match kind {
            SurfaceEntry::Black => Surface::Black,
            SurfaceEntry::Coated if specular != Vec3::ZERO => {
                Surface::Coated { reflectance, specular, alpha: alpha.max(SMALLEST_ALPHA) }
            }
            SurfaceEntry::Lambert | SurfaceEntry::Coated if reflectance == Paint::Constant(Vec3::ZERO) => {
                Surface::Black
            }
            SurfaceEntry::Lambert | SurfaceEntry::Coated => Surface::Lambert { reflectance },
            SurfaceEntry::RoughConductor if alpha >= SMALLEST_ALPHA => {
                Surface::RoughConductor { specular: reflectance, alpha }
            }
            SurfaceEntry::Mirror | SurfaceEntry::RoughConductor => Surface::Mirror { reflectance },
            SurfaceEntry::Dielectric if (ior - 1.0).abs() > NO_REFRACTION => Surface::Dielectric { ior, transmittance },
            SurfaceEntry::Dielectric | SurfaceEntry::ThinDielectric => Surface::ThinDielectric { ior, transmittance },
        }
    }
}

/// A colour from the scene file. Errors: values that are negative, not finite, or above `largest`.
pub(super) fn colour(values: [f32; 3], key: &str, largest: f32, place: &str) -> Result<Vec3> {
    if values.iter().all(|v| (0.0..=largest).contains(v)) {
        return Ok(values.into());
    }
    Err(Error::input(place, format!("{key} {values:?} has a value out of range"), "give finite numbers of at least 0"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surface(source: MtlMaterial) -> Surface {
        look_of(&source, Paint::Constant(source.diffuse.unwrap_or_default())).surface()
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
        let air = MtlMaterial { ior: Some(1.0), ..glass };
        assert_eq!(surface(air), Surface::ThinDielectric { ior: 1.0, transmittance: Vec3::ONE });
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
