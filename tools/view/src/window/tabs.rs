//! Several views of one scene in one document: which is in front, and which of them memory holds.

use std::cmp::Reverse;
use std::path::Path;

use eframe::egui;

use super::document::{Document, view_name};
use super::message::Message;
use super::open_view::{OpenView, open_session};
use super::worker_requests::ask_picture;
use crate::mixer::Mix;
use crate::residency::budgets;
use crate::worker::Means;
use ltm::error::Result;

impl Document {
    /// All views in the order of their tabs.
    pub(super) fn views(&self) -> impl Iterator<Item = &OpenView> {
        let (before, after) = self.behind.split_at(self.at);
        before.iter().chain([&self.front]).chain(after)
    }

    /// The tab of a container's file, if it is open.
    pub(super) fn tab_of(&self, path: &Path) -> Option<usize> {
        let real = |path: &Path| std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let wanted = real(path);
        self.views().position(|view| real(&view.session.path) == wanted)
    }

    /// Opens a container as a further view, behind the one in front; its lights join the mix.
    ///
    /// Errors: those of opening it; more lights than a matrix can have.
    pub(super) fn add_view(&mut self, context: &egui::Context, path: &Path) -> Result<()> {
        let session = open_session(context, path)?;
        let name = self.free_view_name(path);
        let before = self.lights.clone();
        let own = self.lights.add(session.basis(), &name)?;
        let scene = Mix::of_scene(self.lights.basis());
        let carry = |mix: &Mix| mix.grown(before.basis(), self.lights.basis(), &scene);
        self.work.grow(scene.clone(), carry);
        for view in std::iter::once(&mut self.front).chain(&mut self.behind) {
            view.compare.snapshots.map_mixes(carry);
        }
        let view = OpenView::new(name, session, own, &self.work.mix, self.opening.state.clone())?;
        self.behind.push(view);
        self.list_lights_of_front();
        Ok(())
    }

    /// Brings the view of a tab to the front. What all views share stays; the view comes with its own zoom.
    pub(super) fn show_tab(&mut self, tab: usize) {
        if tab == self.at || tab > self.behind.len() {
            return;
        }
        let mut view = self.behind.remove(if tab < self.at { tab } else { tab - 1 });
        view.seen_at = self.front.seen_at + 1;
        view.compare.share(&mut self.front.compare);
        let before = std::mem::replace(&mut self.front, view);
        self.behind.insert(if tab < self.at { self.at - 1 } else { self.at }, before);
        self.at = tab;
        self.list_lights_of_front();
        self.share_memory();
    }

    /// Shows the next tab, or one before.
    pub(super) fn step_tab(&mut self, back: bool) {
        let count = self.behind.len() + 1;
        self.show_tab((self.at + if back { count - 1 } else { 1 }) % count);
    }

    /// Closes a tab, if it is not the only one.
    pub(super) fn close_tab(&mut self, tab: usize) {
        if self.behind.is_empty() || tab > self.behind.len() {
            return;
        }
        // Its worker brings what they have done.
        if self.files.any_open() {
            self.message = Some(Message::problem("Files are being read or written; close the tab when that is done"));
            return;
        }
        if tab == self.at {
            self.show_tab(if tab < self.behind.len() { tab + 1 } else { tab - 1 });
        }
        let closed = self.behind.remove(if tab < self.at { tab } else { tab - 1 });
        self.at -= usize::from(tab < self.at);
        self.lights.remove(&closed.lights);
        self.autosave.go_on();
        self.share_memory();
    }

    /// What is to be known of views that do not have the same lights.
    pub(super) fn say_what_is_not_shared(&mut self) {
        if self.behind.is_empty() {
            return;
        }
        let alone =
            self.views().filter(|view| !self.lights.are_shared(&view.lights)).last().map(|view| view.name.clone());
        let text = match (alone, self.lights.counts(self.behind.len() + 1)) {
            (Some(name), _) => {
                format!("{name} has no light in common with the other views: its lights are mixed by themselves")
            }
            (None, (_, 0)) => return,
            (None, (all, some)) => {
                let are = if some == 1 { "is" } else { "are" };
                format!("{some} of {all} lights {are} not in every view; each tab lists those of its view")
            }
        };
        self.message = Some(Message::info(text));
    }

    /// Does something with a view that is behind as if it were in front.
    pub(super) fn with_behind<T>(&mut self, index: usize, act: impl FnOnce(&mut Self) -> T) -> T {
        std::mem::swap(&mut self.front, &mut self.behind[index]);
        let done = act(self);
        std::mem::swap(&mut self.front, &mut self.behind[index]);
        done
    }

    /// Gives the view in front its memory, and takes it from those behind that have no room beside it.
    pub(super) fn share_memory(&mut self) {
        let (front, behind) = self.budgets();
        for (view, budget) in self.behind.iter_mut().zip(behind) {
            if budget.is_none() {
                view.sleep();
            }
        }
        self.front.wake(Means { budget_bytes: front, ..self.opening.means.clone() });
    }

    /// Memory for the view in front, and for those behind that have room beside it, most recently seen first.
    fn budgets(&self) -> (u64, Vec<Option<u64>>) {
        let mut order: Vec<usize> = (0..self.behind.len()).collect();
        order.sort_by_key(|&index| Reverse(self.behind[index].seen_at));
        let behind = order.iter().map(|&index| self.behind[index].needed_bytes);
        let needed: Vec<u64> = std::iter::once(self.front.needed_bytes).chain(behind).collect();
        let memory_bytes = self.opening.means.budget_bytes;
        let found = budgets(&needed, memory_bytes);
        let mut behind = vec![None; order.len()];
        order.into_iter().zip(&found[1..]).for_each(|(index, budget)| behind[index] = *budget);
        (found[0].unwrap_or(memory_bytes), behind)
    }

    /// Once the view in front rests: loads those behind it that memory has room for, one after the other, and has them follow the mix, so
    /// that they are there when they are shown.
    pub(super) fn ask_behind(&mut self, context: &egui::Context, held: bool) {
        if self.behind.is_empty() || held || !self.front.is_lit_by(&self.work.mix) {
            return;
        }
        let is_awake = |view: &OpenView| view.session.worker.is_awake();
        if self.behind.iter().all(|view| !is_awake(view) || view.is_ready()) {
            let (_, budgets) = self.budgets();
            let mut next = self.behind.iter_mut().zip(budgets).filter(|(view, _)| !is_awake(view));
            if let Some((view, budget_bytes)) = next.find_map(|(view, budget)| Some((view, budget?))) {
                view.wake(Means { budget_bytes, ..self.opening.means.clone() });
            }
        }
        for index in 0..self.behind.len() {
            if is_awake(&self.behind[index]) {
                self.with_behind(index, |document| ask_picture(document, context));
            }
        }
    }

    /// Whether those views behind the one in front that memory has room for have followed the mix.
    pub(super) fn are_settled_behind(&self) -> bool {
        let (_, budgets) = self.budgets();
        self.behind.iter().zip(budgets).all(|(view, budget)| budget.is_none() || view.is_lit_by(&self.work.mix))
    }

    /// Lists the lights of the view in front alone, and what they bring to its picture.
    fn list_lights_of_front(&mut self) {
        let all = 0..self.lights.lights().len();
        self.list.absent = all.filter(|&light| self.front.lights.own(light).is_none()).collect();
        self.list.contributions = self.front.contributions(&self.lights);
    }

    /// A name for a tab that no other has.
    fn free_view_name(&self, path: &Path) -> String {
        let name = view_name(path);
        let numbered = (2..).map(|number| format!("{name} {number}"));
        let mut names = std::iter::once(name.clone()).chain(numbered);
        names.find(|name| self.views().all(|view| view.name != *name)).unwrap_or_default()
    }
}
