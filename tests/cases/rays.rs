//! No light is lost on the way: analytic irradiance wherever lamp and surface stand.

use super::Collection;

pub(super) const TESTS: &[(&str, fn())] = &[];

pub(super) const COLLECTIONS: &[Collection] = &[];
