//! What cameras see, in rendered pixels.

use glam::{Vec2, Vec3};
use ltm::light::{EnvironmentMapping, LightKind};
use ltm::matrix::Feature;
use ltm::scene::{Camera, Emitter, EnvironmentEmitter, Lens, Paint, PixelFilter, Projection, Surface};

use super::scenes::{Builder, lambert, settings, trace, tracer};

const SIDE: u32 = 64;

fn looking_down() -> Camera {
    let size = (SIDE, SIDE);
    Camera::looking(Vec3::new(0.0, 4.0, 0.0), Vec3::NEG_Y, Vec3::NEG_Z, 0.5, size, PixelFilter::Box).unwrap()
}

/// The image of a small lamp at (x, y, z) that faces up, as pixels row by row.
fn lamp_seen(camera: Camera, at: Vec3, samples: u32) -> Vec<f64> {
    let mut builder = Builder::new(camera);
    let half = 0.01;
    let corner = at - Vec3::new(half, 0.0, -half);
    let lamp = builder.quad(corner, Vec3::X * (2.0 * half), Vec3::NEG_Z * (2.0 * half), Surface::Black);
    builder.lamp("lamp", &lamp);
    let image = tracer(builder.build(), settings(samples, 2)).trace_image(&[[1.0; 3]], || false);
    image.unwrap().into_iter().map(|pixel| f64::from(pixel[0])).collect()
}

/// The middle of what is seen, in pixels, and the mean square of the distance from it.
fn spot(image: &[f64]) -> (Vec2, f64, f64) {
    let sum: f64 = image.iter().sum();
    let place = |i: usize| Vec2::new((i as u32 % SIDE) as f32 + 0.5, (i as u32 / SIDE) as f32 + 0.5);
    let mean =
        |value: &dyn Fn(Vec2) -> f64| image.iter().enumerate().map(|(i, v)| v * value(place(i))).sum::<f64>() / sum;
    let middle = Vec2::new(mean(&|at| f64::from(at.x)) as f32, mean(&|at| f64::from(at.y)) as f32);
    (middle, mean(&|at| f64::from((at - middle).length_squared())), sum)
}

#[test]
fn cameras_show_a_lamp_where_they_say() {
    let flat = looking_down().projected(Projection::Orthographic { height: 3.0 }).unwrap();
    let around = looking_down().projected(Projection::Panorama).unwrap();
    let cameras = [
        looking_down(),
        looking_down().shifted(Vec2::new(0.2, -0.1)).unwrap(),
        looking_down().with_pixel_aspect(1.5).unwrap(),
        flat,
        flat.shifted(Vec2::new(-0.2, 0.3)).unwrap(),
        around,
    ];
    for camera in cameras {
        let lamp = Vec3::new(0.31, 0.7, 0.22);
        let (middle, _, sum) = spot(&lamp_seen(camera, lamp, 64));
        assert!(sum > 0.0);
        // The lamp is smaller than a pixel: pixels are half a pixel exact where it touches two of them.
        let wanted = camera.position_of(lamp).unwrap();
        assert!((middle - wanted).abs().max_element() < 0.75, "{middle} for {wanted}: {camera:?}");
    }
}

/// A point at a distance z is a uniform disc of radius A·|z − f| / z in the plane of focus (similar triangles; Potmesil and Chakravarty
/// 1981, §3), in pixels that over the size of a pixel there, f·2 tan(fov / 2) / height. The mean square in a disc is half that of its rim.
#[test]
fn a_lamp_out_of_focus_is_a_disc_of_the_size_of_its_circle_of_confusion() {
    let (radius, focus) = (0.12, 3.0);
    let lens = |blades| Lens { radius, focus_distance: focus, blades, rotation_radians: 0.4 };
    let pinhole = looking_down();
    for (y, blades) in [(1.0, 0), (2.4, 0), (-2.0, 0), (2.4, 5)] {
        let z = 4.0 - y;
        let lamp = Vec3::new(0.02, y, 0.05);
        let (sharp, own, light) = spot(&lamp_seen(pinhole, lamp, 256));
        let (middle, spread, sum) = spot(&lamp_seen(pinhole.with_lens(lens(blades)).unwrap(), lamp, 1024));
        let pixel = focus * 2.0 * 0.25f32.tan() / SIDE as f32;
        let confusion = f64::from(radius * (z - focus).abs() / z / pixel);
        // Of a regular polygon of n sides the mean square is (2 + cos(2π / n)) / 6 of that of its corners.
        let part = if blades == 0 { 0.5 } else { (2.0 + (std::f64::consts::TAU / f64::from(blades)).cos()) / 6.0 };
        assert!((middle - sharp).length() < 0.6, "{y}: {middle} {sharp}");
        // The lamp's own size and the pixel's add at most about 0.3; the rest is the noise of some hundred hits.
        let wanted = part * confusion * confusion;
        assert!((spread - own - wanted).abs() < 0.06 * wanted + 0.15, "{y}: {spread} of {wanted} beside {own}");
        assert!((sum / light - 1.0).abs() < 0.1, "{y}: {sum} {light}");
    }
}

/// Each sample has the features of what it meets after the lens.
#[test]
fn features_have_the_variance_of_what_is_out_of_focus() {
    let shown = |camera: Camera| {
        let mut builder = Builder::new(camera);
        builder.quad(Vec3::new(-4.0, 0.0, 4.0), Vec3::X * 8.0, Vec3::NEG_Z * 8.0, lambert(0.8));
        // The left half is covered half-way up.
        builder.quad(Vec3::new(-2.0, 2.0, 2.0), Vec3::X * 2.0, Vec3::NEG_Z * 4.0, lambert(0.2));
        builder.panel("panel", Vec3::new(-0.5, 6.0, -0.5), Vec3::X, Vec3::Z, (1, 1));
        let blocks = trace(builder.build(), settings(64, 2));
        // The row of pixels below the middle: the first rows of eight blocks of eight pixels.
        let row = |feature, least: f32| {
            let blocks = blocks[32..40].iter().map(|(block, _)| block.planes.as_ref().unwrap());
            blocks.flat_map(|planes| planes.variance(feature)[..8].to_vec()).filter(|v| *v > least).count()
        };
        // Across a pixel, and across the lens, the depth of a floor varies a little.
        [row(Feature::Albedo, 1e-5), row(Feature::Depth, 1e-4)]
    };
    let lens = Lens { radius: 0.3, focus_distance: 4.0, blades: 0, rotation_radians: 0.0 };
    // The edge lies between two pixels of a sharp picture, so that no pixel has both; the depth across a pixel varies by less than that.
    assert_eq!(shown(looking_down()), [0, 0]);
    // At the edge's height, half of the focus distance, the rays of a pixel cover a disc of radius 0.15: 0.3 on the floor, of which 64 pixels
    // show 2.04. That is 9.4 pixels to either side, the last of which few rays leave on the other side.
    let [albedo, depth] = shown(looking_down().with_lens(lens).unwrap());
    assert!((15..=20).contains(&albedo) && (15..=20).contains(&depth), "{albedo} {depth}");
}

/// A lamp in the upper half of the picture, a mirror that shows it in the lower half, a pane of glass before the left half, and a sky.
#[test]
fn unseen_lights_are_seen_in_mirrors_alone_and_light_as_before() {
    let camera = Camera::looking(Vec3::new(0.0, 1.0, 4.0), Vec3::NEG_Z, Vec3::Y, 1.0, (SIDE, SIDE), PixelFilter::Box);
    let camera = camera.unwrap();
    let image = |unseen: [bool; 2]| {
        let mut builder = Builder::new(camera);
        let mirror = Surface::Mirror { reflectance: Paint::Constant(Vec3::ONE) };
        builder.quad(Vec3::new(-9.0, 0.0, 9.0), Vec3::X * 18.0, Vec3::NEG_Z * 18.0, mirror);
        builder.quad(Vec3::new(1.6, 0.1, 0.0), Vec3::Z * 2.0, Vec3::Y * 3.0, lambert(0.5));
        builder.quad(
            Vec3::new(-3.0, 0.5, 2.0),
            Vec3::X * 3.0,
            Vec3::Y * 3.0,
            Surface::ThinDielectric { ior: 1.0, transmittance: Vec3::ONE },
        );
        builder.panel("panel", Vec3::new(-1.0, 0.9, 0.0), Vec3::X * 2.0, Vec3::Y, (1, 1));
        if unseen[0] {
            builder.unseen();
        }
        let mapping = EnvironmentMapping::Octahedral { side: 1 };
        let sky = EnvironmentEmitter { mapping, world_from_environment: glam::Mat3::IDENTITY, is_split: false };
        builder.bodiless("sky", LightKind::Octahedral { side: 1 }, Emitter::Environment(sky));
        if unseen[1] {
            builder.unseen();
        }
        let tracer = tracer(builder.build(), settings(4, 8));
        let lit = |weights: [f32; 2]| tracer.trace_image(&weights.map(|w| [w; 3]), || false).unwrap();
        [lit([1.0, 0.0]), lit([0.0, 1.0])].map(|image| image.into_iter().map(|pixel| pixel[0]).collect::<Vec<f32>>())
    };
    let at = |image: &[f32], x: u32, y: u32| image[(y * SIDE + x) as usize];
    let (seen, [panel, sky]) = (image([false, false]), image([true, true]));
    // A lamp that faces the camera, right and left, the latter behind the pane; and what is seen of both in the floor.
    for (x, y) in [(35, 22), (28, 22)] {
        assert_eq!((at(&seen[0], x, y), at(&panel, x, y)), (1.0, 0.0));
        // The sky is not seen behind it either, but if it is seen itself.
        assert_eq!((at(&seen[1], x, y), at(&sky, x, y), at(&image([true, false])[1], x, y)), (0.0, 0.0, 1.0));
    }
    assert_eq!((at(&seen[1], 10, 4), at(&sky, 10, 4)), (1.0, 0.0));
    let lower = (SIDE * SIDE * 3 / 5) as usize..;
    assert_eq!(seen[0][lower.clone()], panel[lower.clone()]);
    assert_eq!(seen[1][lower.clone()], sky[lower.clone()]);
    assert!(panel[lower.clone()].contains(&1.0) && sky[lower].contains(&1.0));
    // The wall beside the lamp, before it, is lit as before.
    let wall = at(&panel, 59, 22);
    assert!(wall > 0.0 && wall == at(&seen[0], 59, 22) && at(&sky, 59, 22) == at(&seen[1], 59, 22), "{wall}");
}
