//! Rivals that a Python runs: named by a variable of the environment, or else the `python3` on the path.

use std::ffi::OsString;
use std::path::Path;
use std::process::{Command, Stdio};

use ltm::error::{Error, Result};

/// A package, and the variable that names a Python which has it.
pub(super) struct Python {
    pub(super) package: &'static str,
    pub(super) variable: &'static str,
}

impl Python {
    fn program(&self) -> OsString {
        std::env::var_os(self.variable).unwrap_or_else(|| "python3".into())
    }

    /// Whether there is a Python with the package.
    pub(super) fn is_there(&self) -> bool {
        let mut command = Command::new(self.program());
        command.args(["-c", &format!("import {}", self.package)]).stdout(Stdio::null()).stderr(Stdio::null());
        command.status().is_ok_and(|status| status.success())
    }

    /// Runs a script on a folder; what it printed.
    ///
    /// Errors: no Python; a script that fails, with its last line.
    pub(super) fn run(&self, script: &str, folder: &Path, arguments: &[String]) -> Result<String> {
        let output = Command::new(self.program()).args(["-c", script]).arg(folder).args(arguments).output();
        let output = output.map_err(Error::io(folder, "start Python for"))?;
        if output.status.success() {
            return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
        }
        let text = String::from_utf8_lossy(&output.stderr);
        let last = text.lines().last().unwrap_or("no message");
        Err(Error::input(
            self.package,
            format!("failed ({last})"),
            format!("run its script on {} by hand", folder.display()),
        ))
    }
}
