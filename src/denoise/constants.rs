//! Tuned constants of the denoiser. How they were chosen: decision 11, unless a constant names another page.
//!
//! Radii and steps are in pixels, widths of range weights in units of the noise's standard deviation σ.

/// Least albedo that light is divided by.
pub(super) const MIN_ALBEDO: f32 = 0.02;
/// Number of guides for each kind of light, direct and indirect.
pub(super) const GUIDES: usize = 6;
/// Weight of the chroma of the first guide, relative to its luminance.
pub(super) const CHROMA: f32 = 2.0;

/// Radius of the filter of the albedo that is seen in mirrors or through smooth glass.
pub(super) const MIRRORED: usize = 3;
/// Least share of noise in the difference between an albedo and its filtered value for that value to count. Tuned:
/// decision 13.
pub(super) const MIN_MIRRORED_NOISE: f32 = 0.5;

/// Differences of features (normal, albedo, shares) at which a weight falls to 1/e.
pub(super) const NORMAL_WIDTH: f32 = 0.2;
pub(super) const ALBEDO_WIDTH: f32 = 0.25;
pub(super) const SHARE_WIDTH: f32 = 0.25;
/// Factor on the variance of normal, albedo and shares in feature distances. It makes a pixel on the edge of two
/// surfaces similar to both, since it has few neighbours of its own kind. Not applied to pixels that look through glass
/// or by a mirror. Tuned: decision 14.
pub(super) const FEATURE_NOISE: f32 = 16.0;
/// Width for the relative difference of inverse depth from the plane of the surface.
pub(super) const DEPTH_WIDTH: f32 = 0.03;

/// Radius of the patches over which guides are compared.
pub(super) const PATCH: usize = 1;

/// Radii, range widths and relative widths of the filter of the guides of direct light, and of direct light itself.
pub(super) const DIRECT_PILOT: usize = 5;
pub(super) const DIRECT_PILOT_NOISE: f32 = 0.7;
pub(super) const DIRECT_PILOT_RELATIVE: f32 = 0.05;
pub(super) const DIRECT: usize = 7;
/// Distance beyond which both filters read only every second pixel, or fewer at larger radii.
pub(super) const DIRECT_DENSE: usize = 3;
/// Filters of direct light in larger images: steps that the wide one reaches, and radius of the narrow one after it.
/// Tuned: decision 15.
pub(super) const DIRECT_WIDE: usize = 4;
pub(super) const DIRECT_NARROW: usize = 4;
/// Range-weight width of direct light in units of the noise's σ. Tuned: decision 12.
pub(super) const DIRECT_NOISE: f32 = 1.5;
pub(super) const DIRECT_RELATIVE: f32 = 0.05;

/// The wide filter of indirect light reads every `INDIRECT_STRIDE.0`th pixel across and down, and every
/// `INDIRECT_STRIDE.1`th in larger images. The stride is the image's side, the square root of its number of pixels,
/// over `SIDE_OF_STRIDE`. A narrow filter follows, whose radius must exceed the stride. Tuned: decision 16.
pub(super) const INDIRECT_PILOT_NOISE: f32 = 1.0;
pub(super) const INDIRECT_PILOT_RELATIVE: f32 = 0.05;
pub(super) const MIN_INDIRECT_STRIDE: usize = 3;
pub(super) const MAX_INDIRECT_STRIDE: usize = 4;
pub(super) const SIDE_OF_STRIDE: f64 = 110.0;
/// Radius of the wide filter, in strides.
pub(super) const INDIRECT_WIDE: usize = 6;
pub(super) const INDIRECT_NARROW: usize = 4;
pub(super) const INDIRECT_NOISE: f32 = 1.0;
pub(super) const INDIRECT_RELATIVE: f32 = 0.03;

/// Filter of each image of indirect light by itself: radius in steps, and step in pixels; then range width, slope and
/// relative width. Tuned: decision 17.
pub(super) const ALONE_STEPS: usize = 6;
pub(super) const ALONE_STEP_PIXELS: usize = 4;
pub(super) const ALONE_NOISE: f32 = 1.4;
pub(super) const ALONE_SLOPE: f32 = 0.03;
pub(super) const ALONE_RELATIVE: f32 = 0.03;
/// Near pass of that filter in large images, which have two passes: radius in steps, and step in pixels; then the range
/// width. Tuned: decision 18.
pub(super) const ALONE_NEAR_STEPS: usize = 4;
pub(super) const ALONE_NEAR_STEP_PIXELS: usize = 5;
pub(super) const ALONE_NEAR_NOISE: f32 = 2.0;
/// Far pass: radius in steps; then the range width.
pub(super) const ALONE_FAR_STEPS: usize = 4;
pub(super) const ALONE_FAR_NOISE: f32 = 4.0;
/// The far pass has steps of the image's side, the square root of its number of pixels, over this.
pub(super) const SIDE_OF_FAR_STEP: f64 = 59.0;
/// Bounds of that step in pixels. An image whose step would be below the first has one pass only; no step exceeds the
/// second. Tuned: decision 18.
pub(super) const MIN_FAR_STEP: usize = 12;
pub(super) const MAX_FAR_STEP: usize = 15;
/// Largest factor, and inverse of the smallest, that an image is scaled by to keep the sum of all images.
pub(super) const MAX_SCALE: f32 = 4.0;

/// Leverage of the slope correction for each effective sample of a mean: of the guides, and of what they filter. The
/// last is the upper bound of the leverage.
pub(super) const PILOT_SLOPE: f32 = 0.1;
pub(super) const SLOPE: f32 = 0.01;
pub(super) const MAX_LEVERAGE: f32 = 3.0;

/// Radii of the boxes over which the noise of raw and of filtered guides is averaged.
pub(super) const RAW_NOISE_REACH: usize = 2;
pub(super) const FILTERED_NOISE_REACH: usize = 3;
/// Radius, in cells of 3 × 3 pixels, over which the estimated risk is averaged.
pub(super) const RISK_CELLS: usize = 2;
/// A pixel is an outlier of its cell, and left out, where its change less its gain exceeds this many times the change
/// of the others together. Tuned: decision 19.
pub(super) const OUTLIER: f32 = 3.0;
/// Estimated best weight of the filtered value: below the first it counts 0, from the second on 1. Tuned: decision 49.
pub(super) const MIN_KEPT_SHARE: f32 = 0.2;
pub(super) const WHOLE_SHARE: f32 = 0.5;
/// Relative change by filtering up to which a weight of 1 is needed for that, and from which on [`WHOLE_SHARE`].
pub(super) const CHANGE: (f32, f32) = (0.2, 0.8);
/// The first of these weights for imported images, whose change does not matter: their noise is known less well.
pub(super) const MIN_KEPT_SHARE_OF_IMPORTED: f32 = 0.1;

/// Wiener gain of lost detail, and evenness of the square that it is estimated from: up to the first nothing is given back, from the
/// second on all. Tuned: decision 53.
pub(super) const DETAIL_GAIN: (f32, f32) = (0.3, 1.0);
pub(super) const DETAIL_EVENNESS: (f32, f32) = (0.25, 0.5);

/// Correlation of the two halves of the tiles: up to the first they are not believed, from the second on wholly.
pub(super) const MIN_AGREEMENT: f64 = 0.25;
pub(super) const WHOLE_AGREEMENT: f64 = 0.75;

/// Weight added to the direct neighbours of a pixel. It counts only where no neighbour is similar.
pub(super) const BESIDE: f32 = 1e-3;
/// Spatial σ as a share of the filter's radius.
pub(super) const NEARNESS: f32 = 1.0 / 1.7;
