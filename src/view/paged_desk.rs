//! The worker's desk for a container that is larger than its budget: every picture is made at once of what is held, and
//! refined as the rest passes through.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

use super::desk::{Desk, Pace};
use super::metered::Metered;
use super::worker::{Event, Progress, Request, most_bytes, nearest_first};
use crate::container::ContainerReader;
use crate::error::Result;
use crate::image::LinearImage;
use crate::light::Lighting;
use crate::matrix::{BlockId, FactorSource};
use crate::relight::{Detail, PagedRelighter};

/// Three relighters share the budget, so that no block pushes another out that the next picture needs: each picture
/// needs every block once.
struct Pages<'a> {
    source: &'a ContainerReader,
    /// Base layers of all blocks, as far as they fit.
    base: PagedRelighter<'a>,
    /// Whole blocks, as many as fit beside them.
    whole: PagedRelighter<'a>,
    whole_bytes: u64,
    /// Reads what is to be seen once; holds nothing.
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
        let fits = |id: &&BlockId| match room.checked_sub(most_bytes(self.source, **id)) {
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
        let mut lines = [&self.base, &self.whole, &self.passing].map(PagedRelighter::damage).concat();
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
        budget_bytes: u64,
    ) -> Result<()> {
        let base = PagedRelighter::new(metered, budget_bytes);
        let (shape, all) = (source.shape(), ids.len());
        let mut image = LinearImage::black(shape.width(), shape.height());
        let mut pace = Pace::new();
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
            base.relight_view(&request.lighting, step, Detail::Base, &mut image)?;
            at += step.len();
            pace.has_read();
            self.shared.meter.resident_bytes.store(base.resident_bytes(), Ordering::Relaxed);
            let progress = Progress { base: at as f32 / all as f32, whole: 0.0 };
            self.show(&request, Arc::new(image.clone()), progress, (Instant::now(), 0.0));
            pace.has_shown();
        }
        let whole_bytes = budget_bytes.saturating_sub(base.resident_bytes());
        let mut pages = Pages {
            source,
            base,
            whole: PagedRelighter::new(metered, whole_bytes),
            whole_bytes,
            passing: PagedRelighter::new(metered, 0),
            held: Vec::new(),
            rest: ids,
        };
        self.outbox.send(Event::Loaded { relighter: None, adapter: None });
        self.refine_and_serve(metered, &mut pages)
    }

    fn refine_and_serve(mut self, metered: &Metered, pages: &mut Pages) -> Result<()> {
        let all = (pages.held.len() + pages.rest.len()).max(1);
        let mut canvas: Option<Canvas> = None;
        let mut pace = Pace::new();
        let mut told = (0, false);
        loop {
            let is_new = canvas.is_none() || self.shared.wishes().picture.is_some();
            if let Some(request) = self.newest().filter(|_| is_new) {
                let begun = Instant::now();
                canvas = Some(self.begin(pages, request, canvas.take())?);
                let canvas = canvas.as_ref().expect("it was just made");
                let done = (pages.held.len() + canvas.refined) as f32 / all as f32;
                let progress = Progress { base: 1.0, whole: done.min(1.0) };
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
                    canvas.refined += pages.refine(&lighting, left, pace.step, &mut canvas.image)?;
                    pace.has_read();
                    self.shared.meter.resident_bytes.store(pages.resident_bytes(), Ordering::Relaxed);
                    let left = canvas.order.len() - canvas.refined;
                    let progress = Progress { base: 1.0, whole: 1.0 - left as f32 / all as f32 };
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
                    let Some(wishes) = self.shared.wait() else { return Ok(()) };
                    let mut waiting = self.shared.wishes();
                    // What came in the meantime is newer.
                    waiting.picture = waiting.picture.take().or(wishes.picture);
                    waiting.pixel = waiting.pixel.or(wishes.pixel);
                }
            }
        }
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
