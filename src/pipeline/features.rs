//! What the pixels of a `.ltm` show beside light: in memory, or as an EXR for denoisers and for compositing.

use std::path::Path;

use super::strip::{Strip, strip_bytes};
use crate::error::{Error, Result};
use crate::host::{Need, PROGRAM_BYTES, Watch};
use crate::image::{ImageSize, exr_rows_need_bytes, write_exr_channels};
use crate::matrix::{BlockSource, FEATURE_PLANES, Feature, MatrixShape};
use crate::store::{self, StoreReader};

/// The channel of each plane of features, in their order: Blender's names of what its denoiser takes, as OIDN's users
/// know them too; then shares of the samples.
pub const FEATURE_CHANNELS: [&str; FEATURE_PLANES] = [
    "Denoising Albedo.R",
    "Denoising Albedo.G",
    "Denoising Albedo.B",
    "Denoising Normal.X",
    "Denoising Normal.Y",
    "Denoising Normal.Z",
    "Denoising Depth.Z",
    "Emitter Share.V",
    "Specular Share.V",
    "Surface Share.V",
];

/// What the pixels of a whole image show beside light.
#[derive(Clone, Debug, PartialEq)]
pub struct Features {
    size: (u32, u32),
    planes: Vec<f32>,
    missing: u32,
}

impl Features {
    /// Bytes of those of an image.
    pub fn needs_bytes(shape: MatrixShape) -> u64 {
        (FEATURE_PLANES * size_of::<f32>()) as u64 * u64::from(shape.width()) * u64::from(shape.height())
    }

    /// Reads those of all blocks. Blocks that the file lacks are zero.
    ///
    /// # Errors
    /// The matrix knows nothing of its samples, or not even one block; a block is damaged.
    pub fn read(matrix: &StoreReader) -> Result<Self> {
        let shape = BlockSource::shape(matrix);
        if !are_known(matrix)? {
            return Err(unknown("the features".to_owned()));
        }
        let (width, height) = (shape.width() as usize, shape.height() as usize);
        let mut features = Self {
            size: (shape.width(), shape.height()),
            planes: vec![0.0; FEATURE_PLANES * width * height],
            missing: shape.block_count(),
        };
        let mut reused = None;
        for id in shape.blocks().filter(|&id| matrix.is_committed(id)) {
            let Some(block) = matrix.read_planes(id, reused.take())? else { continue };
            let rect = shape.rect(id);
            let rows = block.features.chunks_exact(rect.width as usize);
            for (row, values) in rows.enumerate() {
                let (plane, y) = (row / rect.height as usize, rect.y as usize + row % rect.height as usize);
                features.planes[(plane * height + y) * width + rect.x as usize..][..values.len()]
                    .copy_from_slice(values);
            }
            features.missing -= 1;
            reused = Some(block);
        }
        Ok(features)
    }

    /// Width and height of the image.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// Blocks that the file lacks.
    pub fn missing_blocks(&self) -> u32 {
        self.missing
    }

    /// All planes, one after the other in the order of [`Feature`]: pixels row by row, means over all samples.
    pub fn planes(&self) -> &[f32] {
        &self.planes
    }

    /// The planes of a feature: one, or three.
    pub fn planes_of(&self, feature: Feature) -> impl Iterator<Item = &[f32]> {
        let pixels = self.size.0 as usize * self.size.1 as usize;
        feature.planes().map(move |plane| &self.planes[plane * pixels..][..pixels])
    }
}

/// Whether a matrix knows what its samples are. All blocks of a file do, or none.
fn are_known(matrix: &StoreReader) -> Result<bool> {
    let first = BlockSource::shape(matrix).blocks().find(|&id| matrix.is_committed(id));
    first.map_or(Ok(false), |first| Ok(matrix.read_planes(first, None)?.is_some()))
}

/// Writes the features of a matrix as one EXR of 32-bit channels, [`FEATURE_CHANNELS`]. Blocks that the file lacks are
/// black. Returns how many those are.
///
/// # Errors
/// The matrix knows nothing of its samples, or not even one block; a block is damaged; the memory is too small;
/// [`Error::Interrupted`]; what writing refuses.
pub fn write_features(matrix: &StoreReader, path: &Path, memory_bytes: Option<u64>, watch: &dyn Watch) -> Result<u32> {
    let shape = BlockSource::shape(matrix);
    let size = ImageSize { width: shape.width() as usize, height: shape.height() as usize };
    let reading = store::requirements(matrix.job(), &matrix.options()).memory_bytes;
    let rows = strip_bytes(shape, FEATURE_PLANES) + exr_rows_need_bytes(FEATURE_PLANES.div_ceil(3), size);
    let need = Need { fixed_bytes: PROGRAM_BYTES + reading + rows, ..Need::default() };
    need.threads_within("writing features", memory_bytes)?;
    if !are_known(matrix)? {
        return Err(unknown("--layers features".to_owned()));
    }
    let mut strip = Strip::new(shape, FEATURE_PLANES, |id| match matrix.is_committed(id) {
        true => Ok(matrix.read_planes(id, None)?.map(|planes| planes.features)),
        false => Ok(None),
    });
    watch.begin("writing features", u64::from(shape.blocks_down()), "rows of blocks");
    let names = FEATURE_CHANNELS.map(str::to_owned);
    let written = write_exr_channels(path, &names, size, &mut |channel, y, row| strip.copy_row(channel, y, row, watch));
    watch.end();
    written?;
    Ok(shape.blocks().filter(|&id| !matrix.is_committed(id)).count() as u32)
}

/// What is asked of a matrix that was rendered without knowing what its samples are.
pub(super) fn unknown(place: String) -> Error {
    let hint = "render it again with this program and at least 2 samples per pixel";
    Error::input(place, "the matrix does not know what its samples are", hint)
}
