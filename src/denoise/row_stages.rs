//! Filter stages that move down an image together, each some rows ahead of the next. Nothing is computed twice, and
//! only rows that a later stage still reads are held.

use std::ops::Range;

use super::image_rows::{ImageRows, Region};

/// The rows that one step denoises, within the region that is asked for.
#[derive(Clone, Debug)]
pub(super) struct Step<'a> {
    pub(super) region: &'a Region,
    pub(super) y: Range<usize>,
}

impl Step<'_> {
    /// The region that this step denoises.
    pub(super) fn part(&self) -> Region {
        Region { x: self.region.x.clone(), y: self.y.clone() }
    }
}

/// Which rows later stages need of one stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stage {
    /// Number of planes.
    pub(super) planes: usize,
    /// Radius, in pixels, around the denoised region within which the stage is computed.
    pub(super) reach: usize,
    /// Pixels beyond that radius that are held as well.
    pub(super) beyond: usize,
    /// The first row read in a step, relative to the step's first row.
    pub(super) kept: isize,
}

impl Stage {
    /// A stage that is computed within `reach` of the denoised region. `readers` has, for each stage that reads it,
    /// that stage's reach and the radius that it reads around its own pixels.
    pub(super) fn new(planes: usize, reach: usize, readers: &[(usize, usize)]) -> Self {
        let first = |&(reach, reads): &(usize, usize)| reach as isize - reads as isize;
        debug_assert!(readers.iter().all(|(of_reader, reads)| of_reader + reads <= reach), "{reach}");
        Self { planes, reach, beyond: 0, kept: readers.iter().map(first).min().unwrap_or(0) }
    }

    /// The same stage with the rows of patches around pixels, which its readers compare.
    pub(super) fn with_patches(self, patch: usize) -> Self {
        Self { beyond: patch, kept: self.kept - patch as isize, ..self }
    }

    /// Largest number of rows held, in steps of `step` rows that begin at the image's top.
    pub(super) fn rows(&self, step: usize) -> usize {
        step + self.reach + self.beyond + self.kept.min(0).unsigned_abs()
    }
}

/// How far down the image a stage is computed.
#[derive(Clone, Debug)]
pub(super) struct Track {
    stage: Stage,
    /// One past the last row computed.
    done: usize,
}

impl Track {
    /// The start of a stage for a region of an image, and the rows that it fills.
    pub(super) fn begin(stage: Stage, region: &Region, size: (usize, usize), step: usize) -> (Self, ImageRows) {
        let track = Self { stage, done: region.y.start.saturating_sub(stage.reach) };
        (track, ImageRows::none_yet(size, stage.planes, stage.rows(step)))
    }

    /// Makes room for the rows of the next step. Returns the region to fill.
    pub(super) fn advance(&mut self, rows: &mut ImageRows, step: &Step<'_>) -> Region {
        let Stage { reach, beyond, kept, .. } = self.stage;
        let columns = step.region.grown(reach, rows).x;
        let end = (step.y.end + reach).min(rows.height()).max(self.done);
        let first = if rows.held().is_empty() {
            self.done.saturating_sub(beyond)
        } else {
            step.y.start.saturating_add_signed(kept)
        };
        rows.hold(first..(end + beyond).min(rows.height()));
        let next = self.done..end;
        self.done = end;
        Region { x: columns, y: next }
    }
}
