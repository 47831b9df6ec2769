//! Files that other programs or people write: whatever their bytes are, reading them ends, without a panic and within the
//! memory that the reader was given. Shared by the fuzz targets and by `tests/fuzz.rs`, which needs no fuzzer.

use std::io::{Cursor, Write};
use std::path::Path;

use ltm::image::{ImageSize, LightSet, LinearImage, image_facts, read_rgba, write_exr, write_exr_rows, write_npy};
use ltm::light::{Light, LightBasis, LightKind};
use ltm::look;
use ltm::resources::MemoryNeed;

use crate::limit::within;

/// Memory that readers are given.
const MEMORY: u64 = 16 << 20;
/// What may be held beside it: buffers, thread stacks' bookkeeping, what was read.
const BESIDE: usize = 8 << 20;

/// A kind of input.
pub(crate) struct Target {
    pub(crate) name: &'static str,
    /// Sound files, from which changed ones are made.
    pub(crate) seeds: fn() -> Vec<Vec<u8>>,
    /// Reads an input in a folder of its own. Returns whether it was accepted.
    pub(crate) look: fn(&[u8], &Path) -> bool,
}

/// All kinds but our own files.
pub(crate) static TARGETS: [Target; 12] = [
    Target { name: "scene", seeds: || vec![SCENE.into()], look: |bytes, folder| scene(bytes, folder, "scene.toml") },
    Target { name: "obj", seeds: || vec![OBJ.into()], look: |bytes, folder| scene(bytes, folder, "room.obj") },
    Target { name: "mtl", seeds: || vec![MTL.into()], look: |bytes, folder| scene(bytes, folder, "room.mtl") },
    Target { name: "gltf", seeds: gltf_seeds, look: read_gltf },
    Target { name: "ies", seeds: || vec![IES.into()], look: |bytes, folder| scene(bytes, folder, "lamp.ies") },
    Target { name: "ldt", seeds: || vec![ldt().into()], look: |bytes, folder| scene(bytes, folder, "lamp.ldt") },
    Target { name: "look", seeds: || vec![LOOK.into()], look: read_look },
    Target { name: "exr", seeds: exr_seeds, look: |bytes, folder| image_and_lights(bytes, folder, "input.exr") },
    Target { name: "hdr", seeds: hdr_seeds, look: |bytes, folder| image_and_lights(bytes, folder, "one {light}.hdr") },
    Target { name: "pfm", seeds: pfm_seeds, look: |bytes, folder| lights(bytes, folder, "one {light}.pfm") },
    Target { name: "npy", seeds: npy_seeds, look: |bytes, folder| lights(bytes, folder, "input.npy") },
    Target { name: "npz", seeds: npz_seeds, look: |bytes, folder| lights(bytes, folder, "input.npz") },
];

/// What numbers and words in texts are changed to.
pub(crate) const WORDS: [&str; 22] = [
    "0",
    "-1",
    "1e38",
    "-1e-40",
    "nan",
    "inf",
    "4294967295",
    "2147483648",
    "18446744073709551615",
    "65536",
    "[",
    "]",
    "{",
    "}",
    "\"",
    "'",
    "\n",
    "../",
    "[[light]]",
    "texels = [65536, 65536]",
    "f 1 2 3",
    "é",
];

const SCENE: &str = r#"name = "room"
geometry = ["room.obj"]
metres_per_unit = 1.0
[camera]
eye = [0, 1, 4]
look_at = [0, 1, 0]
projection = "orthographic"
view_height = 4
shift = [0, 0.1]
pixel_aspect = 1.5
aperture_radius = 0.05
focus_distance = 3
blades = 5
width = 32
height = 24
filter = "tent"
[render]
samples_per_pixel = 4
block_side = 16
[[light]]
material = "lamp"
texels = [2, 3]
[[light]]
kind = "panel"
origin = [-1, 3, -1]
edge_u = [1, 0, 0]
edge_v = [0, 0, 1]
texels = [3, 2]
[[light]]
kind = "environment"
texels = [8, 4]
map = "map.hdr"
[[light]]
kind = "spot"
position = [0, 2, 0]
inner_degrees = 20
outer_degrees = 40
[[light]]
kind = "ies"
position = [0, 2, 1]
file = "lamp.ies"
[[light]]
kind = "ies"
name = "other"
position = [1, 2, 1]
file = "lamp.ldt"
[[light]]
kind = "sun"
towards = [0.3, 1, 0.2]
[[material]]
match = "ground"
roughness = 0.4
reflectance_map = "wood.png"
"#;
const OBJ: &str = "mtllib room.mtl\no floor\nusemtl ground\nv -5 0 -5\nv 5 0 -5\nv 5 0 5\nv -5 0 5\nvt 0 0\nvt 1 1\nvn 0 1 0\n\
f 1/1/1 4/2/1 3/1/1 2/2/1\no lamp\nusemtl lamp\nv -1 2 -1\nv 1 2 -1\nv 1 2 1\nv -1 2 1\nf -4 -3 -2 -1\n";
const MTL: &str = "newmtl ground\nKd 0.5 0.4 0.3\nKs 0.1 0.1 0.1\nNs 40\nillum 2\nmap_Kd -s 1 1 1 wood.png\nnewmtl lamp\nKe 3 2 1\n\
Ni 1.5\nd 1\nTr 0\nPr 0.3\nPm 0.1\nTf 1 1 1\n";
const IES: &str = "IESNA:LM-63-2002\n[TEST] x\nTILT=NONE\n1 1000 1.0 3 3 1 2 -.12 0 0 1.0 1.0 75\n0 45 90\n0 45 90\n100 50 25\n\
90 40 20\n80 30 10\n";
/// A EULUMDAT file of four planes.
fn ldt() -> String {
    let head = "maker 1 0 4 90 2 90 report lamp 1 lamp.ldt today 100 100 50 90 90 0 0 0 0 100 100 1.0 0 1 1 LED 2000 830 80 20";
    let angles = "0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0 90 180 270 0 90";
    format!("{head} {angles} 100 10 90 9 80 8 70 7").replace(' ', "\r\n")
}

const LOOK: &str = r##"base = "scene"
[groups]
both = ["panel", "l*"]
[[light]]
name = "both"
stops = -1.0
color = { kelvin = 2700 }
[[light]]
name = "panel"
intensity = 4.0
shape = { kind = "disc", center = [0.5, 0.5], radius = 0.2 }
[[light]]
name = "sky"
environment = { file = "map.hdr", rotation_degrees = 30, stops = 1 }
[[look]]
name = "night"
[[look.light]]
name = "*"
on = false
[[look.light]]
name = "panel"
image = { file = "wood.png" }
color = { srgb = "#ffcc88" }
[[key]]
time_secs = 0
look = "night"
[[key]]
time_secs = 2
look = "night"
"##;

/// Loads a scene of which one file is the input.
fn scene(bytes: &[u8], folder: &Path, name: &str) -> bool {
    let ldt = ldt();
    let whole: [(&str, &[u8]); 7] = [
        ("scene.toml", SCENE.as_bytes()),
        ("room.obj", OBJ.as_bytes()),
        ("room.mtl", MTL.as_bytes()),
        ("lamp.ies", IES.as_bytes()),
        ("lamp.ldt", ldt.as_bytes()),
        ("wood.png", &png()),
        ("map.hdr", &hdr_seeds()[0]),
    ];
    for (file, sound) in whole {
        let path = folder.join(file);
        if file == name {
            std::fs::write(path, bytes).expect("the folder can be written");
        } else if !path.exists() {
            std::fs::write(path, sound).expect("the folder can be written");
        }
    }
    let options = ltm::scene::LoadOptions { memory_bytes: Some(MEMORY), ..Default::default() };
    within(MEMORY as usize + BESIDE, || match ltm::scene::load_with(&folder.join("scene.toml"), options) {
        Ok(_) => true,
        Err(error) => {
            one_line(&error);
            false
        }
    })
}

/// Loads a glTF file as a scene of its own.
fn read_gltf(bytes: &[u8], folder: &Path) -> bool {
    if !folder.join("wood.png").exists() {
        std::fs::write(folder.join("wood.png"), png()).expect("the folder can be written");
    }
    let path = folder.join("room.glb");
    std::fs::write(&path, bytes).expect("the folder can be written");
    let options = ltm::scene::LoadOptions { memory_bytes: Some(MEMORY), ..Default::default() };
    within(MEMORY as usize + BESIDE, || match ltm::scene::load_with(&path, options) {
        Ok(_) => true,
        Err(error) => {
            one_line(&error);
            false
        }
    })
}

/// The JSON of a small room; its buffer follows in the GLB.
const GLTF: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,2,3,4],
"extensions":{"EXT_lights_image_based":{"light":0}}}],
"extensionsUsed":["KHR_lights_punctual","KHR_texture_transform","EXT_lights_ies","EXT_lights_image_based"],"extensions":{"KHR_lights_punctual":{"lights":[
{"type":"spot","intensity":683,"spot":{"innerConeAngle":0.2,"outerConeAngle":0.5}}]},
"EXT_lights_ies":{"lights":[{"bufferView":5,"mimeType":"application/x-ies-lm-63"}]},
"EXT_lights_image_based":{"lights":[{"name":"sky","intensity":0.5,"rotation":[0,0.6,0,0.8],"irradianceCoefficients":[[9,9,9]],
"specularImageSize":4,"specularImages":[[0,0,0,0,0,0]]}]}},
"nodes":[{"mesh":0,"children":[1],"scale":[1,1,-1]},{"name":"lamp","mesh":1,"translation":[0,2,0],"rotation":[1,0,0,0]},
{"name":"eye","camera":0,"translation":[0,1,4]},{"name":"spot","translation":[0,2,0],"extensions":{"KHR_lights_punctual":{"light":0},
"EXT_lights_ies":{"light":0,"multiplier":2,"color":[1,0.5,0]}}},
{"mesh":1,"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,3,1,0,1]}],
"cameras":[{"type":"perspective","perspective":{"yfov":0.8,"znear":0.1}}],
"materials":[{"name":"wood","alphaMode":"MASK","pbrMetallicRoughness":{"metallicFactor":0,"baseColorTexture":{"index":0,
"extensions":{"KHR_texture_transform":{"offset":[0.5,0],"rotation":0.3,"scale":[2,2]}}}}},{"emissiveFactor":[1,1,1]}],
"textures":[{"source":0}],"images":[{"bufferView":4,"mimeType":"image/png"}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1},"indices":2,"material":0}]},
{"primitives":[{"attributes":{"POSITION":3},"mode":5,"material":1}]}],
"accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","min":[-2,0,-2],"max":[2,0,2],"count":4},
{"bufferView":1,"componentType":5121,"normalized":true,"type":"VEC2","count":4},
{"bufferView":2,"componentType":5123,"type":"SCALAR","count":6},
{"bufferView":0,"componentType":5126,"type":"VEC3","min":[-2,0,-2],"max":[2,0,2],"count":4,"sparse":{"count":1,"indices":{"bufferView":3,"componentType":5121},
"values":{"bufferView":0,"byteOffset":12}}}],
"bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteStride":4,"byteLength":16},
{"buffer":0,"byteOffset":64,"byteLength":12},{"buffer":0,"byteOffset":76,"byteLength":1},
{"buffer":0,"byteOffset":80,"byteLength":PNG},{"buffer":0,"byteOffset":WEB,"byteLength":LENGTH}],"buffers":[{"byteLength":ALL}]}"#;

fn gltf_seeds() -> Vec<Vec<u8>> {
    let corners = [[-2.0f32, 0.0, -2.0], [-2.0, 0.0, 2.0], [2.0, 0.0, -2.0], [2.0, 0.0, 2.0]];
    let mut bytes: Vec<u8> = corners.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([0, 0, 9, 9, 0, 255, 9, 9, 255, 0, 9, 9, 255, 255, 9, 9]);
    bytes.extend([0u16, 1, 2, 2, 1, 3].iter().flat_map(|i| i.to_le_bytes()));
    bytes.extend([1, 0, 0, 0]);
    let png = png();
    bytes.extend(&png);
    let web = bytes.len();
    bytes.extend(IES.as_bytes());
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    let json = GLTF.replace("PNG", &png.len().to_string()).replace("ALL", &bytes.len().to_string());
    let json = json.replace("WEB", &web.to_string()).replace("LENGTH", &IES.len().to_string());
    // The same with the image beside the file.
    let beside = json.replace(r#""bufferView":4,"mimeType":"image/png""#, r#""uri":"wood.png""#);
    vec![glb(json, &bytes), glb(beside, &bytes), compressed_gltf()]
}

/// A GLB of a text and a buffer.
fn glb(json: String, bytes: &[u8]) -> Vec<u8> {
    let mut json = json.into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((28 + json.len() as u32 + bytes.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json.as_slice()), (b"BIN\0", bytes)] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    file
}

/// A square that Draco compresses, one that meshopt does, instances of both, and a WebP texture. The streams are of Google's and
/// meshoptimizer's encoders.
fn compressed_gltf() -> Vec<u8> {
    let hex = |text: &str| -> Vec<u8> {
        (0..text.len() / 2)
            .map(|i| u8::from_str_radix(&text[2 * i..2 * i + 2], 16).expect("it is hexadecimal"))
            .collect()
    };
    let parts = [
        hex(
            "445241434f02020101000000040201020000011fff0111ff011102000000ff00000102020401000101000903000102010101000903013017011003\
             001c8201ff0001000000000000ff0000000101010003030130011003002882280800000000ff3f0000000020c100000000000020c10000a0410e",
        ),
        hex(
            "a0000000010c000000ff000000000000000133000000ffff0000000000000000000000000000000000000000000020c100000000000020c1",
        ),
        hex("e1f000007687566778a9866589689801690000"),
        [[0.0f32, 0.0, 0.0], [0.0, 3.0, 0.0]].as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect(),
        hex("5249464622000000574542505650384c160000002f014000000f10f3bffff31f0e140208808226a2ff31"),
    ];
    let (mut bytes, mut views) = (Vec::new(), String::new());
    for (index, part) in parts.iter().enumerate() {
        let (offset, length) = (bytes.len(), part.len());
        let compressed = |mode: &str, count: usize, stride: usize| {
            let stated = format!(r#""byteStride":{stride},"count":{count},"mode":"{mode}""#);
            format!(
                r#""byteLength":{},"extensions":{{"EXT_meshopt_compression":{{"buffer":0,"byteOffset":{offset},"byteLength":{length},{stated}}}}}"#,
                count * stride
            )
        };
        let view = match index {
            1 => compressed("ATTRIBUTES", 4, 12),
            2 => compressed("TRIANGLES", 6, 4),
            _ => format!(r#""byteOffset":{offset},"byteLength":{length}"#),
        };
        views += &format!(r#"{}{{"buffer":0,{view}}}"#, if index > 0 { "," } else { "" });
        bytes.extend(part);
        bytes.resize(bytes.len().next_multiple_of(4), 0);
    }
    glb(COMPRESSED.replace("VIEWS", &views).replace("ALL", &bytes.len().to_string()), &bytes)
}

const COMPRESSED: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1]}],
"nodes":[{"mesh":0,"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":3}}}},
{"mesh":1,"translation":[0,1,0],"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":3}}}}],
"materials":[{"extensions":{"KHR_materials_pbrSpecularGlossiness":{"diffuseTexture":{"index":0},"specularFactor":[0.1,0.1,0.1]}}},
{"emissiveFactor":[1,1,1]}],"textures":[{"extensions":{"EXT_texture_webp":{"source":0}}}],"images":[{"bufferView":4}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0,"COLOR_0":1},"material":0,"extensions":{"KHR_draco_mesh_compression":
{"bufferView":0,"attributes":{"POSITION":1,"COLOR_0":0}}}}]},{"primitives":[{"attributes":{"POSITION":2},"indices":4,"material":1}]}],
"accessors":[{"componentType":5126,"type":"VEC3","count":4},{"componentType":5121,"normalized":true,"type":"VEC4","count":4},
{"bufferView":1,"componentType":5126,"type":"VEC3","count":4},{"bufferView":3,"componentType":5126,"type":"VEC3","count":2},
{"bufferView":2,"componentType":5125,"type":"SCALAR","count":6}],
"bufferViews":[VIEWS],"buffers":[{"byteLength":ALL}]}"#;

/// An error is one line; what it quotes may be ugly, but not long.
fn one_line(error: &ltm::Error) {
    let text = error.to_string();
    assert!(!text.contains('\n') && text.len() < 20_000, "{text}");
}

fn read_look(bytes: &[u8], folder: &Path) -> bool {
    let mut basis = LightBasis::new();
    basis.push(Light::unplaced("panel", LightKind::AreaTexels { across: 8, down: 4 })).expect("it fits");
    basis.push(Light::unplaced("sky", LightKind::LatLong { across: 8, down: 4 })).expect("it fits");
    basis.push(Light::unplaced("lamp", LightKind::Lamp)).expect("it fits");
    if !folder.join("wood.png").exists() {
        std::fs::write(folder.join("wood.png"), png()).expect("the folder can be written");
        std::fs::write(folder.join("map.hdr"), &hdr_seeds()[0]).expect("the folder can be written");
    }
    let path = folder.join("look.toml");
    std::fs::write(&path, bytes).expect("the folder can be written");
    within(MEMORY as usize, || match look::load(&path, &basis) {
        Ok(found) => {
            if let Ok(frames) = found.frames(2.0) {
                (0..frames.count().min(4)).for_each(|frame| drop(frames.lighting(frame)));
            }
            true
        }
        Err(error) => {
            one_line(&error);
            false
        }
    })
}

/// Reads a file as an image, and as images of lights.
fn image_and_lights(bytes: &[u8], folder: &Path, name: &str) -> bool {
    let path = folder.join(name.replace("{light}", "a"));
    std::fs::write(&path, bytes).expect("the folder can be written");
    let read = within(MEMORY as usize + BESIDE, || match image_facts(&path) {
        Ok(facts) if facts.needs_bytes <= MEMORY => match read_rgba(&path) {
            Ok(image) => {
                assert_eq!(image.pixels.len(), image.width as usize * image.height as usize);
                assert_eq!((image.width, image.height), (facts.width, facts.height));
                true
            }
            Err(error) => {
                one_line(&error);
                false
            }
        },
        Ok(_) => false,
        Err(error) => {
            one_line(&error);
            false
        }
    });
    lights(bytes, folder, name) || read
}

/// Reads a file as images of lights.
fn lights(bytes: &[u8], folder: &Path, name: &str) -> bool {
    std::fs::write(folder.join(name.replace("{light}", "a")), bytes).expect("the folder can be written");
    let path = folder.join(name);
    within(MEMORY as usize + BESIDE, || {
        let set = match LightSet::open(&path, None) {
            Ok(set) => set,
            Err(error) => {
                one_line(&error);
                return false;
            }
        };
        let needed = set.fixed_bytes() + set.thread_bytes() * rayon::current_num_threads() as u64;
        if needed > MEMORY {
            return false;
        }
        let (images, width, height) = (set.images(), set.width as usize, set.height as usize);
        let mut take = |row: ltm::image::LightRow<'_>| {
            assert!(row.image < images && row.channel < 3 && row.y < height && row.x + row.values.len() <= width);
            Ok(())
        };
        match set.read(&mut take) {
            Ok(()) => true,
            Err(error) => {
                one_line(&error);
                false
            }
        }
    })
}

fn image(seed: u32) -> LinearImage {
    let value = |i: u32| ((i * 7919 + seed * 104_729) % 1000) as f32 / 500.0;
    let pixels = (0..6 * 4).map(|i| [value(3 * i), value(3 * i + 1), value(3 * i + 2)]).collect();
    LinearImage { width: 6, height: 4, pixels }
}

fn png() -> Vec<u8> {
    let mut bytes = Vec::new();
    let pixels: Vec<u8> = (0..4 * 4 * 4).map(|i| (i * 13) as u8).collect();
    let image = image::RgbaImage::from_raw(4, 4, pixels).expect("16 pixels");
    image.write_to(&mut Cursor::new(&mut bytes), image::ImageFormat::Png).expect("into memory");
    bytes
}

/// What `write` leaves at a path.
fn written(write: impl FnOnce(&Path)) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("seed");
    write(&path);
    std::fs::read(path).expect("it was written")
}

const SIZE: ImageSize = ImageSize { width: 6, height: 4 };

fn fetch(image: usize, channel: usize, y: usize, row: &mut [f32]) -> ltm::Result<()> {
    row.iter_mut().enumerate().for_each(|(x, value)| *value = (image * 7 + channel + y * 3 + x) as f32 / 9.0);
    Ok(())
}

fn exr_seeds() -> Vec<Vec<u8>> {
    let layers = ["View.Combined", "View.Combined_key", "View.Combined_fill"].map(String::from);
    vec![
        written(|path| write_exr(path, &image(1)).expect("it can be written")),
        written(|path| write_exr_rows(path, false, &layers, SIZE, &mut fetch).expect("it can be written")),
        exr_with_chroma(),
    ]
}

/// Luminance and chroma of every second pixel in a part of the frame, in other primaries; as the format's text says it.
fn exr_with_chroma() -> Vec<u8> {
    let attribute = |name: &str, kind: &str, value: &[u8]| {
        [name.as_bytes(), &[0], kind.as_bytes(), &[0], &(value.len() as u32).to_le_bytes(), value].concat()
    };
    let words = |values: &[i32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let channel = |name: &str, step: i32| [name.as_bytes(), &[0], &words(&[1, 0, step, step])].concat();
    let list = [channel("BY", 2), channel("RY", 2), channel("Y", 1), vec![0]].concat();
    let acescg = [0.713f32, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767].map(f32::to_le_bytes);
    let head = [
        vec![0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0],
        attribute("channels", "chlist", &list),
        attribute("chromaticities", "chromaticities", acescg.as_flattened()),
        attribute("compression", "compression", &[0]),
        attribute("dataWindow", "box2i", &words(&[2, 2, 5, 5])),
        attribute("displayWindow", "box2i", &words(&[0, 0, 7, 5])),
        attribute("lineOrder", "lineOrder", &[0]),
        attribute("pixelAspectRatio", "float", &1.0f32.to_le_bytes()),
        attribute("screenWindowCenter", "v2f", &[0; 8]),
        attribute("screenWindowWidth", "float", &1.0f32.to_le_bytes()),
        vec![0],
    ];
    let mut file = head.concat();
    // Four lines of four luminances in 16 bits, with two of each chroma in every second.
    let lines: Vec<Vec<u8>> = (0..4i32)
        .map(|y| {
            let bytes = if y % 2 == 0 { 16 } else { 8 };
            [words(&[2 + y, bytes]), (0..bytes / 2).flat_map(|i| (0x3400 + 16 * i as u16).to_le_bytes()).collect()]
                .concat()
        })
        .collect();
    let mut at = file.len() + 8 * lines.len();
    for line in &lines {
        file.extend((at as u64).to_le_bytes());
        at += line.len();
    }
    [file, lines.concat()].concat()
}

fn hdr_seeds() -> Vec<Vec<u8>> {
    let pixels: Vec<image::Rgb<f32>> = image(2).pixels.into_iter().map(image::Rgb).collect();
    let mut wide = Vec::new();
    image::codecs::hdr::HdrEncoder::new(&mut wide).encode(&pixels.repeat(4), 24, 4).expect("into memory");
    let mut flat = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n".to_vec();
    flat.extend([128, 64, 0, 129, 128, 128, 128, 132]);
    let head =
        "#?RADIANCE\r\nEXPOSURE=2\r\nCOLORCORR= 2 1 0.5\nPRIMARIES= 0.7 0.3 0.2 0.8 0.1 0.05 0.33 0.33\n\n+X 2 +Y 3\n";
    let runs = [[128u8, 64, 0, 129], [1, 1, 1, 2], [9, 9, 9, 140], [1, 1, 1, 1], [9, 9, 9, 128]];
    let old = [head.as_bytes(), runs.as_flattened()].concat();
    let xyz = [b"FORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n".as_slice(), &[162, 150, 81, 130]].concat();
    vec![wide, flat, old, xyz]
}

fn pfm_seeds() -> Vec<Vec<u8>> {
    let mut colour = b"PF\n6 4\n-1.0\n".to_vec();
    colour.extend(image(3).pixels.iter().flatten().flat_map(|v| v.to_le_bytes()));
    let mut grey = b"Pf\n4 2\n1.0\n".to_vec();
    (0..8).for_each(|i| grey.extend((i as f32).to_be_bytes()));
    vec![colour, grey]
}

fn npy_seeds() -> Vec<Vec<u8>> {
    vec![written(|path| write_npy(path, false, 2, SIZE, &mut fetch).expect("it can be written"))]
}

fn npz_seeds() -> Vec<Vec<u8>> {
    let mut names = b"\x93NUMPY\x01\x00\x76\x00{'descr': '<U4', 'fortran_order': False, 'shape': (2,)}".to_vec();
    names.resize(10 + 0x76, b' ');
    for name in ["key ", "fill"] {
        names.extend(name.chars().flat_map(|c| (c as u32).to_le_bytes()));
    }
    let archive = |method| {
        let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
        let options = zip::write::SimpleFileOptions::default().compression_method(method);
        for (name, bytes) in [("images.npy", &npy_seeds()[0]), ("lights.npy", &names)] {
            zip.start_file(name, options).expect("into memory");
            zip.write_all(bytes).expect("into memory");
        }
        zip.finish().expect("into memory").into_inner()
    };
    vec![archive(zip::CompressionMethod::Stored), archive(zip::CompressionMethod::Deflated)]
}
