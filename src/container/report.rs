//! How a container was made.

use crate::encoding::{Decode, Encode};

/// How a container was made, for people and programs; where each figure comes from.
#[derive(Clone, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub struct ContainerReport {
    /// Program and version that packed.
    pub program: String,
    /// Compression method, by name.
    pub method: String,
    /// What the rank and the steps were chosen for (a slope, a size, a PSNR), as text.
    pub target: String,
    /// The covariance of lightings that errors were weighed by, as text; empty for none.
    pub prior: String,
    /// All other settings, as text.
    pub settings: String,
    /// For each figure in the file, how it came about: (name, "measured against the stored matrix after quantisation").
    pub provenance: Vec<(String, String)>,
}
