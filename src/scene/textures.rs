//! Textures of a scene: each file read once for each way of using it.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::{Texture, TextureId};
use crate::error::{Error, Result};
use crate::image::{image_size, read_rgba};

/// Most memory that the textures of a scene may take, in bytes.
const BUDGET_BYTES: u64 = 2 << 30;

/// Memory of one texture above which a warning is given, in bytes.
const LARGE_BYTES: u64 = 256 << 20;

/// What a texture is read for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Use {
    /// Reflectance: clamped to [0, 1].
    Reflectance,
    /// Emission: no upper bound.
    Emission,
    /// Cut-out: the alpha channel, or the red one of an image without alpha.
    CutOut,
}

/// The textures read so far.
#[derive(Debug, Default)]
pub(super) struct Textures {
    pub(super) list: Vec<Texture>,
    known: HashMap<(PathBuf, Use), TextureId>,
    bytes: u64,
}

impl Textures {
    /// The texture of a file. Errors: a file that is missing or no image, or more textures than fit.
    pub(super) fn get(
        &mut self,
        path: &Path,
        usage: Use,
        asked_by: &str,
        warnings: &mut Vec<String>,
    ) -> Result<TextureId> {
        if let Some(&id) = self.known.get(&(path.to_owned(), usage)) {
            return Ok(id);
        }
        if !path.is_file() {
            let problem = format!("the texture {} is missing", path.display());
            return Err(Error::input(asked_by, problem, "put it there, or take the map out of the material"));
        }
        let (width, height) = image_size(path)?;
        let bytes = u64::from(width) * u64::from(height) * size_of::<[f32; 4]>() as u64;
        self.bytes += bytes;
        if self.bytes > BUDGET_BYTES {
            return Err(Error::Resources {
                what: format!("reading the textures up to {}", path.display()),
                needed: gib(self.bytes),
                available: format!("a scene's textures may take {}", gib(BUDGET_BYTES)),
                hint: "scale the images down".into(),
            });
        }
        if bytes > LARGE_BYTES {
            let name = path.display();
            warnings.push(format!("{name}: the texture has {width} × {height} pixels and takes {}", gib(bytes)));
        }
        let image = read_rgba(path)?;
        let largest = if usage == Use::Emission { f32::MAX } else { 1.0 };
        let mut mended = false;
        let mut mend = |v: f32| {
            let clamped = if v.is_finite() { v.clamp(0.0, largest) } else { 0.0 };
            mended |= clamped != v;
            clamped
        };
        let texel = |[r, g, b, a]: [f32; 4]| match usage {
            Use::CutOut => [r, g, b, if image.has_alpha { a } else { r }],
            Use::Reflectance | Use::Emission => [mend(r), mend(g), mend(b), a],
        };
        let texels = image.pixels.iter().copied().map(texel).collect();
        if mended {
            warnings.push(format!("{}: values that no surface can have were clamped", path.display()));
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        self.list.push(Texture { name, width, height, texels });
        let id = TextureId(self.list.len() as u32 - 1);
        self.known.insert((path.to_owned(), usage), id);
        Ok(id)
    }
}

fn gib(bytes: u64) -> String {
    format!("{:.1} GiB", bytes as f64 / (1u64 << 30) as f64)
}
