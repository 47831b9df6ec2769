//! Lights for tests.

use ltm::light::{EnvironmentMapping, Light, LightBasis, LightKind};

/// Lamps of these names, each white and at 1.
pub(crate) fn lamps(names: &[&str]) -> LightBasis {
    let mut basis = LightBasis::new();
    for name in names {
        basis.push(Light::unplaced(*name, LightKind::Lamp)).unwrap();
    }
    basis
}

/// A sky by latitude and longitude, and a lamp.
pub(crate) fn sky_and_lamp() -> LightBasis {
    let (across, down) = (32, 16);
    let mapping = EnvironmentMapping::LatLong { across, down };
    let kind = LightKind::LatLong { across, down };
    let texels = || 0..mapping.texel_count();
    let sky = Light {
        places: texels().map(|texel| mapping.middle(texel).to_array()).collect(),
        extents: texels().map(|texel| mapping.solid_angle(texel)).collect(),
        ..Light::unplaced("sky", kind)
    };
    let mut basis = LightBasis::new();
    basis.push(sky).unwrap();
    basis.push(Light::unplaced("lamp", LightKind::Lamp)).unwrap();
    basis
}
