//! Looks: lightings as a designer writes them, in TOML or JSON.
//!
//! ```toml
//! base = "scene"                      # what lights have that no rule names: "scene" or "off"
//! [groups]
//! ceiling = ["lamp 1*", "lamp 2*"]    # names, or globs with * and ?
//!
//! [[light]]                           # rules, the later over the earlier
//! name = "ceiling"                    # a light, a glob or a group
//! stops = -1.0
//! color = { kelvin = 2700 }           # or srgb = "#ffcc88", or linear = [1, 0.8, 0.5]
//! [[light]]
//! name = "panel"
//! intensity = 40.0                    # luminance of the weight, in the light's unit
//! shape = { kind = "disc", center = [0.5, 0.5], radius = 0.2 }   # or image = { file = "pattern.png" }
//! [[light]]
//! name = "sky"
//! environment = { file = "studio.hdr", rotation_degrees = 30, stops = 0 }
//! [[light]]
//! name = "sun *"
//! sun = [0.3, 0.8, -0.5]              # of several suns, the one nearest to this direction; of a sky, its texel there
//!
//! [[look]]                            # further looks by name, on top of the rules above
//! name = "night"
//! [[look.light]]
//! name = "*"
//! on = false
//!
//! [[key]]                             # an animation between looks
//! time_secs = 0
//! look = "night"
//! ```
//!
//! A colour sets the chromaticity and leaves the luminance; a mask or image multiplies; stops come last.
//!
//! # Example
//!
//! ```no_run
//! use std::path::Path;
//!
//! let matrix = ltm::open("room.ltc")?;
//! let looks = ltm::look::load(Path::new("evening.toml"), matrix.basis())?;
//! let night = matrix.relight(looks.named("night")?)?;
//! # Ok::<(), ltm::Error>(())
//! ```

mod file;
mod pattern;
mod resolve;

use std::path::Path;

use crate::error::{Error, Result};
use crate::files::{FileAccess, read_input_text};
use crate::light::names::suggest;
use crate::light::{LightBasis, Lighting};

/// Bytes of a look file at most.
const MAX_TEXT_BYTES: u64 = 16 << 20;
/// Frames that rounding of the keys' times may take off a whole number, at least.
const ROUNDING_FRAMES: f64 = 1e-3;
/// Most memory that the lightings of a file may take.
const MAX_LIGHTING_BYTES: u64 = 1 << 30;
/// Most memory that reading an image may take.
const MAX_IMAGE_BYTES: u64 = 4 << 30;

/// The lightings of a look file over one light basis.
#[derive(Clone, Debug)]
pub struct Look {
    place: String,
    lighting: Lighting,
    named: Vec<(String, Lighting)>,
    /// Time and index of a named look.
    keys: Vec<(f32, usize)>,
    groups: Vec<(String, Vec<u32>)>,
    notes: Vec<String>,
}

/// Reads a look file (JSON if its name ends so, else TOML) for a light basis. Images are found beside the file; those
/// that lie neither in its folder nor in that of `LTM_SCENES` are refused.
///
/// # Errors
/// A file that cannot be read, unknown keys, names that fit no light (with the nearest names), values out of
/// range, images that cannot be read.
pub fn load(path: &Path, basis: &LightBasis) -> Result<Look> {
    load_within(path, basis, &FileAccess::of(path))
}

/// As [`load`], with images from anywhere: for a file whose author is trusted.
///
/// # Errors
/// Those of [`load`].
pub fn load_reaching_outside(path: &Path, basis: &LightBasis) -> Result<Look> {
    load_within(path, basis, &FileAccess::everywhere())
}

fn load_within(path: &Path, basis: &LightBasis, reach: &FileAccess) -> Result<Look> {
    let place = path.display().to_string();
    let text = read_input_text(path, "read the look", MAX_TEXT_BYTES)?;
    let json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    let file = if json { file::parse_json(&place, &text) } else { file::parse_toml(&place, &text) }?;
    resolve::resolve(&place, path.parent().unwrap_or(Path::new("")), reach, &file, basis)
}

impl Look {
    /// The look of the file's own rules.
    pub fn lighting(&self) -> &Lighting {
        &self.lighting
    }

    /// Names of the further looks, in the file's order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.named.iter().map(|(name, _)| name.as_str())
    }

    /// The look of this name.
    ///
    /// # Errors
    /// There is none (with the nearest names).
    pub fn named(&self, name: &str) -> Result<&Lighting> {
        match self.named.iter().find(|(has, _)| has == name) {
            Some((_, lighting)) => Ok(lighting),
            None => {
                let problem = format!("has no look '{name}'");
                Err(Error::input(&self.place, problem, suggest(name, self.names())))
            }
        }
    }

    /// What was done to the values of its images that could surprise, one line each, for people.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The groups of the file in the order of their names, each with the columns of its lights; a light of several
    /// groups is counted with the first.
    pub fn groups(&self) -> &[(String, Vec<u32>)] {
        &self.groups
    }

    /// The lightings at the keys: no frame of the animation has more on any column than the brightest of them.
    pub fn keys(&self) -> impl Iterator<Item = &Lighting> {
        self.keys.iter().map(|&(_, look)| &self.named[look].1)
    }

    /// The animation between the keys, see [`Frames::new`]; empty without keys.
    ///
    /// # Errors
    /// Those of [`Frames::new`].
    pub fn frames(&self, frames_per_sec: f32) -> Result<Frames<'_>> {
        let keys = self.keys.iter().map(|&(time, look)| (time, &self.named[look].1)).collect();
        Frames::new(&self.place, keys, frames_per_sec)
    }

    /// Bytes of memory that its lightings hold.
    pub fn bytes(&self) -> u64 {
        ((self.named.len() + 1) * self.lighting.weights().len() * size_of::<[f32; 3]>()) as u64
    }
}

/// The frames of an animation between lightings, each made when it is asked for.
#[derive(Clone, Debug)]
pub struct Frames<'a> {
    place: &'a str,
    /// Times in seconds, rising, with the lightings then.
    keys: Vec<(f32, &'a Lighting)>,
    frames_per_sec: f32,
    count: usize,
}

impl<'a> Frames<'a> {
    /// `frames_per_sec` lightings a second from the first key to the last: weights between keys are blended linearly. Keys are
    /// lightings with their times in seconds, each later than the one before; `place` names them in errors.
    ///
    /// # Errors
    /// A rate that is not positive, or more than 100,000 frames.
    pub fn new(place: &'a str, keys: Vec<(f32, &'a Lighting)>, frames_per_sec: f32) -> Result<Self> {
        let count = match (keys.first(), keys.last()) {
            // Seconds like 0.9 are no binary fractions: the last key counts where rounding alone puts it between two frames.
            (Some((begin, _)), Some((end, _))) => {
                let (begin, end, rate) = (f64::from(*begin), f64::from(*end), f64::from(frames_per_sec));
                let rounding = (end.abs() * f64::from(f32::EPSILON) * rate).max(ROUNDING_FRAMES);
                ((end - begin) * rate + rounding).floor() + 1.0
            }
            _ => 0.0,
        };
        if !(frames_per_sec > 0.0 && count <= 100_000.0) {
            return Err(Error::input(place, format!("{frames_per_sec} frames a second cannot be made"), ""));
        }
        Ok(Self { place, keys, frames_per_sec, count: count as usize })
    }

    /// Number of frames.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The lighting of a frame, counted from 0.
    ///
    /// # Errors
    /// There is no such frame; a weight that is not finite.
    pub fn lighting(&self, frame: usize) -> Result<Lighting> {
        if frame >= self.count {
            let problem = format!("has no frame {frame}, but 0..{}", self.count);
            return Err(Error::input(self.place, problem, ""));
        }
        self.at(self.keys[0].0 + frame as f32 / self.frames_per_sec)
    }

    /// The animation at a time within its keys.
    fn at(&self, time_secs: f32) -> Result<Lighting> {
        let after = self.keys.partition_point(|(time, _)| *time <= time_secs).clamp(1, self.keys.len());
        let (begin, from) = self.keys[after - 1];
        let Some(&(end, to)) = self.keys.get(after) else { return Ok(from.clone()) };
        let part = (time_secs - begin) / (end - begin);
        let pairs = from.weights().iter().zip(to.weights());
        Lighting::new(pairs.map(|(a, b)| [0, 1, 2].map(|ch: usize| a[ch] * (1.0 - part) + b[ch] * part)).collect())
    }
}
