//! The threads that work is done on.

use std::mem;
use std::process;
use std::sync::{Arc, Mutex, PoisonError};

use ltm::{Error, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// The pool of this process, by its id: in a forked child the parent's pool has no threads.
static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// Runs `work` on the process's pool, which is as large as `RAYON_NUM_THREADS` or the machine says. Not to be called from
/// the pool itself, nor with the interpreter's lock held.
///
/// Errors: those of `work`; the threads cannot be started.
pub(crate) fn on_pool<T: Send>(work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    let pool = {
        let mut held = POOL.lock().unwrap_or_else(PoisonError::into_inner);
        match held.take() {
            Some((id, pool)) if id == process::id() => {
                *held = Some((id, pool.clone()));
                pool
            }
            other => {
                // Ending it would wait for threads that are not there.
                mem::forget(other);
                let made = ThreadPoolBuilder::new().thread_name(|i| format!("ltm {i}")).build();
                let made = made.map_err(|e| Error::input("threads", format!("cannot be started ({e})"), ""))?;
                let pool = Arc::new(made);
                *held = Some((process::id(), pool.clone()));
                pool
            }
        }
    };
    pool.install(work)
}
