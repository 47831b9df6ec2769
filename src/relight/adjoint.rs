//! The adjoint of relighting, `Tᵀ x` for each colour channel: what every column has in common with an image.
//!
//! A block `L R + S` gives `R' (L_ch' x_ch) + S_ch' x_ch`, where `x_ch` are the image's pixels in the block. Coefficients of
//! right sides are added up as such, and transformed back once for all blocks. The blocks of a
//! group are added up one after the other and the groups in their order, so that the bits are the same for any number of
//! threads. Several images are worked on in one pass over the factors, whose left sides are turned into f32 once for all of them.

use rayon::prelude::*;

use super::compact::{CompactBlock, Factor, FactorPart, Quantum, SparseEntries};
use super::cpu::CpuRelighter;
use super::damage::read_undamaged;
use super::lighting::total;
use super::right::RightFactor;
use crate::error::{Error, Result};
use crate::matrix::{
    BlockId, BlockSource, CHANNELS, ColumnTransform, FactorSource, MatrixShape, PixelRect, TracedBlock,
};

/// Groups of blocks at most, and bytes that their sums may take.
const GROUPS: usize = 64;
const GROUP_BYTES: usize = 64 << 20;

/// Independent sums of one dot product: as many as four of the widest vectors hold, so that additions overlap.
const LANES: usize = 64;

impl CpuRelighter {
    /// `Tᵀ x` for each channel: one value for each column. `images` has any number of images of the matrix's size, one
    /// after the other, each row by row; the result has one set of columns for each. Of a damaged block the readable
    /// part counts, as in relighting; a missing block counts 0.
    ///
    /// # Errors
    /// A number of pixels that is no whole number of images; a value that is not finite.
    pub fn adjoint(&self, images: &[[f32; CHANNELS]]) -> Result<Vec<[f64; CHANNELS]>> {
        let transform = self.column_transform();
        sum_blocks(self.shape(), self.column_scales(), Some(transform), images, |id, planes, sums| {
            match self.block(id) {
                Some(block) => set_compact(block, transform, planes, sums),
                None => sums.fill(0.0),
            }
            Ok(())
        })
    }
}

/// As [`CpuRelighter::adjoint`], without keeping factors: each thread holds one block at a time.
///
/// # Errors
/// Those of [`CpuRelighter::adjoint`] and of reading, damage among them.
pub fn adjoint_streaming(source: &dyn FactorSource, images: &[[f32; CHANNELS]]) -> Result<Vec<[f64; CHANNELS]>> {
    let transform = &*source.column_transform();
    sum_blocks(source.shape(), source.column_scales(), Some(transform), images, |id, planes, sums| {
        set_compact(&read_undamaged(source, transform, id)?, transform, planes, sums);
        Ok(())
    })
}

/// As [`CpuRelighter::adjoint`], from the entries of a raw matrix.
///
/// # Errors
/// Those of [`CpuRelighter::adjoint`] and of reading.
pub fn adjoint_raw(source: &dyn BlockSource, images: &[[f32; CHANNELS]]) -> Result<Vec<[f64; CHANNELS]>> {
    let shape = source.shape();
    let columns = shape.columns();
    sum_blocks(shape, &[], None, images, |id, planes, sums| {
        let pixels = shape.rect(id).pixels();
        // Of a block without entries no column is visited.
        sums.fill(0.0);
        let mut scratch = TracedBlock::default();
        source.visit_columns(id, 0..columns as u32, &mut scratch, &mut |column, entries| {
            // Images × channels, of either.
            let planes = planes.chunks_exact(pixels).zip(entries.chunks_exact(pixels).cycle());
            for (sums, (left, right)) in sums.chunks_exact_mut(columns).zip(planes) {
                sums[column.index()] = pulp::Arch::new().dispatch(Dot { left, right });
            }
        })
    })
}

/// Calls `set` for all blocks with the block's pixels (images × channels × pixels). Adds up its results (images ×
/// channels × columns), each column multiplied by its scale. With a transform it sets twice as many: coefficients first, then
/// what is not transformed.
fn sum_blocks(
    shape: MatrixShape,
    scales: &[f32],
    transform: Option<&ColumnTransform>,
    images: &[[f32; CHANNELS]],
    set: impl Fn(BlockId, &[f32], &mut [f32]) -> Result<()> + Sync,
) -> Result<Vec<[f64; CHANNELS]>> {
    let (width, size) = (shape.width() as usize, shape.width() as usize * shape.height() as usize);
    if !images.len().is_multiple_of(size) {
        let problem = format!("has {} pixels, the matrix {width} × {}", images.len(), shape.height());
        return Err(Error::input("image", problem, ""));
    }
    let (blocks, columns, count) = (shape.block_count() as usize, shape.columns(), images.len() / size);
    if count == 0 {
        return Ok(Vec::new());
    }
    let one = count * CHANNELS * columns;
    let values = if transform.is_some() { 2 * one } else { one };
    let groups = GROUPS.min(GROUP_BYTES / (values * size_of::<f64>())).clamp(1, blocks);
    let of_group = |group: usize| -> Result<Vec<f64>> {
        let (mut group_sums, mut sums, mut planes) = (vec![0.0f64; values], vec![0.0; values], Vec::new());
        for id in group * blocks / groups..(group + 1) * blocks / groups {
            let id = BlockId(id as u32);
            let gather = PixelGather { images, size, width, rect: shape.rect(id), planes: &mut planes };
            if !pulp::Arch::new().dispatch(gather) {
                return Err(not_finite(images, size, width));
            }
            set(id, &planes, &mut sums)?;
            group_sums.iter_mut().zip(&sums).for_each(|(total, &sum)| *total += f64::from(sum));
        }
        Ok(group_sums)
    };
    let parts: Vec<_> = (0..groups).into_par_iter().map(of_group).collect::<Result<_>>()?;
    let mut totals = vec![0.0f64; values];
    for part in parts {
        totals.iter_mut().zip(part).for_each(|(total, sum)| *total += sum);
    }
    if let Some(transform) = transform {
        let (coefficients, direct) = totals.split_at_mut(one);
        for (coefficients, direct) in coefficients.chunks_exact_mut(columns).zip(direct.chunks_exact(columns)) {
            let values = transform.values(coefficients);
            coefficients
                .iter_mut()
                .zip(values)
                .zip(direct)
                .for_each(|((total, value), direct)| *total = value + direct);
        }
        totals.truncate(one);
    }
    for totals in totals.chunks_exact_mut(columns) {
        totals.iter_mut().zip(scales).for_each(|(total, &scale)| *total *= f64::from(scale));
    }
    let of_image = |totals: &[f64]| {
        (0..columns).map(|column| [0, 1, 2].map(|channel| totals[channel * columns + column])).collect::<Vec<_>>()
    };
    Ok(totals.chunks_exact(CHANNELS * columns).flat_map(of_image).collect())
}

/// The error that names the first value that is not finite.
fn not_finite(images: &[[f32; CHANNELS]], size: usize, width: usize) -> Error {
    let at = images.iter().position(|pixel| !pixel.iter().all(|value| value.is_finite())).unwrap_or(0);
    let (image, x, y) = (at / size, at % size % width, at % size / width);
    Error::input(format!("image {image}, pixel {x}, {y}"), "is not finite", "give every pixel a finite value")
}

/// Sets `planes` to the pixels of a block, images × channels × pixels, and says whether all are finite; compiled for the
/// vectors that the machine has. Not a closure: what wraps one is compiled without them.
struct PixelGather<'a> {
    images: &'a [[f32; CHANNELS]],
    /// Pixels of an image, and of a row of it.
    size: usize,
    width: usize,
    rect: PixelRect,
    planes: &'a mut Vec<f32>,
}

impl pulp::NullaryFnOnce for PixelGather<'_> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let Self { images, size, width, rect, planes } = self;
        planes.clear();
        for image in images.chunks_exact(size) {
            for channel in 0..CHANNELS {
                for y in rect.y as usize..(rect.y + rect.height) as usize {
                    let row = &image[y * width + rect.x as usize..][..rect.width as usize];
                    planes.extend(row.iter().map(|pixel| pixel[channel]));
                }
            }
        }
        planes.iter().fold(true, |all, value| all & value.is_finite())
    }
}

fn set_compact(block: &CompactBlock, transform: &ColumnTransform, planes: &[f32], sums: &mut [f32]) {
    match block.is_empty() {
        true => sums.fill(0.0),
        false => pulp::Arch::new().dispatch(SetCompact { block, transform, planes, sums }),
    }
}

/// Sets the sums to `R' (s L' x)`, then `S' x`; compiled as [`PixelGather`].
struct SetCompact<'a> {
    block: &'a CompactBlock,
    transform: &'a ColumnTransform,
    planes: &'a [f32],
    sums: &'a mut [f32],
}

impl pulp::NullaryFnOnce for SetCompact<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { block, transform, planes, sums } = self;
        let CompactBlock { left, right, sparse, .. } = block;
        let mut weights = vec![[0.0f32; CHANNELS]; block.rank()];
        let (coefficients, direct) = sums.split_at_mut(sums.len() / 2);
        let of_image = CHANNELS * transform.columns();
        if planes.len() == left.length {
            set_image(left, right, transform, planes, &mut weights, coefficients);
        } else {
            let left = left.widen();
            for (planes, sums) in planes.chunks_exact(left.length).zip(coefficients.chunks_exact_mut(of_image)) {
                set_image(&left, right, transform, planes, &mut weights, sums);
            }
        }
        direct.fill(0.0);
        for (planes, sums) in planes.chunks_exact(left.length).zip(direct.chunks_exact_mut(of_image)) {
            add_sparse(sparse, planes, transform.columns(), sums);
        }
    }
}

/// Sets the sums of one image, channels × coefficients.
#[inline(always)]
fn set_image<N: Quantum, W: Quantum>(
    left: &Factor<N, W>,
    right: &RightFactor,
    transform: &ColumnTransform,
    planes: &[f32],
    weights: &mut [[f32; CHANNELS]],
    sums: &mut [f32],
) {
    weights.fill([0.0; CHANNELS]);
    weigh(&left.narrow, planes, weights);
    weigh(&left.wide, planes, weights);
    right.spread(weights, transform.tiles(), transform.columns(), sums);
}

/// Adds `S' x` of one image to its sums, channels × columns.
#[inline(always)]
fn add_sparse(sparse: &SparseEntries, planes: &[f32], columns: usize, sums: &mut [f32]) {
    let (pixels, mut begin) = (planes.len() / CHANNELS, 0);
    for &(column, end) in &sparse.ends {
        for entry in begin as usize..end as usize {
            let row = sparse.rows[entry] as usize;
            sums[row / pixels * columns + column as usize] += sparse.values[entry] * planes[row];
        }
        begin = end;
    }
}

/// Sets `weights[k] = L_ch' x_ch` for each component of the part and each channel.
#[inline(always)]
fn weigh<Q: Quantum>(part: &FactorPart<Q>, planes: &[f32], weights: &mut [[f32; CHANNELS]]) {
    let pixels = planes.len() / CHANNELS;
    for (&k, values) in part.components.iter().zip(part.values.chunks_exact(planes.len())) {
        let channels = values.chunks_exact(pixels).zip(planes.chunks_exact(pixels));
        for (weight, (values, plane)) in weights[k as usize].iter_mut().zip(channels) {
            *weight = dot(values, plane);
        }
    }
}

#[inline(always)]
fn dot<Q: Quantum>(left: &[Q], right: &[f32]) -> f32 {
    let mut sums = [0.0f32; LANES];
    let ((left, left_tail), (right, right_tail)) = (left.as_chunks::<LANES>(), right.as_chunks::<LANES>());
    for (left, right) in left.iter().zip(right) {
        for i in 0..LANES {
            sums[i] += left[i].to_f32() * right[i];
        }
    }
    for (i, (left, right)) in left_tail.iter().zip(right_tail).enumerate() {
        sums[i] += left.to_f32() * right;
    }
    total(sums)
}

/// A dot product of entries as they are stored; compiled as [`PixelGather`].
struct Dot<'a> {
    left: &'a [f32],
    right: &'a [f32],
}

impl pulp::NullaryFnOnce for Dot<'_> {
    type Output = f32;

    #[inline(always)]
    fn call(self) -> f32 {
        dot(self.left, self.right)
    }
}

#[cfg(test)]
mod tests {
    use super::super::random::{Random, numbers, random_lighting};
    use super::*;
    use crate::image::LinearImage;
    use crate::light::Lighting;
    use crate::relight::relight_raw;

    fn random_image(shape: MatrixShape, seed: u64) -> LinearImage {
        let mut random = numbers(seed);
        let mut image = LinearImage::black(shape.width(), shape.height());
        image.pixels.iter_mut().flatten().for_each(|value| *value = random());
        image
    }

    /// `⟨T ℓ, x⟩`, `⟨ℓ, Tᵀ x⟩`, and the product of the norms of what is multiplied, for each channel.
    fn products(lit: &LinearImage, x: &LinearImage, lighting: &Lighting, adjoint: &[[f64; 3]]) -> [(f64, f64, f64); 3] {
        [0, 1, 2].map(|channel| {
            let f = |v: &[f32; 3]| f64::from(v[channel]);
            let of_image: f64 = lit.pixels.iter().zip(&x.pixels).map(|(a, b)| f(a) * f(b)).sum();
            let of_columns: f64 = lighting.weights().iter().zip(adjoint).map(|(w, a)| f(w) * a[channel]).sum();
            let norm = |pixels: &[[f32; 3]]| pixels.iter().map(|v| f(v).powi(2)).sum::<f64>().sqrt();
            (of_image, of_columns, norm(&lit.pixels) * norm(&x.pixels))
        })
    }

    #[test]
    fn the_adjoint_moves_the_matrix_to_the_other_side_of_the_product() {
        // Blocks of every kind of edge, and columns that are no whole number of strips.
        for (width, height, columns) in [(37, 21, 7), (16, 16, 1), (40, 20, 1101)] {
            let shape = MatrixShape::new(width, height, columns.max(3), 16).unwrap();
            let source = Random(shape);
            let (x, lighting) = (random_image(shape, 7), random_lighting(shape, 8));
            let relighter = CpuRelighter::load(&source).unwrap();
            let resident = relighter.adjoint(&x.pixels).unwrap();
            // Sums of at most some thousand f32 products.
            for (a, b, norm) in products(&relighter.relight(&lighting).unwrap(), &x, &lighting, &resident) {
                assert!((a - b).abs() < 1e-6 * norm, "{a} {b} {norm}");
            }
            assert_eq!(adjoint_streaming(&source, &x.pixels).unwrap(), resident);
            let raw = adjoint_raw(&source, &x.pixels).unwrap();
            let lit = relight_raw(&source, std::slice::from_ref(&lighting)).unwrap().remove(0);
            for (a, b, norm) in products(&lit, &x, &lighting, &raw) {
                assert!((a - b).abs() < 1e-6 * norm, "{a} {b} {norm}");
            }
        }
    }

    #[test]
    fn a_batch_has_the_bits_of_its_images_one_by_one() {
        let shape = MatrixShape::new(37, 21, 45, 16).unwrap();
        let source = Random(shape);
        let relighter = CpuRelighter::load(&source).unwrap();
        let images: Vec<_> = (0..3).map(|seed| random_image(shape, seed).pixels).collect();
        let batch = relighter.adjoint(&images.concat()).unwrap();
        let raw = adjoint_raw(&source, &images.concat()).unwrap();
        for (i, image) in images.iter().enumerate() {
            let range = i * shape.columns()..(i + 1) * shape.columns();
            assert_eq!(batch[range.clone()], relighter.adjoint(image).unwrap());
            assert_eq!(raw[range], adjoint_raw(&source, image).unwrap());
        }
        assert_eq!(adjoint_streaming(&source, &images.concat()).unwrap(), batch);
    }

    #[test]
    fn the_number_of_threads_does_not_change_a_bit() {
        let shape = MatrixShape::new(100, 90, 40, 8).unwrap();
        let relighter = CpuRelighter::load(&Random(shape)).unwrap();
        let x = random_image(shape, 3);
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| relighter.adjoint(&x.pixels).unwrap())
        };
        assert_eq!(with(1), with(5));
    }

    #[test]
    fn images_of_another_size_and_values_that_are_no_number_are_refused() {
        let shape = MatrixShape::new(20, 10, 4, 8).unwrap();
        let relighter = CpuRelighter::load(&Random(shape)).unwrap();
        assert!(relighter.adjoint(&vec![[0.0; 3]; 199]).is_err() && relighter.adjoint(&[]).unwrap().is_empty());
        let mut image = LinearImage::black(20, 10);
        image.pixels[23][1] = f32::NAN;
        let error = relighter.adjoint(&image.pixels).unwrap_err().to_string();
        assert!(error.contains("image 0, pixel 3, 1"), "{error}");
    }
}
