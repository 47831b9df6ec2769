//! Lighting files: a mix as `ltm relight --lighting` reads it, and back.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::display::{CURVES, Display};
use super::groups::{Group, Groups};
use super::mixer::{LightMix, Mix, Tint};
use super::pattern::{Pattern, Shape};
use ltm::error::{Error, Result};
use ltm::files::write_file;
use ltm::image::{LinearImage, ToneMapping, luminance, read_image, write_exr};
use ltm::light::{Light, LightBasis, Lighting};
use ltm::look::{self, Look};

/// The content of a lighting file.
#[derive(Clone, Debug, PartialEq)]
pub struct Saved {
    /// State of the lights.
    pub mix: Mix,
    /// Snapshots by their names: further looks.
    pub snapshots: Vec<(String, Mix)>,
    /// Display settings.
    pub display: Option<Display>,
    /// An animation between the snapshots: seconds, and the name of a snapshot.
    pub keys: Vec<(f32, String)>,
}

impl Saved {
    /// A mix alone.
    pub fn of(mix: Mix) -> Self {
        Self { mix, snapshots: Vec::new(), display: None, keys: Vec::new() }
    }
}

/// Version of the window's part; a file without one is of version 1, whose groups are those of the lights' names.
const VERSION: u32 = 2;

/// What a lighting file holds for the window: how a mix makes the light that the rules say.
#[derive(Default, Deserialize, Serialize)]
struct WindowFile {
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    key: Vec<KeyPart>,
    #[serde(default)]
    mixer: Option<MixerPart>,
}

#[derive(Default, Deserialize, Serialize)]
struct MixerPart {
    #[serde(default)]
    version: u32,
    #[serde(default)]
    display: Option<DisplayPart>,
    #[serde(flatten)]
    mix: MixPart,
    #[serde(default)]
    snapshot: Vec<SnapshotPart>,
}

#[derive(Default, Deserialize, Serialize)]
struct MixPart {
    #[serde(default)]
    group: Vec<GroupPart>,
    #[serde(default)]
    light: Vec<LightPart>,
}

#[derive(Deserialize, Serialize)]
struct SnapshotPart {
    name: String,
    #[serde(flatten)]
    mix: MixPart,
}

#[derive(Deserialize, Serialize)]
struct DisplayPart {
    exposure_stops: f32,
    tone: String,
    white_kelvin: Option<f32>,
    #[serde(default)]
    false_colour: bool,
}

#[derive(Deserialize, Serialize)]
struct KeyPart {
    time_secs: f32,
    look: String,
}

#[derive(Deserialize, Serialize)]
struct GroupPart {
    name: String,
    on: bool,
    #[serde(default)]
    solo: bool,
    stops: f32,
    colour: Option<[u8; 3]>,
    parent: Option<String>,
    #[serde(default)]
    lights: Vec<String>,
}

#[derive(Deserialize, Serialize)]
struct LightPart {
    name: String,
    on: bool,
    solo: bool,
    stops: f32,
    kelvin: Option<f32>,
    linear: Option<[f32; 3]>,
    turn_radians: f32,
    /// File of the pattern before it is turned.
    texture: Option<String>,
    shape: Option<Shape>,
}

/// Reads a lighting file: its first look becomes the mix, further ones become snapshots. Each look is as the window
/// saved it if its light is still the same. Otherwise it follows from the rules of its light and the file's groups
/// alone.
///
/// Errors: those of [`look::load`].
pub fn load(path: &Path, basis: &LightBasis) -> Result<Saved> {
    let look = look::load(path, basis)?;
    let file = read_window_file(path);
    let part = file.mixer.unwrap_or_default();
    let read = |own: Option<&MixPart>, lighting: &Lighting| {
        let as_saved = own.and_then(|own| mix_of(own, part.version, path, basis));
        let same = |mix: &Mix| mix.lighting(basis).is_ok_and(|own| is_near(&own, lighting));
        as_saved.filter(same).unwrap_or_else(|| of_rules(&look, basis, lighting))
    };
    let mix = read(Some(&part.mix), look.lighting());
    let mut snapshots = Vec::new();
    for name in look.names() {
        let own = part.snapshot.iter().find(|snapshot| snapshot.name == name).map(|snapshot| &snapshot.mix);
        snapshots.push((name.to_owned(), read(own, look.named(name)?)));
    }
    let display = part.display.map(|display| Display {
        tone: ToneMapping {
            curve: CURVES.iter().find(|(_, name)| *name == display.tone).map_or(CURVES[0].0, |(curve, _)| *curve),
            exposure_stops: display.exposure_stops,
            white_kelvin: display.white_kelvin,
        },
        false_colour: display.false_colour,
    });
    let keys = file.key.into_iter().map(|key| (key.time_secs, key.look)).collect();
    Ok(Saved { mix, snapshots, display, keys })
}

/// A mix by its light alone, in the groups of the file's rules if it has any.
fn of_rules(look: &Look, basis: &LightBasis, lighting: &Lighting) -> Mix {
    let mut mix = Mix::of_lighting(basis, lighting);
    if !look.groups().is_empty() {
        let parts = look.groups().iter().map(|(name, columns)| {
            let is_own = |light: &Light| columns.binary_search(&light.first_column).is_ok();
            let lights = basis.lights().iter().enumerate().filter(|(_, light)| is_own(light)).map(|(i, _)| i);
            (Group::named(name), lights.collect())
        });
        mix.groups = Groups::from_parts(parts.collect(), basis.lights().len());
    }
    mix
}

/// The window's part of a file, empty where it has none that is understood.
fn read_window_file(path: &Path) -> WindowFile {
    let Ok(text) = std::fs::read_to_string(path) else { return WindowFile::default() };
    let json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    let file = if json { serde_json::from_str(&text).ok() } else { toml::from_str(&text).ok() };
    file.unwrap_or_default()
}

/// The mix that a file describes over these lights; none where it is of others.
fn mix_of(part: &MixPart, version: u32, path: &Path, basis: &LightBasis) -> Option<Mix> {
    let mut mix = Mix::of_scene(basis);
    let light_of: BTreeMap<&str, usize> =
        basis.lights().iter().enumerate().map(|(index, light)| (light.name.as_str(), index)).collect();
    if version < VERSION {
        for own in &part.group {
            let index = mix.groups.find(&own.name)?;
            let group = mix.groups.group_mut(index);
            (group.on, group.stops) = (own.on, own.stops);
        }
    } else {
        let index_of = |name: &String| part.group.iter().position(|group| group.name == *name);
        let parts = part.group.iter().map(|own| {
            let GroupPart { on, solo, stops, colour, .. } = *own;
            let group = Group { name: own.name.clone(), colour, on, solo, stops, parent: None };
            let lights = own.lights.iter().map(|name| light_of.get(name.as_str()).copied()).collect::<Option<_>>()?;
            Some((Group { parent: own.parent.as_ref().and_then(index_of), ..group }, lights))
        });
        mix.groups = Groups::from_parts(parts.collect::<Option<_>>()?, basis.lights().len());
    }
    for own in &part.light {
        let index = *light_of.get(own.name.as_str())?;
        let size = basis.lights()[index].layout();
        let pattern = match &own.texture {
            Some(name) => {
                let image = read_image(&path.with_file_name(name)).ok()?;
                let mut pattern = Pattern::white(size);
                let fits = (image.width, image.height) == size;
                fits.then(|| pattern.texels_mut().copy_from_slice(&image.pixels))?;
                Some(pattern)
            }
            None => None,
        };
        let tint = match (own.kelvin, own.linear) {
            (Some(kelvin), _) => Tint::Kelvin(kelvin),
            (None, Some(linear)) => Tint::Colour(linear),
            (None, None) => Tint::Scene,
        };
        let LightPart { on, solo, stops, turn_radians, shape, .. } = *own;
        mix.lights[index] = LightMix { on, solo, stops, tint, pattern, shape, turn_radians };
    }
    Some(mix)
}

/// Whether two lightings differ by no more than roundings on their way through a file.
fn is_near(a: &Lighting, b: &Lighting) -> bool {
    let peak = a.weights().iter().flatten().fold(0.0f32, |peak, v| peak.max(v.abs()));
    let pairs = a.weights().iter().flatten().zip(b.weights().iter().flatten());
    a.weights().len() == b.weights().len()
        && pairs.into_iter().all(|(a, b)| (a - b).abs() <= 1e-4 * a.abs() + 1e-6 * peak)
}

/// Writes a lighting file in TOML; the patterns of texelled lights become EXR files beside it, named after it and the
/// light.
///
/// In the rules, a light that does not shine for any reason is off, and the stops of groups are added to those of their
/// lights. A snapshot becomes a further look that states everything of every light. What the rules cannot express is in
/// a part that only the window reads. Without `overwrite` an existing file is left as it is. A file of another origin
/// with the name of a pattern is never replaced.
///
/// Errors: the system refuses; the file is there, and may not be replaced.
pub fn save(path: &Path, basis: &LightBasis, saved: &Saved, overwrite: bool) -> Result<()> {
    let mut file = FileMaker { path, basis, text: String::from("base = \"scene\"\n"), taken: foreign_files(path)? };
    if !overwrite && path.exists() {
        return Err(Error::input(path.display().to_string(), "exists already", "give another name"));
    }
    file.groups(&saved.mix.groups)?;
    let (mix, more) = file.mix(&saved.mix, None)?;
    let mut part = MixerPart { version: VERSION, mix, ..Default::default() };
    for (name, mix) in &saved.snapshots {
        line(&mut file.text, format_args!("\n[[look]]\nname = {}", quoted(name)));
        let (mix, _) = file.mix(mix, Some(name))?;
        part.snapshot.push(SnapshotPart { name: name.clone(), mix });
    }
    part.display = saved.display.map(|Display { tone, false_colour }| DisplayPart {
        exposure_stops: tone.exposure_stops,
        tone: CURVES.iter().find(|(curve, _)| *curve == tone.curve).map_or("", |(_, name)| *name).to_owned(),
        white_kelvin: tone.white_kelvin,
        false_colour,
    });
    let named = |key: &&(f32, String)| saved.snapshots.iter().any(|(name, _)| *name == key.1);
    let keys =
        saved.keys.iter().filter(named).map(|(time_secs, look)| KeyPart { time_secs: *time_secs, look: look.clone() });
    let more = more || part.display.is_some() || !part.snapshot.is_empty();
    let own = WindowFile { mixer: more.then_some(part), key: keys.collect() };
    let own = toml::to_string(&own).map_err(|error| file.refused(&error))?;
    write_file(path, overwrite, format!("{}\n{own}", file.text).as_bytes())
}

/// Names in the file's folder that begin as its patterns' names do, and are not of the file that stands there now.
fn foreign_files(path: &Path) -> Result<BTreeSet<String>> {
    let stem = stem_of(path);
    let before = std::fs::read_to_string(path).unwrap_or_default();
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder, "list"))?;
    let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    Ok(names.filter(|name| name.starts_with(&stem) && !before.contains(&quoted(name))).collect())
}

fn stem_of(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// A lighting file in the making.
struct FileMaker<'a> {
    path: &'a Path,
    basis: &'a LightBasis,
    text: String,
    /// Names beside the file that its patterns may not have.
    taken: BTreeSet<String>,
}

impl FileMaker<'_> {
    fn refused(&self, error: &dyn std::fmt::Display) -> Error {
        Error::input(self.path.display().to_string(), format!("cannot hold the mixer ({error})"), "")
    }

    /// The groups, each with all its lights, as rules may name them.
    fn groups(&mut self, groups: &Groups) -> Result<()> {
        #[derive(Serialize)]
        struct Part {
            groups: BTreeMap<String, Vec<String>>,
        }
        let name = |light: usize| self.basis.lights()[light].name.clone();
        // A light's name is no group's to a reader of rules.
        let own = (0..groups.len()).filter(|&group| self.basis.find(&groups.group(group).name).is_none());
        let entry = |group: usize| {
            (groups.group(group).name.clone(), groups.lights(group).into_iter().map(name).collect::<Vec<_>>())
        };
        let part = Part { groups: own.map(entry).collect() };
        if !part.groups.is_empty() && *groups != Groups::of(self.basis) {
            let text = toml::to_string(&part).map_err(|error| self.refused(&error))?;
            self.text += &format!("\n{text}");
        }
        Ok(())
    }

    /// Writes the rules of a mix, as those of a further look if it has a `name`. What they cannot say, and whether a reader of
    /// the rules alone would come to another mix.
    fn mix(&mut self, mix: &Mix, name: Option<&str>) -> Result<(MixPart, bool)> {
        let of_scene = Mix::of_scene(self.basis);
        let mut part = MixPart::default();
        let mut more = mix.groups != of_scene.groups;
        let prefix = name.map_or(String::new(), |name| format!("{name}-"));
        for (index, (light, own)) in self.basis.lights().iter().zip(&mix.lights).enumerate() {
            let (stops, shines) = (mix.stops(index), mix.shines(index));
            more |= own.solo || shines != own.on || own.turn_radians != 0.0 || own.shape.is_some();
            let untouched = own.is_like(&of_scene.lights[index]);
            let mut texture = None;
            if stops != 0.0 || shines != own.on || !untouched || name.is_some() {
                rule(&mut self.text, light, own, (stops, shines), name.is_some());
                if let Some(pattern) = &own.pattern {
                    let turned = pattern.turned(light.kind, own.turn_radians);
                    let file = self.texture(&format!("{prefix}{}", light.name), &turned)?;
                    line(&mut self.text, format_args!("image = {{ file = {} }}", quoted(&file)));
                    texture = match own.turn_radians {
                        0.0 => Some(file),
                        _ => Some(self.texture(&format!("{prefix}{}-unturned", light.name), pattern)?),
                    };
                }
            }
            if !untouched || own.solo {
                let (kelvin, linear) = match own.tint {
                    Tint::Scene => (None, None),
                    Tint::Kelvin(kelvin) => (Some(kelvin), None),
                    Tint::Colour(colour) => (None, Some(colour)),
                };
                let LightMix { on, solo, stops, turn_radians, shape, .. } = *own;
                let name = light.name.clone();
                part.light.push(LightPart { name, on, solo, stops, kelvin, linear, turn_radians, texture, shape });
            }
        }
        for (index, own) in mix.groups.list().iter().enumerate() {
            let Group { on, solo, stops, colour, .. } = *own;
            let names = mix.groups.own_lights(index).into_iter().map(|light| self.basis.lights()[light].name.clone());
            let parent = own.parent.map(|parent| mix.groups.group(parent).name.clone());
            let (name, lights) = (own.name.clone(), names.collect());
            part.group.push(GroupPart { name, on, solo, stops, colour, parent, lights });
        }
        Ok((part, more))
    }

    /// Writes a pattern beside the file; the name that it got.
    fn texture(&mut self, of: &str, pattern: &Pattern) -> Result<String> {
        let plain: String =
            of.chars().map(|c| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect();
        let mut name = format!("{}-{plain}.exr", stem_of(self.path));
        while !self.taken.insert(name.clone()) {
            name = format!("{}_.exr", name.trim_end_matches(".exr"));
        }
        let (width, height) = pattern.size();
        let image = LinearImage { width, height, pixels: pattern.texels().to_vec() };
        write_exr(&self.path.with_file_name(&name), &image)?;
        Ok(name)
    }
}

/// The text of a rule beside its image. The reader sets the colour at constant luminance, then multiplies by the stops.
/// The luminance is stated as well for a texelled light, so that the scene's own map does not show through, and for
/// lights of a further look (`whole`), which is applied after other rules.
fn rule(text: &mut String, light: &Light, own: &LightMix, (stops, shines): (f32, bool), whole: bool) {
    let colour = own.colour(light);
    let is_black = luminance(colour) <= 0.0;
    let table = if whole { "look.light" } else { "light" };
    line(text, format_args!("\n[[{table}]]\nname = {}", quoted(&light.name)));
    line(text, format_args!("on = {}", shines && !is_black));
    if whole && (!shines || is_black) {
        return;
    }
    let texelled = light.layout() != (1, 1) || whole;
    if texelled || luminance(light.emission) == 0.0 {
        line(text, format_args!("intensity = {:?}", luminance(colour)));
    }
    match own.tint {
        Tint::Kelvin(kelvin) => line(text, format_args!("color = {{ kelvin = {kelvin:?} }}")),
        Tint::Colour(colour) if !is_black => line(text, format_args!("color = {{ linear = {colour:?} }}")),
        Tint::Scene if texelled => line(text, format_args!("color = {{ linear = {colour:?} }}")),
        _ => {}
    }
    if stops != 0.0 {
        line(text, format_args!("stops = {stops:?}"));
    }
}

fn line(text: &mut String, arguments: std::fmt::Arguments) {
    writeln!(text, "{arguments}").expect("a string takes all that is written to it");
}

/// A text as TOML writes it.
fn quoted(text: &str) -> String {
    toml::Value::from(text).to_string()
}
