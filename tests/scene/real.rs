//! Real scenes: the committed scene files over the geometry in `LTM_SCENES`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::Vec3;
use ltm::light::LightKind;
use ltm::matrix::{BlockId, MatrixShape, TracedBlock};
use ltm::scene::{AreaLayout, Emitter, LoadedScene, Scene, Surface, load};
use ltm::trace::{TraceSettings, Tracer};

use super::z_test::{compare, reference, write_evidence};

pub(super) const TESTS: &[(&str, fn())] = &[
    ("every_committed_scene_file_loads", every_committed_scene_file_loads),
    ("the_conference_room_has_its_luminaires_facing_down", the_conference_room),
    ("the_conference_room_agrees_with_the_reference", the_conference_room_agrees),
    ("the_conference_rooms_panel_lies_where_its_luminaire_was", the_conference_rooms_panel),
    ("cornell_boxes_have_their_mirrors_and_water", cornell_boxes),
    ("the_erw5_scenes_have_the_lights_and_glass_that_their_readme_states", the_erw5_scenes),
    ("measured_luminaires_have_the_peaks_of_their_files", measured_luminaires),
];

fn scenes() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/scenes")
}

fn read(name: &str) -> LoadedScene {
    load(&scenes().join(name)).unwrap_or_else(|error| panic!("{error}"))
}

fn every_committed_scene_file_loads() {
    let mut names: Vec<_> = std::fs::read_dir(scenes()).unwrap().map(|e| e.unwrap().file_name()).collect();
    names.sort();
    assert!(names.len() >= 12);
    for name in names {
        let loaded = read(name.to_str().unwrap());
        assert!(loaded.scene.basis.column_count() > 0);
        // The bunny has two triangles wound against their normals.
        let known = |w: &ltm::error::Warning| w.text.contains("2 triangles wound against their normals");
        assert!(loaded.warnings.iter().all(known), "{name:?}: {:?}", loaded.warnings);
    }
}

/// Area-weighted normal of a light's triangles.
fn facing(scene: &Scene, light: &str) -> Vec3 {
    let index = scene.basis.lights().iter().position(|l| l.name == light).unwrap_or_else(|| panic!("no light {light}"));
    let own = scene.mesh.triangles.iter().filter(|t| t.emitter == Some(index as u32));
    let normals = own.map(|t| scene.mesh.corners(t)).map(|[a, b, c]| (b - a).cross(c - a));
    normals.sum::<Vec3>().normalize_or_zero()
}

fn the_conference_room() {
    let loaded = read("conference-24.toml");
    let scene = &loaded.scene;
    assert_eq!(scene.basis.column_count(), 24);
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    // 331,179 in the archive's file, and two for each luminaire.
    assert_eq!(scene.mesh.triangles.len(), 331_179 + 48);
    for light in scene.basis.lights() {
        assert!((facing(scene, &light.name) - Vec3::NEG_Y).length() < 1e-5, "{}", light.name);
        // 2 × 4 ft of luminous opening: 0.63 m² at 0.0041613 m a unit.
        let square_metres = light.extents[0] * scene.metres_per_unit.powi(2);
        assert!((0.55..0.7).contains(&square_metres), "{square_metres}");
    }
    let diffuse = |m: &ltm::scene::Material| matches!(m.surface, Surface::Lambert { .. } | Surface::Black);
    assert!(scene.materials.iter().all(diffuse));
    let twenty = read("conference-20.toml");
    assert_eq!(twenty.scene.basis.column_count(), 20);
    assert_ne!(twenty.content, loaded.content);
}

/// `tests/references/conference.py`: all lamps, lum_05 alone, lum_17 alone; `[lighting][channel][y][x]`.
fn the_conference_room_agrees() {
    const WIDTH: u32 = 32;
    const HEIGHT: u32 = 24;
    const LAMPS: usize = 24;
    let LoadedScene { mut scene, settings, .. } = read("conference-24.toml");
    (scene.camera.width, scene.camera.height) = (WIDTH, HEIGHT);
    let alone = ["lum_05", "lum_17"].map(|name| scene.basis.find(name).unwrap().first_column as usize);
    let (scene, shape) = (Arc::new(scene), MatrixShape::new(WIDTH, HEIGHT, LAMPS as u32, 32).unwrap());
    let pixels = (WIDTH * HEIGHT) as usize;
    let one = |seed: u64| {
        let settings = TraceSettings { samples_per_pixel: 64, seed, max_depth: settings.max_depth };
        let tracer = Tracer::new(Arc::clone(&scene), shape, settings).unwrap();
        let mut traced = TracedBlock::default();
        tracer.trace_block(BlockId(0), &mut traced);
        let view = traced.block.view();
        let mut image = vec![0.0; 3 * 3 * pixels];
        for row in 0..3 * pixels {
            image[row] = (0..LAMPS).map(|column| f64::from(view.at(row, column))).sum();
            for (lighting, &column) in alone.iter().enumerate() {
                image[(lighting + 1) * 3 * pixels + row] = f64::from(view.at(row, column));
            }
        }
        image
    };
    let renders: Vec<Vec<f64>> = (0..12).map(one).collect();
    let (mean, variance) = reference("conference");
    assert_eq!(mean.len(), renders[0].len());
    let evidence = write_evidence("conference", &renders);
    // One lamp's light reaches most pixels by rare paths, whose sums are far from normal after some thousand samples:
    // single lamps are compared in squares of 16 pixels, all lamps pixel by pixel.
    let coarse = |image: &[f64]| -> Vec<f64> {
        let (all, alone) = image.split_at(3 * pixels);
        let side = 4;
        let squares = alone.chunks_exact(side * WIDTH as usize).flat_map(|rows| {
            (0..WIDTH as usize / side).map(move |x| {
                let row = |y: usize| &rows[y * WIDTH as usize + x * side..][..side];
                (0..side).flat_map(row).sum::<f64>() / (side * side) as f64
            })
        });
        all.iter().copied().chain(squares).collect()
    };
    let mut variance = coarse(&variance);
    variance[3 * pixels..].iter_mut().for_each(|v| *v /= 16.0);
    let renders: Vec<Vec<f64>> = renders.iter().map(|image| coarse(image)).collect();
    let found = compare(&renders, (&coarse(&mean), &variance), |entry| entry / pixels == 1);
    // 2,592 entries, 864 of them independent: the mean of z² has a deviation of 0.05, and 11 and 15 degrees of freedom
    // bring it to about 1.12.
    assert!(found.mean_square < 1.35 && found.far <= 8 && found.whole.abs() < 4.0, "{found}; {evidence}");
}

fn the_conference_rooms_panel() {
    for side in [32, 64] {
        let loaded = read(&format!("conference-panel-{side}.toml"));
        let lights = loaded.scene.basis.lights();
        assert_eq!(loaded.scene.basis.column_count(), (side * side + 23) as usize);
        assert_eq!(lights[0].kind, LightKind::AreaTexels { across: side, down: side });
        assert!((facing(&loaded.scene, "panel") - Vec3::NEG_Y).length() < 1e-5);
        assert!(loaded.scene.basis.find("lum_10").is_none() && loaded.scene.basis.find("lum_09").is_some());
        let before = read("conference-24.toml");
        let replaced = before.scene.basis.find("lum_10").unwrap();
        let Emitter::Area(area) = &loaded.scene.emitters[0] else { panic!("no area light") };
        let AreaLayout::Texels { origin, edge_u, edge_v, .. } = area.layout else { panic!("no texels") };
        let centre = origin + 0.5 * (edge_u + edge_v);
        assert!((centre - Vec3::from(replaced.places[0])).length() < 3.0, "{centre}");
        let panel_area: f32 = lights[0].extents.iter().sum();
        assert!((panel_area / replaced.extents[0] - 1.0).abs() < 0.02, "{panel_area} for {}", replaced.extents[0]);
    }
}

fn surface_of(loaded: &LoadedScene, name: &str) -> Surface {
    loaded.scene.materials.iter().find(|m| m.name == name).unwrap().surface
}

fn cornell_boxes() {
    for name in ["original", "original-16", "original-64", "mirror", "glossy", "water"] {
        let loaded = read(&format!("cornell-{name}.toml"));
        assert!((facing(&loaded.scene, "light") - Vec3::NEG_Y).length() < 1e-4, "{name}");
        let side = if name.ends_with("16") {
            16
        } else if name.ends_with("64") {
            64
        } else {
            32
        };
        assert_eq!(loaded.scene.basis.column_count(), side * side);
    }
    // 10 surfaces of the box and its light, two boxes: 5 walls of 2, light 2, two boxes of 5 or 6 quads.
    let original = read("cornell-original.toml");
    assert!((32..=36).contains(&original.scene.mesh.triangles.len()), "{}", original.scene.mesh.triangles.len());
    assert!(matches!(surface_of(&read("cornell-mirror.toml"), "tallBox"), Surface::Mirror { .. }));
    let water = read("cornell-water.toml");
    assert!(matches!(surface_of(&water, "leftSphere"), Surface::Mirror { .. }));
    assert!(matches!(surface_of(&water, "water"), Surface::Dielectric { ior: 1.33, .. }));
    assert!(matches!(surface_of(&read("cornell-glossy.toml"), "floor"), Surface::Coated { .. }));
}

fn the_erw5_scenes() {
    for (name, columns, area) in [("0", 1, 144.0), ("3", 1024, 1.0), ("5", 1024, 1.0), ("8", 1024, 4.0)] {
        let loaded = read(&format!("erw5-scene{name}.toml"));
        assert_eq!(loaded.scene.basis.column_count(), columns, "scene {name}");
        let found: f32 = loaded.scene.basis.lights().iter().flat_map(|l| &l.extents).sum();
        assert!((found / area - 1.0).abs() < 1e-3, "scene {name}: {found} m²");
    }
    for light in ["unnamed_L000", "unnamed_L001", "unnamed_L002", "unnamed_L003"] {
        assert!((facing(&read("erw5-scene8.toml").scene, light) - Vec3::NEG_Y).length() < 1e-4);
    }
    let glass = read("erw5-scene5.toml");
    assert_eq!(surface_of(&glass, "unnamed_3"), Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE });
    // The ball's front is outside: the divergence theorem gives a positive volume.
    let scene = &glass.scene;
    let ball = scene.mesh.triangles.iter().filter(|t| scene.materials[t.material.0 as usize].name == "unnamed_3");
    let volume: f32 = ball.map(|t| scene.mesh.corners(t)).map(|[a, b, c]| a.cross(b).dot(c) / 6.0).sum();
    assert!(volume > 0.01, "{volume}");
    // Scene 0 is a closed box seen from inside: its walls must face in.
    let furnace = read("erw5-scene0.toml").scene;
    for triangle in &furnace.mesh.triangles {
        let [a, b, c] = furnace.mesh.corners(triangle);
        assert!((b - a).cross(c - a).dot(furnace.camera.eye - a) > 0.0);
    }
}

fn measured_luminaires() {
    let loaded = read("erw5-scene3-ies.toml");
    // The largest candela in each file at 179 lm/W; the multipliers and ballast factors of all three are 1.
    for (name, candela) in [("downlight", 4853.9), ("troffer", 1832.0), ("pendant", 0.0)] {
        let light = loaded.scene.basis.find(name).unwrap();
        assert_eq!(light.kind, LightKind::Ies);
        if candela > 0.0 {
            assert!((light.emission[0] * 179.0 / candela - 1.0).abs() < 1e-4, "{name}: {:?}", light.emission);
        }
    }
}
