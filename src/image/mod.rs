//! Linear images: reading and writing EXR, HDR and PNG, tone mapping, error measures.
//!
//! # Example
//!
//! ```
//! use ltm::image::{LinearImage, read_image, write_exr};
//!
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("grey.exr");
//! let grey = LinearImage { width: 2, height: 1, pixels: vec![[0.5; 3]; 2] };
//! write_exr(&path, &grey)?;
//! assert_eq!(read_image(&path)?.pixels, grey.pixels);
//! # Ok::<(), ltm::Error>(())
//! ```

mod exr_file;
mod float_map;
mod kelvin;
mod linear;
mod measure;
mod npy;
mod open_exr;
mod per_light;
mod primaries;
mod radiance;
mod read;
mod rgba;
mod tone;
mod tone_tables;
mod value_map;

pub use exr_file::{
    FetchChannel, FetchRow, ImageSize, exr_rows_need_bytes, write_exr, write_exr_channels, write_exr_layers,
    write_exr_rows,
};
pub use kelvin::{KELVIN_RANGE, kelvin_to_linear};
pub use linear::{LinearImage, luminance};
pub(crate) use measure::percentile;
pub use measure::{ImageError, compare};
pub use npy::{npy_header, write_npy, write_npy_values};
pub use per_light::{FeaturePasses, GiveRow, LayerMatch, LayerPattern, LayerRole, LightRow, LightSet, TakeRow};
pub use read::{decode_srgb, embedded_facts, image_facts, read_embedded, read_image, read_rgba};
pub use rgba::{ImageFacts, RgbaImage};
pub use tone::{
    BLACK_BELOW, LUMENS_PER_WATT, ToneCurve, ToneMapping, encode_srgb, exposure_for, false_colour, false_colour_scale,
    write_png, write_rgb_png, write_toned_png,
};
pub use tone_tables::ToneTables;
pub use value_map::{ValueScale, write_value_map};
