//! Blocks of factors as they are held for relighting: left sides in 8 or 16 bits a value, right ones as coefficients.

#[cfg(feature = "gpu")]
use std::ops::Range;

use super::right::RightFactor;
use crate::error::{Error, Result};
use crate::matrix::{BlockId, CHANNELS, CodedBlock, CodedRow, ColumnTransform, FactoredBlock, MatrixShape};

/// Largest magnitude that 16-bit values are scaled to. The smallest normal 16-bit float is then 2⁻²⁹ of it. Smaller
/// values are stored as 0, so that kernels never meet a subnormal number.
const WIDE_PEAK: f64 = 32_768.0;

/// Largest size of an 8-bit value. −128 is not used, so that signs are alike.
const NARROW_PEAK: f64 = 127.0;

/// Largest 8-bit scale, as a fraction of the quantiser step. Rounding then adds at most 1/16 of the step's error power. (The
/// stored error is that of transform coefficients, many of them exactly 0; rounding affects every value.)
const FINEST_SHARE: f64 = 0.25;

/// A stored value that kernels turn into f32 without branches.
pub(crate) trait Quantum: Copy + Sync {
    /// The value before scaling.
    fn to_f32(self) -> f32;
}

impl Quantum for i8 {
    #[inline(always)]
    fn to_f32(self) -> f32 {
        f32::from(self)
    }
}

impl Quantum for f32 {
    #[inline(always)]
    fn to_f32(self) -> f32 {
        self
    }
}

/// The bits of a 16-bit float that is neither subnormal nor infinite nor NaN.
#[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub(crate) struct Wide(pub u16);

impl Quantum for Wide {
    /// Moves exponent and mantissa into place and mends the exponent's bias by a product with 2¹¹²: vectorises, which
    /// a conversion with cases for subnormals and infinities does not.
    #[inline(always)]
    fn to_f32(self) -> f32 {
        let bits = u32::from(self.0);
        let magnitude = f32::from_bits((bits & 0x7fff) << 13) * f32::from_bits((112 + 127) << 23);
        f32::from_bits(magnitude.to_bits() | ((bits & 0x8000) << 16))
    }
}

/// The components of one factor that are stored in one precision.
#[derive(Clone, Debug)]
pub(crate) struct FactorPart<Q> {
    /// Index of each of these components in the block.
    pub components: Vec<u32>,
    /// Their values, component after component.
    pub values: Vec<Q>,
}

/// The left factor: components of `length` values each, those in 8 bits apart from those in 16.
#[derive(Clone, Debug)]
pub(crate) struct Factor<N = i8, W = Wide> {
    pub length: usize,
    pub narrow: FactorPart<N>,
    pub wide: FactorPart<W>,
}

/// Entries outside the low-rank part, column by column.
#[derive(Clone, Debug, Default)]
pub(crate) struct SparseEntries {
    /// Columns that have entries, ascending, with the end of each one's entries; they begin where the last ended.
    pub ends: Vec<(u32, u32)>,
    /// Row of each entry inside the block.
    pub rows: Vec<u32>,
    /// Value of each entry.
    pub values: Vec<f32>,
}

/// A block `L R + S` ready for relighting.
///
/// The left side of a component is held in 8 bits where its quantisation step allows it, else as 16-bit floats; its scale is
/// folded into those of the rows of its right side, which are held as the whole numbers that a container stores.
#[derive(Clone, Debug)]
pub struct CompactBlock {
    rank: usize,
    pub(crate) left: Factor,
    pub(crate) right: RightFactor,
    pub(crate) sparse: SparseEntries,
}

impl<Q: Copy> FactorPart<Q> {
    fn new() -> Self {
        Self { components: Vec::new(), values: Vec::new() }
    }

    /// Positions of some components, given in ascending order.
    #[cfg(feature = "gpu")]
    fn places(&self, components: &Range<u32>) -> Range<usize> {
        let place_of = |component| self.components.partition_point(|&k| k < component);
        place_of(components.start)..place_of(components.end)
    }

    /// Those of some components, which are counted from the first of them on.
    #[cfg(feature = "gpu")]
    fn piece(&self, length: usize, components: &Range<u32>) -> Self {
        let places = self.places(components);
        Self {
            components: self.components[places.clone()].iter().map(|k| k - components.start).collect(),
            values: self.values[places.start * length..places.end * length].to_vec(),
        }
    }

    fn bytes(&self) -> usize {
        self.components.len() * size_of::<u32>() + self.values.len() * size_of::<Q>()
    }
}

impl<Q: Quantum> FactorPart<Q> {
    #[inline(always)]
    fn widen(&self) -> FactorPart<f32> {
        let values = self.values.iter().map(|value| value.to_f32()).collect();
        FactorPart { components: self.components.clone(), values }
    }
}

impl Factor {
    fn new(length: usize) -> Self {
        Self { length, narrow: FactorPart::new(), wide: FactorPart::new() }
    }

    /// Stores component `index` and returns its scale, 0 for a component of zeros, which takes no room; none if a value
    /// is not finite.
    #[inline(always)]
    fn push(&mut self, index: u32, values: &[f32], step: Option<f32>) -> Option<f64> {
        let peak = peak(values);
        if peak == 0.0 {
            return Some(0.0);
        }
        if !peak.is_finite() {
            return None;
        }
        let peak = f64::from(peak);
        Some(match step.and_then(|step| narrow_scale(values, peak, f64::from(step))) {
            Some(scale) => {
                self.narrow.components.push(index);
                self.narrow.values.extend(values.iter().map(|&v| narrow(v, scale.recip())));
                scale
            }
            None => {
                self.wide.components.push(index);
                let scale = peak / WIDE_PEAK;
                self.wide.values.extend(values.iter().map(|&v| wide(v, scale.recip())));
                scale
            }
        })
    }

    /// How many of some components are held in 8 bits, and how many in 16.
    #[cfg(feature = "gpu")]
    pub(crate) fn count(&self, components: &Range<u32>) -> (usize, usize) {
        (self.narrow.places(components).len(), self.wide.places(components).len())
    }

    #[cfg(feature = "gpu")]
    fn piece(&self, components: &Range<u32>) -> Self {
        let (narrow, wide) = (self.narrow.piece(self.length, components), self.wide.piece(self.length, components));
        Self { length: self.length, narrow, wide }
    }

    fn bytes(&self) -> usize {
        self.narrow.bytes() + self.wide.bytes()
    }
}

impl<N: Quantum, W: Quantum> Factor<N, W> {
    /// Its values in f32, for several products with the same factor.
    #[inline(always)]
    pub(crate) fn widen(&self) -> Factor<f32, f32> {
        Factor { length: self.length, narrow: self.narrow.widen(), wide: self.wide.widen() }
    }
}

/// The largest size of a value; not finite if one of them is not. By their bits, which order as sizes do and of which many
/// are compared at once.
#[inline(always)]
fn peak(values: &[f32]) -> f32 {
    f32::from_bits(values.iter().fold(0, |peak, v| peak.max(v.to_bits() & 0x7fff_ffff)))
}

/// The scale with which values fit 8 bits, if there is one: `step` itself where the values are multiples of it (then
/// nothing is lost), else the finest scale that fits, where that is fine enough beside `step`.
#[inline(always)]
fn narrow_scale(values: &[f32], peak: f64, step: f64) -> Option<f64> {
    if step <= 0.0 || peak / NARROW_PEAK > step * (1.0 + 1e-6) {
        return None;
    }
    let multiple = |v: f32| {
        let count = f64::from(v) / step;
        // f32 values that were multiples before rounding are off by at most 2⁻²⁴ of themselves.
        (count - count.round()).abs() <= 1e-4
    };
    if values.iter().all(|&v| multiple(v)) {
        return Some(step);
    }
    Some(peak / NARROW_PEAK).filter(|scale| *scale <= FINEST_SHARE * step)
}

/// What a value is added to so that it stands, rounded, in the lowest bits: that takes many at once. 1.5 · 2²³.
const SHIFT: f32 = 12_582_912.0;

/// `value · inverse_scale` rounded.
#[inline(always)]
fn narrow(value: f32, inverse_scale: f64) -> i8 {
    ((f64::from(value) * inverse_scale) as f32 + SHIFT).to_bits() as i8
}

/// `value · inverse_scale`, at most 2¹⁵, as a 16-bit float rounded to even: without cases, so that it takes many values at
/// once.
#[inline(always)]
fn wide(value: f32, inverse_scale: f64) -> Wide {
    let bits = ((f64::from(value) * inverse_scale) as f32).to_bits();
    let size = bits & 0x7fff_ffff;
    let rounded = size + 0xfff + (size >> 13 & 1);
    let half = (rounded >> 13).wrapping_sub(112 << 10) | bits >> 16 & 0x8000;
    Wide(if rounded < 113 << 23 { 0 } else { half as u16 })
}

impl CompactBlock {
    /// Takes the factors of block `id` into compact form, their right sides as coefficients of `transform`. A lighting is
    /// multiplied by the scales of the columns.
    ///
    /// # Errors
    /// Parts that do not fit each other or the shape, and values that are not finite.
    pub fn new(shape: MatrixShape, id: BlockId, block: CodedBlock, transform: &ColumnTransform) -> Result<Self> {
        let rect = shape.rect(id);
        let refuse = |problem: String| Err(Error::input(id.to_string(), problem, "pack the matrix again"));
        let empty = block.factors.left.is_empty() && block.right.is_empty() && block.factors.sparse.is_empty();
        if !empty && (block.factors.rows != rect.rows() || block.factors.columns != shape.columns()) {
            let FactoredBlock { rows, columns, .. } = block.factors;
            return refuse(format!("has {rows} × {columns} entries, not {} × {}", rect.rows(), shape.columns()));
        }
        if !empty && !block.is_consistent(transform.columns()) {
            return refuse("has factors that do not fit each other".into());
        }
        let CodedBlock { factors: block, right } = block;
        let mut compact = Self {
            rank: if empty { 0 } else { block.rank() },
            left: Factor::new(rect.rows()),
            right: RightFactor::default(),
            sparse: SparseEntries::default(),
        };
        let pushed = PushFactors { block: &block, right, transform, compact: &mut compact };
        let is_finite = pulp::Arch::new().dispatch(pushed);
        if !is_finite || !block.sparse.iter().all(|e| e.value.is_finite()) {
            return refuse("has factors that are not finite".into());
        }
        for entry in &block.sparse {
            match compact.sparse.ends.last_mut() {
                Some((column, end)) if *column == entry.column.0 => *end += 1,
                _ => compact.sparse.ends.push((entry.column.0, compact.sparse.rows.len() as u32 + 1)),
            }
            compact.sparse.rows.push(entry.row);
            compact.sparse.values.push(entry.value);
        }
        compact.shrink();
        Ok(compact)
    }

    fn shrink(&mut self) {
        self.left.narrow.values.shrink_to_fit();
        self.left.wide.values.shrink_to_fit();
        self.sparse.rows.shrink_to_fit();
        self.sparse.values.shrink_to_fit();
    }

    /// Number of components.
    pub fn rank(&self) -> usize {
        self.rank
    }

    /// Bytes that its factors take in memory.
    pub fn bytes(&self) -> usize {
        let sparse = &self.sparse;
        let sparse = sparse.ends.len() * 8 + (sparse.rows.len() + sparse.values.len()) * 4;
        self.left.bytes() + self.right.bytes() + sparse
    }

    /// Some of its components as a block of their own. The sparse entries are in the piece that begins at the first
    /// component, so that the pieces of a block add up to it.
    #[cfg(feature = "gpu")]
    pub(crate) fn piece(&self, components: Range<u32>) -> Self {
        let sparse = if components.start == 0 { self.sparse.clone() } else { SparseEntries::default() };
        let (left, right) = (self.left.piece(&components), self.right.piece(&components));
        Self { rank: components.len(), left, right, sparse }
    }

    /// Whether every relit pixel is black.
    pub(crate) fn is_empty(&self) -> bool {
        self.rank == 0 && self.sparse.rows.is_empty()
    }

    /// Rows of one colour channel.
    pub(crate) fn pixels(&self) -> usize {
        self.left.length / CHANNELS
    }
}

/// Takes in all components and says whether they are finite; compiled for the vectors that the machine has. Not a closure:
/// what wraps one is compiled without them.
struct PushFactors<'a> {
    block: &'a FactoredBlock,
    right: Vec<CodedRow>,
    transform: &'a ColumnTransform,
    compact: &'a mut CompactBlock,
}

impl pulp::NullaryFnOnce for PushFactors<'_> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let Self { block, right, transform, compact } = self;
        let mut scales = Vec::with_capacity(compact.rank);
        for k in 0..compact.rank {
            let left = compact.left.push(k as u32, block.left_component(k), block.left_step.get(k).copied());
            let Some(scale) = left else { return false };
            scales.push(scale);
        }
        match RightFactor::new(right, transform, &scales) {
            Some(right) => compact.right = right,
            None => return false,
        }
        true
    }
}

impl SparseEntries {
    /// The entries of the `at`-th column that has any: rows and values.
    pub(crate) fn of(&self, at: usize) -> (&[u32], &[f32]) {
        let begin = if at == 0 { 0 } else { self.ends[at - 1].1 as usize };
        let range = begin..self.ends[at].1 as usize;
        (&self.rows[range.clone()], &self.values[range])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use half::f16;

    #[test]
    fn every_normal_16_bit_float_is_read_exactly() {
        for bits in 0..=u16::MAX {
            let value = f16::from_bits(bits);
            if value.is_normal() || bits & 0x7fff == 0 {
                assert_eq!(Wide(bits).to_f32().to_bits(), value.to_f32().to_bits());
            }
        }
    }

    #[test]
    fn values_are_rounded_to_16_bits_as_the_half_crate_does_it_and_subnormals_to_zero() {
        for bits in (0..0x7000_0000u32).step_by(997) {
            for value in [f32::from_bits(bits), -f32::from_bits(bits)] {
                if value.abs() <= WIDE_PEAK as f32 {
                    let (found, expected) = (f16::from_bits(wide(value, 1.0).0), f16::from_f32(value));
                    // Between the least normal number and zero there is nothing.
                    let flushed = found.to_bits() == 0 && value.abs() < f16::MIN_POSITIVE.to_f32();
                    assert!(found.to_bits() == expected.to_bits() && expected.is_normal() || flushed, "{value:e}");
                }
            }
        }
    }

    #[test]
    fn values_that_are_not_finite_are_refused_wherever_they_stand() {
        for bad in [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for at in 0..70 {
                let mut values = vec![1.0; 70];
                values[at] = bad;
                assert!(Factor::new(70).push(0, &values, Some(1.0)).is_none());
            }
        }
    }

    #[test]
    fn multiples_of_their_step_lose_nothing_in_8_bits() {
        let step = 0.037f32;
        let values: Vec<f32> = (-127..=127).map(|q| q as f32 * step).collect();
        let mut factor = Factor::new(values.len());
        let scale = factor.push(0, &values, Some(step)).unwrap();
        assert!(factor.wide.components.is_empty());
        for (q, v) in factor.narrow.values.iter().zip(&values) {
            assert!((f64::from(*q) * scale - f64::from(*v)).abs() <= 1e-6 * f64::from(v.abs()));
        }
    }

    #[test]
    fn a_step_too_fine_for_8_bits_takes_16() {
        let values: Vec<f32> = (0..300).map(|q| q as f32).collect();
        let mut factor = Factor::new(values.len());
        let scale = factor.push(0, &values, Some(1.0)).unwrap();
        assert!(factor.narrow.components.is_empty());
        for (q, v) in factor.wide.values.iter().zip(&values) {
            // A 16-bit float keeps 11 bits: half a unit of the last place is 2⁻¹¹ of the value at most.
            assert!((f64::from(q.to_f32()) * scale - f64::from(*v)).abs() <= f64::from(*v) / 2048.0);
        }
    }
}
