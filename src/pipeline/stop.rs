//! When a render is good enough: samples per pixel from an error or a time that people state.
//!
//! A pilot traces some blocks with a few samples. Their noise says what error more samples will leave (its variance
//! falls with their number), their time what more will take. The render itself is then one of so many samples, the same
//! bytes as with that number given, and goes on with it when it was stopped.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use rayon::prelude::*;

use super::render::{job_of, settings_of, tracing_need};
use crate::error::{Error, Result};
use crate::host::{Threads, Watch};
use crate::image::percentile;
use crate::light::{LightBasis, PROBES, probe_lightings};
use crate::matrix::{BlockId, BlockSource, TracedBlock};
use crate::scene::LoadedScene;
use crate::store::{StoreReader, partial_path};
use crate::trace::Tracer;

/// Samples per pixel of the pilot.
const PILOT_SAMPLES: u32 = 8;
/// Blocks that stand for all, spread evenly; in the pilot for each thread as many as fill a few seconds at most.
const BLOCKS: u32 = 24;
/// Part of a stated time that tracing may take: the rest is for reading the scene, the pilot and the disk.
const TRACING_SHARE: f64 = 0.9;
/// Luminance percentile that an image is exposed by.
const WHITE: f64 = 0.95;

/// When to stop: the first of these that is reached.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StopRule {
    /// Expected error of an exposed image, see [`expected_error`].
    pub error: Option<f64>,
    /// Wall-clock seconds for all.
    pub seconds: Option<f64>,
}

/// What a pilot found, for one sample per pixel.
struct Pilot {
    /// Expected error; falls with the root of the number of samples.
    error: f64,
    /// Seconds for the whole image on all threads.
    seconds: f64,
}

/// Sets the scene's samples per pixel so that the first of a rule's ends is reached. A matrix of the same scene that is
/// `unfinished` (by its finished name) goes on with its own number.
///
/// # Errors
/// A rule without an end, or with one that is not above 0; what tracing refuses; [`Error::Interrupted`].
pub fn choose_samples(
    mut loaded: LoadedScene,
    unfinished: Option<&Path>,
    rule: StopRule,
    memory_bytes: Option<u64>,
    watch: &dyn Watch,
) -> Result<LoadedScene> {
    let begun = Instant::now();
    for (name, end) in [("--error", rule.error), ("--time", rule.seconds)] {
        if end.is_some_and(|end| !(end > 0.0 && end.is_finite())) {
            return Err(Error::input(name, "is not above 0", "give for example --error 2% or --time 60s"));
        }
    }
    if let Some(path) = unfinished
        && let Some(samples) = samples_of_unfinished(&mut loaded, path)?
    {
        watch.note(&format!("{}: goes on with {samples} samples per pixel", path.display()));
        return Ok(loaded);
    }
    loaded.settings.samples_per_pixel = PILOT_SAMPLES;
    let job = job_of(&loaded)?;
    let threads = tracing_need(&loaded, &job).threads_within("a pilot", memory_bytes)?;
    let settings = settings_of(&loaded);
    let scene = Arc::new(loaded.scene);
    let tracer = Tracer::new(Arc::clone(&scene), job.shape, settings)?;
    let pilot = Threads::new(threads)?.run(|| pilot(&tracer, &job.basis, watch));
    drop(tracer);
    loaded.scene = Arc::try_unwrap(scene).unwrap_or_else(|shared| (*shared).clone());
    let Pilot { error, seconds } = pilot?;
    let most = f64::from(Tracer::MAX_SAMPLES_PER_PIXEL);
    let by_error = rule.error.map(|end| (error / end).powi(2).ceil());
    let left = |end: f64| (TRACING_SHARE * end - begun.elapsed().as_secs_f64()).max(0.0);
    let by_time = rule.seconds.map(|end| (left(end) / seconds).floor());
    let wanted = by_error.into_iter().chain(by_time).fold(most, f64::min);
    // Two at least, so that the noise is known, and as many in each half.
    let samples = (wanted.max(2.0) / 2.0).ceil() as u32 * 2;
    let ends = match (by_error, by_time) {
        (Some(by_error), Some(by_time)) if by_time < by_error => "the time ends it",
        (Some(_), _) => "for the error",
        _ => "for the time",
    };
    let expected = 100.0 * error / f64::from(samples).sqrt();
    watch.note(&format!(
        "{samples} samples per pixel {ends}: expected error {expected:.2} % of white, about {:.0} s of tracing",
        seconds * f64::from(samples)
    ));
    loaded.settings.samples_per_pixel = samples;
    Ok(loaded)
}

/// Gives the scene the samples of the unfinished matrix at `path`, if there is one of this scene.
fn samples_of_unfinished(loaded: &mut LoadedScene, path: &Path) -> Result<Option<u32>> {
    let Ok(unfinished) = StoreReader::open(&partial_path(path)) else { return Ok(None) };
    let before = loaded.settings.samples_per_pixel;
    let samples = unfinished.job().provenance.samples_per_pixel;
    loaded.settings.samples_per_pixel = samples;
    if job_of(loaded)?.hash() == unfinished.job().hash() {
        return Ok(Some(samples));
    }
    loaded.settings.samples_per_pixel = before;
    Ok(None)
}

fn pilot(tracer: &Tracer, basis: &LightBasis, watch: &dyn Watch) -> Result<Pilot> {
    let shape = BlockSource::shape(tracer);
    let blocks = spread(shape.blocks().collect());
    watch.begin("a pilot", blocks.len() as u64, "blocks");
    let begun = Instant::now();
    let error = error_of(tracer, basis, &blocks, watch);
    let seconds = begun.elapsed().as_secs_f64();
    watch.end();
    let traced: usize = blocks.iter().map(|&id| shape.rect(id).pixels()).sum();
    let all = f64::from(shape.width()) * f64::from(shape.height());
    let samples = f64::from(PILOT_SAMPLES);
    Ok(Pilot { error: error? * samples.sqrt(), seconds: seconds / samples * all / traced as f64 })
}

/// The expected error of an image relit from a stored matrix, as a fraction of white: of the probe lightings
/// (`light::probe_lightings`) the worst. The image of each is exposed so that its 95th percentile is white; the error is
/// the root mean square of its noise, that of pixels beyond white left out, which are clipped. Packing removes a part of
/// it. From some blocks that stand for all; none where the matrix does not know its noise.
///
/// # Errors
/// Those of reading.
pub fn expected_error(matrix: &StoreReader, watch: &dyn Watch) -> Result<Option<f64>> {
    let committed = BlockSource::shape(matrix).blocks().filter(|&id| matrix.is_committed(id)).collect();
    match error_of(matrix, &matrix.job().basis, &spread(committed), watch) {
        Ok(error) => Ok(Some(error).filter(|error| error.is_finite())),
        Err(error) => Err(error),
    }
}

/// Some of the blocks, evenly spread.
fn spread(blocks: Vec<BlockId>) -> Vec<BlockId> {
    let count = blocks.len().min(BLOCKS as usize);
    (0..count).map(|i| blocks[(2 * i + 1) * blocks.len() / (2 * count)]).collect()
}

/// [`expected_error`] from these blocks; NaN where none knows its noise.
fn error_of<S: BlockSource + ?Sized>(
    source: &S,
    basis: &LightBasis,
    blocks: &[BlockId],
    watch: &dyn Watch,
) -> Result<f64> {
    let probes = probe_lightings(basis);
    let relit = |traced: &mut TracedBlock, &id: &BlockId| {
        if watch.interrupted() {
            return Err(Error::Interrupted("nothing was begun".to_owned()));
        }
        source.read_block(id, traced)?;
        watch.advance(1, 1, "blocks");
        Ok(probed(traced, &probes))
    };
    let parts: Result<Vec<_>> = blocks.par_iter().map_init(TracedBlock::default, relit).collect();
    let parts: Vec<_> = parts?.into_iter().flatten().collect();
    let errors = (0..PROBES).filter_map(|probe| {
        let rows = || parts.iter().flat_map(|part| &part[probe]);
        let white = percentile(rows().map(|(value, _)| value.abs()).collect(), WHITE);
        let visible = rows().filter(|(value, _)| value.abs() < white);
        let square: f64 = visible.map(|(_, noise)| f64::from(*noise).powi(2)).sum();
        (white > 0.0).then(|| (square / rows().count() as f64).sqrt() / f64::from(white))
    });
    Ok(errors.fold(f64::NAN, f64::max))
}

/// For each probe lighting, each row's value and noise.
fn probed(traced: &TracedBlock, probes: &[f32]) -> Option<Vec<Vec<(f32, f32)>>> {
    let (rows, noise) = (traced.block.rows(), traced.noise.as_ref()?);
    let lightings = probes.chunks_exact(traced.block.columns()).zip(noise.probes.chunks_exact(rows));
    let relit = lightings.map(|(weights, noise)| {
        let mut image = vec![0.0f32; rows];
        for (entries, &weight) in traced.block.entries().chunks_exact(rows).zip(weights) {
            image.iter_mut().zip(entries).for_each(|(value, entry)| *value += weight * entry);
        }
        image.into_iter().zip(noise.iter().copied()).collect()
    });
    Some(relit.collect())
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
    use super::*;
    use crate::host::Quiet;
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
        let writer = crate::store::StoreWriter::create(&path, &job, Default::default()).unwrap();
        let mut traced = TracedBlock::default();
        traced.block.reset(job.shape.rect(BlockId(0)).rows(), job.shape.columns());
        crate::matrix::BlockSink::write_block(&writer, BlockId(0), &traced).unwrap();
        drop(writer);
        let rule = StopRule { error: None, seconds: Some(1.0) };
        let again = choose_samples(scene(), Some(&path), rule, None, &Quiet).unwrap();
        assert_eq!(again.settings.samples_per_pixel, 6);
        let bad = StopRule { error: Some(-0.1), seconds: None };
        assert!(choose_samples(scene(), Some(&path), bad, None, &Quiet).is_err());
    }
}
