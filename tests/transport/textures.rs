//! Textures as light meets them: colours, cut-outs, patterns of emission.

use glam::Vec3;
use ltm::light::{EnvironmentMapping, LightKind};
use ltm::matrix::Feature;
use ltm::scene::{
    AreaLayout, Emitter, EnvironmentEmitter, MaterialId, Paint, Placing, PointEmitter, Scene, Surface, Texels, Texture,
    TextureId,
};
use ltm::trace::TraceSettings;

use crate::caustics::columns;
use crate::layers::planes;
use crate::scenes::{Builder, all_on, camera, lambert, mean, settings, trace};

/// A texture of 2 × 1 texels, left and right.
fn halves(left: [f32; 4], right: [f32; 4]) -> Texture {
    Texture {
        name: "halves".into(),
        width: 2,
        height: 1,
        texels: Texels::Floats(vec![left, right]),
        placing: Placing::PLAIN,
    }
}

/// All columns of every pixel, `[channel][y][x]`, of an image of 8 × 8.
fn image(scene: Scene, samples: u32, depth: u32) -> Vec<f32> {
    all_on(&trace(scene, settings(samples, depth)))
}

fn sky(builder: &mut Builder) {
    let mapping = EnvironmentMapping::Octahedral { side: 4 };
    let sky = EnvironmentEmitter { mapping, world_from_environment: glam::Mat3::IDENTITY, is_split: false };
    builder.bodiless("sky", LightKind::Octahedral { side: 4 }, Emitter::Environment(sky));
}

/// Looking along −z at the square from (−1, −1, 0) to (1, 1, 0), which overfills the view.
fn before_a_square(surface: Surface) -> Builder {
    let mut builder = Builder::new(camera(Vec3::new(0.0, 0.0, 2.0), Vec3::ZERO, 40.0, 8));
    builder.quad(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0, surface);
    builder
}

#[test]
fn a_textured_wall_reflects_the_colours_of_its_texture() {
    let mut builder =
        before_a_square(Surface::Lambert { reflectance: Paint::Textured(TextureId(0), Vec3::splat(0.5)) });
    sky(&mut builder);
    let mut scene = builder.build();
    scene.textures.push(halves([0.8, 0.2, 0.0, 1.0], [0.0, 0.4, 1.0, 1.0]));
    let found = image(scene, 1024, 2);
    // A flat wall under a sky of 1 is as bright as it is white. Bilinear: the left quarter of the square shows the left
    // texel, the right quarter the right one, as the texture repeats only beyond them.
    for (channel, (left, right)) in [(0.8, 0.0), (0.2, 0.4), (0.0, 1.0)].into_iter().enumerate() {
        for row in 0..8 {
            let at = |x: usize| found[channel * 64 + row * 8 + x];
            // Pixel 1 has u between 0.23 and 0.32: a blend of at most 7 % of the other texel; noise about 1 %.
            let (dark, bright) = (0.5 * left, 0.5 * right);
            assert!(
                (at(1) - dark).abs() < 0.04 && (at(6) - bright).abs() < 0.04,
                "{channel} {row}: {} {}",
                at(1),
                at(6)
            );
        }
    }
}

#[test]
fn what_is_cut_out_is_not_there() {
    // A square of cut-outs before a glowing wall, and above a floor between it and its light.
    let with = |alpha: Option<(f32, f32)>| {
        let mut builder = Builder::new(camera(Vec3::new(0.0, 0.7, 2.0), Vec3::new(0.0, 0.3, 0.0), 50.0, 8));
        builder.quad(Vec3::new(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0, lambert(0.6));
        builder.panel("panel", Vec3::new(-0.5, 1.5, -0.5), Vec3::X, Vec3::Z, (2, 2));
        if alpha.is_some() {
            builder.quad(Vec3::new(-1.5, 1.0, -1.5), Vec3::X * 3.0, Vec3::Z * 3.0, lambert(0.3));
        }
        let mut scene = builder.build();
        if let Some((left, right)) = alpha {
            scene.textures.push(halves([1.0, 1.0, 1.0, left], [1.0, 1.0, 1.0, right]));
            scene.materials.last_mut().unwrap().cutout = Some(TextureId(0));
            assert_eq!(scene.mesh.triangles.last().unwrap().material, MaterialId(scene.materials.len() as u32 - 1));
        }
        image(scene, 64, 3)
    };
    let (none, clear, opaque, half) =
        (with(None), with(Some((0.0, 0.0))), with(Some((1.0, 1.0))), with(Some((1.0, 0.0))));
    // The same paths, but for where rays start again behind a cut-out.
    for (a, b) in none.iter().zip(&clear) {
        assert!((a - b).abs() < 1e-3 * a.abs() + 1e-5, "{a} {b}");
    }
    // The floor sees the panel no more, only what passes beside the square: little.
    assert!(mean(&opaque) < 0.25 * mean(&none), "{} of {}", mean(&opaque), mean(&none));
    let of_all = mean(&half) / mean(&none);
    assert!(of_all > 0.35 && of_all < 0.75, "{of_all}");
}

#[test]
fn a_pattern_of_emission_is_seen_and_gives_light() {
    let pattern = |left: [f32; 4], right: [f32; 4], texels: (u32, u32)| {
        let mut builder = Builder::new(camera(Vec3::new(0.0, 0.0, 2.0), Vec3::ZERO, 40.0, 8));
        builder.panel("panel", Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0, texels);
        // Behind the camera, lit by the panel; not in view.
        let mut scene = builder.build();
        scene.textures.push(halves(left, right));
        let Emitter::Area(area) = &mut scene.emitters[0] else { unreachable!() };
        area.pattern = Some(Paint::Textured(TextureId(0), Vec3::ONE));
        scene
    };
    let found = image(pattern([3.0, 0.0, 0.5, 1.0], [0.0, 2.0, 0.5, 1.0], (1, 1)), 16, 1);
    for row in 0..8 {
        let at = |channel: usize, x: usize| found[channel * 64 + row * 8 + x];
        assert!((at(0, 1) - 3.0).abs() < 0.25 && at(0, 6) < 0.25, "{row}: {} {}", at(0, 1), at(0, 6));
        assert!(at(1, 1) < 0.17 && (at(1, 6) - 2.0).abs() < 0.17 && (at(2, 3) - 0.5).abs() < 1e-5);
    }
    // A floor before the panel receives what the pattern says, from both techniques: half the light of a full one.
    let lit = |value: f32| {
        let mut scene = pattern([value; 4], [value; 4], (2, 2));
        scene.camera = camera(Vec3::new(0.0, -0.5, 0.6), Vec3::new(0.0, -1.2, 0.4), 30.0, 8);
        let mut floor = Builder::new(scene.camera);
        floor.quad(Vec3::new(-3.0, -1.2, 0.0), Vec3::Z * 3.0, Vec3::X * 6.0, lambert(0.7));
        let floor = floor.build();
        let (first, material) = (scene.mesh.vertices.len() as u32, MaterialId(scene.materials.len() as u32));
        scene.mesh.vertices.extend(floor.mesh.vertices);
        scene.materials.extend(floor.materials);
        scene.mesh.triangles.extend(floor.mesh.triangles.into_iter().map(|mut t| {
            (t.vertices, t.material) = (t.vertices.map(|v| v + first), material);
            t
        }));
        mean(&image(scene, 64, 3))
    };
    let (full, half) = (lit(1.0), lit(0.5));
    assert!(full > 0.01 && (half / full - 0.5).abs() < 1e-4, "{half} of {full}");
}

#[test]
fn an_emitter_gives_light_as_far_as_it_is_there() {
    // A floor under a panel that is not in view; the panel as a rectangle of texels, and as triangles.
    let with = |alphas: Option<(f32, f32)>, is_whole: bool| {
        let mut builder = Builder::new(camera(Vec3::new(0.0, 0.7, 2.0), Vec3::new(0.0, 0.0, 0.0), 30.0, 8));
        builder.quad(Vec3::new(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0, lambert(0.6));
        builder.panel("panel", Vec3::new(-0.5, 1.5, -0.5), Vec3::X, Vec3::Z, (1, 1));
        let mut scene = builder.build();
        let Emitter::Area(area) = &mut scene.emitters[0] else { unreachable!() };
        if is_whole {
            area.layout = AreaLayout::Whole;
        }
        if let Some((left, right)) = alphas {
            let material = scene.mesh.triangles[area.triangles[0] as usize].material;
            scene.textures.push(halves([1.0, 1.0, 1.0, left], [1.0, 1.0, 1.0, right]));
            scene.materials[material.0 as usize].cutout = Some(TextureId(0));
        }
        image(scene, 256, 3)
    };
    for is_whole in [false, true] {
        let (none, there) = (with(None, is_whole), with(Some((1.0, 1.0)), is_whole));
        // Paths that meet what may be cut out draw the same numbers; only where rays start is rounded otherwise.
        assert!(mean(&none) > 0.02, "{}", mean(&none));
        assert!((mean(&there) / mean(&none) - 1.0).abs() < 1e-3, "{} for {}", mean(&there), mean(&none));
        assert!(with(Some((0.0, 0.0)), is_whole).iter().all(|&v| v == 0.0));
        // The floor in view is lit evenly from both halves, but for noise.
        let half = mean(&with(Some((1.0, 0.0)), is_whole)) / mean(&none);
        assert!((half - 0.5).abs() < 0.05, "{half}");
    }
}

#[test]
fn samples_of_a_light_and_rays_see_the_same_holes() {
    // A texelled panel all of whose corners have one place in the map: there or not as a whole, whichever side of the map that is.
    for (place, is_there) in [(0.25, true), (0.75, false)] {
        let mut builder = Builder::new(camera(Vec3::new(0.0, 0.7, 2.0), Vec3::new(0.0, 0.0, 0.0), 30.0, 8));
        builder.quad(Vec3::new(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0, lambert(0.6));
        builder.panel("panel", Vec3::new(-0.5, 1.5, -0.5), Vec3::X, Vec3::Z, (2, 2));
        let mut scene = builder.build();
        let Emitter::Area(area) = &scene.emitters[0] else { unreachable!() };
        for &triangle in &area.triangles {
            for vertex in scene.mesh.triangles[triangle as usize].vertices {
                scene.mesh.vertices[vertex as usize].uv = glam::Vec2::new(place, 0.5);
            }
        }
        let material = scene.mesh.triangles[area.triangles[0] as usize].material;
        scene.textures.push(halves([1.0; 4], [1.0, 1.0, 1.0, 0.0]));
        scene.materials[material.0 as usize].cutout = Some(TextureId(0));
        assert_eq!(mean(&image(scene, 64, 3)) > 0.0, is_there);
    }
}

#[test]
fn a_pattern_lies_by_the_texture_coordinates_of_its_surface() {
    let mut builder = Builder::new(camera(Vec3::new(0.0, 0.0, 2.0), Vec3::ZERO, 40.0, 8));
    builder.panel("panel", Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0, (2, 2));
    let mut scene = builder.build();
    scene.textures.push(halves([3.0, 0.0, 0.0, 1.0], [0.0, 2.0, 0.0, 1.0]));
    let Emitter::Area(area) = &mut scene.emitters[0] else { unreachable!() };
    area.pattern = Some(Paint::Textured(TextureId(0), Vec3::ONE));
    // The panel is cut of the middle of the left texel.
    for &triangle in &area.triangles {
        for vertex in scene.mesh.triangles[triangle as usize].vertices {
            let uv = &mut scene.mesh.vertices[vertex as usize].uv;
            *uv = glam::Vec2::new(0.25 + 1e-3 * uv.x, uv.y);
        }
    }
    for (at, value) in image(scene, 16, 1).into_iter().enumerate() {
        let wanted = if at < 64 { 3.0 } else { 0.0 };
        assert!((value - wanted).abs() < 0.02, "{at}: {value}");
    }
}

/// A surface of an opacity is what a mixture of it and of nothing is: by camera paths, shadow rays and photons alike.
#[test]
fn what_is_partly_there_lets_its_share_through() {
    // Black and half there, beside a sheet that reflects nothing and passes a half: the same light, by other code.
    let with = |surface: Surface, opacity: f32| {
        let mut builder = Builder::new(camera(Vec3::new(0.0, 0.8, 2.2), Vec3::new(0.0, 0.3, 0.0), 50.0, 8));
        builder.quad(Vec3::new(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0, lambert(0.6));
        builder.quad(Vec3::new(-2.0, 0.0, -1.0), Vec3::X * 4.0, Vec3::Y * 2.0, lambert(0.5));
        let mirror = Surface::Mirror { reflectance: Paint::Constant(Vec3::ONE) };
        builder.sphere(Vec3::new(0.5, 0.4, 0.2), 0.3, 24, mirror);
        builder.panel("panel", Vec3::new(-0.5, 1.5, -0.5), Vec3::X, Vec3::Z, (2, 1));
        sky(&mut builder);
        let towards = Vec3::new(0.3, 0.9, 0.4).normalize();
        let sun = PointEmitter::Sun { towards, angular_radius_radians: 0.0 };
        builder.bodiless("sun", LightKind::Sun, Emitter::Point(sun));
        // Over the floor, between the ball and the floor, and before the panel.
        for (origin, u, v) in [
            (Vec3::new(-1.5, 1.0, -0.9), Vec3::X * 3.0, Vec3::Z * 2.0),
            (Vec3::new(-0.8, 0.05, -0.5), Vec3::Z * 1.5, Vec3::X * 0.9),
        ] {
            builder.quad(origin, u, v, surface);
        }
        let mut scene = builder.build();
        scene.materials.iter_mut().filter(|m| m.surface == surface).for_each(|m| m.opacity = opacity);
        let mut means: Vec<Vec<f64>> = Vec::new();
        for seed in 0..12 {
            let blocks: Vec<_> = trace(scene.clone(), TraceSettings { seed, ..settings(32, 5) });
            let blocks: Vec<_> = blocks.into_iter().map(|(block, _)| block).collect();
            means.push(columns(&blocks).iter().map(|column| mean(column)).collect());
        }
        means
    };
    let sheet = with(Surface::ThinDielectric { ior: 1.0, transmittance: Vec3::splat(0.5) }, 1.0);
    let half = with(lambert(0.0), 0.5);
    let statistic = |means: &[Vec<f64>], at: usize| {
        let n = means.len() as f64;
        let mean = means.iter().map(|m| m[at]).sum::<f64>() / n;
        (mean, means.iter().map(|m| (m[at] - mean).powi(2)).sum::<f64>() / (n * (n - 1.0)))
    };
    for column in 0..sheet[0].len() {
        let ((a, of_a), (b, of_b)) = (statistic(&sheet, column), statistic(&half, column));
        // Five deviations of twelve renders each, and a thousandth for where rays start again.
        assert!((a - b).abs() <= 5.0 * (of_a + of_b).sqrt() + 1e-3 * a, "column {column}: {a} {b}");
    }
}

#[test]
fn what_shines_through_has_no_grain() {
    // A black surface of opacity a quarter before a glowing panel, in every pixel and whatever the samples.
    let mut builder = Builder::new(camera(Vec3::new(0.0, 0.0, 2.0), Vec3::ZERO, 20.0, 8));
    builder.panel("panel", Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0, (1, 1));
    builder.quad(Vec3::new(-1.0, -1.0, 0.5), Vec3::X * 2.0, Vec3::Y * 2.0, lambert(0.0));
    let mut scene = builder.build();
    scene.materials.last_mut().unwrap().opacity = 0.25;
    for value in image(scene, 2, 2) {
        assert!((value - 0.75).abs() < 1e-5, "{value}");
    }
}

/// Features behind what is partly there are those of all surfaces by their shares, without noise, whichever of them a sample's light met.
#[test]
fn what_is_partly_there_has_its_share_of_the_features() {
    let mut builder = Builder::new(camera(Vec3::new(0.0, 0.0, 2.0), Vec3::ZERO, 20.0, 8));
    builder.quad(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0, lambert(0.4));
    builder.quad(Vec3::new(-1.0, -1.0, 0.5), Vec3::X * 2.0, Vec3::Y * 2.0, lambert(0.6));
    sky(&mut builder);
    let mut scene = builder.build();
    scene.materials.last_mut().unwrap().opacity = 0.25;
    for (block, _) in trace(scene, settings(4, 3)) {
        let planes = planes(&block);
        assert!(planes.variance(Feature::Albedo).iter().any(|variance| *variance > 1e-4), "samples met both surfaces");
        for feature in [Feature::PixelAlbedo, Feature::Normal, Feature::Surface] {
            assert!(planes.variance(feature).iter().all(|variance| *variance < 1e-9), "{feature:?}");
        }
        assert!(planes.feature(Feature::PixelAlbedo).iter().all(|albedo| (albedo - 0.45).abs() < 1e-5));
        // A quarter of 1.5 and three quarters of 2, and a little more towards the corners.
        assert!(planes.feature(Feature::Depth).iter().all(|depth| (1.874..1.93).contains(depth)));
    }
}
