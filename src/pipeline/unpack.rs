//! `.ltc` → `.ltm`, images or arrays.

use std::path::Path;

use rayon::prelude::*;

use super::Watch;
use crate::error::{Error, Result};
use crate::image::{self, LinearImage};
use crate::light::{Job, Lighting};
use crate::matrix::{BlockId, BlockSink, FactorSource, TracedBlock};
use crate::relight::CpuRelighter;
use crate::store::{StoreOptions, StoreWriter};

/// Choices of unpacking into a store.
pub type UnpackOptions = StoreOptions;

/// Multiplies every block out into a stored matrix at `path`.
///
/// Errors: those of reading the container and writing the store.
pub fn unpack_to_store(
    source: &dyn FactorSource,
    job: &Job,
    path: &Path,
    options: &StoreOptions,
    watch: &dyn Watch,
) -> Result<()> {
    let writer = StoreWriter::create(path, job, *options)?;
    let blocks: Vec<BlockId> = job.shape.blocks().collect();
    watch.begin("unpacking", blocks.len() as u64, "blocks");
    let result = blocks.par_iter().try_for_each(|&id| {
        let block = source.read_layers(id, 0..source.layer_count(id))?.expand();
        let bytes = size_of_val(block.entries()) as u64;
        writer.write_block(id, &TracedBlock { block, noise: None })?;
        watch.advance(1, bytes, "B");
        Ok(())
    });
    watch.end();
    result?;
    writer.finish()?;
    Ok(())
}

/// Writes one layer for each light, lit as the scene lights it, into one EXR file at `path`.
///
/// Errors: those of reading the container and writing the file.
pub fn unpack_to_exr(source: &dyn FactorSource, job: &Job, path: &Path, watch: &dyn Watch) -> Result<()> {
    let images = light_images(source, job, watch)?;
    let layers: Vec<_> = job.basis.lights().iter().map(|light| light.name.as_str()).zip(&images).collect();
    in_place_of(path, |temporary| image::write_exr_layers(temporary, &layers))
}

/// Writes an f32 array `[lights, height, width, 3]` of the lights' images, lit as the scene lights them, to `path`.
///
/// Errors: those of reading the container and writing the file.
pub fn unpack_to_npy(source: &dyn FactorSource, job: &Job, path: &Path, watch: &dyn Watch) -> Result<()> {
    let images = light_images(source, job, watch)?;
    in_place_of(path, |temporary| image::write_npy(temporary, &images))
}

/// One image for each light of the basis.
fn light_images(source: &dyn FactorSource, job: &Job, watch: &dyn Watch) -> Result<Vec<LinearImage>> {
    let relighter = CpuRelighter::load(source)?;
    watch.begin("relighting", job.basis.lights().len() as u64, "lights");
    let images = job.basis.lights().iter().map(|light| {
        let mut weights = vec![[0.0; 3]; job.shape.columns()];
        light.columns().for_each(|column| weights[column as usize] = light.emission);
        let image = relighter.relight(&Lighting::new(weights)?)?;
        watch.advance(1, 1, "lights");
        Ok(image)
    });
    let images = images.collect();
    watch.end();
    images
}

/// Lets `write` write to a temporary name beside `path` and moves the result there, so that nothing half-written ever
/// stands under the final name.
fn in_place_of(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    let temporary = path.with_file_name(name);
    let result = write(&temporary)
        .and_then(|()| std::fs::rename(&temporary, path).map_err(Error::io(path, "move the finished file into place")));
    if result.is_err() {
        let _ = std::fs::remove_file(&temporary);
    }
    result
}
