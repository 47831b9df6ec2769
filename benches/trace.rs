//! How fast tracing is, and what the speed buys.
//!
//! * `rays`: millions of rays a second, one thread, on meshes with flat tessellated walls and, where the variable
//!   `LTM_SCENES` names the folder of scenes, on the Conference Room; beside them the tree's quality. With
//!   `LTM_EMBREE` naming the program of `benches/trace/embree_rays.cpp`, which says how it is built, the same rays through Embree.
//!   With `LTM_RAY_DUMP` naming a folder, meshes and rays are written there.
//! * `tax`: time for many columns over time for one, same paths (the paper, §3.1).
//! * `error`: relative error of an image relit from T against seconds, for more and more samples.
//! * `conference`: the same for the Conference Room, all lamps on and each alone, where `LTM_SCENES` is set.
//!
//! `cargo bench --bench trace -- rays` runs one of them.

#[path = "trace/conference.rs"]
mod conference;
mod figures;
#[path = "trace/meshes.rs"]
mod meshes;
#[path = "trace/rays.rs"]
mod rays;
#[expect(dead_code, reason = "the benchmarks use some of the tests' scenes")]
#[path = "../tests/transport/scenes.rs"]
mod scenes;

use std::time::Instant;

use criterion::Criterion;
use figures::Figures;
use glam::Vec3;
use ltm::matrix::{BlockId, BlockSource, TracedBlock};
use ltm::scene::{Paint, Scene, Surface};
use scenes::{Builder, all_on, camera, lambert, settings, trace, tracer};

/// A room with a panel of `texels × texels`, a mirror ball and a glass ball.
fn room(texels: u32, side: u32) -> Scene {
    let mut builder = Builder::new(camera(Vec3::new(0.5, 0.5, 0.98), Vec3::new(0.5, 0.4, 0.0), 75.0, side));
    builder.room(Vec3::ZERO, Vec3::ONE, lambert(0.7));
    let mirror = Surface::Mirror { reflectance: Paint::Constant(Vec3::splat(0.95)) };
    builder.sphere(Vec3::new(0.3, 0.2, 0.35), 0.2, 48, mirror);
    let glass = Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE };
    builder.sphere(Vec3::new(0.7, 0.18, 0.55), 0.18, 48, glass);
    builder.panel("panel", Vec3::new(0.25, 0.99, 0.25), Vec3::X * 0.5, Vec3::Z * 0.5, (texels, texels));
    builder.build()
}

/// Seconds that this thread has run so far, which other work on the machine stretches less than those on the wall;
/// where the system does not tell, those on the wall.
fn thread_seconds(since: Instant) -> f64 {
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = told.and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    nanoseconds.map_or(since.elapsed().as_secs_f64(), |n| n * 1e-9)
}

/// Seconds for some blocks in the middle of the image, one thread.
fn seconds(texels: u32, samples: u32, side: u32) -> (f64, u64) {
    let tracer = tracer(room(texels, side), settings(samples, 8));
    let mut block = TracedBlock::default();
    let count = tracer.shape().block_count();
    let ids = (0..4).map(|i| BlockId(count / 3 + i * count / 12));
    let since = Instant::now();
    let start = thread_seconds(since);
    let rays = ids.map(|id| tracer.trace_block(id, &mut block).rays).sum();
    (thread_seconds(since) - start, rays)
}

fn tax() {
    let mut figures = Figures::new("bench-tax", &[], "cargo bench --bench trace -- tax");
    eprintln!("tax: blocks of 32×32 pixels, one thread, same paths for any number of columns; best of 5");
    for samples in [16, 64, 256] {
        let columns = [1u32, 8, 32, 64];
        let mut best = [f64::INFINITY; 4];
        let mut rays = 0;
        for _ in 0..5 {
            for (best, &texels) in best.iter_mut().zip(&columns) {
                let (time, count) = seconds(texels, samples, 256);
                (*best, rays) = (best.min(time), count);
            }
        }
        let rate = rays as f64 / best[0] / 1e6;
        eprint!("  {samples} samples a pixel, {:.3} s at {rate:.2} M rays/s for 1 column;", best[0]);
        for (time, texels) in best.iter().zip(columns).skip(1) {
            eprint!(" {} columns {:.3}", texels * texels, time / best[0]);
            figures.add(
                &format!("{samples} samples"),
                &format!("{}_columns_over_one", texels * texels),
                time / best[0],
            );
        }
        eprintln!();
    }
    figures.write();
}

fn error() {
    let reference = all_on(&trace(room(4, 32), ltm::trace::TraceSettings { seed: 99, ..settings(16_384, 8) }));
    let norm = reference.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>();
    eprintln!("error: all texels on, 32×32 pixels, relative L2 against 16,384 samples a pixel");
    for samples in [4, 16, 64, 256, 1024] {
        let start = Instant::now();
        let found = all_on(&trace(room(4, 32), settings(samples, 8)));
        let time = start.elapsed().as_secs_f64();
        let square = found.iter().zip(&reference).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        let error = (square / norm).sqrt();
        eprintln!("  {samples:5} samples {time:8.3} s  error {error:.4}  error²·s {:.2e}", error * error * time);
    }
}

fn main() {
    let wanted: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let runs = |name: &str| wanted.is_empty() || wanted.iter().any(|w| w == name);
    // `cargo test` builds benches and runs them with `--test`: nothing to do then.
    if std::env::args().any(|a| a == "--test") {
        return;
    }
    if runs("rays") {
        let mut criterion = Criterion::default().without_plots();
        rays::rays(&mut criterion);
        criterion.final_summary();
    }
    if runs("tax") {
        tax();
    }
    if runs("error") {
        error();
    }
    if runs("conference") {
        conference::conference();
    }
}
