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

/// An hour without daylight, and a lamp of 20 W/sr straight above the first sensor and 2 m from it: 179 · 20 / 2² lx, of which 500 lx are a share
/// of 0.5587, and of 120 W 67.04. In the bright hours it is off, or at a tenth of its light.
#[test]
fn a_lamp_is_dimmed_to_what_its_sensor_lacks() {
    let folder = folder();
    let lamp = "[[light]]\nkind = \"point\"\nname = \"lamp\"\nposition = [-0.5, 2.5, -0.5]\nemission = [20, 20, 20]\n";
    fs::write(folder.path().join("scene.toml"), format!("{SCENE}{lamp}")).unwrap();
    fs::write(folder.path().join("a.wea"), format!("{CLIMATE}12 21 17.5 0 0\n12 21 23.5 0 0\n")).unwrap();
    let dimmed = |zone: &str| {
        let arguments = ["--view", "desk", "--sensor-samples", "64", "--hourly", "--dim", zone];
        let (code, said, problem) = outcome(&mut daylight(folder.path(), &arguments));
        assert_eq!(code, 0, "{said} {problem}");
        let table = fs::read_to_string(folder.path().join("year/lamps.csv")).unwrap();
        let row = table.lines().nth(1).unwrap().to_owned();
        (row.split(',').map(str::to_owned).collect::<Vec<_>>(), said, problem)
    };
    let (row, said, _) = dimmed("l*=desk:1,500lx,120W");
    assert_eq!(&row[..4], ["l*", "desk:1", "500.000", "895.000"]);
    // Of four hours of use it is at full light in none, and off in three.
    assert_eq!(&row[4..9], ["4.000", "0.000", "0.000", "3.000", "0.000"]);
    let share = 500.0 / (179.0 * 20.0 / 4.0);
    let wanted = format!("{:.3}", 0.12 * share);
    assert_eq!(&row[9..11], [&*wanted, "0.480"]);
    assert!(
        said.contains(
            "l*: 0.1 kWh a year, undimmed 0.5 kWh; of 4 h of use 0 h at full light, 0 h at the least, 3 h off"
        ),
        "{said}"
    );
    assert!(said.contains("lamps.csv: 1 zones, 0.1 kWh a year of 0.5 kWh undimmed (86.0 % saved)"), "{said}");
    let hours = fs::read_to_string(folder.path().join("year/lamps-hours.csv")).unwrap();
    let line = hours.lines().find(|line| line.starts_with("12,21,17.500")).unwrap();
    assert_eq!(line, format!("12,21,17.500,0.0,500.0,{:.2},{:.2}", 100.0 * share, 120.0 * share));
    assert!(hours.contains("\n12,21,23.500,0.0,0.0,0.00,0.00\n"), "{hours}");
    // With a least light it stays there.
    let (row, ..) = dimmed("lamp=1,500lx,120W,10%,30W");
    assert_eq!(&row[5..8], ["0.000", "3.000", "0.000"]);
    let wanted = 3.0 * 0.03 + 0.03 + 0.09 * (share - 0.1) / 0.9;
    assert_eq!(row[9], format!("{wanted:.3}"));
    let (row, _, problem) = dimmed("lamp=desk:4,500lx,120W");
    assert_eq!((&*row[5], &*row[8]), ("1.000", "1.000"));
    assert!(problem.contains("less than 500 lx"), "{problem}");
    for (zone, wanted) in [
        ("lamp", "says not which lamps a sensor dims"),
        ("=desk:1,500lx,120W", "says not which lamps a sensor dims"),
        ("lamp=desk:0,500lx,120W", "'desk:0': is no sensor"),
        ("lamp=desk:1,500lx", "has no set point in lx and power in W"),
        ("lamp=roof:1,500lx,120W", "sensor 'roof:1': is of no view here; the views are 'desk'"),
        ("lamp=desk:5,500lx,120W", "sensor 'desk:5': is not there: its view has 4"),
        ("lump=desk:1,500lx,120W", "--dim lump: no light is called so; the nearest names are 'lamp'"),
        ("*=desk:1,500lx,120W", "is daylight and no lamp"),
    ] {
        let arguments = ["--view", "desk", "--sensor-samples", "64", "--dim", zone];
        let (code, _, problem) = outcome(&mut daylight(folder.path(), &arguments));
        assert!([2, 3].contains(&code) && problem.contains(wanted), "{zone}: {code} {problem}");
    }
    let twice = ["--view", "desk", "--dim", "lamp=desk:1,500lx,120W", "--dim", "l*=desk:2,500lx,120W"];
    let (code, _, problem) = outcome(&mut daylight(folder.path(), &twice));
    assert!(code == 3 && problem.contains("--dim l*: 'lamp' is dimmed by --dim lamp too"), "{code} {problem}");
}

/// Open ground has direct sun in two of the three hours; the second, without it, has a sky of 180 W/m² alone. Blinds are a lid above the desk.
#[test]
fn blinds_are_closed_in_the_hours_of_sun_or_above_a_sensors_limit() {
    let folder = folder();
    let scene = SCENE.replace("\"tregenza\"", "\"tregenza\"\nsplit = true");
    fs::write(folder.path().join("scene.toml"), &scene).unwrap();
    fs::write(folder.path().join("lid.obj"), "v -2 1 -2\nv 2 1 -2\nv 2 1 2\nv -2 1 2\nf 4 3 2 1\n").unwrap();
    let lid = |text: &str| text.replace("\"floor.obj\"", "\"floor.obj\", \"lid.obj\"");
    fs::write(folder.path().join("closed.toml"), lid(&scene)).unwrap();
    let lux_of_hours = || {
        let ill = fs::read_to_string(folder.path().join("year/desk.ill")).unwrap();
        let lux = ill.lines().map(|line| line.split(' ').nth(3).unwrap().parse::<f64>().unwrap());
        lux.collect::<Vec<_>>()
    };
    let common = ["--view", "desk", "--sensor-samples", "64", "--hourly"];
    let (code, said, problem) = outcome(&mut daylight(folder.path(), &common));
    assert_eq!(code, 0, "{said} {problem}");
    let open = lux_of_hours();
    for (rule, closed) in [
        (&[][..], [true, false, true]),
        (&["--close", "desk,1000lx,2%"], [true, false, true]),
        (&["--close", "200000lx,2%"], [false; 3]),
        (&["--close", "desk:1,10000lx"], [true, true, true]),
    ] {
        let arguments = [&common[..], &["--blinds", "closed.toml"], rule].concat();
        let (code, said, problem) = outcome(&mut daylight(folder.path(), &arguments));
        assert_eq!(code, 0, "{said} {problem}");
        let count = closed.iter().filter(|is_closed| **is_closed).count();
        assert!(said.contains(&format!("desk: blinds closed in {count} of 3 h of use: ")), "{said}");
        for ((found, open), is_closed) in lux_of_hours().into_iter().zip(&open).zip(closed) {
            assert!(if is_closed { found < 0.9 * open } else { found == *open }, "{rule:?}: {found} and {open}");
        }
        let summary = fs::read_to_string(folder.path().join("year/summary.csv")).unwrap();
        assert!(summary.lines().nth(1).unwrap().ends_with(&format!(",{count}.000,,,")), "{summary}");
        let hours = fs::read_to_string(folder.path().join("year/blinds-hours.csv")).unwrap();
        let wanted: Vec<String> = closed.map(|is_closed| u8::from(is_closed).to_string()).into();
        let found: Vec<&str> = hours.lines().skip(1).map(|line| line.rsplit(',').next().unwrap()).collect();
        assert!(hours.starts_with("month,day,hour,desk\n") && found == wanted, "{hours}");
    }
    // The camera, and eyes that look to the north, have the blinds of the only grid of sensors.
    fs::write(folder.path().join("eyes.pts"), "0 0 1.2 0 1 0\n").unwrap();
    let eyes = "[[grid]]\nname = \"eyes\"\npoints = \"eyes.pts\"\n[[light]]";
    fs::write(folder.path().join("with.toml"), scene.replace("[[light]]", eyes)).unwrap();
    fs::write(folder.path().join("with-closed.toml"), lid(&scene).replace("[[light]]", eyes)).unwrap();
    let mut command = Command::new(assert_cmd::cargo::cargo_bin!("ltm"));
    command.current_dir(folder.path()).args(["daylight", "with.toml", "--climate", "a.wea", "-o", "with"]);
    let (code, said, problem) =
        outcome(command.args(["--blinds", "with-closed.toml", "--eyes", "eyes", "--samples", "8"]));
    assert_eq!(code, 0, "{said} {problem}");
    for view in ["desk", "eyes", "camera"] {
        assert!(said.contains(&format!("{view}: blinds closed in 2 of 3 h of use")), "{said}");
    }
    fs::write(folder.path().join("other.toml"), lid(&scene).replace("[-1, 0.5, -1]", "[-1, 0.6, -1]")).unwrap();
    for (more, wanted) in [
        (&["--blinds", "closed.ltm"][..], "closed.ltm: goes with no scene.toml"),
        (&["--close", "1000lx,2%"], "--blinds <FILE>"),
        (&["--blinds", "closed.toml", "--close", "1000"], "does not say when blinds close"),
        (&["--blinds", "closed.toml", "--close", "1000lx,100%"], "does not say when blinds close"),
        (&["--blinds", "closed.toml", "--close", "roof,1000lx,2%"], "there is no view 'roof'"),
        (&["--blinds", "closed.toml", "--close", "desk:9,1000lx"], "sensor 'desk:9': is not there"),
        (&["--blinds", "other.toml", "--force"], "grid 'desk': has other sensors with blinds"),
    ] {
        let (code, _, problem) = outcome(&mut daylight(folder.path(), &[&common[..], more].concat()));
        assert!([2, 3].contains(&code) && problem.contains(wanted), "{more:?}: {code} {problem}");
    }
}

/// Below a uniform sky of an overcast hour alone, eyes that look along the ground see at most half of it; all numbers follow from the hours.
#[test]
fn eyes_have_the_glare_of_their_hours() {
    let folder = folder();
    let eyes = "[[grid]]\nname = \"eyes\"\npoints = \"eyes.pts\"\n";
    fs::write(folder.path().join("eyes.pts"), "0 0 1.2 1 0 0\n0 0 1.2 0 -1 0\n0 0 1.2 0 0 1\n").unwrap();
    fs::write(folder.path().join("scene.toml"), SCENE.replace("[[light]]", &format!("{eyes}[[light]]"))).unwrap();
    let hours =
        "9 1 9.5 0 5\n9 1 10.5 0 30\n9 1 11.5 0 50\n9 1 12.5 0 60\n9 1 13.5 0 70\n9 1 14.5 0 90\n9 1 17.5 0 0\n";
    fs::write(folder.path().join("a.wea"), format!("{}{hours}", CLIMATE.split("3 21").next().unwrap())).unwrap();
    let arguments = ["--view", "eyes", "--eyes", "eyes", "--sensor-samples", "256", "--hourly"];
    let (code, said, problem) = outcome(&mut daylight(folder.path(), &arguments));
    assert_eq!(code, 0, "{said} {problem}");
    assert!(problem.contains("--eyes eyes: 1 of 3 sensors look up or down"), "{problem}");
    assert!(said.contains("eyes: DGPs 0.35 or above in ") && said.contains("of 3 eyes"), "{said}");
    let year = |name: &str| folder.path().join("year").join(name);
    let ill = fs::read_to_string(year("eyes.ill")).unwrap();
    let lux = |eye: usize| {
        let of_eye = |line: &str| line.split(' ').nth(3 + eye).unwrap().parse::<f64>().unwrap();
        ill.lines().map(of_eye).collect::<Vec<_>>()
    };
    let table = fs::read_to_string(year("eyes-glare.csv")).unwrap();
    assert!(
        table.starts_with("eye,x,y,z,normal_x,normal_y,normal_z,imperceptible_percent,perceptible_percent,"),
        "{table}"
    );
    let dgps = fs::read(year("eyes-dgps.npy")).unwrap();
    let dgps: Vec<f32> =
        dgps[dgps.len() - 3 * 7 * 4..].as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let mut intolerable = 0;
    for eye in 0..3 {
        // Wienold's equation, from the lux of each hour.
        let wanted: Vec<f64> = lux(eye).iter().map(|lux| 6.22e-5 * lux + 0.184).collect();
        for (found, wanted) in dgps[eye * 7..].iter().zip(&wanted) {
            assert!((f64::from(*found) - wanted).abs() < 1e-5, "{eye}: {found} for {wanted}");
        }
        let within = |low: f64, high: f64| wanted.iter().filter(|dgp| (low..high).contains(*dgp)).count() as f64;
        let counts = [within(0.0, 0.35), within(0.35, 0.4), within(0.4, 0.45), within(0.45, f64::MAX)];
        let row: Vec<&str> = table.lines().nth(1 + eye).unwrap().split(',').collect();
        let found: Vec<f64> = row[7..11].iter().map(|percent| percent.parse().unwrap()).collect();
        for (found, wanted) in found.iter().zip(counts.map(|count| 100.0 * count / 7.0)) {
            assert!((found - wanted).abs() < 1e-3, "{eye}: {found} for {wanted}");
        }
        intolerable += usize::from(counts[3] > 0.0);
    }
    assert!(intolerable > 0, "no hour is bright enough to tell the classes apart: {table}");
    for (eyes, wanted) in [("roof", "--eyes roof: is no view here"), ("camera", "its pixels are surfaces and no eyes")]
    {
        let (code, _, problem) = outcome(&mut daylight(folder.path(), &["--eyes", eyes]));
        assert!(code == 3 && problem.contains(wanted), "{code} {problem}");
    }
}

/// A panorama of 1 W/(sr·m²) everywhere: 179 π lx at the eye, no source, and the equation's probability.
#[test]
fn an_even_panorama_has_the_glare_of_its_illuminance() {
    let folder = tempfile::tempdir().unwrap();
    let image = ltm::LinearImage { width: 64, height: 32, pixels: vec![[1.0; 3]; 64 * 32] };
    ltm::image::write_exr(&folder.path().join("eye.exr"), &image).unwrap();
    let run = |arguments: &[&str]| {
        let mut command = Command::new(assert_cmd::cargo::cargo_bin!("ltm"));
        command.current_dir(folder.path()).arg("glare").args(arguments);
        outcome(&mut command)
    };
    let (code, said, problem) = run(&["eye.exr", "eye.exr", "--turn", "-40,10", "-o", "glare.csv"]);
    assert_eq!(code, 0, "{said} {problem}");
    let lux = 179.0 * std::f64::consts::PI;
    let wanted = format!("eye.exr: DGP {:.3}, imperceptible; ", 5.87e-5 * lux + 0.16);
    assert!(said.contains(&wanted) && said.contains("2 pictures: DGP at most 0.193"), "{said}");
    assert!(problem.contains("warning: eye.exr: DGP was found above 380 lx at the eye and from 0.2 on"), "{problem}");
    let table = fs::read_to_string(folder.path().join("glare.csv")).unwrap();
    let row: Vec<&str> = table.lines().nth(1).unwrap().split(',').collect();
    assert_eq!((row[0], row[2], row[4]), ("\"eye.exr\"", "imperceptible", "0"));
    assert!((row[3].parse::<f64>().unwrap() / lux - 1.0).abs() < 0.01, "{table}");
    for (arguments, wanted) in [
        (&["eye.exr", "--turn", "left"][..], "write RIGHT or RIGHT,UP in degrees"),
        (&["eye.exr", "--threshold", "0"], "the threshold 0 is not above 0"),
        (&["none.exr"], "none.exr"),
        (&["eye.png"], "eye.png: is a picture for screens and no radiance"),
    ] {
        let (code, _, problem) = run(arguments);
        assert!((2..10).contains(&code) && problem.contains(wanted), "{arguments:?}: {code} {problem}");
    }
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
