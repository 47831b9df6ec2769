//! What holds for documents: links lead somewhere, versions agree, the README stays short.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use super::root;

/// Lines of the README at most: a visitor reads it to the end.
const LONGEST_README: usize = 150;
/// Lines of an entry in the list of changes at most.
const LONGEST_ENTRY: usize = 2;

fn read(name: &str) -> String {
    fs::read_to_string(root().join(name)).unwrap_or_else(|problem| panic!("{name}: {problem}"))
}

/// All Markdown pages of the repository, but for those of what is built or installed.
fn pages() -> Vec<PathBuf> {
    let (mut pages, mut folders) =
        (Vec::new(), ["docs", "formats", "tools", "examples"].map(|f| root().join(f)).to_vec());
    pages.extend(["README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md"].map(|name| root().join(name)));
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            if path.is_dir() && name != "target" && name != "node_modules" && !name.starts_with('.') {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "md") {
                pages.push(path);
            }
        }
    }
    pages
}

/// The lines of a page that are no code between fences, with what it includes of other pages.
fn prose(page: &Path) -> Vec<String> {
    let text = fs::read_to_string(page).unwrap();
    let mut is_code = false;
    let mut lines = Vec::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            is_code = !is_code;
        } else if let Some(name) = line.strip_prefix("{{#include ").and_then(|rest| rest.strip_suffix("}}")) {
            lines.extend(prose(&page.parent().unwrap().join(name)));
        } else if !is_code {
            lines.push(line.to_owned());
        }
    }
    lines
}

/// What headings are called in links.
fn anchors(page: &Path) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for heading in prose(page).iter().filter(|line| line.starts_with('#')) {
        let told = heading.trim_start_matches('#').trim().to_lowercase().replace(' ', "-");
        let anchor: String = told.chars().filter(|c| c.is_alphanumeric() || *c == '-' || *c == '_').collect();
        let again = (1..).map(|i| format!("{anchor}-{i}")).find(|name| !found.contains(name)).unwrap();
        let name = if found.contains(&anchor) { again } else { anchor };
        found.insert(name);
    }
    found
}

/// The targets of links in a line, without those in code.
fn links(line: &str) -> Vec<String> {
    let text: String = line.split('`').step_by(2).collect::<Vec<_>>().join("code");
    text.split("](").skip(1).filter_map(|rest| rest.split(')').next()).map(str::to_owned).collect()
}

#[test]
fn links_lead_to_files_and_headings() {
    let (mut broken, mut files, mut headings) = (Vec::new(), 0, 0);
    for page in pages() {
        for link in prose(&page).iter().flat_map(|line| links(line)) {
            if link.starts_with("https://") || link.starts_with("http://") {
                continue;
            }
            let (file, anchor) = link.split_once('#').unwrap_or((&link, ""));
            let path = if file.is_empty() { page.clone() } else { page.parent().unwrap().join(file) };
            let is_there = path.exists() && (anchor.is_empty() || anchors(&path).contains(anchor));
            if !is_there {
                broken.push(format!("{} links to {link}", page.strip_prefix(root()).unwrap().display()));
            }
            files += usize::from(!file.is_empty());
            headings += usize::from(!anchor.is_empty());
        }
    }
    assert!(broken.is_empty(), "\n{}", broken.join("\n"));
    assert!(files > 50 && headings > 10, "{files} links to files and {headings} to headings were found");
}

#[test]
fn every_page_of_the_book_is_in_its_contents() {
    let summary = read("docs/SUMMARY.md");
    for page in pages().iter().filter_map(|page| page.strip_prefix(root().join("docs")).ok()) {
        // Decisions have a list of their own.
        let is_listed = summary.contains(&format!("({})", page.display()));
        let is_part = page.starts_with("decisions") && page != Path::new("decisions/README.md");
        assert!(
            is_listed || is_part || page == Path::new("SUMMARY.md"),
            "{} is not in docs/SUMMARY.md",
            page.display()
        );
    }
}

/// What stands behind the first line that begins so, without quotes.
fn value<'a>(text: &'a str, begin: &str) -> &'a str {
    let line = text.lines().find_map(|line| line.strip_prefix(begin)).unwrap_or_else(|| panic!("no line '{begin}'"));
    line.trim().trim_matches('"')
}

#[test]
fn versions_agree() {
    let manifest = read("Cargo.toml");
    let version = value(&manifest, "version = ");
    for name in ["tools/python/Cargo.toml", "tools/python/pyproject.toml", "tools/blender/blender_manifest.toml"] {
        assert_eq!(value(&read(name), "version = "), version, "{name}");
    }
    let citation = read("CITATION.cff");
    assert_eq!(value(&citation, "version:"), version, "CITATION.cff");
    let changes = read("CHANGELOG.md");
    let date = value(&changes, &format!("## [{version}] - "));
    assert_eq!(value(&citation, "date-released:"), date, "CITATION.cff");
    let oldest = value(&manifest, "rust-version = ");
    assert!(read("README.md").contains(&format!("Rust {oldest} or newer")), "README.md names Rust {oldest}");
}

#[test]
fn changes_are_short_and_of_known_kinds() {
    let changes = read("CHANGELOG.md");
    assert!(changes.contains("\n## [Unreleased]\n"), "a place for what comes next");
    let mut lines = 0;
    for line in changes.lines() {
        if let Some(kind) = line.strip_prefix("### ") {
            let known = ["Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"];
            assert!(known.contains(&kind), "{kind}");
        }
        lines = if line.starts_with("- ") {
            1
        } else if line.starts_with("  ") {
            lines + 1
        } else {
            0
        };
        assert!(lines <= LONGEST_ENTRY, "an entry of more than {LONGEST_ENTRY} lines: {line}");
    }
}

#[test]
fn the_readme_is_short() {
    let lines = read("README.md").lines().count();
    assert!(lines <= LONGEST_README, "{lines} lines");
}

/// A reader finds each room, and one thing in it.
#[test]
fn every_room_is_described_in_one_sentence() {
    let page = read("docs/architecture.md");
    let table = page.split("## Rooms").nth(1).and_then(|rest| rest.split("\n## ").next()).expect("a list of rooms");
    let rows = table.lines().filter(|line| line.starts_with("| `"));
    let cells = rows.map(|line| line.trim_matches(['|', ' ']).split_once(" | ").expect("two cells"));
    let said: BTreeMap<&str, &str> = cells.map(|(room, content)| (room.trim_matches('`'), content)).collect();
    let entries = fs::read_dir(root().join("src")).unwrap().map(|entry| entry.unwrap().file_name());
    let rooms: BTreeSet<String> = entries.map(|name| name.into_string().unwrap()).collect();
    let listed: BTreeSet<String> = said.keys().map(|&room| room.to_owned()).chain(["lib.rs".to_owned()]).collect();
    assert_eq!(listed, rooms);
    for (room, content) in said {
        assert!(!content.split_whitespace().any(|word| word == "and"), "{room} holds two things: {content}");
    }
}
