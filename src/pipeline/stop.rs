//! When a render is good enough: samples per pixel from an error or a time that people state.
//!
//! A pilot traces some windows of the picture, with few samples and, where an error is asked for, twice with more. Cleaned as
//! packing will clean them, and held against each other ([`exposed`](super::exposed)), they say how the error of packed images
//! falls with the samples; their seconds say what more samples take. The render itself is then one of so many samples, the same
//! bytes as with that number given, and goes on with it when it was stopped.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use super::clean::Cleaned;
use super::exposed::{
    Blocks, Images, Promise, WINDOW, WindowImages, error_squares, noise_squares, reading_need_bytes, spread_blocks,
    spread_windows, worst,
};
use super::pack::PackOptions;
use super::render::{job_of, settings_of, tracing_need};
use super::shard::hex;
use super::spill::{check_container_output, files_of_pack};
use crate::error::{Error, Result};
use crate::files::with_suffix;
use crate::host::{Need, PROGRAM_BYTES, Threads, Watch};
use crate::light::{Job, PROBES};
use crate::matrix::{BlockId, BlockSource};
use crate::scene::{LoadedScene, Scene};
use crate::store::{self, StoreReader, partial_path};
use crate::trace::{TraceSettings, Tracer};

/// Samples per pixel of the pilot: first few, then more.
const FEW_SAMPLES: u32 = 8;
const MORE_SAMPLES: u32 = 32;
/// Windows of the pilot that stand for the picture.
const WINDOWS: usize = 4;
/// Blocks by which the noise of a stored matrix is measured.
const BLOCKS: usize = 24;
/// Part of a stated time that the pilot may take.
const PILOT_SHARE: f64 = 0.2;
/// Part of a stated time that tracing may take: the rest is for reading the scene, the pilot and the disk.
const TRACING_SHARE: f64 = 0.9;
/// Slowest fall that is believed: of the squared error, as a power of the samples.
const LEAST_POWER: f64 = 0.25;

/// When to stop: the first of these that is reached.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StopRule {
    /// Expected error of exposed images, see [`ExposedError`](crate::light::ExposedError).
    pub error: Option<f64>,
    /// Wall-clock seconds for all.
    pub seconds: Option<f64>,
    /// Whether packing is part of it, or left for later.
    pub packs: bool,
}

/// Where a render goes, by its finished name.
#[derive(Clone, Copy, Debug)]
pub enum RenderTo<'a> {
    /// What is unfinished there of the same scene goes on with its own number of samples.
    GoOn(&'a Path),
    /// What is there is not looked at.
    Anew(&'a Path),
}

/// A scene with as many samples as a rule wants, and what it is held to where that is an error.
pub struct Chosen {
    /// The scene.
    pub loaded: LoadedScene,
    /// What will show whether the error was reached.
    pub promise: Option<Promise>,
}

/// How an error falls with the samples: its square as a power of them, and never slower than that of the samples themselves.
#[derive(Clone, Copy, Debug)]
struct Law {
    /// Squared error of the worst lighting at `samples`.
    square: f64,
    samples: f64,
    power: f64,
    /// Squared noise of the worst lighting for one sample per pixel.
    noise: f64,
}

/// Seconds that a render takes.
#[derive(Clone, Copy, Debug)]
struct Seconds {
    /// Of its tree, and of cleaning.
    fixed: f64,
    per_photon: f64,
    per_sample: f64,
}

impl Law {
    /// Of samples as they are.
    fn of_noise(noise: f64, samples: u32) -> Self {
        let samples = f64::from(samples);
        Self { square: noise, samples, power: 1.0, noise: noise * samples }
    }

    /// Of squared errors of the probe lightings at few and at more samples, and the noise of those. What is measured at more is
    /// not believed where it has fallen faster than noise can. The power is one for all lightings.
    fn fitted(few: &[f64; PROBES], more: &[f64; PROBES], noise: f64) -> Self {
        let (of_few, of_more) = (f64::from(FEW_SAMPLES), f64::from(MORE_SAMPLES));
        let least = of_few / of_more;
        let believed: [f64; PROBES] = std::array::from_fn(|probe| more[probe].max(few[probe] * least));
        let sum = |squares: &[f64; PROBES]| squares.iter().filter(|square| square.is_finite()).sum::<f64>();
        let power = (sum(few) / sum(&believed)).ln() / (of_more / of_few).ln();
        let power = if power.is_finite() { power.clamp(LEAST_POWER, 1.0) } else { 1.0 };
        Self { square: worst(&believed), samples: of_more, power, noise: noise * of_more }
    }

    /// Below the fewest samples that were measured as fast as noise falls: filters fail where there is too little to compare.
    fn error(&self, samples: f64) -> f64 {
        let least = f64::from(FEW_SAMPLES).min(self.samples);
        let few = self.square * (self.samples / samples.max(least)).powf(self.power);
        let cleaned = few * (least / samples).max(1.0);
        cleaned.min(self.noise / samples).max(0.0).sqrt()
    }

    /// Pairs of samples that bring the error down to this, between so many.
    fn pairs(&self, error: f64, between: RangeInclusive<u32>) -> u32 {
        first(*between.end(), |pairs| pairs >= *between.start() && self.error(2.0 * f64::from(pairs)) <= error)
    }
}

/// The first number from 1 on for which something holds that holds for all above, or `most`.
fn first(most: u32, holds: impl Fn(u32) -> bool) -> u32 {
    let (mut low, mut high) = (1, most.max(1));
    while low < high {
        let middle = low + (high - low) / 2;
        if holds(middle) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    high
}

impl Seconds {
    fn of(&self, samples: u32, photons: u64) -> f64 {
        self.fixed + self.per_photon * photons as f64 + self.per_sample * f64::from(samples)
    }
}

/// Sets the scene's samples per pixel so that the first of a rule's ends is reached, for a matrix that will be packed with these
/// options. A render that packs has the number written down until it is finished.
///
/// # Errors
/// A rule without an end, or with one that is not above 0; what tracing refuses; [`Error::Interrupted`].
pub fn choose_samples(
    mut loaded: LoadedScene,
    to: RenderTo<'_>,
    rule: StopRule,
    pack: &PackOptions,
    watch: &dyn Watch,
) -> Result<Chosen> {
    let begun = Instant::now();
    for (name, end) in [("--error", rule.error), ("--time", rule.seconds)] {
        if end.is_some_and(|end| !(end > 0.0 && end.is_finite())) {
            return Err(Error::input(name, "is not above 0", "give for example --error 2% or --time 60s"));
        }
    }
    let (path, known) = match to {
        RenderTo::GoOn(path) => {
            // Before a pilot that would be for nothing.
            match rule.packs {
                true => check_container_output(path, false)?,
                false => store::check_output(path, false)?,
            }
            (path, samples_of_unfinished(&mut loaded, path)?)
        }
        RenderTo::Anew(path) => (path, None),
    };
    if let Some(samples) = known {
        watch.note(&format!("{}: goes on with {samples} samples per pixel", path.display()));
    }
    let cleans = pack.for_source(true).denoise && pack.basis.is_none();
    if known.is_some() && rule.error.is_none() && !(rule.packs && cleans) {
        return Ok(Chosen { loaded, promise: None });
    }
    let job = job_of(&loaded)?;
    let windows = spread_windows(job.shape, WINDOWS);
    let mut need = tracing_need(&loaded, &job);
    need.fixed_bytes += Blocks::images_need_bytes(job.shape, windows.concat().len());
    if cleans {
        let cleaning = Cleaned::need_of_windows(&job, need.per_thread_bytes, WINDOW);
        need = Need { fixed_bytes: need.fixed_bytes + cleaning.fixed_bytes, ..cleaning };
    }
    let threads = Threads::new(need.threads_within("a pilot", pack.memory_bytes)?)?;
    let settings = settings_of(&loaded);
    let scene = Arc::new(loaded.scene);
    let pilot = Pilot { scene: &scene, settings, job: &job, cleans, threads: &threads, watch };
    let found = match known {
        Some(_) => pilot.references(windows).map(|references| (None, Some(references))),
        None => pilot.run(windows, rule, begun).map(|(found, references)| (Some(found), references)),
    };
    let chosen = found.map(|(found, references)| {
        let samples = found.map(|found| found.samples(rule, begun, &pilot));
        (samples, references)
    });
    loaded.scene = Arc::try_unwrap(scene).unwrap_or_else(|shared| (*shared).clone());
    let (samples, references) = chosen.map_err(|error| match error {
        Error::Interrupted(_) => Error::Interrupted("nothing was begun".to_owned()),
        other => other,
    })?;
    if let Some(samples) = samples {
        loaded.settings.samples_per_pixel = samples;
        if rule.packs {
            note_samples(&loaded, path)?;
        }
    }
    let promise = references.map(|(windows, references)| Promise {
        asked: rule.error,
        cleans,
        windows,
        references,
        packed: Mutex::default(),
    });
    Ok(Chosen { loaded, promise })
}

/// Windows with independent samples of them.
type References = (Vec<Vec<BlockId>>, [Images; 2]);

/// What traces some windows of a scene.
struct Pilot<'a> {
    scene: &'a Arc<Scene>,
    settings: TraceSettings,
    job: &'a Job,
    cleans: bool,
    threads: &'a Threads,
    watch: &'a dyn Watch,
}

/// What a pilot found.
struct Found {
    law: Law,
    /// Whether that is of packed, cleaned images.
    of_packed: bool,
    seconds: Seconds,
}

impl Pilot<'_> {
    /// Settings of one of its runs, which share no random numbers with each other or with the render.
    fn settings(&self, run: u64, samples_per_pixel: u32) -> TraceSettings {
        let seed = self.settings.seed ^ (run + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        TraceSettings { samples_per_pixel, seed, ..self.settings }
    }

    fn tracer(&self, settings: TraceSettings) -> Result<Tracer> {
        Tracer::new(Arc::clone(self.scene), self.job.shape, settings).map(Tracer::with_column_scales)
    }

    fn images(&self, tracer: &Tracer, windows: &[Vec<BlockId>], cleans: bool) -> Result<WindowImages> {
        let mut job = self.job.clone();
        job.basis.set_column_scales(tracer.column_scales().to_vec())?;
        let blocks = Blocks { source: tracer, job: &job, windows };
        blocks.images(cleans, self.threads, "a pilot", self.watch)
    }

    /// Independent samples of windows and nothing more.
    fn references(&self, windows: Vec<Vec<BlockId>>) -> Result<References> {
        let tracer = self.tracer(self.settings(1, MORE_SAMPLES))?;
        let first = self.images(&tracer, &windows, false)?.sampled;
        let tracer = tracer.with_settings(self.settings(2, MORE_SAMPLES))?;
        let second = self.images(&tracer, &windows, false)?.sampled;
        Ok((windows, [first, second]))
    }

    fn run(
        &self,
        mut windows: Vec<Vec<BlockId>>,
        rule: StopRule,
        begun: Instant,
    ) -> Result<(Found, Option<References>)> {
        let shape = self.job.shape;
        let pixels = |windows: &[Vec<BlockId>]| {
            windows.iter().flatten().map(|&id| shape.rect(id).pixels()).sum::<usize>() as f64
        };
        let share = f64::from(shape.width()) * f64::from(shape.height()) / pixels(&windows);
        let preparing = Instant::now();
        let tracer = self.tracer(self.settings(0, FEW_SAMPLES))?;
        let (preparing, photons) = (preparing.elapsed().as_secs_f64(), tracer.photon_cost());
        let tracing = Instant::now();
        // With only a time to keep, cleaning tells no more than how long it takes.
        let cleans = self.cleans && (rule.error.is_some() || rule.packs);
        let mut few = self.images(&tracer, &windows, cleans)?;
        let tracing = tracing.elapsed().as_secs_f64() - few.cleaning_seconds;
        let cleaning = if rule.packs { few.cleaning_seconds * share } else { 0.0 };
        let seconds = Seconds {
            fixed: preparing - photons.seconds + cleaning,
            per_photon: photons.seconds / photons.sent.max(1) as f64,
            per_sample: tracing / f64::from(FEW_SAMPLES) * share,
        };
        if let Some(end) = rule.seconds {
            let left = PILOT_SHARE * end - begun.elapsed().as_secs_f64();
            let each = 2.0 * seconds.per_sample * f64::from(MORE_SAMPLES) / share / windows.len() as f64;
            let in_time = (left / each) as usize;
            windows.truncate(if rule.error.is_some() { in_time.max(1) } else { in_time });
        }
        // Where no error was asked for, that of packed images is nice to know where there is time for it.
        if windows.is_empty() || rule.error.is_none() && !cleans {
            let law = Law::of_noise(worst(&noise_squares(&few.sampled)), FEW_SAMPLES);
            return Ok((Found { law, of_packed: false, seconds }, None));
        }
        let at_hand = windows.concat();
        few.shown.retain(|id, _| at_hand.contains(id));
        let tracer = tracer.with_settings(self.settings(1, MORE_SAMPLES))?;
        let first = self.images(&tracer, &windows, self.cleans)?;
        let tracer = tracer.with_settings(self.settings(2, MORE_SAMPLES))?;
        let second = self.images(&tracer, &windows, self.cleans)?;
        let mean = |a: [f64; PROBES], b: [f64; PROBES]| std::array::from_fn(|probe| 0.5 * (a[probe] + b[probe]));
        let noise = worst(&mean(noise_squares(&first.sampled), noise_squares(&second.sampled)));
        let law = match self.cleans {
            true => {
                let of_first = error_squares(&first.shown, [&second.sampled]);
                let of_second = error_squares(&second.shown, [&first.sampled]);
                let of_few = error_squares(&few.shown, [&first.sampled, &second.sampled]);
                Law::fitted(&of_few, &mean(of_first, of_second), noise)
            }
            false => Law::of_noise(noise, MORE_SAMPLES),
        };
        Ok((Found { law, of_packed: self.cleans, seconds }, Some((windows, [first.sampled, second.sampled]))))
    }
}

impl Found {
    /// The samples that a rule wants, and a note on them.
    fn samples(&self, rule: StopRule, begun: Instant, pilot: &Pilot<'_>) -> u32 {
        let most = Tracer::MAX_SAMPLES_PER_PIXEL / 2;
        let takes = |samples: u32| {
            let settings = TraceSettings { samples_per_pixel: samples, ..pilot.settings };
            self.seconds.of(samples, Tracer::photons_sent(pilot.scene, pilot.job.shape, settings))
        };
        // Pairs of samples, so that the noise is known and there are as many in each half.
        // With fewer than were tried, what cleaning makes of them is a guess.
        let least = if pilot.cleans { FEW_SAMPLES / 2 } else { 1 };
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

/// Of which images an error is.
const PACKED: &str = "in exposed images of the packed, cleaned matrix, the worst of 16 lightings";
const RAW: &str = "in exposed images of the matrix as it is, not cleaned, the worst of 16 lightings";

/// What measuring the noise of a stored matrix is called.
const MEASURING: &str = "measuring the noise";

/// Where a render that packs keeps its number of samples until it is finished.
fn samples_path(path: &Path) -> PathBuf {
    with_suffix(path, ".samples")
}

/// Writes down the samples of a render that packs.
fn note_samples(loaded: &LoadedScene, path: &Path) -> Result<()> {
    let text = format!("{} {}", loaded.settings.samples_per_pixel, hex(&job_of(loaded)?.hash().0));
    let path = samples_path(path);
    std::fs::write(&path, text).map_err(Error::io(&path, "write"))
}

/// Forgets them when the render is finished.
pub(super) fn forget_samples(path: &Path) {
    // There is none where the number was given.
    let _ = std::fs::remove_file(samples_path(path));
}

/// Gives the scene the samples of the unfinished render to `path`, if there is one of this scene.
fn samples_of_unfinished(loaded: &mut LoadedScene, path: &Path) -> Result<Option<u32>> {
    let before = loaded.settings.samples_per_pixel;
    // A pack that was refused after its pilot has begun nothing.
    let is_begun = files_of_pack(path).iter().any(|file| file.exists());
    let noted = is_begun.then(|| std::fs::read_to_string(samples_path(path)).ok()).flatten();
    let noted = noted.as_deref().and_then(|text| text.split_once(' ')).and_then(|(samples, hash)| {
        Some((samples.parse().ok().filter(|s| (1..=Tracer::MAX_SAMPLES_PER_PIXEL).contains(s))?, hash.to_owned()))
    });
    let stored = || {
        let unfinished = StoreReader::open(&partial_path(path)).ok()?;
        let job = unfinished.job();
        Some((job.provenance.samples_per_pixel, hex(&job.hash().0)))
    };
    if let Some((samples, hash)) = noted.or_else(stored) {
        loaded.settings.samples_per_pixel = samples;
        if hex(&job_of(loaded)?.hash().0) == hash {
            return Ok(Some(samples));
        }
        loaded.settings.samples_per_pixel = before;
    }
    Ok(None)
}

/// The error of exposed images of a stored matrix as it is, from its own noise, as a fraction of white: see
/// [`ExposedError`](crate::light::ExposedError). From some blocks that stand for all; none where the matrix does not know its
/// noise.
///
/// # Errors
/// Those of reading; the memory is too small; [`Error::Interrupted`].
pub fn expected_error(matrix: &StoreReader, memory_bytes: Option<u64>, watch: &dyn Watch) -> Result<Option<f64>> {
    let shape = BlockSource::shape(matrix);
    let committed = shape.blocks().filter(|&id| matrix.is_committed(id)).collect();
    let blocks = [spread_blocks(shape, committed, BLOCKS)];
    let need = Need {
        fixed_bytes: PROGRAM_BYTES + Blocks::images_need_bytes(shape, blocks[0].len()),
        per_thread_bytes: reading_need_bytes(matrix),
        ..Need::default()
    };
    let threads = Threads::new(need.threads_within(MEASURING, memory_bytes)?)?;
    let blocks = Blocks { source: matrix, job: matrix.job(), windows: &blocks };
    let images = blocks.images(false, &threads, MEASURING, watch)?;
    Ok(Some(worst(&noise_squares(&images.sampled)).sqrt()).filter(|error| error.is_finite()))
}

/// Reads an error such as `2%` or `0.02`.
///
/// # Errors
/// As text: not a number.
pub fn parse_error(text: &str) -> Result<f64, String> {
    let (number, scale) = text.strip_suffix('%').map_or((text, 1.0), |number| (number, 0.01));
    let value: f64 = number.trim().parse().map_err(|_| format!("'{text}' is not an error; write 2% or 0.02"))?;
    Ok(value * scale)
}

/// Reads a time such as `60s`, `5min`, `2h` or plain seconds.
///
/// # Errors
/// As text: not a time.
pub fn parse_seconds(text: &str) -> Result<f64, String> {
    let split = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let scale = match unit.trim() {
        "" | "s" => 1.0,
        "m" | "min" => 60.0,
        "h" => 3600.0,
        _ => return Err(format!("'{unit}' is not a unit of time; write s, min or h")),
    };
    let value: f64 = number.parse().map_err(|_| format!("'{text}' is not a time; write 60s or 5min"))?;
    Ok(value * scale)
}

#[cfg(test)]
mod tests {
    use super::super::exposed::ProbedBlock;
    use super::*;
    use crate::host::Quiet;
    use crate::matrix::TracedBlock;
    use crate::scene::BuiltIn;

    fn scene() -> LoadedScene {
        let mut loaded = BuiltIn { width: 96, height: 64, texels: 2 }.named("diffuse").unwrap();
        loaded.settings.block_side = 32;
        loaded
    }

    #[test]
    fn errors_and_times_are_read_with_their_units() {
        assert_eq!((parse_error("2%"), parse_error("0.02")), (Ok(0.02), Ok(0.02)));
        assert_eq!((parse_seconds("60s"), parse_seconds("1.5min"), parse_seconds("7")), (Ok(60.0), Ok(90.0), Ok(7.0)));
        assert!(parse_error("two").is_err() && parse_seconds("5 days").is_err() && parse_seconds("s").is_err());
    }

    #[test]
    fn an_unfinished_matrix_goes_on_with_its_samples_and_bad_rules_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ltm");
        let mut loaded = scene();
        loaded.settings.samples_per_pixel = 6;
        let job = job_of(&loaded).unwrap();
        let writer = store::StoreWriter::create(&path, &job, Default::default()).unwrap();
        let mut traced = TracedBlock::default();
        traced.block.reset(job.shape.rect(BlockId(0)).rows(), job.shape.columns());
        crate::matrix::BlockSink::write_block(&writer, BlockId(0), &traced).unwrap();
        drop(writer);
        let rule = StopRule { seconds: Some(1.0), ..Default::default() };
        let again = choose_samples(scene(), RenderTo::GoOn(&path), rule, &PackOptions::default(), &Quiet).unwrap();
        assert_eq!(again.loaded.settings.samples_per_pixel, 6);
        let bad = StopRule { error: Some(-0.1), ..Default::default() };
        assert!(choose_samples(scene(), RenderTo::GoOn(&path), bad, &PackOptions::default(), &Quiet).is_err());
    }

    #[test]
    fn an_unfinished_pack_goes_on_with_its_samples() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ltc");
        let options = PackOptions { denoise: true, ..Default::default() };
        let chosen = |seconds| {
            let rule = StopRule { seconds: Some(seconds), packs: true, ..Default::default() };
            choose_samples(scene(), RenderTo::GoOn(&path), rule, &options, &Quiet).unwrap().loaded
        };
        let first = chosen(1.0).settings.samples_per_pixel;
        assert!(samples_path(&path).exists());
        // Nothing was begun with them: they bind nobody.
        assert_eq!(samples_of_unfinished(&mut scene(), &path).unwrap(), None);
        let [_, gathered, ..] = files_of_pack(&path);
        std::fs::write(gathered, "").unwrap();
        // Another time would give another number: twice as long at least, were it not for what is begun.
        let again = chosen(60.0);
        assert_eq!(again.settings.samples_per_pixel, first);
        // One that was begun anew can be gone on with as well.
        std::fs::remove_file(samples_path(&path)).unwrap();
        let rule = StopRule { seconds: Some(1.0), packs: true, ..Default::default() };
        let anew = choose_samples(scene(), RenderTo::Anew(&path), rule, &options, &Quiet).unwrap().loaded;
        assert_eq!(chosen(60.0).settings.samples_per_pixel, anew.settings.samples_per_pixel);
        let mut other = scene();
        other.settings.seed += 1;
        assert_eq!(samples_of_unfinished(&mut other, &path).unwrap(), None);
        let few =
            LoadedScene { settings: crate::scene::RenderSettings { samples_per_pixel: 2, ..again.settings }, ..again };
        crate::pipeline::render_packed(few, &path, &options, &Quiet).unwrap();
        assert!(!samples_path(&path).exists());
    }

    /// The image of every block of a packed scene, of columns divided by their scales.
    fn images_of(path: &Path) -> Images {
        let container = crate::container::ContainerReader::open(path).unwrap();
        let (job, probes) = (container.job(), crate::light::probe_lightings(&container.job().basis));
        let inverse: Vec<f32> = job.basis.column_scales().iter().map(|scale| scale.recip()).collect();
        let image = |id| {
            let mut block = container.read_block(id).unwrap();
            block.scale_columns(&inverse);
            (id, ProbedBlock::of_factors(&block, &probes))
        };
        job.shape.blocks().map(image).collect()
    }

    /// Those of a matrix of many samples.
    fn converged() -> Images {
        let mut job = job_of(&scene()).unwrap();
        let settings = TraceSettings { samples_per_pixel: 1024, seed: 4711, ..settings_of(&scene()) };
        let tracer = Tracer::new(scene().scene, job.shape, settings).unwrap().with_column_scales();
        job.basis.set_column_scales(tracer.column_scales().to_vec()).unwrap();
        let windows = [job.shape.blocks().collect()];
        let blocks = Blocks { source: &tracer, job: &job, windows: &windows };
        let threads = Threads::new(rayon::current_num_threads()).unwrap();
        blocks.images(false, &threads, "", &Quiet).unwrap().sampled
    }

    /// Against a converged reference: what was asked for is kept to a half, and what is stated as reached is right to a quarter, in the
    /// median over seeds. The samples that it is measured against have a noise of 0.13 to 0.21 under narrow lightings; on so small a
    /// picture an error below a tenth of that drowns, and the worst of 16 lightings is stated too large: 1.07 times the true one at
    /// 0.04, 1.5 times at 0.015, over 15 seeds. One statement alone has been wrong by a factor of 5.
    #[test]
    fn a_promised_error_is_reached_and_what_is_stated_is_true() {
        const SEEDS: u64 = 5;
        let (folder, truth) = (tempfile::tempdir().unwrap(), converged());
        for (asked, most) in [(0.04, 1.25), (0.015, 2.0)] {
            let mut found = Vec::new();
            for seed in 0..SEEDS {
                let path = folder.path().join(format!("{asked}-{seed}.ltc"));
                let mut options = PackOptions { denoise: true, ..Default::default() };
                let rule = StopRule { error: Some(asked), packs: true, ..Default::default() };
                let mut seeded = scene();
                seeded.settings.seed = seed;
                let chosen = choose_samples(seeded, RenderTo::GoOn(&path), rule, &options, &Quiet).unwrap();
                options.promise = chosen.promise.map(Arc::new);
                let (_, report) = crate::pipeline::render_packed(chosen.loaded, &path, &options, &Quiet).unwrap();
                let stated = report.exposed.unwrap();
                assert_eq!(crate::container::ContainerReader::open(&path).unwrap().errors().exposed, Some(stated));
                let packed = images_of(&path);
                found.push((f64::from(stated.reached), worst(&error_squares(&packed, [&truth])).sqrt()));
            }
            let median = |of: &dyn Fn(&(f64, f64)) -> f64| {
                let mut all: Vec<f64> = found.iter().map(of).collect();
                all.sort_unstable_by(f64::total_cmp);
                all[all.len() / 2]
            };
            let said = format!("{asked} asked; stated and true by seed: {found:?}");
            assert!((0.8..most).contains(&median(&|(stated, error)| stated / error)), "{said}");
            assert!((0.5..1.5).contains(&median(&|(_, error)| error / asked)), "{said}");
        }
    }

    #[test]
    fn the_rays_of_photons_are_counted() {
        let folder = tempfile::tempdir().unwrap();
        let room = || {
            let mut room = BuiltIn { width: 32, height: 24, texels: 2 }.named("caustics").unwrap();
            room.settings.samples_per_pixel = 4;
            room
        };
        let (loaded, job) = (room(), job_of(&room()).unwrap());
        let settings = settings_of(&loaded);
        let tracer = Tracer::new(loaded.scene, job.shape, settings).unwrap();
        let cost = tracer.photon_cost();
        assert_eq!(cost.sent, Tracer::photons_sent(tracer.scene(), job.shape, settings));
        // Each that rests has come by a mirror or glass.
        assert!(cost.rays >= 2 * tracer.photon_count() as u64 && tracer.photon_count() > 0);
        let trace = |id| tracer.trace_block(id, &mut TracedBlock::default()).rays;
        let rays = cost.rays + job.shape.blocks().map(trace).sum::<u64>();
        let report =
            crate::pipeline::render(room(), &folder.path().join("a.ltm"), &Default::default(), &Quiet).unwrap();
        assert_eq!(report.rays, rays);
        let packed = folder.path().join("a.ltc");
        let (report, _) = crate::pipeline::render_packed(room(), &packed, &Default::default(), &Quiet).unwrap();
        assert_eq!(report.rays, rays);
        assert_eq!(tracer.without_photons().photon_cost(), Default::default());
    }
}
