//! The page: its modules joined into one script, inside of one HTML file that loads nothing from elsewhere.

use sha2::{Digest, Sha256};

use super::base64::base64;
use super::deflate;

/// The modules in an order in which each stands behind those that it uses while the script is read.
const MODULES: [(&str, &str); 16] = [
    ("checksum.js", include_str!("../../page/src/checksum.js")),
    ("colour.js", include_str!("../../page/src/colour.js")),
    ("coder.js", include_str!("../../page/src/coder.js")),
    ("codec.js", include_str!("../../page/src/codec.js")),
    ("blocks.js", include_str!("../../page/src/blocks.js")),
    ("worker.js", include_str!("../../page/src/worker.js")),
    ("stream.js", include_str!("../../page/src/stream.js")),
    ("mix.js", include_str!("../../page/src/mix.js")),
    ("webgl.js", include_str!("../../page/src/webgl.js")),
    ("webgpu.js", include_str!("../../page/src/webgpu.js")),
    ("engine.js", include_str!("../../page/src/engine.js")),
    ("around.js", include_str!("../../page/src/around.js")),
    ("view.js", include_str!("../../page/src/view.js")),
    ("mixer.js", include_str!("../../page/src/mixer.js")),
    ("stage.js", include_str!("../../page/src/stage.js")),
    ("main.js", include_str!("../../page/src/main.js")),
];
const STYLE: &str = include_str!("../../page/src/page.css");
const FRAME: &str = include_str!("../../page/src/page.html");

/// The kernels that the page shares with the GPU relighter, by the name that the page knows them by.
const KERNELS: [(&str, &[&str]); 3] = [
    ("reconstruct", &[LAYOUT, FACTORS, include_str!("../../shaders/reconstruct.wgsl")]),
    ("scatter", &[LAYOUT, include_str!("../../shaders/scatter.wgsl")]),
    ("tone", &[LAYOUT, include_str!("../../shaders/tone.wgsl")]),
];
const LAYOUT: &str = include_str!("../../shaders/layout.wgsl");
const FACTORS: &str = include_str!("../../shaders/factors.wgsl");

/// Unpacks the script, a third of its size, and runs it: a browser that knows the data's compression knows the script's.
const LOADER: &str = include_str!("../../page/src/loader.js");

/// The page that fetches its data from files beside it: for each view its name, which its tab shows if there are several, and its file's.
pub fn page(title: &str, views: &[(&str, &str)]) -> String {
    let meta = |(view, file): &(&str, &str)| {
        let view = named(view, views.len());
        format!("<meta name=\"ltm-data\" content=\"{}\"{view}>", escaped(file))
    };
    assemble(title, &views.iter().map(meta).collect::<String>())
}

/// The page with its data inside, for each view its name and its data.
pub fn page_with_data(title: &str, views: &[(&str, &[u8])]) -> String {
    // Of a type that no browser runs: a block of data.
    let block = |(view, data): &(&str, &[u8])| {
        let view = named(view, views.len());
        format!("<script type=\"application/vnd.ltm.share\"{view}>{}</script>", base64(data))
    };
    assemble(title, &views.iter().map(block).collect::<String>())
}

/// The attribute that names one of so many views.
fn named(view: &str, views: usize) -> String {
    if views > 1 { format!(" data-view=\"{}\"", escaped(view)) } else { String::new() }
}

fn assemble(title: &str, data: &str) -> String {
    let (script, style) = (script(), lean(STYLE));
    let hash = |text: &str| base64(&Sha256::digest(text.as_bytes()));
    // The two scripts are known by their hashes. Workers are made of the script's own text. Nothing is fetched but the data beside
    // the page.
    let policy = format!(
        "default-src 'none'; script-src 'sha256-{}' 'sha256-{}'; style-src 'sha256-{}'; connect-src 'self'; worker-src blob:; \
         img-src blob: data:; base-uri 'none'; form-action 'none'",
        hash(LOADER),
        hash(&script),
        hash(&style)
    );
    lean(FRAME)
        .replace("%policy%", &policy)
        .replace("%data%", data)
        .replace("%style%", &style)
        .replace("%loader%", LOADER)
        .replace("%packed%", &base64(&deflate(script.as_bytes())))
        // The last, since it is the author's and may say anything.
        .replace("%title%", &escaped(title))
}

/// All modules joined into one script.
fn script() -> String {
    let kernels = KERNELS.map(|(name, parts)| format!("{name}: `{}`", lean(&parts.concat())));
    let mut script = format!("'use strict';\nconst KERNELS = {{ {} }};\n", kernels.join(",\n"));
    for (_, text) in MODULES {
        for line in lean(text).lines().filter(|line| !line.starts_with("import ")) {
            script += line.strip_prefix("export ").unwrap_or(line);
            script.push('\n');
        }
    }
    script
}

/// A text without indentation, blank lines, and comments but for those behind code.
fn lean(text: &str) -> String {
    let mut lean = String::with_capacity(text.len());
    let mut in_comment = false;
    for line in text.lines() {
        let mut rest = line.trim();
        let mut code = String::new();
        while !rest.is_empty() {
            let mark = if in_comment { "*/" } else { "/**" };
            let (before, after) = rest.split_once(mark).unwrap_or((rest, ""));
            if !in_comment {
                code += before;
            }
            in_comment ^= rest.len() > before.len();
            rest = after;
        }
        let code = code.trim();
        if !code.is_empty() && !code.starts_with("//") {
            lean += code;
            lean.push('\n');
        }
    }
    lean
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn comments_and_indentation_are_left_out() {
        let text = "/** a\n * b\n */\nlet a = 1; // kept\n\n    // gone\n  b(/** c */ e);\n/** c */\n/** f */ (d)();";
        assert_eq!(lean(text), "let a = 1; // kept\nb( e);\n(d)();\n");
    }

    #[test]
    fn workgroups_are_counted_as_the_kernels_take_them() {
        let text = MODULES.iter().find(|(name, _)| *name == "webgpu.js").expect("it is a module").1;
        let number = |before: &str, text: &str| {
            let rest = text.split_once(before).unwrap_or_else(|| panic!("there is no '{before}'")).1;
            rest.chars().take_while(char::is_ascii_digit).collect::<String>()
        };
        assert_eq!(number("const THREADS = ", text), number("const THREADS: u32 = ", LAYOUT));
    }

    #[test]
    fn modules_import_on_one_line_from_those_before_them_and_share_no_name() {
        let mut names: BTreeMap<&str, &str> = BTreeMap::new();
        for (at, (module, text)) in MODULES.iter().enumerate() {
            for line in text.lines() {
                if line.starts_with("import ") {
                    let from = line.split('\'').nth(1).unwrap_or_else(|| panic!("{module}: {line}"));
                    let from = from.trim_start_matches("./");
                    let found = MODULES[..at].iter().any(|(name, _)| *name == from) || from == "kernels.js";
                    assert!(found && line.ends_with(';'), "{module}: {line}");
                }
                let plain = line.strip_prefix("export ").unwrap_or(line);
                let words: Vec<&str> = plain.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
                let name = match words[..] {
                    ["const" | "let" | "function" | "class", name, ..] => name,
                    ["async", "function", name, ..] => name,
                    _ => continue,
                };
                if let Some(other) = names.insert(name, module) {
                    panic!("`{name}` stands in {other} and in {module}");
                }
            }
        }
    }

    #[test]
    fn the_page_holds_no_foreign_address_and_no_end_of_a_script() {
        let page = page("a <b>", &[("", "picture.lts")]);
        assert_eq!(page.matches("</script>").count(), 2);
        assert!(!script().contains("</script"));
        assert!(page.contains("a &lt;b&gt;") && !page.contains("%policy%") && !page.contains("data-view"));
        let all = [page.as_str(), &script()].concat();
        for line in all.lines().filter(|line| line.contains("http") || line.contains("//")) {
            assert!(line.contains("http-equiv") || !line.contains("://"), "{line}");
        }
    }
}
