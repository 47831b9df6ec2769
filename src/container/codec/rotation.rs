//! Decorrelation of the three colour channels of a component: a rotation onto the principal axes of its colours.

/// Bits of a stored rotation: which of four parts of the unit quaternion is left out, and the other three.
pub(super) const ROTATION_BITS: u32 = 2 + 3 * PART_BITS;
const PART_BITS: u32 = 10;
/// A part that is not the largest is at most 1/√2; this keeps it inside the stored range.
const PART_SCALE: f32 = 722.0;
const PART_ZERO: i32 = 512;

/// A rotation as stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Rotation(pub(super) u32);

impl Rotation {
    /// The rotation onto the principal axes of `planes` (three of equal length), the strongest axis first.
    pub(super) fn onto_axes(values: &[f32]) -> Self {
        let planes: Vec<&[f32]> = values.chunks_exact((values.len() / 3).max(1)).collect();
        let mut covariance = [[0.0f64; 3]; 3];
        for i in 0..3 {
            for j in i..3 {
                let sum = planes[i].iter().zip(planes[j]).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum();
                covariance[i][j] = sum;
                covariance[j][i] = sum;
            }
        }
        Self::from_matrix(principal_axes(covariance))
    }

    /// Row `i` of the matrix is axis `i`.
    pub(super) fn matrix(self) -> [[f32; 3]; 3] {
        let largest = (self.0 >> (3 * PART_BITS)) as usize;
        let mut quaternion = [0.0f32; 4];
        let mut rest = 1.0;
        for (i, place) in (0..4).filter(|&i| i != largest).enumerate() {
            let stored = (self.0 >> (PART_BITS * i as u32)) & ((1 << PART_BITS) - 1);
            let part = (stored as i32 - PART_ZERO) as f32 / PART_SCALE;
            quaternion[place] = part;
            rest -= part * part;
        }
        quaternion[largest] = rest.max(0.0).sqrt();
        let [x, y, z, w] = quaternion;
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    }

    /// The stored rotation nearest to a matrix of orthonormal rows and determinant 1.
    fn from_matrix(m: [[f64; 3]; 3]) -> Self {
        // Four times the squares of the parts; the largest is safe to divide by.
        let squares = [
            1.0 + m[0][0] - m[1][1] - m[2][2],
            1.0 - m[0][0] + m[1][1] - m[2][2],
            1.0 - m[0][0] - m[1][1] + m[2][2],
            1.0 + m[0][0] + m[1][1] + m[2][2],
        ];
        let largest = (0..4).max_by(|&a, &b| squares[a].total_cmp(&squares[b])).expect("four parts");
        let twice = squares[largest].sqrt();
        let (xy, xz, yz) = (m[0][1] + m[1][0], m[0][2] + m[2][0], m[1][2] + m[2][1]);
        let (xw, yw, zw) = (m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]);
        let others = match largest {
            0 => [xy, xz, xw],
            1 => [xy, yz, yw],
            2 => [xz, yz, zw],
            _ => [xw, yw, zw],
        };
        let mut bits = (largest as u32) << (3 * PART_BITS);
        for (i, product) in others.into_iter().enumerate() {
            let part = product / (2.0 * twice) * f64::from(PART_SCALE);
            let stored = (part.round() as i32 + PART_ZERO).clamp(0, (1 << PART_BITS) - 1);
            bits |= (stored as u32) << (PART_BITS * i as u32);
        }
        Self(bits)
    }
}

/// Applies a matrix to the three planes of `values`: plane `i` becomes `Σⱼ matrix[i][j] · plane j`.
#[inline(always)]
pub(super) fn rotate(values: &mut [f32], matrix: [[f32; 3]; 3]) {
    let third = values.len() / 3;
    let (a, rest) = values.split_at_mut(third);
    let (b, c) = rest.split_at_mut(third);
    for ((a, b), c) in a.iter_mut().zip(b).zip(c) {
        let (x, y, z) = (*a, *b, *c);
        *a = matrix[0][0] * x + matrix[0][1] * y + matrix[0][2] * z;
        *b = matrix[1][0] * x + matrix[1][1] * y + matrix[1][2] * z;
        *c = matrix[2][0] * x + matrix[2][1] * y + matrix[2][2] * z;
    }
}

/// The inverse of a rotation.
pub(super) fn transposed(m: [[f32; 3]; 3]) -> [[f32; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| m[j][i]))
}

/// Eigenvectors of a symmetric matrix as rows, by falling eigenvalue, with determinant 1 (Jacobi's method).
fn principal_axes(mut a: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..12 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            for row in &mut a {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            for k in 0..3 {
                (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
                (axes[p][k], axes[q][k]) = (c * axes[p][k] - s * axes[q][k], s * axes[p][k] + c * axes[q][k]);
            }
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[j][j].total_cmp(&a[i][i]));
    let [x, y, z] = order.map(|i| axes[i]);
    let cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
    let positive = cross[0] * z[0] + cross[1] * z[1] + cross[2] * z[2] > 0.0;
    [x, y, if positive { z } else { z.map(|v| -v) }]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_axis_takes_nearly_all_of_one_colour() {
        for colour in [[1.0f32, 0.8, 0.6], [0.0, 1.0, 0.0], [-0.3, 0.9, 0.2], [1.0, 0.0, 0.0]] {
            let shades = (0..64).map(|i| (i as f32 * 0.7).sin());
            let original: Vec<f32> = colour.iter().flat_map(|c| shades.clone().map(move |s| c * s)).collect();
            let rotation = Rotation::onto_axes(&original);
            let mut values = original.clone();
            rotate(&mut values, rotation.matrix());
            let energy = |v: &[f32]| v.iter().map(|v| v * v).sum::<f32>();
            // Parts are stored to 1/722, so axes are off by at most about 2 / 722.
            assert!(energy(&values[64..]) < 1e-5 * energy(&values[..64]), "{colour:?}");
            rotate(&mut values, transposed(rotation.matrix()));
            assert!(values.iter().zip(&original).all(|(a, b)| (a - b).abs() < 1e-5));
        }
    }

    #[test]
    fn any_stored_rotation_is_finite() {
        for bits in (0..u32::MAX).step_by(65_521) {
            assert!(Rotation(bits).matrix().iter().flatten().all(|v| v.is_finite()));
        }
    }
}
