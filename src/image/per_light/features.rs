//! Feature passes of renderers: albedo, normals, depth.

use std::path::Path;

use super::layers::{self, Layers};
use super::{LightRow, TakeRow, several};
use crate::error::{Error, Result};
use crate::resources::MemoryNeed;

/// Albedo, normal and depth of an OpenEXR file, as far as it has them.
#[derive(Clone, Debug)]
pub struct FeaturePasses {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    layers: Layers,
}

impl MemoryNeed for FeaturePasses {
    /// What [`read`](Self::read) takes.
    fn thread_bytes(&self) -> u64 {
        self.layers.chunk_bytes().saturating_mul(5)
    }
}

impl FeaturePasses {
    /// The passes of a file: layers in whose names `albedo`, `normal` or `depth` stands, those for denoisers first. None if it
    /// has none of them, or is no OpenEXR file by its name. Of several files by a pattern with `*`, those of the first.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn find(path: &Path) -> Result<Option<Self>> {
        if !path.to_string_lossy().contains("{light}") && several::is_pattern(path) {
            return Self::find(&several::files(path)?[0]);
        }
        if !path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr")) {
            return Ok(None);
        }
        let found = layers::open_features(path)?;
        Ok(found.map(|(layers, (width, height))| Self { width, height, layers }))
    }

    /// The passes of a file that was named for them.
    ///
    /// # Errors
    /// A file that cannot be read, or that has none.
    pub fn open(path: &Path) -> Result<Self> {
        Self::find(path)?.ok_or_else(|| {
            let hint =
                "give an OpenEXR file with layers such as 'Denoising Albedo', 'Denoising Normal', 'Denoising Depth'";
            Error::input(path.display().to_string(), "has no layers of albedo, normal or depth", hint)
        })
    }

    /// Hands over the rows of albedo (image 0), normal (1) and depth (2, channel 0).
    ///
    /// # Errors
    /// A file that cannot be read or has changed; those of `take`.
    pub fn read(&self, take: &mut TakeRow<'_>) -> Result<()> {
        self.layers.read(&mut |row: LightRow<'_>| take(row))
    }
}
