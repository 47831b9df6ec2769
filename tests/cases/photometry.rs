//! Photometric files: IES and EULUMDAT.

use super::{Case, Collection};

pub(super) const CASES: &[Case] = &[];

pub(super) const COLLECTIONS: &[Collection] = &[];
