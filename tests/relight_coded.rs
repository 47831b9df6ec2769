//! Right factors as they are coded: the same pictures as from decoded ones, whatever the container.

mod relight_source;

use std::path::{Path, PathBuf};

use ltm::container::{ContainerOptions, ContainerReader, ContainerWriter};
use ltm::image::LinearImage;
use ltm::light::{Job, Light, LightBasis, LightKind, Lighting, Provenance};
use ltm::matrix::{BlockId, BlockReport, CHANNELS, ColumnIndex, FactoredBlock, MatrixShape, SparseEntry};
use ltm::relight::{CpuRelighter, PagedRelighter, adjoint_streaming, relight_streaming};
use relight_source::{largest_difference, random_lighting};

/// Left sides are rounded by half of an eighth of their step at most, or by 2⁻¹² of a value, and what these tests pack has steps of
/// a thousandth; right sides are not rounded at all, and products are in f32.
const TOLERANCE: f32 = 1.0 / 1024.0;

/// The picture from the decoded values of all blocks, in f64.
fn decoded(container: &ContainerReader, lighting: &Lighting) -> LinearImage {
    let shape = container.job().shape;
    let mut image = LinearImage::black(shape.width(), shape.height());
    for id in shape.blocks().filter(|&id| container.has_block(id)) {
        let weights = lighting.weights().iter().enumerate().map(|(column, &w)| (ColumnIndex(column as u32), w));
        let (rows, rect) = (container.read_block(id).unwrap().relight(weights), shape.rect(id));
        for (row, value) in rows.into_iter().enumerate() {
            let (channel, pixel) = (row / rect.pixels(), row % rect.pixels());
            let (x, y) = (rect.x as usize + pixel % rect.width as usize, rect.y as usize + pixel / rect.width as usize);
            image.pixels[y * shape.width() as usize + x][channel] = value as f32;
        }
    }
    image
}

/// A panel with tiles of all kinds of edges, a sky, and lamps before, between and behind them.
fn job() -> Job {
    let mut basis = LightBasis::new();
    for (name, kind) in [
        ("a", LightKind::Lamp),
        ("panel", LightKind::AreaTexels { across: 45, down: 33 }),
        ("b", LightKind::Lamp),
        ("c", LightKind::Lamp),
        ("sky", LightKind::LatLong { across: 64, down: 32 }),
        ("d", LightKind::Lamp),
    ] {
        basis.push(Light::unplaced(name, kind)).unwrap();
    }
    let shape = MatrixShape::new(40, 24, basis.column_count() as u32, 16).unwrap();
    Job { shape, basis, provenance: Provenance { source: "test".into(), ..Default::default() } }
}

/// Smooth factors of falling weight with steps of a thousandth; some blocks with sparse entries, one black.
fn block(job: &Job, id: BlockId, band_steps: &[i8]) -> FactoredBlock {
    let (rows, columns) = (job.shape.rect(id).rows(), job.shape.columns());
    let mut block = FactoredBlock { rows, columns, right_band_steps: band_steps.into(), ..Default::default() };
    if id.0 == 4 {
        return block;
    }
    for k in 0..5 {
        let (f, size) = ((1 + k) as f32 + 0.1 * id.0 as f32, 0.4f32.powi(k));
        block.left.extend((0..rows).map(|row| size * (1.2 + (f * row as f32 * 0.03).cos())));
        block.right.extend((0..columns).map(|j| (f * (j % 45) as f32 * 0.1).sin() + (f * j as f32 * 0.002).cos()));
        block.left_step.push(0.001 * size);
        block.right_step.push(0.004);
    }
    if id.0 % 2 == 1 {
        let entry = |i: u32| SparseEntry { column: ColumnIndex(i * 31), row: i * 5, value: 1.0 + i as f32 };
        block.sparse = (0..20).map(entry).collect();
    }
    block
}

/// Writes a container whose bands of right sides are so much finer, in some blocks otherwise than in the others.
fn pack(path: &Path, job: &Job, layered: bool, band_steps: impl Fn(BlockId) -> Vec<i8>) {
    let mut options = ContainerOptions::default();
    options.codec.layered = layered;
    let writer = ContainerWriter::create(path, job, options).unwrap();
    for id in job.shape.blocks() {
        writer.write_block(id, &block(job, id, &band_steps(id)), &BlockReport::default()).unwrap();
    }
    writer.finish().unwrap();
}

/// How much finer bands are: the first lamp and the low frequencies more than the others, some coarser.
fn uneven(_: BlockId) -> Vec<i8> {
    let image = [8, 6, 5, 3, 2, 1, 0, 0, -1, -1];
    [&[3][..], &image, &[4, 0], &image, &[-2]].concat()
}

fn packed(folder: &Path) -> Vec<PathBuf> {
    let job = job();
    let path = |name: &str| folder.join(name);
    pack(&path("even.ltc"), &job, true, |_| Vec::new());
    pack(&path("uneven.ltc"), &job, true, uneven);
    pack(&path("one-layer.ltc"), &job, false, uneven);
    // Blocks that are not in the units of the first are coded anew.
    pack(&path("mixed.ltc"), &job, true, |id| if id.0 < 2 { uneven(id) } else { Vec::new() });
    ["even.ltc", "uneven.ltc", "one-layer.ltc", "mixed.ltc"].map(path).to_vec()
}

fn golden() -> Vec<PathBuf> {
    let files = std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("formats/golden")).unwrap();
    let paths: Vec<PathBuf> = files.map(|file| file.unwrap().path()).collect();
    paths.into_iter().filter(|path| path.extension().is_some_and(|extension| extension == "ltc")).collect()
}

/// The lighting with a brush's stroke across the panel, or across what there is in a container without one.
fn painted(lighting: &Lighting) -> Vec<(ColumnIndex, [f32; CHANNELS])> {
    let columns = lighting.weights().len();
    (columns / 5..columns / 2).step_by(3).map(|j| (ColumnIndex(j as u32), [2.0, 0.25 * (j % 4) as f32, 0.0])).collect()
}

#[test]
fn pictures_are_those_of_the_decoded_factors() {
    let folder = tempfile::tempdir().unwrap();
    for (path, tolerance) in
        packed(folder.path()).into_iter().map(|path| (path, TOLERANCE)).chain(golden().into_iter().map(|p| (p, 0.01)))
    {
        let container = ContainerReader::open(&path).unwrap();
        let columns = container.job().shape.columns();
        let relighter = CpuRelighter::load(&container).unwrap();
        let even = Lighting::uniform(columns, [1.0, 0.5, 0.25]).unwrap();
        for lighting in [random_lighting(columns, 1), random_lighting(columns, 2), even] {
            let (expected, relit) = (decoded(&container, &lighting), relighter.relight(&lighting).unwrap());
            let difference = largest_difference(&relit, &expected);
            assert!(difference <= tolerance, "{}: {difference}", path.display());
            assert_eq!(relight_streaming(&container, &lighting).unwrap().0, relit);
            for budget in [0, u64::MAX] {
                assert_eq!(PagedRelighter::new(&container, budget).relight(&lighting).unwrap(), relit);
            }
        }
    }
}

#[test]
fn one_light_changed_and_a_texture_painted_arrive_at_the_same_picture() {
    let folder = tempfile::tempdir().unwrap();
    for path in packed(folder.path()).into_iter().chain(golden()) {
        let container = ContainerReader::open(&path).unwrap();
        let relighter = CpuRelighter::load(&container).unwrap();
        let columns = container.job().shape.columns();
        let lighting = random_lighting(columns, 3);
        let mut kept = relighter.relight_kept(&lighting).unwrap();
        let mut weights = lighting.weights().to_vec();
        let one = |j: usize| vec![(ColumnIndex(j as u32), [3.0, 0.0, 1.0])];
        for changes in [one(0), one(columns / 2), one(columns - 1), painted(&lighting), one(columns / 3)] {
            relighter.change(&mut kept, &changes).unwrap();
            changes.iter().for_each(|&(column, weight)| weights[column.index()] = weight);
            let expected = relighter.relight(&Lighting::new(weights.clone()).unwrap()).unwrap();
            let difference = largest_difference(&kept.image, &expected);
            // The same sums in another order: thousands of f32 products.
            assert!(difference < 2e-5, "{}: {difference}", path.display());
        }
    }
}

#[test]
fn the_adjoint_is_that_of_the_decoded_factors() {
    let folder = tempfile::tempdir().unwrap();
    for path in packed(folder.path()) {
        let container = ContainerReader::open(&path).unwrap();
        let shape = container.job().shape;
        let x: Vec<[f32; 3]> = (0..shape.rows() / 3).map(|i| [0.1, 0.7, 1.3].map(|f| (f * i as f32).sin())).collect();
        let adjoint = CpuRelighter::load(&container).unwrap().adjoint(&x).unwrap();
        assert_eq!(adjoint_streaming(&container, &x).unwrap(), adjoint);
        for column in [0, 7, 500, shape.columns() - 1] {
            let mut one = vec![[0.0; 3]; shape.columns()];
            one[column] = [1.0; 3];
            let image = decoded(&container, &Lighting::new(one).unwrap());
            for channel in 0..CHANNELS {
                let pairs = image.pixels.iter().zip(&x).map(|(a, b)| f64::from(a[channel]) * f64::from(b[channel]));
                let (sum, size) = pairs.fold((0.0, 0.0), |(sum, size), p| (sum + p, size + p.abs()));
                assert!(
                    (adjoint[column][channel] - sum).abs() <= 1e-3 * size,
                    "{} for {sum}",
                    adjoint[column][channel]
                );
            }
        }
    }
}

#[test]
fn memory_is_near_to_the_bytes_of_the_file_and_below_what_is_reckoned() {
    let folder = tempfile::tempdir().unwrap();
    for path in packed(folder.path()).into_iter().take(3).chain(golden()) {
        let container = ContainerReader::open(&path).unwrap();
        let held = CpuRelighter::load(&container).unwrap().factor_bytes();
        assert!(held <= container.factors_bytes(), "{}: {held}", path.display());
        let dense: usize =
            container.job().shape.blocks().map(|id| container.rank(id) * container.job().shape.columns()).sum();
        assert!(held < 2 * dense as u64 + container.job().shape.rows() * 100);
    }
}
