//! Images stored by rows: for each row of pixels the rows of all planes.

use std::cell::RefCell;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

/// Planes of one size of which a range of rows is held, row by row. If `f` is the first row held, row `y` of plane `p`
/// begins at `((y − f) · planes + p) · width`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImageRows {
    width: usize,
    height: usize,
    planes: usize,
    first: usize,
    values: Vec<f32>,
}

/// A pool of buffers of finished images, reused for images of about their size, since fresh memory from the system is
/// slow.
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
    /// The region grown by `reach` pixels to each side, clipped to the image.
    pub(super) fn grown(&self, reach: usize, image: &ImageRows) -> Self {
        let grow = |range: &Range<usize>, size: usize| range.start.saturating_sub(reach)..(range.end + reach).min(size);
        Self { x: grow(&self.x, image.width), y: grow(&self.y, image.height) }
    }
}

impl Pool {
    /// Planes of the size of `image` with the rows `held`. The values are unspecified.
    pub(super) fn rows_like(&self, image: &ImageRows, planes: usize, held: Range<usize>) -> ImageRows {
        let (width, height) = (image.width, image.height);
        let length = width * held.len() * planes;
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
            // Otherwise one that is too small by less than half is grown.
            if let Some(small) = find(&kept, length.div_ceil(2)..length) {
                kept.swap_remove(small);
            }
            vec![0.0; length]
        };
        ImageRows { width, height, planes, first: held.start, values }
    }

    /// Bytes in the pool.
    #[cfg(test)]
    pub(super) fn bytes(&self) -> usize {
        self.0.borrow().iter().map(|kept| 4 * kept.capacity()).sum()
    }

    /// Returns the memory of a finished image to the pool.
    pub fn keep(&self, rows: ImageRows) {
        self.0.borrow_mut().push(rows.values);
    }
}

impl ImageRows {
    /// Planes of zeros, all rows.
    pub fn zeros(width: usize, height: usize, planes: usize) -> Self {
        Self { width, height, planes, first: 0, values: vec![0.0; width * height * planes] }
    }

    /// Planes of which no row is held yet, with capacity for `room` values.
    pub(super) fn none_yet((width, height): (usize, usize), planes: usize, room: usize) -> Self {
        Self { width, height, planes, first: 0, values: Vec::with_capacity(width * planes * room.min(height)) }
    }

    /// Bytes of its capacity.
    #[cfg(test)]
    pub(super) fn room_bytes(&self) -> usize {
        4 * self.values.capacity()
    }

    /// Rows that are held.
    pub(super) fn held(&self) -> Range<usize> {
        self.first..self.first + self.values.len() / (self.planes * self.width).max(1)
    }

    /// Holds these rows and drops all before them. The values of new rows are unspecified.
    pub(super) fn hold(&mut self, rows: Range<usize>) {
        let row = self.planes * self.width;
        if self.values.is_empty() {
            self.first = rows.start;
        }
        let forgotten = rows.start.saturating_sub(self.first).min(self.held().len());
        self.values.drain(..forgotten * row);
        self.first += forgotten;
        self.values.resize(rows.end.saturating_sub(self.first).max(self.held().len()) * row, 0.0);
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

    /// One row of one plane, which must be held.
    pub fn row(&self, plane: usize, y: usize) -> &[f32] {
        &self.values[self.begin_of(plane, y)..][..self.width]
    }

    /// One row of one plane, which must be held.
    pub fn row_mut(&mut self, plane: usize, y: usize) -> &mut [f32] {
        let begin = self.begin_of(plane, y);
        &mut self.values[begin..][..self.width]
    }

    /// Index of the first value of a row of a plane.
    #[inline(always)]
    pub(super) fn begin_of(&self, plane: usize, y: usize) -> usize {
        ((y - self.first) * self.planes + plane) * self.width
    }

    /// All values that are held.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// All values that are held.
    pub fn values_mut(&mut self) -> &mut [f32] {
        &mut self.values
    }

    /// Fills rows of all planes by a function of the row, on all threads.
    pub(super) fn fill_whole_rows(&mut self, rows: &Range<usize>, fill: impl Fn(usize, &mut [f32]) + Sync) {
        let row = self.planes * self.width;
        if row > 0 && !rows.is_empty() {
            let begin = self.begin_of(0, rows.start);
            let each = self.values[begin..begin + rows.len() * row].par_chunks_mut(row);
            each.enumerate().for_each(|(y, values)| fill(rows.start + y, values));
        }
    }

    /// Fills a region tile by tile, on all threads. The function gets the tile's origin, its pixels (for each row of
    /// pixels the rows of all planes), and scratch memory that is passed on to the next tile.
    pub(super) fn fill_tiles<T: Default + Send>(
        &mut self,
        region: &Region,
        (across, down): (usize, usize),
        fill: impl Fn(&mut T, (usize, usize), Vec<&mut [f32]>) + Sync,
    ) {
        let row = self.planes * self.width;
        if row == 0 || region.x.is_empty() || region.y.is_empty() {
            return;
        }
        let begin = self.begin_of(0, region.y.start);
        let mut tiles = Vec::new();
        for (strip, values) in self.values[begin..begin + region.y.len() * row].chunks_mut(down * row).enumerate() {
            let y = region.y.start + strip * down;
            let first = tiles.len();
            let begins = region.x.clone().step_by(across);
            tiles.extend(begins.map(|x| ((x, y), Vec::with_capacity(values.len() / self.width))));
            for row in values.chunks_exact_mut(self.width) {
                let parts = row[region.x.clone()].chunks_mut(across);
                tiles[first..].iter_mut().zip(parts).for_each(|((_, rows), part)| rows.push(part));
            }
        }
        // Kept from tile to tile, whichever thread has it next: rayon would begin anew wherever work is stolen.
        let kept = Mutex::new(Vec::new());
        let lock = || kept.lock().unwrap_or_else(PoisonError::into_inner);
        tiles.into_par_iter().for_each(|(begin, rows)| {
            let mut memory: T = lock().pop().unwrap_or_default();
            fill(&mut memory, begin, rows);
            lock().push(memory);
        });
    }

    /// Fills each row of each plane in a region by a function of the row and the plane, on all threads. The function
    /// gets the row's pixels in the region, all zero.
    pub(super) fn fill_rows(&mut self, region: &Region, fill: impl Fn(usize, usize, &mut [f32]) + Sync) {
        self.change_rows(region, |y, plane, out| {
            out.fill(0.0);
            fill(y, plane, out);
        });
    }

    /// Sets all pixels of a region to zero.
    pub(super) fn clear(&mut self, region: &Region) {
        self.fill_rows(region, |_, _, _| {});
    }

    /// As [`fill_rows`](Self::fill_rows), but the function gets the previous values.
    pub(super) fn change_rows(&mut self, region: &Region, fill: impl Fn(usize, usize, &mut [f32]) + Sync) {
        let width = self.width;
        self.fill_whole_rows(&region.y, |y, row| {
            for (plane, row) in row.chunks_exact_mut(width).enumerate() {
                fill(y, plane, &mut row[region.x.clone()]);
            }
        });
    }

    /// Mean over the square of `2 · reach + 1` pixels around each pixel of a region, clipped to the image.
    pub(super) fn box_mean(&self, reach: usize, region: &Region, pool: &Pool) -> Self {
        let around = Region { x: region.x.clone(), y: region.grown(reach, self).y };
        let mut across = pool.rows_like(self, self.planes, around.y.clone());
        across.fill_rows(&around, |y, plane, out| {
            let row = self.row(plane, y);
            let near = |x: usize| x.saturating_sub(reach)..(x + reach + 1).min(self.width);
            // Shifted rows are added, for sums along a row would wait for one another.
            for (from, to) in shifts(&region.x, reach, 1, self.width) {
                out[to].iter_mut().zip(&row[from]).for_each(|(o, v)| *o += v);
            }
            out.iter_mut().zip(region.x.clone()).for_each(|(o, x)| *o /= near(x).len() as f32);
        });
        let mut mean = pool.rows_like(self, self.planes, region.y.clone());
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

    /// These rows of all planes, which must be held, cut into strips. `borders` are the first rows of the strips.
    pub fn strips_mut(&mut self, rows: &Range<usize>, borders: &[usize]) -> Vec<&mut [f32]> {
        let row = self.planes * self.width;
        let begin = self.begin_of(0, rows.start);
        let mut rest = &mut self.values[begin..begin + rows.len() * row];
        let mut strips = Vec::new();
        for (i, &begin) in borders.iter().enumerate() {
            let end = borders.get(i + 1).copied().unwrap_or(rows.end);
            let (strip, after) = rest.split_at_mut((end - begin) * row);
            strips.push(strip);
            rest = after;
        }
        strips
    }
}

/// For each shift from `−reach` to `reach` in equal steps: which pixels of a row of `width` map to which of those in
/// `columns`.
pub(super) fn shifts(
    columns: &Range<usize>,
    reach: usize,
    step: usize,
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
        let mut image = ImageRows::zeros(7, 5, 2);
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
