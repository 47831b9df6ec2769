//! Sensors in a room under the patches of a sky, beside Radiance: error and processors' seconds at several numbers of samples, and the
//! patches one by one.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::StudyReport;
use super::bench::Bench;
use super::table::{Cell, Table};
use super::timing::Clock;
use ltm::error::{Error, Result};
use ltm::matrix::{BlockSource, ColumnIndex, TracedBlock};
use ltm::pipeline::{self, RenderOptions};
use ltm::scene::LoadOptions;
use ltm::store::StoreReader;

/// Names the folder of Radiance: it has its programs in `bin` and its files in `lib`.
const VARIABLE: &str = "LTM_RADIANCE";

/// A material, and the corner and the edges of a rectangle of it.
type Part = (&'static str, [f32; 3], [f32; 3], [f32; 3]);

/// A room of 6 × 4 × 3 m with a window of 3 × 1.5 m in its north wall: rectangles by corner and edges (y up), and their materials.
const ROOM: [Part; 9] = [
    ("floor", [-3.0, 0.0, -2.0], [0.0, 0.0, 4.0], [6.0, 0.0, 0.0]),
    ("ceiling", [-3.0, 3.0, -2.0], [6.0, 0.0, 0.0], [0.0, 0.0, 4.0]),
    ("wall", [-3.0, 0.0, 2.0], [0.0, 3.0, 0.0], [6.0, 0.0, 0.0]),
    ("wall", [-3.0, 0.0, -2.0], [0.0, 3.0, 0.0], [0.0, 0.0, 4.0]),
    ("wall", [3.0, 0.0, -2.0], [0.0, 0.0, 4.0], [0.0, 3.0, 0.0]),
    ("wall", [-3.0, 0.0, -2.0], [1.5, 0.0, 0.0], [0.0, 3.0, 0.0]),
    ("wall", [1.5, 0.0, -2.0], [1.5, 0.0, 0.0], [0.0, 3.0, 0.0]),
    ("wall", [-1.5, 0.0, -2.0], [3.0, 0.0, 0.0], [0.0, 0.9, 0.0]),
    ("wall", [-1.5, 2.4, -2.0], [3.0, 0.0, 0.0], [0.0, 0.6, 0.0]),
];

/// Diffuse reflectances.
const MATERIALS: [(&str, f32); 3] = [("floor", 0.2), ("ceiling", 0.8), ("wall", 0.5)];

/// Sensors along x and z, at a height of 0.8 m.
const SENSORS: [usize; 2] = [12, 8];

/// Renders with seeds of their own for the comparison patch by patch.
const SEEDS: u64 = 8;

/// Bounces of Radiance, as the note says: with 6 a room like this loses 0.6 % of its light.
const BOUNCES: &str = "12";

const NOTE: &str = "96 sensors at 0.8 m in a room of 6 × 4 × 3 m with a window of 3 × 1.5 m, reflectances 0.2, 0.5 and 0.8, under Radiance's patches. \
Radiance: rfluxmtx -I+ -n 1 -ab 12 -lw 1e-6 with -ad as given. Error: root of the mean square over sensors and patches, against the mean of four \
runs of Radiance with -ad of the reference whose sensors stand 0.1 mm apart, over the mean entry.";

/// Ticks of a second in which Linux counts processors' time.
const TICKS: f64 = 100.0;

/// Entries: sensors × patches, patch fastest.
type Entries = Vec<f64>;

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let Some(radiance) = std::env::var_os(VARIABLE).map(PathBuf::from) else {
        bench.watch.note(&format!("daylight: no Radiance ({VARIABLE}), nothing was measured"));
        return Ok(StudyReport::default());
    };
    let folder = bench.out.join("daylight");
    fs::create_dir_all(&folder).map_err(Error::io(&folder, "make the folder"))?;
    write_room(&folder)?;
    let subdivisions: &[u32] = if bench.quick { &[1] } else { &[1, 4] };
    let (reference_ad, ads, samples): (u32, &[u32], &[u32]) = match bench.quick {
        true => (4000, &[500], &[64, 256]),
        false => (16_000, &[1000, 4000], &[256, 1024, 4096]),
    };
    let mut table = Table::new(
        "Sensors under the patches of a sky, beside Radiance",
        bench.notes(&[NOTE]),
        &[
            ("patches", 0),
            ("program", 0),
            ("samples", 0),
            ("reference_samples", 0),
            ("error_percent", 3),
            ("cpu_secs", 2),
        ],
    );
    let mut patches = Table::new(
        "Each patch of a sky over the sensors, beside Radiance",
        bench.notes(&[NOTE, "Sums over all sensors of eight renders of 1,024 samples and of four runs of Radiance, by their standard errors."]),
        &[("patch", 0), ("ours", 6), ("radiance", 6), ("z", 2)],
    );
    for &subdivision in subdivisions {
        let mut runs = Vec::new();
        for run in 0..4 {
            runs.push(radiance_entries(&radiance, &folder, subdivision, reference_ad, f64::from(run) * 1e-4)?.0);
        }
        let reference = mean_of(&runs);
        let mut push = |program: &str, samples: u32, entries: &Entries, cpu_secs: f64| {
            let count = reference.len() / (SENSORS[0] * SENSORS[1]);
            table.push(vec![
                count.into(),
                program.into(),
                samples.into(),
                reference_ad.into(),
                (100.0 * error(entries, &reference)).into(),
                cpu_secs.into(),
            ]);
        };
        for &ad in ads {
            // Beside the reference's places, so that its own draws are others.
            let (entries, cpu_secs) = radiance_entries(&radiance, &folder, subdivision, ad, 5e-4)?;
            push("rcontrib", ad, &entries, cpu_secs);
        }
        for &samples in samples {
            let (entries, cpu_secs) = own_entries(bench, &folder, subdivision, samples, 0)?;
            push("ltm", samples, &entries, cpu_secs);
        }
        if subdivision == 1 {
            let seeds = if bench.quick { 2 } else { SEEDS };
            let own: Result<Vec<Entries>> = (1..=seeds)
                .map(|seed| Ok(own_entries(bench, &folder, 1, samples[samples.len() / 2], seed)?.0))
                .collect();
            compare_patches(&own?, &runs, &mut patches);
        }
    }
    let mut report = StudyReport::default();
    report.add_table(&bench.out, "daylight", &table)?;
    report.add_csv(&bench.out, "daylight-patches", &patches)?;
    Ok(report)
}

/// Each patch by the sums over sensors.
fn compare_patches(own: &[Entries], radiance: &[Entries], table: &mut Table) {
    let count = own[0].len() / (SENSORS[0] * SENSORS[1]);
    for patch in 0..count {
        let sums = |runs: &[Entries]| -> Vec<f64> {
            runs.iter().map(|entries| entries.iter().skip(patch).step_by(count).sum()).collect()
        };
        let ([ours, of_ours], [theirs, of_theirs]) = (mean_and_error(&sums(own)), mean_and_error(&sums(radiance)));
        let spread = of_ours.hypot(of_theirs);
        let z = if spread > 0.0 { Cell::from((ours - theirs) / spread) } else { Cell::Missing };
        table.push(vec![patch.into(), ours.into(), theirs.into(), z]);
    }
}

/// Mean and its standard error.
fn mean_and_error(values: &[f64]) -> [f64; 2] {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    [mean, (squares / (count - 1.0).max(1.0) / count).sqrt()]
}

fn mean_of(runs: &[Entries]) -> Entries {
    (0..runs[0].len()).map(|entry| runs.iter().map(|run| run[entry]).sum::<f64>() / runs.len() as f64).collect()
}

/// Root of the mean square difference over the mean of the reference.
fn error(entries: &Entries, reference: &Entries) -> f64 {
    let squares: f64 = entries.iter().zip(reference).map(|(a, b)| (a - b).powi(2)).sum();
    (squares / reference.len() as f64).sqrt() / (reference.iter().sum::<f64>() / reference.len() as f64)
}

/// Writes the room for both programs.
fn write_room(folder: &Path) -> Result<()> {
    let write = |name: &str, text: &str| {
        let path = folder.join(name);
        fs::write(&path, text).map_err(Error::io(&path, "write"))
    };
    let (mut obj, mut rad, mut mtl) = ("mtllib room.mtl\n".to_owned(), String::new(), String::new());
    for (name, reflectance) in MATERIALS {
        mtl += &format!("newmtl {name}\nKd {reflectance} {reflectance} {reflectance}\n");
        rad += &format!("void plastic {name} 0 0 5 {reflectance} {reflectance} {reflectance} 0 0\n");
    }
    for (index, (material, corner, u, v)) in ROOM.into_iter().enumerate() {
        let at = |a: f32, b: f32| [0, 1, 2].map(|axis: usize| corner[axis] + a * u[axis] + b * v[axis]);
        let corners = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)];
        obj += &format!("usemtl {material}\n");
        rad += &format!("{material} polygon wall{index} 0 0 12");
        for [x, y, z] in corners {
            obj += &format!("v {x} {y} {z}\n");
            // Radiance has z up.
            rad += &format!(" {x} {} {y}", -z);
        }
        rad.push('\n');
        let first = 4 * index + 1;
        obj += &format!("f {} {} {} {}\n", first, first + 1, first + 2, first + 3);
    }
    write("room.obj", &obj)?;
    write("room.mtl", &mtl)?;
    write("room.rad", &rad)
}

/// Places of the sensors, z up as Radiance has it, moved along x.
fn points(moved: f64) -> String {
    let [across, down] = SENSORS;
    let at = |i: usize| {
        let (x, z) = ((i % across) as f64 + 0.5, (i / across) as f64 + 0.5);
        (x / across as f64 * 6.0 - 3.0 + moved, 2.0 - z / down as f64 * 4.0)
    };
    (0..across * down).map(at).map(|(x, y)| format!("{x} {y} 0.8 0 0 1\n")).collect()
}

/// The entries by `rfluxmtx`, the lower hemisphere first, and the processors' seconds that it took.
fn radiance_entries(radiance: &Path, folder: &Path, subdivision: u32, ad: u32, moved: f64) -> Result<(Entries, f64)> {
    let sky = format!(
        "#@rfluxmtx h=u u=+Y\nvoid glow ground 0 0 4 1 1 1 0\nground source g 0 0 4 0 0 -1 180\n\
         #@rfluxmtx h=r{subdivision} u=+Y\nvoid glow sky 0 0 4 1 1 1 0\nsky source s 0 0 4 0 0 1 180\n"
    );
    let of = |name: &str| folder.join(name);
    fs::write(of("sky.rad"), sky).map_err(Error::io(folder, "write"))?;
    fs::write(of("points"), points(moved)).map_err(Error::io(folder, "write"))?;
    let bin = radiance.join("bin");
    let path = std::env::join_paths(
        std::iter::once(bin.clone()).chain(std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default())),
    );
    let input = fs::File::open(of("points")).map_err(Error::io(folder, "open the points"))?;
    let before = children_seconds();
    let output = Command::new(bin.join("rfluxmtx"))
        .args([
            "-h",
            "-I+",
            "-n",
            "1",
            "-ab",
            BOUNCES,
            "-ad",
            &ad.to_string(),
            "-lw",
            "1e-6",
            "-faa",
            "-",
            "sky.rad",
            "room.rad",
        ])
        .current_dir(folder)
        .env("PATH", path.unwrap_or_default())
        .env("RAYPATH", radiance.join("lib"))
        .stdin(input)
        .stderr(Stdio::piped())
        .output()
        .map_err(Error::io(&bin, "start rfluxmtx in"))?;
    let took = children_seconds() - before;
    if !output.status.success() {
        let text = String::from_utf8_lossy(&output.stderr);
        let last = text.lines().last().unwrap_or("no message").to_owned();
        return Err(Error::input("rfluxmtx", last, format!("{VARIABLE} names a folder with bin and lib")));
    }
    let text = String::from_utf8_lossy(&output.stdout);
    let values: Vec<f64> = text.split_ascii_whitespace().filter_map(|word| word.parse().ok()).collect();
    // Grey: the first of three channels.
    Ok((values.into_iter().step_by(3).collect(), took))
}

/// Processors' seconds of the programs that have ended.
fn children_seconds() -> f64 {
    let text = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // Behind the name, which is in brackets: user and system time of children are the 14th and 15th field.
    let fields: Vec<&str> = text.rsplit_once(')').map_or("", |parts| parts.1).split_ascii_whitespace().collect();
    let ticks = |field: usize| fields.get(field).and_then(|word| word.parse::<f64>().ok()).unwrap_or(0.0);
    (ticks(13) + ticks(14)) / TICKS
}

/// Our entries, and the processors' seconds from the scene file to the matrix.
fn own_entries(bench: &Bench<'_>, folder: &Path, subdivision: u32, samples: u32, seed: u64) -> Result<(Entries, f64)> {
    let text = format!(
        "geometry = [\"room.obj\"]\n[[grid]]\nname = \"desk\"\norigin = [-3, 0.8, -2]\nedge_u = [6, 0, 0]\nedge_v = [0, 0, 4]\n\
         spacing = 0.5\n[[light]]\nkind = \"environment\"\nname = \"sky\"\npatches = \"reinhart\"\nsubdivision = {subdivision}\n"
    );
    let scene = folder.join("room.toml");
    fs::write(&scene, text).map_err(Error::io(&scene, "write"))?;
    let clock = Clock::start();
    let mut loaded = pipeline::load_scene(&scene, LoadOptions::default())?;
    (loaded.settings.samples_per_pixel, loaded.settings.seed) = (samples, seed);
    let path = folder.join("desk.ltm");
    let mut options = RenderOptions::default();
    options.store.overwrite = true;
    pipeline::render(loaded, &path, &options, bench.watch)?;
    let took = clock.stop().cpu_secs;
    let matrix = StoreReader::open(&path)?;
    let (shape, mut traced) = (BlockSource::shape(&matrix), TracedBlock::default());
    let columns = shape.columns();
    let mut entries = vec![0.0; SENSORS[0] * SENSORS[1] * columns];
    for id in shape.blocks() {
        matrix.read_block(id, &mut traced)?;
        let rect = shape.rect(id);
        for column in 0..columns {
            let values = traced.block.view().column(ColumnIndex(column as u32));
            for (pixel, value) in values[..rect.pixels()].iter().enumerate() {
                let (x, y) = (rect.x + pixel as u32 % rect.width, rect.y + pixel as u32 / rect.width);
                entries[(y * shape.width() + x) as usize * columns + column] = f64::from(*value);
            }
        }
    }
    Ok((entries, took))
}
