//! Light from every kind of emitter against closed forms, in the column where it belongs.

use std::f32::consts::PI;

use glam::{DVec3, Mat3, Vec3};
use ltm::light::{EnvironmentMapping, LightKind};
use ltm::matrix::{CHANNELS, TracedBlock};
use ltm::scene::{Emitter, EnvironmentEmitter, IesProfile, Paint, PixelFilter, PointEmitter, Scene, SpotCone, Surface};
use ltm::trace::BlockStats;

use crate::scenes::{Builder, all_on, camera, lambert, mean, settings, trace};

const FLOOR: f32 = 0.8;

/// A grey floor seen so closely that all pixels are one point, the origin.
fn floor() -> Builder {
    let mut builder = Builder::new(camera(Vec3::new(0.25, 0.25, 0.0), Vec3::ZERO, 0.1, 8));
    builder.quad(Vec3::new(-5.0, 0.0, -5.0), Vec3::Z * 10.0, Vec3::X * 10.0, lambert(FLOOR));
    builder
}

/// Mean over all pixels and channels of one column.
fn column_mean(blocks: &[(TracedBlock, BlockStats)], column: usize) -> f64 {
    let rows: Vec<f32> =
        blocks.iter().flat_map(|(b, _)| (0..b.block.rows()).map(move |row| b.block.view().at(row, column))).collect();
    mean(&rows)
}

/// Irradiance at the origin, normal +y, from a polygon of radiance 1: Lambert's formula,
/// `½ Σ θᵢ (cᵢ · n)` over edges with subtended angle θ and unit normal c of the plane through the origin.
fn irradiance(corners: &[Vec3]) -> f64 {
    let unit: Vec<DVec3> = corners.iter().map(|c| c.as_dvec3().normalize()).collect();
    let edges = (0..unit.len()).map(|i| (unit[i], unit[(i + 1) % unit.len()]));
    let sum: f64 = edges.map(|(a, b)| a.dot(b).clamp(-1.0, 1.0).acos() * a.cross(b).normalize().y).sum();
    0.5 * sum.abs()
}

#[test]
fn every_texel_of_a_rectangle_lights_the_floor_by_lamberts_formula() {
    let (origin, u, v) = (Vec3::new(-0.2, 0.7, -0.5), Vec3::X * 1.2, Vec3::Z * 0.8);
    let mut builder = floor();
    builder.panel("panel", origin, u, v, (4, 3));
    let blocks = trace(builder.build(), settings(256, 3));
    for column in 0..12 {
        let at =
            |du: usize, dv: usize| origin + u * ((column % 4 + du) as f32 / 4.0) + v * ((column / 4 + dv) as f32 / 3.0);
        let expected = irradiance(&[at(0, 0), at(1, 0), at(1, 1), at(0, 1)]) * f64::from(FLOOR / PI);
        let found = column_mean(&blocks, column);
        // 64 pixels × 256 samples × 4 light samples = 65,536, stratified: deviation below 0.2 %; measured worst 0.4 %.
        assert!((found / expected - 1.0).abs() < 0.01, "column {column}: {found} for {expected}");
    }
}

#[test]
fn point_like_lights_light_the_floor_by_the_square_of_the_distance() {
    let at = Vec3::new(0.3, 2.0, 0.4);
    let (d2, cosine) = (at.length_squared(), at.y / at.length());
    let away = -at.normalize();
    let spot = |inner: f32, outer: f32, direction: Vec3| PointEmitter::Spot {
        position: at,
        direction: direction.normalize(),
        inner_radians: inner,
        outer_radians: outer,
    };
    // A profile that falls linearly from nadir to the horizon.
    let profile =
        IesProfile { vertical_radians: vec![0.0, 0.5 * PI], horizontal_radians: vec![0.0], intensity: vec![1.0, 0.0] };
    // The luminaire's nadir −z points down: its z axis is the world's y.
    let world_from_luminaire = Mat3::from_cols(Vec3::Z, Vec3::X, Vec3::Y);
    let ies = PointEmitter::Ies { position: at, world_from_luminaire, profile };
    let cone = SpotCone { direction: (-at).normalize(), inner_radians: 0.3, outer_radians: 0.5 };
    let nadir_angle = (-away.y).acos();
    let sun = |radius| PointEmitter::Sun { towards: at.normalize(), angular_radius_radians: radius };
    let cases = [
        ("point", LightKind::Point, PointEmitter::Point { position: at }, cosine / d2),
        ("spot, lit", LightKind::Spot, spot(0.3, 0.5, -at), cosine / d2),
        ("spot, missed", LightKind::Spot, spot(0.3, 0.5, Vec3::Y), 0.0),
        ("ies", LightKind::Ies, ies, cosine / d2 * (1.0 - nadir_angle / (0.5 * PI))),
        ("ball", LightKind::Point, PointEmitter::Ball { position: at, radius: 0.2, cone: None }, cosine / d2),
        (
            "ball, spot",
            LightKind::Spot,
            PointEmitter::Ball { position: at, radius: 1e-3, cone: Some(cone) },
            cosine / d2,
        ),
        ("sun", LightKind::Sun, sun(0.0), cosine),
        ("sun, disc", LightKind::Sun, sun(0.05), cosine),
    ];
    for (name, kind, emitter, irradiance) in cases {
        let mut builder = floor();
        builder.bodiless(name, kind, Emitter::Point(emitter));
        let found = mean(&all_on(&trace(builder.build(), settings(64, 4))));
        let expected = f64::from(irradiance * FLOOR / PI);
        // No variance but the disc's and the ball's; the pixels' extent of 1/1000 adds some 1e-4.
        assert!((found - expected).abs() <= 2e-3 * expected, "{name}: {found} for {expected}");
    }
}

/// Intensity between the cones falls with the square of a smooth step in the cosine: 3 t² − 2 t³.
#[test]
fn a_spots_light_falls_smoothly_between_its_cones() {
    let (inner, outer) = (0.3f32, 0.7f32);
    let mut before = f64::INFINITY;
    for step in 0..=8 {
        let angle = inner + (outer - inner) * step as f32 / 8.0;
        let direction = Vec3::new(angle.sin(), -angle.cos(), 0.0);
        let position = Vec3::Y * 2.0;
        let spot = PointEmitter::Spot { position, direction, inner_radians: inner, outer_radians: outer };
        let mut builder = floor();
        builder.bodiless("spot", LightKind::Spot, Emitter::Point(spot));
        let found = mean(&all_on(&trace(builder.build(), settings(64, 4))));
        let t = f64::from((angle.cos() - outer.cos()) / (inner.cos() - outer.cos())).clamp(0.0, 1.0);
        let expected = (3.0 * t * t - 2.0 * t * t * t) / 4.0 * f64::from(FLOOR / PI);
        // The pixels' extent of 1/1000 turns the direction by as much, and the step's slope is below 8 there.
        assert!((found - expected).abs() <= 4e-3 * f64::from(FLOOR / PI) / 4.0, "{angle}: {found} for {expected}");
        assert!(found <= before, "it never grows outwards");
        before = found;
    }
}

/// A web of five planes that differ, over the whole circle, met at and between its planes.
#[test]
fn a_photometric_web_is_read_bilinearly_in_both_angles() {
    let horizontal_radians: Vec<f32> = [0.0f32, 90.0, 180.0, 270.0, 360.0].map(f32::to_radians).to_vec();
    // Two vertical angles a plane: nadir and 60°. All planes agree at the nadir.
    let intensity = vec![1.0, 0.2, 1.0, 0.8, 1.0, 0.4, 1.0, 0.6, 1.0, 0.2];
    let profile = IesProfile {
        vertical_radians: vec![0.0, 60f32.to_radians()],
        horizontal_radians,
        intensity: intensity.clone(),
    };
    // The luminaire's nadir −z points down: its z axis is the world's y, and its x the world's z.
    let axes = Mat3::from_cols(Vec3::Z, Vec3::X, Vec3::Y);
    for turn_degrees in [0.0f32, 45.0, 90.0, 150.0, 200.0, 315.0] {
        for vertical_degrees in [15.0f32, 40.0] {
            let (turn, vertical) = (turn_degrees.to_radians(), vertical_degrees.to_radians());
            // From the light to the origin, in the luminaire's axes.
            let away = Vec3::new(turn.cos() * vertical.sin(), turn.sin() * vertical.sin(), -vertical.cos());
            let position = axes * away * -2.0;
            let ies = PointEmitter::Ies { position, world_from_luminaire: axes, profile: profile.clone() };
            let mut builder = floor();
            builder.bodiless("ies", LightKind::Ies, Emitter::Point(ies));
            let found = mean(&all_on(&trace(builder.build(), settings(64, 4))));
            let plane = |i: usize| f64::from(1.0 + (intensity[2 * i + 1] - 1.0) * vertical_degrees / 60.0);
            let (at, part) = ((turn_degrees / 90.0) as usize, f64::from(turn_degrees / 90.0).fract());
            let relative = plane(at) * (1.0 - part) + plane(at + 1) * part;
            let expected = relative * f64::from(vertical.cos()) / 4.0 * f64::from(FLOOR / PI);
            // The pixels' extent of 1/1000, as above.
            assert!(
                (found - expected).abs() <= 3e-3 * expected,
                "{turn_degrees}°, {vertical_degrees}°: {found} for {expected}"
            );
        }
    }
}

#[test]
fn a_two_sided_lamp_lights_both_ways_and_a_one_sided_one_only_before_it() {
    let (origin, u, v) = (Vec3::new(-0.4, 0.8, -0.4), Vec3::X * 0.8, Vec3::Z * 0.8);
    let expected = irradiance(&[origin, origin + u, origin + u + v, origin + v]) * f64::from(FLOOR / PI);
    // The front is the side of `u × v`, which looks down; with the edges swapped it looks up.
    for (edges, two_sided, share) in
        [((u, v), false, 1.0), ((v, u), false, 0.0), ((u, v), true, 1.0), ((v, u), true, 1.0)]
    {
        let mut builder = floor();
        let triangles = builder.quad(origin, edges.0, edges.1, Surface::Black);
        match two_sided {
            true => builder.two_sided_lamp("lamp", &triangles),
            false => builder.lamp("lamp", &triangles),
        }
        let found = mean(&all_on(&trace(builder.build(), settings(256, 3))));
        // As for the panel above: stratified, a deviation below 0.2 %.
        assert!((found - share * expected).abs() <= 0.01 * expected, "{two_sided} {share}: {found} for {expected}");
    }
}

/// An edge between black and light is blurred by the filter: a pixel at a distance from it holds the filter's integral beyond.
#[test]
fn filters_blur_an_edge_by_their_integral() {
    for (filter, beyond) in [
        (PixelFilter::Tent { radius: 2.0 }, tent as fn(f64) -> f64),
        (PixelFilter::Gaussian { deviation: 0.5 }, gaussian),
    ] {
        // The light fills the right half of a view of 16 × 16 pixels.
        let mut camera = camera(Vec3::Z * 2.0, Vec3::ZERO, 20.0, 16);
        camera.filter = filter;
        let mut builder = Builder::new(camera);
        builder.panel("panel", Vec3::new(0.0, -4.0, 0.0), Vec3::X * 8.0, Vec3::Y * 8.0, (1, 1));
        let blocks = trace(builder.build(), settings(4096, 2));
        let image = all_on(&blocks);
        // Blocks of 8 × 8 pixels: rows of the first channel, of the block at the left and at its right.
        for (x, column) in (4..12).enumerate().map(|(i, column)| (i as f64 - 3.5, column)) {
            let block = &image[usize::from(column >= 8) * 192..];
            let found = (0..8).map(|y| f64::from(block[y * 8 + column % 8])).sum::<f64>() / 8.0;
            // 8 × 4,096 samples of a coin: a deviation of at most 0.28 %.
            assert!((found - beyond(-x)).abs() < 0.015, "{filter:?} at {x}: {found} for {}", beyond(-x));
        }
    }
}

/// Share of a tent of radius 2 beyond `x`.
fn tent(x: f64) -> f64 {
    let inside = (1.0 - x.abs() / 2.0).max(0.0).powi(2) / 2.0;
    if x > 0.0 { inside } else { 1.0 - inside }
}

/// Share of a Gaussian beyond `x`, cut at three standard deviations, a radius of 1.5.
fn gaussian(x: f64) -> f64 {
    let density = |t: f64| (-0.5 * (t / 0.5) * (t / 0.5)).exp();
    let sum = |from: f64| {
        (0..3000).map(|i| from + (1.5 - from) * (f64::from(i) + 0.5) / 3000.0).map(density).sum::<f64>() * (1.5 - from)
    };
    sum(x.clamp(-1.5, 1.5)) / sum(-1.5)
}

/// Beside the edge of a half plane the sun's disc is cut by a chord: the floor gets the share of the disc that is left.
#[test]
fn the_penumbra_of_a_sun_is_as_wide_as_its_disc() {
    let (radius, height, side) = (0.1f32, 2.0f32, 16);
    // A view from below the roof of ±1.3 half shadows to both sides of the shadow's edge.
    let half_shadow = height * radius.tan();
    let view = 2.6 * half_shadow;
    let mut camera = camera(Vec3::Y * 1.0, Vec3::ZERO, 2.0 * (0.5 * view).atan().to_degrees(), side);
    camera.up = Vec3::Z;
    camera.right = Vec3::X;
    let mut builder = Builder::new(camera);
    builder.quad(Vec3::new(-5.0, 0.0, -5.0), Vec3::Z * 10.0, Vec3::X * 10.0, lambert(FLOOR));
    // A roof over all x below 0, of a black that returns no light.
    builder.quad(Vec3::new(-9.0, height, -9.0), Vec3::Z * 18.0, Vec3::X * 9.0, Surface::Black);
    let sun = PointEmitter::Sun { towards: Vec3::Y, angular_radius_radians: radius };
    builder.bodiless("sun", LightKind::Sun, Emitter::Point(sun));
    let blocks = trace(builder.build(), settings(1024, 2));
    let image = all_on(&blocks);
    let brightest = f64::from(FLOOR / PI);
    for column in 0..side as usize {
        // Blocks of 8 × 8 pixels, as above.
        let block = &image[usize::from(column >= 8) * 192..];
        let found = (0..8).map(|y| f64::from(block[y * 8 + column % 8])).sum::<f64>() / 8.0;
        // Mean over the pixel of the share of a disc beyond a chord, which the disc's radius measures.
        let share = |x: f64| {
            let d = x.clamp(-1.0, 1.0);
            0.5 + (d * (1.0 - d * d).sqrt() + d.asin()) / std::f64::consts::PI
        };
        let at = |x: f64| f64::from(view / half_shadow) * (x / f64::from(side) - 0.5);
        let lit = (0..64).map(|i| share(at(column as f64 + (f64::from(i) + 0.5) / 64.0))).sum::<f64>() / 64.0;
        // 8 × 1,024 samples of a coin: a deviation of at most 0.6 %; tan and sine of the radius differ by 0.5 %.
        assert!((found / brightest - lit).abs() < 0.02, "column {column}: {} for {lit}", found / brightest);
    }
}

#[test]
fn a_sky_lights_the_floor_texel_by_texel() {
    let turned = Mat3::from_rotation_y(0.7) * Mat3::from_rotation_x(0.3);
    for (mapping, kind) in [
        (EnvironmentMapping::Octahedral { side: 4 }, LightKind::Octahedral { side: 4 }),
        (EnvironmentMapping::LatLong { across: 6, down: 4 }, LightKind::LatLong { across: 6, down: 4 }),
    ] {
        let mut builder = floor();
        let sky = EnvironmentEmitter { mapping, world_from_environment: turned, is_split: false };
        builder.bodiless("sky", kind, Emitter::Environment(sky));
        let blocks = trace(builder.build(), settings(256, 4));
        let (across, down) = kind.layout();
        // ∫ over the upper hemisphere of cos θ / π, sorted into texels by a million stratified directions.
        let mut expected = vec![0.0; (across * down) as usize];
        for i in 0..1_000_000 {
            let at = |k: i32| (k as f32 + 0.5) / 1000.0;
            let (r, turn) = (at(i % 1000).sqrt(), 2.0 * PI * at(i / 1000));
            let direction = Vec3::new(r * turn.cos(), (1.0 - r * r).sqrt(), r * turn.sin());
            expected[mapping.texel_at(turned.transpose() * direction) as usize] += f64::from(FLOOR) * 1e-6;
        }
        for (column, expected) in expected.iter().enumerate() {
            let found = column_mean(&blocks, column);
            // About 80,000 stratified samples over some 16 texels: 1.5 % would be five deviations if they were random.
            assert!((found - expected).abs() < 0.01 * expected + 2e-4, "{mapping:?} {column}: {found} for {expected}");
        }
        assert!((mean(&all_on(&blocks)) / f64::from(FLOOR) - 1.0).abs() < 1e-3);
    }
}

/// A 2 × 2 panel filling the view, seen directly, in a mirror, and through a thin sheet.
#[test]
fn a_light_in_view_stands_in_its_texels_columns() {
    let sheet = Surface::ThinDielectric { ior: 1.5, transmittance: Vec3::new(0.5, 0.6, 0.7) };
    let kept = (1.0 - 0.08 / 1.04) * Vec3::new(0.5, 0.6, 0.7);
    let mirror = Surface::Mirror { reflectance: Paint::Constant(Vec3::new(0.9, 0.8, 0.7)) };
    for (name, factor) in [("direct", Vec3::ONE), ("mirror", Vec3::new(0.9, 0.8, 0.7)), ("sheet", kept)] {
        // Looking along −z; the panel faces +z. In the mirror's case the camera looks at a mirror behind which it is.
        let mut builder = Builder::new(camera(Vec3::new(0.0, 0.0, 2.0), Vec3::ZERO, 20.0, 8));
        let (origin, u, v) = match name {
            "mirror" => (Vec3::new(2.0, -2.0, 4.0), Vec3::X * -4.0, Vec3::Y * 4.0),
            _ => (Vec3::new(-2.0, -2.0, 0.0), Vec3::X * 4.0, Vec3::Y * 4.0),
        };
        builder.panel("panel", origin, u, v, (2, 2));
        if name == "mirror" {
            builder.quad(Vec3::new(-2.0, -2.0, 0.0), Vec3::X * 4.0, Vec3::Y * 4.0, mirror);
        }
        if name == "sheet" {
            builder.quad(Vec3::new(-2.0, -2.0, 1.0), Vec3::X * 4.0, Vec3::Y * 4.0, sheet);
        }
        let blocks = trace(builder.build(), settings(1024, 8));
        let view = blocks[0].0.block.view();
        for pixel in 0..64 {
            let (x, y) = (pixel % 8, pixel / 8);
            // Texel columns run along u, rows along v, which points up; the mirrored panel's u runs to the left, and
            // the mirror turns it round again about the camera, which leaves it as in the mirror image.
            let right = if name == "mirror" { x < 4 } else { x >= 4 };
            let texel = usize::from(y < 4) * 2 + usize::from(right);
            for column in 0..4 {
                for channel in 0..CHANNELS {
                    let found = view.at(channel * 64 + pixel, column);
                    let expected = if column == texel { factor[channel] } else { 0.0 };
                    // Only the sheet is left to chance: 7.7 % reflected, deviation 0.8 % at 1,024 samples.
                    assert!((found - expected).abs() < 0.05 * expected + 1e-6, "{name} {pixel} {column}: {found}");
                }
            }
        }
    }
}

/// Both ways to find a light pass thin sheets: a floor below one is darker by exactly what the sheet keeps.
#[test]
fn a_thin_sheet_before_a_light_dims_it_by_its_transmittance() {
    let scene = |with_sheet: bool, surface: Surface| {
        let mut builder = floor();
        let _ = builder.quad(Vec3::new(-0.1, 0.5, -0.1), Vec3::X * 0.2, Vec3::Z * 0.2, Surface::Black);
        builder.panel("panel", Vec3::new(-0.6, 0.9, -0.6), Vec3::X * 1.2, Vec3::Z * 1.2, (2, 2));
        if with_sheet {
            builder.quad(Vec3::new(-4.0, 0.7, -4.0), Vec3::X * 8.0, Vec3::Z * 8.0, surface);
        }
        builder.build()
    };
    let lit = |scene: Scene| mean(&all_on(&trace(scene, settings(256, 2))));
    // Index 1 reflects nothing, so the closed form needs no angles.
    let clear = lit(scene(false, Surface::Black));
    let dimmed = lit(scene(true, Surface::ThinDielectric { ior: 1.0, transmittance: Vec3::splat(0.5) }));
    assert!((dimmed / clear - 0.5).abs() < 1e-3, "{dimmed} of {clear}");
    assert_eq!(lit(scene(true, lambert(0.5))), 0.0);
}
