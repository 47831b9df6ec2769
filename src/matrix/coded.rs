//! Blocks of factors whose right sides are coefficients, as they are stored and as they are held for relighting.

use super::{ColumnTransform, FactoredBlock};

/// Steps of the largest coefficient where values that were never quantised are: its errors are 2⁻²⁰ of it at most.
const FINE_STEPS: f64 = 520_192.0;

/// Largest number of steps that is asked for where values are multiples of a step: f32 tells these from their neighbours.
const MOST_STEPS: f64 = 2_097_152.0;

/// A block `L R + S` of columns divided by their scales, with `R` as coefficients of a [`ColumnTransform`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CodedBlock {
    /// Left sides and sparse entries; its right sides are left out.
    pub factors: FactoredBlock,
    /// The right sides: that of a component is the sum of all rows that name it.
    pub right: Vec<CodedRow>,
}

/// A right side, or a part that adds to one, in whole numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct CodedRow {
    /// The component.
    pub component: u32,
    /// What 1 stands for, in the units of the coefficients.
    pub step: f32,
    /// One number for each coefficient, in the order of the transform.
    pub values: Vec<i32>,
}

impl CodedBlock {
    /// Codes factors of values, whose columns are first divided by `scales`; of no scales all are 1. Right sides whose coefficients
    /// are multiples of their step stay as they are; others are off by 2⁻²⁰ of the largest at most. A row of values that are
    /// not finite has a step that is not.
    ///
    /// # Panics
    /// If right sides are not of as many columns as the transform and the scales are.
    pub fn of(mut block: FactoredBlock, scales: &[f32], transform: &ColumnTransform) -> Self {
        if !scales.is_empty() {
            block.scale_columns(&scales.iter().map(|scale| scale.recip()).collect::<Vec<_>>());
        }
        let right = (0..block.rank())
            .map(|k| {
                let coefficients = transform.coefficients(block.right_component(k));
                CodedRow::of(k as u32, &coefficients, block.right_step.get(k).copied().unwrap_or(0.0))
            })
            .collect();
        block.right = Vec::new();
        Self { factors: block, right }
    }

    /// Whether the parts fit each other, under a transform of so many columns.
    pub fn is_consistent(&self, columns: usize) -> bool {
        let rank = self.factors.rank();
        let is_apart = self.factors.right.is_empty();
        let fits = |row: &CodedRow| (row.component as usize) < rank && row.values.len() == columns;
        let fits = is_apart && self.factors.columns == columns && self.right.iter().all(fits);
        fits && self.factors.is_consistent_beside_right()
    }

    /// The right side of a component as values, one a column.
    ///
    /// # Panics
    /// If the transform has another number of columns.
    pub fn right_component(&self, component: usize, transform: &ColumnTransform) -> Vec<f64> {
        let mut coefficients = vec![0.0; transform.columns()];
        for row in self.right.iter().filter(|row| row.component as usize == component) {
            let step = f64::from(row.step);
            coefficients.iter_mut().zip(&row.values).for_each(|(sum, &value)| *sum += f64::from(value) * step);
        }
        transform.values(&coefficients)
    }
}

impl CodedRow {
    fn of(component: u32, coefficients: &[f32], step: f32) -> Self {
        let peak = coefficients.iter().fold(0.0f32, |peak, value| peak.max(value.abs()));
        // The largest of several does not tell of one that is no number.
        let sum: f32 = coefficients.iter().map(|value| value * 0.0).sum();
        let step = match f64::from(step) {
            _ if sum != 0.0 => f64::NAN,
            step if is_multiple(coefficients, f64::from(peak), step) => step,
            _ => f64::from(peak) / FINE_STEPS,
        };
        let inverse = if step > 0.0 { step.recip() } else { 0.0 };
        let values = coefficients.iter().map(|&value| (f64::from(value) * inverse).round() as i32).collect();
        Self { component, step: step as f32, values }
    }
}

/// Whether all values are multiples of a step, up to what rounding them to f32 does.
fn is_multiple(values: &[f32], peak: f64, step: f64) -> bool {
    let multiple = |&value: &f32| {
        let count = f64::from(value) / step;
        (count - count.round()).abs() <= 1e-4
    };
    step > 0.0 && peak <= step * MOST_STEPS && values.iter().all(multiple)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn panel() -> ColumnTransform {
        // Tiles of all kinds of edges, and lamps before and behind.
        let finer: Vec<i8> = (0..3).map(|i| 2 * i - 1).chain((0..10).map(|zone| 9 - zone)).chain([3]).collect();
        ColumnTransform::new([(3, 1, false), (45, 33, true), (1, 1, false)], &finer)
    }

    fn values(count: usize, seed: f32) -> Vec<f32> {
        (0..count).map(|i| (seed + 0.37 * i as f32).sin() + (i as f32 * 0.01).cos()).collect()
    }

    #[test]
    fn coded_rows_are_the_values_and_their_products_those_of_the_values() {
        let transform = panel();
        let columns = transform.columns();
        assert_eq!(columns, 3 + 45 * 33 + 1);
        for (transform, step) in [(&transform, 0.0), (&ColumnTransform::identity(columns), 0.0), (&transform, 0.25)] {
            let block = FactoredBlock {
                rows: 3,
                columns,
                left: vec![1.0; 6],
                right: [values(columns, 1.0), values(columns, 2.0)].concat(),
                right_step: vec![step; 2],
                ..Default::default()
            };
            let coded = CodedBlock::of(block.clone(), &[], transform);
            assert!(coded.is_consistent(columns) && !coded.is_consistent(columns + 1));
            let lighting = values(columns, 5.0);
            for k in 0..2 {
                let decoded = coded.right_component(k, transform);
                let off = decoded.iter().zip(block.right_component(k)).map(|(a, &b)| (a - f64::from(b)).abs());
                // The largest coefficient is at most 32 times the largest value, 2.
                assert!(off.fold(0.0, f64::max) < 64.0 * 2f64.powi(-20) * 33.0);
                let row = &coded.right[k];
                let mut product = 0.0;
                for &tile in transform.tiles() {
                    let mut weights = [0.0; super::super::column_transform::TILE_COEFFICIENTS];
                    let used = transform.weights(tile, &lighting, &mut weights);
                    assert!(weights[used..].iter().all(|weight| *weight == 0.0));
                    let values = &row.values[tile.places()];
                    product += values.iter().zip(weights).map(|(&v, w)| f64::from(v) * f64::from(w)).sum::<f64>();
                }
                let expected: f64 = decoded.iter().zip(&lighting).map(|(a, &b)| a * f64::from(b)).sum();
                assert!((product * f64::from(row.step) - expected).abs() < 1e-4, "{product} for {expected}");
            }
        }
    }

    #[test]
    fn multiples_of_a_step_stay_what_they_are_and_what_is_no_number_is_told() {
        let quantised: Vec<f32> = (0..50).map(|i| (i * 7919 % 300) as f32 * 0.125).collect();
        let row = CodedRow::of(3, &quantised, 0.125);
        assert_eq!((row.component, row.step), (3, 0.125));
        assert!(row.values.iter().zip(&quantised).all(|(&n, &v)| n as f32 * 0.125 == v));
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(!CodedRow::of(0, &[1.0, bad, 2.0], 1.0).step.is_finite());
        }
        assert_eq!(CodedRow::of(0, &[0.0; 4], 0.0).values, [0; 4]);
    }

    #[test]
    fn few_weights_have_the_coefficients_of_all() {
        let transform = panel();
        for column in [0, 2, 3, 3 + 44, 3 + 32 * 45 + 40, transform.columns() - 1] {
            let tile = transform.tiles()[transform.tile_of(column)];
            let mut all = vec![0.0f32; transform.columns()];
            all[column] = 1.5;
            let mut expected = vec![0.0f32; tile.len()];
            transform.weights(tile, &all, &mut expected);
            assert!(expected.iter().any(|weight| *weight != 0.0), "column {column} is in another tile");
            let mut few = vec![[0.0f64; 1]; tile.len()];
            transform.few_weights(tile, std::iter::once((column, [1.5])), &mut few);
            assert!(few.iter().zip(&expected).all(|(few, &all)| (few[0] - f64::from(all)).abs() < 1e-5));
        }
    }
}
