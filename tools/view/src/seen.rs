//! Where lights are seen in the picture, by the camera that the container states.

use glam::Vec3;
use ltm::light::{Light, LightBasis, LightKind};
use ltm::scene::Camera;

/// Position of a light's centre in pixels, also beside the picture and behind what hides it. `None` behind the eye, and
/// for an environment, which has no centre.
pub fn position(camera: &Camera, light: &Light) -> Option<[f32; 2]> {
    let middle = light.places.iter().map(|place| Vec3::from(*place)).sum::<Vec3>() / light.places.len().max(1) as f32;
    let at = match light.kind {
        LightKind::LatLong { .. }
        | LightKind::Octahedral { .. }
        | LightKind::Patches { .. }
        | LightKind::Suns { .. }
        | LightKind::Image => None,
        LightKind::Sun => camera.position(middle.try_normalize()?),
        LightKind::Lamp | LightKind::AreaTexels { .. } | LightKind::Point | LightKind::Spot | LightKind::Ies => {
            camera.position_of(middle)
        }
    };
    at.map(|at| at.to_array())
}

/// The lights whose middle is seen at a position of the picture, in pixels, that an area `holds`.
pub fn lights_within(camera: &Camera, basis: &LightBasis, holds: impl Fn([f32; 2]) -> bool) -> Vec<usize> {
    let lights = basis.lights().iter().enumerate();
    lights.filter(|(_, light)| position(camera, light).is_some_and(&holds)).map(|(index, _)| index).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ltm::scene::PixelFilter;

    #[test]
    fn lights_are_where_the_camera_sees_them() {
        let eye = Vec3::new(0.0, 1.0, 4.0);
        let camera =
            Camera::looking(eye, Vec3::NEG_Z, Vec3::Y, std::f32::consts::FRAC_PI_2, (200, 100), PixelFilter::Box);
        let camera = camera.unwrap();
        let mut basis = LightBasis::new();
        let mut add = |name: &str, kind, places: Vec<[f32; 3]>| {
            let unplaced = Light::unplaced(name, kind);
            basis.push(Light { extents: vec![1.0; places.len()], places, ..unplaced }).unwrap();
        };
        // At the distance 1 a pixel is 1/50.
        add("ahead", LightKind::Lamp, vec![[0.0, 1.0, 3.0]]);
        add("right", LightKind::AreaTexels { across: 2, down: 1 }, vec![[0.5, 1.5, 3.0], [1.5, 1.5, 3.0]]);
        add("behind", LightKind::Point, vec![[0.0, 1.0, 5.0]]);
        add("sun", LightKind::Sun, vec![[-1.0, 0.0, -1.0]]);
        add("sky", LightKind::LatLong { across: 1, down: 1 }, vec![[0.0, 1.0, -1.0]]);
        let seen: Vec<_> = basis.lights().iter().map(|light| position(&camera, light)).collect();
        let near = |found: Option<[f32; 2]>, wanted: [f32; 2]| {
            found.is_some_and(|found| (0..2).all(|axis| (found[axis] - wanted[axis]).abs() < 1e-3))
        };
        assert!(
            near(seen[0], [100.0, 50.0]) && near(seen[1], [150.0, 25.0]) && near(seen[3], [50.0, 50.0]),
            "{seen:?}"
        );
        assert!(seen[2].is_none() && seen[4].is_none(), "{seen:?}");
        let within = |x: std::ops::Range<f32>, y: std::ops::Range<f32>| {
            lights_within(&camera, &basis, |at| x.contains(&at[0]) && y.contains(&at[1]))
        };
        assert_eq!(within(90.0..160.0, 20.0..60.0), [0, 1]);
        assert_eq!(within(0.0..200.0, 0.0..100.0), [0, 1, 3]);
        assert!(within(0.0..9.0, 0.0..9.0).is_empty());
    }
}
