//! The container that a pack writes, and what lies beside it.

use std::path::Path;

use crate::block_records::remove_leftovers;
use crate::container::ContainerReader;
use crate::error::Result;
use crate::files::check_output;

/// Refuses a container that exists, as [`check_output`] does. Removes temporary files of a pack that was killed after
/// its last step.
///
/// # Errors
/// Those of [`check_output`].
pub fn check_container_output(path: &Path, overwrite: bool) -> Result<()> {
    let checked = check_output(path, overwrite);
    if checked.is_err()
        && let Ok(container) = ContainerReader::open(path)
    {
        container.remove_leftover();
        remove_leftovers(path, container.job().shape.block_count());
    }
    checked
}
