//! An image of linear Rec. 709 radiance.

/// `width × height` RGB pixels, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearImage {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Pixels, row by row.
    pub pixels: Vec<[f32; 3]>,
}

impl LinearImage {
    /// A black image.
    pub fn black(width: u32, height: u32) -> Self {
        Self { width, height, pixels: vec![[0.0; 3]; width as usize * height as usize] }
    }

    /// All channel values, pixel by pixel.
    pub fn values(&self) -> &[f32] {
        self.pixels.as_flattened()
    }

    /// Rec. 709 luminance of every pixel.
    pub fn luminances(&self) -> impl Iterator<Item = f32> + '_ {
        self.pixels.iter().copied().map(luminance)
    }
}

/// Rec. 709 luminance of a linear colour.
pub fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}
