//! Checking stored matrices and containers.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

use super::open::open_container;
use crate::container::ContainerReader;
use crate::error::{Error, Result};
use crate::matrix::FactorSource;
use crate::resources::{Held, MemoryNeed, ResourceEstimate, Threads};
use crate::resources::{PeakMemory, Progress, human_bytes};
use crate::store::{self, StoreReader};

/// Result of checking a matrix or a container. Displays as one line without the faults.
#[derive(Clone, Debug)]
pub struct Verified {
    /// Number of blocks checked.
    pub blocks: u32,
    /// The faults, each with its position; empty for a sound file.
    pub faults: Vec<String>,
    /// Blocks of a matrix that were never written.
    pub missing: usize,
    /// Bytes read: the good ones of a matrix, all of a container.
    pub verified_bytes: u64,
    /// Wall-clock seconds.
    pub seconds: f64,
    /// Peak resident anonymous memory, where the system tells.
    pub peak_memory_bytes: Option<u64>,
}

impl fmt::Display for Verified {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} blocks, {} read in {:.1} s, {}/s, peak memory {}",
            self.blocks,
            human_bytes(self.verified_bytes),
            self.seconds,
            human_bytes((self.verified_bytes as f64 / self.seconds.max(1e-9)) as u64),
            self.peak_memory_bytes.map_or("unknown".into(), human_bytes),
        )
    }
}

/// Checks every byte of a stored matrix on one thread, which is faster than the disk.
///
/// # Errors
/// Those of [`store::verify`]; [`Error::Resources`] where the memory is too small.
pub fn verify(path: &Path, memory_bytes: Option<u64>, watch: &dyn Progress) -> Result<Verified> {
    let begun = Instant::now();
    let memory = PeakMemory::start();
    let reader = StoreReader::open(path)?;
    let blocks = reader.job().shape.block_count();
    ResourceEstimate::of_one_thread(&[&reader]).admit("checking", path, &[], memory_bytes, watch)?;
    watch.begin("checking", u64::from(blocks), "blocks");
    let mut bytes = 0;
    let found = store::verify_storage(&reader, |_, read| {
        watch.advance(1, read - bytes, "B");
        bytes = read;
        !watch.interrupted()
    });
    watch.end();
    let found = found?;
    Ok(Verified {
        blocks: found.blocks,
        faults: found.damaged.into_iter().map(|damage| damage.problem).chain(found.stray).collect(),
        missing: found.missing.len(),
        verified_bytes: found.verified_bytes,
        seconds: begun.elapsed().as_secs_f64(),
        peak_memory_bytes: memory.stop(),
    })
}

/// Reads and decodes every byte of a container, with blocks in parallel on as many threads as the memory allows.
///
/// # Errors
/// Those of [`open_container`]; [`Error::Resources`] where the memory is too small; [`Error::Interrupted`].
pub fn verify_container(path: &Path, memory_bytes: Option<u64>, watch: &dyn Progress) -> Result<Verified> {
    let begun = Instant::now();
    let memory = PeakMemory::start();
    let reader = open_container(path)?;
    let need = ResourceEstimate::of(&[&reader]);
    let threads = Threads::new(need.admit("checking", path, &[], memory_bytes, watch)?)?;
    let blocks = reader.job().shape.blocks().filter(|&id| reader.has_block(id)).count();
    watch.begin("checking", blocks as u64, "blocks");
    let look = |bytes| {
        watch.advance(1, bytes, "B");
        !watch.interrupted()
    };
    let found = threads.run(|| reader.verify(look));
    watch.end();
    if watch.interrupted() {
        return Err(Error::interrupted(format!("{} blocks were checked", found.blocks)));
    }
    Ok(Verified {
        blocks: found.blocks,
        faults: found.faults.into_iter().map(|fault| fault.problem).collect(),
        missing: 0,
        verified_bytes: reader.file_bytes(),
        seconds: begun.elapsed().as_secs_f64(),
        peak_memory_bytes: memory.stop(),
    })
}

/// Checks the memory for joining `parts` against the memory given, or against what the system has available. The
/// description and the index of each part are held, and one block or chunk at a time.
///
/// # Errors
/// Those of opening the parts; [`Error::Resources`] where the memory is too small.
pub fn admit_merge(parts: &[PathBuf], memory_bytes: Option<u64>) -> Result<()> {
    let (mut held, mut largest) = (0, 0);
    for path in parts {
        let is_container = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("ltc"));
        if is_container {
            let reader = ContainerReader::open(path)?;
            let shape = reader.job().shape;
            let chunk = shape.blocks().map(|id| reader.encoded_bytes(id, 0..reader.layer_count(id))).max();
            // Each part's index, the records of the whole, and the index being written.
            held += 2 * reader.fixed_bytes() + u64::from(shape.block_count()) * 128;
            largest = largest.max(chunk.unwrap_or(0));
        } else {
            held += StoreReader::open(path)?.thread_bytes();
        }
        ResourceEstimate::of(&[&Held(held), &Held(largest)]).threads_within("joining", memory_bytes)?;
    }
    Ok(())
}
