//! The newest picture: its values, its texture, how it came.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;

use eframe::egui::{self, ColorImage, TextureHandle, TextureId};
use eframe::egui_wgpu::RenderState;

use super::sampling::Sampling;
use super::screen::ScreenTexture;
use crate::display::Shown;
use crate::worker::{Picture, PictureProgress, Seen};
use ltm::image::LinearImage;
use ltm::relight::CpuRelighter;

/// Pictures over which their rate is counted, and the longest pause between two of them that is no rest, in seconds.
const RATE_PICTURES: usize = 24;
const REST_SECS: f64 = 0.5;

/// Cost of the last drag.
#[derive(Clone, Copy, Default)]
pub(super) struct Latency {
    pub(super) frames: u64,
    pub(super) relight_secs: f64,
    pub(super) total_secs: f64,
}

/// The values of a picture.
pub(super) struct PictureValues {
    /// Generation of the picture.
    pub(super) generation: u64,
    /// Linear radiance.
    pub(super) image: Arc<LinearImage>,
    pub(super) histogram: Vec<[f32; 3]>,
}

pub(super) struct ShownPicture {
    /// Linear radiance of the newest picture whose values have come.
    pub(super) image: Option<Arc<LinearImage>>,
    pub(super) histogram: Vec<[f32; 3]>,
    pub(super) progress: PictureProgress,
    /// All factors, once they are there, where the CPU relights.
    pub(super) relighter: Option<Arc<CpuRelighter>>,
    /// Whether the container is larger than its budget.
    pub(super) is_paged: bool,
    /// The adapter that relights, where it is not the CPU.
    pub(super) adapter: Option<String>,
    pub(super) latency: Latency,
    /// Pictures that have come.
    pub(super) pictures: u64,
    /// Generations of the newest picture and of the newest values.
    pub(super) seen: u64,
    pub(super) valued: u64,
    /// Whether larger pixels run into each other: of an early picture they mean nothing by themselves.
    pub(super) is_smooth: bool,
    /// Whether one looks around in it.
    is_around: bool,
    /// What its texture is called.
    name: String,
    texture: Option<TextureHandle>,
    /// What is drawn until there is a picture.
    stand_in: Option<TextureHandle>,
    /// The device's own texture, instead of the other, where the device shows the pictures.
    screen: Option<ScreenTexture>,
    /// The device that draws the window.
    state: Option<RenderState>,
    arrivals: VecDeque<Instant>,
}

impl ShownPicture {
    /// None yet; its texture will be called so. Pictures are shown on the device of `state`, if that is the one that relights.
    pub(super) fn new(name: String, state: Option<RenderState>) -> Self {
        Self {
            image: None,
            histogram: Vec::new(),
            progress: PictureProgress::default(),
            relighter: None,
            is_paged: false,
            adapter: None,
            latency: Latency::default(),
            pictures: 0,
            seen: 0,
            valued: 0,
            is_smooth: false,
            is_around: false,
            name,
            texture: None,
            stand_in: None,
            screen: None,
            state,
            arrivals: VecDeque::new(),
        }
    }

    /// Puts a picture on the screen. Its values and histogram, where they have come with it.
    pub(super) fn take(&mut self, context: &egui::Context, picture: Picture) -> Option<PictureValues> {
        self.progress = picture.progress;
        (self.seen, self.pictures) = (picture.generation, self.pictures + 1);
        self.count_arrival();
        self.stand_in = None;
        match (picture.seen, &self.state) {
            (Seen::Bytes(shown, image), _) => {
                let sampling = self.sampling();
                set_texture(context, &mut self.texture, &self.name, &shown, sampling);
                self.screen = None;
                return Some(PictureValues { generation: picture.generation, image, histogram: shown.histogram });
            }
            (Seen::Texture(texture), Some(state)) => {
                if !self.screen.as_ref().is_some_and(|screen| screen.shows(&texture)) {
                    self.screen = Some(ScreenTexture::new(state.clone(), texture));
                }
            }
            // Nobody has asked a device for it.
            (Seen::Texture(_), None) => {}
        }
        None
    }

    fn sampling(&self) -> Sampling {
        match (self.is_around, self.is_smooth) {
            (true, _) => Sampling::Around,
            (false, true) => Sampling::Smooth,
            (false, false) => Sampling::Squares,
        }
    }

    /// Shows further pictures as one looks around in them, or flat; whether that is another way than before.
    pub(super) fn look_around(&mut self, is_around: bool) -> bool {
        std::mem::replace(&mut self.is_around, is_around) != is_around
    }

    /// The texture of the image.
    pub(super) fn id(&self) -> Option<TextureId> {
        let in_memory = || self.texture.as_ref().map(TextureHandle::id);
        self.screen.as_ref().map(|screen| screen.id(self.sampling())).or_else(in_memory)
    }

    /// The texture to draw: that of another picture while there is none of this.
    pub(super) fn drawn(&self) -> Option<TextureId> {
        self.id().or(self.stand_in.as_ref().map(TextureHandle::id))
    }

    /// The texture itself, where it is in the memory of the CPU.
    pub(super) fn handle(&self) -> Option<TextureHandle> {
        self.texture.clone().or(self.stand_in.clone())
    }

    /// Draws another picture until there is one.
    pub(super) fn stand_in(&mut self, other: Option<TextureHandle>) {
        self.stand_in = other.filter(|_| self.id().is_none());
    }

    /// The value of a pixel.
    pub(super) fn pixel(&self, [x, y]: [u32; 2]) -> Option<[f32; 3]> {
        let image = self.image.as_ref()?;
        image.pixels.get(y as usize * image.width as usize + x as usize).copied()
    }

    /// Pictures a second over the last that came in a row; none after a rest.
    pub(super) fn per_sec(&self) -> Option<f64> {
        let (first, last) = (self.arrivals.front()?, self.arrivals.back()?);
        let span = last.duration_since(*first).as_secs_f64();
        (self.arrivals.len() > 2 && span > 0.0).then(|| (self.arrivals.len() - 1) as f64 / span)
    }

    fn count_arrival(&mut self) {
        let now = Instant::now();
        if self.arrivals.back().is_some_and(|last| now.duration_since(*last).as_secs_f64() > REST_SECS) {
            self.arrivals.clear();
        }
        self.arrivals.push_back(now);
        if self.arrivals.len() > RATE_PICTURES {
            self.arrivals.pop_front();
        }
    }
}

/// The picture as the CPU's memory has it.
pub(super) fn colour_image(shown: &Shown) -> ColorImage {
    // Opaque, so that nothing is to be multiplied.
    ColorImage::from_rgba_premultiplied(shown.size, &shown.rgba)
}

/// Sets a texture, or makes it.
pub(super) fn set_texture(
    context: &egui::Context,
    texture: &mut Option<TextureHandle>,
    name: &str,
    shown: &Shown,
    sampling: Sampling,
) {
    let image = reduced(colour_image(shown), context.input(|input| input.max_texture_side));
    match texture {
        Some(texture) => texture.set(image, sampling.options()),
        None => *texture = Some(context.load_texture(name, image, sampling.options())),
    }
}

/// Of an image that is larger than a texture may be, every second pixel, or third, and so on.
fn reduced(image: ColorImage, most: usize) -> ColorImage {
    let [width, height] = image.size;
    let step = width.max(height).div_ceil(most.max(1));
    if step <= 1 {
        return image;
    }
    let rows = image.pixels.chunks_exact(width.max(1)).step_by(step);
    let pixels = rows.flat_map(|row| row.iter().step_by(step).copied()).collect();
    ColorImage::new([width.div_ceil(step), height.div_ceil(step)], pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_beyond_the_largest_texture_is_reduced_into_it() {
        let image = ColorImage::new([5, 3], (0..15).map(egui::Color32::from_gray).collect());
        assert_eq!(reduced(image.clone(), 5), image);
        let small = reduced(image, 3);
        assert_eq!(small.size, [3, 2]);
        assert_eq!(small.pixels, [0, 2, 4, 10, 12, 14].map(egui::Color32::from_gray));
    }
}
