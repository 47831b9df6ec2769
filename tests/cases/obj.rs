//! OBJ and MTL of many exporters.

use super::{Case, Collection};

pub(super) const CASES: &[Case] = &[];

pub(super) const COLLECTIONS: &[Collection] = &[];
