//! The whole window: where the panels stand, files dropped on it, messages.

mod scenes;
mod views;

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};

use eframe::egui::{self, Align2, Color32, FontId, RichText, Ui};
use eframe::egui_wgpu::RenderState;

use super::actions::{Action, act};
use super::chooser::{Answer, Chooser, Purpose};
use super::daylight_panel::open_climate;
use super::document::{Document, Opening};
use super::event_throttle::Waiting;
use super::file_jobs::JobCount;
use super::keys::{help, pressed};
use super::layout::{Tab, show_document};
use super::message::Message;
use super::native_dialog::{NativeDialog, Outcome};
use super::question::{Next, Question, Reply};
use super::rendering::Rendering;
use super::theme::{self, ALARM, SURROUND, TEXT, WEAK};
use super::top_bar::{Choice, recent_files};
use super::{exports, file_reading, report, worker_events, worker_requests};
use crate::WindowOptions;
use crate::export::write_rgba;
use crate::live::LiveChoices;
use crate::recent::{Recent, RecentKind};
use crate::unsaved::LeftBehind;
use crate::words::line;
use crate::worker::{Means, PictureProgress, SharedDevice};
use ltm::error::{Error, Result};

/// Frames that may pass without the picture before a screenshot is taken of what there is.
const PATIENCE_FRAMES: u32 = 2000;

/// The window's content; it needs a context of egui, not a window.
pub struct App {
    document: Option<Document>,
    /// The scene that is rendered, whose newest estimate the document is.
    rendering: Option<Rendering>,
    /// How scenes are rendered, and the memory for that.
    choices: LiveChoices,
    /// Work on that scene that an earlier window left behind, until there is a picture that it can be gone on with.
    left: Option<LeftBehind>,
    memory_bytes: Option<u64>,
    message: Option<String>,
    recent: Recent,
    /// Options for opening containers.
    opening: Opening,
    chooser: Option<Chooser>,
    /// The desktop's dialogue, while one is open.
    dialog: Option<NativeDialog>,
    native_dialogs: bool,
    /// Events of the pointer that later frames are shown.
    waiting: Waiting,
    question: Option<Question>,
    /// What is to be done once the work is saved.
    after_save: Option<Next>,
    /// Whether the window may close: nothing is lost, or the question was answered.
    may_close: bool,
    /// Whether it was said that something is being written still: who closes the window again means it.
    warned_of_writing: bool,
    /// Whether the window's size is settled: it was asked for, or made to fit the screen.
    fits: bool,
    /// Title of the window.
    title: String,
    panels: bool,
    tab: Tab,
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
    /// Opens what the options name, to relight it on the device of `state` if there is one. A failed screenshot is put
    /// into `failure`.
    pub fn new(
        context: &egui::Context,
        options: WindowOptions,
        state: Option<RenderState>,
        failure: Arc<Mutex<Option<Error>>>,
    ) -> Self {
        theme::apply(context);
        options.opened.store(true, Ordering::Relaxed);
        let screenshot =
            options.screenshot.map(|path| Screenshot { path, frames: options.frames.max(1), waited: 0, asked: false });
        let share = |state: &RenderState| {
            let is_software = state.adapter.get_info().device_type == wgpu::DeviceType::Cpu;
            let shows = options.shown_on_device.unwrap_or(!is_software);
            SharedDevice { device: state.device.clone(), queue: state.queue.clone(), shows }
        };
        let device = state.as_ref().map(share);
        let memory_bytes = options.budget_bytes;
        let means = Means { device, budget_bytes: options.budget_bytes.unwrap_or_else(half_the_memory) };
        let recent = Recent::load(options.state_folder.clone());
        let mut app = Self {
            document: None,
            rendering: None,
            choices: options.live,
            left: None,
            memory_bytes,
            message: None,
            recent,
            opening: Opening {
                means,
                state,
                state_folder: options.state_folder,
                jobs: JobCount::default(),
                work_of: None,
            },
            chooser: None,
            dialog: None,
            native_dialogs: options.native_dialogs,
            waiting: Waiting::default(),
            question: None,
            after_save: None,
            may_close: false,
            warned_of_writing: false,
            fits: options.size.is_some() || screenshot.is_some(),
            title: String::new(),
            panels: true,
            tab: Tab::default(),
            help: false,
            screenshot,
            failure,
        };
        let paths: Vec<PathBuf> = options.path.into_iter().chain(options.beside).collect();
        app.open_all(context, &paths);
        app
    }

    /// Opens a container, or renders a scene, instead of what is open, whose work is not kept. Whether that could be begun.
    pub fn open(&mut self, context: &egui::Context, path: &Path) -> bool {
        if ltm::scene::is_scene_file(path) {
            self.render(context, path);
            return true;
        }
        self.rendering = None;
        match Document::open(context, path, self.opening.clone()) {
            Ok(document) => {
                if let Some(mut old) = self.document.replace(document) {
                    old.autosave.forget();
                }
                self.message = None;
                let kept = self.recent.add(RecentKind::Container, path);
                self.tell(kept);
                let left = self.opening.state_folder.as_ref().and_then(|folder| LeftBehind::find(folder, path));
                self.question = left.map(Question::LeftBehind).filter(|_| self.screenshot.is_none());
                true
            }
            Err(error) => {
                self.refuse(context, error);
                false
            }
        }
    }

    /// Tells why something cannot be opened; where a screenshot is to be taken, that ends it.
    fn refuse(&mut self, context: &egui::Context, error: Error) {
        if self.screenshot.is_some() {
            self.message = Some(line(&error));
            return self.fail(context, error);
        }
        self.tell(Err(error));
    }

    /// Does what would take the place of the work, or asks first where that is not saved.
    fn proceed(&mut self, context: &egui::Context, next: Next) {
        if self.document.as_ref().is_some_and(Document::is_modified) {
            self.question = Some(Question::Unsaved(next));
        } else {
            self.do_next(context, next);
        }
    }

    fn do_next(&mut self, context: &egui::Context, next: Next) {
        let leaves = matches!(next, Next::Close | Next::Open(_));
        if leaves && self.rendering.as_ref().is_some_and(Rendering::is_unfinished) {
            self.question = Some(Question::Unfinished(next));
            return;
        }
        match next {
            Next::Close if self.is_writing() && !self.warned_of_writing => {
                self.warned_of_writing = true;
                if let Some(document) = &mut self.document {
                    let message = "Files are being read or written; close again to leave them unfinished";
                    document.message = Some(Message::problem(message));
                }
            }
            Next::Close => {
                if let Some(document) = &mut self.document {
                    document.autosave.forget();
                }
                self.may_close = true;
                context.send_viewport_cmd(egui::ViewportCommand::Close);
            }
            Next::Open(paths) => self.open_all(context, &paths),
            Next::LoadLook(path) => {
                let kept = self.recent.add(RecentKind::Look, &path);
                self.tell(kept);
                if let Some(document) = &mut self.document {
                    file_reading::read_look(document, path);
                }
            }
        }
    }

    /// Asks what is to be asked, and does what is answered.
    fn ask(&mut self, context: &egui::Context) {
        let Some(reply) = self.question.as_ref().and_then(|question| question.show(context)) else { return };
        match (self.question.take(), reply) {
            (Some(Question::Unsaved(next)), Reply::Yes) => self.save_then(next),
            (Some(Question::Unsaved(next)), Reply::No) => self.do_next(context, next),
            (Some(Question::Unfinished(next)), Reply::Yes | Reply::No) => {
                if let Some(rendering) = &mut self.rendering {
                    rendering.end(reply == Reply::No);
                }
                self.do_next(context, next);
            }
            (Some(Question::LeftBehind(left)), Reply::Yes) => {
                if let Some(document) = &mut self.document {
                    file_reading::recover(document, left);
                }
            }
            (Some(Question::LeftBehind(left)), Reply::No) => left.forget(),
            // What was left behind stays for the next time.
            (_, Reply::Cancel) | (None, _) => {}
        }
    }

    /// Saves the work to its file, or to one that is chosen, and does then what is next.
    fn save_then(&mut self, next: Next) {
        let Some(document) = &mut self.document else { return };
        match document.work.look().map(Path::to_owned) {
            Some(path) => exports::write_look(document, path),
            None => document.files.wanted = Some(Purpose::SaveLook),
        }
        self.after_save = Some(next);
    }

    /// Goes on once what was to be saved is.
    fn go_on_after_save(&mut self, context: &egui::Context) {
        let Some(document) = &self.document else { return };
        let awaited = document.files.any_open() || document.files.wanted.is_some();
        if self.after_save.is_none() || awaited || self.chooser.is_some() || self.dialog.is_some() {
            return;
        }
        let was_saved = !document.is_modified();
        if let Some(next) = self.after_save.take().filter(|_| was_saved) {
            self.do_next(context, next);
        }
    }

    /// Lets the window close only where nothing is lost.
    fn check_close(&mut self, context: &egui::Context) {
        if !context.input(|input| input.viewport().close_requested()) || self.may_close || self.screenshot.is_some() {
            return;
        }
        if self.document.as_ref().is_some_and(Document::is_modified) {
            context.send_viewport_cmd(egui::ViewportCommand::CancelClose);
            self.question = Some(Question::Unsaved(Next::Close));
        } else if self.rendering.as_ref().is_some_and(Rendering::is_unfinished)
            || (self.is_writing() && !self.warned_of_writing)
        {
            context.send_viewport_cmd(egui::ViewportCommand::CancelClose);
            self.do_next(context, Next::Close);
        } else if let Some(document) = &mut self.document {
            document.autosave.forget();
        }
    }

    /// Whether something is under way that would be lost with the window: an animation, a report, pictures; also those of a container
    /// that was open before.
    fn is_writing(&self) -> bool {
        self.opening.jobs.is_any()
    }

    /// Makes the first window small enough for its screen, frame and a bar of the desktop's included.
    fn fit_to_screen(&mut self, context: &egui::Context) {
        const FRAMES: u64 = 60;
        const BAR: f32 = 48.0;
        if self.fits || context.cumulative_frame_nr() > FRAMES {
            return;
        }
        let (screen, outer, inner) = context.input(|input| {
            let viewport = input.viewport();
            (viewport.monitor_size, viewport.outer_rect, viewport.inner_rect)
        });
        let (Some(screen), Some(outer), Some(inner)) = (screen, outer, inner) else { return };
        let frame = (outer.size() - inner.size()).max(egui::Vec2::ZERO);
        let most = screen - frame - egui::vec2(0.0, BAR);
        if inner.width() > most.x || inner.height() > most.y {
            self.fits = true;
            context.send_viewport_cmd(egui::ViewportCommand::InnerSize(inner.size().min(most)));
            context.send_viewport_cmd(egui::ViewportCommand::OuterPosition(
                ((screen - outer.size().min(screen)) / 2.0).to_pos2(),
            ));
        }
    }

    /// Names the window after its container, with a mark while there is unsaved work.
    fn set_title(&mut self, context: &egui::Context) {
        let title = self.document.as_ref().map_or_else(
            || "ltm".to_owned(),
            |document| {
                let path = self.rendering.as_ref().map_or(&document.front.session.path, |rendering| &rendering.scene);
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                let mark = if document.is_modified() { "● " } else { "" };
                format!("{mark}{name} – ltm")
            },
        );
        if title != self.title {
            context.send_viewport_cmd(egui::ViewportCommand::Title(title.clone()));
            self.title = title;
        }
    }

    /// Title of the window.
    pub fn title(&self) -> &str {
        &self.title
    }

    /// Whether the image is complete and no newer one is pending.
    pub fn is_settled(&self) -> bool {
        let awaits = self.rendering.as_ref().is_some_and(|rendering| rendering.awaits_picture());
        !awaits && self.document.as_ref().is_none_or(|document| document.is_settled())
    }

    /// Pictures that have come of the open container.
    pub fn pictures(&self) -> u64 {
        self.document.as_ref().map_or(0, |document| document.front.shown.pictures)
    }

    /// How much of the open container is in the picture.
    pub fn progress(&self) -> PictureProgress {
        self.document.as_ref().map_or(PictureProgress::COMPLETE, |document| document.front.shown.progress)
    }

    /// Draws one frame.
    pub fn show(&mut self, ui: &mut Ui) {
        let context = ui.ctx().clone();
        self.check_close(&context);
        self.fit_to_screen(&context);
        self.take_dropped(&context);
        if self.chooser.is_none() && self.dialog.is_none() && self.question.is_none() {
            for action in pressed(&context) {
                self.act(&context, action);
            }
        }
        if self.help && context.input(|input| input.key_pressed(egui::Key::Escape)) {
            self.help = false;
        }
        let rendered = self.show_rendering(ui);
        match &mut self.document {
            None if self.rendering.is_some() => self.outline(ui),
            None => self.welcome(ui),
            Some(document) => {
                worker_events::receive(document, &context);
                let choice = show_document(ui, document, self.panels, &mut self.tab, &self.recent);
                let held = context.input(|input| input.pointer.any_down());
                worker_requests::ask(document, &context, held);
                let wanted = document.files.wanted.take().map(|purpose| (purpose, near(document, purpose)));
                if let Some((purpose, near)) = wanted {
                    self.begin_choosing(&context, purpose, &near);
                }
                match choice {
                    Some(Choice::Act(action)) => self.act(&context, action),
                    Some(Choice::Open(path)) => self.proceed(&context, Next::Open(vec![path])),
                    Some(Choice::Look(path)) => self.proceed(&context, Next::LoadLook(path)),
                    None => {}
                }
            }
        }
        self.act_on_rendering(&context, rendered);
        self.ask(&context);
        self.choose(&context);
        self.go_on_after_save(&context);
        self.warned_of_writing &= self.is_writing();
        self.set_title(&context);
        if self.help {
            help(&context, &mut self.help);
        }
        if context.input(|input| !input.raw.hovered_files.is_empty()) {
            drop_hint(&context);
        }
        self.take_screenshot(&context);
    }

    fn act(&mut self, context: &egui::Context, action: Action) {
        let larger = |factor: f32| context.set_zoom_factor((context.zoom_factor() * factor).clamp(0.5, 3.0));
        match (action, &mut self.document) {
            (Action::Help, _) => self.help = !self.help,
            (Action::Panels, _) => self.panels = !self.panels,
            (Action::Larger, _) => larger(1.1),
            (Action::Smaller, _) => larger(1.0 / 1.1),
            (Action::Quit, _) => self.proceed(context, Next::Close),
            (Action::FullScreen, _) => {
                let full = context.input(|input| input.viewport().fullscreen.unwrap_or(false));
                context.send_viewport_cmd(egui::ViewportCommand::Fullscreen(!full));
            }
            (Action::Open, document) => {
                let near = document.as_ref().map_or(Path::new("."), |document| document.front.session.path.as_path());
                let near = near.to_owned();
                self.begin_choosing(context, Purpose::Container, &near);
            }
            (Action::Reload, Some(_)) => self.reload(context),
            (Action::AddView, Some(_)) => self.choose_views(context),
            (action, Some(document)) => act(context, document, action),
            (_, None) => {}
        }
    }

    /// Asks for a file: in the desktop's dialogue if there is one, else in a list of the window's own.
    fn begin_choosing(&mut self, context: &egui::Context, purpose: Purpose, near: &Path) {
        if self.native_dialogs {
            self.dialog = Some(NativeDialog::open(context, purpose, near));
        } else {
            self.chooser = Some(Chooser::new(purpose, near));
        }
    }

    /// Takes the answer of the desktop's dialogue.
    fn take_from_desktop(&mut self, context: &egui::Context) {
        let Some((purpose, outcome)) = self.dialog.as_ref().and_then(|d| Some((d.purpose, d.outcome()?))) else {
            return;
        };
        self.dialog = None;
        match outcome {
            Outcome::Answered(Answer::Chosen(paths)) => self.chosen(context, purpose, paths),
            Outcome::Answered(Answer::Cancelled) => self.after_save = None,
            Outcome::Failed => {
                self.native_dialogs = false;
                let near =
                    self.document.as_ref().map_or_else(|| PathBuf::from("."), |document| near(document, purpose));
                self.chooser = Some(Chooser::new(purpose, &near));
            }
        }
    }

    /// Leaves of what the system brings what this frame may see; the rest comes in those that follow.
    pub fn take_turns(&mut self, context: &egui::Context, input: &mut egui::RawInput) {
        // What is drawn now is what the pointer meets in the next frame.
        if self.waiting.take_turns(&mut input.events, context.cumulative_frame_nr() > 1) {
            context.request_repaint();
        }
    }

    /// Shows the list of files while one is being chosen.
    fn choose(&mut self, context: &egui::Context) {
        self.take_from_desktop(context);
        let Some(chooser) = &mut self.chooser else { return };
        let purpose = chooser.purpose;
        match chooser.show(context) {
            Some(Answer::Chosen(paths)) => {
                self.chooser = None;
                self.chosen(context, purpose, paths);
            }
            Some(Answer::Cancelled) => (self.chooser, self.after_save) = (None, None),
            None => {}
        }
    }

    /// Does with files what they were chosen for: with one, unless several can be opened together.
    fn chosen(&mut self, context: &egui::Context, purpose: Purpose, paths: Vec<PathBuf>) {
        match purpose {
            Purpose::Container => return self.proceed(context, Next::Open(paths)),
            Purpose::View => return self.add_views(context, &paths, true),
            _ => {}
        }
        let Some(path) = paths.into_iter().next() else { return };
        if purpose == Purpose::SaveLook {
            let kept = self.recent.add(RecentKind::Look, &path);
            self.tell(kept);
        }
        let Some(document) = &mut self.document else { return };
        if matches!(purpose, Purpose::Png | Purpose::Exr) {
            document.front.files.export_base = path.with_extension("");
        }
        match purpose {
            Purpose::Container | Purpose::View => {}
            Purpose::LoadLook => self.proceed(context, Next::LoadLook(path)),
            Purpose::SaveContainer => exports::copy_container(document, path),
            Purpose::SaveLook => exports::write_look(document, path),
            Purpose::Climate => open_climate(document, path),
            Purpose::LightImage(light) => file_reading::read_image(document, path, Some(light)),
            Purpose::Reference => file_reading::read_image(document, path, None),
            Purpose::Png => exports::write_png(document, path),
            Purpose::Exr => exports::write_exr(document, path),
            Purpose::Layers => exports::write_layers(document, path),
            Purpose::Report => report::write_report(document, path),
            Purpose::Sheet => exports::write_sheet(document, path),
            Purpose::Animation => exports::write_animation(document, path),
        }
    }

    /// What went wrong, in the status line or on the empty window.
    fn tell(&mut self, outcome: Result<()>) {
        let Err(error) = outcome else { return };
        match &mut self.document {
            Some(document) => document.message = Some(Message::error(&error)),
            None => self.message = Some(line(&error)),
        }
    }

    /// The screen without a container.
    fn welcome(&mut self, ui: &mut Ui) {
        let mut chosen = None;
        egui::CentralPanel::default().frame(egui::Frame::new().fill(SURROUND)).show(ui, |ui| {
            ui.vertical_centered(|ui| {
                ui.add_space(ui.available_height() * 0.3);
                ui.label(RichText::new("Drop a container or a scene here").size(22.0).color(TEXT));
                ui.label(RichText::new("a .ltc file, or a scene to render: .glb, .gltf, .obj, .toml").color(WEAK));
                ui.add_space(14.0);
                if ui.button("Open…  (Ctrl+O)").clicked() {
                    self.begin_choosing(&ui.ctx().clone(), Purpose::Container, Path::new("."));
                }
                if self.recent.of(RecentKind::Container).next().is_some() {
                    ui.add_space(14.0);
                    ui.label(RichText::new("or one of these again").color(WEAK));
                    chosen = recent_files(ui, &self.recent, RecentKind::Container);
                }
                if let Some(message) = &self.message {
                    ui.add_space(10.0);
                    ui.label(RichText::new(message).color(ALARM));
                }
            });
        });
        if let Some(path) = chosen {
            self.open_all(ui.ctx(), &[path]);
        }
    }

    /// Containers are opened, several as views of one scene; lighting files loaded; an image goes onto the selected texelled light if the pointer is
    /// over the left panel, else it becomes a reference.
    fn take_dropped(&mut self, context: &egui::Context) {
        let dropped: Vec<PathBuf> =
            context.input(|input| input.raw.dropped_files.iter().map(|file| file.path().to_owned()).collect());
        let mut opened = Vec::new();
        for path in dropped {
            let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
            let Some(document) = self.document.as_ref().filter(|_| !["ltc", "glb", "gltf", "obj"].contains(&&*ending))
            else {
                opened.push(path);
                continue;
            };
            let pointer = context.input(|input| input.pointer.latest_pos());
            let over_mixer = pointer.is_some_and(|pointer| document.list.rect.contains(pointer));
            let texelled =
                document.list.selected().filter(|&light| document.basis().lights()[light].layout() != (1, 1));
            let purpose = match (ending.as_str(), texelled.filter(|_| over_mixer)) {
                ("toml" | "json", _) => Purpose::LoadLook,
                ("epw" | "wea", _) => Purpose::Climate,
                (_, Some(light)) => Purpose::LightImage(light),
                (_, None) => Purpose::Reference,
            };
            self.chosen(context, purpose, vec![path]);
        }
        if !opened.is_empty() {
            self.proceed(context, Next::Open(opened));
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
        if let Some(error) = self.rendering.as_mut().and_then(Rendering::take_error) {
            return self.fail(context, error);
        }
        if screenshot.frames > 0 {
            screenshot.frames -= 1;
            return;
        }
        if !std::mem::replace(&mut screenshot.asked, true) {
            let (path, failure, context_too) = (screenshot.path.clone(), self.failure.clone(), context.clone());
            let callback = egui::ScreenshotCallback::new(move |image: Arc<egui::ColorImage>| {
                let rgba: Vec<u8> = image.pixels.iter().flat_map(|pixel| pixel.to_array()).collect();
                if let (Err(error), Ok(mut failure)) = (write_rgba(&path, image.size, &rgba), failure.lock()) {
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

    fn raw_input_hook(&mut self, context: &egui::Context, input: &mut egui::RawInput) {
        self.take_turns(context, input);
    }

    fn clear_color(&self, _: &egui::Visuals) -> [f32; 4] {
        SURROUND.to_normalized_gamma_f32()
    }
}

/// The name, without ending, that is proposed where a file is chosen for something.
fn near(document: &Document, purpose: Purpose) -> PathBuf {
    let base = &document.front.files.export_base;
    match (document.work.look(), purpose) {
        (Some(path), Purpose::SaveLook | Purpose::LoadLook) => path.with_extension(""),
        // Not the name under which the radiance is saved.
        (_, Purpose::Layers) => PathBuf::from(format!("{}-layers", base.display())),
        (_, Purpose::Sheet) => PathBuf::from(format!("{}-sheet", base.display())),
        (_, Purpose::Animation) => PathBuf::from(format!("{}-frame", base.display())),
        _ => base.clone(),
    }
}

/// Memory of a machine that does not tell, in bytes: little enough for any that has a window.
const UNKNOWN_MEMORY: u64 = 4 << 30;

/// Half of the machine's memory, in bytes.
fn half_the_memory() -> u64 {
    ltm::resources::machine_memory().total_bytes.unwrap_or(UNKNOWN_MEMORY) / 2
}

/// Hint on what dropping a file would do.
fn drop_hint(context: &egui::Context) {
    let painter = context.layer_painter(egui::LayerId::new(egui::Order::Foreground, egui::Id::unique("drop")));
    let rect = context.content_rect();
    painter.rect_filled(rect, 0.0, Color32::from_black_alpha(170));
    let text = "Drop a container to open it, a lighting file to load it, a climate (EPW, WEA) for the sky,\n\
                an image over the mixer for the selected light, elsewhere as a reference";
    painter.text(rect.center(), Align2::CENTER_CENTER, text, FontId::proportional(18.0), Color32::WHITE);
}
