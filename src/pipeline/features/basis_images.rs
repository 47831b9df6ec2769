//! Export of the images that are denoised to an EXR, and import of the result of any other denoiser.

use std::path::Path;

use super::block_rows::BlockRow;
use super::{FEATURE_CHANNELS, unknown};
use crate::denoise::BASIS_LAYER;
use crate::error::Result;
use crate::image::{ImageSize, exr_rows_need_bytes, write_exr_channels};
use crate::light::Clusters;
use crate::matrix::{BlockPlanes, BlockSource, CHANNELS, FEATURE_PLANES};
use crate::resources::{Held, Progress, ResourceEstimate};
use crate::store::StoreReader;

/// Writes the images of the clusters of columns of a matrix as one EXR of 32-bit channels: layers `basis.00` onwards with R,
/// G, B, and [`FEATURE_CHANNELS`]. An image is the sum of the columns of a cluster (`light::Clusters`) in their unit, without
/// the emitters in view, which are exact as they are. `pack` takes the file back, denoised
/// ([`PackOptions::basis`](crate::pipeline::PackOptions::basis)). Returns the number of images.
///
/// # Errors
/// The matrix lacks blocks or knows nothing of its samples; a block is damaged; the memory is too small;
/// [`Error::Interrupted`](crate::Error::Interrupted); what writing refuses.
pub fn write_basis(
    matrix: &StoreReader,
    path: &Path,
    memory_bytes: Option<u64>,
    watch: &dyn Progress,
) -> Result<usize> {
    let shape = BlockSource::shape(matrix);
    let clusters = Clusters::of_basis(&matrix.job().basis).count();
    let size = ImageSize { width: shape.width() as usize, height: shape.height() as usize };
    let planes = CHANNELS * clusters + FEATURE_PLANES;
    let mut strip = BlockRow::new(shape, planes, |id| {
        let planes = matrix.read_planes(id, None)?.ok_or_else(|| unknown(id.to_string()))?;
        let mut values = images_of(&planes, matrix.job().provenance.samples_per_pixel);
        values.extend_from_slice(&planes.features);
        Ok(Some(values))
    });
    let writing = Held(exr_rows_need_bytes(planes.div_ceil(3), size));
    let need = ResourceEstimate::of_one_thread(&[matrix, &strip, &writing]);
    need.threads_within("writing the basis images", memory_bytes)?;
    let layers = (0..clusters).flat_map(|k| ["R", "G", "B"].map(|colour| format!("{BASIS_LAYER}{k:02}.{colour}")));
    let names: Vec<String> = layers.chain(FEATURE_CHANNELS.map(str::to_owned)).collect();
    watch.begin("writing the basis images", u64::from(shape.blocks_down()), "rows of blocks");
    let written = write_exr_channels(path, &names, size, &mut |channel, y, row| strip.copy_row(channel, y, row, watch));
    watch.end();
    written.map(|()| clusters)
}

/// The images of a block with direct and indirect light added up: the mean of the halves, of which the first has one
/// more sample if their number is odd.
fn images_of(planes: &BlockPlanes, samples: u32) -> Vec<f32> {
    let second = if samples > 1 { (samples / 2) as f32 / samples as f32 } else { 0.5 };
    let mean = |halves: &[Vec<f32>; 2], i: usize| halves[0][i] + second * (halves[1][i] - halves[0][i]);
    (0..planes.direct[0].len()).map(|i| mean(&planes.direct, i) + mean(&planes.indirect, i)).collect()
}
