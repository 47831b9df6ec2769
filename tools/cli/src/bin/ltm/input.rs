//! What the commands' inputs have in common.

use std::path::Path;

use clap::Args;
use ltm::light::LightBasis;
use ltm::look::{self, Look};
use ltm::pipeline::check_matrix_path;
use ltm::scene::{LoadOptions, LoadedScene};
use ltm::{Error, Result};
use ltm_cli::words::parse_size;

/// Reads a look file, whose images may lie anywhere where that is allowed.
pub(crate) fn load_look(path: &Path, basis: &LightBasis, allow_outside: bool) -> Result<Look> {
    let look = match allow_outside {
        true => look::load_reaching_outside(path, basis),
        false => look::load(path, basis),
    }?;
    look.notes().iter().for_each(|note| eprintln!("warning: {note}"));
    Ok(look)
}

/// What of a scene is rendered, and what may be read for it.
#[derive(Args)]
pub(crate) struct SceneFiles {
    /// Which camera of a glTF file [default: the first]; with --pack several, by an option each, give a container each.
    #[arg(long = "camera", value_name = "CAMERA")]
    pub(crate) cameras: Vec<String>,
    /// Render this grid of sensors of a scene file in the place of its camera.
    #[arg(long)]
    pub(crate) grid: Option<String>,
    /// Render although textures are missing, with the materials' colours in their place.
    #[arg(long)]
    pub(crate) allow_missing: bool,
    /// Read files that the scene names outside of its folder and of LTM_SCENES: for scenes whose author you trust.
    #[arg(long)]
    pub(crate) allow_outside: bool,
}

impl SceneFiles {
    /// Errors: several cameras, where only one view is made.
    pub(crate) fn one_camera(&self) -> Result<Option<&String>> {
        match &self.cameras[..] {
            [_, _, ..] => {
                let hint = "give one --camera; ltm render --pack takes several";
                Err(Error::input("--camera", "is given several times", hint))
            }
            few => Ok(few.first()),
        }
    }

    pub(crate) fn load_options(&self, memory_bytes: Option<u64>) -> LoadOptions {
        let Self { cameras, grid, allow_missing, allow_outside } = self;
        LoadOptions {
            allow_missing: *allow_missing,
            allow_outside: *allow_outside,
            memory_bytes,
            camera: cameras.first().cloned(),
            grid: grid.clone(),
        }
    }
}

/// What is rendered in place of what the scene file says.
#[derive(Args, Clone, Copy, Default)]
pub(crate) struct Overrides {
    /// Samples per pixel [default: the scene file's].
    #[arg(long)]
    pub(crate) samples: Option<u32>,
    /// Seed of the samples: another one gives other noise [default: the scene file's].
    #[arg(long)]
    pub(crate) seed: Option<u64>,
    /// Image size, WIDTHxHEIGHT [default: the scene file's].
    #[arg(long, value_parser = parse_size)]
    pub(crate) size: Option<(u32, u32)>,
}

impl Overrides {
    /// A scene with what was asked for.
    pub(crate) fn of(self, mut loaded: LoadedScene) -> LoadedScene {
        loaded.settings.samples_per_pixel = self.samples.unwrap_or(loaded.settings.samples_per_pixel);
        loaded.settings.seed = self.seed.unwrap_or(loaded.settings.seed);
        match self.size {
            Some((width, height)) => loaded.sized(width, height),
            None => loaded,
        }
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
        Some("ltm") | Some("part") => check_matrix_path(path).map(|()| Kind::Matrix),
        _ => Err(Error::input(
            path.display().to_string(),
            "the name ends neither in .ltc nor in .ltm",
            "give a container made by ltm-pack or a matrix made by ltm render",
        )),
    }
}

/// Whether a TOML text is that of a scene file, which names geometry or another scene; a look does neither.
pub(crate) fn is_scene_text(text: &str) -> bool {
    let begins = |line: &str, key: &str| line.strip_prefix(key).is_some_and(|rest| rest.trim_start().starts_with('='));
    text.lines().any(|line| ["geometry", "scene"].iter().any(|key| begins(line.trim_start(), key)))
}
