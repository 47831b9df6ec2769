//! What a step of denoising gives.

use std::ops::Range;

use super::errors::{BlockErrors, ErrorSums};
use super::image_rows::{ImageRows, Pool, Region};

/// The denoised rows of one step of [`Denoiser`](super::Denoiser).
#[derive(Clone, Debug, PartialEq)]
pub struct DenoisedRows {
    /// Three channels for each cluster, direct and indirect light added up.
    pub images: ImageRows,
    pub(super) errors: BlockErrors,
}

impl DenoisedRows {
    /// The range of rows that was denoised.
    pub fn rows(&self) -> Range<usize> {
        self.images.held()
    }

    /// Error estimates of the blocks that lie in a region of these rows, for each group of clusters.
    pub fn errors(&self, region: &Region) -> Vec<ErrorSums> {
        self.errors.of(region)
    }

    /// Returns the memory to the pool.
    pub fn keep_in(self, pool: &Pool) {
        pool.keep(self.images);
    }
}
