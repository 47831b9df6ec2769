//! Which resolution and which number of samples comes after which.

use super::cost::CostModel;
use super::stage::RenderStage;

/// Most pixels of the longer side of the first estimate.
const FIRST_SIDE: u32 = 160;
/// Samples per pixel of the first estimates: the fewest whose noise the denoiser can tell from what is seen.
const FIRST_SAMPLES: u32 = 4;
/// The largest part of all samples that the first estimate may be, of which nothing is known yet.
const FIRST_PART: f64 = 0.05;

/// The stages of one view.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stages {
    last: RenderStage,
    /// The newest that is done.
    done: Option<RenderStage>,
    /// One that an earlier run has left and that was not given yet.
    found: Option<RenderStage>,
}

impl Stages {
    pub(super) fn new((width, height): (u32, u32), samples_per_pixel: u32) -> Self {
        Self { last: RenderStage { width, height, samples_per_pixel }, done: None, found: None }
    }

    /// The finished render.
    pub(super) fn last(&self) -> RenderStage {
        self.last
    }

    /// Says that a stage is done.
    pub(super) fn done(&mut self, stage: RenderStage) {
        self.done = Some(stage);
    }

    /// Says that a stage is there from an earlier run.
    pub(super) fn find(&mut self, stage: RenderStage) {
        (self.done, self.found) = (Some(stage), Some(stage));
    }

    /// Takes the stage that is there from an earlier run.
    pub(super) fn take_found(&mut self) -> Option<RenderStage> {
        self.found.take()
    }

    /// The first estimate; `None` where the finished render is hardly more.
    pub(super) fn first(&self) -> Option<RenderStage> {
        let side = self.last.width.max(self.last.height);
        let factor = (0..).map(|doubled| 1 << doubled).find(|factor| side.div_ceil(*factor) <= FIRST_SIDE)?;
        let first = self.at(factor, FIRST_SAMPLES.min(self.last.samples_per_pixel));
        (first.samples() as f64 <= FIRST_PART * self.last.samples() as f64).then_some(first)
    }

    /// The next stage, and whether it is the last. All early ones together stay within a part of the time of the last, of which `spent`
    /// seconds are used.
    pub(super) fn next(&self, costs: &CostModel, spent: f64, early_part: f64) -> (RenderStage, bool) {
        let last = (self.last, true);
        let Some(done) = self.done else { return self.first().map_or(last, |first| (first, false)) };
        let factor = self.factor_of(done);
        let finer = (factor > 1).then(|| self.at(factor / 2, done.samples_per_pixel));
        if !costs.is_known() {
            // After an earlier run: what would be the first estimate of a larger image.
            let is_small = |stage: &RenderStage| stage.samples() as f64 <= FIRST_PART * self.last.samples() as f64;
            return finer.filter(is_small).map_or(last, |finer| (finer, false));
        }
        let cleaner = self.at(factor, 2 * done.samples_per_pixel);
        let budget = early_part * costs.tracing_seconds(self.last) - spent;
        let is_early = |stage: &RenderStage| stage.samples() * 2 <= self.last.samples();
        let candidates = finer.into_iter().chain([cleaner]);
        let next = candidates.filter(is_early).find(|stage| costs.seconds(*stage) <= budget);
        next.map_or(last, |next| (next, false))
    }

    fn at(&self, factor: u32, samples_per_pixel: u32) -> RenderStage {
        let RenderStage { width, height, .. } = self.last;
        RenderStage { width: width.div_ceil(factor), height: height.div_ceil(factor), samples_per_pixel }
    }

    /// The power of two by which the last stage is wider and higher.
    fn factor_of(&self, stage: RenderStage) -> u32 {
        let of = |factor: &u32| self.at(*factor, 1).width <= stage.width && self.at(*factor, 1).height <= stage.height;
        (0..32).map(|doubled| 1 << doubled).find(of).unwrap_or(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All stages of a render whose sample takes 1 µs and whose pixel takes `pixel_secs` more.
    fn all(size: (u32, u32), samples: u32, pixel_secs: f64) -> Vec<RenderStage> {
        let (mut stages, mut costs, mut spent) = (Stages::new(size, samples), CostModel::default(), 0.0);
        let mut all = Vec::new();
        loop {
            let (stage, is_last) = stages.next(&costs, spent, 0.15);
            all.push(stage);
            if is_last {
                return all;
            }
            let tracing = 1e-6 * stage.samples() as f64;
            let seconds = tracing + pixel_secs * stage.pixels() as f64;
            costs.add(stage, tracing, seconds);
            spent += seconds;
            stages.done(stage);
        }
    }

    #[test]
    fn resolution_doubles_then_samples_and_all_of_it_is_a_small_part() {
        let of = |size, samples, pixel_secs| {
            let stages = all(size, samples, pixel_secs);
            stages.iter().map(|s| (s.width, s.samples_per_pixel)).collect::<Vec<_>>()
        };
        assert_eq!(of((1024, 768), 64, 0.0), [(128, 4), (256, 4), (512, 4), (1024, 4), (1024, 64)]);
        let many = of((1024, 768), 256, 4e-6);
        assert_eq!(many, [(128, 4), (256, 4), (512, 4), (1024, 4), (1024, 8), (1024, 256)]);
        // Where denoising takes as long as sixteen samples the full resolution does not fit beside the finished render.
        assert_eq!(of((640, 480), 64, 16e-6), [(160, 4), (320, 4), (640, 64)]);
        assert_eq!(of((64, 48), 16, 0.0), [(64, 16)]);
        for (size, samples) in [((1023, 769), 64), ((4000, 3), 1024), ((320, 240), 200), ((5000, 4000), 16)] {
            let stages = all(size, samples, 2e-6);
            let seconds = |s: &RenderStage| 1e-6 * s.samples() as f64 + 2e-6 * s.pixels() as f64;
            let (last, early) = stages.split_last().unwrap();
            let part = early.iter().map(seconds).sum::<f64>() / seconds(last);
            assert!(part <= 0.15, "{size:?}: {part}");
            assert_eq!((last.width, last.height, last.samples_per_pixel), (size.0, size.1, samples));
            assert!(early.windows(2).all(|pair| pair[0].samples() < pair[1].samples()));
        }
    }

    #[test]
    fn what_an_earlier_run_left_is_not_rendered_again() {
        let mut stages = Stages::new((640, 480), 64);
        let left = RenderStage { width: 320, height: 240, samples_per_pixel: 4 };
        stages.find(left);
        assert_eq!((stages.take_found(), stages.take_found()), (Some(left), None));
        // Nothing is known of the costs yet: the full resolution would be a sixteenth of all.
        assert_eq!(stages.next(&CostModel::default(), 0.0, 0.15), (stages.last(), true));
        stages.find(RenderStage { width: 160, height: 120, samples_per_pixel: 4 });
        assert_eq!(stages.next(&CostModel::default(), 0.0, 0.15), (left, false));
    }
}
