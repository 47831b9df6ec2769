//! Files as the programs treat them: interruptions, damage, competing programs, permissions, pipes.

mod program;
mod room;

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use ltm::matrix::{BlockId, BlockSource, TracedBlock};
use ltm::store::StoreReader;
use room::write_room;
use tempfile::TempDir;

const LIGHTS: &str = "
[render]
samples_per_pixel = 4
block_side = 8

[[light]]
material = \"lamp\"
texels = [4, 4]
";

fn command(folder: &Path, program: &str, arguments: &[&str]) -> Command {
    let mut command = program::command(folder, program, arguments);
    command.stdin(Stdio::null());
    command
}

fn run(folder: &Path, program: &str, arguments: &[&str]) -> Output {
    command(folder, program, arguments).output().unwrap()
}

fn said(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

fn succeed(folder: &Path, program: &str, arguments: &[&str]) -> String {
    let output = run(folder, program, arguments);
    assert!(output.status.success(), "{program} {arguments:?}: {}", said(&output));
    said(&output)
}

/// Runs a program that must end with this exit code, having said all of `words`.
fn end_with(folder: &Path, program: &str, arguments: &[&str], code: i32, words: &[&str]) {
    let output = run(folder, program, arguments);
    let text = said(&output);
    assert_eq!(output.status.code(), Some(code), "{program} {arguments:?}: {text}");
    words.iter().for_each(|word| assert!(text.contains(word), "'{word}' is not in: {text}"));
}

/// A folder with a room, its matrix and its container.
fn room() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_room(folder.path(), LIGHTS);
    succeed(folder.path(), "ltm", &["render", "room.toml"]);
    succeed(folder.path(), "ltm-pack", &["room.ltm"]);
    folder
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn flip(path: &Path, at: usize) {
    let mut bytes = fs::read(path).unwrap();
    bytes[at] ^= 0xff;
    fs::write(path, bytes).unwrap();
}

/// Where a byte of a block's tile stands.
fn tile_byte(path: &Path) -> usize {
    StoreReader::open(path).unwrap().layout().slot_offset(BlockId(9)) as usize + 5
}

fn signal(child: &Child, name: &str) {
    assert!(Command::new("kill").args([name, &child.id().to_string()]).status().unwrap().success());
}

/// Waits for a process to end, and fails if that takes longer.
fn ended_within(child: &mut Child, limit: Duration, what: &str) -> i32 {
    let begun = Instant::now();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return status.code().unwrap_or_else(|| panic!("{what} was ended by {status}"));
        }
        if begun.elapsed() > limit {
            child.kill().unwrap();
            panic!("{what} went on for {limit:?}");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Waits until a file of that name holds something.
fn wait_for(path: &Path) {
    let begun = Instant::now();
    while fs::metadata(path).map_or(0, |found| found.len()) == 0 {
        assert!(begun.elapsed() < Duration::from_secs(60), "{} never came", path.display());
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Waits until a program handles that signal itself (`SigCgt` of proc(5); a while, where a system has no such file).
fn wait_for_handler(child: &Child, signal: u32) {
    let begun = Instant::now();
    loop {
        let Ok(status) = fs::read_to_string(format!("/proc/{}/status", child.id())) else {
            return std::thread::sleep(Duration::from_millis(100));
        };
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap();
        if u64::from_str_radix(caught.trim(), 16).unwrap() >> (signal - 1) & 1 == 1 {
            return;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "signal {signal} is never handled");
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn an_interrupted_program_exits_with_130_and_the_same_command_goes_on() {
    let folder = room();
    let at = folder.path();
    let long = ["render", "room.toml", "-o", "long.ltm", "--samples", "40000"];
    for (name, number) in [("-INT", 2), ("-TERM", 15)] {
        let mut child = command(at, "ltm", &long).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
        wait_for(&at.join("long.ltm.part"));
        wait_for_handler(&child, number);
        std::thread::sleep(Duration::from_millis(100));
        signal(&child, name);
        assert_eq!(ended_within(&mut child, Duration::from_secs(60), "render"), 130);
        assert!(at.join("long.ltm.part").exists() && !at.join("long.ltm").exists());
    }
    succeed(at, "ltm", &long);
    assert!(!at.join("long.ltm.part").exists());
}

#[test]
fn a_second_interruption_ends_a_program_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    // One block that takes minutes.
    write_room(at, &LIGHTS.replace("block_side = 8", "block_side = 64"));
    let long = ["render", "room.toml", "--samples", "1000000"];
    let mut child = command(at, "ltm", &long).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
    wait_for(&at.join("room.ltm.part"));
    std::thread::sleep(Duration::from_millis(300));
    signal(&child, "-INT");
    std::thread::sleep(Duration::from_millis(300));
    assert!(child.try_wait().unwrap().is_none(), "the block at hand is finished after the first");
    signal(&child, "-INT");
    assert_eq!(ended_within(&mut child, Duration::from_secs(1), "render"), 130);
}

#[test]
fn outputs_have_the_permissions_that_the_umask_leaves() {
    let folder = room();
    let at = folder.path();
    let shell = |umask: &str, program: &str, arguments: &str| {
        let path = program::path(program);
        let script = format!("umask {umask} && {path} {arguments}");
        let output = Command::new("sh").args(["-c", &script]).current_dir(at).output().unwrap();
        assert!(output.status.success(), "{}", said(&output));
    };
    for (umask, expected) in [("077", 0o600), ("022", 0o644), ("002", 0o664)] {
        let jobs = [
            ("ltm", "render room.toml -o o.ltm"),
            ("ltm-pack", "room.ltm -o o.ltc"),
            ("ltm-unpack", "room.ltc -o o.exr"),
            ("ltm-unpack", "room.ltc -o o.npy"),
            ("ltm", "relight room.ltc --device cpu -o o.png"),
            ("ltm", "merge -o p.ltc room.ltc"),
        ];
        for (program, arguments) in jobs {
            shell(umask, program, arguments);
        }
        for output in ["o.ltm", "o.ltc", "o.exr", "o.npy", "o.png", "p.ltc"] {
            let mode = fs::metadata(at.join(output)).unwrap().permissions().mode() & 0o777;
            assert_eq!(mode, expected, "{output} under umask {umask}: {mode:o}");
            fs::remove_file(at.join(output)).unwrap();
        }
    }
}

#[test]
fn a_damaged_container_is_relit_only_on_demand() {
    let folder = room();
    let at = folder.path();
    // Behind the header of 64 bytes stand the chunks.
    flip(&at.join("room.ltc"), 100);
    let relight = ["relight", "room.ltc", "--device", "cpu", "-o", "o.exr"];
    end_with(at, "ltm", &relight, 4, &["damaged", "--allow-damage"]);
    assert!(!at.join("o.exr").exists());
    let budget = [&relight[..], &["--memory", "64MiB"]].concat();
    end_with(at, "ltm", &budget, 4, &["damaged"]);
    assert!(!at.join("o.exr").exists());
    end_with(at, "ltm", &[&relight[..], &["--allow-damage"]].concat(), 4, &["block"]);
    assert!(at.join("o.exr").exists());
}

#[test]
fn merge_as_a_program_says_what_is_missing_and_what_is_damaged() {
    let folder = room();
    let at = folder.path();
    succeed(at, "ltm", &["render", "room.toml", "-o", "a.ltm", "--blocks", "0..8"]);
    succeed(at, "ltm", &["render", "room.toml", "-o", "b.ltm", "--blocks", "8..15"]);
    end_with(at, "ltm", &["merge", "-o", "all.ltm", "a.ltm"], 3, &["7 blocks are missing", "8", "14", "merge"]);
    assert!(at.join("all.ltm").exists(), "the next merge adds to it");
    end_with(at, "ltm", &["merge", "-o", "part.ltm", "a.ltm", "--partial"], 0, &["8 blocks copied"]);
    succeed(at, "ltm", &["merge", "-o", "all.ltm", "b.ltm"]);
    assert!(fs::read(at.join("all.ltm")).unwrap() == fs::read(at.join("room.ltm")).unwrap());
    flip(&at.join("all.ltm"), tile_byte(&at.join("room.ltm")));
    end_with(at, "ltm", &["verify", "all.ltm"], 4, &["damaged"]);
    fs::copy(at.join("all.ltm"), at.join("damaged.ltm")).unwrap();
    end_with(at, "ltm", &["merge", "-o", "new.ltm", "damaged.ltm"], 4, &["damaged: damaged.ltm"]);
    end_with(at, "ltm", &["merge", "-o", "all.ltm", "a.ltm", "b.ltm"], 0, &["1 damaged block replaced"]);
    assert!(fs::read(at.join("all.ltm")).unwrap() == fs::read(at.join("room.ltm")).unwrap());
    end_with(at, "ltm", &["merge", "-o", "all.ltc", "room.ltc"], 0, &["15 blocks"]);
    end_with(at, "ltm", &["merge", "-o", "all.ltc", "room.ltc"], 3, &["exists already"]);
}

#[test]
fn repair_as_a_program_makes_the_file_whole_again() {
    let folder = room();
    let at = folder.path();
    let whole = fs::read(at.join("room.ltm")).unwrap();
    flip(&at.join("room.ltm"), tile_byte(&at.join("room.ltm")));
    end_with(at, "ltm", &["repair", "room.ltm", "room.toml", "--samples", "5"], 3, &["another scene"]);
    end_with(at, "ltm", &["repair", "room.ltm", "room.toml"], 0, &["1 blocks rendered again"]);
    assert!(fs::read(at.join("room.ltm")).unwrap() == whole);
    // One of another seed.
    succeed(at, "ltm", &["render", "room.toml", "--seed", "5", "-o", "seed.ltm"]);
    let whole = fs::read(at.join("seed.ltm")).unwrap();
    flip(&at.join("seed.ltm"), tile_byte(&at.join("seed.ltm")));
    end_with(at, "ltm", &["repair", "seed.ltm", "room.toml"], 3, &["another scene", "--seed"]);
    end_with(at, "ltm", &["repair", "seed.ltm", "room.toml", "--seed", "5"], 0, &["1 blocks rendered again"]);
    assert!(fs::read(at.join("seed.ltm")).unwrap() == whole);
}

#[test]
fn a_preview_comes_before_a_pack_as_before_a_matrix() {
    let folder = room();
    let at = folder.path();
    succeed(at, "ltm", &["render", "room.toml", "--pack", "-o", "p.ltc", "--preview=only"]);
    assert!(at.join("p-preview.png").exists() && !at.join("p.ltc").exists());
    // What is in the way is said before a pilot, and nothing of it is kept.
    let render = ["render", "room.toml", "--pack", "-o", "room.ltc", "--error", "5%"];
    end_with(at, "ltm", &render, 3, &["exists already"]);
    assert!(!at.join("room.ltc.samples").exists());
}

#[test]
fn two_programs_with_one_output_leave_the_file_of_one() {
    let folder = room();
    let at = folder.path();
    succeed(at, "ltm-unpack", &["room.ltc", "-o", "all.exr"]);
    succeed(at, "ltm-unpack", &["room.ltc", "-o", "crop.exr", "--crop", "0,0,16x16"]);
    let (all, crop) = (fs::read(at.join("all.exr")).unwrap(), fs::read(at.join("crop.exr")).unwrap());
    let before = names(at).len();
    for delay in 0..12 {
        let mut first = command(at, "ltm-unpack", &["room.ltc", "-o", "o.exr"]);
        let mut first = first.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(3 * delay));
        let arguments = ["room.ltc", "-o", "o.exr", "--crop", "0,0,16x16", "--force"];
        assert!(run(at, "ltm-unpack", &arguments).status.success(), "it may replace what is there");
        let first = first.wait().unwrap().code();
        let found = fs::read(at.join("o.exr")).unwrap();
        // The first may not replace a file that came meanwhile: then it says so.
        assert!(matches!(first, Some(0 | 3)), "{first:?}");
        assert!(found == crop || (found == all && first == Some(0)), "a mixture, or another's file");
        fs::remove_file(at.join("o.exr")).unwrap();
        assert_eq!(names(at).len(), before, "{:?}", names(at));
    }
}

#[test]
fn pipes_and_folders_are_refused_and_not_waited_for() {
    let folder = room();
    let at = folder.path();
    for name in ["p.toml", "p.ltm", "p.ltc", "p.exr", "p.npy", "p.part"] {
        assert!(Command::new("mkfifo").arg(at.join(name)).status().unwrap().success());
    }
    fs::create_dir(at.join("folder.ltc")).unwrap();
    let commands: [(&str, &[&str]); 12] = [
        ("ltm", &["render", "p.toml"]),
        ("ltm", &["relight", "p.ltc", "-o", "o.png"]),
        ("ltm", &["relight", "p.ltm", "-o", "o.png"]),
        ("ltm", &["relight", "room.ltc", "--lighting", "p.toml", "-o", "o.png"]),
        ("ltm", &["info", "p.ltc"]),
        ("ltm", &["verify", "p.ltm"]),
        ("ltm", &["merge", "-o", "o.ltc", "p.ltc"]),
        ("ltm-pack", &["p.ltm", "-o", "o.ltc"]),
        ("ltm-pack", &["p.exr", "-o", "o.ltc"]),
        ("ltm-pack", &["p.npy", "-o", "o.ltc"]),
        ("ltm-pack", &["room.ltm", "-o", "folder.ltc", "--force"]),
        ("ltm-unpack", &["room.ltc", "-o", "missing/o.exr"]),
    ];
    for (program, arguments) in commands {
        let what = format!("{program} {arguments:?}");
        let mut child = command(at, program, arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        assert_eq!(ended_within(&mut child, Duration::from_secs(20), &what), 3, "{what}");
    }
    assert!(names(at).iter().all(|name| !name.ends_with(".ltm-tmp0") && !name.ends_with(".spill")), "{:?}", names(at));
}

/// What a file names outside of its folder is opened only if the user says so, or has put it into the library's folder.
#[test]
fn files_outside_of_a_folder_need_the_flag_or_the_library() {
    let folder = room();
    let at = folder.path();
    fs::create_dir(at.join("from afar")).unwrap();
    let scene = fs::read_to_string(at.join("room.toml")).unwrap();
    fs::write(at.join("from afar/room.toml"), scene.replace("room.obj", "../room.obj")).unwrap();
    let render = ["render", "from afar/room.toml", "-o", "o.ltm"];
    end_with(at, "ltm", &render, 3, &["room.obj", "outside", "--allow-outside"]);
    assert!(!at.join("o.ltm").exists() && !at.join("o.ltm.part").exists());
    succeed(at, "ltm", &[&render[..], &["--allow-outside"]].concat());
    assert!(fs::read(at.join("o.ltm")).unwrap() == fs::read(at.join("room.ltm")).unwrap());
    let repair = ["repair", "o.ltm", "from afar/room.toml"];
    end_with(at, "ltm", &repair, 3, &["outside"]);
    end_with(at, "ltm", &[&repair[..], &["--allow-outside"]].concat(), 0, &["0 blocks"]);
    for geometry in ["room.obj", "../room.obj"] {
        fs::write(at.join("from afar/room.toml"), scene.replace("room.obj", geometry)).unwrap();
        let mut render = command(at, "ltm", &["render", "from afar/room.toml", "-o", "o.ltm", "--force"]);
        let output = render.env("LTM_SCENES", at).output().unwrap();
        assert!(output.status.success(), "{}", said(&output));
    }
    succeed(at, "ltm-unpack", &["room.ltc", "-o", "pattern.exr", "--relit"]);
    fs::write(at.join("from afar/l.toml"), "[[light]]\nname = 'lamp'\nimage = { file = '../pattern.exr' }\n").unwrap();
    let relight = ["relight", "room.ltc", "--device", "cpu", "-o", "o.exr", "-l", "from afar/l.toml"];
    end_with(at, "ltm", &relight, 3, &["pattern.exr", "outside", "--allow-outside"]);
    succeed(at, "ltm", &[&relight[..], &["--allow-outside"]].concat());
    let share = ["share", "room.ltc", "--single", "-o", "o.html", "-l", "from afar/l.toml"];
    let info = ["info", "room.ltc", "--json", "-l", "from afar/l.toml"];
    for asked in [&share[..], &info] {
        end_with(at, "ltm", asked, 3, &["pattern.exr", "outside", "--allow-outside"]);
        succeed(at, "ltm", &[asked, &["--allow-outside"]].concat());
    }
}

#[test]
fn options_that_would_be_passed_over_are_refused() {
    let folder = room();
    let at = folder.path();
    fs::create_dir(at.join("folder.ltm")).unwrap();
    for option in [["--block-side", "16"], ["--layers", "x"]] {
        end_with(at, "ltm-pack", &["room.ltm", "-o", "o.ltc", option[0], option[1]], 3, &[option[0], "leave it out"]);
    }
    end_with(at, "ltm", &["merge", "-o", "folder.ltm", "room.ltm"], 3, &["folder.ltm", "is a folder"]);
    assert!(!at.join("o.ltc").exists());
    // A size is an aim: what misses it says by how much, and whether anything is left to leave out.
    end_with(
        at,
        "ltm-pack",
        &["room.ltm", "-o", "o.ltc", "--target", "1B", "--force"],
        0,
        &["\nthe file has", "more than the target", "nothing is left"],
    );
}

/// Whatever the system refuses, and when: one line and the exit code of memory, and no abort with a trace.
#[test]
fn a_program_that_is_refused_memory_says_so_in_one_line() {
    let folder = room();
    let at = folder.path();
    let mut refused = 0;
    for mebibytes in [60, 80, 150, 200, 300, 6000] {
        let script =
            format!("ulimit -v {} && {} room.ltm -o o.ltc --force", mebibytes << 10, env!("CARGO_BIN_EXE_ltm-pack"));
        let output = Command::new("sh").args(["-c", &script]).current_dir(at).output().unwrap();
        let text = said(&output);
        match output.status.code() {
            Some(0) => {}
            Some(6) => {
                refused += 1;
                assert!(text.contains("memory") && !text.contains("backtrace"), "{mebibytes} MiB: {text}");
            }
            code => panic!("{mebibytes} MiB: {code:?}: {text}"),
        }
    }
    assert!(refused > 0, "no run was refused memory");
    succeed(at, "ltm-pack", &["room.ltm", "-o", "o.ltc", "--force"]);
    assert!(fs::read(at.join("o.ltc")).unwrap() == fs::read(at.join("room.ltc")).unwrap());
}

/// Options of packing and rendering do what they say, seen in the files.
#[test]
fn options_of_programs_reach_the_files() {
    let folder = room();
    let at = folder.path();
    let packed = |arguments: &[&str]| {
        succeed(at, "ltm-pack", &[&["room.ltm", "-o", "o.ltc", "--force"], arguments].concat());
        fs::read(at.join("o.ltc")).unwrap()
    };
    let random = |seed: &str| packed(&["--method", "algorithm1", "--rank", "4", "--compression-seed", seed]);
    assert!(random("1") == random("1") && random("1") != random("2"));
    assert!(packed(&[]) != packed(&["--prior", "flat"]));
    assert!(succeed(at, "ltm", &["info", "o.ltc"]).contains("prior flat"));
    let mut sizes = Vec::new();
    for precision in ["f32", "bf16", "f16"] {
        succeed(at, "ltm", &["render", "room.toml", "-o", "p.ltm", "--force", "--precision", precision]);
        assert!(succeed(at, "ltm", &["info", "p.ltm"]).contains(precision), "{precision}");
        sizes.push(fs::metadata(at.join("p.ltm")).unwrap().len());
    }
    assert!(sizes[1] < sizes[0] && sizes[2] == sizes[1], "{sizes:?}");
}

/// Another seed gives other samples, and the fused way makes of them what the stored way does.
#[test]
fn a_seed_is_that_of_the_samples() {
    let folder = room();
    let at = folder.path();
    let rendered = |seed: &str| {
        succeed(at, "ltm", &["render", "room.toml", "-o", "s.ltm", "--force", "--seed", seed]);
        let store = StoreReader::open(&at.join("s.ltm")).unwrap();
        let mut entries = Vec::new();
        for block in store.job().shape.blocks() {
            let mut traced = TracedBlock::default();
            store.read_block(block, &mut traced).unwrap();
            entries.extend_from_slice(traced.block.entries());
        }
        assert!(entries.iter().any(|&entry| entry > 0.0));
        entries
    };
    assert!(rendered("0") != rendered("7"));
    assert!(rendered("7") == rendered("7"));
    succeed(at, "ltm-pack", &["s.ltm"]);
    succeed(at, "ltm", &["render", "room.toml", "-o", "fused.ltc", "--pack", "--seed", "7"]);
    assert!(fs::read(at.join("s.ltc")).unwrap() == fs::read(at.join("fused.ltc")).unwrap());
}

#[test]
fn a_merge_heeds_an_interruption() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    // 960 blocks, each made durable when it is copied.
    write_room(at, &LIGHTS.replace("block_side = 8", "block_side = 1"));
    succeed(at, "ltm", &["render", "room.toml"]);
    let merge = ["merge", "-o", "o.ltm", "room.ltm"];
    let mut interrupted = 0;
    for delay in [5, 10, 20, 40, 80] {
        let mut child = command(at, "ltm", &merge).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(delay));
        signal(&child, "-INT");
        let code = child.wait().unwrap().code();
        assert!(matches!(code, Some(0 | 130)) || code.is_none(), "{code:?}");
        if code == Some(130) {
            interrupted += 1;
            assert!(!at.join("o.ltm").exists());
        }
        let _ = fs::remove_file(at.join("o.ltm"));
    }
    assert!(interrupted > 0, "no interruption was heeded");
    succeed(at, "ltm", &merge);
    assert!(fs::read(at.join("o.ltm")).unwrap() == fs::read(at.join("room.ltm")).unwrap());
}

#[test]
fn no_program_gives_a_file_the_name_of_another_kind() {
    let folder = room();
    let at = folder.path();
    let before = names(at);
    end_with(at, "ltm-pack", &["room.ltm", "-o", "y.ltm"], 3, &["y.ltm", "a container is written", "name it x.ltc"]);
    end_with(at, "ltm", &["render", "room.toml", "-o", "y.LTC"], 3, &["y.LTC", "a matrix is written", "--pack"]);
    end_with(at, "ltm", &["render", "room.toml", "--pack", "-o", "y.ltm"], 3, &["y.ltm", "a container is written"]);
    assert_eq!(names(at), before);
}
