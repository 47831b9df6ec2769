//! What kinds of scattering a surface has.

/// Flags of a surface's lobes, as in Pharr, Jakob and Humphreys, *Physically Based Rendering*, 4th edition, §9.1.2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lobes(u8);

impl Lobes {
    /// Absorbs everything.
    pub const NONE: Self = Self(0);
    /// Reflection without a direction of its own.
    pub const DIFFUSE_REFLECTION: Self = Self(1);
    /// Transmission without a direction of its own.
    pub const DIFFUSE_TRANSMISSION: Self = Self(2);
    /// Reflection about the mirror direction.
    pub const GLOSSY_REFLECTION: Self = Self(4);
    /// Transmission about the refracted direction.
    pub const GLOSSY_TRANSMISSION: Self = Self(8);
    /// Reflection in the mirror direction alone.
    pub const SPECULAR_REFLECTION: Self = Self(16);
    /// Transmission in the refracted direction alone.
    pub const SPECULAR_TRANSMISSION: Self = Self(32);
    /// Transmission straight on, also for shadow rays.
    pub const STRAIGHT: Self = Self(64);

    /// Both.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether any lobe is of one of these kinds.
    #[inline(always)]
    pub const fn has(self, any: Self) -> bool {
        self.0 & any.0 != 0
    }

    /// Whether light is scattered over a solid angle, so that light samples can contribute.
    #[inline(always)]
    pub const fn is_non_specular(self) -> bool {
        self.has(Self(15))
    }

    /// Whether light is scattered over solid angles on the far side.
    #[inline(always)]
    pub const fn is_two_sided(self) -> bool {
        self.has(Self::DIFFUSE_TRANSMISSION.and(Self::GLOSSY_TRANSMISSION))
    }

    /// Whether light is reflected mainly about the mirror direction, or only there.
    #[inline(always)]
    pub const fn has_direction(self) -> bool {
        !matches!(self, Self::NONE | Self::DIFFUSE_REFLECTION)
    }
}
