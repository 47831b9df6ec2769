//! What a material of an MTL file looks like: its surface, and what shows through it. `formats/scene.md` states the mapping.

use glam::Vec3;

use super::super::file::SurfaceEntry;
use super::super::material::{IORS, USUAL_IOR, normal_reflectance};
use super::MtlMaterial;
use super::dialect::Writer;
use super::shape::MaterialShape;

/// An index of refraction this near to 1 bends no light: the 1.000 of exporters that know none, and their 1.021.
const NO_REFRACTION: f32 = 1e-3;
/// The least index that a body of glass is given by its file on purpose.
const MIN_GLASS_IOR: f32 = 1.1;
/// Phong exponent from which a reflection counts as perfect.
const MIRROR_SHININESS: f32 = 1000.0;
/// Opacity from which nothing shows through.
const OPAQUE: f32 = 0.999;
/// Opacity below which nobody sees a surface that reflects nothing.
const UNSEEN: f32 = 0.01;
/// Stems of words for glass and water, in languages of the files at hand.
const GLASS: [&str; 17] = [
    "glas",
    "verre",
    "vitre",
    "vetro",
    "vidr",
    "cristal",
    "crystal",
    "kristal",
    "szklo",
    "steklo",
    "acryl",
    "plexi",
    "pyrex",
    "windscreen",
    "windshield",
    "water",
    "wasser",
];
/// Whole words for the same.
const GLASS_WORDS: [&str; 7] = ["pane", "panes", "window", "lens", "agua", "acqua", "eau"];
/// Stems of words for hollow bodies around a lamp.
const LAMP: [&str; 9] = ["bulb", "lamp", "light", "lantern", "shade", "globe", "bombilla", "ampoule", "luz"];

/// A surface's properties, of which its kind uses some.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in super::super) struct MtlLook {
    pub(in super::super) kind: SurfaceEntry,
    /// Overrides the diffuse colour and its map.
    pub(in super::super) reflectance: Option<Vec3>,
    pub(in super::super) specular: Vec3,
    pub(in super::super) alpha: f32,
    pub(in super::super) ior: f32,
    pub(in super::super) transmittance: Vec3,
    /// Whether `Pr` and `Pm` say what it is.
    pub(in super::super) is_pbr: bool,
}

/// The rule by which transparency was decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(in super::super) enum Through {
    /// Nothing was to be decided.
    Stated,
    /// Would be invisible, so it is opaque.
    Unseen,
    /// A pane or a sheet of glass.
    Pane,
    /// A body of glass.
    Body,
    /// A share that passes straight through.
    Share,
}

impl Through {
    /// What the rule makes, in words behind the names of materials.
    pub(in super::super) fn words(self) -> &'static str {
        match self {
            Self::Stated => "",
            Self::Unseen => "nobody would see it by its d, Tr or illum: drawn opaque",
            Self::Pane => "shows through (d, Tr): thin glass, by its illum or name",
            Self::Body => "shows through (d, Tr): a body of glass, by its illum, closed shape and Ni",
            Self::Share => "shows through (d, Tr): that share of the light passes straight",
        }
    }
}

/// What a material looks like on surfaces of some shape.
pub(in super::super) struct ShownLook {
    pub(in super::super) look: MtlLook,
    pub(in super::super) opacity: f32,
    /// Which rule made it so.
    pub(in super::super) through: Through,
}

/// The look of a material on surfaces of this shape.
pub(in super::super) fn look_of(source: &MtlMaterial, shape: MaterialShape) -> ShownLook {
    let opacity = source.opacity();
    let shown = |look, through| ShownLook { look, opacity: 1.0, through };
    let opaque = |rule| shown(plain_look(source, opaque_illumination(source)), rule);
    let stated = || {
        let look = plain_look(source, source.illumination);
        let is_sheet = look.kind == SurfaceEntry::ThinDielectric;
        match source.writer {
            Writer::Maya => opaque(Through::Stated),
            _ if is_sheet && look.ior == 1.0 && look.transmittance == Vec3::ONE => opaque(Through::Unseen),
            _ => shown(look, Through::Stated),
        }
    };
    let filtered =
        source.is_glass() && source.writer != Writer::Maya && source.transmission.is_some_and(|tf| tf != Vec3::ONE);
    let Some(opacity) = opacity.filter(|opacity| !filtered && opacity.min_element() < OPAQUE) else { return stated() };
    let share = opacity.element_sum() / 3.0;
    let is_unseen = share < UNSEEN && source.dissolve_map.is_none();
    if is_unseen && !is_named_glass(source) {
        return opaque(Through::Unseen);
    }
    let ior = source.ior.filter(|ior| (MIN_GLASS_IOR..=*IORS.end()).contains(ior));
    // By the format's text a share dissolves into the background, whatever else the surface is. Decision 63.
    let is_bent = source.is_glass() && (ior.is_some() || source.writer == Writer::Maya);
    if !(is_unseen || is_bent) {
        return ShownLook { opacity: share, ..opaque(Through::Share) };
    }
    let passed = match source.writer {
        Writer::Maya => Vec3::ONE - opacity,
        _ => Vec3::ONE - opacity * (Vec3::ONE - source.diffuse.unwrap_or(Vec3::ONE).min(Vec3::ONE)),
    };
    let mut look = plain_look(source, opaque_illumination(source));
    look.reflectance = None;
    if let Some(ior) = ior.filter(|_| shape.is_solid() && !is_named_lamp(source)) {
        look.kind = SurfaceEntry::Dielectric;
        (look.ior, look.transmittance) = (ior, passed.map(f32::sqrt));
        return shown(look, Through::Body);
    }
    look.kind = SurfaceEntry::ThinDielectric;
    (look.ior, look.transmittance) = (ior.unwrap_or(USUAL_IOR), passed);
    if shape.has_two_faces() {
        // Each face reflects once, where a sheet stands for two.
        (look.ior, look.transmittance) = (ior_of_sheet(normal_reflectance(look.ior)), passed.map(f32::sqrt));
    }
    shown(look, Through::Pane)
}

/// Whether its name or `illum` says glass.
fn is_named_glass(source: &MtlMaterial) -> bool {
    let name = source.name.to_lowercase();
    let has_word = || words(&source.name).iter().any(|word| GLASS_WORDS.contains(&word.as_str()));
    source.is_glass() || GLASS.iter().any(|stem| name.contains(stem)) || has_word()
}

/// Whether its name says that it is a hollow body around a lamp.
fn is_named_lamp(source: &MtlMaterial) -> bool {
    let name = source.name.to_lowercase();
    LAMP.iter().any(|stem| name.contains(stem))
}

/// The words of a name like `cabinetPane_2`, in lower case.
fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut was_lower = false;
    for letter in name.chars() {
        if !letter.is_alphabetic() || (letter.is_uppercase() && was_lower) {
            words.push(String::new());
        }
        was_lower = letter.is_lowercase();
        if letter.is_alphabetic() {
            words.last_mut().expect("one at least").extend(letter.to_lowercase());
        }
    }
    words
}

/// `illum` without glass.
fn opaque_illumination(source: &MtlMaterial) -> Option<u32> {
    match source.illumination {
        Some(4 | 9) => Some(2),
        Some(6 | 7) => Some(3),
        other => other,
    }
}

/// Index of a thin sheet of two faces that reflects this at normal incidence, `R = 2F / (1 + F)`.
fn ior_of_sheet(reflected: f32) -> f32 {
    let face = (reflected / (2.0 - reflected)).sqrt();
    (1.0 + face) / (1.0 - face)
}

/// GGX α of the lobe that a Blinn–Phong exponent means: `α = √(2 / (n + 2))` (Walter et al. 2007, §5.2).
fn alpha_of_shininess(exponent: f32) -> f32 {
    (2.0 / (exponent.max(0.0) + 2.0)).sqrt()
}

/// Perceptual roughness, the root of that α.
pub(in super::super) fn roughness_of_shininess(exponent: f32) -> f32 {
    alpha_of_shininess(exponent).min(1.0).sqrt()
}

/// The mapping of the fields but `d` and `Tr`.
fn plain_look(source: &MtlMaterial, illumination: Option<u32>) -> MtlLook {
    let specular = source.specular_factor();
    let diffuse = source.diffuse.unwrap_or(Vec3::ZERO);
    let ior = source.ior.filter(|ior| IORS.contains(ior)).unwrap_or(USUAL_IOR);
    let coat_ior = if ior > 1.0 + NO_REFRACTION { ior } else { USUAL_IOR };
    let mut look = MtlLook {
        kind: SurfaceEntry::Lambert,
        reflectance: None,
        specular: Vec3::splat(normal_reflectance(coat_ior)),
        alpha: source.shininess_factor().map_or(0.25, alpha_of_shininess),
        ior,
        transmittance: source.transmission.unwrap_or(Vec3::ONE),
        is_pbr: false,
    };
    match illumination.unwrap_or(2) {
        4 | 6 | 7 | 9 if (ior - 1.0).abs() > NO_REFRACTION => look.kind = SurfaceEntry::Dielectric,
        4 | 6 | 7 | 9 => {
            look.kind = SurfaceEntry::ThinDielectric;
            look.be_sheet(source.specular.unwrap_or(Vec3::ZERO));
        }
        _ if source.is_pbr() => {
            look.alpha = source.roughness.unwrap_or(0.5).clamp(0.0, 1.0).powi(2);
            let metal = source.metallic.unwrap_or(0.0) >= 1.0;
            look.kind = if metal { SurfaceEntry::RoughConductor } else { SurfaceEntry::Coated };
            look.is_pbr = true;
        }
        3 | 5 | 8 if specular.max_element() > 0.0 && specular.max_element() >= diffuse.max_element() => {
            look.reflectance = Some(specular);
            let perfect = source.shininess_factor().is_none_or(|n| n >= MIRROR_SHININESS);
            look.kind = if perfect { SurfaceEntry::Mirror } else { SurfaceEntry::RoughConductor };
        }
        3 | 5 | 8 if specular.max_element() > 0.0 => {
            look.kind = SurfaceEntry::Coated;
            look.specular = specular;
        }
        // A Phong highlight is a look, not a reflectance: Ks scales what a lacquer of index Ni reflects, so that the
        // `Ks 1 1 1` of many exporters becomes lacquer and not chrome.
        2 if specular.max_element() > 0.0 && source.shininess_factor().is_none_or(|n| n > 1.0) => {
            look.kind = SurfaceEntry::Coated;
            look.specular = specular.min(Vec3::ONE) * normal_reflectance(coat_ior);
        }
        _ => {}
    }
    look
}

impl MtlLook {
    /// Makes the sheet reflect `Ks` and pass `Tf` at normal incidence, where the two leave room for each other.
    fn be_sheet(&mut self, specular: Vec3) {
        let reflected = specular.max_element();
        if reflected + self.transmittance.max_element() > 1.001 || reflected >= 0.9 {
            self.ior = if reflected > 0.0 { USUAL_IOR } else { 1.0 };
            return;
        }
        self.ior = ior_of_sheet(reflected);
        self.transmittance /= 1.0 - reflected;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn through(source: MtlMaterial) -> Through {
        look_of(&source, MaterialShape::Sheet).through
    }

    #[test]
    fn a_share_dissolves_whatever_the_gloss_or_name_unless_illum_asks_for_glass_that_bends() {
        let pane = MtlMaterial {
            name: "glass".into(),
            dissolve: Some(0.3),
            specular: Some(Vec3::splat(0.5)),
            ior: Some(1.5),
            ..Default::default()
        };
        assert_eq!(through(pane.clone()), Through::Share);
        assert_eq!(through(MtlMaterial { illumination: Some(7), ior: Some(1.0), ..pane.clone() }), Through::Share);
        assert_eq!(through(MtlMaterial { illumination: Some(7), ..pane.clone() }), Through::Pane);
        assert_eq!(look_of(&pane, MaterialShape::Slab).opacity, 0.3);
    }

    #[test]
    fn names_tell_what_is_seen_though_nothing_of_it_is_left() {
        let named = |name: &str| through(MtlMaterial { name: name.into(), dissolve: Some(0.0), ..Default::default() });
        for glass in ["cabinetPane", "FlakonSmokeGlassMat", "vidre_taula", "glass curtain"] {
            assert_eq!(named(glass), Through::Pane, "{glass}");
        }
        for other in ["Curtain_01", "Material.003", "panel"] {
            assert_eq!(named(other), Through::Unseen, "{other}");
        }
        assert_eq!(words("cabinetPane_2 A"), ["cabinet", "pane", "", "", "a"]);
    }
}
