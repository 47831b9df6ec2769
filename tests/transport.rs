//! What tracing promises: the right light in the right column, the same bytes every time.

#[path = "transport/scenes.rs"]
mod scenes;

use glam::Vec3;
use ltm::light::LightKind;
use ltm::matrix::TracedBlock;
use ltm::scene::{Emitter, EnvironmentEmitter, EnvironmentMapping, Surface};
use scenes::{Builder, all_on, camera, lambert, mean, settings, trace, tracer};

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

/// Under a sky of 1 in every direction, what neither absorbs nor emits cannot be seen.
#[test]
fn glass_and_thin_sheets_vanish_in_a_white_furnace() {
    let glass = Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE };
    let sheet = Surface::ThinDielectric { ior: 1.5, transmittance: Vec3::ONE };
    for surface in [glass, sheet] {
        let mut builder = Builder::new(camera(Vec3::new(0.0, 0.0, 3.0), Vec3::ZERO, 45.0, 16));
        builder.sphere(Vec3::ZERO, 1.0, 32, surface);
        let sky = EnvironmentEmitter {
            mapping: EnvironmentMapping::Octahedral { side: 4 },
            world_from_environment: glam::Mat3::IDENTITY,
        };
        builder.bodiless("sky", LightKind::Octahedral { side: 4 }, Emitter::Environment(sky));
        let pixels = all_on(&trace(builder.build(), settings(64, 64)));
        // No variance: every path carries 1 exactly. What is lost are paths whose refracted direction the interpolated
        // normal allows and the triangle does not, at the rim.
        assert!((mean(&pixels) - 1.0).abs() < 2e-3, "{surface:?}: {}", mean(&pixels));
        let middle: Vec<f32> = pixels.iter().copied().filter(|p| (p - 1.0).abs() > 1e-4).collect();
        assert!(middle.len() < pixels.len() / 20, "{surface:?}: {} of {}", middle.len(), pixels.len());
    }
}
