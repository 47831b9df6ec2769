//! The demonstration: the embedded room through every stage, and one table of what it cost and what it lost.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::resources::{PeakMemory, Progress, human_bytes};

use super::{PackOptions, PackReport, RelightOptions, RenderOptions};
use crate::container::ContainerReader;
use crate::error::{Error, Result};
use crate::image::{self, ImageError, LinearImage};
use crate::light::{Light, LightBasis, Lighting};
use crate::matrix::MatrixShape;
use crate::relight::relight_raw;
use crate::scene::LoadedScene;
use crate::store::StoreReader;

/// Positions of the moving spot.
const SPOT_FRAMES: usize = 4;

/// Result of the demonstration; displays as its closing table.
#[derive(Clone, Debug)]
pub struct DemoReport {
    stages: Vec<DemoStage>,
    lightings: Vec<(String, ImageError)>,
    shape: MatrixShape,
    samples_per_pixel: u32,
    pack: PackReport,
    relit_by: String,
}

#[derive(Clone, Debug)]
struct DemoStage {
    name: &'static str,
    seconds: f64,
    peak_memory_bytes: Option<u64>,
    bytes: u64,
}

/// Renders `loaded` into `folder/demo.ltm`, packs it to `folder/demo.ltc`, relights it under four lightings, and writes
/// an EXR and a PNG of each.
///
/// # Errors
/// Those of the stages; an existing `demo.ltm` or `demo.ltc` is replaced.
pub fn demo(loaded: LoadedScene, folder: &Path, watch: &dyn Progress) -> Result<DemoReport> {
    std::fs::create_dir_all(folder).map_err(Error::io(folder, "create the folder"))?;
    let (matrix_path, container_path) = (folder.join("demo.ltm"), folder.join("demo.ltc"));
    let mut render_options = RenderOptions::default();
    render_options.store.overwrite = true;
    let samples_per_pixel = loaded.settings.samples_per_pixel;
    let render = super::render(loaded, &matrix_path, &render_options, watch)?;

    let matrix = StoreReader::open(&matrix_path)?;
    let mut pack_options = PackOptions { denoise: true, ..PackOptions::default() };
    pack_options.container.overwrite = true;
    let pack = super::pack(&matrix, matrix.job(), &container_path, &pack_options, watch)?;

    let begun = Instant::now();
    let memory = PeakMemory::start();
    let (names, lightings) = demo_lightings(&matrix.job().basis)?;
    let container = ContainerReader::open(&container_path)?;
    let (images, relit_by) = super::relight(&container, &lightings, RelightOptions::default(), watch)?;
    for (name, image) in names.iter().zip(&images) {
        write_images(folder, name, image)?;
    }
    let relight = (begun.elapsed().as_secs_f64(), memory.stop());

    let begun = Instant::now();
    let memory = PeakMemory::start();
    let references = relight_raw(&matrix, &lightings)?;
    let compare = (begun.elapsed().as_secs_f64(), memory.stop());
    let errors = images.iter().zip(&references).map(|(image, reference)| image::compare(image, reference));
    let stage = |name, seconds, peak_memory_bytes, bytes| DemoStage { name, seconds, peak_memory_bytes, bytes };
    Ok(DemoReport {
        stages: vec![
            stage("render", render.seconds, render.peak_memory_bytes, matrix.tally()?.stored_bytes),
            stage("pack", pack.seconds, pack.peak_memory_bytes, pack.packed_bytes),
            stage("relight", relight.0, relight.1, 0),
            stage("raw product", compare.0, compare.1, 0),
        ],
        lightings: names.into_iter().zip(errors).collect(),
        shape: matrix.job().shape,
        samples_per_pixel,
        pack,
        relit_by,
    })
}

fn write_images(folder: &Path, name: &str, image: &LinearImage) -> Result<()> {
    let path = |extension: &str| -> PathBuf { folder.join(format!("{name}.{extension}")) };
    image::write_exr(&path("exr"), image)?;
    image::write_png(&path("png"), image, 0.9)
}

/// The demonstration's lightings of the first texelled light: all on; one warm corner; a painted pattern; a spot that
/// moves, in [`SPOT_FRAMES`] positions. Other lights stay off, but in "all on".
fn demo_lightings(basis: &LightBasis) -> Result<(Vec<String>, Vec<Lighting>)> {
    let panel = basis
        .lights()
        .iter()
        .find(|light| light.places.len() > 1)
        .ok_or_else(|| Error::input("the demonstration", "the scene has no texelled light", "give it one"))?;
    let emission = panel.emission;
    let tinted = |rgb: [f32; 3], strength: f32| -> [f32; 3] {
        std::array::from_fn(|channel| emission[channel] * rgb[channel] * strength)
    };
    let (warm, cool) = ([1.0, 0.62, 0.28], [0.35, 0.6, 1.0]);
    let mut named = vec![("all-on".to_owned(), Lighting::of_scene(basis))];
    named.push((
        "warm-corner".to_owned(),
        paint(basis, panel, |u, v| if u < 0.3 && v < 0.3 { tinted(warm, 6.0) } else { [0.0; 3] })?,
    ));
    named.push((
        "pattern".to_owned(),
        paint(basis, panel, |u, v| {
            let ring = ((u - 0.5).hypot(v - 0.5) * 5.0) as u32;
            tinted(if ring.is_multiple_of(2) { warm } else { cool }, if ring < 3 { 1.5 } else { 0.6 })
        })?,
    ));
    for frame in 0..SPOT_FRAMES {
        let angle = std::f32::consts::TAU * frame as f32 / SPOT_FRAMES as f32;
        let (x, y) = (0.5 + 0.35 * angle.cos(), 0.5 + 0.35 * angle.sin());
        let spot = paint(basis, panel, |u, v| {
            let distance = (u - x).hypot(v - y);
            tinted([1.0; 3], if distance < 0.09 { 20.0 } else { 0.0 })
        })?;
        named.push((format!("moving-spot-{}", frame + 1), spot));
    }
    Ok(named.into_iter().unzip())
}

/// A lighting that paints one texelled light by its (u, v), texel centres in [0, 1]², and leaves the others off.
fn paint(basis: &LightBasis, panel: &Light, colour: impl Fn(f32, f32) -> [f32; 3]) -> Result<Lighting> {
    let (across, down) = panel.layout();
    let mut weights = vec![[0.0; 3]; basis.column_count()];
    for (index, column) in panel.columns().enumerate() {
        let (i, j) = (index as u32 % across, index as u32 / across);
        weights[column as usize] = colour((i as f32 + 0.5) / across as f32, (j as f32 + 0.5) / down as f32);
    }
    Lighting::new(weights)
}

impl fmt::Display for DemoReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<16} {:>8} {:>13} {:>12}", "stage", "seconds", "peak memory", "written")?;
        for stage in &self.stages {
            let memory = stage.peak_memory_bytes.map_or("unknown".to_owned(), human_bytes);
            let written = if stage.bytes > 0 { human_bytes(stage.bytes) } else { "-".to_owned() };
            writeln!(f, "{:<16} {:>8.2} {:>13} {:>12}", stage.name, stage.seconds, memory, written)?;
        }
        let (shape, pack) = (self.shape, &self.pack);
        writeln!(
            f,
            "\nmatrix: {} rows × {} columns, {} samples per pixel, f32, {} raw",
            shape.rows(),
            shape.columns(),
            self.samples_per_pixel,
            human_bytes(pack.raw_bytes),
        )?;
        writeln!(
            f,
            "packed: {}, ratio {:.0}× (mean rank {:.2}, block {side}×{side}, quantised, {} sparse entries), \
             matrix error {:.4} relative L2",
            human_bytes(pack.packed_bytes),
            pack.raw_bytes as f64 / pack.packed_bytes as f64,
            pack.mean_rank,
            pack.sparse_entries,
            pack.relative_l2,
            side = shape.block_side(),
        )?;
        writeln!(f, "relit by: {}\n", self.relit_by)?;
        writeln!(
            f,
            "{:<16} {:>11} {:>10} {:>12} {:>11}",
            "lighting", "relative L2", "PSNR (dB)", "at peak", "clip (dB)"
        )?;
        for (name, error) in &self.lightings {
            writeln!(
                f,
                "{:<16} {:>11.5} {:>10.1} {:>12.3} {:>11.1}",
                name, error.relative_l2, error.psnr_linear, error.peak, error.psnr_clipped
            )?;
        }
        write!(
            f,
            "(packed image against the raw matrix's. PSNR: peak = the raw image's largest value. clip: exposed so that \
             the raw image's\n 95th luminance percentile is 1, clipped to [0, 1], peak 1.)"
        )
    }
}
