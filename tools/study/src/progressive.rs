//! When a scene can be mixed: seconds from its file to each estimate of a progressive render, and what the early ones cost.

use std::time::Instant;

use super::StudyReport;
use super::bench::{Bench, CLASSROOM, CONFERENCE_LAMPS, Wanted};
use super::reference::alone;
use super::table::{Cell, Table};
use super::timing::Clock;
use super::visual_metrics::Seen;
use ltm::container::ContainerReader;
use ltm::error::Result;
use ltm::files::write_file;
use ltm::image::LinearImage;
use ltm::light::Lighting;
use ltm::pipeline::{self, PackOptions, ProgressiveRender, RelightOptions};
use ltm::relight::relight_raw;
use ltm::scene::LoadedScene;

/// A scene, its size, and the light that is seen alone.
struct Room {
    scene: &'static str,
    size: (u32, u32),
    light: &'static str,
    texels: u32,
    is_file: bool,
}

struct Plan {
    rooms: &'static [Room],
    samples: u32,
    /// Samples of the references.
    converged: u32,
}

const FULL: Plan = Plan {
    rooms: &[
        Room { scene: "mixed", size: (640, 480), light: "ceiling", texels: 16, is_file: false },
        Room { scene: CLASSROOM, size: (640, 480), light: "unnamed_L001", texels: 1, is_file: true },
        Room { scene: CONFERENCE_LAMPS, size: (1024, 768), light: "lum_06", texels: 1, is_file: true },
    ],
    samples: 64,
    converged: 256,
};

const QUICK: Plan = Plan {
    rooms: &[Room { scene: "mixed", size: (168, 96), light: "ceiling", texels: 4, is_file: false }],
    samples: 24,
    converged: 32,
};

const NOTE: &str = "Seconds by the clock, from before the scene's file is read; cpu: processors' seconds of all threads. Each estimate holds all \
lights, cleaned and packed, and is relit here under one light alone. ꟻLIP as `ltm study picture` has it, of the estimate brought to the full \
size bilinearly, against a matrix of another seed, of scene files one with that light alone. offline: `ltm render --pack` of the same settings, by \
processors' seconds, its own loading included.";

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let plan = if bench.quick { &QUICK } else { &FULL };
    let mut table = Table::new(
        "From a scene to pictures that can be mixed",
        bench.notes(&[NOTE]),
        &[
            ("scene", 0),
            ("columns", 0),
            ("width", 0),
            ("height", 0),
            ("samples_per_px", 0),
            ("is_final", 0),
            ("secs", 2),
            ("cpu_secs", 2),
            ("stated_error", 4),
            ("flip", 4),
            ("cpu_over_offline", 3),
        ],
    );
    let mut report = StudyReport::default();
    let rooms: Vec<&Room> = plan.rooms.iter().filter(|room| bench.has(room.scene)).collect();
    if rooms.len() < plan.rooms.len() {
        bench.watch.note("progressive: files of some scenes are not there (LTM_SCENES), these were not measured");
    }
    bench.watch.begin("progressive", rooms.len() as u64, "scenes");
    for room in rooms {
        measure(bench, plan, room, &mut table)?;
        bench.watch.advance(1, 0, "B");
    }
    bench.watch.end();
    report.add_table(&bench.out, "progressive", &table)?;
    Ok(report)
}

fn measure(bench: &Bench<'_>, plan: &Plan, room: &Room, table: &mut Table) -> Result<()> {
    let Room { scene, size, light, texels, .. } = *room;
    let wanted = |samples, seed| Wanted { scene, size, texels, samples, seed, block_side: 32 };
    // Of a scene file, a matrix of that light alone, so that it gets all samples.
    let reference = match room.is_file {
        true => bench.matrix_alone(wanted(plan.converged, 1), light)?,
        false => bench.matrix(wanted(plan.converged, 1))?,
    };
    let truth = relight_raw(&reference, &[alone(reference.job(), light)?])?.remove(0);
    drop(reference);
    let options = || {
        let mut options = PackOptions { denoise: true, ..PackOptions::default() };
        options.container.overwrite = true;
        options
    };
    let load = || -> Result<LoadedScene> { bench.loaded(wanted(plan.samples, 0)) };
    let offline = bench.cached(&format!("{scene}-offline.ltc"));
    let clock = Clock::start();
    pipeline::render_packed(load()?, &offline, &options(), &bench.silent())?;
    let offline_took = clock.stop();

    let path = bench.cached(&format!("{scene}-live.ltc"));
    // What an earlier study has left would be the first estimate.
    let _ = std::fs::remove_file(pipeline::early_path(&path));
    let (begun, clock) = (Instant::now(), Clock::start());
    let mut render = ProgressiveRender::begin(load()?, &path, options(), &bench.silent())?;
    let mut measuring = (0.0, 0.0);
    while let Some(estimate) = render.next_estimate(&bench.silent())? {
        let (secs, cpu_secs) = (begun.elapsed().as_secs_f64() - measuring.0, clock.stop().cpu_secs - measuring.1);
        let container = ContainerReader::open(&estimate.path)?;
        let lighting: Lighting = alone(container.job(), light)?;
        let (images, _) = pipeline::relight(&container, &[lighting], RelightOptions::default(), &bench.silent())?;
        let seen = Seen::of(&resized(&images[0], truth.width, truth.height), &truth, &truth, 32);
        table.push(vec![
            scene.into(),
            container.job().shape.columns().into(),
            estimate.stage.width.into(),
            estimate.stage.height.into(),
            estimate.stage.samples_per_pixel.into(),
            estimate.is_final.into(),
            secs.into(),
            cpu_secs.into(),
            estimate.error.into(),
            seen.flip.into(),
            if estimate.is_final { (cpu_secs / offline_took.cpu_secs).into() } else { Cell::Missing },
        ]);
        measuring = (begun.elapsed().as_secs_f64() - secs, clock.stop().cpu_secs - cpu_secs);
    }
    let same = std::fs::read(&offline).ok() == std::fs::read(&path).ok();
    if !same {
        bench.watch.note(&format!("progressive: {scene}: the last estimate is not the offline container"));
    }
    write_file(&bench.cached(&format!("{scene}-live.txt")), true, format!("the same bytes: {same}\n").as_bytes())
}

/// An image in other pixels, bilinearly between the middles of its own, as a window shows it.
fn resized(image: &LinearImage, width: u32, height: u32) -> LinearImage {
    if (image.width, image.height) == (width, height) {
        return image.clone();
    }
    let place = |at: u32, of: u32, own: u32| {
        let position = ((at as f32 + 0.5) * own as f32 / of as f32 - 0.5).clamp(0.0, own as f32 - 1.0);
        let first = position as u32;
        (first, (first + 1).min(own - 1), position - first as f32)
    };
    let value = |x: u32, y: u32| image.pixels[y as usize * image.width as usize + x as usize];
    let pixel = |at: u32| {
        let (x, y) = (place(at % width, width, image.width), place(at / width, height, image.height));
        let mix = |a: [f32; 3], b: [f32; 3], t: f32| [0, 1, 2].map(|ch| a[ch] + t * (b[ch] - a[ch]));
        mix(mix(value(x.0, y.0), value(x.1, y.0), x.2), mix(value(x.0, y.1), value(x.1, y.1), x.2), y.2)
    };
    LinearImage { width, height, pixels: (0..width * height).map(pixel).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_enlarged_image_keeps_its_ramp() {
        let image = LinearImage { width: 4, height: 1, pixels: (0..4).map(|x| [x as f32; 3]).collect() };
        let large = resized(&image, 8, 2);
        let row: Vec<f32> = large.pixels[..8].iter().map(|pixel| pixel[0]).collect();
        assert_eq!(row, [0.0, 0.25, 0.75, 1.25, 1.75, 2.25, 2.75, 3.0]);
        assert_eq!(resized(&image, 4, 1), image);
    }
}
