//! `ltm daylight`: what it writes, what it says, what it refuses.

mod outcome;

use std::fs;
use std::path::Path;
use std::process::Command;

use outcome::outcome;

const CLIMATE: &str = "place A_B\nlatitude 48.1\nlongitude -11.6\ntime_zone -15\nsite_elevation 515\nweather_data_file_units 1\n\
    3 21 9.5 500 120\n3 21 12.5 0 180\n6 21 12.5 850 100\n";
const SCENE: &str = "geometry = [\"floor.obj\"]\n[camera]\neye = [0, 2, 2]\nlook_at = [0, 0, 0]\nwidth = 8\nheight = 6\n\
    [[grid]]\nname = \"desk\"\norigin = [-1, 0.5, -1]\nedge_u = [2, 0, 0]\nedge_v = [0, 0, 2]\nspacing = 1\n\
    [[light]]\nkind = \"environment\"\npatches = \"tregenza\"\n";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("floor.obj", "v -3 0 -3\nv 3 0 -3\nv 3 0 3\nv -3 0 3\nf 4 3 2 1\n");
    write("scene.toml", SCENE);
    write("a.wea", CLIMATE);
    folder
}

fn daylight(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin!("ltm"));
    command.current_dir(folder).args(["daylight", "scene.toml", "--climate", "a.wea", "-o", "year"]).args(arguments);
    command
}

#[test]
fn a_year_of_a_grid_and_a_camera_is_written_and_continued() {
    let folder = folder();
    let (code, said, problem) =
        outcome(&mut daylight(folder.path(), &["--hourly", "--sensor-samples", "1024", "--sky-matrix", "1"]));
    assert_eq!(code, 0, "{said} {problem}");
    for name in
        ["desk.ltm", "desk-measures.csv", "desk-measures.npy", "desk-hours.npy", "desk.ill", "camera.ltc", "sky.mtx"]
    {
        assert!(folder.path().join("year").join(name).is_file(), "{name}: {said}");
    }
    for name in ["desk-da.png", "camera-mean_lux.png"] {
        assert!(ltm::image::read_image(&folder.path().join("year").join(name)).is_ok(), "{name}");
    }
    let table = fs::read_to_string(folder.path().join("year/desk-measures.csv")).unwrap();
    assert_eq!(table.lines().count(), 5);
    assert!(table.starts_with("x,y,z,normal_x,normal_y,normal_z,da_percent,"), "{table}");
    let ill = fs::read_to_string(folder.path().join("year/desk.ill")).unwrap();
    let words: Vec<&str> = ill.lines().next().unwrap().split(' ').collect();
    assert_eq!((words.len(), &words[..3]), (7, &["3", "21", "9.500"][..]));
    let summary = fs::read_to_string(folder.path().join("year/summary.csv")).unwrap();
    assert!(summary.lines().count() == 3 && summary.contains("\ndesk,4,0,100.000,"), "{summary}");
    // The matrices are there: the year alone is done again, from the container too.
    let (code, said, _) = outcome(&mut daylight(folder.path(), &["--sensor-samples", "1024"]));
    assert!(code == 0 && !said.contains("rendered"), "{said}");
    let mut again = Command::new(assert_cmd::cargo::cargo_bin!("ltm"));
    again.current_dir(folder.path()).args(["daylight", "year/camera.ltc", "--climate", "a.wea", "-o", "other"]);
    assert_eq!(outcome(&mut again).0, 0);
    // Other settings are another matrix.
    let (code, _, problem) = outcome(&mut daylight(folder.path(), &["--sensor-samples", "16"]));
    assert!(code == 3 && problem.contains("--force renders it again"), "{code} {problem}");
}

#[test]
fn what_has_no_year_is_one_line() {
    let folder = folder();
    let refused = |arguments: &[&str], wanted: &str| {
        let (code, _, problem) = outcome(&mut daylight(folder.path(), arguments));
        let last = problem.lines().last().unwrap_or_default();
        assert!([2, 3].contains(&code) && problem.contains(wanted), "{arguments:?}: {code} {last}");
    };
    refused(&["--schedule", "18-8"], "is no time of use");
    refused(&["--months", "0-3"], "are none");
    refused(&["--ground", "2"], "is no reflectance");
    refused(&["--autonomy", "0"], "is no illuminance");
    refused(&["--sky-matrix", "0"], "is no subdivision");
    refused(&["--view", "roof"], "has no grid 'roof'; it has 'desk'");
    fs::write(folder.path().join("a.wea"), CLIMATE.replace("850", "9999")).unwrap();
    refused(&[], "a.wea, line 9: 9999 and 100 W/m² are no light");
    fs::write(folder.path().join("a.wea"), CLIMATE).unwrap();
    // A picture of radiance has no illuminances.
    let run = |arguments: &[&str]| {
        let mut command = Command::new(assert_cmd::cargo::cargo_bin!("ltm"));
        command.current_dir(folder.path()).args(arguments);
        outcome(&mut command)
    };
    assert_eq!(run(&["render", "scene.toml", "--samples", "2", "-o", "a.ltm"]).0, 0);
    let (code, _, problem) = run(&["daylight", "a.ltm", "--climate", "a.wea"]);
    assert!(code == 3 && problem.contains("shows radiance, and not the irradiance"), "{code} {problem}");
}
