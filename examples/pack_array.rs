//! Packs an array in memory: a wall of 64 × 48 pixels under a row of eight lamps, each of which lights it by the inverse square of the
//! distance. What does not fit the memory is written block by block, see `write_and_pack.rs`.
//!
//! `cargo run --release --example pack_array -- wall.ltc`

use std::path::Path;

use ltm::{LinearImage, MemoryMatrix, PackOptions, PackReport};

fn main() -> ltm::Result<()> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "wall.ltc".into());
    eprintln!("{}", pack_wall(Path::new(&path))?);
    Ok(())
}

/// Packs the wall.
pub(crate) fn pack_wall(path: &Path) -> ltm::Result<PackReport> {
    let pixel = |lamp: u32, x: u32, y: u32| {
        let across = x as f32 + 0.5 - (lamp as f32 + 0.5) * 8.0;
        [100.0 / (across * across + (y as f32 + 0.5).powi(2) + 25.0); 3]
    };
    let image = |lamp| {
        let pixels = (0..64 * 48).map(|i| pixel(lamp, i % 64, i / 64)).collect();
        (format!("lamp {lamp}"), LinearImage { width: 64, height: 48, pixels })
    };
    ltm::pack(&MemoryMatrix::from_images((0..8).map(image))?, path, &PackOptions::default())
}
