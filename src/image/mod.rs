//! Linear images: reading and writing EXR, HDR and PNG, tone mapping, error measures.

mod exr_file;
mod kelvin;
mod light_files;
mod light_layers;
mod linear;
mod measure;
mod npy;
mod read;
mod tone;

pub use exr_file::{write_exr, write_exr_layers};
pub use kelvin::{KELVIN_RANGE, kelvin_to_linear};
pub use light_files::{read_light_array, read_light_files, read_pfm};
pub use light_layers::{LayerMatch, LayerRole, LightImage, LightImages, capture, read_light_layers};
pub use linear::{LinearImage, luminance};
pub use measure::{ImageError, compare};
pub use npy::write_npy;
pub use read::{RgbaImage, decode_srgb, image_size, read_image, read_rgba};
pub use tone::{ToneCurve, ToneMapping, encode_srgb, false_colour, false_colour_scale, write_png, write_toned_png};
