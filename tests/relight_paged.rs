//! Relighting what is larger than memory: the same bits as from memory, within the budget, and nothing read twice that
//! need not be.

mod relight_source;

use ltm::error::Error;
use ltm::image::LinearImage;
use ltm::matrix::BlockId;
use ltm::relight::{CpuRelighter, Detail, PagedRelighter, Reads};
use relight_source::{MemoryFactors, Recipe, hard_shapes, random_lighting};

fn source() -> MemoryFactors {
    Recipe::new((100, 80), 16, 50, &[2, 4]).sparse(40).narrow().make()
}

fn every_chunk(source: &MemoryFactors) -> Vec<(u32, u32)> {
    source.chunks(0..source.shape.block_count(), 0..2)
}

/// Bytes that all chunks take in memory, and all blocks.
fn all_bytes(source: &MemoryFactors) -> (u64, u64) {
    let paged = PagedRelighter::new(source, u64::MAX);
    paged.relight(&random_lighting(source.shape.columns(), 1)).unwrap();
    source.take_log();
    // Each chunk is kept with its places in three maps, of 64 bytes at most each.
    let chunks = source.total_bytes() + 192 * paged.reads().chunks;
    (chunks, paged.resident_bytes() - chunks)
}

#[test]
fn it_gives_the_same_bits_as_from_memory_in_every_hard_shape_at_any_budget() {
    for (name, recipe) in hard_shapes() {
        let source = recipe.narrow().make();
        let lighting = random_lighting(source.shape.columns(), 1);
        let expected = CpuRelighter::load(&source).unwrap().relight(&lighting).unwrap();
        let (chunks, blocks) = all_bytes(&source);
        let all = chunks + blocks;
        for budget in [0, chunks / 10, chunks, chunks + blocks / 10, all, u64::MAX] {
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
    let (chunks, blocks) = all_bytes(&source);
    let paged = PagedRelighter::new(&source, chunks + blocks);
    let mut image = LinearImage::black(100, 80);
    let mut read = Vec::new();
    for (seed, detail) in [(1, Detail::Base), (2, Detail::Base), (3, Detail::Whole), (4, Detail::Base)] {
        let lighting = random_lighting(50, seed);
        paged.relight_view(&lighting, &all, detail, &mut image).unwrap();
        read.extend(source.take_log());
        read.sort_unstable();
        let expected: Vec<_> = every_chunk(&source).into_iter().filter(|(_, layer)| seed > 2 || *layer == 0).collect();
        assert_eq!(read, expected, "after picture {seed}");
    }
    // Base layers were decoded alone first, then with the rest.
    let (chunks, decodes) = (every_chunk(&source).len() as u64, 2 * all.len() as u64);
    assert_eq!(paged.reads(), Reads { chunks, bytes: source.total_bytes(), decodes });
}

#[test]
fn with_room_for_the_chunks_none_is_read_twice_and_what_is_left_saves_decoding() {
    let source = source();
    let (chunks, blocks) = all_bytes(&source);
    let lighting = random_lighting(50, 1);
    for (share, saved) in [(0.0, 0.0..=0.0), (0.5, 0.42..=0.5), (1.0, 1.0..=1.0)] {
        let paged = PagedRelighter::new(&source, chunks + (share * blocks as f64) as u64);
        paged.relight(&lighting).unwrap();
        assert_eq!(source.take_log(), every_chunk(&source));
        let first = paged.reads();
        paged.relight(&lighting).unwrap();
        let again = paged.reads();
        assert_eq!((again.chunks, again.bytes), (first.chunks, first.bytes), "{share} of the blocks");
        let not_decoded = 1.0 - (again.decodes - first.decodes) as f64 / first.decodes as f64;
        // Blocks differ in size by their sparse entries only: room for two more is the most that stays free.
        assert!(saved.contains(&not_decoded), "{share} of the blocks: {not_decoded}");
    }
}

#[test]
fn with_a_tenth_of_the_room_a_tenth_is_not_read_again() {
    let source = source();
    let (chunks, _) = all_bytes(&source);
    let lighting = random_lighting(50, 1);
    let paged = PagedRelighter::new(&source, chunks / 10);
    paged.relight(&lighting).unwrap();
    let first = paged.reads();
    assert_eq!(source.take_log(), every_chunk(&source), "the first picture reads each chunk once");
    let kept = paged.resident_bytes();
    // Room for one more chunk is the most that stays free: less than a fifth of a tenth of 70 chunks.
    assert!(kept * 100 >= chunks / 10 * 80, "{kept} of {}", chunks / 10);
    paged.relight(&lighting).unwrap();
    let second = paged.reads().bytes - first.bytes;
    let saved = 1.0 - second as f64 / first.bytes as f64;
    assert!((0.07..=0.1).contains(&saved), "{saved}");
}

#[test]
fn a_view_reads_its_own_blocks_and_what_is_near_is_there_before_it_is_seen() {
    let source = source();
    let (chunks, blocks) = all_bytes(&source);
    let paged = PagedRelighter::new(&source, chunks + blocks / 2);
    let (view, nearby): (Vec<_>, Vec<_>) = ((0..7).map(BlockId).collect(), (7..14).map(BlockId).collect());
    let lighting = random_lighting(50, 1);
    let mut image = LinearImage::black(100, 80);
    paged.relight_view(&lighting, &view, Detail::Whole, &mut image).unwrap();
    assert_eq!(source.take_log(), source.chunks(0..7, 0..2));
    paged.prefetch(&view, &nearby).unwrap();
    assert_eq!(source.take_log(), source.chunks(7..14, 0..2));
    let before = paged.reads();
    paged.relight_view(&lighting, &nearby, Detail::Whole, &mut image).unwrap();
    assert_eq!(paged.reads(), before, "nothing is left to read or to decode");
    let whole = CpuRelighter::load(&source).unwrap().relight(&lighting).unwrap();
    for (i, (pixel, expected)) in image.pixels.iter().zip(&whole.pixels).enumerate() {
        let seen = i / 100 / 16 < 2;
        assert_eq!(*pixel, if seen { *expected } else { [0.0; 3] }, "pixel {i}");
    }
}

#[test]
fn what_is_near_and_does_not_fit_is_read_and_not_decoded_and_leaves_the_view_alone() {
    let source = source();
    let (chunks, blocks) = all_bytes(&source);
    let paged = PagedRelighter::new(&source, chunks + blocks / 4);
    let (view, nearby): (Vec<_>, Vec<_>) = ((0..5).map(BlockId).collect(), (5..35).map(BlockId).collect());
    paged.prefetch(&view, &nearby).unwrap();
    assert_eq!(source.take_log(), every_chunk(&source));
    // A quarter of 35 blocks with both layers; their base layers alone before, and those of the step that fits no more.
    let room = paged.reads().decodes;
    assert!((10..=60).contains(&room), "{room}");
    let lighting = random_lighting(50, 1);
    let mut image = LinearImage::black(100, 80);
    let before = paged.reads();
    paged.relight_view(&lighting, &view, Detail::Whole, &mut image).unwrap();
    assert_eq!(paged.reads(), before, "the view was decoded first, and stayed");
}

#[test]
fn base_layers_give_a_whole_picture_first() {
    let whole = source();
    let base = whole.first_layers(1);
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
fn factors_that_are_not_finite_are_refused_by_name() {
    let mut source = source();
    source.layers[3][1].right[5] = f32::INFINITY;
    let refused = PagedRelighter::new(&source, 0).relight(&random_lighting(50, 1)).err().unwrap();
    assert!(matches!(&refused, Error::Input { place, .. } if place == "block 3"), "{refused}");
}

#[test]
fn what_does_not_fit_is_refused() {
    let source = source();
    let paged = PagedRelighter::new(&source, 1000);
    assert!(paged.relight(&random_lighting(49, 1)).is_err());
    let mut small = LinearImage::black(10, 10);
    assert!(paged.relight_view(&random_lighting(50, 1), &[BlockId(0)], Detail::Whole, &mut small).is_err());
}
