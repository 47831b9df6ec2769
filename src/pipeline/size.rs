//! The cut for a file of so many bytes. What bits cost is estimated from entropies when a slope is chosen, which may be off
//! by a factor of several; here some blocks are really encoded.

use rayon::prelude::*;

use super::budget::on_threads;
use super::pack::Packing;
use crate::compress::{CandidateSummary, Cut, Target};
use crate::error::Result;
use crate::matrix::BlockId;

/// Blocks that are encoded for each guess, spread evenly; all of a small image.
const SAMPLE_BLOCKS: usize = 48;
/// Between one guess and the next while the slope is not yet enclosed, in powers of two.
const STRIDE: f64 = 3.0;
/// Guesses at most until it is: what noise or a fixed rank decide does not depend on the slope.
const MOST_STRIDES: usize = 10;
/// Halvings of the enclosed range: to a 40th of a power of two, which is less than 1 % of the bytes.
const HALVINGS: usize = 7;

impl Packing {
    /// The cut for the target; where that is a number of bytes, the one of the largest file that is not larger.
    pub(super) fn choose(&self, analysed: &[CandidateSummary]) -> Result<Cut> {
        let cut = self.compressor().choose(analysed.iter());
        match self.compressor().settings().target {
            Target::Bytes(bytes) if cut.slope > 0.0 => on_threads(self.threads(), || self.of_size(cut, bytes as f64))?,
            _ => Ok(cut),
        }
    }

    fn of_size(&self, cut: Cut, target_bytes: f64) -> Result<Cut> {
        let at = |exponent: f64| Cut { slope: exponent.exp2(), ..cut };
        let fits = |exponent: f64| Ok::<_, crate::Error>(self.bytes_at(&at(exponent))? <= target_bytes);
        let start = cut.slope.log2();
        let step = if fits(start)? { -STRIDE } else { STRIDE };
        let (mut inside, mut outside) = (start, start + step);
        for _ in 0..MOST_STRIDES {
            if fits(outside)? != (step < 0.0) {
                break;
            }
            (inside, outside) = (outside, outside + step);
        }
        // Larger slopes make smaller files.
        let (mut small, mut large) = (inside.max(outside), inside.min(outside));
        for _ in 0..HALVINGS {
            let middle = 0.5 * (small + large);
            if fits(middle)? { small = middle } else { large = middle }
        }
        Ok(at(small))
    }

    /// Bytes of the file that a cut makes, from those of the blocks of the sample.
    fn bytes_at(&self, cut: &Cut) -> Result<f64> {
        let blocks = self.shape().block_count() as usize;
        let sample: Vec<BlockId> =
            (0..blocks).step_by(blocks.div_ceil(SAMPLE_BLOCKS)).map(|i| BlockId(i as u32)).collect();
        let encode = |&id: &BlockId| -> Result<(usize, usize)> {
            let size = self.writer().encode(id, &self.candidate(id)?.0.cut(cut))?.size();
            Ok((size.bytes(), size.layer_bytes.len()))
        };
        let sizes = sample.par_iter().map(encode).collect::<Result<Vec<_>>>()?;
        let share = blocks as f64 / sample.len() as f64;
        let bytes = share * sizes.iter().map(|(bytes, _)| *bytes as f64).sum::<f64>();
        let layers = share * sizes.iter().map(|(_, layers)| *layers as f64).sum::<f64>();
        Ok(bytes + self.writer().overhead_bytes(layers.round() as u64) as f64)
    }
}
