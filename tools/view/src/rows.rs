//! The rows of the mixer: search, order, folding.

use std::collections::BTreeSet;

use ltm::light::LightBasis;

use super::groups::Groups;

/// A row of the mixer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Row {
    /// Head of a group.
    Group {
        /// Index of the group.
        group: usize,
        /// Groups that it stands in.
        depth: usize,
    },
    /// A light.
    Light {
        /// Index into the basis.
        light: usize,
        /// Groups that it stands in.
        depth: usize,
    },
}

/// Order of the mixer's rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// In the order of the basis.
    #[default]
    File,
    /// By name.
    Name,
    /// By contribution to the image, largest first.
    Contribution,
}

/// The state that determines the rows.
#[derive(Clone, Copy, Debug)]
pub struct Listing<'a> {
    /// Shown are lights whose name, kind or groups hold every word of it.
    pub search: &'a str,
    /// Their order.
    pub order: Order,
    /// Names of the groups that show their head alone; a search unfolds them.
    pub folded: &'a BTreeSet<String>,
    /// Contribution of each light to the image; or empty.
    pub contributions: &'a [f32],
    /// Lights that have no row: those of other views.
    pub absent: &'a BTreeSet<usize>,
}

/// A group with what is in it, or a light.
enum Entry {
    Group { group: usize, inside: Vec<Entry>, sum: f32, first: usize },
    Light { light: usize, value: f32 },
}

/// The rows of the mixer; a group is sorted by the first of its lights, its name, or the sum over its lights.
pub fn rows(basis: &LightBasis, groups: &Groups, listing: Listing) -> Vec<Row> {
    let words: Vec<String> = listing.search.split_whitespace().map(str::to_lowercase).collect();
    let shown = |light: usize| {
        let own = &basis.lights()[light];
        let around = groups.around(light).map(|group| groups.group(group).name.as_str());
        let around = around.collect::<Vec<_>>().join(" ");
        let text = format!("{} {:?} {around}", own.name, own.kind).to_lowercase();
        !listing.absent.contains(&light) && words.iter().all(|word| text.contains(word))
    };
    let lights: Vec<usize> = (0..basis.lights().len()).filter(|&light| shown(light)).collect();
    let entries = entries_of(basis, groups, &listing, &lights, None);
    let mut rows = Vec::new();
    put(&mut rows, groups, (listing.folded, words.is_empty()), &entries, 0);
    rows
}

/// What stands in a group, or in none, of these lights, sorted.
fn entries_of(
    basis: &LightBasis,
    groups: &Groups,
    listing: &Listing,
    lights: &[usize],
    of: Option<usize>,
) -> Vec<Entry> {
    let value = |light: usize| listing.contributions.get(light).copied().unwrap_or(0.0);
    let mut entries = Vec::new();
    for group in (0..groups.len()).filter(|&group| groups.group(group).parent == of) {
        let own: Vec<usize> =
            lights.iter().copied().filter(|&light| groups.around(light).any(|around| around == group)).collect();
        if let Some(&first) = own.iter().min() {
            let sum = own.iter().map(|&light| value(light)).sum();
            entries.push(Entry::Group {
                group,
                inside: entries_of(basis, groups, listing, &own, Some(group)),
                sum,
                first,
            });
        }
    }
    let own = lights.iter().copied().filter(|&light| groups.of_light(light) == of);
    entries.extend(own.map(|light| Entry::Light { light, value: value(light) }));
    let name = |entry: &Entry| match entry {
        Entry::Group { group, .. } => natural(&groups.group(*group).name),
        Entry::Light { light, .. } => natural(&basis.lights()[*light].name),
    };
    match listing.order {
        Order::File => entries.sort_by_key(|entry| match entry {
            Entry::Group { first, .. } => *first,
            Entry::Light { light, .. } => *light,
        }),
        Order::Name => entries.sort_by_cached_key(name),
        Order::Contribution => {
            let brings = |entry: &Entry| match entry {
                Entry::Group { sum, .. } => *sum,
                Entry::Light { value, .. } => *value,
            };
            entries.sort_by(|a, b| brings(b).total_cmp(&brings(a)));
        }
    }
    entries
}

fn put(rows: &mut Vec<Row>, groups: &Groups, folding: (&BTreeSet<String>, bool), entries: &[Entry], depth: usize) {
    for entry in entries {
        match entry {
            Entry::Light { light, .. } => rows.push(Row::Light { light: *light, depth }),
            Entry::Group { group, inside, .. } => {
                rows.push(Row::Group { group: *group, depth });
                let (folded, folds) = folding;
                if !(folds && folded.contains(&groups.group(*group).name)) {
                    put(rows, groups, folding, inside, depth + 1);
                }
            }
        }
    }
}

/// A name cut into text and numbers, so that `lamp 10` comes after `lamp 9`.
pub(super) fn natural(name: &str) -> Vec<(String, u64)> {
    let mut parts = vec![(String::new(), 0u64)];
    let mut in_number = false;
    for c in name.chars() {
        let (text, number) = parts.last_mut().expect("there is always one");
        match c.to_digit(10) {
            Some(digit) => {
                *number = number.saturating_mul(10).saturating_add(u64::from(digit));
                in_number = true;
            }
            None if in_number => {
                parts.push((c.to_lowercase().collect(), 0));
                in_number = false;
            }
            None => text.extend(c.to_lowercase()),
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_lights::lamps as basis;

    fn lights(rows: &[Row]) -> Vec<usize> {
        let light = |row: &Row| if let Row::Light { light, .. } = row { Some(*light) } else { None };
        rows.iter().filter_map(light).collect()
    }

    fn listing_of(folded: &BTreeSet<String>) -> Listing<'_> {
        static NONE: BTreeSet<usize> = BTreeSet::new();
        Listing { search: "", order: Order::File, folded, contributions: &[], absent: &NONE }
    }

    #[test]
    fn rows_are_searched_ordered_and_folded() {
        let basis = basis(&["spot 10", "sun", "spot 9", "door"]);
        let groups = Groups::of(&basis);
        let mut folded = BTreeSet::new();
        let all = |search: &str, order, folded: &_| {
            let contributions = &[1.0, 5.0, 2.0, 0.0];
            rows(&basis, &groups, Listing { search, order, contributions, ..listing_of(folded) })
        };
        assert_eq!(lights(&all("", Order::File, &folded)), [0, 2, 1, 3]);
        assert_eq!(lights(&all("", Order::Name, &folded)), [3, 2, 0, 1]);
        assert_eq!(lights(&all("", Order::Contribution, &folded)), [1, 2, 0, 3]);
        assert_eq!(lights(&all("SPOT 9", Order::File, &folded)), [2]);
        assert_eq!(all("nothing", Order::File, &folded), []);
        folded.insert("spot".to_owned());
        assert_eq!(all("", Order::File, &folded)[0], Row::Group { group: 0, depth: 0 });
        assert_eq!(lights(&all("", Order::File, &folded)), [1, 3]);
        assert_eq!(lights(&all("spot", Order::File, &folded)), [0, 2], "a search unfolds");
    }

    #[test]
    fn groups_in_groups_are_indented_and_found_by_their_names() {
        let basis = basis(&["row 1", "row 2", "row 3", "door"]);
        let mut groups = Groups::of(&basis);
        let pair = groups.make("pair", &[0, 2]).unwrap();
        let folded = BTreeSet::new();
        let absent = BTreeSet::from([1]);
        let listing = |search| Listing { search, order: Order::File, ..listing_of(&folded) };
        let expected = [
            Row::Group { group: 0, depth: 0 },
            Row::Group { group: pair, depth: 1 },
            Row::Light { light: 0, depth: 2 },
            Row::Light { light: 2, depth: 2 },
            Row::Light { light: 1, depth: 1 },
            Row::Light { light: 3, depth: 0 },
        ];
        assert_eq!(rows(&basis, &groups, listing("")), expected);
        assert_eq!(lights(&rows(&basis, &groups, listing("pair"))), [0, 2]);
        assert_eq!(lights(&rows(&basis, &groups, Listing { absent: &absent, ..listing("") })), [0, 2, 3]);
        assert_eq!(
            rows(&basis, &groups, Listing { absent: &(0..3).collect(), ..listing("") }).len(),
            1,
            "no empty groups"
        );
    }

    #[test]
    fn a_thousand_lights_keep_one_row_each() {
        let names: Vec<String> = (0..1000).map(|i| format!("row{}/lamp{i}", i % 20)).collect();
        let basis = basis(&names.iter().map(String::as_str).collect::<Vec<_>>());
        let (groups, folded) = (Groups::of(&basis), BTreeSet::new());
        let listing = Listing { order: Order::Contribution, ..listing_of(&folded) };
        let rows = rows(&basis, &groups, listing);
        let mut found = lights(&rows);
        found.sort_unstable();
        assert_eq!(found, (0..1000).collect::<Vec<_>>());
        assert_eq!(rows.len(), 1020);
    }
}
