//! Images in rows: for each row of pixels, the row of every plane.

use std::ops::Range;

use rayon::prelude::*;

/// Planes of one size, stored row by row: row `y` of plane `p` begins at `(y · planes + p) · width`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rows {
    width: usize,
    height: usize,
    planes: usize,
    values: Vec<f32>,
}

/// A rectangle of pixels of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Region {
    /// Pixels across.
    pub x: Range<usize>,
    /// Pixels down.
    pub y: Range<usize>,
}

impl Region {
    /// What of the image lies within `reach` of the region.
    pub(super) fn grown(&self, reach: usize, image: &Rows) -> Self {
        let grow = |range: &Range<usize>, size: usize| range.start.saturating_sub(reach)..(range.end + reach).min(size);
        Self { x: grow(&self.x, image.width), y: grow(&self.y, image.height) }
    }
}

impl Rows {
    /// Planes of zeros.
    pub fn zeros(width: usize, height: usize, planes: usize) -> Self {
        Self { width, height, planes, values: vec![0.0; width * height * planes] }
    }

    /// Pixels across.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Pixels down.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Number of planes.
    pub fn planes(&self) -> usize {
        self.planes
    }

    /// All pixels.
    pub fn whole(&self) -> Region {
        Region { x: 0..self.width, y: 0..self.height }
    }

    /// One row of one plane.
    pub fn row(&self, plane: usize, y: usize) -> &[f32] {
        &self.values[(y * self.planes + plane) * self.width..][..self.width]
    }

    /// One row of one plane.
    pub fn row_mut(&mut self, plane: usize, y: usize) -> &mut [f32] {
        &mut self.values[(y * self.planes + plane) * self.width..][..self.width]
    }

    /// All values.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// All values.
    pub fn values_mut(&mut self) -> &mut [f32] {
        &mut self.values
    }

    /// Fills strips of at most `height` rows of all planes by a function of their first row, with all threads.
    pub(super) fn fill_strips(&mut self, rows: &Range<usize>, height: usize, fill: impl Fn(usize, &mut [f32]) + Sync) {
        let row = self.planes * self.width;
        if row > 0 {
            let strips = self.values[rows.start * row..rows.end * row].par_chunks_mut(height * row);
            strips.enumerate().for_each(|(strip, values)| fill(rows.start + strip * height, values));
        }
    }

    /// Fills each row of all planes in a region by a function of the row and the plane, with all threads. It is given those
    /// pixels of the row that lie in the region.
    pub(super) fn fill_rows(&mut self, region: &Region, fill: impl Fn(usize, usize, &mut [f32]) + Sync) {
        let width = self.width;
        self.fill_strips(&region.y, 1, |y, row| {
            for (plane, row) in row.chunks_exact_mut(width).enumerate() {
                fill(y, plane, &mut row[region.x.clone()]);
            }
        });
    }

    /// For each pixel of a region the mean of the square of `2 · reach + 1` pixels around it, as far as it lies in the image.
    pub(super) fn box_mean(&self, reach: usize, region: &Region) -> Self {
        let mut across = Self::zeros(self.width, self.height, self.planes);
        across.fill_rows(&Region { x: region.x.clone(), y: region.grown(reach, self).y }, |y, plane, out| {
            let row = self.row(plane, y);
            let near = |x: usize| x.saturating_sub(reach)..(x + reach + 1).min(self.width);
            // Shifted rows are added, for sums along a row would wait for one another.
            for (from, to) in shifts(&region.x, (reach, 1), self.width) {
                out[to].iter_mut().zip(&row[from]).for_each(|(o, v)| *o += v);
            }
            out.iter_mut().zip(region.x.clone()).for_each(|(o, x)| *o /= near(x).len() as f32);
        });
        let mut mean = Self::zeros(self.width, self.height, self.planes);
        mean.fill_rows(region, |y, plane, out| {
            let rows = y.saturating_sub(reach)..(y + reach + 1).min(self.height);
            let scale = 1.0 / rows.len() as f32;
            for from in rows {
                out.iter_mut().zip(&across.row(plane, from)[region.x.clone()]).for_each(|(o, v)| *o += v * scale);
            }
        });
        mean
    }
}

/// For each shift of at most `reach` to either side, from one to the next a step: which pixels of a row of `width` go to which
/// of those in `columns`.
pub(super) fn shifts(
    columns: &Range<usize>,
    (reach, step): (usize, usize),
    width: usize,
) -> impl Iterator<Item = (Range<usize>, Range<usize>)> {
    let (begin, end) = (columns.start, columns.end);
    (0..2 * reach + 1).step_by(step).filter_map(move |shift| {
        // Pixel x reads x + shift − reach.
        let first = begin.max(reach.saturating_sub(shift));
        let last = end.min((width + reach).saturating_sub(shift));
        (first < last).then(|| (first + shift - reach..last + shift - reach, first - begin..last - begin))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_a_square_is_of_what_lies_in_the_image() {
        let mut image = Rows::zeros(7, 5, 2);
        image.values_mut().iter_mut().enumerate().for_each(|(i, v)| *v = (i * i % 17) as f32);
        for region in [image.whole(), Region { x: 2..4, y: 1..5 }] {
            let means = image.box_mean(2, &region);
            for plane in 0..2 {
                for y in region.y.clone() {
                    for x in region.x.clone() {
                        let near: Vec<f32> = (y.saturating_sub(2)..(y + 3).min(5))
                            .flat_map(|y| image.row(plane, y)[x.saturating_sub(2)..(x + 3).min(7)].to_vec())
                            .collect();
                        let right = near.iter().sum::<f32>() / near.len() as f32;
                        assert!((means.row(plane, y)[x] - right).abs() < 1e-4, "{x} {y}");
                    }
                }
            }
        }
    }
}
