//! Numbers as the panels show them.

/// A number in about three digits.
pub(super) fn short(value: f32) -> String {
    match value.abs() {
        v if v == 0.0 || (0.001..1.0).contains(&v) => format!("{value:.3}"),
        v if (1.0..10.0).contains(&v) => format!("{value:.2}"),
        v if (10.0..100.0).contains(&v) => format!("{value:.1}"),
        v if (100.0..100_000.0).contains(&v) => format!("{value:.0}"),
        _ => format!("{value:.1e}"),
    }
}
