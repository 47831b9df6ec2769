//! What is done to the selected lights together.

use super::light_list::LightList;
use super::renaming::Renaming;
use crate::mixer::{LightMix, Mix, STOPS_RANGE};
use crate::work::Work;
use ltm::light::LightBasis;

/// Makes a group of the selected lights, whose name can be typed at once.
pub(super) fn group(list: &mut LightList, mix: &mut Mix) {
    let lights: Vec<usize> = list.chosen().iter().copied().collect();
    let group = mix.groups.make("Group", &lights);
    let Some(group) = group else { return };
    let groups = &mix.groups;
    for around in std::iter::successors(Some(group), |&group| groups.group(group).parent) {
        list.folded.remove(&groups.group(around).name);
    }
    list.search.clear();
    list.renamed = Some(Renaming::of(group, &groups.group(group).name));
    if let Some(&first) = lights.first() {
        list.select_all(lights.iter().copied());
        list.scroll_to_selected = first > 0;
    }
}

/// Takes the innermost groups of the selected lights away.
pub(super) fn ungroup(list: &mut LightList, mix: &mut Mix) {
    let groups = &mut mix.groups;
    let mut names: Vec<String> = Vec::new();
    for &light in list.chosen() {
        if let Some(group) = groups.of_light(light) {
            names.push(groups.group(group).name.clone());
        }
    }
    for name in names {
        if let Some(group) = groups.find(&name) {
            groups.dissolve(group);
        }
    }
    list.renamed = None;
}

/// Moves the selected lights into a group, or out of all.
pub(super) fn move_to_group(list: &mut LightList, mix: &mut Mix, group: Option<usize>) {
    let name = group.map(|group| mix.groups.group(group).name.clone());
    for &light in list.chosen() {
        // An emptied group moves the indices of others.
        let group = name.as_ref().and_then(|name| mix.groups.find(name));
        mix.groups.put(light, group);
    }
    list.renamed = None;
}

/// Switches the selected lights: off where any of them is on.
pub(super) fn switch(list: &LightList, mix: &mut Mix) {
    let lights = &mut mix.lights;
    let on = !list.chosen().iter().any(|&light| lights[light].on);
    list.chosen().iter().for_each(|&light| lights[light].on = on);
}

/// Solo on the selected lights together, or an end of it.
pub(super) fn solo(list: &LightList, mix: &mut Mix) {
    let chosen = list.chosen();
    let lights = &mix.lights;
    let is_so = (0..lights.len()).all(|light| lights[light].solo == chosen.contains(&light));
    mix.clear_solo();
    if !is_so {
        chosen.iter().for_each(|&light| mix.lights[light].solo = true);
    }
}

/// Gives the selected lights the settings that were copied; a texture only where it fits.
pub(super) fn paste(list: &LightList, basis: &LightBasis, mix: &mut Mix) {
    let Some(copied) = list.copied.clone() else { return };
    for &light in list.chosen() {
        let own = &mut mix.lights[light];
        let size = basis.lights()[light].layout();
        let fits = copied.pattern.as_ref().is_none_or(|pattern| pattern.size() == size);
        let LightMix { on, stops, tint, .. } = copied;
        *own = match fits {
            true => LightMix { solo: own.solo, ..copied.clone() },
            false => LightMix { on, stops, tint, ..own.clone() },
        };
    }
}

/// Brings the selected lights back to the scene's own lighting.
pub(super) fn reset(list: &LightList, work: &mut Work) {
    for &light in list.chosen() {
        reset_light(work, light);
    }
}

/// Brings a light back to the scene's own lighting; solo stays.
pub(super) fn reset_light(work: &mut Work, light: usize) {
    let solo = work.mix.lights[light].solo;
    work.mix.lights[light] = LightMix { solo, ..work.scene.lights[light].clone() };
}

/// Gives all selected lights the tint of one of them.
pub(super) fn share_tint(list: &LightList, mix: &mut Mix, light: usize) {
    let tint = mix.lights[light].tint;
    if list.chosen().contains(&light) {
        list.chosen().iter().for_each(|&other| mix.lights[other].tint = tint);
    }
}

/// Changes the stops of all selected lights by as much as those of one of them, which become `stops`.
pub(super) fn move_stops(list: &LightList, mix: &mut Mix, light: usize, stops: f32) {
    let before = mix.lights[light].stops;
    for &other in list.chosen() {
        let own = &mut mix.lights[other].stops;
        *own = (*own + stops - before).clamp(*STOPS_RANGE.start(), *STOPS_RANGE.end());
    }
    mix.lights[light].stops = stops;
}
