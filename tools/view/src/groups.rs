//! Groups of lights, and the rows of the mixer: search, order, folding.

use std::collections::{BTreeMap, BTreeSet};

use ltm::light::LightBasis;

/// Lights whose names differ in their last part only: `ceiling/1` and `ceiling/2`, `lamp_a_01` and `lamp_a_02`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Groups {
    groups: Vec<Group>,
    of_light: Vec<Option<usize>>,
}

/// One group.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// What its lights' names begin with.
    pub name: String,
    /// Its lights, as indices into the basis.
    pub lights: Vec<usize>,
}

/// What a line of the mixer shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Row {
    /// Head of a group.
    Group(usize),
    /// A light; `indented` where it stands below the head of its group.
    Light {
        /// Index into the basis.
        light: usize,
        /// Whether it stands below its group's head.
        indented: bool,
    },
}

/// Order of the mixer's rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// As in the basis.
    #[default]
    File,
    /// By name.
    Name,
    /// Those that bring most to the picture first.
    Contribution,
}

/// The part of a name that its group shares: what stands before the last `/`, or before a final number and the
/// separator in front of it. None if nothing is left.
fn stem(name: &str) -> Option<&str> {
    let stem = match name.rsplit_once(['/', ':']) {
        Some((stem, _)) => stem,
        None => {
            let without_number = name.trim_end_matches(|c: char| c.is_ascii_digit());
            if without_number.len() == name.len() {
                return None;
            }
            without_number.trim_end_matches(['.', '_', '-', ' ', '#'])
        }
    };
    (!stem.is_empty()).then_some(stem)
}

impl Groups {
    /// The groups of at least two lights, in the order of their first light.
    pub fn of(basis: &LightBasis) -> Self {
        let mut by_stem: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for (index, light) in basis.lights().iter().enumerate() {
            if let Some(stem) = stem(&light.name) {
                by_stem.entry(stem).or_default().push(index);
            }
        }
        let mut groups: Vec<Group> = by_stem
            .into_iter()
            .filter(|(_, lights)| lights.len() > 1)
            .map(|(name, lights)| Group { name: name.to_owned(), lights })
            .collect();
        groups.sort_by_key(|group| group.lights[0]);
        let mut of_light = vec![None; basis.lights().len()];
        for (index, group) in groups.iter().enumerate() {
            group.lights.iter().for_each(|&light| of_light[light] = Some(index));
        }
        Self { groups, of_light }
    }

    /// Number of groups.
    pub fn len(&self) -> usize {
        self.groups.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.groups.is_empty()
    }

    /// One group.
    pub fn group(&self, index: usize) -> &Group {
        &self.groups[index]
    }

    /// The group of a light.
    pub fn of_light(&self, light: usize) -> Option<usize> {
        self.of_light.get(light).copied().flatten()
    }

    /// The rows of the mixer: lights whose name or kind holds every word of `search`, folded groups as their head
    /// alone (a search unfolds them), groups ordered by their sum. `contributions`: one value per light, or empty.
    pub fn rows(
        &self,
        basis: &LightBasis,
        search: &str,
        order: Order,
        folded: &BTreeSet<usize>,
        contributions: &[f32],
    ) -> Vec<Row> {
        let words: Vec<String> = search.split_whitespace().map(str::to_lowercase).collect();
        let shown = |light: usize| {
            let light = &basis.lights()[light];
            let text = format!("{} {:?}", light.name, light.kind).to_lowercase();
            words.iter().all(|word| text.contains(word))
        };
        let value = |light: usize| contributions.get(light).copied().unwrap_or(0.0);
        let name = |light: usize| basis.lights()[light].name.as_str();
        let sorted = |lights: &mut Vec<usize>| match order {
            Order::File => lights.sort_unstable(),
            Order::Name => lights.sort_by_cached_key(|&light| natural(name(light))),
            Order::Contribution => lights.sort_by(|&a, &b| value(b).total_cmp(&value(a))),
        };
        let mut entries: Vec<(Option<usize>, Vec<usize>)> = Vec::new();
        for (index, group) in self.groups.iter().enumerate() {
            let mut lights: Vec<usize> = group.lights.iter().copied().filter(|&light| shown(light)).collect();
            sorted(&mut lights);
            if !lights.is_empty() {
                entries.push((Some(index), lights));
            }
        }
        let alone = (0..basis.lights().len()).filter(|&light| self.of_light(light).is_none() && shown(light));
        entries.extend(alone.map(|light| (None, vec![light])));
        let title = |entry: &(Option<usize>, Vec<usize>)| entry.0.map_or(name(entry.1[0]), |g| &self.groups[g].name);
        let sum = |entry: &(Option<usize>, Vec<usize>)| entry.1.iter().map(|&light| value(light)).sum::<f32>();
        match order {
            Order::File => entries.sort_by_key(|entry| entry.1.iter().copied().min()),
            Order::Name => entries.sort_by_cached_key(|entry| natural(title(entry))),
            Order::Contribution => entries.sort_by(|a, b| sum(b).total_cmp(&sum(a))),
        }
        let mut rows = Vec::new();
        for (group, lights) in entries {
            if let Some(group) = group {
                rows.push(Row::Group(group));
                if folded.contains(&group) && words.is_empty() {
                    continue;
                }
            }
            rows.extend(lights.into_iter().map(|light| Row::Light { light, indented: group.is_some() }));
        }
        rows
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
    use ltm::light::{Light, LightKind};

    fn basis(names: &[&str]) -> LightBasis {
        let mut basis = LightBasis::new();
        for name in names {
            let light = Light::unplaced(*name, LightKind::Lamp);
            basis.push(light).unwrap();
        }
        basis
    }

    fn lights(rows: &[Row]) -> Vec<usize> {
        let light = |row: &Row| if let Row::Light { light, .. } = row { Some(*light) } else { None };
        rows.iter().filter_map(light).collect()
    }

    #[test]
    fn names_that_differ_in_their_last_part_make_a_group() {
        let basis = basis(&["ceiling/a", "sun", "spot 1", "ceiling/b", "spot 2", "lamp3", "7"]);
        let groups = Groups::of(&basis);
        assert_eq!(groups.len(), 2);
        assert_eq!(groups.group(0), &Group { name: "ceiling".into(), lights: vec![0, 3] });
        assert_eq!(groups.group(1).name, "spot");
        assert_eq!((groups.of_light(5), groups.of_light(4), groups.of_light(99)), (None, Some(1), None));
    }

    #[test]
    fn rows_are_searched_ordered_and_folded() {
        let basis = basis(&["spot 10", "sun", "spot 9", "door"]);
        let groups = Groups::of(&basis);
        let mut folded = BTreeSet::new();
        let rows = |search: &str, order, folded: &_| groups.rows(&basis, search, order, folded, &[1.0, 5.0, 2.0, 0.0]);
        assert_eq!(lights(&rows("", Order::File, &folded)), [0, 2, 1, 3]);
        assert_eq!(lights(&rows("", Order::Name, &folded)), [3, 2, 0, 1]);
        assert_eq!(lights(&rows("", Order::Contribution, &folded)), [1, 2, 0, 3]);
        assert_eq!(lights(&rows("SPOT 9", Order::File, &folded)), [2]);
        assert_eq!(rows("nothing", Order::File, &folded), []);
        folded.insert(0);
        assert_eq!(rows("", Order::File, &folded)[0], Row::Group(0));
        assert_eq!(lights(&rows("", Order::File, &folded)), [1, 3]);
        assert_eq!(lights(&rows("spot", Order::File, &folded)), [0, 2], "a search unfolds");
    }

    #[test]
    fn a_thousand_lights_keep_one_row_each() {
        let names: Vec<String> = (0..1000).map(|i| format!("row{}/lamp{i}", i % 20)).collect();
        let basis = basis(&names.iter().map(String::as_str).collect::<Vec<_>>());
        let groups = Groups::of(&basis);
        let rows = groups.rows(&basis, "", Order::Contribution, &BTreeSet::new(), &[]);
        let mut found = lights(&rows);
        found.sort_unstable();
        assert_eq!(found, (0..1000).collect::<Vec<_>>());
        assert_eq!(rows.len(), 1020);
    }
}
