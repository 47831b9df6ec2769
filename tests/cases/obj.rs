//! OBJ of many exporters.

use std::path::Path;

use super::Outcome::{Converted, Read, Refused, Warned};
use super::room::{FACES, Folder, MATERIALS, VERTICES, area_of, files, floor, seen};
use super::{Case, Collection};

pub(super) const CASES: &[Case] = &[
    Case { format: "OBJ", input: "lines that end with CR, LF or both", outcome: Read, test: ends_of_lines },
    Case { format: "OBJ", input: "a byte order mark of UTF-8", outcome: Read, test: byte_order_mark },
    Case { format: "OBJ", input: "UTF-16", outcome: Refused, test: utf_16 },
    Case { format: "OBJ", input: "names in Latin-1", outcome: Read, test: latin_1 },
    Case { format: "OBJ", input: "`#` within names", outcome: Read, test: number_signs },
    Case {
        format: "OBJ",
        input: "lines continued by `\\`, negative indices, `f 1// 2//`",
        outcome: Read,
        test: spellings,
    },
    Case { format: "OBJ", input: "concave polygons", outcome: Read, test: concave },
    Case { format: "OBJ", input: "polygons closed by their first corner", outcome: Read, test: closed },
    Case { format: "OBJ", input: "polygons that cross themselves", outcome: Warned, test: crossing },
    Case { format: "OBJ", input: "faces of one or two corners", outcome: Warned, test: short_faces },
    Case { format: "OBJ", input: "vertex 0, or one that is not there", outcome: Warned, test: no_such_vertex },
    Case {
        format: "OBJ",
        input: "texture coordinate or normal 0, or one that is not there",
        outcome: Warned,
        test: no_such_normal,
    },
    Case { format: "OBJ", input: "vertices that are no numbers", outcome: Warned, test: vertices_of_nan },
    Case { format: "OBJ", input: "normals that are no numbers", outcome: Warned, test: normals_of_nan },
    Case { format: "OBJ", input: "decimal commas", outcome: Converted, test: commas },
    Case {
        format: "OBJ",
        input: "points, lines, curves and free-form surfaces beside faces",
        outcome: Warned,
        test: lines,
    },
    Case { format: "OBJ", input: "no faces", outcome: Refused, test: no_faces },
    Case { format: "OBJ", input: "vertex colours", outcome: Warned, test: vertex_colours },
    Case {
        format: "OBJ",
        input: "faces without normals in a smoothing group (`s`)",
        outcome: Read,
        test: smoothing_groups,
    },
    Case { format: "OBJ", input: "`mtllib` of several files", outcome: Read, test: several_libraries },
    Case {
        format: "OBJ",
        input: "`mtllib` of names with blanks, bare, escaped or in quotation marks",
        outcome: Read,
        test: blanks,
    },
    Case { format: "OBJ", input: "`mtllib` of a folder that is not there", outcome: Converted, test: moved_library },
    Case { format: "OBJ", input: "a material file that is missing", outcome: Warned, test: missing_library },
];

pub(super) const COLLECTIONS: &[Collection] = &[
    Collection { folder: "30-obj-tinyobj", test: files_of_tinyobjloader },
    Collection { folder: "31-obj-quirks", test: quirks },
];

fn obj() -> String {
    format!("mtllib room.mtl\n{VERTICES}{FACES}")
}

fn ends_of_lines() {
    for end in ["\r", "\n", "\r\n"] {
        Folder::of_obj(obj().replace('\n', end)).with("room.mtl", MATERIALS.replace('\n', end)).shows(1.0, &[]);
    }
}

fn byte_order_mark() {
    let marked = |text: &str| format!("\u{FEFF}{text}");
    Folder::of_obj(marked(&obj())).with("room.mtl", marked(MATERIALS)).shows(1.0, &[]);
}

fn utf_16() {
    for mark in [[0xFF, 0xFE], [0xFE, 0xFF]] {
        let little = mark[0] == 0xFF;
        let units = |text: &str| -> Vec<u8> {
            let bytes = |unit: u16| if little { unit.to_le_bytes() } else { unit.to_be_bytes() };
            mark.into_iter().chain(text.encode_utf16().flat_map(bytes)).collect()
        };
        Folder::of_obj(units(&obj())).refused(&["room.obj, line 1", "UTF-16", "UTF-8"]);
        Folder::of_mtl(units(MATERIALS)).refused(&["room.mtl, line 1", "UTF-16", "UTF-8"]);
    }
}

fn latin_1() {
    // A floor "dünn" and a lamp "dänn", which differ in the one letter that is no UTF-8.
    let written = |text: String| -> Vec<u8> { text.chars().map(|c| c as u8).collect() };
    let named = |text: &str| written(text.replace("grey", "dünn").replace("panel", "dänn"));
    Folder::of_obj(named(&obj())).with("room.mtl", named(MATERIALS)).shows(1.0, &[]);
}

fn number_signs() {
    for (grey, panel) in [("Material #26", "Material #25"), ("Material #25", "Material #26"), ("#1", "#2")] {
        let named = |text: &str| text.replace("grey", grey).replace("panel", panel);
        Folder::of_obj(named(&obj())).with("room.mtl", named(MATERIALS)).shows(1.0, &[]);
    }
    // What follows a name is no part of it where no material has it.
    Folder::of_obj(obj().replace("usemtl grey", "usemtl grey # of the floor")).shows(1.0, &[]);
}

fn spellings() {
    let faces = [
        "usemtl grey\nf -8 -5 \\\n  -6 \\\n -7\nusemtl panel\nf -4 -3 -2 \\\r\n -1",
        "usemtl grey\nf 1// 4// 3// 2//\nusemtl panel\nf 5/ 6/ 7/ 8/\n",
        "usemtl  \tgrey \nf 1 4 3 2 # up\nusemtl panel\t\nf 5\t6 7  8 \n",
    ];
    for faces in faces {
        Folder::of_obj(format!("mtllib room.mtl\n{VERTICES}{faces}")).shows(1.0, &[]);
    }
}

/// A U: of 3 by 3 with a bay of 1 by 2, at the height of the lamp.
const U: [[f32; 2]; 8] =
    [[-1.5, -1.5], [1.5, -1.5], [1.5, 1.5], [0.5, 1.5], [0.5, -0.5], [-0.5, -0.5], [-0.5, 1.5], [-1.5, 1.5]];

fn concave() {
    for first in 0..8 {
        let corners: String = (0..8).map(|i| U[(i + first) % 8]).map(|[x, z]| format!("v {x} 3 {z}\n")).collect();
        let text = format!(
            "mtllib room.mtl\n{VERTICES}usemtl grey\nf 1 4 3 2\n{corners}usemtl panel\nf 9 10 11 12 13 14 15 16\n"
        );
        let loaded = Folder::of_obj(text).loads(&[]);
        assert!((area_of(&loaded.scene, "panel") - 7.0).abs() < 1e-5);
        // By the configuration factors of rectangles: 3 by 3 without a bay of 1 by 2.
        let found = seen(loaded.scene)[0];
        assert!((found / 0.8868 - 1.0).abs() < 0.02, "{found}");
    }
}

fn closed() {
    let text = obj().replace("f 1 4 3 2", "f 1 4 4 3 2 1").replace("f 5 6 7 8", "f 5 6 7 8 5");
    let loaded = Folder::of_obj(text).loads(&[]);
    assert_eq!(loaded.scene.mesh.triangles.len(), 4);
}

fn crossing() {
    let bow = format!("{}usemtl grey\nf 1 3 4 2\n", obj());
    Folder::of_obj(bow).loads(&["room.obj: 1 polygons cross themselves"]);
}

fn short_faces() {
    let text = format!("{}f 1\nf 1 2\nf\n", obj());
    Folder::of_obj(text).shows(1.0, &["room.obj: 3 faces of fewer than three corners", "line 14"]);
}

fn no_such_vertex() {
    for face in ["f 0 1 2", "f 1 2 9", "f 1 2 -9", "f 1 2 4294967297", "f 1 2 x", "f 1 /2 3"] {
        Folder::of_obj(format!("{}{face}\n", obj())).shows(1.0, &["1 faces were left out", "line 14"]);
    }
}

fn no_such_normal() {
    let face = |face: &str| obj().replace("f 1 4 3 2", face);
    Folder::of_obj(face("f 1/0 4/0 3/0 2/0")).shows(1.0, &["4 texture coordinates", "line 11"]);
    Folder::of_obj(face("f 1//0 4//0 3//0 2//0")).shows(1.0, &["4 normals", "line 11"]);
    Folder::of_obj(face("f 1//7 4//7 3//7 2//7")).shows(1.0, &["4 normals"]);
    Folder::of_obj(face("f 1/7 4/7 3/7 2/7")).shows(1.0, &["4 texture coordinates"]);
}

fn vertices_of_nan() {
    for vertex in ["v nan 0 0", "v 1.#IND -1.#IND 0", "v inf 0 0", "v 0 0", "v 1e99 0 0", "v one 0 0"] {
        let text = obj().replace("usemtl grey\n", &format!("{vertex}\nusemtl grey\nf 1 2 9\n"));
        Folder::of_obj(text).shows(1.0, &["1 vertices are not three finite numbers", "line 10"]);
    }
}

fn normals_of_nan() {
    for normal in ["vn nan nan nan", "vn -1.#IND -1.#IND -1.#IND", "vn 0 1"] {
        let text = obj().replace("usemtl grey\nf 1 4 3 2", &format!("{normal}\nusemtl grey\nf 1//1 4//1 3//1 2//1"));
        Folder::of_obj(text).shows(1.0, &["1 normals are not three finite numbers", "line 10"]);
    }
}

fn commas() {
    let text = obj().replace("v -5 0 -5", "v -5,0 0,0 -5,0");
    Folder::of_obj(text).shows(1.0, &["3 numbers with a decimal comma", "line 2"]);
}

fn lines() {
    Folder::of_obj(format!("{}p 1\nl 1 2\n", obj())).shows(1.0, &["2 points and lines were left out", "line 14"]);
    Folder::of_obj(format!("{}curv 0 1 1 2\nsurf 0 1 0 1 1 2\nend\n", obj())).shows(1.0, &["free-form", "polygons"]);
}

fn no_faces() {
    Folder::of_obj(VERTICES).refused(&["room.obj", "no faces", "f lines"]);
    Folder::of_obj(format!("{VERTICES}p 1 2 3\n")).refused(&["room.obj", "points and lines"]);
    Folder::of_obj(format!("{VERTICES}surf 0 1 0 1 1 2\n")).refused(&["room.obj", "free-form"]);
    Folder::of_obj(format!("{VERTICES}f 1 2\n")).refused(&["room.obj", "three corners"]);
    Folder::of_obj("").refused(&["room.obj", "no faces"]);
}

fn vertex_colours() {
    let coloured = VERTICES.lines().map(|line| format!("{line} 0.2 0.4 0.6\n")).collect::<String>();
    Folder::of_obj(format!("mtllib room.mtl\n{coloured}{FACES}")).shows(1.0, &["8 vertices have colours", "line 2"]);
}

fn smoothing_groups() {
    // A roof over the floor, whose ridge is at y = 2, where both its faces meet.
    let roof = "v -1 1.5 0\nv 1 1.5 0\nv 1 2 1\nv -1 2 1\nv -1 1.5 2\nv 1 1.5 2\ns 1\nusemtl grey\nf -6 -3 -4 -5\nf -3 -2 -1 -4\n";
    let loaded = Folder::of_obj(format!("mtllib room.mtl\n{VERTICES}{FACES}{roof}")).loads(&[]);
    let at = |height: f32| loaded.scene.mesh.vertices.iter().filter(move |vertex| vertex.position.y == height);
    assert!(at(2.0).count() > 0 && at(2.0).all(|vertex| (vertex.normal.y - 1.0).abs() < 1e-6));
    // The floor is of no group.
    assert!(at(0.0).all(|vertex| vertex.normal == glam::Vec3::ZERO));
}

fn several_libraries() {
    let (grey, panel) = MATERIALS.split_once("\n\n").expect("two materials");
    let parted = |names: &str| {
        let text = obj().replace("room.mtl", names);
        Folder::of_obj(text).with("one.mtl", grey).with("two two.mtl", panel).with("two.mtl", panel)
    };
    for names in [
        "one.mtl two.mtl",
        "one.mtl two two.mtl",
        "one.mtl \"two two.mtl\"",
        "one.mtl\nmtllib two.mtl",
        "one.mtl  two\\ two.mtl",
    ] {
        parted(names).shows(1.0, &[]);
    }
    parted("one.mtl none.mtl two.mtl").shows(1.0, &["of several material files these are missing: \"none.mtl\""]);
}

fn blanks() {
    for name in ["my room.mtl", "\"my room.mtl\"", "my\\ room.mtl", "\"plain.mtl\""] {
        let text = obj().replace("room.mtl", name);
        Folder::of_obj(text)
            .with("room.mtl", "")
            .with("my room.mtl", MATERIALS)
            .with("plain.mtl", MATERIALS)
            .shows(1.0, &[]);
    }
}

fn moved_library() {
    for name in ["C:\\Users\\x\\room.mtl", "/home/x/room.mtl", ".\\room.mtl", "ROOM.MTL", "materials/room.mtl"] {
        Folder::of_obj(obj().replace("room.mtl", name)).shows(1.0, &["is read from", "room.mtl"]);
    }
    // That of the OBJ file's own name, where a file was renamed.
    Folder::of_obj(obj().replace("room.mtl", "untitled.mtl"))
        .shows(1.0, &["\"untitled.mtl\" is missing", "room.mtl is read"]);
}

fn missing_library() {
    let lamp = "[[light]]\nkind = \"point\"\nname = \"lamp\"\nposition = [0, 2, 0]\n";
    let text = obj().replace("room.mtl", "none.mtl").replace("usemtl panel\nf 5 6 7 8\n", "");
    let folder = Folder::new().with("room.obj", text);
    // Grey: 0.5 / π / 4 at 2 m under an intensity of 1.
    let found = seen(folder.scene(lamp).loads(&["\"none.mtl\" is missing", "grey"]).scene)[0];
    assert!((found / (0.125 / std::f64::consts::PI) - 1.0).abs() < 0.02, "{found}");
    let dark = Folder::new().with("room.obj", obj().replace("room.mtl", "none.mtl")).scene("");
    dark.refused(&["no light", "\"none.mtl\" is missing"]);
}

/// A scene file beside other files, with all of them in view and a lamp.
pub(super) fn seen_by_all(name: &str) -> String {
    format!(
        "geometry = [\"{name}\"]\n[camera]\neye = [0.1, 0.2, 5]\nlook_at = [0, 0, 0]\n[[light]]\nkind = \"environment\"\ntexels = [2, 1]\n"
    )
}

/// Triangles and their area; none of a file that is refused.
type Made = Option<(usize, f32)>;

/// What the notes of these files say of them: what they make, and a part of the line, if there is one.
fn files_of_tinyobjloader(folder: &Path) {
    let right: [(&str, Made, &str); 7] = [
        ("colorspace-issue-184.obj", None, "diffuse.jpg"),
        ("invalid-face-definition.obj", None, "no faces of three corners"),
        // The first face has vertex 0; of the square's other half is left.
        ("issue-140-zero-face-idx.obj", Some((1, 0.5)), "1 faces were left out"),
        // Fourteen unit squares: the surface of a bar of 1 by 1 by 3 without its foot.
        ("issue-295-trianguation-failure.obj", Some((28, 14.0)), ""),
        ("mtl filename with whitespace issue46.obj", Some((12, 24.0)), "these are missing"),
        ("mtllib-multiple-files-issue-112.obj", None, "tmp.png"),
        // Embree's Cornell box without four vertices that are no numbers and the face at them; the area is Newell's of the rest.
        ("test-nan.obj", Some((34, 1_681_371.6)), "4 vertices are not three finite numbers"),
    ];
    let found = files(folder, "obj");
    assert_eq!(found.len(), right.len());
    for path in found {
        let name = path.file_name().and_then(|name| name.to_str()).expect("a name");
        let &(_, triangles, part) = right.iter().find(|(known, ..)| *known == name).expect("a known file");
        let made = Folder::copy_of(folder).with("scene.toml", seen_by_all(name));
        let loaded = made.load();
        match (loaded, triangles) {
            (Ok(loaded), Some((count, area))) => {
                let mesh = &loaded.scene.mesh;
                assert_eq!(mesh.triangles.len(), count, "{name}: {:?}", loaded.warnings);
                let whole: f32 = mesh
                    .triangles
                    .iter()
                    .map(|t| mesh.corners(t))
                    .map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length())
                    .sum();
                assert!((whole / area - 1.0).abs() < 1e-5, "{name}: {whole}");
                assert!(
                    part.is_empty() || loaded.warnings.iter().any(|line| line.text.contains(part)),
                    "{name}: {:?}",
                    loaded.warnings
                );
            }
            (Err(error), None) => assert!(error.to_string().contains(part), "{name}: {error}"),
            (loaded, _) => panic!("{name}: {:?}", loaded.map(|loaded| loaded.warnings)),
        }
    }
}

/// The floor of every file as its note says; the two in survey coordinates have another light, and stand in the collection of such.
fn quirks(folder: &Path) {
    let scenes = files(folder, "toml");
    assert!(scenes.len() > 30);
    let copy = Folder::copy_of(folder);
    for path in scenes {
        let name = path.file_stem().and_then(|name| name.to_str()).expect("a name");
        let text = std::fs::read_to_string(&path).expect("a scene file");
        // The cameras of the files look at more than the middle.
        let text = text.replace("vertical_fov_degrees=20", "vertical_fov_degrees=2").replace("=64", "=4");
        let path = copy.path(&format!("{name}.toml"));
        std::fs::write(&path, text).expect("a scene file");
        if name.starts_with("survey") {
            continue;
        }
        let loaded = match ltm::scene::load(&path) {
            Ok(loaded) => loaded,
            Err(error) => {
                let line = error.to_string();
                assert!(
                    name == "missing_mtl" && line.contains("nowhere.mtl") && !line.contains('\n'),
                    "{name}: {line}"
                );
                continue;
            }
        };
        // 0.6166 or 0.8868; 0.62 where a texture of 188 in sRGB stands for 0.5.
        let right = if name.starts_with("concave") { 0.8868 } else { floor() };
        let found = seen(loaded.scene)[0];
        assert!((found / right - 1.0).abs() < 0.02, "{name}: {found}, {right}");
    }
}
