//! How finely each band of a right side is stored: by what its errors do to images.

use super::component::right_shapes;
use super::planes::bands;
use crate::container::layout::LightLayout;
use crate::light::LightingPrior;
use crate::matrix::cosines::ZONES;

/// Bands are finer or coarser by at most this many half octaves: a step 1,024 times smaller or larger.
const MOST: i32 = 20;

/// Step refinement of each band of a right factor relative to its component's step, in half octaves. An image of texels
/// has ten bands, its zones of frequency; each light of one column is a band. Empty if all bands are alike.
///
/// An error `e` of a band's coefficient changes images by `e² bᵀ K b` in the mean. `K = F Fᵀ + diag(d)` is the
/// covariance of the prior's lightings, and `b` what the coefficient adds to the columns. So a band of mean weight `w`
/// gets the component's step over `√w`. With one step for all bands, the sum over a panel's 1,024 texels would have 32
/// times the error of a single lamp. No band of texels counts less than their mean, and no light of one column less than 1:
/// decision 35.
///
/// # Panics
/// If the lights and the prior have different numbers of columns.
pub fn band_steps(lights: &LightLayout, prior: &LightingPrior) -> Vec<i8> {
    let finer = |weight: f64| (weight.log2().round() as i32).clamp(-MOST, MOST) as i8;
    let mut weights = band_weights(lights, prior);
    let (variances, mut first) = (prior.variances(), 0);
    let mut rest = weights.as_mut_slice();
    for shape in right_shapes(lights) {
        let bands;
        (bands, rest) = rest.split_at_mut(shape.bands());
        let of_light = &variances[first..][..shape.values()];
        let mean = of_light.iter().map(|&v| f64::from(v)).sum::<f64>() / of_light.len() as f64;
        let least = if shape.tile == 0 { 1.0 } else { mean };
        bands.iter_mut().for_each(|weight| *weight = weight.max(least));
        first += shape.values();
    }
    let finer: Vec<i8> = weights.into_iter().map(finer).collect();
    if finer.iter().all(|&finer| finer == 0) { Vec::new() } else { finer }
}

/// The mean of `bᵀ K b` over the coefficients of each band.
fn band_weights(lights: &LightLayout, prior: &LightingPrior) -> Vec<f64> {
    assert_eq!(lights.columns(), prior.columns());
    let mut weights = Vec::new();
    let mut rest = prior.independent();
    for shape in right_shapes(lights) {
        let here;
        (here, rest) = rest.split_at(shape.values());
        let mean = here.iter().map(|&d| f64::from(d)).sum::<f64>() / here.len() as f64;
        match shape.tile {
            0 => weights.extend(here.iter().map(|&d| f64::from(d))),
            _ => weights.extend([mean; ZONES]),
        }
    }
    let square = |value: &f32| f64::from(*value).powi(2);
    for column in prior.factor().chunks_exact(prior.columns()) {
        let (mut rest, mut rest_of_weights) = (column, weights.as_mut_slice());
        for shape in right_shapes(lights) {
            let (here, weights);
            (here, rest) = rest.split_at(shape.values());
            (weights, rest_of_weights) = rest_of_weights.split_at_mut(shape.bands());
            match shape.tile {
                0 => weights.iter_mut().zip(here).for_each(|(weight, value)| *weight += square(value)),
                _ => {
                    for (weight, band) in weights.iter_mut().zip(bands(here, shape)) {
                        *weight += band.iter().map(square).sum::<f64>() / band.len().max(1) as f64;
                    }
                }
            }
        }
    }
    weights
}

#[cfg(test)]
mod tests {
    use super::super::{CodecSettings, LayerPart, decode_layer, encode_layer};
    use super::*;
    use crate::container::layout::BlockLayout;
    use crate::light::{Light, LightBasis, LightKind};
    use crate::matrix::{BlockId, FactoredBlock, MatrixShape};

    fn basis(side: u32, lamps: usize) -> LightBasis {
        let mut basis = LightBasis::new();
        let kind = LightKind::AreaTexels { across: side, down: side };
        basis.push(Light::unplaced("panel", kind)).unwrap();
        (0..lamps).for_each(|i| {
            basis.push(Light::unplaced(format!("lamp {i}"), LightKind::Lamp)).unwrap();
        });
        basis
    }

    /// Frequency 0 is the sum over all texels over the root of their number; a lamp is itself.
    #[test]
    fn bands_are_finer_by_what_they_do_to_images() {
        let basis = basis(8, 2);
        let prior = LightingPrior::of_lights_alone(&basis, &[0.5, 0.48, 0.02]);
        let finer = band_steps(&LightLayout::of(&basis), &prior);
        let energy = |columns: std::ops::Range<usize>| {
            let mut weights = [0.0; 66];
            weights[columns.clone()].fill((columns.len() as f64).sqrt().recip());
            prior.energy(&weights)
        };
        let expected = [energy(0..64), energy(64..65), energy(65..66)].map(|energy| energy.log2().round());
        assert_eq!([finer[0], finer[11]].map(f64::from), [expected[0], expected[2]]);
        // A bright lamp beside a faint one weighs less than 1, as the texels do.
        assert!(expected[1] < 0.0 && finer.len() == 12 && finer[9] < 0 && finer[10] == 0 && finer[11] > 0, "{finer:?}");
        assert!(band_steps(&LightLayout::of(&basis), &LightingPrior::flat(66)).is_empty());
    }

    /// The transform is orthonormal: over all coefficients the weights are those of the columns.
    #[test]
    fn weights_of_bands_add_up_to_those_of_columns() {
        for side in [8, 32, 48] {
            let basis = basis(side, 3);
            let (lights, prior) = (LightLayout::of(&basis), LightingPrior::of_basis(&basis));
            let counts = right_shapes(&lights).flat_map(|shape| {
                let of_image = bands(&vec![0.0; shape.values()], shape).map(|band| band.len());
                if shape.tile == 0 { vec![1; shape.values()] } else { of_image.to_vec() }
            });
            let weights = band_weights(&lights, &prior);
            let sum: f64 = counts.zip(&weights).map(|(count, weight)| count as f64 * weight).sum();
            let expected: f64 = prior.variances().iter().map(|&v| f64::from(v)).sum();
            assert!((sum / expected - 1.0).abs() < 1e-4, "{sum} over {expected}");
        }
    }

    #[test]
    fn smooth_lightings_want_low_frequencies_finer() {
        for side in [8, 32, 48] {
            let basis = basis(side, 0);
            let finer = band_steps(&LightLayout::of(&basis), &LightingPrior::of_basis(&basis));
            assert!(finer.is_sorted_by(|a, b| a >= b) && finer[0] >= 5 && finer[9] == 0, "{finer:?}");
        }
    }

    const FINER: [i8; 13] = [8, 3, 1, 0, 0, 0, 0, 0, 0, 0, 0, 5, -2];

    /// How much the sum over the 64 texels of `even`'s right side is off, and each of its three lamps.
    fn errors(even: &FactoredBlock, right: &[f32]) -> [f32; 4] {
        let off: Vec<f32> = right.iter().zip(&even.right).map(|(a, b)| a - b).collect();
        [off[..64].iter().sum::<f32>().abs(), off[64].abs(), off[65].abs(), off[66].abs()]
    }

    #[test]
    fn bands_have_steps_of_their_own_in_every_layer() {
        let step = 0.3f32;
        let rect = MatrixShape::new(8, 4, 67, 8).unwrap().rect(BlockId(0));
        let layout = BlockLayout::new(rect, LightLayout::of(&basis(8, 3)));
        let even = FactoredBlock {
            rows: 96,
            columns: 67,
            left: (0..96).map(|i| (0.1 * i as f32).sin()).collect(),
            right: (0..67).map(|j| (0.2 + 0.07 * j as f32).sin()).collect(),
            left_step: vec![0.01],
            right_step: vec![step],
            ..Default::default()
        };
        let finer = FactoredBlock { right_band_steps: FINER.into(), ..even.clone() };
        let coded = |block: &FactoredBlock, shared, base| {
            let part = LayerPart { shared, ..Default::default() };
            let bytes = encode_layer(&layout, block, part, &CodecSettings { lambda: 0.0, layered: true }).unwrap();
            (bytes[0], decode_layer(&layout, &bytes, base).unwrap())
        };
        // Steps are rounded to an eighth of an octave; the sum is off by eight times its coefficient.
        let limit = |finer: i8| 0.5 * 1.05 * step / (f32::from(finer) / 2.0).exp2();
        let limits = [8.0 * limit(8), limit(0), limit(5), limit(-2)];
        let is_within = |errors: [f32; 4]| errors.iter().zip(limits).all(|(error, limit)| *error <= limit);
        let ((plain_coding, plain), (coding, read)) = (coded(&even, 0, None), coded(&finer, 0, None));
        assert_eq!((plain_coding, coding), (3, 4));
        assert!(!is_within(errors(&even, &plain.right)), "nothing to see: {:?}", errors(&even, &plain.right));
        assert!(is_within(errors(&even, &read.right)), "{:?} over {limits:?}", errors(&even, &read.right));
        // A refinement of a coarser layer has the bands of that.
        let (_, coarse) = coded(&FactoredBlock { right_step: vec![8.0 * step], ..finer.clone() }, 0, None);
        let missing = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<_>>();
        let (left, right) = (missing(&finer.left, &coarse.left), missing(&finer.right, &coarse.right));
        let (_, layer) = coded(&FactoredBlock { left, right, ..finer }, 1, Some(&coarse));
        assert_eq!(layer.right_band_steps[..], FINER);
        // Its first component has the whole right side.
        let whole = errors(&even, layer.right_component(0));
        assert!(is_within(whole), "{whole:?} over {limits:?}");
    }
}
