//! How far a filter may be trusted: pixel by pixel and image by image.

use super::constants::{LEAST_SHARE, WHOLE_SHARE};
use super::rows::{Region, Rows};

/// Mixes `smooth` into `raw`, in a region, pixel by pixel and for each cluster, as far as the estimated risk falls (Stein 1981): of
/// `r + α (s − r)` the best is `α = E[n (n − F n)] / E[(r − s)²]`, with the noise `n` of `r` from its halves. Both hold two
/// halves, one after the other; expectations are means over squares of pixels.
pub(super) fn mix_in(raw: &Rows, smooth: &mut Rows, reach: usize, region: &Region) {
    let planes = raw.planes() / 2;
    let groups = planes / 3;
    let around = region.grown(reach, raw);
    // What is gained, then what is changed.
    let mut terms = Rows::zeros(raw.width(), raw.height(), 2 * groups);
    terms.fill_rows(&around, |y, plane, out| {
        let of_group = plane % groups * 3;
        for channel in of_group..of_group + 3 {
            let [raw_a, raw_b] = [channel, planes + channel].map(|plane| &raw.row(plane, y)[around.x.clone()]);
            let [a, b] = [channel, planes + channel].map(|plane| &smooth.row(plane, y)[around.x.clone()]);
            for (x, out) in out.iter_mut().enumerate() {
                let (noise, left) = (0.5 * (raw_a[x] - raw_b[x]), 0.5 * (a[x] - b[x]));
                let change = 0.5 * (raw_a[x] + raw_b[x] - a[x] - b[x]);
                *out += if plane < groups { noise * (noise - left) } else { change * change };
            }
        }
    });
    let terms = terms.box_mean(reach, region);
    smooth.fill_rows(region, |y, plane, out| {
        let group = plane % planes / 3;
        let [gained, changed, raw] =
            [terms.row(group, y), terms.row(groups + group, y), raw.row(plane, y)].map(|row| &row[region.x.clone()]);
        for (x, out) in out.iter_mut().enumerate() {
            let share = if changed[x] > 0.0 { trusted(gained[x] / changed[x]) } else { 1.0 };
            *out = raw[x] + share * (*out - raw[x]);
        }
    });
}

/// The share that is taken where an estimate says `best`. The mean alone is no worse than what was there from a half on, and
/// what is left of grain is seen more than what is lost: so that is taken whole, and below it falls off.
fn trusted(best: f32) -> f32 {
    ((best - LEAST_SHARE) / (WHOLE_SHARE - LEAST_SHARE)).clamp(0.0, 1.0)
}
