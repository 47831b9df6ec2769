//! The files of a room among themselves: none leads back to itself through its neighbours, and a type's name has one meaning.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use regex_lite::Regex;

use super::{code_lines_with, files_below, root};

type Path = Vec<String>;

/// A module of a crate, as far as names are concerned.
struct Module {
    /// Its code without comments and tests.
    code: String,
    /// The paths that it names, and those that it exports.
    named: Vec<String>,
    exported: Vec<String>,
}

/// All paths of a `use` declaration, without what is in front of it: `a::{b, c::d}` is `a::b` and `a::c::d`.
fn paths_of_use(tree: &str) -> Vec<String> {
    let Some((head, rest)) = tree.split_once('{') else {
        let path = tree.split(" as ").next().unwrap().trim();
        return if path.is_empty() { Vec::new() } else { vec![path.to_owned()] };
    };
    let body = rest.trim().strip_suffix('}').unwrap();
    let (mut depth, mut begin, mut paths) = (0, 0, Vec::new());
    for (at, c) in body.char_indices().chain([(body.len(), ',')]) {
        depth += i32::from(c == '{') - i32::from(c == '}');
        if c == ',' && depth == 0 {
            paths.extend(paths_of_use(&body[begin..at]).into_iter().map(|path| format!("{}{path}", head.trim())));
            begin = at + 1;
        }
    }
    paths
}

/// The code of a file without comments and without its modules of tests, those that want a feature as well among them.
fn code_of(text: &str) -> String {
    let lines = code_lines_with(text, |line| line.starts_with("#[cfg(test)]") || line.starts_with("#[cfg(all(test"));
    lines.iter().filter(|line| !line.is_test).map(|line| format!("{}\n", line.code)).collect()
}

/// The modules of a crate by their paths; its root has none.
fn modules_of(folder: &str) -> BTreeMap<Path, Module> {
    let declaration = Regex::new(r"(?m)^\s*(pub(?:\([^)]*\))?\s+)?use\s+([\w:{},*\s]+);").unwrap();
    let inline = Regex::new(r"\b(?:super|crate|self)(?:::\w+)+|\b\w+::").unwrap();
    let mut modules = BTreeMap::new();
    for file in files_below(folder, &["rs"]) {
        let inside = file.strip_prefix(root().join(folder)).unwrap().with_extension("");
        let mut path: Path = inside.iter().map(|part| part.to_str().unwrap().to_owned()).collect();
        path.pop_if(|last| ["mod", "lib", "main"].contains(&last.as_str()));
        let code = code_of(&fs::read_to_string(&file).unwrap());
        let (mut named, mut exported) = (Vec::new(), Vec::new());
        for found in declaration.captures_iter(&code) {
            let list = if found.get(1).is_some() { &mut exported } else { &mut named };
            list.extend(paths_of_use(&found[2]));
        }
        let rest = declaration.replace_all(&code, "");
        named.extend(inline.find_iter(&rest).map(|found| found.as_str().trim_end_matches("::").to_owned()));
        modules.insert(path, Module { code, named, exported });
    }
    modules
}

/// The module in which a path that another module names is declared.
fn declared_in(modules: &BTreeMap<Path, Module>, module: &Path, named: &str, depth: u32) -> Option<Path> {
    let mut parts: Vec<&str> = named.split("::").collect();
    let mut at = match parts[0] {
        "crate" => Vec::new(),
        "self" | "super" => module.clone(),
        _ => {
            let child: Path = module.iter().cloned().chain([parts[0].to_owned()]).collect();
            return modules.contains_key(&child).then_some(child).and_then(|child| {
                let rest = parts[1..].join("::");
                if rest.is_empty() {
                    Some(child)
                } else {
                    declared_in(modules, &child, &format!("self::{rest}"), depth)
                }
            });
        }
    };
    while parts.first().is_some_and(|part| ["crate", "self", "super"].contains(part)) {
        if parts.remove(0) == "super" {
            at.pop();
        }
    }
    while let Some(part) = parts.first() {
        let child: Path = at.iter().cloned().chain([(*part).to_owned()]).collect();
        if !modules.contains_key(&child) {
            break;
        }
        at = child;
        parts.remove(0);
    }
    let elsewhere = parts.first().filter(|_| depth < 5).and_then(|item| {
        let exported = modules.get(&at)?.exported.iter();
        exported
            .filter(|path| path.rsplit("::").next() == Some(item))
            .find_map(|path| declared_in(modules, &at, path, depth + 1))
    });
    Some(elsewhere.unwrap_or(at))
}

/// What is reached from a place along edges.
fn reached<'a>(edges: &'a BTreeMap<String, BTreeSet<String>>, from: &'a str) -> BTreeSet<&'a str> {
    let (mut open, mut seen) = (vec![from], BTreeSet::new());
    while let Some(at) = open.pop() {
        for next in edges.get(at).into_iter().flatten() {
            if seen.insert(next.as_str()) {
                open.push(next);
            }
        }
    }
    seen
}

/// Neighbours of one folder that lead to each other in a circle; a folder is one neighbour. What a folder's own `mod.rs` declares
/// is every neighbour's.
fn circles_in(folder: &str) -> Vec<String> {
    let modules = modules_of(folder);
    let mut rooms: BTreeMap<Path, BTreeMap<String, BTreeSet<String>>> = BTreeMap::new();
    for (path, module) in &modules {
        for named in &module.named {
            let Some(other) = declared_in(&modules, path, named, 0) else { continue };
            let common = path.iter().zip(&other).take_while(|(a, b)| a == b).count();
            if common < path.len() && common < other.len() {
                let edges = rooms.entry(path[..common].to_vec()).or_default();
                edges.entry(path[common].clone()).or_default().insert(other[common].clone());
            }
        }
    }
    let mut circles = Vec::new();
    for (room, edges) in rooms.iter().filter(|(room, _)| !room.is_empty()) {
        for from in edges.keys().filter(|from| reached(edges, from).contains(from.as_str())) {
            circles.push(format!("{folder}/{}: `{from}` leads back to itself", room.join("/")));
        }
    }
    circles
}

#[test]
fn files_of_a_room_lead_to_each_other_in_no_circle() {
    let folders = ["src", "tools/cli/src", "tools/python/src", "tools/study/src", "tools/view/src"];
    let circles: Vec<String> = folders.into_iter().flat_map(circles_in).collect();
    assert!(circles.is_empty(), "\n{}", circles.join("\n"));
}

#[test]
fn circles_are_seen() {
    assert_eq!(paths_of_use("a::{b, c::{d, e as f}}"), ["a::b", "a::c::d", "a::c::e"]);
    let modules = modules_of("src");
    let declared = |module: &[&str], named| {
        let module: Path = module.iter().map(|&part| part.to_owned()).collect();
        declared_in(&modules, &module, named, 0).unwrap().join("/")
    };
    assert_eq!(declared(&["denoise", "filter"], "super::kernel::Offsets"), "denoise/kernel");
    assert_eq!(declared(&["pipeline", "pack"], "crate::matrix::BlockSource"), "matrix/source");
}

/// A type that other files see has a name of its own in the library.
#[test]
fn a_type_that_others_see_has_a_name_of_its_own() {
    let declaration = Regex::new(r"(?m)^(pub(?:\([^)]*\))? )(?:struct|enum|trait|type|union) (\w+)").unwrap();
    let mut places: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for (path, module) in modules_of("src") {
        for found in declaration.captures_iter(&module.code) {
            places.entry(found[2].to_owned()).or_default().push(path.join("/"));
        }
    }
    // One of the two is built.
    places.remove("OnGpu");
    let twice: Vec<String> =
        places.iter().filter(|(_, at)| at.len() > 1).map(|(name, at)| format!("{name}: {at:?}")).collect();
    assert!(places.len() > 200 && twice.is_empty(), "\n{}", twice.join("\n"));
}
