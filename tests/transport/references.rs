//! Against another renderer: images of single columns by Mitsuba 3, with their variance (`tests/references/make.py`).

use glam::Vec3;
use ltm::matrix::{CHANNELS, TracedBlock};
use ltm::scene::{Paint, Scene, Surface};
use ltm::trace::TraceSettings;

use crate::scenes::{Builder, camera, lambert, settings, trace};

const SIDE: usize = 16;
const TEXELS: usize = 2;
const ENTRIES: usize = TEXELS * CHANNELS * SIDE * SIDE;

/// The scene of this name, as the script builds it.
fn scene(name: &str) -> Scene {
    let mut builder = Builder::new(camera(Vec3::new(0.5, 0.5, 0.95), Vec3::new(0.5, 0.4, 0.0), 75.0, SIDE as u32));
    builder.room(Vec3::ZERO, Vec3::ONE, lambert(0.5));
    let ceiling = (Vec3::new(0.25, 0.98, 0.25), Vec3::X * 0.5, Vec3::Z * 0.5);
    let mirror = Surface::Mirror { reflectance: Paint::Constant(Vec3::splat(0.9)) };
    let glossy = Surface::RoughConductor { specular: Paint::Constant(Vec3::ONE), alpha: 0.2 };
    let (origin, u, v) = match name {
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
            let glass = Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE };
            builder.sphere(Vec3::new(0.5, 0.35, 0.4), 0.25, 24, glass);
            ceiling
        }
        "light_in_view" => {
            let sheet = Surface::ThinDielectric { ior: 1.5, transmittance: Vec3::ONE };
            builder.quad(Vec3::new(0.1, 0.2, 0.3), Vec3::X * 0.5, Vec3::Y * 0.6, sheet);
            (Vec3::new(0.3, 0.3, 0.02), Vec3::X * 0.4, Vec3::Y * 0.4)
        }
        _ => unreachable!("{name}"),
    };
    builder.panel("panel", origin, u, v, (TEXELS as u32, 1));
    let mut scene = builder.build();
    // Flat facets, as in the references: how interpolated normals behave at a rim is each renderer's own convention.
    scene.mesh.normals.fill(Vec3::ZERO);
    scene
}

/// Mean and variance of the mean, `[texel][channel][y][x]`, from the reference's file.
fn reference(name: &str) -> (Vec<f64>, Vec<f64>) {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/references/{name}.f32"));
    let bytes = std::fs::read(&path).unwrap();
    let values: Vec<f64> =
        bytes.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap()))).collect();
    assert_eq!(values.len(), 2 * ENTRIES);
    (values[..ENTRIES].to_vec(), values[ENTRIES..].to_vec())
}

/// One render in the reference's order.
fn image(blocks: &[(TracedBlock, ltm::trace::BlockStats)]) -> Vec<f64> {
    let mut image = vec![0.0; ENTRIES];
    for (index, (traced, _)) in blocks.iter().enumerate() {
        let view = traced.block.view();
        for column in 0..TEXELS {
            for row in 0..view.rows() {
                let (channel, pixel) = (row / 64, row % 64);
                let (x, y) = (index % 2 * 8 + pixel % 8, index / 2 * 8 + pixel / 8);
                image[((column * CHANNELS + channel) * SIDE + y) * SIDE + x] = f64::from(view.at(row, column));
            }
        }
    }
    image
}

fn agrees(name: &str) {
    let renders: Vec<Vec<f64>> =
        (0..24).map(|seed| image(&trace(scene(name), TraceSettings { seed, ..settings(128, 24) }))).collect();
    let n = renders.len() as f64;
    let (expected, their_variance) = reference(name);
    let (mut squares, mut far, mut counted) = (0.0, 0, 0);
    let (mut difference, mut variance, mut total) = (0.0, 0.0, 0.0);
    for entry in 0..ENTRIES {
        let mean = renders.iter().map(|r| r[entry]).sum::<f64>() / n;
        let ours = renders.iter().map(|r| (r[entry] - mean).powi(2)).sum::<f64>() / (n - 1.0) / n;
        // Rounding of f32 sums, where neither side has noise (a light seen directly).
        let both = ours + their_variance[entry] + (1e-5 * expected[entry]).powi(2) + 1e-12;
        let z = (mean - expected[entry]) / both.sqrt();
        squares += z * z;
        far += usize::from(z.abs() > 4.5);
        counted += 1;
        // Channels are the same paths: one of them stands for all.
        if (entry / (SIDE * SIDE)).is_multiple_of(CHANNELS) {
            (difference, variance, total) =
                (difference + mean - expected[entry], variance + both, total + expected[entry]);
        }
    }
    let (mean_square, whole) = (squares / f64::from(counted), difference / variance.sqrt());
    let relative = difference / total;
    let found = format!(
        "{name}: mean z² {mean_square:.3}, {far} of {counted} entries beyond 4.5 deviations; \
         the images differ by {relative:.5}, {whole:.2} deviations"
    );
    // 1,536 entries, 512 of them independent: the mean of z² has a deviation of 0.07, and 23 and 15 degrees of freedom
    // bring it to 1.06. Both sides find the variance of rare bright paths too small: a few entries may lie far out.
    assert!(mean_square < 1.35 && far <= 12 && whole.abs() < 4.0, "{found}");
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

#[test]
fn a_light_seen_through_a_sheet_agrees_with_the_reference() {
    agrees("light_in_view");
}
