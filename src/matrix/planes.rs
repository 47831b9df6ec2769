//! What the samples of a block are: light by how it came, emitters in view, and the surfaces that are seen.

use std::ops::Range;

use super::CHANNELS;

/// Planes of features: see [`Feature`].
pub const FEATURE_PLANES: usize = 14;

/// Emitters that are listed for each pixel at most, in the mean over a block.
const MAX_SEEN_IN_PIXEL: u64 = 8;

/// What is known of a pixel beside its light: of each sample, at the first surface that scatters, where the camera
/// path stops at last. Mirrors, smooth glass and thin sheets on the way are passed. All are means over the pixel's
/// samples but the material; a sample whose path leaves the scene counts as zero in every plane but [`Emitter`](Self::Emitter)
/// and [`Specular`](Self::Specular).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feature {
    /// RGB: share of light that the surface reflects towards the viewer (diffuse, and specular where rough), times
    /// what mirrors and glass on the way keep. Zero on black surfaces.
    Albedo,
    /// x, y, z: unit shading normal in world space, on the viewer's side.
    Normal,
    /// Length of the camera path to the surface, in scene units.
    Depth,
    /// Part of the samples whose camera path shows an emitter, by either way from smooth glass.
    Emitter,
    /// Part of the samples that came by a mirror or through smooth glass.
    Specular,
    /// Part of the samples that end on a surface: `Depth / Surface` is the mean over those alone.
    Surface,
    /// Index of the surface's material, from 1 on in the order of the scene; 0 without a surface. A mean of indices
    /// would name another material, so it is that of the first sample. Its variance is that of the mean of indices, 0
    /// if all samples show one material. 0 as well if a file of an earlier version, or an import, does not know it.
    Material,
    /// RGB: the albedo of the pixel by further camera rays, which carry no light, together with the samples. Where the samples alone
    /// know it well, and in files of an earlier version and imports, it is [`Albedo`](Self::Albedo).
    PixelAlbedo,
}

/// Light of an emitter that a pixel shows: the emitter is met by the camera ray, or through a chain of mirrors and
/// smooth glass.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct SeenEmission {
    /// Pixel in the block.
    pub pixel: u32,
    /// Column of `T`.
    pub column: u32,
    /// RGB: its part of the entry, a mean over all samples.
    pub value: [f32; CHANNELS],
}

/// The planes of a block's samples, for clusters of columns (`light::Clusters`) whose 0/1 matrix is `S`.
///
/// `T S = mean of halves (direct + indirect) + emission S`, to rounding. Here the columns of `T` and `emission` are
/// divided by their scales as direct and indirect light are (see [`TracedBlock`](super::TracedBlock)). With an odd
/// number of samples the first half has one more, and the mean is weighted accordingly. Light and variances are rounded
/// to nine significant bits ([`encode_unsigned`]) in memory too, so that files return what they were given.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BlockPlanes {
    /// For each half of the samples, rows × clusters, column-major: the mean of light that reaches the first surface
    /// that scatters straight from an emitter, or through thin sheets.
    pub direct: [Vec<f32>; 2],
    /// The same of light that comes by other surfaces, mirrors and glass.
    pub indirect: [Vec<f32>; 2],
    /// Pixels × [`FEATURE_PLANES`], plane by plane in the order of [`Feature`].
    pub features: Vec<f32>,
    /// The same layout: variance of those means, as if samples were independent.
    pub feature_variance: Vec<f32>,
    /// Emitters in view, sorted by pixel, then column: at most [`most_seen`](Self::most_seen), the brightest. What is
    /// fainter, where a pixel of a glass ball sees a whole panel of texels, counts as indirect.
    pub emission: Vec<SeenEmission>,
}

impl Feature {
    /// All features in the order of their planes.
    pub const ALL: [Self; 8] = [
        Self::Albedo,
        Self::Normal,
        Self::Depth,
        Self::Emitter,
        Self::Specular,
        Self::Surface,
        Self::Material,
        Self::PixelAlbedo,
    ];

    /// Whether it is of the samples that carry light alone, without further camera rays.
    pub fn is_of_light(self) -> bool {
        matches!(self, Self::Albedo | Self::Emitter | Self::Specular | Self::Material)
    }

    /// The planes of the feature.
    pub fn planes(self) -> Range<usize> {
        match self {
            Self::Albedo => 0..3,
            Self::Normal => 3..6,
            Self::Depth => 6..7,
            Self::Emitter => 7..8,
            Self::Specular => 8..9,
            Self::Surface => 9..10,
            Self::Material => 10..11,
            Self::PixelAlbedo => 11..14,
        }
    }
}

impl BlockPlanes {
    /// Emitters that a block of `pixels` lists, at most.
    pub fn most_seen(pixels: u64, columns: u64) -> u64 {
        pixels * columns.min(MAX_SEEN_IN_PIXEL)
    }

    /// Takes the albedo of the samples for that of the pixel, of which nothing more is known.
    pub fn pixel_albedo_of_samples(&mut self) {
        let [from, to] = [Feature::Albedo, Feature::PixelAlbedo].map(|feature| {
            let planes = feature.planes();
            planes.start * self.pixels()..planes.end * self.pixels()
        });
        for planes in [&mut self.features, &mut self.feature_variance] {
            planes.copy_within(from.clone(), to.start);
        }
    }

    /// Makes these the empty planes of a block of `pixels` and `clusters`, keeping the allocations. The values of the
    /// fixed-size planes are left as they were: whoever fills them writes all.
    pub fn reset(&mut self, pixels: usize, clusters: usize) {
        for light in self.direct.iter_mut().chain(&mut self.indirect) {
            light.resize(pixels * CHANNELS * clusters, 0.0);
        }
        self.features.resize(pixels * FEATURE_PLANES, 0.0);
        self.feature_variance.resize(pixels * FEATURE_PLANES, 0.0);
        self.emission.clear();
    }

    /// Rounds light and variances to what [`encode_unsigned`] keeps.
    pub fn round(&mut self) {
        let light = self.direct.iter_mut().chain(&mut self.indirect);
        for plane in light.chain([&mut self.feature_variance]) {
            // One loop over a slice, which the compiler makes of whole vectors.
            for value in plane.as_mut_slice() {
                *value = decode_unsigned(encode_unsigned(*value));
            }
        }
    }

    /// Bytes of the planes in memory but for the emission.
    pub fn fixed_bytes(pixels: u64, clusters: u64) -> u64 {
        4 * pixels * (4 * CHANNELS as u64 * clusters + 2 * FEATURE_PLANES as u64)
    }

    /// Pixels of the block.
    pub fn pixels(&self) -> usize {
        self.features.len() / FEATURE_PLANES
    }

    /// Clusters that light is summed over.
    pub fn clusters(&self) -> usize {
        self.direct[0].len().checked_div(self.pixels() * CHANNELS).unwrap_or(0)
    }

    /// Means of a feature: pixels × its planes, plane by plane.
    pub fn feature(&self, feature: Feature) -> &[f32] {
        let (pixels, planes) = (self.pixels(), feature.planes());
        &self.features[planes.start * pixels..planes.end * pixels]
    }

    /// Variances of a feature's means, in the layout of [`feature`](Self::feature).
    pub fn variance(&self, feature: Feature) -> &[f32] {
        let (pixels, planes) = (self.pixels(), feature.planes());
        &self.feature_variance[planes.start * pixels..planes.end * pixels]
    }
}

/// Drop of bits from an f32 to the 16 that are kept: 8 of exponent, 8 of fraction, no sign.
const DROPPED: u32 = 15;

/// Rounds a non-negative value to a 16-bit float with the range of f32 and nine significant bits: the upper half of an
/// f32 without its sign. The relative error is at most 2⁻⁹. Negative values and NaN give 0, values that are too large
/// the largest.
#[inline]
pub fn encode_unsigned(value: f32) -> u16 {
    // Also of −0, whose sign would be a bit.
    let bits = if value > 0.0 { value.min(f32::MAX).to_bits() } else { 0 };
    // Half of the last bit, less one where the kept part is even: ties go to the even one.
    let rounded = (bits + (1 << (DROPPED - 1)) - 1 + (bits >> DROPPED & 1)) >> DROPPED;
    rounded.min(f32::MAX.to_bits() >> DROPPED) as u16
}

/// The value of a 16-bit float of [`encode_unsigned`].
#[inline]
pub fn decode_unsigned(bits: u16) -> f32 {
    f32::from_bits(u32::from(bits) << DROPPED)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unsigned_floats_keep_nine_bits_and_what_they_have_kept_once() {
        let mut value = f32::MIN_POSITIVE;
        while value < 1e38 {
            let kept = decode_unsigned(encode_unsigned(value));
            assert!((kept - value).abs() <= value * 2f32.powi(-9), "{value} became {kept}");
            assert_eq!(decode_unsigned(encode_unsigned(kept)), kept);
            value *= 1.000_37;
        }
        // Ties go to even: 1 + 1/512 lies between 1 and 1 + 1/256, 1 + 3/512 between 1 + 1/256 and 1 + 2/256.
        let kept = |value: f32| decode_unsigned(encode_unsigned(value));
        assert_eq!((kept(1.0 + 1.0 / 512.0), kept(1.0 + 3.0 / 512.0)), (1.0, 1.0 + 2.0 / 256.0));
        assert_eq!([0.0, -1.0, -0.0, f32::NAN].map(encode_unsigned), [0; 4]);
        assert!([f32::MAX, f32::INFINITY].map(kept).iter().all(|v| v.is_finite() && *v > 3e38));
    }
}
