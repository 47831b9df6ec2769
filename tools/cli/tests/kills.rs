//! The real programs, killed at random instants: nothing half-written ever stands under a final name, the same command goes on and
//! ends with the same bytes, and nothing is left behind.
//!
//! `LTM_KILLS=1000 cargo test --release -p ltm-cli --test kills -- --nocapture` kills that often, over all commands.

mod program;
mod room;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use room::write_room;

/// Processes that are killed while they run, over all commands, where `LTM_KILLS` does not say otherwise.
const KILLS: usize = 39;

const SETTINGS: &str = r#"
[render]
samples_per_pixel = 48
block_side = 8

[[light]]
material = "lamp"
texels = [4, 4]

[[light]]
kind = "point"
name = "point_1"
position = [0.5, 1.5, 0.5]
emission = [1.0, 2.0, 3.0]

[[light]]
kind = "point"
name = "point_2"
position = [-0.5, 1.5, 0.5]
emission = [3.0, 2.0, 1.0]
"#;

/// A command that writes `outputs` from files that are there, and what it may say when it is run again over a finished output.
struct Case {
    program: &'static str,
    arguments: &'static [&'static str],
    outputs: &'static [&'static str],
    /// Copied to the first output before the first run: what the command changes in place.
    begins_as: Option<&'static str>,
}

const fn case(program: &'static str, arguments: &'static [&'static str], outputs: &'static [&'static str]) -> Case {
    Case { program, arguments, outputs, begins_as: None }
}

const CASES: [Case; 13] = [
    case("ltm", &["render", "room.toml", "-o", "o.ltm"], &["o.ltm"]),
    case("ltm", &["render", "room.toml", "-o", "o.ltc", "--pack"], &["o.ltc"]),
    case("ltm-pack", &["in.ltm", "-o", "o.ltc"], &["o.ltc"]),
    case("ltm-pack", &["in.ltm", "-o", "o.ltc", "--target", "40dB", "--verify"], &["o.ltc"]),
    case("ltm-pack", &["in.exr", "-o", "o.ltc"], &["o.ltc"]),
    case("ltm-unpack", &["in.ltc", "-o", "o.ltm"], &["o.ltm"]),
    case("ltm-unpack", &["in.ltc", "-o", "o.exr"], &["o.exr"]),
    case("ltm-unpack", &["in.ltc", "-o", "o.npy"], &["o.npy"]),
    case("ltm-unpack", &["in.ltc", "-o", "o_{light}.exr"], &["o_lamp.exr", "o_point_1.exr", "o_point_2.exr"]),
    case("ltm", &["merge", "-o", "o.ltm", "a.ltm", "b.ltm"], &["o.ltm"]),
    case("ltm", &["merge", "-o", "o.ltc", "in.ltc"], &["o.ltc"]),
    case("ltm", &["relight", "in.ltc", "-o", "o.png", "--device", "cpu"], &["o.png"]),
    Case {
        program: "ltm",
        arguments: &["repair", "o.ltm", "room.toml"],
        outputs: &["o.ltm"],
        begins_as: Some("damaged.ltm"),
    },
];

/// A generator of shares between 0 and 1 that is the same in every run.
struct Shares(u64);

impl Shares {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f64 / (1u64 << 24) as f64
    }
}

fn command(folder: &Path, program: &str, arguments: &[&str]) -> Command {
    let mut command = program::command(folder, program, arguments);
    command.stdout(Stdio::null()).stderr(Stdio::null());
    command
}

fn succeed(folder: &Path, program: &str, arguments: &[&str]) {
    let output = command(folder, program, arguments).stderr(Stdio::piped()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{program} {arguments:?}: {said}");
}

/// What every command reads.
fn prepare(folder: &Path) {
    write_room(folder, SETTINGS);
    succeed(folder, "ltm", &["render", "room.toml", "-o", "in.ltm"]);
    succeed(folder, "ltm-pack", &["in.ltm", "-o", "in.ltc"]);
    succeed(folder, "ltm-unpack", &["in.ltc", "-o", "in.exr"]);
    succeed(folder, "ltm", &["render", "room.toml", "-o", "a.ltm", "--blocks", "0..8"]);
    succeed(folder, "ltm", &["render", "room.toml", "-o", "b.ltm", "--blocks", "8..15"]);
    let mut bytes = fs::read(folder.join("in.ltm")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle..middle + 4096].fill(0xa5);
    fs::write(folder.join("damaged.ltm"), bytes).unwrap();
}

/// Every file of a folder with its bytes.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    entries.map(|entry| (entry.file_name().into_string().unwrap(), fs::read(entry.path()).unwrap())).collect()
}

fn begin(folder: &Path, case: &Case) {
    if let Some(from) = case.begins_as {
        fs::copy(folder.join(from), folder.join(case.outputs[0])).unwrap();
    }
}

fn clear(folder: &Path, case: &Case) {
    for output in case.outputs {
        fs::remove_file(folder.join(output)).unwrap();
    }
}

/// Runs a case and kills it after a while; whether it was running still, and how it ended if not.
fn killed(folder: &Path, case: &Case, after: Duration) -> Result<(), ExitStatus> {
    let mut child = command(folder, case.program, case.arguments).spawn().unwrap();
    std::thread::sleep(after);
    child.kill().unwrap();
    let status = child.wait().unwrap();
    if status.code().is_none() { Ok(()) } else { Err(status) }
}

#[test]
fn programs_killed_at_any_instant_lose_nothing_and_show_nothing_half_written() {
    let kills_wanted = std::env::var("LTM_KILLS").map_or(KILLS, |text| text.parse().expect("LTM_KILLS is a number"));
    let per_case = kills_wanted.div_ceil(CASES.len());
    let folder = tempfile::tempdir().unwrap();
    let folder: PathBuf = folder.path().to_owned();
    prepare(&folder);
    let inputs = files(&folder);
    let mut shares = Shares(std::env::var("LTM_KILLS_SEED").map_or(1, |text| text.parse().expect("a number")));
    let mut all_kills = 0;
    for case in &CASES {
        let what = format!("{} {}", case.program, case.arguments.join(" "));
        begin(&folder, case);
        let started = Instant::now();
        succeed(&folder, case.program, case.arguments);
        let whole_run = started.elapsed();
        let finished = files(&folder);
        assert_eq!(finished.len(), inputs.len() + case.outputs.len(), "{what} leaves {:?}", finished.keys());
        clear(&folder, case);
        let (mut kills, mut rounds) = (0, 0);
        while kills < per_case && rounds < 20 * per_case {
            rounds += 1;
            begin(&folder, case);
            // Some rounds are killed again and again before the command may end.
            let tries = 1 + (shares.next() * 3.0) as usize;
            for _ in 0..tries {
                match killed(&folder, case, whole_run.mul_f64(1.1 * shares.next())) {
                    Ok(()) => kills += 1,
                    // Ended before the kill: done, or refused since an earlier run of this round was done.
                    Err(status) => assert!(matches!(status.code(), Some(0 | 3)), "{what}: {status}"),
                }
                for output in case.outputs {
                    let Ok(bytes) = fs::read(folder.join(output)) else { continue };
                    let in_place = case.begins_as.is_some();
                    assert!(in_place || bytes == finished[*output], "{what}: a wrong {output} after {kills} kills");
                }
            }
            let last = command(&folder, case.program, case.arguments).status().unwrap();
            assert!(matches!(last.code(), Some(0 | 3)), "{what}: {last} when it was run again");
            let now = files(&folder);
            assert_eq!(now.keys().collect::<Vec<_>>(), finished.keys().collect::<Vec<_>>(), "{what}: left behind");
            let wrong: Vec<_> = now.iter().filter(|(name, bytes)| finished[*name] != **bytes).map(|(n, _)| n).collect();
            assert!(wrong.is_empty(), "{what}: {wrong:?} differ after {kills} kills");
            clear(&folder, case);
        }
        eprintln!("{what}: {kills} kills in {rounds} rounds");
        assert!(kills >= per_case, "{what}: only {kills} kills fell into its run");
        all_kills += kills;
    }
    eprintln!("{all_kills} kills over {} commands: nothing lost, nothing half-written", CASES.len());
}
