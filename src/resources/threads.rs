//! The threads that a job was admitted with.

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, Result};

/// A number of threads to run work on: a pool of their own, made once, or the current pool where that has as many.
pub(crate) struct Threads {
    count: usize,
    pool: Option<ThreadPool>,
}

impl Threads {
    /// # Errors
    /// The system does not start so many.
    pub(crate) fn new(count: usize) -> Result<Self> {
        if count == rayon::current_num_threads() {
            return Ok(Self { count, pool: None });
        }
        let pool = ThreadPoolBuilder::new().num_threads(count).build();
        let pool =
            pool.map_err(|e| Error::input("threads", format!("{count} cannot be started ({e})"), "ask for fewer"))?;
        Ok(Self { count, pool: Some(pool) })
    }

    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// Runs `work` on them.
    pub(crate) fn run<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        match &self.pool {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_runs_on_as_many_threads_as_were_asked_for() {
        let current = rayon::current_num_threads();
        for count in [1, current, current + 1] {
            let threads = Threads::new(count).unwrap();
            assert_eq!((threads.count(), threads.run(rayon::current_num_threads)), (count, count));
            assert_eq!(threads.pool.is_some(), count != current);
        }
    }

    #[test]
    fn a_pool_is_made_once_for_any_number_of_runs() {
        let threads = Threads::new(rayon::current_num_threads() + 1).unwrap();
        let ids = |_| threads.run(|| rayon::broadcast(|_| std::thread::current().id()));
        assert_eq!(ids(0), ids(1));
    }
}
