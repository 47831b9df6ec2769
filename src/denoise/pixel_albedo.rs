//! The albedo that further camera rays have measured in place of that of the samples.
//!
//! Few samples of a fine texture, of leaves or of an edge hit its colours unevenly. That noise is in the light of a pixel
//! and in the albedo of the same samples alike, and light divided by it is free of it. Multiplied by the albedo of more
//! rays, the light is what it would be if the samples had hit the colours evenly: a ratio estimator (Cochran, *Sampling
//! Techniques*, 3rd edition, §6.2).

use crate::matrix::{BlockPlanes, CHANNELS, Feature};

/// Bounds of the factor, for pixels whose samples hardly saw what the rays see.
const MAX_FACTOR: f32 = 4.0;

/// Scales the light of a block's pixels from the albedo of their samples to that of the pixels, which becomes their albedo.
pub(super) fn adopt(planes: &mut BlockPlanes) {
    let pixels = planes.pixels();
    let [sampled, of_pixel] = [Feature::Albedo, Feature::PixelAlbedo].map(|feature| planes.feature(feature));
    if sampled == of_pixel {
        return;
    }
    let factor = |(&sampled, &of_pixel): (&f32, &f32)| {
        if sampled > 0.0 { (of_pixel / sampled).clamp(1.0 / MAX_FACTOR, MAX_FACTOR) } else { 1.0 }
    };
    let factors: Vec<f32> = sampled.iter().zip(of_pixel).map(factor).collect();
    for half in planes.direct.iter_mut().chain(&mut planes.indirect) {
        for image in half.chunks_exact_mut(CHANNELS * pixels) {
            image.iter_mut().zip(&factors).for_each(|(light, factor)| *light *= factor);
        }
    }
    let [to, from] = [Feature::Albedo, Feature::PixelAlbedo].map(Feature::planes);
    for of in [&mut planes.features, &mut planes.feature_variance] {
        of.copy_within(from.start * pixels..from.end * pixels, to.start * pixels);
    }
    planes.round();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_scaled_to_the_albedo_of_the_pixel() {
        let mut planes = BlockPlanes::default();
        planes.reset(2, 1);
        planes.features.fill(0.5);
        planes.feature_variance.fill(0.25);
        let of_pixel = Feature::PixelAlbedo.planes().start;
        // The red of pixel 1 is half of what its samples saw; the blue of pixel 0 too much for them to know.
        planes.features[2 * of_pixel + 1] = 0.25;
        planes.features[2 * (of_pixel + 2)] = 50.0;
        planes.direct.iter_mut().chain(&mut planes.indirect).for_each(|half| half.fill(1.0));
        adopt(&mut planes);
        let expected = [1.0, 0.5, 1.0, 1.0, 4.0, 1.0];
        for half in planes.direct.iter().chain(&planes.indirect) {
            assert_eq!(*half, expected);
        }
        assert_eq!(planes.feature(Feature::Albedo), [0.5, 0.25, 0.5, 0.5, 50.0, 0.5]);
    }
}
