//! Moves of a camera: about what it looks at, along its image, and nearer.

use glam::{Quat, Vec2, Vec3};

use ltm::scene::{Camera, Projection};

/// Narrowest and widest field of view, in radians.
pub const FOV_RANGE: (f32, f32) = (0.035, 2.6);
/// How near, in radians, the view may come to straight up or down.
const POLE: f32 = 0.02;
/// The field of view that is assumed where a projection has none.
const USUAL_FOV: f32 = 0.785;

/// A move, as the pointer or a control asks for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CameraMove {
    /// About the pivot, by radians to the right and up, as the eye goes.
    Orbit(Vec2),
    /// Along the image, by heights of the image at the pivot's distance, as what is seen goes.
    Pan(Vec2),
    /// The distance to the pivot times this.
    Dolly(f32),
    /// Another field of view from the lower to the upper edge, in radians.
    FieldOfView(f32),
}

/// A camera that is moved about a scene.
#[derive(Clone, Copy, Debug)]
pub struct MovingCamera {
    /// Where it is.
    pub camera: Camera,
    /// Distance to what is moved about, in the middle of the image.
    pub distance: f32,
    /// What is up in the scene: the axis that is most upwards in the camera with which it began.
    up: Vec3,
}

impl MovingCamera {
    /// Begins with a camera that looks at something in this distance.
    pub fn new(camera: Camera, distance: f32) -> Self {
        let axes = [Vec3::X, Vec3::Y, Vec3::Z];
        let most = axes.into_iter().max_by(|a, b| camera.up.dot(*a).abs().total_cmp(&camera.up.dot(*b).abs()));
        let axis = most.unwrap_or(Vec3::Y);
        Self { camera, distance, up: axis * camera.up.dot(axis).signum() }
    }

    /// What it is moved about.
    pub fn pivot(&self) -> Vec3 {
        self.camera.eye + self.distance * self.camera.forward
    }

    /// Field of view from the lower to the upper edge.
    fn fov(&self) -> f32 {
        self.camera.vertical_fov_radians().unwrap_or(USUAL_FOV)
    }

    /// Does a move. One that would turn the view over, or make it no view, changes nothing.
    pub fn apply(&mut self, step: CameraMove) {
        match step {
            CameraMove::Orbit(by) => {
                let pivot = self.pivot();
                let elevation = self.camera.forward.dot(self.up).clamp(-1.0, 1.0).asin();
                let most = std::f32::consts::FRAC_PI_2 - POLE;
                let pitch = (elevation - by.y).clamp(-most, most) - elevation;
                let level = self.camera.forward.cross(self.up).try_normalize().unwrap_or(self.camera.right);
                let turn = Quat::from_axis_angle(self.up, by.x) * Quat::from_axis_angle(level, pitch);
                self.look(pivot - turn * (self.camera.forward * self.distance), turn * self.camera.forward);
            }
            CameraMove::Pan(by) => {
                let height = match self.camera.projection {
                    Projection::Orthographic { height } => height,
                    _ => 2.0 * self.distance * (0.5 * self.fov()).tan(),
                };
                self.camera.eye += height * (by.y * self.camera.up - by.x * self.camera.right);
            }
            CameraMove::Dolly(factor) if factor > 0.0 && factor.is_finite() => {
                let pivot = self.pivot();
                let distance = self.distance * factor;
                if distance > f32::MIN_POSITIVE && distance.is_finite() {
                    (self.camera.eye, self.distance) = (pivot - distance * self.camera.forward, distance);
                }
                if let Projection::Orthographic { height } = self.camera.projection {
                    self.project(Projection::Orthographic { height: height * factor });
                }
            }
            CameraMove::Dolly(_) => {}
            CameraMove::FieldOfView(radians) => {
                let vertical_fov_radians = radians.clamp(FOV_RANGE.0, FOV_RANGE.1);
                if matches!(self.camera.projection, Projection::Perspective { .. }) {
                    self.project(Projection::Perspective { vertical_fov_radians });
                }
            }
        }
    }

    /// Looks at the middle of a box from where it stands, from so far that a sphere around the box, which has this radius, fills a part
    /// of the image.
    pub fn frame(&mut self, middle: Vec3, radius: f32) {
        const PART: f32 = 0.35;
        let direction = (middle - self.camera.eye).try_normalize().unwrap_or(self.camera.forward);
        let needed = radius / (PART * 0.5 * self.fov()).sin();
        // Never farther than it is: what is between would be in the way.
        let distance = needed.min(middle.distance(self.camera.eye)).max(2.0 * radius);
        self.look(middle - distance * direction, direction);
        self.distance = distance;
    }

    fn look(&mut self, eye: Vec3, direction: Vec3) {
        let Camera { width, height, filter, .. } = self.camera;
        if let Ok(found) = Camera::looking(eye, direction, self.up, USUAL_FOV, (width, height), filter) {
            let Camera { eye, forward, right, up, .. } = found;
            self.camera = Camera { eye, forward, right, up, ..self.camera };
        }
    }

    fn project(&mut self, projection: Projection) {
        if let Ok(camera) = self.camera.projected(projection) {
            self.camera = camera;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ltm::scene::PixelFilter;

    fn camera() -> MovingCamera {
        let (eye, direction) = (Vec3::new(1.0, 2.0, 6.0), Vec3::new(0.1, -0.2, -1.0));
        let camera = Camera::looking(eye, direction, Vec3::Y, 0.8, (640, 480), PixelFilter::Box).unwrap();
        MovingCamera::new(camera, 5.0)
    }

    #[test]
    fn an_orbit_keeps_the_pivot_in_the_middle_and_never_turns_over() {
        let mut moved = camera();
        let pivot = moved.pivot();
        for by in [Vec2::new(0.3, 0.2), Vec2::new(-2.0, 9.0), Vec2::new(1.0, -99.0), Vec2::new(7.0, 0.5)] {
            moved.apply(CameraMove::Orbit(by));
            // Some roundings of f32 at a few units.
            assert!((moved.pivot() - pivot).length() < 1e-4, "{by}");
            let middle = moved.camera.position_of(pivot).unwrap();
            assert!((middle - Vec2::new(320.0, 240.0)).length() < 0.1);
            assert!(moved.camera.up.y > 0.0 && moved.camera.right.y.abs() < 1e-4);
        }
        let mut level = camera();
        level.apply(CameraMove::Orbit(Vec2::new(0.5, 0.0)));
        assert!((level.camera.eye.y - camera().camera.eye.y).abs() < 1e-4, "to the side is not up");
    }

    #[test]
    fn what_is_panned_goes_with_the_pointer_and_what_is_dollied_to_comes_nearer() {
        let mut moved = camera();
        let pivot = moved.pivot();
        moved.apply(CameraMove::Pan(Vec2::new(0.25, 0.125)));
        let place = moved.camera.position_of(pivot).unwrap();
        assert!((place - Vec2::new(320.0 + 120.0, 240.0 + 60.0)).length() < 0.1, "{place}");
        let mut near = camera();
        near.apply(CameraMove::Dolly(0.5));
        assert!((near.camera.eye.distance(pivot) - 2.5).abs() < 1e-4);
        let before = near.camera;
        near.apply(CameraMove::Dolly(0.0));
        near.apply(CameraMove::Dolly(f32::NAN));
        assert_eq!(near.camera, before);
        near.apply(CameraMove::FieldOfView(9.0));
        assert_eq!(near.camera.vertical_fov_radians(), Some(FOV_RANGE.1));
    }

    #[test]
    fn a_framed_lamp_is_in_the_middle_and_not_behind_anything_new() {
        let mut moved = camera();
        let (lamp, eye) = (Vec3::new(-2.0, 3.0, -1.0), moved.camera.eye);
        moved.frame(lamp, 0.1);
        assert!((moved.camera.position_of(lamp).unwrap() - Vec2::new(320.0, 240.0)).length() < 0.1);
        let way = (lamp - eye).normalize();
        assert!((moved.camera.eye - eye).dot(way) >= 0.0 && moved.camera.eye.distance(lamp) < lamp.distance(eye));
    }
}
