//! The Conference Room with its 24 lamps: what seconds buy, all lamps at once and each alone.
//!
//! `tests/references/conference.py --times` measures Mitsuba 3 on the same images.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use ltm::matrix::{BlockSource, MatrixShape, TracedBlock};
use ltm::scene::Scene;
use ltm::trace::{TraceSettings, Tracer};

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;

/// One render on this thread: for each row of all blocks, the entries of all columns; and seconds.
fn render(scene: &Arc<Scene>, samples_per_pixel: u32, seed: u64) -> (Vec<Vec<f32>>, f64) {
    let columns = scene.basis.column_count();
    let shape = MatrixShape::new(WIDTH, HEIGHT, columns as u32, 32).expect("a small shape");
    let settings = TraceSettings { samples_per_pixel, seed, max_depth: 12 };
    let tracer = Tracer::new(Arc::clone(scene), shape, settings).expect("the scene can be traced");
    let mut rows = Vec::new();
    let mut traced = TracedBlock::default();
    let start = Instant::now();
    let mut seconds = 0.0;
    for id in shape.blocks() {
        tracer.read_block(id, &mut traced).expect("tracing does not fail");
        seconds = start.elapsed().as_secs_f64();
        let view = traced.block.view();
        rows.extend((0..view.rows()).map(|row| (0..columns).map(|column| view.at(row, column)).collect()));
    }
    (rows, seconds)
}

/// Relative root mean square error of one of two independent renders: `√(½ Σ (a − b)² / Σ (½ (a + b))²)`.
fn error(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (mut square, mut norm) = (0.0, 0.0);
    for (a, b) in pairs {
        square += 0.5 * (a - b).powi(2);
        norm += (0.5 * (a + b)).powi(2);
    }
    (square / norm).sqrt()
}

pub(crate) fn conference() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/scenes/conference-24.toml");
    let mut scene = match ltm::scene::load(&path) {
        Ok(loaded) => loaded.scene,
        Err(error) => {
            eprintln!("conference: left out ({error})");
            return;
        }
    };
    (scene.camera.width, scene.camera.height) = (WIDTH, HEIGHT);
    let (scene, columns) = (Arc::new(scene), 24);
    eprintln!("conference: {WIDTH}×{HEIGHT} pixels, 24 columns, one thread; relative error of all lamps on, and the");
    eprintln!("  root mean square over the lamps of the relative error of each lamp alone");
    for samples in [4, 16, 64, 256, 1024] {
        let (a, seconds_a) = render(&scene, samples, 1);
        let (b, seconds_b) = render(&scene, samples, 2);
        let sum = |row: &[f32]| row.iter().map(|&v| f64::from(v)).sum::<f64>();
        let all = error(a.iter().zip(&b).map(|(a, b)| (sum(a), sum(b))));
        let alone = |column: usize| error(a.iter().zip(&b).map(|(a, b)| (a[column].into(), b[column].into())));
        let mean = ((0..columns).map(|c| alone(c).powi(2)).sum::<f64>() / columns as f64).sqrt();
        let seconds = seconds_a.min(seconds_b);
        eprintln!(
            "  {samples:5} samples {seconds:8.3} s  all {all:.4} (error²·s {:.3e})  alone {mean:.4} (error²·s {:.3e})",
            all * all * seconds,
            mean * mean * seconds
        );
    }
}
