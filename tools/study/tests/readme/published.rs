//! The tables of published runs, `docs/plots/*.csv`.

use std::fs;
use std::path::{Path, PathBuf};

use super::tables::{Row, read_table};

/// A table as it was published.
pub(crate) struct Csv {
    pub(crate) name: String,
    /// What prints it.
    pub(crate) command: String,
    pub(crate) machine: String,
    /// What its program was built from, where it says so.
    pub(crate) commit: Option<String>,
    /// All lines of notes, without their `# `.
    pub(crate) notes: Vec<String>,
    pub(crate) rows: Vec<Row>,
}

/// The root of the repository.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

impl Csv {
    pub(crate) fn published(name: &str) -> Self {
        let path = root().join("docs/plots").join(name);
        let text = fs::read_to_string(&path).unwrap_or_else(|problem| panic!("{}: {problem}", path.display()));
        let notes: Vec<String> = text.lines().filter_map(|line| line.strip_prefix("# ")).map(str::to_owned).collect();
        let note = |begin: &str| {
            let found = notes.iter().find_map(|note| note.strip_prefix(begin));
            found.unwrap_or_else(|| panic!("{name} has no line '# {begin}…'")).to_owned()
        };
        let command = note("Command: ");
        let command = command.split('`').nth(1).unwrap_or_else(|| panic!("{name}: the command stands in backticks"));
        Self {
            name: name.to_owned(),
            commit: notes
                .iter()
                .find_map(|note| Some(note.strip_prefix("Built from commit ")?.trim_end_matches('.').to_owned())),
            command: command.to_owned(),
            machine: note("Machine: ").trim_end_matches('.').to_owned(),
            rows: read_table(&path),
            notes,
        }
    }

    /// The only row with these cells, if there is one.
    pub(crate) fn maybe(&self, cells: &[(&str, &str)]) -> Option<&Row> {
        let mut found = self.rows.iter().filter(|row| cells.iter().all(|(name, cell)| text(row, name) == *cell));
        let row = found.next();
        assert!(found.next().is_none(), "{}: two rows {cells:?}", self.name);
        row
    }

    /// The only row with these cells.
    pub(crate) fn find(&self, cells: &[(&str, &str)]) -> &Row {
        self.maybe(cells).unwrap_or_else(|| panic!("{}: no row {cells:?}", self.name))
    }

    /// What stands in a column, each once, in the order of the table.
    pub(crate) fn each(&self, column: &str) -> Vec<&str> {
        let mut found = Vec::new();
        for row in &self.rows {
            let cell = text(row, column);
            if !found.contains(&cell) {
                found.push(cell);
            }
        }
        found
    }

    /// Rows of two ways that are the same in other columns: of each of `ours` what is to be compared with it.
    pub(crate) fn pairs(&self, column: &str, ours: &str, theirs: &str, same: &[&str]) -> Vec<(&Row, &Row)> {
        let of = |way: &str| self.rows.iter().filter(|row| text(row, column) == way).collect::<Vec<_>>();
        let others = of(theirs);
        let pairs: Vec<_> = of(ours)
            .into_iter()
            .filter_map(|row| {
                let is_same = |other: &&&Row| same.iter().all(|name| text(row, name) == text(other, name));
                others.iter().find(is_same).map(|other| (row, *other))
            })
            .collect();
        assert!(!pairs.is_empty(), "{}: nothing to compare between '{ours}' and '{theirs}'", self.name);
        pairs
    }

    /// A figure of a benchmark, whose tables have a line for each.
    pub(crate) fn figure(&self, case: &str, figure: &str) -> f64 {
        self.maybe_figure(case, figure).unwrap_or_else(|| panic!("{}: no {figure} of '{case}'", self.name))
    }

    /// A figure of each case that has it.
    pub(crate) fn figures<'a>(&'a self, figure: &str) -> Vec<(&'a str, f64)> {
        let of = |case| Some((case, self.maybe_figure(case, figure)?));
        self.each("case").into_iter().filter_map(of).collect()
    }

    pub(crate) fn maybe_figure(&self, case: &str, figure: &str) -> Option<f64> {
        self.maybe(&[("case", case), ("figure", figure)]).map(|row| number(row, "value"))
    }
}

/// A cell.
pub(crate) fn text<'a>(row: &'a Row, column: &str) -> &'a str {
    row.get(column).unwrap_or_else(|| panic!("no column '{column}' in {row:?}"))
}

/// A cell that is a number, if it is not empty.
pub(crate) fn maybe(row: &Row, column: &str) -> Option<f64> {
    let cell = text(row, column);
    (!cell.is_empty()).then(|| cell.parse().unwrap_or_else(|_| panic!("{column} is no number: '{cell}'")))
}

/// A cell that is a number.
pub(crate) fn number(row: &Row, column: &str) -> f64 {
    maybe(row, column).unwrap_or_else(|| panic!("{column} is empty in {row:?}"))
}

/// A number with so many digits; a dash where there is none.
pub(crate) fn shown(row: &Row, column: &str, digits: usize) -> String {
    dashed(maybe(row, column), digits)
}

/// A number with so many digits; a dash where there is none.
pub(crate) fn dashed(number: Option<f64>, digits: usize) -> String {
    number.map_or("–".to_owned(), |number| format!("{number:.digits$}"))
}
