//! Rough glass, translucent sheets, bodies that absorb, mixtures and reliefs in whole scenes, beside closed forms.

use std::f32::consts::PI;

use glam::Vec3;
use ltm::light::{EnvironmentMapping, LightKind};
use ltm::matrix::ColumnIndex;
use ltm::scene::{
    Emitter, EnvironmentEmitter, FloatTexture, Paint, Placing, PointEmitter, PrincipledSurface, Relief, Scene, Surface,
    Texels, Texture, TextureId,
};
use ltm::trace::bsdf::{Bsdf, RoughDielectric, RoughSheet, Translucent};

use crate::scenes::{Builder, all_on, camera, lambert, mean, settings, trace};

fn white() -> PrincipledSurface {
    PrincipledSurface::opaque(1.5)
}

fn glass(roughness: f32, is_thin: bool) -> Surface {
    let (roughness, transmission) = (FloatTexture::Constant(roughness), FloatTexture::Constant(1.0));
    Surface::Principled(PrincipledSurface { roughness, transmission, is_thin, ..white() })
}

fn paper(reflected: f32, transmitted: f32) -> Surface {
    let base = Paint::Constant(Vec3::splat(reflected / (1.0 - transmitted)));
    Surface::Principled(PrincipledSurface { base, translucency: FloatTexture::Constant(transmitted), ..white() })
}

fn sky(builder: &mut Builder) {
    let mapping = EnvironmentMapping::Octahedral { side: 4 };
    let sky = EnvironmentEmitter { mapping, world_from_environment: glam::Mat3::IDENTITY, is_split: false };
    builder.bodiless("sky", LightKind::Octahedral { side: 4 }, Emitter::Environment(sky));
}

/// A texture of one texel.
fn texel(values: [f32; 4]) -> Texture {
    Texture { name: "texel".into(), width: 1, height: 1, texels: Texels::Floats(vec![values]), placing: Placing::PLAIN }
}

/// Mean of the image of 8 × 8 pixels.
fn shown(scene: Scene, samples: u32, depth: u32) -> f64 {
    mean(&all_on(&trace(scene, settings(samples, depth))))
}

/// A ball under a sky of 1, which overfills the view.
fn furnace(surface: Surface) -> Builder {
    let mut builder = Builder::new(camera(Vec3::new(0.0, 0.0, 3.0), Vec3::ZERO, 20.0, 8));
    builder.sphere(Vec3::ZERO, 1.0, 48, surface);
    sky(&mut builder);
    builder
}

#[test]
fn white_surfaces_of_every_kind_vanish_in_a_white_furnace() {
    let metal = |roughness: f32| {
        let (metallic, roughness) = (FloatTexture::Constant(1.0), FloatTexture::Constant(roughness));
        Surface::Principled(PrincipledSurface { metallic, roughness, ..white() })
    };
    let half_glass = PrincipledSurface {
        transmission: FloatTexture::Constant(0.5),
        roughness: FloatTexture::Constant(0.3),
        ..white()
    };
    let half_metal =
        PrincipledSurface { metallic: FloatTexture::Constant(0.5), roughness: FloatTexture::Constant(0.8), ..white() };
    for (name, surface) in [
        ("metal, .6", metal(0.6)),
        ("metal, 1", metal(1.0)),
        ("half metal", Surface::Principled(half_metal)),
        ("rough glass", glass(0.5, false)),
        ("rough sheet", glass(0.5, true)),
        ("paper", paper(0.5, 0.5)),
        ("half glass", Surface::Principled(half_glass)),
    ] {
        let found = shown(furnace(surface).build(), 256, 256);
        // Noise below 0.3 %; rims of the mesh, where normals disagree, and tables of albedos make the rest.
        assert!((found - 1.0).abs() < 0.01, "{name}: {found}");
    }
}

/// A sun that stands straight over a sheet of paper, seen from above and below.
#[test]
fn paper_glows_on_both_sides() {
    let seen_from = |z: f32, two_sided: bool| {
        let mut builder = Builder::new(camera(Vec3::new(0.0, 0.0, z), Vec3::ZERO, 10.0, 8));
        let surface = if two_sided { paper(0.3, 0.5) } else { lambert(0.3) };
        builder.quad(Vec3::new(-2.0, -2.0, 0.0), Vec3::X * 4.0, Vec3::Y * 4.0, surface);
        let sun = PointEmitter::Sun { towards: Vec3::Z, angular_radius_radians: 0.0 };
        builder.bodiless("sun", LightKind::Sun, Emitter::Point(sun));
        // Out of view, and on the far side of the sun's.
        builder.panel("panel", Vec3::new(-50.0, -50.0, -9.0), Vec3::X * 100.0, Vec3::Y * 100.0, (1, 1));
        let blocks = trace(builder.build(), settings(256, 2));
        let column = |at: u32| {
            let values: Vec<f32> =
                blocks.iter().flat_map(|(b, _)| b.block.view().column(ColumnIndex(at)).to_vec()).collect();
            mean(&values)
        };
        [column(0), column(1)]
    };
    let pi = f64::from(PI);
    let front = seen_from(3.0, true);
    assert!((front[0] - 0.3 / pi).abs() < 1e-3, "{front:?}");
    let back = seen_from(-3.0, true);
    assert!((back[0] - 0.5 / pi).abs() < 1e-3, "{back:?}");
    // The panel below fills 0.97 of the half space there: cos² of what is beyond its edges is missing.
    assert!((front[1] - 0.5 * 0.984).abs() < 0.02 && (back[1] - 0.3 * 0.984).abs() < 0.02, "{front:?} {back:?}");
    assert_eq!(seen_from(-3.0, false)[0], 0.0);
}

/// Light of 1 comes through a cube of side 2 that bends nothing: `e^(−2σ)`.
#[test]
fn bodies_absorb_by_their_thickness() {
    let absorption = Vec3::new(0.1, 0.5, 1.5);
    for surface in [
        PrincipledSurface { transmission: FloatTexture::Constant(1.0), ior: 1.0, is_thin: false, ..white() },
        PrincipledSurface { transmission: FloatTexture::Constant(1.0), is_thin: false, ..white() },
    ] {
        let mut builder = Builder::new(camera(Vec3::new(0.0, 0.0, 900.0), Vec3::ZERO, 0.05, 8));
        let (low, d) = (-Vec3::ONE, Vec3::splat(2.0));
        let (x, y, z) = (Vec3::X * d.x, Vec3::Y * d.y, Vec3::Z * d.z);
        for (origin, u, v) in [(low, x, z), (low, y, x), (low, z, y), (-low, -z, -x), (-low, -x, -y), (-low, -y, -z)] {
            builder.quad(origin, u, v, Surface::Principled(surface));
        }
        sky(&mut builder);
        let mut scene = builder.build();
        scene.materials[0].absorption = absorption;
        let values = all_on(&trace(scene, settings(256, 64)));
        for (channel, values) in values.chunks(64).enumerate() {
            // Two faces at normal incidence reflect R, and what is between them all its ways (a Fabry–Pérot etalon without phases):
            // `R + (1 − R)² R t² / (1 − R² t²)` comes back and `(1 − R)² t / (1 − R² t²)` comes through.
            let (r, t) = (((surface.ior - 1.0) / (surface.ior + 1.0)).powi(2), (-2.0 * absorption[channel]).exp());
            let ways = 1.0 - r * r * t * t;
            let wanted = r + (1.0 - r).powi(2) * (r * t * t + t) / ways;
            assert!((mean(values) - f64::from(wanted)).abs() < 4e-3, "{channel}: {} {wanted}", mean(values));
        }
    }
}

/// Under a sun, a wall whose map leans its normals reflects as a wall that leans.
#[test]
fn normals_of_a_map_shade_as_a_leaning_wall() {
    let towards = Vec3::new(0.6, 0.0, 0.8);
    let with = |relief: Option<(Relief, Texture)>| {
        let mut builder = Builder::new(camera(Vec3::new(0.0, 0.0, 2.0), Vec3::ZERO, 20.0, 8));
        builder.quad(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0, lambert(1.0));
        let sun = PointEmitter::Sun { towards, angular_radius_radians: 0.0 };
        builder.bodiless("sun", LightKind::Sun, Emitter::Point(sun));
        let mut scene = builder.build();
        if let Some((relief, texture)) = relief {
            scene.materials[0].relief = Some(relief);
            scene.textures.push(texture);
        }
        PI * shown(scene, 16, 2) as f32
    };
    assert!((with(None) - 0.8).abs() < 1e-3);
    let normals = |x: f32, z: f32| texel([0.5 + 0.5 * x, 0.5, 0.5 + 0.5 * z, 1.0]);
    let map = |scale: f32| Relief::Normals(TextureId(0), scale);
    assert!((with(Some((map(1.0), normals(0.0, 1.0)))) - 0.8).abs() < 1e-3);
    assert!((with(Some((map(1.0), normals(0.6, 0.8)))) - 1.0).abs() < 1e-3);
    assert!((with(Some((map(1.0), normals(-0.6, 0.8)))) - 0.28).abs() < 1e-3);
    assert!((with(Some((map(0.0), normals(-0.6, 0.8)))) - 0.8).abs() < 1e-3);
    // Normals that turn away from the viewer, or are none, still shade.
    for odd in [texel([0.5; 4]), normals(1.0, -1.0), texel([f32::NAN; 4])] {
        let found = with(Some((map(1.0), odd)));
        assert!((0.0..=1.001).contains(&found), "{found}");
    }
    // A ramp of three quarters of the width for each width leans as 3 : 4. The middle of the picture is on the ramp.
    let ramp = Texture {
        name: "ramp".into(),
        width: 2,
        height: 1,
        texels: Texels::Floats(vec![[0.25; 4], [0.625; 4]]),
        placing: Placing::PLAIN,
    };
    let found = with(Some((Relief::Heights(TextureId(0), -1.0), ramp)));
    assert!((found - 1.0).abs() < 1e-3, "{found}");
}

/// A sky of 1 behind a black sheet whose map of opacity is a quarter, and before one that is glass by half.
#[test]
fn maps_of_opacity_and_of_glass_let_their_share_through() {
    let behind = |surface: Surface, change: &dyn Fn(&mut Scene)| {
        let mut builder = Builder::new(camera(Vec3::new(0.0, 0.0, 2.0), Vec3::ZERO, 20.0, 8));
        builder.quad(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0, surface);
        sky(&mut builder);
        let mut scene = builder.build();
        change(&mut scene);
        shown(scene, 256, 4)
    };
    let quarter = |scene: &mut Scene| {
        scene.textures.push(texel([1.0, 1.0, 1.0, 0.25]));
        scene.materials[0].opacity_map = Some(TextureId(0));
    };
    assert!((behind(lambert(0.0), &quarter) - 0.75).abs() < 1e-4);
    // White glass of index 1 by a half, and black by the rest.
    let half = PrincipledSurface {
        base: Paint::Constant(Vec3::ONE),
        metallic: FloatTexture::Constant(0.0),
        transmission: FloatTexture::Textured(TextureId(0), 0, 0.5),
        ior: 1.0,
        ..white()
    };
    let found = behind(Surface::Principled(half), &|scene| scene.textures.push(texel([1.0; 4])));
    assert!((found - 1.0).abs() < 5e-3, "{found}");
    // Roughness and metal by texture are what they are by number.
    let numbers = PrincipledSurface {
        base: Paint::Constant(Vec3::splat(0.5)),
        metallic: FloatTexture::Constant(1.0),
        roughness: FloatTexture::Constant(0.5),
        ..white()
    };
    let mapped = PrincipledSurface {
        metallic: FloatTexture::Textured(TextureId(0), 2, 1.0),
        roughness: FloatTexture::Textured(TextureId(0), 1, 1.0),
        ..numbers
    };
    let [a, b] = [numbers, mapped]
        .map(|surface| behind(Surface::Principled(surface), &|scene| scene.textures.push(texel([0.0, 0.5, 1.0, 1.0]))));
    // At each of several facets half is absorbed.
    assert!((a - b).abs() < 1e-6 && (0.45..0.52).contains(&a), "{a} {b}");
}

/// A lamp behind a sheet, seen straight on: `∫ f cos θ cos θ' / d² dA`, of which light samples and scattered rays find
/// each its part.
#[test]
fn a_lamp_behind_rough_glass_is_as_bright_as_its_integral() {
    let [sheet, body] = [true, false].map(|is_thin| glass(0.6, is_thin));
    let one = Vec3::ONE;
    for (name, surface, lobe) in [
        ("sheet", sheet, Bsdf::RoughSheet(RoughSheet::new(1.5, one, 0.36))),
        ("boundary", body, Bsdf::RoughDielectric(RoughDielectric::new(1.5, one, 0.36))),
        ("paper", paper(0.2, 0.6), Bsdf::Translucent(Translucent::new(0.2 * one, 0.6 * one, Vec3::ZERO, 1e-3))),
    ] {
        for size in [0.2f32, 3.0] {
            let corner = Vec3::new(0.1, -0.5 * size, -1.0);
            let mut builder = Builder::new(camera(Vec3::new(0.0, 0.0, 2.0), Vec3::ZERO, 0.1, 8));
            builder.quad(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0, surface);
            builder.panel("panel", corner, Vec3::X * size, Vec3::Y * size, (1, 1));
            let found = shown(builder.build(), 4096, 2);
            let (steps, mut wanted) = (400, 0.0);
            for i in 0..steps * steps {
                let at = |k: i32| (k as f32 + 0.5) / steps as f32 * size;
                let point = corner + Vec3::new(at(i % steps), at(i / steps), 0.0);
                let wi = point.normalize();
                let seen = lobe.eval(Vec3::Z, wi).0.x * -wi.z / point.length_squared();
                wanted += f64::from(seen * (size / steps as f32).powi(2));
            }
            // 64 pixels of 4,096 samples: noise below 0.5 %.
            assert!((found / wanted - 1.0).abs() < 0.015, "{name} {size}: {found} for {wanted}");
        }
    }
}
