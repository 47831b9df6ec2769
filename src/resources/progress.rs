//! What a long job tells the program that runs it, and how it hears that it should stop.

use crate::error::Warning;

/// Hears the progress of a job. All methods may be called from any thread.
pub trait Progress: Sync {
    /// A stage begins that has `total` steps, each a `unit` ("blocks").
    fn begin(&self, stage: &str, total: u64, unit: &str);

    /// `steps` more are done; `work` more of what the stage counts as its rate (rays, bytes), with its unit.
    fn advance(&self, steps: u64, work: u64, work_unit: &str);

    /// The stage is over.
    fn end(&self);

    /// One line for the user: a warning or a note.
    fn note(&self, line: &str);

    /// A warning for the user: who has words of their own for its hint notes it in those.
    fn warn(&self, warning: &Warning) {
        self.note(&warning.to_string());
    }

    /// Whether the user asked to stop: jobs finish the blocks at hand and return [`Error::Interrupted`](crate::Error::Interrupted).
    fn interrupted(&self) -> bool;
}

/// Hears nothing and never stops a job.
pub struct NoProgress;

impl Progress for NoProgress {
    fn begin(&self, _: &str, _: u64, _: &str) {}
    fn advance(&self, _: u64, _: u64, _: &str) {}
    fn end(&self) {}
    fn note(&self, _: &str) {}
    fn interrupted(&self) -> bool {
        false
    }
}

/// Hears nothing, and stops a job when the one that it has says so.
pub struct SilentProgress<'a>(pub &'a dyn Progress);

impl Progress for SilentProgress<'_> {
    fn begin(&self, _: &str, _: u64, _: &str) {}
    fn advance(&self, _: u64, _: u64, _: &str) {}
    fn end(&self) {}
    fn note(&self, _: &str) {}
    fn interrupted(&self) -> bool {
        self.0.interrupted()
    }
}

/// A stage of a job, as [`Progress`] shows it.
#[derive(Clone, Copy)]
pub(crate) struct JobStage<'a> {
    /// Name of the stage.
    pub(crate) name: &'a str,
    /// Unit in which its work is counted ("rays").
    pub(crate) work_unit: &'a str,
}
