//! The product with right factors that are decoded to one value a column, in 8 or 16 bits: what coefficients are held against.

use ltm::container::ContainerReader;
use ltm::light::Lighting;
use ltm::matrix::{BlockId, CHANNELS, FactorSource};
use rayon::prelude::*;

const NARROW_PEAK: f32 = 127.0;
const WIDE_PEAK: f32 = 32_768.0;
const LANES: usize = 32;
const TILE: usize = 64;

/// A value that is turned into f32 without branches.
trait Held: Copy + Sync {
    fn to_f32(self) -> f32;
}

impl Held for i8 {
    #[inline(always)]
    fn to_f32(self) -> f32 {
        f32::from(self)
    }
}

impl Held for u16 {
    /// Of a 16-bit float that is neither subnormal nor infinite nor NaN.
    #[inline(always)]
    fn to_f32(self) -> f32 {
        let bits = u32::from(self);
        let magnitude = f32::from_bits((bits & 0x7fff) << 13) * f32::from_bits((112 + 127) << 23);
        f32::from_bits(magnitude.to_bits() | ((bits & 0x8000) << 16))
    }
}

/// The components of one factor, those in 8 bits apart from those in 16.
#[derive(Default)]
struct Factor {
    narrow: (Vec<u32>, Vec<i8>),
    wide: (Vec<u32>, Vec<u16>),
}

impl Factor {
    /// Returns the component's scale.
    fn push(&mut self, index: u32, values: &[f32], step: f32) -> f32 {
        let peak = values.iter().fold(0.0f32, |peak, v| peak.max(v.abs()));
        if peak == 0.0 {
            return 0.0;
        }
        // As fine as a quarter of the step, so that rounding is small beside quantisation.
        if peak / NARROW_PEAK <= 0.25 * step {
            let scale = peak / NARROW_PEAK;
            self.narrow.0.push(index);
            self.narrow.1.extend(values.iter().map(|v| (v / scale).round() as i8));
            return scale;
        }
        let scale = peak / WIDE_PEAK;
        self.wide.0.push(index);
        self.wide.1.extend(values.iter().map(|v| {
            let half = half::f16::from_f32(v / scale);
            if half.is_normal() { half.to_bits() } else { 0 }
        }));
        scale
    }

    fn bytes(&self) -> usize {
        self.narrow.1.len() + 2 * self.wide.1.len()
    }
}

struct Block {
    scales: Vec<f32>,
    left: Factor,
    right: Factor,
    rows: usize,
}

/// All factors of a container but its sparse entries.
pub(crate) struct Decoded {
    blocks: Vec<Block>,
    columns: usize,
}

impl Decoded {
    pub(crate) fn load(container: &ContainerReader) -> Self {
        let shape = container.shape();
        let inverse: Vec<f32> = container.column_scales().iter().map(|scale| scale.recip()).collect();
        let block = |id| {
            let mut block = container.read_block(BlockId(id)).unwrap();
            block.scale_columns(&inverse);
            let (mut left, mut right) = (Factor::default(), Factor::default());
            let scales = (0..block.rank()).map(|k| {
                let scale = left.push(k as u32, block.left_component(k), block.left_step[k]);
                scale * right.push(k as u32, block.right_component(k), block.right_step[k])
            });
            Block { scales: scales.collect(), left, right, rows: block.rows }
        };
        Self { blocks: (0..shape.block_count()).into_par_iter().map(block).collect(), columns: shape.columns() }
    }

    /// Bytes of left and of right factors.
    pub(crate) fn bytes(&self) -> [usize; 2] {
        let sum = |of: fn(&Block) -> &Factor| self.blocks.iter().map(|block| of(block).bytes()).sum();
        [sum(|block| &block.left), sum(|block| &block.right)]
    }

    /// Sets the rows of each block, channel-planar, to `L (R ℓ)`.
    pub(crate) fn product(&self, lighting: &Lighting, scales: &[f32], rows: &mut Vec<Vec<f32>>) {
        let channels = [0, 1, 2].map(|channel| {
            let mut weights = lighting.channel(channel);
            weights.iter_mut().zip(scales).for_each(|(weight, scale)| *weight *= scale);
            weights
        });
        rows.resize(self.blocks.len(), Vec::new());
        let columns = self.columns;
        self.blocks.par_iter().zip(rows).for_each(|(block, planes)| {
            pulp::Arch::new().dispatch(Product { block, columns, channels: &channels, planes });
        });
    }
}

/// The product of a block, compiled for the vectors that the machine has.
struct Product<'a> {
    block: &'a Block,
    columns: usize,
    channels: &'a [Vec<f32>; CHANNELS],
    planes: &'a mut Vec<f32>,
}

impl pulp::NullaryFnOnce for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { block, columns, channels, planes } = self;
        let mut projected = vec![[0.0f32; CHANNELS]; block.scales.len()];
        project(&block.right.narrow, columns, channels, &block.scales, &mut projected);
        project(&block.right.wide, columns, channels, &block.scales, &mut projected);
        planes.clear();
        planes.resize(block.rows, 0.0);
        let pixels = block.rows / CHANNELS;
        for (channel, plane) in planes.chunks_exact_mut(pixels).enumerate() {
            add(&block.left.narrow, block.rows, channel, &projected, plane);
            add(&block.left.wide, block.rows, channel, &projected, plane);
        }
    }
}

#[inline(always)]
fn project<'a, Q: Held>(
    (components, values): &(Vec<u32>, Vec<Q>),
    columns: usize,
    [red, green, blue]: &'a [Vec<f32>; CHANNELS],
    scales: &[f32],
    projected: &mut [[f32; CHANNELS]],
) {
    for (&k, values) in components.iter().zip(values.chunks_exact(columns)) {
        let mut sums = [[0.0f32; LANES]; CHANNELS];
        let (chunks, tail) = values.as_chunks::<LANES>();
        let whole = |weights: &'a [f32]| weights.as_chunks::<LANES>().0.iter();
        for (chunk, ((red, green), blue)) in chunks.iter().zip(whole(red).zip(whole(green)).zip(whole(blue))) {
            for i in 0..LANES {
                let value = chunk[i].to_f32();
                sums[0][i] += value * red[i];
                sums[1][i] += value * green[i];
                sums[2][i] += value * blue[i];
            }
        }
        let start = chunks.len() * LANES;
        for (i, value) in tail.iter().enumerate() {
            for (sums, weights) in sums.iter_mut().zip([red, green, blue]) {
                sums[i] += value.to_f32() * weights[start + i];
            }
        }
        projected[k as usize] = sums.map(|lanes| lanes.iter().sum::<f32>() * scales[k as usize]);
    }
}

#[inline(always)]
fn add<Q: Held>(
    (components, values): &(Vec<u32>, Vec<Q>),
    rows: usize,
    channel: usize,
    projected: &[[f32; CHANNELS]],
    plane: &mut [f32],
) {
    let first = channel * plane.len();
    let (tiles, tail) = plane.as_chunks_mut::<TILE>();
    let tail_start = first + tiles.len() * TILE;
    for (t, tile) in tiles.iter_mut().enumerate() {
        let start = first + t * TILE;
        let mut sums = *tile;
        for (&k, values) in components.iter().zip(values.chunks_exact(rows)) {
            let weight = projected[k as usize][channel];
            let values: &[Q; TILE] = values[start..start + TILE].try_into().expect("a whole tile");
            (0..TILE).for_each(|i| sums[i] += values[i].to_f32() * weight);
        }
        *tile = sums;
    }
    for (&k, values) in components.iter().zip(values.chunks_exact(rows)) {
        let weight = projected[k as usize][channel];
        tail.iter_mut().zip(&values[tail_start..]).for_each(|(sum, value)| *sum += value.to_f32() * weight);
    }
}
