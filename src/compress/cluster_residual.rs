//! The residual that tells the columns of a cluster apart. The cluster's image is denoised; the residual is kept as far
//! as it is above its noise.
//!
//! With the 0/1 matrix `S` (columns × clusters), its images `B = A S` and any map `R` (clusters × columns), a block is
//! `A = B R + A (I − S R)`. Denoising smooths `B`. Of the second term, this module keeps the components on which the
//! samples agree, each times `1 − noise / energy` (Wiener's filter), and the outliers.

use faer::{MatMut, MatRef};
use half::f16;

use super::Candidate;
use super::compressor::Compressor;
use super::dense::write_product;
use crate::light::Clusters;
use crate::matrix::{Block, ColumnIndex, SparseEntry};
use crate::simd::dispatch;

/// The components and sparse entries of a block that are above their noise.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClusterResidual {
    rows: usize,
    columns: usize,
    /// Rows × components, column-major, scaled by the square root of the number of rows: values are near 1 for any
    /// block.
    left: Vec<f16>,
    /// Components × columns, row-major.
    right: Vec<f32>,
    /// For each component: the noise as a share of its left factor's energy, and the noise projected on its right
    /// factor.
    noise: Vec<[f32; 2]>,
    sparse: Vec<SparseEntry>,
}

/// How columns are made of the images of clusters.
#[derive(Clone, Copy, Debug)]
pub struct ClusterMap<'a> {
    /// Which column is in which cluster: `S`.
    pub clusters: &'a Clusters,
    /// The share of each cluster's image in each column: `R`, clusters × columns, row-major.
    pub shares: &'a [f32],
}

impl Compressor {
    /// The residual of an analysed block. Entries of emission seen by the camera (`is_seen`) are left out.
    pub fn contrasts(&self, candidate: &Candidate, is_seen: impl Fn(&SparseEntry) -> bool) -> ClusterResidual {
        let s = &candidate.summary;
        let (rows, columns) = (s.rows as usize, s.columns as usize);
        let mut contrasts = ClusterResidual { rows, columns, ..Default::default() };
        let (factor, scale) = (self.settings().noise_factor.unwrap_or(0.0) as f32, (rows as f32).sqrt());
        for k in (0..candidate.rank()).filter(|&k| k == 0 || s.gains[k] > factor * (s.noise[k] + s.fitted_noise[k])) {
            contrasts.left.extend(candidate.left[k * rows..][..rows].iter().map(|v| f16::from_f32(scale * v)));
            contrasts.right.extend_from_slice(&candidate.right[k * columns..][..columns]);
            contrasts.noise.push([s.fitted_noise[k] / s.gains[k].max(f32::MIN_POSITIVE), s.noise[k]]);
        }
        contrasts.sparse = candidate.sparse.iter().filter(|entry| !is_seen(entry)).copied().collect();
        contrasts
    }

    /// Fills `block` from the images of its clusters (rows × clusters, column-major): every column is the mixture by
    /// `map` (`R`, row-major) plus the residual. Negative entries are then removed such that the image of their cluster
    /// stays, unless that is negative itself.
    ///
    /// # Panics
    /// If they are of another size.
    pub fn spread(&self, mut images: Vec<f32>, contrasts: &ClusterResidual, map: ClusterMap<'_>, block: &mut Block) {
        let (m, n, rank) = (contrasts.rows, contrasts.columns, contrasts.noise.len());
        assert_eq!((m, n), (block.rows(), block.columns()));
        let ClusterMap { clusters, shares } = map;
        assert_eq!((images.len(), shares.len()), (m * clusters.count(), n * clusters.count()));
        // A single entry tells its column apart from the share that it has of its cluster: that much less is spread.
        for entry in &contrasts.sparse {
            images[usize::from(clusters.of_column()[entry.column.index()]) * m + entry.row as usize] -= entry.value;
        }
        let mut left = images;
        left.extend(contrasts.left.iter().map(|v| v.to_f32()));
        let mut right = shares.to_vec();
        right.extend(self.trusted(contrasts, map));
        let both = clusters.count() + rank;
        write_product(
            MatMut::from_column_major_slice_mut(block.entries_mut(), m, n),
            MatRef::from_column_major_slice(&left, m, both),
            MatRef::from_row_major_slice(&right, both, n),
        );
        for entry in &contrasts.sparse {
            block.entries_mut()[entry.column.index() * m + entry.row as usize] += entry.value;
        }
        keep_positive(clusters, block);
    }

    /// Right sides of the components beside the clusters, row-major, as far as they are no noise.
    fn trusted(&self, contrasts: &ClusterResidual, map: ClusterMap<'_>) -> Vec<f32> {
        let (n, rank) = (contrasts.columns, contrasts.noise.len());
        let beside = |row: &[f32]| beside_clusters(row, map);
        let mut right: Vec<f32> = contrasts.right.chunks_exact(n).flat_map(beside).collect();
        let energies = self.plan().energies(&right, rank);
        let scale = 1.0 / (contrasts.rows as f32).sqrt();
        for ((row, [own, fallen]), energy) in right.chunks_exact_mut(n).zip(&contrasts.noise).zip(energies) {
            let noise = f64::from(*own) + f64::from(*fallen) / energy.max(f64::MIN_POSITIVE);
            let trust = (1.0 - noise).clamp(0.0, 1.0) as f32;
            row.iter_mut().for_each(|v| *v *= scale * trust);
        }
        right
    }
}

impl ClusterResidual {
    /// Upper bound of the bytes of a block's residual, with one sparse entry for each row, which is more than is
    /// likely.
    pub fn bytes(rows: u64, columns: u64, rank: u64) -> u64 {
        let rank = (rank + 1).min(rows).min(columns);
        rank * (2 * rows + 4 * columns + 8) + 12 * rows + 64
    }

    /// Encodes it in the machine's byte order, for a file that the same program reads.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        for count in [self.rows, self.columns, self.noise.len(), self.sparse.len()] {
            bytes.extend((count as u64).to_ne_bytes());
        }
        bytes.extend_from_slice(bytemuck::cast_slice(&self.noise));
        bytes.extend_from_slice(bytemuck::cast_slice(&self.right));
        for entry in &self.sparse {
            bytes.extend_from_slice(bytemuck::cast_slice(&[entry.column.0, entry.row, entry.value.to_bits()]));
        }
        self.left.iter().for_each(|v| bytes.extend(v.to_bits().to_ne_bytes()));
        bytes
    }

    /// Decodes what [`to_bytes`](Self::to_bytes) wrote; `None` for other bytes.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (head, mut rest) = bytes.split_at_checked(4 * size_of::<u64>())?;
        let (head, _) = head.as_chunks::<8>();
        let count = |at: usize| usize::try_from(u64::from_ne_bytes(head[at])).ok();
        let (rows, columns, rank, sparse) = (count(0)?, count(1)?, count(2)?, count(3)?);
        let mut take = |count: usize, size: usize| -> Option<&[u8]> {
            let (taken, left) = rest.split_at_checked(count.checked_mul(size)?)?;
            rest = left;
            Some(taken)
        };
        let noise = take(rank, 8)?.as_chunks::<8>().0.iter().map(|b| bytemuck::pod_read_unaligned(b)).collect();
        let right =
            take(columns.checked_mul(rank)?, 4)?.as_chunks::<4>().0.iter().map(|b| f32::from_ne_bytes(*b)).collect();
        let entry = |e: &[u8; 12]| {
            let [column, row, value]: [u32; 3] = bytemuck::pod_read_unaligned(e);
            SparseEntry { column: ColumnIndex(column), row, value: f32::from_bits(value) }
        };
        let sparse = take(sparse, 12)?.as_chunks::<12>().0.iter().map(entry).collect();
        let left = take(rows.checked_mul(rank)?, 2)?;
        let left = left.as_chunks::<2>().0.iter().map(|b| f16::from_bits(u16::from_ne_bytes(*b))).collect();
        rest.is_empty().then_some(Self { rows, columns, left, right, noise, sparse })
    }
}

/// `v (I − S R)` of a row `v`.
fn beside_clusters(row: &[f32], ClusterMap { clusters, shares }: ClusterMap<'_>) -> Vec<f32> {
    let mut sums = vec![0.0f32; clusters.count()];
    row.iter().zip(clusters.of_column()).for_each(|(v, &cluster)| sums[usize::from(cluster)] += v);
    let mut rest = row.to_vec();
    for (sum, map) in sums.iter().zip(shares.chunks_exact(row.len())) {
        rest.iter_mut().zip(map).for_each(|(rest, share)| *rest -= sum * share);
    }
    rest
}

/// Raises negative entries of each pixel to 0 and scales down the positive entries of the same cluster. The cluster's
/// sum stays; a negative sum becomes 0.
fn keep_positive(clusters: &Clusters, block: &mut Block) {
    let rows = block.rows();
    // For each cluster and row: the sum, and the sum of the positive entries.
    let mut sums = vec![0.0f32; clusters.count() * rows];
    let mut above = sums.clone();
    let part = |cluster: u16| usize::from(cluster) * rows..(usize::from(cluster) + 1) * rows;
    dispatch(
        #[inline(always)]
        || {
            for (entries, &cluster) in block.entries().chunks_exact(rows).zip(clusters.of_column()) {
                let both = sums[part(cluster)].iter_mut().zip(&mut above[part(cluster)]);
                for ((sum, above), entry) in both.zip(entries) {
                    *sum += entry;
                    *above += entry.max(0.0);
                }
            }
        },
    );
    // They now become the least value of each entry, and the factor after that.
    for (sum, above) in sums.iter_mut().zip(&mut above) {
        (*sum, *above) = match (*above > *sum, *sum > 0.0) {
            (false, _) => (f32::NEG_INFINITY, 1.0),
            (true, true) => (0.0, *sum / *above),
            (true, false) => (0.0, 0.0),
        };
    }
    let (least, scale) = (sums, above);
    dispatch(
        #[inline(always)]
        || {
            for (entries, &cluster) in block.entries_mut().chunks_exact_mut(rows).zip(clusters.of_column()) {
                let both = least[part(cluster)].iter().zip(&scale[part(cluster)]);
                for (entry, (least, scale)) in entries.iter_mut().zip(both) {
                    // NaN stays NaN.
                    *entry = if *entry < *least { *least } else { *entry } * scale;
                }
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::{Light, LightBasis, LightKind};

    const ROWS: usize = 6;

    /// One row each: columns of both signs, all negative, both signs with a negative sum, all 0, all positive, all NaN.
    #[test]
    fn nothing_stays_below_zero_and_sums_stay() {
        let mut basis = LightBasis::new();
        basis.push(Light::unplaced("panel", LightKind::AreaTexels { across: 12, down: 12 })).unwrap();
        let clusters = Clusters::of_basis(&basis);
        let columns = clusters.of_column().len();
        let values = |row: usize, column: usize| {
            let is_odd = column % 2 == 1;
            [if is_odd { -0.1 } else { 0.5 }, -0.3, if is_odd { -0.5 } else { 0.1 }, 0.0, 0.2, f32::NAN][row]
        };
        let entries = (0..columns).flat_map(|column| (0..ROWS).map(move |row| values(row, column))).collect();
        let mut block = Block::from_entries(ROWS, columns, entries);
        let sums = |block: &Block| {
            let mut sums = vec![0.0f32; ROWS * clusters.count()];
            for (entries, &cluster) in block.entries().chunks_exact(ROWS).zip(clusters.of_column()) {
                sums[ROWS * usize::from(cluster)..].iter_mut().zip(entries).for_each(|(sum, v)| *sum += v);
            }
            sums
        };
        let before = sums(&block);
        keep_positive(&clusters, &mut block);
        let is_right = |(i, v): (usize, &f32)| if i % ROWS == 5 { v.is_nan() } else { *v >= 0.0 };
        assert!(block.entries().iter().enumerate().all(is_right));
        for (after, before) in sums(&block).iter().zip(before) {
            assert!(before.is_nan() || (after - before.max(0.0)).abs() < 1e-5, "{after}, not {before}");
        }
    }
}
