//! Fixed probabilities of quantised coefficients.
//!
//! A band of coefficients is coded with one *class*, the member of a family of discrete Laplace distributions that
//! codes it best. Class 0 means that the whole band is zero. The following classes are a factor √2 apart in scale. From
//! `FIRST_SHIFTED` on, the lowest `shift` bits of a value are stored as they are, and the rest is coded by one of two
//! tables centred on −½. All tables are computed from the decimal constants below by operations that IEEE 754 rounds
//! alike everywhere, so they are part of the format.

use std::sync::OnceLock;

/// Bits of a probability.
pub(super) const PROBABILITY_BITS: u32 = 11;
/// Sum of the frequencies of a table.
pub(super) const TOTAL: u32 = 1 << PROBABILITY_BITS;
/// Symbols of a table: the values −7 to 7, and the escape.
pub(super) const SYMBOLS: usize = 16;
/// The symbol for values outside −7..=7.
pub(super) const ESCAPE: usize = 15;
/// Largest value that a symbol stands for.
pub(super) const LARGEST: i32 = 7;
/// First class whose low bits are stored as they are.
pub(super) const FIRST_SHIFTED: u32 = 9;
/// Scale of the first class, in steps.
pub(super) const MIN_SCALE: f32 = 0.15;
/// Number of classes.
pub(super) const CLASSES: u32 = 41;
/// Largest magnitude of a quantised value.
pub(super) const MAX_MAGNITUDE: i32 = 1 << 24;

/// Ratio of neighbouring probabilities of each table, `exp(−1/b)`: tables 0 to 7 for b = 0.15 · √2ⁿ, then two for
/// shifted values, with b = 1.2 and 1.7.
const RATIOS: [f64; 10] =
    [0.001_272_6, 0.008_967_7, 0.035_674, 0.094_707, 0.188_876, 0.307_747, 0.434_598, 0.554_749, 0.434_598, 0.554_749];

/// One table: how often each symbol comes, and the symbol of each slot.
pub(super) struct SymbolTable {
    /// Frequency of each symbol; they sum to [`TOTAL`].
    pub(super) frequency: [u16; SYMBOLS],
    /// Sum of the frequencies before each symbol.
    pub(super) start: [u16; SYMBOLS],
    /// Cost of each symbol in bits.
    pub(super) bits: [f32; SYMBOLS],
    /// For each slot: frequency << 16 | (slot − start) << 4 | symbol.
    pub(super) slots: Box<[u32; TOTAL as usize]>,
}

/// Table and shift of a class other than 0.
pub(super) fn coding_of(class: u32) -> (&'static SymbolTable, u32) {
    let tables = tables();
    if class < FIRST_SHIFTED {
        (&tables[class as usize - 1], 0)
    } else {
        (&tables[8 + (class - FIRST_SHIFTED) as usize % 2], 1 + (class - FIRST_SHIFTED) / 2)
    }
}

/// The symbol for a value after its shift.
pub(super) fn symbol_of(high: i32) -> usize {
    if (-LARGEST..=LARGEST).contains(&high) { (high + LARGEST) as usize } else { ESCAPE }
}

/// Bits behind the escape of a value after its shift.
pub(super) fn escape_bits(high: i32) -> u32 {
    let excess = high.unsigned_abs() - LARGEST as u32;
    5 + (31 - excess.leading_zeros()) + 1
}

fn tables() -> &'static [SymbolTable; RATIOS.len()] {
    static TABLES: OnceLock<[SymbolTable; RATIOS.len()]> = OnceLock::new();
    TABLES.get_or_init(|| std::array::from_fn(|i| table(RATIOS[i], i >= 8)))
}

fn table(ratio: f64, shifted: bool) -> SymbolTable {
    // Probabilities up to a common factor, each from the one before by a product.
    let mut weights = [0.0f64; SYMBOLS];
    let centre = LARGEST as usize;
    if shifted {
        // P(h) ∝ ratio^|h + ½|: −1 and 0 are equally likely.
        let mut weight = 1.0 - ratio;
        for n in 0..=centre {
            weights[centre + n] = weight;
            if n < centre {
                weights[centre - 1 - n] = weight;
            }
            weight *= ratio;
        }
        weights[ESCAPE] = 2.0 * weight / (1.0 - ratio);
    } else {
        // The mass of a Laplace density over [n − ½, n + ½].
        let root = ratio.sqrt();
        weights[centre] = 2.0 * (1.0 - root);
        let mut weight = root * (1.0 - ratio);
        for n in 1..=centre {
            weights[centre + n] = weight;
            weights[centre - n] = weight;
            weight *= ratio;
        }
        weights[ESCAPE] = 2.0 * weight / (1.0 - ratio);
    }
    let sum: f64 = weights.iter().sum();
    // Heavier tails than Laplace's: real bands mix scales.
    let floor = 1.0 + f64::from(TOTAL) / 1024.0;
    let free = f64::from(TOTAL) - floor * SYMBOLS as f64;
    let mut frequency = weights.map(|w| (floor + w / sum * free) as u16);
    let rest = TOTAL - frequency.iter().map(|&f| u32::from(f)).sum::<u32>();
    frequency[centre] += rest as u16;
    let mut start = [0; SYMBOLS];
    let mut slots = Box::new([0; TOTAL as usize]);
    let mut at = 0usize;
    for symbol in 0..SYMBOLS {
        start[symbol] = at as u16;
        for offset in 0..usize::from(frequency[symbol]) {
            slots[at] = u32::from(frequency[symbol]) << 16 | (offset as u32) << 4 | symbol as u32;
            at += 1;
        }
    }
    let bits = frequency.map(|f| PROBABILITY_BITS as f32 - f32::from(f).log2());
    SymbolTable { frequency, start, bits, slots }
}
