//! Means over seeds, and how sure they are.

/// Quantile 0.975 of Student's t for 1, 2, … degrees of freedom.
const T_QUANTILES: [f64; 4] = [12.706, 4.303, 3.182, 2.776];

/// The mean; not a number of none.
pub(super) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

/// Half of the interval of 95 % of a mean of normal draws; none for one draw.
pub(super) fn half_interval(draws: &[f64]) -> Option<f64> {
    let quantile = T_QUANTILES.get(draws.len().checked_sub(2)?)?;
    let centre = mean(draws.iter().copied());
    let variance = draws.iter().map(|draw| (draw - centre).powi(2)).sum::<f64>() / (draws.len() - 1) as f64;
    Some(quantile * (variance / draws.len() as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_of_a_mean_is_students() {
        // Mean 2, standard deviation 1, three draws: 4.303 / √3.
        assert!((half_interval(&[1.0, 2.0, 3.0]).unwrap() - 4.303 / 3f64.sqrt()).abs() < 1e-12);
        assert_eq!(half_interval(&[1.0]), None);
    }
}
