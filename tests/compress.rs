//! What compression promises, on made-up blocks that look like light transport.

use ltm::compress::{Candidate, CompressSettings, Compressor, Method, Ranks, Target};
use ltm::light::{Light, LightBasis, LightKind};
use ltm::matrix::{Block, BlockId, MatrixShape};

/// A panel of `side × side` texels.
fn panel(side: u32) -> LightBasis {
    let mut basis = LightBasis::new();
    basis.push(Light::unplaced("panel", LightKind::AreaTexels { across: side, down: side })).unwrap();
    basis
}

/// A floor below the panel: form factors of each texel at each pixel, a shadow edge, and a little noise of fixed hash.
fn floor(shape: MatrixShape, id: BlockId, side: u32, noise: f32) -> Block {
    let rect = shape.rect(id);
    let mut block = Block::zeros(rect.rows(), shape.columns());
    let rows = rect.rows();
    let entries = block.entries_mut();
    for column in 0..shape.columns() {
        let (u, v) = ((column as u32 % side) as f32 / side as f32, (column as u32 / side) as f32 / side as f32);
        for p in 0..rect.pixels() {
            let x = (rect.x + p as u32 % rect.width) as f32 / shape.width() as f32;
            let y = (rect.y + p as u32 / rect.width) as f32 / shape.height() as f32;
            let d2 = (x - u).powi(2) + (y - v).powi(2) + 0.25;
            let lit = if x + 0.5 * u > 0.8 { 0.2 } else { 1.0 };
            for channel in 0..3 {
                let row = channel * rect.pixels() + p;
                let hash = (row as u32).wrapping_mul(2654435761).wrapping_add(column as u32 * 40503 + id.0 * 97) >> 8;
                let jitter = 1.0 + noise * ((hash.wrapping_mul(747796405) >> 16) as f32 / 65536.0 - 0.5);
                let albedo = [0.7, 0.5, 0.3][channel];
                entries[column * rows + row] = albedo * lit / (d2 * d2) / shape.columns() as f32 * jitter;
            }
        }
    }
    block
}

fn relative_error(a: &Block, b: &Block) -> f64 {
    let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
        a.entries().iter().zip(b.entries()).map(|(&x, &y)| f(f64::from(x), f64::from(y))).sum()
    };
    (sum(&|x, y| (x - y).powi(2)) / sum(&|x, _| x * x)).sqrt()
}

#[test]
fn every_method_gives_consistent_factors_of_a_smooth_block() {
    let (basis, shape) = (panel(16), MatrixShape::new(32, 32, 256, 16).unwrap());
    let block = floor(shape, BlockId(0), 16, 0.0);
    let error_of = |method, rank| {
        let settings = CompressSettings { method, rank, target: Target::Slope(0.0), ..Default::default() };
        let compressor = Compressor::new(&basis, shape, settings).unwrap();
        let candidate = compressor.analyse(BlockId(0), block.view(), None);
        let cut = compressor.choose([candidate.summary()].into_iter());
        let factored = candidate.cut(&cut);
        assert!(factored.is_consistent(), "{method}");
        relative_error(&block, &factored.expand())
    };
    let best = error_of(Method::BlockSvd, 24);
    let one = error_of(Method::BlockSvd, 1);
    for method in Method::ALL {
        let error = error_of(method, 24);
        assert!(error > 0.99 * best, "{method} beats the best possible: {error} against {best}");
        // The paper's choices come without a bound on their error, and a shadow edge that moves with the light is hard for
        // them: 24 columns must at least beat the best single component by half. Ours is nearly the best for all lightings,
        // not for the matrix, and so may lose some of the latter; PCA spends one component on the mean.
        let bound = match method {
            Method::Auto | Method::BlockSvd | Method::BlockPca => 2.0 * best,
            _ => 0.5 * one,
        };
        assert!(error < bound, "{method}: {error} against {bound} (best {best}, one component {one})");
    }
}

#[test]
fn a_block_svd_may_go_by_rate() {
    let (basis, shape) = (panel(16), MatrixShape::new(64, 48, 256, 16).unwrap());
    let kept = |target| {
        let svd = CompressSettings::of_method(Method::BlockSvd);
        let compressor =
            Compressor::new(&basis, shape, CompressSettings { ranks: Ranks::ByRate, target, ..svd }).unwrap();
        let candidates: Vec<Candidate> =
            shape.blocks().map(|id| compressor.analyse(id, floor(shape, id, 16, 0.05).view(), None)).collect();
        let cut = compressor.choose(candidates.iter().map(Candidate::summary));
        let blocks: Vec<_> = candidates.iter().map(|candidate| candidate.cut(&cut)).collect();
        assert!(blocks.iter().all(|block| block.is_consistent() && block.left_step.len() == block.rank()));
        blocks.iter().map(|block| block.rank()).collect::<Vec<_>>()
    };
    let (coarse, fine) = (kept(Target::PsnrDb(25.0)), kept(Target::PsnrDb(45.0)));
    assert!(coarse.iter().sum::<usize>() < fine.iter().sum(), "{coarse:?} {fine:?}");
    // Each block has a rank of its own, below the 32 that a fixed rank would keep.
    assert!(fine.iter().any(|rank| rank != &fine[0]) && coarse.iter().all(|&rank| rank < 32), "{coarse:?} {fine:?}");
}

#[test]
fn a_candidate_survives_its_bytes_and_every_truncation_is_an_error() {
    let (basis, shape) = (panel(8), MatrixShape::new(16, 16, 64, 8).unwrap());
    let mut block = floor(shape, BlockId(1), 8, 0.1);
    block.entries_mut()[777] = 100.0;
    block.entries_mut()[778] = f32::NAN;
    let compressor = Compressor::new(&basis, shape, CompressSettings::default()).unwrap();
    let candidate = compressor.analyse(BlockId(1), block.view(), None);
    let bytes = candidate.to_bytes();
    assert_eq!(Candidate::from_bytes(&bytes).unwrap(), candidate);
    for length in 0..bytes.len() {
        assert!(Candidate::from_bytes(&bytes[..length]).is_err(), "{length}");
    }
    assert!(Candidate::from_bytes(&[bytes, vec![0]].concat()).is_err());
}

#[test]
fn a_higher_target_costs_more_and_is_expected_to_be_reached() {
    let (basis, shape) = (panel(16), MatrixShape::new(64, 48, 256, 16).unwrap());
    let mut last = 0;
    for target in [20.0, 30.0, 40.0, 50.0] {
        let settings = CompressSettings { target: Target::PsnrDb(target), ..Default::default() };
        let compressor = Compressor::new(&basis, shape, settings).unwrap();
        let candidates: Vec<Candidate> =
            shape.blocks().map(|id| compressor.analyse(id, floor(shape, id, 16, 0.2).view(), None)).collect();
        let cut = compressor.choose(candidates.iter().map(Candidate::summary));
        assert!(cut.expected_bytes > last, "{target} dB: {cut:?}");
        assert!(cut.expected_psnr_db >= target - 0.1, "{target} dB: {cut:?}");
        last = cut.expected_bytes;
    }
}
