//! What was rendered, with what settings: the description that travels with a matrix through every file of ours.

use std::fmt;

use super::LightBasis;
use crate::encoding::{Decode, Encode};
use crate::matrix::{BlockSource, MatrixShape};

/// Identity of a job: SHA-256 over its encoded description and its scene's content. Two files with the same hash hold
/// blocks of the same matrix and can be merged.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct JobHash(pub [u8; 32]);

/// Provenance of a matrix.
#[derive(Clone, Debug, Default, PartialEq, Encode, Decode)]
pub struct Provenance {
    /// Scene name or source file name, without its folder.
    pub source: String,
    /// SHA-256 of everything that decides the entries and is not in this description: geometry, materials, textures.
    pub content: [u8; 32],
    /// Program and version that made the entries.
    pub program: String,
    /// Samples per pixel; 0 where unknown.
    pub samples_per_pixel: u32,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Settings as text, for people: camera, depth, clamping, in the scene file's words.
    pub settings: String,
    /// Metres per scene unit, 0 where unknown.
    pub metres_per_unit: f32,
}

/// The description of a matrix: shape, light basis, provenance.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// Shape and block grid.
    pub shape: MatrixShape,
    /// The light of each column.
    pub basis: LightBasis,
    /// Provenance of the entries.
    pub provenance: Provenance,
}

/// A matrix that knows what it is a matrix of.
pub trait DescribedSource: BlockSource {
    /// Its shape, its lights, and where it comes from.
    fn job(&self) -> &Job;
}

impl fmt::Display for JobHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0[..8].iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for JobHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "JobHash({self})")
    }
}
