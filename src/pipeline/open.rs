//! Opens containers by path or by address.

use std::path::Path;

use crate::blob_store::{is_object, open_object};
use crate::container::ContainerReader;
use crate::error::{Error, Result};

/// Opens a container: a file, or an object of a store (`s3://BUCKET/NAME`), of which only what is wanted is fetched.
///
/// # Errors
/// Those of [`ContainerReader::open`] and of [`open_object`].
pub fn open_container(path: &Path) -> Result<ContainerReader> {
    match is_object(path) {
        true => ContainerReader::open_ranged(path, open_object(path)?),
        false => ContainerReader::open(path),
    }
}

/// Refuses the address of an object where a stored matrix is to be read, through a memory map.
///
/// # Errors
/// It is one.
pub fn check_matrix_path(path: &Path) -> Result<()> {
    let problem = "a stored matrix is read through a memory map, and not from an object store";
    match is_object(path) {
        true => Err(Error::input(path.display().to_string(), problem, "copy it to a disk, or pack it")),
        false => Ok(()),
    }
}
