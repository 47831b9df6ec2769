//! Images against a reference with mean and variance.

/// How far renders are from a reference, in standard deviations of the difference.
#[derive(Debug)]
pub(crate) struct Comparison {
    /// Mean over entries of z².
    pub(crate) mean_square: f64,
    /// Entries beyond 4.5 deviations.
    pub(crate) far: usize,
    /// Entries compared.
    pub(crate) entries: usize,
    /// Difference of the whole images, in deviations.
    pub(crate) whole: f64,
    /// The same, relative to the reference.
    pub(crate) relative: f64,
}

/// Compares independent renders with the mean and the variance of that mean of a reference. `counts` says which entries
/// stand for the whole image: channels that come of the same paths are not independent.
pub(crate) fn compare(
    renders: &[Vec<f64>],
    (expected, their_variance): (&[f64], &[f64]),
    counts: impl Fn(usize) -> bool,
) -> Comparison {
    let n = renders.len() as f64;
    let (mut squares, mut far) = (0.0, 0);
    let (mut difference, mut variance, mut total) = (0.0, 0.0, 0.0);
    for entry in 0..expected.len() {
        let mean = renders.iter().map(|r| r[entry]).sum::<f64>() / n;
        let ours = renders.iter().map(|r| (r[entry] - mean).powi(2)).sum::<f64>() / (n - 1.0) / n;
        // Rounding of f32 sums, where neither side has noise (a light seen directly).
        let both = ours + their_variance[entry] + (1e-5 * expected[entry]).powi(2) + 1e-12;
        let z = (mean - expected[entry]) / both.sqrt();
        squares += z * z;
        far += usize::from(z.abs() > 4.5);
        if counts(entry) {
            (difference, variance, total) =
                (difference + mean - expected[entry], variance + both, total + expected[entry]);
        }
    }
    Comparison {
        mean_square: squares / expected.len() as f64,
        far,
        entries: expected.len(),
        whole: difference / variance.sqrt(),
        relative: difference / total,
    }
}

/// Mean, and variance of the mean, from a file of `tests/references`.
pub(crate) fn reference(name: &str) -> (Vec<f64>, Vec<f64>) {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/references/{name}.f32"));
    let bytes = std::fs::read(&path).unwrap();
    let values: Vec<f64> =
        bytes.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap()))).collect();
    let (mean, variance) = values.split_at(values.len() / 2);
    (mean.to_vec(), variance.to_vec())
}

/// Writes the mean of renders, and the variance of that mean, as the references are written, and says where.
pub(crate) fn write_evidence(name: &str, renders: &[Vec<f64>]) -> String {
    let n = renders.len() as f64;
    let mean = |entry: usize| renders.iter().map(|r| r[entry]).sum::<f64>() / n;
    let variance = |entry: usize| renders.iter().map(|r| (r[entry] - mean(entry)).powi(2)).sum::<f64>() / (n - 1.0) / n;
    let entries = 0..renders.first().map_or(0, Vec::len);
    let values = entries.clone().map(mean).chain(entries.map(variance));
    let bytes: Vec<u8> = values.flat_map(|value| (value as f32).to_le_bytes()).collect();
    let path = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-found.f32"));
    match std::fs::write(&path, bytes) {
        Ok(()) => format!("what was rendered is in {}", path.display()),
        Err(error) => format!("{}: {error}", path.display()),
    }
}

impl std::fmt::Display for Comparison {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { mean_square, far, entries, whole, relative } = self;
        write!(f, "mean z² {mean_square:.3}, {far} of {entries} entries beyond 4.5 deviations; ")?;
        write!(f, "the images differ by {relative:.5}, {whole:.2} deviations")
    }
}
