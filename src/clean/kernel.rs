//! Weighted means of neighbours: a row of weights for each offset, then the same weights for every plane.

use std::ops::Range;

use super::constants::BESIDE;
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

/// For each pixel the mean of its neighbours in each plane of `images`. `weigh` fills the weights of the pixels of row `y` for
/// one offset, given the columns whose neighbours there are in the image; the others count nothing. A pixel weighs for itself
/// as much as the one most alike, so that one that is like no other, on the edge of two surfaces say, does not keep its
/// grain: it becomes what is beside it. A pixel without any weight keeps its value.
pub(super) fn weighted_means(
    images: &Rows,
    offsets: &[(isize, isize)],
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
