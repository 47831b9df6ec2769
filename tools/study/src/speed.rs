//! Speed against error, end to end: from a scene to its first relit image, and from then on image by image.

use std::time::Instant;

use super::bench::{Bench, Wanted};
use super::chart::{Axis, Chart, Line, Panel};
use super::judged::{Judged, LIGHTINGS_NOTE};
use super::measured::{Measured, Summary};
use super::oidn::{self, Surfaces};
use super::table::{Cell, Table};
use super::{StudyReport, mitsuba};
use ltm::container::ContainerReader;
use ltm::error::Result;
use ltm::image::LinearImage;
use ltm::light::Lighting;
use ltm::matrix::{BlockSource, MatrixShape};
use ltm::pipeline::{self, PackOptions, RenderOptions, job_of};
use ltm::relight::{CpuRelighter, relight_raw};
use ltm::store::StoreReader;
use ltm::trace::{TraceSettings, Tracer};

const MITSUBA_NOTE: &str = "Mitsuba 3: the same scene and lighting by its path integrator, on all cores; loading and \
compiling are not counted. With the denoiser: Open Image Denoise on its image, with noise-free albedo and normals, Python and files not counted.";

struct Plan {
    scene: &'static str,
    size: (u32, u32),
    texels: u32,
    samples: &'static [u32],
    converged: u32,
}

const QUICK: Plan = Plan { scene: "mixed", size: (64, 48), texels: 8, samples: &[4, 16], converged: 256 };
const FULL: Plan = Plan { scene: "mixed", size: (256, 192), texels: 32, samples: &[4, 16, 64, 256], converged: 2048 };

const STORED: &str = "ours (stored)";
const FUSED: &str = "ours (fused)";
const RAW: &str = "uncompressed T from disk";
const DENOISED: &str = "Mitsuba 3 (llvm_ad_rgb) and the denoiser";
const AGAIN: &str = "rendering each lighting again";

/// A way to relit images.
struct Way {
    name: &'static str,
    /// From the scene until relighting can begin.
    prepare_secs: f64,
    relight_secs: f64,
    bytes: u64,
    /// Over the twelve lightings; none where only one was made.
    summary: Option<Summary>,
    all_on: Measured,
}

impl Way {
    /// Rendering for one lighting, without any preparation.
    fn again(name: &'static str, seconds: f64, image: &LinearImage, all_on: &LinearImage) -> Self {
        let all_on = Measured::of(image, all_on);
        Self { name, prepare_secs: 0.0, relight_secs: seconds, bytes: 0, summary: None, all_on }
    }
}

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let plan = if bench.quick { &QUICK } else { &FULL };
    let Plan { scene, size, texels, converged, .. } = *plan;
    let note = format!(
        "Errors against a matrix of {converged} samples per pixel and another seed. Prepare: from the scene to when relighting can \
begin. Relight: mean of the lightings, CPU. {AGAIN}: the same tracer with the light as one column, all on, and nothing \
stored; each of the columns by itself would take columns times as long. Pays off: relights from which on preparing has been \
worth it against rendering again at the same samples. {MITSUBA_NOTE}"
    );
    bench.watch.begin("speed", plan.samples.len() as u64, "sample counts");
    let wanted = Wanted { scene, size, texels, samples: converged, seed: 1, block_side: 32 };
    let again_there = rendered_again(bench, wanted, plan.samples)?;
    let mut notes = bench.notes(&[&note, LIGHTINGS_NOTE]);
    notes.extend(again_there.left_out.clone());
    if !oidn::OIDN.is_there() {
        notes.push("The denoiser was not compared: no Python with it (`LTM_OIDN` names one, else `python3`).".into());
    }
    let mut table = Table::new(
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
            ("pays_off_after", 1),
            ("psnr_lin_db", 2),
            ("psnr_clip_db", 2),
            ("all_on_lin_db", 2),
            ("all_on_clip_db", 2),
            ("all_on_flip", 3),
        ],
    );
    let reference = bench.matrix(wanted)?;
    let shape = reference.shape();
    let Judged { lightings, references, .. } = Judged::of(&reference)?;
    let surfaces = if oidn::OIDN.is_there() { Surfaces::of(&reference)? } else { None };
    let mut last = Vec::new();
    let mut error_lines: Vec<Line> = Vec::new();
    for &samples in plan.samples {
        bench.stop_if_interrupted()?;
        let mut ways = ways(bench, Wanted { samples, seed: 0, ..wanted }, &lightings, &references)?;
        ways.extend(again_there.ways(bench, samples, surfaces.as_ref(), &references[0])?);
        let again = ways.iter().find(|way| way.name == AGAIN).map_or(f64::NAN, |way| way.relight_secs);
        for way in &ways {
            table.push(row(scene, samples, shape, way, again));
            let at = (way.prepare_secs + way.relight_secs, way.all_on.psnr_clipped);
            match error_lines.iter_mut().find(|line| line.name == way.name) {
                Some(line) => line.points.push(at),
                None => error_lines.push(Line { name: way.name.into(), points: vec![at] }),
            }
        }
        bench.watch.advance(1, shape.raw_bytes(), "B");
        last = ways;
    }
    bench.watch.end();
    let counts = (0..=16).map(|i| 10f64.powf(f64::from(i) * 0.25).round());
    let totals = last.iter().map(|way| Line {
        name: way.name.into(),
        points: counts.clone().map(|n| (n, way.prepare_secs + n * way.relight_secs)).collect(),
    });
    let most = plan.samples.last().copied().unwrap_or(0);
    let charts = [
        Chart {
            title: format!("Seconds for a number of relit images, {scene}, {most} spp"),
            caption: bench.caption(&format!("{} × {}, CPU; from measured parts", shape.rows(), shape.columns())),
            x: Axis::logarithmic("relit images"),
            y: Axis::logarithmic("seconds in all"),
            panels: vec![Panel { title: String::new(), lines: totals.collect() }],
        },
        Chart {
            title: format!("Error of the first image (all on) against seconds to it, {scene}"),
            caption: bench.caption(&format!("{} × {}, {:?} spp", shape.rows(), shape.columns(), plan.samples)),
            x: Axis::logarithmic("seconds from the scene to the first image"),
            y: Axis::linear("PSNR clip (dB)"),
            panels: vec![Panel { title: String::new(), lines: error_lines }],
        },
    ];
    let mut report = StudyReport::default();
    report.add_table(&bench.out, "speed", &table)?;
    for (chart, stem) in charts.iter().zip(["speed-total", "speed-error"]) {
        report.add_chart(&bench.out, stem, chart)?;
    }
    Ok(report)
}

fn row(scene: &str, samples: u32, shape: MatrixShape, way: &Way, again: f64) -> Vec<Cell> {
    let pays_off = way.prepare_secs / (again - way.relight_secs);
    vec![
        scene.into(),
        way.name.into(),
        samples.into(),
        shape.rows().into(),
        shape.columns().into(),
        shape.block_side().into(),
        way.bytes.into(),
        way.prepare_secs.into(),
        (way.prepare_secs + way.relight_secs).into(),
        (way.prepare_secs + 10.0 * way.relight_secs).into(),
        (way.prepare_secs + 100.0 * way.relight_secs).into(),
        way.relight_secs.into(),
        if way.prepare_secs > 0.0 && pays_off > 0.0 { pays_off.into() } else { Cell::Missing },
        way.summary.map(|s| s.mean.psnr_linear).into(),
        way.summary.map(|s| s.mean.psnr_clipped).into(),
        way.all_on.psnr_linear.into(),
        way.all_on.psnr_clipped.into(),
        way.all_on.flip.into(),
    ]
}

fn ways(bench: &Bench<'_>, wanted: Wanted, lightings: &[Lighting], references: &[LinearImage]) -> Result<Vec<Way>> {
    let (matrix_path, container_path) = (bench.cached("speed.ltm"), bench.cached("speed.ltc"));
    let mut render_options = RenderOptions::default();
    render_options.store.overwrite = true;
    let loaded = bench.loaded(wanted)?;
    let begun = Instant::now();
    pipeline::render(loaded, &matrix_path, &render_options, &bench.silent())?;
    let render_secs = begun.elapsed().as_secs_f64();
    let matrix = StoreReader::open(&matrix_path)?;
    let mut pack_options = PackOptions { denoise: true, ..Default::default() };
    pack_options.container.overwrite = true;
    let begun = Instant::now();
    let packed = pipeline::pack(&matrix, matrix.job(), &container_path, &pack_options, &bench.silent())?;
    let relighter = CpuRelighter::load(&ContainerReader::open(&container_path)?)?;
    let pack_secs = begun.elapsed().as_secs_f64();

    let relit = |relight: &dyn Fn(&Lighting) -> Result<LinearImage>| -> Result<(f64, Vec<LinearImage>)> {
        let begun = Instant::now();
        let images = lightings.iter().map(relight).collect::<Result<Vec<_>>>()?;
        Ok((begun.elapsed().as_secs_f64() / lightings.len() as f64, images))
    };
    let way = |name, prepare_secs, bytes, (relight_secs, images): (f64, Vec<LinearImage>)| Way {
        name,
        prepare_secs,
        relight_secs,
        bytes,
        summary: Some(Summary::of(&images, references)),
        all_on: Measured::of(&images[0], &references[0]),
    };
    let stored = relit(&|lighting| relighter.relight(lighting))?;
    let raw = relit(&|lighting| Ok(relight_raw(&matrix, std::slice::from_ref(lighting))?.swap_remove(0)))?;
    let mut ways = vec![
        way(STORED, render_secs + pack_secs, packed.packed_bytes, stored),
        way(RAW, render_secs, matrix.tally()?.stored_bytes, raw),
    ];

    // Packed while it is traced: the raw matrix never exists.
    let fused_path = bench.cached("speed-fused.ltc");
    let begun = Instant::now();
    let (_, fused) = pipeline::render_packed(bench.loaded(wanted)?, &fused_path, &pack_options, &bench.silent())?;
    let relighter = CpuRelighter::load(&ContainerReader::open(&fused_path)?)?;
    let fused_secs = begun.elapsed().as_secs_f64();
    ways.push(way(FUSED, fused_secs, fused.packed_bytes, relit(&|lighting| relighter.relight(lighting))?));

    // The light as one column: what rendering the scene under this one lighting costs, with nothing stored.
    let single = bench.loaded(Wanted { texels: 1, ..wanted })?;
    let (shape, settings) = (job_of(&single)?.shape, single.settings);
    let begun = Instant::now();
    let settings = TraceSettings {
        samples_per_pixel: settings.samples_per_pixel,
        seed: settings.seed,
        max_depth: settings.max_depth,
    };
    let tracer = Tracer::new(single.scene, shape, settings)?;
    let image = &relight_raw(&tracer, &[Lighting::uniform(shape.columns(), [1.0; 3])?])?[0];
    let again_secs = begun.elapsed().as_secs_f64();
    ways.push(Way::again(AGAIN, again_secs, image, &references[0]));
    Ok(ways)
}

/// What Mitsuba rendered.
#[derive(Default)]
struct RenderedAgain {
    /// With the name of the variant.
    images: Vec<(&'static str, mitsuba::Rendered)>,
    /// A line for each variant that is left out.
    left_out: Vec<String>,
}

impl RenderedAgain {
    /// What it takes with a number of samples; of the fastest variant also with the denoiser, where that is at hand.
    fn ways(
        &self,
        bench: &Bench<'_>,
        samples: u32,
        surfaces: Option<&Surfaces>,
        all_on: &LinearImage,
    ) -> Result<Vec<Way>> {
        let mut ways = Vec::new();
        for (name, rendered) in self.images.iter().filter(|(_, rendered)| rendered.samples == samples) {
            ways.push(Way::again(name, rendered.seconds, &rendered.image, all_on));
            let Some(surfaces) = surfaces.filter(|_| *name == mitsuba::VARIANTS[0].1) else { continue };
            // Twice: the first prepares the denoiser, which is not counted.
            let images = [rendered.image.clone(), rendered.image.clone()];
            let (clean, seconds) = oidn::denoise_timed(&images, surfaces, &bench.cached("oidn"))?;
            ways.push(Way::again(DENOISED, rendered.seconds + seconds, &clean[0], all_on));
        }
        Ok(ways)
    }
}

/// The scene with everything on, rendered by each variant of Mitsuba with each number of samples.
fn rendered_again(bench: &Bench<'_>, wanted: Wanted, samples: &[u32]) -> Result<RenderedAgain> {
    let mut again = RenderedAgain::default();
    if !mitsuba::MITSUBA.is_there() {
        let how = "Mitsuba was not compared: no Python with it (`LTM_MITSUBA` names one, else `python3`).";
        again.left_out.push(how.to_owned());
        return Ok(again);
    }
    // One texel: its lighting has one weight, and the light is one shape.
    let mut loaded = bench.loaded(Wanted { texels: 1, ..wanted })?;
    loaded.lighting = Lighting::uniform(loaded.scene.basis.column_count(), [1.0; 3])?;
    for (variant, name) in mitsuba::VARIANTS {
        bench.stop_if_interrupted()?;
        match mitsuba::render(&loaded, &bench.cached("mitsuba"), variant, samples) {
            Ok(rendered) => again.images.extend(rendered.into_iter().map(|image| (name, image))),
            Err(problem) => again.left_out.push(format!("{name} left out: {problem}.")),
        }
    }
    Ok(again)
}
