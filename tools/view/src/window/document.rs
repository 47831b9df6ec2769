//! One open container with everything that the window knows of it.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

use eframe::egui::{self, ColorImage, TextureHandle, TextureId, TextureOptions};
use eframe::egui_wgpu::RenderState;

use super::chooser::Purpose;
use super::screen::ScreenTexture;
use crate::display::{Display, Shown};
use crate::groups::{Groups, Order, Row};
use crate::history::History;
use crate::mixer::Mix;
use crate::pattern::{Brush, ShapeKind};
use crate::reach::Reach;
use crate::snapshots::{Snapshots, thumbnail};
use crate::viewport::Viewport;
use crate::worker::{Event, Means, Picture, Progress, Request, Seen, Session};
use ltm::error::Result;
use ltm::image::{LUMENS_PER_WATT, LinearImage};
use ltm::light::{LightBasis, LightUnit, Lighting};
use ltm::matrix::FactorSource;
use ltm::relight::CpuRelighter;

/// Pictures over which their rate is counted, and the longest pause between two of them that is no rest, in seconds.
const RATE_PICTURES: usize = 24;
const REST_SECS: f64 = 0.5;

/// What the pointer does on a light's texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tool {
    Brush,
    Shape(ShapeKind),
    Turn,
}

/// The texture editor's settings, which outlive a change of light.
pub(super) struct Easel {
    pub(super) tool: Tool,
    pub(super) brush: Brush,
    /// Brightness of the paint, in stops.
    pub(super) paint_stops: f32,
    /// Size of shapes, as a fraction of the light's size.
    pub(super) shape_size: f32,
    pub(super) last_touch: Option<[f32; 2]>,
    /// What a drag does with the light's shape.
    pub(super) hold: Hold,
}

/// How a shape is held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Hold {
    /// At a place inside it, given from its middle, in fractions of the light's size.
    Inside([f32; 2]),
    /// At one of its corners.
    Corner,
}

/// A pixel that was asked about, with what each light brings there.
pub(super) struct Asked {
    pub(super) pixel: [u32; 2],
    pub(super) lights: Vec<f32>,
}

/// What the last drag cost.
#[derive(Clone, Copy, Default)]
pub(super) struct Latency {
    pub(super) frames: u64,
    pub(super) relight_secs: f64,
    pub(super) total_secs: f64,
}

pub(super) struct Document {
    pub(super) session: Session,
    pub(super) groups: Groups,
    pub(super) mix: Mix,
    /// The scene's own.
    pub(super) scene_mix: Mix,
    pub(super) history: History<Mix>,
    pub(super) display: Display,
    pub(super) viewport: Viewport,
    pub(super) snapshots: Snapshots,
    pub(super) thumbnails: BTreeMap<String, TextureHandle>,
    pub(super) selected: Option<usize>,
    pub(super) search: String,
    pub(super) order: Order,
    pub(super) folded: BTreeSet<usize>,
    pub(super) contributions: Vec<f32>,
    /// The contributions by which the mixer is sorted, and the order that was chosen then.
    ranked: (Vec<f32>, Order),
    pub(super) asked: Option<Asked>,
    /// Whether the next answer about a pixel selects its strongest light.
    pub(super) select_strongest: bool,
    pub(super) scroll_to_selected: bool,
    pub(super) hovered: Option<[u32; 2]>,
    pub(super) easel: Easel,
    /// Linear radiance of the newest picture whose values have come.
    pub(super) image: Option<Arc<LinearImage>>,
    texture: Option<TextureHandle>,
    /// The device's own texture, in place of the other, where the device shows the pictures.
    screen: Option<ScreenTexture>,
    /// The device that draws the window.
    state: Option<RenderState>,
    compared: Option<(Arc<Shown>, TextureHandle)>,
    pub(super) histogram: Vec<[f32; 3]>,
    pub(super) progress: Progress,
    /// All factors, once they are there, where the CPU relights.
    pub(super) relighter: Option<Arc<CpuRelighter>>,
    /// Whether the container is larger than its budget.
    pub(super) is_paged: bool,
    /// The adapter that relights, where it is not the CPU.
    pub(super) adapter: Option<String>,
    pub(super) latency: Latency,
    pub(super) message: Option<(String, bool)>,
    /// Works beside the worker that are not done yet.
    pub(super) beside: usize,
    /// Name for exported files, without ending.
    pub(super) export_base: PathBuf,
    /// The lighting file in which a mix stands.
    pub(super) look: Option<(PathBuf, Mix)>,
    /// What a file is to be chosen for.
    pub(super) wanted: Option<Purpose>,
    /// Where the mixer stands, for files that are dropped on it.
    pub(super) mixer_rect: egui::Rect,
    arrivals: VecDeque<Instant>,
    reach: Option<Reach>,
    lighting: Arc<Lighting>,
    lit: Option<Mix>,
    asked_display: Option<(Display, Option<usize>)>,
    generation: u64,
    /// Generations of the newest picture, of the newest values, and of the newest request that changed the lighting.
    seen: u64,
    valued: u64,
    relit: u64,
    /// Whether to take a snapshot as soon as the picture's values are there.
    snapshot_wanted: bool,
    /// Pictures that have come.
    pub(super) pictures: u64,
    /// Frame in which each open request was made.
    pending: BTreeMap<u64, u64>,
    /// The exposure that was chosen for the picture, until the whole picture stands.
    exposed: Option<f32>,
}

impl Document {
    /// Opens a container. The pictures are shown on the device of `state` if that is the one of `means`.
    pub(super) fn open(context: &egui::Context, path: &Path, means: Means, state: Option<RenderState>) -> Result<Self> {
        let wake = {
            let context = context.clone();
            Arc::new(move || context.request_repaint())
        };
        let session = Session::open(path, means, wake)?;
        let groups = Groups::of(session.basis());
        let mix = Mix::of_scene(session.basis(), &groups);
        let lighting = Arc::new(mix.lighting(session.basis(), &groups)?);
        // A group of all would hide them all.
        let is_long = session.basis().lights().len() > 60 && groups.len() > 1;
        let stem = path.file_stem().map_or("picture".into(), |stem| stem.to_string_lossy().into_owned());
        Ok(Self {
            history: History::new(mix.clone()),
            scene_mix: mix.clone(),
            selected: (!mix.lights.is_empty()).then_some(0),
            folded: if is_long { (0..groups.len()).collect() } else { BTreeSet::new() },
            session,
            groups,
            mix,
            display: Display::default(),
            viewport: Viewport::default(),
            snapshots: Snapshots::default(),
            thumbnails: BTreeMap::new(),
            search: String::new(),
            order: Order::File,
            contributions: Vec::new(),
            ranked: (Vec::new(), Order::File),
            asked: None,
            select_strongest: false,
            scroll_to_selected: false,
            hovered: None,
            easel: Easel {
                tool: Tool::Brush,
                brush: Brush { radius_texels: 2.0, hardness: 0.3, flow: 0.5, colour: [1.0; 3] },
                paint_stops: 2.0,
                shape_size: 0.5,
                last_touch: None,
                hold: Hold::Corner,
            },
            image: None,
            texture: None,
            screen: None,
            state,
            compared: None,
            histogram: Vec::new(),
            progress: Progress::default(),
            relighter: None,
            is_paged: false,
            adapter: None,
            latency: Latency::default(),
            message: None,
            beside: 0,
            export_base: stem.into(),
            look: None,
            wanted: None,
            mixer_rect: egui::Rect::NOTHING,
            arrivals: VecDeque::new(),
            reach: None,
            lighting,
            lit: None,
            asked_display: None,
            generation: 0,
            seen: 0,
            valued: 0,
            relit: 0,
            snapshot_wanted: false,
            pictures: 0,
            pending: BTreeMap::new(),
            exposed: Some(Display::default().tone.exposure_stops),
        })
    }

    pub(super) fn basis(&self) -> &LightBasis {
        self.session.basis()
    }

    /// Width and height of the picture.
    pub(super) fn size(&self) -> [u32; 2] {
        let shape = self.session.container.shape();
        [shape.width(), shape.height()]
    }

    /// What makes luminances cd/m², where a weight 1 on each light is a physical quantity and pixels are radiances.
    pub(super) fn lumens_per_watt(&self) -> Option<f32> {
        let metres = self.session.container.job().provenance.metres_per_unit;
        let is_known = |unit| match unit {
            LightUnit::Radiance | LightUnit::Irradiance => true,
            // Intensity falls with the square of a distance, whose unit must be known.
            LightUnit::Intensity => metres > 0.0,
            LightUnit::Multiple => false,
        };
        self.basis().lights().iter().all(|light| is_known(light.unit)).then_some(LUMENS_PER_WATT)
    }

    /// Pictures a second over the last that came in a row; none after a rest.
    pub(super) fn pictures_per_sec(&self) -> Option<f64> {
        let (first, last) = (self.arrivals.front()?, self.arrivals.back()?);
        let span = last.duration_since(*first).as_secs_f64();
        (self.arrivals.len() > 2 && span > 0.0).then(|| (self.arrivals.len() - 1) as f64 / span)
    }

    pub(super) fn bytes_read(&self) -> u64 {
        self.session.worker.meter().bytes_read.load(Ordering::Relaxed)
    }

    /// Bytes of factors in the memory of the CPU.
    pub(super) fn resident_bytes(&self) -> u64 {
        self.session.worker.meter().resident_bytes.load(Ordering::Relaxed)
    }

    /// Bytes of factors and their pictures in the memory of the device that relights.
    pub(super) fn device_bytes(&self) -> u64 {
        self.session.worker.meter().device_bytes.load(Ordering::Relaxed)
    }

    /// Takes what the worker has done; before the panels are drawn.
    pub(super) fn receive(&mut self, context: &egui::Context) {
        let events: Vec<Event> = self.session.worker.events().collect();
        for event in events {
            match event {
                Event::Picture(picture) => self.take_picture(context, *picture),
                Event::Values { generation, image, histogram } => self.take_values(generation, image, histogram),
                Event::Loaded { relighter, adapter, is_paged } => {
                    self.is_paged = is_paged;
                    self.relighter = relighter;
                    self.adapter = adapter;
                }
                Event::Damage(lines) => {
                    let blocks = if lines.len() == 1 { "block" } else { "blocks" };
                    let first = lines.first().map_or("", String::as_str);
                    self.message = Some((format!("{} damaged {blocks}: {first}", lines.len()), true));
                }
                Event::Brought(brought) => {
                    self.beside -= 1;
                    let outcome = brought.and_then(|brought| self.take(brought).map_err(|error| error.to_string()));
                    self.message = match outcome {
                        Ok(message) => Some((message, false)),
                        Err(message) => Some((message, true)),
                    };
                }
                Event::Reach(reach) => {
                    self.contributions = reach.contributions(self.session.basis(), &self.lighting);
                    self.reach = Some(reach);
                }
                Event::Pixel { pixel, lights } => {
                    if std::mem::take(&mut self.select_strongest) {
                        let strongest = (0..lights.len()).max_by(|&a, &b| lights[a].total_cmp(&lights[b]));
                        if let Some(light) = strongest.filter(|&light| lights[light] > 0.0) {
                            self.select_and_show(light);
                        }
                    }
                    self.asked = Some(Asked { pixel, lights });
                }
                Event::Failed(message) => {
                    // It may have been about the pixel.
                    self.select_strongest = false;
                    self.message = Some((message, true));
                }
            }
        }
        if self.snapshot_wanted {
            self.snapshot();
        }
    }

    /// Selects a light and brings it into view, out of a folded group too.
    pub(super) fn select_and_show(&mut self, light: usize) {
        if let Some(group) = self.groups.of_light(light) {
            self.folded.remove(&group);
        }
        (self.selected, self.scroll_to_selected) = (Some(light), true);
    }

    fn take_picture(&mut self, context: &egui::Context, picture: Picture) {
        if let Some(asked_in) = self.pending.get(&picture.generation) {
            let frames = context.cumulative_frame_nr() - asked_in;
            let (relight_secs, total_secs) = (picture.relight_secs, picture.total_secs);
            if relight_secs > 0.0 {
                self.latency = Latency { frames, relight_secs, total_secs };
            }
        }
        self.pending.retain(|&generation, _| generation > picture.generation);
        self.progress = picture.progress;
        (self.seen, self.pictures) = (picture.generation, self.pictures + 1);
        match (picture.seen, &self.state) {
            (Seen::Bytes(shown, image), _) => {
                set_texture(context, &mut self.texture, "picture", &shown);
                self.screen = None;
                self.take_values(picture.generation, image, shown.histogram);
            }
            (Seen::Texture(texture), Some(state)) => {
                if !self.screen.as_ref().is_some_and(|screen| screen.shows(&texture)) {
                    self.screen = Some(ScreenTexture::new(state.clone(), texture));
                }
            }
            // Nobody has asked a device for it.
            (Seen::Texture(_), None) => {}
        }
        self.take_compared(context, picture.compared);
        let now = Instant::now();
        if self.arrivals.back().is_some_and(|last| now.duration_since(*last).as_secs_f64() > REST_SECS) {
            self.arrivals.clear();
        }
        self.arrivals.push_back(now);
        if self.arrivals.len() > RATE_PICTURES {
            self.arrivals.pop_front();
        }
    }

    fn take_values(&mut self, generation: u64, image: Arc<LinearImage>, histogram: Vec<[f32; 3]>) {
        // Base layers alone can be darker than the whole: until that stands, the exposure follows, unless it was set.
        if self.exposed == Some(self.display.tone.exposure_stops) {
            self.display.tone.exposure_stops = ltm::image::exposure_for(&image);
            self.exposed = (!self.progress.is_complete()).then_some(self.display.tone.exposure_stops);
        }
        (self.valued, self.image, self.histogram) = (generation, Some(image), histogram);
    }

    fn take_compared(&mut self, context: &egui::Context, shown: Option<Arc<Shown>>) {
        let Some(shown) = shown else { return self.compared = None };
        let (kept, mut texture) = self.compared.take().unzip();
        if !kept.is_some_and(|kept| Arc::ptr_eq(&kept, &shown)) {
            set_texture(context, &mut texture, "compared", &shown);
        }
        self.compared = texture.map(|texture| (shown, texture));
    }

    /// What to draw as the picture.
    pub(super) fn picture_id(&self) -> Option<TextureId> {
        let in_memory = || self.texture.as_ref().map(TextureHandle::id);
        self.screen.as_ref().map(ScreenTexture::id).or_else(in_memory)
    }

    /// What to draw beside the wipe.
    pub(super) fn compared_id(&self) -> Option<TextureId> {
        self.compared.as_ref().map(|(_, texture)| texture.id())
    }

    /// The rows of the mixer.
    pub(super) fn rows(&self) -> Vec<Row> {
        self.groups.rows(self.session.basis(), &self.search, self.order, &self.folded, &self.ranked.0)
    }

    /// Sorts the mixer anew by what lights bring by now; while it `is_used`, only where another order was chosen.
    pub(super) fn rank(&mut self, is_used: bool) {
        let is_new = self.ranked.1 != self.order || self.ranked.0.len() != self.contributions.len();
        if is_new || !is_used {
            self.ranked = (self.contributions.clone(), self.order);
        }
    }

    /// Asks for what has changed; after the panels were drawn. `held` while a drag is on.
    pub(super) fn ask(&mut self, context: &egui::Context, held: bool) {
        self.history.observe(&self.mix, held);
        let relit = self.lit.as_ref() != Some(&self.mix);
        let display = (self.display, self.snapshots.compared());
        if !relit && self.asked_display == Some(display) {
            return;
        }
        if relit {
            match self.mix.lighting(self.session.basis(), &self.groups) {
                Ok(lighting) => self.lighting = Arc::new(lighting),
                Err(error) => self.message = Some((error.to_string(), true)),
            }
            self.lit = Some(self.mix.clone());
            if let Some(reach) = &self.reach {
                self.contributions = reach.contributions(self.session.basis(), &self.lighting);
            }
        }
        self.asked_display = Some(display);
        self.generation += 1;
        if relit {
            self.relit = self.generation;
        }
        self.pending.insert(self.generation, context.cumulative_frame_nr());
        self.session.worker.request(Request {
            generation: self.generation,
            lighting: self.lighting.clone(),
            display: self.display,
            looked_at: self.viewport.centre,
            compared: self.snapshots.compared().map(|index| self.snapshots.list()[index].image.clone()),
        });
        // After the lighting under which it is asked.
        if let (true, Some(asked)) = (relit, &self.asked) {
            self.session.worker.ask_pixel(asked.pixel);
        }
    }

    /// Whether the whole picture stands and nothing is awaited.
    pub(super) fn is_settled(&self) -> bool {
        let has_come = self.pending.is_empty() && self.valued == self.seen && !self.select_strongest;
        self.progress.is_complete() && has_come && self.beside == 0
    }

    pub(super) fn undo(&mut self) {
        self.mix = self.history.undo().unwrap_or_else(|| self.mix.clone());
    }

    pub(super) fn redo(&mut self) {
        self.mix = self.history.redo().unwrap_or_else(|| self.mix.clone());
    }

    /// Back to the scene's own lighting.
    pub(super) fn reset(&mut self) {
        self.mix = self.scene_mix.clone();
    }

    /// Back to how the picture was first shown.
    pub(super) fn reset_display(&mut self) {
        self.display = Display::default();
        self.expose();
    }

    pub(super) fn expose(&mut self) {
        if let Some(image) = &self.image {
            self.display.tone.exposure_stops = ltm::image::exposure_for(image);
        }
    }

    /// Keeps the lighting with its picture: at once, or when the picture is there.
    pub(super) fn snapshot(&mut self) {
        let is_there = self.valued >= self.relit && self.lit.as_ref() == Some(&self.mix);
        self.snapshot_wanted = !is_there;
        if let (true, Some(image)) = (is_there, self.image.clone()) {
            self.snapshots.take(self.mix.clone(), image);
        }
    }

    /// The small picture of a snapshot, made once.
    pub(super) fn thumbnail(&mut self, context: &egui::Context, index: usize) -> TextureHandle {
        let snapshot = &self.snapshots.list()[index];
        let display = self.display;
        self.thumbnails
            .entry(snapshot.name.clone())
            .or_insert_with(|| {
                let shown = display.show(&thumbnail(&snapshot.image, 128));
                context.load_texture(&snapshot.name, colour_image(&shown), TextureOptions::LINEAR)
            })
            .clone()
    }
}

/// The picture as the CPU's memory has it.
pub(super) fn colour_image(shown: &Shown) -> ColorImage {
    // Opaque, so that nothing is to be multiplied.
    ColorImage::from_rgba_premultiplied(shown.size, &shown.rgba)
}

fn set_texture(context: &egui::Context, texture: &mut Option<TextureHandle>, name: &str, shown: &Shown) {
    let options = TextureOptions {
        magnification: egui::TextureFilter::Nearest,
        minification: egui::TextureFilter::Linear,
        ..Default::default()
    };
    let image = reduced(colour_image(shown), context.input(|input| input.max_texture_side));
    match texture {
        Some(texture) => texture.set(image, options),
        None => *texture = Some(context.load_texture(name, image, options)),
    }
}

/// Of an image that is larger than a texture may be, every second pixel, or third, and so on.
fn reduced(image: ColorImage, most: usize) -> ColorImage {
    let [width, height] = image.size;
    let step = width.max(height).div_ceil(most.max(1));
    if step <= 1 {
        return image;
    }
    let rows = image.pixels.chunks_exact(width.max(1)).step_by(step);
    let pixels = rows.flat_map(|row| row.iter().step_by(step).copied()).collect();
    ColorImage::new([width.div_ceil(step), height.div_ceil(step)], pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_beyond_the_largest_texture_is_reduced_into_it() {
        let image = ColorImage::new([5, 3], (0..15).map(egui::Color32::from_gray).collect());
        assert_eq!(reduced(image.clone(), 5), image);
        let small = reduced(image, 3);
        assert_eq!(small.size, [3, 2]);
        assert_eq!(small.pixels, [0, 2, 4, 10, 12, 14].map(egui::Color32::from_gray));
    }
}
