//! The demonstration: a room rendered in rounds, packed, relit under a few lightings, and one table of what it cost and what it lost.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::resources::{PeakMemory, Progress, human_bytes};

use super::{PackOptions, PackReport, RelightOptions, Relighter};
use crate::container::ContainerReader;
use crate::error::{Error, Result};
use crate::image::{self, LinearImage};
use crate::light::{LightBasis, LightKind, Lighting, light_errors_lines};
use crate::matrix::MatrixShape;
use crate::scene::LoadedScene;

/// A first whole picture has one of so many of the samples.
const SAMPLES_OVER_FIRST: u32 = 4;
/// Fewest samples per pixel of it: two, since its halves tell the noise.
const FEWEST_SAMPLES: u32 = 2;
/// Names of the container, and of the picture that each round replaces.
const CONTAINER: &str = "demo.ltc";
const PICTURE: &str = "all-on";

/// Result of the demonstration; displays as its closing table.
#[derive(Clone, Debug)]
pub struct DemoReport {
    /// The container of the last round.
    pub container: PathBuf,
    stages: Vec<DemoStage>,
    shape: MatrixShape,
    samples_per_pixel: u32,
    pack: PackReport,
    errors: [String; 2],
    relit_by: String,
    lightings: usize,
}

#[derive(Clone, Debug)]
struct DemoStage {
    name: String,
    seconds: f64,
    /// Since the beginning.
    shown_after: f64,
    peak_memory_bytes: Option<u64>,
    bytes: u64,
}

/// Renders `loaded` in rounds into `folder`: a small first image, then the whole picture with few samples, then with all of them,
/// each packed as `demo.ltc` and shown as `all-on.png`. Then relights the last under a few lightings, and writes an EXR and a PNG of each.
///
/// # Errors
/// Those of the stages; an existing `demo.ltc` is replaced.
pub fn demo(loaded: LoadedScene, folder: &Path, watch: &dyn Progress) -> Result<DemoReport> {
    std::fs::create_dir_all(folder).map_err(Error::io(folder, "create the folder"))?;
    let begun = Instant::now();
    let (container_path, picture_path) = (folder.join(CONTAINER), folder.join(format!("{PICTURE}.png")));
    let samples_per_pixel = loaded.settings.samples_per_pixel;
    let mut stages = Vec::new();

    let memory = PeakMemory::start();
    let first = super::preview(&loaded, &picture_path, watch)?;
    watch.note(&format!("{}: a first, small image after {:.1} s", picture_path.display(), first.first_secs));
    stages.push(DemoStage {
        name: "first image".into(),
        seconds: first.seconds,
        shown_after: first.first_secs,
        peak_memory_bytes: memory.stop(),
        bytes: 0,
    });

    let mut one_round = |samples: u32| -> Result<PackReport> {
        let round = Instant::now();
        let mut loaded = loaded.clone();
        loaded.settings.samples_per_pixel = samples;
        let mut options = PackOptions { denoise: true, ..PackOptions::default() };
        options.container.overwrite = true;
        let (_, report) = super::render_packed(loaded, &container_path, &options, watch)?;
        let container = ContainerReader::open(&container_path)?;
        let relighter = Relighter::open(&container, RelightOptions::default(), watch)?;
        let picture = relighter.relight(&Lighting::of_scene(&container.job().basis))?;
        image::write_png(&picture_path, &picture, 0.9)?;
        let shown_after = begun.elapsed().as_secs_f64();
        watch.note(&format!("{}: {samples} samples per pixel, after {shown_after:.1} s", picture_path.display()));
        stages.push(DemoStage {
            name: format!("{samples} samples"),
            seconds: round.elapsed().as_secs_f64(),
            shown_after,
            peak_memory_bytes: report.peak_memory_bytes,
            bytes: report.packed_bytes,
        });
        Ok(report)
    };
    if let Some(samples) = samples_of_first_round(samples_per_pixel) {
        one_round(samples)?;
    }
    let pack = one_round(samples_per_pixel)?;

    let relight = Instant::now();
    let memory = PeakMemory::start();
    let container = ContainerReader::open(&container_path)?;
    let basis = &container.job().basis;
    let named = demo_lightings(basis)?;
    let lightings: Vec<Lighting> = named.iter().map(|(_, lighting)| lighting.clone()).collect();
    let (images, relit_by) = super::relight(&container, &lightings, RelightOptions::default(), watch)?;
    for ((name, _), image) in named.iter().zip(&images) {
        write_images(folder, name, image)?;
    }
    stages.push(DemoStage {
        name: format!("{} lightings", named.len()),
        seconds: relight.elapsed().as_secs_f64(),
        shown_after: begun.elapsed().as_secs_f64(),
        peak_memory_bytes: memory.stop(),
        bytes: 0,
    });
    Ok(DemoReport {
        stages,
        shape: container.job().shape,
        samples_per_pixel,
        errors: light_errors_lines(&pack.lights, basis),
        pack,
        relit_by,
        lightings: named.len(),
        container: container_path,
    })
}

/// The samples per pixel of the round before the one that has all; none where that is too few.
fn samples_of_first_round(samples_per_pixel: u32) -> Option<u32> {
    Some(samples_per_pixel / SAMPLES_OVER_FIRST).filter(|&samples| samples >= FEWEST_SAMPLES)
}

fn write_images(folder: &Path, name: &str, image: &LinearImage) -> Result<()> {
    let path = |extension: &str| -> PathBuf { folder.join(format!("{name}.{extension}")) };
    image::write_exr(&path("exr"), image)?;
    image::write_png(&path("png"), image, 0.9)
}

/// The demonstration's lightings: all on; sky and sun alone; lamps alone; rings painted on the panel.
fn demo_lightings(basis: &LightBasis) -> Result<Vec<(&'static str, Lighting)>> {
    let scene = Lighting::of_scene(basis);
    let of_kinds = |name: &'static str, keeps: &dyn Fn(LightKind) -> bool| -> Result<(&'static str, Lighting)> {
        let dark = basis.lights().iter().filter(|light| !keeps(light.kind));
        let lighting = dark.map(|light| light.name.as_str()).try_fold(scene.clone(), |l, name| l.with(name, 0.0))?;
        Ok((name, lighting))
    };
    let is_sky = |kind: LightKind| kind.is_daylight() || kind == LightKind::Sun;
    let is_panel = |kind| matches!(kind, LightKind::AreaTexels { .. });
    let mut named = vec![(PICTURE, scene.clone())];
    named.push(of_kinds("day", &is_sky)?);
    named.push(of_kinds("evening", &|kind| !is_sky(kind) && !is_panel(kind))?);
    named.push(("painted-panel", painted_panel(basis)?));
    Ok(named)
}

/// Rings of two colours on the first light of several texels that is no sky; the others are off.
fn painted_panel(basis: &LightBasis) -> Result<Lighting> {
    let panel = basis.lights().iter().find(|light| matches!(light.kind, LightKind::AreaTexels { .. }));
    let hint = "give it one";
    let panel = panel
        .ok_or_else(|| Error::input("the demonstration", "the scene has no area light of several texels", hint))?;
    let (warm, cool) = ([1.0, 0.62, 0.28], [0.25, 0.5, 1.0]);
    let (across, down) = panel.layout();
    let mut weights = vec![[0.0; 3]; basis.column_count()];
    for (index, column) in panel.columns().enumerate() {
        let (i, j) = (index as u32 % across, index as u32 / across);
        let place = ((i as f32 + 0.5) / across as f32, (j as f32 + 0.5) / down as f32);
        let ring = ((place.0 - 0.5).hypot(place.1 - 0.5) * 5.0) as u32;
        let colour: [f32; 3] = if ring.is_multiple_of(2) { warm } else { cool };
        weights[column as usize] = std::array::from_fn(|channel| panel.emission[channel] * colour[channel]);
    }
    Lighting::new(weights)
}

impl fmt::Display for DemoReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<16} {:>8} {:>11} {:>13} {:>12}", "stage", "seconds", "shown after", "peak memory", "written")?;
        for stage in &self.stages {
            let memory = stage.peak_memory_bytes.map_or("unknown".to_owned(), human_bytes);
            let written = if stage.bytes > 0 { human_bytes(stage.bytes) } else { "-".to_owned() };
            let DemoStage { name, seconds, shown_after, .. } = stage;
            writeln!(f, "{name:<16} {seconds:>8.2} {shown_after:>11.2} {memory:>13} {written:>12}")?;
        }
        let (shape, pack) = (self.shape, &self.pack);
        writeln!(
            f,
            "\nmatrix: {} rows × {} columns, {} samples per pixel, {} in f32, never stored",
            shape.rows(),
            shape.columns(),
            self.samples_per_pixel,
            human_bytes(pack.raw_bytes),
        )?;
        writeln!(
            f,
            "packed: {}, ratio {:.0}× (mean rank {:.2}, block {side}×{side}, {} sparse entries)",
            human_bytes(pack.packed_bytes),
            pack.raw_bytes as f64 / pack.packed_bytes as f64,
            pack.mean_rank,
            pack.sparse_entries,
            side = shape.block_side(),
        )?;
        self.errors.iter().try_for_each(|line| writeln!(f, "{line}"))?;
        write!(f, "relit under {} lightings by: {}", self.lightings, self.relit_by)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_grow_to_all_samples() {
        assert_eq!(samples_of_first_round(16), Some(4));
        assert_eq!(samples_of_first_round(8), Some(2));
        assert_eq!(samples_of_first_round(4), None);
        assert_eq!(samples_of_first_round(1), None);
    }
}
