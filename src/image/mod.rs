//! Linear images: reading and writing EXR, HDR and PNG, tone mapping, error measures.

mod exr_file;
mod linear;
mod measure;
mod npy;
mod read;
mod tone;

pub use exr_file::{write_exr, write_exr_layers};
pub use linear::LinearImage;
pub use measure::{ImageError, compare};
pub use npy::write_npy;
pub use read::{RgbaImage, decode_srgb, image_size, read_image, read_rgba};
pub use tone::{encode_srgb, write_png};
