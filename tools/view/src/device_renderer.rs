//! The worker's desk where a device holds the factors: pictures go from there to the screen, and their values are read
//! back when nobody waits for a picture. Where the device is the slower one at showing, they are read back at once.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::display::Display;
use super::metered::Metered;
use super::renderer::Desk;
use super::words::line;
use super::worker::{Event, PictureProgress, Request, Seen, SharedDevice, Wishes};
use ltm::error::{Error, Result};
use ltm::image::LinearImage;
use ltm::light::Lighting;
use ltm::relight::{GpuRelighter, GpuScreen, GpuSettings};

/// Values are read back once nothing was wished for this long, and in a drag after this long at most, so that histogram
/// and probe follow. In between, no picture waits for them.
const QUIET: Duration = Duration::from_millis(30);
const OVERDUE: Duration = Duration::from_millis(200);

/// Who shows what the device relights.
enum Way {
    /// The device.
    Screen(Box<GpuScreen>),
    /// The CPU.
    ReadBack(Box<GpuRelighter>),
}

/// The device's part of what the worker keeps.
pub(super) struct OnDevice {
    way: Way,
    /// The lighting of what stands on the screen.
    lit: Option<Arc<Lighting>>,
    /// The values that were read back last.
    read: Option<(Arc<Lighting>, Arc<LinearImage>)>,
    /// The newest picture that is shown without its values, and since when there is one.
    unread: Option<(Unread, Instant)>,
}

/// A picture that the device has made.
enum Made {
    /// A texture that is displayed already.
    Shown(wgpu::Texture),
    /// An image read back.
    Image(Arc<LinearImage>),
}

struct Unread {
    generation: u64,
    lighting: Arc<Lighting>,
    display: Display,
}

impl OnDevice {
    /// Puts all factors on the device.
    pub(super) fn load(SharedDevice { device, queue, shows }: SharedDevice, metered: &Metered) -> Result<Self> {
        let relighter = GpuRelighter::on_device(device, queue, metered, GpuSettings::default())?;
        let way = match shows {
            true => Way::Screen(Box::new(GpuScreen::new(relighter)?)),
            false => Way::ReadBack(Box::new(relighter)),
        };
        Ok(Self { way, lit: None, read: None, unread: None })
    }

    fn relighter(&self) -> &GpuRelighter {
        match &self.way {
            Way::Screen(screen) => screen.relighter(),
            Way::ReadBack(relighter) => relighter,
        }
    }

    pub(super) fn adapter(&self) -> String {
        self.relighter().adapter()
    }

    pub(super) fn resident_bytes(&self) -> u64 {
        match &self.way {
            Way::Screen(screen) => screen.resident_bytes(),
            Way::ReadBack(relighter) => relighter.resident_bytes(),
        }
    }

    /// Relights what is asked for, and shows it or gives it back to be shown; says whether it had to be relit.
    fn make(&mut self, request: &Request) -> Result<(Made, bool)> {
        let is_new = self.lit.as_ref() != Some(&request.lighting);
        let screen = match &self.way {
            Way::Screen(screen) => screen,
            Way::ReadBack(relighter) => {
                let kept = self.read.as_ref().filter(|_| !is_new);
                let image = match kept {
                    Some((_, image)) => image.clone(),
                    None => Arc::new(relighter.relight(&request.lighting)?),
                };
                self.lit = Some(request.lighting.clone());
                self.read = Some((request.lighting.clone(), image.clone()));
                return Ok((Made::Image(image), is_new));
            }
        };
        screen.show(is_new.then_some(&request.lighting), request.display.shown_as())?;
        let texture = screen.texture().clone();
        self.lit = Some(request.lighting.clone());
        let Request { generation, display, .. } = *request;
        let unread = Unread { generation, lighting: request.lighting.clone(), display };
        let since = self.unread.as_ref().map_or_else(Instant::now, |(_, since)| *since);
        self.unread = Some((unread, since));
        Ok((Made::Shown(texture), is_new))
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
            _ => Arc::new(self.relighter().radiance()?),
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
        match device.make(request) {
            Ok((made, is_new)) => {
                let times = (begun, if is_new { begun.elapsed().as_secs_f64() } else { 0.0 });
                match made {
                    Made::Shown(texture) => {
                        self.send(request, Seen::Texture(texture), PictureProgress::COMPLETE, times)
                    }
                    Made::Image(image) => self.show(request, image, PictureProgress::COMPLETE, times),
                }
            }
            Err(error) => self.lose_device(&error),
        }
        self.device.is_some()
    }

    fn lose_device(&mut self, error: &Error) {
        self.device = None;
        self.outbox.send(Event::Failed(format!("{}; relighting on the CPU", line(error))));
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
