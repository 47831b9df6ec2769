//! A stored matrix taken apart as it is: arrays, images, and parts that are matrices again.

use std::fs;
use std::path::Path;

use ltm::image::read_image;
use ltm::light::{Job, Light, LightBasis, LightKind};
use ltm::matrix::{BlockId, BlockSink, BlockSource, CHANNELS, MatrixShape, PixelRect, TracedBlock};
use ltm::pipeline::{self, Selection, UnpackOptions};
use ltm::resources::NoProgress;
use ltm::store::{Precision, StoreOptions, StoreReader, StoreWriter};

const WIDTH: u32 = 21;
const HEIGHT: u32 = 13;

/// The entry at a pixel: halves, so that 16-bit floats hold it, and 0 in the third column.
fn entry(x: u32, y: u32, channel: usize, column: u32) -> f32 {
    if column == 2 { 0.0 } else { (x + 2 * y + 5 * channel as u32) as f32 * 0.5 + column as f32 }
}

/// How the scene lights the texels of the light in the middle, as an environment's map does.
const TEXELS: [[f32; 3]; 4] = [[0.5; 3], [1.0, 0.0, 2.0], [0.0; 3], [0.25, 4.0, 0.5]];

/// Three lights; the one in the middle has 2 × 2 texels. Six blocks, of which some are written.
fn matrix(folder: &Path, precision: Precision, blocks: impl Iterator<Item = u32>) -> StoreReader {
    let mut basis = LightBasis::new();
    let lights = [
        ("desk", LightKind::Lamp, 1, [1.0, 2.0, 3.0]),
        ("panel", LightKind::AreaTexels { across: 2, down: 2 }, 4, [0.5; 3]),
        ("door", LightKind::Lamp, 1, [4.0, 0.0, 1.0]),
    ];
    for (name, kind, columns, emission) in lights {
        let light = Light {
            name: name.into(),
            kind,
            unit: ltm::light::LightUnit::Radiance,
            emission,
            first_column: 0,
            places: vec![[0.0; 3]; columns],
            extents: vec![1.0; columns],
        };
        basis.push(light).unwrap();
    }
    basis.set_scene_weights(1, TEXELS.to_vec()).unwrap();
    let shape = MatrixShape::new(WIDTH, HEIGHT, basis.column_count() as u32, 8).unwrap();
    let job = Job { shape, basis, provenance: Default::default() };
    let path = folder.join("a.ltm");
    let options = StoreOptions { precision, overwrite: true, ..Default::default() };
    let writer = StoreWriter::create(&path, &job, options).unwrap();
    for id in blocks.map(BlockId) {
        let rect = shape.rect(id);
        let mut traced = TracedBlock::default();
        traced.block.reset(rect.rows(), shape.columns());
        for (at, value) in traced.block.entries_mut().iter_mut().enumerate() {
            let (column, row) = (at / rect.rows(), at % rect.rows());
            let (channel, pixel) = (row / rect.pixels(), (row % rect.pixels()) as u32);
            *value = entry(rect.x + pixel % rect.width, rect.y + pixel / rect.width, channel, column as u32);
        }
        writer.write_block(id, &traced).unwrap();
    }
    writer.finish().unwrap();
    StoreReader::open(&path).unwrap()
}

/// What a light's image has at a pixel, as the scene lights it.
fn lit(light: &Light, x: u32, y: u32, channel: usize) -> f32 {
    let weight = |column: u32| match light.name.as_str() {
        "panel" => TEXELS[column as usize - 1][channel],
        _ => light.emission[channel],
    };
    light.columns().map(|column| entry(x, y, channel, column) * weight(column)).sum()
}

/// The values of a `.npy` file, which has a header of a multiple of 64 bytes before them.
fn npy_values(path: &Path) -> Vec<f32> {
    let bytes = fs::read(path).unwrap();
    let head = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    bytes[head..].as_chunks::<4>().0.iter().map(|&four| f32::from_le_bytes(four)).collect()
}

#[test]
fn an_array_of_a_stored_matrix_has_its_entries_as_the_scene_lights_them() {
    for precision in [Precision::F32, Precision::F16] {
        let folder = tempfile::tempdir().unwrap();
        let matrix = matrix(folder.path(), precision, 0..6);
        let path = folder.path().join("a.npy");
        pipeline::unpack_to_npy(&matrix, &path, &UnpackOptions::default(), &NoProgress).unwrap();
        let mut values = npy_values(&path).into_iter();
        for light in matrix.job().basis.lights() {
            for (y, x) in (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (y, x))) {
                for channel in 0..CHANNELS {
                    assert_eq!(values.next(), Some(lit(light, x, y, channel)), "{precision} {} {x} {y}", light.name);
                }
            }
        }
        assert_eq!(values.next(), None);
        assert!(
            pipeline::unpack_to_npy(&matrix, &path, &UnpackOptions::default(), &NoProgress).is_err(),
            "it is there"
        );
    }
}

#[test]
fn crops_blocks_and_lights_choose_a_part() {
    let folder = tempfile::tempdir().unwrap();
    let matrix = matrix(folder.path(), Precision::F32, 0..6);
    let crop = PixelRect { x: 5, y: 3, width: 12, height: 9 };
    let selection = Selection { crop: Some(crop), blocks: Some(1..3), lights: vec!["d*".into()] };
    let options = UnpackOptions { selection, ..Default::default() };
    let path = folder.path().join("{light}.exr");
    let written = pipeline::unpack_to_exr(&matrix, &path, &options, &NoProgress).unwrap();
    assert_eq!(written, ["desk.exr", "door.exr"].map(|name| folder.path().join(name)));
    for (path, name) in written.iter().zip(["desk", "door"]) {
        let image = read_image(path).unwrap();
        assert_eq!((image.width, image.height), (crop.width, crop.height));
        for (at, pixel) in image.pixels.iter().enumerate() {
            let (x, y) = (crop.x + at as u32 % crop.width, crop.y + at as u32 / crop.width);
            // Blocks 1 and 2 are the upper ones from the ninth pixel on.
            let is_chosen = x >= 8 && y < 8;
            let light = matrix.job().basis.find(name).unwrap();
            let wanted = [0, 1, 2].map(|channel| if is_chosen { lit(light, x, y, channel) } else { 0.0 });
            assert_eq!(*pixel, wanted, "{name} {x} {y}");
        }
    }
    // All of them as one image.
    let path = folder.path().join("all.exr");
    pipeline::unpack_relit(&matrix, &path, &UnpackOptions::default(), &NoProgress).unwrap();
    let pixel = read_image(&path).unwrap().pixels[(4 * WIDTH + 7) as usize];
    let all = |channel| matrix.job().basis.lights().iter().map(|light| lit(light, 7, 4, channel)).sum::<f32>();
    assert_eq!(pixel, [all(0), all(1), all(2)]);
}

#[test]
fn a_part_of_a_matrix_is_a_matrix() {
    let folder = tempfile::tempdir().unwrap();
    let matrix = matrix(folder.path(), Precision::F32, 0..6);
    let crop = PixelRect { x: 5, y: 3, width: 12, height: 9 };
    let selection = Selection { crop: Some(crop), lights: vec!["panel".into(), "door".into()], ..Default::default() };
    let options = UnpackOptions { selection, ..Default::default() };
    let path = folder.path().join("part.ltm");
    assert_eq!(pipeline::unpack_to_store(&matrix, &path, &options, &NoProgress).unwrap(), 4);
    let part = StoreReader::open(&path).unwrap();
    let shape = BlockSource::shape(&part);
    assert_eq!((shape.width(), shape.height(), shape.columns()), (12, 9, 5));
    assert_eq!(part.job().basis.scene_weights(), [&TEXELS[..], &[[4.0, 0.0, 1.0]]].concat());
    let mut traced = TracedBlock::default();
    for id in shape.blocks() {
        part.read_block(id, &mut traced).unwrap();
        let rect = shape.rect(id);
        for (at, value) in traced.block.entries().iter().enumerate() {
            let (column, row) = (at / rect.rows(), at % rect.rows());
            let (channel, pixel) = (row / rect.pixels(), (row % rect.pixels()) as u32);
            let (x, y) = (rect.x + pixel % rect.width, rect.y + pixel / rect.width);
            assert_eq!(*value, entry(crop.x + x, crop.y + y, channel, column as u32 + 1), "{id} {at}");
        }
    }
}

#[test]
fn what_is_missing_or_damaged_is_an_error_that_names_the_block() {
    let folder = tempfile::tempdir().unwrap();
    let partial = matrix(folder.path(), Precision::F32, 0..4);
    let path = folder.path().join("a.npy");
    let error =
        pipeline::unpack_to_npy(&partial, &path, &UnpackOptions::default(), &NoProgress).unwrap_err().to_string();
    assert!(error.contains("block 4") && !path.exists(), "{error}");
    let there = Selection { blocks: Some(0..4), ..Default::default() };
    let options = UnpackOptions { selection: there, ..Default::default() };
    pipeline::unpack_to_npy(&partial, &path, &options, &NoProgress).unwrap();
    drop(partial);

    let name = folder.path().join("a.ltm");
    drop(matrix(folder.path(), Precision::F32, 0..6));
    let mut bytes = fs::read(&name).unwrap();
    // The last entry of the sixth column at pixel 20, 12 of the third channel.
    let last = entry(WIDTH - 1, HEIGHT - 1, 2, 5).to_le_bytes();
    let at = bytes.windows(4).rposition(|four| four == last).expect("it is stored as it is");
    bytes[at] ^= 1;
    fs::write(&name, bytes).unwrap();
    let damaged = StoreReader::open(&name).unwrap();
    let options = UnpackOptions { overwrite: true, ..Default::default() };
    let error = pipeline::unpack_to_npy(&damaged, &path, &options, &NoProgress).unwrap_err();
    assert!(matches!(error, ltm::Error::Damaged { .. }) && error.to_string().contains("block 5"), "{error}");
    // Columns that are not asked for are not read.
    let selection = Selection { lights: vec!["desk".into()], ..Default::default() };
    pipeline::unpack_to_npy(&damaged, &path, &UnpackOptions { selection, ..options }, &NoProgress).unwrap();
}
