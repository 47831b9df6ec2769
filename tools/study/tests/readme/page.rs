//! The parts of pages that code writes: a table from published runs, the command that prints it, and sentences about it.

use super::published::Csv;

/// A part of a page: what follows the first line with a bar below a heading, to the end of the list behind it.
pub(crate) struct Figure {
    /// Its page, from the root of the repository.
    pub(crate) page: &'static str,
    /// The line of its heading.
    pub(crate) heading: &'static str,
    /// Tables in `docs/plots` that it is made from.
    pub(crate) files: &'static [&'static str],
    /// The head and all rows of its table.
    pub(crate) table: fn(&[Csv]) -> Vec<Vec<String>>,
    /// What else the tables say, a sentence or more for each item of the list below.
    pub(crate) says: fn(&[Csv]) -> Vec<String>,
}

/// Letters in a line of a list.
const WIDTH: usize = 140;

impl Figure {
    /// The lines of its part.
    pub(crate) fn lines(&self) -> Vec<String> {
        let files: Vec<Csv> = self.files.iter().map(|name| Csv::published(name)).collect();
        let table = (self.table)(&files);
        let mut lines = Vec::new();
        for (i, row) in table.iter().enumerate() {
            assert_eq!(row.len(), table[0].len(), "{}: {row:?}", self.heading);
            lines.push(format!("| {} |", row.join(" | ")));
            if i == 0 {
                lines.push(format!("|{}", "---|".repeat(row.len())));
            }
        }
        assert!(lines.len() > 2, "{} has no rows", self.heading);
        lines.push(String::new());
        lines.extend(wrapped("", &format!("Measured by {}.", self.sources(&files))));
        let says = (self.says)(&files);
        if !says.is_empty() {
            lines.push(String::new());
        }
        says.iter().for_each(|item| lines.extend(wrapped("- ", item)));
        lines
    }

    /// Commands, machines and commits, each with the tables that came of it.
    fn sources(&self, files: &[Csv]) -> String {
        let folder = if self.page.starts_with("formats/") { "plots" } else { "docs/plots" };
        let mut sources: Vec<(String, Vec<String>)> = Vec::new();
        for file in files {
            let commit = file.commit.as_ref().map_or(String::new(), |commit| format!(", commit {commit}"));
            let by = format!("`{}` on {}{commit}", file.command, file.machine);
            let link = format!("[{name}]({folder}/{name})", name = file.name);
            match sources.iter_mut().find(|source| source.0 == by) {
                Some(source) => source.1.push(link),
                None => sources.push((by, vec![link])),
            }
        }
        let told: Vec<String> = sources.iter().map(|(by, links)| format!("{by}: {}", links.join(", "))).collect();
        told.join("; ")
    }
}

/// Words, with a unit at the number that it belongs to.
fn joined(text: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        let is_unit = ["%", "dB", "×", "ms", "MB", "s"].contains(&word.trim_end_matches([',', ';', '.', ')', ':']));
        match words.last_mut().filter(|_| is_unit) {
            Some(number) => *number += &format!(" {word}"),
            None => words.push(word.to_owned()),
        }
    }
    words
}

/// A paragraph, broken between words.
fn wrapped(begin: &str, text: &str) -> Vec<String> {
    let (mut lines, mut line, mut is_fresh) = (Vec::new(), begin.to_owned(), true);
    for word in joined(text) {
        if !is_fresh && line.chars().count() + 1 + word.chars().count() > WIDTH {
            lines.push(std::mem::replace(&mut line, " ".repeat(begin.len())));
            is_fresh = true;
        }
        if !is_fresh {
            line.push(' ');
        }
        line.push_str(&word);
        is_fresh = false;
    }
    lines.push(line);
    lines
}

/// Where a figure's part begins and ends in a page's lines. A page that has none yet gets it at the end of the section.
pub(crate) fn place(lines: &[&str], heading: &str) -> Option<(usize, usize)> {
    let begin = lines.iter().position(|line| *line == heading)?;
    let end = lines[begin + 1..].iter().position(|line| line.starts_with('#'));
    let end = end.map_or(lines.len(), |length| begin + 1 + length);
    let trimmed = |from: usize, mut to: usize| {
        while to > from && lines[to - 1].trim().is_empty() {
            to -= 1;
        }
        to
    };
    let Some(first) = (begin + 1..end).find(|&i| lines[i].starts_with('|')) else {
        let last = trimmed(begin + 1, end);
        return Some((last, last));
    };
    // The paragraph that names the command may have several lines.
    let (mut last, mut in_source) = (first, false);
    while last < end {
        let line = lines[last];
        in_source = line.starts_with("Measured by ") || (in_source && !line.is_empty());
        let is_ours = in_source || line.is_empty() || ["|", "- ", "  "].iter().any(|begin| line.starts_with(begin));
        if !is_ours {
            break;
        }
        last += 1;
    }
    Some((first, trimmed(first, last)))
}

/// A page with a part replaced by these lines.
pub(crate) fn replaced(page: &str, (first, last): (usize, usize), part: &[String]) -> String {
    let lines: Vec<&str> = page.lines().collect();
    let mut all: Vec<&str> = lines[..first].to_vec();
    if first == last {
        all.push("");
    }
    all.extend(part.iter().map(String::as_str));
    all.extend(&lines[last..]);
    all.join("\n") + "\n"
}

/// Text with any white space as one space: where lines break does not matter.
pub(crate) fn flat(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn a_part_is_found_replaced_and_put_where_there_is_none() {
    let page = "# A\n\ntext\n\n| a |\n|---|\n| 1 |\n\nMeasured by `x` on\na machine.\n\n- one\n  more\n\nhand-written\n\n## B\n\nnone\n\n## C\n";
    let lines: Vec<&str> = page.lines().collect();
    let part = ["| b |".to_owned(), "| 2 |".to_owned()];
    let at = place(&lines, "# A").unwrap();
    assert_eq!((lines[at.0], lines[at.1 - 1]), ("| a |", "  more"));
    assert!(replaced(page, at, &part).contains("text\n\n| b |\n| 2 |\n\nhand-written\n"));
    let at = place(&lines, "## B").unwrap();
    assert!(replaced(page, at, &part).contains("none\n\n| b |\n| 2 |\n\n## C\n"));
    assert_eq!(place(&lines, "## D"), None);
    let long = wrapped("- ", &"word ".repeat(60));
    assert!(long.len() > 1 && long[0].starts_with("- word") && long[1].starts_with("  word"), "{long:?}");
    assert!(long.iter().all(|line| line.chars().count() <= WIDTH));
    assert_eq!(joined("by 2 %), so"), ["by", "2 %),", "so"]);
}
