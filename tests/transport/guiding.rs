//! Paths that are guided to surfaces close to lamps.

use glam::Vec3;
use ltm::light::{EnvironmentMapping, LightKind};
use ltm::scene::{Emitter, EnvironmentEmitter, PointEmitter, Scene, Surface};

use crate::scenes::{Builder, blocks, camera, lambert, mean, renders, settings, tracer};
use crate::z_test::compare;

/// Renders of each kind.
const REPEATS: u64 = 16;

/// A shade of four walls, open above and below, around a point light, and a bulb close to the light.
fn shaded_lamp(builder: &mut Builder, centre: Vec3, half: f32, surface: Surface) {
    let height = Vec3::Y * 3.0 * half;
    for (out, along) in [(Vec3::X, Vec3::Z), (Vec3::Z, -Vec3::X), (-Vec3::X, -Vec3::Z), (-Vec3::Z, Vec3::X)] {
        builder.quad(centre + half * (out - along) - 0.5 * height, 2.0 * half * along, height, surface);
    }
    builder.sphere(centre - Vec3::Y * 0.4 * half, 0.2 * half, 6, surface);
    builder.bodiless("lamp", LightKind::Point, Emitter::Point(PointEmitter::Point { position: centre }));
}

fn room(half: f32) -> Scene {
    let mut builder = Builder::new(camera(Vec3::new(0.5, 0.5, 0.95), Vec3::new(0.5, 0.45, 0.0), 75.0, 8));
    builder.room(Vec3::ZERO, Vec3::ONE, lambert(0.6));
    let coat = Surface::Coated {
        reflectance: ltm::scene::Paint::Constant(Vec3::splat(0.5)),
        specular: Vec3::splat(0.04),
        alpha: 0.3,
    };
    builder.quad(Vec3::new(0.1, 0.02, 0.1), Vec3::Z * 0.8, Vec3::X * 0.8, coat);
    shaded_lamp(&mut builder, Vec3::new(0.4, 0.6, 0.4), half, lambert(0.8));
    builder.panel("panel", Vec3::new(0.6, 0.99, 0.3), Vec3::X * 0.3, Vec3::Z * 0.3, (2, 1));
    builder.build()
}

/// The same mean as without guiding, in every column.
#[test]
fn guiding_does_not_change_the_mean() {
    let entries = |blocks: Vec<ltm::matrix::TracedBlock>| -> Vec<f64> {
        blocks.iter().flat_map(|block| block.block.entries().to_vec()).map(f64::from).collect()
    };
    let (guided, plain) = (tracer(room(0.04), settings(1, 4)), tracer(room(0.04), settings(1, 4)).without_guiding());
    assert!(guided.is_guided() && !plain.is_guided());
    let of = |tracer, samples, first: u64| -> Vec<Vec<f64>> {
        renders(tracer, settings(samples, 4), first..first + REPEATS).map(entries).collect()
    };
    let (guided, plain) = (of(guided, 64, 0), of(plain, 1024, 100));
    let n = REPEATS as f64;
    let means: Vec<f64> = (0..plain[0].len()).map(|at| plain.iter().map(|r| r[at]).sum::<f64>() / n).collect();
    let variances: Vec<f64> = (0..means.len())
        .map(|at| plain.iter().map(|r| (r[at] - means[at]).powi(2)).sum::<f64>() / (n - 1.0) / n)
        .collect();
    let found = compare(&guided, (&means, &variances), |entry| entry % 3 == 0);
    // Variances from 16 draws: the mean of z² is 15/13 where both have as much. The whole image: four deviations.
    assert!(found.mean_square < 1.35 && found.whole.abs() < 4.0, "{found}");
    // Of a sixteenth of the samples, whose variance would be sixteen times as much: measured is three times.
    let noise = |renders: &[Vec<f64>]| -> f64 {
        let of = |at: usize| {
            let mean = renders.iter().map(|render| render[at]).sum::<f64>() / n;
            renders.iter().map(|render| (render[at] - mean).powi(2)).sum::<f64>()
        };
        (0..renders[0].len()).map(of).sum()
    };
    assert!(noise(&guided) < 8.0 * noise(&plain), "{} and {}", noise(&guided), noise(&plain));
}

/// White surfaces and clear panes under a white sky cannot be seen, whatever directions their paths take.
#[test]
fn a_white_shade_vanishes_in_a_white_furnace_and_its_panes_too() {
    for has_panes in [false, true] {
        let mut builder = Builder::new(camera(Vec3::new(0.0, 0.4, 3.0), Vec3::ZERO, 45.0, 16));
        builder.quad(Vec3::new(-1.0, -0.5, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0, lambert(1.0));
        shaded_lamp(&mut builder, Vec3::ZERO, 0.05, lambert(1.0));
        if has_panes {
            let pane = Surface::ThinDielectric { ior: 1.5, transmittance: Vec3::ONE };
            for (out, along) in [(Vec3::X, Vec3::Z), (Vec3::Z, -Vec3::X), (-Vec3::X, -Vec3::Z), (-Vec3::Z, Vec3::X)] {
                builder.quad(0.2 * (out - along - Vec3::Y), 0.4 * along, 0.4 * Vec3::Y, pane);
            }
        }
        let mapping = EnvironmentMapping::Octahedral { side: 4 };
        let sky = EnvironmentEmitter { mapping, world_from_environment: glam::Mat3::IDENTITY, is_split: false };
        builder.bodiless("sky", LightKind::Octahedral { side: 4 }, Emitter::Environment(sky));
        let scene = builder.build();
        assert!(tracer(scene.clone(), settings(1, 2)).is_guided());
        let sky_alone: Vec<f32> = {
            let blocks = blocks(&tracer(scene, settings(256, 256)));
            let of = |block: &ltm::matrix::TracedBlock, row: usize| {
                let view = block.block.view();
                (1..view.columns()).map(|column| view.at(row, column)).sum::<f32>()
            };
            blocks.iter().flat_map(|block| (0..block.block.rows()).map(move |row| of(block, row))).collect()
        };
        assert!((mean(&sky_alone) - 1.0).abs() < 0.01, "panes {has_panes}: {}", mean(&sky_alone));
    }
}
