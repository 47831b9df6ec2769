//! Peak resident memory of a stretch of work.

use std::convert::Infallible;
use std::fs::File;
use std::io::{Read, Seek};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender};
use std::thread::JoinHandle;
use std::time::Duration;

/// How often the resident memory is read. Blocks live for tens of milliseconds, so peaks are not missed by much.
const PERIOD: Duration = Duration::from_millis(5);

/// Measures the peak of the process's resident *anonymous* memory (what it allocated; not clean file-backed pages,
/// which the system takes back at will) from [`start`](Self::start) to [`stop`](Self::stop), by sampling.
///
/// Where it is dropped without being stopped, as by a job that fails, it ends as well.
pub struct PeakMemory {
    peak: Arc<AtomicU64>,
    /// Dropped to end the sampler.
    running: Option<Sender<Infallible>>,
    sampler: Option<JoinHandle<()>>,
}

impl PeakMemory {
    /// Begins to measure.
    pub fn start() -> Self {
        let peak = Arc::new(AtomicU64::new(anonymous_bytes().unwrap_or(0)));
        let (running, ended) = std::sync::mpsc::channel();
        let sampler = {
            let peak = Arc::clone(&peak);
            std::thread::spawn(move || {
                let status = Status::open();
                while ended.recv_timeout(PERIOD) == Err(RecvTimeoutError::Timeout) {
                    let now = status.as_ref().and_then(Status::anonymous_bytes);
                    peak.fetch_max(now.unwrap_or(0), Ordering::Relaxed);
                }
            })
        };
        Self { peak, running: Some(running), sampler: Some(sampler) }
    }

    /// The peak so far; none where the system does not tell.
    pub fn so_far(&self) -> Option<u64> {
        let peak = self.peak.fetch_max(anonymous_bytes().unwrap_or(0), Ordering::Relaxed);
        let peak = peak.max(self.peak.load(Ordering::Relaxed));
        (peak > 0).then_some(peak)
    }

    /// The peak in bytes; none where the system does not tell (other systems than Linux).
    pub fn stop(mut self) -> Option<u64> {
        self.end();
        let peak = self.peak.load(Ordering::Relaxed).max(anonymous_bytes().unwrap_or(0));
        (peak > 0).then_some(peak)
    }

    fn end(&mut self) {
        self.running = None;
        if let Some(sampler) = self.sampler.take() {
            // It cannot panic; if it did, there is a peak up to then.
            let _ = sampler.join();
        }
    }
}

impl Drop for PeakMemory {
    fn drop(&mut self) {
        self.end();
    }
}

/// Resident anonymous memory of this process now.
fn anonymous_bytes() -> Option<u64> {
    Status::open()?.anonymous_bytes()
}

/// `/proc/self/status`, kept open: to open it again takes longer than to read it.
struct Status(File);

impl Status {
    fn open() -> Option<Self> {
        File::open("/proc/self/status").ok().map(Self)
    }

    fn anonymous_bytes(&self) -> Option<u64> {
        let mut file = &self.0;
        let mut text = [0; 4096];
        file.rewind().ok()?;
        let length = file.read(&mut text).ok()?;
        let status = String::from_utf8_lossy(&text[..length]);
        let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:"))?;
        let kibibytes: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
        Some(kibibytes * 1024)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg_attr(not(target_os = "linux"), ignore = "only Linux tells")]
    fn an_allocation_shows_in_the_peak() {
        let measure = PeakMemory::start();
        let ballast = vec![1u8; 64 << 20];
        assert!(ballast.iter().step_by(4096).all(|&b| b == 1));
        // Other tests take memory and give it back beside this one: what was there all the time is what must show.
        let there = (0..40).map(|_| {
            std::thread::sleep(PERIOD / 10);
            anonymous_bytes().unwrap()
        });
        let least = there.min().unwrap();
        drop(ballast);
        assert!(least >= 60 << 20 && measure.stop().unwrap() >= least);
    }

    #[test]
    fn a_measurement_that_is_given_up_ends_its_thread() {
        let measure = PeakMemory::start();
        let held = Arc::downgrade(&measure.peak);
        drop(measure);
        assert!(held.upgrade().is_none(), "the sampler holds the peak as long as it runs");
    }
}
