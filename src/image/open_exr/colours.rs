//! Colour spaces of OpenEXR parts.

use std::path::Path;

use exr::meta::MetaData;
use exr::meta::attribute::AttributeValue;
use exr::meta::header::Header;

use super::channels::text;
use crate::error::{Error, Result};
use crate::image::primaries::{ColourMatrix, Primaries, converted, known};

/// Attributes in which programs name the colour space by a word.
const NAMES: [&str; 2] = ["colorInteropID", "oiio:ColorSpace"];

/// Colour attributes of a part.
pub(super) struct Space {
    pub(super) primaries: Primaries,
    pub(super) matrix: Option<ColourMatrix>,
    /// A note on how they were interpreted, for people.
    pub(super) note: Option<String>,
}

/// The space of a part: its chromaticities, else the space that it names, else that of the format, Rec. 709.
///
/// # Errors
/// As text for the caller to place: chromaticities that span no colour space.
pub(super) fn space_of(header: &Header) -> Result<Space, String> {
    let point = |v: exr::prelude::Vec2<f32>| [f64::from(v.0), f64::from(v.1)];
    let stated = header.shared_attributes.chromaticities;
    let stated = stated.map(|c| Primaries([c.red, c.green, c.blue, c.white].map(point)));
    let word = named(header);
    let by_word = word.as_deref().and_then(known);
    let primaries = stated.or(by_word).unwrap_or(crate::image::primaries::REC_709);
    let matrix = primaries.to_rec_709()?;
    let note = match (&matrix, &word) {
        (Some(_), _) => Some(format!("its colours are converted from {} to Rec. 709", primaries.name())),
        // Words that do not say linear light.
        (None, Some(word)) if stated.is_none() && by_word.is_none() && is_encoded(word) => {
            Some(format!("it says that its colours are '{}'; they are taken for linear Rec. 709", word.escape_debug()))
        }
        _ => None,
    };
    Ok(Space { primaries, matrix, note })
}

fn named(header: &Header) -> Option<String> {
    let all = [&header.shared_attributes.other, &header.own_attributes.other];
    let found = NAMES.iter().find_map(|name| {
        let value = all.iter().find_map(|others| others.iter().find(|(key, _)| text(key) == *name))?.1;
        if let AttributeValue::Text(word) = value { Some(text(word)) } else { None }
    });
    found.filter(|word| !word.is_empty())
}

/// Whether a word names another space than linear Rec. 709 or data without one.
fn is_encoded(word: &str) -> bool {
    let linear = ["lin_rec709_scene", "lin_rec709", "lin_srgb", "linear", "scene_linear", "raw", "data", "unknown"];
    !linear.contains(&word.to_lowercase().as_str())
}

/// The matrix of each part, none where its values mean Rec. 709, and a note of each kind of conversion.
///
/// # Errors
/// Chromaticities that span no colour space.
pub(in crate::image) fn matrices(path: &Path, meta: &MetaData) -> Result<(Vec<Option<ColourMatrix>>, Vec<String>)> {
    let mut notes = Vec::new();
    let matrix = |header: &Header| {
        let space = space_of(header).map_err(|problem| refused(path, problem))?;
        notes.extend(space.note.filter(|note| !notes.contains(note)));
        Ok(space.matrix)
    };
    let matrices = meta.headers.iter().map(matrix).collect::<Result<_>>()?;
    Ok((matrices, notes))
}

pub(super) fn refused(path: &Path, problem: String) -> Error {
    let hint = "write it with the chromaticities of its colours, or without that attribute where they are Rec. 709";
    Error::input(path.display().to_string(), problem, hint)
}

/// Converts rows of red, green and blue.
pub(in crate::image) fn converted_rows(matrix: &ColourMatrix, rows: &mut [Vec<f32>; 3]) {
    let [reds, greens, blues] = rows;
    for ((red, green), blue) in reds.iter_mut().zip(greens).zip(blues) {
        [*red, *green, *blue] = converted(matrix, [*red, *green, *blue]);
    }
}
