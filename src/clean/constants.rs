//! Every constant of the filter that was tuned. All were chosen on `conference-24` at 384 × 288 pixels and on the built-in room
//! `mixed` at 256 × 192 pixels, 16 and 64 samples, seed 1; the relative widths of indirect light and the weight of colour also on
//! `cornell-glossy` at 192 × 192 pixels, seed 0; the slopes on those three and `cornell-mirror`, the agreement on the panels among
//! them, `cornell-water` and `erw5-scene3`, all as `ltm study picture` has them. The cells of risks were chosen on the demonstration's
//! room at 256 samples. All that came later was kept only where no row of all nine scenes of that study became visibly worse, so
//! these are not wholly strangers; or it says what it was measured on.

/// Light is divided by no albedo below this.
pub(super) const LEAST_ALBEDO: f32 = 0.02;
/// Guides of each kind of light.
pub(super) const GUIDES: usize = 6;
/// Weight of the colour of the first of them.
pub(super) const CHROMA: f32 = 2.0;

/// Radius of the filter of albedo that is seen by a mirror or through smooth glass.
pub(super) const MIRRORED: usize = 3;
/// Share of noise in what that takes away from the albedo below which nothing is taken away: the variance of the samples is more than their noise, for they are
/// spread over the pixel. Of 0, 0.5 and 0.8, chosen on `erw5-scene5` at 640 × 480 pixels (a ball of glass, which was grainy), and on
/// `mixed` and `cornell-water` as the picture study has them, all at 16 samples: with 0 ꟻLIP of the two rose by 1 %.
pub(super) const LEAST_MIRRORED_NOISE: f32 = 0.5;

/// Differences of what pixels see at which a weight is 1/e.
pub(super) const NORMAL_WIDTH: f32 = 0.2;
pub(super) const ALBEDO_WIDTH: f32 = 0.25;
pub(super) const SHARE_WIDTH: f32 = 0.25;
/// Variances of normal, albedo and shares count so many times: a pixel on the edge of two surfaces is like both of them, for
/// of its own kind there is only the edge, too little to average. Chosen with one lamp of `conference-24` at 1024 × 768 pixels,
/// 16 and 64 samples; the same of depths was worse. Not where a pixel looks through glass or by a mirror: waves would make all that
/// is behind them alike (`cornell-water` at 128 × 128 pixels).
pub(super) const FEATURE_NOISE: f32 = 16.0;
/// Relative, of the inverse depth against the plane of the surface.
pub(super) const DEPTH_WIDTH: f32 = 0.03;

/// Pixels to each side of those that guides are compared over together.
pub(super) const PATCH: usize = 1;

/// Radius of the filter of the guides of direct light, and of direct light itself.
pub(super) const DIRECT_PILOT: usize = 5;
pub(super) const DIRECT_PILOT_NOISE: f32 = 0.7;
pub(super) const DIRECT_PILOT_RELATIVE: f32 = 0.05;
pub(super) const DIRECT: usize = 7;
/// Beyond so many pixels both read every second one, or fewer of larger radii.
pub(super) const DIRECT_DENSE: usize = 3;
/// In larger images direct light has a wide filter and a narrow one as indirect light has: steps that the wide one reaches, and
/// radius of the narrow one. Chosen on `conference-24` at 1024 × 768 pixels and 16 samples, of which single lamps had mottle of the size of
/// the one filter; smaller images lost 1 to 5 % of ꟻLIP by it with all lamps on.
pub(super) const DIRECT_WIDE: usize = 4;
pub(super) const DIRECT_NARROW: usize = 4;
/// Of 1.2, 1.5, 2 and 2.5, for guides of half of the samples, chosen on the bunny under a sky with a sun (`formats/scenes/bunny-city.toml`,
/// 640 × 480 pixels) and three lamps of `conference-24` at 1024 × 768 pixels, 16 samples: with 2 the bunny has softer facets and 0.1 dB more in
/// clip, the lamps' ꟻLIP is 0.7 to 1.1 % higher; with 1.2 it is the other way round, by 0.2 dB and 0.5 %. In `ltm study picture` no row of nine
/// scenes had a ꟻLIP more than 0.4 % higher than that of cleaner 13, which weighed both halves by guides of all samples.
pub(super) const DIRECT_NOISE: f32 = 1.5;
pub(super) const DIRECT_RELATIVE: f32 = 0.05;

/// The wide filter of indirect light reads every third pixel across and down, in larger images every fourth; a narrow one
/// follows, which must reach farther than that. The first was chosen as all the rest, of 3, 4 and 5; the second, and the side of an image
/// for each, on `conference-24` at 1024 × 768 pixels, of which single lamps looked blotched.
pub(super) const INDIRECT_PILOT_NOISE: f32 = 1.0;
pub(super) const INDIRECT_PILOT_RELATIVE: f32 = 0.05;
pub(super) const MIN_INDIRECT_STRIDE: usize = 3;
pub(super) const MAX_INDIRECT_STRIDE: usize = 4;
pub(super) const SIDE_OF_STRIDE: f64 = 110.0;
/// Steps of that size that it reaches.
pub(super) const INDIRECT_WIDE: usize = 6;
pub(super) const INDIRECT_NARROW: usize = 4;
pub(super) const INDIRECT_NOISE: f32 = 1.0;
pub(super) const INDIRECT_RELATIVE: f32 = 0.03;

/// Each image of indirect light by itself, after that: steps that its filter reaches and pixels of a step, widths and the slope. Chosen on
/// `conference-24`, `mixed` and `cornell-glossy` at 16 samples, as the picture study has them. The same of direct light gained a
/// thousandth of FLIP there, took as long again, and under a sky of 64 samples lost 6 dB.
pub(super) const ALONE_STEPS: usize = 6;
pub(super) const ALONE_STEP_PIXELS: usize = 4;
pub(super) const ALONE_NOISE: f32 = 1.4;
pub(super) const ALONE_SLOPE: f32 = 0.03;
pub(super) const ALONE_RELATIVE: f32 = 0.03;
/// Large images have two passes of that in place of one: a near pass, then a far pass. Steps that the near pass reaches and pixels of a
/// step, and its width. All constants of both passes were chosen on three lamps of `conference-24` at 1024 × 768 pixels, 16 and 64
/// samples, which had soft blotches: ꟻLIP fell by 12 to 8 % and by 7 to 2 %.
pub(super) const ALONE_NEAR_STEPS: usize = 4;
pub(super) const ALONE_NEAR_STEP_PIXELS: usize = 5;
pub(super) const ALONE_NEAR_NOISE: f32 = 2.0;
/// Steps that the far pass reaches, and its width.
pub(super) const ALONE_FAR_STEPS: usize = 4;
pub(super) const ALONE_FAR_NOISE: f32 = 4.0;
/// A step of the far pass is the image's side, the root of its pixels, over this.
pub(super) const SIDE_OF_FAR_STEP: f64 = 59.0;
/// Pixels of a step: where it would be less than the first there is one pass only, and it is never more than the second. With 9 as the first,
/// 512 × 512 and 640 × 480 pixels would have two passes: of `erw5-scene8`, `cornell-glossy` and `cornell-water` ꟻLIP fell by up to
/// 1.3 % at 16 samples then, and rose by up to 1.3 % at 64.
pub(super) const MIN_FAR_STEP: usize = 12;
pub(super) const MAX_FAR_STEP: usize = 15;
/// What an image is scaled by at most, and at least by its inverse, for their sum to stay.
pub(super) const MOST_SCALE: f32 = 4.0;

/// Leverage of the correction for slopes that each sample of a mean pays for: of the guides, of what is filtered by them; and
/// the most there is.
pub(super) const PILOT_SLOPE: f32 = 0.1;
pub(super) const SLOPE: f32 = 0.01;
pub(super) const MOST_LEVERAGE: f32 = 3.0;

/// Reach of the squares over which the noise of raw and of filtered guides are means.
pub(super) const RAW_NOISE_REACH: usize = 2;
pub(super) const FILTERED_NOISE_REACH: usize = 3;
/// Cells of 3 × 3 pixels to each side over which risks are means.
pub(super) const RISK_CELLS: usize = 2;
/// A pixel is an outlier of its cell, and left out, where its change less its gain is more than so many times what the others
/// change together. Of 1 and 3, chosen on the sky of the built-in `environment` at 48 × 40 pixels and 64 samples, where to leave out a
/// pixel of every cell lost detail; kept since no row of all nine scenes of `ltm study picture` became worse by more than 0.2 % of ꟻLIP.
pub(super) const OUTLIER: f32 = 3.0;
/// Estimated best shares of the mean below which none of it is taken, and from which on all.
pub(super) const LEAST_SHARE: f32 = 0.1;
pub(super) const WHOLE_SHARE: f32 = 0.5;

/// Correlation of what two halves of the tiles say of the columns from which on it is believed, and that from which on wholly.
pub(super) const LEAST_AGREEMENT: f64 = 0.25;
pub(super) const WHOLE_AGREEMENT: f64 = 0.75;

/// Added to the weight of the pixels beside one: it counts only where none is alike.
pub(super) const BESIDE: f32 = 1e-3;
/// Share of the radius at which the distance itself takes a weight to 1/√e.
pub(super) const NEARNESS: f32 = 1.0 / 1.7;
