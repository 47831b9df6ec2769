//! The tables of published runs, `docs/plots/*.csv`.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use super::tables::{Row, read_table};

/// A table as it was published.
pub(crate) struct Csv {
    /// What prints it.
    pub(crate) command: String,
    pub(crate) machine: String,
    /// What its program was built from, where it says so.
    pub(crate) commit: Option<String>,
    /// One row for each case in the tables of benchmarks, whose figures are then columns.
    pub(crate) rows: Vec<Row>,
}

/// The root of the repository.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// All published tables by the names of their files.
pub(crate) fn all() -> BTreeMap<String, Csv> {
    let files = fs::read_dir(root().join("docs/plots")).unwrap().map(|entry| entry.unwrap().path());
    let tables = files.filter(|path| path.extension().is_some_and(|e| e == "csv"));
    tables.map(|path| (path.file_name().unwrap().to_string_lossy().into_owned(), read(&path))).collect()
}

fn read(path: &Path) -> Csv {
    let text = fs::read_to_string(path).unwrap();
    let note = |begin: &str| text.lines().find_map(|line| line.strip_prefix("# ")?.strip_prefix(begin));
    let command = note("Command: ").and_then(|command| command.split('`').nth(1));
    let rows = read_table(path);
    Csv {
        command: command.unwrap_or_else(|| panic!("{}: no command in backticks", path.display())).to_owned(),
        machine: note("Machine: ").unwrap().trim_end_matches('.').to_owned(),
        commit: note("Built from commit ").map(|commit| commit.trim_end_matches('.').to_owned()),
        rows: if rows[0].contains_key("figure") { by_case(&rows) } else { rows },
    }
}

/// Rows of `case, figure, value` as one row for each case.
fn by_case(rows: &[Row]) -> Vec<Row> {
    let mut cases: Vec<Row> = Vec::new();
    for row in rows {
        let (figure, value) = (row["figure"].clone(), row["value"].clone());
        match cases.iter_mut().find(|case| case["case"] == row["case"]) {
            Some(case) => drop(case.insert(figure, value)),
            None => cases.push([("case".to_owned(), row["case"].clone()), (figure, value)].into()),
        }
    }
    cases
}
