//! Lights and weights as Python gives and takes them.

use ltm::light::{Light, LightBasis, LightKind, LightUnit, Lighting, SkyPatches};
use ltm::matrix::CHANNELS;
use ltm::{Error, Result};

/// A light as a tuple: name, kind, unit, texels (across, down), emission, places, extents.
pub(crate) type LightTuple = (String, String, String, (u32, u32), [f32; 3], Vec<[f32; 3]>, Vec<f32>);

pub(crate) fn to_tuple(light: &Light) -> LightTuple {
    (
        light.name.clone(),
        light.kind.name().to_owned(),
        unit_name(light.unit).to_owned(),
        light.layout(),
        light.emission,
        light.places.clone(),
        light.extents.clone(),
    )
}

fn unit_name(unit: LightUnit) -> &'static str {
    match unit {
        LightUnit::Radiance => "radiance",
        LightUnit::Intensity => "intensity",
        LightUnit::Irradiance => "irradiance",
        LightUnit::Multiple => "multiple",
    }
}

/// The basis of these lights. Errors: an unknown kind or unit, and those of [`LightBasis::push`].
pub(crate) fn basis_of(lights: Vec<LightTuple>) -> Result<LightBasis> {
    let mut basis = LightBasis::new();
    for (name, kind, unit, (across, down), emission, places, extents) in lights {
        let unknown = |what: &str, value: &str, hint: &str| {
            Error::input(format!("light '{name}'"), format!("'{value}' is no {what}"), hint)
        };
        let kind = match kind.as_str() {
            "lamp" => LightKind::Lamp,
            "area" => LightKind::AreaTexels { across, down },
            "lat-long" => LightKind::LatLong { across, down },
            "octahedral" => LightKind::Octahedral { side: across },
            "point" => LightKind::Point,
            "spot" => LightKind::Spot,
            "sun" => LightKind::Sun,
            "ies" => LightKind::Ies,
            "image" => LightKind::Image,
            "suns" => LightKind::Suns { count: across },
            "patches" => match SkyPatches::of_count(across).filter(|_| (1..=2).contains(&down)) {
                Some(patches) => LightKind::Patches { subdivision: patches.subdivision(), is_split: down == 2 },
                None => {
                    return Err(unknown("number of patches", &format!("{across} × {down}"), "146, 578, 1298, 2306, …"));
                }
            },
            _ => {
                let hint = "kinds are lamp, area, lat-long, octahedral, point, spot, sun, ies, image, patches, suns";
                return Err(unknown("kind", &kind, hint));
            }
        };
        let unit = match unit.as_str() {
            "radiance" => LightUnit::Radiance,
            "intensity" => LightUnit::Intensity,
            "irradiance" => LightUnit::Irradiance,
            "multiple" => LightUnit::Multiple,
            _ => return Err(unknown("unit", &unit, "units are radiance, intensity, irradiance, multiple")),
        };
        basis.push(Light { name, kind, unit, emission, first_column: 0, places, extents })?;
    }
    Ok(basis)
}

/// Lightings from weights that lie one lighting after the other, each columns × channels.
pub(crate) fn lightings_of(weights: &[f32], columns: usize) -> Result<Vec<Lighting>> {
    let (weights, _) = weights.as_chunks::<CHANNELS>();
    weights.chunks(columns).map(|weights| Lighting::new(weights.to_vec())).collect()
}
