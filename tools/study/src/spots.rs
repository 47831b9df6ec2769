//! Spots: small bright marks that the reference has not.

use rayon::prelude::*;

use super::measured::exposure_of;
use ltm::image::{LinearImage, encode_srgb};

/// How much brighter a spot is than all that the reference shows around it, in displayed values from 0 to 1.
const STANDS_OUT: f32 = 0.05;

/// Radius in pixels of what the reference may show in another place: an edge that is drawn less sharply is no spot.
const NEAR: usize = 2;

/// Radius in pixels of the surroundings, whose median error is no spot: light that is off over a whole surface.
const AROUND: usize = 8;

/// Part of the pixels that stand out of their surroundings in an image and not in its reference. A pixel does if its
/// displayed luminance exceeds, by [`STANDS_OUT`], every reference pixel within [`NEAR`], and if its error exceeds the
/// median error within [`AROUND`] by as much. Displayed: exposed to the reference's 95th percentile, clipped, sRGB.
pub(super) fn spots(image: &LinearImage, reference: &LinearImage) -> f64 {
    let exposure = exposure_of(reference) as f32;
    let shown = |image: &LinearImage| -> Vec<f32> {
        image.luminances().map(|v| encode_srgb((v * exposure).clamp(0.0, 1.0))).collect()
    };
    let (ours, theirs) = (shown(image), shown(reference));
    let (width, height) = (image.width as usize, image.height as usize);
    let error = |at: usize| ours[at] - theirs[at];
    let around = |x: usize, y: usize, radius: usize| {
        let rows = y.saturating_sub(radius)..(y + radius + 1).min(height);
        let columns = x.saturating_sub(radius)..(x + radius + 1).min(width);
        rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
    };
    let is_spot = |x: usize, y: usize| {
        let at = y * width + x;
        if error(at) < STANDS_OUT || around(x, y, NEAR).any(|near| ours[at] < theirs[near] + STANDS_OUT) {
            return false;
        }
        let mut errors: Vec<f32> = around(x, y, AROUND).map(error).collect();
        let middle = errors.len() / 2;
        let median = *errors.select_nth_unstable_by(middle, f32::total_cmp).1;
        error(at) > median + STANDS_OUT
    };
    let of_row = |y: usize| (0..width).filter(|&x| is_spot(x, y)).count();
    let count: usize = (0..height).into_par_iter().map(of_row).sum();
    count as f64 / (width * height) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bright_marks_are_spots_and_edges_and_other_brightness_are_not() {
        let (width, height) = (64, 48);
        let of = |value: &dyn Fn(u32, u32) -> f32| LinearImage {
            width,
            height,
            pixels: (0..width * height).map(|at| [value(at % width, at / width); 3]).collect(),
        };
        // A wall with a bright and a dark half.
        let wall = |x: u32, _: u32| if x < 32 { 0.2 } else { 1.0 };
        let reference = of(&wall);
        assert_eq!(spots(&reference, &reference), 0.0);
        let blurred = of(&|x, y| if (30..34).contains(&x) { 0.6 } else { wall(x, y) });
        assert_eq!(spots(&blurred, &reference), 0.0, "an edge");
        let brighter = of(&|x, y| 1.3 * wall(x, y));
        assert_eq!(spots(&brighter, &reference), 0.0, "all brighter");
        let marked = of(&|x, y| if (10..12).contains(&x) && (20..23).contains(&y) { 0.4 } else { wall(x, y) });
        assert_eq!(spots(&marked, &reference), 6.0 / f64::from(width * height));
        let holes = of(&|x, y| if (10..12).contains(&x) && (20..23).contains(&y) { 0.1 } else { wall(x, y) });
        assert_eq!(spots(&holes, &reference), 0.0, "dark marks");
    }
}
