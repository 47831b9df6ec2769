//! Images in rows: for each row of pixels, the row of every plane.

use std::cell::RefCell;
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

/// Memory of images that are done with, for the next of about their size: the system takes its time to give new pages.
#[derive(Debug, Default)]
pub struct Pool(RefCell<Vec<Vec<f32>>>);

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

impl Pool {
    /// Planes of any values.
    pub fn rows(&self, width: usize, height: usize, planes: usize) -> Rows {
        let length = width * height * planes;
        let mut kept = self.0.borrow_mut();
        let find = |kept: &[Vec<f32>], sizes: Range<usize>| {
            let fitting = (0..kept.len()).filter(|&i| sizes.contains(&kept[i].capacity()));
            fitting.min_by_key(|&i| kept[i].capacity())
        };
        let values = if let Some(fitting) = find(&kept, length..2 * length) {
            let mut values = kept.swap_remove(fitting);
            values.resize(length, 0.0);
            values
        } else {
            // One that is too small by less makes room.
            if let Some(small) = find(&kept, length.div_ceil(2)..length) {
                kept.swap_remove(small);
            }
            vec![0.0; length]
        };
        Rows { width, height, planes, values }
    }

    /// Keeps the memory of an image that is done with.
    pub fn keep(&self, rows: Rows) {
        self.0.borrow_mut().push(rows.values);
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
    /// pixels of the row that lie in the region, all zero.
    pub(super) fn fill_rows(&mut self, region: &Region, fill: impl Fn(usize, usize, &mut [f32]) + Sync) {
        self.change_rows(region, |y, plane, out| {
            out.fill(0.0);
            fill(y, plane, out);
        });
    }

    /// Makes all pixels of a region zero.
    pub(super) fn clear(&mut self, region: &Region) {
        self.fill_rows(region, |_, _, _| {});
    }

    /// The same, but it is given what the pixels were.
    pub(super) fn change_rows(&mut self, region: &Region, fill: impl Fn(usize, usize, &mut [f32]) + Sync) {
        let width = self.width;
        self.fill_strips(&region.y, 1, |y, row| {
            for (plane, row) in row.chunks_exact_mut(width).enumerate() {
                fill(y, plane, &mut row[region.x.clone()]);
            }
        });
    }

    /// For each pixel of a region the mean of the square of `2 · reach + 1` pixels around it, as far as it lies in the image.
    pub(super) fn box_mean(&self, reach: usize, region: &Region, pool: &Pool) -> Self {
        let mut across = pool.rows(self.width, self.height, self.planes);
        across.fill_rows(&Region { x: region.x.clone(), y: region.grown(reach, self).y }, |y, plane, out| {
            let row = self.row(plane, y);
            let near = |x: usize| x.saturating_sub(reach)..(x + reach + 1).min(self.width);
            // Shifted rows are added, for sums along a row would wait for one another.
            for (from, to) in shifts(&region.x, (reach, 1), self.width) {
                out[to].iter_mut().zip(&row[from]).for_each(|(o, v)| *o += v);
            }
            out.iter_mut().zip(region.x.clone()).for_each(|(o, x)| *o /= near(x).len() as f32);
        });
        let mut mean = pool.rows(self.width, self.height, self.planes);
        mean.fill_rows(region, |y, plane, out| {
            let rows = y.saturating_sub(reach)..(y + reach + 1).min(self.height);
            let scale = 1.0 / rows.len() as f32;
            for from in rows {
                out.iter_mut().zip(&across.row(plane, from)[region.x.clone()]).for_each(|(o, v)| *o += v * scale);
            }
        });
        pool.keep(across);
        mean
    }

    /// The rows of all planes, cut before each of these rows of pixels but the first, which is where they begin.
    pub fn strips_mut(&mut self, borders: &[usize]) -> Vec<&mut [f32]> {
        let row = self.planes * self.width;
        let mut rest = &mut self.values[..];
        let mut strips = Vec::new();
        for (i, &begin) in borders.iter().enumerate() {
            let end = borders.get(i + 1).copied().unwrap_or(self.height);
            let (strip, after) = rest.split_at_mut((end - begin) * row);
            strips.push(strip);
            rest = after;
        }
        strips
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
            let means = image.box_mean(2, &region, &Pool::default());
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
