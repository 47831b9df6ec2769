//! Reading OpenEXR files: what their channels are, where their pixels lie, which colours their values mean.
//!
//! Format: *OpenEXR File Layout* and *Technical Introduction to OpenEXR* (openexr.com): layers, views, windows, chromaticities,
//! luminance and chroma.

mod channels;
mod chroma;
mod colours;
mod lines;
mod picture;
mod rewrite;
mod subsampled;
mod window;

use std::path::Path;

use exr::meta::MetaData;

pub(super) use channels::{Channel, ChannelPlace, Colours, ExrLayer, channels, layers};
pub(super) use colours::{converted_rows, matrices};
pub(super) use lines::{ExrLine, chunk_bytes, read_lines};
pub(super) use picture::ExrPicture;
pub(super) use rewrite::{check_lines, rewrite_lines};
pub(super) use window::{Window, common_frame, note_of_frame, windows_of};

use crate::error::{Error, Result};
use crate::files::open_input;

/// What the head of a file says.
///
/// # Errors
/// A file that cannot be opened or is no OpenEXR file.
pub(super) fn read_meta(path: &Path) -> Result<MetaData> {
    open_input(path, "open")?;
    MetaData::read_from_file(path, false).map_err(|e| failed(path, e))
}

/// An error of the decoder.
pub(super) fn failed(path: &Path, error: exr::error::Error) -> Error {
    match error {
        exr::error::Error::Io(io) => Error::io(path, "read")(io),
        other => super::rgba::refuse(path, &other.to_string()),
    }
}
