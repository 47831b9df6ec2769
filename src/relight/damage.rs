//! Reading factors from a source that may be damaged in places.

use crate::error::{Error, Result};
use crate::matrix::{BlockId, FactorSource, FactoredBlock};

/// What could be read of a block.
pub(crate) struct Readable {
    /// The factors of the layers that stand, none if not even the base layer does.
    pub block: Option<FactoredBlock>,
    /// What is wrong with the rest.
    pub damage: Option<Error>,
}

/// Reads all layers of a block or, where one is damaged, those before it.
///
/// Errors: everything that is not damage of this block.
pub(crate) fn read_what_stands(source: &dyn FactorSource, id: BlockId) -> Result<Readable> {
    let mut layers = source.layer_count(id);
    let mut damage = None;
    loop {
        match source.read_layers(id, 0..layers) {
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
