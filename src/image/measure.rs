//! Error of an image against its reference.

use super::LinearImage;

/// Error of an image against a reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageError {
    /// `‖image − reference‖₂ / ‖reference‖₂` over all channels; 0 where both are black.
    pub relative_l2: f64,
    /// PSNR in dB with the peak at the largest reference value ("lin").
    pub psnr_linear: f64,
    /// PSNR in dB after exposing the reference's 95th luminance percentile to 1 and clipping to [0, 1] ("clip").
    pub psnr_clipped: f64,
    /// The peak of `psnr_linear`.
    pub peak: f32,
}

/// Compares an image with its reference.
///
/// # Panics
/// If their sizes differ.
pub fn compare(image: &LinearImage, reference: &LinearImage) -> ImageError {
    assert_eq!((image.width, image.height), (reference.width, reference.height));
    let pairs = || image.values().iter().zip(reference.values()).map(|(&a, &b)| (f64::from(a), f64::from(b)));
    let squared_error: f64 = pairs().map(|(a, b)| (a - b).powi(2)).sum();
    let squared_norm: f64 = pairs().map(|(_, b)| b * b).sum();
    let count = reference.values().len() as f64;
    let peak = reference.values().iter().copied().fold(0.0f32, f32::max);
    let exposure = 1.0 / f64::from(percentile(reference.luminances().collect(), 0.95)).max(f64::MIN_POSITIVE);
    let clip = |v: f64| (v * exposure).clamp(0.0, 1.0);
    let squared_clipped: f64 = pairs().map(|(a, b)| (clip(a) - clip(b)).powi(2)).sum();
    let relative_l2 = if squared_error == 0.0 { 0.0 } else { (squared_error / squared_norm).sqrt() };
    ImageError {
        relative_l2,
        psnr_linear: psnr(squared_error / count, f64::from(peak)),
        psnr_clipped: psnr(squared_clipped / count, 1.0),
        peak,
    }
}

/// Peak signal-to-noise ratio in dB; infinite for a perfect match, of black against black too.
fn psnr(mean_squared_error: f64, peak: f64) -> f64 {
    if mean_squared_error == 0.0 {
        return f64::INFINITY;
    }
    10.0 * (peak * peak / mean_squared_error).log10()
}

/// The value below which a fraction `p` of `values` lies; 0 if there are none.
pub(crate) fn percentile(mut values: Vec<f32>, p: f64) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let index = ((values.len() - 1) as f64 * p).round() as usize;
    *values.select_nth_unstable_by(index, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_errors_are_measured() {
        let reference = LinearImage { width: 2, height: 1, pixels: vec![[1.0; 3], [2.0; 3]] };
        let mut image = reference.clone();
        assert_eq!(compare(&image, &reference).relative_l2, 0.0);
        assert_eq!(compare(&image, &reference).psnr_linear, f64::INFINITY);
        image.pixels[0] = [1.2; 3];
        let error = compare(&image, &reference);
        assert!((error.relative_l2 - 0.2 / 5f64.sqrt()).abs() < 1e-6);
        assert!((error.psnr_linear - 10.0 * (4.0f64 / 0.02).log10()).abs() < 1e-4);
        assert_eq!(error.peak, 2.0);
    }

    #[test]
    fn black_matches_black() {
        let black = LinearImage::black(2, 2);
        let error = compare(&black, &black);
        assert_eq!((error.relative_l2, error.psnr_linear, error.psnr_clipped), (0.0, f64::INFINITY, f64::INFINITY));
    }

    #[test]
    fn clipping_hides_errors_above_white() {
        let mut reference = LinearImage { width: 100, height: 1, pixels: vec![[1.0; 3]; 100] };
        reference.pixels[7] = [50.0; 3];
        let mut image = reference.clone();
        image.pixels[7] = [30.0; 3];
        let error = compare(&image, &reference);
        assert!(error.psnr_linear < 40.0 && error.psnr_clipped == f64::INFINITY);
    }
}
