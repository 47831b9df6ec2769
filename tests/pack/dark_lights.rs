//! Lights that do not reach the image.

use std::fs;

use ltm::light::LightErrors;
use ltm::pipeline::{self, PackOptions};
use ltm::resources::NoProgress;
use ltm::scene;

/// A closed box from −1 to 1, seen from inside.
const BOX: &str = "v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\n\
                   f 1 2 3 4\nf 5 6 7 8\nf 1 2 6 5\nf 4 3 7 8\nf 1 4 8 5\nf 2 3 7 6\n";

/// What a room under two lamps loses, with so many lamps outside of it, and the bytes of its container.
fn packed(outside: usize) -> (LightErrors, u64) {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("box.obj"), BOX).unwrap();
    let lamp = |name: &str, x: f32, y: f32| {
        format!("[[light]]\nkind = \"point\"\nname = \"{name}\"\nposition = [{x}, {y}, 0.2]\nemission = [1, 1, 1]\n")
    };
    let camera = "eye = [0, 0, 0.9]\nlook_at = [0, -0.2, -1]\nvertical_fov_degrees = 70\nwidth = 96\nheight = 64\n";
    let lamps: Vec<String> = (0..outside).map(|i| lamp(&format!("outside {i}"), 3.0 + i as f32, 0.0)).collect();
    let [left, right] = [lamp("left", -0.6, 0.5), lamp("right", 0.7, -0.2)];
    let render = "[render]\nsamples_per_pixel = 16\n";
    let text = format!("geometry = [\"box.obj\"]\n[camera]\n{camera}{render}{left}{right}{}", lamps.concat());
    let path = folder.path().join("scene.toml");
    fs::write(&path, text).unwrap();
    let loaded = scene::load(&path).unwrap();
    let options = PackOptions { denoise: true, ..PackOptions::default() };
    let (_, report) = pipeline::render_packed(loaded, &folder.path().join("box.ltc"), &options, &NoProgress).unwrap();
    (report.lights, report.packed_bytes)
}

/// They have no image whose errors could count, however brightly it would be exposed: the others keep all of their weight.
#[test]
fn lamps_outside_of_a_room_leave_its_image_as_near() {
    let ((alone, alone_bytes), (beside, beside_bytes)) = (packed(0), packed(3));
    // A lamp more among the lights with which errors are weighed makes each of the others count less.
    assert!(beside.single_worst < 1.3 * alone.single_worst, "{beside:?} over {alone:?}");
    assert!(beside.all_on < 1.3 * alone.all_on, "{beside:?} over {alone:?}");
    assert!(beside_bytes < alone_bytes + alone_bytes / 5, "{beside_bytes} over {alone_bytes}");
}
