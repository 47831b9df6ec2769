//! How pictures are shown: the same for all views.

use crate::display::Display;
use ltm::image::{LinearImage, exposure_for};

/// The exposure that was chosen for a picture, until the whole picture stands.
pub(super) struct Exposure(Option<f32>);

impl Default for Exposure {
    fn default() -> Self {
        Self(Some(Display::default().tone.exposure_stops))
    }
}

impl Exposure {
    /// Exposes for a picture that streams in: base layers alone can be darker than the whole, so until that stands, the
    /// exposure follows, unless it was set.
    pub(super) fn follow(&mut self, display: &mut Display, image: &LinearImage, is_complete: bool) {
        if self.0 == Some(display.tone.exposure_stops) {
            display.tone.exposure_stops = exposure_for(image);
            self.0 = (!is_complete).then_some(display.tone.exposure_stops);
        }
    }

    /// Follows no more.
    pub(super) fn stay(&mut self) {
        self.0 = None;
    }
}
