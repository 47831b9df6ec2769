//! Several looks on one sheet.

use ab_glyph::{Font, FontRef, ScaleFont, point};

use super::display::Shown;
use ltm::error::{Error, Result};

/// Width of a picture on the sheet at most, in pixels; room between pictures, and below each for its name.
const WIDEST: usize = 960;
const GAP: usize = 24;
const CAPTION: usize = 40;
/// Height of letters, in pixels.
const LETTERS: f32 = 24.0;
/// Greys of the sheet and of what is written on it.
const PAPER: u8 = 24;
const INK: u8 = 220;

/// Pictures of one size side by side in rows, each over its name: about as many across as down.
///
/// # Errors
/// There is none, or they differ in size.
pub fn contact_sheet(pictures: &[(String, Shown)]) -> Result<Shown> {
    let refuse = |problem: &str| Err(Error::input("the contact sheet", problem, "keep a snapshot"));
    let Some((_, first)) = pictures.first() else { return refuse("has no pictures") };
    if pictures.iter().any(|(_, shown)| shown.size != first.size) || first.size.contains(&0) {
        return refuse("has pictures of several sizes");
    }
    let step = first.size[0].div_ceil(WIDEST);
    let [width, height] = first.size.map(|v| v.div_ceil(step));
    let across = (pictures.len() as f64).sqrt().ceil() as usize;
    let down = pictures.len().div_ceil(across);
    let size = [across * (width + GAP) + GAP, down * (height + CAPTION + GAP) + GAP];
    let mut sheet = Canvas { size, rgba: [PAPER, PAPER, PAPER, 255].repeat(size[0] * size[1]) };
    for (index, (name, shown)) in pictures.iter().enumerate() {
        let left = GAP + index % across * (width + GAP);
        let top = GAP + index / across * (height + CAPTION + GAP);
        for y in 0..height {
            for x in 0..width {
                let from = (y * step * shown.size[0] + x * step) * 4;
                sheet.put([left + x, top + y], &shown.rgba[from..from + 3]);
            }
        }
        sheet.write([left, top + height + 6], width, name)?;
    }
    Ok(Shown { size: sheet.size, rgba: sheet.rgba, histogram: Vec::new() })
}

struct Canvas {
    size: [usize; 2],
    rgba: Vec<u8>,
}

impl Canvas {
    fn put(&mut self, [x, y]: [usize; 2], colour: &[u8]) {
        let at = (y * self.size[0] + x) * 4;
        self.rgba[at..at + 3].copy_from_slice(colour);
    }

    /// Writes a line of text, cut where it would be wider than `width`.
    fn write(&mut self, [left, top]: [usize; 2], width: usize, text: &str) -> Result<()> {
        let font = FontRef::try_from_slice(epaint_default_fonts::UBUNTU_LIGHT)
            .map_err(|error| Error::input("the built-in typeface", error.to_string(), ""))?;
        let scaled = font.as_scaled(LETTERS);
        let mut pen = 0.0;
        for letter in text.chars() {
            let glyph = scaled.scaled_glyph(letter);
            let advance = scaled.h_advance(glyph.id);
            if pen + advance > width as f32 {
                break;
            }
            let glyph = glyph.id.with_scale_and_position(LETTERS, point(pen, scaled.ascent()));
            if let Some(outlined) = font.outline_glyph(glyph) {
                let bounds = outlined.px_bounds();
                outlined.draw(|x, y, share| {
                    let at = [left as f32 + bounds.min.x + x as f32, top as f32 + bounds.min.y + y as f32];
                    let inside = (0..2).all(|axis| at[axis] >= 0.0 && (at[axis] as usize) < self.size[axis]);
                    if inside {
                        let value = f32::from(PAPER) + (f32::from(INK) - f32::from(PAPER)) * share.clamp(0.0, 1.0);
                        self.put(at.map(|v| v as usize), &[value as u8; 3]);
                    }
                });
            }
            pen += advance;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(value: u8, size: [usize; 2]) -> Shown {
        Shown { size, rgba: [value, value, value, 255].repeat(size[0] * size[1]), histogram: Vec::new() }
    }

    #[test]
    fn pictures_stand_in_rows_over_their_names() {
        let pictures: Vec<_> = (0..3).map(|i| (format!("Look {i}"), grey(100 + i, [200, 30]))).collect();
        let sheet = contact_sheet(&pictures).unwrap();
        assert_eq!(sheet.size, [2 * 224 + 24, 2 * (30 + 40 + 24) + 24]);
        let at = |x: usize, y: usize| sheet.rgba[(y * sheet.size[0] + x) * 4];
        assert_eq!([at(30, 30), at(30 + 224, 30), at(30, 30 + 94), at(0, 0)], [100, 101, 102, PAPER]);
        let written = |left: usize, top: usize| (0..200).any(|x| (0..34).any(|y| at(left + x, top + y) > 150));
        assert!(written(24, 56) && written(248, 56) && written(24, 150), "each has a name");
        assert!(!written(248, 150), "where no picture stands, no name does");
        assert!(contact_sheet(&[]).is_err());
        assert!(contact_sheet(&[("a".into(), grey(1, [2, 2])), ("b".into(), grey(1, [2, 3]))]).is_err());
        let large = contact_sheet(&[("wide".into(), grey(9, [4000, 10]))]).unwrap();
        assert_eq!(large.size[0], 800 + 2 * GAP);
    }
}
