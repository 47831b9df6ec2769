//! A window without a window: egui's input made by hand, its widgets found by their accessible names.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use eframe::egui::{self, Event, Key, Modifiers, PointerButton, Pos2, Rect, accesskit};
use eframe::egui_wgpu::{RenderState, RendererOptions, WgpuConfiguration};
use ltm_view::{App, WindowOptions};

/// Size of the window, in points, where a test does not ask for another.
const SIZE: egui::Vec2 = egui::vec2(1280.0, 800.0);
/// How long a picture may take to come, on a machine that does other things as well.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);

/// What the names of the views' textures begin with.
const PICTURE: &str = "picture of ";

pub(crate) struct Driver {
    context: egui::Context,
    app: App,
    time_secs: f64,
    size: egui::Vec2,
    /// Pixels of a point.
    scale: f32,
    modifiers: Modifiers,
    /// Files that are dropped in the next frame.
    dropped: Vec<egui::DroppedFileHandle>,
    /// Widgets of the last frame: name, what it says of itself, place.
    widgets: Vec<(String, Rect)>,
    /// Name of the widget that has the keyboard.
    focused: Option<String>,
    /// What was copied last.
    copied: Option<String>,
    /// Whether the system has just asked the window to close.
    close_requested: bool,
    /// Whether the window has let that happen, or asked for it.
    closed: bool,
    /// The newest bytes of each texture, by its name.
    textures: BTreeMap<String, Vec<u8>>,
    /// How each is sampled.
    sampled: BTreeMap<String, egui::TextureOptions>,
    /// Name of the texture that was drawn last as the picture.
    drawn: Option<String>,
}

impl Driver {
    /// Opens a container and waits for its picture.
    pub(crate) fn open(path: &Path) -> Self {
        Self::open_with(WindowOptions { path: Some(path.to_owned()), ..Default::default() }, SIZE)
    }

    /// Opens containers as views of one scene, and waits for their pictures.
    pub(crate) fn open_tabs(paths: &[&Path]) -> Self {
        Self::open_tabs_sized(paths, SIZE)
    }

    /// As [`open_tabs`](Self::open_tabs), in a window of some size, in points.
    pub(crate) fn open_tabs_sized(paths: &[&Path], size: egui::Vec2) -> Self {
        let beside = paths[1..].iter().map(|path| (*path).to_owned()).collect();
        Self::open_with(WindowOptions { path: Some(paths[0].to_owned()), beside, ..Default::default() }, size)
    }

    /// Opens a container that the device relights which would draw the window, and waits for its picture. It shows it,
    /// too, or does what suits it.
    pub(crate) fn open_on_device(path: &Path, shown_on_device: Option<bool>) -> Self {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = wgpu::Backends::PRIMARY;
        let instance = wgpu::Instance::new(descriptor);
        let (configuration, options) = (WgpuConfiguration::default(), RendererOptions::default());
        let state = pollster::block_on(RenderState::create(&configuration, &instance, None, options)).unwrap();
        let options = WindowOptions { path: Some(path.to_owned()), shown_on_device, ..Default::default() };
        Self::open_drawn_by(Some(state), options, SIZE)
    }

    /// Opens a window of some size, in points, and waits for its picture.
    pub(crate) fn open_with(options: WindowOptions, size: egui::Vec2) -> Self {
        Self::open_drawn_by(None, options, size)
    }

    /// As [`open_with`](Self::open_with), on a display of so many pixels a point.
    pub(crate) fn open_scaled(options: WindowOptions, size: egui::Vec2, scale: f32) -> Self {
        let mut driver = Self::unseen(None, options, size);
        driver.scale = scale;
        driver.settle();
        driver
    }

    /// Opens a window of which no frame has been drawn.
    pub(crate) fn open_unseen(path: &Path) -> Self {
        Self::unseen(None, WindowOptions { path: Some(path.to_owned()), ..Default::default() }, SIZE)
    }

    /// Pixels of a point, as the window takes them.
    pub(crate) fn pixels_per_point(&self) -> f32 {
        self.context.pixels_per_point()
    }

    /// Clicks at several places, all of which come in one frame.
    pub(crate) fn clicks_in_one_frame(&mut self, places: &[Pos2]) {
        let click = |&at: &Pos2| [Event::PointerMoved(at), self.button(at, true), self.button(at, false)];
        let clicks = places.iter().flat_map(click).collect();
        self.frame(clicks);
        (0..2 * places.len() + 2).for_each(|_| self.frame(Vec::new()));
        self.time_secs += 1.0;
    }

    fn open_drawn_by(state: Option<RenderState>, options: WindowOptions, size: egui::Vec2) -> Self {
        let mut driver = Self::unseen(state, options, size);
        driver.settle();
        driver
    }

    /// Opens a window of which no frame has been drawn, with options of its own.
    pub(crate) fn unseen_with(options: WindowOptions) -> Self {
        Self::unseen(None, options, SIZE)
    }

    fn unseen(state: Option<RenderState>, options: WindowOptions, size: egui::Vec2) -> Self {
        let context = egui::Context::default();
        context.enable_accesskit();
        let app = App::new(&context, options, state, Arc::new(Mutex::new(None)));
        Self {
            context,
            app,
            time_secs: 0.0,
            size,
            scale: 1.0,
            dropped: Vec::new(),
            modifiers: Modifiers::NONE,
            widgets: Vec::new(),
            focused: None,
            copied: None,
            close_requested: false,
            closed: false,
            textures: BTreeMap::new(),
            sampled: BTreeMap::new(),
            drawn: None,
        }
    }

    /// One frame of a sixtieth of a second.
    pub(crate) fn frame(&mut self, events: Vec<Event>) {
        self.time_secs += 1.0 / 60.0;
        let input = egui::RawInput {
            screen_rect: Some(Rect::from_min_size(Pos2::ZERO, self.size)),
            time: Some(self.time_secs),
            events,
            dropped_files: std::mem::take(&mut self.dropped),
            focused: true,
            ..Default::default()
        };
        let close_requested = std::mem::take(&mut self.close_requested);
        let mut input = input;
        if close_requested {
            input.viewports.entry(egui::ViewportId::ROOT).or_default().events.push(egui::ViewportEvent::Close);
        }
        input.viewports.entry(egui::ViewportId::ROOT).or_default().native_pixels_per_point = Some(self.scale);
        self.app.take_turns(&self.context, &mut input);
        let mut output = self.context.run_ui(input, |ui| self.app.show(ui));
        if let Some(update) = output.platform_output.accesskit_update.take() {
            let focused = update.nodes.iter().find(|(id, _)| *id == update.focus);
            self.focused = focused.and_then(|(_, node)| widget(node)).map(|(name, _)| name);
            self.widgets = update.nodes.iter().filter_map(|(_, node)| widget(node)).collect();
        }
        for (id, delta) in output.textures_delta.set.iter().flat_map(|(id, all)| all.iter().map(move |one| (id, one))) {
            let egui::ImageData::Color(image) = &delta.image;
            let name = self.context.tex_manager().read().meta(*id).map(|meta| meta.name.clone());
            if let (Some(name), None) = (name, delta.pos) {
                self.sampled.insert(name.clone(), delta.options);
                self.textures.insert(name, image.pixels.iter().flat_map(|pixel| pixel.to_array()).collect());
            }
        }
        for texture in output.shapes.iter().flat_map(|clipped| textures_of(&clipped.shape)) {
            let name = self.context.tex_manager().read().meta(texture).map(|meta| meta.name.clone());
            self.drawn = name.filter(|name| name.starts_with(PICTURE)).or(self.drawn.take());
        }
        for command in &output.platform_output.commands {
            if let egui::OutputCommand::CopyText(text) = command {
                self.copied = Some(text.clone());
            }
        }
        let commands = output.viewport_output.values().flat_map(|viewport| &viewport.commands);
        let said = |wanted: &egui::ViewportCommand| commands.clone().any(|command| command == wanted);
        self.closed |= said(&egui::ViewportCommand::Close);
        self.closed |= close_requested && !said(&egui::ViewportCommand::CancelClose);
        output.drop_without_applying_deltas();
    }

    /// Frames until nothing is awaited, and three more for what follows from it.
    pub(crate) fn settle(&mut self) {
        let begun = Instant::now();
        self.frame(Vec::new());
        while !self.app.is_settled() {
            assert!(begun.elapsed() < PATIENCE, "the picture does not come");
            std::thread::sleep(Duration::from_millis(2));
            self.frame(Vec::new());
        }
        for _ in 0..3 {
            self.frame(Vec::new());
        }
        while !self.app.is_settled() {
            assert!(begun.elapsed() < PATIENCE, "the picture does not come");
            std::thread::sleep(Duration::from_millis(2));
            self.frame(Vec::new());
        }
    }

    /// Pictures that have come so far.
    pub(crate) fn pictures(&self) -> u64 {
        self.app.pictures()
    }

    /// The bytes of the picture that was drawn last, RGBA.
    pub(crate) fn picture(&self) -> Vec<u8> {
        self.texture(self.drawn.as_deref().expect("no picture was drawn yet"))
    }

    /// How the picture that was drawn last is sampled.
    pub(crate) fn sampled(&self) -> egui::TextureOptions {
        self.sampled[self.drawn.as_deref().expect("no picture was drawn yet")]
    }

    /// Whether there is a picture of the view of this name, drawn or not.
    pub(crate) fn has_picture_of(&self, view: &str) -> bool {
        self.textures.contains_key(&format!("{PICTURE}{view}"))
    }

    /// The bytes of a texture, RGBA.
    pub(crate) fn texture(&self, name: &str) -> Vec<u8> {
        self.textures.get(name).unwrap_or_else(|| panic!("there is no texture '{name}' yet")).clone()
    }

    /// Name of the widget that has the keyboard.
    pub(crate) fn focused(&self) -> Option<&str> {
        self.focused.as_deref()
    }

    /// What was copied last.
    pub(crate) fn copied(&self) -> Option<&str> {
        self.copied.as_deref()
    }

    /// Asks the window to close, as its frame's button does; whether it does.
    pub(crate) fn close(&mut self) -> bool {
        self.close_requested = true;
        self.frame(Vec::new());
        self.settle();
        self.closed
    }

    /// Whether the window has closed, or would have.
    pub(crate) fn is_closed(&self) -> bool {
        self.closed
    }

    /// What the window is called.
    pub(crate) fn title(&self) -> &str {
        self.app.title()
    }

    /// Frames until something holds, for what takes its time.
    pub(crate) fn wait_until(&mut self, what: &str, holds: impl Fn(&Self) -> bool) {
        let begun = Instant::now();
        while !holds(self) {
            assert!(begun.elapsed() < PATIENCE, "{what} does not come");
            std::thread::sleep(Duration::from_millis(10));
            self.frame(Vec::new());
        }
    }

    /// Whether a widget has exactly this name.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.widgets.iter().any(|(label, _)| label == name)
    }

    /// Place of the widget with exactly this name.
    pub(crate) fn find(&self, name: &str) -> Rect {
        let found = self.widgets.iter().find(|(label, _)| label == name);
        found.unwrap_or_else(|| panic!("no widget is called '{name}': {:?}", self.names())).1
    }

    /// Place of a widget whose name holds this text.
    pub(crate) fn find_containing(&self, text: &str) -> Rect {
        let found = self.widgets.iter().find(|(label, _)| label.contains(text));
        found.unwrap_or_else(|| panic!("no widget says '{text}': {:?}", self.names())).1
    }

    /// Clicks with the other button.
    pub(crate) fn right_click(&mut self, pos: Pos2) {
        self.frame(vec![Event::PointerMoved(pos)]);
        for pressed in [true, false] {
            let (button, modifiers) = (PointerButton::Secondary, self.modifiers);
            self.frame(vec![Event::PointerButton { pos, button, pressed, modifiers }]);
        }
        self.time_secs += 1.0;
    }

    /// Drags with the other button over a number of frames.
    pub(crate) fn drag_secondary(&mut self, from: Pos2, to: Pos2, frames: usize) {
        let modifiers = self.modifiers;
        let button = |pos, pressed| Event::PointerButton { pos, button: PointerButton::Secondary, pressed, modifiers };
        self.frame(vec![Event::PointerMoved(from)]);
        self.frame(vec![button(from, true)]);
        for frame in 1..=frames {
            self.move_to(from + (to - from) * (frame as f32 / frames as f32));
        }
        self.frame(vec![button(to, false)]);
        self.time_secs += 1.0;
    }

    /// Whether a widget's name holds this text.
    pub(crate) fn says(&self, text: &str) -> bool {
        self.widgets.iter().any(|(label, _)| label.contains(text))
    }

    /// Asks the window to close, as its frame's button does, and draws one frame; whether it does.
    pub(crate) fn ask_to_close(&mut self) -> bool {
        self.close_requested = true;
        self.frame(Vec::new());
        self.frame(Vec::new());
        self.closed
    }

    /// Places of all widgets that have a name.
    pub(crate) fn widgets(&self) -> &[(String, Rect)] {
        &self.widgets
    }

    /// Drops a file at a place.
    pub(crate) fn drop_file(&mut self, path: &Path, at: Pos2) {
        self.drop_files(&[path], at);
    }

    /// Drops files at a place, together.
    pub(crate) fn drop_files(&mut self, paths: &[&Path], at: Pos2) {
        self.frame(vec![Event::PointerMoved(at)]);
        for path in paths {
            self.dropped.push(Arc::new(Dropped((*path).to_owned())));
        }
        self.frame(Vec::new());
    }

    /// Turns the wheel over a place, in points.
    pub(crate) fn scroll(&mut self, at: Pos2, points: f32) {
        let (unit, delta, phase) = (egui::MouseWheelUnit::Point, egui::vec2(0.0, points), egui::TouchPhase::Move);
        let (modifiers, source) = (self.modifiers, egui::MouseWheelSource::Wheel);
        let wheel = Event::MouseWheel { unit, delta, phase, modifiers, source };
        self.frame(vec![Event::PointerMoved(at), wheel]);
        // Scrolling is smoothed over some frames.
        (0..30).for_each(|_| self.frame(Vec::new()));
    }

    /// Drags with keys held.
    pub(crate) fn drag_with(&mut self, from: Pos2, to: Pos2, frames: usize, modifiers: Modifiers) {
        self.modifiers = modifiers;
        self.frame(vec![Event::ModifiersChanged(modifiers)]);
        self.drag(from, to, frames);
        self.modifiers = Modifiers::NONE;
        self.frame(vec![Event::ModifiersChanged(Modifiers::NONE)]);
    }

    /// Clicks twice at once.
    pub(crate) fn double_click(&mut self, at: Pos2) {
        self.press(at);
        self.frame(vec![self.button(at, false)]);
        self.frame(vec![self.button(at, true)]);
        self.release(at);
    }

    fn names(&self) -> Vec<&str> {
        self.widgets.iter().map(|(name, _)| name.as_str()).collect()
    }

    pub(crate) fn click(&mut self, at: Pos2) {
        self.press(at);
        self.release(at);
    }

    /// Drags over a number of frames.
    pub(crate) fn drag(&mut self, from: Pos2, to: Pos2, frames: usize) {
        self.press(from);
        for frame in 1..=frames {
            self.move_to(from + (to - from) * (frame as f32 / frames as f32));
        }
        self.release(to);
    }

    /// Goes to a place and puts the button down.
    pub(crate) fn press(&mut self, at: Pos2) {
        self.frame(vec![Event::PointerMoved(at)]);
        self.frame(vec![self.button(at, true)]);
    }

    pub(crate) fn move_to(&mut self, at: Pos2) {
        self.frame(vec![Event::PointerMoved(at)]);
    }

    /// Lets the button go.
    pub(crate) fn release(&mut self, at: Pos2) {
        self.frame(vec![self.button(at, false)]);
        // What follows is not meant as a double click.
        self.time_secs += 1.0;
    }

    pub(crate) fn key(&mut self, key: Key, modifiers: Modifiers) {
        self.modifiers = modifiers;
        let event = |pressed| Event::Key { key, physical_key: None, pressed, repeat: false, modifiers };
        self.frame(vec![Event::ModifiersChanged(modifiers), event(true)]);
        self.frame(vec![event(false), Event::ModifiersChanged(Modifiers::NONE)]);
        self.modifiers = Modifiers::NONE;
    }

    /// Clicks with keys held.
    pub(crate) fn click_with(&mut self, at: Pos2, modifiers: Modifiers) {
        self.modifiers = modifiers;
        self.frame(vec![Event::ModifiersChanged(modifiers)]);
        self.click(at);
        self.modifiers = Modifiers::NONE;
        self.frame(vec![Event::ModifiersChanged(Modifiers::NONE)]);
    }

    /// Replaces what stands in the field that has the keyboard, and presses Enter.
    pub(crate) fn enter(&mut self, text: &str) {
        self.key(Key::A, Modifiers::CTRL.plus(Modifiers::COMMAND));
        self.frame(vec![Event::Text(text.to_owned())]);
        self.key(Key::Enter, Modifiers::NONE);
    }

    fn button(&self, pos: Pos2, pressed: bool) -> Event {
        Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers: self.modifiers }
    }
}

/// The textures that a shape is drawn with.
fn textures_of(shape: &egui::Shape) -> Vec<egui::TextureId> {
    match shape {
        egui::Shape::Vec(shapes) => shapes.iter().flat_map(textures_of).collect(),
        egui::Shape::Mesh(mesh) => vec![mesh.texture_id],
        egui::Shape::Rect(rect) => rect.brush.iter().map(|brush| brush.fill_texture_id).collect(),
        _ => Vec::new(),
    }
}

/// A file as the system hands it over.
#[derive(Debug)]
struct Dropped(PathBuf);

impl egui::DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        std::fs::read(&self.0).map_err(|error| error.to_string())
    }
}

fn widget(node: &accesskit::Node) -> Option<(String, Rect)> {
    let bounds = node.bounds()?;
    let name = node.label().or(node.value())?.to_owned();
    let place = |x: f64, y: f64| Pos2::new(x as f32, y as f32);
    Some((name, Rect::from_min_max(place(bounds.x0, bounds.y0), place(bounds.x1, bounds.y1))))
}
