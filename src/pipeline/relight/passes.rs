//! Passes of a relit image: emission, direct and indirect light.

use super::{RelightOptions, relight_matrix};
use crate::error::Result;
use crate::image::LinearImage;
use crate::light::{Clusters, Lighting};
use crate::matrix::{BlockPlanes, BlockSource, CHANNELS, MatrixShape, PixelRect};
use crate::pipeline::features::check_known;
use crate::store::StoreReader;

/// The passes of a relit image, in their order. Emission is seen straight or by mirrors and smooth glass. Direct light
/// is scattered once, and reaches that surface straight or through thin sheets. Indirect light is the rest.
pub const PASSES: [&str; 3] = ["Emission", "Direct", "Indirect"];

/// Bytes of the passes of an image.
pub fn passes_need_bytes(shape: MatrixShape) -> u64 {
    (PASSES.len() * size_of::<[f32; CHANNELS]>()) as u64 * u64::from(shape.width()) * u64::from(shape.height())
}

/// Relights a matrix as the [`PASSES`] of its light, which sum up to the image of [`relight_matrix`].
///
/// A matrix has the emission seen for each column, and direct and indirect light for each cluster of columns
/// ([`Clusters`]). So emission is exact. The rest is split in the ratio of direct to indirect light of the clusters
/// under the mean weights of their columns. That is exact to rounding if each cluster is lit evenly, as always with up
/// to 80 columns, and an approximation otherwise.
///
/// # Errors
/// The matrix knows nothing of its samples; those of [`relight_matrix`].
pub fn relight_passes(
    matrix: &StoreReader,
    lighting: &Lighting,
    options: RelightOptions,
) -> Result<[LinearImage; PASSES.len()]> {
    check_known(matrix, "the passes")?;
    let shape = BlockSource::shape(matrix);
    let beside_bytes = options.beside_bytes + passes_need_bytes(shape);
    let total = relight_matrix(matrix, lighting, RelightOptions { beside_bytes, ..options })?;
    let basis = &matrix.job().basis;
    let clusters = cluster_weights(&Clusters::of_basis(basis), basis.column_scales(), lighting);
    let mut images = PASSES.map(|_| LinearImage::black(shape.width(), shape.height()));
    let mut planes = BlockPlanes::default();
    for id in shape.blocks() {
        planes = matrix.read_planes(id, Some(planes))?.unwrap_or_default();
        let rect = shape.rect(id);
        let [direct, indirect] = [&planes.direct, &planes.indirect].map(|halves| lit(halves, &clusters, rect.rows()));
        let mut emission = vec![[0.0f32; CHANNELS]; rect.pixels()];
        for seen in &planes.emission {
            let weight = lighting.weights()[seen.column as usize];
            let sum = &mut emission[seen.pixel as usize];
            (0..CHANNELS).for_each(|channel| sum[channel] += seen.value[channel] * weight[channel]);
        }
        for (pixel, emission) in emission.into_iter().enumerate() {
            let place = index_in(rect, pixel, shape);
            for (channel, emission) in emission.into_iter().enumerate() {
                let row = channel * rect.pixels() + pixel;
                let rest = total.pixels[place][channel] - emission;
                let sum = direct[row] + indirect[row];
                // Without light in any cluster, the rest is rounding of the emission.
                let first = if sum > 0.0 { rest * (direct[row] / sum) } else { 0.0 };
                let parts = [emission, first, rest - first];
                images.iter_mut().zip(parts).for_each(|(image, part)| image.pixels[place][channel] = part);
            }
        }
    }
    Ok(images)
}

/// Index in the image of a pixel of a block.
fn index_in(rect: PixelRect, pixel: usize, shape: MatrixShape) -> usize {
    let (across, down) = (pixel % rect.width as usize, pixel / rect.width as usize);
    (rect.y as usize + down) * shape.width() as usize + rect.x as usize + across
}

/// Mean weight of the columns of each cluster, whose light is of columns divided by their scales.
fn cluster_weights(clusters: &Clusters, scales: &[f32], lighting: &Lighting) -> Vec<[f32; CHANNELS]> {
    let mut sums = vec![([0.0f64; CHANNELS], 0u32); clusters.count()];
    for (column, (&cluster, weight)) in clusters.of_column().iter().zip(lighting.weights()).enumerate() {
        let (sum, count) = &mut sums[usize::from(cluster)];
        let scale = f64::from(scales.get(column).copied().unwrap_or(1.0));
        sum.iter_mut().zip(weight).for_each(|(sum, &weight)| *sum += scale * f64::from(weight));
        *count += 1;
    }
    sums.into_iter().map(|(sum, count)| sum.map(|sum| (sum / f64::from(count.max(1))) as f32)).collect()
}

/// The rows of a block's cluster light, both halves of the samples added up, under a weight for each cluster.
fn lit(halves: &[Vec<f32>; 2], clusters: &[[f32; CHANNELS]], rows: usize) -> Vec<f32> {
    let mut sums = vec![0.0f32; rows];
    for half in halves {
        for (light, weight) in half.chunks_exact(rows).zip(clusters) {
            for (row, (sum, light)) in sums.iter_mut().zip(light).enumerate() {
                *sum += light * weight[row * CHANNELS / rows];
            }
        }
    }
    sums
}

#[cfg(all(test, feature = "scene"))]
mod tests {
    use super::*;
    use crate::pipeline::{RenderOptions, render};
    use crate::resources::NoProgress;
    use crate::scene::BuiltIn;

    /// The raw matrix of a room under a panel of `texels` × `texels`, of paths of this length.
    fn room(texels: u32, max_depth: u32) -> StoreReader {
        let mut loaded = BuiltIn { width: 24, height: 16, texels }.named("diffuse").unwrap();
        (loaded.settings.samples_per_pixel, loaded.settings.max_depth) = (16, max_depth);
        let file = tempfile::Builder::new().suffix(".ltm").tempfile().unwrap();
        let mut options = RenderOptions::default();
        options.store.overwrite = true;
        render(loaded, file.path(), &options, &NoProgress).unwrap();
        StoreReader::open(file.path()).unwrap()
    }

    fn uneven(matrix: &StoreReader) -> Lighting {
        let columns = BlockSource::shape(matrix).columns();
        Lighting::new((0..columns).map(|c| [c as f32, (c % 3) as f32, 1.0]).collect()).unwrap()
    }

    fn worst(a: &LinearImage, b: &[f32]) -> f32 {
        let most = b.iter().copied().fold(0.0, f32::max);
        a.values().iter().zip(b).fold(0.0f32, |worst, (a, b)| worst.max((a - b).abs())) / most
    }

    #[test]
    fn direct_light_and_emission_are_the_image_of_paths_of_two_segments() {
        let (all, short) = (room(4, 8), room(4, 2));
        let lighting = uneven(&all);
        let [emission, direct, indirect] = relight_passes(&all, &lighting, RelightOptions::default()).unwrap();
        let [whole, two] = [&all, &short].map(|matrix| relight_matrix(matrix, &lighting, RelightOptions::default()));
        let (whole, two) = (whole.unwrap(), two.unwrap());
        let first: Vec<f32> = emission.values().iter().zip(direct.values()).map(|(a, b)| a + b).collect();
        // Light is kept in nine bits by cluster, here by column.
        assert!(worst(&two, &first) < 1.0 / 512.0, "{}", worst(&two, &first));
        let sum: Vec<f32> = first.iter().zip(indirect.values()).map(|(first, indirect)| first + indirect).collect();
        assert!(worst(&whole, &sum) < 1e-6, "{}", worst(&whole, &sum));
        assert!(worst(&whole, &first) > 0.1, "there is indirect light");
    }

    /// More columns than clusters, of which some are lit and some are not.
    #[test]
    fn passes_sum_up_to_the_image_and_are_near_where_clusters_are_lit_unevenly() {
        let (all, short) = (room(8, 8), room(8, 2));
        let lighting = uneven(&all);
        let passes = relight_passes(&all, &lighting, RelightOptions::default()).unwrap();
        let [whole, two] = [&all, &short].map(|matrix| relight_matrix(matrix, &lighting, RelightOptions::default()));
        let (whole, two) = (whole.unwrap(), two.unwrap());
        let [first, sum]: [Vec<f32>; 2] = [2, 3].map(|count| {
            let values = |at: usize| passes[..count].iter().map(|image| image.values()[at]).sum();
            (0..whole.values().len()).map(values).collect()
        });
        assert!(worst(&whole, &sum) < 1e-6, "{}", worst(&whole, &sum));
        let relative = |a: &LinearImage, b: &[f32]| {
            let squares = a.values().iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
            (squares / a.values().iter().map(|a| f64::from(*a).powi(2)).sum::<f64>()).sqrt()
        };
        assert!(relative(&two, &first) < 0.1, "{}", relative(&two, &first));
    }
}
