//! A pilot: some windows of the picture, traced with few samples and with more.

use std::sync::Arc;
use std::time::Instant;

use super::StopRule;
use super::error_model::{ErrorModel, FEW_SAMPLES, MORE_SAMPLES, Seconds, first};
use crate::error::Result;
use crate::error_estimate::{Blocks, ProbedImages, WindowImages, error_squares, noise_squares, worst};
use crate::light::{Job, PROBES};
use crate::matrix::BlockId;
use crate::resources::{Progress, Threads};
use crate::scene::Scene;
use crate::trace::{TraceSettings, Tracer};

/// Part of the given time that the pilot may take.
const PILOT_SHARE: f64 = 0.2;
/// Part of the given time that tracing may take. The rest is for reading the scene, the pilot and the disk.
const TRACING_SHARE: f64 = 0.9;

/// Windows, and two independent sets of images of them.
pub(super) type References = (Vec<Vec<BlockId>>, [ProbedImages; 2]);

/// Traces windows of a scene.
pub(super) struct Pilot<'a> {
    pub(super) scene: &'a Arc<Scene>,
    pub(super) settings: TraceSettings,
    pub(super) job: &'a Job,
    pub(super) denoises: bool,
    pub(super) threads: &'a Threads,
    pub(super) watch: &'a dyn Progress,
}

/// Result of a pilot.
pub(super) struct PilotResult {
    law: ErrorModel,
    /// Whether the law is that of packed, denoised images.
    of_packed: bool,
    seconds: Seconds,
}

impl Pilot<'_> {
    /// Settings of one of its runs. Runs share no random numbers with each other or with the render.
    fn settings(&self, run: u64, samples_per_pixel: u32) -> TraceSettings {
        let seed = self.settings.seed ^ (run + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        TraceSettings { samples_per_pixel, seed, ..self.settings }
    }

    fn tracer(&self, settings: TraceSettings) -> Result<Tracer> {
        Tracer::new(Arc::clone(self.scene), self.job.shape, settings).map(Tracer::with_column_scales)
    }

    fn images(&self, tracer: &Tracer, windows: &[Vec<BlockId>], denoises: bool) -> Result<WindowImages> {
        let mut job = self.job.clone();
        job.basis.set_column_scales(tracer.column_scales().to_vec())?;
        let blocks = Blocks { source: tracer, job: &job, windows };
        blocks.images(denoises, self.threads, "a pilot", self.watch)
    }

    /// Independent samples of windows.
    pub(super) fn references(&self, windows: Vec<Vec<BlockId>>) -> Result<References> {
        let tracer = self.tracer(self.settings(1, MORE_SAMPLES))?;
        let first = self.images(&tracer, &windows, false)?.sampled;
        let tracer = tracer.with_settings(self.settings(2, MORE_SAMPLES))?;
        let second = self.images(&tracer, &windows, false)?.sampled;
        Ok((windows, [first, second]))
    }

    pub(super) fn run(
        &self,
        mut windows: Vec<Vec<BlockId>>,
        rule: StopRule,
        begun: Instant,
    ) -> Result<(PilotResult, Option<References>)> {
        let shape = self.job.shape;
        let pixels = |windows: &[Vec<BlockId>]| {
            windows.iter().flatten().map(|&id| shape.rect(id).pixels()).sum::<usize>() as f64
        };
        let share = f64::from(shape.width()) * f64::from(shape.height()) / pixels(&windows);
        let preparing = Instant::now();
        let tracer = self.tracer(self.settings(0, FEW_SAMPLES))?;
        let (preparing, photons) = (preparing.elapsed().as_secs_f64(), tracer.photon_cost());
        let tracing = Instant::now();
        // If only a time is given, denoising only measures its own duration.
        let denoises = self.denoises && (rule.error.is_some() || rule.packs);
        let mut few = self.images(&tracer, &windows, denoises)?;
        let tracing = tracing.elapsed().as_secs_f64() - few.denoising_seconds;
        let denoising = if rule.packs { few.denoising_seconds * share } else { 0.0 };
        let seconds = Seconds {
            fixed: preparing - photons.seconds + denoising,
            per_photon: photons.seconds / photons.sent.max(1) as f64,
            per_sample: tracing / f64::from(FEW_SAMPLES) * share,
        };
        if let Some(end) = rule.seconds {
            let left = PILOT_SHARE * end - begun.elapsed().as_secs_f64();
            let each = 2.0 * seconds.per_sample * f64::from(MORE_SAMPLES) / share / windows.len() as f64;
            let in_time = (left / each) as usize;
            windows.truncate(if rule.error.is_some() { in_time.max(1) } else { in_time });
        }
        // Without an error to reach, that of packed images is still measured if time allows.
        if windows.is_empty() || rule.error.is_none() && !denoises {
            let law = ErrorModel::of_noise(worst(&noise_squares(&few.sampled)), FEW_SAMPLES);
            return Ok((PilotResult { law, of_packed: false, seconds }, None));
        }
        let at_hand = windows.concat();
        few.shown.retain(|id, _| at_hand.contains(id));
        let tracer = tracer.with_settings(self.settings(1, MORE_SAMPLES))?;
        let first = self.images(&tracer, &windows, self.denoises)?;
        let tracer = tracer.with_settings(self.settings(2, MORE_SAMPLES))?;
        let second = self.images(&tracer, &windows, self.denoises)?;
        let mean = |a: [f64; PROBES], b: [f64; PROBES]| std::array::from_fn(|probe| 0.5 * (a[probe] + b[probe]));
        let noise = worst(&mean(noise_squares(&first.sampled), noise_squares(&second.sampled)));
        let law = match self.denoises {
            true => {
                let of_first = error_squares(&first.shown, [&second.sampled]);
                let of_second = error_squares(&second.shown, [&first.sampled]);
                let of_few = error_squares(&few.shown, [&first.sampled, &second.sampled]);
                ErrorModel::fitted(&of_few, &mean(of_first, of_second), noise)
            }
            false => ErrorModel::of_noise(noise, MORE_SAMPLES),
        };
        Ok((PilotResult { law, of_packed: self.denoises, seconds }, Some((windows, [first.sampled, second.sampled]))))
    }
}

impl PilotResult {
    /// The number of samples for a rule, and a note on it.
    pub(super) fn samples(&self, rule: StopRule, begun: Instant, pilot: &Pilot<'_>) -> u32 {
        let most = Tracer::MAX_SAMPLES_PER_PIXEL / 2;
        let takes = |samples: u32| {
            let settings = TraceSettings { samples_per_pixel: samples, ..pilot.settings };
            self.seconds.of(samples, Tracer::photons_sent(pilot.scene, pilot.job.shape, settings))
        };
        // Pairs of samples, so that the noise is known and both halves have the same number. Below the pilot's least
        // number the denoiser's error would be a guess.
        let least = if pilot.denoises { FEW_SAMPLES / 2 } else { 1 };
        let by_error = rule.error.map(|error| self.law.pairs(error, least..=most));
        let by_time = rule.seconds.map(|end| {
            let left = TRACING_SHARE * end - begun.elapsed().as_secs_f64();
            first(most, |pairs| takes(2 * pairs + 2) > left)
        });
        let pairs = by_error.into_iter().chain(by_time).fold(most, u32::min);
        let why = match (by_error, by_time) {
            (Some(by_error), Some(by_time)) if by_time < by_error => "the time ends it",
            (Some(by_error), _) if by_error == most => "there are no more",
            (Some(_), _) => "for the error",
            _ => "for the time",
        };
        let (samples, what) = (2 * pairs, if self.of_packed { PACKED } else { RAW });
        pilot.watch.note(&format!(
            "{samples} samples per pixel, {why}: expected error {:.2} % of white {what}, about {:.0} s",
            100.0 * self.law.error(f64::from(samples)),
            takes(samples),
        ));
        samples
    }
}

/// Descriptions of the images that an error refers to.
const PACKED: &str = "in exposed images of the packed, denoised matrix, the worst of 16 lightings";
const RAW: &str = "in exposed images of the matrix as it is, not denoised, the worst of 16 lightings";
