//! What glTF files mean.

use std::f32::consts::{FRAC_1_SQRT_2, PI};

use glam::{Vec2, Vec3};
use ltm::light::{LightKind, LightUnit};
use ltm::matrix::{MatrixShape, TracedBlock};
use ltm::scene::{Emitter, LoadOptions, LoadedScene, PointEmitter, Scene, Surface, Vertex, load, load_with};
use ltm::trace::{TraceSettings, Tracer};
use serde_json::{Value, json};

use super::glb::{F32, Glb, I16, U8, U32, room};
use super::{Folder, ROOM_OBJ};

pub(super) const TESTS: &[(&str, fn())] = &[
    ("a_glb_is_a_scene_with_its_own_camera_and_lights", a_glb_is_a_scene),
    ("the_same_room_as_obj_and_as_glb_has_the_same_matrix", the_same_room_has_the_same_matrix),
    ("a_glb_is_geometry_of_a_scene_file", a_glb_is_geometry_of_a_scene_file),
    ("nodes_carry_their_children_and_mirrors_turn_triangles", nodes_carry_their_children),
    ("every_instance_that_emits_is_a_light_by_its_nodes_name", every_instance_is_a_light),
    ("emissive_materials_of_one_name_make_lights_of_several", materials_may_share_a_name),
    ("strips_fans_and_plain_vertices_make_triangles", strips_and_fans),
    ("indices_of_every_type_and_interleaved_buffers_are_read", indices_of_every_type),
    ("sparse_accessors_replace_what_they_name", sparse_accessors),
    ("quantised_positions_are_numbers_or_fractions", quantised_positions),
    ("buffers_and_images_lie_in_the_file_in_uris_or_beside_it", buffers_lie_anywhere),
    ("textures_lie_as_the_file_says", textures_lie_as_the_file_says),
    ("masks_cut_out_at_their_own_threshold", masks_cut_out),
    ("lamps_are_watts_by_683_lumens", lamps_are_watts),
    ("luminaires_hang_as_their_nodes_do", luminaires_hang),
    ("cameras_are_chosen_by_name", cameras_are_chosen),
    ("vertex_colours_are_the_base_colour", vertex_colours),
    ("what_is_not_used_is_said", what_is_not_used_is_said),
];

pub(super) fn of(file: &Glb) -> ltm::Result<LoadedScene> {
    load(&Folder::new().with("room.glb", file.to_glb()).path("room.glb"))
}

pub(super) fn scene(file: &Glb) -> Scene {
    of(file).unwrap().scene
}

pub(super) fn near(a: impl Into<Vec3>, b: impl Into<Vec3>) {
    let (a, b) = (a.into(), b.into());
    assert!((a - b).length() < 1e-5, "{a} for {b}");
}

fn normals(scene: &Scene) -> Vec<Vec3> {
    let normal = |t| {
        let [a, b, c] = scene.mesh.corners(t);
        (b - a).cross(c - a).normalize()
    };
    scene.mesh.triangles.iter().map(normal).collect()
}

fn a_glb_is_a_scene() {
    let loaded = of(&room()).unwrap();
    let (camera, basis) = (&loaded.scene.camera, &loaded.scene.basis);
    near(camera.eye, [0.0, 1.0, 4.0]);
    near(camera.forward, Vec3::NEG_Z);
    near(camera.up, Vec3::Y);
    assert_eq!((camera.width, camera.height), (640, 480));
    assert!((camera.vertical_fov_radians().unwrap() - PI / 4.0).abs() < 1e-6);
    assert_eq!(basis.lights().len(), 1);
    let light = &basis.lights()[0];
    assert_eq!((light.name.as_str(), light.unit), ("bulb", LightUnit::Radiance));
    near(light.emission, [4.0, 2.0, 1.0]);
    assert!((light.extents[0] - 2.0).abs() < 1e-5);
    assert_eq!((loaded.scene.name.as_str(), loaded.scene.metres_per_unit), ("room", 1.0));
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
}

/// The bits of all entries of a scene's matrix.
fn entries(scene: Scene) -> Vec<u32> {
    let (width, height, columns) = (scene.camera.width, scene.camera.height, scene.basis.column_count() as u32);
    let shape = MatrixShape::new(width, height, columns, 16).unwrap();
    let tracer = Tracer::new(scene, shape, TraceSettings { samples_per_pixel: 8, seed: 5, max_depth: 6 }).unwrap();
    let block = |id| {
        let mut block = TracedBlock::default();
        tracer.trace_block(id, &mut block);
        block.block.entries().iter().map(|v| v.to_bits()).collect::<Vec<_>>()
    };
    shape.blocks().flat_map(block).collect()
}

/// Bit for bit: the same numbers reach the tracer in the same order.
fn the_same_room_has_the_same_matrix() {
    let mtl = "newmtl ground\nKd 0.5 0.4 0.3\nPr 0.5\nPm 0\nnewmtl lamp\nKd 0 0 0\nPr 0.5\nPm 0\nKe 4 2 1\n";
    let toml = "geometry = [\"room.obj\"]\n[camera]\neye = [0, 1, 4]\ndirection = [0, 0, -1]\n";
    let folder = Folder::new().with("room.obj", ROOM_OBJ).with("room.mtl", mtl).with("scene.toml", toml);
    let obj = folder.load().unwrap().sized(32, 24).scene;
    let glb = of(&room()).unwrap().sized(32, 24).scene;
    assert_eq!(obj.camera, glb.camera);
    let (obj, glb) = (entries(obj), entries(glb));
    assert!(obj.iter().filter(|bits| f32::from_bits(**bits) > 0.0).count() > 500);
    assert!(obj == glb);
}

fn a_glb_is_geometry_of_a_scene_file() {
    let toml = "geometry = [\"room.glb\"]\n[camera]\neye = [0, 1, 4]\nlook_at = [0, 1, 0]\n[[light]]\nmaterial = \"lamp\"\n\
        texels = [4, 2]\n[[material]]\nmatch = \"ground\"\nkind = \"mirror\"\n";
    let mut file = room();
    add_lamp(&mut file, json!({ "type": "point" }), json!({ "name": "spare" }));
    let folder = Folder::new().with("room.glb", file.to_glb()).with("scene.toml", toml);
    let loaded = folder.load().unwrap();
    assert_eq!(loaded.scene.basis.column_count(), 8);
    assert!(matches!(loaded.scene.materials[0].surface, Surface::Mirror { .. }));
    assert!(
        loaded.warnings.iter().any(|w| w.text.contains("1 lamps of the file are not used")),
        "{:?}",
        loaded.warnings
    );
}

fn nodes_carry_their_children() {
    let mut file = room();
    // A quarter turn about y takes the child's +x to −z.
    let turn = json!([0.0, FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2]);
    let child = file.push("nodes", json!({ "name": "child", "mesh": 1, "translation": [10.0, 0.0, 0.0] }));
    file.root(json!({ "name": "parent", "rotation": turn, "scale": [2.0, 1.0, 2.0], "children": [child] }));
    let matrix = [-1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 7.0, 0.0, 1.0];
    file.root(json!({ "name": "mirrored", "mesh": 1, "matrix": matrix }));
    let scene = scene(&file);
    let place = |name: &str| scene.basis.find(name).unwrap().places[0];
    near(place("child"), [1.0, 3.0, -20.0]);
    near(place("mirrored"), [0.0, 10.0, 0.5]);
    assert!((scene.basis.find("child").unwrap().extents[0] - 8.0).abs() < 1e-4);
    // The floor faces up; all lamps face down, whatever their transforms do.
    let faces: Vec<f32> = normals(&scene).iter().map(|n| n.y).collect();
    assert_eq!(faces.len(), 8);
    assert!(faces[..2].iter().all(|y| *y > 0.999) && faces[2..].iter().all(|y| *y < -0.999), "{faces:?}");
}

fn every_instance_is_a_light() {
    let mut file = room();
    for x in 0..3 {
        file.root(json!({ "name": "bulb", "mesh": 1, "translation": [x, 1.0, 0.0] }));
    }
    file.json["materials"][1]["doubleSided"] = json!(true);
    let scene = scene(&file);
    let names: Vec<&str> = scene.basis.lights().iter().map(|l| l.name.as_str()).collect();
    assert_eq!(names, ["bulb", "bulb 2", "bulb 3", "bulb 4"]);
    assert!(scene.emitters.iter().all(|e| matches!(e, Emitter::Area(area) if area.two_sided)));
    near(scene.basis.lights()[3].places[0], [2.0, 4.0, 0.5]);
}

fn materials_may_share_a_name() {
    let mut file = room();
    let lamp = file.json["materials"][1].clone();
    let other = file.push("materials", lamp);
    let mut second = file.json["meshes"][1]["primitives"][0].clone();
    second["material"] = json!(other);
    file.json["meshes"][1]["primitives"].as_array_mut().unwrap().push(second);
    // One that is called as a light of the other node would be.
    file.root(json!({ "name": "bulb lamp", "mesh": 1 }));
    let names: Vec<String> = scene(&file).basis.lights().iter().map(|l| l.name.clone()).collect();
    assert_eq!(names, ["bulb lamp 2", "bulb lamp 3", "bulb lamp lamp", "bulb lamp lamp 2"]);
}

/// Replaces the floor's primitive.
fn with_floor(primitive: impl FnOnce(&mut Glb) -> Value) -> Glb {
    let mut file = room();
    let mut primitive = primitive(&mut file);
    primitive["material"] = json!(0);
    file.json["meshes"][0]["primitives"] = json!([primitive]);
    file
}

const FLOOR: [[f32; 3]; 4] = [[-5.0, 0.0, -5.0], [-5.0, 0.0, 5.0], [5.0, 0.0, 5.0], [5.0, 0.0, -5.0]];

fn floor_area(scene: &Scene) -> f32 {
    let area = |t| {
        let [a, b, c] = scene.mesh.corners(t);
        // Signed: what is turned over counts against the rest.
        0.5 * (b - a).cross(c - a).y
    };
    scene.mesh.triangles.iter().filter(|t| t.material.0 == 0).map(area).sum()
}

fn strips_and_fans() {
    let [a, b, c, d] = FLOOR;
    let cases: [(u32, Vec<[f32; 3]>); 3] = [(4, vec![a, b, c, a, c, d]), (5, vec![a, b, d, c]), (6, vec![a, b, c, d])];
    for (mode, corners) in cases {
        let file = with_floor(|file| {
            let positions = file.vectors(&corners);
            json!({ "attributes": { "POSITION": positions }, "mode": mode })
        });
        assert!((floor_area(&scene(&file)) - 100.0).abs() < 1e-3, "mode {mode}");
    }
    let mut file = room();
    let positions = file.vectors(&FLOOR);
    file.json["meshes"][0]["primitives"]
        .as_array_mut()
        .unwrap()
        .push(json!({ "attributes": { "POSITION": positions }, "mode": 1 }));
    assert!(of(&file).unwrap().warnings[0].text.contains("1 meshes of points or lines"));
}

fn indices_of_every_type() {
    for (component, width) in [(U8, 1), (super::glb::U16, 2), (U32, 4)] {
        let file = with_floor(|file| {
            // Position, and a number between that belongs to nobody.
            let bytes: Vec<u8> =
                FLOOR.iter().flat_map(|[x, y, z]| [*x, *y, *z, 9.0]).flat_map(f32::to_le_bytes).collect();
            let positions = file.accessor(&bytes, F32, "VEC3", 4);
            let view = file.json["bufferViews"].as_array().unwrap().len() - 1;
            file.json["bufferViews"][view]["byteStride"] = json!(16);
            let bytes: Vec<u8> = [0u32, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()[..width].to_vec()).collect();
            let indices = file.accessor(&bytes, component, "SCALAR", 6);
            json!({ "attributes": { "POSITION": positions }, "indices": indices })
        });
        assert!((floor_area(&scene(&file)) - 100.0).abs() < 1e-3);
    }
}

/// Positions of which a sparse accessor states all, or the last alone.
fn sparse(file: &mut Glb, stated: &[u16], base: Option<usize>) -> usize {
    let places: Vec<u8> = stated.iter().flat_map(|i| i.to_le_bytes()).collect();
    let values: Vec<u8> = stated.iter().flat_map(|i| FLOOR[usize::from(*i) % 4]).flat_map(f32::to_le_bytes).collect();
    let (places, values) = (file.view(&places), file.view(&values));
    let sparse = json!({
        "count": stated.len(), "indices": { "bufferView": places, "componentType": 5123 },
        "values": { "bufferView": values },
    });
    let mut accessor = json!({ "componentType": F32, "type": "VEC3", "count": 4, "sparse": sparse });
    if let Some(base) = base {
        accessor["bufferView"] = file.json["accessors"][base]["bufferView"].clone();
    }
    file.push("accessors", accessor)
}

fn sparse_accessors() {
    for all in [true, false] {
        let file = with_floor(|file| {
            let [a, b, c, _] = FLOOR;
            let base = file.vectors(&[a, b, c, [0.0, 77.0, 0.0]]);
            let positions = if all { sparse(file, &[0, 1, 2, 3], None) } else { sparse(file, &[3], Some(base)) };
            let indices = file.indices(&[0, 1, 2, 0, 2, 3]);
            json!({ "attributes": { "POSITION": positions }, "indices": indices })
        });
        assert!((floor_area(&scene(&file)) - 100.0).abs() < 1e-3, "all {all}");
    }
}

fn quantised_positions() {
    for normalised in [true, false] {
        let mut file = with_floor(|file| {
            let unit = if normalised { 32_767 } else { 5 };
            let bytes: Vec<u8> = FLOOR
                .iter()
                .flat_map(|p| p.map(|v| (v.signum() * v.abs().min(1.0)) as i16 * unit))
                .flat_map(i16::to_le_bytes)
                .collect();
            let positions = file.accessor(&bytes, I16, "VEC3", 4);
            file.json["accessors"][positions]["normalized"] = json!(normalised);
            json!({ "attributes": { "POSITION": positions }, "mode": 6 })
        });
        file.push("extensionsRequired", json!("KHR_mesh_quantization"));
        file.uses("KHR_mesh_quantization");
        let area = if normalised { 4.0 } else { 100.0 };
        assert!((floor_area(&scene(&file)) - area).abs() < 1e-3, "normalised {normalised}");
    }
}

fn base64(bytes: &[u8]) -> String {
    let letters: Vec<char> = ('A'..='Z').chain('a'..='z').chain('0'..='9').chain(['+', '/']).collect();
    let mut text = String::new();
    for group in bytes.chunks(3) {
        let bits = (0..3).fold(0u32, |bits, i| bits << 8 | u32::from(*group.get(i).unwrap_or(&0)));
        for i in 0..4 {
            let letter = letters[(bits >> (18 - 6 * i) & 63) as usize];
            text.push(if i > group.len() { '=' } else { letter });
        }
    }
    text
}

/// A picture of two texels, one above the other, and its alphas.
pub(super) fn png(top: [u8; 4], bottom: [u8; 4]) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = image::RgbaImage::from_raw(1, 2, [top, bottom].concat()).unwrap();
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// Gives the ground a texture.
pub(super) fn textured(file: &mut Glb, image: Value) {
    let image = file.push("images", image);
    let texture = file.push("textures", json!({ "source": image }));
    file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": texture });
    let uvs = file.vectors(&[[0.0f32, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]]);
    file.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(uvs);
}

fn buffers_lie_anywhere() {
    let picture = png([255, 0, 0, 255], [0, 0, 255, 255]);
    let embedded = {
        let mut file = room();
        let view = file.view(&picture);
        textured(&mut file, json!({ "bufferView": view, "mimeType": "image/png" }));
        Folder::new().with("room.gltf", file.to_glb())
    };
    let uri = |bytes: &[u8], kind: &str| format!("data:{kind};base64,{}", base64(bytes));
    let uris = {
        let mut file = room();
        textured(&mut file, json!({ "uri": uri(&picture, "image/png") }));
        let buffer = uri(&file.bytes, "application/octet-stream");
        file.json["buffers"] = json!([{ "byteLength": file.bytes.len(), "uri": buffer }]);
        Folder::new().with("room.gltf", file.document().to_string())
    };
    let beside = {
        let mut file = room();
        textured(&mut file, json!({ "uri": "two%20texels.png" }));
        file.json["buffers"] = json!([{ "byteLength": file.bytes.len(), "uri": "room.bin" }]);
        let folder = Folder::new().with("room.gltf", file.document().to_string());
        folder.with("room.bin", &file.bytes).with("two texels.png", &picture)
    };
    let load = |folder: &Folder| load(&folder.path("room.gltf")).unwrap().scene;
    let first = load(&embedded);
    assert_eq!((first.textures.len(), first.textures[0].texels.at(0)), (1, [1.0, 0.0, 0.0, 1.0]));
    for scene in [load(&uris), load(&beside)] {
        assert_eq!(scene.mesh.vertices, first.mesh.vertices);
        assert_eq!(scene.textures[0].texels, first.textures[0].texels);
    }
}

fn textures_lie_as_the_file_says() {
    let picture = png([255, 0, 0, 255], [0, 0, 255, 255]);
    let with = |transform: Value| {
        let mut file = room();
        let view = file.view(&picture);
        textured(&mut file, json!({ "bufferView": view, "mimeType": "image/png" }));
        file.uses("KHR_texture_transform");
        if !transform.is_null() {
            let texture = &mut file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"];
            texture["extensions"] = json!({ "KHR_texture_transform": transform });
        }
        scene(&file)
    };
    let at = |scene: &Scene, corner: usize, uv: [f32; 2]| {
        let found = scene.mesh.vertices[corner].uv;
        assert!((found - Vec2::from(uv)).length() < 1e-5, "corner {corner}: {found}");
    };
    // The image's top is v = 0 in the file, and v = 1 here.
    let plain = with(Value::Null);
    at(&plain, 0, [0.0, 1.0]);
    at(&plain, 2, [1.0, 0.0]);
    let Surface::Coated { reflectance, .. } = plain.materials[0].surface else { panic!("not coated") };
    near(reflectance.at(&plain.textures, Vec2::new(0.5, 0.75)), [0.5, 0.0, 0.0]);
    near(reflectance.at(&plain.textures, Vec2::new(0.5, 0.25)), [0.0, 0.0, 0.3]);
    let moved = with(json!({ "offset": [0.25, 0.5], "scale": [2.0, 3.0] }));
    at(&moved, 0, [0.25, 0.5]);
    at(&moved, 2, [2.25, -2.5]);
    // Counter-clockwise as it is seen with v down: u turns towards −v of the file, +v here.
    let turned = with(json!({ "rotation": PI / 2.0 }));
    at(&turned, 3, [0.0, 2.0]);
    at(&turned, 1, [1.0, 1.0]);
}

fn masks_cut_out() {
    let picture = png([255, 0, 0, 200], [0, 0, 255, 100]);
    let shown = |cutoff: f32| {
        let mut file = room();
        let view = file.view(&picture);
        textured(&mut file, json!({ "bufferView": view, "mimeType": "image/png" }));
        file.json["materials"][0]["alphaMode"] = json!("MASK");
        file.json["materials"][0]["alphaCutoff"] = json!(cutoff);
        let scene = scene(&file);
        let texture = scene.materials[0].cutout.expect("it cuts out");
        [0, 1].map(|row| scene.textures[texture.0 as usize].texels.at(row)[3] >= 0.5)
    };
    assert_eq!(shown(0.3), [true, true]);
    assert_eq!(shown(0.5), [true, false]);
    assert_eq!(shown(0.9), [false, false]);
    // Without a texture the whole is there or not.
    let mut file = room();
    file.json["materials"][0]["alphaMode"] = json!("MASK");
    file.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"][3] = json!(0.4);
    // From below, where the lamp alone is in view.
    file.json["nodes"][2]["rotation"] = json!([FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2]);
    file.json["nodes"][2]["translation"] = json!([0.0, 1.0, 0.5]);
    assert_eq!(floor_area(&scene(&file)), 0.0);
}

pub(super) fn add_lamp(file: &mut Glb, light: Value, mut node: Value) {
    let lights = &mut file.json["extensions"]["KHR_lights_punctual"]["lights"];
    if lights.is_null() {
        *lights = json!([]);
    }
    let lights = lights.as_array_mut().unwrap();
    lights.push(light);
    node["extensions"] = json!({ "KHR_lights_punctual": { "light": lights.len() - 1 } });
    file.uses("KHR_lights_punctual");
    file.root(node);
}

fn lamps_are_watts() {
    let mut file = room();
    // A lamp of 100 W in Blender: 683 × 100 / 4π cd.
    let candela = 683.0 * 100.0 / (4.0 * PI);
    let point = json!({ "type": "point", "intensity": candela, "color": [1.0, 0.5, 0.0] });
    add_lamp(&mut file, point, json!({ "name": "point", "translation": [1.0, 2.0, 3.0] }));
    let cones = json!({ "innerConeAngle": 0.2, "outerConeAngle": 0.5 });
    // A quarter turn about x takes −z to −y… and +y to +z: down.
    let down = json!([-FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2]);
    let spot = json!({ "type": "spot", "intensity": 683.0, "spot": cones });
    add_lamp(&mut file, spot, json!({ "name": "spot", "rotation": down }));
    add_lamp(&mut file, json!({ "type": "directional", "intensity": 1366.0 }), json!({ "name": "sun" }));
    let loaded = of(&file).unwrap();
    let light = |name: &str| loaded.scene.basis.find(name).unwrap_or_else(|| panic!("no '{name}'"));
    near(light("point").emission, [7.957_747, 3.978_873_6, 0.0]);
    assert_eq!(light("point").unit, LightUnit::Intensity);
    near(light("spot").emission, [1.0; 3]);
    near(light("sun").emission, [2.0; 3]);
    assert_eq!(light("sun").unit, LightUnit::Irradiance);
    let points: Vec<_> = loaded
        .scene
        .emitters
        .iter()
        .filter_map(|e| if let Emitter::Point(point) = e { Some(point) } else { None })
        .collect();
    let [
        PointEmitter::Point { position },
        PointEmitter::Spot { direction, inner_radians, outer_radians, .. },
        PointEmitter::Sun { towards, angular_radius_radians },
    ] = points[..]
    else {
        panic!("{points:?}")
    };
    near(*position, [1.0, 2.0, 3.0]);
    near(*direction, Vec3::NEG_Y);
    assert!((inner_radians - 0.2).abs() < 1e-6 && (outer_radians - 0.5).abs() < 1e-6);
    near(*towards, Vec3::Z);
    assert_eq!(*angular_radius_radians, 0.0);
}

/// A luminaire of type C: 358 cd at the nadir, half of that at 45° in the plane of 0°, none elsewhere at the side.
pub(super) const IES: &str = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 5 1 2 0 0 0\n1 1 10\n0 45 90\n0 90 180 270 360\n\
    358 179 0\n358 0 0\n358 0 0\n358 0 0\n358 179 0\n";

fn luminaires_hang() {
    let mut file = room();
    // By URI and in a buffer view, as the extension has them.
    let view = file.view(IES.as_bytes());
    let profiles = json!([{ "uri": "web.ies" }, { "bufferView": view, "mimeType": "application/x-ies-lm-63" }]);
    file.json["extensions"] = json!({ "EXT_lights_ies": { "lights": profiles } });
    file.uses("EXT_lights_ies");
    let hangs = |light: u32, more: Value| {
        let mut stated = more;
        stated["light"] = json!(light);
        json!({ "EXT_lights_ies": stated })
    };
    file.root(json!({ "name": "straight", "translation": [1.0, 2.0, 3.0], "extensions": hangs(0, json!({})) }));
    // A quarter turn about x takes −z down; the scale changes nothing.
    let down = json!([-FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2]);
    let tinted = json!({ "multiplier": 3.0, "color": [1.0, 0.5, 0.0] });
    file.root(json!({ "name": "down", "rotation": down, "scale": [2.0, 5.0, 3.0], "extensions": hangs(1, tinted) }));
    let folder = Folder::new().with("web.ies", IES).with("room.glb", file.to_glb());
    let loaded = load(&folder.path("room.glb")).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let light = |name: &str| loaded.scene.basis.find(name).unwrap_or_else(|| panic!("no '{name}'"));
    assert_eq!((light("straight").kind, light("straight").unit), (LightKind::Ies, LightUnit::Intensity));
    // 358 cd at 179 lm/W.
    near(light("straight").emission, [2.0; 3]);
    near(light("down").emission, [6.0, 3.0, 0.0]);
    let luminaires: Vec<_> = loaded
        .scene
        .emitters
        .iter()
        .filter_map(|e| match e {
            Emitter::Point(PointEmitter::Ies { position, world_from_luminaire, .. }) => {
                Some((*position, *world_from_luminaire))
            }
            _ => None,
        })
        .collect();
    let [(at, straight), (_, down)] = luminaires[..] else { panic!("{luminaires:?}") };
    near(at, [1.0, 2.0, 3.0]);
    // Untransformed, the nadir is −z and the plane of 0° holds +x.
    near(straight * Vec3::NEG_Z, Vec3::NEG_Z);
    near(straight * Vec3::X, Vec3::X);
    near(down * Vec3::NEG_Z, Vec3::NEG_Y);
    near(down * Vec3::X, Vec3::X);
    assert!((down.determinant() - 1.0).abs() < 1e-5);
}

fn cameras_are_chosen() {
    let mut file = room();
    let lens = json!({ "yfov": 1.0, "znear": 0.1, "aspectRatio": 2.0 });
    let camera = file.push("cameras", json!({ "name": "wide", "type": "perspective", "perspective": lens }));
    file.root(json!({ "name": "door", "camera": camera, "translation": [0.0, 2.0, 4.5] }));
    let folder = Folder::new().with("room.glb", file.to_glb());
    let with = |name: Option<&str>| {
        let options = LoadOptions { camera: name.map(String::from), ..Default::default() };
        load_with(&folder.path("room.glb"), options)
    };
    let first = with(None).unwrap();
    near(first.scene.camera.eye, [0.0, 1.0, 4.0]);
    assert!(first.warnings[0].text.contains("camera 'eye' of 2 is used ('eye', 'door')"), "{:?}", first.warnings);
    for name in ["door", "wide"] {
        let camera = with(Some(name)).unwrap().scene.camera;
        near(camera.eye, [0.0, 2.0, 4.5]);
        assert_eq!((camera.width, camera.height, camera.vertical_fov_radians()), (960, 480, Some(1.0)));
    }
    let error = with(Some("window")).unwrap_err().to_string();
    assert!(error.contains("no camera 'window'") && error.contains("'door'"), "{error}");
    // Without any, all of the scene is in view.
    let mut file = room();
    file.json["cameras"] = json!([]);
    file.json["nodes"][2].as_object_mut().unwrap().remove("camera");
    let loaded = of(&file).unwrap();
    assert!(loaded.warnings[0].text.contains("all of it is seen"), "{:?}", loaded.warnings);
    let camera = loaded.scene.camera;
    for Vertex { position, .. } in &loaded.scene.mesh.vertices {
        let to = *position - camera.eye;
        let depth = to.dot(camera.forward);
        let half = (0.5 * camera.vertical_fov_radians().unwrap()).tan() * depth;
        assert!(depth > 0.0 && to.dot(camera.up).abs() < half && to.dot(camera.right).abs() < half * 4.0 / 3.0);
    }
}

fn vertex_colours() {
    for wide in [false, true] {
        let mut file = with_floor(|file| {
            let positions = file.vectors(&FLOOR);
            // Normalised bytes: 255 is 1. Four of each, of which the last is alpha or nobody's.
            let bytes = [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [51, 51, 51, 255u8]].concat();
            let colours = file.accessor(&bytes, U8, if wide { "VEC4" } else { "VEC3" }, 4);
            file.json["accessors"][colours]["normalized"] = json!(true);
            let view = file.json["bufferViews"].as_array().unwrap().len() - 1;
            file.json["bufferViews"][view]["byteStride"] = json!(4);
            let indices = file.indices(&[0, 1, 2, 0, 2, 3]);
            json!({ "attributes": { "POSITION": positions, "COLOR_0": colours }, "indices": indices })
        });
        // Shown a second time by another node.
        file.root(json!({ "name": "again", "mesh": 0, "translation": [0.0, -1.0, 0.0] }));
        // And as a mirror shows it: its corners have changed places.
        file.root(json!({ "name": "mirrored", "mesh": 0, "scale": [-1.0, 1.0, 1.0], "translation": [0.0, -2.0, 0.0] }));
        let loaded = of(&file).unwrap();
        let scene = loaded.scene;
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        assert_eq!(scene.textures.len(), 2);
        let floor: Vec<usize> = (0..scene.mesh.triangles.len())
            .filter(|t| scene.materials[scene.mesh.triangles[*t].material.0 as usize].name == "ground")
            .collect();
        assert_eq!(floor.len(), 6);
        let factor = Vec3::from(pbr_base(&file));
        for (index, t) in floor.into_iter().enumerate() {
            let triangle = &scene.mesh.triangles[t];
            let (Surface::Coated { reflectance, .. } | Surface::Lambert { reflectance }) =
                scene.materials[triangle.material.0 as usize].surface
            else {
                panic!("no base colour")
            };
            let uv: Vec2 = triangle.vertices.iter().map(|v| scene.mesh.vertices[*v as usize].uv / 3.0).sum();
            let mean = [Vec3::splat(1.0 / 3.0), Vec3::new(1.2, 0.2, 1.2) / 3.0][index % 2];
            assert!((reflectance.at(&scene.textures, uv) - factor * mean).length() < 1e-4, "triangle {index}");
            // The corner at (−5, −5), or (5, −5) mirrored, is the first, which is red.
            let is_red = |v: &&u32| {
                let at = scene.mesh.vertices[**v as usize].position;
                (at.x + if at.y < -1.5 { -5.0 } else { 5.0 }).abs() < 1e-5 && (at.z + 5.0).abs() < 1e-5
            };
            let red = scene.mesh.vertices[*triangle.vertices.iter().find(is_red).unwrap() as usize].uv;
            let inwards = red.lerp(uv, 0.02);
            assert!(reflectance.at(&scene.textures, inwards).x > 0.8 * factor.x, "triangle {index}");
        }
    }
}

/// The first three numbers of the base colour of the first material.
fn pbr_base(file: &Glb) -> [f32; 3] {
    let base = &file.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"];
    std::array::from_fn(|i| base[i].as_f64().map_or(1.0, |v| v as f32))
}

fn what_is_not_used_is_said() {
    let mut file = room();
    let view = file.view(&png([255, 0, 0, 255], [0, 0, 255, 255]));
    textured(&mut file, json!({ "bufferView": view, "mimeType": "image/png" }));
    file.json["materials"][0]["normalTexture"] = json!({ "index": 0 });
    file.json["materials"][0]["pbrMetallicRoughness"]["metallicRoughnessTexture"] = json!({ "index": 0 });
    let moved = json!({ "KHR_texture_transform": { "scale": [2.0, 2.0] } });
    file.json["materials"][0]["normalTexture"]["extensions"] = moved;
    file.json["materials"][0]["extensions"] = json!({ "KHR_materials_sheen": { "sheenColorTexture": { "index": 0 } } });
    file.uses("KHR_materials_iridescence");
    let warnings = of(&file).unwrap().warnings;
    for words in ["KHR_materials_iridescence", "lie differently", "textures of sheens"] {
        assert!(warnings.iter().any(|w| w.text.contains(words)), "{words}: {warnings:?}");
    }
}
