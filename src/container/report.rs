//! What a container knows of its own error, per block and as a whole.

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

/// How a container was made, for people and programs; where each figure comes from.
#[derive(Clone, Debug, Default, PartialEq, Eq, bincode::Encode, bincode::Decode)]
pub struct ContainerReport {
    /// Program and version that packed.
    pub program: String,
    /// Compression method, by name.
    pub method: String,
    /// What the rank and the steps were chosen for (a slope, a size, a PSNR), as text.
    pub target: String,
    /// The covariance of lightings that errors were weighed by, as text; empty for none.
    pub prior: String,
    /// All other settings, as text.
    pub settings: String,
    /// For each figure in the file, how it came about: (name, "measured against the stored matrix after quantisation").
    pub provenance: Vec<(String, String)>,
}

/// How far images of the whole picture are from those of the stored matrix, relative L2, after quantisation, over lightings
/// of every kind. NaN means not known.
#[derive(Clone, Copy, Debug, PartialEq, bincode::Encode, bincode::Decode)]
pub struct LightErrors {
    /// Under the prior's lightings, as it was expected when ranks and steps were chosen.
    pub prior: f32,
    /// All lights on, weight 1 each.
    pub all_on: f32,
    /// Root mean square under weights drawn evenly from 0 to 1 for each column by itself, over that of the images.
    pub random: f32,
    /// One column on alone: the mean over the columns that light anything.
    pub single_mean: f32,
    /// One column on alone: the worst.
    pub single_worst: f32,
    /// Which column that is.
    pub worst_column: u32,
    /// The noise of the samples in the stored images of single columns, in the same mean.
    pub noise_mean: f32,
    /// … and in that of the worst.
    pub noise_worst: f32,
}
