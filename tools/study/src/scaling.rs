//! How time and memory grow with the image, the columns, the triangles and the rank.

use std::collections::HashMap;
use std::time::Instant;

use super::StudyReport;
use super::bench::{Bench, Wanted};
use super::chart::{Axis, Chart, Line, Panel};
use super::curve;
use super::table::{Cell, Table};
use ltm::compress::{CompressSettings, Target};
use ltm::container::ContainerReader;
use ltm::error::{Error, Result};
use ltm::light::Lighting;
use ltm::matrix::BlockSource;
use ltm::pipeline::{self, PackOptions, RenderOptions};
use ltm::relight::CpuRelighter;
use ltm::scene::{LoadedScene, Mesh, Vertex, content_hash};
use ltm::store::StoreReader;

/// Relights that a time is the mean of.
const RELIGHTS: usize = 10;
/// Seconds after which a size is not run again.
const LONG_SECS: f64 = 30.0;

struct Plan {
    /// Runs of each size, of which the least times are told.
    runs: usize,
    samples: u32,
    /// Images with 256 columns.
    sizes: &'static [(u32, u32)],
    /// Texels along a side, at the smallest image but one.
    texels: &'static [u32],
    /// Times that every triangle is cut into four, at the smallest image.
    levels: &'static [u32],
    ranks: &'static [usize],
}

const QUICK: Plan =
    Plan { runs: 1, samples: 4, sizes: &[(32, 32), (64, 64)], texels: &[4, 8], levels: &[0, 1], ranks: &[4, 8] };

const FULL: Plan = Plan {
    runs: 3,
    samples: 16,
    sizes: &[(96, 64), (192, 128), (384, 256), (768, 512), (1536, 1024)],
    texels: &[8, 16, 32, 64, 128],
    levels: &[0, 1, 2, 3],
    ranks: &[4, 8, 16, 32, 64],
};

/// What is read off a size.
type Read<T> = fn(&Taken) -> T;

/// What one size took.
struct Taken {
    varied: &'static str,
    value: f64,
    rows: u64,
    columns: usize,
    triangles: usize,
    rank: usize,
    mean_rank: f64,
    raw_bytes: u64,
    render_secs: f64,
    pack_secs: f64,
    relight_secs: f64,
    render_peak: Option<u64>,
    pack_peak: Option<u64>,
    relative_l2: f64,
}

impl Taken {
    /// The least times of two runs of the same size, and the larger peaks.
    fn with(self, other: Self) -> Self {
        Self {
            render_secs: self.render_secs.min(other.render_secs),
            pack_secs: self.pack_secs.min(other.pack_secs),
            relight_secs: self.relight_secs.min(other.relight_secs),
            render_peak: self.render_peak.max(other.render_peak),
            pack_peak: self.pack_peak.max(other.pack_peak),
            ..self
        }
    }
}

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let plan = if bench.quick { &QUICK } else { &FULL };
    let steps = plan.sizes.len() + plan.texels.len() + plan.levels.len() + plan.ranks.len();
    bench.watch.begin("scaling", steps as u64, "jobs");
    let standard = CompressSettings::default();
    let scene = |size, texels| {
        bench.loaded(Wanted { scene: "mixed", size, texels, samples: plan.samples, seed: 0, block_side: 32 })
    };
    let small = plan.sizes[1];
    let mut all = Vec::new();
    let mut take =
        |varied, value: f64, scene: &dyn Fn() -> Result<LoadedScene>, settings: &CompressSettings| -> Result<()> {
            // The first run of a series is slower: the last file of the one before, the largest, is still on its way to the disk.
            let mut taken: Option<Taken> = None;
            let begun = Instant::now();
            for _ in 0..plan.runs {
                bench.stop_if_interrupted()?;
                // Made anew, for a second copy would be counted in the peak of memory.
                let run = measure(bench, varied, value, scene()?, settings)?;
                taken = Some(match taken {
                    Some(taken) => taken.with(run),
                    None => run,
                });
                if begun.elapsed().as_secs_f64() > LONG_SECS {
                    break;
                }
            }
            all.extend(taken);
            bench.watch.advance(1, 1, "jobs");
            Ok(())
        };
    for &size in plan.sizes {
        take("pixels", f64::from(size.0 * size.1), &|| scene(size, 16), &standard)?;
    }
    for &texels in plan.texels {
        take("columns", f64::from(texels * texels), &|| scene(small, texels), &standard)?;
    }
    let triangles = scene(plan.sizes[0], 16)?.scene.mesh.triangles.len();
    for &level in plan.levels {
        let finer = || {
            let mut loaded = scene(plan.sizes[0], 16)?;
            (0..level).for_each(|_| subdivide(&mut loaded.scene.mesh));
            loaded.content = content_hash(&loaded.scene, loaded.settings.max_depth);
            Ok(loaded)
        };
        take("triangles", (triangles << (2 * level)) as f64, &finer, &standard)?;
    }
    for &rank in plan.ranks {
        // All components are kept, so that relighting has so many too.
        let settings =
            CompressSettings { rank, target: Target::Slope(0.0), noise_factor: None, ..CompressSettings::default() };
        take("rank", rank as f64, &|| scene(small, 32), &settings)?;
    }
    bench.watch.end();
    write(bench, plan, &all)
}

fn write(bench: &Bench<'_>, plan: &Plan, all: &[Taken]) -> Result<StudyReport> {
    let note = "One size is varied at a time. Times are the least of three runs, of fewer where they are long. Peak: resident anonymous memory of this process, sampled every 5 ms. Error: of \
the packed matrix against the stored one, relative L2. Packing cleans, as it does by default; at rank all components are kept, and nothing is cleaned.";
    let mut table = Table::new(
        "Time and memory against size",
        bench.notes(&[note]),
        &[
            ("varied", 0),
            ("value", 0),
            ("rows", 0),
            ("columns", 0),
            ("triangles", 0),
            ("largest_rank", 0),
            ("mean_rank", 2),
            ("samples_per_px", 0),
            ("block_px", 0),
            ("raw_bytes", 0),
            ("render_secs", 3),
            ("pack_secs", 3),
            ("relight_secs", 5),
            ("render_peak_bytes", 0),
            ("pack_peak_bytes", 0),
            ("relative_l2", 4),
        ],
    );
    for t in all {
        let bytes = |peak: Option<u64>| Cell::from(peak.map(|b| b as f64));
        table.push(vec![
            t.varied.into(),
            t.value.into(),
            t.rows.into(),
            t.columns.into(),
            t.triangles.into(),
            t.rank.into(),
            t.mean_rank.into(),
            plan.samples.into(),
            32u32.into(),
            t.raw_bytes.into(),
            t.render_secs.into(),
            t.pack_secs.into(),
            t.relight_secs.into(),
            bytes(t.render_peak),
            bytes(t.pack_peak),
            t.relative_l2.into(),
        ]);
    }
    let times: [(&str, Read<f64>); 3] =
        [("render", |t| t.render_secs), ("pack", |t| t.pack_secs), ("relight", |t| t.relight_secs)];
    let mut slopes = Table::new(
        "Slopes of time against size (log–log, least squares)",
        bench.notes(&["1 is proportional, 0 is flat. Memory: slope of the peak against the bytes of the raw matrix."]),
        &[("varied", 0), ("stage", 0), ("slope", 2), ("points", 0)],
    );
    let mut panels = Vec::new();
    for varied in ["pixels", "columns", "triangles", "rank"] {
        let of: Vec<&Taken> = all.iter().filter(|t| t.varied == varied).collect();
        let mut lines = Vec::new();
        for (name, time) in times {
            let points: Vec<(f64, f64)> = of.iter().map(|t| (t.value, time(t))).collect();
            slopes.push(vec![varied.into(), name.into(), curve::slope(&points).into(), points.len().into()]);
            lines.push(Line { name: name.into(), points });
        }
        panels.push(Panel { title: format!("against {varied}"), lines });
    }
    let peaks: [(&str, Read<Option<u64>>); 2] =
        [("render (peak)", |t| t.render_peak), ("pack (peak)", |t| t.pack_peak)];
    let mut memory = Vec::new();
    for (name, peak) in peaks {
        let of = all.iter().filter(|t| t.varied == "pixels");
        let points: Vec<(f64, f64)> = of.filter_map(|t| Some((t.raw_bytes as f64, peak(t)? as f64))).collect();
        slopes.push(vec!["raw bytes".into(), name.into(), curve::slope(&points).into(), points.len().into()]);
        memory.push(Line { name: name.into(), points });
    }
    let caption = bench.caption(&format!("mixed, {} spp, blocks of 32 px", plan.samples));
    let mut report = StudyReport::default();
    report.add_table(&bench.out, "scaling", &table)?;
    report.add_table(&bench.out, "scaling-slopes", &slopes)?;
    let time = Chart {
        title: "Seconds against size".into(),
        caption: caption.clone(),
        x: Axis::logarithmic("pixels, columns, triangles, components"),
        y: Axis::logarithmic("seconds"),
        panels,
    };
    report.add_chart(&bench.out, "scaling-time", &time)?;
    let whole = memory.iter().find(|line| !line.points.is_empty()).map(|line| line.points.clone()).unwrap_or_default();
    memory.push(Line { name: "the matrix itself".into(), points: whole.iter().map(|p| (p.0, p.0)).collect() });
    let chart = Chart {
        title: "Peak memory against the size of the matrix".into(),
        caption,
        x: Axis::logarithmic("bytes of the raw matrix"),
        y: Axis::logarithmic("bytes of memory"),
        panels: vec![Panel { title: "256 columns, growing image".into(), lines: memory }],
    };
    report.add_chart(&bench.out, "scaling-memory", &chart)?;
    Ok(report)
}

fn measure(
    bench: &Bench<'_>,
    varied: &'static str,
    value: f64,
    loaded: LoadedScene,
    settings: &CompressSettings,
) -> Result<Taken> {
    // All components are kept where the rank is varied: nothing is denoised then.
    let denoise = settings.noise_factor.is_some();
    let (matrix_path, container_path) = (bench.cached("scaling.ltm"), bench.cached("scaling.ltc"));
    let triangles = loaded.scene.mesh.triangles.len();
    let mut render_options = RenderOptions::default();
    render_options.store.overwrite = true;
    let rendered = pipeline::render(loaded, &matrix_path, &render_options, &bench.silent())?;
    let matrix = StoreReader::open(&matrix_path)?;
    let mut options =
        PackOptions { allow_lost_lights: true, compress: settings.clone(), denoise, ..Default::default() };
    options.container.overwrite = true;
    let packed = pipeline::pack(&matrix, matrix.job(), &container_path, &options, &bench.silent())?;
    let shape = matrix.shape();
    let relighter = CpuRelighter::load(&ContainerReader::open(&container_path)?)?;
    let lighting = Lighting::uniform(shape.columns(), [1.0; 3])?;
    let mut image = relighter.relight(&lighting)?;
    let begun = Instant::now();
    for _ in 0..RELIGHTS {
        relighter.relight_into(&lighting, &mut image)?;
    }
    let relight_secs = begun.elapsed().as_secs_f64() / RELIGHTS as f64;
    drop(matrix);
    for path in [matrix_path, container_path] {
        std::fs::remove_file(&path).map_err(Error::io(&path, "remove"))?;
    }
    Ok(Taken {
        varied,
        value,
        rows: shape.rows(),
        columns: shape.columns(),
        triangles,
        rank: settings.rank,
        mean_rank: packed.mean_rank,
        raw_bytes: shape.raw_bytes(),
        render_secs: rendered.seconds,
        pack_secs: packed.seconds,
        relight_secs,
        render_peak: rendered.peak_memory_bytes,
        pack_peak: packed.peak_memory_bytes,
        relative_l2: packed.relative_l2,
    })
}

/// Cuts every triangle into four of the same plane: the same scene with four times the triangles.
fn subdivide(mesh: &mut Mesh) {
    let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
    let triangles = std::mem::take(&mut mesh.triangles);
    for triangle in triangles {
        let [a, b, c] = triangle.vertices;
        let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(a, b)| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let [a, b] = [a, b].map(|vertex| mesh.vertices[vertex as usize]);
                mesh.vertices.push(Vertex {
                    position: 0.5 * (a.position + b.position),
                    normal: (a.normal + b.normal).normalize_or_zero(),
                    uv: 0.5 * (a.uv + b.uv),
                });
                mesh.vertices.len() as u32 - 1
            })
        });
        for vertices in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
            mesh.triangles.push(ltm::scene::Triangle { vertices, ..triangle });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_finer_mesh_covers_the_same_area() {
        let mut mesh = ltm::scene::built_in().scene.mesh;
        let area = |mesh: &Mesh| -> f64 {
            let of = |t| {
                let [a, b, c] = mesh.corners(t);
                f64::from(0.5 * (b - a).cross(c - a).length())
            };
            mesh.triangles.iter().map(of).sum()
        };
        let (before, count) = (area(&mesh), mesh.triangles.len());
        subdivide(&mut mesh);
        assert_eq!(mesh.triangles.len(), 4 * count);
        // The sum of rounded f32 areas of ten thousands of triangles.
        assert!((area(&mesh) / before - 1.0).abs() < 1e-5);
    }
}
