//! What is known of the error of one packed block.

/// Error and noise of one packed block. The container keeps each figure as a 32-bit float; NaN means not known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockReport {
    /// `Σ (packed − stored)²` over all entries, after quantisation.
    pub squared_error: f64,
    /// `Σ stored²` over all entries.
    pub squared_norm: f64,
    /// Variance of the noise of a stored entry, from the two half-sample estimates.
    pub noise_variance: f64,
    /// Relative L2 error of the block's pixels with all lights on (weight 1 each).
    pub uniform_error: f64,
}

impl Default for BlockReport {
    /// Nothing known.
    fn default() -> Self {
        Self { squared_error: f64::NAN, squared_norm: f64::NAN, noise_variance: f64::NAN, uniform_error: f64::NAN }
    }
}

impl BlockReport {
    /// `‖packed − stored‖ / ‖stored‖` (Frobenius); 0 for a black block that is kept exactly.
    pub fn relative_error(&self) -> f64 {
        if self.squared_error == 0.0 { 0.0 } else { (self.squared_error / self.squared_norm).sqrt() }
    }
}
