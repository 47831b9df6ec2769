//! ꟻLIP (Andersson et al. 2020) at 67 pixels a degree.

use ltm::image::LinearImage;

/// Where and how much a displayed image differs from its reference.
pub(super) struct Flip(nv_flip::FlipImageFloat);

impl Flip {
    /// Of two images of one size; `displayed` gives the 8-bit sRGB bytes of each.
    pub(super) fn new(
        image: &LinearImage,
        reference: &LinearImage,
        displayed: impl Fn(&LinearImage) -> Vec<u8>,
    ) -> Self {
        let shown =
            |image: &LinearImage| nv_flip::FlipImageRgb8::with_data(image.width, image.height, &displayed(image));
        Self(nv_flip::flip(shown(reference), shown(image), nv_flip::DEFAULT_PIXELS_PER_DEGREE))
    }

    /// The mean over all pixels.
    pub(super) fn mean(&self) -> f64 {
        f64::from(nv_flip::FlipPool::from_image(&self.0).mean())
    }

    /// The map as 8-bit sRGB bytes: from black (0) over violet and orange to light yellow (1).
    pub(super) fn coloured(&self) -> Vec<u8> {
        self.0.apply_color_lut(&nv_flip::magma_lut()).to_vec()
    }
}
