//! Mixes filtered with raw values by an estimate of the risk, for each pixel and image.

use std::ops::Range;

use super::constants::{CHANGE, MIN_KEPT_SHARE, MIN_KEPT_SHARE_OF_IMPORTED, OUTLIER, RISK_CELLS, WHOLE_SHARE};
use super::detail::{DETAIL_REACH, with_detail};
use super::image_rows::{ImageRows, Pool, Region, shifts};
use super::ramp;
use crate::simd::dispatch;

/// Radius of a cell, and its diameter in pixels.
const CELL_REACH: usize = 1;
const CELL: usize = 2 * CELL_REACH + 1;
/// Radius, in pixels, over which mixing weights are averaged.
const SHARE_REACH: usize = 1;

/// Radius, in pixels, that [`mixed`] reads.
pub(super) const RISK_REACH: usize = CELL * RISK_CELLS + CELL_REACH + SHARE_REACH;
const _: () = assert!(DETAIL_REACH <= RISK_REACH);

/// Mixes `smooth` into `raw`, in a region, for each pixel and cluster, to minimise the estimated risk (Stein 1981). Of
/// `r + α (s − r)` the best is `α = E[n (n − F n)] / E[(r − s)²]`, with the noise `n` of `r` from its halves. Both
/// images hold two halves, one after the other.
///
/// Expectations are means over cells of 3 × 3 pixels. A cell counts less the brighter it is than the pixel: otherwise
/// the error of a caustic would decide for the shadow around it. An outlier is left out of its cell ([`OUTLIER`]). A
/// firefly that both halves have looks like a detail, but a detail has more than one pixel. A pixel's weight is at least
/// the mean weight of its neighbours, as far as its own cell alone allows.
pub(super) fn mixed(
    raw: &ImageRows,
    smooth: &ImageRows,
    origin: ImageOrigin,
    region: &Region,
    pool: &Pool,
) -> ImageRows {
    let (width, planes) = (raw.width(), raw.planes() / 2);
    let mut mixed = pool.rows_like(raw, raw.planes(), region.y.clone());
    for first in (0..planes).step_by(3) {
        let cells = Cells { origin, terms: Cells::terms(raw, smooth, first, region, pool) };
        let shares = cells.shares(&region.grown(SHARE_REACH, raw), pool);
        let even = shares.box_mean(SHARE_REACH, region, pool);
        let smooth = with_detail(raw, smooth, first, region, pool);
        mixed.fill_whole_rows(&region.y, |y, row| {
            let cell = cells.own_shares(y);
            let [own, even, cell] = [shares.row(0, y), even.row(0, y), &cell].map(|row| &row[region.x.clone()]);
            let shares = own.iter().zip(even).zip(cell).map(|((own, even), cell)| own.max(even.min(*cell)));
            let shares: Vec<f32> = shares.collect();
            for (at, plane) in (first..first + 3).chain(planes + first..planes + first + 3).enumerate() {
                let out = &mut row[plane * width..][region.x.clone()];
                let [raw, smooth] = [raw.row(plane, y), smooth.row(at, y)].map(|row| &row[region.x.clone()]);
                let pairs = raw.iter().zip(smooth).zip(&shares);
                out.iter_mut().zip(pairs).for_each(|(out, ((raw, smooth), share))| *out = raw + share * (smooth - raw));
            }
        });
        [cells.terms, shares, even, smooth].into_iter().for_each(|done| pool.keep(done));
    }
    mixed
}

/// Terms of the risk of the cell around each pixel, in the image of one cluster: gain, change, and squared light.
struct Cells {
    terms: ImageRows,
    origin: ImageOrigin,
}

impl Cells {
    /// The terms of the cluster whose first plane is `first`.
    fn terms(raw: &ImageRows, smooth: &ImageRows, first: usize, region: &Region, pool: &Pool) -> ImageRows {
        let around = region.grown(RISK_REACH, raw);
        let mut terms = pool.rows_like(raw, 3, around.y.clone());
        terms.fill_whole_rows(&around.y, |y, row| {
            row.fill(0.0);
            let (gained, rest) = row.split_at_mut(raw.width());
            let (changed, squared) = rest.split_at_mut(raw.width());
            let [gained, changed, squared] = [gained, changed, squared].map(|row| &mut row[around.x.clone()]);
            for channel in first..first + 3 {
                let ([raw_a, raw_b], [a, b]) =
                    (halves(raw, channel, &around.x, y), halves(smooth, channel, &around.x, y));
                dispatch(
                    #[inline(always)]
                    || {
                        let sums = gained.iter_mut().zip(&mut *changed).zip(&mut *squared);
                        let values = raw_a.iter().zip(raw_b).zip(a).zip(b);
                        for (((gained, changed), squared), (((raw_a, raw_b), a), b)) in sums.zip(values) {
                            let (noise, left) = (0.5 * (raw_a - raw_b), 0.5 * (a - b));
                            let light = 0.5 * (a + b);
                            let change = 0.5 * (raw_a + raw_b) - light;
                            *gained += noise * (noise - left);
                            *changed += change * change;
                            *squared += light * light;
                        }
                    },
                );
            }
        });
        let cells = of_cells(&terms, &region.grown(CELL * RISK_CELLS + SHARE_REACH, raw), pool);
        pool.keep(terms);
        cells
    }

    /// The mixing weight α of each pixel of a region.
    fn shares(&self, region: &Region, pool: &Pool) -> ImageRows {
        let mut shares = pool.rows_like(&self.terms, 1, region.y.clone());
        shares.fill_rows(region, |y, _, out| out.copy_from_slice(&self.shares_of_row(y, region)));
        shares
    }

    /// The mixing weight of each cell of a row by itself.
    fn own_shares(&self, y: usize) -> Vec<f32> {
        let [gained, changed, light] = [0, 1, 2].map(|term| self.terms.row(term, y));
        let cells = gained.iter().zip(changed).zip(light);
        cells
            .map(|((&gain, &change), &light)| share(gain, change, self.origin.shares_believed(change, light)))
            .collect()
    }

    /// [`shares`](Self::shares) of a row.
    fn shares_of_row(&self, y: usize, region: &Region) -> Vec<f32> {
        let Self { terms, origin } = self;
        let own = &terms.row(2, y)[region.x.clone()];
        let [mut gains, mut changes] = [0, 1].map(|_| vec![0.0; own.len()]);
        let rows = (0..=2 * RISK_CELLS).filter_map(|cell| (y + CELL * cell).checked_sub(CELL * RISK_CELLS));
        for y in rows.filter(|&y| y < terms.height()) {
            let [gained, changed, light] = [0, 1, 2].map(|term| terms.row(term, y));
            for (from, to) in shifts(&region.x, CELL * RISK_CELLS, CELL, terms.width()) {
                dispatch(
                    #[inline(always)]
                    || {
                        let sums = gains[to.clone()].iter_mut().zip(&mut changes[to.clone()]).zip(&own[to.clone()]);
                        let cells = gained[from.clone()].iter().zip(&changed[from.clone()]).zip(&light[from.clone()]);
                        for (((gain, change), own), ((gained, changed), light)) in sums.zip(cells) {
                            let weight = (own / (own + light + f32::MIN_POSITIVE)).powi(2);
                            *gain += weight * gained;
                            *change += weight * changed;
                        }
                    },
                );
            }
        }
        let changed = &terms.row(1, y)[region.x.clone()];
        let believed = changed.iter().zip(own).map(|(&change, &light)| origin.shares_believed(change, light));
        let sums = gains.iter().zip(&changes).zip(believed);
        sums.map(|((&gain, &change), believed)| share(gain, change, believed)).collect()
    }
}

/// Means of the terms over the cell around each pixel of a region. Gain and change leave out outliers.
fn of_cells(terms: &ImageRows, region: &Region, pool: &Pool) -> ImageRows {
    let (width, height) = (terms.width(), terms.height());
    let mut cells = pool.rows_like(terms, terms.planes(), region.y.clone());
    cells.fill_whole_rows(&region.y, |y, row| {
        row.fill(0.0);
        let (gained, rest) = row.split_at_mut(width);
        let (changed, squared) = rest.split_at_mut(width);
        let [gained, changed, squared] = [gained, changed, squared].map(|row| &mut row[region.x.clone()]);
        // Gain and change of the pixel whose change exceeds its gain by most: it is kept out of the sums.
        let [mut most_gain, mut most_change, mut count] = [0, 1, 2].map(|_| vec![0.0f32; region.x.len()]);
        for y in y.saturating_sub(CELL_REACH)..(y + CELL_REACH + 1).min(height) {
            let from = [0, 1, 2].map(|term| terms.row(term, y));
            for (there, here) in shifts(&region.x, CELL_REACH, 1, width) {
                let [gain, change, light] = from.map(|row| &row[there.clone()]);
                dispatch(
                    #[inline(always)]
                    || {
                        let most = most_gain[here.clone()].iter_mut().zip(&mut most_change[here.clone()]);
                        let sums = gained[here.clone()].iter_mut().zip(&mut changed[here.clone()]);
                        let means = squared[here.clone()].iter_mut().zip(&mut count[here.clone()]);
                        let values = gain.iter().zip(change).zip(light);
                        for ((most, sums), (means, ((&gain, &change), light))) in most.zip(sums).zip(means.zip(values))
                        {
                            let is_most = change - gain > *most.1 - *most.0;
                            *sums.0 += if is_most { *most.0 } else { gain };
                            *sums.1 += if is_most { *most.1 } else { change };
                            *most.0 = if is_most { gain } else { *most.0 };
                            *most.1 = if is_most { change } else { *most.1 };
                            *means.0 += light;
                            *means.1 += 1.0;
                        }
                    },
                );
            }
        }
        for (x, mut count) in count.into_iter().enumerate() {
            let (gain, change) = (most_gain[x], most_change[x]);
            squared[x] /= count;
            if change - gain > OUTLIER * changed[x] {
                count -= 1.0;
            } else {
                gained[x] += gain;
                changed[x] += change;
            }
            gained[x] /= count.max(1.0);
            changed[x] /= count.max(1.0);
        }
    });
    cells
}

/// The halves of a channel: some pixels of a row.
fn halves<'a>(rows: &'a ImageRows, channel: usize, x: &Range<usize>, y: usize) -> [&'a [f32]; 2] {
    [channel, rows.planes() / 2 + channel].map(|plane| &rows.row(plane, y)[x.clone()])
}

/// Where images come from, and so how well their noise is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageOrigin {
    /// Traced here: noise and features are known of each pixel's samples.
    Traced,
    /// Taken from another program.
    Imported,
}

impl ImageOrigin {
    /// The estimated best weights below which the filtered value is not taken, and from which on it is taken alone, for a cell of a
    /// mean squared change and a mean squared light. From 0.5 on it is no worse than the input. Where filtering changes
    /// much of the light, noise is more visible than lost detail; where it changes little, the best weight is as good as it
    /// says, if noise is known well.
    fn shares_believed(self, changed: f32, light: f32) -> (f32, f32) {
        if self == Self::Imported {
            return (MIN_KEPT_SHARE_OF_IMPORTED, WHOLE_SHARE);
        }
        let (least, most) = CHANGE;
        let relative = (changed / light.max(f32::MIN_POSITIVE)).sqrt();
        let whole = WHOLE_SHARE + (1.0 - WHOLE_SHARE) * ramp((most, least), relative);
        (MIN_KEPT_SHARE, whole)
    }
}

/// The mixing weight: the estimated best one, as far as it is believed.
fn share(gained: f32, changed: f32, believed: (f32, f32)) -> f32 {
    if changed > 0.0 { ramp(believed, gained / changed) } else { 1.0 }
}
