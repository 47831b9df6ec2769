//! Rules of the house: who may import whom, which crate is used where, file sizes, no dead files, paths in documents.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Lines above which a source file is to be split.
const LONGEST_FILE: usize = 700;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn files_below(folder: &str, extensions: &[&str]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![root().join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).into_iter().flatten() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| extensions.iter().any(|x| e == *x)) {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

fn words_in_backticks(text: &str) -> Vec<&str> {
    text.split('`').skip(1).step_by(2).collect()
}

/// A table of the documentation of `src/lib.rs`, by the title of its first column: for each name there, what stands in the
/// second column.
fn table_of(title: &str) -> BTreeMap<String, BTreeSet<String>> {
    let text = fs::read_to_string(root().join("src/lib.rs")).unwrap();
    let head = format!("//! | {title} |");
    let rows = text.lines().skip_while(|line| !line.starts_with(&head)).skip(2);
    let rows = rows.map_while(|line| line.strip_prefix("//! | "));
    let mut table = BTreeMap::new();
    for row in rows {
        let (names, allowed) = row.split_once('|').unwrap();
        let allowed: BTreeSet<String> = words_in_backticks(allowed).into_iter().map(String::from).collect();
        for name in words_in_backticks(names) {
            let twice = table.insert(name.to_owned(), allowed.clone());
            assert!(twice.is_none(), "`{name}` stands in the table twice");
        }
    }
    assert!(table.len() >= 5, "the table of `{title}` was not found in src/lib.rs");
    table
}

/// A line of code without its comment.
struct Line<'a> {
    number: usize,
    code: &'a str,
    /// Whether it is compiled for tests only.
    is_test: bool,
}

/// The code of a source file, all of it.
fn code_lines(text: &str) -> Vec<Line<'_>> {
    let (mut is_test, mut lines) = (false, Vec::new());
    for (i, line) in text.lines().enumerate() {
        is_test |= line.starts_with("#[cfg(test)]");
        lines.push(Line { number: i + 1, code: line.split("//").next().unwrap(), is_test });
        // The end of a test module, or the declaration of one in a file of its own.
        let is_attribute = line.starts_with("#[");
        let ends_declaration = !is_attribute && !line.starts_with(' ') && line.ends_with(';');
        is_test &= line != "}" && !ends_declaration;
    }
    lines
}

/// The room of a source file: its folder below `src`, or its own stem.
fn room_of(inside: &Path) -> String {
    inside.iter().next().unwrap().to_str().unwrap().trim_end_matches(".rs").to_owned()
}

/// Source files of the library with their paths below `src`, but for `lib.rs`.
fn library_files() -> impl Iterator<Item = (PathBuf, String)> {
    files_below("src", &["rs"]).into_iter().filter_map(|path| {
        let inside = path.strip_prefix(root().join("src")).unwrap().to_owned();
        (inside != Path::new("lib.rs")).then(|| (inside, fs::read_to_string(&path).unwrap()))
    })
}

#[test]
fn modules_import_only_what_the_table_allows() {
    let table = table_of("module");
    let mut broken = Vec::new();
    for (inside, text) in library_files() {
        let module = room_of(&inside);
        let allowed = table.get(&module).unwrap_or_else(|| panic!("`{module}` is not in the table of src/lib.rs"));
        for Line { number, code, .. } in code_lines(&text) {
            for used in code.split("crate::").skip(1) {
                let used: String = used.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                let stem = if used == "Error" || used == "Result" { "error" } else { used.as_str() };
                if stem != module && !allowed.contains(stem) {
                    broken.push(format!("{}:{number}: `{module}` may not import `{stem}`", inside.display()));
                }
            }
            assert!(!code.contains("use crate::{"), "{}:{number}: one path per import", inside.display());
        }
    }
    assert!(broken.is_empty(), "\n{}", broken.join("\n"));
}

/// Where a name stands as the beginning of a path: `name::`, but not behind another `::`.
fn begins_a_path(code: &str, name: &str) -> bool {
    code.match_indices(&format!("{name}::")).any(|(at, _)| {
        let before = code[..at].chars().next_back();
        before.is_none_or(|c| !(c.is_alphanumeric() || c == '_' || c == ':'))
    })
}

#[test]
fn outside_crates_are_used_only_where_the_table_allows() {
    let table = table_of("crate");
    let mut broken = Vec::new();
    for (inside, text) in library_files() {
        let folder = inside.parent().unwrap().to_str().unwrap();
        let is_in =
            |room: &String| folder == room || folder.starts_with(&format!("{room}/")) || room_of(&inside) == *room;
        for (name, rooms) in &table {
            // A module of ours may have the name of a crate.
            let is_ours =
                text.contains(&format!("use crate::{name};")) || text.contains(&format!("use crate::{name}::{{self"));
            if is_ours || rooms.iter().any(is_in) {
                continue;
            }
            for Line { number, code, .. } in code_lines(&text).iter().filter(|line| !line.is_test) {
                if begins_a_path(code, name) {
                    broken.push(format!("{}:{number}: `{name}` is not used here", inside.display()));
                }
            }
        }
    }
    assert!(broken.is_empty(), "\n{}", broken.join("\n"));
}

/// The output of `Debug` follows the names in the code: in a file, a hash or a message it would change with them.
#[test]
fn no_text_of_the_library_is_debug_output() {
    let mut broken = Vec::new();
    for (inside, text) in library_files() {
        for Line { number, code, .. } in code_lines(&text).iter().filter(|line| !line.is_test) {
            if code.contains(":?}") || code.contains(":#?}") {
                broken.push(format!("{}:{number}: write the text out, or implement `Display`", inside.display()));
            }
        }
    }
    assert!(broken.is_empty(), "\n{}", broken.join("\n"));
}

#[test]
fn every_dependency_has_a_place() {
    let table = table_of("crate");
    let manifest = fs::read_to_string(root().join("Cargo.toml")).unwrap();
    let dependencies = manifest.lines().skip_while(|line| *line != "[dependencies]").skip(1);
    let dependencies = dependencies.take_while(|line| !line.starts_with('['));
    let names: Vec<String> = dependencies
        .filter(|line| line.starts_with(|c: char| c.is_ascii_alphabetic()))
        .map(|line| line.split(['.', ' ', '=']).next().unwrap().replace('-', "_"))
        .collect();
    assert!(names.len() > 10, "the dependencies were not found: {names:?}");
    for name in &names {
        assert!(table.contains_key(name), "`{name}` is missing from the table of src/lib.rs");
    }
    for name in table.keys().filter(|name| !name.contains("::")) {
        assert!(names.contains(name), "`{name}` stands in the table of src/lib.rs, and is no dependency");
    }
}

#[test]
fn every_module_stands_in_the_table() {
    let text = fs::read_to_string(root().join("src/lib.rs")).unwrap();
    let modules = text.lines().filter_map(|l| l.strip_prefix("pub mod ")).map(|l| l.trim_end_matches(';'));
    let table = table_of("module");
    for module in modules {
        assert!(table.contains_key(module), "`{module}` is missing from the table");
    }
}

#[test]
fn source_files_can_be_held_in_the_head() {
    let folders = ["src", "tools", "tests", "benches", "shaders"];
    let long: Vec<_> = folders
        .iter()
        .flat_map(|folder| files_below(folder, &["rs", "wgsl"]))
        .filter_map(|path| {
            let lines = fs::read_to_string(&path).unwrap().lines().count();
            (lines > LONGEST_FILE).then(|| format!("{} has {lines} lines", path.display()))
        })
        .collect();
    assert!(long.is_empty(), "\n{}", long.join("\n"));
}

#[test]
fn every_source_file_is_part_of_the_build() {
    for path in files_below("src", &["rs"]) {
        let stem = path.file_stem().unwrap().to_str().unwrap();
        let folder = path.parent().unwrap();
        let parent = match stem {
            "lib" => continue,
            "mod" => folder.parent().unwrap().join("mod.rs"),
            _ => folder.join("mod.rs"),
        };
        let parent = if parent.exists() { parent } else { root().join("src/lib.rs") };
        let name = if stem == "mod" { folder.file_name().unwrap().to_str().unwrap() } else { stem };
        let text = fs::read_to_string(&parent).unwrap();
        assert!(text.contains(&format!("mod {name};")), "{} is not declared in {}", path.display(), parent.display());
    }
}

#[test]
fn paths_named_in_documents_exist() {
    let documents = files_below("formats", &["md"]).into_iter().chain([root().join("README.md")]);
    for document in documents {
        let text = fs::read_to_string(&document).unwrap_or_default();
        for word in words_in_backticks(&text) {
            let ours = ["src/", "tools/", "tests/", "formats/", "shaders/", "benches/"];
            let plain = !word.contains(['*', '{', '<', ' ', '\n']);
            if plain && ours.iter().any(|folder| word.starts_with(folder)) {
                assert!(root().join(word).exists(), "{} names {word}, which does not exist", document.display());
            }
        }
    }
}

#[test]
fn words_that_mean_nothing_are_not_module_names() {
    for path in files_below("src", &["rs"]) {
        let stem = path.file_stem().unwrap().to_str().unwrap();
        let empty = ["util", "utils", "common", "helpers", "types", "core", "prelude", "misc"];
        assert!(!empty.contains(&stem), "{}", path.display());
    }
}
