//! Reading factors from a source that may be damaged in places.

use super::compact::CompactBlock;
use crate::error::{Error, Result};
use crate::matrix::{BlockId, CodedBlock, ColumnTransform, FactorSource};

/// The readable part of a block.
struct Readable {
    /// The factors of the layers that stand, none if not even the base layer does.
    block: Option<CodedBlock>,
    /// The error of the rest.
    damage: Option<Error>,
}

/// Reads all layers of a block or, where one is damaged, those before it.
///
/// # Errors
/// Everything that is not damage of this block.
fn read_what_stands(source: &dyn FactorSource, id: BlockId) -> Result<Readable> {
    let mut layers = source.layer_count(id);
    let mut damage = None;
    loop {
        match source.read_coded(id, layers) {
            Ok(block) => return Ok(Readable { block: Some(block), damage }),
            Err(error @ Error::Damaged { .. }) => {
                damage.get_or_insert(error);
                if layers <= 1 {
                    return Ok(Readable { block: None, damage });
                }
                layers -= 1;
            }
            Err(other) => return Err(other),
        }
    }
}

/// The readable part of a block in compact form, and a description of the damage.
///
/// # Errors
/// As [`read_what_stands`], and factors that do not fit the shape or are not finite.
pub(crate) fn read_compact(
    source: &dyn FactorSource,
    transform: &ColumnTransform,
    id: BlockId,
) -> Result<(Option<CompactBlock>, Option<String>)> {
    let readable = read_what_stands(source, id)?;
    let block = readable.block.map(|block| CompactBlock::new(source.shape(), id, block, transform)).transpose()?;
    Ok((block, readable.damage.map(|damage| damage.to_string())))
}

/// A whole block in compact form.
///
/// # Errors
/// Those of reading, damage among them, and factors that do not fit the shape or are not finite.
pub(crate) fn read_undamaged(
    source: &dyn FactorSource,
    transform: &ColumnTransform,
    id: BlockId,
) -> Result<CompactBlock> {
    let block = source.read_coded(id, source.layer_count(id))?;
    CompactBlock::new(source.shape(), id, block, transform)
}
