//! What compression makes of the samples' noise: blocks with a known truth and two noisy half-sample estimates.

use ltm::compress::{ClusterMap, ClusterResidual, CompressSettings, Compressor, Target};
use ltm::container::codec::{CodecSettings, LayerPart, decode_layer, encode_layer};
use ltm::container::{BlockLayout, LightLayout};
use ltm::light::{Clusters, Light, LightBasis, LightKind, probe_lightings};
use ltm::matrix::{Block, BlockId, BlockNoise, FactoredBlock, MatrixShape, SparseEntry};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const SIDE: usize = 16;
const TEXELS: usize = 9;
const COLUMNS: usize = TEXELS * TEXELS;
const ROWS: usize = 3 * SIDE * SIDE;
/// What a pixel shows of a light in view.
const LIGHT: f64 = 400.0;

fn panel() -> LightBasis {
    let mut basis = LightBasis::new();
    basis.push(Light::unplaced("panel", LightKind::AreaTexels { across: TEXELS as u32, down: TEXELS as u32 })).unwrap();
    basis
}

/// What of the panel is in view.
#[derive(Clone, Copy, PartialEq)]
enum View {
    /// Texel 20, by pixel 100.
    Pixel,
    /// Half of its texels, by 4 × 4 pixels of two each.
    Panel,
}

/// The texels that a pixel sees.
fn in_view(view: View, pixel: usize) -> Vec<usize> {
    let (x, y) = (pixel % SIDE, pixel / SIDE);
    match view {
        View::Pixel if pixel == 100 => vec![20],
        View::Panel if (4..8).contains(&x) && (4..8).contains(&y) => {
            let first = (y - 4) * 2 * TEXELS + (x - 4) * 2;
            vec![first, first + 1]
        }
        _ => Vec::new(),
    }
}

/// A floor below the panel, and pixels that see it.
fn truth(view: View, row: usize, column: usize) -> f64 {
    let pixel = row % (SIDE * SIDE);
    let (x, y) = ((pixel % SIDE) as f64 / SIDE as f64, (pixel / SIDE) as f64 / SIDE as f64);
    let (u, v) = ((column % TEXELS) as f64 / TEXELS as f64, (column / TEXELS) as f64 / TEXELS as f64);
    let seen = in_view(view, pixel);
    let light = if seen.contains(&column) { LIGHT / seen.len() as f64 } else { 0.0 };
    light + 0.2 / ((x - u).powi(2) + (y - v).powi(2) + 0.4).powi(2)
}

/// The mean of two estimates of `samples` paths each, every path carrying the light of one column, and their noise. A path
/// of a pixel that sees the panel meets one of the texels in view first.
fn traced(view: View, samples: usize, seed: u64) -> (Block, BlockNoise) {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut halves = [vec![0.0f64; ROWS * COLUMNS], vec![0.0f64; ROWS * COLUMNS]];
    for half in &mut halves {
        for row in 0..ROWS {
            let seen = in_view(view, row % (SIDE * SIDE));
            for _ in 0..samples {
                let column = random.random_range(0..COLUMNS);
                let light = if seen.contains(&column) { LIGHT / seen.len() as f64 } else { 0.0 };
                half[column * ROWS + row] += (truth(view, row, column) - light) * COLUMNS as f64 / samples as f64;
            }
        }
        for pixel in 0..SIDE * SIDE {
            let seen = in_view(view, pixel);
            for _ in 0..if seen.is_empty() { 0 } else { samples } {
                let column = seen[random.random_range(0..seen.len())];
                (0..3).for_each(|c| half[column * ROWS + c * SIDE * SIDE + pixel] += LIGHT / samples as f64);
            }
        }
    }
    let [a, b] = halves;
    let mean: Vec<f32> = a.iter().zip(&b).map(|(a, b)| (0.5 * (a + b)) as f32).collect();
    let half_difference: Vec<f64> = a.iter().zip(&b).map(|(a, b)| 0.5 * (a - b)).collect();
    let mut noise =
        BlockNoise { row_variance: vec![0.0; ROWS], column_variance: vec![0.0; COLUMNS], probes: Vec::new() };
    for (i, d) in half_difference.iter().enumerate() {
        noise.row_variance[i % ROWS] += (d * d / COLUMNS as f64) as f32;
        noise.column_variance[i / ROWS] += (d * d / ROWS as f64) as f32;
    }
    for lighting in probe_lightings(&panel()).chunks_exact(COLUMNS) {
        let seen =
            |row: usize| (0..COLUMNS).map(|j| half_difference[j * ROWS + row] * f64::from(lighting[j])).sum::<f64>();
        noise.probes.extend((0..ROWS).map(|row| seen(row) as f32));
    }
    (Block::from_entries(ROWS, COLUMNS, mean), noise)
}

/// What a reader gets of the packed block.
fn pack(block: &Block, noise: &BlockNoise, noise_factor: Option<f64>) -> FactoredBlock {
    pack_to(Target::Slope(0.0), block, noise, noise_factor).0
}

/// What a reader gets of the packed block, and its bytes.
fn pack_to(target: Target, block: &Block, noise: &BlockNoise, noise_factor: Option<f64>) -> (FactoredBlock, usize) {
    let shape = MatrixShape::new(SIDE as u32, SIDE as u32, COLUMNS as u32, SIDE as u32).unwrap();
    let settings = CompressSettings { noise_factor, target, ..Default::default() };
    let compressor = Compressor::new(&panel(), shape, settings).unwrap();
    let candidate = compressor.analyse(BlockId(0), block.view(), Some(noise));
    let factored = candidate.cut(&compressor.choose([candidate.summary()].into_iter()));
    let layout = BlockLayout::new(shape.rect(BlockId(0)), LightLayout::of(&panel()));
    let bytes = encode_layer(&layout, &factored, LayerPart::default(), &CodecSettings::default()).unwrap();
    (decode_layer(&layout, &bytes, None).unwrap(), bytes.len())
}

/// Squared error against the truth of the block and of images under single texels and half of the panel.
fn squared_error(view: View, block: &Block, lighting: impl Fn(usize) -> f64) -> f64 {
    let pixel = |row: usize| {
        let error = |j: usize| (f64::from(block.entries()[j * ROWS + row]) - truth(view, row, j)) * lighting(j);
        (0..COLUMNS).map(error).sum::<f64>()
    };
    (0..ROWS).map(|row| pixel(row).powi(2)).sum()
}

/// Squared error against the truth under draws of how people light.
fn error_of_images(view: View, block: &Block) -> f64 {
    let probes = probe_lightings(&panel());
    probes.chunks_exact(COLUMNS).map(|lighting| squared_error(view, block, |j| f64::from(lighting[j]))).sum()
}

#[test]
fn the_noise_chooses_a_rank_within_a_decibel_of_the_best_against_the_truth() {
    let mut worst = 0.0f64;
    let mut sum = 0.0;
    for seed in 1..=8 {
        let (block, noise) = traced(View::Pixel, 8, seed);
        let chosen = pack(&block, &noise, CompressSettings::default().noise_factor);
        // Noise is heeded, but every component passes it.
        let all = pack(&block, &noise, Some(1e-9));
        assert_eq!(all.rank(), CompressSettings::default().rank);
        let error_at = |rank: usize| {
            let mut first = all.clone();
            first.left.truncate(rank * ROWS);
            first.right.truncate(rank * COLUMNS);
            error_of_images(View::Pixel, &first.expand())
        };
        let least = (1..=all.rank()).map(error_at).fold(f64::INFINITY, f64::min);
        let times = error_of_images(View::Pixel, &chosen.expand()) / least;
        worst = worst.max(times);
        sum += times;
    }
    // The best here knows the truth; the choice has one realisation of the noise to estimate it from, whose sixteen probe
    // images are known to about √(2/16), 35 %, each. Seen: 0.89 to 1.01 for seven seeds (leaving out what is noise before
    // the block is projected does better than any rank of all), and 1.30 for the sixth, which keeps four components of five.
    assert!(sum / 8.0 < 1.1 && worst < 1.5, "{} in the mean, {worst} at worst", sum / 8.0);
}

#[test]
fn single_texels_come_much_nearer_to_the_truth_and_smooth_light_no_farther() {
    let (block, noise) = traced(View::Pixel, 8, 1);
    let factored = pack(&block, &noise, CompressSettings::default().noise_factor);
    let packed = factored.expand();
    for texel in [0, 27, 63] {
        let only = |j: usize| f64::from(u8::from(j == texel));
        let (raw, ours) = (squared_error(View::Pixel, &block, only), squared_error(View::Pixel, &packed, only));
        // 16 paths a pixel over 64 texels: a texel's own image is nearly all noise. Through eight components eight
        // texels share their paths, and pixels that are averaged share theirs too.
        assert!(ours < 0.1 * raw, "texel {texel}: {ours} against {raw}, rank {}", factored.rank());
    }
    let half = |j: usize| if j % TEXELS < TEXELS / 2 { 1.0 } else { 0.0 };
    // Smooth light is seen with little noise; it may not be made worse.
    let ratio = squared_error(View::Pixel, &packed, half) / squared_error(View::Pixel, &block, half);
    assert!(ratio < 1.0, "{ratio}, rank {}", factored.rank());
}

#[test]
fn a_seen_light_stays_an_entry_and_a_stray_path_does_not() {
    let (mut block, mut noise) = traced(View::Pixel, 8, 2);
    // A path of one estimate only.
    block.entries_mut()[31 * ROWS + 50] += 40.0;
    noise.row_variance[50] += 40.0f32.powi(2) / COLUMNS as f32;
    noise.column_variance[31] += 40.0f32.powi(2) / ROWS as f32;
    for (lighting, seen) in probe_lightings(&panel()).chunks_exact(COLUMNS).zip(noise.probes.chunks_exact_mut(ROWS)) {
        seen[50] += 40.0 * lighting[31];
    }
    let factored = pack(&block, &noise, CompressSettings::default().noise_factor);
    let has = |row: u32, column: u32| factored.sparse.iter().any(|e| (e.row, e.column.0) == (row, column));
    let pixels = (SIDE * SIDE) as u32;
    assert!((0..3).all(|channel| has(100 + channel * pixels, 20)), "{:?}", factored.sparse);
    assert!(!has(50, 31));
    assert!(factored.sparse.len() < 20, "{}", factored.sparse.len());
}

#[test]
fn a_panel_in_view_stays_what_it_is_though_its_samples_met_different_texels() {
    for seed in [1, 2, 3] {
        let (block, noise) = traced(View::Panel, 2, seed);
        let packed = pack(&block, &noise, CompressSettings::default().noise_factor).expand();
        let lightings: [(&str, &dyn Fn(usize) -> f64); 3] = [
            ("half", &|j| f64::from(u8::from(j % TEXELS < TEXELS / 2))),
            ("gradient", &|j| (j / TEXELS) as f64),
            ("one texel", &|j| f64::from(u8::from(j == 27))),
        ];
        for (name, lighting) in lightings {
            let error = |block| squared_error(View::Panel, block, lighting);
            let (raw, ours) = (error(&block), error(&packed));
            // Nearly all of it is of the pixels in view. As one component of the block they would show every lighting as
            // the mean of all texels: many times the error of the matrix under half of the panel.
            assert!(ours < raw, "{name}, seed {seed}: {ours} against {raw}");
        }
    }
}

#[test]
fn of_four_samples_none_is_an_entry_only_because_it_stands_out_in_its_row() {
    for seed in [1, 2, 3] {
        let (block, noise) = traced(View::Pixel, 2, seed);
        let factored = pack(&block, &noise, CompressSettings::default().noise_factor);
        // The neighbours of the pixel that sees a texel are taken for its like where their own samples agree.
        let beside = |e: &SparseEntry| {
            let pixel = e.row as usize % (SIDE * SIDE);
            (pixel % SIDE).abs_diff(100 % SIDE).max((pixel / SIDE).abs_diff(100 / SIDE)) <= 1
        };
        let others = factored.sparse.iter().filter(|e| !beside(e)).count();
        // Some 40 rows of the 768 have two of their four samples in one texel, one of each estimate.
        assert!(others <= 2, "seed {seed}: {others} of {}", factored.sparse.len());
        let (raw, ours) = (error_of_images(View::Pixel, &block), error_of_images(View::Pixel, &factored.expand()));
        // Pixels lit alike share their samples: 49 of them, or a third of that beside edges of the block.
        assert!(ours < 0.15 * raw, "seed {seed}: {ours} against {raw}");
    }
}

#[test]
fn by_default_no_bytes_are_spent_on_what_the_noise_hides() {
    let factor = CompressSettings::default().noise_factor;
    for samples in [2, 8, 64] {
        let (block, noise) = traced(View::Pixel, samples, 1);
        let (all, all_bytes) = pack_to(Target::Slope(0.0), &block, &noise, factor);
        let (chosen, bytes) = pack_to(Target::Automatic, &block, &noise, factor);
        let error = |factored: &FactoredBlock| error_of_images(View::Pixel, &factored.expand());
        // A 500th of the noise's energy, seen against what averaging leaves of it.
        let (all, chosen, raw) = (error(&all), error(&chosen), error_of_images(View::Pixel, &block));
        assert!(bytes < all_bytes, "{samples} samples: {bytes} of {all_bytes} bytes");
        assert!(chosen < all + 0.01 * raw, "{samples} samples: {chosen} against {all}, of {raw}");
    }
}

/// Every column the image of its cluster, shared out evenly, and what its samples tell it apart by: error of images of single
/// texels against the truth, without the latter and with it.
fn errors_with_clusters(samples: usize) -> [f64; 2] {
    let shape = MatrixShape::new(SIDE as u32, SIDE as u32, COLUMNS as u32, SIDE as u32).unwrap();
    // As denoising sets it.
    let settings = CompressSettings { rank: 64, noise_factor: Some(2.0), ..Default::default() };
    let compressor = Compressor::new(&panel(), shape, settings).unwrap();
    let clusters = Clusters::of_basis(&panel());
    assert!(clusters.count() < COLUMNS);
    let of = |column: usize| usize::from(clusters.of_column()[column]);
    let members = |cluster: usize| (0..COLUMNS).filter(move |&column| of(column) == cluster);
    let mut map = vec![0.0; clusters.count() * COLUMNS];
    (0..COLUMNS).for_each(|j| map[of(j) * COLUMNS + j] = 1.0 / members(of(j)).count() as f32);
    let image = |cluster: usize, row: usize| members(cluster).map(|j| truth(View::Pixel, row, j)).sum::<f64>();
    let images: Vec<f32> = (0..clusters.count() * ROWS).map(|i| image(i / ROWS, i % ROWS) as f32).collect();
    let mut block = Block::zeros(ROWS, COLUMNS);
    for (i, entry) in block.entries_mut().iter_mut().enumerate() {
        *entry = images[of(i / ROWS) * ROWS + i % ROWS] * map[of(i / ROWS) * COLUMNS + i / ROWS];
    }
    let single = |block: &Block| (0..COLUMNS).map(|j| squared_error(View::Pixel, block, |k| f64::from(k == j))).sum();
    let without = single(&block);
    let (seen, noise) = traced(View::Pixel, samples, 5);
    let contrasts = compressor.contrasts(&compressor.analyse(BlockId(0), seen.view(), Some(&noise)), |_| false);
    let again = ClusterResidual::from_bytes(&contrasts.to_bytes()).unwrap();
    assert_eq!(again, contrasts);
    assert_eq!(ClusterResidual::from_bytes(&contrasts.to_bytes()[1..]), None);
    compressor.spread(images, &again, ClusterMap { clusters: &clusters, shares: &map }, &mut block);
    assert!(block.entries().iter().all(|&v| v >= 0.0));
    for (cluster, row) in (0..clusters.count()).flat_map(|cluster| (0..ROWS).map(move |row| (cluster, row))) {
        let sum: f64 = members(cluster).map(|j| f64::from(block.entries()[j * ROWS + row])).sum();
        let right = image(cluster, row);
        assert!((sum - right).abs() < 1e-4 * right, "cluster {cluster}, row {row}: {sum}, not {right}");
    }
    [without, single(&block)]
}

/// A lamp in view and the slope of the light over the panel: with few samples nothing may come worse of it, with many all must come
/// back.
#[test]
fn what_tells_the_columns_of_a_cluster_apart_comes_back_as_far_as_samples_agree() {
    let [without, with] = errors_with_clusters(4);
    assert!(with < without, "of few samples {with}, not {without}");
    let [without, with] = errors_with_clusters(400);
    assert!(with < 0.02 * without, "of many samples {with}, not {without}");
}
