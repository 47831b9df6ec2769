//! The programs from outside: the whole way on a small room, and one clear line for everything that can go wrong.

mod program;
mod room;

use std::fs;
use std::path::Path;
use std::process::Output;

use room::write_room;
use tempfile::TempDir;

const LIGHTS: &str = r#"
[render]
samples_per_pixel = 4

[[light]]
material = "lamp"
"#;

fn room() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_room(folder.path(), LIGHTS);
    folder
}

fn run(folder: &Path, program: &str, arguments: &[&str]) -> Output {
    program::command(folder, program, arguments).output().unwrap()
}

fn succeed(folder: &Path, program: &str, arguments: &[&str]) -> String {
    let output = run(folder, program, arguments);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{program} {arguments:?}: {error}");
    String::from_utf8(output.stdout).unwrap()
}

/// Runs a program that must fail with this exit code and one error line that has all of `words`. Before it may stand what
/// the job would have needed.
fn fail(folder: &Path, program: &str, arguments: &[&str], code: i32, words: &[&str]) {
    let output = run(folder, program, arguments);
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{program} {arguments:?}: {error}");
    assert!(!error.contains("panicked"), "{error}");
    let lines: Vec<&str> = error.lines().filter(|line| !line.contains(", needs up to ")).collect();
    assert_eq!(lines.len(), 1, "one line: {error}");
    for word in words {
        assert!(error.contains(word), "'{word}' is not in: {error}");
    }
}

/// The values of a NumPy file of 32-bit floats, whose header must state this shape.
fn array(path: &Path, shape: &str) -> Vec<f32> {
    let bytes = fs::read(path).unwrap();
    let values = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = std::str::from_utf8(&bytes[10..values]).unwrap();
    assert_eq!(header.trim_end(), format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}"));
    bytes[values..].as_chunks::<4>().0.iter().map(|word| f32::from_le_bytes(*word)).collect()
}

#[test]
#[cfg_attr(not(all(target_os = "linux", target_env = "gnu")), ignore = "closed pipes are handled on Linux")]
fn a_reader_that_has_seen_enough_ends_a_program_quietly() {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut program = std::process::Command::new(program::path("ltm"));
    let output = program.arg("--help").stdout(writer).output().unwrap();
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    let folder = room();
    succeed(folder.path(), "ltm", &["render", "room.toml"]);
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut program = std::process::Command::new(program::path("ltm"));
    let output = program.current_dir(folder.path()).args(["info", "room.ltm"]).stdout(writer).output().unwrap();
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
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
    assert!(array(&at.join("lights.npy"), "(1, 24, 40, 3)").iter().any(|&v| v > 0.0));
}

#[test]
fn the_demonstration_prints_its_table_and_leaves_its_images() {
    let folder = tempfile::tempdir().unwrap();
    let table = succeed(folder.path(), "ltm", &["demo", "--size", "64x36", "--samples", "8"]);
    for word in ["first image", "2 samples", "8 samples", "4 lightings", "columns", "mean rank", "relative L2", "Next:"]
    {
        assert!(table.contains(word), "'{word}' is not in:\n{table}");
    }
    for name in ["all-on", "day", "evening", "painted-panel"] {
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
        ("room.obj", "v 1 0 1", "v 1 nan 1", &["nothing of the geometry"]),
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
    fail(folder.path(), "ltm", &["render", "room.toml", "-o", "no/such/folder/t.ltm"], 3, &["no/such/folder"]);
    succeed(folder.path(), "ltm", &["render", "room.toml"]);
    fail(folder.path(), "ltm-pack", &["room.ltm", "-o", "no/such/t.ltc"], 3, &["no/such"]);
}

#[test]
fn unusable_arguments_exit_with_2_and_help_with_0() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(run(folder.path(), "ltm", &["render"]).status.code(), Some(2));
    for program in ["ltm", "ltm-pack", "ltm-unpack"] {
        assert!(succeed(folder.path(), program, &["--help"]).contains("Exit codes"));
    }
}

#[test]
fn a_matrix_is_not_named_as_a_container_nor_the_other_way_round() {
    let folder = room();
    let before = fs::read_dir(folder.path()).unwrap().count();
    fail(folder.path(), "ltm", &["render", "room.toml", "-o", "room.ltc"], 3, &["room.ltc", "x.ltm", "--pack"]);
    fail(folder.path(), "ltm", &["render", "room.toml", "--pack", "-o", "room.LTM"], 3, &["room.LTM", "x.ltc"]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), before, "nothing was written");
}

/// Images of two lights and of both together, as Blender names them.
fn write_light_groups(path: &Path) {
    let layers = ["ViewLayer.Combined", "ViewLayer.Combined_key", "ViewLayer.Combined_fill light"].map(String::from);
    let value = |image: usize, c: usize, x: usize, y: usize| match image {
        0 => 3.0 + (x + y) as f32 / 50.0 + c as f32,
        1 => 1.0 + (x + y) as f32 / 50.0,
        _ => 2.0 + c as f32,
    };
    let size = ltm::image::ImageSize { width: 50, height: 40 };
    let mut fetch = |image: usize, c: usize, y: usize, row: &mut [f32]| {
        row.iter_mut().enumerate().for_each(|(x, v)| *v = value(image, c, x, y));
        Ok(())
    };
    ltm::image::write_exr_rows(path, true, &layers, size, &mut fetch).unwrap();
}

#[test]
fn light_groups_are_cleaned_into_a_file_like_theirs_and_get_names() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_light_groups(&at.join("groups.exr"));
    let said = succeed(at, "ltm-pack", &["groups.exr", "--clean-to", "clean.exr"]);
    assert!(said.contains("clean.exr: 2 clean light groups, which add up"), "{said}");
    fail(at, "ltm-pack", &["groups.exr", "--clean-to", "clean.exr"], 3, &["clean.exr", "--force"]);
    fail(at, "ltm-pack", &["groups.exr", "--clean-to", "no/clean.exr"], 3, &["no"]);
    fail(at, "ltm-pack", &["*.exr", "--clean-to", "x.exr"], 3, &["two layers"]);
    let again = succeed(at, "ltm-pack", &["clean.exr", "--progress"]);
    assert!(again.contains("light 'key'") && again.contains("the lights' sum is"), "{again}");
    assert!(!at.join("groups.ltc").exists());
    fs::write(at.join("names.json"), r#"{"key": "Küche.001"}"#).unwrap();
    let said = succeed(at, "ltm-pack", &["g*s.exr", "--names", "names.json", "-o", "named.ltc"]);
    assert!(said.contains("light 'Küche.001'") && said.contains("light 'fill light'"), "{said}");
    fs::write(at.join("names.json"), "[1]").unwrap();
    fail(at, "ltm-pack", &["groups.exr", "--names", "names.json", "-o", "x.ltc"], 3, &["names.json", "object"]);
}

/// Each frame of a sequence becomes the container that its file would become alone, and is relit under its own number.
#[test]
fn a_sequence_is_packed_and_relit_frame_by_frame() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for frame in ["0007", "0008", "0012"] {
        write_light_groups(&at.join(format!("shot.{frame}.exr")));
    }
    let said = succeed(at, "ltm-pack", &["shot.####.exr", "--frames", "0..12"]);
    assert!(said.contains("frame 8, 2 in all") && said.matches("light 'key'").count() == 1, "{said}");
    assert!(at.join("shot.0007.ltc").exists() && !at.join("shot.0012.ltc").exists());
    succeed(at, "ltm-pack", &["shot.0008.exr", "-o", "alone.ltc"]);
    let [of_sequence, alone] =
        ["shot.0008.ltc", "alone.ltc"].map(|name| ltm::container::ContainerReader::open(&at.join(name)).unwrap());
    assert_eq!(of_sequence.job().basis, alone.job().basis);
    // One frame is there already: nothing is packed.
    fail(at, "ltm-pack", &["shot.####.exr"], 3, &["shot.0007.ltc", "--force"]);
    assert!(!at.join("shot.0012.ltc").exists());
    fail(at, "ltm-pack", &["shot.####.exr", "-o", "one.ltc"], 3, &["one.ltc", "####"]);
    fail(at, "ltm-pack", &["other.####.exr"], 3, &["other.####.exr", "no file"]);
    fail(at, "ltm-pack", &["shot.0007.exr", "-o", "x.ltc", "--frames", "0..3"], 3, &["--frames", "####"]);
    let said = succeed(at, "ltm", &["relight", "shot.####.ltc", "-o", "out.###.png", "--on", "key"]);
    assert!(said.contains("2 frames") && said.matches("exposed by").count() == 1, "{said}");
    assert!(at.join("out.007.png").exists() && at.join("out.008.png").exists());
    // An animated look goes on from frame to frame.
    let look = "[[look]]\nname = 'dim'\n[[look.light]]\nname = '*'\nstops = -2\n[[look]]\nname = 'bright'\n\
        [[key]]\ntime_secs = 0\nlook = 'dim'\n[[key]]\ntime_secs = 1\nlook = 'bright'\n";
    fs::write(at.join("fade.toml"), look).unwrap();
    let faded = ["relight", "shot.####.ltc", "-l", "fade.toml", "--fps", "1", "-o", "fade.####.exr"];
    succeed(at, "ltm", &faded);
    let [dim, bright] = ["fade.0007.exr", "fade.0008.exr"].map(|name| ltm::image::read_image(&at.join(name)).unwrap());
    for (dim, bright) in dim.pixels.iter().flatten().zip(bright.pixels.iter().flatten()) {
        assert!((4.0 * dim - bright).abs() <= 1e-3 * bright, "{dim}, {bright}");
    }
    // Whichever of the frames are asked for.
    let part = ["relight", "shot.####.ltc", "-l", "fade.toml", "--fps", "1", "-o", "part.####.exr", "--frames", "8..9"];
    succeed(at, "ltm", &part);
    let [of_all, of_part] =
        ["fade.0008.exr", "part.0008.exr"].map(|name| ltm::image::read_image(&at.join(name)).unwrap());
    assert!(of_all.pixels == of_part.pixels && !at.join("part.0007.exr").exists());
    fail(at, "ltm", &["relight", "shot.####.ltc", "-o", "one.png"], 3, &["one.png", "####"]);
    fail(at, "ltm", &["relight", "shot.####.exr", "-o", "x.###.png"], 3, &["shot.0007.exr"]);
}

#[test]
fn light_groups_become_a_container_and_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_light_groups(&at.join("groups.exr"));
    let said = succeed(at, "ltm-pack", &["groups.exr", "--target", "80dB", "--verify"]);
    for word in
        ["light 'key'", "light 'fill light'", "all lights together", "the lights' sum is", "worst place", "relative L2"]
    {
        assert!(said.contains(word), "'{word}' is not in:\n{said}");
    }
    fail(at, "ltm-pack", &["groups.exr"], 3, &["groups.ltc", "--force"]);
    fail(at, "ltm-pack", &["groups.exr", "-o", "x.ltc", "--layers", "Nothing_(.+)"], 3, &["groups.exr", "--layers"]);
    succeed(at, "ltm-pack", &["groups.exr", "-o", "key.ltc", "--layers", "Combined_(key)"]);
    // What is unpacked packs again to the same lights.
    succeed(at, "ltm-unpack", &["groups.ltc", "-o", "back.exr"]);
    let again = succeed(at, "ltm-pack", &["back.exr", "-o", "again.ltc"]);
    assert!(
        again.contains("light 'key'") && again.contains("light 'fill light'") && again.contains("the lights' sum is")
    );
    succeed(at, "ltm-unpack", &["groups.ltc", "-o", "one_{light}.exr", "--memory", "200MiB"]);
    let (relit, key) = ("relit.exr", "one_key.exr");
    succeed(at, "ltm-unpack", &["groups.ltc", "-o", relit, "--on", "key"]);
    let [relit, key] = [relit, key].map(|name| ltm::image::read_image(&at.join(name)).unwrap());
    assert_eq!(relit, key);
    // The target is 80 dB of the peak, which is about 6.
    assert!((relit.pixels[50 * 30 + 20][1] - 2.0).abs() < 6e-3, "{:?}", relit.pixels[50 * 30 + 20]);
    succeed(at, "ltm-unpack", &["groups.ltc", "-o", "crop.npy", "--crop", "20,30,7x5", "--lights", "k*"]);
    assert_eq!(array(&at.join("crop.npy"), "(1, 5, 7, 3)")[1], relit.pixels[50 * 30 + 20][1]);
    // A crop of the matrix, packed again, is the crop of the picture.
    succeed(at, "ltm-unpack", &["groups.ltc", "-o", "crop.ltm", "--crop", "20,30,7x5", "--lights", "key"]);
    succeed(at, "ltm", &["relight", "crop.ltm", "-o", "crop.exr"]);
    let crop = ltm::image::read_image(&at.join("crop.exr")).unwrap();
    // The same factors, multiplied in another order.
    assert!((crop.pixels[0][1] - relit.pixels[50 * 30 + 20][1]).abs() < 1e-5);
    succeed(at, "ltm-unpack", &["groups.ltc", "-o", "part.ltm", "--blocks", "1..3"]);
    assert!(succeed(at, "ltm", &["info", "part.ltm"]).contains("committed    2 of 4 blocks"));
    fail(at, "ltm-unpack", &["groups.ltc", "-o", "x.npy", "--crop", "20,30,70x5"], 3, &["50 × 40"]);
    fail(at, "ltm-unpack", &["groups.ltc", "-o", "x.npy", "--lights", "sun"], 3, &["sun", "fill light"]);
    fail(at, "ltm-unpack", &["groups.ltc", "-o", "x.npy", "--memory", "1KiB"], 6, &["--memory"]);
    assert!(!names(at).iter().any(|name| name.contains(".part")), "{:?}", names(at));
}

/// The line on what the first job needs, the largest memory that a job names, in MiB, and standard output.
fn stated_need(folder: &Path, program: &str, arguments: &[&str]) -> (String, f64, String) {
    let output = run(folder, program, arguments);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{program} {arguments:?}: {said}");
    let lines: Vec<&str> = said.lines().filter(|line| line.contains(", needs up to ")).collect();
    let line = (*lines.first().unwrap_or_else(|| panic!("{said}"))).to_owned();
    // A program may have two jobs to do, one after the other.
    let needs = lines.iter().map(|line| mebibytes(line.split(", needs up to ").nth(1).unwrap()));
    let need = needs.fold(0.0, f64::max);
    (line, need, String::from_utf8(output.stdout).unwrap())
}

fn mebibytes(text: &str) -> f64 {
    let mut words = text.split_whitespace();
    let number: f64 = words.next().unwrap().parse().unwrap();
    let unit = words.next().unwrap();
    number
        * if unit.starts_with("KiB") {
            1.0 / 1024.0
        } else if unit.starts_with("MiB") {
            1.0
        } else {
            f64::MAX
        }
}

#[test]
fn what_jobs_on_containers_need_is_said_and_kept_and_too_little_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_light_groups(&at.join("groups.exr"));
    let (line, ..) = stated_need(at, "ltm-pack", &["groups.exr", "--target", "60dB"]);
    assert!(line.contains("reading the images, then packing"), "{line}");
    // Three images of 50 × 40 pixels in f32 wait on disk, and then the blocks that are packed.
    let disk = mebibytes(line.split(" and likely ").nth(1).unwrap_or_else(|| panic!("{line}")));
    assert!(disk > 70.3 / 1024.0 && disk < 1.0, "{line}");
    let before = names(at);
    let jobs: [(&str, &[&str], &str); 6] = [
        ("ltm-unpack", &["groups.ltc", "-o", "layers.exr"], "140.6 KiB of disk"),
        ("ltm-unpack", &["groups.ltc", "-o", "one_{light}.exr"], "93.8 KiB of disk"),
        ("ltm-unpack", &["groups.ltc", "-o", "relit.exr", "--relit"], "46.9 KiB of disk"),
        ("ltm-unpack", &["groups.ltc", "-o", "lights.npy"], "93.8 KiB of disk"),
        ("ltm", &["verify", "groups.ltc"], "of memory"),
        ("ltm-pack", &["groups.exr", "-o", "again.ltc"], "of disk"),
    ];
    for (program, arguments, _) in jobs {
        // More than the program itself, so that the images have been looked at when it is refused.
        for memory in ["1KiB", "24MiB"] {
            fail(
                at,
                program,
                &[arguments, &["--memory", memory]].concat(),
                6,
                &["are allowed; raise --memory", "of memory"],
            );
            assert_eq!(names(at), before, "{program} {arguments:?}");
        }
    }
    for (program, arguments, disk) in jobs {
        let (line, need, said) = stated_need(at, program, &[arguments, &["--memory", "300MiB"]].concat());
        assert!(line.contains(disk), "{line}");
        let peak = mebibytes(said.split("peak memory ").nth(1).unwrap_or_else(|| panic!("{said}")));
        assert!(peak <= need, "{program} {arguments:?}: {peak} MiB of {need} MiB");
    }
}

/// Hundreds of blocks of few columns: what each leaves behind in the allocator adds up.
#[test]
fn memory_stays_below_what_is_said_over_many_blocks() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let texels = "[render]\nsamples_per_pixel = 2\n\n[[light]]\nmaterial = \"lamp\"\ntexels = [6, 4]\n";
    write_room(at, texels);
    // Denoising takes long where code is not optimised.
    for (size, denoise) in [("1536x1024", "off"), ("288x192", "auto")] {
        succeed(at, "ltm", &["render", "room.toml", "--force", "--size", size]);
        let (_, need, said) = stated_need(at, "ltm-pack", &["room.ltm", "--force", "--denoise", denoise]);
        let peak = mebibytes(said.split("peak memory ").nth(1).unwrap_or_else(|| panic!("{said}")));
        assert!(peak <= need, "{peak} MiB of {need} MiB");
    }
}

#[test]
fn info_says_what_a_container_is_to_people_and_programs() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_light_groups(&at.join("groups.exr"));
    succeed(at, "ltm-pack", &["groups.exr", "--target", "60dB"]);
    let said = succeed(at, "ltm", &["info", "groups.ltc", "--rank-map", "ranks.png"]);
    for word in
        ["method auto", "60 dB PSNR", "prior lighting", "base layer", "worst", "rank map", "noise        not known"]
    {
        assert!(said.contains(word), "'{word}' is not in:\n{said}");
    }
    let map = ltm::image::read_image(&at.join("ranks.png")).unwrap();
    assert_eq!((map.width, map.height), (50, 40));
    let json: serde_json::Value = serde_json::from_str(&succeed(at, "ltm", &["info", "groups.ltc", "--json"])).unwrap();
    assert_eq!(json["packing"]["method"], "auto");
    assert_eq!(json["lights"][1]["name"], "key");
    assert_eq!(json["block_list"].as_array().unwrap().len(), 4);
    assert!(json["relative_l2"].as_f64().unwrap() < 0.01 && json["noise_rms"].is_null());
    let lights = &json["light_errors"];
    assert!(lights["single_worst"].as_f64().unwrap() >= lights["single_mean"].as_f64().unwrap());
    assert!(["'key'", "'fill light'"].contains(&lights["worst_light"].as_str().unwrap()), "{lights}");
    assert!(said.contains("one light alone: ") && said.contains("noise of the samples not known"), "{said}");
    let old = concat!(env!("CARGO_MANIFEST_DIR"), "/../../formats/golden/v1.ltc");
    assert!(succeed(at, "ltm", &["info", old]).contains("under single lights and at random: not known"));
}

#[test]
fn info_says_what_a_scene_holds_and_why_it_cannot_be_rendered() {
    let folder = room();
    let at = folder.path();
    let said = succeed(at, "ltm", &["info", "room.toml"]);
    for word in ["40 × 24 pixels", "lamp ", "emission 3.000 2.000 1.000", "lambert, 2 triangles", "columns      1"] {
        assert!(said.contains(word), "'{word}' is not in:\n{said}");
    }
    let json: serde_json::Value = serde_json::from_str(&succeed(at, "ltm", &["info", "room.toml", "--json"])).unwrap();
    assert_eq!((&json["lights"][0]["name"], &json["triangles"]), (&"lamp".into(), &4.into()));
    assert!(json["refused"].is_null());
    // A triangle in the open, and no light.
    let positions: Vec<u8> = [[-1.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        .iter()
        .flatten()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    fs::write(at.join("dark.bin"), positions).unwrap();
    let dark = r#"{ "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0, 1] }], "materials": [{ "name": "paint" }],
        "nodes": [{ "mesh": 0, "name": "flag" }, { "camera": 0, "name": "door", "translation": [0, 0, 4] }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 1, "znear": 0.1 } }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3, "min": [-1, 0, 0], "max": [1, 1, 0] }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }], "buffers": [{ "byteLength": 36, "uri": "dark.bin" }] }"#;
    fs::write(at.join("dark.gltf"), dark).unwrap();
    let said = succeed(at, "ltm", &["info", "dark.gltf"]);
    for word in ["cameras      1", "  door", "triangles    1", "lights       0", "paint", "cannot be rendered"] {
        assert!(said.contains(word), "'{word}' is not in:\n{said}");
    }
    fail(at, "ltm", &["render", "dark.gltf"], 3, &["dark.gltf", "has no light"]);
}

#[test]
fn info_says_what_each_light_gives_under_a_look_and_progress_comes_in_lines() {
    let folder = room();
    let at = folder.path();
    let told = run(at, "ltm", &["render", "room.toml", "--pack", "--progress"]);
    let told = String::from_utf8(told.stderr).unwrap();
    let last = told.lines().filter_map(|line| line.strip_prefix("progress: ")).next_back().unwrap_or_default();
    let (done, total) = last.rsplit(' ').next().and_then(|counts| counts.split_once('/')).unwrap();
    assert_eq!(done, total, "{told}");
    fs::write(at.join("a.toml"), "[groups]\nall = [\"*\"]\n[[light]]\nname = \"all\"\nstops = 1\n").unwrap();
    let said = succeed(at, "ltm", &["info", "room.ltc", "--json", "--lighting", "a.toml"]);
    let json: serde_json::Value = serde_json::from_str(&said).unwrap();
    let light = &json["lights"][0];
    assert_eq!(light["weight"], serde_json::json!([6.0, 4.0, 2.0]));
    assert_eq!(light["scene_weight"], serde_json::json!([3.0, 2.0, 1.0]));
    assert_eq!((&light["is_even"], &json["groups"]["all"][0]), (&true.into(), &"lamp".into()));
}
