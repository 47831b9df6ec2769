//! Light that mirrors and smooth glass throw: by photons, beside closed forms and beside paths from the camera.

use std::sync::Arc;

use glam::{Mat3, Vec3};
use ltm::light::{EnvironmentMapping, LightKind};
use ltm::matrix::{BlockSource, CHANNELS, TracedBlock};
use ltm::scene::{Camera, Emitter, EnvironmentEmitter, IesProfile, Paint, PointEmitter, Projection, Scene, Surface};
use ltm::trace::{Tracer, TracerMemory};

use crate::scenes::{Builder, blocks, camera, lambert, mean, renders, settings, tracer};

const WHITE: f32 = 0.8;
const SILVER: f32 = 0.9;
const INDEX: f32 = 1.33;

fn mirror() -> Surface {
    Surface::Mirror { reflectance: Paint::Constant(Vec3::splat(SILVER)) }
}

fn glass(ior: f32) -> Surface {
    Surface::Dielectric { ior, transmittance: Vec3::ONE }
}

/// A floor or a ceiling at height `y` of ±`half`, its front up or down.
fn level(builder: &mut Builder, y: f32, half: f32, up: bool, surface: Surface) {
    let (u, v) = if up { (Vec3::Z, Vec3::X) } else { (Vec3::X, Vec3::Z) };
    builder.quad(Vec3::new(-half, y, -half), u * 2.0 * half, v * 2.0 * half, surface);
}

/// Images of every column, block by block: columns × rows.
pub(crate) fn columns(blocks: &[TracedBlock]) -> Vec<Vec<f32>> {
    let mut columns = vec![Vec::new(); blocks[0].block.columns()];
    for block in blocks {
        let view = block.block.view();
        let entries = view.entries().chunks_exact(view.rows());
        columns.iter_mut().zip(entries).for_each(|(column, entries)| column.extend(entries));
    }
    columns
}

/// Radiance of a white level as the camera sees it, of an irradiance: in the order of rows, red alone.
fn expected(camera: &Camera, y: f32, irradiance: impl Fn(Vec3) -> f32) -> Vec<f32> {
    const FINE: u32 = 4;
    let pixel = |x: u32, row: u32| {
        let at = |k: u32| (k as f32 + 0.5) / FINE as f32;
        let samples = (0..FINE * FINE).map(|k| {
            let image = glam::Vec2::new(x as f32 + at(k % FINE), row as f32 + at(k / FINE));
            let direction = camera.direction(image);
            irradiance(camera.eye + direction * ((y - camera.eye.y) / direction.y))
        });
        WHITE / std::f32::consts::PI * samples.sum::<f32>() / (FINE * FINE) as f32
    };
    (0..camera.height).flat_map(|row| (0..camera.width).map(move |x| (x, row))).map(|(x, row)| pixel(x, row)).collect()
}

/// The red of a column, pixel by pixel as in [`expected`]: blocks have `side` pixels a side.
fn red(tracer: &Tracer, column: usize) -> Vec<f32> {
    let shape = tracer.shape();
    let mut image = vec![0.0; (shape.width() * shape.height()) as usize];
    for (id, block) in shape.blocks().zip(blocks(tracer)) {
        let rect = shape.rect(id);
        for pixel in 0..rect.pixels() as u32 {
            let (x, y) = (rect.x + pixel % rect.width, rect.y + pixel / rect.width);
            image[(y * shape.width() + x) as usize] = block.block.view().at(pixel as usize, column);
        }
    }
    image
}

fn relative_error(found: &[f32], expected: &[f32]) -> f64 {
    let square: f64 = found.iter().zip(expected).map(|(f, e)| f64::from(f - e).powi(2)).sum();
    let size: f64 = expected.iter().map(|e| f64::from(*e).powi(2)).sum();
    (square / size).sqrt()
}

/// A lamp between a mirror below and a white ceiling, which it lights itself and by its mirror image.
fn above_a_mirror(lamp: Emitter, kind: LightKind, side: u32) -> Scene {
    let view = camera(Vec3::new(0.2, 1.2, 0.1), Vec3::new(0.3, 2.0, -0.1), 70.0, side);
    let mut builder = Builder::new(view);
    // As large as what is seen needs, so that most photons come there.
    level(&mut builder, 0.0, 0.6, true, mirror());
    level(&mut builder, 2.0, 6.0, false, lambert(WHITE));
    builder.bodiless("lamp", kind, lamp);
    builder.build()
}

/// Irradiance of a lamp of intensity 1 on a level above or below it.
fn from_lamp(lamp: Vec3, point: Vec3) -> f32 {
    let offset = point - lamp;
    offset.y.abs() / offset.length().powi(3)
}

#[test]
fn a_lamp_over_a_mirror_lights_as_its_mirror_image_does() {
    let lamp = Vec3::new(0.1, 1.0, 0.2);
    let below = Vec3::new(lamp.x, -lamp.y, lamp.z);
    // Of an intensity that falls from 1 at the nadir to 0.5 at the horizon and is 0 above it.
    let profile = IesProfile {
        vertical_radians: vec![0.0, std::f32::consts::FRAC_PI_2],
        horizontal_radians: vec![0.0],
        intensity: vec![1.0, 0.5],
    };
    // A luminaire's nadir is −z.
    let axes = Mat3::from_rotation_x(-std::f32::consts::FRAC_PI_2);
    let ies = PointEmitter::Ies { position: lamp, world_from_luminaire: axes, profile };
    let wide = PointEmitter::Spot {
        position: lamp,
        direction: Vec3::NEG_Y,
        inner_radians: 1.56,
        outer_radians: std::f32::consts::FRAC_PI_2,
    };
    let falling = |point: Vec3| {
        let offset = point - below;
        1.0 - (offset.y / offset.length()).acos() / std::f32::consts::PI
    };
    type Relative<'a> = &'a dyn Fn(Vec3) -> f32;
    let ball = PointEmitter::Ball { position: lamp, radius: 0.05, cone: None };
    let lamps: [(PointEmitter, LightKind, f32, Relative<'_>); 4] = [
        (PointEmitter::Point { position: lamp }, LightKind::Point, 1.0, &|_| 1.0),
        (wide, LightKind::Spot, 0.0, &|_| 1.0),
        (ies, LightKind::Ies, 0.0, &falling),
        // As bright as a point, wherever it is whole in sight.
        (ball, LightKind::Point, 1.0, &|_| 1.0),
    ];
    for (emitter, kind, direct, relative) in lamps {
        let scene = above_a_mirror(Emitter::Point(emitter), kind, 16);
        let expected = expected(&scene.camera, 2.0, |point| {
            direct * from_lamp(lamp, point) + SILVER * relative(point) * from_lamp(below, point)
        });
        let found = red(&tracer(scene, settings(64, 3)), 0);
        // Of 65,536 photons some 10,000 come into view, evenly: a deviation below 1 %. A gathering holds some 30, of 18 %.
        let difference = mean(&found) / mean(&expected) - 1.0;
        assert!(difference.abs() < 0.02, "{kind:?}: {} for {}", mean(&found), mean(&expected));
        assert!(relative_error(&found, &expected) < 0.25, "{kind:?}: {}", relative_error(&found, &expected));
    }
}

/// The sun shines past the edge of a white ceiling, and from a mirror below it onto the ceiling.
#[test]
fn a_mirror_sends_the_sun_onto_what_is_above_it() {
    let towards = Vec3::new(0.6, 0.8, 0.0);
    for angular_radius_radians in [0.0, 0.03] {
        let mut builder = Builder::new(camera(Vec3::new(-1.5, 1.0, 0.1), Vec3::new(-1.5, 2.0, 0.1), 30.0, 16));
        level(&mut builder, 0.0, 1.0, true, mirror());
        // What is seen, about x = −1.5 at a height of 2, has its light from x = 0 on the mirror, and that from x = 1.5.
        builder.quad(Vec3::new(-8.0, 2.0, -8.0), Vec3::X * 8.5, Vec3::Z * 16.0, lambert(WHITE));
        let sun = PointEmitter::Sun { towards, angular_radius_radians };
        builder.bodiless("sun", LightKind::Sun, Emitter::Point(sun));
        let found = mean(&red(&tracer(builder.build(), settings(64, 3)), 0));
        let expected = f64::from(WHITE * SILVER / std::f32::consts::PI * towards.y);
        // Some 3,000 photons, evenly: a deviation below 2 %.
        assert!((found / expected - 1.0).abs() < 0.04, "{angular_radius_radians}: {found} for {expected}");
    }
}

/// Share that passes from air into a medium.
fn passed(cosine: f32, cosine_inside: f32) -> f32 {
    let parallel = (INDEX * cosine - cosine_inside) / (INDEX * cosine + cosine_inside);
    let perpendicular = (cosine - INDEX * cosine_inside) / (cosine + INDEX * cosine_inside);
    1.0 - 0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// A lamp above the surface of water lights the ground: rays at an angle `θ` come down at `ρ = h tan θ + t tan θ′`, where
/// `sin θ = n sin θ′`, with the Fresnel share that passes: `E = F sin θ / (ρ dρ/dθ)`.
#[test]
fn a_lamp_above_water_lights_the_ground_by_what_is_refracted() {
    let (height, depth) = (1.2f32, 1.1f32);
    let at = |theta: f32| {
        let (sine, cosine) = theta.sin_cos();
        let sine_inside = sine / INDEX;
        let cosine_inside = (1.0 - sine_inside * sine_inside).sqrt();
        let radius = height * sine / cosine + depth * sine_inside / cosine_inside;
        let slope = height / (cosine * cosine) + depth * cosine / (INDEX * cosine_inside.powi(3));
        (radius, passed(cosine, cosine_inside) * sine / (radius * slope))
    };
    let irradiance = |radius: f32| {
        let (mut low, mut high) = (1e-4f32, 1.55f32);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if at(middle).0 < radius { low = middle } else { high = middle }
        }
        at(low).1
    };
    // The camera is in the water.
    let mut builder = Builder::new(camera(Vec3::new(0.3, -0.1, 0.2), Vec3::new(0.4, -depth, 0.1), 50.0, 16));
    level(&mut builder, 0.0, 0.8, true, glass(INDEX));
    level(&mut builder, -depth, 8.0, true, lambert(WHITE));
    let lamp = PointEmitter::Point { position: Vec3::Y * height };
    builder.bodiless("lamp", LightKind::Point, Emitter::Point(lamp));
    let scene = builder.build();
    let expected = expected(&scene.camera, -depth, |point| irradiance(point.x.hypot(point.z)));
    let found = red(&tracer(scene, settings(64, 3)), 0);
    assert!((mean(&found) / mean(&expected) - 1.0).abs() < 0.02, "{} for {}", mean(&found), mean(&expected));
    assert!(relative_error(&found, &expected) < 0.25, "{}", relative_error(&found, &expected));
}

/// As many photons as paths: sixteen times as many have `16^(2/3)` in reach and `16^(−1/3) = 0.40` of the error.
#[test]
fn the_error_falls_with_the_number_of_samples() {
    let lamp = Vec3::new(0.1, 1.0, 0.2);
    let below = Vec3::new(lamp.x, -lamp.y, lamp.z);
    let error = |samples| {
        let scene = above_a_mirror(Emitter::Point(PointEmitter::Point { position: lamp }), LightKind::Point, 64);
        let expected = expected(&scene.camera, 2.0, |p| from_lamp(lamp, p) + SILVER * from_lamp(below, p));
        relative_error(&red(&tracer(scene, settings(samples, 3)), 0), &expected)
    };
    let (few, many) = (error(32), error(512));
    assert!(many < 0.5 * few, "{few} with 32 samples, {many} with 512");
    // Beyond a million photons they come in more maps: four times as many have `4^(−1/3) = 0.63` of the error.
    let more = error(2048);
    assert!(more < 0.75 * many, "{many} with 512 samples, {more} with 2,048");
}

/// A box with a mirror ball and a glass ball and a rough metal; under a panel, a lamp that shines both ways, a sky and a sun.
fn lit_by_everything_that_paths_find() -> Scene {
    lit_by_everything_under(SKIES[0])
}

fn lit_by_everything_under((mapping, kind): (EnvironmentMapping, LightKind)) -> Scene {
    let mut builder = Builder::new(camera(Vec3::new(0.5, 0.5, 1.6), Vec3::new(0.5, 0.4, 0.0), 50.0, 16));
    for (origin, u, v) in [
        (Vec3::ZERO, Vec3::Z, Vec3::X),
        (Vec3::ZERO, Vec3::X, Vec3::Y),
        (Vec3::ZERO, Vec3::Y, Vec3::Z),
        (Vec3::X, Vec3::Z, Vec3::Y),
    ] {
        builder.quad(origin, u, v, lambert(0.6));
    }
    builder.sphere(Vec3::new(0.3, 0.22, 0.4), 0.18, 48, mirror());
    builder.sphere(Vec3::new(0.7, 0.25, 0.6), 0.18, 48, glass(1.5));
    let gold = Surface::RoughConductor { specular: Paint::Constant(Vec3::splat(0.8)), alpha: 0.15 };
    builder.sphere(Vec3::new(0.55, 0.15, 0.2), 0.12, 48, gold);
    let sheet = Surface::ThinDielectric { ior: 1.5, transmittance: Vec3::ONE };
    builder.quad(Vec3::new(0.02, 0.3, 0.3), Vec3::new(0.1, 0.0, 0.3), Vec3::Y * 0.5, sheet);
    builder.panel("panel", Vec3::new(0.35, 0.98, 0.25), Vec3::X * 0.3, Vec3::Z * 0.3, (2, 2));
    let both = builder.quad(Vec3::new(0.85, 0.7, 0.3), Vec3::Y * 0.2, Vec3::Z * 0.3, Surface::Black).to_vec();
    builder.two_sided_lamp("both", &both);
    let world_from_environment = Mat3::from_rotation_y(0.4);
    let sky = EnvironmentEmitter { mapping, world_from_environment, is_split: false };
    builder.bodiless("sky", kind, Emitter::Environment(sky));
    let towards = Vec3::new(0.2, 0.9, 0.5).normalize();
    let sun = PointEmitter::Sun { towards, angular_radius_radians: 0.15 };
    builder.bodiless("sun", LightKind::Sun, Emitter::Point(sun));
    builder.build()
}

/// Means of each column over each quarter of the image, and the variance of that mean, from renders of different seeds.
fn quarters(renders: impl Iterator<Item = Vec<TracedBlock>>) -> Vec<(f64, f64)> {
    let of_columns = |c: &Vec<f32>| c.chunks_exact(c.len() / 4).map(mean).collect::<Vec<f64>>();
    let renders: Vec<Vec<f64>> = renders.map(|blocks| columns(&blocks).iter().flat_map(of_columns).collect()).collect();
    let n = renders.len();
    let statistic = |at: usize| {
        let mean = renders.iter().map(|r| r[at]).sum::<f64>() / n as f64;
        let variance = renders.iter().map(|r| (r[at] - mean).powi(2)).sum::<f64>() / (n * (n - 1)) as f64;
        (mean, variance)
    };
    (0..renders[0].len()).map(statistic).collect()
}

/// The sky as an octahedral map and as one of latitude and longitude.
const SKIES: [(EnvironmentMapping, LightKind); 2] = [
    (EnvironmentMapping::Octahedral { side: 2 }, LightKind::Octahedral { side: 2 }),
    (EnvironmentMapping::LatLong { across: 3, down: 2 }, LightKind::LatLong { across: 3, down: 2 }),
];

#[test]
fn photons_bring_the_light_that_paths_from_the_camera_find() {
    photons_and_paths_agree(Arc::new(lit_by_everything_under(SKIES[0])));
}

#[test]
fn photons_bring_the_light_that_paths_find_under_a_sky_of_latitude_and_longitude() {
    photons_and_paths_agree(Arc::new(lit_by_everything_under(SKIES[1])));
}

fn photons_and_paths_agree(scene: Arc<Scene>) {
    let tracer = |samples| tracer(Arc::clone(&scene), settings(samples, 8));
    let ours = quarters(renders(tracer(1), settings(64, 8), 0..16));
    let paths = quarters(renders(tracer(1).without_photons(), settings(1024, 8), 100..116));
    assert!(tracer(64).photon_count() > 10_000);
    let (mut squares, mut difference, mut variance) = (0.0, 0.0, 0.0);
    for (at, ((a, va), (b, vb))) in ours.iter().zip(&paths).enumerate() {
        // What is blurred across a quarter's edge, and darkened where surfaces meet: half a percent.
        let z = (a - b) / (va + vb + (0.005 * b).powi(2)).sqrt();
        assert!(z.abs() < 4.5, "column {}, quarter {}: {a} for {b}, {z:.1} deviations", at / 4, at % 4);
        squares += z * z / ours.len() as f64;
        (difference, variance) = (difference + a - b, variance + va + vb);
    }
    let total: f64 = paths.iter().map(|(b, _)| b).sum();
    assert!(squares < 2.0, "mean z² {squares}");
    assert!((difference / total).abs() < 0.004 + 4.0 * variance.sqrt() / total, "{}", difference / total);
}

#[test]
fn photons_are_the_same_with_any_number_of_threads() {
    let scene = Arc::new(lit_by_everything_that_paths_find());
    let traced = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| blocks(&tracer(Arc::clone(&scene), settings(6, 6))))
    };
    let alone = traced(1);
    assert_eq!(alone, traced(5));
    // And a tracer that had other settings before.
    let again = tracer(Arc::clone(&scene), settings(2, 2)).with_settings(settings(6, 6)).unwrap();
    assert_eq!(alone, blocks(&again));
}

/// Nothing is sent where there is no mirror and no glass, none that light reaches, or no path long enough.
#[test]
fn scenes_without_caustics_trace_the_same_rays_to_the_same_bytes() {
    let room = |with_mirror: bool| {
        let mut builder = Builder::new(camera(Vec3::new(0.5, 0.5, 0.98), Vec3::new(0.5, 0.4, 0.0), 75.0, 16));
        builder.room(Vec3::ZERO, Vec3::ONE, lambert(0.7));
        builder.panel("panel", Vec3::new(0.25, 0.99, 0.25), Vec3::X * 0.5, Vec3::Z * 0.5, (2, 2));
        if with_mirror {
            // Behind the wall.
            builder.quad(Vec3::new(-1.0, -1.0, -1.0), Vec3::X, Vec3::Y, mirror());
        }
        builder.build()
    };
    for (scene, depth) in [(room(false), 6), (room(true), 6), (lit_by_everything_that_paths_find(), 2)] {
        let scene = Arc::new(scene);
        let [ours, paths] = [true, false].map(|with_photons| {
            let tracer = tracer(Arc::clone(&scene), settings(8, depth));
            let tracer = if with_photons { tracer } else { tracer.without_photons() };
            assert_eq!(tracer.photon_count(), 0);
            let traced = |id| {
                let mut block = TracedBlock::default();
                (tracer.trace_block(id, &mut block), block)
            };
            tracer.shape().blocks().map(traced).collect::<Vec<_>>()
        });
        assert_eq!(ours, paths);
    }
    // What no light reaches is found out with the first of the photons; the others need none.
    let sent = |scene: Scene, depth: u32| {
        let tracer = tracer(Arc::new(scene), settings(64, depth));
        (tracer.photon_cost().sent, Tracer::photons_sent(tracer.scene(), tracer.shape(), settings(64, depth)))
    };
    assert_eq!(sent(room(false), 6), (0, 0));
    assert_eq!(sent(lit_by_everything_that_paths_find(), 2), (0, 0));
    let (in_vain, planned) = sent(room(true), 6);
    assert!(in_vain > 0 && 4 * in_vain <= planned, "{in_vain} of {planned}");
    let shape = tracer(room(false), settings(8, 6)).shape();
    let memory = TracerMemory { scene: &room(false), shape, clusters: 1, settings: settings(8, 6) };
    assert_eq!(memory.photon_bytes(), 0);
}

/// The halves of the samples gather different photons: what they differ by is what repeated renders differ by.
#[test]
fn the_noise_of_photons_is_stated() {
    let mut scene = above_a_mirror(
        Emitter::Point(PointEmitter::Point { position: Vec3::new(0.1, 1.0, 0.2) }),
        LightKind::Point,
        16,
    );
    scene.camera.projection = Projection::Perspective { vertical_fov_radians: 1.0 };
    let renders: Vec<_> = renders(tracer(scene, settings(1, 3)), settings(16, 3), 0..24).collect();
    let (mut stated, mut shown) = (0.0, 0.0);
    for (block, first) in renders[0].iter().enumerate() {
        let rows = first.block.rows();
        assert_eq!(rows % CHANNELS, 0);
        let entry = |render: &Vec<TracedBlock>, row| f64::from(render[block].block.view().at(row, 0));
        for row in 0..rows {
            let mean = renders.iter().map(|r| entry(r, row)).sum::<f64>() / 24.0;
            shown += renders.iter().map(|r| (entry(r, row) - mean).powi(2)).sum::<f64>() / 23.0;
        }
        let of = |render: &Vec<TracedBlock>| render[block].noise.as_ref().unwrap().mean_variance() * rows as f64;
        stated += renders.iter().map(of).sum::<f64>() / 24.0;
    }
    assert!(shown > 0.0 && (stated / shown - 1.0).abs() < 0.1, "stated {stated}, shown {shown}");
}
