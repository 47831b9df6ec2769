//! What is refused, each with one line that says where and what.

use ltm::Error;

use super::{Folder, ROOM_MTL, ROOM_OBJ, ROOM_TOML, room};

pub(super) const TESTS: &[(&str, fn())] = &[
    ("bad_scene_files_are_one_clear_line", bad_scene_files),
    ("bad_lights_are_one_clear_line", bad_lights),
    ("bad_materials_and_textures_are_one_clear_line", bad_materials),
    ("bad_geometry_is_one_clear_line", bad_geometry),
    ("bad_cameras_are_one_clear_line", bad_cameras),
    ("a_camera_inside_something_solid_is_warned_of", a_camera_inside_something_solid),
    ("columns_that_do_not_fit_say_what_they_would_need", columns_that_do_not_fit),
    ("memory_is_counted_while_a_scene_is_loaded", memory_is_counted_while_a_scene_is_loaded),
    ("textures_beyond_what_a_scene_may_hold_are_refused_unread", textures_beyond_what_a_scene_may_hold),
    ("files_outside_of_the_scenes_folder_are_read_only_on_demand", files_outside_of_the_scenes_folder),
    ("errors_quote_no_file_that_a_scene_names", errors_quote_no_file_that_a_scene_names),
    ("no_cut_or_changed_byte_of_an_input_panics", no_damaged_input_panics),
];

/// Holds an error to its promise: the right kind, one line, and the words that help.
fn refused(folder: &Folder, words: &[&str]) {
    let error = match folder.load() {
        Ok(_) => panic!("accepted, but should say {words:?}"),
        Err(error) => error,
    };
    let text = error.to_string();
    assert!(matches!(error, Error::Input { .. } | Error::Resources { .. } | Error::Io { .. }), "{error:?}");
    assert!(!text.contains('\n') && text.len() < 600, "{text}");
    for word in words {
        assert!(text.contains(word), "'{word}' is missing in: {text}");
    }
}

fn bad_scene_files() {
    refused(&Folder::new(), &["scene.toml"]);
    refused(&Folder::new().with("scene.toml", ROOM_TOML), &["scene.toml", "room.obj", "missing", "LTM_SCENES"]);
    refused(&room("[rendr]\n"), &["scene.toml, line 5", "'rendr'", "did you mean 'render'"]);
    refused(&room("[render]\nsample_per_pixel = 3\n"), &["line 6", "did you mean 'samples_per_pixel'"]);
    refused(&room("[render]\nsamples_per_pixel = 0\n"), &["scene.toml", "samples_per_pixel = 0"]);
    refused(&room("[render]\nsamples_per_pixel = -1\n"), &["scene.toml, line 6"]);
    refused(&room("[render]\nblock_side = 1000\n"), &["block_side = 1000", "256"]);
    refused(&room("").with("scene.toml", [0xff, 0xfe, 0x00]), &["scene.toml"]);
    refused(
        &room("").with("scene.toml", "geometry = [\"room.obj\"]\n[camera]\nlook_at = [0, 0, 0]\n"),
        &["'eye' is missing"],
    );
    let negative = ROOM_TOML.replace("[camera]", "metres_per_unit = -1\n[camera]");
    refused(&room("").with("scene.toml", negative), &["metres_per_unit"]);
}

fn bad_lights() {
    let light = |text: &str| room(&format!("[[light]]\n{text}\n"));
    refused(&light("material = \"lmp\""), &["scene.toml, light 1 \"lmp\"", "no surface fits", "did you mean 'lamp'"]);
    refused(&light("material = \"ground\""), &["'ground' does not emit"]);
    refused(&light("kind = \"sun\"\ntexels = [2, 2]"), &["\"sun\"", "'texels'", "towards"]);
    refused(&light("kind = \"sun\""), &["'towards' is missing"]);
    refused(&light("kind = \"sun\"\ntowards = [0, 0, 0]"), &["towards has no length"]);
    refused(&light("kind = \"point\"\nposition = [0, nan, 0]"), &["position", "not finite"]);
    refused(&light("kind = \"spot\"\nposition = [0, 1, 0]\ninner_degrees = 50"), &["inner_degrees 50"]);
    refused(&light("kind = \"laser\""), &["line 6", "\"laser\"", "panel"]);
    refused(&light("texels = [0, 4]"), &["texels [0, 4]"]);
    refused(&light("emission = [-1, 0, 0]"), &["emission"]);
    refused(&light("material = \"lamp\"\n[[light]]\nmaterial = \"lamp\""), &["light 2", "belongs to earlier lights"]);
    let panel = "kind = \"panel\"\norigin = [0, 2, 0]\nedge_u = [1, 0, 0]\n";
    refused(&light(&format!("{panel}edge_v = [1, 1, 0]")), &["not perpendicular"]);
    refused(&light(&format!("{panel}edge_v = [0, 0, 0]")), &["edge_v has no length"]);
    refused(&light(&format!("{panel}edge_v = [0, 0, 1]\nfaces = [1, 0, 0]")), &["'faces'"]);
    refused(&light(&format!("{panel}edge_v = [0, 0, 1]\nreplaces = \"lamb\"")), &["\"lamb\"", "did you mean 'lamp'"]);
    refused(&light("kind = \"environment\"\nmapping = \"octahedral\"\ntexels = [4, 2]"), &["octahedral", "square"]);
    refused(&light("kind = \"environment\"\n[[light]]\nkind = \"environment\"\nname = \"b\""), &["light 2", "already"]);
    refused(&light("kind = \"environment\"\nmap = \"none.hdr\""), &["none.hdr", "missing"]);
    refused(&light("kind = \"ies\"\nposition = [0, 1, 0]\nfile = \"a.ies\"").with("a.ies", "?"), &["a.ies", "TILT"]);
    refused(&light("kind = \"point\"\nposition = [0, 1, 0]\nname = \"lamp\"\n[[light]]"), &["'lamp'", "taken"]);
    let split = ROOM_OBJ.replace("f 5 6 7 8", "f 5 6 7");
    refused(&light("texels = [2, 2]").with("room.obj", split), &["'lamp'", "not a rectangle", "panel"]);
    let dark = ROOM_MTL.replace("Ke 3 2 1", "Ke 0 0 0");
    refused(&room("").with("room.mtl", dark), &["no light", "[[light]]"]);
    let flat = ROOM_OBJ.replace("f 5 6 7 8", "f 5 6 6");
    refused(&light("material = \"lamp\"").with("room.obj", flat), &["no surface fits \"lamp\""]);
}

fn bad_materials() {
    let material = |text: &str| room(&format!("[[material]]\n{text}\n"));
    refused(&material("match = \"grond\"\nroughness = 1"), &["material \"grond\"", "did you mean 'ground'"]);
    refused(&material("match = \"*\"\nroughness = 2"), &["material \"*\"", "roughness 2"]);
    refused(&material("match = \"*\"\nior = 0"), &["ior 0"]);
    refused(&material("match = \"*\"\nreflectance = [-1, 0, 0]"), &["reflectance", "-1"]);
    refused(&material("match = \"*\"\nkind = \"shiny\""), &["line 7", "\"shiny\"", "coated"]);
    refused(&material("match = \"*\"\nreflectence = [1, 1, 1]"), &["line 7", "did you mean 'reflectance'"]);
    refused(&room("").with("room.mtl", "newmtl ground\nKd 1 \0 1\n"), &["no light"]);
    refused(&room("").with("room.mtl", "newmtl\0ground\n"), &["room.mtl, line 1", "no text"]);
    refused(&room("").with("room.mtl", "newmtl ground\nmap_Kd wood.png\n"), &["'ground'", "wood.png", "missing"]);
    let text = room("").with("room.mtl", "newmtl ground\nmap_Kd wood.png\n").with("wood.png", "no image");
    refused(&text, &["wood.png", "cannot be read"]);
    // A PNG that claims 65,535 × 65,535 pixels in its header.
    let mut huge = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\xff\xff\0\0\xff\xff\x08\x06\0\0\0".to_vec();
    huge.extend(crc32fast::hash(&huge[12..]).to_be_bytes());
    huge.extend(b"\0\0\0\0IDAT\x35\xaf\x06\x1e");
    let folder = room("").with("room.mtl", "newmtl ground\nmap_Kd wood.png\n").with("wood.png", huge);
    refused(&folder, &["wood.png", "65535"]);
}

fn bad_geometry() {
    let with = |obj: &str| room("").with("room.obj", obj);
    refused(&with(""), &["room.obj", "no faces"]);
    refused(&with("v 0 0 0\nv 1 0 0\nv 0 1 0\n"), &["room.obj", "no faces"]);
    refused(&with("v 0 0 NaN\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), &["room.obj", "nothing is left", "1 vertices", "line 1"]);
    refused(&with("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 44\n"), &["room.obj", "nothing is left", "1 faces", "line 4"]);
    refused(&with("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n"), &["room.obj", "three corners"]);
    refused(&with("v 0 0 0\nf 1 1 1\n"), &["no triangles"]);
    refused(&room("").with("scene.toml", ROOM_TOML.replace("\"room.obj\"", "")), &["no triangles"]);
}

fn bad_cameras() {
    let with = |camera: &str| room("").with("scene.toml", format!("geometry = [\"room.obj\"]\n[camera]\n{camera}\n"));
    refused(&with("eye = [0, 1, 4]"), &["[camera]", "look_at"]);
    refused(&with("eye = [0, 1, 4]\nlook_at = [0, 0, 0]\ndirection = [0, 0, 1]"), &["[camera]", "both"]);
    refused(&with("eye = [0, 1, 4]\nlook_at = [0, 1, 4]"), &["[camera]", "no direction"]);
    refused(&with("eye = [0, inf, 4]\nlook_at = [0, 1, 4]"), &["[camera]", "not finite"]);
    refused(&with("eye = [0, 1, 4]\ndirection = [0, -1, 0]"), &["[camera]", "'up'"]);
    refused(&with("eye = [0, 1, 4]\ndirection = [1, 0, 0]\nvertical_fov_degrees = 180"), &["field of view"]);
    refused(&with("eye = [0, 1, 4]\ndirection = [1, 0, 0]\nwidth = 0"), &["no pixels"]);
    refused(&with("eye = [0, 1, 4]\ndirection = [1, 0, 0]\nfilter_radius = 2"), &["box filter"]);
    refused(&with("eye = [0, 1, 40]\ndirection = [0, 0, 1]"), &["sees nothing", "[0, 1, 40]"]);
    refused(&with("eye = [0, 0.0001, 0]\ndirection = [0, -1, 0]\nup = [0, 0, 1]"), &["stands in a wall"]);
}

fn a_camera_inside_something_solid() {
    let cube =
        "mtllib room.mtl\nusemtl lamp\nv -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nv -1 2 -1\nv 1 2 -1\nv 1 2 1\nv -1 2 1
f 1 2 3 4\nf 8 7 6 5\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n";
    let camera = "geometry = [\"room.obj\"]\n[camera]\neye = [0, 1, 0.1]\ndirection = [0, 0, -1]\n";
    let loaded = room("").with("room.obj", cube).with("scene.toml", camera).load().unwrap();
    assert!(loaded.warnings.iter().any(|w| w.text.contains("inside something solid")), "{:?}", loaded.warnings);
}

fn columns_that_do_not_fit() {
    let words = ["light 1", "25000000 columns", "TiB", "16777216", "fewer texels"];
    refused(&room("[[light]]\ntexels = [5000, 5000]\n"), &words);
    refused(&room("[[light]]\ntexels = [4294967295, 4294967295]\n"), &["columns", "TiB"]);
    refused(&room("[[light]]\nkind = \"environment\"\ntexels = [5000, 5000]\n"), &words);
    let panel = "kind = \"panel\"\norigin = [0, 2, 0]\nedge_u = [1, 0, 0]\nedge_v = [0, 0, 1]\n";
    refused(&room(&format!("[[light]]\n{panel}texels = [5000, 5000]\n")), &words);
    // Four lights of 2³¹ × 2³¹ texels each are 2⁶⁴ columns, which 64 bits hold as none.
    let lamps = ["1", "2", "3", "4"].map(|n| format!("newmtl lamp{n}\nKe 1 1 1\n")).concat();
    let square = |n: usize| {
        let corners = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(x, z)| format!("v {x} {n} {z}\n")).concat();
        format!("usemtl lamp{n}\n{corners}f -4 -3 -2 -1\n")
    };
    let squares = format!("mtllib room.mtl\n{}", (1..=4).map(square).collect::<String>());
    let entry = "[[light]]\nmaterial = \"lamp*\"\ntexels = [2147483648, 2147483648]\n";
    refused(&room(entry).with("room.mtl", lamps).with("room.obj", squares), &["light 1", "columns", "fewer texels"]);
}

/// Geometry, textures, maps and columns are counted against the memory before they are made.
fn memory_is_counted_while_a_scene_is_loaded() {
    let load = |folder: &Folder, bytes: u64| {
        let options = ltm::scene::LoadOptions { memory_bytes: Some(bytes), ..Default::default() };
        ltm::scene::load_with(&folder.path("scene.toml"), options)
    };
    let small = room("");
    assert!(load(&small, 1 << 20).is_ok());
    let big_obj: String = (0..20_000).map(|i| format!("v {i} 0 0\nf -1 1 2\n")).collect();
    let header = |width: u32| format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1024 +X {width}\n");
    let texture = room("").with("room.mtl", "newmtl ground\nmap_Kd wood.hdr\nnewmtl lamp\nKe 1 1 1\n");
    let sky = room("[[light]]\nkind = \"environment\"\nmap = \"sky.hdr\"\n");
    let panel = "[[light]]\nkind = \"panel\"\norigin = [0, 2, 0]\nedge_u = [1, 0, 0]\nedge_v = [0, 0, 1]\n";
    for (folder, named) in [
        (room("").with("room.obj", format!("{ROOM_OBJ}{big_obj}")), "room.obj"),
        (texture.with("wood.hdr", header(1024)), "wood.hdr"),
        (sky.with("sky.hdr", header(1024)), "sky.hdr"),
        (room(&format!("{panel}texels = [1000, 1000]\n")), "light 1"),
        (room(&format!("#{}\n", "x".repeat(1 << 20))), "scene.toml"),
    ] {
        let error = load(&folder, 1 << 20).unwrap_err();
        assert!(matches!(error, Error::Resources { .. }) && error.to_string().contains(named), "{named}: {error}");
    }
}

fn textures_beyond_what_a_scene_may_hold() {
    // Floats of 16,384² pixels, without any.
    let header = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16384 +X 16384\n";
    let folder = room("").with("room.mtl", "newmtl ground\nmap_Kd a.hdr\nnewmtl lamp\nKe 1 1 1\n");
    refused(&folder.with("a.hdr", header), &["a.hdr", "4.0 GiB", "2.0 GiB", "scale"]);
}

/// Whoever wrote a scene may be a stranger: whatever names a file, and however.
fn files_outside_of_the_scenes_folder() {
    let outside = Folder::new().with("room.obj", ROOM_OBJ).with("room.mtl", ROOM_MTL);
    let outside = outside.with("lamp.ies", "TILT=NONE\n1 1 1 2 2 1 1 0 0 0 1 1 1 0 90 0 90 4 3 2 1\n");
    let outside = outside.with("sky.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n@@@\u{7f}");
    let at = |name: &str| outside.path(name).display().to_string();
    let texture = |name: &str| format!("newmtl ground\nmap_Kd {name}\nnewmtl lamp\nKe 1 1 1\n");
    let geometry = |name: &str| ROOM_TOML.replace("room.obj", name);
    let light =
        |kind: &str, name: &str| format!("[[light]]\nmaterial = \"lamp\"\n[[light]]\nkind = \"{kind}\"\n{name}\n");
    let ies = format!("position = [0, 1, 0]\nfile = \"{}\"", at("lamp.ies"));
    let material = format!("[[material]]\nmatch = \"ground\"\nreflectance_map = \"{}\"\n", at("sky.hdr"));
    let linked = |name: &str, to: &str| {
        let folder = room("").with("room.mtl", texture("sky.hdr"));
        let _ = std::fs::remove_file(folder.path(name));
        std::os::unix::fs::symlink(outside.path(to), folder.path(name)).expect("a link");
        folder
    };
    let up = outside.path("").file_name().map(|name| format!("../{}/room.obj", name.to_string_lossy()));
    let cases = [
        room("").with("scene.toml", geometry(&at("room.obj"))),
        room("").with("scene.toml", geometry(&up.expect("a temporary folder has a name"))),
        room("").with("room.obj", ROOM_OBJ.replace("room.mtl", &at("room.mtl"))),
        room("").with("room.mtl", texture(&at("sky.hdr"))),
        room(&light("ies", &ies)),
        room(&light("environment", &format!("map = \"{}\"", at("sky.hdr")))),
        room(&material),
        linked("sky.hdr", "sky.hdr"),
    ];
    let allowed = ltm::scene::LoadOptions { allow_outside: true, allow_missing: true, ..Default::default() };
    for (index, folder) in cases.iter().enumerate() {
        refused(folder, &["outside", "`allow_outside`"]);
        let loaded = ltm::scene::load_with(&folder.path("scene.toml"), allowed.clone());
        assert!(loaded.is_ok(), "case {index}: {}", loaded.expect_err("not allowed"));
    }
}

/// A scene from elsewhere may name any file as geometry or materials: what stands in it is not repeated.
fn errors_quote_no_file_that_a_scene_names() {
    let secret = "root:x:0:0:root:/root:/bin/sh\nusers:x:100:\n";
    let light = "[[light]]\nkind = \"ies\"\nposition = [0, 1, 0]\nfile = \"a.ies\"\n";
    for folder in [
        room("").with("room.mtl", secret),
        room("").with("room.obj", secret),
        room("").with("room.obj", format!("v {secret}")),
        room("").with("room.obj", format!("{ROOM_OBJ}f {secret}")),
        room("").with("room.mtl", format!("newmtl ground\nKd {secret}")),
        room(light).with("a.ies", format!("TILT=NONE\n{secret}")),
        room(light).with("a.ies", secret),
    ] {
        let lines = match folder.load() {
            Ok(loaded) => loaded.warnings.lines().join("\n"),
            Err(error) => error.to_string(),
        };
        assert!(!lines.contains("root") && !lines.contains("users"), "{lines}");
    }
}

fn no_damaged_input_panics() {
    let more = "[[light]]\nmaterial = \"lamp\"\ntexels = [2, 2]\n[[light]]\nkind = \"ies\"\nposition = [0, 1, 0]\nfile = \"a.ies\"\n";
    let ies = "TILT=NONE\n1 1 1 2 2 1 1 0 0 0 1 1 1 0 90 0 90 4 3 2 1\n";
    let whole = [("room.obj", ROOM_OBJ.to_owned()), ("room.mtl", ROOM_MTL.to_owned()), ("a.ies", ies.to_owned())];
    let whole = whole.into_iter().chain([("scene.toml", format!("{ROOM_TOML}{more}"))]);
    let whole: Vec<_> = whole.map(|(name, text)| (name, text.into_bytes())).collect();
    let folder = || whole.iter().fold(Folder::new(), |folder, (name, bytes)| folder.with(name, bytes));
    assert!(folder().load().is_ok());
    let mut folder = folder();
    for (name, bytes) in &whole {
        for at in 0..bytes.len() {
            folder = folder.with(name, &bytes[..at]);
            let _ = folder.load();
            for byte in [b'0', b'-', b'/', b'\n', 0xff] {
                let mut changed = bytes.clone();
                changed[at] = byte;
                folder = folder.with(name, &changed);
                let _ = folder.load();
            }
        }
        folder = folder.with(name, bytes);
    }
}
