//! `ltm` without a command: what can be done next with the files of this folder.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use ltm::Result;
use ltm::error::Error;
use ltm::files::natural_order;
use ltm::image::LightSet;
use ltm_cli::{say, shell};

use crate::input::is_scene_text;

/// Files that are listed; more are counted.
const MAX_LISTED: usize = 5;
/// Bytes of a TOML file that are looked at to tell a scene from a look.
const MAX_TOML_BYTES: u64 = 1 << 20;

/// What can be done with a file.
struct Step {
    command: String,
    /// What comes of it.
    result: String,
}

/// Prints about ten lines: a command for each file of the folder that the programs read, and where more is said.
///
/// # Errors
/// The folder cannot be read.
pub(crate) fn run(folder: &Path) -> Result<()> {
    let steps = steps_of(&names_in(folder)?, folder);
    println!("ltm renders a scene once for all its lights; from then on every change of light shows at once.");
    if steps.is_empty() {
        println!(
            "Nothing in this folder is a .blend, .glb, .gltf, .obj, scene .toml, .exr, .ltm or .ltc file. To begin:"
        );
        println!("  ltm demo                          a furnished room: rendered, packed, shown");
        println!("  ltm render room.glb --pack        your scene, as glTF with its camera and lights -> room.ltc");
        println!("  ltm-pack lights.exr -o room.ltc   images of single lights that another renderer made");
    } else {
        println!("Next, in this folder:");
        for step in steps.iter().take(MAX_LISTED) {
            say!("  {}   # {}", step.command, step.result);
        }
        if steps.len() > MAX_LISTED {
            println!("  … and {} more files", steps.len() - MAX_LISTED);
        }
        println!("A room to try: ltm demo.");
    }
    println!("All commands: ltm --help. This machine, and what is missing for what: ltm doctor.");
    Ok(())
}

/// The names of the folder's files, in the order in which people count them.
fn names_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let failed = || Error::io(folder, "look into the folder");
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed())? {
        let entry = entry.map_err(failed())?;
        let is_hidden = entry.file_name().as_encoded_bytes().first() == Some(&b'.');
        if !is_hidden && entry.path().is_file() {
            names.push(PathBuf::from(entry.file_name()));
        }
    }
    names.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    Ok(names)
}

/// The steps, those nearest to a picture first. A file from which another one here was made is left out.
fn steps_of(names: &[PathBuf], folder: &Path) -> Vec<Step> {
    let with = |extensions: &[&str]| -> Vec<&Path> {
        let has = |name: &&Path| extensions.contains(&&*extension_of(name));
        names.iter().map(PathBuf::as_path).filter(has).collect()
    };
    let there: BTreeSet<PathBuf> = names.iter().cloned().collect();
    let lacks = |name: &&Path, extension: &str| !there.contains(&name.with_extension(extension));
    let mut steps: Vec<Step> = Vec::new();
    steps.extend(with(&["ltc"]).into_iter().map(of_container));
    steps.extend(with(&["ltm"]).into_iter().filter(|name| lacks(name, "ltc")).map(of_matrix));
    steps.extend(with(&["glb", "gltf"]).into_iter().filter(|name| lacks(name, "ltc")).map(of_scene));
    let texts = with(&["toml"]).into_iter().filter_map(|name| Some((name, toml_text(&folder.join(name))?)));
    let scenes: Vec<(&Path, String)> = texts.filter(|(_, text)| is_scene_text(text)).collect();
    steps.extend(scenes.iter().map(|(name, _)| *name).filter(|name| lacks(name, "ltc")).map(of_scene));
    let is_named = |name: &Path| name.to_str().is_some_and(|name| scenes.iter().any(|(_, text)| text.contains(name)));
    steps.extend(with(&["obj"]).into_iter().filter(|name| !is_named(name)).map(of_geometry));
    let is_exported = |name: &&Path| lacks(name, "glb") && lacks(name, "ltc") && lacks(name, "gltf");
    steps.extend(with(&["blend"]).into_iter().filter(is_exported).map(of_blend));
    steps.extend(of_images(&with(&["exr", "npy", "npz"]), folder, &lacks));
    steps
}

fn extension_of(name: &Path) -> String {
    name.extension().map(|extension| extension.to_string_lossy().to_lowercase()).unwrap_or_default()
}

fn of_container(name: &Path) -> Step {
    let picture = shell::word(&name.with_extension("png"));
    let result = format!("mix its lights; ltm relight {} -o {picture} writes a picture", shell::word(name));
    Step { command: format!("ltm view {}", shell::word(name)), result }
}

fn of_matrix(name: &Path) -> Step {
    let result = format!("compress the matrix -> {}", name.with_extension("ltc").display());
    Step { command: format!("ltm-pack {}", shell::word(name)), result }
}

fn of_scene(name: &Path) -> Step {
    let result = format!("render for all lights -> {}", name.with_extension("ltc").display());
    Step { command: format!("ltm render {} --pack", shell::word(name)), result }
}

/// An OBJ file renders by itself, with all of it in view under an even sky; the window moves the camera and saves it into a scene file.
fn of_geometry(name: &Path) -> Step {
    let scene = name.with_extension("toml");
    let result = format!("choose a view while it renders; Save the view begins {}, where lamps go", scene.display());
    Step { command: format!("ltm view {}", shell::word(name)), result }
}

/// Blender itself exports cameras and lamps.
fn of_blend(name: &Path) -> Step {
    let exported = name.with_extension("glb");
    let file = exported.to_string_lossy().replace('\\', "\\\\").replace('"', "\\\"");
    let export =
        format!("import bpy; bpy.ops.export_scene.gltf(filepath=\"{file}\", export_cameras=True, export_lights=True)");
    let command = format!("blender --background {} --python-expr {}", shell::word(name), shell::quoted(&export));
    Step { command, result: format!("then ltm render {} --pack; the add-on does both", shell::word(&exported)) }
}

/// Files of light groups, arrays, and images of single lights under one pattern of names.
fn of_images(names: &[&Path], folder: &Path, lacks: &impl Fn(&&Path, &str) -> bool) -> Vec<Step> {
    let (sets, single): (Vec<&Path>, Vec<&Path>) =
        names.iter().copied().partition(|name| is_set_of_lights(&folder.join(name)));
    let mut steps: Vec<Step> = Vec::new();
    for name in sets.into_iter().filter(|name| lacks(name, "ltc")) {
        let packed = name.with_extension("ltc");
        let command = format!("ltm-pack {} -o {}", shell::word(name), shell::word(&packed));
        steps.push(Step { command, result: format!("images of single lights -> {}", packed.display()) });
    }
    if let Some((pattern, packed)) = pattern_of(&single)
        && lacks(&packed.as_path(), "ltc")
        && is_set_of_lights(&folder.join(&pattern))
    {
        let command = format!("ltm-pack {} -o {}", shell::word(&pattern), shell::word(&packed));
        steps.push(Step { command, result: format!("an image of each light -> {}", packed.display()) });
    }
    steps
}

/// Whether these are images of two lights or more; only names and sizes are read.
fn is_set_of_lights(path: &Path) -> bool {
    LightSet::open(path, None).is_ok_and(|set| set.lights.len() > 1)
}

/// The pattern of names that begin and end alike, and a name for what is made of them.
fn pattern_of(names: &[&Path]) -> Option<(PathBuf, PathBuf)> {
    let names: Vec<&str> = names.iter().map(|name| name.to_str()).collect::<Option<_>>()?;
    let (first, rest) = names.split_first()?;
    let begins = |length: usize| first.get(..length).is_some_and(|part| rest.iter().all(|name| name.starts_with(part)));
    let prefix = &first[..(0..=first.len()).rev().find(|&length| begins(length))?];
    let prefix = &prefix[..prefix.rfind(['_', '-', '.', ' ']).map_or(0, |at| at + 1)];
    let stem = prefix.trim_end_matches(['_', '-', '.', ' ']);
    if rest.is_empty() || stem.is_empty() {
        return None;
    }
    let extension = Path::new(first).extension()?.to_str()?;
    Some((format!("{prefix}{{light}}.{extension}").into(), format!("{stem}.ltc").into()))
}

/// A small TOML file as text.
fn toml_text(path: &Path) -> Option<String> {
    ltm::files::read_input_text(path, "read", MAX_TOML_BYTES).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_begin_alike_are_one_pattern() {
        let pattern = |names: &[&str]| {
            let names: Vec<PathBuf> = names.iter().map(PathBuf::from).collect();
            pattern_of(&names.iter().map(PathBuf::as_path).collect::<Vec<_>>())
        };
        let expected = Some(("room_{light}.exr".into(), "room.ltc".into()));
        assert_eq!(pattern(&["room_desk.exr", "room_door.exr", "room_sky.exr"]), expected);
        assert_eq!(pattern(&["desk.exr", "sky.exr"]), None);
        assert_eq!(pattern(&["room_desk.exr"]), None);
        assert_eq!(pattern(&[]), None);
        assert_eq!(pattern(&["ä_1.exr", "ä_2.exr"]), Some(("ä_{light}.exr".into(), "ä.ltc".into())));
    }
}
