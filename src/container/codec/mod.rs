//! From factors to bytes and back: functions on slices that know no file.

mod plain;

pub use plain::{CodecSettings, decode_layer, encode_layer};
