//! Long jobs: progress to a callback, and Ctrl-C.
//!
//! Signals are looked at, and the callback is called, on the thread that called, which alone may do so; the job runs on
//! others.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use ltm::Result;
use ltm::error::Warning;
use ltm::resources::Progress;
use pyo3::prelude::*;

use crate::errors::{exception, panic_exception};
use crate::threads::on_pool;
use crate::words::in_arguments;

/// How often signals and progress are looked at.
const PERIOD: Duration = Duration::from_millis(50);

#[derive(Default)]
struct Shared {
    stop: AtomicBool,
    said: Mutex<Said>,
    /// Told when the job is over.
    over: Condvar,
}

/// What the job has said and the caller has not heard yet.
#[derive(Default)]
struct Said {
    is_over: bool,
    stage: Option<Stage>,
    changed: bool,
    notes: Vec<String>,
}

#[derive(Clone)]
struct Stage {
    name: String,
    done: u64,
    total: u64,
}

impl Shared {
    fn said(&self) -> MutexGuard<'_, Said> {
        self.said.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Progress for Shared {
    fn begin(&self, stage: &str, total: u64, _: &str) {
        let mut said = self.said();
        said.stage = Some(Stage { name: stage.to_owned(), done: 0, total });
        said.changed = true;
    }

    fn advance(&self, steps: u64, _: u64, _: &str) {
        let mut said = self.said();
        if let Some(stage) = &mut said.stage {
            stage.done += steps;
        }
        said.changed = true;
    }

    fn end(&self) {}

    fn note(&self, line: &str) {
        self.said().notes.push(line.to_owned());
    }

    fn warn(&self, warning: &Warning) {
        self.note(&warning.worded(in_arguments));
    }

    fn interrupted(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Runs a long job without the interpreter's lock. `progress(stage, done, total)` hears of it some times a second, and notes
/// go to the logger `ltm`. A signal handler or a callback that raises stops the job as Ctrl-C stops the programs: what is
/// finished is kept.
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    job: impl FnOnce(&dyn Progress) -> Result<T> + Send,
) -> PyResult<T> {
    let shared = Shared::default();
    let mut raised = None;
    let done = std::thread::scope(|scope| {
        let worker = scope.spawn(|| {
            let done = catch_unwind(AssertUnwindSafe(|| on_pool(|| job(&shared))));
            shared.said().is_over = true;
            shared.over.notify_all();
            done
        });
        loop {
            let is_over = py.detach(|| {
                let said = shared.said();
                if said.is_over {
                    return true;
                }
                shared.over.wait_timeout(said, PERIOD).unwrap_or_else(PoisonError::into_inner).0.is_over
            });
            if raised.is_none() {
                raised = py.check_signals().and_then(|()| tell(py, &shared, progress)).err();
                shared.stop.store(raised.is_some(), Ordering::Relaxed);
            }
            if is_over {
                // The worker touches nothing of Python.
                break worker.join();
            }
        }
    });
    if let Some(raised) = raised {
        return Err(raised);
    }
    match done {
        Ok(Ok(Ok(value))) => Ok(value),
        Ok(Ok(Err(error))) => Err(exception(&error)),
        Ok(Err(panic)) | Err(panic) => Err(panic_exception(&*panic)),
    }
}

/// Tells what the job has said since the last time.
fn tell(py: Python<'_>, shared: &Shared, progress: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
    let (stage, notes) = {
        let mut said = shared.said();
        let changed = std::mem::take(&mut said.changed);
        (said.stage.clone().filter(|_| changed), std::mem::take(&mut said.notes))
    };
    if !notes.is_empty() {
        let logger = py.import("logging")?.call_method1("getLogger", ("ltm",))?;
        for line in notes {
            logger.call_method1("info", ("%s", line))?;
        }
    }
    if let (Some(stage), Some(progress)) = (stage, progress) {
        progress.call1((stage.name, stage.done, stage.total))?;
    }
    Ok(())
}
