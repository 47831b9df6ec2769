//! The programs that are tested.

use std::path::Path;
use std::process::Command;

/// Where a program lies: `ltm`, `ltm-pack` or `ltm-unpack`.
pub(crate) fn path(program: &str) -> &'static str {
    match program {
        "ltm" => env!("CARGO_BIN_EXE_ltm"),
        "ltm-pack" => env!("CARGO_BIN_EXE_ltm-pack"),
        "ltm-unpack" => env!("CARGO_BIN_EXE_ltm-unpack"),
        _ => panic!("no program {program}"),
    }
}

/// A program, to be run in a folder.
pub(crate) fn command(folder: &Path, program: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new(path(program));
    command.current_dir(folder).args(arguments);
    command
}
