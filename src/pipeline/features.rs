//! `.ltm` → an EXR of what its pixels show beside light: for denoisers and for compositing.

use std::path::Path;

use super::strip::{Strip, strip_bytes};
use crate::error::{Error, Result};
use crate::host::{Need, PROGRAM_BYTES, Watch};
use crate::image::{ImageSize, exr_rows_need_bytes, write_exr_channels};
use crate::matrix::{BlockSource, FEATURE_PLANES};
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
    let committed = || shape.blocks().filter(|&id| matrix.is_committed(id));
    // All blocks of a file know of their samples, or none.
    let known = match committed().next() {
        Some(first) => matrix.read_planes(first, None)?.is_some(),
        None => false,
    };
    if !known {
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
    Ok(shape.block_count() - committed().count() as u32)
}

/// What is asked of a matrix that was rendered without knowing what its samples are.
pub(super) fn unknown(place: String) -> Error {
    let hint = "render it again with this program and at least 2 samples per pixel";
    Error::input(place, "the matrix does not know what its samples are", hint)
}
