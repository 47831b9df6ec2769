//! Groups of lights: found by their names, or made by hand.

use std::collections::{BTreeMap, BTreeSet};

use ltm::light::LightBasis;

/// One group: lights and other groups that are dimmed, switched and soloed together.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// Name, unique among the groups.
    pub name: String,
    /// Colour by which it is told from others, sRGB.
    pub colour: Option<[u8; 3]>,
    /// The group that it stands in.
    pub parent: Option<usize>,
    /// Whether its lights may shine.
    pub on: bool,
    /// Whether it is soloed: see [`Mix::shines`](super::mixer::Mix::shines).
    pub solo: bool,
    /// Brightness of all that is in it, in stops.
    pub stops: f32,
}

impl Group {
    /// A group that changes nothing.
    pub fn named(name: impl Into<String>) -> Self {
        Self { name: name.into(), colour: None, parent: None, on: true, solo: false, stops: 0.0 }
    }
}

/// All groups, and which light stands in which. A light stands in one group at most; no group is empty or inside itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Groups {
    list: Vec<Group>,
    of_light: Vec<Option<usize>>,
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
    /// No groups over this many lights.
    pub fn none(lights: usize) -> Self {
        Self { list: Vec::new(), of_light: vec![None; lights] }
    }

    /// Lights whose names differ in their last part only (`ceiling/1` and `ceiling/2`, `lamp_a_01` and `lamp_a_02`), where
    /// they are at least two; in the order of their first light.
    pub fn of(basis: &LightBasis) -> Self {
        let mut by_stem: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for (index, light) in basis.lights().iter().enumerate() {
            if let Some(stem) = stem(&light.name) {
                by_stem.entry(stem).or_default().push(index);
            }
        }
        let mut found: Vec<(&str, Vec<usize>)> = by_stem.into_iter().filter(|(_, lights)| lights.len() > 1).collect();
        found.sort_by_key(|(_, lights)| lights[0]);
        let mut groups = Self::none(basis.lights().len());
        for (name, lights) in found {
            lights.into_iter().for_each(|light| groups.of_light[light] = Some(groups.list.len()));
            groups.list.push(Group::named(name));
        }
        groups
    }

    /// Groups as a file tells them: each with its own lights. Names that are taken get a number, a parent that would put a
    /// group into itself is left out, and so is a group without lights.
    pub fn from_parts(parts: Vec<(Group, Vec<usize>)>, lights: usize) -> Self {
        let mut groups = Self::none(lights);
        let parents: Vec<Option<usize>> = parts.iter().map(|(group, _)| group.parent).collect();
        for (index, (group, own)) in parts.into_iter().enumerate() {
            let name = groups.free_name(&group.name);
            groups.list.push(Group { name, parent: None, ..group });
            own.into_iter().filter(|&light| light < lights).for_each(|light| groups.of_light[light] = Some(index));
        }
        for (index, parent) in parents.into_iter().enumerate() {
            groups.nest(index, parent);
        }
        groups.prune();
        groups
    }

    /// The groups.
    pub fn list(&self) -> &[Group] {
        &self.list
    }

    /// Number of groups.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// One group.
    pub fn group(&self, index: usize) -> &Group {
        &self.list[index]
    }

    /// One group, to be changed; its name and parent by [`rename`](Self::rename) and [`nest`](Self::nest).
    pub fn group_mut(&mut self, index: usize) -> &mut Group {
        &mut self.list[index]
    }

    /// All groups, to be changed as with [`group_mut`](Self::group_mut).
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut Group> {
        self.list.iter_mut()
    }

    /// The group of this name.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.list.iter().position(|group| group.name == name)
    }

    /// The group that a light stands in.
    pub fn of_light(&self, light: usize) -> Option<usize> {
        self.of_light.get(light).copied().flatten()
    }

    /// The groups that a light stands in, from the innermost out.
    pub fn around(&self, light: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(self.of_light(light), |&group| self.list[group].parent)
    }

    /// Whether a group is `outer` or inside it.
    pub fn is_inside(&self, group: usize, outer: usize) -> bool {
        std::iter::successors(Some(group), |&group| self.list[group].parent).any(|group| group == outer)
    }

    /// The lights that stand in a group itself.
    pub fn own_lights(&self, group: usize) -> Vec<usize> {
        (0..self.of_light.len()).filter(|&light| self.of_light[light] == Some(group)).collect()
    }

    /// All lights of a group, those of the groups in it too.
    pub fn lights(&self, group: usize) -> Vec<usize> {
        (0..self.of_light.len()).filter(|&light| self.around(light).any(|around| around == group)).collect()
    }

    /// A name that no group has: this one, or with a number behind it.
    pub fn free_name(&self, wanted: &str) -> String {
        let wanted = if wanted.trim().is_empty() { "Group" } else { wanted.trim() };
        let numbered = (2..).map(|number| format!("{wanted} {number}"));
        let mut names = std::iter::once(wanted.to_owned()).chain(numbered);
        names.find(|name| self.find(name).is_none()).unwrap_or_default()
    }

    /// Moves lights into a new group, out of their old ones, and returns its index. The new group is inside the
    /// innermost group that contains them all, unless it would be all of that. Empty groups are removed.
    pub fn make(&mut self, name: &str, lights: &[usize]) -> Option<usize> {
        let first = *lights.first()?;
        let chosen: BTreeSet<usize> = lights.iter().copied().collect();
        let holds_all = |group: &usize| chosen.iter().all(|&light| self.around(light).any(|around| around == *group));
        let parent = self.around(first).find(holds_all).filter(|&group| self.lights(group).len() > chosen.len());
        let group = Group { parent, ..Group::named(self.free_name(name)) };
        let name = group.name.clone();
        let index = self.list.len();
        self.list.push(group);
        let own = self.of_light.iter_mut().enumerate().filter(|(light, _)| chosen.contains(light));
        own.for_each(|(_, of)| *of = Some(index));
        self.prune();
        self.find(&name)
    }

    /// Takes a group away; what is in it stands where it stood.
    pub fn dissolve(&mut self, group: usize) {
        let parent = self.list[group].parent;
        self.of_light.iter_mut().filter(|of| **of == Some(group)).for_each(|of| *of = parent);
        self.list.iter_mut().filter(|other| other.parent == Some(group)).for_each(|other| other.parent = parent);
        self.prune();
    }

    /// Puts a light into a group, or into none.
    pub fn put(&mut self, light: usize, group: Option<usize>) {
        self.of_light[light] = group;
        self.prune();
    }

    /// Puts a group into another, or into none; not into itself or what stands in it. Says whether it could.
    pub fn nest(&mut self, group: usize, parent: Option<usize>) -> bool {
        let fits = parent.is_none_or(|parent| parent < self.list.len() && !self.is_inside(parent, group));
        if fits {
            self.list[group].parent = parent;
        }
        fits
    }

    /// Gives a group a name that no other has; it may get a number.
    pub fn rename(&mut self, group: usize, name: &str) {
        let before = std::mem::take(&mut self.list[group].name);
        let name = if name.trim().is_empty() { before } else { self.free_name(name) };
        self.list[group].name = name;
    }

    /// Takes away what is empty.
    fn prune(&mut self) {
        let is_used: Vec<bool> = (0..self.list.len()).map(|group| !self.lights(group).is_empty()).collect();
        if is_used.iter().all(|used| *used) {
            return;
        }
        let mut count = 0;
        let new: Vec<Option<usize>> = is_used
            .iter()
            .map(|used| {
                count += usize::from(*used);
                used.then(|| count - 1)
            })
            .collect();
        let mut used = is_used.iter();
        self.list.retain(|_| *used.next().unwrap_or(&false));
        let moved = |at: &mut Option<usize>| *at = at.and_then(|at| new[at]);
        self.list.iter_mut().for_each(|group| moved(&mut group.parent));
        self.of_light.iter_mut().for_each(moved);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_lights::lamps as basis;

    #[test]
    fn names_that_differ_in_their_last_part_make_a_group() {
        let basis = basis(&["ceiling/a", "sun", "spot 1", "ceiling/b", "spot 2", "lamp3", "7"]);
        let groups = Groups::of(&basis);
        assert_eq!(groups.len(), 2);
        assert_eq!((groups.group(0), groups.lights(0)), (&Group::named("ceiling"), vec![0, 3]));
        assert_eq!(groups.group(1).name, "spot");
        assert_eq!((groups.of_light(5), groups.of_light(4), groups.of_light(99)), (None, Some(1), None));
    }

    #[test]
    fn a_group_of_one_s_own_stands_in_the_group_that_holds_all_its_lights() {
        let mut groups = Groups::of(&basis(&["row 1", "row 2", "row 3", "desk", "door"]));
        let pair = groups.make("pair", &[0, 1]).unwrap();
        assert_eq!(groups.group(pair).parent, groups.find("row"));
        assert_eq!((groups.lights(0), groups.own_lights(0)), (vec![0, 1, 2], vec![2]));
        let mixed = groups.make("pair", &[1, 3]).unwrap();
        assert_eq!((groups.group(mixed).name.as_str(), groups.group(mixed).parent), ("pair 2", None));
        assert_eq!(groups.around(0).count(), 2);
        // Taking the last light out of a group leaves none of it.
        groups.put(0, None);
        assert!(groups.find("pair").is_none() && groups.find("pair 2").is_some());
        assert_eq!(groups.of_light(1), groups.find("pair 2"), "indices follow");
    }

    #[test]
    fn no_group_stands_in_itself() {
        let mut groups = Groups::of(&basis(&["row 1", "row 2", "row 3"]));
        let inner = groups.make("inner", &[0]).unwrap();
        assert!(!groups.nest(0, Some(inner)) && !groups.nest(0, Some(0)) && !groups.nest(0, Some(9)));
        assert!(groups.nest(inner, None) && groups.nest(0, Some(inner)));
        groups.dissolve(inner);
        assert_eq!((groups.len(), groups.group(0).parent, groups.of_light(0)), (1, None, None));
        groups.rename(0, "  ");
        assert_eq!(groups.group(0).name, "row");
        let looped = |parent| (Group { parent, ..Group::named("a") }, vec![parent.unwrap_or(0)]);
        let read = Groups::from_parts(vec![looped(Some(1)), looped(Some(0)), looped(Some(7))], 2);
        assert!((0..2).all(|light| read.around(light).count() <= 2), "{read:?}");
        assert_eq!(read.list().iter().map(|group| group.name.as_str()).collect::<Vec<_>>(), ["a", "a 2"]);
    }
}
