//! The origin of a scene.
//!
//! Geometry is traced in f32, which has seven digits: coordinates of millions of metres would be rounded to half
//! metres. So geometry that is far away for its size is read in f64 and moved near zero before it is rounded. Messages
//! and metadata use the coordinates of the scene's file.

use glam::{DVec3, Vec3};

use crate::decimal;

/// Along an axis on which the middle lies farther from zero than this, in units of half the largest side, a scene is moved, and then lies no
/// farther. Three bits are lost there at most.
const FAR: f64 = 8.0;

/// Largest step of an origin, as a power of ten.
const MAX_STEP: i32 = 300;

/// How the origin stands in a job's settings, before the camera's words.
const WORDS: &str = "origin = ";

/// The origin of a scene that lies between two corners, axis by axis: 0 where it stands near zero. Else the roundest number near its middle, a
/// multiple of the largest power of ten, so that a scene that was moved by a round number lies where it lay.
pub(super) fn origin_between(low: DVec3, high: DVec3) -> DVec3 {
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low).max_element());
    if !(half.is_finite() && middle.is_finite() && half > 0.0) {
        return DVec3::ZERO;
    }
    let along = |middle: f64| {
        let least = (FAR * half).log10().floor() as i32;
        let multiple = |power: i32| {
            // Whole powers are exact, and so are whole multiples of them as far as f64 goes.
            let step = 10f64.powi(power.abs());
            if power < 0 { (middle * step).round() / step } else { (middle / step).round() * step }
        };
        let near = |origin: &f64| (middle - origin).abs() <= FAR * half;
        // The first multiple that is near may be 0.
        (least..=MAX_STEP).rev().map(multiple).find(near).unwrap_or(0.0)
    };
    DVec3::from_array(middle.to_array().map(along))
}

/// A place of the scene in its file's coordinates, to as many digits as f32 keeps of it.
pub fn in_file(origin: DVec3, place: Vec3) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|axis| along(origin[axis], place[axis])))
}

/// The shortest decimal that comes to the same f32 once the origin is taken from it.
fn along(origin: f64, place: f32) -> f64 {
    if origin == 0.0 {
        // The decimal that the f32 is written as.
        return decimal::of_f32(place).parse().unwrap_or_else(|_| f64::from(place));
    }
    let whole = origin + f64::from(place);
    let rounded = |digits: usize| format!("{whole:.digits$}").parse::<f64>().unwrap_or(whole);
    (0..=16).map(rounded).find(|&value| (value - origin) as f32 == place).unwrap_or(whole)
}

/// The origin in words, for a job's settings; nothing where it is zero.
pub(super) fn in_words(origin: DVec3) -> String {
    if origin == DVec3::ZERO {
        String::new()
    } else {
        format!("{WORDS}{}, ", decimal::list(origin.to_array(), decimal::of_f64))
    }
}

/// The origin that a job's settings state: its lights' places are counted from there. Zero where they state none.
pub fn stated_origin(settings: &str) -> DVec3 {
    let numbers = || {
        let inside = settings.split_once(WORDS)?.1.strip_prefix('[')?.split_once(']')?.0;
        let mut numbers = inside.split(',').map(|number| number.trim().parse::<f64>().ok().filter(|n| n.is_finite()));
        let origin = DVec3::new(numbers.next()??, numbers.next()??, numbers.next()??);
        numbers.next().is_none().then_some(origin)
    };
    numbers().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_near_zero_stays_and_what_stands_far_is_moved_by_round_numbers() {
        let around = |middle: [f64; 3], half: f64| {
            let middle = DVec3::from_array(middle);
            origin_between(middle - half, middle + half).to_array()
        };
        assert_eq!(around([5.0, -7.9, 0.0], 1.0), [0.0; 3]);
        assert_eq!(around([691_000.237, 1.5, 5_335_000.137], 5.0), [691_000.0, 0.0, 5_335_000.0]);
        assert_eq!(around([-20.3, 1.5, 9.0], 1.0), [-20.0, 0.0, 10.0]);
        assert_eq!(around([691_005.0, 691_050.3, 691_039.0], 5.0), [691_000.0, 691_050.0, 691_000.0]);
        assert_eq!(around([691_000_237.0, 0.0, 0.0], 5000.0), [691_000_000.0, 0.0, 0.0]);
        assert_eq!(around([0.5, 0.0, 0.0], 1e-3), [0.5, 0.0, 0.0]);
        assert_eq!(around([f64::INFINITY, 0.0, 0.0], 1.0), [0.0; 3]);
        assert_eq!(origin_between(DVec3::INFINITY, DVec3::NEG_INFINITY), DVec3::ZERO);
        assert_eq!(around([3.0, 3.0, 3.0], 0.0), [0.0; 3]);
    }

    #[test]
    fn places_are_told_in_the_files_digits() {
        let origin = DVec3::new(691_000.0, 0.0, -5_335_000.0);
        let place = (DVec3::new(691_000.287, 2.9, -5_335_000.187) - origin).as_vec3();
        assert_eq!(in_file(origin, place).to_array(), [691_000.287, 2.9, -5_335_000.187]);
        let settings = format!("64 samples; camera: {}eye = [1, 2, 3]", in_words(origin));
        assert_eq!(stated_origin(&settings), origin);
        for none in ["", "origin = ", "origin = [1, 2]", "origin = [1, NaN, 2]", "origin = [1, 2, 3, 4]"] {
            assert_eq!(stated_origin(none), DVec3::ZERO, "{none}");
        }
        assert_eq!(in_words(DVec3::ZERO), "");
    }
}
