//! The window over several views of one scene.

use std::path::{Path, PathBuf};

use eframe::egui;

use super::App;
use crate::recent::RecentKind;
use crate::window::chooser::Purpose;
use crate::window::document::Document;
use crate::window::file_jobs::name_of;
use crate::window::message::Message;
use ltm::error::{Error, Result};
use ltm::scene::is_scene_file;
use ltm_cli::sequence;

impl App {
    /// Opens containers as views of one scene, or one scene, instead of what is open, whose work is not kept.
    pub fn open_all(&mut self, context: &egui::Context, paths: &[PathBuf]) {
        let [first, others @ ..] = paths else { return };
        if others.is_empty() {
            match sequence::frames(first, None) {
                Ok(Some(frames)) => self.open_frames(context, frames),
                Ok(None) => drop(self.open(context, first)),
                Err(error) => self.refuse(context, error),
            }
            return;
        }
        if let Some(scene) = paths.iter().find(|path| is_scene_file(path)) {
            return self.refuse(context, is_no_view(scene));
        }
        if self.open(context, first) {
            self.add_views(context, others, false);
        }
    }

    /// Opens the containers of an animation's frames.
    fn open_frames(&mut self, context: &egui::Context, frames: Vec<(usize, PathBuf)>) {
        if let Some((_, scene)) = frames.iter().find(|(_, path)| is_scene_file(path)) {
            return self.refuse(context, is_no_view(scene));
        }
        if self.open(context, &frames[0].1)
            && let Some(document) = &mut self.document
        {
            document.go_through(frames);
        }
    }

    /// Asks for containers to be opened beside the view in front.
    pub(super) fn choose_views(&mut self, context: &egui::Context) {
        let Some(document) = &mut self.document else { return };
        if document.frames.is_some() {
            document.message = Some(Message::info("An animation is gone through by itself; open views without it"));
            return;
        }
        if self.rendering.is_some() {
            let text =
                "A scene that is rendered stands alone; open its container when it is finished, and others beside it";
            document.message = Some(Message::info(text));
            return;
        }
        let near = document.front.session.path.clone();
        self.begin_choosing(context, Purpose::View, &near);
    }

    /// Opens containers beside the view in front; `shows` the last of them.
    pub(super) fn add_views(&mut self, context: &egui::Context, paths: &[PathBuf], shows: bool) {
        let Some(document) = &mut self.document else { return };
        let (mut last, mut there, mut problem) = (None, None, None);
        for path in paths {
            if let Some(tab) = document.tab_of(path) {
                (last, there) = (Some(tab), Some(path));
                continue;
            }
            let added = if is_scene_file(path) { Err(is_no_view(path)) } else { document.add_view(context, path) };
            match added {
                Ok(()) => {
                    last = Some(document.behind.len());
                    problem = self.recent.add(RecentKind::Container, path).err().or(problem);
                }
                Err(error) => problem = Some(error),
            }
        }
        if let Some(tab) = last.filter(|_| shows) {
            document.show_tab(tab);
        }
        document.say_what_is_not_shared();
        if let Some(path) = there {
            document.message = Some(Message::info(format!("{} is open already, and has one tab", name_of(path))));
        }
        if let Some(error) = problem {
            self.refuse(context, error);
        }
    }

    /// Opens the containers anew and goes on with the work on them.
    pub(super) fn reload(&mut self, context: &egui::Context) {
        if let Some(rendering) = &mut self.rendering {
            return rendering.restart(context, self.memory_bytes);
        }
        let Some(old) = self.document.take() else { return };
        match self.opened_again(context, &old) {
            Ok(mut document) => {
                document.go_on(old);
                self.document = Some(document);
            }
            Err(error) => {
                let old = self.document.insert(old);
                old.message = Some(Message::failed("cannot be reloaded", &error));
            }
        }
    }

    /// The same views in the same order, with the same one in front.
    fn opened_again(&self, context: &egui::Context, old: &Document) -> Result<Document> {
        let mut paths: Vec<&Path> = old.views().map(|view| view.session.path.as_path()).collect();
        if old.frames.is_some() {
            paths = vec![&old.front.session.path];
        }
        let mut document = Document::open(context, paths[0], self.opening.clone())?;
        for path in &paths[1..] {
            document.add_view(context, path)?;
        }
        document.show_tab(old.at);
        Ok(document)
    }
}

fn is_no_view(scene: &Path) -> Error {
    let hint = "open containers together (`ltm render --pack --camera` makes one for each view), or the scene alone";
    Error::input(scene.display().to_string(), "is a scene, which is rendered in a window of its own", hint)
}
