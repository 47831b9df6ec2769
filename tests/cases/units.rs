//! The unit of a scene decides nothing about which of its lamps are kept.

use super::Collection;

pub(super) const TESTS: &[(&str, fn())] = &[];

pub(super) const COLLECTIONS: &[Collection] = &[];
