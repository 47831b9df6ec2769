//! What a scene file or a glTF file holds.

use std::path::Path;

use ltm::Result;
use ltm::glam::Vec2;
use ltm::scene::{Camera, LoadOptions, Projection, SceneSurvey, in_file, survey};
use ltm_cli::say;
use ltm_cli::words::in_flags;
use serde_json::json;

use super::{MAX_LISTED, lights_json, print_json, print_lights, print_more};

pub(super) fn run(path: &Path, as_json: bool, allow_outside: bool, memory_bytes: Option<u64>) -> Result<()> {
    let found =
        survey(path, &LoadOptions { allow_missing: true, allow_outside, memory_bytes, ..LoadOptions::default() })?;
    if as_json {
        print_as_json(path, &found);
    } else {
        print(path, &found);
    }
    Ok(())
}

fn print(path: &Path, found: &SceneSurvey) {
    let (camera, basis) = (&found.scene.camera, &found.scene.basis);
    let [x, y, z] = in_file(found.scene.origin, camera.eye).to_array();
    say!("{}", path.display());
    say!("image        {} × {} pixels", camera.width, camera.height);
    say!("camera       at {x:.2} {y:.2} {z:.2}, {}", seen_by(camera));
    if !found.cameras.is_empty() {
        say!("cameras      {}", found.cameras.len());
        found.cameras.iter().take(MAX_LISTED).for_each(|name| say!("  {name}"));
        print_more(found.cameras.len());
    }
    say!("triangles    {}", found.scene.mesh.triangles.len());
    print_lights(basis);
    say!("columns      {}", basis.column_count());
    say!("materials    {}", found.scene.materials.len());
    for (material, triangles) in found.materials().take(MAX_LISTED) {
        let (name, surface) = (&material.name, material.surface.name());
        let opacity = if material.opacity < 1.0 { format!(", opacity {:.3}", material.opacity) } else { String::new() };
        say!("  {name:<24} {surface}{opacity}, {triangles} triangles");
    }
    print_more(found.scene.materials.len());
    if !found.warnings.is_empty() {
        say!("remarks      {}", found.warnings.len());
        found.warnings.worded(in_flags).iter().for_each(|line| say!("  {line}"));
    }
    if let Some(problem) = &found.refused {
        say!("cannot be rendered: {problem}");
    }
}

/// What a camera sees, and how.
fn seen_by(camera: &Camera) -> String {
    let mut text = match camera.projection {
        Projection::Perspective { vertical_fov_radians } => {
            format!("{:.1}° from the lower to the upper edge", vertical_fov_radians.to_degrees())
        }
        Projection::Orthographic { height } => format!("orthographic, {height} from the lower to the upper edge"),
        Projection::Panorama => "panorama of all directions".into(),
    };
    if camera.shift != Vec2::ZERO {
        text += &format!(", shifted by {} {}", camera.shift.x, camera.shift.y);
    }
    if camera.pixel_aspect != 1.0 {
        text += &format!(", pixels {} times as wide as high", camera.pixel_aspect);
    }
    if let Some(lens) = camera.lens {
        text += &format!(", lens of radius {} focused at {}", lens.radius, lens.focus_distance);
        text += &if lens.blades == 0 { String::new() } else { format!(" with {} blades", lens.blades) };
    }
    text
}

fn print_as_json(path: &Path, found: &SceneSurvey) {
    let camera = &found.scene.camera;
    let materials = found.materials().map(|(material, triangles)| {
        json!({ "name": material.name, "surface": material.surface.name(), "opacity": material.opacity, "triangles": triangles })
    });
    print_json(json!({
        "file": path.display().to_string(), "kind": "scene",
        "camera": {
            "eye": in_file(found.scene.origin, camera.eye).to_array(), "forward": camera.forward.to_array(), "up": camera.up.to_array(),
            "projection": camera.projection.name(),
            "vertical_fov_degrees": camera.vertical_fov_radians().map(f32::to_degrees),
            "view_height": match camera.projection { Projection::Orthographic { height } => Some(height), _ => None },
            "shift": camera.shift.to_array(), "pixel_aspect": camera.pixel_aspect,
            "lens": camera.lens.map(|lens| json!({
                "radius": lens.radius, "focus_distance": lens.focus_distance, "blades": lens.blades,
                "blade_rotation_degrees": lens.rotation_radians.to_degrees(),
            })),
            "width": camera.width, "height": camera.height,
        },
        "cameras": found.cameras, "triangles": found.scene.mesh.triangles.len(),
        "columns": found.scene.basis.column_count(), "lights": lights_json(&found.scene.basis),
        "materials": materials.collect::<Vec<_>>(), "remarks": found.warnings.worded(in_flags), "refused": found.refused,
    }));
}
