//! The worked example of the guide: what the programs print when it is run as it stands there.

use std::path::Path;
use std::process::Command;

use super::StudyReport;
use super::bench::{Bench, CONFERENCE_LAMPS, scene_text};
use super::table::Table;
use ltm::error::{Error, Result};
use ltm::files::write_file;

const NOTE: &str = "What the programs print, line by line. The matrix is rendered first, by `ltm render conference-24.toml --samples 32`.";

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let mut notes = bench.notes(&[NOTE]);
    let runs = !bench.quick && bench.has(CONFERENCE_LAMPS);
    if !runs {
        notes.push("Not run: quickly, or `LTM_SCENES` names no folder with the Conference Room.".to_owned());
    }
    let mut table = Table::new("The worked example", notes, &[("command", 0), ("line", 0)]);
    let printed = if runs { printed(bench)? } else { "not run".to_owned() };
    for line in printed.lines() {
        table.push(vec!["ltm-pack conference-24.ltm --verify".into(), line.into()]);
    }
    let mut report = StudyReport::default();
    report.add_table(&bench.out, "example", &table)?;
    Ok(report)
}

/// Renders, packs, and returns what packing prints.
fn printed(bench: &Bench<'_>) -> Result<String> {
    let scene = bench.cached("conference-24.toml");
    write_file(&scene, true, scene_text(CONFERENCE_LAMPS).as_bytes())?;
    let [matrix, container] = ["ltm", "ltc"].map(|extension| scene.with_extension(extension));
    bench.watch.begin("worked example", 2, "programs");
    program(bench, "ltm", &["render", &named(&scene), "--samples", "32", "--force", "-o", &named(&matrix)])?;
    bench.watch.advance(1, 0, "B");
    let printed = program(bench, "ltm-pack", &[&named(&matrix), "-o", &named(&container), "--force", "--verify"])?;
    bench.watch.end();
    let folder = format!("{}/", container.parent().unwrap_or(Path::new("")).display());
    Ok(printed.replace(&folder, ""))
}

fn named(path: &Path) -> String {
    path.display().to_string()
}

/// Runs a program that lies beside this one; what it prints.
fn program(bench: &Bench<'_>, name: &str, arguments: &[&str]) -> Result<String> {
    bench.stop_if_interrupted()?;
    let own = std::env::current_exe().map_err(Error::io(Path::new(name), "find the program's folder"))?;
    let path = own.with_file_name(name);
    let done = Command::new(&path).args(arguments).output().map_err(Error::io(&path, "start"))?;
    let said = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    if !done.status.success() {
        let last = said(&done.stderr).lines().last().unwrap_or_default().to_owned();
        return Err(Error::input(named(&path), format!("failed: {last}"), "run it by hand to see why"));
    }
    Ok(said(&done.stdout))
}
