//! Tables of results: as CSV for programs, as Markdown for people.

use std::fmt::Write;

use ltm::files::csv_field;

/// One value.
#[derive(Clone, Debug)]
pub(super) enum Cell {
    Text(String),
    Number(f64),
    /// Not measured, or not to be had.
    Missing,
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<bool> for Cell {
    fn from(is_so: bool) -> Self {
        Self::from(if is_so { "yes" } else { "no" })
    }
}

impl From<f64> for Cell {
    fn from(number: f64) -> Self {
        if number.is_finite() { Self::Number(number) } else { Self::Missing }
    }
}

impl From<u64> for Cell {
    fn from(number: u64) -> Self {
        Self::Number(number as f64)
    }
}

impl From<usize> for Cell {
    fn from(number: usize) -> Self {
        Self::Number(number as f64)
    }
}

impl From<u32> for Cell {
    fn from(number: u32) -> Self {
        Self::Number(f64::from(number))
    }
}

impl From<Option<f64>> for Cell {
    fn from(number: Option<f64>) -> Self {
        number.map_or(Self::Missing, Self::from)
    }
}

/// A table with what it was made by.
#[derive(Clone, Debug)]
pub(super) struct Table {
    title: String,
    /// Command, machine, metrics: one line each.
    notes: Vec<String>,
    /// Name (unit last) and digits after the point.
    columns: Vec<(&'static str, usize)>,
    rows: Vec<Vec<Cell>>,
}

impl Table {
    pub(super) fn new(title: impl Into<String>, notes: Vec<String>, columns: &[(&'static str, usize)]) -> Self {
        Self { title: title.into(), notes, columns: columns.to_vec(), rows: Vec::new() }
    }

    /// Panics if the row has another number of cells than there are columns.
    pub(super) fn push(&mut self, row: Vec<Cell>) {
        assert_eq!(row.len(), self.columns.len(), "{}", self.title);
        self.rows.push(row);
    }

    /// `#` lines with the notes, then a header, then a line for each row; full precision, missing values empty.
    pub(super) fn to_csv(&self) -> String {
        let mut text = format!("# {}\n", self.title);
        self.notes.iter().for_each(|note| text += &format!("# {note}\n"));
        let names: Vec<&str> = self.columns.iter().map(|c| c.0).collect();
        text += &names.join(",");
        text.push('\n');
        for row in &self.rows {
            let cells: Vec<String> = row
                .iter()
                .map(|cell| match cell {
                    Cell::Text(text) => csv_field(text).into_owned(),
                    Cell::Number(number) => format!("{number}"),
                    Cell::Missing => String::new(),
                })
                .collect();
            text += &cells.join(",");
            text.push('\n');
        }
        text
    }

    pub(super) fn to_markdown(&self) -> String {
        let mut text = format!("### {}\n\n", self.title);
        self.notes.iter().for_each(|note| text += &format!("{note}  \n"));
        let names: Vec<String> = self.columns.iter().map(|c| c.0.replace('_', " ")).collect();
        let _ = writeln!(text, "\n| {} |\n|{}", names.join(" | "), "---|".repeat(names.len()));
        for row in &self.rows {
            let cells: Vec<String> = row
                .iter()
                .zip(&self.columns)
                .map(|(cell, (_, digits))| match cell {
                    Cell::Text(text) => text.clone(),
                    Cell::Number(number) => rounded(*number, *digits),
                    Cell::Missing => "–".to_owned(),
                })
                .collect();
            let _ = writeln!(text, "| {} |", cells.join(" | "));
        }
        text
    }
}

/// A number with so many digits after the point; tiny ones with two significant digits.
fn rounded(number: f64, digits: usize) -> String {
    let least = 0.5 * 10f64.powi(-(digits as i32));
    if digits > 0 && number != 0.0 && number.abs() < least {
        format!("{number:.1e}")
    } else {
        format!("{number:.digits$}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_read_back_as_they_were_written() {
        let mut table = Table::new("t", vec!["command: x".into()], &[("name", 0), ("value_db", 1)]);
        table.push(vec!["a, b".into(), 1.25.into()]);
        table.push(vec!["c".into(), f64::INFINITY.into()]);
        assert_eq!(table.to_csv(), "# t\n# command: x\nname,value_db\n\"a, b\",1.25\nc,\n");
        assert!(table.to_markdown().contains("| name | value db |\n|---|---|\n| a, b | 1.2 |\n| c | – |"));
        assert_eq!(rounded(0.00001, 3), "1.0e-5");
    }
}
