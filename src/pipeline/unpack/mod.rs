//! Unpacking of `.ltc` or `.ltm` into `.ltm`, images or arrays, block by block.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use sha2::{Digest, Sha256};

mod selection;
mod source;

pub use self::selection::Selection;
use self::selection::{Selected, overlap};
pub use self::source::{ColumnWeights, UnpackSource};
use super::row_spill::{RowPlace, RowSpill};
use crate::error::{Error, Hint, Result, Warning};
use crate::files::{ContinuationFile, check_output, with_suffix};
use crate::image::{self, ImageSize};
use crate::matrix::{BlockId, BlockSink, CHANNELS, ColumnIndex, PixelRect, TracedBlock};
use crate::resources::Progress;
use crate::resources::{Held, PerThread, ResourceEstimate, Threads};
use crate::store::{self, StoreOptions, StoreWriter};

/// Largest number of channels in a Nuke script.
const NUKE_CHANNELS: usize = 1023;

/// Options of unpacking.
#[derive(Clone, Debug, Default)]
pub struct UnpackOptions {
    /// The part of the matrix to unpack.
    pub selection: Selection,
    /// Replace files that exist.
    pub overwrite: bool,
    /// Limit of anonymous memory in bytes; `None` for what the system has available.
    pub memory_bytes: Option<u64>,
}

/// Writes blocks, those of a container multiplied out, into a stored matrix at `path` without noise. Returns the number
/// of blocks that it holds. Continues where an interrupted run over the same file stopped.
///
/// # Errors
/// Those of the selection, of reading the source and of writing the store.
pub fn unpack_to_store(
    source: &dyn UnpackSource,
    path: &Path,
    options: &UnpackOptions,
    watch: &dyn Progress,
) -> Result<usize> {
    store::check_output(path, options.overwrite)?;
    let selected = options.selection.of(source.job())?;
    let job = selected.job(source.job())?;
    let origin = Some(source.fingerprint()?);
    let store = StoreOptions { overwrite: options.overwrite, origin, ..Default::default() };
    let requirements = store::requirements(&job, &store);
    let writing = PerThread(job.shape.max_block_bytes() + requirements.memory_bytes);
    let memory = ResourceEstimate::of(&[&Held(source.fixed_bytes()), &PerThread(source.reading_bytes()), &writing]);
    let need = ResourceEstimate { disk_bytes: requirements.disk_bytes, ..memory };
    let threads =
        Threads::new(need.admit("unpacking", path, &[&store::partial_path(path)], options.memory_bytes, watch)?)?;
    let writer = StoreWriter::create_or_resume(path, &job, store)?;
    let columns = selected.columns();
    let blocks = selected.target_blocks(source.job(), &job);
    let (kept, to_do): (Vec<_>, Vec<_>) = blocks.iter().partition(|&&id| writer.is_committed(id));
    if !kept.is_empty() {
        watch.note(&format!("{}: continuing, {} blocks are unpacked", path.display(), kept.len()));
    }
    watch.begin("unpacking", blocks.len() as u64, "blocks");
    watch.advance(kept.len() as u64, 0, "B");
    let unpack_one = |traced: &mut TracedBlock, &id: &BlockId| {
        if watch.interrupted() {
            let kept = writer.path().display();
            return Err(Error::interrupted_keeping(format!("{kept} keeps the finished blocks")));
        }
        let rect = job.shape.rect(id);
        traced.block.reset(rect.rows(), columns.len());
        selected.fill(source, rect, &columns, traced.block.entries_mut())?;
        let bytes = size_of_val(traced.block.entries()) as u64;
        writer.write_block(id, traced)?;
        watch.advance(1, bytes, "B");
        Ok(())
    };
    let result = threads.run(|| to_do.par_iter().try_for_each_init(TracedBlock::default, unpack_one));
    watch.end();
    result?;
    writer.finish()?;
    Ok(blocks.len())
}

/// Writes one layer for each light, as the scene lights it, into one OpenEXR file at `path`, after a layer with all of
/// them. The layers are named as Blender names light groups, `ViewLayer.Combined_LIGHT`, in one part of 32-bit floats,
/// with channels that end in `.R`, `.G`, `.B`. Programs that read them: decision 42. A path with `{light}` asks for a
/// file of plain RGB for each light instead. Returns the files written.
///
/// # Errors
/// Those of the selection, of reading the source and of writing the files.
pub fn unpack_to_exr(
    source: &dyn UnpackSource,
    path: &Path,
    options: &UnpackOptions,
    watch: &dyn Progress,
) -> Result<Vec<PathBuf>> {
    let selected = options.selection.of(source.job())?;
    let names = safe_names(selected.lights.iter().map(|light| light.name.as_str()));
    let text = path.display().to_string();
    if text.contains("{light}") {
        let paths: Vec<PathBuf> = names.iter().map(|name| text.replace("{light}", name).into()).collect();
        unpack_to_files(source, &selected, path, &paths, options, watch)?;
        return Ok(paths);
    }
    check_output(path, options.overwrite)?;
    if 3 * (names.len() + 1) > NUKE_CHANNELS {
        let most = NUKE_CHANNELS / 3 - 1;
        let (path, count) = (path.display(), names.len());
        let text = format!("{path}: {count} lights are more than the {most} that Nuke has channels for");
        watch.warn(&Warning::new(text, Hint::FewerLights));
    }
    let mut layers = vec!["ViewLayer.Combined".to_owned()];
    layers.extend(names.iter().map(|name| format!("ViewLayer.Combined_{name}")));
    let mut images = vec![(0..selected.lights.len()).collect()];
    images.extend((0..selected.lights.len()).map(|light| vec![light]));
    let rows = relight_images(
        source,
        &selected,
        LitImages { groups: &images, in_a_file: images.len() },
        path,
        options,
        watch,
    )?;
    let mut fetch = |image, channel, y, row: &mut [f32]| rows.read(RowPlace { image, channel, y, x: 0 }, row);
    image::write_exr_rows(path, options.overwrite, &layers, size_of_rect(selected.rect), &mut fetch)?;
    Ok(vec![path.to_owned()])
}

/// Writes a file of plain RGB for each light. Files that an interrupted run over the same source and selection has
/// written are recorded beside them, and written again.
fn unpack_to_files(
    source: &dyn UnpackSource,
    selected: &Selected,
    pattern: &Path,
    paths: &[PathBuf],
    options: &UnpackOptions,
    watch: &dyn Progress,
) -> Result<()> {
    const MARK: [u8; 8] = *b"LTMfile1";
    let mut hash = Sha256::new();
    hash.update(source.fingerprint()?);
    hash.update(selected.job(source.job())?.hash().0);
    selected.blocks.iter().for_each(|id| hash.update(id.0.to_le_bytes()));
    check_output(&with_suffix(pattern, ".part"), true)?;
    let begun =
        ContinuationFile::open(&with_suffix(pattern, ".part"), MARK, hash.finalize().into(), paths.len() as u32, true)?;
    for (key, path) in (0..).zip(paths) {
        check_output(path, options.overwrite || begun.has(key))?;
    }
    let images: Vec<Vec<usize>> = (0..selected.lights.len()).map(|light| vec![light]).collect();
    let rows = relight_images(source, selected, LitImages { groups: &images, in_a_file: 1 }, pattern, options, watch)?;
    watch.begin("writing images", paths.len() as u64, "images");
    let written = (0..).zip(paths).try_for_each(|(key, path)| {
        if watch.interrupted() {
            return Err(Error::interrupted_keeping("the images before it are written"));
        }
        let overwrite = options.overwrite || begun.has(key);
        if !begun.has(key) {
            // Before the file is renamed: an unrecorded file would count as someone else's.
            begun.append(key, &[])?;
        }
        let mut fetch =
            |_, channel, y, row: &mut [f32]| rows.read(RowPlace { image: key as usize, channel, y, x: 0 }, row);
        image::write_exr_rows(path, overwrite, &[String::new()], size_of_rect(selected.rect), &mut fetch)?;
        watch.advance(1, 1, "images");
        Ok(())
    });
    watch.end();
    written?;
    begun.remove()
}

/// Writes one image under all selected lights, as the scene lights them, as plain RGB to an OpenEXR file at `path`.
///
/// # Errors
/// Those of the selection, of reading the source and of writing the file.
pub fn unpack_relit(
    source: &dyn UnpackSource,
    path: &Path,
    options: &UnpackOptions,
    watch: &dyn Progress,
) -> Result<()> {
    check_output(path, options.overwrite)?;
    let selected = options.selection.of(source.job())?;
    let images = [(0..selected.lights.len()).collect()];
    let rows = relight_images(source, &selected, LitImages { groups: &images, in_a_file: 1 }, path, options, watch)?;
    let mut fetch = |image, channel, y, row: &mut [f32]| rows.read(RowPlace { image, channel, y, x: 0 }, row);
    image::write_exr_rows(path, options.overwrite, &[String::new()], size_of_rect(selected.rect), &mut fetch)
}

/// Writes an f32 array `[lights, height, width, 3]` of the lights' images, as the scene lights them, to `path`.
///
/// # Errors
/// Those of the selection, of reading the source and of writing the file.
pub fn unpack_to_npy(
    source: &dyn UnpackSource,
    path: &Path,
    options: &UnpackOptions,
    watch: &dyn Progress,
) -> Result<()> {
    check_output(path, options.overwrite)?;
    let selected = options.selection.of(source.job())?;
    let images: Vec<Vec<usize>> = (0..selected.lights.len()).map(|light| vec![light]).collect();
    let rows = relight_images(source, &selected, LitImages { groups: &images, in_a_file: 1 }, path, options, watch)?;
    let mut fetch = |image, channel, y, row: &mut [f32]| rows.read(RowPlace { image, channel, y, x: 0 }, row);
    image::write_npy(path, options.overwrite, images.len(), size_of_rect(selected.rect), &mut fetch)
}

/// The images that are made.
#[derive(Clone, Copy)]
struct LitImages<'a> {
    /// The lights of each, as indices into the selection.
    groups: &'a [Vec<usize>],
    /// Images that come into one file.
    in_a_file: usize,
}

/// Lights each block under groups of lights and leaves the images on disk, once there is room for them, and for the files.
fn relight_images(
    source: &dyn UnpackSource,
    selected: &Selected,
    LitImages { groups, in_a_file }: LitImages<'_>,
    beside: &Path,
    options: &UnpackOptions,
    watch: &dyn Progress,
) -> Result<RowSpill> {
    let shape = source.job().shape;
    let size = size_of_rect(selected.rect);
    let writing = Held(image::exr_rows_need_bytes(in_a_file, size));
    let lit = PerThread(16 * shape.max_block_rows() as u64);
    let memory =
        ResourceEstimate::of(&[&Held(source.fixed_bytes()), &PerThread(source.reading_bytes()), &lit, &writing]);
    // The images in between, and the files, which are not larger.
    let disk_bytes = 2 * RowSpill::bytes(groups.len(), size.width, size.height);
    let need = ResourceEstimate { disk_bytes, ..memory };
    let threads = Threads::new(need.admit("unpacking", beside, &[], options.memory_bytes, watch)?)?;
    let rows = RowSpill::create(beside, groups.len(), size.width, size.height)?;
    watch.begin("relighting", selected.blocks.len() as u64, "blocks");
    let scene_weights = source.job().basis.scene_weights();
    let weights_of = |lights: &Vec<usize>| -> ColumnWeights {
        let columns = lights.iter().flat_map(|&light| selected.lights[light].columns());
        columns.map(|column| (ColumnIndex(column), scene_weights[column as usize])).collect()
    };
    let lightings: Vec<ColumnWeights> = groups.iter().map(weights_of).collect();
    let relight_one = |&id: &BlockId| {
        stop_if_interrupted(beside, watch)?;
        let rect = shape.rect(id);
        let part = overlap(rect, selected.rect).expect("only blocks inside the crop are selected");
        source.relight(id, &lightings, &mut |image, lit| {
            let lit: Vec<f32> = lit.into_iter().map(|value| value as f32).collect();
            for channel in 0..CHANNELS {
                for y in part.y..part.y + part.height {
                    let from = (channel * rect.height as usize + (y - rect.y) as usize) * rect.width as usize;
                    let from = from + (part.x - rect.x) as usize;
                    let lit = &lit[from..from + part.width as usize];
                    let (y, x) = ((y - selected.rect.y) as usize, (part.x - selected.rect.x) as usize);
                    rows.write(RowPlace { image, channel, y, x }, lit)?;
                }
            }
            Ok(())
        })?;
        watch.advance(1, groups.len() as u64, "images");
        Ok(())
    };
    let result = threads.run(|| selected.blocks.par_iter().try_for_each(relight_one));
    watch.end();
    result?;
    Ok(rows)
}

/// Unique names that programs can read as layers and files: letters and digits of any script, spaces, and a few other
/// characters. Blender keeps 63 bytes of a pass's name, part of which are `Combined_` and a number.
pub(super) fn safe_names<'a>(lights: impl Iterator<Item = &'a str>) -> Vec<String> {
    const MAX_BYTES: usize = 48;
    let mut taken = HashSet::new();
    let mut free_from: HashMap<String, usize> = HashMap::new();
    // Beyond ASCII, every visible character.
    let is_seen = |c: char| !c.is_control() && !c.is_whitespace() && !matches!(c, '\u{2000}'..='\u{206f}' | '\u{feff}');
    let is_safe =
        |c: char| if c.is_ascii() { c.is_ascii_alphanumeric() || " _-+#()[]".contains(c) } else { is_seen(c) };
    let safe = |c: char| if is_safe(c) { c } else { '_' };
    lights
        .map(|light| {
            let safe: String = light.chars().map(safe).collect();
            let plain = safe[..safe.floor_char_boundary(MAX_BYTES)].to_owned();
            if taken.insert(plain.clone()) {
                return plain;
            }
            let number = free_from.entry(plain.clone()).or_insert(2);
            loop {
                let name = format!("{plain}_{number}");
                *number += 1;
                if taken.insert(name.clone()) {
                    return name;
                }
            }
        })
        .collect()
}

fn size_of_rect(rect: PixelRect) -> ImageSize {
    ImageSize { width: rect.width as usize, height: rect.height as usize }
}

fn stop_if_interrupted(path: &Path, watch: &dyn Progress) -> Result<()> {
    if watch.interrupted() {
        return Err(Error::interrupted(format!("{} was not written", path.display())));
    }
    Ok(())
}
