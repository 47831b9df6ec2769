//! Where the sun may stand: what becomes the columns of a light of kind "suns".

use std::f32::consts::TAU;

use glam::Vec3;

use crate::light::SkyPatches;

/// Largest declination of the sun, in radians.
const OBLIQUITY: f32 = 23.45 * std::f32::consts::PI / 180.0;

/// How far below the horizon its middle may stand while some of its disc is above, in radians.
const RADIUS: f32 = 0.2665 * std::f32::consts::PI / 180.0;

/// Unit vectors to the middles of all patches above the horizon, in their order; +y is the zenith, −z north, +x east.
pub(super) fn of_patches(patches: SkyPatches) -> Vec<Vec3> {
    (1..patches.count()).map(|patch| patches.middle_direction(patch)).collect()
}

/// Unit vectors to places that are a step or less from where the sun stands at any time of a year at a latitude: circles of declination at
/// even distances, and even distances along them.
///
/// The place in the sky follows from declination and hour angle (Duffie and Beckman 2013, *Solar engineering of thermal processes*, §1.6).
pub(super) fn at_latitude(latitude: f32, step: f32) -> Vec<Vec3> {
    let (sin, cos) = latitude.sin_cos();
    let circles = (2.0 * OBLIQUITY / step).ceil() as u32;
    let mut places = Vec::new();
    for circle in 0..=circles {
        let (up, ring) = (OBLIQUITY * (2.0 * circle as f32 / circles as f32 - 1.0)).sin_cos();
        let count = (TAU * ring / step).ceil() as u32;
        places.extend((0..count).filter_map(|at| {
            let (west, noon) = (TAU * at as f32 / count as f32).sin_cos();
            let place = Vec3::new(-ring * west, sin * up + cos * ring * noon, sin * ring * noon - cos * up);
            (place.y > -RADIUS.sin()).then(|| place.normalize())
        }));
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sun_stands_where_the_latitude_says_at_noon_and_sets_in_the_west() {
        let places = at_latitude(48f32.to_radians(), 1f32.to_radians());
        let highest = places.iter().map(|place| place.y).fold(0.0, f32::max);
        // At noon of the summer solstice 90° − 48° + 23.45°.
        assert!((highest.asin().to_degrees() - 65.45).abs() < 0.01, "{highest}");
        // Where it is highest it stands in the south, +z.
        let noon = places.iter().find(|place| place.y == highest).unwrap();
        assert!(noon.z > 0.0 && noon.x.abs() < 1e-5, "{noon}");
        // At midsummer it goes down north of west: cos A = sin δ / cos φ (sunset), 53.5° from north.
        let farthest = places.iter().map(|place| -place.z).fold(0.0, f32::max);
        assert!((farthest - (23.45f32.to_radians().sin() / 48f32.to_radians().cos())).abs() < 0.02, "{farthest}");
        // East and west alike.
        assert!(places.iter().map(|place| place.x).sum::<f32>().abs() < 1.0);
    }

    #[test]
    fn at_the_pole_the_sun_circles_and_is_never_higher_than_its_declination() {
        let places = at_latitude(90f32.to_radians(), 2f32.to_radians());
        assert!(places.iter().all(|place| place.y < 0.4));
        assert!(!places.is_empty() && places.iter().map(|p| p.x).sum::<f32>().abs() < 1e-2);
    }

    #[test]
    fn patches_have_their_middles_in_the_sky() {
        let places = of_patches(SkyPatches::of_subdivision(4).unwrap());
        assert_eq!(places.len(), 2305);
        assert!(places.iter().all(|place| place.y > 0.0 && (place.length() - 1.0).abs() < 1e-6));
    }
}
