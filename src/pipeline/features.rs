//! `.ltm` → an EXR of what its pixels show beside light: for denoisers and for compositing.

use std::path::Path;

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
    let pixels = size.width * size.height;
    let reading = store::requirements(matrix.job(), &matrix.options()).memory_bytes;
    let image = (pixels * FEATURE_PLANES * 4) as u64;
    let fixed_bytes = PROGRAM_BYTES + reading + image + exr_rows_need_bytes(FEATURE_PLANES.div_ceil(3), size);
    Need { fixed_bytes, ..Need::default() }.threads_within("writing features", memory_bytes)?;
    let mut planes = vec![0.0f32; pixels * FEATURE_PLANES];
    let (mut reused, mut missing, mut known) = (None, 0, false);
    watch.begin("reading features", u64::from(shape.block_count()), "blocks");
    for id in shape.blocks() {
        if watch.interrupted() {
            watch.end();
            return Err(Error::Interrupted("nothing was written".to_owned()));
        }
        if !matrix.is_committed(id) {
            missing += 1;
            continue;
        }
        if let Some(block) = matrix.read_planes(id, reused.take())? {
            known = true;
            let rect = shape.rect(id);
            let (width, height) = (rect.width as usize, rect.height as usize);
            for (plane, values) in block.features.chunks_exact(width * height).enumerate() {
                for (y, row) in values.chunks_exact(width).enumerate() {
                    let at = plane * pixels + (rect.y as usize + y) * size.width + rect.x as usize;
                    planes[at..at + width].copy_from_slice(row);
                }
            }
            reused = Some(block);
        }
        watch.advance(1, 1, "blocks");
    }
    watch.end();
    if !known {
        let hint = "render it again with this program and at least 2 samples per pixel";
        return Err(Error::input("--layers features", "the matrix does not know what its samples are", hint));
    }
    write_exr_channels(path, &FEATURE_CHANNELS.map(str::to_owned), size, &mut |channel, y, row| {
        row.copy_from_slice(&planes[channel * pixels + y * size.width..][..size.width]);
        Ok(())
    })?;
    Ok(missing)
}
