//! The noise of a block, as tracing measures it.

/// Noise of a block, from its two half-sample estimates `A` and `B`.
///
/// The block is the mean of all samples. With `m` and `n` samples in the halves, `D = √(m n) / (m + n) · (A − B)` has
/// the variance of that mean and, since the halves are independent, no signal. For equal halves it is `(A − B) / 2`.
/// Emitters in view are not included: their entries are listed one by one ([`SeenEmission`](super::SeenEmission)) and
/// kept as they are.
///
/// The stored data are small beside the block: marginals of `D²`, and `D Ω` for a few *probe* lightings `Ω`
/// (`light::probe_lightings`), which show noise shared by columns. All of it is of columns divided by their scales, see
/// [`TracedBlock`](super::TracedBlock).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BlockNoise {
    /// For each row, the mean over columns of `D²`.
    pub row_variance: Vec<f32>,
    /// For each column, the mean over rows of `D²`.
    pub column_variance: Vec<f32>,
    /// `D Ω`: rows × probes, column-major.
    pub probes: Vec<f32>,
}

impl BlockNoise {
    /// Mean of `D²` over the whole block: the variance of an entry.
    pub fn mean_variance(&self) -> f64 {
        let sum: f64 = self.row_variance.iter().map(|&v| f64::from(v)).sum();
        if self.row_variance.is_empty() { 0.0 } else { sum / self.row_variance.len() as f64 }
    }
}
