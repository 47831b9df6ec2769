//! The corpus: scenes that others made, beside a denoiser that denoises each relit image by itself.
//!
//! The folder that `LTM_CORPUS` names has one folder for each scene, with a `scene.toml` or one glTF file that has a
//! camera and lights. Which scenes choose constants and which judge them is no choice: folders are sorted by name; the
//! first, third, fifth … choose, the second, fourth, sixth … judge ([`Half`]).

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::StudyReport;
use super::bench::Bench;
use super::interval::mean;
use super::mosaic::Picture;
use super::oidn::{self, Surfaces};
use super::reference::{alone, norm};
use super::rivals::{PACKED, packed};
use super::spots::spots;
use super::stated::{Alone, Compared, SeenEmitters};
use super::table::{Cell, Table};
use super::timing::{Clock, Took};
use super::visual_metrics::Seen;
use ltm::compress::{CompressSettings, Target};
use ltm::container::ContainerReader;
use ltm::error::{Error, Result};
use ltm::files::write_file;
use ltm::image::{LinearImage, read_image};
use ltm::light::{DenoiseErrors, DenoisedLight, Job, Light, Lighting};
use ltm::matrix::{BlockSource, MatrixShape};
use ltm::pipeline::PackOptions;
use ltm::relight::relight_raw;
use ltm::scene::{self, BuiltIn, LoadOptions, LoadedScene};
use ltm::store::StoreReader;

/// The variable of the environment that names the folder.
const VARIABLE: &str = "LTM_CORPUS";

/// A folder that is no scene: files that were refused.
const LEFT_OUT: &str = "raw-refused";

/// A light is left out whose image in the reference is, in L2, less than this part of that with all on: it hardly
/// reaches the picture.
const DARK: f64 = 1e-3;

/// Standard deviation of a spot on a light with texels, as a part of its longer side.
const SPOT: f32 = 0.15;

/// Seed of the references.
const REFERENCE_SEED: u64 = 1;

/// What the study of a corpus measures.
#[derive(Clone, Debug)]
pub struct CorpusOptions {
    /// Names of scenes; empty for all. Which half a scene belongs to does not depend on it.
    pub scenes: Vec<String>,
    /// Pixels across and down.
    pub size: (u32, u32),
    /// Samples per pixel.
    pub samples: Vec<u32>,
    /// Samples per pixel of the references.
    pub reference_samples: u32,
}

impl Default for CorpusOptions {
    fn default() -> Self {
        Self { scenes: Vec::new(), size: (256, 192), samples: vec![16, 64, 256], reference_samples: 2048 }
    }
}

/// What a scene is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Half {
    /// Constants are chosen on it.
    Chooses,
    /// What is published of the program's pictures is measured on it.
    Judges,
}

impl Half {
    /// Of the scene at this place among all, sorted by name. Never to be changed: decision 46.
    fn of(place: usize) -> Self {
        if place.is_multiple_of(2) { Self::Chooses } else { Self::Judges }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Chooses => "chooses",
            Self::Judges => "judges",
        }
    }
}

/// A scene of the corpus.
pub(super) struct Entry {
    pub(super) name: String,
    half: Half,
    /// `None` for a built-in scene.
    file: Option<PathBuf>,
}

/// A light, or a part of one, that is on.
pub(super) struct Shown {
    pub(super) name: String,
    pub(super) lighting: Lighting,
    pub(super) reference: LinearImage,
}

/// One way from samples to images.
struct Rival {
    method: &'static str,
    bytes: Option<u64>,
    took: Took,
    images: Vec<LinearImage>,
}

/// All ways, and what the default container states of its lights.
struct Rivals {
    rivals: Vec<Rival>,
    denoised_lights: Vec<DenoisedLight>,
}

/// What is seen under one lighting.
struct Judged {
    seen: Seen,
    spots: f64,
}

const RAW: &str = "raw matrix";
const OURS: &str = "ours";
/// As it was packed by default before packing went by the eye: to 72 dB.
const FINER: &str = "ours, 72 dB";
const DENOISER: &str = "denoiser on each image";

const NOTE: &str = "Scenes that others made, sorted by name: the 1st, 3rd, 5th … choose constants, the 2nd, 4th, 6th … judge. Images against \
those of a matrix of another seed, mean over the lightings; worst where it says so. Lightings: the scene's own, each light alone, a spot of 0.15 \
of its side on each light with texels, the texel of each sky that lights most, each sky under the environment maps of the folder `hdr` of `LTM_SCENES`; without those whose image is, in L2, less than a thousandth \
of that with all on. ꟻLIP, clip, seams and negative as in `ltm study picture`. Spots: pixels whose displayed luminance exceeds by 0.05 all that the \
reference shows within two pixels, and whose error exceeds by as much the median error within eight; in thousandths of all pixels. \
Denoiser: Intel's Open Image Denoise on each raw relit image, high quality, with the reference's own albedo and normals as noise-free guides. Ours, 72 dB: packed finely, as bytes were once chosen. Over \
the denoiser: mean and largest ratio of ꟻLIP over the lightings. cpu: processors' seconds of all threads, of tracing the raw matrix, of packing \
(cleaning included), of the denoiser on one image.";

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let mut report = StudyReport::default();
    let entries = entries(bench)?;
    if entries.is_empty() {
        bench.watch.note(&format!("corpus: {VARIABLE} names no folder of scenes; nothing was measured"));
        return Ok(report);
    }
    let with_denoiser = oidn::OIDN.is_there();
    let absent = "The denoiser was not measured: no Python with `pyoidn` was found.";
    let notes = bench.notes(&[NOTE, absent][..if with_denoiser { 1 } else { 2 }]);
    let mut table = Table::new("Scenes that others made, beside a denoiser on each image", notes.clone(), &COLUMNS);
    let mut each = Table::new("The corpus under each lighting", notes.clone(), &EACH_COLUMNS);
    let mut stated =
        Table::new("Stated errors of denoising beside real ones", bench.notes(&[STATED_NOTE]), &STATED_COLUMNS);
    bench.watch.begin("corpus", entries.len() as u64, "scenes");
    let mut pictures = Vec::new();
    for entry in &entries {
        match measure(bench, entry, with_denoiser, [&mut table, &mut each, &mut stated]) {
            Ok(rows) => pictures.push((format!("corpus-{}", entry.name), rows)),
            Err(problem @ Error::Interrupted { .. }) => return Err(problem),
            Err(problem) => bench.watch.note(&format!("corpus: {} was not measured: {problem}", entry.name)),
        }
        bench.watch.advance(1, 0, "B");
    }
    bench.watch.end();
    report.add_table(&bench.out, "corpus", &table)?;
    report.add_csv(&bench.out, "corpus-lightings", &each)?;
    report.add_csv(&bench.out, "corpus-errors", &stated)?;
    for (stem, rows) in &pictures {
        report.add_pictures(&bench.out, stem, rows, 1)?;
    }
    Ok(report)
}

const COLUMNS: [(&str, usize); 22] = [
    ("scene", 0),
    ("half", 0),
    ("samples_per_px", 0),
    ("reference_samples_per_px", 0),
    ("method", 0),
    ("rows", 0),
    ("columns", 0),
    ("lightings", 0),
    ("bytes", 0),
    ("flip", 4),
    ("flip_worst", 4),
    ("flip_over_denoiser", 3),
    ("flip_over_denoiser_worst", 3),
    ("psnr_clip_db", 2),
    ("psnr_clip_worst_db", 2),
    ("psnr_clip_over_denoiser_db", 2),
    ("seams", 3),
    ("seams_worst", 3),
    ("spots_permille", 2),
    ("spots_worst_permille", 2),
    ("negative_permille", 2),
    ("cpu_seconds", 2),
];

const STATED_NOTE: &str = "What containers state of denoising for each light alone, beside the relative L2 distance from the reference over all pixels \
that do not show the light itself; the reference's own noise, as it follows from that of the raw matrix, is taken off. Ratio: stated error, noise and bias together, over the \
distance. Light kept: the sum of the denoised light over that of the samples, as stated; packed light: the sum of the packed image over that of the reference.";

const STATED_COLUMNS: [(&str, usize); 11] = [
    ("scene", 0),
    ("half", 0),
    ("samples_per_px", 0),
    ("light", 0),
    ("stated_noise", 4),
    ("stated_bias", 4),
    ("stated_error", 4),
    ("stated_light_kept", 4),
    ("error", 4),
    ("ratio", 3),
    ("packed_light", 4),
];

const EACH_COLUMNS: [(&str, usize); 8] = [
    ("scene", 0),
    ("half", 0),
    ("samples_per_px", 0),
    ("lighting", 0),
    ("method", 0),
    ("flip", 4),
    ("psnr_clip_db", 2),
    ("spots_permille", 2),
];

/// The scenes that are wanted; without a corpus, or in the quick setting, two built-in ones.
pub(super) fn entries(bench: &Bench<'_>) -> Result<Vec<Entry>> {
    let folder = std::env::var_os(VARIABLE).map(PathBuf::from);
    let mut found: Vec<(String, Option<PathBuf>)> = match folder {
        _ if bench.quick => ["diffuse", "mixed"].map(|name| (name.to_owned(), None)).into(),
        None => Vec::new(),
        Some(folder) => {
            let listed = std::fs::read_dir(&folder).map_err(Error::io(&folder, "list"))?.flatten();
            let scene = |path: PathBuf| {
                let name = path.file_name()?.to_str()?.to_owned();
                (name != LEFT_OUT).then_some(())?;
                Some((name, Some(scene_file(&path)?)))
            };
            listed.filter_map(|entry| scene(entry.path())).collect()
        }
    };
    found.sort();
    let entry = |(place, (name, file))| Entry { name, half: Half::of(place), file };
    let wanted = |entry: &Entry| bench.corpus.scenes.is_empty() || bench.corpus.scenes.contains(&entry.name);
    Ok(found.into_iter().enumerate().map(entry).filter(wanted).collect())
}

/// The `scene.toml` of a folder, or else its first glTF file by name.
fn scene_file(folder: &Path) -> Option<PathBuf> {
    let own = folder.join("scene.toml");
    if own.is_file() {
        return Some(own);
    }
    let files = std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path());
    files.filter(|path| path.extension().is_some_and(|kind| kind == "glb" || kind == "gltf")).min()
}

/// A matrix of a scene, and how long its tracing took when it was traced.
pub(super) fn matrix(bench: &Bench<'_>, entry: &Entry, (samples, seed): (u32, u64)) -> Result<(StoreReader, Took)> {
    let (width, height) = size(bench);
    let loaded = match &entry.file {
        // Some name textures of their makers' disks.
        Some(file) => scene::load_with(file, LoadOptions { allow_missing: true, ..LoadOptions::default() })?,
        None => BuiltIn { width, height, texels: 4 }.named(&entry.name)?,
    };
    let mut loaded: LoadedScene = loaded.sized(width, height);
    loaded.settings.samples_per_pixel = samples;
    loaded.settings.seed = seed;
    let name = format!("corpus-{}-{width}x{height}-{samples}s-{seed}.ltm", entry.name);
    let times = bench.cached(&format!("{name}.seconds"));
    let (before, clock) = (bench.cached(&name).metadata().and_then(|file| file.modified()).ok(), Clock::start());
    let matrix = bench.rendered(&name, loaded)?;
    if before != bench.cached(&name).metadata().and_then(|file| file.modified()).ok() {
        let took = clock.stop();
        write_file(&times, true, format!("{} {}", took.secs, took.cpu_secs).as_bytes())?;
    }
    let text = std::fs::read_to_string(&times).unwrap_or_default();
    let mut numbers = text.split(' ').map(|number| number.parse().unwrap_or(f64::NAN));
    let mut next = || numbers.next().unwrap_or(f64::NAN);
    Ok((matrix, Took { secs: next(), cpu_secs: next() }))
}

fn size(bench: &Bench<'_>) -> (u32, u32) {
    if bench.quick { (64, 48) } else { bench.corpus.size }
}

/// The rows of one scene, and its pictures.
fn measure(
    bench: &Bench<'_>,
    entry: &Entry,
    with_denoiser: bool,
    [table, each, stated]: [&mut Table; 3],
) -> Result<Vec<Vec<Picture>>> {
    let converged = if bench.quick { 128 } else { bench.corpus.reference_samples };
    let (reference, _) = matrix(bench, entry, (converged, REFERENCE_SEED))?;
    let shown = lightings(&reference)?;
    let surfaces = Surfaces::of(&reference)?.filter(|_| with_denoiser);
    let seen = SeenEmitters::of(&reference)?;
    let samples: &[u32] = if bench.quick { &[16] } else { &bench.corpus.samples };
    let mut pictures = Vec::new();
    for &samples in samples {
        let Rivals { rivals, denoised_lights } = rivals(bench, entry, samples, &shown, surfaces.as_ref())?;
        let judged = judge(&rivals, &shown, reference.shape());
        let cells = [entry.name.as_str().into(), entry.half.name().into(), samples.into()];
        for (rival, judged) in rivals.iter().zip(&judged) {
            for (shown, of) in shown.iter().zip(judged) {
                let more = [shown.name.as_str().into(), rival.method.into()];
                let measures = [of.seen.flip, of.seen.psnr_clipped, 1e3 * of.spots].map(Cell::from);
                each.push(cells.iter().cloned().chain(more).chain(measures).collect());
            }
        }
        let [ours, raw] = [&rivals[0], &rivals[rivals.len() - 1]];
        let lights = reference.job().basis.lights().iter();
        for (light, (Light { name, .. }, told)) in lights.zip(&denoised_lights).enumerate() {
            let Some(at) = shown.iter().position(|shown| shown.name == *name) else { continue };
            let alone = Alone {
                light,
                ours: &ours.images[at],
                raw: &raw.images[at],
                reference: &shown[at].reference,
                samples: [samples, converged].map(f64::from),
            };
            let row = stated_row(told, &alone.compare(&seen)).map(Cell::from);
            stated.push(cells.iter().cloned().chain([name.as_str().into()]).chain(row).collect());
        }
        for row in rows(&rivals, &judged, reference.shape()) {
            let row: [Cell; COLUMNS.len() - 4] = row;
            table.push(cells.iter().cloned().chain([converged.into()]).chain(row).collect());
        }
        pictures.extend(pictured(&rivals, &judged, &shown, samples));
    }
    Ok(pictures)
}

/// What is stated of a light, and what was found, as [`STATED_COLUMNS`] have it behind the names.
fn stated_row(told: &DenoisedLight, found: &Compared) -> [f64; STATED_COLUMNS.len() - 4] {
    let DenoisedLight { errors: DenoiseErrors { noise_after, bias, .. }, light_kept } = told;
    let [noise, bias, error, kept] = [*noise_after, *bias, told.error(), *light_kept].map(f64::from);
    [noise, bias, error, kept, found.error, error / found.error, found.light]
}

/// The lightings of a scene that reach its picture, and what a matrix of it shows under each.
pub(super) fn lightings(reference: &StoreReader) -> Result<Vec<Shown>> {
    let job = reference.job();
    let mut named = vec![("all".to_owned(), Lighting::of_scene(&job.basis))];
    for light in job.basis.lights() {
        named.push((light.name.clone(), alone(job, &light.name)?));
        if light.places.len() > 1 {
            named.push((format!("{}: spot", light.name), spot(job, light)?));
        }
        if light.kind.is_environment() && light.places.len() > 1 {
            named.push((format!("{}: texel", light.name), brightest(reference, light)?));
            named.extend(real_skies(job, light)?);
        }
    }
    let (names, lightings): (Vec<_>, Vec<_>) = named.into_iter().unzip();
    let images = relight_raw(reference, &lightings)?;
    let least = DARK * norm(&images[0]);
    let all = names.into_iter().zip(lightings).zip(images);
    let shown = all.map(|((name, lighting), reference)| Shown { name, lighting, reference });
    Ok(shown.filter(|shown| norm(&shown.reference) > least).collect())
}

/// A light through a Gaussian about its middle texel, all others off.
fn spot(job: &Job, light: &Light) -> Result<Lighting> {
    let ((across, down), weights) = (light.layout(), job.basis.scene_weights());
    let deviation = SPOT * across.max(down) as f32;
    let weight = |column: usize| {
        let texel = column as u32 - light.first_column;
        let offset = [texel % across, texel / across].map(|at| at as f32 + 0.5);
        let square = (offset[0] - 0.5 * across as f32).powi(2) + (offset[1] - 0.5 * down as f32).powi(2);
        weights[column].map(|weight| weight * (-0.5 * square / (deviation * deviation)).exp())
    };
    only(light, weights.len(), &weight)
}

/// The texel of a light whose image has the largest norm.
fn brightest(reference: &StoreReader, light: &Light) -> Result<Lighting> {
    let weights = reference.job().basis.scene_weights();
    let texel = |column: u32| only(light, weights.len(), &|j| if j as u32 == column { weights[j] } else { [0.0; 3] });
    let lightings = light.columns().map(texel).collect::<Result<Vec<_>>>()?;
    let norms: Vec<f64> = relight_raw(reference, &lightings)?.iter().map(norm).collect();
    let best = (0..norms.len()).fold(0, |best, at| if norms[at] > norms[best] { at } else { best });
    Ok(lightings[best].clone())
}

/// A sky under each environment map of the folder `hdr` in that of the scenes, where there is one.
fn real_skies(job: &Job, light: &Light) -> Result<Vec<(String, Lighting)>> {
    let Some(folder) = std::env::var_os("LTM_SCENES").map(|scenes| Path::new(&scenes).join("hdr")) else {
        return Ok(Vec::new());
    };
    let Some(mapping) = light.kind.environment() else { return Ok(Vec::new()) };
    let listed = std::fs::read_dir(&folder).map(|files| files.flatten().map(|file| file.path()).collect::<Vec<_>>());
    let mut maps = listed.unwrap_or_default();
    maps.retain(|file| file.extension().is_some_and(|kind| kind == "hdr"));
    maps.sort();
    let under = |file: PathBuf| {
        let map = read_image(&file)?;
        let texels = mapping.resample((map.width, map.height), &map.pixels, 0.0);
        let weight = |column: usize| texels[column - light.first_column as usize];
        let name = file.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        Ok((format!("{}: {name}", light.name), only(light, job.shape.columns(), &weight)?))
    };
    maps.into_iter().map(under).collect()
}

/// A lighting of the columns of one light.
fn only(light: &Light, columns: usize, weight: &dyn Fn(usize) -> [f32; 3]) -> Result<Lighting> {
    let own = light.columns();
    let of = |column: usize| if own.contains(&(column as u32)) { weight(column) } else { [0.0; 3] };
    Lighting::new((0..columns).map(of).collect())
}

/// Ours first, the raw matrix last.
fn rivals(
    bench: &Bench<'_>,
    entry: &Entry,
    samples: u32,
    shown: &[Shown],
    surfaces: Option<&Surfaces>,
) -> Result<Rivals> {
    let (matrix, took) = matrix(bench, entry, (samples, 0))?;
    let lightings: Vec<Lighting> = shown.iter().map(|shown| shown.lighting.clone()).collect();
    let options = PackOptions { allow_lost_lights: true, denoise: true, ..PackOptions::default() };
    let clock = Clock::start();
    let ours = packed(bench, &matrix, options.clone(), &lightings)?;
    let mut rivals = vec![Rival { method: OURS, bytes: Some(ours.bytes), took: clock.stop(), images: ours.images }];
    let denoised_lights = ContainerReader::open(&bench.cached(PACKED))?.errors().denoised_lights.clone();
    let target = Target::PsnrDb(72.0);
    let finer = PackOptions { compress: CompressSettings { target, ..CompressSettings::default() }, ..options };
    let clock = Clock::start();
    let ours = packed(bench, &matrix, finer, &lightings)?;
    rivals.push(Rival { method: FINER, bytes: Some(ours.bytes), took: clock.stop(), images: ours.images });
    let raw = relight_raw(&matrix, &lightings)?;
    if let Some(surfaces) = surfaces {
        let oidn::TimedImages { images, secs, cpu_secs } = oidn::denoise_timed(&raw, surfaces, &bench.cached("oidn"))?;
        rivals.push(Rival { method: DENOISER, bytes: None, took: Took { secs, cpu_secs }, images });
    }
    rivals.push(Rival { method: RAW, bytes: Some(matrix.shape().raw_bytes()), took, images: raw });
    Ok(Rivals { rivals, denoised_lights })
}

/// By rival, then by lighting.
fn judge(rivals: &[Rival], shown: &[Shown], shape: MatrixShape) -> Vec<Vec<Judged>> {
    let raw = rivals.last().map_or(&[][..], |raw| &raw.images);
    let of_rival = |rival: &Rival| -> Vec<Judged> {
        let all = rival.images.par_iter().zip(shown).zip(raw);
        let judged = all.map(|((image, shown), raw)| Judged {
            seen: Seen::of(image, &shown.reference, raw, shape.block_side()),
            spots: spots(image, &shown.reference),
        });
        judged.collect()
    };
    rivals.iter().map(of_rival).collect()
}

/// A row for each rival, without the first four cells.
fn rows(rivals: &[Rival], judged: &[Vec<Judged>], shape: MatrixShape) -> Vec<[Cell; COLUMNS.len() - 4]> {
    let denoiser = rivals.iter().position(|rival| rival.method == DENOISER).map(|at| &judged[at]);
    let row = |(rival, judged): (&Rival, &Vec<Judged>)| {
        let of_all = |part: fn(&Judged) -> f64| mean(judged.iter().map(part));
        let worst = |part: fn(&Judged) -> f64| judged.iter().map(part).fold(f64::NEG_INFINITY, f64::max);
        let beside = |part: fn(&Judged, &Judged) -> f64| -> Option<Vec<f64>> {
            denoiser.map(|other| judged.iter().zip(other).map(|(own, other)| part(own, other)).collect())
        };
        let ratios = beside(|own, other| own.seen.flip / other.seen.flip);
        let gains = beside(|own, other| own.seen.psnr_clipped - other.seen.psnr_clipped);
        let average = |values: &Vec<f64>| mean(values.iter().copied());
        [
            rival.method.into(),
            shape.rows().into(),
            shape.columns().into(),
            judged.len().into(),
            rival.bytes.map(|bytes| bytes as f64).into(),
            of_all(|j| j.seen.flip).into(),
            worst(|j| j.seen.flip).into(),
            ratios.as_ref().map(average).into(),
            ratios.map(|ratios| ratios.into_iter().fold(0.0, f64::max)).into(),
            of_all(|j| j.seen.psnr_clipped).into(),
            (-worst(|j| -j.seen.psnr_clipped)).into(),
            gains.as_ref().map(average).into(),
            of_all(|j| j.seen.seams).into(),
            worst(|j| j.seen.seams).into(),
            of_all(|j| 1e3 * j.spots).into(),
            worst(|j| 1e3 * j.spots).into(),
            of_all(|j| 1e3 * j.seen.negative).into(),
            rival.took.cpu_secs.into(),
        ]
    };
    rivals.iter().zip(judged).map(row).collect()
}

/// Two rows of pictures: all lights, and the lighting under which ours is furthest from the reference.
fn pictured(rivals: &[Rival], judged: &[Vec<Judged>], shown: &[Shown], samples: u32) -> Vec<Vec<Picture>> {
    let flip = |at: usize| judged[0][at].seen.flip;
    let worst = (1..shown.len()).fold(0, |worst, at| if flip(at) > flip(worst) || worst == 0 { at } else { worst });
    let row = |at: usize| {
        let Shown { name, reference, .. } = &shown[at];
        let of_rival = |rival: &Rival| {
            let caption = match rival.method {
                RAW => format!("{name}, {samples} samples"),
                method => method.to_owned(),
            };
            Picture::shown(&rival.images[at], reference, caption)
        };
        let shown = rivals[..rivals.len() - 1].iter().filter(|rival| rival.method != FINER);
        let pictures = rivals.iter().rev().take(1).chain(shown).map(of_rival);
        pictures.chain([Picture::shown(reference, reference, "reference")]).collect()
    };
    let both = if worst == 0 { vec![0] } else { vec![0, worst] };
    both.into_iter().map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_second_scene_judges() {
        let halves: Vec<Half> = (0..5).map(Half::of).collect();
        assert_eq!(halves, [Half::Chooses, Half::Judges, Half::Chooses, Half::Judges, Half::Chooses]);
    }
}
