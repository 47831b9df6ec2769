//! NumPy arrays of per-light images.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use super::{LayerMatch, LayerRole, LightRow, LightSet, Source, TakeRow};
use crate::error::{Error, Result};
use crate::files::open_input;
use crate::matrix::MatrixShape;

const MAX_SIDE: u64 = MatrixShape::MAX_IMAGE_SIDE as u64;
const MAX_LIGHTS: u64 = MatrixShape::MAX_COLUMNS as u64;

/// An array on disk.
#[derive(Clone, Debug)]
pub(super) struct Array {
    path: PathBuf,
    lights: usize,
}

/// Lights, height, width, and how values are stored.
type Layout = (usize, usize, usize, Kind);

/// How values are stored.
#[derive(Clone, Copy)]
enum Kind {
    F16,
    F32,
    F64,
}

/// Looks at an array `[lights, height, width, 3]` in an NPY file, or at `images` and optionally `lights` (names) in an
/// NPZ file.
///
/// Errors: a file that cannot be read, an array of another shape or type than f16, f32 or f64, names of another number.
pub(super) fn open(path: &Path) -> Result<LightSet> {
    let mut names = None;
    let mut shape = [0; 3];
    with_array(path, &mut |(lights, height, width, _), _| {
        shape = [lights, height, width];
        Ok(())
    })?;
    if is_archive(path) {
        let failed = |e: std::io::Error| refuse(path, e.to_string());
        let mut archive = npyz::npz::NpzArchive::new(opened(path)?).map_err(failed)?;
        if let Some(lights) = archive.by_name("lights").map_err(failed)? {
            names = Some(read_names(lights).map_err(|problem| refuse(path, problem))?);
        }
    }
    let [count, height, width] = shape;
    let names = names.unwrap_or_else(|| (0..count).map(|i| format!("light {i}")).collect());
    if names.len() != count {
        return Err(refuse(path, format!("it names {} lights but holds {count} images", names.len())));
    }
    let role = |name: &String| LayerMatch { layer: name.clone(), role: LayerRole::Light(name.clone()) };
    Ok(LightSet {
        width: width as u32,
        height: height as u32,
        matches: names.iter().map(role).collect(),
        lights: names,
        has_sum: false,
        source: Source::Array(Array { path: path.to_owned(), lights: count }),
    })
}

impl Array {
    /// Reads the values in the order of the file.
    pub(super) fn read(&self, (width, height): (usize, usize), take: &mut TakeRow<'_>) -> Result<()> {
        let mut failed: Option<Error> = None;
        let read = with_array(&self.path, &mut |(.., kind), reader| {
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

fn refuse(path: &Path, problem: String) -> Error {
    Error::input(path.display().to_string(), problem, "save it as float32 [lights, height, width, 3]")
}

/// Calls `work` with the layout of the images' array and a reader of its values.
fn with_array(path: &Path, work: &mut dyn FnMut(Layout, &mut dyn Read) -> Result<(), String>) -> Result<()> {
    let failed = |e: std::io::Error| refuse(path, e.to_string());
    let refused = |problem: String| refuse(path, problem);
    let file = opened(path)?;
    if is_archive(path) {
        let mut archive = npyz::npz::NpzArchive::new(file).map_err(failed)?;
        let array = archive.by_name("images").map_err(failed)?;
        let array = array.ok_or_else(|| refuse(path, "it has no array 'images'".into()))?;
        let layout = layout(&array).map_err(refused)?;
        return work(layout, &mut array.into_inner()).map_err(refused);
    }
    let array = npyz::NpyFile::new(file).map_err(failed)?;
    let layout = layout(&array).map_err(refused)?;
    work(layout, &mut array.into_inner()).map_err(refused)
}

fn layout<R: Read>(array: &npyz::NpyFile<R>) -> Result<Layout, String> {
    let shape = array.shape();
    let &[lights, height, width, 3] = shape else {
        return Err(format!("its array has the shape {shape:?}"));
    };
    let sides = 1..=MAX_SIDE;
    if !(1..=MAX_LIGHTS).contains(&lights) || !sides.contains(&height) || !sides.contains(&width) {
        return Err(format!("its array has the shape {shape:?}"));
    }
    if array.order() != npyz::Order::C {
        return Err("its array is in Fortran order".into());
    }
    let npyz::DType::Plain(dtype) = array.dtype() else {
        return Err("its array is a structured one".into());
    };
    let kind = match dtype.to_string().as_str() {
        "<f2" => Kind::F16,
        "<f4" => Kind::F32,
        "<f8" => Kind::F64,
        other => return Err(format!("its array is of type {other}, neither float16, float32 nor float64")),
    };
    Ok((lights as usize, height as usize, width as usize, kind))
}

/// Reads an array of texts of one length (`<U…`: 32-bit code points, padded with zeros).
fn read_names<R: Read>(array: npyz::NpyFile<R>) -> Result<Vec<String>, String> {
    let npyz::DType::Plain(dtype) = array.dtype() else {
        return Err("its names are not texts".into());
    };
    let dtype = dtype.to_string();
    let length = dtype.strip_prefix("<U").and_then(|n| n.parse::<usize>().ok()).filter(|n| (1..=4096).contains(n));
    let length = length.ok_or(format!("its names are of the type {dtype}"))?;
    let count = array.shape().iter().product::<u64>();
    let mut reader = array.into_inner();
    let mut names = Vec::new();
    let mut bytes = vec![0; 4 * length];
    for _ in 0..count {
        reader.read_exact(&mut bytes).map_err(|e| format!("its names are cut short ({e})"))?;
        let points = bytes.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word));
        names.push(points.take_while(|&p| p != 0).filter_map(char::from_u32).collect());
    }
    Ok(names)
}
