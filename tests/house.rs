//! Rules of the house: who may import whom, file sizes, no dead files, paths in documents.

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

/// The import table, read from the documentation of `src/lib.rs`.
fn import_table() -> BTreeMap<String, BTreeSet<String>> {
    let text = fs::read_to_string(root().join("src/lib.rs")).unwrap();
    let rows = text.lines().filter_map(|line| line.strip_prefix("//! | `"));
    let mut table = BTreeMap::new();
    for row in rows {
        let (modules, imports) = row.split_once('|').unwrap();
        let imports: BTreeSet<String> = words_in_backticks(imports).into_iter().map(String::from).collect();
        for module in words_in_backticks(&format!("`{modules}")) {
            table.insert(module.to_owned(), imports.clone());
        }
    }
    table
}

/// The code of a source file without comments and without what follows its test module.
fn code_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let code = text.lines().enumerate().take_while(|(_, line)| !line.starts_with("#[cfg(test)]"));
    code.map(|(i, line)| (i + 1, line.split("//").next().unwrap()))
}

#[test]
fn modules_import_only_what_the_table_allows() {
    let table = import_table();
    assert!(table.len() >= 11, "the table in src/lib.rs was not found: {table:?}");
    let mut broken = Vec::new();
    for path in files_below("src", &["rs"]) {
        let inside = path.strip_prefix(root().join("src")).unwrap();
        let module = inside.iter().next().unwrap().to_str().unwrap().trim_end_matches(".rs").to_owned();
        if module == "lib" {
            continue;
        }
        let allowed = table.get(&module).unwrap_or_else(|| panic!("`{module}` is not in the table of src/lib.rs"));
        let text = fs::read_to_string(&path).unwrap();
        for (number, line) in code_lines(&text) {
            for used in line.split("crate::").skip(1) {
                let used: String = used.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                let stem = if used == "Error" || used == "Result" { "error" } else { used.as_str() };
                if stem != module && !allowed.contains(stem) {
                    broken.push(format!("{}:{number}: `{module}` may not import `{stem}`", inside.display()));
                }
            }
            assert!(!line.contains("use crate::{"), "{}:{number}: one path per import", inside.display());
        }
    }
    assert!(broken.is_empty(), "\n{}", broken.join("\n"));
}

#[test]
fn every_module_stands_in_the_table() {
    let text = fs::read_to_string(root().join("src/lib.rs")).unwrap();
    let modules = text.lines().filter_map(|l| l.strip_prefix("pub mod ")).map(|l| l.trim_end_matches(';'));
    let table = import_table();
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
