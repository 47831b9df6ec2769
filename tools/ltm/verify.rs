//! `ltm verify`.

use std::path::PathBuf;

use clap::Args;
use ltm::pipeline::human_bytes;
use ltm::{Error, Result};

use crate::input::{Kind, kind_of};

#[derive(Args)]
pub(crate) struct Verify {
    /// The file.
    file: PathBuf,
}

pub(crate) fn run(options: &Verify) -> Result<()> {
    let path = &*options.file;
    let (faults, missing) = match kind_of(path)? {
        Kind::Container => {
            let found = ltm::container::verify(path)?;
            println!("{}: {} blocks, {} chunks read", path.display(), found.blocks, found.chunks);
            let place = |block: Option<_>| block.map_or("header".to_owned(), |id| format!("{id}"));
            (found.faults.iter().map(|fault| format!("{}: {}", place(fault.block), fault.problem)).collect(), 0)
        }
        Kind::Matrix => {
            let found = ltm::store::verify(path, |_, _| {})?;
            println!("{}: {} blocks, {} read", path.display(), found.blocks, human_bytes(found.verified_bytes));
            let damaged = found.damaged.iter().map(|damage| format!("{}: {}", damage.block, damage.problem));
            (damaged.chain(found.stray.iter().cloned()).collect::<Vec<_>>(), found.missing.len())
        }
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
