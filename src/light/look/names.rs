//! The names that were perhaps meant.

use crate::light::names::edit_distance;

/// "did you mean …" with up to three of the nearest names, or what there is.
pub(super) fn nearest<'a>(name: &str, among: impl Iterator<Item = &'a str>) -> String {
    let mut ranked: Vec<_> =
        among.map(|other| (edit_distance(&name.to_lowercase(), &other.to_lowercase()), other)).collect();
    ranked.sort();
    ranked.truncate(3);
    if ranked.is_empty() {
        return "there are none".into();
    }
    let quoted: Vec<_> = ranked.iter().map(|(_, other)| format!("'{other}'")).collect();
    format!("the nearest names are {}", quoted.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_comes_first() {
        assert!(nearest("pannel", ["lamp", "panel", "sky"].into_iter()).starts_with("the nearest names are 'panel'"));
    }
}
