//! The figures on the pages against the tables of the runs that made them.
//!
//! Code writes each table of figures and the list behind it, and the test compares. With `LTM_UPDATE_FIGURES=1` it writes them
//! into the pages instead; sentences inside of prose are printed as they should be, and are edited by hand.

mod benches;
mod goals;
mod gpu;
mod large;
mod methods;
mod page;
mod pictures;
mod published;
mod relighting;
mod sentences;
#[path = "../tables/mod.rs"]
mod tables;
mod times;
mod words;

use std::collections::BTreeSet;
use std::fs;

use ltm_study::Study;
use page::{Figure, flat, place, replaced};
use published::{Csv, root};
use sentences::{PRINTED, PrintedText, ROWS, SENTENCES, TableRow};

/// All pages with figures.
const PAGES: [&str; 3] = ["README.md", "docs/figures.md", "docs/growth.md"];

fn figures() -> impl Iterator<Item = &'static Figure> {
    [
        pictures::FIGURES,
        methods::FIGURES,
        times::FIGURES,
        large::FIGURES,
        benches::FIGURES,
        relighting::FIGURES,
        gpu::FIGURES,
        goals::FIGURES,
    ]
    .into_iter()
    .flatten()
}

fn read(page: &str) -> String {
    fs::read_to_string(root().join(page)).unwrap_or_else(|problem| panic!("{page}: {problem}"))
}

/// A page as it should be.
fn renewed(page: &str) -> String {
    let mut text = read(page);
    for figure in figures().filter(|figure| figure.page == page) {
        let lines: Vec<&str> = text.lines().collect();
        let at = place(&lines, figure.heading).unwrap_or_else(|| panic!("{page} has no '{}'", figure.heading));
        text = replaced(&text, at, &figure.lines());
    }
    for row in ROWS.iter().filter(|row| row.page == page) {
        text = with_row(&text, row);
    }
    for printed in PRINTED.iter().filter(|printed| printed.page == page) {
        text = with_printed(&text, printed);
    }
    text
}

/// A page with the text between two fences replaced.
fn with_printed(text: &str, printed: &PrintedText) -> String {
    let begin = format!("\n{}\n\n```text\n", printed.after);
    let (before, rest) = text.split_once(&begin).unwrap_or_else(|| panic!("{} has no '{begin}'", printed.page));
    let (_, after) = rest.split_once("```\n").expect("a second fence");
    let rows = Csv::published(printed.file).rows;
    let all: Vec<&str> = rows.iter().map(|row| published::text(row, "line")).collect();
    let shown = all.iter().position(|line| line.starts_with(printed.until)).expect("a line that is not shown");
    let lines: String = all[..shown].iter().map(|line| format!("{line}\n")).collect();
    format!("{before}{begin}{lines}```\n{after}")
}

/// A page with one row of a table replaced.
fn with_row(text: &str, row: &TableRow) -> String {
    let begin = format!("| {} |", row.first);
    let is_it = |line: &&str| line.starts_with(&begin);
    assert_eq!(text.lines().filter(is_it).count(), 1, "{}: one row '{begin}'", row.page);
    let line = format!("{begin} {} |", (row.cells)().join(" | "));
    let lines: Vec<&str> = text.lines().map(|old| if is_it(&old) { line.as_str() } else { old }).collect();
    lines.join("\n") + "\n"
}

#[test]
fn figures_are_those_of_the_published_runs() {
    let is_update = std::env::var_os("LTM_UPDATE_FIGURES").is_some();
    let mut differing = String::new();
    for page in PAGES {
        let (old, new) = (read(page), renewed(page));
        let only_in = |a: &str, b: &str, mark: &str| -> String {
            let known: BTreeSet<&str> = b.lines().collect();
            a.lines().filter(|line| !known.contains(line)).map(|line| format!("{mark} {line}\n")).collect()
        };
        if old != new {
            differing += &format!("{page}:\n{}{}", only_in(&old, &new, "-"), only_in(&new, &old, "+"));
        }
        if is_update {
            // In one step, since the other tests read the pages at the same time.
            let fresh = root().join(format!("{page}.new"));
            fs::write(&fresh, new).unwrap();
            fs::rename(&fresh, root().join(page)).unwrap();
        }
    }
    if is_update {
        eprintln!("{differing}");
    } else {
        assert!(differing.is_empty(), "LTM_UPDATE_FIGURES=1 writes what is new:\n{differing}");
    }
}

#[test]
fn sentences_in_prose_are_those_of_the_published_runs() {
    let missing: Vec<String> = SENTENCES
        .iter()
        .map(|sentence| (sentence.page, (sentence.says)()))
        .filter(|(page, says)| !flat(&read(page)).contains(says))
        .map(|(page, says)| format!("{page} should say: {says}"))
        .collect();
    assert!(missing.is_empty(), "\n{}", missing.join("\n"));
}

/// The part of the README that states figures, and the page of figures, without what code wrote or checks.
fn written_by_hand(page: &str) -> String {
    let text = read(page);
    let mut lines: Vec<&str> = text.lines().collect();
    for figure in figures().filter(|figure| figure.page == page) {
        let (first, last) = place(&lines, figure.heading).expect("it has a place");
        lines.drain(first..last);
    }
    let begin = lines.iter().position(|line| *line == "## What it reaches").unwrap_or(0);
    let end = lines.iter().position(|line| line.starts_with("## How it works")).unwrap_or(lines.len());
    let mut rest = flat(&lines[begin..end].join("\n"));
    for sentence in SENTENCES.iter().filter(|sentence| sentence.page == page) {
        rest = rest.replace(&(sentence.says)(), "");
    }
    rest
}

#[test]
fn no_figure_is_written_by_hand() {
    for page in ["README.md", "docs/figures.md"] {
        let rest = written_by_hand(page);
        assert!(rest.len() > 1000, "{page}: {rest}");
        let units = [
            " %", " dB", " ms", " s ", " s.", " s,", " s;", " GB/s", " GB", " times", "×", " MB", " KB", " KiB",
            " minutes", " million",
        ];
        for unit in units.into_iter().chain([" MiB of memory", " GiB of matrix"]) {
            for (at, _) in rest.match_indices(unit) {
                let before = rest[..at].chars().next_back();
                let near: String = rest[..at].chars().rev().take(60).collect::<Vec<_>>().into_iter().rev().collect();
                assert!(before.is_none_or(|c| !c.is_ascii_digit()), "{page}: '{near}{unit}' comes out of no table");
            }
        }
    }
}

#[test]
fn every_published_table_is_shown_and_names_a_command_that_exists() {
    let printed = PRINTED.iter().map(|printed| printed.file);
    let shown: BTreeSet<&str> = figures().flat_map(|figure| figure.files).copied().chain(printed).collect();
    let mut count = 0;
    for entry in fs::read_dir(root().join("docs/plots")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if !name.ends_with(".csv") {
            continue;
        }
        count += 1;
        assert!(shown.contains(name.as_str()), "{name} is on no page");
        let Csv { command, machine, .. } = Csv::published(&name);
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
    assert!(count >= 20, "{count} tables");
}

/// What a heading is called in links.
fn anchor(heading: &str) -> String {
    let plain = heading.trim_start_matches('#').trim().to_lowercase().replace(' ', "-");
    plain.chars().filter(|c| c.is_alphanumeric() || *c == '-').collect()
}

#[test]
fn links_to_figures_lead_to_a_heading_and_to_files() {
    let text = read("docs/figures.md");
    let anchors: BTreeSet<String> = text.lines().filter(|line| line.starts_with('#')).map(anchor).collect();
    let mut count = 0;
    for page in PAGES {
        let text = read(page);
        let folder = root().join(page).parent().unwrap().to_owned();
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            if link.starts_with("http") {
                continue;
            }
            let (file, at) = link.split_once('#').unwrap_or((link, ""));
            let path = if file.is_empty() { root().join(page) } else { folder.join(file) };
            assert!(path.exists(), "{page} links to {link}");
            assert!(at.is_empty() || anchors.contains(at), "{page} links to {link}, and there is no such heading");
            count += usize::from(!at.is_empty());
        }
    }
    assert!(count >= 5, "the README links to the page of figures: {count}");
}
