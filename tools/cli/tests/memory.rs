//! Memory of the programs as it is seen from outside, against what they were allowed.

#![cfg(target_os = "linux")]

mod program;
mod room;

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use room::write_room;

fn command(folder: &Path, program: &str, arguments: &[&str]) -> Command {
    let mut command = program::command(folder, program, arguments);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

fn succeed(folder: &Path, program: &str, arguments: &[&str]) {
    assert!(command(folder, program, arguments).status().unwrap().success(), "{program} {arguments:?}");
}

/// Runs a program that must succeed; the largest anonymous memory that was seen of it, in MiB.
fn peak_of(folder: &Path, program: &str, arguments: &[&str]) -> f64 {
    let mut child = command(folder, program, arguments).spawn().unwrap();
    let status_file = format!("/proc/{}/status", child.id());
    let mut peak_kibibytes = 0.0f64;
    loop {
        // Gone from an ended process, which is no fault.
        let text = fs::read_to_string(&status_file).unwrap_or_default();
        if let Some(line) = text.lines().find_map(|line| line.strip_prefix("RssAnon:")) {
            peak_kibibytes = peak_kibibytes.max(line.trim().trim_end_matches(" kB").parse().unwrap());
        }
        if let Some(status) = child.try_wait().unwrap() {
            assert!(status.success(), "{program} {arguments:?}: {status}");
            assert!(peak_kibibytes > 0.0, "nothing was seen of {program} {arguments:?}");
            return peak_kibibytes / 1024.0;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Half of the lamps go out within a second.
const LOOK: &str = r#"
[[look]]
name = "all"
[[look]]
name = "half"
[[look.light]]
name = "p1*"
on = false
[[key]]
time_secs = 0
look = "all"
[[key]]
time_secs = 1
look = "half"
"#;

/// Files and images of 24 lights, which together take 84 MiB, are read and written in less.
#[test]
fn what_is_allowed_is_kept_however_many_lights_there_are() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let light = |i: u32| {
        let (x, z) = (f64::from(i % 6) / 5.0 - 0.5, f64::from(i / 6) / 3.0 - 0.5);
        format!("[[light]]\nkind = \"point\"\nname = \"p{i}\"\nposition = [{x}, 1.5, {z}]\n")
    };
    write_room(at, &format!("[render]\nsamples_per_pixel = 1\n{}", (0..24).map(light).collect::<String>()));
    succeed(at, "ltm", &["render", "room.toml", "--size", "640x480"]);
    succeed(at, "ltm-pack", &["room.ltm", "--denoise", "off"]);
    succeed(at, "ltm", &["render", "room.toml", "--size", "640x480", "--samples", "2", "-o", "known.ltm"]);
    fs::write(at.join("look.toml"), LOOK).unwrap();
    let jobs: [(f64, &str, &[&str]); 11] = [
        (64.0, "ltm-unpack", &["room.ltc", "-o", "all.exr", "--force"]),
        (40.0, "ltm-unpack", &["room.ltc", "-o", "one_{light}.exr", "--force"]),
        (40.0, "ltm-unpack", &["room.ltc", "-o", "back.ltm", "--force"]),
        (48.0, "ltm-pack", &["all.exr", "-o", "layers.ltc", "--force"]),
        (48.0, "ltm-pack", &["one_{light}.exr", "-o", "files.ltc", "--force"]),
        (72.0, "ltm", &["relight", "room.ltc", "--device", "cpu", "-o", "lights.exr", "--layers", "lights"]),
        (40.0, "ltm", &["relight", "room.ltm", "-o", "raw.exr"]),
        (40.0, "ltm", &["relight", "room.ltc", "--device", "cpu", "-o", "paged.exr"]),
        (
            48.0,
            "ltm",
            &["relight", "room.ltc", "--device", "cpu", "-l", "look.toml", "--fps", "4", "-o", "frame_##.png"],
        ),
        (64.0, "ltm", &["relight", "known.ltm", "-o", "passes.exr", "--layers", "passes"]),
        (32.0, "ltm", &["merge", "-o", "merged.ltc", "room.ltc", "--force"]),
    ];
    for (allowed, program, arguments) in jobs {
        let peak = peak_of(at, program, &[arguments, &["--memory", &format!("{allowed}MiB")]].concat());
        assert!(peak <= allowed, "{program} {arguments:?} took {peak:.1} MiB of {allowed} MiB");
    }
}
