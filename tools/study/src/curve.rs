//! Curves through measured points: values between them, gains between curves, slopes.

use ltm::error::Result;

/// How often an interval is halved that brackets a size.
const HALVINGS: usize = 9;

/// Two exponents of two, near each other, between which a size passes a target that lies between those at `ends`: it falls as the
/// exponent rises.
///
/// Errors: those of `bytes`.
pub(super) fn bracket(ends: (f64, f64), target: f64, bytes: &mut dyn FnMut(f64) -> Result<u64>) -> Result<[f64; 2]> {
    let (mut fine, mut coarse) = ends;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (fine + coarse);
        if bytes(middle)? as f64 > target {
            fine = middle;
        } else {
            coarse = middle;
        }
    }
    Ok([fine, coarse])
}

/// How much higher one curve lies than another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Gain {
    pub(super) least: f64,
    pub(super) mean: f64,
}

/// The value at `x` of the straight lines between points, in any order; none outside them.
pub fn at(points: &[(f64, f64)], x: f64) -> Option<f64> {
    let mut points = points.to_vec();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    if let Some(exact) = points.iter().find(|p| p.0 == x) {
        return Some(exact.1);
    }
    let pair = points.windows(2).find(|pair| pair[0].0 < x && x < pair[1].0)?;
    let share = (x - pair[0].0) / (pair[1].0 - pair[0].0);
    Some(pair[0].1 + share * (pair[1].1 - pair[0].1))
}

/// The gain of `ours` over `theirs` at the points of either curve that lie within the other; none if there are none. Beyond
/// its last point ours stays what it was: it may take fewer bytes than it is given.
pub(super) fn gain(ours: &[(f64, f64)], theirs: &[(f64, f64)]) -> Option<Gain> {
    let last = ours.iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
    let of_ours = |x: f64| if x > last.0 { Some(last.1) } else { at(ours, x) };
    let gains: Vec<f64> = ours.iter().chain(theirs).filter_map(|p| Some(of_ours(p.0)? - at(theirs, p.0)?)).collect();
    let least = gains.iter().copied().fold(f64::INFINITY, f64::min);
    (!gains.is_empty()).then(|| Gain { least, mean: gains.iter().sum::<f64>() / gains.len() as f64 })
}

/// Slope of the straight line through points on logarithmic axes, by least squares; none with fewer than two.
pub(super) fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<(f64, f64)> =
        points.iter().filter(|p| p.0 > 0.0 && p.1 > 0.0).map(|p| (p.0.ln(), p.1.ln())).collect();
    let count = logs.len() as f64;
    let mean = logs.iter().fold((0.0, 0.0), |s, p| (s.0 + p.0 / count, s.1 + p.1 / count));
    let spread: f64 = logs.iter().map(|p| (p.0 - mean.0).powi(2)).sum();
    let along: f64 = logs.iter().map(|p| (p.0 - mean.0) * (p.1 - mean.1)).sum();
    (spread > 0.0).then(|| along / spread)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_of_a_power_is_its_exponent() {
        let points = [1.0, 2.0, 8.0].map(|x: f64| (x, 3.0 * x.powf(1.5)));
        assert!((slope(&points).unwrap() - 1.5).abs() < 1e-12);
        assert_eq!(slope(&points[..1]), None);
    }

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
        assert_eq!(gain(&points, &[(9.0, 1.0), (10.0, 2.0)]), Some(Gain { least: 2.0, mean: 2.5 }));
        assert_eq!(gain(&points, &[(-9.0, 1.0), (-8.0, 2.0)]), None);
    }
}
