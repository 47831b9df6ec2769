//! Names of outputs: none may be that of another kind of file, which the next command would take it for.

use std::path::Path;

use ltm::error::{Error, Result};

/// Refuses `output` with the extension `other`.
///
/// # Errors
/// It has that extension: `problem` says what is written, `hint` what to name it.
pub fn refuse_extension(output: &Path, other: &str, problem: &str, hint: &str) -> Result<()> {
    match output.extension() {
        Some(extension) if extension.eq_ignore_ascii_case(other) => {
            Err(Error::input(output.display().to_string(), problem, hint))
        }
        _ => Ok(()),
    }
}

/// Refuses the name of a matrix for a container.
///
/// # Errors
/// `output` ends in `.ltm`.
pub fn check_container(output: &Path) -> Result<()> {
    refuse_extension(output, "ltm", "a container is written, not a matrix", "name it x.ltc")
}
