//! Errors of lightings of every kind over the whole image, summed block by block.

use std::sync::{Mutex, MutexGuard};

use crate::light::{Light, LightBasis, LightErrors, LightLoss};

/// Squared norms of the columns of one block.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ColumnErrors {
    /// Of the stored block minus the block.
    pub error: Vec<f64>,
    /// Of the block.
    pub norm: Vec<f64>,
    /// Of the noise of its samples; NaN if unknown.
    pub noise: Vec<f64>,
    /// Squared error and squared norm of the block's image with all lights on.
    pub all_on: (f64, f64),
}

/// Sums over blocks in any order, from any thread, with the same bits: they are kept in fixed point.
pub struct LightErrorSums {
    /// Value of one unit of the sums.
    unit: f64,
    sums: Mutex<LightSums>,
}

#[derive(Clone, Debug, Default)]
struct LightSums {
    /// Error, norm and noise of each column.
    columns: Vec<[i128; 3]>,
    all_on: [i128; 2],
    noise_known: bool,
}

impl LightErrorSums {
    /// For `columns` columns. `energy` is roughly the squared norm of the whole matrix.
    pub fn new(columns: usize, energy: f64) -> Self {
        // 70 bits below the total, and 57 above it.
        let unit = if energy > 0.0 && energy.is_finite() { (energy.log2().floor() - 70.0).exp2() } else { 1.0 };
        let sums = LightSums { columns: vec![[0; 3]; columns], all_on: [0; 2], noise_known: true };
        Self { unit, sums: Mutex::new(sums) }
    }

    /// Adds a block.
    pub fn add(&self, block: &ColumnErrors) {
        // NaN becomes 0; ±∞ saturates.
        let count = |value: f64| (value / self.unit).round() as i128;
        let add = |sum: &mut i128, value: f64| *sum = sum.saturating_add(count(value));
        let mut sums = self.lock();
        sums.noise_known &= block.noise.iter().all(|noise| !noise.is_nan());
        for (j, sum) in sums.columns.iter_mut().enumerate() {
            for (sum, of) in sum.iter_mut().zip([&block.error, &block.norm, &block.noise]) {
                add(sum, of[j]);
            }
        }
        add(&mut sums.all_on[0], block.all_on.0);
        add(&mut sums.all_on[1], block.all_on.1);
    }

    /// All sums so far: of each column, then with all lights on, then whether the noise is known.
    pub fn to_bytes(&self) -> Vec<u8> {
        let sums = self.lock();
        let values = sums.columns.iter().flatten().chain(&sums.all_on);
        values.flat_map(|sum| sum.to_le_bytes()).chain([u8::from(sums.noise_known)]).collect()
    }

    /// Adds sums of other blocks in the same unit, as [`to_bytes`](Self::to_bytes) gave them; `None` if they are not of as many
    /// columns.
    pub fn add_bytes(&self, bytes: &[u8]) -> Option<()> {
        let mut sums = self.lock();
        let (&noise_known, values) = bytes.split_last()?;
        let (values, rest) = values.as_chunks::<{ size_of::<i128>() }>();
        if values.len() != 3 * sums.columns.len() + 2 || !rest.is_empty() {
            return None;
        }
        let LightSums { columns, all_on, noise_known: known } = &mut *sums;
        for (sum, value) in columns.iter_mut().flatten().chain(all_on).zip(values) {
            *sum = sum.saturating_add(i128::from_le_bytes(*value));
        }
        *known &= noise_known == 1;
        Some(())
    }

    /// The errors over all blocks. `prior` is the expected error under the prior.
    pub fn errors(&self, prior: f64) -> LightErrors {
        let sums = self.lock();
        let ratio = |error: i128, norm: i128| if error <= 0 { 0.0 } else { (error as f64 / norm as f64).sqrt() };
        let lit: Vec<(usize, f64, f64)> = sums
            .columns
            .iter()
            .enumerate()
            .filter(|(_, sum)| sum[1] > 0)
            .map(|(j, &[error, norm, noise])| {
                (j, ratio(error, norm), if sums.noise_known { ratio(noise, norm) } else { f64::NAN })
            })
            .collect();
        let mean = |part: fn(&(usize, f64, f64)) -> f64| {
            if lit.is_empty() { 0.0 } else { lit.iter().map(part).sum::<f64>() / lit.len() as f64 }
        };
        // The first of equal ones.
        let worst = lit.iter().rev().copied().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default();
        // A weight between 0 and 1 has the mean 1/2 and the variance 1/12.
        let random = |which: usize| {
            let columns: f64 = sums.columns.iter().map(|sum| sum[which] as f64).sum();
            sums.all_on[which] as f64 / 4.0 + columns / 12.0
        };
        let random = if random(1) > 0.0 { (random(0).max(0.0) / random(1)).sqrt() } else { 0.0 };
        LightErrors {
            prior: prior as f32,
            all_on: ratio(sums.all_on[0], sums.all_on[1]) as f32,
            random: random as f32,
            single_mean: mean(|light| light.1) as f32,
            single_worst: worst.1 as f32,
            worst_column: worst.0 as u32,
            noise_mean: mean(|light| light.2) as f32,
            noise_worst: worst.2 as f32,
        }
    }

    /// The lights whose images alone have large errors, the worst first.
    pub fn lossy_lights(&self, basis: &LightBasis) -> Vec<LightLoss> {
        let sums = self.lock();
        let loss = |light: &Light| {
            let of = |which: usize| -> f64 {
                light.columns().map(|column| sums.columns[column as usize][which] as f64).sum()
            };
            // Images of texels add up, but their errors hardly do. For a light as a whole, squared errors count once.
            let share = 1.0 / light.places.len() as f64;
            let noise = if sums.noise_known { of(2) } else { 0.0 };
            LightLoss::notable(&light.name, [share * of(0), share * noise, of(1)])
        };
        let mut losses: Vec<LightLoss> = basis.lights().iter().filter_map(loss).collect();
        losses.sort_by(|a, b| b.error.total_cmp(&a.error));
        losses
    }

    fn lock(&self) -> MutexGuard<'_, LightSums> {
        // After a panic in another thread the sums are not read any more.
        self.sums.lock().unwrap_or_else(|e| e.into_inner())
    }
}
