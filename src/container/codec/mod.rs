//! From factors to bytes and back: functions on slices that know no file.

mod adaptive;
mod classes;
mod layer;
mod planes;
mod rans;
mod rotation;
mod sparse;
mod step;
mod transform;

pub use layer::{
    CodecSettings, LayerPart, correcting_components, decode_layer, encode_layer, shared_components, sparse_step,
};
