//! How far two pictures are apart, as they are shown.

use super::display::Shown;

/// The difference of two pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Mean ꟻLIP (P. Andersson et al., *FLIP: A Difference Evaluator for Alternating Images*, 2020) at 67 pixels a degree: 0 for
    /// equal pictures, 1 at most.
    pub flip: f32,
    /// Peak signal-to-noise ratio of the 8-bit values in dB; infinite for equal pictures.
    pub psnr_db: f64,
    /// ꟻLIP of each pixel, from black over violet and orange to light yellow.
    pub map: Shown,
}

/// Compares two pictures of one size; none where the sizes differ or there is nothing to compare.
pub fn between(picture: &Shown, reference: &Shown) -> Option<Difference> {
    let [width, height] = picture.size;
    if picture.size != reference.size || width == 0 || height == 0 {
        return None;
    }
    let rgb = |shown: &Shown| -> Vec<u8> { shown.rgba.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect() };
    let (picture, reference) = (rgb(picture), rgb(reference));
    let squared: f64 = picture.iter().zip(&reference).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum();
    let mean = squared / picture.len() as f64;
    let psnr_db = if squared == 0.0 { f64::INFINITY } else { 10.0 * (255.0f64.powi(2) / mean).log10() };
    let image = |bytes: &[u8]| nv_flip::FlipImageRgb8::with_data(width as u32, height as u32, bytes);
    let map = nv_flip::flip(image(&reference), image(&picture), nv_flip::DEFAULT_PIXELS_PER_DEGREE);
    let flip = nv_flip::FlipPool::from_image(&map).mean();
    let coloured = map.apply_color_lut(&nv_flip::magma_lut()).to_vec();
    let rgba = coloured.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
    Some(Difference { flip, psnr_db, map: Shown { size: [width, height], rgba, histogram: Vec::new() } })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(value: u8) -> Shown {
        Shown { size: [32, 16], rgba: [value, value, value, 255].repeat(32 * 16), histogram: Vec::new() }
    }

    #[test]
    fn equal_pictures_are_not_apart_and_black_and_white_are_as_far_as_can_be() {
        let same = between(&grey(90), &grey(90)).unwrap();
        assert_eq!((same.flip, same.psnr_db), (0.0, f64::INFINITY));
        let far = between(&grey(0), &grey(255)).unwrap();
        assert!(far.flip > 0.9 && far.psnr_db == 0.0, "{} {}", far.flip, far.psnr_db);
        // One step of 8 bits everywhere: 20 log₁₀ 255.
        let near = between(&grey(90), &grey(91)).unwrap();
        assert!((near.psnr_db - 48.13).abs() < 0.01 && near.flip < 0.05, "{} {}", near.flip, near.psnr_db);
        assert!(far.map.rgba[0] > same.map.rgba[0] && same.map.size == [32, 16]);
        let other = Shown { size: [16, 32], ..grey(0) };
        assert!(between(&grey(0), &other).is_none());
    }
}
