//! The cut for a file of so many bytes. What bits cost is estimated from entropies when a slope is chosen, which may be off
//! by a factor of several; here some blocks are really encoded.

use super::Cut;
use crate::error::Result;

/// Between one guess and the next while the slope is not yet enclosed, in powers of two.
const STRIDE: f64 = 3.0;
/// Guesses at most until it is: what noise or a fixed rank decide does not depend on the slope.
const MAX_STRIDES: usize = 10;
/// Halvings of the enclosed range: to a 40th of a power of two, which is less than 1 % of the bytes.
const HALVINGS: usize = 7;

/// The cut, at another slope than that of `start`, of the largest file of at most `target_bytes`, where `bytes_at` says how large
/// a cut makes it.
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
