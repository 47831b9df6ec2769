//! Floats as text: the shortest decimal that reads back as the same number, always with a point or an exponent. Files and
//! identities hold it, so that it never changes.

use std::fmt::{Display, LowerExp};

/// The text of an f32.
pub(crate) fn of_f32(value: f32) -> String {
    let size = value.abs();
    text(value, size == 0.0 || (1e-4..1e16).contains(&size))
}

/// The text of an f64.
pub(crate) fn of_f64(value: f64) -> String {
    let size = value.abs();
    text(value, size == 0.0 || (1e-4..1e16).contains(&size))
}

/// The texts of several, as a list.
pub(crate) fn list<T>(values: impl IntoIterator<Item = T>, text: fn(T) -> String) -> String {
    format!("[{}]", values.into_iter().map(text).collect::<Vec<_>>().join(", "))
}

fn text(value: impl Display + LowerExp, is_plain: bool) -> String {
    if !is_plain {
        return format!("{value:e}");
    }
    let mut text = value.to_string();
    if !text.contains('.') {
        text += ".0";
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    /// The texts that stand in files of all versions were made by `{:?}` of the standard library.
    #[test]
    fn numbers_are_written_as_in_all_files_before() {
        let known = [0.0f32, -0.0, 1.0, -1.5, 1e-4, 9.999e-5, 1e16, 9.9e15, 1e-45, f32::MAX, f32::NAN, f32::INFINITY];
        let texts = known.map(of_f32);
        let wanted = ["0.0", "-0.0", "1.0", "-1.5", "0.0001", "9.999e-5", "1e16"];
        assert_eq!(texts[..7], wanted);
        let mut random = Pcg64Mcg::seed_from_u64(1);
        for value in known.into_iter().chain((0..100_000).map(|_| f32::from_bits(random.random()))) {
            assert_eq!(of_f32(value), format!("{value:?}"));
            assert_eq!(of_f64(value.into()), format!("{:?}", f64::from(value)));
        }
        for value in (0..100_000).map(|_| f64::from_bits(random.random())).chain([1e-4, 1e16, 0.1 + 0.2]) {
            assert_eq!(of_f64(value), format!("{value:?}"));
        }
        assert_eq!(list([1.0, 0.25], of_f32), format!("{:?}", [1.0, 0.25]));
    }
}
