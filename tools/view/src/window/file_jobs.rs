//! Jobs that read and write files beside the worker, so that the window never waits for a disk.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::chooser::Purpose;
use crate::file_watch::FileChange;
use crate::mixer::Mix;
use crate::worker::{Brought, Session};
use ltm::error::Result;

/// The jobs that read and write files.
pub(super) struct FileJobs {
    /// Jobs that are not done yet.
    open: usize,
    count: JobCount,
    /// Purpose of the file to choose.
    pub(super) wanted: Option<Purpose>,
}

/// The file of a view, and names of files that are made of it.
pub(super) struct ViewFiles {
    /// Name for exported files, without ending.
    pub(super) export_base: PathBuf,
    /// What has become of the container's file since it was opened.
    pub(super) changed: Option<FileChange>,
    /// The file that was written for a command line.
    pub(super) command_look: Option<CommandLook>,
}

/// A look that a command line names.
pub(super) struct CommandLook {
    pub(super) path: PathBuf,
    /// What stands in it.
    pub(super) mix: Mix,
}

impl ViewFiles {
    pub(super) fn new(container: &Path) -> Self {
        Self { export_base: base_of(container), changed: None, command_look: None }
    }

    /// Names files after another container.
    pub(super) fn name_after(&mut self, container: &Path) {
        self.export_base = base_of(container);
    }

    /// Goes on with the names of files.
    pub(super) fn go_on(&mut self, old: Self) {
        (self.export_base, self.command_look) = (old.export_base, old.command_look);
    }
}

impl FileJobs {
    pub(super) fn new(count: JobCount) -> Self {
        Self { open: 0, count, wanted: None }
    }

    /// Does something that takes long beside the worker.
    pub(super) fn start(&mut self, session: &Session, job: impl FnOnce() -> Result<Brought> + Send + 'static) {
        self.open += 1;
        let running = self.count.begin();
        session.worker.beside(move || {
            let _running = running;
            job()
        });
    }

    /// Takes note that a job is done.
    pub(super) fn end(&mut self) {
        self.open -= 1;
    }

    /// Whether a job is not done yet.
    pub(super) fn any_open(&self) -> bool {
        self.open > 0
    }
}

/// How many jobs run, those of containers that were open before included.
#[derive(Clone, Default)]
pub(super) struct JobCount(Arc<AtomicUsize>);

/// A running job; it counts until it is dropped.
struct RunningJob(JobCount);

impl JobCount {
    pub(super) fn is_any(&self) -> bool {
        self.0.load(Ordering::Relaxed) > 0
    }

    fn begin(&self) -> RunningJob {
        self.0.fetch_add(1, Ordering::Relaxed);
        RunningJob(self.clone())
    }
}

impl Drop for RunningJob {
    fn drop(&mut self) {
        self.0.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// The name of a file without its folder.
pub(super) fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

pub(super) fn is_pdf(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("pdf"))
}

/// What is said of a file that was written.
pub(super) fn wrote(path: &Path) -> Brought {
    Brought::Message(format!("Wrote {}", path.display()))
}

/// What names of files begin with that are made of a container.
fn base_of(container: &Path) -> PathBuf {
    std::path::absolute(container).unwrap_or_else(|_| container.to_owned()).with_extension("")
}
