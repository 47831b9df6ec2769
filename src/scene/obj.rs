//! OBJ files: text to triangles with one material and one object name each.
//!
//! One pass over the lines keeps the three vertex streams and the corners of the faces, which may stand before their
//! vertices; the parts are then made one at a time. Errors name the line and the statement, and quote nothing else: the
//! file may be any file that a scene from elsewhere names.

use std::collections::HashMap;
use std::io::{BufRead, Read};
use std::path::Path;

use glam::{DVec2, DVec3, Vec2, Vec3};

use super::Vertex;
use super::memory::Memory;
use super::names::NameList;
use crate::error::{Error, Result};

/// Longest line, with those that it continues. A line is held as text.
const MAX_LINE_BYTES: u64 = 16 << 20;
/// Lines after which the memory is looked at.
const LINES_BETWEEN_LOOKS: usize = 1 << 12;

/// Triangles of one object and one material, with their own vertices.
#[derive(Debug, Default)]
pub(super) struct ObjPart {
    /// Index into [`ObjFile::objects`].
    pub(super) object: usize,
    /// Index into [`ObjFile::materials`].
    pub(super) material: usize,
    pub(super) positions: Vec<DVec3>,
    /// One a vertex, or none at all.
    pub(super) normals: Vec<Vec3>,
    /// One a vertex, or none at all.
    pub(super) uvs: Vec<Vec2>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl ObjPart {
    /// Its vertices, with zeros where it has no normals or texture coordinates, and positions in f32.
    pub(super) fn vertices(&self) -> impl Iterator<Item = Vertex> + '_ {
        self.positions.iter().enumerate().map(|(at, position)| Vertex {
            position: position.as_vec3(),
            normal: self.normals.get(at).copied().unwrap_or_default(),
            uv: self.uvs.get(at).copied().unwrap_or_default(),
        })
    }
}

/// What an OBJ file holds.
#[derive(Debug, Default)]
pub(super) struct ObjFile {
    /// Material files that it names.
    pub(super) libraries: Vec<String>,
    /// Names of the materials that its faces use, the empty one for faces without.
    pub(super) materials: NameList,
    /// Names of its objects, the empty one for faces without.
    pub(super) objects: NameList,
    positions: Vec<DVec3>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
    /// Corners of all faces: places in the three streams, 0 where a group has no such stream.
    corners: Vec<[u32; 3]>,
    /// Corners of each face.
    arities: Vec<u32>,
    groups: Vec<Group>,
    /// Largest index used of each stream, counted from 1, with its line.
    largest: [(i64, usize); 3],
}

/// Faces that follow each other with one object, one material and one corner format.
#[derive(Debug)]
struct Group {
    object: usize,
    material: usize,
    format: CornerFormat,
    faces: usize,
    corners: usize,
}

/// Whether a face's corners have texture coordinates and normals.
type CornerFormat = (bool, bool);

/// Reads an OBJ file; `path` is for messages. Polygons are cut into fans, so they must be convex.
///
/// # Errors
/// What cannot be read, numbers that are none or not finite, indices out of range, no faces at all, more than `memory`
/// holds.
pub(super) fn parse(path: &Path, mut reader: &mut dyn BufRead, memory: &Memory) -> Result<ObjFile> {
    let mut parser = Parser::default();
    let mut line = Vec::new();
    loop {
        line.clear();
        let read = (&mut reader).take(MAX_LINE_BYTES).read_until(b'\n', &mut line);
        if read.map_err(Error::io(path, "read the geometry"))? == 0 {
            break;
        }
        if line.len() as u64 == MAX_LINE_BYTES {
            return Err(at_line(path, parser.lines + 1, "the line is too long to be one".into()));
        }
        let text = String::from_utf8_lossy(&line);
        parser.line(&text).map_err(|problem| at_line(path, parser.lines, problem))?;
        if parser.lines.is_multiple_of(LINES_BETWEEN_LOOKS) {
            memory.check(parser.file.bytes(), path)?;
        }
    }
    let file = parser.file;
    memory.check(file.bytes(), path)?;
    file.check_ranges(path)?;
    if file.arities.is_empty() {
        let hint = "give a mesh of polygons (f lines)";
        return Err(Error::input(path.display().to_string(), "the OBJ file has no faces", hint));
    }
    Ok(file)
}

fn at_line(path: &Path, line: usize, problem: String) -> Error {
    Error::input(format!("{}, line {line}", path.display()), problem, "mend the file or export it again")
}

impl ObjFile {
    /// Bytes that it holds.
    pub(super) fn bytes(&self) -> u64 {
        let streams = (2 * self.positions.capacity() + self.normals.capacity() + self.corners.capacity()) * 12;
        let faces = self.arities.capacity() * 4 + self.groups.capacity() * size_of::<Group>();
        let names: usize = self.libraries.iter().map(|name| name.len() + size_of::<String>()).sum();
        (streams + self.uvs.capacity() * 8 + faces + names) as u64 + self.materials.bytes() + self.objects.bytes()
    }

    /// Its parts, each made when it is asked for.
    pub(super) fn parts(&self) -> impl Iterator<Item = ObjPart> {
        let (mut corners, mut arities) = (self.corners.as_slice(), self.arities.as_slice());
        self.groups.iter().map(move |group| {
            let (here, there) = corners.split_at(group.corners);
            let (faces, after) = arities.split_at(group.faces);
            (corners, arities) = (there, after);
            self.part(group, here, faces)
        })
    }

    /// Vertices in the order in which they first occur, one for each triple of indices.
    fn part(&self, group: &Group, mut corners: &[[u32; 3]], faces: &[u32]) -> ObjPart {
        let mut part = ObjPart { object: group.object, material: group.material, ..ObjPart::default() };
        let mut known: HashMap<[u32; 3], u32> = HashMap::new();
        for &arity in faces {
            let (face, rest) = corners.split_at(arity as usize);
            corners = rest;
            let mut vertex = |corner: &[u32; 3]| {
                let next = part.positions.len() as u32;
                *known.entry(*corner).or_insert_with(|| {
                    let [v, vt, vn] = corner.map(|place| place as usize);
                    part.positions.push(self.positions[v]);
                    if group.format.0 {
                        part.uvs.push(self.uvs[vt]);
                    }
                    if group.format.1 {
                        part.normals.push(self.normals[vn].normalize_or_zero());
                    }
                    next
                })
            };
            let (first, mut last) = (vertex(&face[0]), vertex(&face[1]));
            for corner in &face[2..] {
                let next = vertex(corner);
                part.triangles.push([first, last, next]);
                last = next;
            }
        }
        part
    }

    fn check_ranges(&self, path: &Path) -> Result<()> {
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        for (stream, what) in ["vertices", "texture coordinates", "normals"].into_iter().enumerate() {
            let ((largest, line), count) = (self.largest[stream], counts[stream].min(u32::MAX as usize));
            if largest > count as i64 {
                let problem = format!("the face asks for number {largest} of {count} {what}");
                return Err(at_line(path, line, problem));
            }
        }
        Ok(())
    }
}

/// A file while its lines go by.
#[derive(Default)]
struct Parser {
    file: ObjFile,
    /// Lines read, for messages.
    lines: usize,
    /// Format of the group that faces are added to; none where the next face begins one.
    format: Option<CornerFormat>,
    object: usize,
    material: usize,
    /// Begin of a statement that a `\` at the line's end continues.
    unfinished: String,
}

impl Parser {
    fn line(&mut self, line: &str) -> Result<(), String> {
        self.lines += 1;
        let line = line.split('#').next().unwrap_or_default().trim();
        if let Some(begin) = line.strip_suffix('\\') {
            self.unfinished.push_str(begin);
            self.unfinished.push(' ');
            if self.unfinished.len() as u64 > MAX_LINE_BYTES {
                return Err("the statement is too long to be one".into());
            }
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
            "v" => self.file.positions.push(DVec3::from_array(numbers("v", rest)?)),
            "vn" => self.file.normals.push(DVec3::from_array(numbers("vn", rest)?).as_vec3()),
            "vt" => self.file.uvs.push(DVec2::from_array(numbers("vt", rest)?).as_vec2()),
            "f" => self.face(rest)?,
            "o" | "g" => {
                self.object = self.file.objects.position(rest);
                self.format = None;
            }
            "usemtl" => {
                self.material = self.file.materials.position(rest);
                self.format = None;
            }
            "mtllib" => self.file.libraries.push(rest.to_owned()),
            _ => {}
        }
        Ok(())
    }

    fn face(&mut self, rest: &str) -> Result<(), String> {
        let begin = self.file.corners.len();
        // Corners that differ in what they have: keep what all of them have.
        let (mut common, mut arity) = ((true, true), 0);
        for word in rest.split_whitespace() {
            let mut corner = [None; 3];
            for (stream, index) in word.split('/').enumerate() {
                let slot = corner.get_mut(stream).ok_or("a corner of the face has more than three parts")?;
                if !index.is_empty() {
                    *slot = Some(self.index(stream, index).ok_or("a corner of the face is not made of indices")?);
                }
            }
            let [Some(v), vt, vn] = corner else {
                return Err("a corner of the face has no vertex".into());
            };
            common = (common.0 && vt.is_some(), common.1 && vn.is_some());
            self.file.corners.push([v, vt.unwrap_or(0), vn.unwrap_or(0)]);
            arity += 1;
        }
        if arity < 3 {
            return Err("the face has fewer than three corners".into());
        }
        for corner in &mut self.file.corners[begin..] {
            let [_, vt, vn] = corner;
            *vt *= u32::from(common.0);
            *vn *= u32::from(common.1);
        }
        if self.format != Some(common) {
            self.format = Some(common);
            if self.file.materials.as_slice().is_empty() {
                self.material = self.file.materials.position("");
            }
            if self.file.objects.as_slice().is_empty() {
                self.object = self.file.objects.position("");
            }
            let (object, material) = (self.object, self.material);
            self.file.groups.push(Group { object, material, format: common, faces: 0, corners: 0 });
        }
        let group = self.file.groups.last_mut().expect("a face has a group");
        group.faces += 1;
        group.corners += arity as usize;
        self.file.arities.push(arity);
        Ok(())
    }

    /// The place in a stream of an index that is counted from 1, or backwards from -1; its range is checked at the end.
    fn index(&mut self, stream: usize, text: &str) -> Option<u32> {
        let index: i64 = text.parse().ok()?;
        let count = [self.file.positions.len(), self.file.uvs.len(), self.file.normals.len()][stream] as i64;
        let absolute = if index < 0 { count.checked_add(index)? + 1 } else { index };
        if absolute > self.file.largest[stream].0 {
            self.file.largest[stream] = (absolute, self.lines);
        }
        (absolute >= 1).then(|| (absolute - 1) as u32)
    }
}

/// The first `N` numbers of a statement. A texture coordinate of one number lies on the line v = 0.
fn numbers<const N: usize>(key: &str, rest: &str) -> Result<[f64; N], String> {
    let mut words = rest.split_whitespace();
    let mut numbers = [0.0f64; N];
    for (i, number) in numbers.iter_mut().enumerate() {
        let Some(word) = words.next() else {
            if key == "vt" && i == 1 {
                break;
            }
            return Err(format!("the statement '{key}' has fewer than {N} numbers"));
        };
        *number = word.parse().map_err(|_| format!("number {} of the statement '{key}' is none", i + 1))?;
        if !(*number as f32).is_finite() {
            return Err(format!("number {} of the statement '{key}' is not finite", i + 1));
        }
    }
    Ok(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<ObjFile> {
        parse(Path::new("a.obj"), &mut text.as_bytes(), &Memory::of(u64::MAX))
    }

    fn read(text: &str) -> (ObjFile, Vec<ObjPart>) {
        let file = parsed(text).unwrap();
        let parts = file.parts().collect();
        (file, parts)
    }

    const SQUARE: &str = "v 0 0 0\nv\t1 0 0\r\nv 1 1 0\nv 0 1 0 1.0\n";

    #[test]
    fn negative_indices_tabs_and_polygons_are_read() {
        let (file, parts) = read(&format!("{SQUARE}o quad\nusemtl\tred wall\nf -4 -3 -2 -1\nf 1\t2 3\n"));
        assert_eq!(file.materials.as_slice(), ["red wall"]);
        assert_eq!(parts.len(), 1);
        let part = &parts[0];
        assert_eq!(file.objects.as_slice()[part.object], "quad");
        assert_eq!((part.triangles.len(), part.positions.len()), (3, 4));
        assert_eq!(part.positions[part.triangles[1][2] as usize], DVec3::Y);
    }

    #[test]
    fn faces_with_and_without_normals_do_not_mix() {
        let (_, parts) =
            read(&format!("{SQUARE}vn 0 0 1\nvt 0.5 0.5\nf 1 2 3\nf 1//1 2//1 3//1\nf 1/1/1 2/1/1 3/1\nf 1 3 4\n"));
        for part in &parts {
            assert!(part.normals.is_empty() || part.normals.len() == part.positions.len());
            assert!(part.uvs.is_empty() || part.uvs.len() == part.positions.len());
        }
        assert_eq!(parts.iter().map(|p| p.triangles.len()).sum::<usize>(), 4);
        assert_eq!(parts.iter().filter(|p| !p.normals.is_empty()).count(), 1);
    }

    #[test]
    fn faces_may_stand_before_their_vertices_and_lines_may_go_on() {
        let (file, parts) = read(&format!("f 1 2 \\\n 3\n{SQUARE}"));
        assert_eq!(parts[0].triangles.len(), 1);
        assert_eq!(file.materials.as_slice(), [""]);
    }

    #[test]
    fn materials_change_within_an_object() {
        let (file, parts) =
            read(&format!("{SQUARE}g a\nusemtl x\nf 1 2 3\nusemtl y\nf 1 3 4\ng b\nf 1 2 4\nusemtl x\nf 1 2 3\n"));
        let found: Vec<_> = parts
            .iter()
            .map(|p| (file.objects.as_slice()[p.object].as_str(), file.materials.as_slice()[p.material].as_str()))
            .collect();
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
            let error = parsed(text).unwrap_err().to_string();
            assert!(error.contains("a.obj") && error.contains(part), "{text:?}: {error}");
        }
    }

    #[test]
    fn a_polygon_is_a_fan_and_memory_is_counted_while_lines_are_read() {
        let (_, parts) = read(&format!("{SQUARE}v 0 0.5 0\nf 1 2 3 4 5\n"));
        assert_eq!(parts[0].triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
        let many = "v 0 0 0\n".repeat(10_000);
        let error = parse(Path::new("a.obj"), &mut many.as_bytes(), &Memory::of(50_000)).unwrap_err();
        assert!(matches!(error, Error::Resources { .. }), "{error}");
        let endless =
            parse(Path::new("a.obj"), &mut std::io::BufReader::new(std::io::repeat(b'v')), &Memory::of(1 << 20));
        assert!(endless.unwrap_err().to_string().contains("too long"));
    }

    #[test]
    fn errors_quote_nothing_of_the_file() {
        for text in ["v secret 0 0\n", "vt secret\n", "f secret 1 1\n", "f 1/2/3/secret 1 1\n", "f 1 2secret 3\n"] {
            assert!(!parsed(text).unwrap_err().to_string().contains("secret"), "{text}");
        }
    }
}
