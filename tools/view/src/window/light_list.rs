//! The mixer's list: what is selected in it, and which rows it shows.

use std::collections::BTreeSet;

use eframe::egui::{Id, Rect};

use super::renaming::Renaming;
use crate::mixer::{LightMix, Mix};
use crate::rows::{Listing, Order, Row, rows};
use ltm::light::LightBasis;

/// Lights and groups from which on a list begins with its groups folded.
const LONG: usize = 60;

pub(super) struct LightList {
    /// The light that the panels speak of; it is among the chosen ones.
    selected: Option<usize>,
    /// All selected lights.
    chosen: BTreeSet<usize>,
    pub(super) search: String,
    pub(super) order: Order,
    /// Names of the groups that show their head alone.
    pub(super) folded: BTreeSet<String>,
    /// Lights that the view in front does not have: they are not listed.
    pub(super) absent: BTreeSet<usize>,
    /// Contribution of each light to the image.
    pub(super) contributions: Vec<f32>,
    /// The contributions by which the rows are sorted, and the order that was chosen then.
    ranked: (Vec<f32>, Order),
    pub(super) scroll_to_selected: bool,
    /// A group whose name is being typed.
    pub(super) renamed: Option<Renaming>,
    /// Settings that were copied from a light.
    pub(super) copied: Option<LightMix>,
    /// The light from which a drag over rows, or a click with Shift, selects.
    pub(super) anchor: Option<usize>,
    /// Where the mixer stands, for files that are dropped on it.
    pub(super) rect: Rect,
}

impl LightList {
    pub(super) fn new(mix: &Mix) -> Self {
        // A group of all would hide them all.
        let is_long = mix.lights.len() > LONG && mix.groups.len() > 1;
        let names = mix.groups.list().iter().map(|group| group.name.clone());
        let selected = (!mix.lights.is_empty()).then_some(0);
        Self {
            selected,
            chosen: selected.into_iter().collect(),
            search: String::new(),
            order: Order::File,
            folded: if is_long { names.collect() } else { BTreeSet::new() },
            absent: BTreeSet::new(),
            contributions: Vec::new(),
            ranked: (Vec::new(), Order::File),
            scroll_to_selected: false,
            renamed: None,
            copied: None,
            anchor: selected,
            rect: Rect::NOTHING,
        }
    }

    pub(super) fn selected(&self) -> Option<usize> {
        self.selected
    }

    /// All selected lights.
    pub(super) fn chosen(&self) -> &BTreeSet<usize> {
        &self.chosen
    }

    /// Selects one light alone.
    pub(super) fn select(&mut self, light: usize) {
        self.select_all([light]);
    }

    /// Selects these lights alone; the first of them is the one that the panels speak of.
    pub(super) fn select_all(&mut self, lights: impl IntoIterator<Item = usize>) {
        let lights: Vec<usize> = lights.into_iter().collect();
        if let Some(&first) = lights.first() {
            (self.selected, self.anchor) = (Some(first), Some(first));
            self.chosen = lights.into_iter().collect();
        }
    }

    /// Adds a light to the selected ones, or takes it out; one at least stays.
    pub(super) fn toggle(&mut self, light: usize) {
        if self.chosen.len() > 1 && self.chosen.remove(&light) {
            self.selected = self.selected.filter(|&own| own != light).or_else(|| self.chosen.first().copied());
        } else {
            self.chosen.insert(light);
            (self.selected, self.anchor) = (Some(light), Some(light));
        }
    }

    /// Selects all lights from the anchor's row to this one's.
    pub(super) fn select_to(&mut self, light: usize, rows: &[Row]) {
        let lights: Vec<usize> = lights_of(rows).collect();
        let at = |light: usize| lights.iter().position(|&other| other == light);
        let (Some(to), from) = (at(light), self.anchor.and_then(at)) else { return };
        let from = from.unwrap_or(to);
        self.chosen = lights[from.min(to)..=from.max(to)].iter().copied().collect();
        self.selected = Some(light);
    }

    /// Selects a light and brings it into view, out of folded groups too.
    pub(super) fn select_and_show(&mut self, light: usize, mix: &Mix) {
        for group in mix.groups.around(light) {
            self.folded.remove(&mix.groups.group(group).name);
        }
        self.select(light);
        self.scroll_to_selected = true;
    }

    /// Follows another container with its lights: what is selected and folded stays where it is still there.
    pub(super) fn go_on(&mut self, old: Self, lights: usize) {
        let chosen: BTreeSet<usize> = old.chosen.into_iter().filter(|&light| light < lights).collect();
        if let Some(first) = old.selected.filter(|&light| light < lights).or_else(|| chosen.first().copied()) {
            (self.selected, self.chosen, self.anchor) = (Some(first), chosen, Some(first));
        }
        (self.search, self.order, self.folded) = (old.search, old.order, old.folded);
    }

    /// The rows as they are shown.
    pub(super) fn rows(&self, basis: &LightBasis, mix: &Mix) -> Vec<Row> {
        let (search, order) = (self.search.as_str(), self.order);
        let (folded, contributions, absent) = (&self.folded, &self.ranked.0, &self.absent);
        rows(basis, &mix.groups, Listing { search, order, folded, contributions, absent })
    }

    /// Sorts the rows anew by what lights bring by now; while the list `is_used`, only where another order was chosen.
    pub(super) fn rank(&mut self, is_used: bool) {
        let is_new = self.ranked.1 != self.order || self.ranked.0.len() != self.contributions.len();
        if is_new || !is_used {
            self.ranked = (self.contributions.clone(), self.order);
        }
    }
}

/// The lights among rows.
pub(super) fn lights_of(rows: &[Row]) -> impl Iterator<Item = usize> {
    rows.iter().filter_map(|row| if let Row::Light { light, .. } = row { Some(*light) } else { None })
}

/// Identity of the search field, for its key.
pub(super) fn search_id() -> Id {
    Id::unique("search lights")
}
