//! Names: lists that find them again, and the nearest known name to a misspelt one.

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
    fn misspelt_names_find_the_known_one() {
        let known = ["texels", "emission", "position"];
        assert_eq!(nearest("texel", known), Some("texels"));
        assert_eq!(nearest("emmision", known), Some("emission"));
        assert_eq!(nearest("colour", known), None);
    }
}
