//! The programs from outside: the whole way on a small room, and one clear line for everything that can go wrong.

use std::fs;
use std::path::Path;
use std::process::Output;

use assert_cmd::Command;
use tempfile::TempDir;

/// A room of one wall and one lamp, small enough for tests.
const OBJ: &str = "mtllib room.mtl
v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1
v -0.5 2 -0.5\nv 0.5 2 -0.5\nv 0.5 2 0.5\nv -0.5 2 0.5
usemtl floor\nf 4 3 2 1
usemtl lamp\nf 5 6 7 8
";
const MTL: &str = "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 3 2 1\n";
const SCENE: &str = r#"
geometry = ["room.obj"]

[camera]
eye = [0.0, 1.0, 3.0]
look_at = [0.0, 0.5, 0.0]
vertical_fov_degrees = 50.0
width = 40
height = 24

[render]
samples_per_pixel = 4

[[light]]
material = "lamp"
"#;

fn write_room(folder: &Path) {
    fs::write(folder.join("room.obj"), OBJ).unwrap();
    fs::write(folder.join("room.mtl"), MTL).unwrap();
    fs::write(folder.join("room.toml"), SCENE).unwrap();
}

fn room() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_room(folder.path());
    folder
}

fn run(folder: &Path, program: &str, arguments: &[&str]) -> Output {
    let path = match program {
        "ltm" => env!("CARGO_BIN_EXE_ltm"),
        "ltm-pack" => env!("CARGO_BIN_EXE_ltm-pack"),
        _ => env!("CARGO_BIN_EXE_ltm-unpack"),
    };
    Command::new(path).current_dir(folder).args(arguments).output().unwrap()
}

fn succeed(folder: &Path, program: &str, arguments: &[&str]) -> String {
    let output = run(folder, program, arguments);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{program} {arguments:?}: {error}");
    String::from_utf8(output.stdout).unwrap()
}

/// Runs a program that must fail with this exit code and one line on standard error that has all of `words`.
fn fail(folder: &Path, program: &str, arguments: &[&str], code: i32, words: &[&str]) {
    let output = run(folder, program, arguments);
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{program} {arguments:?}: {error}");
    assert!(!error.contains("panicked"), "{error}");
    assert_eq!(error.lines().count(), 1, "one line: {error}");
    for word in words {
        assert!(error.contains(word), "'{word}' is not in: {error}");
    }
}

/// Names in a folder, to show that nothing half-written is left.
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn the_whole_way_from_a_scene_file_to_images() {
    let folder = room();
    let at = folder.path();
    succeed(at, "ltm", &["render", "room.toml"]);
    assert!(succeed(at, "ltm", &["info", "room.ltm"]).contains("lamp"));
    succeed(at, "ltm-pack", &["room.ltm"]);
    assert!(succeed(at, "ltm", &["info", "room.ltc"]).contains("40 × 24 pixels"));
    for output in ["relit.exr", "relit.png"] {
        succeed(at, "ltm", &["relight", "room.ltc", "-o", output]);
        assert!(fs::metadata(at.join(output)).unwrap().len() > 100);
    }
    succeed(at, "ltm", &["relight", "room.ltm", "-o", "raw.exr"]);
    for output in ["again.ltm", "lights.exr", "lights.npy"] {
        succeed(at, "ltm-unpack", &["room.ltc", "-o", output]);
    }
    let bytes = fs::read(at.join("lights.npy")).unwrap();
    let array = npyz::NpyFile::new(&bytes[..]).unwrap();
    assert_eq!(array.shape(), [1, 24, 40, 3]);
    assert!(array.into_vec::<f32>().unwrap().iter().any(|&v| v > 0.0));
}

#[test]
fn the_demonstration_prints_its_table_and_leaves_its_images() {
    let folder = tempfile::tempdir().unwrap();
    let table = succeed(folder.path(), "ltm", &["demo", "--size", "64x48", "--samples", "4"]);
    for word in ["render", "pack", "relight", "peak memory", "columns", "mean rank", "relative L2", "PSNR", "Next:"] {
        assert!(table.contains(word), "'{word}' is not in:\n{table}");
    }
    for name in ["all-on", "warm-corner", "pattern", "moving-spot-1"] {
        for extension in ["exr", "png"] {
            assert!(folder.path().join(format!("out/{name}.{extension}")).exists(), "{name}.{extension}");
        }
    }
}

#[test]
fn results_are_not_overwritten_unless_forced() {
    let folder = room();
    let at = folder.path();
    succeed(at, "ltm", &["render", "room.toml"]);
    succeed(at, "ltm-pack", &["room.ltm"]);
    fail(at, "ltm-pack", &["room.ltm"], 3, &["room.ltc", "--force"]);
    succeed(at, "ltm-pack", &["room.ltm", "--force"]);
    succeed(at, "ltm-unpack", &["room.ltc", "-o", "again.ltm"]);
    fail(at, "ltm-unpack", &["room.ltc", "-o", "again.ltm"], 3, &["again.ltm", "--force"]);
}

#[test]
fn missing_and_foreign_files_are_named() {
    let folder = room();
    let at = folder.path();
    fail(at, "ltm", &["render", "nowhere.toml"], 5, &["nowhere.toml"]);
    fail(at, "ltm", &["info", "nowhere.ltm"], 5, &["nowhere.ltm"]);
    fail(at, "ltm-pack", &["nowhere.ltm"], 5, &["nowhere.ltm"]);
    fs::write(at.join("noise.ltm"), [7u8; 5000]).unwrap();
    fs::write(at.join("noise.ltc"), [7u8; 5000]).unwrap();
    fail(at, "ltm-pack", &["noise.ltm"], 3, &["noise.ltm"]);
    fail(at, "ltm", &["info", "noise.ltc"], 3, &["noise.ltc"]);
    fs::write(at.join("empty.ltc"), []).unwrap();
    fail(at, "ltm", &["info", "empty.ltc"], 3, &["empty.ltc"]);
    fs::remove_file(at.join("room.obj")).unwrap();
    fail(at, "ltm", &["render", "room.toml"], 3, &["room.obj"]);
}

#[test]
fn files_cut_short_are_named() {
    let folder = room();
    let at = folder.path();
    succeed(at, "ltm", &["render", "room.toml"]);
    succeed(at, "ltm-pack", &["room.ltm"]);
    for (name, arguments) in [("cut.ltm", &["verify", "cut.ltm"]), ("cut.ltc", &["info", "cut.ltc"])] {
        let whole = fs::read(at.join(name.replace("cut", "room"))).unwrap();
        for length in [whole.len() / 3, whole.len() - 1] {
            fs::write(at.join(name), &whole[..length]).unwrap();
            fail(at, "ltm", arguments, 4, &[name]);
        }
    }
}

#[test]
fn scenes_that_cannot_be_rendered_say_why() {
    let cases: [(&str, &str, &str, &[&str]); 6] = [
        ("room.toml", "[render]", "[render]\nsampels = 3", &["room.toml", "sampels"]),
        ("room.toml", "\"lamp\"", "\"lantern\"", &["lantern"]),
        ("room.toml", "look_at = [0.0, 0.5, 0.0]", "look_at = [0.0, 1.0, 9.0]", &["camera"]),
        ("room.obj", "v 1 0 1", "v 1 nan 1", &["room.obj"]),
        ("room.obj", "v 0.5 2 0.5\nv -0.5 2 0.5", "v 0.5 2 -0.5\nv -0.5 2 -0.5", &["lamp"]),
        ("room.obj", "f ", "# f ", &["room.obj"]),
    ];
    for (file, from, to, words) in cases {
        let folder = room();
        let at = folder.path();
        let text = fs::read_to_string(at.join(file)).unwrap();
        assert!(text.contains(from));
        fs::write(at.join(file), text.replace(from, to)).unwrap();
        fail(at, "ltm", &["render", "room.toml"], 3, words);
        assert_eq!(names(at), ["room.mtl", "room.obj", "room.toml"], "nothing is left behind");
    }
}

#[test]
fn a_folder_that_cannot_be_written_is_named() {
    let folder = room();
    fail(folder.path(), "ltm", &["render", "room.toml", "-o", "no/such/folder/t.ltm"], 5, &["no/such/folder"]);
    succeed(folder.path(), "ltm", &["render", "room.toml"]);
    fail(folder.path(), "ltm-pack", &["room.ltm", "-o", "no/such/t.ltc"], 5, &["no/such"]);
}

#[test]
fn unusable_arguments_exit_with_2_and_help_with_0() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(run(folder.path(), "ltm", &["render"]).status.code(), Some(2));
    for program in ["ltm", "ltm-pack", "ltm-unpack"] {
        assert!(succeed(folder.path(), program, &["--help"]).contains("Exit codes"));
    }
}
