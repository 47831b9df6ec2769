//! What scene files mean.

use glam::{Vec2, Vec3};
use ltm::error::Warnings;
use ltm::image::{LinearImage, write_exr};
use ltm::light::{EnvironmentMapping, LightBasis, LightKind, LightUnit};
use ltm::matrix::MatrixShape;
use ltm::scene::{
    AreaLayout, Emitter, Paint, PixelFilter, PointEmitter, RenderSettings, Surface, built_in, built_in_named, validate,
};

use super::{Folder, room};

pub(super) const TESTS: &[(&str, fn())] = &[
    ("every_emissive_material_is_a_column_where_no_light_is_named", every_emissive_material_is_a_column),
    ("a_rectangle_without_texture_coordinates_is_cut_along_its_sides", a_rectangle_is_cut_along_its_sides),
    ("texture_coordinates_decide_where_the_texels_lie", texture_coordinates_decide),
    ("the_side_that_emits_can_be_chosen", the_side_that_emits_can_be_chosen),
    ("normals_decide_which_side_is_the_front", normals_decide_which_side_is_the_front),
    ("lights_are_chosen_by_object_and_joined", lights_are_chosen_by_object_and_joined),
    ("earlier_lights_take_their_surfaces_first", earlier_lights_take_their_surfaces_first),
    ("a_panel_replaces_a_lamp", a_panel_replaces_a_lamp),
    ("point_spot_sun_and_ies_are_one_column_each", point_like_lights_are_one_column_each),
    ("an_environments_map_becomes_the_scenes_lighting", an_environments_map_becomes_the_lighting),
    ("materials_are_overridden_by_pattern", materials_are_overridden_by_pattern),
    ("energy_above_one_is_clamped_with_one_warning", energy_above_one_is_clamped),
    ("textures_are_read_once_and_cut_outs_use_alpha", textures_are_read_once),
    ("textures_are_found_in_any_case_with_one_warning", textures_in_any_case),
    ("material_files_are_found_in_any_case", material_files_in_any_case),
    ("missing_textures_are_all_named_or_give_way_to_colours", missing_textures),
    ("degenerate_triangles_are_left_out_and_counted", degenerate_triangles_are_left_out),
    ("material_files_may_say_odd_things", material_files_say_odd_things),
    ("missing_materials_are_grey_with_a_warning", missing_materials_are_grey),
    ("the_camera_and_the_settings_are_as_written", the_camera_and_the_settings_are_as_written),
    ("the_content_hash_follows_what_decides_the_entries", the_content_hash_follows),
    ("built_in_scenes_pass_their_own_checks", built_in_scenes_pass_their_own_checks),
    ("the_format_document_states_the_defaults_and_limits_of_the_code", the_format_document_states_the_defaults),
    ("a_very_large_matrix_is_warned_of", a_very_large_matrix_is_warned_of),
];

fn near(a: [f32; 3], b: [f32; 3]) {
    assert!((Vec3::from(a) - Vec3::from(b)).length() < 1e-5, "{a:?} for {b:?}");
}

fn every_emissive_material_is_a_column() {
    let loaded = room("").load().unwrap();
    let lights = loaded.scene.basis.lights();
    assert_eq!(lights.len(), 1);
    assert_eq!(
        (lights[0].name.as_str(), lights[0].kind, lights[0].unit),
        ("lamp", LightKind::Lamp, LightUnit::Radiance)
    );
    near(lights[0].emission, [3.0, 2.0, 1.0]);
    near(lights[0].places[0], [0.0, 3.0, 0.5]);
    assert!((lights[0].extents[0] - 2.0).abs() < 1e-5);
    assert_eq!(loaded.lighting.weights(), [[3.0, 2.0, 1.0]]);
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    assert_eq!(loaded.scene.name, "scene");
    let lit = loaded.scene.mesh.triangles.iter().filter(|t| t.emitter == Some(0)).count();
    assert_eq!(lit, 2);
}

fn a_rectangle_is_cut_along_its_sides() {
    let loaded = room("[[light]]\nmaterial = \"lamp\"\ntexels = [4, 2]\n").load().unwrap();
    let light = &loaded.scene.basis.lights()[0];
    assert_eq!(light.kind, LightKind::AreaTexels { across: 4, down: 2 });
    near(light.places[0], [-0.75, 3.0, 0.25]);
    near(light.places[5], [-0.25, 3.0, 0.75]);
    assert!(light.extents.iter().all(|area| (area - 0.25).abs() < 1e-5));
    let Emitter::Area(area) = &loaded.scene.emitters[0] else { panic!("not an area light") };
    let AreaLayout::Texels { normal, .. } = area.layout else { panic!("not cut") };
    near(normal.into(), [0.0, -1.0, 0.0]);
    for (texel, place) in light.places.iter().enumerate() {
        assert_eq!(area.layout.column_at((*place).into()), texel as u32);
    }
}

fn texture_coordinates_decide() {
    let obj = "v -1 3 0\nv 1 3 0\nv 1 3 1\nv -1 3 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1
v -5 0 -5\nv -5 0 5\nv 5 0 5\nv 5 0 -5\nf 5 6 7 8
usemtl lamp\nf 1/3 2/4 3/1 4/2\n";
    let more = "[[light]]\nmaterial = \"lamp\"\nemission = [1, 1, 1]\ntexels = [2, 2]\n";
    let folder = room(more).with("room.obj", obj);
    let loaded = folder.load().unwrap();
    // The corner (1, 3, 1) has the smallest texture coordinates, u runs to −x.
    let light = &loaded.scene.basis.lights()[0];
    near(light.places[0], [0.5, 3.0, 0.75]);
    near(light.places[1], [-0.5, 3.0, 0.75]);
    near(light.places[2], [0.5, 3.0, 0.25]);
}

fn front_of_light(folder: &Folder) -> Vec3 {
    let scene = folder.load().unwrap().scene;
    let triangle = scene.mesh.triangles.iter().find(|t| t.emitter.is_some()).unwrap();
    let [a, b, c] = scene.mesh.corners(triangle);
    (b - a).cross(c - a).normalize()
}

fn the_side_that_emits_can_be_chosen() {
    assert_eq!(front_of_light(&room("")), Vec3::NEG_Y);
    assert_eq!(front_of_light(&room("[[light]]\nside = \"back\"\n")), Vec3::Y);
    // Normals that shade turn with it, and stay what they are for whatever shares the vertices.
    let shaded = room("[[light]]\nside = \"back\"\n")
        .with("room.obj", super::ROOM_OBJ.replace("usemtl lamp\n", "vn 0.6 -0.8 0\nusemtl lamp\n"));
    let shaded = shaded.load().unwrap().scene;
    let lit = shaded.mesh.triangles.iter().filter(|t| t.emitter == Some(0));
    assert!(lit.clone().count() == 2 && lit.flat_map(|t| shaded.mesh.vertices_of(t)).all(|v| v.normal.y >= 0.0));
    let both = room("[[light]]\nside = \"both\"\ntexels = [2, 2]\n").load().unwrap();
    assert!(matches!(&both.scene.emitters[0], Emitter::Area(area) if area.two_sided));
}

fn normals_decide_which_side_is_the_front() {
    let obj = super::ROOM_OBJ.replace("f 5 6 7 8", "vn 0 1 0\nf 5//1 6//1 7//1 8//1");
    let folder = room("").with("room.obj", obj);
    assert_eq!(front_of_light(&folder), Vec3::Y);
    assert!(folder.load().unwrap().warnings[0].text.contains("2 triangles"));
}

const TWO_LAMPS: &str = "mtllib room.mtl
v -5 0 -5\nv -5 0 5\nv 5 0 5\nv 5 0 -5\nv -1 3 0\nv 1 3 0\nv 1 3 1\nv -1 3 1
usemtl ground\nf 1 2 3 4
o left\nusemtl lamp\nf 5 6 7
o right\nusemtl lamp\nf 5 7 8
o right\nusemtl bulb\nf 5 6 7 8
";

fn two_lamps(more: &str) -> Folder {
    let mtl = format!("{}newmtl bulb\nKe 3 2 1\nKd 0\n", super::ROOM_MTL);
    room(more).with("room.obj", TWO_LAMPS).with("room.mtl", mtl)
}

fn names_of(folder: &Folder) -> Vec<String> {
    folder.load().unwrap().scene.basis.lights().iter().map(|l| l.name.clone()).collect()
}

fn lights_are_chosen_by_object_and_joined() {
    assert_eq!(names_of(&two_lamps("")), ["lamp", "bulb"]);
    assert_eq!(names_of(&two_lamps("[[light]]\nobject = \"*\"\n")), ["left", "right"]);
    assert_eq!(names_of(&two_lamps("[[light]]\njoin = true\nname = \"all\"\n")), ["all"]);
    assert_eq!(names_of(&two_lamps("[[light]]\nobject = \"right\"\nmaterial = \"lamp\"\n")), ["lamp"]);
}

fn earlier_lights_take_their_surfaces_first() {
    let folder = two_lamps("[[light]]\nmaterial = \"bulb\"\ntexels = [2, 2]\n[[light]]\nmaterial = \"*\"\n");
    let loaded = folder.load().unwrap();
    assert_eq!(loaded.scene.basis.column_count(), 5);
    assert!(loaded.warnings.is_empty());
    let dark = two_lamps("[[light]]\nmaterial = \"bulb\"\n").load().unwrap();
    assert!(dark.warnings.iter().any(|w| w.text.contains("'lamp' emits")), "{:?}", dark.warnings);
}

fn a_panel_replaces_a_lamp() {
    let more = "[[light]]\nkind = \"panel\"\nreplaces = \"lamp\"\norigin = [-1, 2.9, 0]\nedge_u = [2, 0, 0]
edge_v = [0, 0, 1]\nfaces = [0, -1, 0]\ntexels = [8, 4]\nemission = [5, 5, 5]\n";
    let folder = room(more);
    let loaded = folder.load().unwrap();
    assert_eq!(loaded.scene.mesh.triangles.len(), 4);
    assert_eq!(loaded.scene.basis.column_count(), 32);
    assert_eq!(loaded.scene.basis.lights()[0].name, "panel");
    assert_eq!(front_of_light(&folder), Vec3::NEG_Y);
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
}

fn point_like_lights_are_one_column_each() {
    let ies = "TILT=NONE\n1 1000 2 2 1 1 2 0 0 0 1 1 75\n0 90\n0\n179 0\n";
    let more = "[[light]]\nkind = \"point\"\nposition = [0, 2, 0]\nemission = [7, 7, 7]
[[light]]\nkind = \"spot\"\nposition = [1, 2, 0]\nouter_degrees = 40\n[[light]]\nkind = \"sun\"\ntowards = [0, 3, 4]
[[light]]\nkind = \"ies\"\nfile = \"a.ies\"\nposition = [0, 2, 1]\n[[material]]\nmatch = \"lamp\"\nemission = [0, 0, 0]\n";
    let loaded = room(more).with("a.ies", ies).load().unwrap();
    let lights = loaded.scene.basis.lights();
    let kinds: Vec<_> = lights.iter().map(|l| (l.name.as_str(), l.kind, l.unit)).collect();
    let wanted = [
        ("point", LightKind::Point, LightUnit::Intensity),
        ("spot", LightKind::Spot, LightUnit::Intensity),
        ("sun", LightKind::Sun, LightUnit::Irradiance),
        ("ies", LightKind::Ies, LightUnit::Intensity),
    ];
    assert_eq!(kinds, wanted);
    near(lights[0].emission, [7.0; 3]);
    near(lights[2].places[0], [0.0, 0.6, 0.8]);
    // 2π (1 − cos 0.2665°)
    assert!((lights[2].extents[0] / 6.797e-5 - 1.0).abs() < 1e-3, "{}", lights[2].extents[0]);
    near(lights[3].emission, [2.0; 3]);
    // The same luminaire as EULUMDAT: 179 cd for 1,000 lm, of which there are 2,000.
    let head = "x\n1\n1\n1\n0\n2\n90\n".to_owned() + &"0\n".repeat(16) + "1\n0\n1\n1\nLED\n2000\n0\n0\n9\n";
    let ldt = head + &"0\n".repeat(10) + "0\n0\n90\n179\n0\n";
    let same = room(&more.replace("a.ies", "a.LDT")).with("a.LDT", ldt).load().unwrap();
    near(same.scene.basis.lights()[3].emission, [2.0; 3]);
    let Emitter::Point(PointEmitter::Spot { direction, inner_radians, outer_radians, .. }) = &loaded.scene.emitters[1]
    else {
        panic!("no spot")
    };
    assert_eq!(*direction, Vec3::NEG_Y);
    assert!((inner_radians / outer_radians - 0.8).abs() < 1e-6);
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
}

fn an_environments_map_becomes_the_lighting() {
    let mut image = LinearImage::black(64, 32);
    image.pixels.iter_mut().enumerate().for_each(|(i, p)| *p = [if i % 64 < 32 { 2.0 } else { 0.0 }, 1.0, 0.5]);
    for (mapping, texels) in [("lat_long", "[16, 8]"), ("octahedral", "[12, 12]")] {
        let more = format!(
            "[[light]]\nkind = \"environment\"\nmapping = \"{mapping}\"\ntexels = {texels}\nmap = \"sky.exr\"
emission = [1, 2, 1]\n[[light]]\nmaterial = \"lamp\"\n"
        );
        let folder = room(&more);
        write_exr(&folder.path("sky.exr"), &image).unwrap();
        let loaded = folder.load().unwrap();
        let weights = loaded.lighting.weights();
        let sky = &loaded.scene.basis.lights()[0];
        assert_eq!(weights.len(), sky.places.len() + 1);
        near(weights[sky.places.len()], [3.0, 2.0, 1.0]);
        for (weight, place) in weights.iter().zip(&sky.places) {
            // The image's left half turns from −z over +x to +z.
            if place[0].abs() > 0.3 {
                near(*weight, [if place[0] > 0.0 { 2.0 } else { 0.0 }, 2.0, 0.5]);
            }
        }
        let sphere: f32 = sky.extents.iter().sum();
        assert!((sphere / (4.0 * std::f32::consts::PI) - 1.0).abs() < 1e-4);
    }
    let turned = room("[[light]]\nkind = \"environment\"\nturn_degrees = 90\n").load().unwrap();
    let Emitter::Environment(sky) = turned.scene.emitters[0] else { panic!("no environment") };
    assert_eq!(sky.mapping, EnvironmentMapping::LatLong { across: 32, down: 16 });
    // Counter-clockwise seen from above, −z goes to −x.
    assert!((sky.world_from_environment * Vec3::NEG_Z - Vec3::NEG_X).length() < 1e-5);
}

fn surface_of(folder: &Folder, name: &str) -> Surface {
    folder.load().unwrap().scene.materials.iter().find(|m| m.name == name).unwrap().surface
}

fn materials_are_overridden_by_pattern() {
    let with = |text: &str| surface_of(&room(&format!("[[material]]\nmatch = \"gr*d\"\n{text}\n")), "ground");
    let grey = Paint::Constant(Vec3::splat(0.25));
    let own = Paint::Constant(Vec3::new(0.5, 0.4, 0.3));
    assert_eq!(with("reflectance = [0.25, 0.25, 0.25]"), Surface::Lambert { reflectance: grey });
    assert_eq!(with("kind = \"mirror\""), Surface::Mirror { reflectance: own });
    let metal = with("kind = \"rough_conductor\"\nroughness = 0.5");
    assert_eq!(metal, Surface::RoughConductor { specular: own, alpha: 0.25 });
    let glass = with("kind = \"dielectric\"\nior = 1.33\ntransmittance = [1, 0.5, 1]");
    assert_eq!(glass, Surface::Dielectric { ior: 1.33, transmittance: Vec3::new(1.0, 0.5, 1.0) });
    assert!(matches!(with("kind = \"thin_dielectric\""), Surface::ThinDielectric { ior: 1.5, .. }));
    assert!(matches!(with("kind = \"coated\"\nspecular = [0.1, 0.1, 0.1]"), Surface::Coated { .. }));
    assert_eq!(with("kind = \"coated\"\nspecular = [0, 0, 0]"), Surface::Lambert { reflectance: own });
    assert_eq!(with("kind = \"black\""), Surface::Black);
}

fn energy_above_one_is_clamped() {
    let mtl = format!("{}newmtl snow\nKd 1.5 0.5 0.5\n", super::ROOM_MTL);
    let obj = format!("{}usemtl snow\nf 1 2 3\nf 1 3 4\nf 2 3 4\n", super::ROOM_OBJ);
    let folder = room("").with("room.mtl", mtl).with("room.obj", obj);
    let reflectance = Paint::Constant(Vec3::new(1.0, 0.5, 0.5));
    assert_eq!(surface_of(&folder, "snow"), Surface::Lambert { reflectance });
    let warnings = folder.load().unwrap().warnings;
    assert_eq!(warnings.iter().filter(|w| w.text.contains("'snow'")).count(), 1, "{warnings:?}");
}

fn textures_are_read_once() {
    let mtl = "newmtl lamp\nKe 1 1 1\nmap_Ke glow.png\nnewmtl ground\nKd 0 0 0\nmap_Kd wood.png\nmap_d wood.png
newmtl other\nKd 0.5 0.5 0.5\nmap_Kd -s 1 1 1 wood.png\n";
    let obj = format!("{}usemtl other\nf 1 2 3\n", super::ROOM_OBJ);
    let folder = room("").with("room.mtl", mtl).with("room.obj", obj);
    let wood = vec![255u8, 0, 0, 255, 0, 255, 0, 0];
    image::RgbaImage::from_raw(2, 1, wood).unwrap().save(folder.path("wood.png")).unwrap();
    image::GrayImage::from_raw(1, 1, vec![255]).unwrap().save(folder.path("glow.png")).unwrap();
    let scene = folder.load().unwrap().scene;
    assert_eq!(scene.textures.len(), 3, "wood as reflectance and as cut-out, glow as emission");
    let by_name = |name: &str| scene.materials.iter().find(|m| m.name == name).unwrap();
    let Surface::Lambert { reflectance } = by_name("ground").surface else { panic!("not Lambertian") };
    assert_eq!(reflectance.at(&scene.textures, Vec2::new(0.25, 0.5)), Vec3::X, "a black Kd beside a map counts as 1");
    let Surface::Lambert { reflectance } = by_name("other").surface else { panic!("not Lambertian") };
    assert_eq!(reflectance.at(&scene.textures, Vec2::new(0.75, 0.5)), Vec3::Y * 0.5);
    let cutout = by_name("ground").opacity_map.unwrap();
    assert_eq!(scene.textures[cutout.0 as usize].sample(Vec2::new(0.75, 0.5))[3], 0.0);
    assert!(matches!(&scene.emitters[0], Emitter::Area(area) if area.pattern.is_some()));
}

fn degenerate_triangles_are_left_out() {
    let obj = format!("{}f 1 1 2\nf 5 6 6\nv 0 0 0\nv 1 1 1\nv 2 2 2\nf 9 10 11\n", super::ROOM_OBJ);
    let loaded = room("").with("room.obj", obj).load().unwrap();
    assert_eq!(loaded.scene.mesh.triangles.len(), 4);
    assert!(loaded.warnings.iter().any(|w| w.text.contains("3 triangles without area")), "{:?}", loaded.warnings);
}

fn material_files_say_odd_things() {
    let glass = |ior: &str| {
        let mtl = format!("newmtl ground\nKd 0.5 0.5 0.5\nillum 7\nNi {ior}\nnewmtl lamp\nKe 3 2 1\n");
        room("").with("room.mtl", mtl)
    };
    assert!(matches!(surface_of(&glass("1.3"), "ground"), Surface::Dielectric { ior: 1.3, .. }));
    assert!(glass("1.3").load().unwrap().warnings.is_empty());
    for ior in ["0", "-2", "1000"] {
        assert!(matches!(surface_of(&glass(ior), "ground"), Surface::Dielectric { ior: 1.5, .. }), "{ior}");
        assert!(glass(ior).load().unwrap().warnings.iter().any(|w| w.text.contains("no index of refraction")), "{ior}");
    }
    // A map without a colour beside it is as bright as it is.
    let white = LinearImage { width: 1, height: 1, pixels: vec![[1.0; 3]] };
    let folder = room("").with("room.mtl", "newmtl ground\nmap_Kd -s 2 2 1 white.exr\nnewmtl lamp\nKe 3 2 1\n");
    write_exr(&folder.path("white.exr"), &white).unwrap();
    let Surface::Lambert { reflectance: Paint::Textured(_, factor) } = surface_of(&folder, "ground") else { panic!() };
    assert_eq!(factor, Vec3::ONE);
}

fn missing_materials_are_grey() {
    let more = "[[light]]\nkind = \"point\"\nposition = [0, 2, 0]\n";
    let folder = room(more).with("room.obj", super::ROOM_OBJ.replace("room.mtl", "none.mtl"));
    std::fs::rename(folder.path("room.mtl"), folder.path("other.mtl")).unwrap();
    let loaded = folder.load().unwrap();
    assert!(loaded.warnings.iter().any(|w| w.text.contains("none.mtl")), "{:?}", loaded.warnings);
    assert_eq!(surface_of(&folder, "ground"), Surface::Lambert { reflectance: Paint::Constant(Vec3::splat(0.5)) });
    let folder = room("").with("room.obj", super::ROOM_OBJ.replace("usemtl ground", "usemtl grund"));
    assert!(
        folder
            .load()
            .unwrap()
            .warnings
            .iter()
            .any(|w| w.text.contains("'grund' is not described (did you mean 'ground'?)"))
    );
}

fn the_camera_and_the_settings_are_as_written() {
    let text = "name = \"A room\"\ngeometry = [\"room.obj\"]\nmetres_per_unit = 0.5\n[camera]\neye = [0, 1, 4]
direction = [0, 0, -2]\nup = [1, 0, 0]\nvertical_fov_degrees = 90\nwidth = 30\nheight = 20\nfilter = \"gaussian\"
filter_radius = 3\n[render]\nsamples_per_pixel = 9\nseed = 5\nblock_side = 16\nmax_depth = 3\n";
    let loaded = room("").with("scene.toml", text).load().unwrap();
    let camera = loaded.scene.camera;
    assert_eq!((camera.width, camera.height, camera.filter), (30, 20, PixelFilter::Gaussian { deviation: 1.0 }));
    assert_eq!((camera.forward, camera.up), (Vec3::NEG_Z, Vec3::X));
    // The upper edge of a 90° view, in the middle.
    let top = camera.direction(Vec2::new(15.0, 0.0));
    assert!((top - Vec3::new(1.0, 0.0, -1.0).normalize()).length() < 1e-6, "{top}");
    assert_eq!((loaded.scene.name.as_str(), loaded.scene.metres_per_unit), ("A room", 0.5));
    let wanted = RenderSettings { samples_per_pixel: 9, seed: 5, block_side: 16, max_depth: 3 };
    assert_eq!(loaded.settings, wanted);
    assert_eq!(RenderSettings::default().block_side, MatrixShape::DEFAULT_BLOCK_SIDE);
}

fn the_content_hash_follows() {
    let hash = |folder: Folder| folder.load().unwrap().content;
    let plain = hash(room(""));
    assert_eq!(plain, hash(room("[render]\nseed = 7\nsamples_per_pixel = 3\n")));
    assert_eq!(plain, hash(room("").with("room.obj", format!("# a comment\n{}", super::ROOM_OBJ))));
    let changed = [
        room("[render]\nmax_depth = 3\n"),
        room("[[material]]\nmatch = \"ground\"\nreflectance = [0.5, 0.4, 0.2]\n"),
        room("[[light]]\ntexels = [2, 2]\n"),
        room("").with("room.obj", super::ROOM_OBJ.replace("v -5 0 -5", "v -5 0 -6")),
        room("").with("scene.toml", super::ROOM_TOML.replace("[0, 1, 4]", "[0, 1, 4.5]")),
    ];
    for (i, folder) in changed.into_iter().enumerate() {
        assert_ne!(plain, hash(folder), "change {i}");
    }
    assert_eq!(plain, hash(room("[[material]]\nmatch = \"lamp\"\nemission = [9, 9, 9]\n")), "weights are no entries");
}

fn built_in_scenes_pass_their_own_checks() {
    for name in ltm::scene::BUILT_IN_NAMES {
        let loaded = built_in_named(name).unwrap();
        assert_eq!(validate(&loaded.scene).unwrap(), Warnings::new(), "{name}");
        let columns = if name == "environment" { 512 } else { 1024 };
        assert_eq!(loaded.scene.basis.column_count(), columns);
        assert_eq!(loaded.lighting.weights().len(), columns);
    }
    let shown = built_in().scene.camera;
    assert_eq!((shown.width, shown.height), (256, 192));
}

fn a_very_large_matrix_is_warned_of() {
    let loaded = room("[[light]]\ntexels = [1024, 1024]\n").load().unwrap();
    assert!(
        loaded.warnings.iter().any(|w| w.text.contains("1048576 columns") && w.text.contains("TiB")),
        "{:?}",
        loaded.warnings
    );
}

fn the_format_document_states_the_defaults() {
    let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/formats/scene.md")).unwrap();
    let default = RenderSettings::default();
    let camera = room("").load().unwrap().scene.camera;
    let columns = LightBasis::MAX_COLUMNS.to_string();
    let grouped = format!("{},{},{}", &columns[..2], &columns[2..5], &columns[5..]);
    let stated = [
        format!("| `samples_per_pixel` | {} |", default.samples_per_pixel),
        format!("| `seed` | {} |", default.seed),
        format!("| `block_side` | {} |", default.block_side),
        format!("1 to {} |", MatrixShape::MAX_BLOCK_SIDE),
        format!("| `max_depth` | {} |", default.max_depth),
        format!("| `width`, `height` | {}, {} |", camera.width, camera.height),
        format!("| `vertical_fov_degrees` | {} |", camera.vertical_fov_radians().unwrap().to_degrees().round()),
        format!("more columns than {grouped}"),
    ];
    for line in stated {
        assert!(text.contains(&line), "formats/scene.md does not say: {line}");
    }
}

/// A texture of one blue texel.
fn blue(path: std::path::PathBuf) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    image::RgbImage::from_raw(1, 1, vec![0, 0, 255]).unwrap().save(path).unwrap();
}

fn textures_in_any_case() {
    let mtl = "newmtl lamp\nKe 1 1 1\nnewmtl ground\nKd 1 1 1\nmap_Kd TEXTURES\\Wood.PNG\nnewmtl other\nmap_Kd tile.png\n\
        newmtl plain\nmap_Kd Textures\\wood.png\n";
    let obj = format!("{}usemtl other\nf 1 2 3\nusemtl plain\nf 1 2 3\n", super::ROOM_OBJ);
    let folder = room("").with("room.mtl", mtl).with("room.obj", obj);
    blue(folder.path("Textures/wood.png"));
    blue(folder.path("Tile.png"));
    let loaded = folder.load().unwrap();
    let Surface::Lambert { reflectance } = loaded.scene.materials[0].surface else { panic!("a textured floor") };
    assert_eq!(reflectance.at(&loaded.scene.textures, Vec2::ZERO), Vec3::Z);
    let said: Vec<_> = loaded.warnings.iter().filter(|warning| warning.text.contains("upper and lower case")).collect();
    assert!(said.len() == 1 && said[0].text.contains("3 texture names"), "{:?}", loaded.warnings);
    assert!(
        said[0].text.contains("TEXTURES\\Wood.PNG, is ") && said[0].text.ends_with("Textures/wood.png"),
        "{}",
        said[0]
    );
    // The right spelling is taken where both are there, and says nothing.
    blue(folder.path("tile.png"));
    let mtl = "newmtl lamp\nKe 1 1 1\nnewmtl ground\nmap_Kd tile.png\n";
    let loaded = folder.with("room.mtl", mtl).with("room.obj", super::ROOM_OBJ).load().unwrap();
    assert!(!loaded.warnings.iter().any(|warning| warning.text.contains("case")), "{:?}", loaded.warnings);
    assert_eq!(loaded.scene.textures[0].name, "tile.png");
}

fn material_files_in_any_case() {
    let folder = room("").with("room.obj", super::ROOM_OBJ.replace("room.mtl", "ROOM.mtl"));
    let loaded = folder.load().unwrap();
    assert!(
        loaded.warnings.iter().any(|warning| warning.text.contains("\"ROOM.mtl\" is read from")),
        "{:?}",
        loaded.warnings
    );
    assert!(!loaded.warnings.iter().any(|warning| warning.text.contains("grey")), "{:?}", loaded.warnings);
}

fn missing_textures() {
    let mtl =
        "newmtl lamp\nKe 1 1 1\nmap_Ke glow.png\nnewmtl ground\nKd 0.5 0.4 0.3\nmap_Kd wood.png\nmap_d holes.png\n";
    let maps = "[[material]]\nmatch = \"ground\"\ncutout_map = \"mask.png\"\n";
    let folder = room(maps).with("room.mtl", mtl);
    let refused = folder.load().unwrap_err().to_string();
    for name in [
        "4 textures are missing",
        "mask.png",
        "glow.png",
        "wood.png",
        "holes.png",
        "'ground'",
        "'lamp'",
        "`allow_missing`",
    ] {
        assert!(refused.contains(name), "{name} is not in: {refused}");
    }
    assert!(!refused.contains('\n'));
    let options = ltm::scene::LoadOptions { allow_missing: true, ..Default::default() };
    let loaded = ltm::scene::load_with(&folder.path("scene.toml"), options).unwrap();
    let Surface::Lambert { reflectance } = loaded.scene.materials[0].surface else { panic!("a floor of one colour") };
    assert_eq!(reflectance.at(&[], Vec2::ZERO), Vec3::new(0.5, 0.4, 0.3));
    assert!(loaded.scene.materials[0].cutout.is_none() && loaded.scene.textures.is_empty());
    assert_eq!(loaded.warnings.iter().filter(|warning| warning.text.contains("4 textures are missing")).count(), 1);
}
