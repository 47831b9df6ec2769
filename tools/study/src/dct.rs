//! A transform coder as a general-purpose rival: the four-dimensional DCT of each block over pixels and texels, one
//! uniform quantiser, and zstd. It knows nothing of light transport but that neighbours are alike.

use std::f64::consts::PI;
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use faer::{Mat, MatRef};
use rayon::prelude::*;

use super::factors::assemble;
use super::rivals::ZSTD_LEVEL;
use ltm::error::{Error, Result};
use ltm::image::LinearImage;
use ltm::light::{LightBasis, Lighting};
use ltm::matrix::{BlockId, BlockSource, BlockView, CHANNELS, MatrixShape, PixelRect, TracedBlock};
use ltm::store::StoreReader;

/// A coefficient beyond ±127 steps is written as this byte and kept in full at the end of its block.
const ESCAPE: i8 = -128;

/// The orthonormal DCT-II of length `n` as a matrix, a row for each frequency. As matrix products the transforms of such
/// short lengths need no library of their own.
fn basis(n: usize) -> Mat<f32> {
    Mat::from_fn(n, n, |k, i| {
        let scale = if k == 0 { 1.0 } else { 2.0f64 } / n as f64;
        (scale.sqrt() * (PI * k as f64 * (2 * i + 1) as f64 / (2 * n) as f64).cos()) as f32
    })
}

/// The Kronecker product of the transforms of an across × down grid, row by row: cells × cells.
fn grid_basis(across: usize, down: usize) -> Mat<f32> {
    let (x, y) = (basis(across), basis(down));
    Mat::from_fn(across * down, across * down, |f, c| x[(f % across, c % across)] * y[(f / across, c / across)])
}

/// Grids of texels (across, down) in the order of their columns: one for each light of texels; lights of one column that
/// follow each other are one row.
pub(super) fn grids(lights: &LightBasis) -> Vec<(usize, usize)> {
    let mut grids: Vec<(usize, usize)> = Vec::new();
    let mut row_is_open = false;
    for light in lights.lights() {
        let (across, down) = light.layout();
        match (grids.last_mut(), across * down) {
            (Some(row), 1) if row_is_open => row.0 += 1,
            (_, texels) => {
                grids.push((across as usize, down as usize));
                row_is_open = texels == 1;
            }
        }
    }
    grids
}

/// The transforms of grids whose columns follow each other: columns × columns.
fn texel_basis(grids: &[(usize, usize)]) -> Mat<f32> {
    let columns = grids.iter().map(|(across, down)| across * down).sum();
    let mut all = Mat::zeros(columns, columns);
    let mut first = 0;
    for &(across, down) in grids {
        let count = across * down;
        all.submatrix_mut(first, first, count, count).copy_from(grid_basis(across, down));
        first += count;
    }
    all
}

/// Coefficients of a block of this size, from low frequencies to high over all four dimensions, as (row, column).
fn order(rect: PixelRect, grids: &[(usize, usize)]) -> Vec<(u32, u32)> {
    let (width, height) = (rect.width as usize, rect.height as usize);
    let part = |i: usize, n: usize| (i * 1024 / n) as u32;
    let pixel = |p: usize| part(p % width, width) + part(p / width, height);
    let of_grid = |&(across, down): &(usize, usize)| {
        (0..across * down).map(move |t| part(t % across, across) + part(t / across, down))
    };
    let texels: Vec<u32> = grids.iter().flat_map(of_grid).collect();
    let rows = rect.rows() as u32;
    let mut all: Vec<(u32, u32)> =
        (0..texels.len() as u32).flat_map(|column| (0..rows).map(move |row| (row, column))).collect();
    all.par_sort_by_cached_key(|&(row, column)| pixel(row as usize % rect.pixels()) + texels[column as usize]);
    all
}

/// Writes `source` once for each step; returns the files.
pub(super) fn write(source: &StoreReader, steps: &[f32], stem: &Path) -> Result<Vec<PathBuf>> {
    let (shape, grids) = (source.shape(), grids(&source.job().basis));
    let paths: Vec<PathBuf> = (0..steps.len()).map(|i| stem.with_extension(format!("{i}.rival"))).collect();
    let open = |path: &PathBuf| {
        let file = BufWriter::new(File::create(path).map_err(Error::io(path, "create"))?);
        zstd::Encoder::new(file, ZSTD_LEVEL).map_err(Error::io(path, "write"))
    };
    let mut files = paths.iter().map(open).collect::<Result<Vec<_>>>()?;
    let texels = texel_basis(&grids);
    let mut traced = TracedBlock::default();
    let mut known: Option<(PixelRect, Vec<(u32, u32)>)> = None;
    for id in shape.blocks() {
        source.read_block(id, &mut traced)?;
        let rect = PixelRect { x: 0, y: 0, ..shape.rect(id) };
        if known.as_ref().is_none_or(|(size, _)| *size != rect) {
            known = Some((rect, order(rect, &grids)));
        }
        let places = &known.as_ref().expect("set above").1;
        let coefficients = transform(traced.block.view(), rect, texels.as_ref());
        files.par_iter_mut().zip(steps).zip(&paths).try_for_each(|((file, step), path)| {
            let mut escaped = Vec::new();
            let mut bytes: Vec<u8> = places
                .iter()
                .map(|&(row, column)| {
                    let level = (coefficients[(row as usize, column as usize)] / step).round();
                    if level.abs() > 127.0 {
                        escaped.extend(level.to_le_bytes());
                        return ESCAPE as u8;
                    }
                    (level as i8) as u8
                })
                .collect();
            bytes.extend(escaped);
            file.write_all(&bytes).map_err(Error::io(path, "write"))
        })?;
    }
    for (file, path) in files.into_iter().zip(&paths) {
        file.finish().and_then(|mut file| file.flush()).map_err(Error::io(path, "write"))?;
    }
    Ok(paths)
}

/// Pixels, colours and texels transformed: rows (planes of colour frequencies) × columns (texel frequencies).
fn transform(block: BlockView<'_>, rect: PixelRect, texels: MatRef<'_, f32>) -> Mat<f32> {
    let (colours, pixels) = (basis(CHANNELS), grid_basis(rect.width as usize, rect.height as usize));
    let a = MatRef::from_column_major_slice(block.entries(), block.rows(), block.columns());
    let through = a * texels.transpose();
    let count = rect.pixels();
    let planes: Vec<Mat<f32>> = (0..CHANNELS).map(|ch| &pixels * through.as_ref().subrows(ch * count, count)).collect();
    Mat::from_fn(block.rows(), block.columns(), |row, column| {
        (0..CHANNELS).map(|ch| colours[(row / count, ch)] * planes[ch][(row % count, column)]).sum()
    })
}

/// The images of a file under lightings. The transforms being orthonormal, a lighting's own coefficients are multiplied
/// with those of the block, and only images are transformed back.
pub(super) fn read(
    path: &Path,
    step: f32,
    shape: MatrixShape,
    lights: &LightBasis,
    lightings: &[Lighting],
) -> Result<Vec<LinearImage>> {
    let failed = || Error::io(path, "read");
    let grids = grids(lights);
    let columns = shape.columns();
    let texels = texel_basis(&grids);
    let colours = basis(CHANNELS);
    // Coefficients of the lightings: columns × (lighting, channel).
    let weights =
        Mat::from_fn(columns, lightings.len() * CHANNELS, |j, l| lightings[l / CHANNELS].weights()[j][l % CHANNELS]);
    let weights = texels * weights;
    let file = File::open(path).map_err(failed())?;
    let mut file = zstd::Decoder::new(BufReader::new(file)).map_err(failed())?;
    let mut relit = Vec::new();
    let mut known: Option<(PixelRect, Vec<(u32, u32)>)> = None;
    for id in shape.blocks() {
        let rect = PixelRect { x: 0, y: 0, ..shape.rect(id) };
        if known.as_ref().is_none_or(|(size, _)| *size != rect) {
            known = Some((rect, order(rect, &grids)));
        }
        let places = &known.as_ref().expect("set above").1;
        let mut levels = vec![0u8; places.len()];
        file.read_exact(&mut levels).map_err(failed())?;
        // Rows of colour and pixel frequencies × (lighting, channel).
        let mut sums = Mat::<f32>::zeros(rect.rows(), weights.ncols());
        for (&level, &(row, column)) in levels.iter().zip(places) {
            let level = match level as i8 {
                0 => continue,
                ESCAPE => {
                    let mut full = [0; 4];
                    file.read_exact(&mut full).map_err(failed())?;
                    f32::from_le_bytes(full)
                }
                level => f32::from(level),
            };
            for l in 0..weights.ncols() {
                sums[(row as usize, l)] += level * step * weights[(column as usize, l)];
            }
        }
        relit.push(to_pixels(&sums, rect, &colours, lightings.len()));
    }
    Ok(assemble(shape, lightings.len(), &relit))
}

/// For each lighting, rows (channel-planar) from the coefficients under each (lighting, channel).
fn to_pixels(sums: &Mat<f32>, rect: PixelRect, colours: &Mat<f32>, lightings: usize) -> Vec<Vec<f64>> {
    let pixels = grid_basis(rect.width as usize, rect.height as usize);
    let count = rect.pixels();
    let planes: Vec<Mat<f32>> =
        (0..CHANNELS).map(|s| pixels.transpose() * sums.as_ref().subrows(s * count, count)).collect();
    let value = |l: usize, row: usize| -> f64 {
        let (ch, p) = (row / count, row % count);
        (0..CHANNELS).map(|s| f64::from(colours[(s, ch)] * planes[s][(p, l * CHANNELS + ch)])).sum()
    };
    (0..lightings).map(|l| (0..rect.rows()).map(|row| value(l, row)).collect()).collect()
}

/// The largest constant coefficient of any block, all colours together: what steps are measured by.
pub(super) fn scale(source: &StoreReader) -> Result<f32> {
    let shape = source.shape();
    let mut traced = TracedBlock::default();
    let mut largest = 0.0f32;
    for id in (0..shape.block_count()).map(BlockId) {
        source.read_block(id, &mut traced)?;
        let entries = traced.block.entries();
        let sum: f64 = entries.iter().map(|&v| f64::from(v)).sum();
        largest = largest.max((sum / (entries.len() as f64).sqrt()) as f32);
    }
    Ok(largest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ltm::light::{Light, LightKind};

    #[test]
    fn the_transform_is_orthonormal() {
        let d = texel_basis(&[(5, 3), (4, 1)]);
        let unit = &d * d.transpose();
        assert!((unit - Mat::<f32>::identity(19, 19)).norm_max() < 1e-5);
    }

    #[test]
    fn each_light_of_texels_is_a_grid_and_lamps_are_one_row() {
        let mut basis = LightBasis::new();
        for (name, kind) in [
            ("a", LightKind::Point),
            ("b", LightKind::AreaTexels { across: 4, down: 2 }),
            ("c", LightKind::Point),
            ("d", LightKind::Spot),
        ] {
            basis.push(Light::unplaced(name, kind)).unwrap();
        }
        assert_eq!(grids(&basis), [(1, 1), (4, 2), (2, 1)]);
    }

    #[test]
    fn low_frequencies_come_first() {
        let rect = PixelRect { x: 0, y: 0, width: 4, height: 2 };
        let places = order(rect, &[(2, 2)]);
        assert_eq!(places.len(), 24 * 4);
        assert_eq!(places[0].1, 0);
        assert_eq!(places[0].0 % 8, 0);
        assert_eq!(places.last().map(|p| p.1), Some(3));
    }
}
