//! Values of published tables, as marks on the pages ask for them.
//!
//! | part | value |
//! |---|---|
//! | `large.csv[stage=pack; columns=1047].file_bytes` | a column of the rows that match; `~` in place of `=`: of those that contain the text |
//! | `flip` | in a row of a table: that column of the row |
//! | `@[method=raw].flip` | in a row of a table: that column of the rows of its file that match, and agree with it in the columns of `each` |
//! | `[scene=$scene]` | in a row of a table: the row's own scene |
//! | `min(x)`, `max(x)`, `mean(x)`, `size(x)`, `count(x)` | of several values; the last is how many are above 0 |
//!
//! with numbers, `+ - * /` and brackets, value by value. Behind `as` stands a format: `.2` for digits, `,` for thousands, `%0` for
//! per cent with so many digits, `+1` for a signed number, `e1` for a power of ten, `bytes`, `short` for two digits or three. Several values
//! are shown as a span, and a value that is missing as a dash. Without `as` a cell is shown as it stands.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

use super::published::Csv;
use super::tables::Row;

/// What expressions may refer to.
pub(crate) struct Context<'a> {
    pub(crate) tables: &'a BTreeMap<String, Csv>,
    /// The row of a table that is being written: its file, itself, and the columns of `each`.
    pub(crate) row: Option<(&'a str, &'a Row, &'a [&'a str])>,
    /// Files that were asked.
    pub(crate) used: &'a RefCell<BTreeSet<String>>,
}

/// Columns that say what a row is of: values are combined only where these agree.
const KEYS: [&str; 5] = ["scene", "lamp", "room", "scenes", "samples_per_px"];

/// Values, and what each is of.
struct Values {
    numbers: Vec<Option<f64>>,
    keys: Vec<Vec<String>>,
}

impl Values {
    fn one(number: f64) -> Self {
        Self { numbers: vec![Some(number)], keys: Vec::new() }
    }

    fn with(self, other: Self, operation: fn(f64, f64) -> f64) -> Self {
        let (a, b) = (&self.numbers, &other.numbers);
        assert!(a.len() == b.len() || a.len() == 1 || b.len() == 1, "{} and {} values", a.len(), b.len());
        let are_lists = self.keys.len() > 1 && other.keys.len() > 1;
        assert!(!are_lists || self.keys == other.keys, "values of different things: {:?}, {:?}", self.keys, other.keys);
        let at = |values: &[Option<f64>], i: usize| if values.len() == 1 { values[0] } else { values[i] };
        let numbers = (0..a.len().max(b.len())).map(|i| Some(operation(at(a, i)?, at(b, i)?))).collect();
        Self { numbers, keys: if self.keys.len() > 1 { self.keys } else { other.keys } }
    }
}

struct Parser<'a> {
    rest: &'a str,
    context: &'a Context<'a>,
}

impl<'a> Parser<'a> {
    fn takes(&mut self, letter: char) -> bool {
        let stripped = self.rest.trim_start().strip_prefix(letter);
        stripped.map(|rest| self.rest = rest).is_some()
    }

    fn word(&mut self, belongs: fn(char) -> bool) -> &'a str {
        let rest = self.rest.trim_start();
        let (word, rest) = rest.split_at(rest.find(|c| !belongs(c)).unwrap_or(rest.len()));
        self.rest = rest;
        word
    }

    fn sum(&mut self) -> Values {
        let mut sum = self.product();
        loop {
            if self.takes('+') {
                sum = sum.with(self.product(), |a, b| a + b);
            } else if self.takes('-') {
                sum = sum.with(self.product(), |a, b| a - b);
            } else {
                return sum;
            }
        }
    }

    fn product(&mut self) -> Values {
        let mut product = self.atom();
        loop {
            if self.takes('*') {
                product = product.with(self.atom(), |a, b| a * b);
            } else if self.takes('/') {
                product = product.with(self.atom(), |a, b| a / b);
            } else {
                return product;
            }
        }
    }

    fn in_brackets(&mut self) -> Values {
        let inside = self.sum();
        assert!(self.takes(')'), "a bracket is open before '{}'", self.rest);
        inside
    }

    fn atom(&mut self) -> Values {
        if self.takes('(') {
            return self.in_brackets();
        }
        if self.rest.trim_start().starts_with(|c: char| c.is_ascii_digit()) {
            let number = self.word(|c| c.is_ascii_alphanumeric() || c == '.');
            return Values::one(number.parse().unwrap_or_else(|_| panic!("'{number}' is no number")));
        }
        let before = self.rest;
        let name = self.word(|c| c.is_ascii_alphabetic());
        if !self.takes('(') {
            self.rest = before;
            let (rows, column) = self.column();
            let cells = rows.iter().map(|row| (number(row, &column), keys(row)));
            let (numbers, keys) = cells.unzip();
            return Values { numbers, keys };
        }
        let known: Vec<f64> = self.in_brackets().numbers.into_iter().flatten().collect();
        assert!(!known.is_empty(), "{name} of nothing");
        Values::one(match name {
            "min" => known.iter().copied().fold(f64::INFINITY, f64::min),
            "max" => known.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            "mean" => known.iter().sum::<f64>() / known.len() as f64,
            "median" => {
                let mut sorted = known.clone();
                sorted.sort_by(f64::total_cmp);
                0.5 * (sorted[(sorted.len() - 1) / 2] + sorted[sorted.len() / 2])
            }
            "size" => known.len() as f64,
            "count" => known.iter().filter(|value| **value > 0.0).count() as f64,
            _ => panic!("'{name}' is no function"),
        })
    }

    /// The rows and the column of a reference.
    fn column(&mut self) -> (Vec<&'a Row>, String) {
        let of_letters = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let own = self.context.row;
        let is_sibling = self.takes('@');
        let name = if is_sibling { "" } else { self.word(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-') };
        if !is_sibling && !self.rest.starts_with(".csv") {
            let (_, row, _) = own.unwrap_or_else(|| panic!("'{name}' stands in no row"));
            return (vec![row], name.to_owned());
        }
        let file = if is_sibling {
            own.expect("'@' stands in a row").0.to_owned()
        } else {
            self.rest = &self.rest[".csv".len()..];
            format!("{name}.csv")
        };
        let mut conditions = "";
        if let Some(rest) = self.rest.strip_prefix('[') {
            (conditions, self.rest) = rest.split_once(']').expect("a closing bracket");
        }
        assert!(self.takes('.'), "no column before '{}'", self.rest);
        let column = self.word(of_letters);
        let keys = if is_sibling { own.map_or(&[] as &[&str], |(.., each)| each) } else { &[] };
        let is_like_own = |row: &&Row| own.is_none_or(|(_, own, _)| keys.iter().all(|key| row[*key] == own[*key]));
        let rows: Vec<&Row> = self.context.rows(&file, conditions).into_iter().filter(is_like_own).collect();
        assert!(!rows.is_empty(), "{file} has no row [{conditions}]");
        assert!(rows.iter().any(|row| row.contains_key(column)), "{file}[{conditions}] has no column {column}");
        (rows, column.to_owned())
    }
}

fn number(row: &Row, column: &str) -> Option<f64> {
    let cell = row.get(column).filter(|cell| !cell.is_empty())?;
    Some(cell.parse().unwrap_or_else(|_| panic!("{column} is no number: '{cell}'")))
}

fn keys(row: &Row) -> Vec<String> {
    KEYS.iter().filter_map(|key| row.get(*key).cloned()).collect()
}

impl<'a> Context<'a> {
    /// The rows of a file that fulfil conditions.
    pub(crate) fn rows(&self, file: &str, conditions: &str) -> Vec<&'a Row> {
        self.used.borrow_mut().insert(file.to_owned());
        let table = self.tables.get(file).unwrap_or_else(|| panic!("{file} is not published"));
        let conditions: Vec<&str> = conditions.split(';').map(str::trim).filter(|c| !c.is_empty()).collect();
        let fulfils = |row: &&Row| {
            conditions.iter().all(|condition| {
                let (column, wanted) = condition.split_once(['=', '~']).unwrap_or_else(|| panic!("'{condition}'"));
                let own = |column: &str| self.row.expect("'$' stands in a row").1[column].as_str();
                let wanted = wanted.strip_prefix('$').map_or(wanted, own);
                let cell = row.get(column).unwrap_or_else(|| panic!("{file} has no column {column}"));
                if condition[column.len()..].starts_with('~') { cell.contains(wanted) } else { cell == wanted }
            })
        };
        table.rows.iter().filter(fulfils).collect()
    }

    /// What an expression with its format shows.
    pub(crate) fn shown(&self, expression: &str) -> String {
        let (value, format) = expression.rsplit_once(" as ").unwrap_or((expression, ""));
        let mut parser = Parser { rest: value, context: self };
        if format.is_empty() || format == "judged" {
            let (rows, column) = parser.column();
            let [row] = rows[..] else { panic!("{} rows of '{value}'", rows.len()) };
            // A scene's name, in bold where it took no part in choosing constants.
            let is_bold = format == "judged" && row["tuned_on"] == "no";
            return if is_bold { format!("**{}**", row[&column]) } else { row[&column].clone() };
        }
        let values = parser.sum();
        assert!(parser.rest.trim().is_empty(), "'{}' is too much in '{value}'", parser.rest);
        span(values.numbers.into_iter().flatten(), format.trim())
    }

    /// Text with what stands in braces replaced by what it shows.
    pub(crate) fn filled(&self, template: &str) -> String {
        let mut parts = template.split('{');
        let mut text = parts.next().unwrap_or_default().to_owned();
        for part in parts {
            let (expression, rest) = part.split_once('}').unwrap_or_else(|| panic!("a brace is open in '{part}'"));
            text += &self.shown(expression);
            text += rest;
        }
        text.replace("– / –", "–")
    }
}

/// One number, or the least and the largest of several.
fn span(values: impl Iterator<Item = f64>, format: &str) -> String {
    let values: Vec<f64> = values.collect();
    let low = values.iter().copied().reduce(f64::min).map(|low| formatted(low, format));
    let high = values.iter().copied().reduce(f64::max).map(|high| formatted(high, format));
    match (low, high) {
        (Some(low), Some(high)) if low == high => low,
        (Some(low), Some(high)) => format!("{low} to {high}"),
        _ => "–".to_owned(),
    }
}

fn formatted(value: f64, format: &str) -> String {
    let digits = || format[1..].parse::<usize>().unwrap_or_else(|_| panic!("'{format}' is no format"));
    match (format, format.chars().next().unwrap_or_default()) {
        ("bytes", _) => bytes(value),
        ("short", _) => rounded(value, if value >= 9.95 { 0 } else { 1 + usize::from(value < 0.095) }),
        (",", _) => thousands(value),
        (_, '.') => rounded(value, digits()),
        (_, '%') => rounded(100.0 * value, digits()),
        (_, 'e') => format!("{value:.*e}", digits()),
        (_, '+') => {
            let told = rounded(value, digits());
            if value > 0.0 && told.contains(|c: char| ('1'..='9').contains(&c)) { format!("+{told}") } else { told }
        }
        _ => panic!("'{format}' is no format"),
    }
}

/// A number with so many digits, where what is shown as zero has no sign.
fn rounded(value: f64, digits: usize) -> String {
    let told = format!("{value:.digits$}");
    let is_zero = told.chars().all(|c| matches!(c, '-' | '0' | '.'));
    if is_zero { told.trim_start_matches('-').to_owned() } else { told }
}

/// `1,047`.
fn thousands(value: f64) -> String {
    let told = rounded(value, 0);
    let digits = told.trim_start_matches('-');
    let groups: Vec<&str> = digits.as_bytes().rchunks(3).rev().map(|group| str::from_utf8(group).unwrap()).collect();
    format!("{}{}", &told[..told.len() - digits.len()], groups.join(","))
}

/// Bytes in the unit that shows them with two digits or three; a dash for none.
fn bytes(bytes: f64) -> String {
    if bytes == 0.0 {
        return "–".to_owned();
    }
    let units = [(1024f64.powi(3), "GiB"), (1024f64.powi(2), "MiB"), (1024.0, "KiB"), (1.0, "B")];
    let (unit, name) = units.into_iter().find(|(unit, _)| bytes >= *unit).unwrap_or((1.0, "B"));
    let value = bytes / unit;
    let digits = usize::from(value < 10.0 && unit > 1.0);
    format!("{value:.digits$} {name}")
}

#[test]
fn numbers_are_shown_in_their_formats() {
    let shown = |value: f64, format: &str| span([value].into_iter(), format);
    assert_eq!([shown(2_359_296.0, ","), shown(-1234.0, ",")], ["2,359,296", "-1,234"]);
    assert_eq!([1e3, 5e5, 9.88e9].map(|value| shown(value, "bytes")), ["1000 B", "488 KiB", "9.2 GiB"]);
    assert_eq!(
        [shown(-0.04, ".1"), shown(0.04, "+1"), shown(1.26, "+1"), shown(-1.26, "+1")],
        ["0.0", "0.0", "+1.3", "-1.3"]
    );
    assert_eq!(
        [shown(0.173, "%0"), shown(62.3, "short"), shown(2.64, "short"), shown(0.02, "short")],
        ["17", "62", "2.6", "0.02"]
    );
    assert_eq!(
        [span([2.2, 38.4].into_iter(), ".0"), span([2.2, 2.4].into_iter(), ".0"), span([].into_iter(), ".0")],
        ["2 to 38", "2", "–"]
    );
}

#[test]
fn expressions_are_of_the_rows_that_they_name() {
    let row = |cells: &[(&str, &str)]| cells.iter().map(|(n, c)| ((*n).to_owned(), (*c).to_owned())).collect::<Row>();
    let rows: Vec<Row> = [("a", "ours", "1"), ("a", "raw", "3"), ("b", "ours", "2"), ("b", "raw", "")]
        .iter()
        .map(|(scene, way, error)| row(&[("scene", scene), ("way", way), ("error", error)]))
        .collect();
    let own = rows[2].clone();
    let csv = Csv { command: String::new(), machine: String::new(), commit: None, rows };
    let (tables, used) = ([("x-1.csv".to_owned(), csv)].into(), RefCell::default());
    let context = Context { tables: &tables, row: Some(("x-1.csv", &own, &["scene"])), used: &used };
    assert_eq!(context.filled("{scene}: {error as .0} / {@[way=raw].error as .0}"), "b: 2 / –");
    assert_eq!(context.shown("x-1.csv[way=ours].error as .0"), "1 to 2");
    assert_eq!(context.shown("x-1.csv[scene=a; way~ra].error / x-1.csv[scene=a; way=ours].error as .1"), "3.0");
    assert_eq!(context.shown("count(x-1.csv[way=raw].error - x-1.csv[way=ours].error) as .0"), "1");
    assert_eq!(context.shown("2 * (max(x-1.csv[scene=$scene].error) - 1) as .0"), "2");
}
