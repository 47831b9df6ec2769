//! Names: patterns that choose by name, and the nearest known name to a misspelt one.

use std::collections::HashMap;

/// Names in the order in which they first occur, found again by hash: files have had a hundred thousand groups.
#[derive(Debug, Default)]
pub(super) struct NameList {
    names: Vec<String>,
    index: HashMap<String, usize>,
}

impl NameList {
    /// Index of a name, which is added if it is new.
    pub(super) fn position(&mut self, name: &str) -> usize {
        if let Some(&index) = self.index.get(name) {
            return index;
        }
        self.names.push(name.to_owned());
        self.index.insert(name.to_owned(), self.names.len() - 1);
        self.names.len() - 1
    }

    pub(super) fn as_slice(&self) -> &[String] {
        &self.names
    }
}

/// Whether `name` fits a pattern in which `*` stands for any characters and `?` for one.
pub(super) fn fits(pattern: &str, name: &str) -> bool {
    let (pattern, name): (Vec<char>, Vec<char>) = (pattern.chars().collect(), name.chars().collect());
    let (mut p, mut n) = (0, 0);
    // Where to go on if the characters after the latest star do not fit: the star takes one character more.
    let mut retry = None;
    while n < name.len() {
        match pattern.get(p) {
            Some('*') => {
                retry = Some((p + 1, n));
                p += 1;
            }
            Some(&c) if c == '?' || c == name[n] => (p, n) = (p + 1, n + 1),
            _ => match retry {
                Some((star, taken)) => {
                    retry = Some((star, taken + 1));
                    (p, n) = (star, taken + 1);
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|&c| c == '*')
}

/// The known name that is nearest to `word`, if one is near enough to be meant.
pub(super) fn nearest<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let limit = (word.chars().count() / 3).max(2);
    let scored = known.into_iter().map(|name| (edits(&word.to_lowercase(), &name.to_lowercase()), name));
    scored.filter(|(edits, _)| *edits <= limit).min_by_key(|(edits, _)| *edits).map(|(_, name)| name)
}

/// Least number of characters put in, taken out or replaced to make one word the other.
fn edits(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, &y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_choose_by_name() {
        for (pattern, name) in [("*", ""), ("lum_*", "lum_07"), ("lum_?7", "lum_17"), ("*a*b", "xxaabb"), ("a", "a")] {
            assert!(fits(pattern, name), "{pattern} {name}");
        }
        for (pattern, name) in [("", "a"), ("lum_?", "lum_07"), ("*a", "ab"), ("a*b", "a"), ("a", "A")] {
            assert!(!fits(pattern, name), "{pattern} {name}");
        }
    }

    #[test]
    fn misspelt_names_find_the_known_one() {
        let known = ["texels", "emission", "position"];
        assert_eq!(nearest("texel", known), Some("texels"));
        assert_eq!(nearest("emmision", known), Some("emission"));
        assert_eq!(nearest("colour", known), None);
    }
}
