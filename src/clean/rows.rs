//! Images in rows: for each row of pixels, the row of every plane.

/// Planes of one size, stored row by row: row `y` of plane `p` begins at `(y · planes + p) · width`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rows {
    width: usize,
    height: usize,
    planes: usize,
    values: Vec<f32>,
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

    /// Fills each row of all planes by a function of the row, with all threads.
    pub(super) fn fill_rows(&mut self, fill: impl Fn(usize, &mut [f32]) + Sync) {
        use rayon::prelude::*;
        let length = (self.planes * self.width).max(1);
        self.values.par_chunks_exact_mut(length).enumerate().for_each(|(y, row)| fill(y, row));
    }

    /// The mean of each pixel's square of `2 · reach + 1` pixels, as far as it lies in the image.
    pub(super) fn box_mean(&self, reach: usize) -> Self {
        let (width, height, planes) = (self.width, self.height, self.planes);
        let mut across = Self::zeros(width, height, planes);
        across.fill_rows(|y, out| {
            for (plane, out) in out.chunks_exact_mut(width).enumerate() {
                let row = self.row(plane, y);
                for (x, out) in out.iter_mut().enumerate() {
                    let span = &row[x.saturating_sub(reach)..(x + reach + 1).min(width)];
                    *out = span.iter().sum::<f32>() / span.len() as f32;
                }
            }
        });
        let mut mean = Self::zeros(width, height, planes);
        mean.fill_rows(|y, out| {
            let rows = y.saturating_sub(reach)..(y + reach + 1).min(height);
            let scale = 1.0 / rows.len() as f32;
            for from in rows {
                let from = &across.values[from * planes * width..][..planes * width];
                out.iter_mut().zip(from).for_each(|(o, v)| *o += v * scale);
            }
        });
        mean
    }
}
