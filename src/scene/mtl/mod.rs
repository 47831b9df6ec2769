//! MTL files: material descriptions as they are written, with the PBR extension.
//!
//! What is not as it should be is left out and counted. Counts name the line and the statement, and quote nothing else: the file
//! may be any file that a scene from elsewhere names.

mod dialect;
mod look;
mod maps;
mod shape;

use std::path::Path;

use glam::Vec3;

use super::Placing;
use super::lines::{LineError, Lines, text_of, without_comment};
use crate::error::{Error, Result, Warnings};
pub(super) use dialect::Writer;
pub(super) use look::{MtlLook, ShownLook, Through, look_of, roughness_of_shininess};
pub(super) use maps::MtlMap;
pub(super) use shape::{MaterialShape, SHAPE_BYTES, shape_of};

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
    /// `Tr`.
    pub(super) transparency: Option<f32>,
    pub(super) illumination: Option<u32>,
    pub(super) roughness: Option<f32>,
    pub(super) metallic: Option<f32>,
    pub(super) diffuse_map: Option<MtlMap>,
    pub(super) emission_map: Option<MtlMap>,
    pub(super) dissolve_map: Option<MtlMap>,
    /// `map_Pr`.
    pub(super) roughness_map: Option<MtlMap>,
    /// `map_Pm`.
    pub(super) metallic_map: Option<MtlMap>,
    /// `map_Ks`.
    pub(super) specular_map: Option<MtlMap>,
    /// `map_Ns`.
    pub(super) shininess_map: Option<MtlMap>,
    /// `norm`.
    pub(super) normal_map: Option<MtlMap>,
    /// `map_Bump` or `bump`: heights, or normals in blue, as many programs write them.
    pub(super) bump_map: Option<MtlMap>,
    /// Who wrote it.
    pub(super) writer: Writer,
}

/// What is left out of a file: how often, and the first line with its statement.
#[derive(Default)]
struct LeftOut {
    before_first: (usize, usize),
    values: (usize, usize, &'static str),
}

/// Statements that are read. Their names are written in any case.
const KEYS: [&str; 22] = [
    "Kd",
    "Ks",
    "Ke",
    "Tf",
    "Ns",
    "Ni",
    "d",
    "Tr",
    "illum",
    "Pr",
    "Pm",
    "map_Kd",
    "map_Ke",
    "map_d",
    "map_opacity",
    "map_Pr",
    "map_Pm",
    "map_Ks",
    "map_Ns",
    "map_Bump",
    "bump",
    "norm",
];

/// Reads an MTL file. Statements that say nothing about light transport here are skipped.
///
/// # Errors
/// What is no text.
pub(super) fn parse(path: &Path, text: &[u8], warnings: &mut Warnings) -> Result<Vec<MtlMaterial>> {
    let mut materials: Vec<MtlMaterial> = Vec::new();
    let mut left_out = LeftOut::default();
    let (mut reader, mut line, mut head) = (text, Vec::new(), String::new());
    let mut lines = Lines::of(&mut reader);
    loop {
        match lines.next(&mut line) {
            Ok(false) => break,
            Ok(true) => {}
            Err(LineError::Io(error)) => return Err(Error::io(path, "read the materials")(error)),
            Err(LineError::Unreadable(problem)) => {
                let place = format!("{}, line {}", path.display(), lines.count);
                return Err(Error::input(place, problem, "mend the material file"));
            }
        }
        let text = text_of(&line);
        let text = text.trim();
        if text.starts_with('#') {
            if materials.is_empty() && head.len() < 4096 {
                head.push_str(text);
                head.push('\n');
            }
            continue;
        }
        let (key, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
        if key.eq_ignore_ascii_case("newmtl") {
            materials.push(MtlMaterial { name: rest.trim().to_owned(), ..Default::default() });
            continue;
        }
        let Some(key) = KEYS.into_iter().find(|known| known.eq_ignore_ascii_case(key)) else { continue };
        let Some(material) = materials.last_mut() else {
            if left_out.before_first.0 == 0 {
                left_out.before_first.1 = lines.count;
            }
            left_out.before_first.0 += 1;
            continue;
        };
        if !material.state(key, rest.trim()) {
            if left_out.values.0 == 0 {
                (left_out.values.1, left_out.values.2) = (lines.count, key);
            }
            left_out.values.0 += 1;
        }
    }
    left_out.report(path, warnings);
    dialect::read_as_written(path, &head, &mut materials, warnings);
    Ok(materials)
}

impl LeftOut {
    fn report(&self, path: &Path, warnings: &mut Warnings) {
        let place = path.display();
        let (count, line) = self.before_first;
        if count > 0 {
            warnings.push(format!(
                "{place}: {count} statements before the first newmtl were left out (the first: line {line})"
            ));
        }
        let (count, line, key) = self.values;
        if count > 0 {
            warnings.push(format!(
                "{place}: {count} values are none that their statements take and were left out (the first: line {line}, '{key}')"
            ));
        }
    }
}

impl MtlMaterial {
    /// The maps that are used, in the order of which the first says how all lie.
    pub(super) fn maps(&self) -> impl Iterator<Item = &MtlMap> {
        let maps = [
            &self.diffuse_map,
            &self.dissolve_map,
            &self.emission_map,
            &self.roughness_map,
            &self.metallic_map,
            &self.normal_map,
            &self.bump_map,
            &self.specular_map,
            &self.shininess_map,
        ];
        maps.into_iter().flatten()
    }

    /// How a map lies beside the first, whose place the texture coordinates have taken.
    pub(super) fn placing(&self, map: &MtlMap) -> Placing {
        let first = self.maps().next().unwrap_or(map);
        let scale = map.scale / first.scale;
        let (scale, offset) = (scale, map.offset - first.offset * scale);
        // One that is scaled by 0 has no place for others.
        let is_placed = scale.is_finite() && offset.is_finite() && scale.x != 0.0 && scale.y != 0.0;
        let (scale, offset) = if is_placed { (scale, offset) } else { (Placing::PLAIN.scale, Placing::PLAIN.offset) };
        Placing { scale, offset, is_clamped: map.is_clamped }
    }

    /// What `Ks` says, or what its map is times: 1 where `Ks` is 0 or not stated.
    pub(super) fn specular_factor(&self) -> Vec3 {
        let stated = self.specular.unwrap_or(Vec3::ZERO);
        if self.specular_map.is_some() && stated == Vec3::ZERO { Vec3::ONE } else { stated }
    }

    /// What `Ns` says, or what its map is times: none, which is the most, where `Ns` is 0.
    pub(super) fn shininess_factor(&self) -> Option<f32> {
        self.shininess.filter(|ns| self.shininess_map.is_none() || *ns > 0.0)
    }

    /// Whether a statement of physically based materials says what it is: of its roughness or of its metal.
    fn is_pbr(&self) -> bool {
        let stated = self.roughness.is_some() || self.metallic.is_some();
        stated || self.roughness_map.is_some() || self.metallic_map.is_some()
    }

    /// Reads what follows a key. False where that is no value of it.
    fn state(&mut self, key: &str, rest: &str) -> bool {
        let values = without_comment(rest);
        let number = || number_of(values);
        let colour = || colour_of(values);
        let mut is_read = true;
        let mut keep = |slot: &mut Option<f32>, value: Option<f32>| {
            is_read = value.is_some();
            *slot = value.or(*slot);
        };
        match key {
            "Ns" => keep(&mut self.shininess, number()),
            "Ni" => keep(&mut self.ior, number()),
            "d" => keep(&mut self.dissolve, number()),
            "Tr" => keep(&mut self.transparency, number()),
            "Pr" => keep(&mut self.roughness, number()),
            "Pm" => keep(&mut self.metallic, number()),
            "illum" => {
                let value = number().filter(|value| *value >= 0.0);
                is_read = value.is_some();
                self.illumination = value.map(|value| value as u32).or(self.illumination);
            }
            "Kd" | "Ks" | "Ke" | "Tf" => {
                let slot = match key {
                    "Kd" => &mut self.diffuse,
                    "Ks" => &mut self.specular,
                    "Ke" => &mut self.emission,
                    _ => &mut self.transmission,
                };
                let value = colour();
                is_read = value.is_some();
                *slot = value.or(*slot);
            }
            _ => {
                let slot = match key {
                    "map_Kd" => &mut self.diffuse_map,
                    "map_Ke" => &mut self.emission_map,
                    "map_Pr" => &mut self.roughness_map,
                    "map_Pm" => &mut self.metallic_map,
                    "map_Ks" => &mut self.specular_map,
                    "map_Ns" => &mut self.shininess_map,
                    "norm" => &mut self.normal_map,
                    "map_Bump" | "bump" => &mut self.bump_map,
                    _ => &mut self.dissolve_map,
                };
                let map = MtlMap::parse(rest);
                is_read = map.is_some();
                *slot = map.or_else(|| slot.take());
            }
        }
        is_read
    }
}

fn number_of(text: &str) -> Option<f32> {
    // `d -halo 0.5` and `Tr 0  0` have more words than the number.
    let word = text.split_whitespace().find(|word| *word != "-halo")?;
    parsed(word)
}

/// A finite number, with a point or a comma before its decimals.
fn parsed(word: &str) -> Option<f32> {
    let number = word.parse().ok().or_else(|| {
        let (whole, decimals) = word.split_once(',')?;
        format!("{whole}.{decimals}").parse().ok()
    });
    number.filter(|v: &f32| v.is_finite())
}

/// One or three numbers of at least 0.
fn colour_of(text: &str) -> Option<Vec3> {
    let numbers: Vec<f32> = text.split_whitespace().take(4).map(parsed).collect::<Option<_>>()?;
    let colour = match numbers[..] {
        [v] => Vec3::splat(v),
        [r, g, b, ..] => Vec3::new(r, g, b),
        _ => return None,
    };
    (colour.min_element() >= 0.0).then_some(colour)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Vec<MtlMaterial> {
        parse(Path::new("a.mtl"), text.as_bytes(), &mut Warnings::new()).unwrap()
    }

    #[test]
    fn statements_are_read_whatever_their_spacing() {
        let text =
            "# head\r\nnewmtl red wall\r\n\tKd\t0.5 0.25 0 # Red\r\n  Ns 40\r\n Tr 0.25 0\r\n ILLUM 7\n Pr 0.5\nke 2\n";
        let material = read(text).remove(0);
        assert_eq!(material.name, "red wall");
        assert_eq!(material.diffuse, Some(Vec3::new(0.5, 0.25, 0.0)));
        assert_eq!(material.emission, Some(Vec3::splat(2.0)));
        assert_eq!((material.shininess, material.transparency), (Some(40.0), Some(0.25)));
        assert_eq!((material.illumination, material.roughness, material.metallic), (Some(7), Some(0.5), None));
    }

    #[test]
    fn names_keep_their_number_signs() {
        let names: Vec<String> =
            read("newmtl Material #25\nnewmtl Material #26\n").into_iter().map(|m| m.name).collect();
        assert_eq!(names, ["Material #25", "Material #26"]);
    }

    #[test]
    fn bad_values_are_left_out_with_their_line() {
        let bad = ["Kd 1 x 1", "Kd 1 2", "Ns", "Kd nan 0 0", "Kd -1 0 0", "map_Kd", "d", "illum x", "Kd xyz 1 1 1"];
        for text in bad {
            let mut warnings = Warnings::new();
            let text = format!("newmtl a\n{text}\nKs 0.5 0.5 0.5\n");
            let material = parse(Path::new("a.mtl"), text.as_bytes(), &mut warnings).unwrap().remove(0);
            let lines = warnings.lines();
            assert!(lines.len() == 1 && lines[0].contains("a.mtl") && lines[0].contains("line 2"), "{text}: {lines:?}");
            let rest = MtlMaterial { name: "a".into(), specular: Some(Vec3::splat(0.5)), ..Default::default() };
            assert_eq!(material, rest);
        }
        let mut warnings = Warnings::new();
        let found = parse(Path::new("a.mtl"), b"\nKd 1 1 1\nNs 20\nnewmtl a\nKd 1 1 1\n", &mut warnings).unwrap();
        let lines = warnings.lines();
        assert_eq!((found.len(), found[0].diffuse, found[0].shininess), (1, Some(Vec3::ONE), None));
        assert!(lines.len() == 1 && lines[0].contains("2 statements") && lines[0].contains("line 2"), "{lines:?}");
    }
}
