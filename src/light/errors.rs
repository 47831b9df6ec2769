//! What images under lightings of every kind lose by compression.

use super::LightBasis;
use crate::encoding::{Decode, Encode};
use crate::matrix::ColumnIndex;

/// How far whole images are from those of the stored matrix, relative L2, after quantisation, over lightings
/// of every kind. NaN means not known.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct LightErrors {
    /// Under the prior's lightings, as it was expected when ranks and steps were chosen.
    pub prior: f32,
    /// All lights on, weight 1 each.
    pub all_on: f32,
    /// Root mean square under weights drawn evenly from 0 to 1 for each column by itself, over that of the images.
    pub random: f32,
    /// One column on alone: the mean over the columns that light anything.
    pub single_mean: f32,
    /// One column on alone: the worst.
    pub single_worst: f32,
    /// Index of that column.
    pub worst_column: u32,
    /// The noise of the samples in the stored images of single columns, in the same mean.
    pub noise_mean: f32,
    /// The noise of the samples in the stored image of `worst_column`.
    pub noise_worst: f32,
}

/// What denoising did to the images of the clusters of columns, relative L2, estimated from the two halves of the samples.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct DenoiseErrors {
    /// The noise of the samples before.
    pub noise_before: f32,
    /// Noise left after denoising.
    pub noise_after: f32,
    /// What the denoised images are off beside noise: where they were averaged over what is not alike.
    pub bias: f32,
}

impl DenoiseErrors {
    /// Whether these are the numbers of version 1 of containers for images that were not denoised.
    pub(crate) fn is_none(&self) -> bool {
        self.noise_before.is_nan() && self.noise_after.is_nan() && self.bias.is_nan()
    }
}

/// A line on what denoising did, for people.
pub fn denoise_errors_line(errors: &DenoiseErrors) -> String {
    format!(
        "denoising, relative L2 of the images of groups of lights: noise {:.2e} before, {:.2e} after, bias {:.2e} (estimated)",
        errors.noise_before, errors.noise_after, errors.bias
    )
}

/// What denoising did to the picture under one light alone, all its columns on, relative L2, estimated from the two halves of the
/// samples. Of lights that share groups of columns ([`LightGroups`](super::LightGroups)) all together.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct DenoisedLight {
    /// Noise and bias, for this light.
    pub errors: DenoiseErrors,
    /// The sum of the light of the denoised picture over that of the samples. What is below 1 was lost with bright samples that no
    /// pixel around them confirmed.
    pub light_kept: f32,
}

impl DenoisedLight {
    /// How far the picture is from a converged one, relative L2: noise and bias together.
    pub fn error(&self) -> f32 {
        self.errors.noise_after.hypot(self.errors.bias)
    }
}

/// Lines on the lights of a basis that are farthest off, for people. None where nothing is known of them.
pub fn denoised_light_lines(lights: &[DenoisedLight], basis: &LightBasis) -> Vec<String> {
    /// Lights that are named.
    const NAMED: usize = 3;
    let mut worst: Vec<usize> = (0..lights.len()).collect();
    worst.sort_by(|&a, &b| lights[b].error().total_cmp(&lights[a].error()));
    let line = |&light: &usize| {
        let DenoisedLight { errors, light_kept } = lights[light];
        let [after, bias, kept] = [errors.noise_after, errors.bias, light_kept].map(|share| 100.0 * share);
        format!(
            "light '{}' alone: noise {after:.1} %, bias {bias:.1} %, {kept:.1} % of the light of its samples kept",
            basis.lights()[light].name
        )
    };
    let mut lines: Vec<String> = worst.iter().take(NAMED).map(line).collect();
    if let Some(&next) = worst.get(NAMED) {
        let error = 100.0 * lights[next].error();
        lines.push(format!("the other {} lights alone: at most {error:.1} % off", worst.len() - NAMED));
    }
    lines
}

/// The error of exposed images in units of white. The image under each probe lighting
/// ([`probe_lightings`](super::probe_lightings)) is exposed so that its 95th percentile is white. The error is the root
/// mean square over pixels that are not clipped; of all lightings the worst.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct ExposedError {
    /// What was asked for; 0 where that was a time.
    pub asked: f32,
    /// The error reached, measured for some blocks against independent samples.
    pub reached: f32,
}

/// A line on the error of exposed images of a matrix of samples as it is, a fraction of white, for people.
pub fn expected_error_line(error: f64) -> String {
    let percent = 100.0 * error;
    format!(
        "exposed images of the matrix as it is, not denoised: expected error {percent:.2} % of white (the worst of 16 lightings)"
    )
}

/// A line on what was reached and asked for, for people.
pub fn exposed_error_line(error: &ExposedError) -> String {
    let asked = match error.asked {
        0.0 => String::new(),
        asked => format!(", {:.2} % asked for", 100.0 * asked),
    };
    format!("exposed images: error {:.2} % of white reached{asked} (the worst of 16 lightings)", 100.0 * error.reached)
}

/// How far the picture under one light alone is from what it should be, beyond the noise of the samples.
#[derive(Clone, Debug, PartialEq)]
pub struct LightLoss {
    /// Name of the light.
    pub light: String,
    /// Relative L2 over the whole picture, all columns of the light on.
    pub error: f64,
}

impl LightLoss {
    /// Error from which on people are told.
    const NOTABLE: f64 = 0.05;
    /// Error from which on there is little left of the light.
    const SEVERE: f64 = 0.5;

    /// The loss of a light with this squared error, noise of the samples and norm, or `None` if it is not worth a
    /// warning.
    pub fn notable(light: &str, [error, noise, norm]: [f64; 3]) -> Option<Self> {
        let error = ((error - noise).max(0.0) / norm.max(f64::MIN_POSITIVE)).sqrt();
        (error > Self::NOTABLE).then(|| Self { light: light.to_owned(), error })
    }

    /// Whether so little is left of the light that nobody would want it.
    pub fn is_severe(&self) -> bool {
        self.error > Self::SEVERE
    }
}

/// A line for people.
impl std::fmt::Display for LightLoss {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "light '{}' alone is {:.0} % off", self.light, 100.0 * self.error)
    }
}

/// The errors that are known over the whole image.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StatedErrors {
    /// Errors of compression.
    pub lights: Option<LightErrors>,
    /// Errors of denoising before that.
    pub denoising: Option<DenoiseErrors>,
    /// Those of denoising for each light alone, in the order of the basis; empty where they are not known.
    pub denoised_lights: Vec<DenoisedLight>,
    /// That of exposed images, where one was asked for and images were denoised.
    pub exposed: Option<ExposedError>,
}

/// Two lines on what images lose, for people.
pub fn light_errors_lines(errors: &LightErrors, basis: &LightBasis) -> [String; 2] {
    let noise = |share: f32| match share.is_nan() {
        true => "noise of the samples not known".to_owned(),
        false => format!("the samples' noise {share:.2e}"),
    };
    [
        format!(
            "images, relative L2: {:.2e} expected under the prior; measured: {:.2e} all on, {:.2e} with every light at \
             random",
            errors.prior, errors.all_on, errors.random
        ),
        format!(
            "one light alone: {:.2e} in the mean ({}), worst {:.2e}, {} ({})",
            errors.single_mean,
            noise(errors.noise_mean),
            errors.single_worst,
            column_name(ColumnIndex(errors.worst_column), basis),
            noise(errors.noise_worst)
        ),
    ]
}

/// A column by its light and, where that has several, its texel.
pub fn column_name(column: ColumnIndex, basis: &LightBasis) -> String {
    let column = basis.column(column);
    match column.light.layout() {
        (1, 1) => format!("'{}'", column.light.name),
        _ => format!("'{}' texel {},{}", column.light.name, column.texel.0, column.texel.1),
    }
}
