//! What samples know of themselves: how light came, what is seen in mirrors and glass, and what surfaces are there.

use glam::{Mat3, Vec3};
use ltm::light::{Clusters, EnvironmentMapping, LightKind};
use ltm::matrix::{BlockPlanes, CHANNELS, Feature, TracedBlock};
use ltm::scene::{Emitter, EnvironmentEmitter, Paint, PointEmitter, Scene, Surface};
use ltm::trace::BlockStats;

use crate::scenes::{Builder, camera, lambert, mean, settings, trace};

/// Rounding of light to nine bits.
const KEPT: f32 = 1.0 / 512.0;

/// A room with everything in it that there is: rough and smooth, glass, a sheet before the panel, a lamp, a sky behind
/// a missing wall.
fn full_room() -> Scene {
    let mut builder = Builder::new(camera(Vec3::new(0.5, 0.5, 1.6), Vec3::new(0.5, 0.5, 0.0), 60.0, 24));
    let walls = builder.room(Vec3::ZERO, Vec3::new(1.0, 1.0, 2.0), lambert(0.6));
    builder.lamp("lamp", &walls[..1]);
    builder.sphere(Vec3::new(0.25, 0.2, 0.35), 0.2, 24, Surface::Mirror { reflectance: Paint::Constant(Vec3::ONE) });
    let glass = Surface::Dielectric { ior: 1.5, transmittance: Vec3::new(0.9, 1.0, 0.9) };
    builder.sphere(Vec3::new(0.7, 0.2, 0.7), 0.2, 24, glass);
    let gold = Surface::RoughConductor { specular: Paint::Constant(Vec3::new(0.9, 0.7, 0.3)), alpha: 0.2 };
    builder.sphere(Vec3::new(0.2, 0.6, 0.5), 0.15, 24, gold);
    let base = Paint::Constant(Vec3::new(0.2, 0.3, 0.4));
    let coat = Surface::Coated { reflectance: base, specular: Vec3::splat(0.04), alpha: 0.1 };
    builder.sphere(Vec3::new(0.8, 0.6, 0.4), 0.15, 24, coat);
    builder.panel("panel", Vec3::new(0.25, 0.9, 0.25), Vec3::X * 0.5, Vec3::Z * 0.5, (8, 8));
    let sheet = Surface::ThinDielectric { ior: 1.5, transmittance: Vec3::new(1.0, 0.8, 0.6) };
    builder.quad(Vec3::new(0.2, 0.8, 0.2), Vec3::X * 0.3, Vec3::Z * 0.6, sheet);
    let point = PointEmitter::Point { position: Vec3::new(0.5, 0.7, 1.2) };
    builder.bodiless("point", LightKind::Point, Emitter::Point(point));
    builder.build()
}

pub(crate) fn planes(block: &TracedBlock) -> &BlockPlanes {
    block.planes.as_ref().expect("two samples a pixel have planes")
}

/// `T S` of a block: rows × clusters, column-major.
fn summed(block: &TracedBlock, clusters: &Clusters) -> Vec<f32> {
    let view = block.block.view();
    let mut sums = vec![0.0; view.rows() * clusters.count()];
    for (entries, &cluster) in view.entries().chunks_exact(view.rows()).zip(clusters.of_column()) {
        let sums = &mut sums[usize::from(cluster) * view.rows()..][..view.rows()];
        sums.iter_mut().zip(entries).for_each(|(sum, entry)| *sum += entry);
    }
    sums
}

/// The emission summed over clusters, in the same layout.
fn emission(planes: &BlockPlanes, clusters: &Clusters) -> Vec<f32> {
    let pixels = planes.pixels();
    let mut sums = vec![0.0; CHANNELS * pixels * clusters.count()];
    for seen in &planes.emission {
        let cluster = usize::from(clusters.of_column()[seen.column as usize]);
        for (channel, value) in seen.value.into_iter().enumerate() {
            sums[(cluster * CHANNELS + channel) * pixels + seen.pixel as usize] += value;
        }
    }
    sums
}

#[test]
fn direct_and_indirect_light_and_emission_make_up_the_matrix() {
    let scene = full_room();
    let clusters = Clusters::of_basis(&scene.basis);
    assert!(clusters.count() > 10 && clusters.of_column().len() == 66);
    for samples in [8u32, 5, 2] {
        let weights = [samples.div_ceil(2), samples / 2].map(|count| count as f32 / samples as f32);
        let mut emitting = 0;
        for (block, _) in trace(scene.clone(), settings(samples, 8)) {
            let planes = planes(&block);
            assert_eq!(planes.clusters(), clusters.count());
            emitting += planes.emission.len();
            let (sums, emission) = (summed(&block, &clusters), emission(planes, &clusters));
            for (at, (&sum, emission)) in sums.iter().zip(emission).enumerate() {
                let half = |half: usize| weights[half] * (planes.direct[half][at] + planes.indirect[half][at]);
                let made_up = half(0) + half(1) + emission;
                assert!((made_up - sum).abs() <= sum * (KEPT + 1e-5), "{made_up} for {sum}");
            }
        }
        assert!(emitting > 0);
    }
    assert!(trace(scene, settings(1, 8)).iter().all(|(block, _)| block.planes.is_none()));
}

/// The longest path that brings direct light has two segments, and any longer one leaves it as it is.
#[test]
fn direct_light_is_what_paths_of_two_segments_bring() {
    let mut builder = Builder::new(camera(Vec3::new(0.5, 0.5, 0.98), Vec3::new(0.5, 0.4, 0.0), 75.0, 16));
    builder.room(Vec3::ZERO, Vec3::ONE, lambert(0.7));
    builder.panel("panel", Vec3::new(0.25, 0.99, 0.25), Vec3::X * 0.5, Vec3::Z * 0.5, (4, 4));
    let scene = builder.build();
    let traced = [1, 2, 8].map(|depth| trace(scene.clone(), settings(16, depth)));
    for ((seen, lit), all) in traced[0].iter().zip(&traced[1]).zip(&traced[2]) {
        let [seen, lit, all] = [seen, lit, all].map(|(block, _)| planes(block));
        assert!(seen.direct.iter().chain(&seen.indirect).chain(&lit.indirect).flatten().all(|&v| v == 0.0));
        assert_eq!((&seen.emission, &lit.emission, &lit.direct), (&all.emission, &all.emission, &all.direct));
        assert_eq!((&seen.features, &lit.features), (&all.features, &all.features));
        assert!(all.indirect[0].iter().any(|&v| v > 0.0));
    }
}

/// Where every wall emits 1 and reflects half, what is seen is 1, what is lit directly ½, and all the rest ½.
#[test]
fn a_closed_glowing_room_has_its_share_in_every_layer() {
    let mut builder = Builder::new(camera(Vec3::new(0.3, 0.4, 0.2), Vec3::new(1.0, 0.1, 0.8), 80.0, 16));
    let walls = builder.room(Vec3::ZERO, Vec3::new(1.0, 1.5, 2.0), lambert(0.5));
    builder.lamp("floor", &walls[..2]);
    builder.lamp("others", &walls[2..]);
    let blocks = trace(builder.build(), settings(256, 40));
    // Both halves of all pixels and clusters: mean over rows of the sum over clusters.
    let light = |of: &dyn Fn(&BlockPlanes) -> [Vec<f32>; 2]| {
        let all: Vec<f32> = blocks.iter().flat_map(|(block, _)| of(planes(block)).concat()).collect();
        mean(&all) * 2.0
    };
    // The deviation of 256 pixels at 256 samples is about 0.15 % of 2, see the test of the whole; five of it.
    let (direct, indirect) = (light(&|p| p.direct.clone()), light(&|p| p.indirect.clone()));
    assert!((direct - 0.5).abs() < 0.015, "{direct}");
    assert!((indirect - 0.5).abs() < 0.015, "{indirect}");
    for (block, _) in &blocks {
        let planes = planes(block);
        let mut seen = vec![0.0; planes.pixels()];
        planes.emission.iter().for_each(|e| seen[e.pixel as usize] += e.value[1]);
        assert!(seen.iter().all(|v| (v - 1.0).abs() < 1e-5), "{seen:?}");
        assert!(planes.feature(Feature::Emitter).iter().all(|&share| share == 1.0));
        assert!(planes.feature(Feature::Albedo).iter().all(|&albedo| (albedo - 0.5).abs() < 1e-6));
    }
}

/// The mean of a feature's plane over all pixels, and the largest variance in it.
fn feature(blocks: &[(TracedBlock, BlockStats)], feature: Feature, plane: usize) -> (f64, f32) {
    let of = |values: &[f32], pixels: usize| values[plane * pixels..][..pixels].to_vec();
    let mut means = Vec::new();
    let mut variance = 0.0f32;
    for (block, _) in blocks {
        let planes = planes(block);
        means.extend(of(planes.feature(feature), planes.pixels()));
        variance = of(planes.variance(feature), planes.pixels()).into_iter().fold(variance, f32::max);
    }
    (mean(&means), variance)
}

const TINT: Vec3 = Vec3::new(0.5, 0.8, 1.0);

/// A camera that sees almost a single point: a tinted mirror two units before it, in which it sees what stands three
/// units behind it.
fn before_a_mirror() -> Builder {
    let mut builder = Builder::new(camera(Vec3::ZERO, Vec3::NEG_Z, 0.05, 8));
    let mirror = Surface::Mirror { reflectance: Paint::Constant(TINT) };
    builder.quad(Vec3::new(-1.0, -1.0, -2.0), Vec3::X * 2.0, Vec3::Y * 2.0, mirror);
    builder
}

#[test]
fn features_are_those_of_the_surface_that_a_mirror_shows() {
    let mut builder = before_a_mirror();
    let colour = Vec3::new(0.2, 0.4, 0.6);
    let wall = Surface::Lambert { reflectance: Paint::Constant(colour) };
    builder.quad(Vec3::new(1.0, -1.0, 3.0), Vec3::X * -2.0, Vec3::Y * 2.0, wall);
    let point = PointEmitter::Point { position: Vec3::new(0.5, 0.5, 1.0) };
    builder.bodiless("point", LightKind::Point, Emitter::Point(point));
    let scene = builder.build();
    // The wall's is the last.
    let number = scene.materials.len() as f32;
    let blocks = trace(scene, settings(4, 4));
    let expected = [
        (Feature::Albedo, (TINT * colour).to_array().to_vec()),
        (Feature::Normal, vec![0.0, 0.0, -1.0]),
        (Feature::Depth, vec![7.0]),
        (Feature::Emitter, vec![0.0]),
        (Feature::Specular, vec![1.0]),
        (Feature::Surface, vec![1.0]),
        (Feature::Material, vec![number]),
    ];
    for (which, values) in expected {
        for (plane, value) in values.into_iter().enumerate() {
            let (mean, variance) = feature(&blocks, which, plane);
            assert!((mean - f64::from(value)).abs() < 1e-4, "{which:?} {plane}: {mean} for {value}");
            assert!(variance < 1e-9, "{which:?} {plane}: {variance}");
        }
    }
    assert!(blocks.iter().all(|(block, _)| planes(block).emission.is_empty()));
}

#[test]
fn a_lamp_in_a_mirror_is_emission_and_nothing_else() {
    let mut builder = before_a_mirror();
    builder.panel("panel", Vec3::new(1.0, -1.0, 3.0), Vec3::X * -2.0, Vec3::Y * 2.0, (1, 1));
    let blocks = trace(builder.build(), settings(4, 4));
    for (block, _) in &blocks {
        let planes = planes(block);
        assert_eq!(planes.emission.len(), planes.pixels());
        for (pixel, seen) in planes.emission.iter().enumerate() {
            assert_eq!((seen.pixel as usize, seen.column), (pixel, 0));
            assert!((Vec3::from(seen.value) - TINT).abs().max_element() < 1e-5, "{seen:?}");
        }
        assert!(planes.direct.iter().chain(&planes.indirect).flatten().all(|&v| v == 0.0));
    }
    assert_eq!(feature(&blocks, Feature::Emitter, 0), (1.0, 0.0));
    assert_eq!(feature(&blocks, Feature::Albedo, 1), (0.0, 0.0), "the panel is black");
    assert!((feature(&blocks, Feature::Depth, 0).0 - 7.0).abs() < 1e-4);
}

/// A path takes one way from a boundary, and lamps are seen along both.
#[test]
fn lamps_in_glass_and_behind_it_have_no_grain() {
    let boundary = Surface::Dielectric { ior: 1.5, transmittance: TINT };
    let sheet = Surface::ThinDielectric { ior: 1.5, transmittance: TINT };
    // Radiance is smaller outside a medium by the square of its index.
    for (surface, mirrored, index) in [(boundary, 0.04, 1.5), (sheet, 0.08 / 1.04, 1.0)] {
        let mut builder = Builder::new(camera(Vec3::ZERO, Vec3::NEG_Z, 0.05, 8));
        builder.quad(Vec3::new(-1.0, -1.0, -2.0), Vec3::X * 2.0, Vec3::Y * 2.0, surface);
        builder.panel("in it", Vec3::new(1.0, -1.0, 3.0), Vec3::X * -2.0, Vec3::Y * 2.0, (1, 1));
        builder.panel("behind it", Vec3::new(-1.0, -1.0, -4.0), Vec3::X * 2.0, Vec3::Y * 2.0, (1, 1));
        let expected = [Vec3::splat(mirrored), TINT * (1.0 - mirrored) / (index * index)];
        for (block, _) in trace(builder.build(), settings(2, 4)) {
            let planes = planes(&block);
            assert_eq!(planes.emission.len(), 2 * planes.pixels());
            for seen in &planes.emission {
                let expected = expected[seen.column as usize];
                assert!((Vec3::from(seen.value) - expected).abs().max_element() < 1e-4, "{seen:?}, not {expected}");
            }
            let rows = block.block.view().rows();
            for (entries, expected) in block.block.view().entries().chunks_exact(rows).zip(expected) {
                let mean = mean(entries);
                let right = f64::from(expected.element_sum() / 3.0);
                assert!((mean - right).abs() < 2e-3 * right, "{mean}, not {right}");
            }
        }
    }
}

#[test]
fn shares_of_a_half_covered_image_are_means_with_the_variance_of_their_samples() {
    // A wall before the left half of a sky, seen in one wide pixel; the camera looks along the wall's edge.
    let mut builder = Builder::new(camera(Vec3::ZERO, Vec3::NEG_Z, 40.0, 1));
    builder.quad(Vec3::new(-9.0, -9.0, -1.0), Vec3::X * 9.0, Vec3::Y * 18.0, lambert(0.5));
    let mapping = EnvironmentMapping::Octahedral { side: 2 };
    let sky = EnvironmentEmitter { mapping, world_from_environment: Mat3::IDENTITY, is_split: false };
    builder.bodiless("sky", LightKind::Octahedral { side: 2 }, Emitter::Environment(sky));
    let samples = 64;
    let blocks = trace(builder.build(), settings(samples, 3));
    let [surface, emitter] = [Feature::Surface, Feature::Emitter].map(|which| feature(&blocks, which, 0));
    // Stratified: each half of the samples covers the pixel evenly. At an edge, 48 further camera rays show the surface as well.
    assert!([surface.0, emitter.0].iter().all(|share| (share - 0.5).abs() <= 1.0 / 16.0));
    let variance = |share: f64, rays: u32| share * (1.0 - share) / f64::from(rays - 1);
    let of_rays = variance(surface.0, samples + 48);
    assert!((f64::from(surface.1) - of_rays).abs() < 0.01 * of_rays, "{} for {of_rays}", surface.1);
    let variance = variance(emitter.0, samples);
    // Light is divided by the albedo of its own samples, and the pixel's is that of all rays.
    let [own, of_pixel] = [Feature::Albedo, Feature::PixelAlbedo].map(|which| feature(&blocks, which, 0).0);
    assert!((own - 0.5 * (1.0 - emitter.0)).abs() < 1e-6 && (of_pixel - 0.5 * surface.0).abs() < 1e-6);
    // Half of the samples show the only material: the pixel is of the first sample's, and its variance says that it is mixed.
    let (material, mixed) = feature(&blocks, Feature::Material, 0);
    assert!(material == 0.0 || material == 1.0, "{material}");
    assert!((f64::from(mixed) - variance).abs() < 0.01 * variance, "{mixed} for {variance}");
    let (normal, depth) = (feature(&blocks, Feature::Normal, 2).0, feature(&blocks, Feature::Depth, 0).0);
    assert!((normal - surface.0).abs() < 1e-6, "the normal +z of the part that is covered");
    assert!((1.0..1.1).contains(&(depth / surface.0)), "{depth}");
}
