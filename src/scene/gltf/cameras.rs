//! Cameras of a file, and one where it has none.

use std::path::Path;

use glam::{DMat3, DVec3, Vec3};

use super::super::{Camera, Mesh, PixelFilter, Projection};
use super::nodes::Placed;
use super::plain;
use super::tree::{JsonItem, JsonTree};
use crate::error::{Result, Warnings};

/// Pixels along the height of an image whose size nobody states.
const USUAL_HEIGHT: u32 = 480;

/// A camera.
#[derive(Clone, Debug)]
pub(in super::super) struct FileCamera {
    /// Name of its node.
    pub(in super::super) name: String,
    /// Name of the camera itself, which may differ.
    pub(in super::super) own_name: Option<String>,
    eye: DVec3,
    forward: Vec3,
    up: Vec3,
    projection: Projection,
    width_over_height: f32,
}

/// The cameras of the nodes. A camera is what it has, whatever type it states.
pub(super) fn of(
    path: &Path,
    tree: &JsonTree,
    nodes: &[Placed<'_>],
    warnings: &mut Warnings,
) -> Result<Vec<FileCamera>> {
    let mut cameras = Vec::new();
    for placed in nodes {
        let Some(index) = placed.node.index("camera", "cameras")? else { continue };
        let camera = tree.item("cameras", index)?;
        let Some((projection, width_over_height)) = perspective(&camera).or_else(|| orthographic(&camera)) else {
            let problem = match camera.has("orthographic") {
                true => "states no size of what it sees; it is left out",
                false => "states no field of view; it is left out",
            };
            warnings.push(format!("{}: the camera '{}' {problem}", path.display(), placed.name));
            continue;
        };
        let axes = DMat3::from_mat4(placed.world);
        cameras.push(FileCamera {
            name: placed.name.clone(),
            own_name: camera.name().map(plain),
            eye: placed.world.w_axis.truncate(),
            forward: (-axes.z_axis).normalize_or_zero().as_vec3(),
            up: axes.y_axis.normalize_or_zero().as_vec3(),
            projection,
            width_over_height,
        });
    }
    Ok(cameras)
}

/// A perspective projection and the shape of the image.
fn perspective(camera: &JsonItem<'_>) -> Option<(Projection, f32)> {
    let lens = camera.object("perspective").ok().flatten()?;
    let vertical_fov_radians = lens.number("yfov").ok().flatten()?;
    let aspect = lens.number("aspectRatio").ok().flatten().filter(|a| *a > 0.0 && a.is_finite());
    Some((Projection::Perspective { vertical_fov_radians }, aspect.unwrap_or(4.0 / 3.0)))
}

/// Likewise an orthographic one, of which the file states half the width and half the height.
fn orthographic(camera: &JsonItem<'_>) -> Option<(Projection, f32)> {
    let lens = camera.object("orthographic").ok().flatten()?;
    let half = |key: &str| lens.number(key).ok().flatten().map(f32::abs).filter(|m| *m > 0.0 && m.is_finite());
    let (across, up) = (half("xmag")?, half("ymag")?);
    Some((Projection::Orthographic { height: 2.0 * up }, across / up))
}

impl FileCamera {
    /// The camera, 480 pixels high, counted from the scene's origin. Errors: those of [`Camera::looking`].
    pub(in super::super) fn camera(&self, origin: DVec3) -> Result<Camera> {
        let width = (USUAL_HEIGHT as f32 * self.width_over_height).round().clamp(1.0, 16_384.0) as u32;
        let size = (width, USUAL_HEIGHT);
        let eye = (self.eye - origin).as_vec3();
        Camera::looking(eye, self.forward, self.up, 1.0, size, PixelFilter::Box)?.projected(self.projection)
    }
}

/// A camera before the scene and above it that has all of it in view.
pub(in super::super) fn seeing_all(mesh: &Mesh) -> Result<Camera> {
    let (low, high) = mesh.bounds();
    let (centre, radius) = (0.5 * (low + high), (0.5 * (high - low).length()).max(f32::MIN_POSITIVE));
    let fov = 45f32.to_radians();
    let towards = Vec3::new(0.5, 0.4, 1.0).normalize();
    let distance = 1.05 * radius / (0.5 * fov).sin();
    Camera::looking(centre + distance * towards, -towards, Vec3::Y, fov, (640, USUAL_HEIGHT), PixelFilter::Box)
}
