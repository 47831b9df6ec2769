//! Tests of hypotheses.

/// Chance that counts at least this far from their expectations come up (Pearson's χ²); bins of few are pooled.
pub(crate) fn chi_square_p_value(counts: &[u32], expected: &[f64]) -> f64 {
    let mut bins: Vec<(f64, f64)> = counts.iter().map(|&c| f64::from(c)).zip(expected.iter().copied()).collect();
    bins.sort_by(|a, b| a.1.total_cmp(&b.1));
    let (mut statistic, mut freedom) = (0.0, -1.0);
    let (mut seen, mut wanted) = (0.0, 0.0);
    for (i, bin) in bins.iter().enumerate() {
        (seen, wanted) = (seen + bin.0, wanted + bin.1);
        if wanted >= 8.0 || i + 1 == bins.len() {
            statistic += (seen - wanted) * (seen - wanted) / wanted.max(1e-3);
            freedom += 1.0;
            (seen, wanted) = (0.0, 0.0);
        }
    }
    // Wilson and Hilferty 1931: the cube root of χ²/k is nearly normal.
    let spread = 2.0 / (9.0 * f64::max(freedom, 1.0));
    let z = ((statistic / f64::max(freedom, 1.0)).cbrt() - (1.0 - spread)) / spread.sqrt();
    1.0 - normal_cdf(z)
}

/// Standard normal distribution function (Zelen and Severo 1964, error below 7.5e-8).
pub(crate) fn normal_cdf(z: f64) -> f64 {
    if z < 0.0 {
        return 1.0 - normal_cdf(-z);
    }
    let t = 1.0 / (1.0 + 0.231_641_9 * z);
    let poly = [1.330_274_429, -1.821_255_978, 1.781_477_937, -0.356_563_782, 0.319_381_530];
    let sum = poly.iter().fold(0.0, |acc, c| acc * t + c) * t;
    1.0 - (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt() * sum
}

#[test]
fn wrong_counts_are_noticed_and_right_ones_pass() {
    let expected = vec![100.0; 50];
    let mut counts = vec![100u32; 50];
    counts.iter_mut().step_by(2).for_each(|c| *c += 10);
    counts.iter_mut().skip(1).step_by(2).for_each(|c| *c -= 10);
    // χ² = 50 of 49 degrees of freedom: 0.43.
    assert!((chi_square_p_value(&counts, &expected) - 0.433).abs() < 0.01);
    counts[0] = 180;
    assert!(chi_square_p_value(&counts, &expected) < 1e-4);
}
