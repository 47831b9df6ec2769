//! Peak resident memory of a stretch of work.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// How often the resident memory is read. Blocks live for tens of milliseconds, so peaks are not missed by much.
const PERIOD: Duration = Duration::from_millis(5);

/// Measures the peak of the process's resident *anonymous* memory (what it allocated; not clean file-backed pages,
/// which the system takes back at will) from [`start`](Self::start) to [`stop`](Self::stop), by sampling.
pub struct PeakMemory {
    peak: Arc<AtomicU64>,
    stop: Arc<AtomicBool>,
    sampler: JoinHandle<()>,
}

impl PeakMemory {
    /// Begins to measure.
    pub fn start() -> Self {
        let peak = Arc::new(AtomicU64::new(anonymous_bytes().unwrap_or(0)));
        let stop = Arc::new(AtomicBool::new(false));
        let sampler = {
            let (peak, stop) = (Arc::clone(&peak), Arc::clone(&stop));
            std::thread::spawn(move || {
                while !stop.load(Ordering::Relaxed) {
                    peak.fetch_max(anonymous_bytes().unwrap_or(0), Ordering::Relaxed);
                    std::thread::sleep(PERIOD);
                }
            })
        };
        Self { peak, stop, sampler }
    }

    /// The peak in bytes; none where the system does not tell (other systems than Linux).
    pub fn stop(self) -> Option<u64> {
        self.stop.store(true, Ordering::Relaxed);
        let _ = self.sampler.join();
        let peak = self.peak.load(Ordering::Relaxed).max(anonymous_bytes().unwrap_or(0));
        (peak > 0).then_some(peak)
    }
}

/// Resident anonymous memory of this process now, from `/proc/self/status`.
fn anonymous_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:"))?;
    let kibibytes: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kibibytes * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg_attr(not(target_os = "linux"), ignore = "only Linux tells")]
    fn an_allocation_shows_in_the_peak() {
        let measure = PeakMemory::start();
        let before = anonymous_bytes().unwrap();
        let ballast = vec![1u8; 64 << 20];
        assert!(ballast.iter().step_by(4096).all(|&b| b == 1));
        std::thread::sleep(PERIOD * 4);
        drop(ballast);
        assert!(measure.stop().unwrap() >= before + (60 << 20));
    }
}
