//! How a picture is seen between the middles of its pixels.

use eframe::egui::{TextureFilter, TextureOptions};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Sampling {
    /// Pixels are squares when they are large.
    #[default]
    Squares,
    /// They run into each other.
    Smooth,
    /// So, and at the right edge into those at the left one: as one looks around in a panorama.
    Around,
}

impl Sampling {
    /// What a texture is to be made with.
    pub(super) fn options(self) -> TextureOptions {
        match self {
            Self::Squares => TextureOptions { magnification: TextureFilter::Nearest, ..TextureOptions::LINEAR },
            Self::Smooth => TextureOptions::LINEAR,
            Self::Around => TextureOptions::LINEAR_REPEAT,
        }
    }
}
