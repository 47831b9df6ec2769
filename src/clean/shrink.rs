//! How far a filter may be trusted: pixel by pixel and image by image.

use super::constants::{LEAST_SHARE, WHOLE_SHARE};
use super::rows::Rows;

/// Mixes `smooth` into `raw`, pixel by pixel and for each cluster, as far as the estimated risk falls (Stein 1981): of
/// `r + α (s − r)` the best is `α = E[n (n − F n)] / E[(r − s)²]`, with the noise `n` of `r` from its halves. Both hold two
/// halves, one after the other; expectations are means over squares of pixels.
pub(super) fn mix_in(raw: &Rows, smooth: &mut Rows, reach: usize) {
    let (width, height, planes) = (raw.width(), raw.height(), raw.planes() / 2);
    let groups = planes / 3;
    // What is gained, then what is changed.
    let mut terms = Rows::zeros(width, height, 2 * groups);
    terms.fill_rows(|y, out| {
        let (gained, changed) = out.split_at_mut(groups * width);
        for plane in 0..planes {
            let at = plane / 3 * width;
            let rows =
                [raw.row(plane, y), raw.row(planes + plane, y), smooth.row(plane, y), smooth.row(planes + plane, y)];
            for x in 0..width {
                let [ra, rb, sa, sb] = rows.map(|row| row[x]);
                let (noise, left) = (0.5 * (ra - rb), 0.5 * (sa - sb));
                let change = 0.5 * (ra + rb - sa - sb);
                gained[at + x] += noise * (noise - left);
                changed[at + x] += change * change;
            }
        }
    });
    let terms = terms.box_mean(reach);
    smooth.fill_rows(|y, out| {
        for (plane, out) in out.chunks_exact_mut(width).enumerate() {
            let group = plane % planes / 3;
            let (gained, changed) = (terms.row(group, y), terms.row(groups + group, y));
            for (x, (out, raw)) in out.iter_mut().zip(raw.row(plane, y)).enumerate() {
                let share = if changed[x] > 0.0 { trusted(gained[x] / changed[x]) } else { 1.0 };
                *out = raw + share * (*out - raw);
            }
        }
    });
}

/// The share that is taken where an estimate says `best`. The mean alone is no worse than what was there from a half on, and
/// what is left of grain is seen more than what is lost: so that is taken whole, and below it falls off.
fn trusted(best: f32) -> f32 {
    ((best - LEAST_SHARE) / (WHOLE_SHARE - LEAST_SHARE)).clamp(0.0, 1.0)
}
