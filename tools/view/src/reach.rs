//! What each light brings to the whole picture, and by the rows of a pixel to that.

use ltm::image::luminance;
use ltm::light::LightBasis;
use ltm::light::Lighting;
use ltm::matrix::{CHANNELS, CodedBlock, ColumnTransform, FactorSource, MatrixShape};

/// Sums over blocks for [`TexelReach`].
pub(super) struct ReachSums {
    shape: MatrixShape,
    sums: BlockSums,
}

/// The sums of the rows of a block, of columns divided by their scales: of its right sides as coefficients, and of its sparse
/// entries by column.
pub(super) struct BlockSums {
    coefficients: Vec<[f64; CHANNELS]>,
    columns: Vec<[f64; CHANNELS]>,
}

impl BlockSums {
    fn zeros(columns: usize) -> Self {
        Self { coefficients: vec![[0.0; CHANNELS]; columns], columns: vec![[0.0; CHANNELS]; columns] }
    }

    /// Those of one block: `(1ᵀ L) R` and `1ᵀ S`, so the rows are summed before the columns are made.
    pub(super) fn of(block: &CodedBlock, pixels: usize) -> Self {
        let factors = &block.factors;
        let mut sums = Self::zeros(factors.columns);
        for row in &block.right {
            let left = factors.left_component(row.component as usize);
            let step = f64::from(row.step);
            let weights = [0, 1, 2]
                .map(|channel| step * left[channel * pixels..][..pixels].iter().map(|&v| f64::from(v)).sum::<f64>());
            for (sum, &value) in sums.coefficients.iter_mut().zip(&row.values).filter(|(_, value)| **value != 0) {
                (0..CHANNELS).for_each(|channel| sum[channel] += weights[channel] * f64::from(value));
            }
        }
        for entry in &factors.sparse {
            sums.columns[entry.column.index()][entry.row as usize / pixels] += f64::from(entry.value);
        }
        sums
    }
}

impl ReachSums {
    pub(super) fn new(shape: MatrixShape) -> Self {
        Self { shape, sums: BlockSums::zeros(shape.columns()) }
    }

    pub(super) fn add(&mut self, of_block: &BlockSums) {
        let BlockSums { coefficients, columns } = &mut self.sums;
        for (sums, added) in [(coefficients, &of_block.coefficients), (columns, &of_block.columns)] {
            sums.as_flattened_mut().iter_mut().zip(added.as_flattened()).for_each(|(sum, added)| *sum += added);
        }
    }

    pub(super) fn reach(&self, transform: &ColumnTransform, scales: &[f32]) -> TexelReach {
        let pixels = f64::from(self.shape.width()) * f64::from(self.shape.height());
        let channels = [0, 1, 2].map(|channel| {
            let coefficients: Vec<f64> = self.sums.coefficients.iter().map(|sum| sum[channel]).collect();
            transform.values(&coefficients)
        });
        let columns = self.sums.columns.iter().enumerate();
        let per_column = columns.map(|(column, direct)| {
            let scale = scales.get(column).map_or(1.0, |&scale| f64::from(scale));
            [0, 1, 2].map(|channel| ((channels[channel][column] + direct[channel]) * scale / pixels) as f32)
        });
        TexelReach { per_column: per_column.collect() }
    }
}

/// The mean over all pixels of what a weight 1 on each column brings, per channel.
#[derive(Clone, Debug, PartialEq)]
pub struct TexelReach {
    per_column: Vec<[f32; CHANNELS]>,
}

impl TexelReach {
    /// Measures all columns in one pass over the factors. Blocks that cannot be read count as black.
    ///
    /// Cost of a block: rows × rank + 3 × rank × columns products.
    pub fn measure(source: &dyn FactorSource) -> Self {
        let shape = source.shape();
        let mut sums = ReachSums::new(shape);
        for id in shape.blocks() {
            let Ok(block) = source.read_coded(id, source.layer_count(id)) else { continue };
            sums.add(&BlockSums::of(&block, shape.rect(id).pixels()));
        }
        sums.reach(&source.column_transform(), source.column_scales())
    }

    /// What each light brings under `lighting`: the mean luminance of the picture that it makes alone.
    pub fn contributions(&self, basis: &LightBasis, lighting: &Lighting) -> Vec<f32> {
        per_light(basis, &self.per_column, lighting)
    }
}

/// Luminance that each light brings, from what each column brings at weight 1.
pub fn per_light(basis: &LightBasis, per_column: &[[f32; CHANNELS]], lighting: &Lighting) -> Vec<f32> {
    let weights = lighting.weights();
    let of_column = |column: usize| luminance([0, 1, 2].map(|ch| per_column[column][ch] * weights[column][ch]));
    let of_light = |columns: std::ops::Range<u32>| columns.map(|column| of_column(column as usize)).sum();
    basis.lights().iter().map(|light| of_light(light.columns())).collect()
}
