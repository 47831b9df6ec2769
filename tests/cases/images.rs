//! Images of other renderers: Radiance HDR, OpenEXR, arrays, files by the number.

use super::{Case, Collection};

pub(super) const CASES: &[Case] = &[];

pub(super) const COLLECTIONS: &[Collection] = &[];
