//! The cut for a file of a given size. The entropies by which a slope is chosen may be wrong by a factor of several, so
//! some blocks are encoded.

use super::Cut;
use crate::error::Result;

/// Exponent of two from one guess to the next while the slope is not bracketed.
const STRIDE: f64 = 3.0;
/// Largest number of such guesses. Noise or a fixed rank may prevent a bracket, since they do not depend on the slope.
const MAX_STRIDES: usize = 10;
/// Bisections of the bracket: to a 40th of a power of two of the slope.
const HALVINGS: usize = 7;

/// The cut whose file is the largest of at most `target_bytes`. It is that of `start` with another slope; `bytes_at`
/// gives the size of a cut's file.
///
/// # Errors
/// Those of `bytes_at`.
pub fn cut_of_size(start: Cut, target_bytes: u64, bytes_at: impl Fn(&Cut) -> Result<f64>) -> Result<Cut> {
    let at = |exponent: f64| Cut { slope: exponent.exp2(), ..start };
    let fits = |exponent: f64| Ok::<_, crate::Error>(bytes_at(&at(exponent))? <= target_bytes as f64);
    let start = start.slope.log2();
    let step = if fits(start)? { -STRIDE } else { STRIDE };
    let (mut inside, mut outside) = (start, start + step);
    for _ in 0..MAX_STRIDES {
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
