//! Lights in the units in which they are bought: cd/m², lm, W, cd, lx.

use std::f64::consts::PI;

use super::mixer::Mix;
use ltm::image::{LUMENS_PER_WATT, luminance};
use ltm::light::{Light, LightBasis, LightKind, LightUnit};

/// A unit in which a light can be stated and set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Mean luminance of a surface, cd/m².
    Luminance,
    /// Luminous intensity, cd: of a spot on its axis, of a measured luminaire at its peak.
    Intensity,
    /// Luminous flux, lm: of a surface that sends light to one side evenly, of a point to all sides.
    Flux,
    /// Radiant flux, W, at the 179 lm/W of white light.
    Power,
    /// Illuminance on a plane that faces the light, lx.
    Illuminance,
}

impl Quantity {
    /// The sign of its unit.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Luminance => "cd/m²",
            Self::Intensity => "cd",
            Self::Flux => "lm",
            Self::Power => "W",
            Self::Illuminance => "lx",
        }
    }
}

/// The quantities that are known of a light, the most usual first, each with its value at a mean luminance of the light's
/// weights of 1. `metres_per_unit`: 0 where unknown; then what needs a length is left out.
pub fn quantities(light: &Light, metres_per_unit: f32) -> Vec<(Quantity, f64)> {
    let lumens = f64::from(LUMENS_PER_WATT);
    match light.unit {
        LightUnit::Radiance if light.kind.is_environment() => vec![(Quantity::Luminance, lumens)],
        LightUnit::Radiance => {
            let area = light.extents.iter().map(|v| f64::from(*v)).sum::<f64>() * f64::from(metres_per_unit).powi(2);
            let mut known = vec![(Quantity::Luminance, lumens)];
            // Lambert's emitter: Φ = π A L.
            if area > 0.0 {
                known.extend([(Quantity::Flux, PI * area * lumens), (Quantity::Power, PI * area)]);
            }
            known
        }
        LightUnit::Intensity => match light.kind {
            LightKind::Point => {
                let all_around = 4.0 * PI;
                vec![
                    (Quantity::Flux, all_around * lumens),
                    (Quantity::Intensity, lumens),
                    (Quantity::Power, all_around),
                ]
            }
            LightKind::Lamp
            | LightKind::AreaTexels { .. }
            | LightKind::LatLong { .. }
            | LightKind::Octahedral { .. }
            | LightKind::Spot
            | LightKind::Patches { .. }
            | LightKind::Sun
            | LightKind::Suns { .. }
            | LightKind::Ies
            | LightKind::Image => vec![(Quantity::Intensity, lumens)],
        },
        LightUnit::Irradiance => vec![(Quantity::Illuminance, lumens)],
        LightUnit::Multiple => Vec::new(),
    }
}

/// Mean luminance of a light's weights, were it on, at its own and its groups' stops: over the area of a surface or the solid
/// angle of an environment.
pub fn mean_weight(basis: &LightBasis, mix: &Mix, index: usize) -> f64 {
    let (light, own) = (&basis.lights()[index], &mix.lights[index]);
    let gain = f64::from(mix.stops(index)).exp2();
    let colour = own.colour(light);
    let Some(pattern) = &own.pattern else { return gain * f64::from(luminance(colour)) };
    let turned = pattern.turned(light.kind, own.turn_radians);
    let (mut sum, mut whole) = (0.0, 0.0);
    for (texel, &extent) in turned.texels().iter().zip(&light.extents) {
        let weight = [0, 1, 2].map(|ch: usize| colour[ch] * texel[ch]);
        sum += f64::from(luminance(weight)) * f64::from(extent);
        whole += f64::from(extent);
    }
    if whole > 0.0 { gain * sum / whole } else { 0.0 }
}

/// Stops by which a light is to change to have a value; none where it is dark, or the value is no positive number.
pub fn stops_to(now: f64, wanted: f64) -> Option<f32> {
    let stops = (wanted / now).log2() as f32;
    (now > 0.0 && wanted > 0.0 && stops.is_finite()).then_some(stops)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pattern::Pattern;

    fn light(kind: LightKind, unit: LightUnit, extent: f32) -> Light {
        let mut light = Light { unit, ..Light::unplaced("a", kind) };
        light.extents.iter_mut().for_each(|own| *own = extent);
        light
    }

    fn values(light: &Light, metres: f32) -> Vec<(&'static str, f64)> {
        quantities(light, metres).into_iter().map(|(quantity, value)| (quantity.unit(), value)).collect()
    }

    #[test]
    fn each_kind_of_light_has_the_units_that_are_known_of_it() {
        let near = |known: &[(&str, f64)], expected: &[(&str, f64)]| {
            assert_eq!(known.len(), expected.len(), "{known:?}");
            for (a, b) in known.iter().zip(expected) {
                assert!(a.0 == b.0 && (a.1 / b.1 - 1.0).abs() < 1e-6, "{a:?} for {b:?}");
            }
        };
        // A panel of 2 × 1 texels of 0.5 square units of 2 m: 4 m².
        let panel = light(LightKind::AreaTexels { across: 2, down: 1 }, LightUnit::Radiance, 0.5);
        near(&values(&panel, 2.0), &[("cd/m²", 179.0), ("lm", 4.0 * PI * 179.0), ("W", 4.0 * PI)]);
        near(&values(&panel, 0.0), &[("cd/m²", 179.0)]);
        let point = light(LightKind::Point, LightUnit::Intensity, 0.0);
        near(&values(&point, 1.0), &[("lm", 4.0 * PI * 179.0), ("cd", 179.0), ("W", 4.0 * PI)]);
        near(&values(&light(LightKind::Spot, LightUnit::Intensity, 0.0), 1.0), &[("cd", 179.0)]);
        near(&values(&light(LightKind::Sun, LightUnit::Irradiance, 0.0), 0.0), &[("lx", 179.0)]);
        near(
            &values(&light(LightKind::LatLong { across: 4, down: 2 }, LightUnit::Radiance, 1.0), 1.0),
            &[("cd/m²", 179.0)],
        );
        near(&values(&light(LightKind::Image, LightUnit::Multiple, 1.0), 1.0), &[]);
    }

    #[test]
    fn the_mean_weight_counts_stops_groups_and_patterns() {
        let mut basis = LightBasis::new();
        for name in ["row 1", "row 2"] {
            let kind = LightKind::AreaTexels { across: 2, down: 1 };
            let extents = vec![1.0, 3.0];
            basis.push(Light { extents, emission: [2.0; 3], ..Light::unplaced(name, kind) }).unwrap();
        }
        let mut mix = Mix::of_scene(&basis);
        assert!((mean_weight(&basis, &mix, 0) - 2.0).abs() < 1e-6);
        mix.lights[0].stops = 1.0;
        mix.groups.group_mut(0).stops = 1.0;
        let mut pattern = Pattern::white((2, 1));
        pattern.texels_mut()[1] = [0.0; 3];
        mix.lights[0].pattern = Some(pattern);
        // 2 · 2¹⁺¹ over a quarter of the area.
        assert!((mean_weight(&basis, &mix, 0) - 2.0).abs() < 1e-6);
        assert_eq!(stops_to(2.0, 8.0), Some(2.0));
        assert_eq!((stops_to(0.0, 8.0), stops_to(2.0, 0.0), stops_to(2.0, f64::NAN)), (None, None, None));
    }
}
