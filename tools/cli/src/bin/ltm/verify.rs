//! `ltm verify`.

use std::path::PathBuf;

use clap::Args;
use ltm::pipeline;
use ltm::resources::parse_bytes;
use ltm::{Error, Result};

use crate::input::{Kind, kind_of};
use ltm_cli::console::{Console, peak_memory_bytes};
use ltm_cli::say;

#[derive(Args)]
pub(crate) struct Verify {
    /// The file.
    file: PathBuf,
    /// Memory to stay within, for example 1GiB [default: what the system has].
    #[arg(long, value_parser = parse_bytes)]
    memory: Option<u64>,
}

pub(crate) fn run(options: &Verify, console: &Console) -> Result<()> {
    let path = &*options.file;
    let kind = kind_of(path)?;
    let mut verified = match kind {
        Kind::Container => pipeline::verify_container(path, options.memory, console)?,
        Kind::Matrix => pipeline::verify(path, options.memory, console)?,
    };
    verified.peak_memory_bytes = peak_memory_bytes();
    say!("{}: {verified}", path.display());
    verified.faults.iter().for_each(|fault| say!("damaged: {fault}"));
    if verified.missing > 0 {
        say!("{} blocks were never written", verified.missing);
    }
    let places = match verified.faults.len() {
        0 => {
            say!("sound");
            return Ok(());
        }
        1 => "1 place is damaged".to_owned(),
        places => format!("{places} places are damaged"),
    };
    let hint = match kind {
        Kind::Container => "the other blocks can be read; pack it again",
        Kind::Matrix => "the other blocks can be read; repair it with ltm repair, or render it again",
    };
    Err(Error::damaged(path, places, hint))
}
