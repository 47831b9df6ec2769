//! The scene file as it is typed: TOML to records, with errors that name the line, the key and the nearest known one.
//!
//! `formats/scene.md` describes every key; what the values mean is decided in `load`.

use std::path::Path;

use glam::Mat3;
use serde::Deserialize;

use super::cube_map::CubeMap;
use super::names;
use super::photometry::Photometry;
use crate::error::{Error, Result};

/// A scene file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SceneFile {
    pub(super) name: Option<String>,
    /// An OBJ or glTF file that is a scene of its own, with its lights and cameras, instead of `geometry`.
    pub(super) scene: Option<String>,
    pub(super) geometry: Option<Vec<String>>,
    pub(super) metres_per_unit: Option<f32>,
    pub(super) camera: Option<CameraEntry>,
    #[serde(default)]
    pub(super) grid: Vec<GridEntry>,
    #[serde(default)]
    pub(super) render: RenderEntry,
    #[serde(default)]
    pub(super) light: Vec<LightEntry>,
    #[serde(default)]
    pub(super) material: Vec<MaterialEntry>,
}

/// `[camera]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraEntry {
    pub(super) eye: [f64; 3],
    pub(super) look_at: Option<[f64; 3]>,
    pub(super) direction: Option<[f32; 3]>,
    pub(super) up: Option<[f32; 3]>,
    pub(super) projection: Option<ProjectionEntry>,
    pub(super) vertical_fov_degrees: Option<f32>,
    pub(super) view_height: Option<f32>,
    pub(super) shift: Option<[f32; 2]>,
    pub(super) pixel_aspect: Option<f32>,
    pub(super) aperture_radius: Option<f32>,
    pub(super) focus_distance: Option<f32>,
    pub(super) blades: Option<u32>,
    pub(super) blade_rotation_degrees: Option<f32>,
    pub(super) width: Option<u32>,
    pub(super) height: Option<u32>,
    pub(super) filter: Option<FilterEntry>,
    pub(super) filter_radius: Option<f32>,
    pub(super) irradiance: Option<bool>,
}

/// `[[grid]]`: sensors in the place of a camera.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GridEntry {
    pub(super) name: String,
    pub(super) origin: Option<[f64; 3]>,
    pub(super) edge_u: Option<[f32; 3]>,
    pub(super) edge_v: Option<[f32; 3]>,
    pub(super) spacing: Option<f32>,
    pub(super) faces: Option<[f32; 3]>,
    pub(super) points: Option<String>,
    pub(super) axes: Option<PointAxes>,
}

/// The axes of a file of points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum PointAxes {
    /// Radiance's: (x, y, z) is (x, z, −y) of a scene.
    #[default]
    ZUp,
    YUp,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum ProjectionEntry {
    #[default]
    Perspective,
    Orthographic,
    Panorama,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum FilterEntry {
    Box,
    Tent,
    Gaussian,
}

/// `[render]`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RenderEntry {
    pub(super) samples_per_pixel: Option<u32>,
    pub(super) seed: Option<u64>,
    pub(super) block_side: Option<u32>,
    pub(super) max_depth: Option<u32>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum LightEntryKind {
    #[default]
    Surface,
    Panel,
    Point,
    Spot,
    Sun,
    Ies,
    Environment,
    Suns,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum SideEntry {
    #[default]
    Front,
    Back,
    Both,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum MappingEntry {
    #[default]
    LatLong,
    Octahedral,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum PatchesEntry {
    Tregenza,
    Reinhart,
}

/// `[[light]]`, for all kinds; which keys go with which kind is checked by [`LightEntry::check_keys`].
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LightEntry {
    #[serde(default)]
    pub(super) kind: LightEntryKind,
    pub(super) name: Option<String>,
    pub(super) emission: Option<[f32; 3]>,
    pub(super) camera: Option<bool>,
    pub(super) material: Option<String>,
    pub(super) object: Option<String>,
    pub(super) join: Option<bool>,
    pub(super) texels: Option<[u32; 2]>,
    pub(super) side: Option<SideEntry>,
    pub(super) replaces: Option<String>,
    pub(super) origin: Option<[f64; 3]>,
    pub(super) edge_u: Option<[f32; 3]>,
    pub(super) edge_v: Option<[f32; 3]>,
    pub(super) faces: Option<[f32; 3]>,
    pub(super) position: Option<[f64; 3]>,
    pub(super) direction: Option<[f32; 3]>,
    pub(super) radius: Option<f32>,
    pub(super) inner_degrees: Option<f32>,
    pub(super) outer_degrees: Option<f32>,
    pub(super) towards: Option<[f32; 3]>,
    pub(super) angular_radius_degrees: Option<f32>,
    pub(super) file: Option<String>,
    pub(super) turn_degrees: Option<f32>,
    pub(super) mapping: Option<MappingEntry>,
    pub(super) map: Option<String>,
    pub(super) patches: Option<PatchesEntry>,
    pub(super) subdivision: Option<u32>,
    pub(super) split: Option<bool>,
    pub(super) latitude_degrees: Option<f32>,
    pub(super) step_degrees: Option<f32>,
    /// What stands for `file`, `direction` and `turn_degrees` of a luminaire that a glTF file brings.
    #[serde(skip)]
    pub(super) luminaire: Option<Luminaire>,
    /// What stands for `map` and `turn_degrees` of an environment that a glTF file brings.
    #[serde(skip)]
    pub(super) cube: Option<CubeMap>,
}

/// A measured luminaire and how it hangs.
#[derive(Clone, Debug)]
pub(super) struct Luminaire {
    pub(super) photometry: Photometry,
    /// The nadir is −z, and the plane of 0° holds +x.
    pub(super) world_from_luminaire: Mat3,
}

/// `[[material]]`: what overrides the MTL file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MaterialEntry {
    #[serde(rename = "match")]
    pub(super) pattern: String,
    pub(super) kind: Option<SurfaceEntry>,
    pub(super) reflectance: Option<[f32; 3]>,
    pub(super) reflectance_map: Option<String>,
    pub(super) colour_times_map: Option<bool>,
    pub(super) specular: Option<[f32; 3]>,
    pub(super) roughness: Option<f32>,
    pub(super) ior: Option<f32>,
    pub(super) transmittance: Option<[f32; 3]>,
    pub(super) attenuation_colour: Option<[f32; 3]>,
    pub(super) attenuation_distance: Option<f32>,
    pub(super) cutout_map: Option<String>,
    pub(super) opacity: Option<f32>,
    pub(super) emission: Option<[f32; 3]>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum SurfaceEntry {
    Lambert,
    Mirror,
    RoughConductor,
    Dielectric,
    ThinDielectric,
    Coated,
    Black,
}

impl LightEntryKind {
    /// Its name in the file and the keys that go with it besides `kind`, `name`, `emission` and `camera`.
    fn keys(self) -> (&'static str, &'static [&'static str]) {
        match self {
            Self::Surface => ("surface", &["material", "object", "join", "texels", "side"]),
            Self::Panel => ("panel", &["origin", "edge_u", "edge_v", "faces", "texels", "side", "replaces"]),
            Self::Point => ("point", &["position", "radius"]),
            Self::Spot => ("spot", &["position", "radius", "direction", "inner_degrees", "outer_degrees"]),
            Self::Sun => ("sun", &["towards", "angular_radius_degrees"]),
            Self::Ies => ("ies", &["file", "position", "direction", "turn_degrees"]),
            Self::Environment => {
                ("environment", &["mapping", "texels", "patches", "subdivision", "split", "turn_degrees", "map"])
            }
            Self::Suns => (
                "suns",
                &[
                    "latitude_degrees",
                    "step_degrees",
                    "patches",
                    "subdivision",
                    "turn_degrees",
                    "angular_radius_degrees",
                ],
            ),
        }
    }
}

impl LightEntry {
    /// Errors: a key that does not go with the light's kind.
    pub(super) fn check_keys(&self, place: &str) -> Result<()> {
        let given = [
            ("material", self.material.is_some()),
            ("object", self.object.is_some()),
            ("join", self.join.is_some()),
            ("texels", self.texels.is_some()),
            ("side", self.side.is_some()),
            ("replaces", self.replaces.is_some()),
            ("origin", self.origin.is_some()),
            ("edge_u", self.edge_u.is_some()),
            ("edge_v", self.edge_v.is_some()),
            ("faces", self.faces.is_some()),
            ("position", self.position.is_some()),
            ("direction", self.direction.is_some()),
            ("radius", self.radius.is_some()),
            ("inner_degrees", self.inner_degrees.is_some()),
            ("outer_degrees", self.outer_degrees.is_some()),
            ("towards", self.towards.is_some()),
            ("angular_radius_degrees", self.angular_radius_degrees.is_some()),
            ("file", self.file.is_some()),
            ("turn_degrees", self.turn_degrees.is_some()),
            ("mapping", self.mapping.is_some()),
            ("map", self.map.is_some()),
            ("patches", self.patches.is_some()),
            ("subdivision", self.subdivision.is_some()),
            ("split", self.split.is_some()),
            ("latitude_degrees", self.latitude_degrees.is_some()),
            ("step_degrees", self.step_degrees.is_some()),
        ];
        let (kind, allowed) = self.kind.keys();
        match given.iter().find(|(key, given)| *given && !allowed.contains(key)) {
            None => Ok(()),
            Some((key, _)) => Err(Error::input(
                place,
                format!("a light of kind \"{kind}\" has no '{key}'"),
                format!("it takes name, emission, camera, {}", allowed.join(", ")),
            )),
        }
    }
}

/// Parses a scene file's text; `path` is for messages. Errors: anything that is not a scene file, with its line.
pub(super) fn parse(path: &Path, text: &str) -> Result<SceneFile> {
    toml::from_str(text).map_err(|error| {
        let mut place = path.display().to_string();
        if let Some(span) = error.span() {
            let line = text.get(..span.start).map_or(0, |before| before.matches('\n').count()) + 1;
            place = format!("{place}, line {line}");
        }
        let message = error.message().lines().next().unwrap_or_default().to_owned();
        let quoted: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
        match quoted.split_first() {
            Some((&key, known)) if message.starts_with("unknown field") => {
                let nearest = names::nearest(key, known.iter().copied());
                let hint = nearest.map(|name| format!("did you mean '{name}'? ")).unwrap_or_default();
                Error::input(place, format!("unknown key '{key}'"), format!("{hint}known here: {}", known.join(", ")))
            }
            Some((&value, known)) if message.starts_with("unknown variant") => {
                let hint = format!("choose one of {}", known.join(", "));
                Error::input(place, format!("unknown value \"{value}\""), hint)
            }
            Some((&key, _)) if message.starts_with("missing field") => missing(place, key),
            _ => Error::input(place, message, "formats/scene.md says how a scene file is written"),
        }
    })
}

fn missing(place: String, key: &str) -> Error {
    Error::input(place, format!("the key '{key}' is missing"), "formats/scene.md lists the keys")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(text: &str) -> String {
        parse(Path::new("a.toml"), text).unwrap_err().to_string()
    }

    #[test]
    fn errors_name_the_line_the_key_and_the_nearest_known_one() {
        let unknown = message("geometry = []\n[camera]\neye = [0, 0, 0]\nfov_degrees = 3\n");
        assert!(unknown.contains("line 4") && unknown.contains("'fov_degrees'"), "{unknown}");
        let unknown = message("geometry = []\n[camera]\neye = [0, 0, 0]\n[[light]]\ntexel = 3\n");
        assert!(unknown.contains("line 5") && unknown.contains("did you mean 'texels'"), "{unknown}");
        let unknown = message("geometry = []\n[camera]\neye = [0, 0, 0]\n[[light]]\nkind = \"lamp\"\n");
        assert!(unknown.contains("line 5") && unknown.contains("environment"), "{unknown}");
        assert!(message("geometry = []\n[camera]\nlook_at = [0, 0, 0]\n").contains("'eye' is missing"));
        assert!(message("geometry = 3\n").contains("line 1"));
        assert!(message("geometry = [").contains("line 1"));
    }

    /// The keys that a table takes, as its parser lists them.
    fn keys_after(text: &str) -> Vec<String> {
        let error = toml::from_str::<SceneFile>(&format!("{text}\nno_such_key = 1\n")).unwrap_err();
        assert!(error.message().starts_with("unknown field"), "{error}");
        error.message().split('`').skip(3).step_by(2).map(String::from).collect()
    }

    #[test]
    fn the_format_document_lists_exactly_the_keys_that_are_read() {
        let document = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/formats/scene.md")).unwrap();
        let (before, rest) = document.split_once("```toml").unwrap();
        let (example, after) = rest.split_once("```").unwrap();
        let prose = format!("{before}{after}");
        let words: Vec<&str> = prose.split('`').skip(1).step_by(2).map(|w| w.trim_matches(['[', ']'])).collect();
        assert_eq!(parse(Path::new("scene.md"), example).unwrap().light.len(), 1);
        let camera = "[camera]\neye = [0, 0, 0]";
        let heads =
            ["geometry = []", camera, "[[grid]]\nname = \"a\"", "[render]", "[[light]]", "[[material]]\nmatch = \"*\""];
        let mut known: Vec<String> = heads.iter().flat_map(|head| keys_after(head)).collect();
        for key in &known {
            let in_example = example.lines().any(|line| line.starts_with(&format!("{key} =")));
            assert!(words.contains(&key.as_str()) || in_example, "formats/scene.md does not describe '{key}'");
        }
        // What stands first in a row of a table of keys is one.
        known.extend(
            ["surface", "panel", "environment", "point", "spot", "ies", "sun", "suns", "illum", "Pm", "Pr"]
                .map(String::from),
        );
        for row in document.lines().filter(|line| line.starts_with("| `")) {
            let first = row.split('|').nth(1).unwrap_or_default();
            for key in first.split('`').skip(1).step_by(2) {
                let key = key.split(' ').next().unwrap_or_default();
                // Keys of OBJ's materials and extensions of glTF have names of their own.
                let foreign = ["Ks", "Kd", "Ns", "Ni", "norm", "bump"].contains(&key)
                    || ["KHR_", "map_"].iter().any(|start| key.starts_with(start));
                assert!(
                    foreign || known.iter().any(|k| k == key),
                    "formats/scene.md describes '{key}', which is not read"
                );
            }
        }
    }

    #[test]
    fn every_kind_of_light_refuses_the_keys_of_others() {
        let kinds = ["surface", "panel", "point", "spot", "sun", "suns", "ies", "environment"];
        for kind in kinds {
            let text = format!("geometry=[]\n[camera]\neye=[0,0,0]\n[[light]]\nkind=\"{kind}\"\n");
            let mut light = parse(Path::new("a"), &text).unwrap().light.remove(0);
            assert_eq!(light.kind.keys().0, kind);
            assert!(light.check_keys("here").is_ok());
            light.inner_degrees = Some(1.0);
            assert_eq!(light.check_keys("here").is_ok(), kind == "spot");
        }
    }
}
