//! The README's figures against the tables of the runs that made them.

mod studies;
#[path = "../tables/mod.rs"]
mod tables;

use std::fs;
use std::path::Path;

use tables::{Row, read_csv};

fn readme() -> String {
    fs::read_to_string("../../README.md").unwrap()
}

/// The table of a study, as it is published.
fn published(name: &str) -> Vec<Row> {
    read_csv(&Path::new("../../formats/plots").join(name))
}

/// The cells of the README's row that begins so, between its bars.
fn row_of<'a>(readme: &'a str, begin: &str) -> Vec<&'a str> {
    let mut lines = readme.lines().filter(|line| line.starts_with(begin));
    let line = lines.next().unwrap_or_else(|| panic!("no row '{begin}'"));
    assert_eq!(lines.next(), None, "two rows '{begin}'");
    line.trim_matches('|').split('|').map(str::trim).collect()
}

/// A value with so many digits; a dash where there is none.
fn shown(row: &Row, column: &str, digits: usize) -> String {
    match row[column].as_str() {
        "" => "–".to_owned(),
        number => format!("{:.digits$}", number.parse::<f64>().unwrap()),
    }
}
