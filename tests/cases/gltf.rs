//! glTF files of many exporters. What most are changed from is a grey floor of albedo one half, 2 m under a point of 683 cd, which
//! is 1 W·sr⁻¹: from above it shows a radiance of 0.5 / π / 2² = 0.03979.

#[path = "gltf/plain.rs"]
mod plain_file;

use std::f32::consts::{FRAC_1_SQRT_2, PI};
use std::path::Path;

use glam::Vec3;
use ltm::scene::{LoadOptions, Surface, load, survey};
use serde_json::{Value, json};

use self::plain_file::{
    PLAIN, as_plain, as_plain_but_says, bytes_of, changed, data_uri, down, floor_bytes, glb, middle, narrowed, near,
    opened, plain, push, read, refused, vectors, view,
};
use super::Outcome::{Converted, Read, Refused, Warned};
use super::{Case, Collection, Outcome};

const fn case(input: &'static str, outcome: Outcome, test: fn()) -> Case {
    Case { format: "glTF", input, outcome, test }
}

pub(super) const CASES: &[Case] = &[
    case(
        "attributes that are not known (`_FEATURE_ID_0`, `_IFC_ID`), and wrong ones that are not used",
        Read,
        attributes,
    ),
    case("animations, however they are written, and `KHR_animation_pointer`", Read, animations),
    case("a mark of the byte order, zeros that fill a chunk, chunks of other kinds", Read, frames),
    case("names in Latin-1 instead of UTF-8", Read, latin_names),
    case("positions without bounds, or with wrong ones", Read, bounds),
    case("members that are `null`, and whole numbers with a fraction of zero", Read, nulls),
    case("buffers, views and accessors that are missing or broken, where nothing uses them", Read, unused_buffers),
    case("a spot without `spot`, or without its angles", Read, spots),
    case("a range that is the largest number", Read, no_range),
    case("a lamp's range", Warned, range),
    case("a lamp of another type, such as `ambient`", Warned, other_lamps),
    case("lamps and meshes under roots in millimetres, in inches, mirrored, or stretched", Read, roots),
    case("textures of roughness, metal, transmission and normals", Read, textures_of_numbers),
    case("alpha mode BLEND", Read, blended),
    case("`EXT_mesh_gpu_instancing`", Read, instances),
    case("`KHR_node_visibility`", Read, visibility),
    case("WebP textures (`EXT_texture_webp`)", Read, webp),
    case("a texture of KTX2, DDS or AVIF beside one of PNG or JPEG", Warned, fallback),
    case("a texture of KTX2, DDS or AVIF alone", Refused, other_images),
    case("an image under its exporter's own path, which lies beside the file", Warned, image_elsewhere),
    case("meshes compressed by Draco (`KHR_draco_mesh_compression`)", Read, draco),
    case("buffers compressed by meshopt (`EXT_meshopt_compression`), with their filters", Read, meshopt),
    case("compressed meshes that are damaged", Refused, damaged_compression),
    case("specular colour and glossiness (`KHR_materials_pbrSpecularGlossiness`)", Converted, glossy),
    case("normals and texture coordinates that are no numbers", Warned, no_numbers),
    case("skins and morph targets", Warned, skins),
    case("an extension that is only used", Warned, used_extension),
    case("an extension that is required", Refused, required_extension),
    case("several scenes of which none is said to be shown", Warned, many_scenes),
    case("nodes without a scene", Warned, no_scene),
    case("a camera without a field of view, an orthographic one without a size", Warned, blind_camera),
    case("glTF 1", Refused, first_version),
];

pub(super) const COLLECTIONS: &[Collection] = &[
    Collection { folder: "01-babylon-max-maya", test: babylon },
    Collection { folder: "07-gltf-exporter-quirks", test: quirks },
    Collection { folder: "08-gltf-attributes", test: every_file_is_read },
];

fn attributes() {
    as_plain(&plain());
    as_plain(&changed(|json| {
        let attributes = json!({ "POSITION": 0, "_FEATURE_ID_0": 99, "_IFC_ID": 1, "BATCHID": 0, "TANGENT": "x", "JOINTS_7": -1,
            "TEXCOORD_0": 1, "TEXCOORD_9": 77 });
        json["meshes"][0]["primitives"][0]["attributes"] = attributes;
    }));
}

fn animations() {
    as_plain(&changed(|json| {
        let channel = |target: Value| json!({ "sampler": 0, "target": target });
        let pointer =
            json!({ "path": "pointer", "extensions": { "KHR_animation_pointer": { "pointer": "/nodes/0" } } });
        json["animations"] = json!([
            { "channels": [channel(json!({ "node": 0, "path": "translation" })), channel(pointer)],
              "samplers": [{ "input": 0, "output": 99, "interpolation": 0 }] },
            { "channels": "none" },
        ]);
        push(json, "extensionsUsed", json!("KHR_animation_pointer"));
    }));
}

fn frames() {
    let same = |bytes: Vec<u8>| {
        let loaded = opened(bytes).unwrap_or_else(|error| panic!("{error}"));
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        near(middle(loaded.scene), Vec3::splat(PLAIN));
    };
    let text = plain().to_string().into_bytes();
    same([b"\xef\xbb\xbf".as_slice(), &text].concat());
    let within = changed(|json| json["buffers"] = json!([{ "byteLength": 60 }])).to_string();
    let padded = |with: u8| {
        let mut text = within.clone().into_bytes();
        text.resize(text.len().next_multiple_of(4) + 4, with);
        text
    };
    let binary = floor_bytes();
    for text in [padded(b' '), padded(0)] {
        same(glb(&[(b"JSON", &text), (b"BIN\0", &binary)]));
        same(glb(&[(b"JSON", &text), (b"BIN\0", &binary), (b"META", b"1234")]));
        same(glb(&[(b"JSON", &text), (b"META", b"1234"), (b"BIN\0", &binary)]));
        same([glb(&[(b"JSON", &text), (b"BIN\0", &binary)]), b"more".to_vec()].concat());
    }
}

fn latin_names() {
    let text = changed(|json| json["nodes"][1]["name"] = json!("Küche")).to_string();
    for bytes in [text.clone().into_bytes(), text.chars().map(|c| c as u8).collect()] {
        let loaded = opened(bytes).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(loaded.scene.basis.lights()[0].name, "Küche");
    }
}

fn bounds() {
    for bounds in [json!(null), json!([1, 2]), json!([null, null, null]), json!([7, 7, 7])] {
        as_plain(&changed(|json| {
            (json["accessors"][0]["min"], json["accessors"][0]["max"]) = (bounds.clone(), bounds)
        }));
    }
}

fn nulls() {
    as_plain(&changed(|json| {
        json["nodes"][0] = json!({ "name": null, "mesh": 0.0, "camera": null, "children": null, "matrix": null, "skin": null,
            "extensions": null, "extras": { "a": [null] } });
        json["nodes"][1]["extensions"]["KHR_lights_punctual"] = json!({ "light": 0.0, "intensity": 0.0, "spot": null });
        (json["accessors"][0]["count"], json["accessors"][0]["sparse"]) = (json!(4.0), json!(null));
        (json["bufferViews"][0]["byteStride"], json["bufferViews"][0]["target"]) = (json!(0), json!(0));
        json["materials"][0]["emissiveTexture"] = json!(null);
    }));
}

fn unused_buffers() {
    as_plain(&changed(|json| {
        push(json, "buffers", json!({ "byteLength": 7, "uri": "animations.bin" }));
        push(json, "buffers", json!({ "byteLength": 7 }));
        push(json, "bufferViews", json!({ "buffer": 9, "byteLength": "x" }));
        push(json, "accessors", json!({ "bufferView": 99, "componentType": 5124, "type": "MAT7" }));
        push(json, "images", json!({ "uri": "none.png" }));
        push(json, "textures", json!({ "source": 99, "sampler": 9 }));
    }));
}

fn spots() {
    for (spot, inner, outer) in [
        (json!(null), 0.0, PI / 4.0),
        (json!({}), 0.0, PI / 4.0),
        (json!({ "innerConeAngle": null, "outerConeAngle": 0.5 }), 0.0, 0.5),
    ] {
        let json = changed(|json| {
            json["nodes"][1]["rotation"] = down();
            json["extensions"]["KHR_lights_punctual"]["lights"] =
                json!([{ "type": "spot", "intensity": 683, "spot": spot }]);
        });
        let scene = read(&json).scene;
        let ltm::scene::Emitter::Point(ltm::scene::PointEmitter::Spot { inner_radians, outer_radians, .. }) =
            scene.emitters[0]
        else {
            panic!("{:?}", scene.emitters)
        };
        assert!((inner_radians - inner).abs() < 1e-6 && (outer_radians - outer).abs() < 1e-6);
        as_plain(&json);
    }
}

fn with_range(range: Value) -> Value {
    changed(|json| json["extensions"]["KHR_lights_punctual"]["lights"][0]["range"] = range)
}

fn no_range() {
    for range in [json!(3.402_823_47e38), json!(1e300), json!(null), json!(0)] {
        as_plain(&with_range(range));
    }
}

fn range() {
    as_plain_but_says(&with_range(json!(1.0)), "1 lamps state a range");
}

fn other_lamps() {
    let other = changed(|json| {
        push(&mut json["extensions"]["KHR_lights_punctual"], "lights", json!({ "type": "ambient", "intensity": 1 }));
        let node = json!({ "name": "all around", "extensions": { "KHR_lights_punctual": { "light": 1 } } });
        let node = push(json, "nodes", node);
        push(&mut json["scenes"][0], "nodes", json!(node));
    });
    as_plain_but_says(&other, "'all around' has the type \"ambient\"");
    // A list may have what no node uses.
    as_plain(&changed(|json| {
        push(&mut json["extensions"]["KHR_lights_punctual"], "lights", json!({ "type": "ambient", "intensity": 1 }));
    }));
}

fn roots() {
    for scale in [0.001, 0.0254, 100.0] {
        as_plain(&changed(|json| {
            let inverse = 1.0 / scale;
            json["nodes"][0]["scale"] = json!([inverse, inverse, inverse]);
            json["nodes"][1]["translation"] = json!([0.0, 2.0 * inverse, 0.0]);
            json["nodes"][2]["translation"] = json!([0.0, 10.0 * inverse, 0.0]);
            push(json, "nodes", json!({ "scale": [scale, scale, scale], "children": [0, 1, 2] }));
            json["scenes"][0]["nodes"] = json!([3]);
        }));
    }
    // A sun of 1,366 lx, 2 W·m⁻², that shines down under a stretching and mirroring root: the floor shows 0.5 × 2 / π.
    let sun = changed(|json| {
        json["extensions"]["KHR_lights_punctual"]["lights"] = json!([{ "type": "directional", "intensity": 1366 }]);
        json["nodes"][1]["rotation"] = down();
        push(json, "nodes", json!({ "scale": [1, 3, -2], "children": [1] }));
        json["scenes"][0]["nodes"] = json!([0, 3, 2]);
    });
    near(middle(read(&sun).scene), Vec3::splat(1.0 / PI));
}

/// Three instances of a lamp of 20 m × 20 m as the floor is, by hand: each at the node's transform of its own.
fn instances() {
    let json = changed(|json| {
        let translations = vectors(json, &[[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 5.0]]);
        let scales = vectors(json, &[[1.0; 3], [0.1; 3], [0.5, 1.0, 0.1]]);
        // A quarter turn about y, as fractions of 16 bits.
        let half = (32_767.0 * FRAC_1_SQRT_2) as i16;
        let rotations: Vec<u8> = [[0, 0, 0, 32_767], [0, half, 0, half], [0, 0, 0, 32_767]]
            .as_flattened()
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        let rotations = view(json, &rotations);
        let rotations =
            json!({ "bufferView": rotations, "componentType": 5122, "normalized": true, "count": 3, "type": "VEC4" });
        let rotations = push(json, "accessors", rotations);
        json["materials"][0]["emissiveFactor"] = json!([1, 1, 1]);
        json["nodes"][0]["translation"] = json!([0, 0, 1]);
        json["nodes"][0]["scale"] = json!([2, 1, 1]);
        json["nodes"][0]["extensions"] = json!({ "EXT_mesh_gpu_instancing": { "attributes":
            { "TRANSLATION": translations, "ROTATION": rotations, "SCALE": scales, "_ID": 77 } } });
        push(json, "extensionsUsed", json!("EXT_mesh_gpu_instancing"));
        push(json, "extensionsRequired", json!("EXT_mesh_gpu_instancing"));
    });
    let loaded = read(&json);
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let basis = &loaded.scene.basis;
    for (name, place, area) in
        [("floor", [0.0, 0.0, 1.0], 800.0), ("floor 2", [6.0, 0.0, 1.0], 8.0), ("floor 3", [0.0, 0.0, 6.0], 40.0)]
    {
        let light = basis.find(name).unwrap_or_else(|| panic!("no '{name}'"));
        assert!((Vec3::from(light.places[0]) - Vec3::from(place)).length() < 1e-3, "{name}: {:?}", light.places);
        assert!((light.extents[0] - area).abs() < 1e-3 * area, "{name}: {:?}", light.extents);
    }
    assert_eq!(loaded.scene.mesh.triangles.len(), 6);
    let mut other = json.clone();
    other["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["SCALE"] = json!(0);
    refused(&other, &["different numbers of instances"]);
}

fn visibility() {
    as_plain(&changed(|json| {
        json["nodes"].as_array_mut().unwrap().push(json!({ "mesh": 0, "translation": [0, 1, 0] }));
        push(json, "nodes", json!({ "children": [3], "extensions": { "KHR_node_visibility": { "visible": false } } }));
        push(&mut json["scenes"][0], "nodes", json!(4));
        push(json, "extensionsUsed", json!("KHR_node_visibility"));
    }));
}

/// Made by libwebp 1.6: 2 × 2 pixels without loss, red above and blue below; 16 × 16 of grey 188, with loss.
const WEBP: &str = "5249464622000000574542505650384c160000002f014000000f10f3bffff31f0e140208808226a2ff31";
const GREY: f32 = 0.5089;
const LOSSY_WEBP: &str = "52494646240000005745425056503820180000003001009d012a1000100000c01225a400037000fefacc8000";

/// The plain file with a texture over the floor, of which the camera sees about the place `uv`.
fn textured(texture: Value, image: Option<&[u8]>, uv: [f32; 2]) -> Value {
    changed(|json| {
        let uvs = vectors(json, &[uv; 4]);
        json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(uvs);
        if let Some(image) = image {
            let view = view(json, image);
            push(json, "images", json!({ "bufferView": view }));
        }
        push(json, "textures", texture);
        json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
    })
}

fn webp() {
    let webp = json!({ "extensions": { "EXT_texture_webp": { "source": 0 } } });
    let mut above = textured(webp.clone(), Some(&bytes_of(WEBP)), [0.5, 0.25]);
    push(&mut above, "extensionsRequired", json!("EXT_texture_webp"));
    near(middle(read(&above).scene), Vec3::new(PLAIN, 0.0, 0.0));
    near(middle(read(&textured(webp.clone(), Some(&bytes_of(WEBP)), [0.5, 0.75])).scene), Vec3::new(0.0, 0.0, PLAIN));
    // What libwebp itself makes of it is sRGB 189, 0.5089 in linear light.
    near(middle(read(&textured(webp, Some(&bytes_of(LOSSY_WEBP)), [0.5; 2])).scene), Vec3::splat(GREY * PLAIN));
    // As exporters without the extension write it, and in a file of another name.
    near(
        middle(read(&textured(json!({ "source": 0 }), Some(&bytes_of(WEBP)), [0.5, 0.25])).scene),
        Vec3::new(PLAIN, 0.0, 0.0),
    );
    let folder = tempfile::tempdir().unwrap();
    let mut json = textured(json!({ "source": 0 }), None, [0.5, 0.25]);
    json["images"] = json!([{ "uri": "wood.png" }]);
    std::fs::write(folder.path().join("wood.png"), bytes_of(WEBP)).unwrap();
    std::fs::write(folder.path().join("a.gltf"), json.to_string()).unwrap();
    near(middle(load(&folder.path().join("a.gltf")).unwrap().scene), Vec3::new(PLAIN, 0.0, 0.0));
}

/// White is a texture of 1 and of a normal that leans; the floor is what its factors say.
fn textures_of_numbers() {
    let mut json = textured(json!({ "source": 0 }), Some(&bytes_of(WEBP)), [0.5, 0.25]);
    // Red, as its colour: neither metal nor rough, and of a normal along the surface, without a scale.
    json["materials"][0]["pbrMetallicRoughness"]["metallicRoughnessTexture"] = json!({ "index": 0 });
    json["materials"][0]["pbrMetallicRoughness"]["metallicFactor"] = json!(1);
    json["materials"][0]["normalTexture"] = json!({ "index": 0, "scale": 0 });
    let loaded = read(&json);
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    near(middle(loaded.scene), Vec3::new(PLAIN, 0.0, 0.0));
}

fn blended() {
    for alpha in [0.25, 0.75] {
        let loaded = read(&changed(|json| {
            json["materials"][0]["alphaMode"] = json!("BLEND");
            json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"][3] = json!(alpha);
        }));
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        let found = middle(loaded.scene);
        // 9,216 paths, of which each meets the floor or not.
        assert!((found / PLAIN - alpha as f32).abs().max_element() < 0.02, "{alpha}: {found}");
    }
}

fn fallback() {
    let both = json!({ "source": 0, "extensions": { "KHR_texture_basisu": { "source": 7 } } });
    let mut json = textured(both, Some(&bytes_of(WEBP)), [0.5, 0.25]);
    push(&mut json, "extensionsUsed", json!("KHR_texture_basisu"));
    let loaded = read(&json);
    assert!(loaded.warnings[0].text.contains("left out: KHR_texture_basisu"), "{:?}", loaded.warnings);
    near(middle(loaded.scene), Vec3::new(PLAIN, 0.0, 0.0));
}

fn other_images() {
    for (extension, kind) in [("KHR_texture_basisu", "KTX2"), ("MSFT_texture_dds", "DDS"), ("EXT_texture_avif", "AVIF")]
    {
        let alone = textured(json!({ "extensions": { extension: { "source": 0 } } }), Some(b"x"), [0.5; 2]);
        refused(&alone, &[extension, kind, "PNG, JPEG or WebP"]);
    }
    for (bytes, kind) in [(b"\xabKTX 20\xbb\r\n\x1a\n".as_slice(), "KTX"), (b"DDS |\0\0\0\0\0\0\0", "DDS")] {
        refused(&textured(json!({ "source": 0 }), Some(bytes), [0.5; 2]), &["image 0", kind]);
    }
}

fn image_elsewhere() {
    for written in ["C:\\work\\maps\\wood.webp", "../maps/wood.webp", "file:///home/me/maps/wood.webp"] {
        let folder = tempfile::tempdir().unwrap();
        let mut json = textured(json!({ "source": 0 }), None, [0.5, 0.25]);
        json["images"] = json!([{ "uri": written }]);
        std::fs::write(folder.path().join("a.gltf"), json.to_string()).unwrap();
        assert!(load(&folder.path().join("a.gltf")).is_err(), "{written}");
        std::fs::write(folder.path().join("wood.webp"), bytes_of(WEBP)).unwrap();
        let loaded = load(&folder.path().join("a.gltf")).unwrap();
        assert!(loaded.warnings[0].text.contains("wood.webp is taken"), "{:?}", loaded.warnings);
        near(middle(loaded.scene), Vec3::new(PLAIN, 0.0, 0.0));
    }
}

/// The floor by Google's encoder (DracoPy 2.2): positions (id 1) of 14 bits and colours (id 0) of 255, 128 and 0, at levels 1 and 7.
const DRACO: [&str; 2] = [
    "445241434f02020101000000040200020000011fff011101ff000002020204010000090300010102000101000903013017011003001c8201ff00010000\
     00000000ff000000000101000303012001200300208428280100000000ff3f0000000020c100000000000020c10000a0410e",
    "445241434f02020101000000040201020000011fff0111ff011102000000ff00000102020401000101000903000102010101000903013017011003001c\
     8201ff0001000000000000ff0000000101010003030130011003002882280800000000ff3f0000000020c100000000000020c10000a0410e",
];

/// The plain file with its floor as Draco has it, and nothing else of it.
fn with_draco(stream: &[u8]) -> Value {
    changed(|json| {
        json["accessors"] = json!([{ "componentType": 5126, "count": 4, "type": "VEC3" },
            { "componentType": 5123, "count": 6, "type": "SCALAR" },
            { "componentType": 5121, "normalized": true, "count": 4, "type": "VEC4" }]);
        let view = view(json, stream);
        let primitive = &mut json["meshes"][0]["primitives"][0];
        primitive["attributes"]["COLOR_0"] = json!(2);
        let ids = json!({ "POSITION": 1, "COLOR_0": 0 });
        primitive["extensions"] = json!({ "KHR_draco_mesh_compression": { "bufferView": view, "attributes": ids } });
        push(json, "extensionsUsed", json!("KHR_draco_mesh_compression"));
        push(json, "extensionsRequired", json!("KHR_draco_mesh_compression"));
    })
}

fn draco() {
    for stream in DRACO {
        let loaded = read(&with_draco(&bytes_of(stream)));
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        assert_eq!(loaded.scene.mesh.triangles.len(), 2);
        near(middle(loaded.scene), PLAIN * Vec3::new(1.0, 128.0 / 255.0, 0.0));
    }
}

/// The floor's positions, as floats and as whole numbers for the exponential filter, and its indices, by meshoptimizer's encoders.
const MESHOPT: [&str; 3] = [
    "a0000000010c000000ff000000000000000133000000ffff0000000000000000000000000000000000000000000020c100000000000020c1",
    "a0010c000000280108000000010800000000000000000133000000282701210000000121000000000000000000000000000000000000000000000000f6ff\
     ff0000000000f6ffff00",
    "e1f000007687566778a9866589689801690000",
];

/// The plain file with its floor as meshopt has it: a stream of its positions with this filter, and that of its indices.
fn with_meshopt(name: &str, positions: &[u8], filter: &str) -> Value {
    changed(|json| {
        let compressed = |json: &mut Value, bytes: &[u8], count: usize, stride: usize, mode: &str, filter: &str| {
            let buffer = push(json, "buffers", json!({ "byteLength": bytes.len(), "uri": data_uri(bytes) }));
            let stated = json!({ "buffer": buffer, "byteLength": bytes.len(), "byteStride": stride, "count": count,
                "mode": mode, "filter": filter });
            // What stands for it where the extension is not read.
            json!({ "buffer": 0, "byteLength": count * stride, "extensions": { name: stated } })
        };
        json["buffers"] = json!([{ "byteLength": 1000, "extensions": { name: { "fallback": true } } }]);
        json["bufferViews"][0] = compressed(json, positions, 4, 12, "ATTRIBUTES", filter);
        json["bufferViews"][1] = compressed(json, &bytes_of(MESHOPT[2]), 6, 4, "TRIANGLES", "NONE");
        json["accessors"][1]["componentType"] = json!(5125);
        push(json, "extensionsUsed", json!(name));
        push(json, "extensionsRequired", json!(name));
    })
}

fn meshopt() {
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        as_plain(&with_meshopt(name, &bytes_of(MESHOPT[0]), "NONE"));
        as_plain(&with_meshopt(name, &bytes_of(MESHOPT[1]), "EXPONENTIAL"));
    }
}

fn damaged_compression() {
    let stream = bytes_of(DRACO[0]);
    refused(&with_draco(&stream[..80]), &["what Draco compresses is damaged", "without compression"]);
    refused(&with_draco(b"no stream"), &["what Draco compresses is damaged"]);
    let mut other = with_draco(&stream);
    other["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]["attributes"]["POSITION"] =
        json!(7);
    refused(&other, &["attributes.POSITION: is no attribute of what is decoded"]);
    let positions = bytes_of(MESHOPT[0]);
    let name = "EXT_meshopt_compression";
    refused(&with_meshopt(name, &positions[..20], "NONE"), &["buffer view 0", "damaged", "without compression"]);
    refused(&with_meshopt(name, &positions, "NEW"), &["buffer view 0", "does not say how it is compressed"]);
    let mut absurd = with_meshopt(name, &positions, "NONE");
    absurd["bufferViews"][0]["extensions"][name]["count"] = json!(1u64 << 40);
    refused(&absurd, &["buffer view 0", "damaged"]);
}

/// By hand, with the reflectance at normal incidence that `specularFactor` is.
fn glossy() {
    let material = |stated: Value| {
        let json = changed(|json| {
            json["materials"][0] = json!({ "extensions": { "KHR_materials_pbrSpecularGlossiness": stated } });
            push(json, "extensionsUsed", json!("KHR_materials_pbrSpecularGlossiness"));
        });
        let loaded = read(&json);
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        loaded.scene.materials[0].surface
    };
    let lacquer =
        json!({ "diffuseFactor": [0.5, 0.25, 0.125, 1], "specularFactor": [0.1, 0.1, 0.1], "glossinessFactor": 0.5 });
    match material(lacquer) {
        Surface::Coated { reflectance, specular, alpha } => {
            assert_eq!(reflectance, ltm::scene::Paint::Constant(Vec3::new(0.5, 0.25, 0.125)));
            assert!((specular - Vec3::splat(0.1)).length() < 1e-6 && (alpha - 0.25).abs() < 1e-6, "{specular} {alpha}");
        }
        other => panic!("{other:?}"),
    }
    let gold = json!({ "diffuseFactor": [0, 0, 0, 1], "specularFactor": [1.0, 0.75, 0.25], "glossinessFactor": 0.5 });
    match material(gold) {
        Surface::RoughConductor { specular, alpha } => {
            assert_eq!(specular, ltm::scene::Paint::Constant(Vec3::new(1.0, 0.75, 0.25)));
            assert!((alpha - 0.25).abs() < 1e-6);
        }
        other => panic!("{other:?}"),
    }
    match material(json!({ "diffuseFactor": [0.5, 0.5, 0.5, 1], "specularFactor": [0, 0, 0] })) {
        Surface::Lambert { reflectance } => assert_eq!(reflectance, ltm::scene::Paint::Constant(Vec3::splat(0.5))),
        other => panic!("{other:?}"),
    }
}

fn no_numbers() {
    let normals = changed(|json| {
        let normals = vectors(json, &[[f32::NAN, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, f32::INFINITY, 0.0], [0.0; 3]]);
        json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(normals);
    });
    as_plain_but_says(&normals, "2 normals or texture coordinates that are no numbers");
    let mut uvs = textured(json!({ "source": 0 }), Some(&bytes_of(LOSSY_WEBP)), [f32::NAN; 2]);
    uvs["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = json!([0.5 / GREY, 0.5 / GREY, 0.5 / GREY, 1]);
    as_plain_but_says(&uvs, "4 normals or texture coordinates that are no numbers");
}

fn skins() {
    let skinned = changed(|json| {
        json["nodes"][0]["skin"] = json!(0);
        json["skins"] = json!([{ "joints": [77] }]);
    });
    as_plain_but_says(&skinned, "1 skinned meshes");
    let morphed = changed(|json| json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": 99 }]));
    as_plain_but_says(&morphed, "1 meshes are shown without their morph targets");
}

fn used_extension() {
    let used = changed(|json| {
        push(json, "extensionsUsed", json!("KHR_materials_iridescence"));
    });
    as_plain_but_says(&used, "left out: KHR_materials_iridescence");
    // What changes no picture is not worth a line.
    as_plain(&changed(|json| {
        for name in ["EXT_mesh_features", "EXT_structural_metadata", "KHR_materials_variants", "KHR_xmp_json_ld"] {
            push(json, "extensionsUsed", json!(name));
        }
    }));
}

fn required_extension() {
    for name in ["EXT_new_geometry", "KHR_techniques_webgl"] {
        refused(&changed(|json| _ = push(json, "extensionsRequired", json!(name))), &["requires", name]);
    }
}

fn many_scenes() {
    let many = changed(|json| {
        push(json, "scenes", json!({ "nodes": [] }));
        json["scene"] = json!(null);
    });
    as_plain_but_says(&many, "which of its 2 scenes");
    as_plain(&changed(|json| _ = push(json, "scenes", json!({ "nodes": [] }))));
}

fn no_scene() {
    let none = changed(|json| {
        json.as_object_mut().unwrap().remove("scene");
        json.as_object_mut().unwrap().remove("scenes");
    });
    as_plain_but_says(&none, "has no scene");
}

fn blind_camera() {
    let blind = changed(|json| {
        let camera = push(json, "cameras", json!({ "type": "perspective" }));
        let node = push(json, "nodes", json!({ "name": "blind", "camera": camera }));
        push(&mut json["scenes"][0], "nodes", json!(node));
    });
    as_plain_but_says(&blind, "the camera 'blind' states no field of view");
}

fn first_version() {
    refused(&changed(|json| json["asset"]["version"] = json!("1.0")), &["another version than 2"]);
    refused(&json!({ "meshes": { "a": {} }, "nodes": {} }), &["another version than 2"]);
}

/// Emissions of a file's lights, in the order of the nodes.
fn emissions(path: &Path) -> Vec<f32> {
    let found = survey(path, &LoadOptions::default()).unwrap_or_else(|error| panic!("{error}"));
    found.scene.basis.lights().iter().map(|light| light.emission[0]).collect()
}

/// Four spots of 100,000 cd and a sun of 0.25 lx, by 683 lm/W.
fn babylon(folder: &Path) {
    let spot = 100_000.0 / 683.0;
    let wanted = [spot, spot, spot, spot, 0.25 / 683.0];
    for name in ["AnimatedSpotlights.gltf", "AnimatedSpotlights_mended.gltf"] {
        let found = emissions(&folder.join("max-AnimatedSpotlights").join(name));
        assert_eq!(found.len(), wanted.len(), "{found:?}");
        assert!(found.iter().zip(wanted).all(|(f, w)| (f - w).abs() < 1e-5 * w), "{found:?}");
    }
}

fn quirks(folder: &Path) {
    for (name, wanted) in [
        ("sun_nonuniform.gltf", Vec3::splat(1.0 / PI)),
        ("emissive_inches.gltf", Vec3::new(4.0, 2.0, 1.0)),
        // By the inverse square and the cosine: a second lamp 3 m aside, and one of 1 cd 1 m aside.
        ("shared_light.gltf", Vec3::splat(PLAIN * (1.0 + 8.0 / 13f32.powf(1.5)))),
        ("zero_and_default.gltf", Vec3::splat(PLAIN * (1.0 + 8.0 / 5f32.powf(1.5) / 683.0))),
    ] {
        let loaded = load(&folder.join(name)).unwrap();
        let found = middle(narrowed(loaded.scene));
        assert!((found - wanted).length() < 3e-3 * wanted.length(), "{name}: {found} for {wanted}");
    }
    let others =
        ["ambient_type", "animation_int", "animation_pointer", "bom", "custom_attribute", "matrix_camera", "mm_root"];
    let more = ["nominmax", "percent", "plain", "space", "spot_defaults", "spot_empty", "spot_null"];
    let binary = ["extrachunk.glb", "plain.glb", "zeropad.glb"].map(String::from);
    for name in others.iter().chain(&more).map(|name| format!("{name}.gltf")).chain(binary) {
        let loaded = load(&folder.join(&name)).unwrap_or_else(|error| panic!("{error}"));
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        let found = middle(narrowed(loaded.scene));
        assert!((found - Vec3::splat(PLAIN)).length() < 1e-3 * PLAIN, "{name}: {found}");
    }
}

fn every_file_is_read(folder: &Path) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "gltf" || e == "glb") {
            let found = survey(&path, &LoadOptions::default()).unwrap_or_else(|error| panic!("{error}"));
            assert!(!found.scene.mesh.triangles.is_empty(), "{}", path.display());
        }
    }
}
