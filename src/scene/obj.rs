//! OBJ files: from text to triangles, each with a material and an object name.
//!
//! One pass over the lines keeps the three vertex streams and the corners of the faces, which may precede their
//! vertices. The parts are then made one at a time. Invalid elements are left out and counted. Errors and counts name
//! the line and quote nothing else, since the file may be any file that a scene from elsewhere names.

use std::collections::HashMap;
use std::io::BufRead;
use std::path::Path;

use glam::{DVec2, DVec3, Vec2, Vec3};

use super::Vertex;
use super::lines::{LineError, Lines, MAX_LINE_BYTES, text_of, without_comment};
use super::memory::MemoryBound;
use super::names::NameList;
use super::polygon;
use super::smoothing::{GroupNormals, SMOOTHING_BYTES, normal_of};
use crate::error::{Error, Result, Warnings};

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
    /// Whether the normals are those of a smoothing group, which say nothing of the faces' fronts.
    pub(super) is_smoothed: bool,
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

/// A kind of element that is left out or repaired.
#[derive(Clone, Copy, Debug)]
enum ObjFault {
    Vertex,
    Normal,
    Coordinate,
    Comma,
    Short,
    Corner,
    Crossing,
    Line,
    FreeForm,
    Colour,
}

/// What is said of each, behind how many there are.
const FAULTS: [&str; 10] = [
    "vertices are not three finite numbers: faces at them were left out",
    "normals are not three finite numbers, or none of the file: the faces' own stand for them",
    "texture coordinates are no finite numbers, or none of the file: 0 stands for them",
    "numbers with a decimal comma were read as with a point",
    "faces of fewer than three corners were left out",
    "faces were left out that name something other than vertices of the file",
    "polygons cross themselves; they may be filled otherwise than they were drawn",
    "points and lines were left out",
    "curves and free-form surfaces are not read; export them as polygons",
    "vertices have colours, which are not used",
];

/// How often each fault was found, and on which line first; 0 where that is not known.
#[derive(Clone, Debug, Default)]
pub(super) struct Faults([(usize, usize); FAULTS.len()]);

impl Faults {
    fn note(&mut self, fault: ObjFault, line: usize) {
        let (count, first) = &mut self.0[fault as usize];
        *count += 1;
        if *first == 0 {
            *first = line;
        }
    }

    /// Adds those that were found elsewhere.
    pub(super) fn add(&mut self, other: &Self) {
        for ((count, first), (more, line)) in self.0.iter_mut().zip(&other.0) {
            *count += more;
            if *first == 0 {
                *first = *line;
            }
        }
    }

    /// One line for each kind that there is.
    pub(super) fn report(&self, path: &Path, warnings: &mut Warnings) {
        for ((count, first), what) in self.0.iter().zip(FAULTS).filter(|((count, _), _)| *count > 0) {
            let line = if *first > 0 { format!(" (the first: line {first})") } else { String::new() };
            warnings.push(format!("{}: {count} {what}{line}", path.display()));
        }
    }

    fn has(&self, fault: ObjFault) -> bool {
        self.0[fault as usize].0 > 0
    }
}

/// The content of an OBJ file.
#[derive(Debug, Default)]
pub(super) struct ObjFile {
    /// What follows `mtllib`, as it stands: one name or several.
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
    /// Largest index of a vertex that is used, counted from 1, with its line.
    largest: (i64, usize),
    /// Faults of its lines; those of its parts come later.
    pub(super) faults: Faults,
}

/// Faces that follow each other with one object, one material and one corner format.
#[derive(Debug)]
struct Group {
    object: usize,
    material: usize,
    format: CornerFormat,
    /// Smoothing group of faces without normals; 0 is none.
    smoothing: u32,
    faces: usize,
    corners: usize,
}

/// Whether a face's corners have texture coordinates, and normals.
type CornerFormat = (bool, bool);

/// The place of what a face names and no file can have.
const NOWHERE: u32 = u32::MAX;

/// Statements that give names, in which `#` is a letter.
const NAMING: [&str; 4] = ["g", "o", "usemtl", "mtllib"];
/// Statements of curves and free-form surfaces.
const FREE_FORM: [&str; 3] = ["curv", "curv2", "surf"];

/// Reads an OBJ file; `path` is for messages.
///
/// # Errors
/// What cannot be read or is no text, no faces at all, more than `memory` holds.
pub(super) fn parse(path: &Path, reader: &mut dyn BufRead, memory: &MemoryBound) -> Result<ObjFile> {
    let mut parser = Parser::default();
    let (mut lines, mut line) = (Lines::of(reader), Vec::new());
    loop {
        match lines.next(&mut line) {
            Ok(false) => break,
            Ok(true) => {}
            Err(LineError::Io(error)) => return Err(Error::io(path, "read the geometry")(error)),
            Err(LineError::Unreadable(problem)) => return Err(at_line(path, lines.count, problem)),
        }
        parser.lines = lines.count;
        parser.line(&text_of(&line)).map_err(|problem| at_line(path, lines.count, problem))?;
        if lines.count.is_multiple_of(LINES_BETWEEN_LOOKS) {
            memory.check(parser.file.bytes(), path)?;
        }
    }
    let mut file = parser.file;
    let smoothed: usize = file.groups.iter().filter(|group| group.smoothing > 0).map(|group| group.corners).sum();
    memory.check(file.bytes() + (smoothed * SMOOTHING_BYTES) as u64, path)?;
    file.smooth();
    if file.arities.is_empty() {
        let problem = match &file.faults {
            faults if faults.has(ObjFault::FreeForm) => "the OBJ file has curves and free-form surfaces, but no faces",
            faults if faults.has(ObjFault::Line) => "the OBJ file has points and lines, but no faces",
            faults if faults.has(ObjFault::Short) => "the OBJ file has no faces of three corners or more",
            faults if faults.has(ObjFault::Corner) => "the OBJ file has no faces whose corners are vertices",
            _ => "the OBJ file has no faces",
        };
        return Err(Error::input(path.display().to_string(), problem, "give a mesh of polygons (f lines)"));
    }
    Ok(file)
}

fn at_line(path: &Path, line: usize, problem: &str) -> Error {
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

    /// Gives faces of smoothing groups, which have no normals of their own, those of their group.
    fn smooth(&mut self) {
        let mut normals = GroupNormals::default();
        let faces = self.smoothed_faces();
        let ring = |begin: usize, arity: usize| -> Vec<(u32, DVec3)> {
            let face = &self.corners[begin..begin + arity];
            let there = face.iter().all(|[v, ..]| self.has(*v));
            face.iter().filter(|_| there).map(|&[v, ..]| (v, self.positions[v as usize])).collect()
        };
        for &(smoothing, begin, arity) in &faces {
            let corners = ring(begin, arity);
            if !corners.is_empty() {
                normals.add(smoothing, &corners);
            }
        }
        let (mut places, mut found): (HashMap<[u32; 3], u32>, Vec<_>) = Default::default();
        let (first, mut made) = (self.normals.len() as u32, Vec::new());
        for &(smoothing, begin, arity) in &faces {
            let corners = ring(begin, arity);
            let normal = if corners.is_empty() { DVec3::ZERO } else { normal_of(&corners) };
            for (at, (vertex, _)) in corners.into_iter().enumerate() {
                let normal = normals.at(smoothing, vertex, normal);
                let place = *places.entry(normal.to_array().map(f32::to_bits)).or_insert_with(|| {
                    made.push(normal);
                    first + made.len() as u32 - 1
                });
                found.push((begin + at, place));
            }
        }
        found.into_iter().for_each(|(at, place)| self.corners[at][2] = place);
        self.normals.append(&mut made);
        self.groups.iter_mut().for_each(|group| group.format.1 |= group.smoothing > 0);
    }

    /// Smoothing group, first corner and number of corners of each face that is smoothed.
    fn smoothed_faces(&self) -> Vec<(u32, usize, usize)> {
        let (mut found, mut begin, mut arities) = (Vec::new(), 0, self.arities.iter());
        for group in &self.groups {
            for &arity in arities.by_ref().take(group.faces) {
                if group.smoothing > 0 {
                    found.push((group.smoothing, begin, arity as usize));
                }
                begin += arity as usize;
            }
        }
        found
    }

    /// Its parts, each made when it is asked for, with what is left out of it.
    pub(super) fn parts(&self) -> impl Iterator<Item = (ObjPart, Faults)> {
        let (mut corners, mut arities) = (self.corners.as_slice(), self.arities.as_slice());
        self.groups.iter().map(move |group| {
            let (here, there) = corners.split_at(group.corners);
            let (faces, after) = arities.split_at(group.faces);
            (corners, arities) = (there, after);
            self.part(group, here, faces)
        })
    }

    /// Vertices in the order in which they first occur, one for each triple of indices.
    fn part(&self, group: &Group, mut corners: &[[u32; 3]], faces: &[u32]) -> (ObjPart, Faults) {
        let (object, material, is_smoothed) = (group.object, group.material, group.smoothing > 0);
        let mut part = ObjPart { object, material, is_smoothed, ..ObjPart::default() };
        let mut faults = Faults::default();
        let mut known: HashMap<[u32; 3], u32> = HashMap::new();
        let (mut ring, mut places) = (Vec::new(), Vec::new());
        // Where the largest index is none of the file, its line is that of the first to be said.
        let line = if self.largest.0 > self.positions.len() as i64 { self.largest.1 } else { 0 };
        for &arity in faces {
            let (face, rest) = corners.split_at(arity as usize);
            corners = rest;
            if let Some([v, ..]) = face.iter().find(|[v, ..]| !self.has(*v)) {
                // Vertices that are there and no numbers have been counted.
                if *v as usize >= self.positions.len() {
                    faults.note(ObjFault::Corner, line);
                }
                continue;
            }
            ring.clear();
            ring.extend_from_slice(face);
            // Polygons that are closed by their first corner, and corners that are there twice.
            ring.dedup_by_key(|[v, ..]| *v);
            if ring.len() > 3 && ring[0][0] == ring[ring.len() - 1][0] {
                ring.pop();
            }
            if ring.len() < 3 {
                ring.clear();
                ring.extend_from_slice(&face[..3]);
            }
            let mut vertex = |corner: &[u32; 3]| {
                let next = part.positions.len() as u32;
                *known.entry(*corner).or_insert_with(|| {
                    let [v, vt, vn] = corner.map(|place| place as usize);
                    part.positions.push(self.positions[v]);
                    if group.format.0 {
                        part.uvs.push(self.uvs.get(vt).copied().unwrap_or_else(|| {
                            faults.note(ObjFault::Coordinate, 0);
                            Vec2::ZERO
                        }));
                    }
                    if group.format.1 {
                        part.normals.push(self.normals.get(vn).map_or_else(
                            || {
                                faults.note(ObjFault::Normal, 0);
                                Vec3::ZERO
                            },
                            |normal| normal.normalize_or_zero(),
                        ));
                    }
                    next
                })
            };
            places.clear();
            places.extend(ring.iter().map(&mut vertex));
            if let [a, b, c] = places[..] {
                part.triangles.push([a, b, c]);
                continue;
            }
            let points: Vec<_> = places.iter().map(|&place| part.positions[place as usize]).collect();
            let cut = polygon::cut(&points);
            if cut.crosses {
                faults.note(ObjFault::Crossing, 0);
            }
            part.triangles.extend(cut.triangles.iter().map(|triangle| triangle.map(|at| places[at])));
        }
        (part, faults)
    }

    /// Whether a vertex of this index exists.
    fn has(&self, place: u32) -> bool {
        self.positions.get(place as usize).is_some_and(|position| position.is_finite())
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
    /// Number of the smoothing group; 0 is off.
    smoothing: u32,
    /// Begin of a statement that a `\` at the line's end continues.
    unfinished: String,
}

impl Parser {
    fn line(&mut self, line: &str) -> Result<(), &'static str> {
        let line = line.trim();
        if line.starts_with('#') {
            return Ok(());
        }
        let begin = if self.unfinished.is_empty() { line } else { &self.unfinished };
        let names = begin.split_whitespace().next().is_some_and(|key| NAMING.contains(&key));
        let line = if names { line } else { without_comment(line) };
        if let Some(begin) = line.strip_suffix('\\') {
            self.unfinished.push_str(begin);
            self.unfinished.push(' ');
            if self.unfinished.len() > MAX_LINE_BYTES {
                return Err("the statement is too long to be one");
            }
            return Ok(());
        }
        if self.unfinished.is_empty() {
            self.statement(line);
        } else {
            let whole = std::mem::take(&mut self.unfinished) + line;
            self.statement(&whole);
        }
        Ok(())
    }

    fn statement(&mut self, line: &str) {
        let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        match key {
            "v" => {
                // One that is no vertex keeps its place, since faces count.
                let found = self.numbers(rest, 3, ObjFault::Vertex);
                if rest.split_whitespace().nth(5).is_some() {
                    self.note(ObjFault::Colour);
                }
                self.file.positions.push(found.map_or(DVec3::NAN, DVec3::from_array));
            }
            "vn" => {
                let found = self.numbers(rest, 3, ObjFault::Normal);
                self.file.normals.push(found.map_or(Vec3::ZERO, |normal| DVec3::from_array(normal).as_vec3()));
            }
            "vt" => {
                // One number lies on the line v = 0.
                let found = self.numbers(rest, 1, ObjFault::Coordinate);
                self.file.uvs.push(found.map_or(Vec2::ZERO, |place| DVec2::from_array(place).as_vec2()));
            }
            "f" | "fo" => self.face(rest),
            "o" | "g" => {
                self.object = self.file.objects.position(rest);
                self.format = None;
            }
            "usemtl" => {
                self.material = self.file.materials.position(rest);
                self.format = None;
            }
            "s" => self.smoothing = rest.parse().unwrap_or(0),
            "mtllib" => self.file.libraries.push(rest.to_owned()),
            "p" | "l" => self.note(ObjFault::Line),
            key if FREE_FORM.contains(&key) => self.note(ObjFault::FreeForm),
            _ => {}
        }
    }

    fn note(&mut self, fault: ObjFault) {
        self.file.faults.note(fault, self.lines);
    }

    /// The first `N` numbers of a statement, of which `needed` must be there. None where they are no finite numbers, which is noted.
    fn numbers<const N: usize>(&mut self, rest: &str, needed: usize, fault: ObjFault) -> Option<[f64; N]> {
        let mut words = rest.split_whitespace();
        let mut numbers = [0.0f64; N];
        for (i, number) in numbers.iter_mut().enumerate() {
            let found = match words.next() {
                Some(word) => {
                    word.parse().ok().or_else(|| self.with_comma(word)).filter(|v: &f64| (*v as f32).is_finite())
                }
                None => (i >= needed).then_some(0.0),
            };
            let Some(found) = found else {
                self.note(fault);
                return None;
            };
            *number = found;
        }
        Some(numbers)
    }

    /// A number whose decimals stand behind a comma.
    fn with_comma(&mut self, word: &str) -> Option<f64> {
        let (whole, decimals) = word.split_once(',')?;
        let number = format!("{whole}.{decimals}").parse().ok()?;
        self.note(ObjFault::Comma);
        Some(number)
    }

    fn face(&mut self, rest: &str) {
        let begin = self.file.corners.len();
        // Corners that differ in what they have: keep what all of them have.
        let (mut common, mut arity) = ((true, true), 0);
        for word in rest.split_whitespace() {
            let Some([v, vt, vn]) = self.corner(word) else {
                self.file.corners.truncate(begin);
                return self.note(ObjFault::Corner);
            };
            common = (common.0 && vt.is_some(), common.1 && vn.is_some());
            self.file.corners.push([v.unwrap_or(NOWHERE), vt.unwrap_or(0), vn.unwrap_or(0)]);
            arity += 1;
        }
        if arity < 3 {
            self.file.corners.truncate(begin);
            return self.note(ObjFault::Short);
        }
        for corner in &mut self.file.corners[begin..] {
            let [_, vt, vn] = corner;
            *vt *= u32::from(common.0);
            *vn *= u32::from(common.1);
        }
        let smoothing = if common.1 { 0 } else { self.smoothing };
        if self.format != Some(common) || self.file.groups.last().is_some_and(|group| group.smoothing != smoothing) {
            self.format = Some(common);
            if self.file.materials.as_slice().is_empty() {
                self.material = self.file.materials.position("");
            }
            if self.file.objects.as_slice().is_empty() {
                self.object = self.file.objects.position("");
            }
            let (object, material) = (self.object, self.material);
            self.file.groups.push(Group { object, material, format: common, smoothing, faces: 0, corners: 0 });
        }
        let group = self.file.groups.last_mut().expect("a face has a group");
        group.faces += 1;
        group.corners += arity as usize;
        self.file.arities.push(arity);
    }

    /// Places in the three streams, the last two where they are given. None where the word is no corner.
    fn corner(&mut self, word: &str) -> Option<[Option<u32>; 3]> {
        let mut corner = [None; 3];
        for (stream, index) in word.split('/').enumerate() {
            let slot = corner.get_mut(stream)?;
            if index.is_empty() {
                continue;
            }
            *slot = self.index(stream, index.parse().ok()?);
            if slot.is_none() {
                match stream {
                    0 => return None,
                    1 => self.note(ObjFault::Coordinate),
                    _ => self.note(ObjFault::Normal),
                }
            }
        }
        corner[0].is_some().then_some(corner)
    }

    /// The place in a stream of an index that is counted from 1, or backwards from -1. None before the first; beyond the last is
    /// looked at when all of the file is read.
    fn index(&mut self, stream: usize, index: i64) -> Option<u32> {
        let count = [self.file.positions.len(), self.file.uvs.len(), self.file.normals.len()][stream] as i64;
        let absolute = if index < 0 { count.checked_add(index)? + 1 } else { index };
        if stream == 0 && absolute > self.file.largest.0 {
            self.file.largest = (absolute, self.lines);
        }
        (absolute >= 1).then(|| u32::try_from(absolute - 1).unwrap_or(NOWHERE))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<ObjFile> {
        parse(Path::new("a.obj"), &mut text.as_bytes(), &MemoryBound::of(u64::MAX))
    }

    fn read(text: &str) -> (ObjFile, Vec<ObjPart>) {
        let file = parsed(text).unwrap();
        let parts = file.parts().map(|(part, _)| part).collect();
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

    /// Wavefront's text: smoothing is off until a group is named, `0` and `off` end it, and normals of the file count first.
    #[test]
    fn faces_of_a_smoothing_group_share_normals_at_their_vertices() {
        // Two faces of a roof, along x, that rise by one half.
        let roof = "v 0 0 0\nv 1 0 0\nv 1 1 0.5\nv 0 1 0.5\nv 0 2 0\nv 1 2 0\n";
        let faces = "f 1 2 3 4\nf 4 3 6 5\n";
        for flat in ["", "s off\n", "s 0\n", "s 1\ns off\n"] {
            assert!(read(&format!("{roof}{flat}{faces}")).1[0].normals.is_empty(), "{flat}");
        }
        let part = &read(&format!("{roof}s 1\n{faces}")).1[0];
        let (across, up) = (0.2f32.sqrt(), 0.8f32.sqrt());
        for (position, normal) in part.positions.iter().zip(&part.normals) {
            let lean = position.y as f32 - 1.0;
            let right = if lean == 0.0 { Vec3::Z } else { Vec3::new(0.0, lean * across, up) };
            assert!((normal - right).length() < 1e-6, "{position}: {normal}");
        }
        // Across the border of two groups there is an edge.
        let parts = read(&format!("{roof}s 1\nf 1 2 3 4\ns 2\nf 4 3 6 5\n")).1;
        assert!((parts[0].normals[2] - Vec3::new(0.0, -across, up)).length() < 1e-6 && parts.len() == 2);
        let own = read(&format!("{roof}vn 0 0 1\ns 1\nf 1//1 2//1 3//1 4//1\n")).1;
        assert!(own[0].normals.iter().all(|normal| *normal == Vec3::Z) && !own[0].is_smoothed);
        // Vertices that are not there leave out their face.
        assert_eq!(told(&format!("{roof}s 1\n{faces}f 1 2 9\n")).1, 4);
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

    /// What is said of a text, and how many triangles it has.
    fn told(text: &str) -> (Vec<String>, usize) {
        let file = parsed(text).unwrap();
        let (mut faults, mut triangles, mut warnings) = (file.faults.clone(), 0, Warnings::new());
        for (part, more) in file.parts() {
            faults.add(&more);
            triangles += part.triangles.len();
        }
        faults.report(Path::new("a.obj"), &mut warnings);
        (warnings.lines(), triangles)
    }

    #[test]
    fn what_is_no_face_or_number_is_left_out_with_its_line() {
        let good = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        let bad = [
            ("v 0 0 nan\nf 1 2 4\n", "1 vertices", "line 5"),
            ("v 0 0 1e99\nf 1 2 4\n", "1 vertices", "line 5"),
            ("v 0 0\nf 1 2 4\n", "1 vertices", "line 5"),
            ("v 0 x 0\nf 1 2 4\n", "1 vertices", "line 5"),
            ("f 1 2 4\n", "1 faces", "line 5"),
            ("f 1 1 0\n", "1 faces", "line 5"),
            ("f 1 1 -4\n", "1 faces", "line 5"),
            ("f 1 2\n", "fewer than three", "line 5"),
            ("f\n", "fewer than three", "line 5"),
            ("f 1 2 9223372036854775807\n", "1 faces", "line 5"),
            ("f 1 2 9223372036854775808\n", "1 faces", "line 5"),
            ("f 1 1 /1\n", "1 faces", "line 5"),
            ("f 1/1/1/1 2 3\n", "1 faces", "line 5"),
            ("p 1\nl 1 2\n", "2 points and lines", "line 5"),
            ("surf 0 1 0 1 1 2 3\n", "free-form", "line 5"),
        ];
        for (text, part, line) in bad {
            let (lines, triangles) = told(&format!("{good}{text}"));
            assert_eq!((lines.len(), triangles), (1, 1), "{text:?}: {lines:?}");
            assert!(lines[0].contains(part) && lines[0].contains(line), "{text:?}: {lines:?}");
        }
        let (lines, triangles) = told(&format!("{good}f 1/1 2/1 3/1\nf 1//9 2//9 3//9\n"));
        assert!(triangles == 3 && lines.len() == 2, "{lines:?}");
        for (text, part) in
            [("v 0 0 0\n", "no faces"), ("", "no faces"), ("f 1 2\n", "three corners"), ("l 1 2\n", "lines")]
        {
            let error = parsed(text).unwrap_err().to_string();
            assert!(error.contains("a.obj") && error.contains(part), "{text:?}: {error}");
        }
    }

    #[test]
    fn names_keep_their_number_signs() {
        let (file, _) = read(&format!("{SQUARE}g part #2\nusemtl Material #25 # really\nf 1 2 3 # a face\n"));
        assert_eq!(file.materials.as_slice(), ["Material #25 # really"]);
        assert_eq!(file.objects.as_slice(), ["part #2"]);
    }

    #[test]
    fn a_polygon_is_a_fan_and_memory_is_counted_while_lines_are_read() {
        let (_, parts) = read(&format!("{SQUARE}v 0 0.5 0\nf 1 2 3 4 5\n"));
        assert_eq!(parts[0].triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
        let many = "v 0 0 0\n".repeat(10_000);
        let error = parse(Path::new("a.obj"), &mut many.as_bytes(), &MemoryBound::of(50_000)).unwrap_err();
        assert!(matches!(error, Error::Resources { .. }), "{error}");
        let endless =
            parse(Path::new("a.obj"), &mut std::io::BufReader::new(std::io::repeat(b'v')), &MemoryBound::of(1 << 20));
        assert!(endless.unwrap_err().to_string().contains("too long"));
    }

    #[test]
    fn lines_quote_nothing_of_the_file() {
        for text in ["v secret 0 0\n", "vt secret\n", "f secret 1 1\n", "f 1/2/3/secret 1 1\n", "f 1 2secret 3\n"] {
            let (lines, _) = told(&format!("{SQUARE}f 1 2 3\n{text}"));
            assert!(lines.len() == 1 && !lines[0].contains("secret"), "{text}: {lines:?}");
        }
    }
}
