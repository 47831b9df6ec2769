//! What tracing promises: the right light in the right column, the same bytes every time.

#[path = "transport/bsdf.rs"]
mod bsdf;
#[path = "transport/bvh.rs"]
mod bvh;
#[path = "transport/cameras.rs"]
mod cameras;
#[path = "transport/caustics.rs"]
mod caustics;
#[path = "transport/guiding.rs"]
mod guiding;
#[path = "transport/layers.rs"]
mod layers;
#[path = "transport/light.rs"]
mod light;
#[path = "transport/lobes.rs"]
mod lobes;
#[path = "transport/references.rs"]
mod references;
#[path = "transport/scenes.rs"]
mod scenes;
#[path = "transport/statistics.rs"]
mod statistics;
#[path = "transport/surfaces.rs"]
mod surfaces;
#[path = "transport/textures.rs"]
mod textures;
#[path = "transport/z_test.rs"]
mod z_test;

use glam::Vec3;
use ltm::light::{EnvironmentMapping, LightKind};
use ltm::matrix::{MatrixShape, TracedBlock};
use ltm::scene::{Emitter, EnvironmentEmitter, Paint, Surface};
use ltm::trace::{TraceSettings, Tracer};
use scenes::{Builder, all_on, camera, lambert, mean, renders, settings, trace, tracer};

/// A closed room whose walls all emit E and reflect ρ is equally bright everywhere: E / (1 − ρ).
#[test]
fn a_closed_glowing_room_is_equally_bright_everywhere() {
    let mut builder = Builder::new(camera(Vec3::new(0.3, 0.4, 0.2), Vec3::new(1.0, 0.1, 0.8), 80.0, 16));
    let walls = builder.room(Vec3::ZERO, Vec3::new(1.0, 1.5, 2.0), lambert(0.5));
    builder.lamp("floor", &walls[..2]);
    builder.lamp("others", &walls[2..]);
    let blocks = trace(builder.build(), settings(256, 40));
    let pixels = all_on(&blocks);
    // Of unit emission: 1 / (1 − 0.5) = 2. Depth 40 leaves out 2⁻⁴⁰. The deviation of a pixel at 256 samples is about
    // 2 %, of the mean of 768 rows (256 independent) about 0.15 %; five of each.
    assert!((mean(&pixels) / 2.0 - 1.0).abs() < 0.0075, "{}", mean(&pixels));
    let worst = pixels.iter().fold(0.0f32, |w, &p| w.max((p / 2.0 - 1.0).abs()));
    assert!(worst < 0.12, "{worst}");
    assert!(blocks.iter().all(|(_, stats)| stats.non_finite == 0));
}

#[test]
fn blocks_are_the_same_bytes_on_any_thread_in_any_order() {
    let scene = {
        let mut builder = Builder::new(camera(Vec3::new(0.5, 0.5, 0.9), Vec3::new(0.5, 0.4, 0.0), 70.0, 24));
        builder.room(Vec3::ZERO, Vec3::ONE, lambert(0.7));
        builder.panel("panel", Vec3::new(0.3, 0.99, 0.3), Vec3::X * 0.4, Vec3::Z * 0.4, (8, 8));
        builder.build()
    };
    let tracer = tracer(scene, settings(8, 6));
    let ids: Vec<_> = ltm::matrix::BlockSource::shape(&tracer).blocks().collect();
    let traced = |id| {
        let mut block = TracedBlock::default();
        tracer.trace_block(id, &mut block);
        block
    };
    let in_order: Vec<_> = ids.iter().map(|&id| traced(id)).collect();
    let threads: Vec<_> = std::thread::scope(|scope| {
        let handles: Vec<_> = ids.iter().rev().map(|&id| scope.spawn(move || traced(id))).collect();
        handles.into_iter().rev().map(|h| h.join().unwrap()).collect()
    });
    assert!(in_order.iter().any(|b| b.block.entries().iter().any(|&e| e > 0.0)));
    assert_eq!(in_order, threads);
}

/// Under a sky of 1 in every direction, what neither absorbs nor emits cannot be seen: also not at the rims of a coarse
/// mesh, where interpolated normals would mirror light to the wrong side of its triangles. Glass loses a little there:
/// a normal that bends light in too steeply makes it run around inside by total reflection, as no true ball does.
#[test]
fn mirrors_glass_and_thin_sheets_vanish_in_a_white_furnace() {
    let mirror = Surface::Mirror { reflectance: Paint::Constant(Vec3::ONE) };
    let glass = Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE };
    let sheet = Surface::ThinDielectric { ior: 1.5, transmittance: Vec3::ONE };
    for (surface, rings, loss) in [
        (mirror, 5, 0.0),
        (mirror, 32, 0.0),
        (sheet, 5, 0.0),
        (sheet, 32, 0.0),
        // Measured: 6.4e-3 with 5 rings.
        (glass, 5, 1e-2),
        (glass, 32, 1e-3),
    ] {
        let mut builder = Builder::new(camera(Vec3::new(0.0, 0.0, 3.0), Vec3::ZERO, 45.0, 16));
        builder.sphere(Vec3::ZERO, 1.0, rings, surface);
        let sky = EnvironmentEmitter {
            mapping: EnvironmentMapping::Octahedral { side: 4 },
            world_from_environment: glam::Mat3::IDENTITY,
            is_split: false,
        };
        builder.bodiless("sky", LightKind::Octahedral { side: 4 }, Emitter::Environment(sky));
        let pixels = all_on(&trace(builder.build(), settings(64, 256)));
        // No variance: every path carries 1, but for the rounding of up to 256 factors.
        let lost = 1.0 - mean(&pixels);
        assert!((-1e-5..=loss + 1e-5).contains(&lost), "{surface:?}, {rings} rings: {lost}");
        let worst = pixels.iter().fold(0.0f32, |w, &p| w.max((p - 1.0).abs()));
        assert!(loss > 0.0 || worst < 1e-4, "{surface:?}, {rings} rings: {worst}");
    }
}

/// What stands out in caustics are single paths that meet the light itself, not the weights of the sampling: nothing that
/// one path from the camera brings home is much brighter than the light.
#[test]
fn no_path_is_much_brighter_than_its_light() {
    let mut builder = Builder::new(camera(Vec3::new(0.5, 0.5, 0.95), Vec3::new(0.5, 0.4, 0.0), 75.0, 16));
    builder.room(Vec3::ZERO, Vec3::ONE, lambert(0.5));
    builder.sphere(Vec3::new(0.3, 0.25, 0.4), 0.2, 24, Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE });
    let gold = Surface::RoughConductor { specular: Paint::Constant(Vec3::new(0.9, 0.7, 0.3)), alpha: 0.02 };
    builder.sphere(Vec3::new(0.72, 0.22, 0.4), 0.18, 24, gold);
    let coated = Paint::Constant(Vec3::splat(0.5));
    let coat = Surface::Coated { reflectance: coated, specular: Vec3::splat(0.04), alpha: 0.02 };
    builder.quad(Vec3::new(0.05, 0.01, 0.05), Vec3::Z * 0.9, Vec3::X * 0.9, coat);
    builder.panel("panel", Vec3::new(0.45, 0.98, 0.45), Vec3::X * 0.1, Vec3::Z * 0.1, (1, 1));
    let tracer = tracer(builder.build(), settings(1, 12)).without_photons();
    let brightest = renders(tracer, settings(1, 12), 0..400)
        .flatten()
        .flat_map(|block| block.block.entries().to_vec())
        .fold(0.0f32, f32::max);
    // Of emission 1: at every vertex a path may find the light by chance (at most 1) and by four samples (at most half
    // of the albedo each, where both techniques are as good), and lives on with chance where it has become dark.
    assert!(brightest > 0.9 && brightest < 2.5, "{brightest}");
}

fn glossy_room(texels: u32) -> ltm::scene::Scene {
    let mut builder = Builder::new(camera(Vec3::new(0.5, 0.5, 0.95), Vec3::new(0.5, 0.4, 0.0), 75.0, 16));
    builder.room(Vec3::ZERO, Vec3::ONE, lambert(0.6));
    let gold = Surface::RoughConductor { specular: Paint::Constant(Vec3::new(0.9, 0.7, 0.3)), alpha: 0.2 };
    builder.sphere(Vec3::new(0.3, 0.25, 0.4), 0.2, 16, gold);
    builder.panel("panel", Vec3::new(0.3, 0.99, 0.3), Vec3::X * 0.4, Vec3::Z * 0.4, (texels, texels));
    builder.build()
}

/// T is linear: its columns summed are the image under uniform light, from the very same paths.
#[test]
fn columns_summed_are_the_image_under_uniform_light() {
    let texels = all_on(&trace(glossy_room(16), settings(32, 6)));
    let whole = all_on(&trace(glossy_room(1), settings(32, 6)));
    for (row, (a, b)) in texels.iter().zip(&whole).enumerate() {
        // The same terms in another order: some roundings of f32.
        assert!((a - b).abs() <= 1e-5 * b.abs() + 1e-7, "row {row}: {a} {b}");
    }
}

#[test]
fn the_stated_noise_is_the_noise_that_repeated_renders_show() {
    let (repeats, columns) = (24, 16);
    let renders: Vec<_> = renders(tracer(glossy_room(4), settings(16, 4)), settings(16, 4), 0..repeats).collect();
    let (mut stated, mut shown, mut probes_stated, mut probes_shown) = (0.0, 0.0, 0.0, 0.0);
    for (block, first) in renders[0].iter().enumerate() {
        let of = |k: usize| &renders[k][block];
        let rows = first.block.rows();
        let deviations = |value: &dyn Fn(usize) -> f64| {
            let values: Vec<f64> = (0..repeats as usize).map(value).collect();
            let mean = values.iter().sum::<f64>() / repeats as f64;
            values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (repeats - 1) as f64
        };
        for row in 0..rows {
            for column in 0..columns {
                shown += deviations(&|k| f64::from(of(k).block.view().at(row, column)));
            }
            let all = |k: usize| (0..columns).map(|c| f64::from(of(k).block.view().at(row, c))).sum::<f64>();
            probes_shown += deviations(&all);
        }
        for k in 0..repeats as usize {
            let noise = of(k).noise.as_ref().unwrap();
            stated += noise.mean_variance() * (rows * columns) as f64 / repeats as f64;
            let by_column: f64 = noise.column_variance.iter().map(|&v| f64::from(v)).sum::<f64>() / columns as f64;
            assert!((by_column / noise.mean_variance() - 1.0).abs() < 1e-4, "marginals of the same squares");
            probes_stated += noise.probes[..rows].iter().map(|&p| f64::from(p).powi(2)).sum::<f64>() / repeats as f64;
        }
    }
    // Both are estimates from some 10,000 rows and 24 repeats, but heavy-tailed ones.
    assert!((stated / shown - 1.0).abs() < 0.1, "entries: stated {stated}, shown {shown}");
    assert!((probes_stated / probes_shown - 1.0).abs() < 0.1, "all on: stated {probes_stated}, shown {probes_shown}");
}

#[test]
fn bad_requests_are_refused_with_a_reason() {
    let refused = |scene: ltm::scene::Scene, width, columns, settings| {
        let shape = MatrixShape::new(width, 16, columns, 8).unwrap();
        Tracer::new(scene, shape, settings).unwrap_err().to_string()
    };
    let good = settings(4, 4);
    assert!(refused(glossy_room(2), 17, 4, good).contains("17×16"));
    assert!(refused(glossy_room(2), 16, 5, good).contains("5"));
    assert!(refused(glossy_room(2), 16, 4, TraceSettings { samples_per_pixel: 0, ..good }).contains("samples"));
    assert!(refused(glossy_room(2), 16, 4, TraceSettings { max_depth: 0, ..good }).contains("depth"));
    let mut flat = glossy_room(1);
    let Emitter::Area(emitter) = &mut flat.emitters[0] else { unreachable!() };
    emitter.layout = ltm::scene::AreaLayout::Whole;
    for t in emitter.triangles.clone() {
        let [a, _, _] = flat.mesh.triangles[t as usize].vertices;
        flat.mesh.triangles[t as usize].vertices = [a; 3];
    }
    assert!(refused(flat, 16, 1, good).contains("has no area"));
    let mut outside = glossy_room(2);
    outside.mesh.triangles[3].vertices[1] = 1 << 30;
    assert!(refused(outside, 16, 4, good).contains("triangle 3"));
}

#[test]
fn one_sample_has_no_noise_to_state() {
    let blocks = trace(glossy_room(2), settings(1, 4));
    assert!(blocks.iter().all(|(block, stats)| block.noise.is_none() && stats.paths == 64 && stats.rays > 64));
}
