//! What the worker does between wishes: it keeps the picture, and brings it to each new lighting by the cheapest way.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

use super::device_renderer::OnDevice;
use super::display::{Display, Shown};
use super::metered::Metered;
use super::reach::per_light;
use super::words::line;
use super::worker::{Compared, Event, Outbox, Picture, PictureProgress, Request, Seen, Shared, SharedDevice, Wishes};
use ltm::container::ContainerReader;
use ltm::error::{Error, Result};
use ltm::image::LinearImage;
use ltm::light::Lighting;
use ltm::matrix::{BlockId, CodedBlock, ColumnIndex, ColumnTransform, FactorSource, FactoredBlock, MatrixShape};
use ltm::relight::{CpuRelighter, Relit, pixel_rows};

/// A changed lighting is applied column by column if fewer than one in this many columns change. A column of `R` is
/// gathered entry by entry, at some ten times the cost of a pass over all of it.
const FEW_COLUMNS: usize = 10;

/// Blocks that are read before the first picture, and how long later steps take at least, in seconds.
const FIRST_STEP: usize = 16;
/// Blocks of a step on a device, at least.
const DEVICE_STEP: usize = 64;
const STEP_SECS: f64 = 0.08;

pub(super) struct Desk {
    source: Arc<ContainerReader>,
    pub(super) shared: Arc<Shared>,
    pub(super) outbox: Outbox,
    pub(super) device: Option<OnDevice>,
    kept: Option<Kept>,
    /// The compared picture, how it was shown, and as what.
    compared: Option<(Arc<LinearImage>, Display, Arc<Shown>)>,
    /// The request of the newest picture, to show it again when more has streamed in.
    pub(super) last: Option<Request>,
}

struct Kept {
    lighting: Arc<Lighting>,
    /// State kept on the CPU to apply changes of a few columns.
    relit: Relit,
    image: Arc<LinearImage>,
}

/// How many blocks to read at once, so that pictures in between cost no more than a third of the time.
pub(super) struct Pace {
    pub(super) step: usize,
    least: usize,
    begun: Instant,
    read_secs: f64,
}

impl Pace {
    pub(super) fn new() -> Self {
        Self { step: FIRST_STEP, least: 1, begun: Instant::now(), read_secs: 0.0 }
    }

    /// For a device that draws the window too: a step waits for a frame however little it does, and doing less would
    /// not make it shorter.
    pub(super) fn of_device() -> Self {
        Self { step: DEVICE_STEP, least: DEVICE_STEP, ..Self::new() }
    }

    pub(super) fn begin(&mut self) {
        self.begun = Instant::now();
    }

    pub(super) fn has_read(&mut self) {
        self.read_secs = self.begun.elapsed().as_secs_f64();
    }

    /// After the picture of what was read.
    pub(super) fn has_shown(&mut self) {
        let wanted_secs = STEP_SECS.max(2.0 * (self.begun.elapsed().as_secs_f64() - self.read_secs));
        self.step = if self.read_secs < wanted_secs { self.step * 2 } else { self.step.div_ceil(2).max(self.least) };
    }
}

impl Desk {
    pub(super) fn new(source: Arc<ContainerReader>, shared: Arc<Shared>, outbox: Outbox) -> Self {
        Self { source, shared, outbox, device: None, kept: None, compared: None, last: None }
    }

    /// Loads base layers, then everything, on `device` too if there is one; then serves wishes until the stop.
    pub(super) fn serve_resident(
        mut self,
        metered: &Metered,
        ids: &[BlockId],
        device: Option<SharedDevice>,
    ) -> Result<()> {
        let mut whole = Some(Arc::new(self.load(metered, ids)?));
        let damage = whole.as_ref().map_or(Vec::new(), |whole| whole.damage().to_vec());
        if let Some(device) = device {
            match OnDevice::load(device, metered) {
                Ok(device) => (self.device, whole) = (Some(device), None),
                Err(error @ Error::Interrupted { .. }) => return Err(error),
                Err(error) => self.outbox.send(Event::Failed(format!("{}; relighting on the CPU", line(&error)))),
            }
        }
        self.has_loaded(whole.as_ref());
        if !damage.is_empty() {
            self.outbox.send(Event::Damage(damage));
        }
        self.outbox.send(Event::Reach(metered.reach().0));
        // Made of what was there by then.
        self.kept = None;
        let mut wishes = Wishes { picture: self.newest(), pixel: None };
        loop {
            if let Some(request) = wishes.picture {
                self.last = Some(request.clone());
                let made = self.make_whole(metered, &mut whole, request);
                self.tell(made);
            }
            if let Some(pixel) = wishes.pixel {
                self.look_at(metered, pixel);
            }
            match self.next_wishes() {
                Some(newer) => wishes = newer,
                None => return Ok(()),
            }
        }
    }

    /// The picture of all factors: on the device where it has them, else on the CPU, which reads them where the device
    /// has just failed.
    fn make_whole(&mut self, metered: &Metered, whole: &mut Option<Arc<CpuRelighter>>, request: Request) -> Result<()> {
        if self.show_on_device(&request) {
            return Ok(());
        }
        let relighter = match whole {
            Some(relighter) => relighter.clone(),
            None => {
                let relighter = Arc::new(CpuRelighter::load(metered)?);
                *whole = Some(relighter.clone());
                self.has_loaded(Some(&relighter));
                relighter
            }
        };
        self.make(&relighter, request, PictureProgress::COMPLETE)
    }

    /// Says what relights from now on.
    fn has_loaded(&self, whole: Option<&Arc<CpuRelighter>>) {
        let meter = &self.shared.meter;
        meter.resident_bytes.store(whole.map_or(0, |whole| whole.factor_bytes()), Ordering::Relaxed);
        meter.device_bytes.store(self.device.as_ref().map_or(0, OnDevice::resident_bytes), Ordering::Relaxed);
        let adapter = self.device.as_ref().map(OnDevice::adapter);
        self.outbox.send(Event::Loaded { relighter: whole.cloned(), adapter, is_paged: false });
    }

    fn load(&mut self, metered: &Metered, ids: &[BlockId]) -> Result<CpuRelighter> {
        // Without layers every block is black and nothing is read.
        let mut relighter = CpuRelighter::load(&Nothing(metered))?;
        let source = self.source.clone();
        let refined: Vec<BlockId> = ids.iter().copied().filter(|&id| source.layer_count(id) > 1).collect();
        let mut progress = PictureProgress::default();
        for (base_only, these) in [(true, ids), (false, &refined)] {
            metered.set_base_only(base_only);
            let mut pace = Pace::new();
            let mut at = 0;
            while at < these.len() {
                pace.begin();
                let step = &these[at..(at + pace.step).min(these.len())];
                match relighter.refine(metered, step) {
                    Err(error) if self.goes_on(&error) => continue,
                    refined => refined?,
                }
                at += step.len();
                match base_only {
                    true => progress.base = at as f32 / ids.len() as f32,
                    false => progress.whole = (ids.len() - these.len() + at) as f32 / ids.len() as f32,
                }
                pace.has_read();
                self.shared.meter.resident_bytes.store(relighter.factor_bytes(), Ordering::Relaxed);
                if at < these.len() {
                    self.show_progress(&relighter, progress);
                }
                pace.has_shown();
            }
        }
        Ok(relighter)
    }

    /// Shows what the newest request gives with the factors that are there by now.
    fn show_progress(&mut self, relighter: &CpuRelighter, progress: PictureProgress) {
        self.kept = None;
        if let Some(request) = self.newest() {
            let made = self.make(relighter, request, progress);
            self.tell(made);
        }
    }

    /// The newest request, which is kept to be shown again.
    pub(super) fn newest(&mut self) -> Option<Request> {
        if let Some(request) = self.shared.wishes().picture.take() {
            self.last = Some(request);
        }
        self.last.clone()
    }

    /// Tells of an error of reading and waits for a wish that is newer than it, with which it may be gone: a disk or network may be
    /// back. Not where another error ends the desk, or lets another go on. At the stop the next read ends it.
    pub(super) fn goes_on(&self, error: &Error) -> bool {
        if !matches!(error, Error::Io { .. }) {
            return false;
        }
        let before = std::mem::take(&mut *self.shared.wishes());
        self.outbox.send(Event::Failed(format!("{}; it is tried again with the next change", line(error))));
        let newer = self.shared.wait().unwrap_or_default();
        self.shared.wishes().add_older(newer);
        self.shared.wishes().add_older(before);
        true
    }

    pub(super) fn tell(&self, outcome: Result<()>) {
        match outcome {
            Err(error) if !self.shared.stopped() => self.outbox.send(Event::Failed(line(&error))),
            _ => {}
        }
    }

    fn make(&mut self, relighter: &CpuRelighter, request: Request, progress: PictureProgress) -> Result<()> {
        let begun = Instant::now();
        let relit = self.relight(relighter, &request.lighting)?;
        let relight_secs = if relit { begun.elapsed().as_secs_f64() } else { 0.0 };
        let kept = self.kept.as_ref().expect("relight has just set it");
        self.show(&request, kept.image.clone(), progress, (begun, relight_secs));
        Ok(())
    }

    /// Sends a picture.
    pub(super) fn show(
        &mut self,
        request: &Request,
        image: Arc<LinearImage>,
        progress: PictureProgress,
        times: (Instant, f64),
    ) {
        let shown = request.display.show(&image);
        self.send(request, Seen::Bytes(shown, image), progress, times);
    }

    /// Sends a picture that is shown already.
    pub(super) fn send(
        &mut self,
        request: &Request,
        seen: Seen,
        progress: PictureProgress,
        (begun, relight_secs): (Instant, f64),
    ) {
        let compared = self.show_compared(request);
        let (generation, total_secs) = (request.generation, begun.elapsed().as_secs_f64());
        let picture = Picture { generation, seen, compared, progress, relight_secs, total_secs };
        self.outbox.send(Event::Picture(Box::new(picture)));
    }

    /// What the picture is compared with, as it is shown; made once as long as both stay the same.
    fn show_compared(&mut self, request: &Request) -> Option<Arc<Shown>> {
        let Compared { image, is_displayed } = request.compared.as_ref()?;
        let display = if *is_displayed { Display::default() } else { request.display };
        let kept = self.compared.as_ref().filter(|(of, shown_as, _)| Arc::ptr_eq(of, image) && *shown_as == display);
        let shown = kept.map_or_else(|| Arc::new(display.show(image)), |(_, _, shown)| shown.clone());
        self.compared = Some((image.clone(), display, shown.clone()));
        Some(shown)
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
            // What changes leave behind of roundings would show where nothing else is.
            let is_dark = lighting.weights().iter().flatten().all(|v| *v == 0.0);
            if few && !is_dark {
                relighter.change(&mut kept.relit, &changes)?;
                kept.lighting = lighting.clone();
                kept.image = Arc::new(kept.relit.image.clone());
                return Ok(true);
            }
        }
        let relit = relighter.relight_kept(lighting)?;
        let image = Arc::new(relit.image.clone());
        self.kept = Some(Kept { lighting: lighting.clone(), relit, image });
        Ok(true)
    }

    /// Says what each light brings to a pixel under the lighting of the newest picture.
    pub(super) fn look_at(&self, metered: &Metered, pixel: [u32; 2]) {
        let Some(request) = &self.last else { return };
        match pixel_rows(metered, pixel) {
            Ok(rows) => {
                let lights = per_light(&self.source.job().basis, &rows, &request.lighting);
                self.outbox.send(Event::Pixel { pixel, lights });
            }
            Err(error) => self.tell(Err(error)),
        }
    }
}

/// A source of black blocks.
struct Nothing<'a>(&'a Metered<'a>);

impl FactorSource for Nothing<'_> {
    fn shape(&self) -> MatrixShape {
        self.0.shape()
    }

    fn column_scales(&self) -> &[f32] {
        self.0.column_scales()
    }

    fn layer_count(&self, _: BlockId) -> u32 {
        0
    }

    fn encoded_bytes(&self, _: BlockId, _: Range<u32>) -> u64 {
        0
    }

    fn read_layers(&self, id: BlockId, _: Range<u32>) -> Result<FactoredBlock> {
        Ok(self.0.black(id).factors)
    }

    fn column_transform(&self) -> Arc<ColumnTransform> {
        self.0.column_transform()
    }

    fn read_coded(&self, id: BlockId, _: u32) -> Result<CodedBlock> {
        Ok(self.0.black(id))
    }

    fn decode_coded(&self, id: BlockId, _: &[Vec<u8>]) -> Result<CodedBlock> {
        Ok(self.0.black(id))
    }
}
