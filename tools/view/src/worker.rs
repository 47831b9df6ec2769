//! Relighting beside the window: a thread that takes the newest lighting and leaves out those that were overtaken.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::Duration;

use super::difference::Difference;
use super::display::{Display, Shown};
use super::file_watch::{FileChange, FileWatch};
use super::looks::Saved;
pub use super::metered::Meter;
use super::metered::Metered;
use super::reach::TexelReach;
use super::renderer::Desk;
use super::surfaces::Surfaces;
use super::unsaved::LeftBehind;
use super::words::line;
use ltm::container::ContainerReader;
use ltm::error::Result;
use ltm::image::LinearImage;
use ltm::light::{LightBasis, Lighting};
use ltm::matrix::{BlockId, CHANNELS, FactorSource, MatrixShape};
use ltm::relight::CpuRelighter;

/// The device that the window draws with, to relight on it too.
#[derive(Clone, Debug)]
pub struct SharedDevice {
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// Whether it shows what it relights too; else that is read back, and the CPU shows it.
    pub shows: bool,
}

/// Resources that a worker may use.
#[derive(Clone, Debug)]
pub struct Means {
    /// The device to relight on; none: the CPU does.
    pub device: Option<SharedDevice>,
    /// Memory for factors, in bytes: the device's where it relights, else the CPU's. A container that may need more is
    /// read as it is shown. A smaller one passes through the memory of the CPU on its way to the device.
    pub budget_bytes: u64,
}

/// The view that the window asks for.
#[derive(Clone, Debug)]
pub struct Request {
    /// Grows with every request, so that a picture can be traced to what asked for it.
    pub generation: u64,
    /// The lighting.
    pub lighting: Arc<Lighting>,
    /// Display settings.
    pub display: Display,
    /// A picture to show beside it.
    pub compared: Option<Compared>,
    /// The pixel in the middle of what is seen: blocks near it are refined first.
    pub looked_at: [f32; 2],
}

/// A picture to compare with.
#[derive(Clone, Debug)]
pub struct Compared {
    /// The picture.
    pub image: Arc<LinearImage>,
    /// Whether it was made for a display: then it is shown as it is, whatever the exposure.
    pub is_displayed: bool,
}

/// A picture made for a request.
#[derive(Clone, Debug)]
pub struct Picture {
    /// The request's.
    pub generation: u64,
    /// The picture as it is shown.
    pub seen: Seen,
    /// The compared picture, as it is shown; the same as before where neither it nor its display has changed.
    pub compared: Option<Arc<Shown>>,
    /// How much of the container is in it.
    pub progress: PictureProgress,
    /// Time of relighting alone, where it is shown on the device with the display; 0 where the lighting had not changed.
    pub relight_secs: f64,
    /// Time from taking the request to the finished picture.
    pub total_secs: f64,
}

/// Location of an image.
#[derive(Clone, Debug)]
pub enum Seen {
    /// In the memory of the CPU, with its linear radiance.
    Bytes(Shown, Arc<LinearImage>),
    /// On the device, in a texture that stays the same for all pictures. Its values follow as [`Event::Values`], once
    /// nothing newer is wished for.
    Texture(wgpu::Texture),
}

/// How much of the container is resident: base layers of all blocks come first, then all their layers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PictureProgress {
    /// Share of the blocks whose base layer is there.
    pub base: f32,
    /// Share of the blocks that are there with all their layers.
    pub whole: f32,
}

impl PictureProgress {
    /// Everything is there.
    pub const COMPLETE: Self = Self { base: 1.0, whole: 1.0 };

    /// Whether all blocks are loaded.
    pub fn is_complete(self) -> bool {
        self == Self::COMPLETE
    }
}

/// Events from jobs beside the worker.
#[derive(Debug)]
pub enum Brought {
    /// A message on a file that was written, one line.
    Message(String),
    /// A lighting file was written.
    Wrote {
        /// The file.
        path: PathBuf,
        /// The content.
        saved: Box<Saved>,
        /// The lights that it is over.
        basis: Box<LightBasis>,
        /// Revision of the snapshots that stand in it.
        revision: u64,
        /// One line about it.
        message: String,
    },
    /// An image was read.
    Image {
        /// Path of the file.
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
        /// The content.
        saved: Box<Saved>,
        /// The lights that it is over.
        basis: Box<LightBasis>,
    },
    /// Work that an earlier window left behind was read.
    Recovered {
        /// The content.
        saved: Box<Saved>,
        /// The lights that it is over.
        basis: Box<LightBasis>,
        /// Where it was saved.
        left: LeftBehind,
    },
    /// The work was written down, in case the window ends by force.
    Unsaved(Result<()>),
    /// The albedos of the surfaces in view were read, or why they could not be.
    Surfaces(std::result::Result<Arc<Surfaces>, String>),
    /// The difference of picture and compared picture; none where there is none. The number is the asker's.
    Difference(u64, Option<Arc<Difference>>),
    /// The picture of a snapshot that came without one.
    SnapshotImage {
        /// The snapshot's name.
        name: String,
        /// Revision of the snapshots for which it was made.
        revision: u64,
        /// The picture.
        image: Arc<LinearImage>,
    },
}

/// Events from the worker.
pub enum Event {
    /// A picture.
    Picture(Box<Picture>),
    /// The values of a picture that was shown on the device.
    Values {
        /// The picture's.
        generation: u64,
        /// Linear radiance.
        image: Arc<LinearImage>,
        /// As in [`Shown`].
        histogram: Vec<[f32; 3]>,
    },
    /// The container is loaded, as far as it stays in memory.
    Loaded {
        /// All factors in the CPU's memory, where they fit and the CPU relights.
        relighter: Option<Arc<CpuRelighter>>,
        /// The adapter that relights, where it is not the CPU.
        adapter: Option<String>,
        /// Whether the container is larger than its budget.
        is_paged: bool,
    },
    /// The contribution of each column to the image.
    Reach(TexelReach),
    /// What each light brings to a pixel, at the newest lighting: luminances.
    Pixel {
        /// The pixel.
        pixel: [u32; 2],
        /// One value for each light.
        lights: Vec<f32>,
    },
    /// Work beside the worker is done, or failed with a message.
    Brought(Result<Brought, String>),
    /// What of the container is damaged: a line for each block that is shown with fewer layers than it has, or as a hole.
    Damage(Vec<String>),
    /// The open file has changed.
    File(FileChange),
    /// An action failed.
    Failed(String),
}

#[derive(Default)]
pub(super) struct Wishes {
    pub(super) picture: Option<Request>,
    pub(super) pixel: Option<[u32; 2]>,
}

impl Wishes {
    pub(super) fn is_empty(&self) -> bool {
        self.picture.is_none() && self.pixel.is_none()
    }

    /// Takes what was wished before, where nothing newer is.
    pub(super) fn add_older(&mut self, older: Self) {
        self.picture = self.picture.take().or(older.picture);
        self.pixel = self.pixel.or(older.pixel);
    }
}

/// State shared by the window and its worker.
#[derive(Default)]
pub(super) struct Shared {
    wishes: Mutex<Wishes>,
    woken: Condvar,
    stop: AtomicBool,
    pub(super) meter: Meter,
}

impl Shared {
    pub(super) fn wishes(&self) -> MutexGuard<'_, Wishes> {
        // No code that can panic runs while the lock is held.
        self.wishes.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    pub(super) fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Waits for wishes and takes them; none after the stop.
    pub(super) fn wait(&self) -> Option<Wishes> {
        let mut wishes = self.wishes();
        while !self.stopped() && wishes.is_empty() {
            wishes = self.woken.wait(wishes).unwrap_or_else(|poisoned| poisoned.into_inner());
        }
        (!self.stopped()).then(|| std::mem::take(&mut *wishes))
    }

    /// As [`wait`](Self::wait), for some time at most; then there may be none.
    pub(super) fn wait_at_most(&self, time: Duration) -> Option<Wishes> {
        let wishes = self.wishes();
        let is_idle = |wishes: &mut Wishes| !self.stopped() && wishes.is_empty();
        let waited = self.woken.wait_timeout_while(wishes, time, is_idle);
        let mut wishes = waited.unwrap_or_else(|poisoned| poisoned.into_inner()).0;
        (!self.stopped()).then(|| std::mem::take(&mut *wishes))
    }
}

/// The worker of one container. It sleeps until it is woken, and holds no factors while it does; what is done beside it goes on. Dropping
/// it ends its threads.
pub struct Worker {
    source: Arc<ContainerReader>,
    shared: Arc<Shared>,
    events: Receiver<Event>,
    outbox: Outbox,
    thread: Option<JoinHandle<()>>,
}

/// Sends events and wakes the window.
#[derive(Clone)]
pub(super) struct Outbox {
    events: Sender<Event>,
    wake: Arc<dyn Fn() + Send + Sync>,
}

impl Outbox {
    pub(super) fn send(&self, event: Event) {
        // The window may be gone already; then nobody needs the event.
        if self.events.send(event).is_ok() {
            (self.wake)();
        }
    }
}

impl Worker {
    /// The worker of an open container, asleep. `wake` is called after every event.
    pub fn asleep(source: Arc<ContainerReader>, wake: Arc<dyn Fn() + Send + Sync>) -> Self {
        let (sender, events) = channel();
        let outbox = Outbox { events: sender, wake };
        Self { source, shared: Arc::default(), events, outbox, thread: None }
    }

    /// Begins to load the factors, unless it is awake.
    pub fn wake(&mut self, means: Means) {
        if self.is_awake() {
            return;
        }
        *self.shared.wishes() = Wishes::default();
        self.shared.stop.store(false, Ordering::Relaxed);
        let (source, shared, outbox) = (self.source.clone(), self.shared.clone(), self.outbox.clone());
        self.thread = Some(std::thread::spawn(move || {
            if let Err(error) = work(&source, means, &shared, &outbox)
                && !shared.stopped()
            {
                outbox.send(Event::Failed(line(&error)));
            }
        }));
    }

    /// Lets the factors go. Of what was asked for nothing comes any more but what is among the events already.
    pub fn sleep(&mut self) {
        {
            // Locked, so that nobody is about to wait who has not seen it.
            let _wishes = self.shared.wishes();
            self.shared.stop.store(true, Ordering::Relaxed);
        }
        self.shared.woken.notify_all();
        if let Some(thread) = self.thread.take() {
            // A panic there was reported by its own message; there is nothing to add here.
            let _ = thread.join();
        }
        let meter = &self.shared.meter;
        meter.resident_bytes.store(0, Ordering::Relaxed);
        meter.device_bytes.store(0, Ordering::Relaxed);
    }

    /// Whether it was woken.
    pub fn is_awake(&self) -> bool {
        self.thread.is_some()
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
        std::thread::spawn(move || outbox.send(Event::Brought(work().map_err(|error| line(&error)))));
    }

    /// The events since the last call.
    pub fn events(&self) -> impl Iterator<Item = Event> + '_ {
        self.events.try_iter()
    }

    /// Counts of the reads so far.
    pub fn meter(&self) -> &Meter {
        &self.shared.meter
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.sleep();
    }
}

/// Loads what the budget allows and serves wishes in between and after.
fn work(source: &Arc<ContainerReader>, means: Means, shared: &Arc<Shared>, outbox: &Outbox) -> Result<()> {
    let metered = Metered::new(source, &shared.meter, &shared.stop);
    let desk = Desk::new(source.clone(), shared.clone(), outbox.clone());
    let mut ids: Vec<BlockId> = source.shape().blocks().filter(|&id| source.has_block(id)).collect();
    let needed_bytes = needed_bytes(source);
    let middle = [source.shape().width(), source.shape().height()].map(|v| v as f32 / 2.0);
    nearest_first(source.shape(), middle, &mut ids);
    match means.budget_bytes {
        budget if budget < needed_bytes => desk.serve_paged(source, &metered, ids, (budget, means.device)),
        _ => desk.serve_resident(&metered, &ids, means.device),
    }
}

/// The most that all blocks take in memory as they are held for relighting.
fn needed_bytes(source: &ContainerReader) -> u64 {
    source.shape().blocks().filter(|&id| source.has_block(id)).map(|id| most_bytes(source, id)).sum()
}

/// The most that a block takes in memory as it is held for relighting: 16 bits a value, 8 and 32 bits more for each
/// component and sparse entry.
pub(super) fn most_bytes(source: &ContainerReader, id: BlockId) -> u64 {
    let shape = source.shape();
    let (rows, rank) = (shape.rect(id).pixels() * CHANNELS, source.rank(id));
    let bytes = rank * (2 * (rows + shape.columns()) + 16) + source.sparse_entries(id) * 16;
    bytes as u64 + 256
}

/// Puts the blocks where people look before the others.
pub(super) fn nearest_first(shape: MatrixShape, looked_at: [f32; 2], ids: &mut [BlockId]) {
    ids.sort_by_cached_key(|&id| {
        let rect = shape.rect(id);
        let [x, y] = [rect.x + rect.width / 2, rect.y + rect.height / 2].map(|v| v as f32);
        ((x - looked_at[0]).hypot(y - looked_at[1]) * 16.0) as u64
    });
}

/// An open container with its worker.
pub struct Session {
    /// Its file.
    pub path: PathBuf,
    /// The container.
    pub container: Arc<ContainerReader>,
    /// Its worker.
    pub worker: Worker,
    _watch: FileWatch,
}

impl Session {
    /// Opens a container and begins to load it.
    ///
    /// Errors: those of [`ContainerReader::open`].
    pub fn open(path: &Path, means: Means, wake: Arc<dyn Fn() + Send + Sync>) -> Result<Self> {
        let mut session = Self::open_asleep(path, wake)?;
        session.worker.wake(means);
        Ok(session)
    }

    /// Opens a container whose worker sleeps.
    ///
    /// Errors: those of [`ContainerReader::open`].
    pub fn open_asleep(path: &Path, wake: Arc<dyn Fn() + Send + Sync>) -> Result<Self> {
        let container = Arc::new(ContainerReader::open(path)?);
        let worker = Worker::asleep(container.clone(), wake);
        let outbox = worker.outbox.clone();
        let _watch = FileWatch::start(path.to_owned(), move |change| outbox.send(Event::File(change)));
        Ok(Self { path: path.to_owned(), container, worker, _watch })
    }

    /// The lights.
    pub fn basis(&self) -> &LightBasis {
        &self.container.job().basis
    }

    /// The most memory that the factors take, in bytes.
    pub fn needed_bytes(&self) -> u64 {
        needed_bytes(&self.container)
    }

    /// Mean rank over all blocks.
    pub fn mean_rank(&self) -> f64 {
        let shape = self.container.shape();
        let ranks: usize = shape.blocks().map(|id| self.container.rank(id)).sum();
        ranks as f64 / f64::from(shape.block_count())
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
