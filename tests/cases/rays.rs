//! No light is lost on the way: analytic irradiance wherever lamp and surface stand, and no light through walls.

#[path = "rays/analytic.rs"]
mod analytic;
#[path = "rays/files.rs"]
mod files;
#[path = "rays/leaks.rs"]
mod leaks;
#[path = "rays/places.rs"]
mod places;

use std::path::Path;

use ltm::image::LinearImage;
use ltm::scene::LoadedScene;

use super::Collection;
use analytic::expected;
use files::{load, rendered};

pub(super) const TESTS: &[(&str, fn())] = &[
    ("a_strip_a_disc_and_a_ball_light_a_surface_wherever_they_stand", analytic::lamps_light_a_surface),
    ("a_scene_of_any_scale_is_lit_alike", analytic::any_scale),
    ("needles_are_lit_and_shadow_as_other_triangles_do", analytic::needles),
    ("a_lamp_of_the_scene_file_just_before_a_surface_lights_it", analytic::panels),
    ("a_point_that_stands_in_a_surface_lights_what_is_before_it", analytic::point_in_a_surface),
    ("a_closed_box_stays_black_with_every_kind_of_lamp_outside", leaks::closed_boxes),
    ("no_light_comes_through_a_thin_slab_and_none_is_lost_before_it", leaks::thin_slabs),
    ("photons_reach_a_floor_close_to_lamp_and_mirror", leaks::mirrors),
    ("a_scene_in_survey_coordinates_is_the_one_at_zero", places::survey),
    ("nodes_of_gltf_far_away_keep_their_digits", places::gltf_nodes),
    ("reports_speak_in_the_files_coordinates", places::reports),
    ("what_stands_near_zero_is_not_moved", places::near_zero),
];

pub(super) const COLLECTIONS: &[Collection] = &[
    Collection { folder: "33-survey-coordinates", test: survey_coordinates },
    Collection { folder: "34-lamp-near-surface", test: lamp_near_surface },
];

/// Mean of all values.
fn mean(image: &LinearImage) -> f64 {
    let all = image.pixels.iter().flatten().map(|&v| f64::from(v)).sum::<f64>();
    all / (3 * image.pixels.len()) as f64
}

/// Means of an image and of what is right, over the pixels of which that is known.
fn means(found: &LinearImage, right: &[Option<f64>]) -> [f64; 2] {
    let known = found.pixels.iter().zip(right).filter_map(|(found, right)| Some([f64::from(found[0]), (*right)?]));
    let sums = known.fold([0.0; 3], |[a, b, n], [found, right]| [a + found, b + right, n + 1.0]);
    [sums[0] / sums[2], sums[1] / sums[2]]
}

fn small(path: &Path, (width, height): (u32, u32)) -> LoadedScene {
    load(path).sized(width, height)
}

/// The note says 0.0628 wherever the room stands, which is what Lambert's formula says.
fn survey_coordinates(folder: &Path) {
    for name in ["survey_near.toml", "survey_far.toml", "site_near.gltf", "site_mid.gltf", "site_far.gltf"] {
        let scene = small(&folder.join(name), (16, 16));
        let right = expected(&scene.scene);
        let middle = right[8 * 16 + 8].expect("the floor");
        assert!((middle / 0.0628 - 1.0).abs() < 0.01, "{name}: {middle}");
        let [found, right] = means(&rendered(&scene, 256, 2), &right);
        // 256 pixels of 256 samples.
        assert!((found / right - 1.0).abs() < 0.005, "{name}: {found} for {right}");
    }
}

/// The strip over a shelf is 0.4189 in the mean, says the note; all others are held against Lambert's formula, part by part.
fn lamp_near_surface(folder: &Path) {
    let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut count = 0;
    for path in names.filter(|path| path.extension().is_some_and(|extension| extension == "toml")) {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let scene = small(&path, (15, 15));
        let right = expected(&scene.scene);
        let found = rendered(&scene, 1024, 2);
        let [lit, average] = means(&found, &right);
        if name.starts_with('s') {
            assert!((average / 0.4189 - 1.0).abs() < 0.01, "{name}: {average}");
        }
        assert!((lit / average - 1.0).abs() < 0.005, "{name}: {lit} for {average}");
        for (at, (found, right)) in found.pixels.iter().zip(&right).enumerate() {
            let Some(right) = right else { continue };
            // 1,024 samples of four light samples each.
            let most = 0.05 * right.max(0.1 * average);
            assert!((f64::from(found[0]) - right).abs() <= most, "{name}, pixel {at}: {} for {right}", found[0]);
        }
        count += 1;
    }
    assert!(count >= 14, "{count}");
}
