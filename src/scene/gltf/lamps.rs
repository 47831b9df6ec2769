//! `KHR_lights_punctual`: points, spots and suns as a scene file would state them.

use std::path::Path;

use glam::{DMat3, Vec3};
use gltf::khr_lights_punctual::Kind;

use super::super::file::{LightEntry, LightEntryKind};
use super::nodes::Placed;
use crate::error::{Error, Result};

/// Lumens of a watt, as exporters of glTF reckon: what light of 555 nm has.
pub(super) const EXPORTERS_LUMENS_PER_WATT: f32 = 683.0;

/// The lamps of the nodes. Errors: colours and intensities that are negative or not finite, cones that are none.
pub(super) fn of(path: &Path, nodes: &[Placed<'_>], warnings: &mut Vec<String>) -> Result<Vec<LightEntry>> {
    let (mut lamps, mut ranged) = (Vec::new(), 0);
    for placed in nodes {
        let Some(light) = placed.node.light() else { continue };
        let refuse = |problem: String| {
            let place = format!("{}, lamp '{}'", path.display(), placed.name);
            Error::input(place, problem, "mend the lamp and export the file again")
        };
        let emission = light.color().map(|c| c * light.intensity() / EXPORTERS_LUMENS_PER_WATT);
        if !emission.iter().all(|v| *v >= 0.0 && v.is_finite()) {
            return Err(refuse("its colour or intensity is negative or not finite".into()));
        }
        ranged += usize::from(light.range().is_some());
        let position = placed.world.w_axis.truncate().to_array();
        let axis = (-DMat3::from_mat4(placed.world).z_axis).normalize_or_zero().as_vec3();
        let name = if placed.node.mesh().is_some() { format!("{} lamp", placed.name) } else { placed.name.clone() };
        let common = LightEntry { name: Some(name), emission: Some(emission), ..LightEntry::default() };
        if axis == Vec3::ZERO && !matches!(light.kind(), Kind::Point) {
            return Err(refuse("its node has no size, so that it points nowhere".into()));
        }
        lamps.push(match light.kind() {
            Kind::Point => LightEntry { kind: LightEntryKind::Point, position: Some(position), ..common },
            Kind::Directional => LightEntry {
                kind: LightEntryKind::Sun,
                towards: Some((-axis).to_array()),
                angular_radius_degrees: Some(0.0),
                ..common
            },
            Kind::Spot { inner_cone_angle, outer_cone_angle } => LightEntry {
                kind: LightEntryKind::Spot,
                position: Some(position),
                direction: Some(axis.to_array()),
                inner_degrees: Some(inner_cone_angle.to_degrees()),
                outer_degrees: Some(outer_cone_angle.to_degrees()),
                ..common
            },
        });
    }
    if ranged > 0 {
        warnings.push(format!("{}: {ranged} lamps state a range, which is not used: light has none", path.display()));
    }
    Ok(lamps)
}
