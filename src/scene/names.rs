//! Names: lists that find them again, names that are given once, and the nearest known name to a misspelt one.

use std::collections::HashMap;

use crate::light::names::edit_distance;

/// Names in the order in which they first occur, found again by hash: files have had a hundred thousand groups.
#[derive(Debug, Default)]
pub(super) struct NameList {
    names: Vec<String>,
    index: HashMap<String, usize>,
    text_bytes: usize,
}

impl NameList {
    /// Index of a name, which is added if it is new.
    pub(super) fn position(&mut self, name: &str) -> usize {
        if let Some(&index) = self.index.get(name) {
            return index;
        }
        self.text_bytes += name.len();
        self.names.push(name.to_owned());
        self.index.insert(name.to_owned(), self.names.len() - 1);
        self.names.len() - 1
    }

    /// Bytes that it holds: each text twice, and its places in list and table.
    pub(super) fn bytes(&self) -> u64 {
        (2 * self.text_bytes + 160 * self.names.len()) as u64
    }

    pub(super) fn as_slice(&self) -> &[String] {
        &self.names
    }
}

/// Names of which none is given twice.
#[derive(Default)]
pub(super) struct UniqueNames {
    /// How often each name was asked for or given.
    taken: HashMap<String, usize>,
}

impl UniqueNames {
    /// Reserves these names.
    pub(super) fn beside(names: impl Iterator<Item = String>) -> Self {
        Self { taken: names.map(|name| (name, 1)).collect() }
    }

    /// The name, with a number behind it where it is taken.
    pub(super) fn unique(&mut self, name: String) -> String {
        let mut number = *self.taken.entry(name.clone()).and_modify(|count| *count += 1).or_insert(1);
        if number == 1 {
            return name;
        }
        loop {
            let numbered = format!("{name} {number}");
            if !self.taken.contains_key(&numbered) {
                self.taken.insert(numbered.clone(), 1);
                self.taken.insert(name, number);
                return numbered;
            }
            number += 1;
        }
    }
}

/// The known name that is nearest to `word`, if one is near enough to be meant.
pub(super) fn nearest<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let limit = (word.chars().count() / 3).max(2);
    let scored = known.into_iter().map(|name| (edit_distance(&word.to_lowercase(), &name.to_lowercase()), name));
    scored.filter(|(edits, _)| *edits <= limit).min_by_key(|(edits, _)| *edits).map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_name_is_given_twice() {
        let mut names = UniqueNames::default();
        let given = ["a", "a 2", "a", "a", "b"].map(|name| names.unique(name.into()));
        assert_eq!(given, ["a", "a 2", "a 3", "a 4", "b"]);
        let mut names = UniqueNames::beside(["a".into(), "b 2".into()].into_iter());
        assert_eq!(["a", "b", "b"].map(|name| names.unique(name.into())), ["a 2", "b", "b 3"]);
    }

    #[test]
    fn misspelt_names_find_the_known_one() {
        let known = ["texels", "emission", "position"];
        assert_eq!(nearest("texel", known), Some("texels"));
        assert_eq!(nearest("emmision", known), Some("emission"));
        assert_eq!(nearest("colour", known), None);
    }
}
