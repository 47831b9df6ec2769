//! Checks of a scene as a whole, before hours are spent on it.

use glam::{Vec2, Vec3};

use super::{Emitter, Scene, in_file};
use crate::error::{Error, Result, Warnings};

/// Rays across and down the image that look for something to see.
const PROBES: [u32; 2] = [8, 6];

/// Directions around the eye that look for a way out.
const AROUND: usize = 32;

/// Raw size of the matrix above which a warning is given, in bytes.
const LARGE_BYTES: u128 = 1 << 40;

/// Checks that a scene can be traced: something to see, something that emits, indices and numbers in order.
///
/// Returns warnings for what can be traced but is hardly meant.
///
/// # Errors
/// No triangles or no light, an index out of range, a position that is not finite, a light without area, a camera that
/// sees nothing or stands in a wall.
pub fn validate(scene: &Scene) -> Result<Warnings> {
    let mut warnings = Warnings::new();
    check_mesh(scene)?;
    check_lights(scene)?;
    if scene.sensors.is_none() {
        check_camera(scene, &mut warnings)?;
    }
    let camera = &scene.camera;
    let entries = u128::from(camera.width) * u128::from(camera.height) * 3 * scene.basis.column_count() as u128;
    if entries * 4 > LARGE_BYTES {
        warnings.push(format!(
            "{} × {} pixels under {} columns make a raw matrix of {:.1} TiB",
            camera.width,
            camera.height,
            scene.basis.column_count(),
            (entries * 4) as f64 / LARGE_BYTES as f64
        ));
    }
    Ok(warnings)
}

fn place(scene: &Scene) -> String {
    format!("scene '{}'", scene.name)
}

fn check_mesh(scene: &Scene) -> Result<()> {
    let mesh = &scene.mesh;
    let refuse = |problem: String| Err(Error::input(place(scene), problem, "mend the geometry"));
    if mesh.triangles.is_empty() {
        return refuse("has no triangles".into());
    }
    if let Some(vertex) = mesh.vertices.iter().position(|v| !v.position.is_finite()) {
        return refuse(format!("the position of vertex {vertex} is not finite"));
    }
    let in_range = |t: &super::Triangle| {
        t.vertices.iter().all(|&v| (v as usize) < mesh.vertices.len())
            && (t.material.0 as usize) < scene.materials.len()
            && t.emitter.is_none_or(|e| matches!(scene.emitters.get(e as usize), Some(Emitter::Area(_))))
    };
    match mesh.triangles.iter().position(|t| !in_range(t)) {
        Some(index) => refuse(format!("triangle {index} names a vertex, material or light that does not exist")),
        None => Ok(()),
    }
}

fn check_lights(scene: &Scene) -> Result<()> {
    if scene.emitters.is_empty() {
        let hint = "add a [[light]], or a material with Ke above 0";
        return Err(Error::input(place(scene), "has no light", hint));
    }
    if scene.emitters.len() != scene.basis.lights().len() {
        return Err(Error::input(place(scene), "has a basis that is not that of its emitters", "make them anew"));
    }
    if scene.unseen_lights.iter().any(|&light| light as usize >= scene.emitters.len()) {
        return Err(Error::input(place(scene), "names an unseen light that does not exist", "make the list anew"));
    }
    for (emitter, light) in scene.emitters.iter().zip(scene.basis.lights()) {
        let Emitter::Area(area) = emitter else { continue };
        let doubled: f32 = area
            .triangles
            .iter()
            .filter_map(|&index| scene.mesh.triangles.get(index as usize))
            .map(|triangle| scene.mesh.corners(triangle))
            .map(|[a, b, c]| (b - a).cross(c - a).length())
            .sum();
        if doubled.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
            let problem = "has no area";
            return Err(Error::input(format!("light '{}'", light.name), problem, "give its emitter some size"));
        }
    }
    Ok(())
}

fn check_camera(scene: &Scene, warnings: &mut Warnings) -> Result<()> {
    let camera = &scene.camera;
    let mut unseen = vec![false; scene.emitters.len()];
    scene.unseen_lights.iter().for_each(|&light| unseen[light as usize] = true);
    let seen = |rays: Vec<(Vec3, Vec3)>| {
        let mut hits = vec![None; rays.len()];
        let is_seen = |t: &&super::Triangle| t.emitter.is_none_or(|light| !unseen[light as usize]);
        for triangle in scene.mesh.triangles.iter().filter(is_seen) {
            let corners = scene.mesh.corners(triangle);
            for (hit, &(origin, direction)) in hits.iter_mut().zip(&rays) {
                if let Some((distance, front)) = intersect(origin, direction, corners)
                    && hit.is_none_or(|(nearest, _)| distance < nearest)
                {
                    *hit = Some((distance, front));
                }
            }
        }
        hits.into_iter().flatten().collect::<Vec<(f32, bool)>>()
    };
    let [across, down] = PROBES;
    let pixels = (0..across * down).map(|i| {
        let (x, y) = ((i % across) as f32 + 0.5, (i / across) as f32 + 0.5);
        Vec2::new(x * camera.width as f32 / across as f32, y * camera.height as f32 / down as f32)
    });
    let in_view = seen(pixels.map(|at| camera.ray(at)).collect());
    let (low, high) = scene.mesh.bounds();
    let size = (high - low).length();
    if in_view.is_empty() {
        let [eye, low, high] = [camera.eye, low, high].map(|place| in_file(scene.origin, place));
        let environment = scene.emitters.iter().any(|e| matches!(e, Emitter::Environment(_)));
        let problem = format!("the camera at {eye} sees nothing of the geometry, which spans {low} to {high}");
        if !environment {
            return Err(Error::input(place(scene), problem, "move the camera or turn it"));
        }
        warnings.push(format!("{}: {problem}", place(scene)));
        return Ok(());
    }
    if in_view.len() == (across * down) as usize && in_view.iter().all(|(distance, _)| *distance < 1e-3 * size) {
        let eye = in_file(scene.origin, camera.eye);
        let problem = format!("the camera at {eye} stands in a wall: all it sees is nearer than {}", 1e-3 * size);
        return Err(Error::input(place(scene), problem, "move the camera into the open"));
    }
    // The rays of an orthographic camera have no common origin.
    let around = match camera.is_orthographic() {
        true => Vec::new(),
        false => seen((0..AROUND).map(|index| (camera.eye, on_sphere(index))).collect()),
    };
    if around.len() == AROUND && around.iter().all(|(_, front)| !front) {
        let problem = "the camera sees only backs of surfaces all around: it may stand inside something solid";
        warnings.push(format!("{}: {problem}", place(scene)));
    }
    Ok(())
}

/// Directions spread over the sphere along a spiral.
fn on_sphere(index: usize) -> Vec3 {
    let y = 1.0 - (2.0 * index as f32 + 1.0) / AROUND as f32;
    let ring = (1.0 - y * y).sqrt();
    let (sin, cos) = (index as f32 * 2.399_963).sin_cos();
    Vec3::new(ring * cos, y, ring * sin)
}

/// Distance to a triangle along a ray and whether its front is hit (Möller and Trumbore 1997).
fn intersect(origin: Vec3, direction: Vec3, [a, b, c]: [Vec3; 3]) -> Option<(f32, bool)> {
    let (e1, e2) = (b - a, c - a);
    let p = direction.cross(e2);
    let determinant = e1.dot(p);
    let inverse = 1.0 / determinant;
    let s = origin - a;
    let u = s.dot(p) * inverse;
    if !(0.0..=1.0).contains(&u) {
        return None;
    }
    let q = s.cross(e1);
    let v = direction.dot(q) * inverse;
    let distance = e2.dot(q) * inverse;
    (v >= 0.0 && u + v <= 1.0 && distance > 0.0).then_some((distance, determinant > 0.0))
}
