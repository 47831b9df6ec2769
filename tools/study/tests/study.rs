//! The studies run, write what they say, and the claims that they are there for hold in the quick setting too.

mod tables;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use ltm::resources::NoProgress;
use ltm_study::{self, CorpusOptions, Study, StudyOptions};
use tables::{Row, read_table};

/// The table of a study, which names the command that made it.
fn read_csv(path: &Path) -> Vec<Row> {
    assert!(fs::read_to_string(path).unwrap().contains("# Command: `ltm study "), "{}", path.display());
    read_table(path)
}

fn number(row: &Row, name: &str) -> f64 {
    row[name].parse().unwrap_or_else(|_| panic!("{name} of {row:?}"))
}

fn of<'a>(rows: &'a [Row], name: &str, value: &str) -> impl Iterator<Item = &'a Row> {
    rows.iter().filter(move |row| row[name] == value)
}

#[test]
fn every_study_writes_what_it_says_and_its_claims_hold() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_owned();
    let options = StudyOptions { out: out.clone(), quick: true, corpus: CorpusOptions::default() };
    let report = ltm_study::run(&Study::ALL, &options, &NoProgress).unwrap();
    for file in &report.files {
        let bytes = fs::metadata(file).unwrap().len();
        assert!(bytes > 200, "{} has {bytes} bytes", file.display());
        match file.extension().and_then(|e| e.to_str()) {
            Some("png" | "jpg") => assert!(ltm::image::read_image(file).is_ok(), "{}", file.display()),
            Some("csv") => drop(read_csv(file)),
            _ => assert!(fs::read_to_string(file).unwrap().contains("|---|")),
        }
    }
    for name in ["fig5", "fig6", "fig7", "fig9", "ablation", "rank", "noise", "picture", "corpus", "speed", "scaling"] {
        let named = |file: &Path| file.file_name().unwrap().to_string_lossy().starts_with(name);
        assert!(report.files.iter().any(|file| named(file) && file.extension().is_some_and(|e| e == "png")), "{name}");
    }

    let packing = read_csv(&out.join("packing.csv"));
    let (whole, default) =
        (of(&packing, "packed", "whole").next().unwrap(), of(&packing, "packed", "default").next().unwrap());
    assert!(number(default, "bytes") < 0.5 * number(whole, "bytes"), "{default:?}");
    assert!(number(default, "seams_worst") < 1.2, "{default:?}");

    let gains = read_csv(&out.join("fig9-16-gain.csv"));
    assert_eq!(gains.len(), 4, "two scenes, twice");
    // By default what is noise is left out, so that the matrix, which holds it, is not followed beyond a size: only what
    // keeps the noise is compared with the matrix at every size.
    for row in of(&gains, "ours", "ours (noise kept)") {
        assert!(number(row, "algorithm4_least_lin_db") > 0.0, "{row:?}");
        assert!(number(row, "svd_least_lin_db") > 0.0, "{row:?}");
    }
    let fig9 = read_csv(&out.join("fig9-16.csv"));
    for method in ["Algorithm 4", "kernel Nyström", "block SVD (fixed rank)"] {
        for scene in ["diffuse", "mixed"] {
            let bytes: Vec<f64> =
                of(&fig9, "method", method).filter(|r| r["scene"] == scene).map(|r| number(r, "bytes")).collect();
            assert!(bytes.len() > 1 && bytes.windows(2).all(|w| w[0] < w[1]), "{method}, {scene}: {bytes:?}");
        }
    }

    // Read off at one size: on the line between the two files around it.
    let fixed = read_csv(&out.join("fig9-16-fixed.csv"));
    let matrix_bytes = |row: &Row| number(row, "rows") * number(row, "columns") * 4.0;
    let mut compared = 0;
    for row in fixed.iter().filter(|row| !row["psnr_clip_db"].is_empty()) {
        let is = |point: &&Row| point["scene"] == row["scene"] && point["method"] == row["method"];
        let own: Vec<(f64, f64)> =
            fig9.iter().filter(is).map(|p| (number(p, "bytes"), number(p, "psnr_clip_db"))).collect();
        let bytes = matrix_bytes(fig9.iter().find(is).unwrap()) / number(row, "ratio");
        let below = own.iter().copied().filter(|p| p.0 <= bytes).max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        let above = own.iter().copied().filter(|p| p.0 >= bytes).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        let (low, high) = (below.1.min(above.1), below.1.max(above.1));
        // Both tables are rounded to a tenth or less.
        assert!(
            (low - 0.06..=high + 0.06).contains(&number(row, "psnr_clip_db")),
            "{row:?} between {below:?} and {above:?}"
        );
        compared += 1;
    }
    assert!(compared >= 8, "{compared} of {} rows have a value", fixed.len());

    // Each idea brings something where it is meant to: the weights of the prior and our coder against the matrix, leaving noise out and
    // cleaning against the truth.
    let ablation = read_csv(&out.join("ablation.csv"));
    let value = |method: &str, name: &str| number(of(&ablation, "method", method).next().expect(method), name);
    let (coder, flat) = ("+ our steps, transform and coder", "block SVD in our coder, no prior");
    assert!(value(coder, "psnr_clip_db") > value(flat, "psnr_clip_db"));
    assert!(value("+ sparse entries (`--keep-noise`)", "psnr_lin_db") > value(coder, "psnr_lin_db"));
    assert!(
        value("+ cleaned (the default)", "truth_clip_db") > value("+ sparse entries (`--keep-noise`)", "truth_clip_db")
    );

    // The stored way and the fused one end in the same container, within the memory that was allowed.
    let large = read_csv(&out.join("large.csv"));
    assert_eq!(
        large.iter().map(|r| r["stage"].as_str()).collect::<Vec<_>>(),
        ["render", "verify", "pack", "unpack", "render --pack"]
    );
    assert_eq!(large[2]["file_bytes"], large[4]["file_bytes"]);
    for row in large.iter().filter(|row| !row["peak_bytes"].is_empty()) {
        assert!(number(row, "peak_bytes") <= number(row, "allowed_bytes"), "{row:?}");
        assert!(number(row, "allowed_bytes") == f64::from(256 << 20), "{row:?}");
    }

    // Some of a matrix of 64 samples is noise, which takes components of its own.
    let ranks = read_csv(&out.join("rank.csv"));
    for row in &ranks {
        assert!(number(row, "rank_of_signal") >= 1.0 && (0.0..0.5).contains(&number(row, "noise_share")), "{row:?}");
    }
    let sum = |name: &str| ranks.iter().map(|row| number(row, name)).sum::<f64>();
    assert!(sum("rank_of_signal") < sum("rank_of_matrix"), "{ranks:?}");

    // The packed image is closer to the truth than the matrix that it was packed from.
    let noise = read_csv(&out.join("noise.csv"));
    for row in of(&noise, "method", "ours") {
        assert!(number(row, "gain_lin_db") > 0.0, "{row:?}");
    }

    // Cleaning brings the picture nearer to the truth for the eye, and hides the blocks.
    let picture = read_csv(&out.join("picture.csv"));
    let measured = |method: &str, name: &str| number(of(&picture, "method", method).next().unwrap(), name);
    for rival in ["ours without cleaning", "raw matrix"] {
        assert!(measured("ours", "flip") < measured(rival, "flip"), "{picture:?}");
    }
    assert!(measured("ours", "seams") < measured("ours without cleaning", "seams"), "{picture:?}");
    assert_eq!(read_csv(&out.join("picture-lightings.csv")).len(), 12 * picture.len());

    every_second_scene_judges(&out);
    packed_images_are_as_near_as_raw_ones_of_more_samples(&out);

    // Lights of an array are better served where their images say which are alike than where they stand at one place.
    let imports = read_csv(&out.join("imports.csv"));
    let measured = |lights: &str, name: &str| number(of(&imports, "lights", lights).next().expect(lights), name);
    for name in ["psnr_lin_db", "psnr_clip_db"] {
        assert!(measured("from the images", name) > measured("nothing of places", name), "{name}: {imports:?}");
    }

    // Matrices are shared: the second run of a study renders nothing.
    let before = matrices(&out.join("cache"));
    assert!(!before.is_empty());
    ltm_study::run(&[Study::Rank], &options, &NoProgress).unwrap();
    assert_eq!(matrices(&out.join("cache")), before);
}

/// Each lighting of each method has a row of its own.
fn every_second_scene_judges(out: &Path) {
    let corpus = read_csv(&out.join("corpus.csv"));
    for (scene, half) in [("diffuse", "chooses"), ("mixed", "judges")] {
        let rows: Vec<&Row> = of(&corpus, "scene", scene).collect();
        assert!(rows.len() >= 2 && rows.iter().all(|row| row["half"] == half), "{rows:?}");
        let measured =
            |method: &str, name: &str| number(rows.iter().find(|row| row["method"] == method).expect(method), name);
        assert!(measured("ours", "flip") < measured("raw matrix", "flip"), "{rows:?}");
        assert!(measured("ours", "spots_permille") < measured("raw matrix", "spots_permille"), "{rows:?}");
    }
    let each: f64 = corpus.iter().map(|row| number(row, "lightings")).sum();
    assert_eq!(read_csv(&out.join("corpus-lightings.csv")).len() as f64, each);
}

/// Of how many more lies between two numbers of samples that were measured.
fn packed_images_are_as_near_as_raw_ones_of_more_samples(out: &Path) {
    let (ratios, points) = (read_csv(&out.join("equal.csv")), read_csv(&out.join("equal-points.csv")));
    assert_eq!(ratios.len(), 1);
    let raw = |samples: f64| {
        let is = |row: &&Row| row["way"] == "raw matrix" && number(row, "samples_per_px") == samples;
        points.iter().find(is).unwrap_or_else(|| panic!("{points:?}"))
    };
    for (measure, at) in [("flip", "raw_samples_at_flip"), ("psnr_clip_db", "raw_samples_at_clip")] {
        let (ours, samples) = (number(&ratios[0], measure), number(&ratios[0], at));
        assert!(samples > 2.0 * number(&ratios[0], "samples_per_px"), "{ratios:?}");
        let (fewer, more) = if samples < 64.0 { (raw(8.0), raw(64.0)) } else { (raw(64.0), raw(512.0)) };
        let ends = [number(fewer, measure), number(more, measure)];
        assert!(ours >= ends[0].min(ends[1]) && ours <= ends[0].max(ends[1]), "{ratios:?} {points:?}");
    }
}

/// The matrices of a folder, each with the time at which it was written.
fn matrices(folder: &Path) -> BTreeMap<PathBuf, SystemTime> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let matrices = entries.filter(|path| path.extension().is_some_and(|extension| extension == "ltm"));
    matrices.map(|path| (path.clone(), fs::metadata(&path).unwrap().modified().unwrap())).collect()
}

#[test]
fn studies_are_found_by_name() {
    assert_eq!("fig9".parse::<Study>().unwrap(), Study::Fig9);
    let error = "fig10".parse::<Study>().unwrap_err().to_string();
    assert!(error.contains("fig10") && error.contains("scaling"), "{error}");
}
