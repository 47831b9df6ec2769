//! Relighting beside the window: a thread that takes the newest lighting and leaves out those that were overtaken.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::Instant;

use super::display::{Display, Shown};
use super::mixer::Mix;
use super::reach::{Reach, per_light, pixel_rows};
use crate::container::ContainerReader;
use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::light::{LightBasis, Lighting};
use crate::matrix::{BlockId, CHANNELS, ColumnIndex, FactorSource, FactoredBlock, MatrixShape};
use crate::relight::{CpuRelighter, GpuRelighter, GpuSettings, Relit};

/// A changed lighting is applied column by column while fewer than one in this many columns change: a column of `R` is
/// gathered entry by entry, some ten times dearer than in a pass over all of it.
const FEW_COLUMNS: usize = 10;

/// Blocks that are read before the first picture, and how long later steps take at least, in seconds.
const FIRST_STEP: usize = 16;
const STEP_SECS: f64 = 0.08;

/// The device that the window draws with, to relight on it too.
#[derive(Clone, Debug)]
pub struct SharedDevice {
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
}

/// What the window wants to see.
#[derive(Clone, Debug)]
pub struct Request {
    /// Grows with every request, so that a picture can be traced to what asked for it.
    pub generation: u64,
    /// The lighting.
    pub lighting: Arc<Lighting>,
    /// How its radiance is turned to colours.
    pub display: Display,
    /// A picture to show beside it, and how far.
    pub compared: Option<Arc<LinearImage>>,
}

/// A picture made for a request.
#[derive(Clone, Debug)]
pub struct Picture {
    /// The request's.
    pub generation: u64,
    /// Linear radiance.
    pub image: Arc<LinearImage>,
    /// As it is shown.
    pub shown: Shown,
    /// The compared picture, as it is shown.
    pub compared: Option<Shown>,
    /// What of the container is in it.
    pub progress: Progress,
    /// Time of relighting alone; 0 where the lighting had not changed.
    pub relight_secs: f64,
    /// Time from taking the request to the finished picture.
    pub total_secs: f64,
}

/// How much of the container is resident: base layers of all blocks come first, then all their layers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Progress {
    /// Share of the blocks whose base layer is there.
    pub base: f32,
    /// Share of the blocks that are there with all their layers.
    pub whole: f32,
}

impl Progress {
    /// Everything is there.
    pub const COMPLETE: Self = Self { base: 1.0, whole: 1.0 };

    /// Whether everything is there.
    pub fn is_complete(self) -> bool {
        self == Self::COMPLETE
    }
}

/// What work beside the worker brings.
#[derive(Debug)]
pub enum Brought {
    /// Something was written; one line about it.
    Message(String),
    /// An image was read.
    Image {
        /// Its file.
        path: PathBuf,
        /// The light that it is for; none: it is a reference.
        light: Option<usize>,
        /// The image.
        image: LinearImage,
    },
    /// A lighting file was read.
    Look {
        /// The file.
        path: PathBuf,
        /// What it puts on the lights.
        mix: Mix,
    },
}

/// What comes back from the worker.
pub enum Event {
    /// A picture.
    Picture(Box<Picture>),
    /// All factors are resident.
    Loaded {
        /// On the CPU, in any case.
        relighter: Arc<CpuRelighter>,
        /// The adapter that relights, where it is not the CPU, and the bytes that it takes there.
        adapter: Option<(String, u64)>,
    },
    /// What each column brings to the picture is known.
    Reach(Reach),
    /// What each light brings to a pixel, at the newest lighting: luminances.
    Pixel {
        /// The pixel.
        pixel: [u32; 2],
        /// One value for each light.
        lights: Vec<f32>,
    },
    /// Work beside the worker is done, or failed with a message.
    Brought(Result<Brought, String>),
    /// Something could not be done.
    Failed(String),
}

/// What was read of the container so far; it counts while others look.
#[derive(Debug, Default)]
pub struct Meter {
    /// Bytes of layers read.
    pub bytes_read: AtomicU64,
    /// Blocks read, base layers and whole ones counted alike.
    pub blocks_read: AtomicU64,
}

/// A container whose reads are counted, and of which only the base layers may be shown.
struct Metered<'a> {
    source: &'a ContainerReader,
    meter: &'a Meter,
    most_layers: u32,
    stop: &'a AtomicBool,
}

impl FactorSource for Metered<'_> {
    fn shape(&self) -> MatrixShape {
        self.source.shape()
    }

    fn layer_count(&self, id: BlockId) -> u32 {
        self.source.layer_count(id).min(self.most_layers)
    }

    fn encoded_bytes(&self, id: BlockId, layers: Range<u32>) -> u64 {
        self.source.encoded_bytes(id, layers)
    }

    fn read_layers(&self, id: BlockId, layers: Range<u32>) -> Result<FactoredBlock> {
        if self.stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted("the window was closed".into()));
        }
        if layers.is_empty() {
            // Also of blocks that the container does not hold.
            let (rows, columns) = (self.shape().rect(id).pixels() * CHANNELS, self.shape().columns());
            return Ok(FactoredBlock { rows, columns, ..Default::default() });
        }
        self.meter.bytes_read.fetch_add(self.source.encoded_bytes(id, layers.clone()), Ordering::Relaxed);
        self.meter.blocks_read.fetch_add(1, Ordering::Relaxed);
        self.source.read_layers(id, layers)
    }
}

#[derive(Default)]
struct Wishes {
    picture: Option<Request>,
    pixel: Option<[u32; 2]>,
}

#[derive(Default)]
struct Shared {
    wishes: Mutex<Wishes>,
    woken: Condvar,
    stop: AtomicBool,
    meter: Meter,
}

impl Shared {
    fn wishes(&self) -> MutexGuard<'_, Wishes> {
        // No code that can panic runs while the lock is held.
        self.wishes.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// The worker of one container. Dropping it ends its threads.
pub struct Worker {
    shared: Arc<Shared>,
    events: Receiver<Event>,
    outbox: Outbox,
    thread: Option<JoinHandle<()>>,
}

/// What sends an event and wakes the window.
#[derive(Clone)]
struct Outbox {
    events: Sender<Event>,
    wake: Arc<dyn Fn() + Send + Sync>,
}

impl Outbox {
    fn send(&self, event: Event) {
        // The window may be gone already; then nobody needs the event.
        if self.events.send(event).is_ok() {
            (self.wake)();
        }
    }
}

impl Worker {
    /// Begins to load the factors of an open container, to relight them on `device` if there is one, else on the CPU.
    /// `wake` is called after every event.
    pub fn start(
        source: Arc<ContainerReader>,
        device: Option<SharedDevice>,
        wake: Arc<dyn Fn() + Send + Sync>,
    ) -> Self {
        let shared = Arc::new(Shared::default());
        let (sender, events) = channel();
        let outbox = Outbox { events: sender, wake };
        let thread = {
            let (shared, outbox) = (shared.clone(), outbox.clone());
            std::thread::spawn(move || {
                if let Err(error) = work(&source, device, &shared, &outbox)
                    && !shared.stopped()
                {
                    outbox.send(Event::Failed(error.to_string()));
                }
            })
        };
        Self { shared, events, outbox, thread: Some(thread) }
    }

    /// Asks for a picture; one that was asked for and not begun is forgotten.
    pub fn request(&self, request: Request) {
        self.shared.wishes().picture = Some(request);
        self.shared.woken.notify_all();
    }

    /// Asks which lights matter at a pixel.
    pub fn ask_pixel(&self, pixel: [u32; 2]) {
        self.shared.wishes().pixel = Some(pixel);
        self.shared.woken.notify_all();
    }

    /// Does something that takes long, writing a file say, on a thread of its own; what it returns comes back as
    /// [`Event::Brought`].
    pub fn beside(&self, work: impl FnOnce() -> Result<Brought> + Send + 'static) {
        let outbox = self.outbox.clone();
        std::thread::spawn(move || outbox.send(Event::Brought(work().map_err(|error| error.to_string()))));
    }

    /// The events since the last call.
    pub fn events(&self) -> impl Iterator<Item = Event> + '_ {
        self.events.try_iter()
    }

    /// What was read so far.
    pub fn meter(&self) -> &Meter {
        &self.shared.meter
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        self.shared.woken.notify_all();
        if let Some(thread) = self.thread.take() {
            // A panic there was reported by its own message; there is nothing to add here.
            let _ = thread.join();
        }
    }
}

/// Loads base layers, then everything, and serves wishes in between and after.
fn work(
    source: &Arc<ContainerReader>,
    device: Option<SharedDevice>,
    shared: &Arc<Shared>,
    outbox: &Outbox,
) -> Result<()> {
    let metered = |most_layers| Metered { source, meter: &shared.meter, most_layers, stop: &shared.stop };
    let mut desk = Desk {
        source: source.clone(),
        shared: shared.clone(),
        outbox: outbox.clone(),
        gpu: None,
        kept: None,
        last: None,
    };
    // Without layers every block is black and nothing is read.
    let mut relighter = CpuRelighter::load(&metered(0))?;
    let mut ids: Vec<BlockId> = source.shape().blocks().filter(|&id| source.has_block(id)).collect();
    middle_first(source.shape(), &mut ids);
    let (all, refined): (usize, Vec<_>) =
        (ids.len(), ids.iter().copied().filter(|&id| source.layer_count(id) > 1).collect());
    let mut progress = Progress::default();
    for (most_layers, ids) in [(1, ids), (u32::MAX, refined)] {
        let (mut at, mut step) = (0, FIRST_STEP);
        while at < ids.len() {
            let begun = Instant::now();
            let these = &ids[at..(at + step).min(ids.len())];
            relighter.refine(&metered(most_layers), these)?;
            at += these.len();
            let share = at as f32 / all as f32;
            match most_layers {
                1 => progress.base = share,
                _ => progress.whole = (all - ids.len() + at) as f32 / all as f32,
            }
            let read_secs = begun.elapsed().as_secs_f64();
            if at < ids.len() {
                desk.show_progress(&relighter, progress);
            }
            // Pictures in between cost time that reading could use: it gets twice theirs.
            let wanted_secs = STEP_SECS.max(2.0 * (begun.elapsed().as_secs_f64() - read_secs));
            step = if read_secs < wanted_secs { step * 2 } else { step.div_ceil(2) };
        }
    }
    let whole = Arc::new(relighter);
    if let Some(SharedDevice { device, queue }) = device {
        match GpuRelighter::on_device(device, queue, &metered(u32::MAX), GpuSettings::default()) {
            Ok(gpu) => desk.gpu = Some(gpu),
            Err(error @ Error::Interrupted(_)) => return Err(error),
            Err(error) => outbox.send(Event::Failed(format!("{error}; relighting on the CPU"))),
        }
    }
    let adapter = desk.gpu.as_ref().map(|gpu| (gpu.adapter(), gpu.resident_bytes()));
    outbox.send(Event::Loaded { relighter: whole.clone(), adapter });
    desk.show_progress(&whole, Progress::COMPLETE);
    let reach = {
        let (source, shared, outbox) = (source.clone(), shared.clone(), outbox.clone());
        std::thread::spawn(move || {
            let metered = Metered { source: &source, meter: &shared.meter, most_layers: u32::MAX, stop: &shared.stop };
            if let Some(reach) = Reach::measure(&metered, &shared.stop) {
                outbox.send(Event::Reach(reach));
            }
        })
    };
    desk.serve(&whole);
    reach.join().map_err(|_| Error::input("contributions", "cannot be measured", "open the file again"))
}

/// Puts the blocks in the middle of the picture, where people look, before those at its edges.
fn middle_first(shape: MatrixShape, ids: &mut [BlockId]) {
    let middle = [shape.width(), shape.height()].map(|v| f64::from(v) / 2.0);
    ids.sort_by_cached_key(|&id| {
        let rect = shape.rect(id);
        let [x, y] = [rect.x + rect.width / 2, rect.y + rect.height / 2].map(f64::from);
        ((x - middle[0]).hypot(y - middle[1]) * 16.0) as u64
    });
}

/// What the worker keeps between wishes.
struct Desk {
    source: Arc<ContainerReader>,
    shared: Arc<Shared>,
    outbox: Outbox,
    gpu: Option<GpuRelighter>,
    kept: Option<Kept>,
    /// The request of the newest picture, to show it again when more has streamed in.
    last: Option<Request>,
}

struct Kept {
    lighting: Arc<Lighting>,
    /// What the CPU keeps to change a few columns; none where the GPU relights.
    relit: Option<Relit>,
    image: Arc<LinearImage>,
}

impl Desk {
    /// Shows what the newest request gives with the factors that are there by now.
    fn show_progress(&mut self, relighter: &CpuRelighter, progress: Progress) {
        self.kept = None;
        if let Some(request) = self.shared.wishes().picture.take() {
            self.last = Some(request);
        }
        if let Some(request) = self.last.clone() {
            let made = self.make(relighter, request, progress);
            self.tell(made);
        }
    }

    /// Serves wishes until the stop.
    fn serve(&mut self, relighter: &CpuRelighter) {
        loop {
            let (picture, pixel) = {
                let mut wishes = self.shared.wishes();
                while !self.shared.stopped() && wishes.picture.is_none() && wishes.pixel.is_none() {
                    wishes = self.shared.woken.wait(wishes).unwrap_or_else(|poisoned| poisoned.into_inner());
                }
                if self.shared.stopped() {
                    return;
                }
                (wishes.picture.take(), wishes.pixel.take())
            };
            if let Some(request) = picture {
                let made = self.make(relighter, request, Progress::COMPLETE);
                self.tell(made);
            }
            if let Some(pixel) = pixel {
                let found = self.look_at(pixel);
                self.tell(found);
            }
        }
    }

    fn tell(&self, outcome: Result<()>) {
        if let Err(error) = outcome {
            self.outbox.send(Event::Failed(error.to_string()));
        }
    }

    fn make(&mut self, relighter: &CpuRelighter, request: Request, progress: Progress) -> Result<()> {
        let begun = Instant::now();
        let relit = self.relight(relighter, &request.lighting)?;
        let relight_secs = if relit { begun.elapsed().as_secs_f64() } else { 0.0 };
        let kept = self.kept.as_ref().expect("relight has just set it");
        let image = kept.image.clone();
        let shown = request.display.show(&image);
        let compared = request.compared.map(|image| request.display.show(&image));
        let total_secs = begun.elapsed().as_secs_f64();
        let generation = request.generation;
        let picture = Picture { generation, image, shown, compared, progress, relight_secs, total_secs };
        self.outbox.send(Event::Picture(Box::new(picture)));
        Ok(())
    }

    /// Brings the kept picture to a lighting by the cheapest way; says whether there was anything to do.
    fn relight(&mut self, relighter: &CpuRelighter, lighting: &Arc<Lighting>) -> Result<bool> {
        if let Some(kept) = &mut self.kept {
            let pairs = kept.lighting.weights().iter().zip(lighting.weights()).enumerate();
            let changes: Vec<_> = pairs
                .filter(|(_, (old, new))| old != new)
                .map(|(column, (_, new))| (ColumnIndex(column as u32), *new))
                .collect();
            if changes.is_empty() {
                return Ok(false);
            }
            let few = changes.len() == 1 || changes.len() * FEW_COLUMNS <= lighting.weights().len();
            if let (true, Some(relit)) = (few, &mut kept.relit) {
                relighter.change(relit, &changes)?;
                kept.lighting = lighting.clone();
                kept.image = Arc::new(relit.image.clone());
                return Ok(true);
            }
        }
        let lighting = lighting.clone();
        if let Some(gpu) = &self.gpu {
            match gpu.relight(&lighting) {
                Ok(image) => {
                    self.kept = Some(Kept { lighting, relit: None, image: Arc::new(image) });
                    return Ok(true);
                }
                Err(error) => {
                    self.gpu = None;
                    self.outbox.send(Event::Failed(format!("{error}; relighting on the CPU")));
                }
            }
        }
        let relit = relighter.relight_kept(&lighting)?;
        let image = Arc::new(relit.image.clone());
        self.kept = Some(Kept { lighting, relit: Some(relit), image });
        Ok(true)
    }

    fn look_at(&self, pixel: [u32; 2]) -> Result<()> {
        let Some(kept) = &self.kept else { return Ok(()) };
        let rows = pixel_rows(&*self.source, pixel)?;
        let lights = per_light(&self.source.job().basis, &rows, &kept.lighting);
        self.outbox.send(Event::Pixel { pixel, lights });
        Ok(())
    }
}

/// An open container with its worker.
pub struct Session {
    /// Its file.
    pub path: PathBuf,
    /// The container.
    pub container: Arc<ContainerReader>,
    /// Its worker.
    pub worker: Worker,
}

impl Session {
    /// Opens a container and begins to load it, to relight it on `device` if there is one.
    ///
    /// Errors: those of [`ContainerReader::open`].
    pub fn open(path: &Path, device: Option<SharedDevice>, wake: Arc<dyn Fn() + Send + Sync>) -> Result<Self> {
        let container = Arc::new(ContainerReader::open(path)?);
        let worker = Worker::start(container.clone(), device, wake);
        Ok(Self { path: path.to_owned(), container, worker })
    }

    /// The lights.
    pub fn basis(&self) -> &LightBasis {
        &self.container.job().basis
    }

    /// Relative error over all blocks, against the stored matrix, as the container states it; none if it does not.
    pub fn stated_error(&self) -> Option<f64> {
        let (mut error, mut norm) = (0.0, 0.0);
        for id in self.container.shape().blocks().filter(|&id| self.container.has_block(id)) {
            let report = self.container.block_report(id);
            error += report.squared_error;
            norm += report.squared_norm;
        }
        let relative = (error / norm).sqrt();
        relative.is_finite().then_some(relative)
    }
}
