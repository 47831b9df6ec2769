//! Rendering the damaged blocks of a stored matrix again.

use std::path::Path;

use super::{job_of, trace_into, tracer_of, tracing_need};
use crate::error::{Error, Hint, Result};
use crate::files::folder_of;
use crate::matrix::BlockId;
use crate::resources::{Held, MemoryNeed, Progress};
use crate::scene::LoadedScene;
use crate::store::{self, Mending, StoreReader};

/// Renders the damaged and missing blocks of a finished matrix again, in place. Returns their indices.
///
/// # Errors
/// The matrix was made from another scene or with other settings; its header cannot be read; errors of tracing and
/// writing; [`Error::Interrupted`]. After an interruption the remaining blocks are missing from the file, and the same
/// command continues.
pub fn repair(
    loaded: LoadedScene,
    path: &Path,
    memory_bytes: Option<u64>,
    watch: &dyn Progress,
) -> Result<Vec<BlockId>> {
    let job = job_of(&loaded)?;
    let reader = StoreReader::open(path)?;
    if reader.job().hash() != job.hash() {
        return Err(Error::input(
            path.display().to_string(),
            "was made from another scene or with other settings",
            Hint::SameRender,
        ));
    }
    let tracing = tracing_need(&loaded, &job);
    // One block more waits to be committed.
    let need = tracing.and(&[&Held(tracing.per_thread_bytes), &Held(reader.thread_bytes())]);
    drop(reader);
    let threads = need.admit("repairing", path, &[], memory_bytes, watch)?;
    watch.begin("checking", u64::from(job.shape.block_count()), "blocks");
    let mended = store::mend(path, |_, _| {
        watch.advance(1, 1, "blocks");
        !watch.interrupted()
    });
    watch.end();
    let Mending { writer, again: mut broken, mut job } = mended?;
    broken.sort();
    if broken.is_empty() {
        writer.finish()?;
        return Ok(broken);
    }
    let tracer = tracer_of(loaded, &mut job, Some(folder_of(path)), watch)?;
    trace_into(&writer, &tracer, &broken, threads, watch)?;
    writer.finish()?;
    Ok(broken)
}
