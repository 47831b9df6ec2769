//! Features of a `.ltm`, in memory or as an EXR for denoisers and compositing.

use std::path::Path;

mod basis_images;
mod block_rows;

use self::block_rows::BlockRow;
use crate::error::{Error, Result};
use crate::image::{ImageSize, exr_rows_need_bytes, write_exr_channels};
use crate::matrix::{BlockId, BlockPlanes, BlockSource, FEATURE_PLANES, Feature, MatrixShape};
use crate::resources::{Held, NoProgress, Progress, ResourceEstimate};
use crate::store::StoreReader;
pub use basis_images::write_basis;

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
    "IndexMA.X",
    "Pixel Albedo.R",
    "Pixel Albedo.G",
    "Pixel Albedo.B",
];

/// The channels of the features' variances, in the same order: `Denoising Albedo Variance.R` beside `Denoising Albedo.R`, as
/// Blender has called them.
fn variance_channels() -> [String; FEATURE_PLANES] {
    FEATURE_CHANNELS.map(|name| match name.split_once('.') {
        Some((layer, channel)) => format!("{layer} Variance.{channel}"),
        None => format!("{name} Variance"),
    })
}

/// The features of a whole image, or their variances.
#[derive(Clone, Debug, PartialEq)]
pub struct Features {
    size: (u32, u32),
    planes: Vec<f32>,
}

impl Features {
    /// Bytes of the features of an image.
    pub fn needs_bytes(shape: MatrixShape) -> u64 {
        (FEATURE_PLANES * size_of::<f32>()) as u64 * u64::from(shape.width()) * u64::from(shape.height())
    }

    /// Reads the features of all blocks. Missing blocks are zero.
    ///
    /// # Errors
    /// The matrix knows nothing of its samples, or not even one block; a block is damaged.
    pub fn read(matrix: &StoreReader) -> Result<Self> {
        Self::read_planes(matrix, |planes| planes.features)
    }

    /// Reads the variances of the features, assuming independent samples.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_variances(matrix: &StoreReader) -> Result<Self> {
        Self::read_planes(matrix, |planes| planes.feature_variance)
    }

    fn read_planes(matrix: &StoreReader, take: fn(BlockPlanes) -> Vec<f32>) -> Result<Self> {
        let shape = BlockSource::shape(matrix);
        check_known(matrix, "the features")?;
        let mut strip = BlockRow::new(shape, FEATURE_PLANES, |id| Ok(of_block(matrix, id)?.map(take)));
        let (width, height) = (shape.width() as usize, shape.height() as usize);
        let mut planes = vec![0.0; FEATURE_PLANES * width * height];
        for y in 0..height {
            for plane in 0..FEATURE_PLANES {
                strip.copy_row(plane, y, &mut planes[(plane * height + y) * width..][..width], &NoProgress)?;
            }
        }
        Ok(Self { size: (shape.width(), shape.height()), planes })
    }

    /// Width and height of the image.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// All planes, one after the other in the order of [`Feature`]: pixels row by row.
    pub fn planes(&self) -> &[f32] {
        &self.planes
    }

    /// The planes of a feature: one, or three.
    pub fn planes_of(&self, feature: Feature) -> impl Iterator<Item = &[f32]> {
        let pixels = self.size.0 as usize * self.size.1 as usize;
        feature.planes().map(move |plane| &self.planes[plane * pixels..][..pixels])
    }
}

/// The planes of a block; `None` if the block is missing.
fn of_block(matrix: &StoreReader, id: BlockId) -> Result<Option<BlockPlanes>> {
    match matrix.is_committed(id) {
        true => Ok(matrix.read_planes(id, None)?),
        false => Ok(None),
    }
}

/// Checks that a matrix has planes; `asks` names the operation. All blocks of a file have them, or none.
pub(super) fn check_known(matrix: &StoreReader, asks: &str) -> Result<()> {
    let first = BlockSource::shape(matrix).blocks().find(|&id| matrix.is_committed(id));
    match first.map(|first| of_block(matrix, first)).transpose()?.flatten() {
        Some(_) => Ok(()),
        None => Err(unknown(asks.to_owned())),
    }
}

/// Writes the features of a matrix as one EXR of 32-bit channels, [`FEATURE_CHANNELS`], and their variances (`Denoising
/// Albedo Variance.R` for `Denoising Albedo.R`). Missing blocks are black; returns their number.
///
/// # Errors
/// The matrix knows nothing of its samples, or not even one block; a block is damaged; the memory is too small;
/// [`Error::Interrupted`]; what writing refuses.
pub fn write_features(
    matrix: &StoreReader,
    path: &Path,
    memory_bytes: Option<u64>,
    watch: &dyn Progress,
) -> Result<u32> {
    let shape = BlockSource::shape(matrix);
    let size = ImageSize { width: shape.width() as usize, height: shape.height() as usize };
    let planes = 2 * FEATURE_PLANES;
    let mut strip = BlockRow::new(shape, planes, |id| {
        Ok(of_block(matrix, id)?.map(|planes| [planes.features, planes.feature_variance].concat()))
    });
    let writing = Held(exr_rows_need_bytes(planes.div_ceil(3), size));
    let need = ResourceEstimate::of_one_thread(&[matrix, &strip, &writing]);
    need.threads_within("writing features", memory_bytes)?;
    check_known(matrix, "features")?;
    watch.begin("writing features", u64::from(shape.blocks_down()), "rows of blocks");
    let names: Vec<String> = FEATURE_CHANNELS.map(str::to_owned).into_iter().chain(variance_channels()).collect();
    let written = write_exr_channels(path, &names, size, &mut |channel, y, row| strip.copy_row(channel, y, row, watch));
    watch.end();
    written?;
    Ok(shape.blocks().filter(|&id| !matrix.is_committed(id)).count() as u32)
}

/// The error for a matrix that was rendered without planes.
pub(super) fn unknown(place: String) -> Error {
    let hint = "render it again with this program and at least 2 samples per pixel";
    Error::input(place, "the matrix does not know what its samples are", hint)
}
