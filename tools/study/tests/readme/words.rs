//! Numbers and comparisons in words.

use super::published::{dashed, maybe, number, text};
use super::tables::Row;

/// `a, b and c`.
pub(crate) fn list<T: AsRef<str>>(items: &[T]) -> String {
    match items {
        [] => "none".to_owned(),
        [one] => one.as_ref().to_owned(),
        [first @ .., last] => {
            let first: Vec<&str> = first.iter().map(AsRef::as_ref).collect();
            format!("{} and {}", first.join(", "), last.as_ref())
        }
    }
}

/// `1,047`.
pub(crate) fn thousands(number: f64) -> String {
    let plain = format!("{number:.0}");
    let (sign, digits) = plain.strip_prefix('-').map_or(("", plain.as_str()), |digits| ("-", digits));
    let mut grouped = String::from(sign);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            grouped.push(',');
        }
        grouped.push(digit);
    }
    grouped
}

/// Bytes in the unit that shows them with two digits or three.
pub(crate) fn bytes(bytes: f64) -> String {
    let (unit, name) = [(1024f64.powi(3), "GiB"), (1024f64.powi(2), "MiB"), (1024.0, "KiB")]
        .into_iter()
        .find(|(unit, _)| bytes >= *unit)
        .unwrap_or((1.0, "B"));
    let value = bytes / unit;
    let digits = usize::from(value < 10.0 && unit > 1.0);
    format!("{value:.digits$} {name}")
}

/// A number with so many digits, where what is shown as zero has no sign.
pub(crate) fn rounded(value: f64, digits: usize) -> String {
    let told = format!("{value:.digits$}");
    if told.trim_start_matches('-').chars().all(|c| c == '0' || c == '.') {
        told.trim_start_matches('-').to_owned()
    } else {
        told
    }
}

/// A change in decibels, with its sign.
pub(crate) fn signed(value: f64) -> String {
    let told = rounded(value, 1);
    if value > 0.0 && told != "0.0" { format!("+{told}") } else { told }
}

/// `2 to 38`, or one number where both are shown alike.
pub(crate) fn span(values: impl IntoIterator<Item = f64>, digits: usize) -> String {
    let bounds = values.into_iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)]);
    assert!(bounds[0].is_finite() && bounds[1].is_finite(), "nothing to span: {bounds:?}");
    match bounds.map(|bound| rounded(bound, digits)) {
        [low, high] if low == high => low,
        [low, high] => format!("{low} to {high}"),
    }
}

/// What is compared, and how a difference is told.
#[derive(Clone, Copy)]
pub(crate) struct Measure {
    pub(crate) column: &'static str,
    pub(crate) name: &'static str,
    /// Larger is better, and differences are told in decibels; else smaller is, and they are told in per cent.
    pub(crate) in_decibels: bool,
}

pub(crate) const FLIP: Measure = Measure { column: "flip", name: "ꟻLIP", in_decibels: false };
pub(crate) const FLIP_WORST: Measure =
    Measure { column: "flip_worst", name: "ꟻLIP under the worst lighting", in_decibels: false };
pub(crate) const CLIP: Measure = Measure { column: "psnr_clip_db", name: "clip", in_decibels: true };
pub(crate) const CLIP_WORST: Measure =
    Measure { column: "psnr_clip_worst_db", name: "clip under the worst lighting", in_decibels: true };
pub(crate) const LIN: Measure = Measure { column: "psnr_lin_db", name: "lin", in_decibels: true };
pub(crate) const LIN_WORST: Measure =
    Measure { column: "psnr_lin_worst_db", name: "lin under the worst lighting", in_decibels: true };
pub(crate) const RELATIVE: Measure = Measure { column: "relative_l2", name: "relative L2", in_decibels: false };

impl Measure {
    /// By how much ours is better, in decibels or per cent of theirs; none where one of them is missing.
    pub(crate) fn lead(&self, ours: &Row, theirs: &Row) -> Option<f64> {
        let (ours, theirs) = (maybe(ours, self.column)?, maybe(theirs, self.column)?);
        Some(if self.in_decibels { ours - theirs } else { 100.0 * (1.0 - ours / theirs) })
    }

    /// A difference in words, whatever its sign.
    pub(crate) fn told(&self, lead: f64) -> String {
        let (size, unit) = (lead.abs(), if self.in_decibels { "dB" } else { "%" });
        if size < 0.05 {
            return format!("less than 0.1 {unit}");
        }
        let digits = usize::from(self.in_decibels || size < 0.95);
        format!("{size:.digits$} {unit}")
    }
}

/// `in ꟻLIP 9 of 9, by 25 % in the mean and 38 % at most`: where ours is better, and by how much.
pub(crate) fn wins(pairs: &[(&Row, &Row)], measure: Measure) -> String {
    let leads: Vec<f64> = pairs.iter().filter_map(|(ours, theirs)| measure.lead(ours, theirs)).collect();
    let won: Vec<f64> = leads.iter().copied().filter(|lead| *lead > 0.0).collect();
    let (mean, most) = (leads.iter().sum::<f64>() / leads.len() as f64, won.iter().copied().fold(0.0, f64::max));
    let told = format!("in {} {} of {}", measure.name, won.len(), leads.len());
    let [mean_told, most_told] = [mean, most].map(|lead| measure.told(lead));
    match (mean < 0.0, won.is_empty()) {
        (false, _) => format!("{told}, by {mean_told} in the mean and {most_told} at most"),
        (true, false) => format!("{told}, by {most_told} at most, but farther by {mean_told} in the mean of all"),
        (true, true) => format!("{told}, farther by {mean_told} in the mean"),
    }
}

/// Where theirs is better, and by how much: `` `mixed`, 16 samples (clip by 0.3 dB) ``. Rows of theirs have the names.
pub(crate) fn losses(pairs: &[(&Row, &Row)], measures: &[Measure], name: fn(&Row) -> String) -> Vec<String> {
    let lost = |&(ours, theirs): &(&Row, &Row)| {
        let of = |measure: &Measure| {
            let lead = measure.lead(ours, theirs)?;
            (lead < 0.0).then(|| format!("{} by {}", measure.name, measure.told(lead)))
        };
        let lost: Vec<String> = measures.iter().filter_map(of).collect();
        (!lost.is_empty()).then(|| format!("{} ({})", name(theirs), lost.join(", ")))
    };
    pairs.iter().filter_map(lost).collect()
}

/// A sentence that begins so and lists something; or that there is nothing.
pub(crate) fn listed(begin: &str, items: &[String]) -> String {
    match items {
        [] => format!("{begin}: nowhere in this table."),
        items => format!("{begin}: {}.", items.join("; ")),
    }
}

/// A scene and its samples.
pub(crate) fn scene_samples(row: &Row) -> String {
    format!("`{}`, {} samples", text(row, "scene"), text(row, "samples_per_px"))
}

/// `0.064 / 31.1`, or a dash where there is no first number.
pub(crate) fn two(row: &Row, (a, a_digits): (&str, usize), (b, b_digits): (&str, usize)) -> String {
    match (dashed(maybe(row, a), a_digits), dashed(maybe(row, b), b_digits)) {
        (a, b) if a == "–" && b == "–" => a,
        (a, b) => format!("{a} / {b}"),
    }
}

/// ꟻLIP / clip.
pub(crate) fn flip_clip(row: &Row) -> String {
    two(row, ("flip", 3), ("psnr_clip_db", 1))
}

/// A scene's name, in bold where it took no part in choosing constants.
pub(crate) fn judging_in_bold(row: &Row) -> String {
    let scene = text(row, "scene");
    if text(row, "tuned_on") == "yes" { scene.to_owned() } else { format!("**{scene}**") }
}

/// `147,456 × 256`.
pub(crate) fn shape(row: &Row) -> String {
    format!("{} × {}", thousands(number(row, "rows")), thousands(number(row, "columns")))
}

/// A head, or a row, of cells that are known.
pub(crate) fn cells(cells: &[&str]) -> Vec<String> {
    cells.iter().map(|cell| (*cell).to_owned()).collect()
}

/// The rows of a table with these cells.
pub(crate) fn only<'a>(pairs: &[(&'a Row, &'a Row)], column: &str, cell: &str) -> Vec<(&'a Row, &'a Row)> {
    pairs.iter().copied().filter(|(ours, _)| text(ours, column) == cell).collect()
}

/// Ratio of a figure in one row to that in another.
pub(crate) fn ratio(a: &Row, b: &Row, column: &str) -> f64 {
    number(a, column) / number(b, column)
}

#[test]
fn words_are_told_as_they_should_be() {
    assert_eq!(thousands(2_359_296.0), "2,359,296");
    assert_eq!([1e3, 5e5, 9.88e9].map(bytes), ["1000 B", "488 KiB", "9.2 GiB"]);
    assert_eq!([rounded(-0.04, 1), signed(0.04), signed(1.26), signed(-1.26)], ["0.0", "0.0", "+1.3", "-1.3"]);
    assert_eq!((span([2.2, 38.4], 0), span([2.2, 2.4], 0)), ("2 to 38".to_owned(), "2".to_owned()));
    let row = |flip: &str| [("flip".to_owned(), flip.to_owned()), ("scene".to_owned(), "x".to_owned())].into();
    let (a, b): (Row, Row) = (row("0.1"), row("0.2"));
    let pairs = [(&a, &b), (&b, &a)];
    assert_eq!(wins(&pairs, FLIP), "in ꟻLIP 1 of 2, by 50 % at most, but farther by 25 % in the mean of all");
    assert_eq!(losses(&pairs, &[FLIP], |row| row["scene"].clone()), ["x (ꟻLIP by 100 %)"]);
    assert_eq!(list(&["a", "b", "c"]), "a, b and c");
}
