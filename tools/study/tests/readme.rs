//! The README's figures against the tables of the runs that made them.

mod tables;

use std::fs;
use std::path::Path;

use tables::{Row, read_csv};

#[test]
fn pictures_are_as_good_as_the_readme_says() {
    let readme = fs::read_to_string("../../README.md").unwrap();
    let rows = read_csv(Path::new("../../formats/plots/picture.csv"));
    let found = |scene: &str, samples: &str, method: &str| {
        let is = |row: &&Row| row["scene"] == scene && row["samples_per_px"] == samples && row["method"] == method;
        rows.iter().find(is).unwrap_or_else(|| panic!("{scene}, {samples} samples: no {method}"))
    };
    let mut scenes: Vec<&str> = rows.iter().map(|row| row["scene"].as_str()).collect();
    scenes.dedup();
    assert!(scenes.len() > 5, "{scenes:?}");
    for scene in scenes {
        let ours = found(scene, "16", "ours");
        let name = if ours["tuned_on"] == "yes" { scene.to_owned() } else { format!("**{scene}**") };
        let line =
            readme.lines().find(|line| line.starts_with(&format!("| {name}, "))).unwrap_or_else(|| panic!("{name}"));
        let mut expected = Vec::new();
        for samples in ["16", "64"] {
            for method in ["ours", "denoiser on each image", "raw matrix"] {
                let number = |column: &str| found(scene, samples, method)[column].parse::<f64>().unwrap();
                expected.push(format!("{:.3} / {:.1}", number("flip"), number("psnr_clip_db")));
            }
        }
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        assert_eq!(cells[2..8], expected, "{scene}");
        let shape: String = cells[1].chars().filter(|c| c.is_ascii_digit() || *c == '×').collect();
        assert!(shape.ends_with(&format!("{}×{}", ours["rows"], ours["columns"])), "{}", cells[1]);
    }
}
