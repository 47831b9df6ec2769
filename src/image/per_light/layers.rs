//! Light groups in OpenEXR files: which layer is which light.

use std::collections::BTreeMap;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use exr::block::reader::ChunksReader;
use exr::block::{self, UncompressedBlock};
use exr::meta::MetaData;
use exr::prelude::{SampleType, f16};
use rayon::prelude::*;

use super::{LayerMatch, LayerPattern, LayerRole, LightRow, LightSet, Source, TakeRow};
use crate::error::{Error, Result};
use crate::files::open_input;

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

/// Where the images stand in a file.
#[derive(Clone, Debug)]
pub(super) struct Layers {
    path: PathBuf,
    /// For each part and channel of the file, the image and colour that it is, where it is one.
    places: Vec<Vec<Option<(usize, usize)>>>,
    chunk_bytes: u64,
}

/// Where a colour of a layer stands: part, channel.
type Places = [Option<(usize, usize)>; 3];

/// Looks at the layers of an OpenEXR file, multi-part or interleaved.
pub(super) fn open(path: &Path, pattern: Option<&LayerPattern>) -> Result<LightSet> {
    let refuse = |problem: String, hint: &str| Error::input(path.display().to_string(), problem, hint);
    open_input(path, "open")?;
    let meta = MetaData::read_from_file(path, false).map_err(|e| failed(path, e))?;
    let mut planes: BTreeMap<String, Places> = BTreeMap::new();
    for Channel { layer, name, part, index } in channels(&meta) {
        let colour = ["R", "G", "B"].iter().position(|c| c.eq_ignore_ascii_case(&name));
        let planes = planes.entry(layer).or_default();
        if let Some(colour) = colour {
            planes[colour] = Some((part, index));
        }
    }
    let colours: Vec<&str> =
        planes.iter().filter(|(_, p)| p.iter().all(Option::is_some)).map(|(name, _)| name.as_str()).collect();
    let roles = roles(&colours, pattern);
    let chosen = sum_of(&roles).map_err(|[first, second]| {
        let problem = format!("'{first}' and '{second}' are each the image under some of the lights");
        refuse(problem, "name the layers of one view layer with --layers")
    })?;
    let (mut matches, mut lights, mut images, mut sum) = (Vec::new(), Vec::new(), Vec::new(), None);
    for (name, planes) in &planes {
        let role = roles.get(name.as_str()).cloned().unwrap_or(LayerRole::Ignored);
        match &role {
            LayerRole::Light(light) => {
                lights.push(light.clone());
                images.push((name, planes));
            }
            LayerRole::Sum if chosen == Some(name) => sum = Some((name, planes)),
            LayerRole::Sum | LayerRole::Ignored => {}
        }
        let role = if role == LayerRole::Sum && chosen != Some(name) { LayerRole::Ignored } else { role };
        matches.push(LayerMatch { layer: name.clone(), role });
    }
    images.extend(sum);
    let mut places: Vec<Vec<Option<(usize, usize)>>> =
        meta.headers.iter().map(|header| vec![None; header.channels.list.len()]).collect();
    let mut window = None;
    for (image, (name, planes)) in images.iter().enumerate() {
        for (colour, place) in planes.iter().enumerate() {
            let (part, channel) = place.expect("roles are given to layers of three colours only");
            let header = &meta.headers[part];
            let here = (header.layer_size, header.own_attributes.layer_position);
            if *window.get_or_insert(here) != here {
                let problem = format!("layer '{name}' covers another part of the picture than the layers before it");
                return Err(refuse(problem, "write all layers with one data window"));
            }
            let channel_of = &header.channels.list[channel];
            if (channel_of.sampling.0, channel_of.sampling.1) != (1, 1) {
                return Err(refuse(format!("layer '{name}' is subsampled"), "write it without subsampling"));
            }
            places[part][channel] = Some((image, colour));
        }
    }
    let size = window.map_or((0, 0), |(size, _)| (size.x() as u32, size.y() as u32));
    let chunk_bytes = chunk_bytes(&meta);
    Ok(LightSet {
        width: size.0,
        height: size.1,
        lights,
        has_sum: sum.is_some(),
        matches,
        warnings: Vec::new(),
        source: Source::Layers(Layers { path: path.to_owned(), places, chunk_bytes }),
    })
}

/// What a renderer's passes say of the surfaces in view: albedo, normal, depth.
const FEATURES: [(&str, &[&str]); 3] = [("albedo", &["R", "G", "B"]), ("normal", &["X", "Y", "Z"]), ("depth", &["Z"])];

/// Where albedo (image 0), normal (1) and depth (2) stand in an OpenEXR file, as far as it has them, and its size. Passes made for
/// denoisers come first; else the layer of the shortest name.
pub(super) fn open_features(path: &Path) -> Result<Option<(Layers, (u32, u32))>> {
    open_input(path, "open")?;
    let meta = MetaData::read_from_file(path, false).map_err(|e| failed(path, e))?;
    let channels = channels(&meta);
    let mut places: Vec<Vec<Option<(usize, usize)>>> =
        meta.headers.iter().map(|header| vec![None; header.channels.list.len()]).collect();
    let mut size = None;
    for (image, (word, names)) in FEATURES.iter().enumerate() {
        let mut layers: Vec<&str> = channels.iter().map(|channel| channel.layer.as_str()).collect();
        layers.retain(|layer| layer.to_lowercase().contains(word));
        layers.sort_by_key(|layer| (!layer.to_lowercase().contains("denois"), layer.len(), *layer));
        let Some(&layer) = layers.first() else { continue };
        let of_layer: Vec<&Channel> = channels.iter().filter(|channel| channel.layer == layer).collect();
        for (index, name) in names.iter().enumerate() {
            // Normals may be stored as colours, and a depth alone under any name.
            let is_named = |channel: &&&Channel| {
                let is = |name: &str| channel.name.eq_ignore_ascii_case(name);
                is(name)
                    || (*word == "normal" && is(["R", "G", "B"][index]))
                    || (names.len() == 1 && of_layer.len() == 1)
            };
            let Some(found) = of_layer.iter().find(is_named) else { continue };
            let header = &meta.headers[found.part];
            let here = (header.layer_size.x() as u32, header.layer_size.y() as u32);
            if *size.get_or_insert(here) == here {
                places[found.part][found.index] = Some((image, index));
            }
        }
    }
    let chunk_bytes = chunk_bytes(&meta);
    Ok(size.map(|size| (Layers { path: path.to_owned(), places, chunk_bytes }, size)))
}

/// A channel of a file.
struct Channel {
    /// What stands before the last dot of its name.
    layer: String,
    name: String,
    part: usize,
    index: usize,
}

/// The channels of the parts that are flat pictures.
fn channels(meta: &MetaData) -> Vec<Channel> {
    let mut channels = Vec::new();
    for (part, header) in meta.headers.iter().enumerate().filter(|(_, header)| !header.deep) {
        let name = header.own_attributes.layer_name.as_ref().map(ToString::to_string).unwrap_or_default();
        for (index, channel) in header.channels.list.iter().enumerate() {
            let channel = channel.name.to_string();
            // Blender's parts repeat their name in their channels' names.
            let repeats = name.is_empty() || channel.starts_with(&name);
            let full = if repeats { channel } else { format!("{name}.{channel}") };
            let (layer, name) = full.rsplit_once('.').unwrap_or(("", &full));
            channels.push(Channel { layer: layer.to_owned(), name: name.to_owned(), part, index });
        }
    }
    channels
}

fn chunk_bytes(meta: &MetaData) -> u64 {
    meta.headers.iter().map(|header| header.max_block_byte_size() as u64).max().unwrap_or(0)
}

impl Layers {
    /// Bytes of the largest chunk of the file.
    pub(super) fn chunk_bytes(&self) -> u64 {
        self.chunk_bytes
    }

    /// Reads the chunks of the file that hold images, in the order of the file.
    pub(super) fn read(&self, take: &mut TakeRow<'_>) -> Result<()> {
        let file = BufReader::new(open_input(&self.path, "open")?);
        let reader = block::read(file, false).map_err(|e| failed(&self.path, e))?;
        if reader.headers().iter().map(|h| h.channels.list.len()).ne(self.places.iter().map(Vec::len)) {
            let place = self.path.display().to_string();
            return Err(Error::input(place, "changed while it was read", "run the command again"));
        }
        let wanted = |part: usize| self.places[part].iter().any(Option::is_some);
        let mut chunks = reader
            .filter_chunks(false, |_, tile, block| {
                wanted(block.layer) && (tile.level_index.0, tile.level_index.1) == (0, 0)
            })
            .map_err(|e| failed(&self.path, e))?;
        let meta = chunks.meta_data().clone();
        let mut values = Vec::new();
        // As many chunks at a time as there are threads to decompress them: the library's own way takes a thread for each
        // core, and more chunks than that, whatever the pool.
        loop {
            let batch: Vec<_> = chunks.by_ref().take(rayon::current_num_threads()).collect();
            if batch.is_empty() {
                return Ok(());
            }
            let decompressed = |chunk: exr::error::Result<_>| UncompressedBlock::decompress_chunk(chunk?, &meta, false);
            let blocks: Vec<_> = batch.into_par_iter().map(decompressed).collect();
            for block in blocks {
                self.hand_over(&meta, &block.map_err(|e| failed(&self.path, e))?, &mut values, take)?;
            }
        }
    }

    fn hand_over(
        &self,
        meta: &MetaData,
        block: &UncompressedBlock,
        values: &mut Vec<f32>,
        take: &mut TakeRow<'_>,
    ) -> Result<()> {
        let channels = &meta.headers[block.index.layer].channels;
        for line in block.lines(channels) {
            let Some((image, channel)) = self.places[block.index.layer][line.location.channel] else { continue };
            values.clear();
            let (x, y) = (line.location.position.x(), line.location.position.y());
            let read = match channels.list[line.location.channel].sample_type {
                SampleType::F16 => line.read_samples::<f16>().try_for_each(|v| v.map(|v| values.push(v.to_f32()))),
                SampleType::F32 => line.read_samples::<f32>().try_for_each(|v| v.map(|v| values.push(v))),
                SampleType::U32 => line.read_samples::<u32>().try_for_each(|v| v.map(|v| values.push(v as f32))),
            };
            read.map_err(|e| failed(&self.path, e))?;
            take(LightRow { image, channel, x, y, values })?;
        }
        Ok(())
    }
}

fn failed(path: &Path, error: exr::error::Error) -> Error {
    match error {
        exr::error::Error::Io(io) => Error::io(path, "read")(io),
        other => Error::input(path.display().to_string(), other.to_string(), "give an OpenEXR file with light groups"),
    }
}

/// Of the layers that show all lights, the one that shows the lights found: a file may have a view layer of them, a composite
/// and others beside it. Each light belongs to the sum with the longest path of names before it.
///
/// # Errors
/// Two sums that each have lights.
fn sum_of<'a>(roles: &BTreeMap<&'a str, LayerRole>) -> Result<Option<&'a str>, [&'a str; 2]> {
    let path = |name: &'a str| name.rsplit_once('.').map_or("", |(path, _)| path);
    let sums: Vec<&str> = roles.iter().filter(|(_, role)| **role == LayerRole::Sum).map(|(&name, _)| name).collect();
    let owns = |sum: &'a str, light: &str| {
        let path = path(sum);
        path.is_empty() || light.strip_prefix(path).is_some_and(|rest| rest.starts_with('.'))
    };
    let mut chosen: Option<&str> = None;
    for (light, _) in roles.iter().filter(|(_, role)| matches!(role, LayerRole::Light(_))) {
        let owner = sums.iter().copied().filter(|sum| owns(sum, light)).max_by_key(|sum| path(sum).len());
        match (chosen, owner) {
            (Some(first), Some(second)) if path(first) != path(second) => return Err([first, second]),
            (None, Some(_)) => chosen = owner,
            _ => {}
        }
    }
    Ok(chosen.or(sums.last().copied()))
}

/// What each layer of three colours is.
fn roles<'a>(layers: &[&'a str], pattern: Option<&LayerPattern>) -> BTreeMap<&'a str, LayerRole> {
    // The part of a name after Blender's view layer.
    let last = |name: &'a str| name.rsplit_once('.').map_or(name, |(_, last)| last);
    let sum_or_ignored = |name: &'a str| {
        if SUMS.contains(&last(name)) { LayerRole::Sum } else { LayerRole::Ignored }
    };
    if let Some(pattern) = pattern {
        let role = |name| pattern.light(name).map_or(sum_or_ignored(name), LayerRole::Light);
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

#[cfg(test)]
mod tests {
    use super::*;

    fn lights(layers: &[&'static str], pattern: Option<&str>) -> Vec<String> {
        let pattern = pattern.map(|pattern| pattern.parse().unwrap());
        let roles = roles(layers, pattern.as_ref());
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
    fn the_image_under_all_lights_is_that_of_their_view_layer() {
        let sum = |layers: &[&'static str]| sum_of(&roles(layers, None)).map(|sum| sum.map(str::to_owned));
        let composite = ["Composite.Combined", "View.Combined", "View.Combined_a.b", "View.Combined_c"];
        assert_eq!(sum(&composite), Ok(Some("View.Combined".into())));
        assert_eq!(sum(&["Z.Combined", "View.Combined", "View.Combined_a"]), Ok(Some("View.Combined".into())));
        assert_eq!(sum(&["RGBA", "RGBA_key", "RGBA_fill"]), Ok(Some("RGBA".into())));
        assert_eq!(sum(&["RGBA_key"]), Ok(None));
        let two = ["A.Combined", "A.Combined_a", "B.Combined", "B.Combined_b"];
        assert_eq!(sum(&two), Err(["A.Combined", "B.Combined"]));
    }

    #[test]
    fn expressions_find_lights() {
        assert_eq!(lights(&["a.x", "b.x", "c"], Some(r"^(.)\.x$")), ["a", "b"]);
        assert_eq!(lights(&["main.L_key_x", "main.L_fill_x"], Some("L_(?<light>[a-z]+)_(x)")), ["fill", "key"]);
        assert_eq!(lights(&["key", "fill", "RGBA"], Some("key|fill")), ["fill", "key"], "no group: all of the match");
    }
}
