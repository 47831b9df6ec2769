//! General codecs of arrays as rivals, by libraries that a Python has: SZ3 (Liang et al. 2023), SPERR (Li, Lindstrom, Clyne 2023)
//! and a quantised Tucker decomposition.
//!
//! `LTM_CODECS` names a Python with the packages, else it is the `python3` on the path; the script beside this file runs them.

use std::fs;

use serde_json::json;

use super::bench::Bench;
use super::dct::grids;
use super::python::Python;
use super::raw_image::read_f32;
use super::rivals::Packed;
use ltm::error::{Error, Result};
use ltm::files::write_file;
use ltm::light::Lighting;
use ltm::matrix::{BlockSource, CHANNELS, TracedBlock};
use ltm::store::StoreReader;

const SCRIPT: &str = include_str!("code_with_python.py");

/// Names of codecs, each with what runs it.
pub(super) const CODECS: [(&str, Python); 3] = [
    ("SZ3", Python { package: "hdf5plugin, h5py", variable: "LTM_CODECS" }),
    ("SPERR", Python { package: "hdf5plugin, h5py", variable: "LTM_CODECS" }),
    (TUCKER, Python { package: "tensorly", variable: "LTM_CODECS" }),
];
pub(super) const TUCKER: &str = "Tucker";

/// Codes a matrix at several sizes between these bytes and around them.
///
/// Errors: files that cannot be written; a script that fails, with its last line.
pub(super) fn code(
    bench: &Bench<'_>,
    matrix: &StoreReader,
    (name, python): &(&str, Python),
    (least, most): (f64, f64),
    lightings: &[Lighting],
) -> Result<Vec<Packed>> {
    bench.stop_if_interrupted()?;
    let folder = bench.cached("codecs");
    fs::create_dir_all(&folder).map_err(Error::io(&folder, "create the folder"))?;
    let shape = matrix.shape();
    let (width, height) = (shape.width(), shape.height());
    let described = json!({ "width": width, "height": height, "grids": grids(&matrix.job().basis) });
    write_file(&folder.join("description.json"), true, described.to_string().as_bytes())?;
    let as_bytes = |values: &[f32]| -> Vec<u8> { values.iter().flat_map(|value| value.to_le_bytes()).collect() };
    write_file(&folder.join("matrix.f32"), true, &as_bytes(&column_images(matrix)?))?;
    let weights: Vec<f32> = lightings.iter().flat_map(|lighting| lighting.weights().as_flattened().to_vec()).collect();
    write_file(&folder.join("weights.f32"), true, &as_bytes(&weights))?;
    let printed = python.run(SCRIPT, &folder, &[(*name).to_owned(), least.to_string(), most.to_string()])?;
    let sizes = printed.lines().filter_map(|line| {
        let (bytes, seconds) = line.split_once(' ')?;
        Some((bytes.parse().ok()?, seconds.parse().ok()?))
    });
    let read = |(which, (bytes, seconds)): (usize, (u64, f64))| -> Result<Packed> {
        let image = |lighting: usize| read_f32(&folder.join(format!("{which}-{lighting}.f32")), width, height);
        let images = (0..lightings.len()).map(image).collect::<Result<_>>()?;
        Ok(Packed { bytes, rank: None, seconds, images })
    };
    sizes.enumerate().map(read).collect()
}

/// All entries as columns × colours × height × width.
fn column_images(matrix: &StoreReader) -> Result<Vec<f32>> {
    let shape = matrix.shape();
    let (width, plane) = (shape.width() as usize, (shape.width() * shape.height()) as usize);
    let mut all = vec![0.0; CHANNELS * plane * shape.columns()];
    let mut traced = TracedBlock::default();
    for id in shape.blocks() {
        matrix.read_block(id, &mut traced)?;
        let rect = shape.rect(id);
        let across = rect.width as usize;
        // Runs of a pixel row: block column by column, colour by colour.
        for (run, values) in traced.block.entries().chunks_exact(across).enumerate() {
            let (of, y) = (run / rect.height as usize, run % rect.height as usize);
            let at = of * plane + (rect.y as usize + y) * width + rect.x as usize;
            all[at..at + across].copy_from_slice(values);
        }
    }
    Ok(all)
}
