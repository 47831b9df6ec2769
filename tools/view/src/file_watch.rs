//! Whether the open file is still the one that was opened.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

use crate::system;

/// Interval at which the file is checked.
const PERIOD: Duration = Duration::from_millis(500);

/// Change of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileChange {
    /// Another stands under its name, or it was written to.
    Replaced,
    /// The file is gone.
    Gone,
    /// The file is as before.
    Same,
}

/// What tells one version of a file from another: device, number, bytes, time of writing.
type Version = Option<((u64, u64), u64, SystemTime)>;

fn version(path: &Path) -> Version {
    let at = std::fs::metadata(path).ok()?;
    Some((system::number(&at), at.len(), at.modified().ok()?))
}

/// Looks at a file from time to time, on a thread that ends with this.
#[derive(Debug)]
pub struct FileWatch {
    stop: Arc<(Mutex<bool>, Condvar)>,
    thread: Option<JoinHandle<()>>,
}

impl FileWatch {
    /// Begins with the file as it is now; `tell` is called when it has changed and, while somebody writes it, has come to rest.
    pub fn start(path: PathBuf, tell: impl Fn(FileChange) + Send + 'static) -> Self {
        let stop = Arc::new((Mutex::new(false), Condvar::new()));
        let first = version(&path);
        let thread = {
            let stop = stop.clone();
            std::thread::spawn(move || {
                let (mut told, mut last) = (first, first);
                while !waits(&stop) {
                    let now = version(&path);
                    if now == last && now != told {
                        told = now;
                        tell(match now {
                            None => FileChange::Gone,
                            _ if now == first => FileChange::Same,
                            Some(_) => FileChange::Replaced,
                        });
                    }
                    last = now;
                }
            })
        };
        Self { stop, thread: Some(thread) }
    }
}

/// Waits for the next look; whether it is to end instead.
fn waits(stop: &(Mutex<bool>, Condvar)) -> bool {
    let stopped = stop.0.lock().unwrap_or_else(PoisonError::into_inner);
    let waited = stop.1.wait_timeout_while(stopped, PERIOD, |stopped| !*stopped);
    *waited.unwrap_or_else(PoisonError::into_inner).0
}

impl Drop for FileWatch {
    fn drop(&mut self) {
        *self.stop.0.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.stop.1.notify_all();
        if let Some(thread) = self.thread.take() {
            // A panic there was reported by its own message.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    #[test]
    fn a_file_that_is_replaced_removed_and_put_back_is_told_once_each() {
        let folder = tempfile::tempdir().unwrap();
        let [path, aside] = ["a", "b"].map(|name| folder.path().join(name));
        std::fs::write(&path, "one").unwrap();
        let (told, tells) = channel();
        let _watch = FileWatch::start(path.clone(), move |change| told.send(change).unwrap());
        let next = || tells.recv_timeout(Duration::from_secs(20)).unwrap();
        std::fs::rename(&path, &aside).unwrap();
        assert_eq!(next(), FileChange::Gone);
        std::fs::write(&path, "two").unwrap();
        assert_eq!(next(), FileChange::Replaced);
        std::fs::rename(&aside, &path).unwrap();
        assert_eq!(next(), FileChange::Same);
        // Two more looks have nothing to tell.
        assert!(tells.recv_timeout(2 * PERIOD + PERIOD / 2).is_err());
    }
}
