//! Images of single lights written by other programs: layers of an OpenEXR file, a file for each light, an array.
//!
//! [`LightSet::open`] reads only names and sizes. [`LightSet::read`] then gives the values row by row, so that a set
//! may be larger than memory.

mod array;
mod features;
mod files;
mod layers;
mod namings;
mod rewrite;
mod roles;
mod several;

use std::collections::{BTreeMap, HashSet};
use std::path::Path;

pub use features::FeaturePasses;
pub use rewrite::GiveRow;

use crate::error::{Error, Hint, Result, Warnings};
use crate::image::open_exr::Window;
use crate::resources::MemoryNeed;

/// Longest side of an image, in pixels.
const MAX_SIDE: u64 = 65_536;
/// Most lights of a set: each takes some hundred bytes of memory for its names alone.
const MAX_LIGHTS: usize = 1 << 18;

/// Bytes of the buffers before an array, and of the window of what is deflated.
const ARRAY_BUFFERS: u64 = 1 << 18;

/// An expression that tells which layers of an OpenEXR file are lights: the group `light`, else its first group, else all
/// of the match is the light's name. Syntax: that of the `regex-lite` crate.
#[derive(Clone, Debug)]
pub struct LayerPattern(regex_lite::Regex);

impl std::str::FromStr for LayerPattern {
    type Err = String;

    fn from_str(expression: &str) -> Result<Self, String> {
        regex_lite::Regex::new(expression)
            .map(Self)
            .map_err(|e| format!("'{expression}' is no regular expression ({e})"))
    }
}

impl LayerPattern {
    /// The light's name in a layer's, where the layer is a light.
    fn light(&self, layer: &str) -> Option<String> {
        let found = self.0.captures(layer)?;
        let light = found.name("light").or_else(|| found.get(1)).or_else(|| found.get(0))?.as_str();
        Some(light.to_owned()).filter(|light| !light.is_empty())
    }
}

/// Role of a layer, file or array.
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
    /// Name of the layer or file.
    pub layer: String,
    /// Its role.
    pub role: LayerRole,
}

/// A piece of a row of one channel of one image.
#[derive(Clone, Copy, Debug)]
pub struct LightRow<'a> {
    /// Index of the light; the number of lights for the image under all of them.
    pub image: usize,
    /// 0 red, 1 green, 2 blue.
    pub channel: usize,
    /// Column of the first value.
    pub x: usize,
    /// Row, counted from the top.
    pub y: usize,
    /// The values.
    pub values: &'a [f32],
}

/// Receives the rows.
pub type TakeRow<'a> = dyn FnMut(LightRow<'_>) -> Result<()> + Send + 'a;

/// A set of per-light images of one size.
#[derive(Clone, Debug)]
pub struct LightSet {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Names of the lights, in the order of the table of matches.
    pub lights: Vec<String>,
    /// Whether there is an image under all lights as well.
    pub has_sum: bool,
    /// The role of each layer.
    pub matches: Vec<LayerMatch>,
    /// What looks wrong with the choice of layers, one line each, for people.
    pub warnings: Warnings,
    source: Source,
}

#[derive(Clone, Debug)]
enum Source {
    Files(files::Files),
    Layers(layers::Layers),
    Several(several::Several),
    Array(array::ImageArray),
}

/// What [`LightSet::read`] takes.
impl MemoryNeed for LightSet {
    fn fixed_bytes(&self) -> u64 {
        let names: usize = self.matches.iter().map(|m| 2 * (m.layer.len() + size_of::<LayerMatch>())).sum();
        let reading = match &self.source {
            // One image at a time.
            Source::Files(files) => files.needs_bytes(),
            Source::Layers(layers) => layers.chunk_bytes(),
            Source::Several(several) => several.chunk_bytes(),
            Source::Array(_) => u64::from(self.width) * 64 + ARRAY_BUFFERS,
        };
        reading + 2 * names as u64
    }

    fn thread_bytes(&self) -> u64 {
        match &self.source {
            // Compressed, decompressed, and on the way between: twice, for planes of bytes and for their differences.
            Source::Layers(layers) => layers.chunk_bytes().saturating_mul(5),
            Source::Several(several) => several.chunk_bytes().saturating_mul(5),
            Source::Files(_) | Source::Array(_) => 0,
        }
    }
}

impl LightSet {
    /// Opens images of lights: a folder (each image file is a light), a file name with `{light}` instead of the
    /// light's name and `*` for any text, an NPY or NPZ file, an OpenEXR file with light groups, or a file name with `*` alone
    /// for several such files, which share the light groups of one rendering.
    ///
    /// `layers` selects the layers of an OpenEXR file that are lights. Without it, the conventions of Blender, Arnold, V-Ray, Corona,
    /// LuxCore, Karma, RenderMan, Redshift and Octane apply in this order, then any layer of three colours beside the one under all
    /// lights.
    ///
    /// # Errors
    /// What cannot be read, nothing that looks like a light, two lights of one name, images of different sizes, more
    /// lights than 262,144.
    pub fn open(path: &Path, layers: Option<&LayerPattern>) -> Result<Self> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        let set = match extension.as_deref() {
            _ if path.is_dir() => files::open(&path.join("{light}.*"))?,
            _ if path.to_string_lossy().contains("{light}") => files::open(path)?,
            _ if several::is_pattern(path) => several::open(path, layers)?,
            Some("npy" | "npz") => array::open(path)?,
            _ => layers::open(path, layers)?,
        };
        let refuse = |problem: String, hint: Hint| Err(Error::input(path.display().to_string(), problem, hint));
        if set.lights.is_empty() {
            return refuse("no layer looks like a light's".into(), Hint::ChooseLayersOrFiles);
        }
        if set.lights.len() > MAX_LIGHTS {
            return refuse(format!("it has {} lights", set.lights.len()), "give 262,144 at most".into());
        }
        set.check_names(path)?;
        Ok(set)
    }

    /// Gives lights other names: a light that `names` has gets the name that stands there. `path` is where the lights are, for
    /// messages.
    ///
    /// # Errors
    /// An empty name, two lights of one name, a name for a light that is not there.
    pub fn rename(&mut self, names: &BTreeMap<String, String>, path: &Path) -> Result<()> {
        let refuse = |problem: String, hint: &str| Err(Error::input(path.display().to_string(), problem, hint));
        if let Some(unknown) = names.keys().find(|name| !self.lights.contains(name)) {
            return refuse(format!("there is no light '{unknown}' to be renamed"), "name the lights as its layers do");
        }
        if let Some((old, _)) = names.iter().find(|(_, new)| new.is_empty()) {
            return refuse(format!("the new name of light '{old}' is empty"), "give it a name");
        }
        let renamed = |light: &mut String| {
            if let Some(name) = names.get(light) {
                light.clone_from(name);
            }
        };
        self.lights.iter_mut().for_each(renamed);
        for found in &mut self.matches {
            if let LayerRole::Light(light) = &mut found.role {
                renamed(light);
            }
        }
        self.check_names(path)
    }

    fn check_names(&self, path: &Path) -> Result<()> {
        let mut names = HashSet::new();
        let Some(light) = self.lights.iter().find(|light| !names.insert(light.as_str())) else { return Ok(()) };
        let hint = "name the layers by a narrower pattern";
        Err(Error::input(path.display().to_string(), format!("two layers are of light '{light}'"), hint))
    }

    /// Number of images: the lights, and the one under all of them where there is one.
    pub fn images(&self) -> usize {
        self.lights.len() + usize::from(self.has_sum)
    }

    /// Hands over every value, in the order of the files.
    ///
    /// # Errors
    /// A file that cannot be read or has changed; those of `take`.
    pub fn read(&self, take: &mut TakeRow<'_>) -> Result<()> {
        match &self.source {
            Source::Files(files) => files.read(take),
            Source::Layers(layers) => layers.read(take),
            Source::Several(several) => several.read(take),
            Source::Array(array) => array.read((self.width as usize, self.height as usize), take),
        }
    }
}

/// The size of a frame. Errors: one beyond what a picture can have.
fn size_of_frame(path: &Path, frame: &Window) -> Result<(u32, u32)> {
    let size = u32::try_from(frame.width).ok().zip(u32::try_from(frame.height).ok());
    size.filter(|size| u64::from(size.0.max(size.1)) <= MAX_SIDE).ok_or_else(|| {
        let hint = format!("give images of {MAX_SIDE} pixels a side at most");
        Error::input(path.display().to_string(), format!("its images would have {frame}"), hint)
    })
}

/// Hands over black for the pixels of a frame that an image does not have.
fn hand_over_black(image: usize, data: &Window, frame: &Window, take: &mut TakeRow<'_>) -> Result<()> {
    if data == frame {
        return Ok(());
    }
    let black = vec![0.0; frame.width as usize];
    for (x, y, length) in data.outside(frame) {
        (0..3).try_for_each(|channel| take(LightRow { image, channel, x, y, values: &black[..length] }))?;
    }
    Ok(())
}

/// Hands a row of RGB pixels over as three rows of one channel.
fn take_pixels(
    take: &mut TakeRow<'_>,
    (image, x, y): (usize, usize, usize),
    row: &[[f32; 3]],
    buffer: &mut Vec<f32>,
) -> Result<()> {
    for channel in 0..3 {
        buffer.clear();
        buffer.extend(row.iter().map(|pixel| pixel[channel]));
        take(LightRow { image, channel, x, y, values: buffer })?;
    }
    Ok(())
}
