//! Joining containers of block ranges.

use std::path::Path;

use super::reader::ContainerReader;
use super::writer::{ContainerSummary, assemble};
use crate::error::{Error, Result};
use crate::matrix::BlockId;

/// Joins containers of the same job into one at `target`; each block is taken, byte for byte, from the first part that
/// holds it. The report is the first part's. The result may itself lack blocks and be merged again.
///
/// Errors: no parts; parts of different jobs or made with different settings; a damaged chunk; `target` exists and may
/// not be replaced.
pub fn merge(parts: &[&Path], target: &Path, overwrite: bool) -> Result<ContainerSummary> {
    if target.exists() && !overwrite {
        let hint = "choose another name, or say --force to replace it";
        return Err(Error::input(target.display().to_string(), "the file exists", hint));
    }
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
    let holder = |id: BlockId| readers.iter().find(|reader| reader.has_block(id));
    let records = first.job().shape.blocks().map(|id| holder(id).unwrap_or(first).record(id)).collect();
    let chunk =
        |id: BlockId, layer: usize| holder(id).expect("only present blocks are asked for").read_chunk(id, layer);
    // Those of parts do not make those of the whole.
    let light_errors = first.light_errors().filter(|_| readers.len() == 1);
    assemble(target, (first.job(), first.report(), light_errors), records, chunk)
}
