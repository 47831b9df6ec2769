//! What tracing knows of a block's noise.

/// Noise of a block, from its two half-sample estimates `A` and `B`.
///
/// The block is the mean of all samples. `D = √(m n) / (m + n) · (A − B)`, where the halves have `m` and `n` samples, has the
/// variance of that mean and, the halves being independent, no signal; with as many in both it is `(A − B) / 2`.
/// Emitters in view are no part of it: their entries are listed one by one ([`SeenEmission`](super::SeenEmission)) and kept as they are.
/// What is kept is small beside the block: marginals of `D²`, and `D Ω` for a few *probe* lightings `Ω`
/// (`light::probe_lightings`), which show noise that columns share and
/// independent entries would hide. All of it is of columns divided by their scales, see [`TracedBlock`](super::TracedBlock).
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
