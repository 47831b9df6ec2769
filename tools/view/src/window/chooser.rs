//! Choosing a file: folders and names inside the window, where there is no desktop with a dialogue of its own.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use eframe::egui::text::{CCursor, CCursorRange};
use eframe::egui::{self, Key, RichText, ScrollArea, TextEdit, vec2};

use super::question::ago;
use super::theme::{ALARM, WEAK};
use crate::animation;
use crate::export::{with_ending, with_one_of};
use crate::rows::natural;
use ltm::resources::human_bytes;

/// Purpose of choosing a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    Container,
    /// Containers to be opened beside the view in front.
    View,
    /// A copy of the container that is shown.
    SaveContainer,
    LoadLook,
    SaveLook,
    /// A climate for the sky.
    Climate,
    /// A picture or map for this light.
    LightImage(usize),
    Reference,
    Png,
    Exr,
    Layers,
    Report,
    Sheet,
    Animation,
}

/// Result of the dialogue.
pub(super) enum Answer {
    Cancelled,
    /// One file, or several where the purpose takes them.
    Chosen(Vec<PathBuf>),
}

/// A folder, or a file that fits.
struct Entry {
    name: String,
    is_folder: bool,
    bytes: u64,
    written: Option<SystemTime>,
}

/// The open list of files.
pub(super) struct Chooser {
    pub(super) purpose: Purpose,
    folder: PathBuf,
    /// Folders, then files that fit.
    entries: Vec<Entry>,
    /// Shown are names that hold this.
    filter: String,
    newest_first: bool,
    name: String,
    /// Names that are chosen together, if there are several; the last stands in the field.
    several: Vec<String>,
    problem: Option<String>,
    /// Whether the name field is to get the keyboard focus.
    fresh: bool,
}

const IMAGES: [&str; 7] = ["exr", "hdr", "png", "jpg", "jpeg", "tga", "bmp"];

impl Purpose {
    pub(super) fn title(self) -> &'static str {
        match self {
            Self::Container => "Open a container or a scene",
            Self::View => "Open further views of the scene beside this one",
            Self::SaveContainer => "Save the container as it stands",
            Self::LoadLook => "Load a look",
            Self::SaveLook => "Save the look",
            Self::Climate => "Light the sky by a climate: EPW or WEA",
            Self::LightImage(_) => "Put an image on the light",
            Self::Reference => "Compare with an image",
            Self::Png => "Save the picture as PNG",
            Self::Exr => "Save the radiance as EXR",
            Self::Layers => "Save an EXR with a layer for each light",
            Self::Report => "Save the report as CSV or PDF",
            Self::Sheet => "Save a contact sheet as PNG or PDF",
            Self::Animation => "Save an animation: numbered PNGs, or a video where ffmpeg is installed",
        }
    }

    pub(super) fn endings(self) -> &'static [&'static str] {
        match self {
            Self::Container => &["ltc", "toml", "glb", "gltf", "obj"],
            Self::View | Self::SaveContainer => &["ltc"],
            Self::LoadLook => &["toml", "json"],
            Self::SaveLook => &["toml"],
            Self::Climate => &["epw", "wea"],
            Self::LightImage(_) | Self::Reference => &IMAGES,
            Self::Png => &["png"],
            Self::Animation => animation::endings(),
            Self::Sheet => &["png", "pdf"],
            Self::Exr | Self::Layers => &["exr"],
            Self::Report => &["csv", "pdf"],
        }
    }

    pub(super) fn saves(self) -> bool {
        !matches!(
            self,
            Self::Container | Self::View | Self::LoadLook | Self::Climate | Self::LightImage(_) | Self::Reference
        )
    }

    /// Whether several files can be chosen together.
    pub(super) fn takes_several(self) -> bool {
        matches!(self, Self::Container | Self::View)
    }
}

impl Chooser {
    /// Begins in the folder of `near`; where a file is saved, with its name, given without ending.
    pub(super) fn new(purpose: Purpose, near: &Path) -> Self {
        let near = std::path::absolute(near).unwrap_or_else(|_| near.to_owned());
        let folder = if near.is_dir() { near.as_path() } else { near.parent().unwrap_or(Path::new("/")) };
        let name = match near.file_name() {
            Some(name) if purpose.saves() => with_ending(Path::new(name), purpose.endings()[0]).display().to_string(),
            _ => String::new(),
        };
        let mut chooser = Self {
            purpose,
            folder: PathBuf::new(),
            entries: Vec::new(),
            filter: String::new(),
            newest_first: false,
            name,
            several: Vec::new(),
            problem: None,
            fresh: true,
        };
        chooser.enter(folder.to_owned());
        chooser
    }

    fn enter(&mut self, folder: PathBuf) {
        let listed = std::fs::read_dir(&folder);
        self.problem = listed.as_ref().err().map(|error| format!("{}: {error}", folder.display()));
        self.entries = listed
            .into_iter()
            .flatten()
            .filter_map(|entry| {
                let entry = entry.ok()?;
                let name = entry.file_name().into_string().ok()?;
                let facts = entry.path().metadata().ok();
                let is_folder = facts.as_ref().is_some_and(|facts| facts.is_dir());
                let ending = Path::new(&name).extension().map(|ending| ending.to_string_lossy().to_lowercase());
                let fits = ending.is_some_and(|ending| self.purpose.endings().contains(&ending.as_str()));
                let bytes = facts.as_ref().map_or(0, |facts| facts.len());
                let written = facts.and_then(|facts| facts.modified().ok());
                (!name.starts_with('.') && (is_folder || fits)).then_some(Entry { name, is_folder, bytes, written })
            })
            .collect();
        self.folder = folder;
        self.filter.clear();
        self.several.clear();
        self.sort();
    }

    fn sort(&mut self) {
        self.entries.sort_by_cached_key(|entry| (!entry.is_folder, natural(&entry.name)));
        if self.newest_first {
            self.entries.sort_by_key(|entry| (!entry.is_folder, entry.written.map(std::cmp::Reverse)));
        }
    }

    /// The folder above, others that are often meant, and which files are listed how.
    fn head(&mut self, ui: &mut egui::Ui) {
        let mut entered = None;
        ui.horizontal(|ui| {
            if ui.button("Up").on_hover_text("The folder above").clicked() {
                entered = self.folder.parent().map(Path::to_owned);
            }
            let folder = |name| std::env::var_os(name).map(PathBuf::from).filter(|folder| folder.is_dir());
            for (name, folder) in
                [("Home", folder("HOME")), ("Scenes", folder("LTM_SCENES")), ("Shell", std::env::current_dir().ok())]
            {
                if let Some(folder) = folder
                    && ui.button(name).on_hover_text(folder.display().to_string()).clicked()
                {
                    entered = Some(folder);
                }
            }
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                if ui.selectable_label(self.newest_first, "Newest first").clicked() {
                    self.newest_first = !self.newest_first;
                    self.sort();
                }
                ui.add(TextEdit::singleline(&mut self.filter).hint_text("Filter").desired_width(120.0));
            });
        });
        ui.add(egui::Label::new(RichText::new(self.folder.display().to_string()).color(WEAK)).truncate());
        if let Some(folder) = entered {
            self.enter(folder);
        }
    }

    /// Shows the list until there is an answer.
    pub(super) fn show(&mut self, context: &egui::Context) -> Option<Answer> {
        let mut answer = None;
        let modal = egui::Modal::new(egui::Id::unique("chooser")).show(context, |ui| {
            ui.set_width(540.0);
            ui.label(RichText::new(self.purpose.title()).size(15.0).strong());
            self.head(ui);
            if let Some(picked) = self.list(ui) {
                answer = Some(picked);
            }
            let field = TextEdit::singleline(&mut self.name).hint_text("Name, or a whole path").desired_width(540.0);
            let mut field = field.show(ui);
            if std::mem::take(&mut self.fresh) {
                field.response.request_focus();
                // What is typed takes the place of what was proposed.
                let end = CCursor::new(self.name.chars().count());
                field.state.cursor.set_char_range(Some(CCursorRange::two(CCursor::new(0), end)));
                field.state.store(ui.ctx(), field.response.id);
            }
            let field = field.response;
            let entered = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
            if self.several.len() > 1 {
                let text = format!("{} files, as views of one scene", self.several.len());
                ui.label(RichText::new(text).size(11.5).color(WEAK));
            }
            if let Some(problem) = &self.problem {
                ui.label(RichText::new(problem).size(11.5).color(ALARM));
            }
            ui.horizontal(|ui| {
                let target = self.target();
                let replaces = self.purpose.saves() && target.is_file();
                let verb = match (self.purpose.saves(), replaces) {
                    (true, true) => "Replace",
                    (true, false) => "Save",
                    (false, _) => "Open",
                };
                let ready = !self.name.trim().is_empty();
                if ui.add_enabled(ready, egui::Button::new(verb)).clicked() || entered && ready {
                    answer = self.accept(target).or(answer.take());
                }
                if ui.button("Cancel").clicked() {
                    answer = Some(Answer::Cancelled);
                }
            });
        });
        if modal.should_close() && answer.is_none() {
            answer = Some(Answer::Cancelled);
        }
        answer
    }

    fn list(&mut self, ui: &mut egui::Ui) -> Option<Answer> {
        let (mut entered, mut picked) = (None, None);
        let area = ScrollArea::vertical().id_salt(&self.folder).max_height(300.0).min_scrolled_height(300.0);
        let filter = self.filter.to_lowercase();
        let shown: Vec<&Entry> = self.entries.iter().filter(|e| e.name.to_lowercase().contains(&filter)).collect();
        area.auto_shrink([false, false]).show_rows(ui, 22.0, shown.len(), |ui, range| {
            for Entry { name, is_folder, bytes, written } in &shown[range] {
                let text = if *is_folder { format!("{name}/") } else { name.clone() };
                let text = RichText::new(text).color(if *is_folder { WEAK } else { ui.visuals().text_color() });
                let facts = match (is_folder, written) {
                    (false, Some(written)) => format!("{}   {}", human_bytes(*bytes), ago(*written)),
                    _ => String::new(),
                };
                let is_chosen = *name == self.name || self.several.contains(name);
                let row = egui::Button::selectable(is_chosen, text).truncate();
                let row = row.right_text(RichText::new(facts).size(11.5).color(WEAK));
                let size = vec2(ui.available_width(), 22.0);
                let layout = egui::Layout::left_to_right(egui::Align::Center).with_main_justify(true);
                let layout = layout.with_main_align(egui::Align::Min);
                let response = ui.allocate_ui_with_layout(size, layout, |ui| ui.add(row)).inner;
                if response.double_clicked() && !is_folder {
                    picked = Some(Answer::Chosen(vec![self.folder.join(name)]));
                } else if response.clicked() {
                    entered = Some((name.clone(), *is_folder));
                }
            }
        });
        if self.entries.is_empty() && self.problem.is_none() {
            ui.label(RichText::new("Nothing here that fits.").color(WEAK));
        }
        match entered {
            Some((name, true)) => self.enter(self.folder.join(name)),
            Some((name, false)) => {
                let adds = self.purpose.takes_several() && ui.input(|input| input.modifiers.command);
                self.choose(name, adds);
            }
            None => {}
        }
        // Where something would be replaced, a double click is no consent.
        picked.filter(|_| !self.purpose.saves())
    }

    /// Chooses a file, beside those that are chosen if it `adds`, or no more if it is one of them.
    fn choose(&mut self, name: String, adds: bool) {
        if adds && self.several.is_empty() && !self.name.is_empty() {
            self.several.push(self.name.clone());
        }
        if !adds {
            self.several.clear();
        } else if let Some(at) = self.several.iter().position(|other| *other == name) {
            self.several.remove(at);
            self.name = self.several.last().cloned().unwrap_or_default();
            return;
        } else {
            self.several.push(name.clone());
        }
        self.name = name;
    }

    /// The path that the name refers to in this folder.
    fn target(&self) -> PathBuf {
        let path = self.folder.join(self.name.trim());
        if self.purpose.saves() && !path.is_dir() { with_one_of(&path, self.purpose.endings()) } else { path }
    }

    fn accept(&mut self, target: PathBuf) -> Option<Answer> {
        if target.is_dir() {
            self.name.clear();
            self.enter(target);
            self.fresh = true;
            return None;
        }
        let there = if self.purpose.saves() { target.parent().is_some_and(Path::is_dir) } else { target.is_file() };
        if !there {
            // Of a file to be saved, the folder.
            let missing = target.parent().filter(|_| self.purpose.saves()).unwrap_or(&target);
            self.problem = Some(format!("{} is not there", missing.display()));
            self.fresh = true;
            return None;
        }
        // What was typed since takes the place of what was chosen.
        if self.several.len() > 1 && self.several.last() == Some(&self.name) {
            return Some(Answer::Chosen(self.several.iter().map(|name| self.folder.join(name)).collect()));
        }
        Some(Answer::Chosen(vec![target]))
    }
}
