//! `ltm-pack` of arrays of images: what they are taken for, and whether they are denoised.

mod outcome;
mod program;

use std::path::Path;

use ltm::image::{ImageSize, write_npy};
use outcome::outcome;

/// Eight images of 32 × 24 pixels, ramps of several slopes with grain of a tenth, as `lights.npy`.
fn write_lights(folder: &Path) {
    let mut state = 1u32;
    let mut fetch = |image: usize, _, _, row: &mut [f32]| {
        for (x, value) in row.iter_mut().enumerate() {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let grain = 0.2 * ((state >> 8) as f32 / (1u32 << 24) as f32 - 0.5);
            *value = (1.0 + (image % 4) as f32 * x as f32 / 32.0) * (1.0 + grain);
        }
        Ok(())
    };
    write_npy(&folder.join("lights.npy"), false, 8, ImageSize { width: 32, height: 24 }, &mut fetch).unwrap();
}

/// Packs the array with these options: the exit code, what is said, and the problem.
fn pack(folder: &Path, options: &str) -> (i32, String, String) {
    let arguments: Vec<&str> = ["lights.npy", "-o", "o.ltc"].into_iter().chain(options.split_whitespace()).collect();
    outcome(&mut program::command(folder, "ltm-pack", &arguments))
}

#[test]
fn images_of_texels_become_one_panel_or_sky() {
    let folder = tempfile::tempdir().unwrap();
    write_lights(folder.path());
    for (options, light) in [
        ("--texels 4x2", "light                    area light of 4 × 2 texels"),
        ("--sky 4x2 --force", "sky                      environment, lat-long, 4 × 2 texels"),
        ("--force", "light 7"),
    ] {
        let (code, _, problem) = pack(folder.path(), options);
        assert_eq!(code, 0, "{options}: {problem}");
        let (_, said, _) = outcome(&mut program::command(folder.path(), "ltm", &["info", "o.ltc"]));
        assert!(said.contains(light), "{options}: {said}");
    }
    let (code, _, problem) = pack(folder.path(), "--texels 3x2 --force");
    assert!(code == 3 && problem.contains("6 in all, and there are 8 images"), "{code} {problem}");
    for wrong in ["--texels 4x2 --sky 4x2", "--texels 8", "--sky 0x3"] {
        assert_eq!(pack(folder.path(), wrong).0, 2, "{wrong}");
    }
}

#[test]
fn images_rendered_once_are_cleaned_where_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    write_lights(folder.path());
    let (code, said, problem) = pack(folder.path(), "");
    assert!(code == 0 && said.contains("not denoised: ") && said.contains("--estimate-noise"), "{said} {problem}");
    for off in ["--denoise off --force", "--estimate-noise --denoise off --force"] {
        let (code, said, problem) = pack(folder.path(), off);
        assert!(code == 0 && !said.contains("denois"), "{off}: {said} {problem}");
    }
    let (code, said, problem) = pack(folder.path(), "--estimate-noise --force");
    assert!(code == 0 && said.contains("denoising, relative L2") && !said.contains("not denoised"), "{said} {problem}");
    let noise = |after: &str| said.split_once(after).and_then(|(_, rest)| rest.split(' ').next()?.parse::<f64>().ok());
    let (before, after) = (noise("lights: noise ").unwrap(), noise(" before, ").unwrap());
    // Uniform noise of a tenth to each side is one of 0.058.
    assert!((0.04..0.08).contains(&before) && after < before / 3.0, "{said}");
    assert_eq!(pack(folder.path(), "--estimate-noise --second lights.npy --force").0, 2);
    let (code, _, problem) = pack(folder.path(), "--features lights.npy --force");
    assert!(code == 3 && problem.contains("--features") && problem.lines().count() == 1, "{code} {problem}");
}
