//! From factors to bytes and back: functions on slices that know no file.

mod adaptive;
mod band_steps;
mod chunk;
mod classes;
mod component;
mod decode;
mod layer;
mod low_bits;
mod planes;
mod rans;
mod rotation;
mod settings;
mod side;
mod sparse;
mod step;

pub use band_steps::band_steps;
pub(crate) use decode::{claims, decode_coded_layer, stored_band_steps};
pub use decode::{correcting_components, decode_layer, shared_components};
pub use layer::{LayerPart, encode_layer, sparse_step};
pub use settings::CodecSettings;
