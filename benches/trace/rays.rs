//! Rays a second on one thread, beside Embree's where `benches/trace/embree_rays.cpp` has been built.

use std::hint::black_box;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use criterion::{Criterion, Throughput};
use glam::Vec3;
use ltm::trace::bvh::{Bvh, Occlusion, Ray, Walk};

use super::figures::Figures;
use super::meshes::{self, RaySets, Subject};

/// Ours and Embree take turns so often.
const ROUNDS: usize = 3;
/// Runs over all rays of a set in a turn, of which the fastest counts: other work on the machine disturbs it least.
const RUNS: usize = 4;
/// The sets, and what is asked of each ray.
const SETS: [(&str, &str); 3] = [("primary", "closest"), ("bounce", "closest"), ("shadow", "any")];

/// What one side does on a set.
#[derive(Clone, Copy, Default)]
struct Reached {
    million_rays_a_second: f64,
    /// Rays that hit, or that are clear where any hit is asked for.
    count: usize,
}

impl Reached {
    fn faster(self, other: Self) -> Self {
        if other.million_rays_a_second > self.million_rays_a_second { other } else { self }
    }
}

pub(crate) fn rays(criterion: &mut Criterion) {
    let mut subjects: Vec<Subject> = [106_000, 504_000].map(meshes::spheres_in_walls).into();
    if let Ok(folder) = std::env::var("LTM_SCENES") {
        let path = Path::new(&folder).join("conference/conference.obj");
        match meshes::object(&path, Vec3::new(680.0, 390.0, -350.0), Vec3::new(-300.0, 150.0, 300.0)) {
            Some(subject) => subjects.push(subject),
            None => eprintln!("{} cannot be read; left out", path.display()),
        }
    }
    let embree = std::env::var_os("LTM_EMBREE");
    let variables = ["LTM_SCENES", "LTM_EMBREE"];
    let mut figures = Figures::new("bench-rays", &variables, "cargo bench --bench trace -- rays");
    for subject in subjects {
        let start = Instant::now();
        let bvh = Bvh::build(&subject.triangles);
        let (seconds, quality) = (start.elapsed().as_secs_f64(), bvh.quality());
        eprintln!(
            "{}: built in {seconds:.2} s; a ray opens {:.1} nodes and {:.1} leaves of {:.1} triangles",
            subject.name, quality.nodes, quality.leaves, quality.leaf_fill
        );
        let sets = RaySets::new(&subject, &bvh, 512);
        if let Ok(folder) = std::env::var("LTM_RAY_DUMP") {
            meshes::dump(Path::new(&folder), &subject, &sets).expect("the dump folder can be written");
        }
        compare(&subject, &bvh, &sets, embree.as_deref().map(Path::new), &mut figures);
        time(&subject, &bvh, &sets, criterion);
    }
    figures.write();
}

fn of<'a>(sets: &'a RaySets, set: &str) -> &'a [Ray] {
    match set {
        "primary" => &sets.primary,
        "bounce" => &sets.bounce,
        _ => &sets.shadow,
    }
}

fn closest(bvh: &Bvh, rays: &[Ray]) -> usize {
    rays.iter().filter(|ray| bvh.closest(ray).is_some()).count()
}

fn clear(bvh: &Bvh, rays: &[Ray]) -> usize {
    rays.iter().filter(|ray| bvh.occlusion(ray) == Occlusion::Clear).count()
}

/// Ours and Embree on the same rays, in turns.
fn compare(subject: &Subject, bvh: &Bvh, sets: &RaySets, embree: Option<&Path>, figures: &mut Figures) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dumped = embree.map(|program| {
        let dumped = meshes::dump(folder.path(), subject, sets).expect("the temporary folder can be written");
        (program, dumped)
    });
    let (mut ours, mut theirs) = ([Reached::default(); SETS.len()], [Reached::default(); SETS.len()]);
    for _ in 0..ROUNDS {
        for ((set, kind), ours) in SETS.into_iter().zip(&mut ours) {
            let rays = of(sets, set);
            for _ in 0..RUNS {
                let start = Instant::now();
                let count = black_box(if kind == "closest" { closest(bvh, rays) } else { clear(bvh, rays) });
                let million_rays_a_second = rays.len() as f64 / start.elapsed().as_secs_f64() / 1e6;
                *ours = ours.faster(Reached { million_rays_a_second, count });
            }
        }
        if let Some((program, dumped)) = &dumped {
            let run = embree_rates(program, dumped);
            theirs.iter_mut().zip(run).for_each(|(theirs, run)| *theirs = theirs.faster(run));
        }
    }
    for (((set, kind), ours), theirs) in SETS.into_iter().zip(ours).zip(theirs) {
        let case = format!("{}: {set} ({kind})", subject.name);
        let (rate, rays) = (ours.million_rays_a_second, of(sets, set).len());
        eprint!("  {set} ({kind}): {rate:.2} M rays/s, {} of {rays}", ours.count);
        figures.add(&case, "million_rays_a_second", rate);
        if dumped.is_some() {
            let embree = theirs.million_rays_a_second;
            eprint!("; Embree {embree:.2} M rays/s, {} of them; ours over Embree {:.2}", theirs.count, rate / embree);
            figures.add(&case, "embree_million_rays_a_second", embree);
            figures.add(&case, "ours_over_embree", rate / embree);
        }
        eprintln!();
    }
}

/// What the program prints of each set, such as `primary 2.345 M rays/s, 260000 of 262144 hit`.
fn embree_rates(program: &Path, dumped: &Path) -> [Reached; SETS.len()] {
    let output = Command::new(program).arg(dumped).output().expect("LTM_EMBREE names a program");
    let told = String::from_utf8_lossy(&output.stdout);
    SETS.map(|(set, _)| {
        let line = told.lines().find_map(|line| line.trim().strip_prefix(set)).unwrap_or_default();
        let words: Vec<&str> = line.split_whitespace().collect();
        let number = |at: usize| words.get(at).and_then(|word| word.parse::<f64>().ok());
        let (Some(million_rays_a_second), Some(count)) = (number(0), number(3)) else {
            panic!("{} printed nothing of {set}: {told}", program.display());
        };
        Reached { million_rays_a_second, count: count as usize }
    })
}

fn time(subject: &Subject, bvh: &Bvh, sets: &RaySets, criterion: &mut Criterion) {
    let plain = Bvh::build(&subject.triangles).with_walk(Walk::Scalar);
    let mut group = criterion.benchmark_group(format!("rays/{}", subject.name));
    group.sample_size(10).measurement_time(Duration::from_secs(2)).warm_up_time(Duration::from_millis(300));
    group.throughput(Throughput::Elements(sets.primary.len() as u64));
    group.bench_function("primary", |b| b.iter(|| black_box(closest(bvh, &sets.primary))));
    group.throughput(Throughput::Elements(sets.bounce.len() as u64));
    group.bench_function("bounce", |b| b.iter(|| black_box(closest(bvh, &sets.bounce))));
    group.bench_function("bounce, scalar", |b| b.iter(|| black_box(closest(&plain, &sets.bounce))));
    group.bench_function("shadow", |b| b.iter(|| black_box(clear(bvh, &sets.shadow))));
    group.finish();
}
