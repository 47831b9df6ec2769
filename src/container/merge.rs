//! Joining containers of block ranges.

use std::cell::RefCell;
use std::path::Path;

use super::reader::ContainerReader;
use super::writer::{About, ContainerSummary, assemble};
use crate::error::{Error, Result};
use crate::files::check_output;
use crate::light::StatedErrors;
use crate::matrix::BlockId;

/// Joins containers of the same job into one at `target`; each block is copied unchanged from the first part that holds
/// it undamaged. The report is the first part's. The result may lack blocks and be merged again. `progress` gets (steps
/// done, steps), half of which are for checking blocks and half for writing them, and returns whether to continue.
///
/// # Errors
/// No parts; parts of different jobs or made with different settings; two parts that hold different bytes for the same
/// block; a block of which every part's copy is damaged; `target` exists and may not be replaced;
/// [`Error::Interrupted`].
///
/// # Panics
/// Never: only blocks that a part has are asked for.
pub fn merge(
    parts: &[&Path],
    target: &Path,
    overwrite: bool,
    mut progress: impl FnMut(u32, u32) -> bool,
) -> Result<ContainerSummary> {
    check_output(target, overwrite)?;
    let readers = parts.iter().map(|path| ContainerReader::open(path)).collect::<Result<Vec<_>>>()?;
    let Some(first) = readers.first() else {
        return Err(Error::input("merge", "no containers were given", "name at least one"));
    };
    for other in &readers[1..] {
        let place = other.path().display().to_string();
        if other.job().hash() != first.job().hash() {
            let problem =
                format!("is of job {}, but {} of {}", other.job().hash(), first.path().display(), first.job().hash());
            return Err(Error::input(place, problem, "only blocks of the same matrix can be merged"));
        }
        if other.report() != first.report() {
            let problem = format!("was packed with other settings than {}", first.path().display());
            return Err(Error::input(place, problem, "pack all parts with the same settings"));
        }
    }
    let shape = first.job().shape;
    let (blocks, stopped) = (shape.block_count(), || Error::interrupted("nothing was written"));
    let mut holders: Vec<Option<&ContainerReader>> = Vec::with_capacity(shape.block_count() as usize);
    for id in shape.blocks() {
        holders.push(holder(id, &readers)?);
        if !progress(id.0 + 1, 2 * blocks) {
            return Err(stopped());
        }
    }
    let records: Vec<_> = shape.blocks().map(|id| holders[id.index()].unwrap_or(first).record(id)).collect();
    let chunks: u64 = records.iter().map(|record| u64::from(record.layers)).sum();
    let written = RefCell::new((0, progress));
    let chunk = |id: BlockId, layer: usize| {
        let (done, progress) = &mut *written.borrow_mut();
        *done += 1;
        if !progress(blocks + (u64::from(blocks) * *done / chunks) as u32, 2 * blocks) {
            return Err(stopped());
        }
        holders[id.index()].expect("only present blocks are asked for").read_chunk(id, layer)
    };
    // Those of parts do not make those of the whole.
    let errors = if readers.len() == 1 { first.errors().clone() } else { StatedErrors::default() };
    let about = About { job: first.job(), report: first.report(), errors: &errors };
    assemble(target, overwrite, about, records, chunk)
}

/// The first part that holds a block undamaged; none where no part holds it.
fn holder(id: BlockId, readers: &[ContainerReader]) -> Result<Option<&ContainerReader>> {
    let having: Vec<_> = readers.iter().filter(|reader| reader.has_block(id)).collect();
    let Some(first) = having.first() else { return Ok(None) };
    for other in &having[1..] {
        if other.stored_form(id) != first.stored_form(id) {
            let problem = format!("{id} differs from that in {}", first.path().display());
            let hint = "one of them was made by another program; merge without it";
            return Err(Error::input(other.path().display().to_string(), problem, hint));
        }
    }
    let mut damage = None;
    for reader in having {
        let layers = usize::from(reader.record(id).layers);
        match (0..layers).try_for_each(|layer| reader.read_chunk(id, layer).map(drop)) {
            Ok(()) => return Ok(Some(reader)),
            Err(error @ Error::Damaged { .. }) => damage = Some(error),
            Err(error) => return Err(error),
        }
    }
    damage.map_or(Ok(None), Err)
}
