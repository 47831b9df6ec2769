//! Lights for tests.

use ltm::light::{Light, LightBasis, LightKind};

/// Lamps of these names, each white and at 1.
pub(crate) fn lamps(names: &[&str]) -> LightBasis {
    let mut basis = LightBasis::new();
    for name in names {
        basis.push(Light::unplaced(*name, LightKind::Lamp)).unwrap();
    }
    basis
}
