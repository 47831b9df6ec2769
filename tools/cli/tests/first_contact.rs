//! What a newcomer meets first: `ltm` without a command, `ltm doctor`, completions, and man pages.

mod program;
mod room;

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use ltm::image::write_exr_layers;

fn run(folder: &Path, program: &str, arguments: &[&str]) -> Output {
    program::command(folder, program, arguments).output().unwrap()
}

fn said(output: Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// The commands that `ltm` proposes in a folder.
fn proposed(folder: &Path) -> Vec<String> {
    let text = said(run(folder, "ltm", &[]));
    assert!(text.lines().count() <= 12, "about ten lines: {text}");
    let commands = text.lines().filter_map(|line| line.strip_prefix("  "));
    commands.map(|line| line.split("   #").next().unwrap().trim().to_owned()).collect()
}

/// Runs a line in a shell that finds the programs under test.
fn in_shell(folder: &Path, line: &str) {
    let programs = Path::new(program::path("ltm")).parent().unwrap().to_owned();
    let path = std::env::join_paths([programs, "/usr/bin".into(), "/bin".into()]).unwrap();
    let output = Command::new("sh").args(["-c", line]).current_dir(folder).env("PATH", path).output().unwrap();
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn an_empty_folder_gets_the_demonstration() {
    let folder = tempfile::tempdir().unwrap();
    let commands = proposed(folder.path());
    assert!(commands.iter().any(|command| command.starts_with("ltm demo")), "{commands:?}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is written");
}

#[test]
fn each_kind_of_file_gets_its_command_and_what_was_made_already_gets_none() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a b.glb", "old.glb", "old.ltc", "raw.ltm", "packed.ltm", "packed.ltc", ".hidden.glb", "notes.txt"] {
        fs::write(folder.path().join(name), "").unwrap();
    }
    fs::write(folder.path().join("look.toml"), "[[light]]\nname = \"*\"\n").unwrap();
    let commands = proposed(folder.path());
    assert_eq!(
        commands[..4],
        ["ltm view old.ltc", "ltm view packed.ltc", "ltm-pack raw.ltm", "ltm render 'a b.glb' --pack"]
    );
    assert_eq!(commands.len(), 4, "{commands:?}");
}

#[test]
fn more_files_than_a_screen_holds_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    for number in 0..40 {
        fs::write(folder.path().join(format!("shot_{number}.ltc")), "").unwrap();
    }
    let commands = proposed(folder.path());
    assert_eq!(commands[..3], ["ltm view shot_0.ltc", "ltm view shot_1.ltc", "ltm view shot_2.ltc"]);
    assert_eq!(commands.last().unwrap(), "… and 35 more files");
}

#[test]
fn the_command_for_a_scene_file_renders_it() {
    let folder = tempfile::tempdir().unwrap();
    room::write_room(folder.path(), "[render]\nsamples_per_pixel = 2\n[[light]]\nmaterial = \"lamp\"\n");
    let commands = proposed(folder.path());
    assert_eq!(commands, ["ltm render room.toml --pack"], "the geometry that the scene names is not listed");
    in_shell(folder.path(), &commands[0]);
    assert_eq!(proposed(folder.path()), ["ltm view room.ltc"]);
}

#[test]
fn a_scene_file_that_names_another_scene_is_one() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("view.toml"), "scene = \"room.glb\"\n").unwrap();
    assert_eq!(proposed(folder.path()), ["ltm render view.toml --pack"]);
}

#[test]
fn geometry_alone_is_rendered_in_the_window_where_its_view_is_chosen() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("it's.obj"), "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nf 3 2 1\n").unwrap();
    let commands = proposed(folder.path());
    let file = commands[0].strip_prefix("ltm view ").unwrap();
    in_shell(folder.path(), &format!("ltm render {file} --pack --samples 1 --size 32x32"));
}

#[test]
fn the_commands_for_images_of_lights_pack_them() {
    let folder = tempfile::tempdir().unwrap();
    let image = |value: f32| ltm::LinearImage { width: 8, height: 8, pixels: vec![[value; 3]; 64] };
    let (desk, sky) = (image(0.5), image(0.25));
    let at = |name: &str| folder.path().join(name);
    write_exr_layers(&at("groups.exr"), &[("desk", &desk), ("sky", &sky)]).unwrap();
    ltm::image::write_exr(&at("room_desk.exr"), &desk).unwrap();
    ltm::image::write_exr(&at("room_sky.exr"), &sky).unwrap();
    let commands = proposed(folder.path());
    assert_eq!(commands, ["ltm-pack groups.exr -o groups.ltc", "ltm-pack 'room_{light}.exr' -o room.ltc"]);
    commands.iter().for_each(|command| in_shell(folder.path(), command));
    assert!(at("groups.ltc").is_file() && at("room.ltc").is_file());
}

#[test]
fn a_blend_file_is_exported_by_blender_itself() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("set.blend"), "").unwrap();
    let commands = proposed(folder.path());
    let begins =
        "blender --background set.blend --python-expr 'import bpy; bpy.ops.export_scene.gltf(filepath=\"set.glb\"";
    assert!(commands[0].starts_with(begins), "{commands:?}");
    fs::write(folder.path().join("set.glb"), "").unwrap();
    assert_eq!(proposed(folder.path()), ["ltm render set.glb --pack"]);
}

#[test]
fn the_doctor_says_one_line_of_each_thing_and_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let mut doctor = program::command(folder.path(), "ltm", &["doctor"]);
    let output = doctor.env("PATH", "").env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").output().unwrap();
    let text = said(output);
    let line = |label: &str| {
        let found: Vec<&str> = text.lines().filter(|line| line.split_whitespace().next() == Some(label)).collect();
        assert_eq!(found.len(), 1, "{label}: {text}");
        found[0].to_owned()
    };
    assert!(line("ltm").contains(env!("CARGO_PKG_VERSION")), "{text}");
    for label in ["system", "processor", "disk", "gpu"] {
        line(label);
    }
    assert!(line("python").ends_with("not found") && line("blender").ends_with("not found"), "{text}");
    assert!(line("ltm-pack").ends_with(env!("CARGO_PKG_VERSION")), "the one beside ltm, without a path: {text}");
    let missing: Vec<&str> = text.lines().filter(|line| line.starts_with("missing")).collect();
    for thing in ["import ltm", ".blend files"] {
        assert!(missing.iter().any(|line| line.contains(thing)), "{text}");
    }
    #[cfg(target_os = "linux")]
    {
        assert!(line("display").contains("none") && missing.iter().any(|line| line.contains("ltm view")), "{text}");
        let memory = fs::read_to_string("/proc/meminfo").unwrap();
        let total = memory.lines().next().unwrap().split_whitespace().nth(1).unwrap().parse::<f64>().unwrap();
        assert!(line("memory").contains(&format!("{:.1} GiB", total / (1 << 20) as f64)), "{text}");
    }
}

#[test]
fn every_shell_gets_completions_of_all_programs() {
    let folder = tempfile::tempdir().unwrap();
    for (shell, of_pack) in [("bash", "-o default ltm-pack"), ("zsh", "#compdef ltm-pack"), ("fish", "-c ltm-pack")] {
        let script = said(run(folder.path(), "ltm", &["completions", shell]));
        assert!(script.contains(of_pack) && script.contains("relight") && script.contains("keep-noise"), "{shell}");
    }
    let refused = run(folder.path(), "ltm", &["completions", "word"]);
    assert_eq!(refused.status.code(), Some(2));
}

/// Where there is a bash, the script does what it is for.
#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "wants a bash")]
fn bash_completes_commands_and_options_from_the_script() {
    let folder = tempfile::tempdir().unwrap();
    let script = said(run(folder.path(), "ltm", &["completions", "bash"]));
    fs::write(folder.path().join("ltm.bash"), script).unwrap();
    let complete = |words: &str, current: usize| {
        let line = format!(
            "source ./ltm.bash; COMP_WORDS=({words}); COMP_CWORD={current}; _ltm ltm \"${{COMP_WORDS[{current}]}}\" \
             \"${{COMP_WORDS[{}]}}\"; echo \"${{COMPREPLY[@]}}\"",
            current - 1
        );
        said(Command::new("bash").args(["--norc", "-c", &line]).current_dir(folder.path()).output().unwrap())
    };
    assert_eq!(complete("ltm rel", 1).trim(), "relight");
    assert_eq!(complete("ltm render --sam", 2).trim(), "--samples");
}

#[test]
fn man_pages_are_written_for_the_programs_and_their_commands() {
    let folder = tempfile::tempdir().unwrap();
    for program in ["ltm", "ltm-pack", "ltm-unpack"] {
        said(run(folder.path(), program, &["--write-man-pages", "man"]));
    }
    let page = |name: &str| fs::read_to_string(folder.path().join("man").join(name)).unwrap();
    assert!(page("ltm.1").contains("doctor") && page("ltm-render.1").contains("samples"));
    assert!(page("ltm-pack.1").contains("keep\\-noise") && page("ltm-unpack.1").starts_with(".ie"));
    assert!(!folder.path().join("man/ltm-view.1").exists(), "the window writes its own");
}
