//! Images of single lights as other programs write them: which layer of a file is which light.

use std::collections::BTreeMap;
use std::path::Path;

use exr::prelude::{FlatSamples, ReadChannels, ReadLayers};

use super::LinearImage;
use crate::error::{Error, Result};

/// The image of one light.
#[derive(Clone, Debug, PartialEq)]
pub struct LightImage {
    /// Name of the light.
    pub name: String,
    /// What it gives alone.
    pub image: LinearImage,
}

/// What a layer was taken for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LayerRole {
    /// The image of the light of this name.
    Light(String),
    /// The image under all lights.
    Sum,
    /// Nothing that is needed here.
    Ignored,
}

/// One row of the table of matches.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LayerMatch {
    /// Name of the layer in the file.
    pub layer: String,
    /// What it was taken for.
    pub role: LayerRole,
}

/// All that was found in a file or a set of files.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightImages {
    /// One image for each light, in the order of the table; all of one size.
    pub lights: Vec<LightImage>,
    /// The image under all lights, where there is one.
    pub sum: Option<LinearImage>,
    /// What each layer was taken for.
    pub matches: Vec<LayerMatch>,
}

/// Red, green and blue of a layer, as far as it has them: width, height, samples.
type Colours = [Option<(usize, usize, FlatSamples)>; 3];

/// Names that begin a light's layer, before the light's name: Blender, Arnold, V-Ray, LuxCore.
const PREFIXES: [&str; 7] =
    ["Combined_", "RGBA_", "VRayLightSelect_", "LightSelect_", "lightSelect_", "RADIANCE_GROUP_", "RADIANCE_GROUP#"];
/// Names of the layer under all lights.
const SUMS: [&str; 6] = ["", "Combined", "RGBA", "beauty", "RGB", "rgba"];
/// Passes of colours that are no light's, looked for where lights are known by no prefix.
const OTHER_PASSES: [&str; 16] = [
    "albedo", "denois", "noisy", "normal", "depth", "diff", "gloss", "emit", "env", "ao", "shadow", "uv", "vector",
    "position", "crypto", "mist",
];

/// Reads the light groups of an OpenEXR file, multi-part or interleaved. `pattern` names the layers of lights with
/// `{light}` in the light's place and `*` for anything; without it the conventions of Blender, Arnold, V-Ray and
/// LuxCore are tried, then any layer of three colours beside the one under all lights.
///
/// Errors: no OpenEXR file, no layer that matches, layers of different sizes.
pub fn read_light_layers(path: &Path, pattern: Option<&str>) -> Result<LightImages> {
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_file(path)
        .map_err(|e| match e {
            exr::error::Error::Io(io) => Error::io(path, "read")(io),
            other => {
                Error::input(path.display().to_string(), other.to_string(), "give an OpenEXR file with light groups")
            }
        })?;
    let mut planes: BTreeMap<String, Colours> = BTreeMap::new();
    for layer in image.layer_data {
        let part = layer.attributes.layer_name.map(|name| name.to_string()).unwrap_or_default();
        let size = (layer.size.x(), layer.size.y());
        for channel in layer.channel_data.list {
            let name = channel.name.to_string();
            // Blender's parts repeat their name in their channels' names.
            let full = if part.is_empty() || name.starts_with(&part) { name } else { format!("{part}.{name}") };
            let (layer, colour) = full.rsplit_once('.').unwrap_or(("", &full));
            let colour = ["R", "G", "B"].iter().position(|c| c.eq_ignore_ascii_case(colour));
            let planes = planes.entry(layer.to_owned()).or_default();
            if let Some(colour) = colour {
                planes[colour] = Some((size.0, size.1, channel.sample_data));
            }
        }
    }
    let colours: Vec<&str> =
        planes.iter().filter(|(_, p)| p.iter().all(Option::is_some)).map(|(name, _)| name.as_str()).collect();
    let roles = roles(&colours, pattern);
    let mut found = LightImages::default();
    for (name, planes) in &planes {
        let role = roles.get(name.as_str()).cloned().unwrap_or(LayerRole::Ignored);
        if role != LayerRole::Ignored {
            let image = interleave(path, name, planes)?;
            match &role {
                LayerRole::Light(light) => found.lights.push(LightImage { name: light.clone(), image }),
                LayerRole::Sum => found.sum = Some(image),
                LayerRole::Ignored => {}
            }
        }
        found.matches.push(LayerMatch { layer: name.clone(), role });
    }
    found.check(path)?;
    Ok(found)
}

impl LightImages {
    /// Errors: no lights, two of one name, images of different sizes.
    pub(super) fn check(&self, path: &Path) -> Result<()> {
        let refuse = |problem: String, hint: &str| Err(Error::input(path.display().to_string(), problem, hint));
        let Some(first) = self.lights.first() else {
            return refuse(
                "no layer looks like a light's".into(),
                "say which are with a pattern such as 'RGBA_{light}'",
            );
        };
        let size = (first.image.width, first.image.height);
        let images = self.lights.iter().map(|light| &light.image).chain(&self.sum);
        if images.into_iter().any(|image| (image.width, image.height) != size) {
            return refuse("its images differ in size".into(), "render all lights at one resolution");
        }
        for (i, light) in self.lights.iter().enumerate() {
            if self.lights[..i].iter().any(|other| other.name == light.name) {
                return refuse(
                    format!("two layers are of light '{}'", light.name),
                    "name the layers by a narrower pattern",
                );
            }
        }
        Ok(())
    }
}

/// What each layer of three colours is.
fn roles<'a>(layers: &[&'a str], pattern: Option<&str>) -> BTreeMap<&'a str, LayerRole> {
    // The part of a name after Blender's view layer.
    let last = |name: &'a str| name.rsplit_once('.').map_or(name, |(_, last)| last);
    let sum_or_ignored = |name: &'a str| {
        if SUMS.contains(&last(name)) { LayerRole::Sum } else { LayerRole::Ignored }
    };
    if let Some(pattern) = pattern {
        let role = |name| capture(pattern, name).map_or(sum_or_ignored(name), LayerRole::Light);
        return layers.iter().map(|&name| (name, role(name))).collect();
    }
    let by_prefix = |name: &'a str| {
        // A light's own name may hold dots, so the prefix is looked for after any of them.
        let starts = std::iter::once(0).chain(name.match_indices('.').map(|(at, _)| at + 1));
        let tails: Vec<&str> = starts.map(|at| &name[at..]).collect();
        let found = tails.iter().find_map(|tail| PREFIXES.iter().find_map(|prefix| tail.strip_prefix(prefix)));
        found.filter(|light| !light.is_empty())
    };
    if layers.iter().any(|&name| by_prefix(name).is_some()) {
        let role = |name| by_prefix(name).map_or(sum_or_ignored(name), |light| LayerRole::Light(light.to_owned()));
        return layers.iter().map(|&name| (name, role(name))).collect();
    }
    let role = |name: &'a str| {
        let lower = name.to_lowercase();
        // `env` alone is a light; `Env.Combined` or `environment pass` is not asked for by name.
        let other = OTHER_PASSES.iter().any(|pass| lower.contains(pass) && lower != "env");
        match sum_or_ignored(name) {
            LayerRole::Sum => LayerRole::Sum,
            _ if other => LayerRole::Ignored,
            _ => LayerRole::Light(name.to_owned()),
        }
    };
    layers.iter().map(|&name| (name, role(name))).collect()
}

/// What stands for `{light}` where `name` matches `pattern`; `*` stands for anything. `None`: it does not match.
pub fn capture(pattern: &str, name: &str) -> Option<String> {
    let (before, after) = pattern.split_once("{light}")?;
    (0..=name.len()).filter(|&start| name.is_char_boundary(start) && matches(before, &name[..start])).find_map(
        |start| {
            let mut ends = (start + 1..=name.len()).rev().filter(|&end| name.is_char_boundary(end));
            ends.find(|&end| matches(after, &name[end..])).map(|end| name[start..end].to_owned())
        },
    )
}

/// Whether `text` is what `pattern` says, `*` standing for anything.
fn matches(pattern: &str, text: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == text,
        Some((start, rest)) => text
            .strip_prefix(start)
            .is_some_and(|tail| (0..=tail.len()).any(|at| tail.is_char_boundary(at) && matches(rest, &tail[at..]))),
    }
}

fn interleave(path: &Path, name: &str, planes: &Colours) -> Result<LinearImage> {
    let [Some((width, height, red)), Some(green), Some(blue)] = planes else {
        return Err(Error::input(path.display().to_string(), format!("layer '{name}' has not three colours"), ""));
    };
    let mut pixels = vec![[0.0; 3]; width * height];
    for (channel, samples) in [red, &green.2, &blue.2].into_iter().enumerate() {
        if samples.len() != pixels.len() {
            let problem = format!("the colours of layer '{name}' differ in size");
            return Err(Error::input(path.display().to_string(), problem, "write them without subsampling"));
        }
        pixels.iter_mut().zip(samples.values_as_f32()).for_each(|(pixel, value)| pixel[channel] = value);
    }
    Ok(LinearImage { width: *width as u32, height: *height as u32, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lights(layers: &[&'static str], pattern: Option<&str>) -> Vec<String> {
        let roles = roles(layers, pattern);
        roles.into_values().filter_map(|r| if let LayerRole::Light(name) = r { Some(name) } else { None }).collect()
    }

    #[test]
    fn the_conventions_of_renderers_are_known() {
        let blender =
            ["ViewLayer.Combined", "ViewLayer.Combined_key", "ViewLayer.Combined_ceiling lamp", "ViewLayer.DiffDir"];
        assert_eq!(lights(&blender, None), ["ceiling lamp", "key"]);
        assert_eq!(lights(&["RGBA", "RGBA_key", "RGBA_fill", "albedo"], None), ["fill", "key"]);
        assert_eq!(lights(&["", "LightSelect_sun", "diffuseFilter"], None), ["sun"]);
        assert_eq!(lights(&["", "RADIANCE_GROUP_0", "RADIANCE_GROUP_1"], None), ["0", "1"]);
        assert_eq!(lights(&["", "env", "spot", "albedo"], None), ["env", "spot"]);
    }

    #[test]
    fn patterns_find_lights() {
        assert_eq!(capture("RGBA_{light}", "RGBA_key"), Some("key".into()));
        assert_eq!(capture("*.L_{light}_*", "main.L_key_x"), Some("key".into()));
        assert_eq!(capture("RGBA_{light}", "RGBA_"), None);
        assert_eq!(capture("RGBA_key", "RGBA_key"), None);
        assert_eq!(lights(&["a.x", "b.x", "c"], Some("{light}.x")), ["a", "b"]);
    }
}
