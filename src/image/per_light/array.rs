//! NumPy arrays of per-light images.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use zip::ZipArchive;

use super::{LayerMatch, LayerRole, LightRow, LightSet, MAX_LIGHTS, MAX_SIDE, Source, TakeRow};
use crate::error::{Error, Hint, Result, Warnings};
use crate::files::open_input;
use crate::image::npy::NpyHeader;

/// Most bytes that deflate makes of one: 258 of two bits each, rounded up.
const MAX_INFLATION: u64 = 1_040;
/// Longest name of a light, in characters.
const MAX_NAME: usize = 4_096;

/// An array on disk.
#[derive(Clone, Debug)]
pub(super) struct ImageArray {
    path: PathBuf,
    lights: usize,
}

/// Shape of an array of images, and how its values are stored.
#[derive(Clone, Copy)]
struct ArrayLayout {
    lights: usize,
    height: usize,
    width: usize,
    kind: Kind,
}

/// How values are stored.
#[derive(Clone, Copy)]
enum Kind {
    F16,
    F32,
    F64,
}

/// Inspects an array `[lights, height, width, 3]` in an NPY file, or `images` and optionally `lights` (names) in an NPZ
/// file.
///
/// # Errors
/// A file that cannot be read or is shorter than its header says, an array of another shape or type than f16, f32 or f64,
/// names of another number.
pub(super) fn open(path: &Path) -> Result<LightSet> {
    let mut layout = None;
    with_array(path, &mut |found, _| {
        layout = Some(found);
        Ok(())
    })?;
    let ArrayLayout { lights: count, height, width, .. } = layout.expect("it is called once");
    let names = if is_archive(path) { names_in_archive(path, count)? } else { None };
    let names = names.unwrap_or_else(|| (0..count).map(|i| format!("light {i}")).collect());
    let role = |name: &String| LayerMatch { layer: name.clone(), role: LayerRole::Light(name.clone()) };
    Ok(LightSet {
        width: width as u32,
        height: height as u32,
        matches: names.iter().map(role).collect(),
        lights: names,
        has_sum: false,
        warnings: Warnings::new(),
        source: Source::Array(ImageArray { path: path.to_owned(), lights: count }),
    })
}

impl ImageArray {
    /// Reads the values in the order of the file.
    pub(super) fn read(&self, (width, height): (usize, usize), take: &mut TakeRow<'_>) -> Result<()> {
        let mut failed: Option<Error> = None;
        let read = with_array(&self.path, &mut |layout, reader| {
            if (layout.lights, layout.height, layout.width) != (self.lights, height, width) {
                return Err("changed while it was read".into());
            }
            let kind = layout.kind;
            let mut bytes = vec![0; width * 3 * kind.bytes()];
            let mut row = Vec::with_capacity(width);
            for image in 0..self.lights {
                for y in 0..height {
                    reader.read_exact(&mut bytes).map_err(|e| format!("its array is cut short ({e})"))?;
                    for channel in 0..3 {
                        row.clear();
                        row.extend(kind.values(&bytes).skip(channel).step_by(3));
                        if let Err(error) = take(LightRow { image, channel, x: 0, y, values: &row }) {
                            failed = Some(error);
                            return Err(String::new());
                        }
                    }
                }
            }
            Ok(())
        });
        failed.map_or(read, Err)
    }
}

impl Kind {
    fn bytes(self) -> usize {
        match self {
            Self::F16 => 2,
            Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    fn values(self, bytes: &[u8]) -> impl Iterator<Item = f32> + '_ {
        bytes.chunks_exact(self.bytes()).map(move |word| match self {
            Self::F16 => half::f16::from_le_bytes([word[0], word[1]]).to_f32(),
            Self::F32 => f32::from_le_bytes(word.try_into().expect("4 bytes")),
            Self::F64 => f64::from_le_bytes(word.try_into().expect("8 bytes")) as f32,
        })
    }
}

fn is_archive(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npz"))
}

fn opened(path: &Path) -> Result<BufReader<File>> {
    Ok(BufReader::with_capacity(1 << 16, open_input(path, "open")?))
}

const SAVE: &str = "save it as float32 [lights, height, width, 3]";

/// What is wrong, and what to do.
type Problem = (String, Hint);

fn refuse(path: &Path, problem: impl Into<String>) -> Error {
    Error::input(path.display().to_string(), problem, SAVE)
}

/// A member of an NPZ file and the bytes that it can hold at most; none where there is no such member.
type Member<'a> = Option<(Box<dyn Read + 'a>, u64)>;

/// Opens the array `name` of an archive. Members are stored or deflated, as NumPy writes them.
fn member<'a>(archive: &'a mut ZipArchive<BufReader<File>>, name: &str) -> Result<Member<'a>, String> {
    let Some(index) = archive.index_for_name(&format!("{name}.npy")) else { return Ok(None) };
    let file = archive.by_index(index).map_err(|e| format!("its array '{name}' cannot be read ({e})"))?;
    let most = file.size().min(file.compressed_size().saturating_mul(MAX_INFLATION));
    Ok(Some((Box::new(BufReader::new(file)), most)))
}

fn archive(path: &Path) -> Result<ZipArchive<BufReader<File>>> {
    ZipArchive::new(opened(path)?).map_err(|e| refuse(path, format!("is not a NumPy archive ({e})")))
}

/// What is done with the layout of the images' array and a reader of its values.
type Work<'a> = dyn FnMut(ArrayLayout, &mut dyn Read) -> Result<(), String> + 'a;

/// Calls `work` once, unless the array is refused.
fn with_array(path: &Path, work: &mut Work<'_>) -> Result<()> {
    let refused = |(problem, hint): Problem| Error::input(path.display().to_string(), problem, hint);
    let mut work_on = |reader: &mut dyn Read, most_bytes: u64, names: Option<u64>| {
        let header = NpyHeader::read(reader).map_err(|problem| (problem, SAVE.into()))?;
        let layout = layout(&header, names)?;
        let values = header.values().ok_or(("its array is too large".to_owned(), Hint::from(SAVE)))?;
        let needed = values.saturating_mul(layout.kind.bytes() as u64).saturating_add(header.bytes);
        if needed > most_bytes {
            let problem = format!("its array is cut short: {needed} bytes are claimed, at most {most_bytes} are there");
            return Err((problem, SAVE.into()));
        }
        work(layout, reader).map_err(|problem| (problem, SAVE.into()))
    };
    if is_archive(path) {
        let mut archive = archive(path)?;
        let named = member(&mut archive, "lights").map_err(|problem| refuse(path, problem))?;
        let named = named.and_then(|(mut reader, _)| NpyHeader::read(&mut *reader).ok()?.values());
        let images = member(&mut archive, "images").map_err(|problem| refuse(path, problem))?.is_some();
        if !images {
            return Err(without_images(path, &archive));
        }
        let images = member(&mut archive, "images").map_err(|problem| refuse(path, problem))?;
        let (mut reader, most_bytes) = images.expect("it was just there");
        return work_on(&mut *reader, most_bytes, named).map_err(refused);
    }
    let mut file = opened(path)?;
    let bytes = file.get_ref().metadata().map_err(Error::io(path, "ask for the length"))?.len();
    work_on(&mut file, bytes, None).map_err(refused)
}

/// An archive of other arrays.
fn without_images(path: &Path, archive: &ZipArchive<BufReader<File>>) -> Error {
    let names: Vec<String> =
        archive.file_names().take(6).flatten().map(|n| n.trim_end_matches(".npy").escape_debug().to_string()).collect();
    let problem = format!("it has no array 'images' but {}", names.join(", "));
    let hint = "save it with numpy.savez(path, images=numpy.stack([...]), lights=[their names])";
    Error::input(path.display().to_string(), problem, hint)
}

/// What an array holds, `names` being how many lights are named beside it.
fn layout(header: &NpyHeader, names: Option<u64>) -> Result<ArrayLayout, Problem> {
    let shape = header.shape.as_slice();
    let of_shape = || {
        let shape: Vec<_> = shape.iter().map(ToString::to_string).collect();
        format!("its array has the shape [{}]", shape.join(", "))
    };
    let &[lights, height, width, 3] = shape else {
        return Err((of_shape(), how_to_turn(shape)));
    };
    // As `ltm.open` shows a matrix of three columns, of which each line would be a light.
    if width == 3 && height > 3 && names != Some(lights) {
        let problem = format!(
            "{}: {lights} lights of {width} × {height} pixels, or {lights} × {height} rows of 3 lights",
            of_shape()
        );
        let hint = "save numpy.moveaxis(a, -1, 0) if the lights come last, as in ltm.open; if they come first, save an .npz with \
                    images and lights, their names";
        return Err((problem, hint.into()));
    }
    let sides = 1..=MAX_SIDE;
    if !sides.contains(&height) || !sides.contains(&width) || lights == 0 {
        return Err((of_shape(), SAVE.into()));
    }
    if lights > MAX_LIGHTS as u64 {
        return Err((format!("{}; it may hold {MAX_LIGHTS} lights at most", of_shape()), SAVE.into()));
    }
    if header.fortran_order {
        return Err(("its array is in Fortran order".into(), "save numpy.ascontiguousarray of it".into()));
    }
    let kind = match header.descr.as_str() {
        "<f2" => Kind::F16,
        "<f4" => Kind::F32,
        "<f8" => Kind::F64,
        other => {
            let other = other.escape_debug();
            let problem = format!("its array is of type {other}, neither little-endian float16, float32 nor float64");
            return Err((problem, "save it as linear light in float32: a.astype('<f4')".into()));
        }
    };
    Ok(ArrayLayout { lights: lights as usize, height: height as usize, width: width as usize, kind })
}

/// What brings an array of another shape into order.
fn how_to_turn(shape: &[u64]) -> Hint {
    let save = match *shape {
        [_, _, 3, _] => "save numpy.moveaxis(a, -1, 0): lights come first, not last as in ltm.open",
        [_, 3, _, _] => "save a.transpose(0, 2, 3, 1): colours come last",
        [_, _, _, 4] => "save a[..., :3]: images have three colours and no alpha",
        [_, _, _, 1] => "save numpy.repeat(a, 3, -1): images have three colours",
        [_, _, _, _, 3] => return Hint::FlattenLights,
        [_, _, 3] => "save a[None] if it is the image of one light",
        [_, _, _] => "save numpy.repeat(a[..., None], 3, -1): images have three colours",
        _ => SAVE,
    };
    save.into()
}

/// The array `lights` of an archive: as many texts of one length as there are images.
fn names_in_archive(path: &Path, count: usize) -> Result<Option<Vec<String>>> {
    let mut archive = archive(path)?;
    let refused = |problem: String| refuse(path, problem);
    let Some((mut reader, _)) = member(&mut archive, "lights").map_err(refused)? else { return Ok(None) };
    read_names(&mut *reader, count).map(Some).map_err(refused)
}

/// Reads an array of texts of one length: `<U…`, 32-bit code points, or `|S…`, bytes of UTF-8; both are padded with zeros.
fn read_names(reader: &mut dyn Read, count: usize) -> Result<Vec<String>, String> {
    let NpyHeader { descr, shape, .. } = NpyHeader::read(reader)?;
    let length =
        |prefix: &str| descr.strip_prefix(prefix)?.parse::<usize>().ok().filter(|n| (1..=MAX_NAME).contains(n));
    let (points, bytes) = (length("<U"), length("|S"));
    let bytes_each = points.map(|n| 4 * n).or(bytes);
    let bytes_each = bytes_each.ok_or_else(|| format!("its names are of the type {}", descr.escape_debug()))?;
    if shape != [count as u64] {
        let shape: Vec<String> = shape.iter().map(u64::to_string).collect();
        return Err(format!("it holds {count} images, but its names have the shape ({})", shape.join(", ")));
    }
    let mut names = Vec::new();
    let mut stored = vec![0; bytes_each];
    for index in 0..count {
        reader.read_exact(&mut stored).map_err(|e| format!("its names are cut short ({e})"))?;
        let name: String = if points.is_some() {
            let points = stored.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word));
            points.take_while(|&p| p != 0).filter_map(char::from_u32).collect()
        } else {
            let end = stored.iter().position(|&byte| byte == 0).unwrap_or(stored.len());
            String::from_utf8_lossy(&stored[..end]).into_owned()
        };
        if name.is_empty() {
            return Err(format!("the name of light {index} is empty"));
        }
        names.push(name);
    }
    Ok(names)
}
