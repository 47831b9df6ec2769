//! Lighting files: a mix as `ltm relight --lighting` reads it, and back.

use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::groups::Groups;
use super::mixer::{GroupMix, LightMix, Mix, Tint};
use super::pattern::{Pattern, Shape};
use ltm::error::{Error, Result};
use ltm::files::write_file;
use ltm::image::{LinearImage, luminance, read_image, write_exr};
use ltm::light::{Light, LightBasis, Lighting};
use ltm::look;

/// What a lighting file holds for the window: how a mix makes the light that the rules say.
#[derive(Deserialize, Serialize)]
struct MixerFile {
    mixer: MixerPart,
}

#[derive(Default, Deserialize, Serialize)]
struct MixerPart {
    #[serde(default)]
    group: Vec<GroupPart>,
    #[serde(default)]
    light: Vec<LightPart>,
}

#[derive(Deserialize, Serialize)]
struct GroupPart {
    name: String,
    on: bool,
    stops: f32,
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

/// Reads the first look of a lighting file as a mix: as the window that wrote it had it, if the light is still the same,
/// else with what its light alone tells.
///
/// Errors: those of [`look::load`].
pub fn load(path: &Path, basis: &LightBasis, groups: &Groups) -> Result<Mix> {
    let lighting = look::load(path, basis)?.lighting().clone();
    let as_saved = read_mixer(path).and_then(|part| mix_of(&part, path, basis, groups));
    let same = |mix: &Mix| mix.lighting(basis, groups).is_ok_and(|own| is_near(&own, &lighting));
    Ok(as_saved.filter(same).unwrap_or_else(|| Mix::of_lighting(basis, groups, &lighting)))
}

/// The window's part of a file, if it has one that is understood.
fn read_mixer(path: &Path) -> Option<MixerPart> {
    let text = std::fs::read_to_string(path).ok()?;
    let json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    let file: Option<MixerFile> = if json { serde_json::from_str(&text).ok() } else { toml::from_str(&text).ok() };
    file.map(|file| file.mixer)
}

/// The mix that a file describes over these lights; none where it is of others.
fn mix_of(part: &MixerPart, path: &Path, basis: &LightBasis, groups: &Groups) -> Option<Mix> {
    let mut mix = Mix::of_scene(basis, groups);
    for own in &part.group {
        let index = (0..groups.len()).find(|&index| groups.group(index).name == own.name)?;
        mix.groups[index] = GroupMix { on: own.on, stops: own.stops };
    }
    for own in &part.light {
        let index = basis.lights().iter().position(|light| light.name == own.name)?;
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

/// Writes the mix as a lighting file in TOML; the patterns of texelled lights become EXR files beside it, named after
/// it and the light. In the rules, what does not shine, for whatever reason, is off, and a group's stops are added to those
/// of its lights; what the rules cannot say stands in a part that only the window reads.
///
/// Errors: the system refuses.
pub fn save(path: &Path, basis: &LightBasis, groups: &Groups, mix: &Mix) -> Result<()> {
    let mut text = String::from("base = \"scene\"\n");
    let mut taken = BTreeSet::new();
    let mut part = MixerPart::default();
    // Whether a reader of the rules alone would come to another mix.
    let mut more = false;
    let of_scene = Mix::of_scene(basis, groups);
    for (index, (light, own)) in basis.lights().iter().zip(&mix.lights).enumerate() {
        let stops = own.stops + groups.of_light(index).map_or(0.0, |group| mix.groups[group].stops);
        let shines = mix.shines(index, groups);
        more |= own.solo || shines != own.on || own.turn_radians != 0.0 || own.shape.is_some();
        let untouched = own.is_like(&of_scene.lights[index]);
        let mut texture = None;
        if stops != 0.0 || shines != own.on || !untouched {
            rule(&mut text, light, own, stops, shines);
            if let Some(pattern) = &own.pattern {
                let name = texture_name(path, &light.name, &mut taken);
                write_texture(&path.with_file_name(&name), &pattern.turned(light.kind, own.turn_radians))?;
                line(&mut text, format_args!("image = {{ file = {} }}", quoted(&name)));
                texture = Some(name);
                if own.turn_radians != 0.0 {
                    let unturned = texture_name(path, &format!("{}-unturned", light.name), &mut taken);
                    write_texture(&path.with_file_name(&unturned), pattern)?;
                    texture = Some(unturned);
                }
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
    for (index, own) in mix.groups.iter().enumerate().filter(|(_, own)| **own != GroupMix::default()) {
        more = true;
        part.group.push(GroupPart { name: groups.group(index).name.clone(), on: own.on, stops: own.stops });
    }
    if more {
        let part = toml::to_string(&MixerFile { mixer: part });
        let part = part.map_err(|error| {
            Error::input(path.display().to_string(), format!("cannot hold the mixer ({error})"), "")
        })?;
        text = format!("{text}\n{part}");
    }
    write_file(path, true, text.as_bytes())
}

fn write_texture(path: &Path, pattern: &Pattern) -> Result<()> {
    let (width, height) = pattern.size();
    let image = LinearImage { width, height, pixels: pattern.texels().to_vec() };
    write_exr(path, &image)
}

/// What a rule says beside its image. The reader sets the colour at constant luminance, then multiplies by the stops;
/// a texelled light is given its luminance too, so that a map of the scene's own does not shine through.
fn rule(text: &mut String, light: &Light, own: &LightMix, stops: f32, shines: bool) {
    let colour = own.colour(light);
    let is_black = luminance(colour) <= 0.0;
    line(text, format_args!("\n[[light]]\nname = {}", quoted(&light.name)));
    line(text, format_args!("on = {}", shines && !is_black));
    let texelled = light.layout() != (1, 1);
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

/// A free name, beside the lighting file, for a light's texture.
fn texture_name(path: &Path, light: &str, taken: &mut BTreeSet<String>) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let plain: String = light.chars().map(|c| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect();
    let mut name = format!("{stem}-{plain}.exr");
    while !taken.insert(name.clone()) {
        name = format!("{}_.exr", name.trim_end_matches(".exr"));
    }
    name
}
