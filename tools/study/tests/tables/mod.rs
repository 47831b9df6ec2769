//! The tables that studies write.

use std::collections::HashMap;
use std::fs;
use std::path::Path;

/// A row of a CSV file by column names.
pub(crate) type Row = HashMap<String, String>;

/// Reads a CSV file of a study: notes, a header, and rows of as many cells.
pub(crate) fn read_csv(path: &Path) -> Vec<Row> {
    let text = fs::read_to_string(path).unwrap();
    assert!(text.starts_with("# ") && text.contains("# Command: `ltm study ") && text.contains("# Machine: "));
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let rows: Vec<Row> = lines
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            assert_eq!(cells.len(), names.len(), "{}: {line}", path.display());
            names.iter().zip(cells).map(|(n, c)| ((*n).to_owned(), c.to_owned())).collect()
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
