//! Names of lights and of what scene files name: patterns that choose, and how far a misspelt name is from another.

/// Whether `name` fits `pattern`, where `*` stands for any letters and `?` for one.
pub fn fits(pattern: &str, name: &str) -> bool {
    let (pattern, name): (Vec<char>, Vec<char>) = (pattern.chars().collect(), name.chars().collect());
    // The last star, and the letter up to which it matches: on a mismatch it takes one more.
    let (mut p, mut n, mut star) = (0, 0, None);
    while n < name.len() {
        if p < pattern.len() && pattern[p] == '*' {
            star = Some((p, n));
            p += 1;
        } else if p < pattern.len() && (pattern[p] == '?' || pattern[p] == name[n]) {
            (p, n) = (p + 1, n + 1);
        } else if let Some((at, taken)) = star {
            star = Some((at, taken + 1));
            (p, n) = (at + 1, taken + 1);
        } else {
            return false;
        }
    }
    pattern[p..].iter().all(|&letter| letter == '*')
}

/// Which of `names` a pattern means: the one that is spelled so, else those that fit it. A name may hold a `*` of its own.
pub fn meant<'a>(pattern: &str, names: impl Iterator<Item = &'a str>) -> Vec<usize> {
    let names: Vec<&str> = names.collect();
    match names.iter().position(|name| *name == pattern) {
        Some(exact) => vec![exact],
        None => (0..names.len()).filter(|&index| fits(pattern, names[index])).collect(),
    }
}

/// Levenshtein's distance: insertions, deletions and replacements.
pub fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

/// "the nearest names are …" with up to three of those that are there, or that there are none.
pub fn suggest<'a>(name: &str, among: impl Iterator<Item = &'a str>) -> String {
    let mut ranked: Vec<_> =
        among.map(|other| (edit_distance(&name.to_lowercase(), &other.to_lowercase()), other)).collect();
    ranked.sort();
    ranked.dedup();
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
    fn globs_fit_what_they_say() {
        for (pattern, name) in [("*", ""), ("a*c", "abbbc"), ("a*b*c", "aXbXbc"), ("?b", "ab"), ("lamp 1*", "lamp 12")]
        {
            assert!(fits(pattern, name), "{pattern} {name}");
        }
        for (pattern, name) in [("a", "b"), ("a*c", "abb"), ("?", ""), ("", "a")] {
            assert!(!fits(pattern, name), "{pattern} {name}");
        }
    }

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
    fn a_name_comes_before_its_reading_as_a_glob() {
        let names = ["Lamp*", "Lamp*1", "Lamp 2"];
        assert_eq!(meant("Lamp*", names.into_iter()), [0]);
        assert_eq!(meant("Lamp?1", names.into_iter()), [1]);
        assert_eq!(meant("L*", names.into_iter()), [0, 1, 2]);
        assert!(meant("x", names.into_iter()).is_empty());
    }

    #[test]
    fn the_nearest_name_comes_first() {
        assert!(suggest("pannel", ["lamp", "panel", "sky"].into_iter()).starts_with("the nearest names are 'panel'"));
        assert_eq!(suggest("x", std::iter::empty()), "there are none");
    }

    #[test]
    fn edits_are_counted() {
        assert_eq!(edit_distance("kitten", "sitting"), 3);
    }
}
