//! The orthogonal transform of columns in whose coefficients right factors are stored and multiplied.
//!
//! With `D` orthogonal, `R ℓ = (R D)(Dᵀ ℓ)`: who holds the coefficients of `R` multiplies them with those of the lighting,
//! which are computed once for a picture. The columns of a light of many texels are an image, cut into tiles of 32 × 32 that
//! are transformed by the orthonormal DCT-II; lights of one column stand for themselves.

use std::ops::Range;

use super::cosines::{MAX_TILE, Scan, ZONES, cosines, forward};

/// Coefficients of a tile at most.
pub(crate) const TILE_COEFFICIENTS: usize = MAX_TILE * MAX_TILE;

/// `D`, with the unit that each of its coefficients is told in.
///
/// Coefficients stand tile by tile; in a tile by zones of frequency, from the lowest on, in each by row, then column.
#[derive(Clone, Debug, PartialEq)]
pub struct ColumnTransform {
    columns: usize,
    tiles: Vec<ColumnTile>,
    planes: Vec<ColumnPlane>,
    /// Of each coefficient; empty where all are 1.
    units: Vec<f32>,
}

/// Columns that are transformed together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ColumnTile {
    /// Column of the tile's first texel, and columns from a row of texels to the next.
    first_column: usize,
    stride: usize,
    width: usize,
    height: usize,
    /// Place of the tile's first coefficient.
    first: usize,
    is_image: bool,
}

/// The columns of an image, or neighbouring lights of one column each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct ColumnPlane {
    first_column: usize,
    across: usize,
    down: usize,
    first_tile: usize,
    is_image: bool,
}

/// Columns of a tile across and down, at most.
fn tile_size(is_image: bool) -> (usize, usize) {
    if is_image { (MAX_TILE, MAX_TILE) } else { (TILE_COEFFICIENTS, 1) }
}

impl ColumnTile {
    /// Number of its coefficients, and of its columns.
    pub(crate) fn len(self) -> usize {
        self.width * self.height
    }

    /// Places of its coefficients among those of all tiles.
    pub(crate) fn places(self) -> Range<usize> {
        self.first..self.first + self.len()
    }

    /// The columns of its texels, row by row.
    fn rows(self) -> impl Iterator<Item = Range<usize>> {
        (0..self.height).map(move |y| {
            let start = self.first_column + y * self.stride;
            start..start + self.width
        })
    }
}

impl ColumnTransform {
    /// The one that changes nothing.
    pub fn identity(columns: usize) -> Self {
        Self::new([(columns, 1, false)], &[])
    }

    /// That of planes (across, down, whether it is an image), which together have the columns, in their order. `finer` says how
    /// much finer each band is told, in half octaves: the ten zones of each image, and each column of the others; empty:
    /// all alike.
    pub(crate) fn new(planes: impl IntoIterator<Item = (usize, usize, bool)>, finer: &[i8]) -> Self {
        let mut transform = Self { columns: 0, tiles: Vec::new(), planes: Vec::new(), units: Vec::new() };
        let mut rest = finer;
        for (across, down, is_image) in planes {
            let here;
            (here, rest) = rest.split_at(rest.len().min(if is_image { ZONES } else { across * down }));
            transform.push(across, down, is_image, here);
        }
        transform
    }

    fn push(&mut self, across: usize, down: usize, is_image: bool, finer: &[i8]) {
        let first_column = self.columns;
        self.planes.push(ColumnPlane { first_column, across, down, first_tile: self.tiles.len(), is_image });
        let (wide, high) = tile_size(is_image);
        let mut first = first_column;
        for y in (0..down).step_by(high) {
            for x in (0..across).step_by(wide) {
                let (width, height) = (wide.min(across - x), high.min(down - y));
                let first_column = first_column + y * across + x;
                let tile = ColumnTile { first_column, stride: across, width, height, first, is_image };
                first += tile.len();
                self.tiles.push(tile);
                let unit = |finer: i8| (-0.5 * f32::from(finer)).exp2();
                match is_image {
                    _ if finer.is_empty() => {}
                    true => {
                        let scan = Scan::of(width, height);
                        for (zone, &finer) in finer.iter().enumerate() {
                            self.units.extend(std::iter::repeat_n(unit(finer), scan.count(zone)));
                        }
                    }
                    false => self.units.extend(finer[x..x + width].iter().map(|&finer| unit(finer))),
                }
            }
        }
        self.columns = first;
    }

    /// Number of columns, and of coefficients.
    pub fn columns(&self) -> usize {
        self.columns
    }

    pub(crate) fn tiles(&self) -> &[ColumnTile] {
        &self.tiles
    }

    /// The tile that a column is in.
    pub(crate) fn tile_of(&self, column: usize) -> usize {
        let plane = self.planes[self.planes.partition_point(|plane| plane.first_column <= column) - 1];
        let place = column - plane.first_column;
        let (wide, high) = tile_size(plane.is_image);
        let (x, y) = (place % plane.across / wide, place / plane.across / high);
        plane.first_tile + y * plane.across.div_ceil(wide) + x
    }

    fn units_of(&self, tile: ColumnTile) -> &[f32] {
        if self.units.is_empty() { &[] } else { &self.units[tile.places()] }
    }

    /// Coefficients of weights, one a column, that fall into a tile: each times its unit, so that its product with whole numbers
    /// of units is the weights' product with what these are. Returns how many there are up to the last that is not 0.
    /// To be inlined into a function that is compiled for the vectors of the machine.
    #[inline(always)]
    pub(crate) fn weights(&self, tile: ColumnTile, weights: &[f32], out: &mut [f32]) -> usize {
        let mut values = [0.0f32; TILE_COEFFICIENTS];
        let values = &mut values[..tile.len()];
        for (columns, row) in tile.rows().zip(values.chunks_exact_mut(tile.width)) {
            row.copy_from_slice(&weights[columns]);
        }
        let out = &mut out[..tile.len()];
        if !tile.is_image {
            out.copy_from_slice(values);
        } else if values.iter().all(|value| *value == values[0]) {
            // All but the first are 0, and not what rounding makes of them.
            out.fill(0.0);
            out[0] = values[0] * (tile.len() as f32).sqrt();
        } else {
            forward(values, tile.width, tile.height);
            let mut at = 0;
            for run in Scan::of(tile.width, tile.height).all_runs() {
                out[at..at + run.len()].copy_from_slice(&values[run.clone()]);
                at += run.len();
            }
        }
        out.iter_mut().zip(self.units_of(tile)).for_each(|(value, unit)| *value *= unit);
        out.iter().rposition(|value| *value != 0.0).map_or(0, |last| last + 1)
    }

    /// The same in f64 of few weights: columns of the tile, each once, with their weights. Sets `out`, where zeros stand.
    pub(crate) fn few_weights<const N: usize>(
        &self,
        tile: ColumnTile,
        weights: impl Iterator<Item = (usize, [f64; N])>,
        out: &mut [[f64; N]],
    ) {
        if !tile.is_image {
            weights.for_each(|(column, weight)| out[column - tile.first_column] = weight);
        } else {
            let (across, down) = (cosines(tile.width), cosines(tile.height));
            // The transform of each row that has any, from left to right.
            let mut rows = vec![None; tile.height];
            for (column, weight) in weights {
                let place = column - tile.first_column;
                let (x, y) = (place % tile.stride, place / tile.stride);
                let row = rows[y].get_or_insert_with(|| vec![[0.0f64; N]; tile.width]);
                for (u, sums) in row.iter_mut().enumerate() {
                    let cosine = f64::from(across[u * tile.width + x]);
                    (0..N).for_each(|i| sums[i] += weight[i] * cosine);
                }
            }
            let places = || Scan::of(tile.width, tile.height).all_runs().flatten();
            for (y, row) in rows.iter().enumerate() {
                let Some(row) = row else { continue };
                for (out, place) in out.iter_mut().zip(places()) {
                    let cosine = f64::from(down[place / tile.width * tile.height + y]);
                    (0..N).for_each(|i| out[i] += row[place % tile.width][i] * cosine);
                }
            }
        }
        for (out, &unit) in out.iter_mut().zip(self.units_of(tile)) {
            *out = out.map(|value| value * f64::from(unit));
        }
    }

    /// What coefficients, each of them so many units, are for the columns: `D` times them, in f64.
    ///
    /// # Panics
    /// If there are not as many as columns.
    pub fn values(&self, coefficients: &[f64]) -> Vec<f64> {
        assert_eq!(coefficients.len(), self.columns);
        let mut values = vec![0.0; self.columns];
        for &tile in &self.tiles {
            let unit = |i: usize| self.units_of(tile).get(i).map_or(1.0, |&unit| f64::from(unit));
            let here = coefficients[tile.places()].iter().enumerate().map(|(i, value)| value * unit(i));
            if !tile.is_image {
                values[tile.first_column..][..tile.len()].iter_mut().zip(here).for_each(|(out, value)| *out = value);
                continue;
            }
            let (width, height) = (tile.width, tile.height);
            let (across, down) = (cosines(width), cosines(height));
            // Of each row of coefficients its sum over the cosines from left to right.
            let mut rows = vec![0.0f64; tile.len()];
            for (value, place) in here.zip(Scan::of(width, height).all_runs().flatten()) {
                if value != 0.0 {
                    let (u, v) = (place % width, place / width);
                    for x in 0..width {
                        rows[v * width + x] += value * f64::from(across[u * width + x]);
                    }
                }
            }
            for (y, columns) in tile.rows().enumerate() {
                for (v, row) in rows.chunks_exact(width).enumerate() {
                    let cosine = f64::from(down[v * height + y]);
                    values[columns.clone()].iter_mut().zip(row).for_each(|(out, value)| *out += value * cosine);
                }
            }
        }
        values
    }

    /// The coefficients of values, one a column, each in its unit.
    pub(crate) fn coefficients(&self, values: &[f32]) -> Vec<f32> {
        let mut coefficients = vec![0.0; self.columns];
        for &tile in &self.tiles {
            let out = &mut coefficients[tile.places()];
            self.weights(tile, values, out);
            // Weights are multiplied by units; values are divided by them.
            out.iter_mut().zip(self.units_of(tile)).for_each(|(value, unit)| *value /= unit * unit);
        }
        coefficients
    }
}
