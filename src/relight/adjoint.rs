//! The adjoint of relighting, `Tᵀ x` for each colour channel: what every column has in common with an image.
//!
//! A block `L R + S` gives `R' (L_ch' x_ch) + S_ch' x_ch`, where `x_ch` are the image's pixels in the block. The blocks of a
//! group are added up one after the other and the groups in their order, so that the bits are the same for any number of
//! threads.

use rayon::prelude::*;

use super::compact::{CompactBlock, Part, Quantum};
use super::cpu::{CpuRelighter, check_size};
use super::damage::read_undamaged;
use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::matrix::{BlockId, BlockSource, CHANNELS, FactorSource, MatrixShape, PixelRect, TracedBlock};

/// Groups of blocks at most, and bytes that their sums may take.
const GROUPS: usize = 64;
const GROUP_BYTES: usize = 256 << 20;

/// Columns that are added to for all components before the next: their sums stay in the first-level cache.
const STRIP: usize = 1024;

/// Independent sums of one dot product.
const LANES: usize = 16;

impl CpuRelighter {
    /// `Tᵀ x` for each channel: one value a column. Of a damaged block what stands is taken, as in relighting; a hole gives
    /// nothing.
    ///
    /// # Errors
    /// An image of another size than the matrix, or with a value that is not finite.
    pub fn adjoint(&self, image: &LinearImage) -> Result<Vec<[f64; CHANNELS]>> {
        let shape = self.shape();
        sum_blocks(shape, image, |id, planes, sums| {
            if let Some(block) = self.block(id) {
                add_compact(block, planes, sums);
            }
            Ok(())
        })
    }
}

/// As [`CpuRelighter::adjoint`], without keeping factors: each thread holds one block at a time.
///
/// # Errors
/// Those of [`CpuRelighter::adjoint`] and of reading, damage among them.
pub fn adjoint_streaming(source: &dyn FactorSource, image: &LinearImage) -> Result<Vec<[f64; CHANNELS]>> {
    let shape = source.shape();
    sum_blocks(shape, image, |id, planes, sums| {
        add_compact(&read_undamaged(source, shape, id)?, planes, sums);
        Ok(())
    })
}

/// As [`CpuRelighter::adjoint`], from the entries of a raw matrix.
///
/// # Errors
/// Those of [`CpuRelighter::adjoint`] and of reading.
pub fn adjoint_raw(source: &dyn BlockSource, image: &LinearImage) -> Result<Vec<[f64; CHANNELS]>> {
    let shape = source.shape();
    sum_blocks(shape, image, |id, planes, sums| {
        let pixels = planes.len() / CHANNELS;
        let mut scratch = TracedBlock::default();
        source.visit_columns(id, 0..shape.columns() as u32, &mut scratch, &mut |column, entries| {
            let planes = entries.chunks_exact(pixels).zip(planes.chunks_exact(pixels));
            for (sums, (left, right)) in sums.channels.iter_mut().zip(planes) {
                sums[column.index()] += pulp::Arch::new().dispatch(Dot { left, right });
            }
        })
    })
}

/// Sums of one block, channel by channel: one value a column.
struct Sums {
    channels: [Vec<f32>; CHANNELS],
}

/// Runs `add` over all blocks with the block's pixels, channel-planar, and adds up what it gives.
fn sum_blocks(
    shape: MatrixShape,
    image: &LinearImage,
    add: impl Fn(BlockId, &[f32], &mut Sums) -> Result<()> + Sync,
) -> Result<Vec<[f64; CHANNELS]>> {
    check_size(shape, image)?;
    if let Some(at) = image.pixels.iter().position(|pixel| !pixel.iter().all(|value| value.is_finite())) {
        let (x, y) = (at % image.width as usize, at / image.width as usize);
        return Err(Error::input(format!("image, pixel {x}, {y}"), "is not finite", "give every pixel a finite value"));
    }
    let (blocks, columns) = (shape.block_count() as usize, shape.columns());
    let groups = GROUPS.min(GROUP_BYTES / (columns * size_of::<[f64; CHANNELS]>())).clamp(1, blocks);
    let of_group = |group: usize| -> Result<Vec<[f64; CHANNELS]>> {
        let mut group_sums = vec![[0.0f64; CHANNELS]; columns];
        let mut sums = Sums { channels: [0, 1, 2].map(|_| vec![0.0; columns]) };
        let mut planes = Vec::new();
        for id in group * blocks / groups..(group + 1) * blocks / groups {
            let id = BlockId(id as u32);
            gather(image, shape.rect(id), &mut planes);
            sums.channels.iter_mut().for_each(|sums| sums.fill(0.0));
            add(id, &planes, &mut sums)?;
            for (channel, sums) in sums.channels.iter().enumerate() {
                group_sums.iter_mut().zip(sums).for_each(|(total, &sum)| total[channel] += f64::from(sum));
            }
        }
        Ok(group_sums)
    };
    let parts: Vec<_> = (0..groups).into_par_iter().map(of_group).collect::<Result<_>>()?;
    let mut total = vec![[0.0; CHANNELS]; columns];
    for part in parts {
        for (total, part) in total.iter_mut().zip(part) {
            (0..CHANNELS).for_each(|channel| total[channel] += part[channel]);
        }
    }
    Ok(total)
}

/// The pixels of a block, channel-planar as its rows.
fn gather(image: &LinearImage, rect: PixelRect, planes: &mut Vec<f32>) {
    planes.clear();
    for channel in 0..CHANNELS {
        for y in rect.y as usize..(rect.y + rect.height) as usize {
            let row = &image.pixels[y * image.width as usize + rect.x as usize..][..rect.width as usize];
            planes.extend(row.iter().map(|pixel| pixel[channel]));
        }
    }
}

fn add_compact(block: &CompactBlock, planes: &[f32], sums: &mut Sums) {
    if !block.is_empty() {
        pulp::Arch::new().dispatch(AddCompact { block, planes, sums });
    }
}

/// Adds `R' (s L' x) + S' x` to the sums, compiled for the vectors that the machine has. Not a closure: what wraps one is
/// compiled without them.
struct AddCompact<'a> {
    block: &'a CompactBlock,
    planes: &'a [f32],
    sums: &'a mut Sums,
}

impl pulp::NullaryFnOnce for AddCompact<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { block, planes, sums } = self;
        let mut weights = vec![[0.0f32; CHANNELS]; block.rank()];
        weigh(&block.left.narrow, planes, &mut weights);
        weigh(&block.left.wide, planes, &mut weights);
        for (weights, scale) in weights.iter_mut().zip(&block.scales) {
            *weights = weights.map(|weight| weight * scale);
        }
        let columns = block.right.length;
        for first in (0..columns).step_by(STRIP) {
            let strip = (first, STRIP.min(columns - first));
            spread(&block.right.narrow, columns, strip, &weights, sums);
            spread(&block.right.wide, columns, strip, &weights, sums);
        }
        let (pixels, mut begin) = (planes.len() / CHANNELS, 0);
        for &(column, end) in &block.sparse.ends {
            for entry in begin as usize..end as usize {
                let row = block.sparse.rows[entry] as usize;
                sums.channels[row / pixels][column as usize] += block.sparse.values[entry] * planes[row];
            }
            begin = end;
        }
    }
}

/// Sets `weights[k] = L_ch' x_ch` for each component of the part and each channel.
#[inline(always)]
fn weigh<Q: Quantum>(part: &Part<Q>, planes: &[f32], weights: &mut [[f32; CHANNELS]]) {
    let pixels = planes.len() / CHANNELS;
    for (&k, values) in part.components.iter().zip(part.values.chunks_exact(planes.len())) {
        let channels = values.chunks_exact(pixels).zip(planes.chunks_exact(pixels));
        for (weight, (values, plane)) in weights[k as usize].iter_mut().zip(channels) {
            *weight = dot(values, plane);
        }
    }
}

/// Adds `R_k` times its weights to the columns of a strip, given as (first, count).
#[inline(always)]
fn spread<Q: Quantum>(
    part: &Part<Q>,
    columns: usize,
    (first, count): (usize, usize),
    weights: &[[f32; CHANNELS]],
    sums: &mut Sums,
) {
    let [red, green, blue] = &mut sums.channels;
    let (red, green, blue) = (&mut red[first..][..count], &mut green[first..][..count], &mut blue[first..][..count]);
    for (&k, values) in part.components.iter().zip(part.values.chunks_exact(columns)) {
        let values = &values[first..][..count];
        let weights = weights[k as usize];
        for i in 0..count {
            let value = values[i].to_f32();
            red[i] += value * weights[0];
            green[i] += value * weights[1];
            blue[i] += value * weights[2];
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
    sums.iter().sum()
}

/// A dot product of entries as they are stored.
struct Dot<'a> {
    left: &'a [f32],
    right: &'a [f32],
}

impl pulp::NullaryFnOnce for Dot<'_> {
    type Output = f32;

    #[inline(always)]
    fn call(self) -> f32 {
        let mut sums = [0.0f32; LANES];
        let (left, left_tail) = self.left.as_chunks::<LANES>();
        let (right, right_tail) = self.right.as_chunks::<LANES>();
        for (left, right) in left.iter().zip(right) {
            for i in 0..LANES {
                sums[i] += left[i] * right[i];
            }
        }
        for (i, (left, right)) in left_tail.iter().zip(right_tail).enumerate() {
            sums[i] += left * right;
        }
        sums.iter().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::Lighting;
    use crate::matrix::{ColumnIndex, FactoredBlock, SparseEntry};
    use crate::relight::relight_raw;
    use rand::RngExt;
    use rand::SeedableRng;

    /// Blocks of random factors, some in 8 bits, with sparse entries; one block is black.
    struct Random(MatrixShape);

    impl FactorSource for Random {
        fn shape(&self) -> MatrixShape {
            self.0
        }

        fn layer_count(&self, id: BlockId) -> u32 {
            u32::from(id.0 != 1)
        }

        fn encoded_bytes(&self, _: BlockId, _: std::ops::Range<u32>) -> u64 {
            0
        }

        fn read_layers(&self, id: BlockId, _: std::ops::Range<u32>) -> Result<FactoredBlock> {
            let (rows, columns, rank) = (self.0.rect(id).rows(), self.0.columns(), 5);
            if id.0 == 1 {
                return Ok(FactoredBlock { rows, columns, ..Default::default() });
            }
            let mut random = rand_pcg::Pcg64::seed_from_u64(u64::from(id.0));
            let mut values = |count: usize| (0..count).map(|_| random.random_range(-1.0f32..1.0)).collect::<Vec<_>>();
            let (left, right) = (values(rows * rank), values(columns * rank));
            let sparse = [(0, 3), (2, 0), (2, rows as u32 - 1)].map(|(column, row)| SparseEntry {
                column: ColumnIndex(column),
                row,
                value: 4.0,
            });
            let step = vec![0.05, 0.0, 0.1, 0.0, 0.05];
            let (left_step, right_step) = (step.clone(), step);
            Ok(FactoredBlock { rows, columns, left, right, left_step, right_step, sparse: sparse.to_vec() })
        }
    }

    impl BlockSource for Random {
        fn shape(&self) -> MatrixShape {
            self.0
        }

        fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> Result<()> {
            target.block = self.read_layers(id, 0..1)?.expand();
            Ok(())
        }
    }

    fn random_image(shape: MatrixShape, seed: u64) -> LinearImage {
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        let mut image = LinearImage::black(shape.width(), shape.height());
        image.pixels.iter_mut().flatten().for_each(|value| *value = random.random_range(-1.0..1.0));
        image
    }

    fn random_lighting(shape: MatrixShape, seed: u64) -> Lighting {
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        Lighting::new((0..shape.columns()).map(|_| [0; 3].map(|_| random.random_range(-1.0..1.0))).collect()).unwrap()
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
        // Blocks of every kind of edge, and more columns than a strip.
        for (width, height, columns) in [(37, 21, 7), (16, 16, 1), (40, 20, STRIP as u32 + 77)] {
            let shape = MatrixShape::new(width, height, columns.max(3), 16).unwrap();
            let source = Random(shape);
            let (x, lighting) = (random_image(shape, 7), random_lighting(shape, 8));
            let relighter = CpuRelighter::load(&source).unwrap();
            let resident = relighter.adjoint(&x).unwrap();
            // Sums of at most some thousand f32 products.
            for (a, b, norm) in products(&relighter.relight(&lighting).unwrap(), &x, &lighting, &resident) {
                assert!((a - b).abs() < 1e-6 * norm, "{a} {b} {norm}");
            }
            assert_eq!(adjoint_streaming(&source, &x).unwrap(), resident);
            let raw = adjoint_raw(&source, &x).unwrap();
            let lit = relight_raw(&source, std::slice::from_ref(&lighting)).unwrap().remove(0);
            for (a, b, norm) in products(&lit, &x, &lighting, &raw) {
                assert!((a - b).abs() < 1e-6 * norm, "{a} {b} {norm}");
            }
        }
    }

    #[test]
    fn the_number_of_threads_does_not_change_a_bit() {
        let shape = MatrixShape::new(100, 90, 40, 8).unwrap();
        let relighter = CpuRelighter::load(&Random(shape)).unwrap();
        let x = random_image(shape, 3);
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| relighter.adjoint(&x).unwrap())
        };
        assert_eq!(with(1), with(5));
    }

    #[test]
    fn images_of_another_size_and_values_that_are_no_number_are_refused() {
        let shape = MatrixShape::new(20, 10, 4, 8).unwrap();
        let relighter = CpuRelighter::load(&Random(shape)).unwrap();
        assert!(relighter.adjoint(&LinearImage::black(10, 20)).is_err());
        let mut image = LinearImage::black(20, 10);
        image.pixels[23][1] = f32::NAN;
        let error = relighter.adjoint(&image).unwrap_err().to_string();
        assert!(error.contains("pixel 3, 1"), "{error}");
    }
}
