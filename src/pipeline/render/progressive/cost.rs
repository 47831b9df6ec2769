//! What stages will take, from what earlier ones took.

use super::stage::RenderStage;

/// Seconds of a sample and of a pixel, by the largest stage so far.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CostModel {
    /// Seconds of tracing for each sample of a pixel, on all threads.
    per_sample: f64,
    /// Seconds of the rest for each pixel: denoising and packing, with what every stage takes beside its pixels.
    per_pixel: f64,
    pixels: u64,
}

impl CostModel {
    /// Learns from a stage: the seconds of its tracing, and all of its seconds.
    pub(super) fn add(&mut self, stage: RenderStage, tracing_seconds: f64, seconds: f64) {
        if stage.pixels() < self.pixels || tracing_seconds <= 0.0 {
            return;
        }
        self.per_sample = tracing_seconds / stage.samples() as f64;
        self.per_pixel = (seconds - tracing_seconds).max(0.0) / stage.pixels() as f64;
        self.pixels = stage.pixels();
    }

    /// Whether a stage was learned from.
    pub(super) fn is_known(&self) -> bool {
        self.pixels > 0
    }

    /// Seconds that a stage is expected to take; 0 where nothing is known.
    pub(super) fn seconds(&self, stage: RenderStage) -> f64 {
        self.tracing_seconds(stage) + self.per_pixel * stage.pixels() as f64
    }

    /// Those of tracing alone, which no stage can do without.
    pub(super) fn tracing_seconds(&self, stage: RenderStage) -> f64 {
        self.per_sample * stage.samples() as f64
    }
}
