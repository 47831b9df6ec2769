//! The sparse remainder: directly seen and mirrored lights, and fireflies.
//!
//! A pixel that sees texel `j` has one entry far above all others of its row: near-identity blocks, which no low rank
//! holds. Such entries are taken out before the range is found.

use std::borrow::Cow;

use crate::matrix::{BlockView, ColumnIndex, SparseEntry};

/// A column with more of its rows standing out than this is a component, not a set of single entries: as a component it
/// costs a value a row, as entries about three times that each.
const DENSE_COLUMN: f64 = 0.3;

/// Entries that carry more than `fraction` of their row's absolute sum and stand more than `contrast` times above the
/// row's 90th percentile, by column, then row.
pub(super) fn stand_out(block: BlockView<'_>, fraction: f64, contrast: f64) -> Vec<SparseEntry> {
    let (m, n) = (block.rows(), block.columns());
    if fraction <= 0.0 || n < 4 {
        return Vec::new();
    }
    let mut sums = vec![0.0f32; m];
    for column in block.entries().chunks_exact(m) {
        sums.iter_mut().zip(column).for_each(|(s, v)| *s += v.abs());
    }
    // A row of equal entries carries 1/n in each: with few columns the fraction must stay above that.
    let fraction = fraction.max(2.0 / n as f64) as f32;
    let thresholds: Vec<f32> = sums.iter().map(|s| (s * fraction).max(f32::MIN_POSITIVE)).collect();
    let mut found: Vec<SparseEntry> = Vec::new();
    for (j, column) in block.entries().chunks_exact(m).enumerate() {
        for (group, (values, limits)) in column.chunks(256).zip(thresholds.chunks(256)).enumerate() {
            if values.iter().zip(limits).fold(false, |any, (v, t)| any | (v.abs() > *t)) {
                let above = values.iter().zip(limits).enumerate().filter(|(_, (v, t))| v.abs() > **t);
                found.extend(above.map(|(i, (v, _))| SparseEntry {
                    column: ColumnIndex(j as u32),
                    row: (group * 256 + i) as u32,
                    value: *v,
                }));
            }
        }
    }
    let mut limits = vec![f32::NAN; m];
    let mut row = vec![0.0f32; n];
    found.retain(|entry| {
        let i = entry.row as usize;
        if limits[i].is_nan() {
            row.iter_mut().enumerate().for_each(|(j, v)| *v = block.at(i, j).abs());
            let at = ((n - 1) as f64 * 0.9) as usize;
            limits[i] = *row.select_nth_unstable_by(at, f32::total_cmp).1 * contrast as f32;
        }
        entry.value.abs() > limits[i]
    });
    let mut counts = vec![0usize; n];
    found.iter().for_each(|e| counts[e.column.index()] += 1);
    let most = ((m as f64 * DENSE_COLUMN) as usize).max(2);
    found.retain(|e| counts[e.column.index()] <= most);
    found
}

/// The entries with the sparse ones set to 0; not copied where there are none.
pub(super) fn without<'a>(entries: Cow<'a, [f32]>, sparse: &[SparseEntry], rows: usize) -> Cow<'a, [f32]> {
    if sparse.is_empty() {
        return entries;
    }
    let mut entries = entries.into_owned();
    for entry in sparse {
        entries[entry.column.index() * rows + entry.row as usize] = 0.0;
    }
    Cow::Owned(entries)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seen_light_is_found_and_smooth_light_is_not() {
        let (m, n) = (12, 64);
        let mut entries: Vec<f32> = (0..m * n).map(|i| 1.0 + 0.3 * ((i % 7) as f32)).collect();
        assert!(stand_out(BlockView::new(m, n, &entries), 0.02, 16.0).is_empty());
        entries[5 * m + 3] = 100.0;
        let found = stand_out(BlockView::new(m, n, &entries), 0.02, 16.0);
        assert_eq!(found, [SparseEntry { column: ColumnIndex(5), row: 3, value: 100.0 }]);
    }
}
