//! Rules of the house: who may import whom, which crate is used where, file sizes, no dead files, paths and links in documents.

#[path = "house/documents.rs"]
mod documents;
#[path = "house/modules.rs"]
mod modules;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Lines above which a source file is to be split.
const MAX_FILE_LINES: usize = 700;

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
    code_lines_with(text, |line| line.starts_with("#[cfg(test)]"))
}

/// The same, where other lines than `#[cfg(test)]` begin what is compiled for tests only.
fn code_lines_with(text: &str, begins_test: impl Fn(&str) -> bool) -> Vec<Line<'_>> {
    let (mut is_test, mut lines) = (false, Vec::new());
    for (i, line) in text.lines().enumerate() {
        is_test |= begins_test(line);
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
            (lines > MAX_FILE_LINES).then(|| format!("{} has {lines} lines", path.display()))
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
    let documents = ["formats", "docs"].into_iter().flat_map(|folder| files_below(folder, &["md"]));
    let documents = documents.chain(["README.md", "CONTRIBUTING.md", "SECURITY.md"].map(|name| root().join(name)));
    for document in documents {
        let text = fs::read_to_string(&document).unwrap_or_default();
        for word in words_in_backticks(&text) {
            let ours = ["src/", "tools/", "tests/", "formats/", "shaders/", "benches/", "docs/", "examples/"];
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

/// Comments of a source file, each as one line: first line, and the text of adjacent comment lines.
fn comments(text: &str) -> Vec<(usize, String)> {
    let mut found: Vec<(usize, String)> = Vec::new();
    let mut last = 0;
    for (i, line) in text.lines().enumerate() {
        let begins = |&at: &usize| line[..at].chars().next_back().is_none_or(char::is_whitespace);
        let inside = line.trim_start().starts_with("* ").then(|| line.trim_start());
        let slashes = line.match_indices("//").map(|(at, _)| at).find(begins).map(|at| &line[at..]);
        let Some(comment) = slashes.or(inside) else { continue };
        let comment = comment.trim_start_matches(['/', '!', '*']).trim();
        match found.last_mut() {
            Some((_, text)) if last == i => *text = format!("{text} {comment}"),
            _ => found.push((i + 1, comment.to_owned())),
        }
        last = i + 1;
    }
    found
}

/// Words by which a comment names a scene of the studies or of the folder of scenes, in lower case.
const SCENES: [&str; 14] = [
    "bunny",
    "classroom",
    "conference",
    "cornell-",
    "diffuse room",
    "erw5-",
    "five built-in scenes",
    "living room",
    "mixed materials",
    "mixed room",
    "shirley's room",
    "sibenik",
    "sponza",
    "two dark halls",
];

/// Words that tell an experiment; those in lower case stand for any case.
const TELLS: [&str; 14] = [
    "FLIP",
    "H100",
    "busy cores",
    "chosen on",
    "do not pay",
    "does not pay",
    "measured in one run",
    "measured on",
    "squared error × time",
    "times the time",
    "tuned on",
    "was tried",
    "were tried",
    "ꟻlip",
];

/// Words behind a figure in per cent that make it a result.
const COMPARED: [&str; 11] =
    ["better", "faster", "fewer", "higher", "less", "lower", "more", "of the bytes", "of the time", "slower", "worse"];

/// What in a comment belongs to a decision instead.
fn told_experiments(comment: &str) -> Vec<&str> {
    let (whole, comment) = (comment, comment.to_lowercase());
    let stands = |word: &&&str| {
        let text = if word.contains(char::is_uppercase) { whole } else { comment.as_str() };
        text.match_indices(**word).any(|(at, _)| {
            let after = text[at + word.len()..].chars().next();
            word.ends_with('-') || !after.is_some_and(char::is_alphanumeric)
        })
    };
    let words = SCENES.iter().chain(&TELLS).filter(stands).copied();
    let after_figure = |unit: &str| {
        let at = comment.match_indices(unit).map(|(at, _)| (&comment[..at], &comment[at + unit.len()..]));
        let has_figure = |(before, _): &(&str, _)| before.trim_end().ends_with(|c: char| c.is_ascii_digit());
        at.filter(has_figure).map(|(_, after)| after.trim_start().to_owned()).collect::<Vec<_>>()
    };
    // One step of 8 bits below white is a definition.
    let decibels = after_figure(" db").iter().any(|after| !after.starts_with("below white"));
    let shares = after_figure("%").iter().any(|after| COMPARED.iter().any(|word| after.starts_with(word)));
    words.chain(decibels.then_some("dB")).chain(shares.then_some("%")).collect()
}

#[test]
fn comments_tell_no_experiments() {
    assert_eq!(told_experiments("With 2 the bunny has 0.1 dB more."), ["bunny", "dB"]);
    assert_eq!(told_experiments("Of 3 and 5, it was tried: 8 % less."), ["was tried", "%"]);
    assert_eq!(told_experiments("Warns above 5 %, 48.1 dB below white. Tuned: decision 12."), [""; 0]);
    for folder in ["formats/scenes", "examples/scenes"] {
        for path in files_below(folder, &["toml"]) {
            let name = path.file_stem().unwrap().to_str().unwrap();
            assert!(SCENES.iter().any(|word| name.contains(word)), "comments may name `{name}`: add it to the list");
        }
    }
    let mut told = Vec::new();
    for path in files_below("src", &["rs", "js"]).into_iter().chain(files_below("shaders", &["wgsl"])) {
        for (line, comment) in comments(&fs::read_to_string(&path).unwrap()) {
            let words = told_experiments(&comment);
            if !words.is_empty() {
                told.push(format!("{}:{line}: {}", path.display(), words.join(", ")));
            }
        }
    }
    assert!(told.is_empty(), "these comments tell experiments, which belong to docs/decisions:\n{}", told.join("\n"));
}

/// The numbers of decisions that a comment names: "decision 3", "Decisions 4 and 5".
fn named_decisions(comment: &str) -> Vec<u32> {
    let mut numbers = Vec::new();
    let words: Vec<&str> = comment.split_whitespace().collect();
    for (i, word) in words.iter().enumerate() {
        let word = word.trim_start_matches('(').to_lowercase();
        if word == "decision" || word == "decisions" {
            let rest = words[i + 1..].iter().filter(|word| **word != "and");
            let number = |word: &&str| word.trim_end_matches(|c: char| c.is_ascii_punctuation()).parse::<u32>().ok();
            numbers.extend(rest.map_while(number));
        }
    }
    numbers
}

#[test]
fn decisions_have_their_page_and_their_line_in_the_index() {
    assert_eq!(
        named_decisions("Tuned: decision 3. Rejected (decisions 4, 5 and 6): the decision of others"),
        [3, 4, 5, 6]
    );
    let index = fs::read_to_string(root().join("docs/decisions/README.md")).unwrap();
    let mut pages = BTreeMap::new();
    for path in files_below("docs/decisions", &["md"]).into_iter().filter(|path| !path.ends_with("README.md")) {
        let (file, text) = (path.file_name().unwrap().to_str().unwrap(), fs::read_to_string(&path).unwrap());
        let number: u32 = file.split('-').next().unwrap().parse().unwrap();
        let title = text.lines().next().unwrap().strip_prefix(&format!("# {number}. "));
        let title = title.unwrap_or_else(|| panic!("{file}: the first line is not `# {number}. TITLE`"));
        let headings: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("## ")).collect();
        assert_eq!(headings, ["Question", "Set-up", "Measurements", "Result", "Commit"], "{file}");
        let line = format!("| {number} | [{title}]({file}) |");
        assert!(index.contains(&line), "the index lacks `{line}`");
        assert!(file.starts_with(&format!("{number:04}-")), "{file}: four digits");
        assert!(pages.insert(number, path).is_none(), "two decisions have the number {number}");
    }
    assert!(index.lines().filter(|line| line.contains("](")).count() == pages.len(), "the index has other lines");
    let mut named = BTreeSet::new();
    let folders = ["src", "shaders", "tools", "benches", "tests"];
    for path in folders.iter().flat_map(|folder| files_below(folder, &["rs", "js", "wgsl", "py"])) {
        if path.ends_with("tests/house.rs") {
            continue;
        }
        let text = fs::read_to_string(&path).unwrap();
        let text = if path.extension().is_some_and(|e| e == "py") { text.replace('#', "//") } else { text };
        for (line, comment) in comments(&text) {
            for number in named_decisions(&comment) {
                assert!(pages.contains_key(&number), "{}:{line}: there is no decision {number}", path.display());
                named.insert(number);
            }
        }
    }
    let idle: Vec<_> = pages.keys().filter(|number| !named.contains(number)).collect();
    assert!(idle.is_empty(), "no comment names the decisions {idle:?}");
}

/// The length of what stands at the beginning of a text of code, and whether it is a string literal. Comments, words and characters of
/// quotes are one piece each.
fn next_piece(rest: &str) -> (usize, bool) {
    let first = rest.chars().next().expect("there is something left");
    let is_of_word = |c: char| c.is_alphanumeric() || c == '_';
    if rest.starts_with("//") {
        return (rest.find('\n').unwrap_or(rest.len()), false);
    }
    for quote in ["'\"'", "'\\\"'", "b'\"'"] {
        if rest.starts_with(quote) {
            return (quote.len(), false);
        }
    }
    let raw = rest.trim_start_matches('b').strip_prefix('r').filter(|raw| raw.trim_start_matches('#').starts_with('"'));
    if let Some(raw) = raw {
        let hashes = raw.len() - raw.trim_start_matches('#').len();
        let end = format!("\"{}", "#".repeat(hashes));
        let inside = raw[hashes + 1..].find(&end).expect("a raw string ends");
        return (rest.len() - raw.len() + hashes + 1 + inside + end.len(), true);
    }
    if first == '"' {
        let mut is_escaped = true;
        let end = rest.find(|c| {
            let is_end = c == '"' && !is_escaped;
            is_escaped = c == '\\' && !is_escaped;
            is_end
        });
        return (end.expect("a string ends") + 1, true);
    }
    match is_of_word(first) {
        true => (rest.find(|c| !is_of_word(c)).unwrap_or(rest.len()), false),
        false => (first.len_utf8(), false),
    }
}

/// The string literals of a source file with the numbers of the lines that they begin in.
fn string_literals(text: &str) -> Vec<(usize, &str)> {
    let (mut literals, mut line, mut at) = (Vec::new(), 1, 0);
    while at < text.len() {
        let (length, is_literal) = next_piece(&text[at..]);
        let piece = &text[at..at + length];
        if is_literal {
            literals.push((line, piece));
        }
        line += piece.matches('\n').count();
        at += length;
    }
    literals
}

/// A flag, a program, or a command of one: what only users of a command line know.
fn names_the_command_line(text: &str) -> bool {
    let has_flag = text.match_indices("--").any(|(at, _)| {
        let before = text[..at].chars().next_back();
        let after = text[at + 2..].chars().next();
        before != Some('-') && after.is_some_and(|c| c.is_ascii_lowercase())
    });
    let programs = ["ltm-pack", "ltm-unpack", "ltm-study", "ltm-view"];
    let commands = ["build", "demo", "info", "merge", "plan", "relight", "render", "share", "study", "verify", "view"];
    has_flag
        || text.contains("command")
        || programs.iter().any(|program| text.contains(program))
        || commands.iter().any(|command| text.contains(&format!("ltm {command}")))
}

/// Hints are typed (`error::Hint`), and each front end words them.
#[test]
fn the_library_does_not_speak_of_the_command_line() {
    let example = "let a = '\"'; // \"--no\"\nlet b = r#\"\"--a\"#; f(\"x\\\"\", b\"ltm-pack\", \"one\n  --two\", 'a', \"3 -- 4\")";
    let found: Vec<_> = string_literals(example).into_iter().filter(|(_, text)| names_the_command_line(text)).collect();
    assert_eq!(found.iter().map(|(line, _)| *line).collect::<Vec<_>>(), [2, 2, 2], "{found:?}");
    let mut broken = Vec::new();
    for (inside, text) in library_files() {
        let tests: BTreeSet<usize> =
            code_lines(&text).iter().filter(|line| line.is_test).map(|line| line.number).collect();
        for (line, literal) in string_literals(&text) {
            if names_the_command_line(literal) && !tests.contains(&line) {
                broken.push(format!("{}:{line}: {literal}", inside.display()));
            }
        }
    }
    assert!(broken.is_empty(), "typed hints instead (`error::Hint`):\n{}", broken.join("\n"));
}
