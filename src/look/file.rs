//! The text of a look file.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::error::{Error, Result};

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LookFile {
    #[serde(default)]
    pub base: Base,
    #[serde(default)]
    pub groups: BTreeMap<String, Vec<String>>,
    #[serde(default)]
    pub light: Vec<Rule>,
    #[serde(default)]
    pub look: Vec<NamedLook>,
    #[serde(default)]
    pub key: Vec<Key>,
    /// State of the window, which other readers ignore.
    #[serde(default, rename = "mixer")]
    pub _mixer: IgnoredAny,
}

#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq)]
#[serde(rename_all = "lowercase")]
pub(super) enum Base {
    #[default]
    Scene,
    Off,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NamedLook {
    pub name: String,
    #[serde(default)]
    pub light: Vec<Rule>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Key {
    pub time_secs: f32,
    pub look: String,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Rule {
    pub name: String,
    pub on: Option<bool>,
    pub stops: Option<f32>,
    pub intensity: Option<f32>,
    #[serde(default, deserialize_with = "color")]
    pub color: Option<Color>,
    pub image: Option<LookImage>,
    pub shape: Option<PatternShape>,
    pub environment: Option<Environment>,
    /// Puts the whole light on the one column that lies nearest to this direction towards the light.
    pub sun: Option<[f32; 3]>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum Color {
    Srgb(String),
    Linear([f32; 3]),
    Kelvin(f32),
}

/// Reads a colour; whatever else stands there, the error says what may.
fn color<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Option<Color>, D::Error> {
    #[derive(Deserialize)]
    #[serde(
        untagged,
        expecting = "a colour is { kelvin = 2700 }, { srgb = \"#ffcc88\" } or { linear = [1, 0.8, 0.5] }"
    )]
    enum Meant {
        Color(Color),
    }
    Meant::deserialize(deserializer).map(|Meant::Color(color)| Some(color))
}

/// An image over the light's texels; `place` is (left, top, right, bottom) in the light's unit square.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LookImage {
    pub file: String,
    #[serde(default = "whole")]
    pub place: [f32; 4],
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum PatternShape {
    Disc { center: [f32; 2], radius: f32 },
    Rectangle { center: [f32; 2], size: [f32; 2] },
    Gradient { from: [f32; 2], to: [f32; 2] },
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Environment {
    pub file: String,
    #[serde(default)]
    pub rotation_degrees: f32,
    #[serde(default)]
    pub stops: f32,
}

fn whole() -> [f32; 4] {
    [0.0, 0.0, 1.0, 1.0]
}

pub(super) fn parse_toml(place: &str, text: &str) -> Result<LookFile> {
    toml::from_str(text).map_err(|e| {
        let line = e.span().map_or(1, |span| text[..span.start.min(text.len())].lines().count().max(1));
        Error::input(format!("{place}, line {line}"), one_line(e.message()), "")
    })
}

pub(super) fn parse_json(place: &str, text: &str) -> Result<LookFile> {
    serde_json::from_str(text).map_err(|e| Error::input(place, one_line(&e.to_string()), ""))
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_documented_example_is_read_word_for_word() {
        let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/formats/look.md")).unwrap();
        let example = text.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
        let file = parse_toml("formats/look.md", example).unwrap();
        assert_eq!((file.light.len(), file.look.len(), file.key.len()), (3, 2, 2));
        for key in ["name", "on", "color", "intensity", "stops", "shape", "image", "environment", "sun"] {
            assert!(text.contains(&format!("| `{key}` |")), "`{key}` is not in the table");
        }
    }
}
