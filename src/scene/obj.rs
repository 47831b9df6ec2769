//! OBJ files: text to triangles with one material and one object name each.
//!
//! The text is first rewritten into a plain form (vertices first, absolute indices, one corner format per group) and
//! checked on the way, so that every error has its line; tobj then joins the index streams and triangulates. Without
//! the rewriting tobj shifts normals where only some faces of a group have them, and refuses tabs behind `usemtl`.

use std::fmt::Write;
use std::path::Path;

use glam::{Vec2, Vec3};

use super::names::NameList;
use crate::error::{Error, Result};

/// Triangles of one object and one material, with their own vertices.
#[derive(Debug, Default)]
pub(super) struct ObjPart {
    pub(super) object: String,
    /// Index into [`ObjFile::materials`].
    pub(super) material: usize,
    pub(super) positions: Vec<Vec3>,
    /// One a vertex, or none at all.
    pub(super) normals: Vec<Vec3>,
    /// One a vertex, or none at all.
    pub(super) uvs: Vec<Vec2>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// What an OBJ file holds.
#[derive(Debug, Default)]
pub(super) struct ObjFile {
    pub(super) parts: Vec<ObjPart>,
    /// Material files that it names.
    pub(super) libraries: Vec<String>,
    /// Names of the materials that its faces use, the empty one for faces without.
    pub(super) materials: Vec<String>,
}

/// Reads an OBJ file's bytes; `path` is for messages. Polygons are cut into fans, so they must be convex.
///
/// Errors: numbers that are none or not finite, indices out of range, no faces at all.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<ObjFile> {
    let mut plain = Plain::default();
    let text = String::from_utf8_lossy(bytes);
    for (number, line) in text.lines().enumerate() {
        plain.line(line).map_err(|problem| at_line(path, number + 1, problem))?;
    }
    plain.check_ranges(path)?;
    if plain.faces == 0 {
        let hint = "give a mesh of polygons (f lines)";
        return Err(Error::input(path.display().to_string(), "the OBJ file has no faces", hint));
    }
    let options = tobj::LoadOptions { single_index: true, triangulate: true, ..Default::default() };
    let named = || {
        let count = plain.materials.as_slice().len();
        let index = (0..count).map(|i| (i.to_string(), i)).collect();
        Ok((vec![tobj::Material::default(); count], index))
    };
    let text = format!("mtllib -\n{}{}", plain.vertices, plain.groups);
    let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, |_| named()).map_err(|error| {
        Error::input(path.display().to_string(), format!("the OBJ file cannot be read ({error})"), "mend the file")
    })?;
    let parts = models.into_iter().map(|model| part(model, plain.objects.as_slice())).collect();
    Ok(ObjFile { parts, libraries: plain.libraries, materials: plain.materials.as_slice().to_vec() })
}

fn part(model: tobj::Model, objects: &[String]) -> ObjPart {
    let mesh = model.mesh;
    let triples = |values: &[f32]| values.chunks_exact(3).map(Vec3::from_slice).collect::<Vec<_>>();
    ObjPart {
        object: model.name.parse().ok().and_then(|i: usize| objects.get(i)).cloned().unwrap_or_default(),
        material: mesh.material_id.unwrap_or(0),
        positions: triples(&mesh.positions),
        normals: triples(&mesh.normals).into_iter().map(Vec3::normalize_or_zero).collect(),
        uvs: mesh.texcoords.chunks_exact(2).map(Vec2::from_slice).collect(),
        triangles: mesh.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
    }
}

fn at_line(path: &Path, line: usize, problem: String) -> Error {
    Error::input(format!("{}, line {line}", path.display()), problem, "mend the file or export it again")
}

/// Which of `v/vt/vn` a face's corners have.
type CornerFormat = (bool, bool);

/// An OBJ file in plain form: object and material names as numbers, vertices before faces.
#[derive(Default)]
struct Plain {
    vertices: String,
    groups: String,
    libraries: Vec<String>,
    materials: NameList,
    objects: NameList,
    /// Lines read, for messages.
    lines: usize,
    faces: usize,
    /// Number of `v`, `vt`, `vn` so far.
    counts: [i64; 3],
    /// Largest index used of each, with its line.
    largest: [(i64, usize); 3],
    format: Option<CornerFormat>,
    object: usize,
    material: usize,
    /// Begin of a statement that a `\` at the line's end continues.
    unfinished: String,
}

impl Plain {
    fn line(&mut self, line: &str) -> Result<(), String> {
        self.lines += 1;
        let line = line.split('#').next().unwrap_or_default().trim();
        if let Some(begin) = line.strip_suffix('\\') {
            self.unfinished.push_str(begin);
            self.unfinished.push(' ');
            return Ok(());
        }
        if self.unfinished.is_empty() {
            return self.statement(line);
        }
        let whole = std::mem::take(&mut self.unfinished) + line;
        self.statement(&whole)
    }

    fn statement(&mut self, line: &str) -> Result<(), String> {
        let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        match key {
            "v" => self.vertex(0, "v", 3, rest),
            "vt" => self.vertex(1, "vt", 2, rest),
            "vn" => self.vertex(2, "vn", 3, rest),
            "f" => self.face(rest),
            "o" | "g" => {
                self.object = self.objects.position(rest);
                self.format = None;
                Ok(())
            }
            "usemtl" => {
                self.material = self.materials.position(rest);
                self.format = None;
                Ok(())
            }
            "mtllib" => {
                self.libraries.push(rest.to_owned());
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn vertex(&mut self, stream: usize, key: &str, wanted: usize, rest: &str) -> Result<(), String> {
        self.vertices.push_str(key);
        let mut words = rest.split_whitespace();
        for i in 0..wanted {
            let word = match words.next() {
                Some(word) => word,
                // A texture coordinate of one number lies on the line v = 0.
                None if stream == 1 && i == 1 => "0",
                None => return Err(format!("'{key} {rest}' has fewer than {wanted} numbers")),
            };
            match word.parse::<f32>() {
                Ok(value) if value.is_finite() => {}
                Ok(_) => return Err(format!("'{key} {rest}' is not finite")),
                Err(_) => return Err(format!("'{word}' in '{key} {rest}' is not a number")),
            }
            self.vertices.push(' ');
            self.vertices.push_str(word);
        }
        self.vertices.push('\n');
        self.counts[stream] += 1;
        Ok(())
    }

    fn face(&mut self, rest: &str) -> Result<(), String> {
        let mut corners = Vec::with_capacity(4);
        for word in rest.split_whitespace() {
            let mut corner = [None; 3];
            for (stream, index) in word.split('/').enumerate() {
                let slot = corner.get_mut(stream).ok_or_else(|| format!("the corner '{word}' has too many parts"))?;
                if !index.is_empty() {
                    *slot = Some(self.index(stream, index).ok_or_else(|| format!("'{word}' is not a face corner"))?);
                }
            }
            corners.push(corner);
        }
        let formats = |c: &[Option<i64>; 3]| (c[1].is_some(), c[2].is_some());
        if corners.len() < 3 || corners.iter().any(|c| c[0].is_none()) {
            return Err(format!("the face 'f {rest}' has fewer than three corners"));
        }
        // Corners that differ in what they have: keep what all of them have.
        let common = corners.iter().map(formats).fold((true, true), |a, b| (a.0 && b.0, a.1 && b.1));
        if self.format != Some(common) {
            self.format = Some(common);
            if self.materials.as_slice().is_empty() {
                self.material = self.materials.position("");
            }
            if self.objects.as_slice().is_empty() {
                self.object = self.objects.position("");
            }
            let _ = write!(self.groups, "g {}\nusemtl {}\n", self.object, self.material);
        }
        self.groups.push('f');
        for [v, vt, vn] in corners {
            let part = |wanted: bool, index: Option<i64>| index.filter(|_| wanted).map(|i| i.to_string());
            let (vt, vn) = (part(common.0, vt), part(common.1, vn));
            let v = v.unwrap_or_default();
            let _ = match (vt, vn) {
                (None, None) => write!(self.groups, " {v}"),
                (Some(vt), None) => write!(self.groups, " {v}/{vt}"),
                (vt, Some(vn)) => write!(self.groups, " {v}/{}/{vn}", vt.unwrap_or_default()),
            };
        }
        self.groups.push('\n');
        self.faces += 1;
        Ok(())
    }

    /// An index counted from 1, made absolute and kept for the range check.
    fn index(&mut self, stream: usize, text: &str) -> Option<i64> {
        let index: i64 = text.parse().ok()?;
        let absolute = if index < 0 { self.counts[stream].checked_add(index)? + 1 } else { index };
        if absolute > self.largest[stream].0 {
            self.largest[stream] = (absolute, self.lines);
        }
        (absolute >= 1).then_some(absolute)
    }

    fn check_ranges(&self, path: &Path) -> Result<()> {
        for (stream, what) in ["vertices", "texture coordinates", "normals"].into_iter().enumerate() {
            let ((largest, line), count) = (self.largest[stream], self.counts[stream]);
            if largest > count {
                let problem = format!("the face asks for number {largest} of {count} {what}");
                return Err(at_line(path, line, problem));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> ObjFile {
        parse(Path::new("a.obj"), text.as_bytes()).unwrap()
    }

    const SQUARE: &str = "v 0 0 0\nv\t1 0 0\r\nv 1 1 0\nv 0 1 0 1.0\n";

    #[test]
    fn negative_indices_tabs_and_polygons_are_read() {
        let file = read(&format!("{SQUARE}o quad\nusemtl\tred wall\nf -4 -3 -2 -1\nf 1\t2 3\n"));
        assert_eq!(file.materials, ["red wall"]);
        assert_eq!(file.parts.len(), 1);
        let part = &file.parts[0];
        assert_eq!((part.object.as_str(), part.triangles.len(), part.positions.len()), ("quad", 3, 4));
        assert_eq!(part.positions[part.triangles[1][2] as usize], Vec3::Y);
    }

    #[test]
    fn faces_with_and_without_normals_do_not_mix() {
        let file =
            read(&format!("{SQUARE}vn 0 0 1\nvt 0.5 0.5\nf 1 2 3\nf 1//1 2//1 3//1\nf 1/1/1 2/1/1 3/1\nf 1 3 4\n"));
        for part in &file.parts {
            assert!(part.normals.is_empty() || part.normals.len() == part.positions.len());
            assert!(part.uvs.is_empty() || part.uvs.len() == part.positions.len());
        }
        assert_eq!(file.parts.iter().map(|p| p.triangles.len()).sum::<usize>(), 4);
        assert_eq!(file.parts.iter().filter(|p| !p.normals.is_empty()).count(), 1);
    }

    #[test]
    fn faces_may_stand_before_their_vertices_and_lines_may_go_on() {
        let file = read(&format!("f 1 2 \\\n 3\n{SQUARE}"));
        assert_eq!(file.parts[0].triangles.len(), 1);
        assert_eq!(file.materials, [""]);
    }

    #[test]
    fn materials_change_within_an_object() {
        let file =
            read(&format!("{SQUARE}g a\nusemtl x\nf 1 2 3\nusemtl y\nf 1 3 4\ng b\nf 1 2 4\nusemtl x\nf 1 2 3\n"));
        let found: Vec<_> =
            file.parts.iter().map(|p| (p.object.as_str(), file.materials[p.material].as_str())).collect();
        assert_eq!(found, [("a", "x"), ("a", "y"), ("b", "y"), ("b", "x")]);
    }

    #[test]
    fn what_cannot_be_read_is_an_error_with_its_line() {
        let bad = [
            ("v 0 0 nan\nf 1 1 1", "line 1"),
            ("v 0 0 1e99\nf 1 1 1", "line 1"),
            ("v 0 0\nf 1 1 1", "line 1"),
            ("v 0 x 0\nf 1 1 1", "line 1"),
            ("v 0 0 0\nf 1 2 3", "line 2"),
            ("v 0 0 0\nf 1 1 0", "line 2"),
            ("v 0 0 0\nf 1 1 -2", "line 2"),
            ("v 0 0 0\nf 1 1", "line 2"),
            ("v 0 0 0\nf 1/1 1/1 1/1", "line 2"),
            ("v 0 0 0\nf 1//9223372036854775807 1 1", "line 2"),
            ("v 0 0 0\nf 1 1 /1", "line 2"),
            ("v 0 0 0\nf 1/1/1/1 1 1", "line 2"),
            ("v 0 0 0\n", "no faces"),
            ("", "no faces"),
        ];
        for (text, part) in bad {
            let error = parse(Path::new("a.obj"), text.as_bytes()).unwrap_err().to_string();
            assert!(error.contains("a.obj") && error.contains(part), "{text:?}: {error}");
        }
    }
}
