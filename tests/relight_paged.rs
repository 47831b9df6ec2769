//! Relighting what is larger than memory: the same bits as from memory, within the budget, and nothing read twice that
//! need not be.

mod relight_source;

use ltm::image::LinearImage;
use ltm::matrix::{BlockId, FactorSource};
use ltm::relight::{CpuRelighter, Detail, PagedRelighter, Reads};
use relight_source::{MemoryFactors, Recipe, hard_shapes, random_lighting};

fn source() -> MemoryFactors {
    Recipe::new((100, 80), 16, 50, &[2, 4]).sparse(40).narrow().make()
}

/// Reads of (block, layer) in the order of blocks, counted by the source itself.
fn log(source: &MemoryFactors) -> Vec<(u32, u32)> {
    let mut log = source.log.lock().unwrap().clone();
    log.sort_unstable();
    log
}

fn every_chunk(source: &MemoryFactors) -> Vec<(u32, u32)> {
    source.shape.blocks().flat_map(|id| (0..source.layer_count(id)).map(move |layer| (id.0, layer))).collect()
}

/// Bytes that all blocks take in memory.
fn all_bytes(source: &MemoryFactors) -> u64 {
    let paged = PagedRelighter::new(source, u64::MAX);
    paged.relight(&random_lighting(source.shape.columns(), 1)).unwrap();
    source.log.lock().unwrap().clear();
    paged.resident_bytes()
}

#[test]
fn it_gives_the_same_bits_as_from_memory_in_every_hard_shape_at_any_budget() {
    for (name, recipe) in hard_shapes() {
        let source = recipe.narrow().make();
        let lighting = random_lighting(source.shape.columns(), 1);
        let expected = CpuRelighter::load(&source).unwrap().relight(&lighting).unwrap();
        let all = all_bytes(&source);
        for budget in [0, all / 10, all, u64::MAX] {
            let paged = PagedRelighter::new(&source, budget);
            for _ in 0..2 {
                assert_eq!(paged.relight(&lighting).unwrap(), expected, "{name}, budget {budget} of {all}");
                assert!(paged.resident_bytes() <= budget, "{name}");
            }
        }
    }
}

#[test]
fn with_room_for_all_each_chunk_is_read_once_whatever_is_asked_in_whatever_order() {
    let source = source();
    let all: Vec<BlockId> = source.shape.blocks().collect();
    let paged = PagedRelighter::new(&source, all_bytes(&source));
    let mut image = LinearImage::black(100, 80);
    for (seed, detail) in [(1, Detail::Base), (2, Detail::Base), (3, Detail::Whole), (4, Detail::Base)] {
        let lighting = random_lighting(50, seed);
        paged.relight_view(&lighting, &all, detail, &mut image).unwrap();
        let expected: Vec<_> = every_chunk(&source).into_iter().filter(|(_, layer)| seed > 2 || *layer == 0).collect();
        assert_eq!(log(&source), expected, "after picture {seed}");
    }
    let bytes = source.total_bytes();
    assert_eq!(paged.reads(), Reads { chunks: every_chunk(&source).len() as u64, bytes });
}

#[test]
fn with_a_tenth_of_the_room_a_tenth_is_not_read_again() {
    let source = source();
    let all = all_bytes(&source);
    let lighting = random_lighting(50, 1);
    let paged = PagedRelighter::new(&source, all / 10);
    paged.relight(&lighting).unwrap();
    let first = paged.reads();
    assert_eq!(log(&source), every_chunk(&source), "the first picture reads each chunk once");
    let kept = paged.resident_bytes();
    // Blocks differ in size by their sparse entries only: room for one more is the most that stays free.
    assert!(kept * 100 >= all / 10 * 80, "{kept} of {}", all / 10);
    paged.relight(&lighting).unwrap();
    let second = paged.reads().chunks - first.chunks;
    let saved = 1.0 - second as f64 / first.chunks as f64;
    assert!((0.05..=0.11).contains(&saved), "{saved}");
}

#[test]
fn a_view_reads_its_own_blocks_and_what_is_near_is_there_before_it_is_seen() {
    let source = source();
    let all = all_bytes(&source);
    let paged = PagedRelighter::new(&source, all / 2);
    let (view, nearby): (Vec<_>, Vec<_>) = ((0..7).map(BlockId).collect(), (7..14).map(BlockId).collect());
    let lighting = random_lighting(50, 1);
    let mut image = LinearImage::black(100, 80);
    paged.relight_view(&lighting, &view, Detail::Whole, &mut image).unwrap();
    assert!(log(&source).iter().all(|(block, _)| *block < 7));
    paged.prefetch(&view, &nearby).unwrap();
    let before = paged.reads();
    paged.relight_view(&lighting, &nearby, Detail::Whole, &mut image).unwrap();
    assert_eq!(paged.reads(), before, "nothing is left to read");
    let whole = CpuRelighter::load(&source).unwrap().relight(&lighting).unwrap();
    for (i, (pixel, expected)) in image.pixels.iter().zip(&whole.pixels).enumerate() {
        let seen = i / 100 / 16 < 2;
        assert_eq!(*pixel, if seen { *expected } else { [0.0; 3] }, "pixel {i}");
    }
}

#[test]
fn base_layers_give_a_whole_picture_first() {
    let whole = source();
    let mut base = source();
    base.layers.iter_mut().for_each(|layers| layers.truncate(1));
    let lighting = random_lighting(50, 1);
    let expected = CpuRelighter::load(&base).unwrap().relight(&lighting).unwrap();
    let paged = PagedRelighter::new(&whole, u64::MAX);
    let all: Vec<BlockId> = whole.shape.blocks().collect();
    let mut image = LinearImage::black(100, 80);
    paged.relight_view(&lighting, &all, Detail::Base, &mut image).unwrap();
    assert_eq!(image, expected);
}

#[test]
fn a_damaged_block_shows_what_stands_of_it_and_is_reported_once() {
    let mut source = source();
    source.damaged.extend([(0, 1), (2, 0)]);
    let lighting = random_lighting(50, 1);
    let cpu = CpuRelighter::load(&source).unwrap();
    for budget in [0, u64::MAX] {
        let paged = PagedRelighter::new(&source, budget);
        for _ in 0..2 {
            assert_eq!(paged.relight(&lighting).unwrap(), cpu.relight(&lighting).unwrap());
            assert_eq!(paged.damage(), cpu.damage());
        }
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let source = source();
    let paged = PagedRelighter::new(&source, 1000);
    assert!(paged.relight(&random_lighting(49, 1)).is_err());
    let mut small = LinearImage::black(10, 10);
    assert!(paged.relight_view(&random_lighting(50, 1), &[BlockId(0)], Detail::Whole, &mut small).is_err());
}
