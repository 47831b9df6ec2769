//! Looking after stored matrices: rendering damaged blocks again.

use std::path::Path;

use super::Watch;
use super::render::{job_of, settings_of};
use crate::error::{Error, Result};
use crate::matrix::{BlockId, BlockSink, TracedBlock};
use crate::scene::LoadedScene;
use crate::store::{self, StoreOptions, StoreReader, StoreWriter};
use crate::trace::Tracer;

/// Renders the damaged and missing blocks of a finished matrix again, where it stands. Returns which ones.
///
/// Errors: the matrix was made from another scene or with other settings; its header cannot be read; what tracing and
/// writing refuse.
pub fn repair(loaded: LoadedScene, path: &Path, watch: &dyn Watch) -> Result<Vec<BlockId>> {
    let job = job_of(&loaded)?;
    let reader = StoreReader::open(path)?;
    if reader.job().hash() != job.hash() {
        return Err(Error::input(
            path.display().to_string(),
            "was made from another scene or with other settings",
            "give the scene file, --samples and --size that it was rendered with",
        ));
    }
    let max_probes = reader.layout().max_probes();
    let options = StoreOptions { precision: reader.precision(), max_probes, ..StoreOptions::default() };
    drop(reader);
    let found = store::verify(path, |_, _| {})?;
    let mut broken: Vec<BlockId> = found.damaged.iter().map(|damage| damage.block).chain(found.missing).collect();
    broken.sort();
    if broken.is_empty() {
        return Ok(broken);
    }
    let writer = StoreWriter::reopen(path, &job, options)?;
    let settings = settings_of(&loaded);
    let tracer = Tracer::new(loaded.scene, job.shape, settings)?;
    watch.begin("repairing", broken.len() as u64, "blocks");
    let mut block = TracedBlock::default();
    for &id in &broken {
        let stats = tracer.trace_block(id, &mut block);
        writer.discard(id)?;
        writer.write_block(id, &block)?;
        watch.advance(1, stats.rays, "rays");
    }
    watch.end();
    writer.finish()?;
    Ok(broken)
}
