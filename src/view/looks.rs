//! Lighting files: a mix as `ltm relight --lighting` reads it, and back.

use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use super::export::in_place_of;
use super::groups::Groups;
use super::mixer::{LightMix, Mix, Tint};
use crate::error::{Error, Result};
use crate::image::{LinearImage, luminance, write_exr};
use crate::light::{Light, LightBasis, look};

/// Reads the first look of a lighting file as a mix.
///
/// Errors: those of [`look::load`].
pub fn load(path: &Path, basis: &LightBasis, groups: &Groups) -> Result<Mix> {
    Ok(Mix::of_lighting(basis, groups, look::load(path, basis)?.lighting()))
}

/// Writes the mix as a lighting file in TOML; the patterns of texelled lights become EXR files beside it, named after
/// it and the light. What does not shine, for whatever reason, is off in the file; a group's stops are added to those
/// of its lights.
///
/// Errors: the system refuses.
pub fn save(path: &Path, basis: &LightBasis, groups: &Groups, mix: &Mix) -> Result<()> {
    let mut text = String::from("base = \"scene\"\n");
    let mut taken = BTreeSet::new();
    let of_scene = Mix::of_scene(basis, groups);
    for (index, (light, own)) in basis.lights().iter().zip(&mix.lights).enumerate() {
        let stops = own.stops + groups.of_light(index).map_or(0.0, |group| mix.groups[group].stops);
        let shines = mix.shines(index, groups);
        if stops == 0.0 && shines == own.on && own.is_like(&of_scene.lights[index]) {
            continue;
        }
        rule(&mut text, light, own, stops, shines);
        if let Some(pattern) = &own.pattern {
            let file = texture_path(path, &light.name, &mut taken);
            let (across, down) = pattern.size();
            let pixels = pattern.turned(light.kind, own.turn_radians).texels().to_vec();
            in_place_of(&file, |file| write_exr(file, &LinearImage { width: across, height: down, pixels }))?;
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            line(&mut text, format_args!("image = {{ file = {} }}", quoted(&name)));
        }
    }
    in_place_of(path, |path| std::fs::write(path, &text).map_err(Error::io(path, "write the lighting")))
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

/// A free name beside the lighting file for a light's texture.
fn texture_path(path: &Path, light: &str, taken: &mut BTreeSet<String>) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let plain: String = light.chars().map(|c| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect();
    let mut name = format!("{stem}-{plain}.exr");
    while !taken.insert(name.clone()) {
        name = format!("{}_.exr", name.trim_end_matches(".exr"));
    }
    path.with_file_name(name)
}
