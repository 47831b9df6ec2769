//! How long something took, by the clock and in processors' seconds.

use std::time::Instant;

/// How long something took.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Took {
    pub(super) secs: f64,
    /// Of all threads together.
    pub(super) cpu_secs: f64,
}

impl Took {
    pub(super) fn least(self, other: Self) -> Self {
        Self { secs: self.secs.min(other.secs), cpu_secs: self.cpu_secs.min(other.cpu_secs) }
    }

    pub(super) fn over(self, times: usize) -> Self {
        Self { secs: self.secs / times as f64, cpu_secs: self.cpu_secs / times as f64 }
    }
}

impl std::ops::Add for Took {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { secs: self.secs + other.secs, cpu_secs: self.cpu_secs + other.cpu_secs }
    }
}

/// Both clocks.
pub(super) struct Clock {
    begun: Instant,
    cpu_secs: f64,
}

impl Clock {
    pub(super) fn start() -> Self {
        Self { begun: Instant::now(), cpu_secs: cpu_seconds() }
    }

    pub(super) fn stop(&self) -> Took {
        Took { secs: self.begun.elapsed().as_secs_f64(), cpu_secs: cpu_seconds() - self.cpu_secs }
    }
}

/// Processors' seconds of all threads of this process so far.
fn cpu_seconds() -> f64 {
    let told = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    told.tv_sec as f64 + 1e-9 * told.tv_nsec as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_processors_clock_counts_what_this_process_does() {
        let before = cpu_seconds();
        let begun = Instant::now();
        let mut sum = 0u64;
        while begun.elapsed().as_secs_f64() < 0.2 {
            sum = (0..100_000u64).fold(sum, |sum, i| sum.wrapping_mul(31) ^ i);
        }
        let took = cpu_seconds() - before;
        // Beside other tests' threads, and where others use the machine.
        assert!(sum != 1 && (!before.is_finite() || took > 0.01), "{took}");
    }
}
