//! glTF files that are refused, each with one line that names the file and what is wrong.

use ltm::Error;
use ltm::scene::{LoadOptions, load, load_with, survey};
use serde_json::{Value, json};

use super::Folder;
use super::glb::{F32, Glb, glb, room};
use super::gltf::add_lamp;

pub(super) const TESTS: &[(&str, fn())] = &[
    ("bad_frames_of_glb_are_one_clear_line", bad_frames),
    ("bad_trees_of_gltf_are_one_clear_line", bad_trees),
    ("bad_buffers_and_accessors_of_gltf_are_one_clear_line", bad_buffers),
    ("bad_nodes_cameras_and_lamps_of_gltf_are_one_clear_line", bad_nodes),
    ("bad_materials_and_images_of_gltf_are_one_clear_line", bad_images),
    ("counts_that_no_byte_stands_for_take_no_memory", absurd_counts),
    ("gltf_geometry_and_textures_are_counted_against_the_memory", memory_is_counted),
    ("no_cut_glb_panics", no_cut_glb_panics),
    ("a_buffer_that_is_a_link_is_read_only_on_demand", links_that_lead_elsewhere),
];

/// Holds an error to its promise.
fn refused(file: impl AsRef<[u8]>, words: &[&str]) {
    let folder = Folder::new().with("room.glb", file);
    let error = match load(&folder.path("room.glb")) {
        Ok(_) => panic!("accepted, but should say {words:?}"),
        Err(error) => error,
    };
    let text = error.to_string();
    assert!(matches!(error, Error::Input { .. } | Error::Resources { .. } | Error::Io { .. }), "{error:?}");
    assert!(!text.contains('\n') && text.len() < 600, "{text}");
    for word in words.iter().chain(&["room.glb"]) {
        assert!(text.contains(word), "'{word}' is missing in: {text}");
    }
}

/// The room after a change of its JSON.
fn changed(change: impl FnOnce(&mut Glb)) -> Vec<u8> {
    let mut file = room();
    change(&mut file);
    file.to_glb()
}

fn bad_frames() {
    let whole = room().to_glb();
    refused("", &["no JSON"]);
    refused(&whole[..10], &["ends within a header"]);
    refused(&whole[..whole.len() - 1], &["truncated", &whole.len().to_string()]);
    refused([&whole[..4], &[1], &whole[5..]].concat(), &["version 1"]);
    refused([&whole[..8], &[0; 4], &whole[12..]].concat(), &["truncated"]);
    refused([&whole[..12], &[0xff; 4], &whole[16..]].concat(), &["past its end"]);
    refused([&whole[..16], b"BIN\0", &whole[20..]].concat(), &["JSON"]);
    let secret = "root:x:0:0:root:/root:/bin/sh\nusers:x:100:\n";
    let folder = Folder::new().with("room.gltf", secret);
    let error = load(&folder.path("room.gltf")).unwrap_err().to_string();
    assert!(error.contains("no JSON (line 1") && !error.contains("users"), "{error}");
    let folder = Folder::new().with("room.gltf", "{\"asset\": \"secret\"}");
    let error = load(&folder.path("room.gltf")).unwrap_err().to_string();
    assert!(error.contains("no glTF 2.0") && !error.contains("secret"), "{error}");
    refused(glb(&b"[".repeat(100_000), b""), &["room.glb"]);
}

fn bad_trees() {
    refused(changed(|f| f.json["asset"]["version"] = json!("1.0")), &["another version"]);
    for name in ["KHR_texture_basisu", "EXT_texture_avif", "KHR_techniques_webgl"] {
        let file = changed(|f| {
            f.uses(name);
            f.push("extensionsRequired", json!(name));
        });
        refused(file, &[name, "export it without"]);
    }
    refused(changed(|f| f.json["nodes"][0]["mesh"] = json!(99)), &["breaks the rules", "nodes[0].mesh"]);
    refused(changed(|f| f.json["scenes"] = json!([])), &["room.glb"]);
    let mut file = changed(|_| ());
    let (from, to) = (b"\"POSITION\":0", b"\"POSITION\":9");
    let at = file.windows(from.len()).position(|part| part == from).unwrap();
    file[at..at + to.len()].copy_from_slice(to);
    refused(file, &["breaks the rules", "accessors[9] is not there"]);
    refused(changed(|f| f.json["accessors"][0]["componentType"] = json!(1)), &["accessors[0].componentType"]);
}

fn bad_buffers() {
    let accessor = |key: &str, value: Value| changed(|f| f.json["accessors"][0][key] = value);
    refused(accessor("count", json!(5)), &["accessor 0", "5 elements of 12 bytes", "48 bytes"]);
    refused(accessor("count", json!(u64::MAX)), &["accessor 0"]);
    refused(accessor("byteOffset", json!(u64::MAX)), &["accessor 0"]);
    refused(accessor("type", json!("VEC2")), &["accessor 0", "vectors of 3"]);
    refused(changed(|f| f.json["bufferViews"][0]["byteLength"] = json!(1 << 30)), &["buffer view 0", "past the end"]);
    refused(changed(|f| f.json["bufferViews"][0]["byteOffset"] = json!(u64::MAX)), &["buffer view 0"]);
    refused(changed(|f| f.bytes[..4].copy_from_slice(&f32::NAN.to_le_bytes())), &["position 0", "not finite"]);
    // Indices follow the positions of the floor.
    refused(changed(|f| f.bytes[48] = 77), &["accessor 1", "vertex 77 of 4"]);
    refused(changed(|f| f.json["accessors"][1]["componentType"] = json!(5122)), &["accessor 1", "no indices"]);
    let buffer = |buffer: Value| changed(|f| f.json["buffers"] = json!([buffer]));
    refused(buffer(json!({ "byteLength": 100_000 })), &["buffer 0", "truncated", "100000"]);
    refused(buffer(json!({ "byteLength": 1, "uri": "none.bin" })), &["buffer 0", "none.bin", "missing"]);
    refused(buffer(json!({ "byteLength": 1, "uri": "../a.bin" })), &["buffer 0", "not in the folder"]);
    refused(buffer(json!({ "byteLength": 1, "uri": "/etc/passwd" })), &["buffer 0", "not in the folder"]);
    refused(buffer(json!({ "byteLength": 1, "uri": "data:;base64,?" })), &["buffer 0", "base 64"]);
    let normals = changed(|f| {
        let normals = f.vectors(&[[0.0f32, 1.0, 0.0]; 3]);
        f.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(normals);
    });
    refused(normals, &["4 positions and 3 normals"]);
    let sparse = |index: u8| {
        changed(|f| {
            let (places, values) = (f.view(&[index]), f.view(&[0; 12]));
            f.json["accessors"][0]["sparse"] = json!({ "count": 1, "values": { "bufferView": values },
                "indices": { "bufferView": places, "componentType": 5121 } });
        })
    };
    refused(sparse(4), &["accessor 0", "replaces element 4 of 4"]);
}

fn bad_nodes() {
    let cycle = changed(|f| {
        f.json["nodes"][0]["children"] = json!([1]);
        f.json["nodes"][1]["children"] = json!([0]);
        f.json["scenes"][0]["nodes"] = json!([0, 2]);
    });
    refused(cycle, &["node 0 is reached twice", "cycle"]);
    refused(changed(|f| f.json["nodes"][0]["children"] = json!([1])), &["node 1 is reached twice"]);
    let far = changed(|f| {
        f.json["nodes"][0]["scale"] = json!([1e38, 1.0, 1.0]);
        f.json["nodes"][0]["children"] = json!([1]);
        f.json["nodes"][1]["scale"] = json!([1e38, 1.0, 1.0]);
        f.json["scenes"][0]["nodes"] = json!([0, 2]);
    });
    refused(far, &["transform of node 1 is not finite"]);
    refused(changed(|f| f.json["nodes"][0]["rotation"] = json!([0.0, 0.0, 0.0, 0.0])), &["node 0", "not finite"]);
    refused(changed(|f| f.json["nodes"][0]["scale"] = json!([1e38, 1.0, 1.0])), &["not finite in the world"]);
    let lens = |yfov: f32| changed(|f| f.json["cameras"][0]["perspective"]["yfov"] = json!(yfov));
    // A camera whose type is not what it has: read as what it has.
    let type_of_none = changed(|f| f.json["cameras"][0]["type"] = json!("orthographic"));
    let folder = Folder::new().with("room.glb", type_of_none);
    assert!(load(&folder.path("room.glb")).is_ok());
    refused(lens(4.0), &["camera 'eye'", "field of view"]);
    refused(changed(|f| f.json["nodes"][2]["scale"] = json!([0.0, 0.0, 0.0])), &["camera 'eye'", "no direction"]);
    let dark = changed(|f| f.json["materials"][1]["emissiveFactor"] = json!([0.0, 0.0, 0.0]));
    let folder = Folder::new().with("room.glb", &dark);
    let said = survey(&folder.path("room.glb"), &LoadOptions::default()).unwrap().refused.expect("it has no light");
    assert!(said.contains("emission or add a lamp") && !said.contains("Ke"), "{said}");
    refused(dark, &["no light", "[[light]]"]);
    let luminaire = |profile: Value, stated: Value| {
        changed(|f| {
            f.json["extensions"] = json!({ "EXT_lights_ies": { "lights": [profile] } });
            f.uses("EXT_lights_ies");
            f.root(json!({ "name": "l", "extensions": { "EXT_lights_ies": stated } }));
        })
    };
    let data = json!({ "uri": "data:application/x-ies-lm-63;base64,VElMVD1OT05F" });
    let first = json!({ "light": 0 });
    refused(luminaire(data.clone(), first.clone()), &["light profile 0", "numbers"]);
    refused(luminaire(data.clone(), json!({ "light": 1 })), &["luminaire 'l'", "not there"]);
    refused(luminaire(data.clone(), json!({ "light": -1 })), &["luminaire 'l'", "no light profile"]);
    refused(luminaire(data, json!({})), &["luminaire 'l'", "no light profile"]);
    refused(luminaire(json!({}), first.clone()), &["luminaire 'l'", "without data"]);
    refused(luminaire(json!({ "bufferView": 99 }), first.clone()), &["luminaire 'l'", "without data"]);
    refused(luminaire(json!({ "uri": "none.ies" }), first.clone()), &["none.ies", "missing"]);
    refused(luminaire(json!({ "uri": "../web.ies" }), first), &["not in the folder"]);
    let good = |stated: Value| {
        changed(|f| {
            let view = f.view(super::gltf::IES.as_bytes());
            f.json["extensions"] = json!({ "EXT_lights_ies": { "lights": [{ "bufferView": view }] } });
            f.uses("EXT_lights_ies");
            f.root(json!({ "name": "l", "extensions": { "EXT_lights_ies": stated } }));
        })
    };
    refused(good(json!({ "light": 0, "multiplier": -1.0 })), &["luminaire 'l'", "negative"]);
    refused(good(json!({ "light": 0, "color": [1.0, 1.0] })), &["luminaire 'l'", "not finite"]);
    let lamp = |light: Value| changed(|f| add_lamp(f, light, json!({ "name": "l" })));
    refused(lamp(json!({ "type": "point", "intensity": -1.0 })), &["lamp 'l'", "negative"]);
    let cones = json!({ "innerConeAngle": 2.0, "outerConeAngle": 1.0 });
    refused(lamp(json!({ "type": "spot", "spot": cones })), &["\"l\"", "cones"]);
    refused(changed(|f| f.json["scenes"][0]["nodes"] = json!([2])), &["no triangles"]);
}

fn bad_images() {
    let with = |image: Value| {
        changed(|f| {
            f.push("images", image);
            f.push("textures", json!({ "source": 0 }));
            f.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
        })
    };
    refused(with(json!({ "uri": "wood.png" })), &["'ground'", "wood.png", "missing", "`allow_missing`"]);
    refused(with(json!({ "uri": "../wood.png" })), &["'ground'", "not in the folder"]);
    refused(with(json!({ "name": "empty" })), &["'ground'", "image 0 has no data"]);
    // What it is is seen from its bytes: a MIME type may be missing.
    refused(with(json!({ "bufferView": 0 })), &["image 0", "neither PNG, JPEG nor WebP"]);
    refused(with(json!({ "bufferView": 0, "mimeType": "image/png" })), &["image 0", "neither PNG, JPEG nor WebP"]);
    // A PNG that claims 65,535 × 65,535 pixels in its header.
    let huge = changed(|f| {
        let mut bytes = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\xff\xff\0\0\xff\xff\x08\x06\0\0\0".to_vec();
        bytes.extend(crc32fast::hash(&bytes[12..]).to_be_bytes());
        bytes.extend(b"\0\0\0\0IDAT\x35\xaf\x06\x1e");
        let view = f.view(&bytes);
        f.push("images", json!({ "bufferView": view, "mimeType": "image/png" }));
        f.push("textures", json!({ "source": 0 }));
        f.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
    });
    refused(huge, &["image 0", "65535"]);
    refused(changed(|f| f.json["materials"][0]["pbrMetallicRoughness"]["metallicFactor"] = json!(-1.0)), &["'ground'"]);
    refused(changed(|f| f.json["materials"][1]["emissiveFactor"] = json!([1e39, 0.0, 0.0])), &["room.glb"]);
    let ior = changed(|f| {
        f.uses("KHR_materials_ior");
        f.json["materials"][0]["extensions"] = json!({ "KHR_materials_ior": { "ior": 99.0 } });
    });
    refused(ior, &["'ground'", "ior 99"]);
}

/// An accessor without data stands for zeros, of which the file does not pay for one.
fn absurd_counts() {
    let file = changed(|f| {
        let zeros = f.push("accessors", json!({ "componentType": F32, "type": "VEC3", "count": 1u64 << 60 }));
        let (places, values) = (f.view(&[0]), f.view(&[0; 12]));
        f.json["accessors"][zeros]["sparse"] = json!({ "count": 1, "values": { "bufferView": values },
            "indices": { "bufferView": places, "componentType": 5121 } });
        f.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(zeros);
    });
    refused(file, &["no data"]);
}

fn memory_is_counted() {
    let load = |file: Vec<u8>, bytes: u64| {
        let folder = Folder::new().with("room.glb", file);
        load_with(&folder.path("room.glb"), LoadOptions { memory_bytes: Some(bytes), ..Default::default() })
    };
    assert!(load(room().to_glb(), 1 << 20).is_ok());
    // Ten thousand instances of a mesh are a file of some hundred kilobytes.
    let crowd = changed(|f| {
        let corners: Vec<[f32; 3]> = (0..300).map(|i| [i as f32, (i * i % 7) as f32, (i % 5) as f32]).collect();
        let positions = f.vectors(&corners);
        f.push("meshes", json!({ "primitives": [{ "attributes": { "POSITION": positions } }] }));
        for i in 0..10_000 {
            f.root(json!({ "mesh": 2, "translation": [i, 0, 0] }));
        }
    });
    let error = load(crowd, 64 << 20).unwrap_err();
    assert!(matches!(error, Error::Resources { .. }), "{error}");
    let large = changed(|f| f.bytes.resize(4 << 20, 0));
    assert!(matches!(load(large, 1 << 20), Err(Error::Resources { .. })));
}

fn no_cut_glb_panics() {
    let whole = room().to_glb();
    let folder = Folder::new();
    for at in 0..whole.len() {
        std::fs::write(folder.path("room.glb"), &whole[..at]).unwrap();
        assert!(load(&folder.path("room.glb")).is_err(), "{at} bytes of it were accepted");
    }
}

/// A link beside the file that leads out of its folder.
fn links_that_lead_elsewhere() {
    let mut bytes = Vec::new();
    let file = changed(|f| {
        f.json["buffers"] = json!([{ "byteLength": f.bytes.len(), "uri": "a.bin" }]);
        bytes = std::mem::take(&mut f.bytes);
    });
    let outside = Folder::new().with("a.bin", bytes);
    let folder = Folder::new().with("room.glb", file);
    std::os::unix::fs::symlink(outside.path("a.bin"), folder.path("a.bin")).unwrap();
    let error = load(&folder.path("room.glb")).unwrap_err().to_string();
    assert!(error.contains("outside") && error.contains("`allow_outside`"), "{error}");
    let options = LoadOptions { allow_outside: true, ..Default::default() };
    load_with(&folder.path("room.glb"), options).unwrap();
}
