//! The worker's desk where a device holds the factors: pictures go from there to the screen, and their values are read
//! back when nobody waits for a picture.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::desk::Desk;
use super::display::Display;
use super::metered::Metered;
use super::worker::{Event, Progress, Request, Seen, SharedDevice, Wishes};
use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::light::Lighting;
use crate::relight::{GpuRelighter, GpuScreen, GpuSettings};

/// Values are read back once nothing was wished for this long, and in a drag after this long at most, so that histogram
/// and probe follow. In between, no picture waits for them.
const QUIET: Duration = Duration::from_millis(30);
const OVERDUE: Duration = Duration::from_millis(200);

/// The device's part of what the worker keeps.
pub(super) struct OnDevice {
    screen: GpuScreen,
    /// The lighting of what stands on the screen.
    lit: Option<Arc<Lighting>>,
    /// The values that were read back last.
    read: Option<(Arc<Lighting>, Arc<LinearImage>)>,
    /// The newest picture that is shown without its values, and since when there is one.
    unread: Option<(Unread, Instant)>,
}

struct Unread {
    generation: u64,
    lighting: Arc<Lighting>,
    display: Display,
}

impl OnDevice {
    /// Puts all factors on the device.
    pub(super) fn load(SharedDevice { device, queue }: SharedDevice, metered: &Metered) -> Result<Self> {
        let relighter = GpuRelighter::on_device(device, queue, metered, GpuSettings::default())?;
        Ok(Self { screen: GpuScreen::new(relighter)?, lit: None, read: None, unread: None })
    }

    pub(super) fn adapter(&self) -> String {
        self.screen.relighter().adapter()
    }

    pub(super) fn resident_bytes(&self) -> u64 {
        self.screen.resident_bytes()
    }

    /// Shows what is asked for; says whether it had to be relit.
    fn show(&mut self, request: &Request) -> Result<bool> {
        let is_new = self.lit.as_ref() != Some(&request.lighting);
        self.screen.show(is_new.then_some(&request.lighting), request.display.shown_as())?;
        self.lit = Some(request.lighting.clone());
        let Request { generation, display, .. } = *request;
        let unread = Unread { generation, lighting: request.lighting.clone(), display };
        let since = self.unread.as_ref().map_or_else(Instant::now, |(_, since)| *since);
        self.unread = Some((unread, since));
        Ok(is_new)
    }

    /// How long the values of what is shown may wait for something to be wished for; none if they were read.
    fn may_wait(&self) -> Option<Duration> {
        let (_, since) = self.unread.as_ref()?;
        Some(match self.read {
            // The first say how to expose the picture.
            None => Duration::ZERO,
            Some(_) => QUIET.min(OVERDUE.saturating_sub(since.elapsed())),
        })
    }

    /// The values of what is shown, if they were not read yet.
    fn values(&mut self) -> Result<Option<Event>> {
        let Some((Unread { generation, lighting, display }, _)) = self.unread.take() else { return Ok(None) };
        let image = match &self.read {
            Some((of, image)) if *of == lighting => image.clone(),
            _ => Arc::new(self.screen.relighter().radiance()?),
        };
        let histogram = display.histogram(&image);
        self.read = Some((lighting, image.clone()));
        Ok(Some(Event::Values { generation, image, histogram }))
    }
}

impl Desk {
    /// Shows a picture on the device; whether there is one that could.
    pub(super) fn show_on_device(&mut self, request: &Request) -> bool {
        let begun = Instant::now();
        let Some(device) = &mut self.device else { return false };
        match device.show(request) {
            Ok(is_new) => {
                let seen = Seen::Texture(device.screen.texture().clone());
                let relight_secs = if is_new { begun.elapsed().as_secs_f64() } else { 0.0 };
                self.send(request, seen, Progress::COMPLETE, (begun, relight_secs));
            }
            Err(error) => self.lose_device(&error),
        }
        self.device.is_some()
    }

    fn lose_device(&mut self, error: &Error) {
        self.device = None;
        self.outbox.send(Event::Failed(format!("{error}; relighting on the CPU")));
    }

    /// The next wishes; while there are none, the values of what is shown are read. None after the stop.
    pub(super) fn next_wishes(&mut self) -> Option<Wishes> {
        if let Some(time) = self.device.as_ref().and_then(OnDevice::may_wait) {
            if !time.is_zero() {
                let wishes = self.shared.wait_at_most(time)?;
                if !wishes.is_empty() {
                    return Some(wishes);
                }
            }
            match self.device.as_mut().map(OnDevice::values) {
                Some(Ok(Some(values))) => self.outbox.send(values),
                Some(Err(error)) => {
                    self.lose_device(&error);
                    return Some(Wishes { picture: self.newest(), pixel: None });
                }
                _ => {}
            }
        }
        self.shared.wait()
    }
}
