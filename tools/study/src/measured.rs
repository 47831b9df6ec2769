//! How far images are from their references, in every measure that is reported.

use rayon::prelude::*;

use super::flip::Flip;
use ltm::image::{LinearImage, ToneMapping, compare, encode_srgb};

/// PSNR that stands for a perfect match, so that means stay finite.
const PERFECT_DB: f64 = 150.0;
/// What keeps the relative squared error of black pixels finite, in squared exposed units.
const RELMSE_FLOOR: f64 = 0.01;

/// Error of an image against its reference.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    /// `‖image − reference‖₂ / ‖reference‖₂` over all channels.
    pub relative_l2: f64,
    /// PSNR in dB, peak = the largest value of the reference ("lin").
    pub psnr_linear: f64,
    /// PSNR in dB after exposing the reference's 95th luminance percentile to 1 and clipping to [0, 1] ("clip").
    pub psnr_clipped: f64,
    /// Mean of `(image − reference)² / (reference² + 0.01)` after the same exposure, not clipped.
    pub rel_mse: f64,
    /// Mean ꟻLIP (Andersson et al. 2020) of the exposed, clipped, sRGB-encoded 8-bit images at 67 pixels a degree.
    pub flip: f64,
}

impl Measured {
    /// Measures an image. Panics if the sizes differ.
    pub fn of(image: &LinearImage, reference: &LinearImage) -> Self {
        let error = compare(image, reference);
        let exposure = exposure_of(reference);
        let pairs = image.values().iter().zip(reference.values());
        let relative = pairs.map(|(&a, &b)| {
            let (a, b) = (f64::from(a) * exposure, f64::from(b) * exposure);
            (a - b).powi(2) / (b * b + RELMSE_FLOOR)
        });
        let rel_mse = relative.sum::<f64>() / reference.values().len() as f64;
        Self {
            relative_l2: error.relative_l2,
            psnr_linear: error.psnr_linear.min(PERFECT_DB),
            psnr_clipped: error.psnr_clipped.min(PERFECT_DB),
            rel_mse,
            flip: Flip::new(image, reference, |image| displayed(image, exposure)).mean(),
        }
    }
}

/// The factor that brings the 95th luminance percentile of `reference` to 1.
pub(super) fn exposure_of(reference: &LinearImage) -> f64 {
    f64::from(ToneMapping::default().auto_exposed(reference, 1.0).exposure_stops).exp2()
}

/// 8-bit sRGB bytes of an exposed image, clipped.
pub(super) fn displayed(image: &LinearImage, exposure: f64) -> Vec<u8> {
    image.values().iter().map(|&v| (encode_srgb(v * exposure as f32) * 255.0 + 0.5) as u8).collect()
}

/// Mean and worst over several lightings.
#[derive(Clone, Copy, Debug)]
pub struct Summary {
    /// Mean of each measure.
    pub mean: Measured,
    /// Worst of each measure: the smallest PSNR, the largest error.
    pub worst: Measured,
}

impl Summary {
    /// Measures images pairwise, in parallel. Panics if there are none or the numbers differ.
    pub fn of(images: &[LinearImage], references: &[LinearImage]) -> Self {
        assert!(!images.is_empty() && images.len() == references.len());
        let all: Vec<Measured> = images.par_iter().zip(references).map(|(i, r)| Measured::of(i, r)).collect();
        let mean = |part: fn(&Measured) -> f64| all.iter().map(part).sum::<f64>() / all.len() as f64;
        let largest = |part: fn(&Measured) -> f64| all.iter().map(part).fold(f64::NEG_INFINITY, f64::max);
        let smallest = |part: fn(&Measured) -> f64| all.iter().map(part).fold(f64::INFINITY, f64::min);
        Self {
            mean: Measured {
                relative_l2: mean(|m| m.relative_l2),
                psnr_linear: mean(|m| m.psnr_linear),
                psnr_clipped: mean(|m| m.psnr_clipped),
                rel_mse: mean(|m| m.rel_mse),
                flip: mean(|m| m.flip),
            },
            worst: Measured {
                relative_l2: largest(|m| m.relative_l2),
                psnr_linear: smallest(|m| m.psnr_linear),
                psnr_clipped: smallest(|m| m.psnr_clipped),
                rel_mse: largest(|m| m.rel_mse),
                flip: largest(|m| m.flip),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_errors_are_measured() {
        let pixels = (0..64 * 64).map(|i| [0.2 + 0.8 * ((i % 64) as f32 / 63.0); 3]).collect();
        let reference = LinearImage { width: 64, height: 64, pixels };
        let same = Measured::of(&reference, &reference);
        assert_eq!((same.rel_mse, same.flip, same.psnr_linear), (0.0, 0.0, PERFECT_DB));
        let brighter =
            LinearImage { pixels: reference.pixels.iter().map(|p| p.map(|v| 1.1 * v)).collect(), ..reference.clone() };
        let error = Measured::of(&brighter, &reference);
        // (0.1 v)² / (v² + floor) lies a little below 0.01, by the floor.
        assert!((0.008..0.01).contains(&error.rel_mse), "{}", error.rel_mse);
        assert!((error.relative_l2 - 0.1).abs() < 1e-6);
        assert!((0.005..0.3).contains(&error.flip), "{}", error.flip);
        let both = Summary::of(&[brighter.clone(), reference.clone()], &[reference.clone(), reference]);
        assert!((both.mean.relative_l2 - 0.05).abs() < 1e-6 && (both.worst.relative_l2 - 0.1).abs() < 1e-6);
    }
}
