//! Speed against error, end to end: from a scene to its first relit image, and from then on image by image.

use super::bench::{Bench, CONFERENCE_LAMPS, Wanted};
use super::chart::{Axis, Chart, Line, Panel};
use super::measured::{Measured, Summary};
use super::oidn::{self, Surfaces};
use super::reference::{Judged, LIGHTINGS_NOTE};
use super::table::{Cell, Table};
use super::timing::{Clock, Took};
use super::{StudyReport, machine, mitsuba};
use ltm::container::ContainerReader;
use ltm::error::Result;
use ltm::image::LinearImage;
use ltm::light::Lighting;
use ltm::matrix::{BlockSource, MatrixShape};
use ltm::pipeline::{self, PackOptions, RenderOptions, job_of};
use ltm::relight::{CpuRelighter, relight_raw};
use ltm::store::StoreReader;
use ltm::trace::{TraceSettings, Tracer};

const MITSUBA_NOTE: &str = "Mitsuba 3: the same scene and lighting by its path integrator and the sampler \
`multijitter`, its best in equal time, on all cores; loading and compiling are not counted. With the denoiser: Open Image Denoise on its \
image, with noise-free albedo and normals, Python and files not counted.";

const TIME_NOTE: &str = "All ways in turn, then all again: each time is the least of so many. cpu: processors' seconds of all threads, which \
others that use the machine change less; the numbers of relights from which on preparing pays off are of these, and so is the last column: \
preparing and a hundred images over rendering a hundred again by the same tracer.";

/// The built-in room, which has mirrors and glass, and one that has none.
const SCENES: [&str; 2] = ["mixed", CONFERENCE_LAMPS];

struct Plan {
    size: (u32, u32),
    texels: u32,
    samples: &'static [u32],
    converged: u32,
    /// Times that all is measured, in turn.
    rounds: usize,
}

const QUICK: Plan = Plan { size: (64, 48), texels: 8, samples: &[4, 16], converged: 64, rounds: 1 };
const FULL: Plan = Plan { size: (256, 192), texels: 32, samples: &[4, 16, 64], converged: 2048, rounds: 3 };

const STORED: &str = "ours (stored)";
const FUSED: &str = "ours (fused)";
const RAW: &str = "uncompressed T from disk";
const DENOISED: &str = "Mitsuba 3 (llvm_ad_rgb) and the denoiser";
const AGAIN: &str = "rendering each lighting again";

/// A way to relit images.
struct Way {
    name: &'static str,
    /// From the scene until relighting can begin.
    prepare: Took,
    relight: Took,
    bytes: u64,
    /// Over the twelve lightings; none where only one was made.
    summary: Option<Summary>,
    all_on: Measured,
}

impl Way {
    /// Rendering for one lighting, without any preparation.
    fn again(name: &'static str, relight: Took, image: &LinearImage, all_on: &LinearImage) -> Self {
        let all_on = Measured::of(image, all_on);
        Self { name, prepare: Took::default(), relight, bytes: 0, summary: None, all_on }
    }

    fn after(&self, images: usize) -> Took {
        let relit = Took { secs: self.relight.secs * images as f64, cpu_secs: self.relight.cpu_secs * images as f64 };
        self.prepare + relit
    }
}

/// Of each way the least times of two rounds.
fn join(all: Vec<Way>, more: Vec<Way>) -> Vec<Way> {
    if all.is_empty() {
        return more;
    }
    let pairs = all.into_iter().zip(more);
    pairs
        .map(|(way, again)| Way {
            prepare: way.prepare.least(again.prepare),
            relight: way.relight.least(again.relight),
            ..way
        })
        .collect()
}

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let plan = if bench.quick { &QUICK } else { &FULL };
    let Plan { converged, rounds, .. } = *plan;
    let note = format!(
        "Errors against a matrix of {converged} samples per pixel and another seed. Prepare: from the scene to when relighting can \
begin. Relight: mean of the lightings, CPU. {AGAIN}: the same tracer with an area light as one column (lamps stay one each), all on, and \
nothing stored; the tree over the scene stands, as Mitsuba's does; each of the columns by itself would take columns times as long. \
Pays off: relights from which on preparing has been worth it against rendering again at the same samples. {TIME_NOTE} {MITSUBA_NOTE} Rounds: {rounds}. {}",
        machine::load()
    );
    let scenes: Vec<&str> = SCENES.into_iter().filter(|scene| bench.has(scene)).collect();
    bench.watch.begin("speed", (scenes.len() * plan.samples.len()) as u64, "sample counts");
    let mut notes = bench.notes(&[&note, LIGHTINGS_NOTE]);
    if !oidn::OIDN.is_there() {
        notes.push("The denoiser was not compared: no Python with it (`LTM_OIDN` names one, else `python3`).".into());
    }
    let rivals = rivals_there(&mut notes);
    let mut table = table(notes);
    let mut panels = (Vec::new(), Vec::new());
    for scene in scenes {
        let (totals, errors) = measure(bench, plan, scene, &rivals, &mut table)?;
        panels.0.push(totals);
        panels.1.push(errors);
    }
    bench.watch.end();
    let most = plan.samples.last().copied().unwrap_or(0);
    let charts = [
        Chart {
            title: format!("Seconds for a number of relit images, {most} spp"),
            caption: bench.caption("CPU; from measured parts"),
            x: Axis::logarithmic("relit images"),
            y: Axis::logarithmic("seconds in all"),
            panels: panels.0,
        },
        Chart {
            title: "Error of the first image (all on) against seconds to it".into(),
            caption: bench.caption(&format!("{:?} spp", plan.samples)),
            x: Axis::logarithmic("seconds from the scene to the first image"),
            y: Axis::linear("PSNR clip (dB)"),
            panels: panels.1,
        },
    ];
    let mut report = StudyReport::default();
    report.add_table(&bench.out, "speed", &table)?;
    for (chart, stem) in charts.iter().zip(["speed-total", "speed-error"]) {
        report.add_chart(&bench.out, stem, chart)?;
    }
    Ok(report)
}

/// Measures all ways on a scene: a row for each and each number of samples, and the panels of both charts.
fn measure(
    bench: &Bench<'_>,
    plan: &Plan,
    scene: &'static str,
    rivals: &[(&'static str, &'static str)],
    table: &mut Table,
) -> Result<(Panel, Panel)> {
    let Plan { size, texels, converged, rounds, .. } = *plan;
    let wanted = Wanted { scene, size, texels, samples: converged, seed: 1, block_side: 32 };
    let reference = bench.matrix(wanted)?;
    let shape = reference.shape();
    let Judged { lightings, references, .. } = Judged::of(&reference)?;
    let surfaces = if oidn::OIDN.is_there() { Surfaces::of(&reference)? } else { None };
    let mut last = Vec::new();
    let mut error_lines: Vec<Line> = Vec::new();
    for &samples in plan.samples {
        let mut ways: Vec<Way> = Vec::new();
        for _ in 0..rounds {
            bench.stop_if_interrupted()?;
            let mut round = ours(bench, Wanted { samples, seed: 0, ..wanted }, &lightings, &references)?;
            round.extend(theirs(bench, wanted, samples, rivals, (surfaces.as_ref(), &references[0]))?);
            ways = join(ways, round);
        }
        let again = ways.iter().find(|way| way.name == AGAIN);
        for way in &ways {
            table.push(row(scene, samples, shape, way, again));
            let at = (way.after(1).secs, way.all_on.psnr_clipped);
            match error_lines.iter_mut().find(|line| line.name == way.name) {
                Some(line) => line.points.push(at),
                None => error_lines.push(Line { name: way.name.into(), points: vec![at] }),
            }
        }
        bench.watch.advance(1, shape.raw_bytes(), "B");
        last = ways;
    }
    let counts = (0..=16).map(|i| 10f64.powf(f64::from(i) * 0.25).round());
    let totals = last.iter().map(|way| Line {
        name: way.name.into(),
        points: counts.clone().map(|n| (n, way.after(n as usize).secs)).collect(),
    });
    let title = format!("{scene}, {} × {}", shape.rows(), shape.columns());
    Ok((Panel { title: title.clone(), lines: totals.collect() }, Panel { title, lines: error_lines }))
}

fn table(notes: Vec<String>) -> Table {
    Table::new(
        "Seconds from the scene to relit images",
        notes,
        &[
            ("scene", 0),
            ("way", 0),
            ("samples_per_px", 0),
            ("rows", 0),
            ("columns", 0),
            ("block_px", 0),
            ("bytes", 0),
            ("prepare_secs", 3),
            ("first_image_secs", 3),
            ("ten_images_secs", 3),
            ("hundred_images_secs", 3),
            ("relight_secs", 5),
            ("prepare_cpu_secs", 2),
            ("relight_cpu_secs", 5),
            ("pays_off_after", 1),
            ("psnr_lin_db", 2),
            ("psnr_clip_db", 2),
            ("flip", 3),
            ("all_on_lin_db", 2),
            ("all_on_clip_db", 2),
            ("all_on_flip", 3),
            ("hundred_over_again", 4),
        ],
    )
}

fn row(scene: &str, samples: u32, shape: MatrixShape, way: &Way, again: Option<&Way>) -> Vec<Cell> {
    let again_secs = again.map_or(f64::NAN, |again| again.relight.cpu_secs);
    let pays_off = way.prepare.cpu_secs / (again_secs - way.relight.cpu_secs);
    let finite = |value: f64| if value.is_finite() { value.into() } else { Cell::Missing };
    vec![
        scene.into(),
        way.name.into(),
        samples.into(),
        shape.rows().into(),
        shape.columns().into(),
        shape.block_side().into(),
        way.bytes.into(),
        way.prepare.secs.into(),
        way.after(1).secs.into(),
        way.after(10).secs.into(),
        way.after(100).secs.into(),
        way.relight.secs.into(),
        finite(way.prepare.cpu_secs),
        finite(way.relight.cpu_secs),
        if way.prepare.secs > 0.0 && pays_off > 0.0 { finite(pays_off) } else { Cell::Missing },
        way.summary.map(|s| s.mean.psnr_linear).into(),
        way.summary.map(|s| s.mean.psnr_clipped).into(),
        way.summary.map(|s| s.mean.flip).into(),
        way.all_on.psnr_linear.into(),
        way.all_on.psnr_clipped.into(),
        way.all_on.flip.into(),
        finite(way.after(100).cpu_secs / (100.0 * again_secs)),
    ]
}

fn ours(bench: &Bench<'_>, wanted: Wanted, lightings: &[Lighting], references: &[LinearImage]) -> Result<Vec<Way>> {
    let (matrix_path, container_path) = (bench.cached("speed.ltm"), bench.cached("speed.ltc"));
    let mut render_options = RenderOptions::default();
    render_options.store.overwrite = true;
    let loaded = bench.loaded(wanted)?;
    let clock = Clock::start();
    pipeline::render(loaded, &matrix_path, &render_options, &bench.silent())?;
    let rendering = clock.stop();
    let matrix = StoreReader::open(&matrix_path)?;
    let mut pack_options = PackOptions { allow_lost_lights: true, denoise: true, ..Default::default() };
    pack_options.container.overwrite = true;
    let clock = Clock::start();
    let packed = pipeline::pack(&matrix, matrix.job(), &container_path, &pack_options, &bench.silent())?;
    let relighter = CpuRelighter::load(&ContainerReader::open(&container_path)?)?;
    let packing = clock.stop();

    let relit =
        |relight: &dyn Fn(&Lighting) -> Result<LinearImage>, times: usize| -> Result<(Took, Vec<LinearImage>)> {
            let images = lightings.iter().map(relight).collect::<Result<Vec<_>>>()?;
            let clock = Clock::start();
            for _ in 0..times {
                lightings.iter().try_for_each(|lighting| relight(lighting).map(drop))?;
            }
            Ok((clock.stop().over(times * lightings.len()), images))
        };
    let way = |name, prepare, bytes, (relight, images): (Took, Vec<LinearImage>)| Way {
        name,
        prepare,
        relight,
        bytes,
        summary: Some(Summary::of(&images, references)),
        all_on: Measured::of(&images[0], &references[0]),
    };
    // The processors' clock ticks a hundred times a second.
    let stored = relit(&|lighting| relighter.relight(lighting), 50)?;
    let raw = relit(&|lighting| Ok(relight_raw(&matrix, std::slice::from_ref(lighting))?.swap_remove(0)), 1)?;
    let mut ways = vec![
        way(STORED, rendering + packing, packed.packed_bytes, stored),
        way(RAW, rendering, matrix.tally()?.stored_bytes, raw),
    ];

    // Packed while it is traced: the raw matrix never exists.
    let fused_path = bench.cached("speed-fused.ltc");
    let clock = Clock::start();
    let (_, fused) = pipeline::render_packed(bench.loaded(wanted)?, &fused_path, &pack_options, &bench.silent())?;
    let relighter = CpuRelighter::load(&ContainerReader::open(&fused_path)?)?;
    let fusing = clock.stop();
    ways.push(way(FUSED, fusing, fused.packed_bytes, relit(&|lighting| relighter.relight(lighting), 50)?));

    // The light as one column: what rendering the scene under this one lighting costs, with nothing stored.
    let single = bench.loaded(Wanted { texels: 1, ..wanted })?;
    let (shape, settings) = (job_of(&single)?.shape, single.settings);
    let settings = TraceSettings {
        samples_per_pixel: settings.samples_per_pixel,
        seed: settings.seed,
        max_depth: settings.max_depth,
    };
    // The tree is not counted, as Mitsuba's is not. Photons are, and are sent once more for that.
    let tracer = Tracer::new(single.scene, shape, settings)?;
    let clock = Clock::start();
    let tracer = tracer.with_settings(settings)?;
    let image = &relight_raw(&tracer, &[Lighting::uniform(shape.columns(), [1.0; 3])?])?[0];
    ways.push(Way::again(AGAIN, clock.stop(), image, &references[0]));
    Ok(ways)
}

/// Variants of Mitsuba that can be asked, with their names in the table; of those that cannot, a line is left in the notes.
fn rivals_there(notes: &mut Vec<String>) -> Vec<(&'static str, &'static str)> {
    let is_there = mitsuba::MITSUBA.is_there();
    if !is_there {
        notes.push("Mitsuba was not compared: no Python with it (`LTM_MITSUBA` names one, else `python3`).".into());
    }
    mitsuba::VARIANTS.into_iter().filter(|_| is_there).collect()
}

/// The scene with everything on, rendered by each variant of Mitsuba; by the first also with the denoiser, where that is at hand.
fn theirs(
    bench: &Bench<'_>,
    wanted: Wanted,
    samples: u32,
    rivals: &[(&'static str, &'static str)],
    (surfaces, all_on): (Option<&Surfaces>, &LinearImage),
) -> Result<Vec<Way>> {
    // One texel: its lighting has one weight, and the light is one shape.
    let mut loaded = bench.loaded(Wanted { texels: 1, ..wanted })?;
    loaded.lighting = Lighting::uniform(loaded.scene.basis.column_count(), [1.0; 3])?;
    let mut ways = Vec::new();
    for &(variant, name) in rivals {
        bench.stop_if_interrupted()?;
        let rendered = mitsuba::render(&loaded, &bench.cached("mitsuba"), variant, &[samples])?.swap_remove(0);
        let rendering = Took { secs: rendered.seconds, cpu_secs: rendered.cpu_seconds };
        ways.push(Way::again(name, rendering, &rendered.image, all_on));
        let Some(surfaces) = surfaces.filter(|_| name == mitsuba::VARIANTS[0].1) else { continue };
        // Twice: the first prepares the denoiser, which is not counted.
        let images = [rendered.image.clone(), rendered.image.clone()];
        let oidn::TimedImages { images: clean, secs, cpu_secs } =
            oidn::denoise_timed(&images, surfaces, &bench.cached("oidn"))?;
        ways.push(Way::again(DENOISED, rendering + Took { secs, cpu_secs }, &clean[0], all_on));
    }
    Ok(ways)
}
