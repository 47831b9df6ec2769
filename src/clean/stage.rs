//! Stages of filtering that go down an image together, each some rows ahead of the next, so that nothing is computed twice and only the
//! rows that a later stage still reads are held.

use std::ops::Range;

use super::rows::{Region, Rows};

/// The rows of pixels that are cleaned at once, of the region that is wanted of an image.
#[derive(Clone, Debug)]
pub(super) struct Step<'a> {
    pub(super) region: &'a Region,
    pub(super) y: Range<usize>,
}

impl Step<'_> {
    /// What is cleaned in this step.
    pub(super) fn part(&self) -> Region {
        Region { x: self.region.x.clone(), y: self.y.clone() }
    }
}

/// What later stages ask of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stage {
    /// Planes that it has.
    pub(super) planes: usize,
    /// Pixels around those that are cleaned which it is computed for.
    pub(super) reach: usize,
    /// Pixels beyond those of which something is held as well.
    pub(super) beyond: usize,
    /// The first row that is read while a step is computed, from the first of the step.
    pub(super) kept: isize,
}

impl Stage {
    /// A stage that is computed `reach` around what is cleaned. Of each stage that reads it `readers` has the reach, and how far
    /// around its own pixels it reads.
    pub(super) fn new(planes: usize, reach: usize, readers: &[(usize, usize)]) -> Self {
        let first = |&(reach, reads): &(usize, usize)| reach as isize - reads as isize;
        debug_assert!(readers.iter().all(|(of_reader, reads)| of_reader + reads <= reach), "{reach}");
        Self { planes, reach, beyond: 0, kept: readers.iter().map(first).min().unwrap_or(0) }
    }

    /// The same, of which readers read patches around the pixels, whose rows are held too.
    pub(super) fn with_patches(self, patch: usize) -> Self {
        Self { beyond: patch, kept: self.kept - patch as isize, ..self }
    }

    /// Rows that are held at most, with steps of so many, where the first begins at the top of the image.
    pub(super) fn rows(&self, step: usize) -> usize {
        step + self.reach + self.beyond + self.kept.min(0).unsigned_abs()
    }
}

/// How far a stage has come.
#[derive(Clone, Debug)]
pub(super) struct Track {
    stage: Stage,
    /// The row after the last that is done.
    done: usize,
}

impl Track {
    /// That of a stage of a region of an image of this size, and the rows that it fills.
    pub(super) fn begin(stage: Stage, region: &Region, size: (usize, usize), step: usize) -> (Self, Rows) {
        let track = Self { stage, done: region.y.start.saturating_sub(stage.reach) };
        (track, Rows::none_yet(size, stage.planes, stage.rows(step)))
    }

    /// Makes room for what a step needs next, which is to be filled.
    pub(super) fn advance(&mut self, rows: &mut Rows, step: &Step<'_>) -> Region {
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
