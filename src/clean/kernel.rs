//! Weighted means of neighbours, and values of planes laid through them: a row of weights for each offset, then the same
//! weights for every image.

use std::ops::Range;

use super::constants::{BESIDE, MOST_LEVERAGE};
use super::rows::Rows;

/// Offsets (across, down) that a filter reads.
pub(super) fn square(radius: isize, stride: usize) -> Vec<(isize, isize)> {
    let steps = || (-radius..=radius).step_by(stride);
    steps().flat_map(|y| steps().map(move |x| (x, y))).collect()
}

/// Columns of a row whose neighbour at `across` lies in the image.
pub(super) fn span(width: usize, across: isize) -> Range<usize> {
    let begin = (-across).max(0) as usize;
    begin..((width as isize - across.max(0)).max(begin as isize)) as usize
}

/// For each pixel the mean of its neighbours in each plane of `images`, corrected for their slope as far as `slope` allows
/// ([`correct_slope`]). `weigh` fills the weights of the pixels of row `y` for one offset, given the columns whose neighbours
/// there are in the image; the others count nothing. A pixel weighs for itself as much as the one most alike, so that one that
/// is like no other, on the edge of two surfaces say, does not keep its grain: it becomes what is beside it. A pixel without
/// any weight keeps its value.
pub(super) fn weighted_means(
    images: &Rows,
    offsets: &[(isize, isize)],
    slope: f32,
    weigh: impl Fn(usize, (isize, isize), Range<usize>, &mut [f32]) + Sync,
) -> Rows {
    let (width, height) = (images.width(), images.height());
    let mut means = Rows::zeros(width, height, images.planes());
    means.fill_rows(|y, out| {
        let mut weights = vec![0.0f32; offsets.len() * width];
        let (mut sums, mut most) = (vec![0.0f32; width], vec![0.0f32; width]);
        let others = || offsets.iter().enumerate().filter(|(_, offset)| **offset != (0, 0));
        for (at, &(across, down)) in others() {
            if y.checked_add_signed(down).is_some_and(|row| row < height) {
                let (weights, span) = (&mut weights[at * width..][..width], span(width, across));
                weigh(y, (across, down), span.clone(), &mut weights[span.clone()]);
                if across.abs() <= 1 && down.abs() <= 1 {
                    weights[span].iter_mut().for_each(|w| *w += BESIDE);
                }
                sums.iter_mut().zip(&*weights).for_each(|(sum, w)| *sum += w);
                most.iter_mut().zip(&*weights).for_each(|(most, w)| *most = most.max(*w));
            }
        }
        if let Some(own) = offsets.iter().position(|offset| *offset == (0, 0)) {
            weights[own * width..][..width].copy_from_slice(&most);
            sums.iter_mut().zip(&most).for_each(|(sum, w)| *sum += w);
        }
        sums.iter_mut().for_each(|sum| *sum = if *sum > 0.0 { 1.0 / *sum } else { 0.0 });
        for weights in weights.chunks_exact_mut(width) {
            weights.iter_mut().zip(&sums).for_each(|(w, scale)| *w *= scale);
        }
        correct_slope(&mut weights, offsets, width, slope);
        pulp::Arch::new().dispatch(
            #[inline(always)]
            || {
                for (plane, out) in out.chunks_exact_mut(width).enumerate() {
                    for (&(across, down), weights) in offsets.iter().zip(weights.chunks_exact(width)) {
                        let Some(row) = y.checked_add_signed(down).filter(|&row| row < height) else { continue };
                        let span = span(width, across);
                        let from = (span.start as isize + across) as usize;
                        let from = &images.row(plane, row)[from..from + span.len()];
                        let pairs = weights[span.clone()].iter().zip(from);
                        out[span].iter_mut().zip(pairs).for_each(|(out, (w, v))| *out += w * v);
                    }
                    let kept = images.row(plane, y).iter().zip(&sums);
                    out.iter_mut().zip(kept).for_each(|(out, (v, &scale))| *out = if scale > 0.0 { *out } else { *v });
                }
            },
        );
    });
    means
}

/// Turns weights of one row of pixels, which add up to 1 for each pixel, from those of a mean into those of the value at the
/// pixel of a plane laid through its neighbours by weighted least squares: local linear regression (Fan and Gijbels 1996,
/// section 2.2; Bitterli et al. 2016 for images of samples). A mean is wrong where neighbours lie to one side and light has a
/// slope, on the rim of a surface above all; the plane is not, but it has more noise: by the factor `1 + t`, where
/// `t = mᵀ C⁻¹ m` is the leverage of the mean offset `m` with the covariance `C` of the offsets. So the correction is scaled down
/// to a leverage of at most `slope` times the number of samples that a mean with these weights is worth, and never above
/// [`MOST_LEVERAGE`].
fn correct_slope(weights: &mut [f32], offsets: &[(isize, isize)], width: usize, slope: f32) {
    // Sums of: the offset, its products, the weights' squares.
    let mut moments = vec![[0.0f32; 6]; width];
    for (&(across, down), weights) in offsets.iter().zip(weights.chunks_exact(width)) {
        let (x, y) = (across as f32, down as f32);
        for (moments, w) in moments.iter_mut().zip(weights) {
            let terms = [x, y, x * x, x * y, y * y, *w];
            moments.iter_mut().zip(terms).for_each(|(sum, term)| *sum += w * term);
        }
    }
    // Each weight is multiplied by `1 − (C⁻¹ m)ᵀ (offset − m)`, or by less of it.
    let tilts: Vec<[f32; 3]> = moments.iter().map(|moments| tilt(*moments, slope)).collect();
    for (&(across, down), weights) in offsets.iter().zip(weights.chunks_exact_mut(width)) {
        let (x, y) = (across as f32, down as f32);
        for (w, [tilt_x, tilt_y, constant]) in weights.iter_mut().zip(&tilts) {
            *w *= constant - x * tilt_x - y * tilt_y;
        }
    }
}

/// What the offset across and the offset down are multiplied by, and what their sum is taken from.
fn tilt([x, y, xx, xy, yy, squares]: [f32; 6], slope: f32) -> [f32; 3] {
    if squares <= 0.0 {
        return [0.0, 0.0, 1.0];
    }
    // Where all neighbours lie on a line the covariance has no inverse.
    let ridge = 1e-2 + 1e-3 * (xx + yy);
    let (a, b, c) = (xx - x * x + ridge, xy - x * y, yy - y * y + ridge);
    let determinant = a * c - b * b;
    let (tilt_x, tilt_y) = ((c * x - b * y) / determinant, (a * y - b * x) / determinant);
    let leverage = tilt_x * x + tilt_y * y;
    let most = (slope / squares).min(MOST_LEVERAGE);
    let scale = if leverage > most { (most / leverage).sqrt() } else { 1.0 };
    [scale * tilt_x, scale * tilt_y, 1.0 + scale * leverage]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Light that rises from the rim of a surface: a mean brightens the rim, a plane does not.
    #[test]
    fn a_slope_at_the_rim_is_no_bias() {
        let (width, height) = (20, 3);
        let mut ramp = Rows::zeros(width, height, 1);
        (0..height).for_each(|y| (0..width).for_each(|x| ramp.row_mut(0, y)[x] = x as f32));
        let rim = |slope: f32| weighted_means(&ramp, &square(5, 1), slope, |_, _, _, out| out.fill(1.0)).row(0, 1)[0];
        assert!((rim(0.0) - 2.5).abs() < 0.1, "{}", rim(0.0));
        assert!(rim(1.0).abs() < 0.05, "{}", rim(1.0));
        // What the mean of few samples is worth pays for a part of it only.
        assert!((0.5..2.0).contains(&rim(0.02)), "{}", rim(0.02));
    }

    #[test]
    fn weights_of_a_plane_add_up_to_one() {
        let mut flat = Rows::zeros(20, 9, 1);
        flat.values_mut().fill(3.0);
        let uneven = |y: usize, (across, down): (isize, isize), span: Range<usize>, out: &mut [f32]| {
            let weight =
                |x: usize| 1.0 / (1.0 + ((y * 7 + x * 3) as isize + across * 5 + down).unsigned_abs() as f32 % 4.0);
            span.zip(out).for_each(|(x, out)| *out = weight(x));
        };
        let means = weighted_means(&flat, &square(4, 1), 1.0, uneven);
        assert!(means.values().iter().all(|v| (v - 3.0).abs() < 1e-3), "{means:?}");
    }
}
