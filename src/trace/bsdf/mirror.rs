//! Perfect mirrors.

use glam::Vec3;

use super::{Lobes, Scattered};

/// Reflects the same share at every angle.
#[derive(Clone, Copy, Debug)]
pub struct Mirror {
    /// Reflectance.
    pub reflectance: Vec3,
}

impl Mirror {
    pub(super) const LOBES: Lobes = Lobes::SPECULAR_REFLECTION;

    #[inline(always)]
    pub(super) fn sample(&self, wo: Vec3) -> Scattered {
        Scattered { weight: self.reflectance, ..Scattered::mirrored(wo) }
    }
}
