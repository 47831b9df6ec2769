//! Walls that let nothing through.

use glam::{DQuat, DVec3, EulerRot};

use super::analytic::irradiance;
use super::files::{Scene, quad, rendered};
use super::mean;

const ZERO: DVec3 = DVec3::ZERO;

/// The faces of a box between two corners, seen from inside, each cut into `cuts × cuts`.
fn inside(min: DVec3, max: DVec3, cuts: u32) -> Vec<Vec<DVec3>> {
    let d = max - min;
    let (x, y, z) = (DVec3::X * d.x, DVec3::Y * d.y, DVec3::Z * d.z);
    let sides = [(min, z, x), (min, x, y), (min, y, z), (max, -x, -z), (max, -y, -x), (max, -z, -y)];
    sides.into_iter().flat_map(|(origin, u, v)| quad(origin, u, v, cuts)).collect()
}

fn turned(turn: DQuat, faces: Vec<Vec<DVec3>>) -> Vec<Vec<DVec3>> {
    faces.into_iter().map(|face| face.into_iter().map(|corner| turn * corner).collect()).collect()
}

/// Paths of eight segments in a closed room, with a panel, a point, a sun and a sky outside: nothing at all comes in.
pub(super) fn closed_boxes() {
    let tilt = DQuat::from_euler(EulerRot::XYZ, 0.3, 0.8, -0.5);
    for (turn, offset) in [
        (DQuat::IDENTITY, ZERO),
        (DQuat::IDENTITY, DVec3::new(7.3, 0.1, -4.7)),
        (tilt, ZERO),
        (tilt, DVec3::new(5.0, -3.0, 8.0)),
        (tilt, DVec3::new(691_000.237, 512.0, 5_335_000.137)),
    ] {
        for cuts in [1, 5] {
            let mut scene = Scene::new(offset);
            scene.add("white", &turned(turn, inside(DVec3::new(-2.0, 0.0, -1.5), DVec3::new(2.0, 2.6, 1.5), cuts)));
            let above = quad(DVec3::new(-3.0, 2.7, -3.0), 6.0 * DVec3::X, 6.0 * DVec3::Z, 1);
            scene.add("lamp", &turned(turn, above));
            let more = format!(
                "[[light]]\nmaterial = \"lamp\"\n[[light]]\nkind = \"point\"\nposition = {}\n\
                [[light]]\nkind = \"sun\"\ntowards = [0.3, 0.8, 0.4]\n[[light]]\nkind = \"environment\"\ntexels = [4, 2]\n",
                scene.place(turn * DVec3::new(2.2, 0.1, 0.3))
            );
            let view = (turn * DVec3::new(1.2, 1.4, 1.1), turn * DVec3::new(-0.6, 1.0, -0.5));
            let image = rendered(&scene.load(view, 100.0, 48, &more), 64, 8);
            let lit = image.pixels.iter().filter(|pixel| **pixel != [0.0; 3]).count();
            assert_eq!(lit, 0, "{offset}, {cuts}: {lit} pixels are lit by what is outside");
        }
    }
}

/// A slab a hundred-thousandth as thick as it is wide, over a floor that it nearly touches: all is dark below, and its top is lit as Lambert
/// says.
pub(super) fn thin_slabs() {
    for offset in [ZERO, DVec3::new(3.0, 1.0, -2.0), DVec3::new(691_000.0, 400.0, 5_335_000.0)] {
        for turn in [DQuat::IDENTITY, DQuat::from_euler(EulerRot::XYZ, 0.3, 0.8, -0.5)] {
            let thin = 2e-5;
            let mut scene = Scene::new(offset);
            let square = |y: f64, up: bool| {
                let corner = DVec3::new(-1.0, y, -1.0);
                let (u, v) = if up { (DVec3::Z, DVec3::X) } else { (DVec3::X, DVec3::Z) };
                turned(turn, quad(corner, 2.0 * u, 2.0 * v, 3))
            };
            scene.add("grey", &square(0.0, true));
            scene.add("grey", &square(0.01, false));
            scene.add("grey", &square(0.01 + thin, true));
            let lamp =
                vec![[(-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2)].map(|(x, z)| DVec3::new(x, 0.5, z)).to_vec()];
            scene.add("lamp", &turned(turn, lamp.clone()));
            let below = DVec3::new(0.1, 0.0, 0.2);
            let view = |point: DVec3, near: f64| (turn * (point + near * DVec3::new(0.6, 1.0, 0.3)), turn * point);
            let dark = rendered(&scene.load(view(below, 0.005), 0.05, 8, ""), 64, 2);
            assert_eq!(mean(&dark), 0.0, "{offset}");
            let above = DVec3::new(0.1, 0.01 + thin, 0.2);
            let lit = mean(&rendered(&scene.load(view(above, 0.2), 0.05, 8, ""), 128, 2));
            let right = irradiance(above, DVec3::Y, &lamp[0]) * 0.5 / std::f64::consts::PI;
            // 8,192 paths of four light samples: a quarter of a per cent; four of those.
            assert!((lit / right - 1.0).abs() < 0.01, "{offset}: {lit} for {right}");
        }
    }
}

/// A point over a mirror that lies close below a floor's edge: the mirror shows the floor a second one, by photons alone.
pub(super) fn mirrors() {
    for offset in [ZERO, DVec3::new(3.0, 1.0, -2.0), DVec3::new(691_000.0, 400.0, 5_335_000.0)] {
        for gap in [0.02, 0.3] {
            // A mirror at y = 0 that looks up, and above it a grey ceiling at `gap`, seen from below; the point is half way.
            let mut scene = Scene::new(offset);
            scene.add("mirror", &quad(DVec3::new(-2.0, 0.0, -2.0), 4.0 * DVec3::Z, 4.0 * DVec3::X, 1));
            scene.add("grey", &quad(DVec3::new(-2.0, gap, -2.0), 4.0 * DVec3::X, 4.0 * DVec3::Z, 1));
            let lamp = DVec3::new(0.0, 0.5 * gap, 0.0);
            let more = format!("[[light]]\nkind = \"point\"\nposition = {}\n", scene.place(lamp));
            let point = DVec3::new(0.1 * gap, gap, 0.05 * gap);
            let eye = point - 0.3 * gap * DVec3::new(0.8, 1.0, 0.3);
            let found = mean(&rendered(&scene.load((eye, point), 1.0, 16, &more), 64, 3));
            let of = |lamp: DVec3| (point - lamp).normalize().y / (point - lamp).length_squared();
            let right = (of(lamp) + of(-lamp)) * 0.5 / std::f64::consts::PI;
            // Photons are gathered over a disc, which blurs a light that varies by its curvature there.
            assert!((found / right - 1.0).abs() < 0.03, "{offset}, {gap}: {found} for {right}");
        }
    }
}
