//! `KHR_lights_punctual`: points, spots and suns as a scene file would state them.

use std::f32::consts::FRAC_PI_4;
use std::path::Path;

use glam::{DMat3, Vec3};

use super::super::file::{LightEntry, LightEntryKind};
use super::nodes::Placed;
use super::plain;
use super::tree::JsonItem;
use crate::error::{Error, Result, Warnings};

/// Lumens of a watt, as exporters of glTF reckon: what light of 555 nm has.
pub(super) const EXPORTERS_LUMENS_PER_WATT: f32 = 683.0;

/// A range from which on it is none: exporters write the largest number that they have.
const NO_RANGE: f32 = 1e30;
/// How much an inner cone may exceed the outer one by rounding, in radians.
const ROUNDING: f32 = 1e-3;

/// The lamps of the nodes. Errors: colours and intensities that are negative or not finite, cones that are none.
pub(super) fn of(path: &Path, nodes: &[Placed<'_>], warnings: &mut Warnings) -> Result<Vec<LightEntry>> {
    let (mut lamps, mut ranged) = (Vec::new(), 0);
    for placed in nodes {
        let Some(light) = &placed.light else { continue };
        let refuse = |problem: String| {
            let place = format!("{}, lamp '{}'", path.display(), placed.name);
            Error::input(place, problem, "mend the lamp and export the file again")
        };
        let intensity = light.number("intensity")?.unwrap_or(1.0);
        let colour: [f32; 3] = light.numbers("color")?.unwrap_or([1.0; 3]);
        let emission = colour.map(|c| c * intensity / EXPORTERS_LUMENS_PER_WATT);
        if !emission.iter().all(|v| *v >= 0.0 && v.is_finite()) {
            return Err(refuse("its colour or intensity is negative or not finite".into()));
        }
        let position = placed.world.w_axis.truncate().to_array();
        let axis = (-DMat3::from_mat4(placed.world).z_axis).normalize_or_zero().as_vec3();
        let name = if placed.mesh.is_some() { format!("{} lamp", placed.name) } else { placed.name.clone() };
        let common = LightEntry { name: Some(name), emission: Some(emission), ..LightEntry::default() };
        let kind = light.text("type")?;
        if axis == Vec3::ZERO && kind != Some("point") {
            return Err(refuse("its node has no size, so that it points nowhere".into()));
        }
        lamps.push(match kind {
            Some("point") => LightEntry { kind: LightEntryKind::Point, position: Some(position), ..common },
            Some("directional") => LightEntry {
                kind: LightEntryKind::Sun,
                towards: Some((-axis).to_array()),
                angular_radius_degrees: Some(0.0),
                ..common
            },
            Some("spot") => {
                let [inner, outer] = cones(light)?;
                LightEntry {
                    kind: LightEntryKind::Spot,
                    position: Some(position),
                    direction: Some(axis.to_array()),
                    inner_degrees: Some(inner.to_degrees()),
                    outer_degrees: Some(outer.to_degrees()),
                    ..common
                }
            }
            other => {
                let kind = other.map_or_else(|| "no type".into(), |kind| format!("the type \"{}\"", plain(kind)));
                let advice = "points, spots and directional lights are read; it is left out";
                warnings.push(format!("{}: the lamp '{}' has {kind}: {advice}", path.display(), placed.name));
                continue;
            }
        });
        ranged += usize::from(light.number("range").ok().flatten().is_some_and(|r| r > 0.0 && r < NO_RANGE));
    }
    if ranged > 0 {
        warnings.push(format!("{}: {ranged} lamps state a range, which is not used: light has none", path.display()));
    }
    Ok(lamps)
}

/// The half angles of a spot's cones, in radians; the format's own where the file states none.
fn cones(light: &JsonItem<'_>) -> Result<[f32; 2]> {
    let (mut inner, mut outer) = (0.0, FRAC_PI_4);
    if let Some(spot) = light.object("spot")? {
        inner = spot.number("innerConeAngle")?.unwrap_or(inner);
        outer = spot.number("outerConeAngle")?.unwrap_or(outer);
    }
    if inner > outer && inner < outer + ROUNDING {
        inner = outer;
    }
    Ok([inner, outer])
}
