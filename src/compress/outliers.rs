//! The sparse remainder: lights seen directly or in mirrors, and fireflies.
//!
//! A pixel that sees texel `j` has one entry far above all others of its row. That is a near-identity block, which has
//! no low rank. Such entries are taken out before the range is computed.

use std::borrow::Cow;

use crate::matrix::{BlockView, ColumnIndex, SparseEntry};
use crate::simd::dispatch;

/// Share of a column's rows that are outliers above which the column is left to a component. As a component it costs
/// one value for each row; as sparse entries it costs about three for each.
const DENSE_COLUMN: f64 = 0.3;

/// Outliers of a block, ordered by column, then row. They carry more than `fraction` of their row's absolute sum
/// (`sums`, one for each row), and exceed `contrast` times the row's 90th percentile.
pub(super) fn find_outliers(block: BlockView<'_>, sums: &[f32], fraction: f64, contrast: f64) -> Vec<SparseEntry> {
    let (m, n) = (block.rows(), block.columns());
    if fraction <= 0.0 || n < 4 {
        return Vec::new();
    }
    // In a row of equal entries each carries 1/n, so the fraction must stay above that for few columns.
    let fraction = fraction.max(2.0 / n as f64) as f32;
    let thresholds: Vec<f32> = sums.iter().map(|s| (s * fraction).max(f32::MIN_POSITIVE)).collect();
    let mut found = above(block, &thresholds);
    if found.is_empty() {
        return found;
    }
    // If at most a tenth of a row exceeds its least candidate over the contrast, the 90th percentile is below that
    // value. Counting takes one pass, and few rows must be examined in full.
    let contrast = contrast as f32;
    let mut limits = vec![f32::INFINITY; m];
    for entry in &found {
        let limit = &mut limits[entry.row as usize];
        *limit = limit.min(entry.value.abs() / contrast);
    }
    let counts = counts_above(block, &limits);
    let at = ((n - 1) as f64 * 0.9) as usize;
    let mut row = vec![0.0f32; n];
    for (i, limit) in limits.iter_mut().enumerate().filter(|(_, limit)| limit.is_finite()) {
        if counts[i] as usize + at < n {
            *limit = 0.0;
        } else {
            row.iter_mut().enumerate().for_each(|(j, v)| *v = block.at(i, j).abs());
            *limit = *row.select_nth_unstable_by(at, f32::total_cmp).1 * contrast;
        }
    }
    found.retain(|entry| entry.value.abs() > limits[entry.row as usize]);
    let mut counts = vec![0usize; n];
    found.iter().for_each(|e| counts[e.column.index()] += 1);
    let most = ((m as f64 * DENSE_COLUMN) as usize).max(2);
    found.retain(|e| counts[e.column.index()] <= most);
    found
}

/// Entries with a larger magnitude than their row's threshold, ordered by column, then row.
fn above(block: BlockView<'_>, thresholds: &[f32]) -> Vec<SparseEntry> {
    let mut found: Vec<SparseEntry> = Vec::new();
    dispatch(
        #[inline(always)]
        || {
            for (j, column) in block.entries().chunks_exact(block.rows()).enumerate() {
                for (group, (values, limits)) in column.chunks(256).zip(thresholds.chunks(256)).enumerate() {
                    if !values.iter().zip(limits).fold(false, |any, (v, t)| any | (v.abs() > *t)) {
                        continue;
                    }
                    let above = values.iter().zip(limits).enumerate().filter(|(_, (v, t))| v.abs() > **t);
                    found.extend(above.map(|(i, (v, _))| SparseEntry {
                        column: ColumnIndex(j as u32),
                        row: (group * 256 + i) as u32,
                        value: *v,
                    }));
                }
            }
        },
    );
    found
}

/// For each row the number of entries with a larger magnitude than its limit. Adjacent rows without a finite limit are
/// skipped.
fn counts_above(block: BlockView<'_>, limits: &[f32]) -> Vec<u32> {
    const TOGETHER: usize = 64;
    let mut counts = vec![0u32; block.rows()];
    let wanted: Vec<usize> = (0..block.rows())
        .step_by(TOGETHER)
        .filter(|&first| limits[first..].iter().take(TOGETHER).any(|limit| limit.is_finite()))
        .collect();
    dispatch(
        #[inline(always)]
        || {
            for column in block.entries().chunks_exact(block.rows()) {
                for &first in &wanted {
                    let end = (first + TOGETHER).min(column.len());
                    let rows = counts[first..end].iter_mut().zip(&column[first..end]).zip(&limits[first..end]);
                    for ((count, value), limit) in rows {
                        *count += u32::from(value.abs() > *limit);
                    }
                }
            }
        },
    );
    counts
}

/// The entries with the sparse ones set to 0; borrowed if there are none.
pub(super) fn without<'a, 'b>(
    entries: Cow<'a, [f32]>,
    sparse: impl Iterator<Item = &'b SparseEntry>,
    rows: usize,
) -> Cow<'a, [f32]> {
    let mut sparse = sparse.peekable();
    if sparse.peek().is_none() {
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

    fn found(block: BlockView<'_>) -> Vec<SparseEntry> {
        let sum = |i: usize| (0..block.columns()).map(|j| block.at(i, j).abs()).sum();
        let sums: Vec<f32> = (0..block.rows()).map(sum).collect();
        find_outliers(block, &sums, 0.02, 16.0)
    }

    #[test]
    fn a_seen_light_is_found_and_smooth_light_is_not() {
        let (m, n) = (12, 64);
        let mut entries: Vec<f32> = (0..m * n).map(|i| 1.0 + 0.3 * ((i % 7) as f32)).collect();
        assert!(found(BlockView::new(m, n, &entries)).is_empty());
        entries[5 * m + 3] = 100.0;
        // Above the threshold from its row's sum, but not by enough above the row's other entries.
        entries[9 * m + 3] = 10.0;
        let one = [SparseEntry { column: ColumnIndex(5), row: 3, value: 100.0 }];
        assert_eq!(found(BlockView::new(m, n, &entries)), one);
    }
}
