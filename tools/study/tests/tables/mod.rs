//! The tables that studies write.

use std::collections::HashMap;
use std::fs;
use std::path::Path;

/// A row of a CSV file by column names.
pub(crate) type Row = HashMap<String, String>;

/// Reads a CSV file as studies and benchmarks write them: notes, a header, and rows of as many cells.
pub(crate) fn read_table(path: &Path) -> Vec<Row> {
    let text = fs::read_to_string(path).unwrap();
    assert!(text.starts_with("# ") && text.contains("# Command: `") && text.contains("# Machine: "));
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let rows: Vec<Row> = lines
        .map(|line| {
            let cells = cells(line);
            assert_eq!(cells.len(), names.len(), "{}: {line}", path.display());
            names.iter().zip(cells).map(|(n, c)| ((*n).to_owned(), c)).collect()
        })
        .collect();
    assert!(!rows.is_empty(), "{} has no rows", path.display());
    for row in &rows {
        for (name, cell) in row {
            let unit = ["_db", "_secs", "_bytes", "_l2", "rows", "columns", "_px"].iter().any(|u| name.ends_with(u));
            assert!(!unit || cell.is_empty() || cell.parse::<f64>().is_ok_and(f64::is_finite), "{name}: {cell}");
        }
    }
    rows
}

/// The cells of a line; one with a comma stands in quotes.
fn cells(line: &str) -> Vec<String> {
    let (mut cells, mut quoted) = (vec![String::new()], false);
    for letter in line.chars() {
        match letter {
            '"' => quoted = !quoted,
            ',' if !quoted => cells.push(String::new()),
            _ => cells.last_mut().expect("one at least").push(letter),
        }
    }
    cells
}
