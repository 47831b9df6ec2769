//! `ltm verify`.

use std::path::{Path, PathBuf};

use clap::Args;
use ltm::pipeline::{self, human_bytes, parse_bytes};
use ltm::{Error, Result};

use crate::console::Console;
use crate::input::{Kind, kind_of};

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
    let (faults, missing) = match kind_of(path)? {
        Kind::Container => {
            let verified = pipeline::verify_container(path, options.memory, console)?;
            let found = verified.found;
            println!(
                "{}: {} blocks, {} chunks, {} read in {:.1} s, {}/s, peak memory {}",
                path.display(),
                found.blocks,
                found.chunks,
                human_bytes(verified.file_bytes),
                verified.seconds,
                human_bytes((verified.file_bytes as f64 / verified.seconds) as u64),
                verified.peak_memory_bytes.map_or("unknown".into(), human_bytes),
            );
            let place = |block: Option<_>| block.map_or("header".to_owned(), |id| format!("{id}"));
            (found.faults.iter().map(|fault| format!("{}: {}", place(fault.block), fault.problem)).collect(), 0)
        }
        Kind::Matrix => matrix(path, options.memory, console)?,
    };
    faults.iter().for_each(|fault| println!("damaged: {fault}"));
    if missing > 0 {
        println!("{missing} blocks were never written");
    }
    if faults.is_empty() {
        println!("sound");
        return Ok(());
    }
    let hint = "the other blocks can be read; repair it with ltm repair, or make it again";
    Err(Error::damaged(path, format!("{} places are damaged", faults.len()), hint))
}

/// What is damaged, and how many blocks are missing.
fn matrix(path: &Path, memory_bytes: Option<u64>, console: &Console) -> Result<(Vec<String>, usize)> {
    let verified = pipeline::verify(path, memory_bytes, console)?;
    let found = verified.found;
    println!(
        "{}: {} blocks, {} read in {:.1} s, {}/s, peak memory {}",
        path.display(),
        found.blocks,
        human_bytes(found.verified_bytes),
        verified.seconds,
        human_bytes((found.verified_bytes as f64 / verified.seconds) as u64),
        verified.peak_memory_bytes.map_or("unknown".into(), human_bytes),
    );
    let damaged = found.damaged.iter().map(|damage| format!("{}: {}", damage.block, damage.problem));
    Ok((damaged.chain(found.stray).collect(), found.missing.len()))
}
