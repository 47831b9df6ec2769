//! Values as a picture in false colours, with a scale beside it.

use std::path::Path;

use super::write_rgb_png;
use crate::error::Result;

/// The scale of a picture, from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueScale<'a> {
    /// Value of the last colour.
    pub end: f32,
    /// Unit, of the letters `h`, `l`, `x` and `%`.
    pub unit: &'a str,
}

/// Colours of the scale in sRGB at even distances, of rising luminance (the corners of Matplotlib's viridis).
const COLOURS: [[f32; 3]; 6] = [
    [68.0, 1.0, 84.0],
    [65.0, 68.0, 135.0],
    [42.0, 120.0, 142.0],
    [34.0, 168.0, 132.0],
    [122.0, 209.0, 81.0],
    [253.0, 231.0, 37.0],
];

/// What has no value.
const UNKNOWN: [u8; 3] = [90, 90, 90];

/// Smallest width of the map; what has fewer pixels shows each as a square of several.
const LEAST_WIDTH: u32 = 480;

/// Steps of the scale that are numbered.
const STEPS: u32 = 5;

/// Size of a letter's dots, its columns, and its rows.
const DOT: u32 = 2;
const LETTER: (u32, u32) = (4, 5);

/// Writes a PNG of `size` values, row by row, and of their scale. Values that are not numbers are grey. An existing file is replaced.
///
/// # Errors
/// The system refuses to write; then the old file stands.
///
/// # Panics
/// If there is not one value for each place.
pub fn write_value_map(path: &Path, size: (u32, u32), values: &[f32], scale: ValueScale<'_>) -> Result<()> {
    assert_eq!(values.len(), size.0 as usize * size.1 as usize, "one value for each place");
    let zoom = LEAST_WIDTH.div_ceil(size.0).clamp(1, 64);
    let (map_width, map_height) = (size.0 * zoom, (size.1 * zoom).max(STEPS * 24));
    let width = map_width + 110;
    let mut picture = Picture { width, pixels: vec![[255; 3]; (width * map_height) as usize] };
    for y in 0..size.1 * zoom {
        for x in 0..map_width {
            let value = values[(y / zoom * size.0 + x / zoom) as usize];
            picture.set(x, y, if value.is_nan() { UNKNOWN } else { colour(value / scale.end) });
        }
    }
    let (top, bottom) = (8, map_height - 8);
    for y in top..bottom {
        let at = (bottom - 1 - y) as f32 / (bottom - 1 - top) as f32;
        (map_width + 12..map_width + 32).for_each(|x| picture.set(x, y, colour(at)));
    }
    for step in 0..=STEPS {
        let y = bottom - 1 - (bottom - 1 - top) * step / STEPS;
        let value = scale.end * step as f32 / STEPS as f32;
        let number = if scale.end < STEPS as f32 { format!("{value:.2}") } else { format!("{value:.0}") };
        let text = if step == STEPS { format!("{number} {}", scale.unit) } else { number };
        let y = y.saturating_sub(LETTER.1 * DOT / 2).min(map_height - LETTER.1 * DOT);
        picture.write(map_width + 38, y, &text);
    }
    write_rgb_png(path, width, map_height, picture.pixels.into_flattened())
}

/// The colour of a place on the scale, from 0 to 1.
fn colour(at: f32) -> [u8; 3] {
    let at = at.clamp(0.0, 1.0) * (COLOURS.len() - 1) as f32;
    let step = (at as usize).min(COLOURS.len() - 2);
    let part = at - step as f32;
    [0, 1, 2]
        .map(|channel: usize| (COLOURS[step][channel] * (1.0 - part) + COLOURS[step + 1][channel] * part + 0.5) as u8)
}

struct Picture {
    width: u32,
    pixels: Vec<[u8; 3]>,
}

impl Picture {
    fn set(&mut self, x: u32, y: u32, colour: [u8; 3]) {
        if let Some(pixel) = self.pixels.get_mut((y * self.width + x) as usize).filter(|_| x < self.width) {
            *pixel = colour;
        }
    }

    fn write(&mut self, x: u32, y: u32, text: &str) {
        for (place, letter) in text.chars().enumerate() {
            for (row, bits) in dots(letter).into_iter().enumerate() {
                for column in (0..3).filter(|column| bits >> (2 - column) & 1 == 1) {
                    for dot in 0..DOT * DOT {
                        let x = x + (place as u32 * LETTER.0 + column) * DOT + dot % DOT;
                        self.set(x, y + row as u32 * DOT + dot / DOT, [0; 3]);
                    }
                }
            }
        }
    }
}

/// Five rows of three dots; nothing for other letters.
fn dots(letter: char) -> [u8; 5] {
    match letter {
        '0' => [7, 5, 5, 5, 7],
        '1' => [2, 6, 2, 2, 7],
        '2' => [7, 1, 7, 4, 7],
        '3' => [7, 1, 7, 1, 7],
        '4' => [5, 5, 7, 1, 1],
        '5' => [7, 4, 7, 1, 7],
        '6' => [7, 4, 7, 5, 7],
        '7' => [7, 1, 2, 2, 2],
        '8' => [7, 5, 7, 5, 7],
        '9' => [7, 5, 7, 1, 7],
        '.' => [0, 0, 0, 0, 2],
        '%' => [5, 1, 2, 4, 5],
        'h' => [4, 4, 6, 5, 5],
        'l' => [4, 4, 4, 4, 6],
        'x' => [0, 5, 2, 5, 0],
        _ => [0; 5],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_shows_its_values_and_what_has_none_and_a_scale_beside() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.png");
        write_value_map(&path, (2, 1), &[0.0, f32::NAN], ValueScale { end: 100.0, unit: "%" }).unwrap();
        let image = image::open(&path).unwrap().to_rgb8();
        // Squares of 64 pixels, of which the map is 128 wide, and 120 high with its scale.
        assert_eq!(image.dimensions(), (128 + 110, 120));
        assert_eq!((image.get_pixel(10, 10).0, image.get_pixel(70, 10).0), ([68, 1, 84], UNKNOWN));
        assert_eq!(image.get_pixel(128 + 20, 8).0, [253, 231, 37]);
        let dark = image.pixels().filter(|pixel| pixel.0 == [0; 3]).count();
        assert!(dark > 100, "the numbers are not there: {dark} dots");
    }
}
