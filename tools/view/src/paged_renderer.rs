//! The worker's desk for a container that is larger than its budget: every picture is made at once of what is held, and
//! refined as the rest passes through.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

use super::metered::Metered;
use super::renderer::{Desk, Pace};
use super::words::line;
use super::worker::{Event, PictureProgress, Request, SharedDevice, most_bytes, nearest_first};
use ltm::container::ContainerReader;
use ltm::error::{Error, Result};
use ltm::image::LinearImage;
use ltm::light::Lighting;
use ltm::matrix::{BlockId, FactorSource};
use ltm::relight::{Detail, GpuSettings, PagedGpuRelighter, PagedRelighter};

/// Pixels on the device take this much beside their factors: radiance, and a copy to be read.
const DEVICE_PIXEL_BYTES: u64 = 24;

/// The owner of the blocks, which relights them.
enum Holder<'a> {
    Cpu(Box<PagedRelighter<'a>>),
    Device(Box<PagedGpuRelighter<'a>>),
}

impl<'a> Holder<'a> {
    /// On the device, if there is one.
    fn new(source: &'a Metered, budget_bytes: u64, device: Option<&SharedDevice>) -> Result<Self> {
        let Some(SharedDevice { device, queue, .. }) = device.cloned() else {
            return Ok(Self::Cpu(Box::new(PagedRelighter::new(source, budget_bytes))));
        };
        // Nothing stays with the host.
        let host = PagedRelighter::new(source, 0);
        let paged = PagedGpuRelighter::on_device(device, queue, host, budget_bytes, GpuSettings::default())?;
        Ok(Self::Device(Box::new(paged)))
    }

    fn relight_view(
        &self,
        lighting: &Lighting,
        view: &[BlockId],
        detail: Detail,
        image: &mut LinearImage,
    ) -> Result<()> {
        match self {
            Self::Cpu(pages) => pages.relight_view(lighting, view, detail, image),
            Self::Device(pages) => pages.relight_view(lighting, view, detail, image),
        }
    }

    fn resident_bytes(&self) -> u64 {
        match self {
            Self::Cpu(pages) => pages.resident_bytes(),
            Self::Device(pages) => pages.resident_bytes(),
        }
    }

    fn pace(&self) -> Pace {
        match self {
            Self::Cpu(_) => Pace::new(),
            Self::Device(_) => Pace::of_device(),
        }
    }

    /// The most that a block takes here.
    fn most_bytes(&self, source: &ContainerReader, id: BlockId) -> u64 {
        let pixels = source.shape().rect(id).pixels() as u64;
        match self {
            Self::Cpu(_) => most_bytes(source, id),
            Self::Device(_) => most_bytes(source, id) + pixels * DEVICE_PIXEL_BYTES,
        }
    }

    fn damage(&self) -> Vec<String> {
        match self {
            Self::Cpu(pages) => pages.damage(),
            Self::Device(pages) => pages.host().damage(),
        }
    }
}

/// Three relighters share the budget, so that no block pushes another out that the next picture needs: each picture
/// needs every block once.
struct Pages<'a> {
    source: &'a ContainerReader,
    /// Base layers of all blocks, as far as they fit.
    base: Holder<'a>,
    /// Whole blocks, as many as fit beside them.
    whole: Holder<'a>,
    whole_bytes: u64,
    /// Reads what is to be seen once; holds nothing. The CPU relights it: on the device it would be used once, too.
    passing: PagedRelighter<'a>,
    /// The blocks of `whole`.
    held: Vec<BlockId>,
    /// The others.
    rest: Vec<BlockId>,
}

/// A picture in the making.
struct Canvas {
    request: Request,
    image: LinearImage,
    /// Blocks of `rest`, in the order in which they are refined, and how many of them are.
    order: Vec<BlockId>,
    refined: usize,
}

impl<'a> Pages<'a> {
    /// Holds `held` and what fits of `order` from `at` on; refines a few blocks of an image and says how many.
    fn refine(
        &mut self,
        lighting: &Lighting,
        order: &[BlockId],
        step: usize,
        image: &mut LinearImage,
    ) -> Result<usize> {
        let mut room = self.whole_bytes.saturating_sub(self.whole.resident_bytes());
        let fits = |id: &&BlockId| match room.checked_sub(self.whole.most_bytes(self.source, **id)) {
            Some(left) => {
                room = left;
                true
            }
            None => false,
        };
        let fitting = order.iter().take(step).take_while(fits).count();
        if fitting > 0 {
            let new = &order[..fitting];
            self.whole.relight_view(lighting, new, Detail::Whole, image)?;
            self.held.extend(new);
            self.rest.retain(|id| !new.contains(id));
            return Ok(fitting);
        }
        let passing = &order[..step.min(order.len())];
        self.passing.relight_view(lighting, passing, Detail::Whole, image)?;
        Ok(passing.len())
    }

    fn resident_bytes(&self) -> u64 {
        self.base.resident_bytes() + self.whole.resident_bytes()
    }

    /// A line for each damaged block.
    fn damage(&self) -> Vec<String> {
        let mut lines = [self.base.damage(), self.whole.damage(), self.passing.damage()].concat();
        lines.sort();
        lines.dedup();
        lines
    }
}

impl Desk {
    /// Reads base layers first, then serves wishes until the stop; while nothing is wished for, the picture is refined.
    pub(super) fn serve_paged(
        mut self,
        source: &ContainerReader,
        metered: &Metered,
        ids: Vec<BlockId>,
        (budget_bytes, device): (u64, Option<SharedDevice>),
    ) -> Result<()> {
        if device.is_some() {
            match self.serve_pages(source, metered, &ids, (budget_bytes, device)) {
                Err(error @ (Error::NoGpu(_) | Error::Resources { .. })) => {
                    self.outbox.send(Event::Failed(format!("{}; relighting on the CPU", line(&error))));
                }
                outcome => return outcome,
            }
        }
        self.serve_pages(source, metered, &ids, (budget_bytes, None))
    }

    fn serve_pages(
        &mut self,
        source: &ContainerReader,
        metered: &Metered,
        ids: &[BlockId],
        (budget_bytes, device): (u64, Option<SharedDevice>),
    ) -> Result<()> {
        let base = Holder::new(metered, budget_bytes, device.as_ref())?;
        let (shape, all) = (source.shape(), ids.len());
        let mut image = LinearImage::black(shape.width(), shape.height());
        let mut pace = base.pace();
        let mut at = 0;
        while at < all {
            let Some(request) = self.newest() else {
                // The window asks for a picture in its first frame.
                if self.shared.stopped() {
                    return Ok(());
                }
                std::thread::sleep(std::time::Duration::from_millis(1));
                continue;
            };
            pace.begin();
            let step = &ids[at..(at + pace.step).min(all)];
            match base.relight_view(&request.lighting, step, Detail::Base, &mut image) {
                Err(error) if self.goes_on(&error) => continue,
                relit => relit?,
            }
            at += step.len();
            pace.has_read();
            self.meter(&base, base.resident_bytes());
            let progress = PictureProgress { base: at as f32 / all as f32, whole: 0.0 };
            self.show(&request, Arc::new(image.clone()), progress, (Instant::now(), 0.0));
            pace.has_shown();
        }
        let whole_bytes = budget_bytes.saturating_sub(base.resident_bytes());
        let mut pages = Pages {
            source,
            base,
            whole: Holder::new(metered, whole_bytes, device.as_ref())?,
            // Of the device's budget a quarter is left for what passes.
            whole_bytes: if device.is_some() { whole_bytes / 4 * 3 } else { whole_bytes },
            passing: PagedRelighter::new(metered, 0),
            held: Vec::new(),
            rest: ids.to_vec(),
        };
        let adapter = match &pages.base {
            Holder::Cpu(_) => None,
            Holder::Device(pages) => Some(pages.adapter()),
        };
        self.outbox.send(Event::Loaded { relighter: None, adapter, is_paged: true });
        self.refine_and_serve(metered, &mut pages)
    }

    fn meter(&self, holder: &Holder, bytes: u64) {
        let meter = &self.shared.meter;
        let (held, other) = match holder {
            Holder::Cpu(_) => (&meter.resident_bytes, &meter.device_bytes),
            Holder::Device(_) => (&meter.device_bytes, &meter.resident_bytes),
        };
        held.store(bytes, Ordering::Relaxed);
        other.store(0, Ordering::Relaxed);
    }

    fn refine_and_serve(&mut self, metered: &Metered, pages: &mut Pages) -> Result<()> {
        let all = (pages.held.len() + pages.rest.len()).max(1);
        let mut canvas: Option<Canvas> = None;
        let mut pace = pages.whole.pace();
        let mut told = (0, false);
        loop {
            let is_new = canvas.is_none() || self.shared.wishes().picture.is_some();
            if let Some(request) = self.newest().filter(|_| is_new) {
                let begun = Instant::now();
                match self.begin(pages, request, canvas.take()) {
                    Ok(begun) => canvas = Some(begun),
                    Err(error) if self.goes_on(&error) => continue,
                    Err(error) => return Err(error),
                }
                let canvas = canvas.as_ref().expect("it was just made");
                let done = (pages.held.len() + canvas.refined) as f32 / all as f32;
                let progress = PictureProgress { base: 1.0, whole: done.min(1.0) };
                let spent = begun.elapsed().as_secs_f64();
                self.show(&canvas.request, Arc::new(canvas.image.clone()), progress, (begun, spent));
            }
            let asked = self.shared.wishes().pixel.take();
            if let Some(pixel) = asked {
                self.look_at(metered, pixel);
            }
            if self.shared.stopped() {
                return Ok(());
            }
            match canvas.as_mut().filter(|canvas| canvas.refined < canvas.order.len()) {
                Some(canvas) => {
                    pace.begin();
                    let lighting = canvas.request.lighting.clone();
                    let left = &canvas.order[canvas.refined..];
                    match pages.refine(&lighting, left, pace.step, &mut canvas.image) {
                        Ok(refined) => canvas.refined += refined,
                        Err(error) if self.goes_on(&error) => continue,
                        Err(error) => return Err(error),
                    }
                    pace.has_read();
                    self.meter(&pages.base, pages.resident_bytes());
                    let left = canvas.order.len() - canvas.refined;
                    let progress = PictureProgress { base: 1.0, whole: 1.0 - left as f32 / all as f32 };
                    self.show(&canvas.request, Arc::new(canvas.image.clone()), progress, (Instant::now(), 0.0));
                    pace.has_shown();
                    if left == 0 {
                        let damage = pages.damage();
                        let (reach, measured) = metered.reach();
                        if !std::mem::replace(&mut told.1, measured >= all) {
                            self.outbox.send(Event::Reach(reach));
                        }
                        if damage.len() > std::mem::replace(&mut told.0, damage.len()) {
                            self.outbox.send(Event::Damage(damage));
                        }
                    }
                }
                None => {
                    if !self.await_wishes() {
                        return Ok(());
                    }
                }
            }
        }
    }

    /// Waits until something is wished; whether it was, and not the end.
    fn await_wishes(&self) -> bool {
        let Some(wishes) = self.shared.wait() else { return false };
        self.shared.wishes().add_older(wishes);
        true
    }

    /// A picture of what is held, or the one at hand where only its display has changed.
    fn begin(&self, pages: &Pages, request: Request, last: Option<Canvas>) -> Result<Canvas> {
        if let Some(last) = last.filter(|last| last.request.lighting == request.lighting) {
            return Ok(Canvas { request, ..last });
        }
        let shape = pages.source.shape();
        let mut image = LinearImage::black(shape.width(), shape.height());
        pages.base.relight_view(&request.lighting, &pages.rest, Detail::Base, &mut image)?;
        pages.whole.relight_view(&request.lighting, &pages.held, Detail::Whole, &mut image)?;
        let mut order = pages.rest.clone();
        nearest_first(shape, request.looked_at, &mut order);
        Ok(Canvas { request, image, order, refined: 0 })
    }
}
