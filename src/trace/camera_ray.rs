//! Rays that leave the camera.

use std::f32::consts::{PI, TAU};

use glam::Vec2;

use super::bsdf::concentric_disc;
use super::pixel_filter::filter_offset;
use super::sampler::{Dimension, LENS_DIMENSION, Sampler};
use super::vertex::PathRay;
use crate::scene::{Camera, Lens};

/// The ray of a sample of the pixel at image position (x, y).
#[inline(always)]
pub(super) fn ray_of_pixel(camera: &Camera, (x, y): (u32, u32), sampler: &Sampler) -> PathRay {
    let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
    let position = centre + filter_offset(camera, sampler.pair(Dimension::Pixel, 0));
    camera_ray(camera, position, || sampler.pair(Dimension::Pixel, LENS_DIMENSION))
}

/// The ray through an image position in pixels. `pair` is uniform over the unit square and chooses the point of the lens.
///
/// A thin lens brings all light of a point in the plane of focus to one place in the image, so each ray goes from a point of the opening
/// to where the ray through the lens's middle meets that plane (Pharr, Jakob and Humphreys, *Physically Based Rendering*, 4th edition, §5.2.3).
#[inline(always)]
fn camera_ray(camera: &Camera, position: Vec2, pair: impl FnOnce() -> Vec2) -> PathRay {
    let (origin, direction) = camera.ray(position);
    let Some(lens) = &camera.lens else { return PathRay::new(origin, direction).of_camera() };
    let focus = direction * (lens.focus_distance / direction.dot(camera.forward));
    let at = opening(lens, pair()) * lens.radius;
    let offset = camera.right * at.x + camera.up * at.y;
    PathRay::new(origin + offset, (focus - offset).normalize()).of_camera()
}

/// A uniform point of the opening, in units of its radius, to the right and up.
fn opening(lens: &Lens, pair: Vec2) -> Vec2 {
    if lens.blades == 0 {
        return concentric_disc(pair);
    }
    // Uniform over one of equal triangles between the middle and a side.
    let blades = lens.blades as f32;
    let side = (pair.x * blades).floor().min(blades - 1.0);
    let (outward, along) = ((pair.x * blades - side).sqrt(), 2.0 * pair.y - 1.0);
    let (sin, cos) = (PI / blades).sin_cos();
    Vec2::from_angle(lens.rotation_radians + side * TAU / blades).rotate(Vec2::new(cos, along * sin) * outward)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::scene::{PixelFilter, Projection};

    fn pairs() -> impl Iterator<Item = Vec2> {
        (0..4096).map(|i| Vec2::new((i % 64) as f32 + 0.5, (i / 64) as f32 + 0.5) / 64.0)
    }

    /// Through a lens of radius A with its plane of focus at f, the rays of a pixel cover a disc of radius A·|z − f| / f at a distance of z,
    /// by similar triangles. Seen from the middle of the lens that is the circle of confusion, of radius A·|z − f| / z on the plane of focus
    /// (Potmesil and Chakravarty 1981, *A lens and aperture camera model for synthetic image generation*, §3, in object space).
    #[test]
    fn what_is_in_the_plane_of_focus_is_sharp_and_the_rest_is_in_its_circle_of_confusion() {
        let lens = Lens { radius: 0.2, focus_distance: 4.0, blades: 0, rotation_radians: 0.0 };
        let (eye, size) = (Vec3::new(1.0, 2.0, 3.0), (90, 60));
        let camera = Camera::looking(eye, Vec3::NEG_Z, Vec3::Y, 0.9, size, PixelFilter::Box).unwrap();
        let shifted = camera.shifted(Vec2::new(0.25, 0.0)).unwrap();
        let flat = camera.projected(Projection::Orthographic { height: 3.0 }).unwrap();
        for camera in [camera, shifted, flat] {
            let camera = camera.with_lens(lens).unwrap();
            let at = Vec2::new(70.0, 12.0);
            let (origin, direction) = camera.ray(at);
            for z in [1.0, 4.0, 9.0] {
                let middle = origin + direction * (z / -direction.z);
                let wanted = lens.radius * (z - lens.focus_distance).abs() / lens.focus_distance;
                let (mut largest, mut squares) = (0.0f32, 0.0);
                for pair in pairs() {
                    let ray = camera_ray(&camera, at, || pair);
                    let from_middle =
                        (ray.origin + ray.direction * ((z + ray.origin.z - 3.0) / -ray.direction.z)) - middle;
                    assert!((ray.origin - origin).length() <= lens.radius + 1e-6 && from_middle.z.abs() < 1e-5);
                    largest = largest.max(from_middle.length());
                    squares += from_middle.length_squared();
                }
                assert!(largest <= wanted + 1e-5 && largest >= 0.95 * wanted, "{z}: {largest} of {wanted}");
                // Of a uniform disc the mean of the squares is half that of its rim.
                assert!((squares / 4096.0 - 0.5 * wanted * wanted).abs() <= 1e-3 * wanted * wanted + 1e-9, "{z}");
            }
        }
    }

    /// The second moment of a regular polygon of n sides with corners at 1 is (2 + cos(2π / n)) / 6 (of the disc 1/2).
    #[test]
    fn blades_make_a_polygon() {
        for blades in [3, 5, 6, 64] {
            let lens = Lens { radius: 1.0, focus_distance: 1.0, blades, rotation_radians: 0.3 };
            let (angle, mut squares, mut mean) = (TAU / blades as f32, 0.0, Vec2::ZERO);
            // A whole number for each side.
            for i in 0..960 * 16 {
                let pair = Vec2::new((i % 960) as f32 + 0.5, (i / 960) as f32 + 0.5) / Vec2::new(960.0, 16.0);
                let at = opening(&lens, pair);
                mean += at / 15_360.0;
                squares += at.length_squared() / 15_360.0;
                for side in 0..blades {
                    let outward = Vec2::from_angle(0.3 + side as f32 * angle);
                    assert!(at.dot(outward) <= (0.5 * angle).cos() + 1e-5, "{at} is beyond side {side} of {blades}");
                }
            }
            assert!(mean.length() < 0.01, "{blades}: {mean}");
            assert!((squares - (2.0 + angle.cos()) / 6.0).abs() < 0.005, "{blades}: {squares}");
        }
    }
}
