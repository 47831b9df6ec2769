//! The figures on the pages against the tables of the runs that made them.
//!
//! Marks in the pages say where figures come from, and the test compares; with `LTM_UPDATE_FIGURES=1` it writes them instead.
//!
//! - `<!--fig EXPRESSION as FORMAT-->531 MiB<!--/fig-->` is a number in prose. It begins no line, for Markdown takes that for HTML.
//! - `<!--table`, the cells of the head, a line for each kind of row, `-->`, the table with its sources, `<!--/table-->`. A line is
//!   `FILE.csv[CONDITIONS] each COLUMNS => CELL | CELL` for a row of each that the file has of these columns, or `=> CELL | CELL`; what
//!   stands in braces in a cell is filled in.
//! - `<!--lines FILE.csv until TEXT-->`, `<!--/lines-->`: the printed lines of a run before the one that begins so.
//!
//! `expression` says what an expression is.

mod expression;
mod published;
#[path = "../tables/mod.rs"]
mod tables;

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use expression::Context;
use ltm_study::Study;
use published::{Csv, root};

/// All pages with figures.
const PAGES: [&str; 6] = [
    "README.md",
    "docs/figures.md",
    "docs/growth.md",
    "docs/limits.md",
    "docs/guide/worked-example.md",
    "tools/blender/README.md",
];

/// Letters in a line that names sources.
const WIDTH: usize = 140;

struct Page<'a> {
    name: &'a str,
    tables: &'a BTreeMap<String, Csv>,
    /// Files that the page shows.
    shown: BTreeSet<String>,
}

impl Page<'_> {
    /// Its text as it should be.
    fn renewed(&mut self, text: &str) -> String {
        let (mut done, mut rest) = (String::new(), text);
        while let Some(at) = rest.find("<!--").filter(|_| !rest.is_empty()) {
            let (before, mark) = rest.split_at(at);
            done += before;
            let end = mark.find("-->").unwrap_or_else(|| panic!("{}: a comment is open", self.name)) + "-->".len();
            let (mark, after) = mark.split_at(end);
            done += mark;
            rest = after;
            let inside = mark.trim_start_matches("<!--").trim_end_matches("-->");
            let kind = inside.split_whitespace().next().unwrap_or_default();
            let told = inside.strip_prefix(kind).unwrap_or_default().trim();
            let fresh = match kind {
                "fig" => self.figure(told, done.lines().last().unwrap_or_default()),
                "table" => self.table(told),
                "lines" => self.lines(told),
                _ => continue,
            };
            let closing = format!("<!--/{kind}-->");
            let until = rest.find(&closing).unwrap_or_else(|| panic!("{}: '{mark}' is not closed", self.name));
            done += &fresh;
            rest = &rest[until..];
        }
        done + rest
    }

    fn context<'b>(&'b self, used: &'b RefCell<BTreeSet<String>>) -> Context<'b> {
        Context { tables: self.tables, row: None, used }
    }

    fn figure(&self, expression: &str, line: &str) -> String {
        let before = line.split("<!--fig").next().unwrap_or_default().trim_start_matches([' ', '-', '*']);
        assert!(!before.is_empty(), "{}: '{expression}' begins a line", self.name);
        assert!(!expression.contains("--"), "{}: '--' ends a comment: '{expression}'", self.name);
        self.context(&RefCell::default()).shown(expression)
    }

    fn table(&mut self, told: &str) -> String {
        let used = RefCell::default();
        let mut lines = told.lines();
        let mut rows = vec![lines.next().expect("a head").to_owned()];
        for line in lines {
            rows.extend(self.rows(line, &used));
        }
        let width = rows[0].split(" | ").count();
        rows.iter().for_each(|row| assert_eq!(row.split(" | ").count(), width, "{}: {row}", self.name));
        assert!(rows.len() > 1, "{}: no rows of '{told}'", self.name);
        rows.insert(1, vec!["---"; width].join("|"));
        rows[1] = format!("|{}|", rows[1]);
        let table: Vec<String> =
            rows.iter().enumerate().map(|(i, row)| if i == 1 { row.clone() } else { format!("| {row} |") }).collect();
        let sources = wrapped(&format!("Measured by {}.", self.sources(&used.borrow())));
        self.shown.extend(used.take());
        format!("\n{}\n\n{sources}\n\n", table.join("\n"))
    }

    /// The rows that one line of a mark asks for, without their outer bars.
    fn rows(&self, line: &str, used: &RefCell<BTreeSet<String>>) -> Vec<String> {
        let (of, template) = line.split_once("=>").unwrap_or_else(|| panic!("{}: no '=>' in '{line}'", self.name));
        let (of, template, context) = (of.trim(), template.trim(), self.context(used));
        if of.is_empty() {
            return vec![context.filled(template)];
        }
        let each = of.rsplit_once(" each ").filter(|(_, each)| !each.contains(']'));
        let (file, each) = each.unwrap_or((of, ""));
        let (file, conditions) = file.trim_end_matches(']').split_once('[').unwrap_or((file, ""));
        let each: Vec<&str> = each.split_whitespace().collect();
        let (mut seen, mut rows) = (BTreeSet::new(), Vec::new());
        for row in context.rows(file, conditions) {
            if each.is_empty() || seen.insert(each.iter().map(|key| row[*key].as_str()).collect::<Vec<_>>()) {
                let context = Context { row: Some((file, row, &each)), ..self.context(used) };
                rows.push(context.filled(template));
            }
        }
        rows
    }

    /// Commands, machines and commits, each with the tables that came of it.
    fn sources(&self, files: &BTreeSet<String>) -> String {
        let up = "../".repeat(self.name.matches('/').count());
        let folder = match self.name.starts_with("docs/") {
            true => format!("{up}docs/plots").replace("../docs/", ""),
            false => format!("{up}docs/plots"),
        };
        let mut sources: Vec<(String, Vec<String>)> = Vec::new();
        for name in files {
            let Csv { command, machine, commit, .. } = &self.tables[name];
            let commit = commit.as_ref().map_or(String::new(), |commit| format!(", commit {commit}"));
            let (by, link) = (format!("`{command}` on {machine}{commit}"), format!("[{name}]({folder}/{name})"));
            match sources.iter_mut().find(|source| source.0 == by) {
                Some(source) => source.1.push(link),
                None => sources.push((by, vec![link])),
            }
        }
        let told: Vec<String> = sources.iter().map(|(by, links)| format!("{by}: {}", links.join(", "))).collect();
        told.join("; ")
    }

    fn lines(&mut self, told: &str) -> String {
        let (file, until) = told.split_once(" until ").expect("until which line");
        self.shown.insert(file.to_owned());
        let lines: Vec<&str> = self.tables[file].rows.iter().map(|row| row["line"].as_str()).collect();
        let shown = lines.iter().position(|line| line.starts_with(until)).expect("a line that is not shown");
        format!("\n```text\n{}\n```\n", lines[..shown].join("\n"))
    }
}

/// A paragraph, broken between words.
fn wrapped(text: &str) -> String {
    let (mut done, mut length) = (String::new(), 0);
    for word in text.split(' ') {
        let letters = word.chars().count();
        let is_full = length > 0 && length + 1 + letters > WIDTH;
        let between = if is_full { "\n" } else { " " };
        if length > 0 {
            done += between;
        }
        length = if is_full { letters } else { length + 1 + letters };
        done += word;
    }
    done
}

fn read(page: &str) -> String {
    fs::read_to_string(root().join(page)).unwrap_or_else(|problem| panic!("{page}: {problem}"))
}

#[test]
fn figures_are_those_of_the_published_runs() {
    let is_update = std::env::var_os("LTM_UPDATE_FIGURES").is_some();
    let tables = published::all();
    let (mut differing, mut shown) = (String::new(), BTreeSet::new());
    for name in PAGES {
        let (old, mut page) = (read(name), Page { name, tables: &tables, shown: BTreeSet::new() });
        let new = page.renewed(&old);
        shown.append(&mut page.shown);
        let only_in = |a: &str, b: &str, mark: &str| -> String {
            let known: BTreeSet<&str> = b.lines().collect();
            a.lines().filter(|line| !known.contains(line)).map(|line| format!("{mark} {line}\n")).collect()
        };
        if old != new {
            differing += &format!("{name}:\n{}{}", only_in(&old, &new, "-"), only_in(&new, &old, "+"));
        }
        if is_update {
            fs::write(root().join(name), new).unwrap();
        }
    }
    assert!(is_update || differing.is_empty(), "LTM_UPDATE_FIGURES=1 writes what is new:\n{differing}");
    let hidden: Vec<&String> = tables.keys().filter(|name| !shown.contains(*name)).collect();
    assert!(hidden.is_empty(), "on no page: {hidden:?}");
}

#[test]
fn every_published_table_names_a_command_that_exists() {
    let tables = published::all();
    assert!(tables.len() >= 20, "{} tables", tables.len());
    for (name, Csv { command, machine, .. }) in &tables {
        assert!(!machine.contains("development build"), "{name} was measured without optimisation");
        let words: Vec<&str> = command.split(' ').skip_while(|word| word.starts_with("LTM_")).collect();
        match words.as_slice() {
            ["ltm", "study", study] => drop(study.parse::<Study>().unwrap()),
            ["cargo", "bench", "--bench", bench, ..] => {
                assert!(root().join(format!("benches/{bench}.rs")).exists(), "{name}: {command}");
            }
            ["cargo", "bench", "-p", package] => {
                let folder = package.strip_prefix("ltm-").expect("a package of ours");
                assert!(root().join(format!("tools/{folder}/benches")).exists(), "{name}: {command}");
            }
            ["python", script] => assert!(root().join(script).exists(), "{name}: {command}"),
            _ => panic!("{name}: '{command}' is no command of this project"),
        }
    }
}

#[test]
fn marks_are_replaced_by_what_the_tables_say() {
    let row = [("case".to_owned(), "a".to_owned()), ("x".to_owned(), "2.5".to_owned())].into();
    let csv = Csv { command: "c".to_owned(), machine: "m".to_owned(), commit: None, rows: vec![row] };
    let tables = [("t.csv".to_owned(), csv)].into();
    let mut page = Page { name: "docs/p.md", tables: &tables, shown: BTreeSet::new() };
    let text = "It is <!--fig t.csv.x as .1-->3<!--/fig--> <!-- kept -->.\n\n<!--table\nwhat | x\nt.csv => {case} | {x as .0}\n-->\nold\n<!--/table-->\n";
    let new = page.renewed(text);
    assert!(new.contains("It is <!--fig t.csv.x as .1-->2.5<!--/fig--> <!-- kept -->."), "{new}");
    assert!(
        new.contains(
            "-->\n| what | x |\n|---|---|\n| a | 2 |\n\nMeasured by `c` on m: [t.csv](plots/t.csv).\n\n<!--/table-->"
        ),
        "{new}"
    );
    assert_eq!(page.renewed(&new), new);
}
