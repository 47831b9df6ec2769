//! Relights a container: every light on its scene's value but those whose names fit a pattern, which are turned off.
//!
//! `cargo run --release --example relight -- room.ltc "desk*" out.exr`

use std::path::Path;

use ltm::Lighting;
use ltm::image::write_exr;

fn main() -> ltm::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [container, pattern, image] = arguments.as_slice() else {
        return Err(ltm::Error::input(
            "arguments",
            "not three of them",
            "give a container, a pattern of lights, an image",
        ));
    };
    without(Path::new(container), pattern, Path::new(image))
}

/// Writes the image without the lights that a pattern means.
pub(crate) fn without(container: &Path, pattern: &str, image: &Path) -> ltm::Result<()> {
    let matrix = ltm::open(container)?;
    let lighting = Lighting::of_scene(matrix.basis()).with(pattern, 0.0)?;
    write_exr(image, &matrix.relight(&lighting)?)
}
