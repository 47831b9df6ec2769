//! The hours of the pixels of a block: `T S`, where `S` has a column for each hour.
//!
//! Of factors `L R` this is `L (R S)`: `R S` is made once for a block, and costs what the rank does and not the number of columns. Sums
//! over channels come first, since the sky has one spectrum in all hours.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use super::year_light::YearLight;
use crate::daylight::{HourSums, LUMENS_PER_WATT, LUMINANCE_WEIGHTS, Thresholds};
use crate::matrix::{BlockView, CHANNELS, ColumnIndex, FactoredBlock};

/// Hours that are summed together: a row of them stays in the first cache.
const CHUNK: usize = 512;

/// A block ready for the product: lux of a pixel at an hour is `left · right`, and what stands apart.
pub(super) struct BlockHours {
    pixels: usize,
    /// Inner width.
    rank: usize,
    /// Pixels × rank.
    left: Vec<f32>,
    /// Rank × hours; none of entries, whose right side is the sky itself.
    right: Option<Vec<f32>>,
    /// Rank: the right side under the overcast sky of the daylight factor.
    overcast: Vec<f32>,
    /// Single entries: pixel, column, value; by pixel.
    entries: Vec<(u32, u32, f32)>,
}

/// What a pixel brings: its sums, and its hours where they are kept.
pub(super) struct PixelHours<'a> {
    pub(super) sums: &'a mut [HourSums],
    /// Pixels × hours, in the order of the year's.
    pub(super) hours: Option<&'a mut [f32]>,
}

/// Which state of the blinds a matrix has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BlindsState {
    /// Its hours are those with blinds open. It tells direct sun in all hours, and the daylight factor.
    Open,
    /// Its hours are those with blinds closed.
    Closed,
}

/// The weight of a channel in lux for a unit of radiance or irradiance.
pub(super) fn lux_of(channel: usize) -> f32 {
    LUMINANCE_WEIGHTS[channel] * LUMENS_PER_WATT as f32
}

impl BlockHours {
    /// Of factors.
    pub(super) fn of_factors(block: &FactoredBlock, year: &YearLight) -> Self {
        let (pixels, rank, hours) = (block.rows / CHANNELS, block.rank(), year.hours());
        let mut left = vec![0.0; pixels * rank];
        for k in 0..rank {
            for (channel, plane) in block.left_component(k).chunks_exact(pixels.max(1)).enumerate() {
                let weight = lux_of(channel);
                plane.iter().enumerate().for_each(|(pixel, value)| left[pixel * rank + k] += weight * value);
            }
        }
        let (columns, texels) = year.sky_columns();
        let mut of_texels = vec![0.0; rank * texels];
        let mut right = vec![0.0; rank * hours];
        for (k, sums) in of_texels.chunks_exact_mut(texels).enumerate() {
            for row in block.right_component(k)[columns.clone()].chunks_exact(texels) {
                sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
            }
        }
        multiply(&mut right, &of_texels, &year.sky, [rank, texels, hours]);
        let overcast = of_texels.chunks_exact(texels).map(|texels| dot(texels, &year.overcast)).collect();
        for k in 0..rank {
            add_sun(year, block.right_component(k), &mut right[k * hours..][..hours]);
        }
        let mut entries: Vec<_> = (block.sparse.iter())
            .map(|entry| (entry.row % pixels as u32, entry.column.0, lux_of(entry.row as usize / pixels) * entry.value))
            .collect();
        entries.sort_by_key(|(pixel, ..)| *pixel);
        Self { pixels, rank, left, right: Some(right), overcast, entries }
    }

    /// Of the entries themselves: the columns of the sky are the inner width, and those of places of the sun stand apart.
    pub(super) fn of_entries(block: BlockView<'_>, pixels: usize, year: &YearLight) -> Self {
        let (columns, texels) = year.sky_columns();
        let mut left = vec![0.0; pixels * texels];
        let mut entries = Vec::new();
        let lux = |column: usize| -> Vec<f32> {
            let mut lux = vec![0.0; pixels];
            for (channel, plane) in block.column(ColumnIndex(column as u32)).chunks_exact(pixels).enumerate() {
                lux.iter_mut().zip(plane).for_each(|(sum, value)| *sum += lux_of(channel) * value);
            }
            lux
        };
        for column in columns.clone() {
            let texel = (column - columns.start) % texels;
            let has_sun = !year.sun_of(column as u32).is_empty();
            for (pixel, value) in lux(column).into_iter().enumerate().filter(|(_, value)| *value != 0.0) {
                left[pixel * texels + texel] += value;
                if has_sun {
                    entries.push((pixel as u32, column as u32, value));
                }
            }
        }
        let mut suns: Vec<u32> =
            year.sun.iter().map(|sun| sun.column).filter(|c| !columns.contains(&(*c as usize))).collect();
        suns.dedup();
        for column in suns {
            let lit = lux(column as usize).into_iter().enumerate().filter(|(_, value)| *value != 0.0);
            entries.extend(lit.map(|(pixel, value)| (pixel as u32, column, value)));
        }
        entries.sort_by_key(|(pixel, ..)| *pixel);
        Self { pixels, rank: texels, left, right: None, overcast: year.overcast.clone(), entries }
    }

    /// The daylight factor of each pixel in percent.
    fn daylight_factors(&self, year: &YearLight) -> Vec<f32> {
        let mut percent: Vec<f32> =
            self.left.chunks_exact(self.rank.max(1)).map(|left| dot(left, &self.overcast)).collect();
        percent.resize(self.pixels, 0.0);
        // Of a matrix without factors the sky is in the left side already.
        if self.right.is_some() {
            let (columns, texels) = year.sky_columns();
            for &(pixel, column, value) in &self.entries {
                if columns.contains(&(column as usize)) {
                    percent[pixel as usize] += value * year.overcast[(column as usize - columns.start) % texels];
                }
            }
        }
        percent
    }

    /// Upper bound of the bytes of a block of `pixels` of factors of a rank, over so many columns and hours.
    pub(super) fn bytes_of_factors(pixels: usize, rank: usize, columns: usize, hours: usize) -> u64 {
        // The factors as they are read, and what is made of them.
        4 * (rank * (CHANNELS * pixels + columns) + rank * (pixels + hours + columns)) as u64
    }

    /// Upper bound of the bytes of a block of `pixels` of the entries of so many columns.
    pub(super) fn bytes_of_entries(pixels: usize, columns: usize) -> u64 {
        ((size_of::<f32>() + size_of::<(u32, u32, f32)>()) * pixels * columns) as u64
    }

    /// Adds the hours of all pixels in which blinds are as they are here, and of open ones the daylight factors.
    pub(super) fn add_to(
        &self,
        year: &YearLight,
        thresholds: &Thresholds,
        state: BlindsState,
        target: &mut PixelHours<'_>,
    ) {
        let is_open = state == BlindsState::Open;
        if is_open {
            for (sums, percent) in target.sums.iter_mut().zip(self.daylight_factors(year)) {
                sums.set_daylight_factor(percent.max(0.0));
            }
        }
        for segment in &year.segments {
            let asked = Asked {
                lux: segment.is_closed != is_open,
                sun: is_open && year.knows_sun && segment.is_used,
                is_used: segment.is_used,
                is_day: segment.is_day,
            };
            if !asked.lux && !asked.sun {
                continue;
            }
            for begin in segment.hours.clone().step_by(CHUNK) {
                let range = begin..(begin + CHUNK).min(segment.hours.end);
                pulp::Arch::new().dispatch(Chunk { block: self, year, thresholds, range, asked, target });
            }
        }
    }

    /// Adds to each hour the number of pixels with direct sun above so many lux, and returns that of pixels that any light reaches.
    pub(super) fn count_sun(&self, year: &YearLight, above: f32, counts: &mut [u32]) -> u32 {
        let mut is_lit: Vec<bool> =
            self.left.chunks_exact(self.rank.max(1)).map(|left| left.iter().any(|value| *value != 0.0)).collect();
        is_lit.resize(self.pixels, false);
        let mut lux = vec![0.0; counts.len()];
        for entries in self.entries.chunk_by(|a, b| a.0 == b.0) {
            is_lit[entries[0].0 as usize] = true;
            lux.fill(0.0);
            for &(_, column, value) in entries {
                for sun in year.sun_of(column).iter().filter(|sun| sun.is_direct) {
                    lux[sun.hour as usize] += value * sun.weight;
                }
            }
            counts.iter_mut().zip(&lux).for_each(|(count, lux)| *count += u32::from(*lux > above));
        }
        is_lit.iter().map(|is_lit| u32::from(*is_lit)).sum()
    }
}

/// The scalar product.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// `product = a b`, row-major of rows × inner × columns.
fn multiply(product: &mut [f32], a: &[f32], b: &[f32], [rows, inner, columns]: [usize; 3]) {
    let product = MatMut::from_row_major_slice_mut(product, rows, columns);
    let (a, b) = (MatRef::from_row_major_slice(a, rows, inner), MatRef::from_row_major_slice(b, inner, columns));
    matmul(product, Accum::Replace, a, b, 1.0, Par::Seq);
}

/// Adds the sun over a component's values of all columns to its hours.
fn add_sun(year: &YearLight, values: &[f32], hours: &mut [f32]) {
    for sun in &year.sun {
        hours[sun.hour as usize] += values[sun.column as usize] * sun.weight;
    }
}

/// What is asked of some hours.
#[derive(Clone, Copy)]
struct Asked {
    lux: bool,
    /// Direct sun.
    sun: bool,
    is_used: bool,
    is_day: bool,
}

/// Some hours of all pixels of a block, compiled for the widest vectors of the processor.
struct Chunk<'a, 'b> {
    block: &'a BlockHours,
    year: &'a YearLight,
    thresholds: &'a Thresholds,
    range: Range<usize>,
    asked: Asked,
    target: &'a mut PixelHours<'b>,
}

impl pulp::NullaryFnOnce for Chunk<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { block, year, thresholds, range, asked, target } = self;
        let (hours, count) = (year.hours(), range.len());
        let right = block.right.as_ref().unwrap_or(&year.sky);
        let (mut all, mut of_sun) = ([0.0f32; CHUNK], [0.0f32; CHUNK]);
        let mut entries = &block.entries[..];
        for pixel in 0..block.pixels {
            let left = &block.left[pixel * block.rank..][..block.rank];
            let (lux, sun) = (&mut all[..count], &mut of_sun[..count]);
            lux.fill(0.0);
            if asked.lux {
                add_product(lux, left, right, hours, range.start);
            }
            sun.fill(0.0);
            let own = entries.iter().take_while(|(at, ..)| *at as usize == pixel).count();
            for &(_, column, value) in &entries[..own] {
                add_entry(year, (column, value, block.right.is_none()), &range, lux, sun);
            }
            entries = &entries[own..];
            if asked.sun {
                target.sums[pixel].add_sun(sun, thresholds);
            }
            if !asked.lux {
                continue;
            }
            // Noise and compression may leave less than nothing.
            lux.iter_mut().for_each(|value| *value = value.max(0.0));
            target.sums[pixel].add(lux, thresholds, (asked.is_used, asked.is_day));
            if let Some(kept) = &mut target.hours {
                kept[pixel * hours..][range.clone()].copy_from_slice(lux);
            }
        }
    }
}

/// Adds `left · right` of some hours.
#[inline(always)]
fn add_product(sums: &mut [f32], left: &[f32], right: &[f32], hours: usize, start: usize) {
    let count = sums.len();
    let mut k = 0;
    // Four rows at once, so that sums are read and written a fourth as often.
    while k + 4 <= left.len() {
        let rows: [&[f32]; 4] = std::array::from_fn(|i| &right[(k + i) * hours + start..][..count]);
        let w = [left[k], left[k + 1], left[k + 2], left[k + 3]];
        for i in 0..count {
            sums[i] += w[0] * rows[0][i] + w[1] * rows[1][i] + w[2] * rows[2][i] + w[3] * rows[3][i];
        }
        k += 4;
    }
    for (k, w) in left.iter().enumerate().skip(k) {
        let row = &right[k * hours + start..][..count];
        sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += w * value);
    }
}

/// Adds one entry of a matrix over some hours; of a matrix without factors the sky is counted already.
#[inline(always)]
fn add_entry(
    year: &YearLight,
    (column, value, has_sky): (u32, f32, bool),
    range: &Range<usize>,
    lux: &mut [f32],
    direct: &mut [f32],
) {
    if !has_sky && let Some(row) = year.sky_row(column) {
        lux.iter_mut().zip(&row[range.clone()]).for_each(|(sum, sky)| *sum += value * sky);
    }
    let suns = year.sun_of(column);
    let first = suns.partition_point(|sun| (sun.hour as usize) < range.start);
    for sun in suns[first..].iter().take_while(|sun| (sun.hour as usize) < range.end) {
        let (at, light) = (sun.hour as usize - range.start, value * sun.weight);
        lux[at] += light;
        if sun.is_direct {
            direct[at] += light;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::DaylightOptions;
    use super::*;
    use crate::daylight::Climate;
    use crate::light::{EnvironmentMapping, Light, LightBasis, SkyPatches};
    use crate::matrix::SparseEntry;

    const WEA: &str = "place Testville_XX\nlatitude 48.1\nlongitude -11.6\ntime_zone -15\nsite_elevation 515\n\
        weather_data_file_units 3\n6 21 11.5 0 12000\n";

    /// A block of which compression has kept a single entry, and no component: the sky lights it as it lights the same entry of a matrix.
    #[test]
    fn a_block_without_components_is_lit_by_the_sky() {
        let mut basis = LightBasis::new();
        let patches = EnvironmentMapping::Patches(SkyPatches::of_subdivision(1).unwrap());
        basis.push(Light::of_texels("sky", patches.into())).unwrap();
        let climate = Climate::parse("a", WEA).unwrap();
        let year = YearLight::new("a", &basis, &climate, &DaylightOptions::default()).unwrap();
        let (column, columns) = (10, basis.column_count());
        let sparse = vec![SparseEntry { column: ColumnIndex(column), row: 1, value: 0.5 }];
        let factored = FactoredBlock { rows: CHANNELS, columns, sparse, ..FactoredBlock::default() };
        let mut entries = vec![0.0; CHANNELS * columns];
        entries[CHANNELS * column as usize + 1] = 0.5;
        let stored = BlockHours::of_entries(BlockView::new(CHANNELS, columns, &entries), 1, &year);
        let measured = [BlockHours::of_factors(&factored, &year), stored].map(|hours| {
            let mut sums = [HourSums::default()];
            let mut target = PixelHours { sums: &mut sums, hours: None };
            hours.add_to(&year, &Thresholds::default(), BlindsState::Open, &mut target);
            sums[0].measures(1, 1, 1.0, false).values
        });
        let [mean, factor] = [6, 11].map(|measure| measured.map(|values| values[measure]));
        assert!(mean[0] > 0.0 && (mean[0] / mean[1] - 1.0).abs() < 1e-5, "{mean:?}");
        assert!(factor[0] > 0.0 && (factor[0] / factor[1] - 1.0).abs() < 1e-5, "{factor:?}");
    }
}
