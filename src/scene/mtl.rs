//! MTL files: material descriptions as they are written, with the PBR extension.
//!
//! Errors name the line and the statement, and quote nothing else: the file may be any file that a scene from elsewhere
//! names.

use std::path::Path;

use glam::Vec3;

use crate::error::{Error, Result};

/// One `newmtl` of an MTL file; what is not stated is `None`.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct MtlMaterial {
    pub(super) name: String,
    pub(super) diffuse: Option<Vec3>,
    pub(super) specular: Option<Vec3>,
    pub(super) emission: Option<Vec3>,
    pub(super) transmission: Option<Vec3>,
    pub(super) shininess: Option<f32>,
    pub(super) ior: Option<f32>,
    pub(super) dissolve: Option<f32>,
    pub(super) illumination: Option<u32>,
    pub(super) roughness: Option<f32>,
    pub(super) metallic: Option<f32>,
    pub(super) diffuse_map: Option<String>,
    pub(super) emission_map: Option<String>,
    pub(super) dissolve_map: Option<String>,
    /// Whether options scale, move or clamp one of the maps, which is not done here.
    pub(super) has_placed_maps: bool,
}

/// Reads the text of an MTL file. Statements that say nothing about light transport here are skipped.
///
/// # Errors
/// A number that is none, with its line; a property before the first `newmtl`.
pub(super) fn parse(path: &Path, text: &str) -> Result<Vec<MtlMaterial>> {
    let mut materials: Vec<MtlMaterial> = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default().trim();
        let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        if key.is_empty() {
            continue;
        }
        if key == "newmtl" {
            materials.push(MtlMaterial { name: rest.to_owned(), ..Default::default() });
            continue;
        }
        let refuse = |problem: String| {
            let place = format!("{}, line {}", path.display(), number + 1);
            Error::input(place, problem, "mend the material file")
        };
        let Some(material) = materials.last_mut() else {
            return Err(refuse("a statement stands before the first newmtl".into()));
        };
        let number = || number_of(rest).ok_or_else(|| refuse(format!("'{key}' should give one number")));
        let colour = || {
            let colour = colour_of(rest).ok_or_else(|| refuse(format!("'{key}' should give one or three numbers")))?;
            if colour.min_element() < 0.0 { Err(refuse(format!("'{key}' is negative"))) } else { Ok(colour) }
        };
        match key {
            "Kd" => material.diffuse = Some(colour()?),
            "Ks" => material.specular = Some(colour()?),
            "Ke" => material.emission = Some(colour()?),
            "Tf" => material.transmission = Some(colour()?),
            "Ns" => material.shininess = Some(number()?),
            "Ni" => material.ior = Some(number()?),
            "d" => material.dissolve = Some(number()?),
            "Tr" => material.dissolve = material.dissolve.or(Some(1.0 - number()?)),
            "illum" => material.illumination = Some(number()?.max(0.0) as u32),
            "Pr" => material.roughness = Some(number()?),
            "Pm" => material.metallic = Some(number()?),
            "map_Kd" | "map_Ke" | "map_d" => {
                material.has_placed_maps |= places_map(rest);
                let map = match key {
                    "map_Kd" => &mut material.diffuse_map,
                    "map_Ke" => &mut material.emission_map,
                    _ => &mut material.dissolve_map,
                };
                *map = map_of(rest);
            }
            _ => {}
        }
    }
    Ok(materials)
}

fn number_of(text: &str) -> Option<f32> {
    // `d -halo 0.5` and `Tr 0  0` have more words than the number.
    let word = text.split_whitespace().find(|word| *word != "-halo")?;
    word.parse().ok().filter(|v: &f32| v.is_finite())
}

fn colour_of(text: &str) -> Option<Vec3> {
    let numbers: Vec<f32> = text.split_whitespace().map(|w| w.parse().ok()).collect::<Option<_>>()?;
    let colour = match numbers[..] {
        [v] => Vec3::splat(v),
        [r, g, b, ..] => Vec3::new(r, g, b),
        _ => return None,
    };
    colour.is_finite().then_some(colour)
}

/// Whether a map's options scale, move or clamp it.
fn places_map(text: &str) -> bool {
    let words: Vec<&str> = text.split_whitespace().collect();
    words.iter().enumerate().any(|(at, option)| {
        let mut numbers = words[at + 1..].iter().map_while(|word| word.parse::<f32>().ok());
        match *option {
            "-s" => numbers.any(|scale| scale != 1.0),
            "-o" | "-t" => numbers.any(|offset| offset != 0.0),
            "-clamp" => words.get(at + 1) == Some(&"on"),
            _ => false,
        }
    })
}

/// The file name behind a map's options (`-s 2 2 1 -bm 0.5 wood.png`); names may contain spaces.
fn map_of(text: &str) -> Option<String> {
    let mut rest = text;
    while rest.starts_with('-') {
        let (option, after) = rest.split_once(char::is_whitespace)?;
        rest = after.trim_start();
        let takes_word = matches!(option, "-blendu" | "-blendv" | "-cc" | "-clamp" | "-imfchan" | "-type");
        while let Some((word, after)) = rest.split_once(char::is_whitespace) {
            if !takes_word && word.parse::<f32>().is_err() {
                break;
            }
            rest = after.trim_start();
            if takes_word {
                break;
            }
        }
    }
    (!rest.is_empty()).then(|| rest.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Vec<MtlMaterial> {
        parse(Path::new("a.mtl"), text).unwrap()
    }

    #[test]
    fn statements_are_read_whatever_their_spacing() {
        let text =
            "# head\r\nnewmtl red wall\r\n\tKd\t0.5 0.25 0 # Red\r\n  Ns 40\r\n Tr 0.25 0\r\n illum 7\n Pr 0.5\nKe 2\n";
        let material = read(text).remove(0);
        assert_eq!(material.name, "red wall");
        assert_eq!(material.diffuse, Some(Vec3::new(0.5, 0.25, 0.0)));
        assert_eq!(material.emission, Some(Vec3::splat(2.0)));
        assert_eq!((material.shininess, material.dissolve), (Some(40.0), Some(0.75)));
        assert_eq!((material.illumination, material.roughness, material.metallic), (Some(7), Some(0.5), None));
    }

    #[test]
    fn maps_are_found_behind_their_options() {
        assert_eq!(map_of("wood.png").as_deref(), Some("wood.png"));
        let placed = |options: &str| read(&format!("newmtl a\nmap_Kd {options} wood.png\n"))[0].has_placed_maps;
        assert!(placed("-s 4 4 1") && placed("-s 1 4 1") && placed("-o 0.5 0") && placed("-clamp on"));
        assert!(!placed("") && !placed("-s 1 1 1 -o 0 0 0 -clamp off -bm 0.5"));
        assert_eq!(map_of("-s 2 2 1 -clamp on tex\\my wood.png").as_deref(), Some("tex\\my wood.png"));
        assert_eq!(map_of("-bm 0.5 4.png").as_deref(), Some("4.png"));
        assert_eq!(map_of(""), None);
    }

    #[test]
    fn bad_numbers_are_errors_with_their_line() {
        for text in ["newmtl a\nKd 1 x 1", "newmtl a\nKd 1 2", "newmtl a\nNs", "newmtl a\nKd nan 0 0", "\nKd 1 1 1"] {
            let error = parse(Path::new("a.mtl"), text).unwrap_err().to_string();
            assert!(error.contains("a.mtl, line 2"), "{error}");
        }
        assert!(parse(Path::new("a.mtl"), "newmtl a\nKd -1 0 0").unwrap_err().to_string().contains("negative"));
    }
}
