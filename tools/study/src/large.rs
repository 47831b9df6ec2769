//! The jobs larger than memory, end to end: rendered, verified, packed, unpacked, and rendered straight into a container.

use std::fs;
use std::path::Path;
use std::time::Instant;

use super::StudyReport;
use super::bench::{Bench, CONFERENCE, Wanted, file_bytes};
use super::table::{Cell, Table};
use ltm::container::ContainerReader;
use ltm::error::{Error, Result};
use ltm::matrix::MatrixShape;
use ltm::pipeline::{self, PackOptions, PackReport, RenderOptions, UnpackOptions};
use ltm::resources::{PeakMemory, human_bytes};
use ltm::store::StoreReader;

struct Plan {
    size: (u32, u32),
    /// Texels along a side of the panel.
    texels: &'static [u32],
    samples: u32,
    memory_bytes: u64,
}

const QUICK: Plan = Plan { size: (64, 48), texels: &[8], samples: 4, memory_bytes: 256 << 20 };
const FULL: Plan = Plan { size: (1024, 768), texels: &[32, 64], samples: 16, memory_bytes: 1 << 30 };

/// What one stage took.
struct Stage {
    name: &'static str,
    seconds: f64,
    /// Of the file that it made or read.
    file_bytes: u64,
    peak_bytes: Option<u64>,
    packed: Option<PackReport>,
}

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let plan = if bench.quick { &QUICK } else { &FULL };
    let scene = bench.with_conference(&["mixed"]).pop().unwrap_or(CONFERENCE);
    let memory = format!(
        "Each stage within {} of memory. Peak: resident anonymous memory of this process, sampled every 5 ms. GB/s: of the \
matrix as f32. Render --pack makes the same bytes as render and pack. Packing cleans, as it does by default.",
        human_bytes(plan.memory_bytes)
    );
    let mut notes = bench.notes(&[&memory]);
    let mut rows = Vec::new();
    bench.watch.begin("large", plan.texels.len() as u64, "matrices");
    for &texels in plan.texels {
        let wanted = Wanted { scene, size: plan.size, texels, samples: plan.samples, seed: 0, block_side: 32 };
        match stages(bench, wanted, plan.memory_bytes) {
            Ok((shape, stages)) => {
                rows.extend(stages.into_iter().map(|stage| row(scene, plan, shape, stage)));
                bench.watch.advance(1, shape.raw_bytes(), "B");
            }
            // A smaller disk or memory than the larger jobs want is no failure of the study.
            Err(problem @ Error::Resources { .. }) => {
                notes.push(format!("{texels} × {texels} texels left out: {problem}."))
            }
            Err(problem) => return Err(problem),
        }
    }
    bench.watch.end();
    let mut table = Table::new(
        "Matrices larger than memory",
        notes,
        &[
            ("scene", 0),
            ("rows", 0),
            ("columns", 0),
            ("block_px", 0),
            ("samples_per_px", 0),
            ("precision", 0),
            ("raw_bytes", 0),
            ("stage", 0),
            ("stage_secs", 1),
            ("raw_gb_per_s", 2),
            ("file_bytes", 0),
            ("peak_bytes", 0),
            ("allowed_bytes", 0),
            ("mean_rank", 2),
            ("ratio", 0),
            ("relative_l2", 4),
        ],
    );
    rows.into_iter().for_each(|row| table.push(row));
    let mut report = StudyReport::default();
    report.add_table(&bench.out, "large", &table)?;
    Ok(report)
}

fn row(scene: &str, plan: &Plan, shape: MatrixShape, stage: Stage) -> Vec<Cell> {
    let raw = shape.raw_bytes();
    let packed = stage.packed.as_ref();
    vec![
        scene.into(),
        shape.rows().into(),
        shape.columns().into(),
        shape.block_side().into(),
        plan.samples.into(),
        "f32".into(),
        raw.into(),
        stage.name.into(),
        stage.seconds.into(),
        (raw as f64 / stage.seconds / 1e9).into(),
        stage.file_bytes.into(),
        stage.peak_bytes.map(|bytes| bytes as f64).into(),
        plan.memory_bytes.into(),
        packed.map(|p| p.mean_rank).into(),
        packed.map(|p| raw as f64 / p.packed_bytes as f64).into(),
        packed.map(|p| p.relative_l2).into(),
    ]
}

/// Runs the stages one after the other, and removes what they leave.
fn stages(bench: &Bench<'_>, wanted: Wanted, memory_bytes: u64) -> Result<(MatrixShape, Vec<Stage>)> {
    let [matrix, container, again, fused] =
        ["large.ltm", "large.ltc", "large-again.ltm", "large-fused.ltc"].map(|name| bench.cached(name));
    let memory_bytes = Some(memory_bytes);
    let mut render_options = RenderOptions { memory_bytes, ..Default::default() };
    render_options.store.overwrite = true;
    let mut pack_options = PackOptions { allow_lost_lights: true, memory_bytes, denoise: true, ..Default::default() };
    pack_options.container.overwrite = true;
    let unpack_options = UnpackOptions { memory_bytes, overwrite: true, ..Default::default() };
    let mut stages = Vec::new();

    let loaded = bench.loaded(wanted)?;
    stages.push(timed("render", &matrix, || {
        pipeline::render(loaded, &matrix, &render_options, &bench.silent())?;
        Ok(None)
    })?);
    stages.push(timed("verify", &matrix, || {
        pipeline::verify(&matrix, memory_bytes, &bench.silent())?;
        Ok(None)
    })?);
    let shape = StoreReader::open(&matrix)?.job().shape;
    stages.push(timed("pack", &container, || {
        let source = StoreReader::open(&matrix)?;
        pipeline::pack(&source, source.job(), &container, &pack_options, &bench.silent()).map(Some)
    })?);
    remove(&matrix)?;
    stages.push(timed("unpack", &again, || {
        pipeline::unpack_to_store(&ContainerReader::open(&container)?, &again, &unpack_options, &bench.silent())?;
        Ok(None)
    })?);
    remove(&again)?;
    let loaded = bench.loaded(wanted)?;
    stages.push(timed("render --pack", &fused, || {
        Ok(Some(pipeline::render_packed(loaded, &fused, &pack_options, &bench.silent())?.1))
    })?);
    let read = |path: &Path| fs::read(path).map_err(Error::io(path, "read"));
    if read(&container)? != read(&fused)? {
        return Err(Error::input(fused.display().to_string(), "differs from what was stored and packed", "report it"));
    }
    remove(&container)?;
    remove(&fused)?;
    Ok((shape, stages))
}

fn timed(name: &'static str, file: &Path, work: impl FnOnce() -> Result<Option<PackReport>>) -> Result<Stage> {
    let (memory, begun) = (PeakMemory::start(), Instant::now());
    let packed = work()?;
    let seconds = begun.elapsed().as_secs_f64();
    Ok(Stage { name, seconds, file_bytes: file_bytes(file)?, peak_bytes: memory.stop(), packed })
}

fn remove(path: &Path) -> Result<()> {
    fs::remove_file(path).map_err(Error::io(path, "remove"))
}
