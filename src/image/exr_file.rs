//! OpenEXR files.

use std::path::Path;

use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage};

use super::LinearImage;
use crate::error::{Error, Result};

/// Writes 32-bit linear RGB.
pub fn write_exr(path: &Path, image: &LinearImage) -> Result<()> {
    let width = image.width as usize;
    exr::prelude::write_rgb_file(path, width, image.height as usize, |x, y| {
        let [r, g, b] = image.pixels[y * width + x];
        (r, g, b)
    })
    .map_err(|e| Error::io(path, "write the image")(into_io(e)))
}

/// Writes one layer of 32-bit linear RGB for each named image: channels `NAME.R`, `NAME.G`, `NAME.B`, one part each, as
/// Blender and Nuke read them. Panics if there are no images; all must have the same size.
pub fn write_exr_layers(path: &Path, images: &[(&str, &LinearImage)]) -> Result<()> {
    let layers: Vec<Layer<AnyChannels<FlatSamples>>> = images
        .iter()
        .map(|(name, image)| {
            let channels = ["R", "G", "B"].iter().enumerate().map(|(c, channel)| {
                let values = image.pixels.iter().map(|pixel| pixel[c]).collect();
                AnyChannel::new(format!("{name}.{channel}").as_str(), FlatSamples::F32(values))
            });
            Layer::new(
                (image.width as usize, image.height as usize),
                LayerAttributes::named(*name),
                Encoding::SMALL_LOSSLESS,
                AnyChannels::sort(channels.collect()),
            )
        })
        .collect();
    let (width, height) = (images[0].1.width as usize, images[0].1.height as usize);
    let attributes = exr::prelude::ImageAttributes::with_size((width, height));
    Image::from_layers(attributes, layers)
        .write()
        .to_file(path)
        .map_err(|e| Error::io(path, "write the image")(into_io(e)))
}

fn into_io(error: exr::error::Error) -> std::io::Error {
    match error {
        exr::error::Error::Io(io) => io,
        other => std::io::Error::other(other.to_string()),
    }
}
