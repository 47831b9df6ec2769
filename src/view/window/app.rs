//! The whole window: where the panels stand, files dropped on it, messages.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use eframe::egui::{self, Align2, Color32, FontId, Margin, RichText, Ui};

use super::document::Document;
use super::export::write_rgba;
use super::keys::{Action, act, help, pressed};
use super::light_panel::light_panel;
use super::mixer_panel::mixer;
use super::pattern_editor::load_image;
use super::picture_panel::picture;
use super::status::status;
use super::theme::{self, ALARM, LINE, PANEL, SURROUND, TEXT, WEAK};
use super::view_panel::view_panel;
use crate::error::Error;
use crate::view::WindowOptions;

/// Frames that may pass without the picture before a screenshot is taken of what there is.
const PATIENCE_FRAMES: u32 = 2000;

/// The window's content; it needs a context of egui, not a window.
pub struct App {
    document: Option<Document>,
    message: Option<String>,
    path: String,
    panels: bool,
    help: bool,
    screenshot: Option<Screenshot>,
    failure: Arc<Mutex<Option<Error>>>,
}

struct Screenshot {
    path: PathBuf,
    /// Frames to wait once the picture stands.
    frames: u32,
    waited: u32,
    asked: bool,
}

impl App {
    /// Opens what the options name. A failed screenshot is put into `failure`.
    pub fn new(context: &egui::Context, options: WindowOptions, failure: Arc<Mutex<Option<Error>>>) -> Self {
        theme::apply(context);
        let screenshot =
            options.screenshot.map(|path| Screenshot { path, frames: options.frames.max(1), waited: 0, asked: false });
        let mut app =
            Self { document: None, message: None, path: String::new(), panels: true, help: false, screenshot, failure };
        if let Some(path) = options.path {
            app.open(context, &path);
        }
        app
    }

    /// Opens a container in place of the one that is open.
    pub fn open(&mut self, context: &egui::Context, path: &Path) {
        match Document::open(context, path) {
            Ok(document) => {
                self.document = Some(document);
                self.message = None;
                let name = path.file_name().map_or("".into(), |name| name.to_string_lossy());
                context.send_viewport_cmd(egui::ViewportCommand::Title(format!("{name} – ltm")));
            }
            Err(error) => {
                self.message = Some(error.to_string());
                if self.screenshot.is_some() {
                    self.fail(context, error);
                }
            }
        }
    }

    /// Whether the picture stands and nothing newer is awaited.
    pub fn is_settled(&self) -> bool {
        self.document.as_ref().is_none_or(|document| document.complete && !document.waits())
    }

    /// Draws one frame.
    pub fn show(&mut self, ui: &mut Ui) {
        let context = ui.ctx().clone();
        self.take_dropped(&context);
        for action in pressed(&context) {
            match action {
                Action::Help => self.help = !self.help,
                Action::Panels => self.panels = !self.panels,
                action => {
                    if let Some(document) = &mut self.document {
                        act(&context, document, action);
                    }
                }
            }
        }
        if self.help && context.input(|input| input.key_pressed(egui::Key::Escape)) {
            self.help = false;
        }
        match &mut self.document {
            None => self.welcome(ui),
            Some(document) => {
                document.receive(&context);
                show_document(ui, document, self.panels);
                let held = context.input(|input| input.pointer.any_down());
                document.ask(&context, held);
            }
        }
        if self.help {
            help(&context, &mut self.help);
        }
        if context.input(|input| !input.raw.hovered_files.is_empty()) {
            drop_hint(&context);
        }
        self.take_screenshot(&context);
    }

    /// What is seen without a container.
    fn welcome(&mut self, ui: &mut Ui) {
        let mut chosen = None;
        egui::CentralPanel::default().frame(egui::Frame::new().fill(SURROUND)).show(ui, |ui| {
            ui.vertical_centered(|ui| {
                ui.add_space(ui.available_height() * 0.36);
                ui.label(RichText::new("Drop a container here").size(22.0).color(TEXT));
                ui.label(RichText::new("a .ltc file, as ltm-pack makes it").color(WEAK));
                ui.add_space(14.0);
                let field = egui::TextEdit::singleline(&mut self.path).hint_text("or type its path and press Enter");
                let field = ui.add(field.desired_width(360.0));
                if field.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter)) {
                    chosen = Some(PathBuf::from(self.path.trim()));
                }
                if let Some(message) = &self.message {
                    ui.add_space(10.0);
                    ui.label(RichText::new(message).color(ALARM));
                }
            });
        });
        if let Some(path) = chosen {
            self.open(ui.ctx(), &path);
        }
    }

    /// Containers are opened; an image goes onto the selected texelled light if the pointer is over the left panel,
    /// else it becomes a reference.
    fn take_dropped(&mut self, context: &egui::Context) {
        let dropped: Vec<PathBuf> =
            context.input(|input| input.raw.dropped_files.iter().map(|file| file.path().to_owned()).collect());
        for path in dropped {
            let is_container = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("ltc"));
            let Some(document) = self.document.as_mut().filter(|_| !is_container) else {
                self.open(context, &path);
                continue;
            };
            let pointer = context.input(|input| input.pointer.latest_pos());
            let over_mixer = pointer.is_some_and(|pointer| document.mixer_rect.contains(pointer));
            let texelled = document.selected.filter(|&light| document.basis().lights()[light].layout() != (1, 1));
            let outcome = match texelled.filter(|_| over_mixer) {
                Some(light) => load_image(document, light, &path),
                None => document.add_reference(&path),
            };
            if let Err(error) = outcome {
                document.message = Some((error.to_string(), true));
            }
        }
    }

    fn take_screenshot(&mut self, context: &egui::Context) {
        let settled = self.is_settled();
        let Some(screenshot) = &mut self.screenshot else { return };
        context.request_repaint();
        screenshot.waited += 1;
        if !settled && screenshot.waited < PATIENCE_FRAMES {
            // Counting begins once the picture stands.
            screenshot.frames = screenshot.frames.max(1);
            return;
        }
        if screenshot.frames > 0 {
            screenshot.frames -= 1;
            return;
        }
        if !std::mem::replace(&mut screenshot.asked, true) {
            let (path, failure, context_too) = (screenshot.path.clone(), self.failure.clone(), context.clone());
            let callback = egui::ScreenshotCallback::new(move |image: Arc<egui::ColorImage>| {
                let rgba = image.pixels.iter().flat_map(|pixel| pixel.to_array()).collect();
                if let (Err(error), Ok(mut failure)) = (write_rgba(&path, image.size, rgba), failure.lock()) {
                    *failure = Some(error);
                }
                context_too.send_viewport_cmd(egui::ViewportCommand::Close);
            });
            context.send_viewport_cmd(egui::ViewportCommand::Screenshot(callback));
        }
    }

    fn fail(&self, context: &egui::Context, error: Error) {
        if let Ok(mut failure) = self.failure.lock() {
            *failure = Some(error);
        }
        context.send_viewport_cmd(egui::ViewportCommand::Close);
    }
}

impl eframe::App for App {
    fn ui(&mut self, ui: &mut Ui, _: &mut eframe::Frame) {
        self.show(ui);
    }

    fn clear_color(&self, _: &egui::Visuals) -> [f32; 4] {
        SURROUND.to_normalized_gamma_f32()
    }
}

fn show_document(ui: &mut Ui, document: &mut Document, panels: bool) {
    let frame = |fill: Color32, margin: Margin| egui::Frame::new().fill(fill).inner_margin(margin);
    let bar = frame(PANEL, Margin::symmetric(10, 4)).stroke((1.0, LINE));
    egui::Panel::bottom("status").frame(bar).show(ui, |ui| status(ui, document));
    if panels {
        let side = frame(PANEL, Margin::symmetric(10, 0));
        let left =
            egui::Panel::left("mixer").frame(side).default_size(400.0).size_range(360.0..=640.0).show(ui, |ui| {
                egui::Panel::bottom("light").frame(egui::Frame::new()).show(ui, |ui| light_panel(ui, document));
                mixer(ui, document);
            });
        document.mixer_rect = left.response.rect;
        egui::Panel::right("view").frame(side).default_size(296.0).size_range(260.0..=460.0).show(ui, |ui| {
            view_panel(ui, document);
        });
    }
    egui::CentralPanel::default().frame(frame(SURROUND, Margin::ZERO)).show(ui, |ui| picture(ui, document));
}

/// What a file that is dropped now would do.
fn drop_hint(context: &egui::Context) {
    let painter = context.layer_painter(egui::LayerId::new(egui::Order::Foreground, egui::Id::unique("drop")));
    let rect = context.content_rect();
    painter.rect_filled(rect, 0.0, Color32::from_black_alpha(170));
    let text = "Drop a container to open it, an image over the mixer for the selected light,\nelsewhere as a reference";
    painter.text(rect.center(), Align2::CENTER_CENTER, text, FontId::proportional(18.0), Color32::WHITE);
}
