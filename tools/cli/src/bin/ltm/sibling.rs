//! Commands that are programs of their own, `ltm-view` and `ltm-study`: what they are built with is not needed to render,
//! pack and relight.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::Command;

use clap::Args;
use ltm::{Error, Result};

#[derive(Args)]
pub(crate) struct Arguments {
    /// Arguments of that program; --help lists them.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    rest: Vec<OsString>,
}

/// Runs `program` in place of this one: the one beside this program if there is one, else the one on the search path.
pub(crate) fn run(program: &str, threads: Option<usize>, arguments: &Arguments) -> Result<()> {
    let beside = std::env::current_exe().ok().map(|path| path.with_file_name(program));
    let found = beside.filter(|path| path.is_file()).unwrap_or_else(|| PathBuf::from(program));
    let mut command = Command::new(&found);
    command.args(&arguments.rest);
    if let Some(threads) = threads {
        command.args(["--threads", &threads.to_string()]);
    }
    let failed = replace_this_program(command)?;
    match failed.kind() {
        std::io::ErrorKind::NotFound => Err(Error::input(
            program,
            "this program is not installed",
            format!(
                "build it with: cargo build --release -p {program} (or cargo install --path tools/{})",
                &program[4..]
            ),
        )),
        _ => Err(Error::io(found, "start")(failed)),
    }
}

#[cfg(unix)]
fn replace_this_program(mut command: Command) -> Result<std::io::Error> {
    use std::os::unix::process::CommandExt;
    Ok(command.exec())
}

#[cfg(not(unix))]
fn replace_this_program(mut command: Command) -> Result<std::io::Error> {
    match command.status() {
        Ok(status) => std::process::exit(status.code().unwrap_or(1)),
        Err(error) => Ok(error),
    }
}
