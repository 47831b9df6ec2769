//! What the commands' inputs have in common.

use std::path::Path;

use ltm::scene::LoadedScene;
use ltm::{Error, Result};

pub(crate) fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let (width, height) = text.split_once('x').ok_or("write WIDTHxHEIGHT, for example 1024x768")?;
    let side = |s: &str| s.parse().map_err(|e| format!("'{s}' is not a size ({e})"));
    Ok((side(width)?, side(height)?))
}

/// A scene with the samples and size that the command line asks for.
pub(crate) fn with_overrides(mut loaded: LoadedScene, samples: Option<u32>, size: Option<(u32, u32)>) -> LoadedScene {
    loaded.settings.samples_per_pixel = samples.unwrap_or(loaded.settings.samples_per_pixel);
    match size {
        Some((width, height)) => loaded.sized(width, height),
        None => loaded,
    }
}

/// What a file is, by its name.
#[derive(Clone, Copy)]
pub(crate) enum Kind {
    Container,
    Matrix,
}

pub(crate) fn kind_of(path: &Path) -> Result<Kind> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("ltc") => Ok(Kind::Container),
        Some("ltm") | Some("part") => Ok(Kind::Matrix),
        _ => Err(Error::input(
            path.display().to_string(),
            "the name ends neither in .ltc nor in .ltm",
            "give a container made by ltm-pack or a matrix made by ltm render",
        )),
    }
}

/// Whether a file is a scene file or a glTF file, by its name.
pub(crate) fn is_scene(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    ["toml", "glb", "gltf"].contains(&&*extension)
}
