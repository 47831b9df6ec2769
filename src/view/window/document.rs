//! One open container with everything that the window knows of it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use eframe::egui::{self, ColorImage, TextureHandle, TextureOptions};

use crate::error::Result;
use crate::image::LinearImage;
use crate::light::{LightBasis, Lighting};
use crate::matrix::FactorSource;
use crate::view::display::{Display, Shown};
use crate::view::groups::{Groups, Order};
use crate::view::history::History;
use crate::view::mixer::Mix;
use crate::view::pattern::{Brush, ShapeKind};
use crate::view::reach::Reach;
use crate::view::snapshots::{Snapshots, thumbnail};
use crate::view::viewport::Viewport;
use crate::view::worker::{Event, Picture, Request, Session};

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
    pub(super) image_path: String,
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
    pub(super) asked: Option<Asked>,
    /// Whether the next answer about a pixel selects its strongest light.
    pub(super) select_strongest: bool,
    pub(super) scroll_to_selected: bool,
    pub(super) hovered: Option<[u32; 2]>,
    pub(super) easel: Easel,
    pub(super) image: Option<Arc<LinearImage>>,
    pub(super) texture: Option<TextureHandle>,
    pub(super) compared_texture: Option<TextureHandle>,
    pub(super) histogram: Vec<[f32; 3]>,
    pub(super) complete: bool,
    pub(super) factor_bytes: u64,
    pub(super) mean_rank: f64,
    pub(super) damage: Vec<String>,
    pub(super) latency: Latency,
    pub(super) message: Option<(String, bool)>,
    pub(super) export_path: String,
    /// Where the mixer stands, for files that are dropped on it.
    pub(super) mixer_rect: egui::Rect,
    reach: Option<Reach>,
    lighting: Arc<Lighting>,
    lit: Option<Mix>,
    asked_display: Option<(Display, Option<usize>)>,
    generation: u64,
    /// Frame in which each open request was made.
    pending: BTreeMap<u64, u64>,
    /// The exposure that was chosen for the picture, until the whole picture stands.
    exposed: Option<f32>,
}

impl Document {
    pub(super) fn open(context: &egui::Context, path: &Path) -> Result<Self> {
        let wake = {
            let context = context.clone();
            Arc::new(move || context.request_repaint())
        };
        let session = Session::open(path, wake)?;
        let groups = Groups::of(session.basis());
        let mix = Mix::of_scene(session.basis(), &groups);
        let lighting = Arc::new(mix.lighting(session.basis(), &groups)?);
        let stem = path.file_stem().map_or("picture".into(), |stem| stem.to_string_lossy().into_owned());
        Ok(Self {
            history: History::new(mix.clone()),
            selected: (!mix.lights.is_empty()).then_some(0),
            folded: if session.basis().lights().len() > 60 { (0..groups.len()).collect() } else { BTreeSet::new() },
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
                image_path: String::new(),
            },
            image: None,
            texture: None,
            compared_texture: None,
            histogram: Vec::new(),
            complete: false,
            factor_bytes: 0,
            mean_rank: 0.0,
            damage: Vec::new(),
            latency: Latency::default(),
            message: None,
            export_path: stem,
            mixer_rect: egui::Rect::NOTHING,
            reach: None,
            lighting,
            lit: None,
            asked_display: None,
            generation: 0,
            pending: BTreeMap::new(),
            exposed: Some(Display::default().exposure_stops),
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

    /// Share of the container's blocks that were read, 0 to 1, while it loads.
    pub(super) fn loaded(&self) -> f32 {
        let read = self.session.worker.meter().blocks_read.load(Ordering::Relaxed);
        (read as f32 / self.session.container.shape().block_count() as f32).min(1.0)
    }

    pub(super) fn bytes_read(&self) -> u64 {
        self.session.worker.meter().bytes_read.load(Ordering::Relaxed)
    }

    /// Takes what the worker has done; before the panels are drawn.
    pub(super) fn receive(&mut self, context: &egui::Context) {
        let events: Vec<Event> = self.session.worker.events().collect();
        for event in events {
            match event {
                Event::Picture(picture) => self.take_picture(context, *picture),
                Event::Loaded { factor_bytes, mean_rank, damage } => {
                    (self.factor_bytes, self.mean_rank) = (factor_bytes, mean_rank);
                    if let Some(first) = damage.first() {
                        self.message = Some((format!("{} damaged blocks: {first}", damage.len()), true));
                    }
                    self.damage = damage;
                }
                Event::Reach(reach) => {
                    self.contributions = reach.contributions(self.session.basis(), &self.lighting);
                    self.reach = Some(reach);
                }
                Event::Pixel { pixel, lights } => {
                    if std::mem::take(&mut self.select_strongest) {
                        let strongest = (0..lights.len()).max_by(|&a, &b| lights[a].total_cmp(&lights[b]));
                        self.selected = strongest.filter(|&light| lights[light] > 0.0).or(self.selected);
                        self.scroll_to_selected = true;
                    }
                    self.asked = Some(Asked { pixel, lights });
                }
                Event::Failed(message) => self.message = Some((message, true)),
            }
        }
    }

    fn take_picture(&mut self, context: &egui::Context, picture: Picture) {
        // Base layers alone can be darker than the whole: until that stands, the exposure follows, unless it was set.
        if self.exposed == Some(self.display.exposure_stops) {
            self.display.exposure_stops = Display::exposure_for(&picture.image);
            self.exposed = (!picture.complete).then_some(self.display.exposure_stops);
        }
        if let Some(asked_in) = self.pending.get(&picture.generation) {
            let frames = context.cumulative_frame_nr() - asked_in;
            let (relight_secs, total_secs) = (picture.relight_secs, picture.total_secs);
            if relight_secs > 0.0 {
                self.latency = Latency { frames, relight_secs, total_secs };
            }
        }
        self.pending.retain(|&generation, _| generation > picture.generation);
        set_texture(context, &mut self.texture, "picture", &picture.shown);
        match &picture.compared {
            Some(shown) => set_texture(context, &mut self.compared_texture, "compared", shown),
            None => self.compared_texture = None,
        }
        self.histogram = picture.shown.histogram;
        self.image = Some(picture.image);
        self.complete = picture.complete;
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
            if let Some(asked) = &self.asked {
                self.session.worker.ask_pixel(asked.pixel);
            }
        }
        self.asked_display = Some(display);
        self.generation += 1;
        self.pending.insert(self.generation, context.cumulative_frame_nr());
        self.session.worker.request(Request {
            generation: self.generation,
            lighting: self.lighting.clone(),
            display: self.display,
            compared: self.snapshots.compared().map(|index| self.snapshots.list()[index].image.clone()),
        });
    }

    /// Whether a picture is awaited.
    pub(super) fn waits(&self) -> bool {
        !self.pending.is_empty()
    }

    pub(super) fn undo(&mut self) {
        self.mix = self.history.undo().unwrap_or_else(|| self.mix.clone());
    }

    pub(super) fn redo(&mut self) {
        self.mix = self.history.redo().unwrap_or_else(|| self.mix.clone());
    }

    /// Back to the scene's own lighting.
    pub(super) fn reset(&mut self) {
        self.mix = Mix::of_scene(self.session.basis(), &self.groups);
    }

    pub(super) fn expose(&mut self) {
        if let Some(image) = &self.image {
            self.display.exposure_stops = Display::exposure_for(image);
        }
    }

    pub(super) fn snapshot(&mut self) {
        if let Some(image) = self.image.clone() {
            self.snapshots.take(self.mix.clone(), image);
        }
    }

    /// Adds an image of the picture's size to compare with.
    pub(super) fn add_reference(&mut self, path: &Path) -> Result<()> {
        let image = crate::image::read_image(path)?;
        if [image.width, image.height] != self.size() {
            let problem = format!("is {} × {} pixels, the picture {:?}", image.width, image.height, self.size());
            return Err(crate::error::Error::input(path.display().to_string(), problem, "give one of the same size"));
        }
        let name = path.file_name().map_or("reference".into(), |name| name.to_string_lossy().into_owned());
        let index = self.snapshots.add_reference(&name, Arc::new(image));
        self.thumbnails.remove(&name);
        if self.snapshots.compared() != Some(index) {
            self.snapshots.toggle_compare(index);
        }
        Ok(())
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

fn colour_image(shown: &Shown) -> ColorImage {
    ColorImage::from_rgba_unmultiplied(shown.size, &shown.rgba)
}

fn set_texture(context: &egui::Context, texture: &mut Option<TextureHandle>, name: &str, shown: &Shown) {
    let options = TextureOptions {
        magnification: egui::TextureFilter::Nearest,
        minification: egui::TextureFilter::Linear,
        ..Default::default()
    };
    match texture {
        Some(texture) => texture.set(colour_image(shown), options),
        None => *texture = Some(context.load_texture(name, colour_image(shown), options)),
    }
}
