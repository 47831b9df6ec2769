//! Against another renderer: images of single columns by Mitsuba 3, with their variance (`tests/references/make.py`).

use std::sync::OnceLock;

use glam::Vec3;
use ltm::light::{Clusters, LightKind};
use ltm::matrix::{CHANNELS, SeenEmission, TracedBlock};
use ltm::scene::{Emitter, Paint, PointEmitter, Scene, Surface};
use ltm::trace::Tracer;

use crate::layers::planes;
use crate::lobes;
use crate::scenes::{self, Builder, camera, lambert, settings, tracer};
use crate::z_test::{Comparison, compare, reference, write_evidence};

const SIDE: usize = 16;
const TEXELS: usize = 2;
/// Rings of a ball that stands for a perfect sphere.
pub(crate) const FINE: u32 = 128;
/// Balls of glass that are smooth, with the sharpest caustics.
const GLASS: [&str; 2] = ["smooth_glass", "perfect_glass"];
const ENTRIES: usize = TEXELS * CHANNELS * SIDE * SIDE;

/// A room with a ball behind the upper edge of the picture, and a point light and a spot at its other side.
fn scene_of_points(name: &str) -> Scene {
    let mut builder = Builder::new(camera(Vec3::new(0.5, 0.5, 0.95), Vec3::new(0.5, 0.4, 0.0), 45.0, SIDE as u32));
    builder.room(Vec3::ZERO, Vec3::ONE, lambert(0.5));
    let (surface, position) = match name {
        "point_glass" => (Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE }, Vec3::new(0.5, 0.9, 0.75)),
        "point_mirror" => {
            (Surface::Mirror { reflectance: Paint::Constant(Vec3::splat(0.9)) }, Vec3::new(0.5, 0.85, 0.25))
        }
        _ => unreachable!("{name}"),
    };
    let centre = Vec3::new(0.5, 0.8, 0.5);
    builder.sphere(centre, 0.1, FINE, surface);
    let direction = (centre - position).normalize();
    let [inner_radians, outer_radians] = [29.999f32, 30.0].map(f32::to_radians);
    builder.bodiless("point", LightKind::Point, Emitter::Point(PointEmitter::Point { position }));
    let spot = PointEmitter::Spot { position, direction, inner_radians, outer_radians };
    builder.bodiless("spot", LightKind::Spot, Emitter::Point(spot));
    builder.build()
}

/// The scene of this name, as the script builds it.
fn scene(name: &str) -> Scene {
    let mut builder = Builder::new(camera(Vec3::new(0.5, 0.5, 0.95), Vec3::new(0.5, 0.4, 0.0), 75.0, SIDE as u32));
    builder.room(Vec3::ZERO, Vec3::ONE, lambert(0.5));
    let ceiling = (Vec3::new(0.25, 0.98, 0.25), Vec3::X * 0.5, Vec3::Z * 0.5);
    let mirror = Surface::Mirror { reflectance: Paint::Constant(Vec3::splat(0.9)) };
    let glossy = Surface::RoughConductor { specular: Paint::Constant(Vec3::ONE), alpha: 0.2 };
    let glass = Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE };
    let ball = |builder: &mut Builder, rings, surface| {
        builder.sphere(Vec3::new(0.5, 0.35, 0.4), 0.25, rings, surface);
        ceiling
    };
    if lobes::NAMES.contains(&name) {
        return lobes::scene(name, builder, |builder| {
            builder.panel("panel", ceiling.0, ceiling.1, ceiling.2, (TEXELS as u32, 1))
        });
    }
    let (origin, u, v) = match name.trim_start_matches("smooth ") {
        "diffuse" => {
            builder.sphere(Vec3::new(0.4, 0.25, 0.4), 0.2, 12, lambert(0.8));
            ceiling
        }
        "reflections" => {
            builder.sphere(Vec3::new(0.3, 0.25, 0.4), 0.2, 24, mirror);
            builder.sphere(Vec3::new(0.72, 0.22, 0.4), 0.18, 24, glossy);
            ceiling
        }
        "caustics" => {
            builder.sphere(Vec3::new(0.5, 0.35, 0.4), 0.25, 24, glass);
            ceiling
        }
        "smooth_mirror" => ball(&mut builder, 24, mirror),
        "smooth_glossy" => ball(&mut builder, 24, glossy),
        "smooth_glass" => ball(&mut builder, 24, glass),
        "coarse_mirror" => ball(&mut builder, 8, mirror),
        "coarse_glossy" => ball(&mut builder, 8, glossy),
        "coarse_glass" => ball(&mut builder, 8, glass),
        "perfect_mirror" => ball(&mut builder, FINE, mirror),
        "perfect_glossy" => ball(&mut builder, FINE, glossy),
        "perfect_glass" => ball(&mut builder, FINE, glass),
        "light_in_view" => {
            let sheet = Surface::ThinDielectric { ior: 1.5, transmittance: Vec3::ONE };
            builder.quad(Vec3::new(0.1, 0.2, 0.3), Vec3::X * 0.5, Vec3::Y * 0.6, sheet);
            (Vec3::new(0.3, 0.3, 0.02), Vec3::X * 0.4, Vec3::Y * 0.4)
        }
        _ => unreachable!("{name}"),
    };
    builder.panel("panel", origin, u, v, (TEXELS as u32, 1));
    let mut scene = builder.build();
    if !name.starts_with("smooth") && !name.starts_with("coarse") && !name.starts_with("perfect") {
        scene.mesh.vertices.iter_mut().for_each(|vertex| vertex.normal = Vec3::ZERO);
    }
    scene
}

/// One render in the reference's order.
fn image(blocks: &[TracedBlock]) -> Vec<f64> {
    image_of(blocks, |traced, row, column| traced.block.view().at(row, column))
}

/// Values of rows and columns of all blocks, in the reference's order.
fn image_of(blocks: &[TracedBlock], value: impl Fn(&TracedBlock, usize, usize) -> f32) -> Vec<f64> {
    let mut image = vec![0.0; ENTRIES];
    for (index, traced) in blocks.iter().enumerate() {
        for column in 0..TEXELS {
            for row in 0..traced.block.rows() {
                let (channel, pixel) = (row / 64, row % 64);
                let (x, y) = (index % 2 * 8 + pixel % 8, index / 2 * 8 + pixel / 8);
                image[((column * CHANNELS + channel) * SIDE + y) * SIDE + x] = f64::from(value(traced, row, column));
            }
        }
    }
    image
}

/// Compares `name` with the reference `with`, of which the order is `[texel][channel][y][x]`.
pub(crate) fn compared(name: &str, with: &str) -> (Comparison, String) {
    match shared_renders(name) {
        Some(renders) => told(name, with, &renders.iter().map(|blocks| image(blocks)).collect::<Vec<_>>()),
        None => compared_by(name, with, |tracer| tracer),
    }
}

fn told(name: &str, with: &str, renders: &[Vec<f64>]) -> (Comparison, String) {
    let found = judged(renders, reference(with));
    eprintln!("{name} with {with}: {found}");
    (found, write_evidence(name, renders))
}

/// Scenes of which several tests compare the same renders, made once: decision 50.
const SHARED: [&str; 4] = ["diffuse", "smooth_glossy", "reflections", "caustics"];

/// The renders of one of the [`SHARED`] scenes, made once.
fn shared_renders(name: &str) -> Option<&'static [Vec<TracedBlock>]> {
    static MADE: [OnceLock<Vec<Vec<TracedBlock>>>; SHARED.len()] = [const { OnceLock::new() }; SHARED.len()];
    let index = SHARED.iter().position(|&shared| shared == name)?;
    let make = || scenes::renders(tracer(scene(name), settings(1, 24)), settings(128, 24), 0..24).collect();
    Some(MADE[index].get_or_init(make))
}

fn compared_by(name: &str, with: &str, by: impl Fn(Tracer) -> Tracer) -> (Comparison, String) {
    let scene = if name.starts_with("point") { scene_of_points(name) } else { scene(name) };
    // Photons are gathered within a radius that shrinks with the samples.
    let (samples, renders) = match name {
        "point_glass" | "point_mirror" => (1024, 8),
        name if GLASS.contains(&name) => (512, 8),
        _ => (128, 24),
    };
    let tracer = by(tracer(scene, settings(1, 24)));
    let renders: Vec<Vec<f64>> =
        scenes::renders(tracer, settings(samples, 24), 0..renders).map(|blocks| image(&blocks)).collect();
    told(name, with, &renders)
}

/// Renders beside a reference's mean and the variance of that.
fn judged(renders: &[Vec<f64>], (mean, variance): (Vec<f64>, Vec<f64>)) -> Comparison {
    assert_eq!(mean.len(), ENTRIES);
    // Channels are the same paths: one of them stands for all.
    compare(renders, (&mean, &variance), |entry| (entry / (SIDE * SIDE)).is_multiple_of(CHANNELS))
}

/// Asserts that a comparison of 1,536 entries shows two renderings of the same.
pub(crate) fn assert_alike(name: &str, (found, evidence): (Comparison, String), most: f64) {
    // 512 of the entries are independent: the mean of z² has a deviation of 0.07, and 23 and 15 degrees of freedom
    // bring it to 1.06. Both sides find the variance of rare bright paths too small: a few entries may lie far out.
    assert!(
        found.mean_square < most && found.far <= 12 && found.whole.abs() < 4.0 && found.relative.abs() < 0.006,
        "{name}: {found}; {evidence}"
    );
}

/// Mean of z² that two renderings of the same have at most.
pub(crate) const ALIKE: f64 = 1.35;

fn agrees(name: &str) {
    // Beside sharp caustics of glass photons add a little, 0.51 % of the image at 128 samples and 0.37 % at 512: z² 1.44 and 1.39.
    assert_alike(name, compared(name, name), if GLASS.contains(&name) { 1.5 } else { ALIKE });
}

#[test]
fn a_diffuse_room_agrees_with_the_reference() {
    agrees("diffuse");
}

#[test]
fn reflections_agree_with_the_reference() {
    agrees("reflections");
}

#[test]
fn caustics_agree_with_the_reference() {
    agrees("caustics");
}

/// Layer by layer: emission and direct light, also in mirrors and behind glass, against the reference's, indirect light and caustics
/// against what its paths add to them.
#[test]
fn every_layer_agrees_with_the_reference() {
    for name in SHARED {
        let clusters = Clusters::of_basis(&scene(name).basis);
        assert_eq!(clusters.of_column(), [0, 1], "each texel must be a cluster for this");
        let (mut first, mut later) = (Vec::new(), Vec::new());
        for traced in shared_renders(name).expect("it is shared") {
            let lit = |halves: &[Vec<f32>; 2], at: usize| 0.5 * (halves[0][at] + halves[1][at]);
            let indirect = |t: &TracedBlock, row, column| lit(&planes(t).indirect, column * t.block.rows() + row);
            let seen_or_direct = |t: &TracedBlock, row: usize, column: usize| {
                let (planes, pixels) = (planes(t), t.block.rows() / CHANNELS);
                let is_here = |e: &&SeenEmission| (e.pixel as usize, e.column as usize) == (row % pixels, column);
                let seen: f32 = planes.emission.iter().filter(is_here).map(|e| e.value[row / pixels]).sum();
                seen + lit(&planes.direct, column * t.block.rows() + row)
            };
            first.push(image_of(traced, seen_or_direct));
            later.push(image_of(traced, indirect));
        }
        let (all, direct) = (reference(name), reference(&format!("direct_{name}")));
        // Two independent renders of the reference: their variances add up.
        let mean: Vec<f64> = all.0.iter().zip(&direct.0).map(|(all, direct)| all - direct).collect();
        let variance: Vec<f64> = all.1.iter().zip(&direct.1).map(|(all, direct)| all + direct).collect();
        for (layer, renders, reference) in [("seen and direct", first, direct), ("indirect", later, (mean, variance))] {
            let (name, found) = (format!("{name}-{layer}"), judged(&renders, reference));
            eprintln!("{name}: {found}");
            assert_alike(&name, (found, write_evidence(&name, &renders)), ALIKE);
        }
    }
}

/// Of lights without a body, against particles from the light: paths from the camera cannot find these caustics.
#[test]
fn caustics_of_a_point_and_a_spot_agree_with_particles_of_the_reference() {
    for name in ["point_glass", "point_mirror"] {
        // What is gathered beside a sharp caustic is too bright, and too dark in corners, by what the radius takes in from there: of
        // glass, z² 1.80 to 2.15 by the seeds and +0.24 to 0.38 % at these samples, +0.14 % with eight times as many. The whole must be right to
        // that.
        let (found, evidence) = compared(name, name);
        assert!(
            found.mean_square < 2.5 && found.far <= 24 && found.relative.abs() < 0.007,
            "{name}: {found}; {evidence}"
        );
        // The comparison can fail: without photons the caustics are missing.
        let (found, _) = compared_by(name, name, Tracer::without_photons);
        assert!(found.mean_square > 10.0 && found.relative < -0.01, "{name}: {found}");
    }
}

#[test]
fn a_light_seen_through_a_sheet_agrees_with_the_reference() {
    agrees("light_in_view");
}

/// Meshes of 24 rings with smooth normals, the same in both renderers.
#[test]
fn smooth_balls_agree_with_the_same_balls_of_the_reference() {
    for name in ["smooth_mirror", "smooth_glossy", "smooth_glass"] {
        agrees(name);
    }
}

/// What smooth normals stand for: fine meshes against true spheres.
#[test]
fn smooth_balls_agree_with_perfect_spheres() {
    for name in ["perfect_mirror", "perfect_glossy", "perfect_glass"] {
        agrees(name);
    }
}

/// Where the two renderers part: at the rim of coarse meshes, an interpolated normal mirrors or refracts rays to the wrong
/// side of the triangle. The reference follows such rays into the ball; here they leave just along the surface. With the
/// reference's rule in place of ours, these scenes had a mean z² of 1.27, 1.12 and 1.18 and no difference of the whole.
#[test]
fn coarse_smooth_balls_differ_from_the_reference_at_their_rims_alone() {
    for (name, most) in [("coarse_mirror", 0.004), ("coarse_glossy", 0.008), ("coarse_glass", 0.015)] {
        // Of paths from the camera, whose rule this is. Photons follow it from the other side, where it is another: with them the
        // coarse mirror lost 0.45 %, with z² 1.54.
        let (found, evidence) = compared_by(name, name, Tracer::without_photons);
        // Measured: z² 1.56, 1.17, 1.34, 15 entries of the mirror far out; differences of 0.02, 0.36 and −0.70 %. Losing such rays, as was done once,
        // gave z² 1.75 and 1.73 with −0.75 % of a mirror and −1.7 % of glass.
        assert!(
            found.mean_square < 1.6 && found.far <= 20 && found.relative.abs() < most,
            "{name}: {found}; {evidence}"
        );
    }
}

/// The comparison can fail: smooth balls are told from facets.
#[test]
fn smooth_balls_do_not_agree_with_facets() {
    for name in ["reflections", "caustics"] {
        let (found, _) = compared(&format!("smooth {name}"), name);
        assert!(found.mean_square > 2.0 && found.far > 12, "{name}: {found}");
    }
}
