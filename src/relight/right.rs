//! Right factors as they are held: whole numbers of steps, most of them zeros that take no room; and products with them.
//!
//! A *cell* has what a row has in one tile of the transform. Its first numbers are dense, a byte each, in groups of
//! sixteen; what is not zero behind them are entries of two bytes, place and number. A number too large for its place
//! leaves a multiple of 64 for a further row, 64 times as coarse. Cells stand tile by tile, so that a tile's part of the
//! lighting stays in the nearest cache while all rows pass by, and so that the change of one texel meets one tile.

#[cfg(feature = "gpu")]
use std::ops::Range;

use super::lighting::{GROUP, LightingCoefficients, LightingTile, total};
use crate::matrix::{CHANNELS, CodedRow, ColumnTile, ColumnTransform, TILE_COEFFICIENTS};

/// What an entry counts beside a dense number, which is a byte, where it is chosen how many are dense. It takes twice as much
/// room, and more time. Decision 100.
const ENTRY_COST: usize = 3;

/// How much coarser a further row is.
const COARSER: i32 = 64;

/// Lowest bits of an entry: its place in the tile. The number, from −32 to 31, stands above them.
pub(super) const PLACE_BITS: u32 = 10;
const PLACE_MASK: u16 = (1 << PLACE_BITS) - 1;

/// The right factor of a block. Being the whole numbers of the file, it loses nothing in sums over columns, as values in 8 bits do
/// (decision 38).
#[derive(Clone, Debug, Default)]
pub(crate) struct RightFactor {
    pub rows: Vec<RightRow>,
    /// Lengths of the cells, tile by tile, in each row by row.
    pub cells: Vec<Cell>,
    /// Word with which each tile begins.
    pub tile_words: Vec<u32>,
    /// The cells: dense numbers, then entries, filled up to whole words.
    pub words: Vec<u32>,
}

/// Numbers that add to a component's right side.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RightRow {
    pub component: u32,
    /// What 1 stands for, times the scale of the left side.
    pub scale: f32,
}

/// Lengths of a cell: groups of dense numbers, and entries.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Cell {
    pub groups: u16,
    pub entries: u16,
}

impl Cell {
    /// Words that it takes.
    #[inline(always)]
    pub(crate) fn words(self) -> usize {
        usize::from(self.groups) * (GROUP / 4) + usize::from(self.entries).div_ceil(2)
    }

    /// Its dense numbers and its entries.
    #[inline(always)]
    fn parts(self, words: &[u32]) -> (&[[i8; GROUP]], &[u16]) {
        let (dense, entries) = words.split_at(usize::from(self.groups) * (GROUP / 4));
        let entries: &[u16] = bytemuck::cast_slice(entries);
        (bytemuck::cast_slice::<u32, i8>(dense).as_chunks().0, &entries[..usize::from(self.entries)])
    }
}

/// Place and number of an entry.
#[inline(always)]
fn place_and_number(entry: u16) -> (usize, i16) {
    (usize::from(entry & PLACE_MASK), entry as i16 >> PLACE_BITS)
}

/// One row in the making: its cells, one behind the other.
#[derive(Default)]
struct RowCells {
    cells: Vec<Cell>,
    words: Vec<u32>,
}

impl RightFactor {
    /// Takes rows in, each times the scale of the left side of its component. Compiled for the vectors of the machine where
    /// it is inlined. None where a scale is not finite.
    #[inline(always)]
    pub(super) fn new(coded: Vec<CodedRow>, transform: &ColumnTransform, left_scales: &[f64]) -> Option<Self> {
        let tiles = transform.tiles();
        let (mut rows, mut made) = (Vec::new(), Vec::new());
        for CodedRow { component, step, mut values } in coded {
            let mut scale = f64::from(step) * left_scales[component as usize];
            if scale == 0.0 {
                continue;
            }
            if !scale.is_finite() {
                return None;
            }
            loop {
                let mut row = RowCells::default();
                let rest = tiles.iter().fold(0, |rest, &tile| rest | row.push(&mut values[tile.places()]));
                if !row.words.is_empty() {
                    let scale = scale as f32;
                    if !scale.is_finite() {
                        return None;
                    }
                    rows.push(RightRow { component, scale });
                    made.push(row);
                }
                if rest == 0 {
                    break;
                }
                scale *= f64::from(COARSER);
            }
        }
        Some(Self::assembled(rows, &made, tiles))
    }

    /// Puts the cells of rows tile by tile.
    fn assembled(rows: Vec<RightRow>, made: &[RowCells], tiles: &[ColumnTile]) -> Self {
        let mut factor = Self {
            cells: Vec::with_capacity(rows.len() * tiles.len()),
            tile_words: Vec::with_capacity(tiles.len()),
            words: Vec::with_capacity(made.iter().map(|row| row.words.len()).sum()),
            rows,
        };
        let mut begins = vec![0; made.len()];
        for tile in 0..tiles.len() {
            factor.tile_words.push(factor.words.len() as u32);
            for (row, begin) in made.iter().zip(&mut begins) {
                let cell = row.cells[tile];
                factor.cells.push(cell);
                factor.words.extend_from_slice(&row.words[*begin..][..cell.words()]);
                *begin += cell.words();
            }
        }
        factor
    }

    /// Cells of a tile, and the words from its first one on.
    #[inline(always)]
    fn tile(&self, tile: usize) -> (&[Cell], &[u32]) {
        let rows = self.rows.len();
        (&self.cells[tile * rows..][..rows], &self.words[self.tile_words[tile] as usize..])
    }

    /// Bytes that it takes in memory.
    pub(super) fn bytes(&self) -> usize {
        let tables = self.rows.len() * size_of::<RightRow>() + self.cells.len() * size_of::<Cell>();
        tables + (self.tile_words.len() + self.words.len()) * size_of::<u32>()
    }

    /// Adds `s (R ℓ)` to the sums of each component and channel.
    #[inline(always)]
    pub(super) fn project(&self, lighting: &LightingCoefficients, projected: &mut [[f32; CHANNELS]]) {
        if self.rows.is_empty() {
            return;
        }
        let mut sums = vec![RowSums::default(); self.rows.len()];
        for (t, tile) in lighting.tiles().iter().enumerate().filter(|(_, tile)| tile.used > 0) {
            let (cells, mut rest) = self.tile(t);
            for (&cell, sums) in cells.iter().zip(&mut sums) {
                let words;
                (words, rest) = rest.split_at(cell.words());
                sums.add(cell, words, tile);
            }
        }
        for (row, sums) in self.rows.iter().zip(&sums) {
            let totals = sums.totals();
            let of_component = &mut projected[row.component as usize];
            (0..CHANNELS).for_each(|channel| of_component[channel] += totals[channel] * row.scale);
        }
    }

    /// Adds `s (R Δ)` of weights that change in one tile: one for each of its coefficients. Says whether that is anything.
    pub(super) fn change(&self, tile: usize, weights: &[[f64; CHANNELS]], projected: &mut [[f64; CHANNELS]]) -> bool {
        if self.rows.is_empty() {
            return false;
        }
        let mut is_reached = false;
        let (cells, mut rest) = self.tile(tile);
        for (&cell, row) in cells.iter().zip(&self.rows) {
            let words;
            (words, rest) = rest.split_at(cell.words());
            let (dense, entries) = cell.parts(words);
            let mut sums = [0.0f64; CHANNELS];
            let mut add = |number: f64, weights: [f64; CHANNELS]| {
                (0..CHANNELS).for_each(|channel| sums[channel] += number * weights[channel]);
            };
            for (&number, &weights) in dense.as_flattened().iter().zip(weights) {
                add(f64::from(number), weights);
            }
            for (place, number) in entries.iter().map(|&entry| place_and_number(entry)) {
                add(f64::from(number), weights[place]);
            }
            is_reached |= sums.iter().any(|sum| *sum != 0.0);
            let of_component = &mut projected[row.component as usize];
            (0..CHANNELS).for_each(|channel| of_component[channel] += sums[channel] * f64::from(row.scale));
        }
        is_reached
    }

    /// Sets `sums`, channels × coefficients, to `Rᵀ s w` of a weight for each component and channel.
    #[inline(always)]
    pub(super) fn spread(&self, weights: &[[f32; CHANNELS]], tiles: &[ColumnTile], columns: usize, sums: &mut [f32]) {
        let mut dense_sums = [[0.0f32; TILE_COEFFICIENTS]; CHANNELS];
        let mut entry_sums = [[0.0f32; CHANNELS + 1]; TILE_COEFFICIENTS];
        for (t, tile) in tiles.iter().enumerate() {
            dense_sums.iter_mut().for_each(|sums| sums[..tile.len()].fill(0.0));
            entry_sums[..tile.len()].fill([0.0; CHANNELS + 1]);
            let (cells, mut rest) = if self.rows.is_empty() { (&[][..], &[][..]) } else { self.tile(t) };
            for (&cell, row) in cells.iter().zip(&self.rows) {
                let words;
                (words, rest) = rest.split_at(cell.words());
                let (dense, entries) = cell.parts(words);
                let [red, green, blue] = weights[row.component as usize].map(|weight| weight * row.scale);
                for (sums, weight) in dense_sums.iter_mut().zip([red, green, blue]) {
                    for (sums, group) in sums.as_chunks_mut::<GROUP>().0.iter_mut().zip(dense) {
                        (0..GROUP).for_each(|i| sums[i] += f32::from(group[i]) * weight);
                    }
                }
                let weights = [red, green, blue, 0.0];
                for &entry in entries {
                    let (place, number) = place_and_number(entry);
                    let (sums, number) = (&mut entry_sums[place], f32::from(number));
                    (0..CHANNELS + 1).for_each(|channel| sums[channel] += number * weights[channel]);
                }
            }
            for (channel, sums) in sums.chunks_exact_mut(columns).enumerate() {
                for (i, sum) in sums[tile.places()].iter_mut().enumerate() {
                    *sum = dense_sums[channel][i] + entry_sums[i][channel];
                }
            }
        }
    }

    /// Words that some of the components have, and cells that are not empty.
    #[cfg(feature = "gpu")]
    pub(super) fn count(&self, components: &Range<u32>) -> (usize, usize) {
        let mut count = (0, 0);
        for (cell, row) in self.cells.iter().zip(self.rows.iter().cycle()) {
            if components.contains(&row.component) {
                count.0 += cell.words();
                count.1 += usize::from(cell.words() > 0);
            }
        }
        count
    }

    /// What some of the components have, counted from the first of them on.
    #[cfg(feature = "gpu")]
    pub(super) fn piece(&self, components: &Range<u32>) -> Self {
        let is_in = |row: &RightRow| components.contains(&row.component);
        let mut piece = Self::default();
        for (tile, &first) in self.tile_words.iter().enumerate() {
            piece.tile_words.push(piece.words.len() as u32);
            let mut begin = first as usize;
            for (&cell, row) in self.cells[tile * self.rows.len()..].iter().zip(&self.rows) {
                if is_in(row) {
                    piece.cells.push(cell);
                    piece.words.extend_from_slice(&self.words[begin..][..cell.words()]);
                }
                begin += cell.words();
            }
        }
        let rows = self.rows.iter().filter(|row| is_in(row));
        piece.rows = rows.map(|row| RightRow { component: row.component - components.start, ..*row }).collect();
        piece
    }
}

impl RowCells {
    /// Appends the cell of a tile. What does not fit stays in `values`, to be told in a row that is coarser; returns bits that are
    /// all 0 where nothing does.
    #[inline(always)]
    fn push(&mut self, values: &mut [i32]) -> i32 {
        let groups = dense_groups(values);
        let dense = values.len().min(groups * GROUP);
        let mut rest = 0;
        let mut split = |value: &mut i32, range: std::ops::RangeInclusive<i32>| {
            let whole = *value;
            let number = match range.contains(&whole) {
                true => whole,
                false => (whole.wrapping_add(COARSER / 2) & (COARSER - 1)) - COARSER / 2,
            };
            *value = ((i64::from(whole) - i64::from(number)) / i64::from(COARSER)) as i32;
            rest |= *value;
            number
        };
        for four in values[..dense].chunks_mut(4) {
            let mut bytes = [0u8; 4];
            for (byte, value) in bytes.iter_mut().zip(four) {
                *byte = split(value, -127..=127) as i8 as u8;
            }
            self.words.push(u32::from_le_bytes(bytes));
        }
        self.words.resize(self.words.len() + groups * (GROUP / 4) - dense.div_ceil(4), 0);
        let (mut entries, mut half) = (0u16, None);
        for (place, value) in values.iter_mut().enumerate().skip(dense).filter(|(_, value)| **value != 0) {
            let number = split(value, -COARSER / 2..=COARSER / 2 - 1);
            if number == 0 {
                continue;
            }
            let entry = (number << PLACE_BITS) as u16 | place as u16;
            entries += 1;
            half = match half {
                None => Some(entry),
                Some(first) => {
                    self.words.push(u32::from(first) | u32::from(entry) << 16);
                    None
                }
            };
        }
        self.words.extend(half.map(u32::from));
        self.cells.push(Cell { groups: groups as u16, entries });
        rest
    }
}

/// How many groups of a tile are dense: as many as cost least, from the front.
#[inline(always)]
fn dense_groups(values: &[i32]) -> usize {
    let groups = values.len().div_ceil(GROUP);
    let (mut best, mut least, mut entries) = (groups, GROUP * groups, 0);
    for (before, group) in values.chunks(GROUP).enumerate().rev() {
        entries += group.iter().map(|&value| usize::from(value != 0)).sum::<usize>();
        let cost = GROUP * before + ENTRY_COST * entries;
        if cost < least {
            (best, least) = (before, cost);
        }
    }
    best
}

/// Sums of a row, side by side so that additions overlap.
#[derive(Clone, Copy, Debug, Default)]
struct RowSums {
    dense: [[f32; GROUP]; CHANNELS],
    entries: [[f32; CHANNELS + 1]; 4],
}

impl RowSums {
    /// Adds the product of a cell.
    #[inline(always)]
    fn add(&mut self, cell: Cell, words: &[u32], tile: &LightingTile) {
        let (dense, entries) = cell.parts(words);
        let groups = dense.len().min(tile.used.div_ceil(GROUP));
        if groups > 0 {
            let [red, green, blue] = tile.planes();
            let weights = red.as_chunks::<GROUP>().0.iter().zip(green.as_chunks::<GROUP>().0);
            let weights = weights.zip(blue.as_chunks::<GROUP>().0);
            let [mut reds, mut greens, mut blues] = self.dense;
            for (group, ((red, green), blue)) in dense[..groups].iter().zip(weights) {
                for i in 0..GROUP {
                    let number = f32::from(group[i]);
                    reds[i] += number * red[i];
                    greens[i] += number * green[i];
                    blues[i] += number * blue[i];
                }
            }
            self.dense = [reds, greens, blues];
        }
        if entries.is_empty() || tile.used <= dense.len() * GROUP {
            return;
        }
        let weights = tile.interleaved();
        let mut sums = self.entries;
        let add = |sums: &mut [f32; CHANNELS + 1], entry: u16| {
            let (place, number) = place_and_number(entry);
            let (weights, number) = (&weights[place], f32::from(number));
            (0..CHANNELS + 1).for_each(|channel| sums[channel] += number * weights[channel]);
        };
        let (fours, rest) = entries.as_chunks::<4>();
        for four in fours {
            (0..4).for_each(|i| add(&mut sums[i], four[i]));
        }
        rest.iter().zip(&mut sums).for_each(|(&entry, sums)| add(sums, entry));
        self.entries = sums;
    }

    /// The sums of the three channels: in the same order on every machine.
    #[inline(always)]
    fn totals(&self) -> [f32; CHANNELS] {
        let [a, b, c, d] = &self.entries;
        [0, 1, 2].map(|channel| total(self.dense[channel]) + ((a[channel] + b[channel]) + (c[channel] + d[channel])))
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::light::Lighting;

    /// Lamps, a panel whose tiles have all kinds of edges, and a tile of less than a group; in units of many sizes.
    fn transform() -> ColumnTransform {
        let finer: Vec<i8> = (0..40).map(|i| i % 5).chain((0..20).map(|zone| 9 - zone)).chain([3, -2]).collect();
        ColumnTransform::new([(40, 1, false), (70, 33, true), (3, 2, true), (2, 1, false)], &finer)
    }

    /// Rows of numbers of all sizes, from empty ones to dense ones; two add to the same component.
    fn rows(transform: &ColumnTransform) -> Vec<CodedRow> {
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let mut number = |density: f64| {
            if !random.random_bool(density) {
                return 0;
            }
            let most = [1, 31, 32, 127, 128, 5000, 1 << 24][random.random_range(0..7)];
            random.random_range(-most..=most)
        };
        let densities = [0.0, 0.001, 0.02, 0.1, 0.3, 0.6, 1.0, 0.1];
        let row = |(at, &density): (usize, &f64)| CodedRow {
            component: at as u32 % 7,
            step: 0.37 / (1 + at) as f32,
            values: (0..transform.columns()).map(|_| number(density)).collect(),
        };
        densities.iter().enumerate().map(row).collect()
    }

    fn lighting(columns: usize, seed: u64) -> Lighting {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        Lighting::new((0..columns).map(|_| [0; 3].map(|_| random.random_range(-1.0..1.0))).collect()).unwrap()
    }

    const LEFT_SCALES: [f64; 7] = [1.0, 0.5, 3.0, 0.01, 1.0, 2.0, 100.0];

    /// For each component and channel the product, and the sum of the sizes of what is added up, from the decoded values.
    fn expected(rows: &[CodedRow], transform: &ColumnTransform, lighting: &Lighting) -> Vec<[(f64, f64); CHANNELS]> {
        let mut sums = vec![[(0.0, 0.0); CHANNELS]; LEFT_SCALES.len()];
        for row in rows {
            let coefficients: Vec<f64> = row.values.iter().map(|&value| f64::from(value)).collect();
            let values = transform.values(&coefficients);
            let scale = f64::from(row.step) * LEFT_SCALES[row.component as usize];
            for (value, weights) in values.iter().zip(lighting.weights()) {
                for (sum, &weight) in sums[row.component as usize].iter_mut().zip(weights) {
                    let product = scale * value * f64::from(weight);
                    *sum = (sum.0 + product, sum.1 + product.abs());
                }
            }
        }
        sums
    }

    #[test]
    fn products_are_those_of_the_decoded_values() {
        let (transform, rows) = (transform(), rows(&transform()));
        let factor = RightFactor::new(rows.clone(), &transform, &LEFT_SCALES).unwrap();
        assert!(factor.rows.len() > rows.len(), "large numbers take further rows");
        let mut lightings: Vec<Lighting> = (0..3).map(|seed| lighting(transform.columns(), seed)).collect();
        // An even light is one coefficient of each tile; one texel is all coefficients of one.
        lightings.push(Lighting::uniform(transform.columns(), [1.0, 0.5, 0.0]).unwrap());
        let mut one = vec![[0.0; 3]; transform.columns()];
        one[40 + 35 * 70 / 2] = [1.0, 2.0, 3.0];
        lightings.push(Lighting::new(one).unwrap());
        for lighting in &lightings {
            let mut projected = vec![[0.0; CHANNELS]; LEFT_SCALES.len()];
            factor.project(&LightingCoefficients::new(lighting, &[], &transform), &mut projected);
            for (sums, expected) in projected.iter().zip(expected(&rows, &transform, lighting)) {
                for (&sum, (product, size)) in sums.iter().zip(expected) {
                    // Thousands of f32 products; the coefficients are rounded as often.
                    assert!((f64::from(sum) - product).abs() <= 2e-6 * size, "{sum} for {product} of {size}");
                }
            }
        }
    }

    #[test]
    fn a_change_adds_the_product_of_what_has_changed() {
        let (transform, rows) = (transform(), rows(&transform()));
        let factor = RightFactor::new(rows.clone(), &transform, &LEFT_SCALES).unwrap();
        for column in [0, 39, 40, 40 + 70, 40 + 69, 40 + 70 * 33 + 5, transform.columns() - 1] {
            let mut weights = vec![[0.0f32; 3]; transform.columns()];
            weights[column] = [0.5, -1.0, 2.0];
            let index = transform.tile_of(column);
            let mut few = vec![[0.0; CHANNELS]; TILE_COEFFICIENTS];
            let change = std::iter::once((column, weights[column].map(f64::from)));
            let tile = transform.tiles()[index];
            transform.few_weights(tile, change, &mut few[..tile.len()]);
            let mut projected = vec![[0.0; CHANNELS]; LEFT_SCALES.len()];
            assert!(factor.change(index, &few, &mut projected));
            let lighting = Lighting::new(weights).unwrap();
            let sizes = expected(&rows, &transform, &self::lighting(transform.columns(), 9));
            for ((sums, expected), sizes) in projected.iter().zip(expected(&rows, &transform, &lighting)).zip(sizes) {
                for ((sum, (product, _)), (_, size)) in sums.iter().zip(expected).zip(sizes) {
                    assert!((sum - product).abs() <= 1e-7 * size.max(1e-9), "{sum} for {product}");
                }
            }
        }
    }

    #[test]
    fn numbers_take_the_room_of_what_is_not_zero() {
        let transform = ColumnTransform::identity(1024);
        let mut values = vec![0; 1024];
        let row = |values: &[i32]| CodedRow { component: 0, step: 1.0, values: values.to_vec() };
        let bytes = |values: &[i32]| RightFactor::new(vec![row(values)], &transform, &[1.0]).unwrap().words.len() * 4;
        assert_eq!(bytes(&values), 0);
        values[1000] = -3;
        assert_eq!(bytes(&values), 4);
        values[500] = 31;
        assert_eq!(bytes(&values), 4);
        // One that is too large takes a second entry, in a row of its own.
        values[500] = 32;
        assert_eq!(bytes(&values), 8);
        values[..16].fill(1);
        assert_eq!(bytes(&values), 24);
        assert_eq!(bytes(&[100; 1024]), 1024);
    }

    #[test]
    fn scales_that_are_not_finite_are_refused() {
        let row = |step| vec![CodedRow { component: 0, step, values: vec![1] }];
        let transform = ColumnTransform::identity(1);
        assert!(RightFactor::new(row(1.0), &transform, &[1.0]).is_some());
        for (step, left) in [(f32::NAN, 1.0), (1.0, f64::INFINITY), (f32::MAX, 1e10)] {
            assert!(RightFactor::new(row(step), &transform, &[left]).is_none());
        }
    }
}
