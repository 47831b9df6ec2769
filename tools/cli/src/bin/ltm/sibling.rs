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

impl Arguments {
    /// Arguments to pass on.
    pub(crate) fn of(rest: impl IntoIterator<Item = OsString>) -> Self {
        Self { rest: rest.into_iter().collect() }
    }
}

/// The other programs of a release, each with what it is for.
pub(crate) const PROGRAMS: [(&str, &str); 3] =
    [("ltm-pack", "packing files"), ("ltm-unpack", "taking containers apart"), ("ltm-view", "ltm view")];

/// Whether a program of ours is there, beside this one or on the search path.
pub(crate) fn is_installed(program: &str) -> bool {
    let place = place_of(program);
    let found = |folder: PathBuf| folder.join(&place).is_file();
    place.is_absolute() || std::env::var_os("PATH").is_some_and(|path| std::env::split_paths(&path).any(found))
}

/// Where a program of ours lies: beside this one if it is there, else its bare name, for the search path.
pub(crate) fn place_of(program: &str) -> PathBuf {
    let name = format!("{program}{}", std::env::consts::EXE_SUFFIX);
    let beside = std::env::current_exe().ok().map(|path| path.with_file_name(name));
    beside.filter(|path| path.is_file()).unwrap_or_else(|| PathBuf::from(program))
}

/// What to do where a program of ours is missing.
pub(crate) fn how_to_install(program: &str) -> String {
    match program {
        "ltm-view" | "ltm-study" => format!("from source: cargo install --path tools/{}", &program["ltm-".len()..]),
        _ => "from source: cargo install --path tools/cli --features gpu,s3".into(),
    }
}

/// Runs `program` in place of this one, see [`place_of`].
pub(crate) fn run(program: &str, threads: Option<usize>, arguments: &Arguments) -> Result<()> {
    let found = place_of(program);
    let mut command = Command::new(&found);
    command.args(&arguments.rest);
    if let Some(threads) = threads {
        command.args(["--threads", &threads.to_string()]);
    }
    let failed = replace_this_program(command)?;
    match failed.kind() {
        std::io::ErrorKind::NotFound => {
            Err(Error::input(program, "this program is not installed", how_to_install(program)))
        }
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
