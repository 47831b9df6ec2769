//! Man pages and shell completions of the programs, made of the same definitions that read their arguments.
//!
//! Every program answers two requests that its help does not list: `--write-completions SHELL` prints a script, and
//! `--write-man-pages FOLDER` writes a page for the program and one for each of its commands.

use std::ffi::OsString;
use std::io::Write;
use std::path::Path;

use clap::{Command, CommandFactory, Parser, ValueEnum};
use clap_complete::{Generator, Shell};
use ltm::{Error, Result};

/// The request for a script of completions.
pub const COMPLETIONS: &str = "--write-completions";
/// The request for man pages.
pub const MAN_PAGES: &str = "--write-man-pages";

/// Begins the first argument by which `ltm` is another program: a release has one file for those that are of the same parts.
const AS: &str = "--as=";

/// The program that `ltm` is to be, by its first argument `--as=PROGRAM`, which its help does not list.
pub fn asked_program() -> Option<String> {
    std::env::args().nth(1)?.strip_prefix(AS).map(str::to_owned)
}

/// The arguments without that.
fn arguments() -> Vec<OsString> {
    let is_own = |argument: &OsString| !argument.to_string_lossy().starts_with(AS);
    let mut all = std::env::args_os().skip(1);
    all.next().filter(is_own).into_iter().chain(all).collect()
}

/// Commands that are programs of their own, whose pages those write.
const PROGRAMS_OF_THEIR_OWN: [&str; 2] = ["view", "study"];

/// The arguments of the program of this name; ends the process where they ask for help, are wrong, or are one of the two requests.
pub fn parse<P: Parser + CommandFactory>(program: &'static str) -> P {
    let arguments = arguments();
    let answered = match &*arguments {
        [request, shell] if request == COMPLETIONS => {
            Some(parsed_shell(shell).and_then(|shell| write_completions(P::command(), program, shell)))
        }
        [request, folder] if request == MAN_PAGES => Some(write_man_pages(P::command(), program, Path::new(folder))),
        _ => None,
    };
    match answered {
        None => P::parse_from(std::iter::once(program.into()).chain(arguments)),
        Some(Ok(())) => std::process::exit(0),
        Some(Err(error)) => {
            let code = i32::from(error.exit_code());
            crate::console::finish(program, Err(error));
            std::process::exit(code)
        }
    }
}

fn parsed_shell(name: &OsString) -> Result<Shell> {
    Shell::from_str(&name.to_string_lossy(), true)
        .map_err(|problem| Error::input(COMPLETIONS, problem, "give bash, zsh, fish, elvish or powershell"))
}

/// Prints a shell's script for a program.
///
/// # Errors
/// Standard output cannot be written.
pub fn write_completions(command: Command, program: &'static str, shell: Shell) -> Result<()> {
    let mut command = command.name(program).bin_name(program);
    command.build();
    let mut script = Vec::new();
    shell.generate(&command, &mut script);
    let written = std::io::stdout().lock().write_all(&script);
    written.map_err(Error::io("standard output", "write the completions to"))
}

/// Writes `PROGRAM.1`, and `PROGRAM-COMMAND.1` for each command.
///
/// # Errors
/// The folder cannot be made or written.
fn write_man_pages(command: Command, program: &'static str, folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(Error::io(folder, "create the folder"))?;
    let mut command = command.name(program).bin_name(program);
    command.build();
    write_page(&command, program, folder)?;
    for sub in command.get_subcommands() {
        if sub.is_hide_set() || sub.get_name() == "help" || PROGRAMS_OF_THEIR_OWN.contains(&sub.get_name()) {
            continue;
        }
        let name = format!("{program}-{}", sub.get_name());
        write_page(sub, &name, folder)?;
    }
    Ok(())
}

fn write_page(command: &Command, name: &str, folder: &Path) -> Result<()> {
    let path = folder.join(format!("{name}.1"));
    let version = concat!("ltm ", env!("CARGO_PKG_VERSION"));
    // Without a date, so that the same source has the same page.
    let page = clap_mangen::Man::new(command.clone()).title(name.to_uppercase()).source(version).manual("ltm");
    let mut text = Vec::new();
    page.render(&mut text).map_err(Error::io(&path, "write"))?;
    std::fs::write(&path, text).map_err(Error::io(&path, "write"))
}
