//! `ltm completions`.

use std::io::Write;
use std::process::{Command, Stdio};

use clap::{Args, CommandFactory};
use clap_complete::Shell;
use ltm::{Error, Result};
use ltm_cli::documentation::{COMPLETIONS, write_completions};

use crate::{Arguments, sibling};

#[derive(Args)]
pub(crate) struct Completions {
    /// bash, zsh, fish, elvish or powershell.
    shell: Shell,
}

/// Prints the script of this program, then those of the other programs that are found, each by its own word.
pub(crate) fn run(options: &Completions) -> Result<()> {
    write_completions(Arguments::command(), "ltm", options.shell)?;
    for (program, _) in sibling::PROGRAMS {
        let mut command = Command::new(sibling::place_of(program));
        command.args([COMPLETIONS, &options.shell.to_string()]).stdin(Stdio::null()).stderr(Stdio::null());
        if let Ok(output) = command.output()
            && output.status.success()
        {
            let written = std::io::stdout().lock().write_all(&output.stdout);
            written.map_err(Error::io("standard output", "write the completions to"))?;
        }
    }
    Ok(())
}
