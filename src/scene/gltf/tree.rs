//! The tree of a file's JSON. Each value is looked at where it is used and nowhere else, so that what is not used cannot refuse a
//! file.
//!
//! A member that is `null` counts as absent, as some libraries write it, and a whole number may have a fraction of zero.

use serde_json::Value;

use super::plain;
use crate::error::{Error, Result};

/// A file's JSON.
pub(super) struct JsonTree {
    root: Value,
    /// The file, for messages.
    place: String,
}

/// A value of the tree, with its path there for messages.
#[derive(Clone)]
pub(super) struct JsonItem<'a> {
    tree: &'a JsonTree,
    value: &'a Value,
    at: String,
}

impl JsonTree {
    pub(super) fn new(root: Value, place: String) -> Self {
        Self { root, place }
    }

    /// The file, for messages.
    pub(super) fn place(&self) -> &str {
        &self.place
    }

    pub(super) fn root(&self) -> JsonItem<'_> {
        JsonItem { tree: self, value: &self.root, at: String::new() }
    }

    /// How long a list of the root is; 0 where there is none.
    pub(super) fn count(&self, list: &str) -> usize {
        self.root.get(list).and_then(Value::as_array).map_or(0, Vec::len)
    }

    /// An item of a list of the root. Errors: it is not there, or no object.
    pub(super) fn item(&self, list: &str, index: usize) -> Result<JsonItem<'_>> {
        let at = format!("{list}[{index}]");
        match self.root.get(list).and_then(|list| list.get(index)) {
            Some(value) if value.is_object() => Ok(JsonItem { tree: self, value, at }),
            Some(_) => Err(self.refuse(&at, "is no object")),
            None => Err(self.refuse(&at, "is not there")),
        }
    }

    fn refuse(&self, at: &str, problem: &str) -> Error {
        let problem = format!("breaks the rules of glTF ({at}: {problem})");
        Error::input(self.place.as_str(), problem, "export the file again as glTF 2.0")
    }
}

impl<'a> JsonItem<'a> {
    /// A member that is there and not `null`.
    fn get(&self, key: &str) -> Option<&'a Value> {
        self.value.get(key).filter(|value| !value.is_null())
    }

    /// A member as it is written.
    pub(super) fn value(&self, key: &str) -> Option<&'a Value> {
        self.get(key)
    }

    pub(super) fn has(&self, key: &str) -> bool {
        self.get(key).is_some()
    }

    /// The names of the members that are not `null`.
    pub(super) fn keys(&self) -> impl Iterator<Item = &'a str> {
        self.value.as_object().into_iter().flatten().filter(|(_, value)| !value.is_null()).map(|(key, _)| key.as_str())
    }

    /// An error for an invalid member.
    pub(super) fn refuse(&self, key: &str, problem: &str) -> Error {
        self.tree.refuse(&self.path(key), problem)
    }

    fn path(&self, key: &str) -> String {
        let key = plain(key);
        if self.at.is_empty() { key } else { format!("{}.{key}", self.at) }
    }

    /// A member as `read` takes it. Errors: it is there, and nothing that `read` takes.
    fn read<T>(&self, key: &str, wanted: &str, read: impl Fn(&'a Value) -> Option<T>) -> Result<Option<T>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        read(value).map(Some).ok_or_else(|| self.refuse(key, &format!("is no {wanted}")))
    }

    pub(super) fn whole(&self, key: &str) -> Result<Option<usize>> {
        self.read(key, "whole number", whole)
    }

    pub(super) fn number(&self, key: &str) -> Result<Option<f32>> {
        self.read(key, "number", |value| value.as_f64().map(|v| v as f32))
    }

    /// The first `N` numbers of a list.
    pub(super) fn numbers<const N: usize>(&self, key: &str) -> Result<Option<[f32; N]>> {
        Ok(self.exact_numbers(key)?.map(|numbers| numbers.map(|number| number as f32)))
    }

    /// As they are written: places in a survey's coordinates have more digits than an f32.
    pub(super) fn exact_numbers<const N: usize>(&self, key: &str) -> Result<Option<[f64; N]>> {
        self.read(key, &format!("list of {N} numbers"), |value| {
            let mut numbers = [0.0; N];
            for (number, value) in numbers.iter_mut().zip(value.as_array().filter(|list| list.len() >= N)?) {
                *number = value.as_f64()?;
            }
            Some(numbers)
        })
    }

    pub(super) fn flag(&self, key: &str) -> Result<Option<bool>> {
        self.read(key, "true or false", Value::as_bool)
    }

    pub(super) fn text(&self, key: &str) -> Result<Option<&'a str>> {
        self.read(key, "text", Value::as_str)
    }

    /// A text that only people read: none where it is empty or something else.
    pub(super) fn name(&self) -> Option<&'a str> {
        self.get("name").and_then(Value::as_str).filter(|name| !name.is_empty())
    }

    pub(super) fn object(&self, key: &str) -> Result<Option<JsonItem<'a>>> {
        let value = self.read(key, "object", |value| value.is_object().then_some(value))?;
        Ok(value.map(|value| JsonItem { tree: self.tree, value, at: self.path(key) }))
    }

    /// The objects of a list; none where there is no list.
    pub(super) fn objects(&self, key: &str) -> Result<Vec<JsonItem<'a>>> {
        let list = self.read(key, "list", Value::as_array)?;
        let objects = list.into_iter().flatten().enumerate().map(|(index, value)| {
            let at = format!("{}[{index}]", self.path(key));
            match value.is_object() {
                true => Ok(JsonItem { tree: self.tree, value, at }),
                false => Err(self.tree.refuse(&at, "is no object")),
            }
        });
        objects.collect()
    }

    /// An index into a list of the root, of which there is as much.
    pub(super) fn index(&self, key: &str, list: &str) -> Result<Option<usize>> {
        let Some(index) = self.read(key, "index", whole)? else { return Ok(None) };
        self.admit(index, key, list).map(Some)
    }

    /// A list of indices into a list of the root; empty where there is none.
    pub(super) fn indices(&self, key: &str, list: &str) -> Result<Vec<usize>> {
        let all = |value: &Value| value.as_array()?.iter().map(whole).collect::<Option<Vec<_>>>();
        let indices = self.read(key, "list of indices", all)?.unwrap_or_default();
        indices.into_iter().map(|index| self.admit(index, key, list)).collect()
    }

    fn admit(&self, index: usize, key: &str, list: &str) -> Result<usize> {
        match index < self.tree.count(list) {
            true => Ok(index),
            false => Err(self.refuse(key, &format!("{list}[{index}] is not there"))),
        }
    }

    /// An extension of this item.
    pub(super) fn extension(&self, name: &str) -> Result<Option<JsonItem<'a>>> {
        match self.object("extensions")? {
            Some(extensions) => extensions.object(name),
            None => Ok(None),
        }
    }
}

fn whole(value: &Value) -> Option<usize> {
    // Above 2⁵³ a fraction of zero says nothing.
    let float = |value: f64| (value.fract() == 0.0 && (0.0..9.0e15).contains(&value)).then_some(value as u64);
    value.as_u64().or_else(|| value.as_f64().and_then(float)).and_then(|value| usize::try_from(value).ok())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn values_are_read_as_they_are_meant_or_refused_with_their_path() {
        let root = json!({
            "list": [{ "a": 2.0, "b": null, "c": [1, 2.5, 3], "d": -1, "e": "x", "extensions": { "E": { "n": 1.5 } } }, 7],
        });
        let tree = JsonTree::new(root, "a.gltf".into());
        let item = tree.item("list", 0).unwrap();
        assert_eq!(item.whole("a").unwrap(), Some(2));
        assert_eq!(item.number("b").unwrap(), None);
        assert_eq!(item.numbers("c").unwrap(), Some([1.0, 2.5]));
        assert_eq!(item.extension("E").unwrap().unwrap().number("n").unwrap(), Some(1.5));
        assert!(item.extension("F").unwrap().is_none());
        let said = |error: Error, words: &str| assert!(error.to_string().contains(words), "{error} for {words}");
        said(item.whole("d").unwrap_err(), "list[0].d: is no whole number");
        said(item.numbers::<4>("c").unwrap_err(), "list[0].c");
        said(item.index("a", "list").unwrap_err(), "list[0].a: list[2] is not there");
        said(item.number("e").unwrap_err(), "list[0].e: is no number");
        said(item.extension("E").unwrap().unwrap().whole("n").unwrap_err(), "list[0].extensions.E.n");
        said(tree.item("list", 1).map(|_| ()).unwrap_err(), "list[1]: is no object");
        said(tree.item("none", 0).map(|_| ()).unwrap_err(), "none[0]: is not there");
    }
}
