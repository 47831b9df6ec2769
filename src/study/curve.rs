//! Curves through measured points: values between them, gains between curves, slopes.

/// How much higher one curve lies than another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Gain {
    pub(super) least: f64,
    pub(super) mean: f64,
}

/// The value at `x` of the straight lines between points, in any order; none outside them.
pub(super) fn at(points: &[(f64, f64)], x: f64) -> Option<f64> {
    let mut points = points.to_vec();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    if let Some(exact) = points.iter().find(|p| p.0 == x) {
        return Some(exact.1);
    }
    let pair = points.windows(2).find(|pair| pair[0].0 < x && x < pair[1].0)?;
    let share = (x - pair[0].0) / (pair[1].0 - pair[0].0);
    Some(pair[0].1 + share * (pair[1].1 - pair[0].1))
}

/// The gain of `ours` over `theirs` at the points of either curve that lie within the other; none if there are none.
pub(super) fn gain(ours: &[(f64, f64)], theirs: &[(f64, f64)]) -> Option<Gain> {
    let gains: Vec<f64> = ours.iter().chain(theirs).filter_map(|p| Some(at(ours, p.0)? - at(theirs, p.0)?)).collect();
    let least = gains.iter().copied().fold(f64::INFINITY, f64::min);
    (!gains.is_empty()).then(|| Gain { least, mean: gains.iter().sum::<f64>() / gains.len() as f64 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_lie_on_the_lines_and_nowhere_else() {
        let points = [(2.0, 4.0), (0.0, 0.0), (4.0, 4.0)];
        assert_eq!(
            (at(&points, 1.0), at(&points, 3.0), at(&points, 4.0), at(&points, 4.1)),
            (Some(2.0), Some(4.0), Some(4.0), None)
        );
        let lower = [(1.0, 0.0), (3.0, 1.0)];
        // At 1: 2 − 0, at 2: 4 − 0.5, at 3: 4 − 1.
        assert_eq!(gain(&points, &lower), Some(Gain { least: 2.0, mean: (2.0 + 3.5 + 3.0) / 3.0 }));
        assert_eq!(gain(&points, &[(9.0, 1.0), (10.0, 2.0)]), None);
    }
}
