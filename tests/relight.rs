//! Relighting on the CPU: the same answer as the direct product, in every hard shape.

mod relight_source;

use ltm::error::Error;
use ltm::light::Lighting;
use ltm::matrix::{ColumnIndex, FactorSource};
use ltm::relight::{CpuRelighter, relight_raw, relight_streaming};
use relight_source::{MemoryFactors, Recipe, hard_shapes, largest_difference, random_lighting};

/// 16-bit floats round each value of each factor by 2⁻¹² of itself at most, which over two factors and a few dozen
/// components of random sign stays well below 2⁻¹⁰ of the largest pixel.
const WIDE_TOLERANCE: f32 = 1.0 / 1024.0;

/// 8 bits round each value by half a step at most, and the sources of these tests have steps of a hundredth of the
/// largest value, half of the components being multiples of them, which lose nothing. Sums over columns average it.
const NARROW_TOLERANCE: f32 = 1.0 / 50.0;

fn direct(source: &MemoryFactors, lighting: &Lighting) -> ltm::image::LinearImage {
    relight_raw(source, std::slice::from_ref(lighting)).unwrap().remove(0)
}

#[test]
fn relighting_equals_the_direct_product_in_every_hard_shape() {
    for (name, recipe) in hard_shapes() {
        for (recipe, tolerance) in [(recipe.clone(), WIDE_TOLERANCE), (recipe.narrow(), NARROW_TOLERANCE)] {
            let source = recipe.make();
            let relighter = CpuRelighter::load(&source).unwrap();
            for seed in 0..2 {
                let lighting = random_lighting(recipe.columns as usize, seed);
                let reference = direct(&source, &lighting);
                let relit = relighter.relight(&lighting).unwrap();
                let difference = largest_difference(&relit, &reference);
                assert!(difference <= tolerance, "{name}, narrow {}: {difference}", recipe.narrow);
                let (streamed, damage) = relight_streaming(&source, &lighting).unwrap();
                assert_eq!(streamed, relit, "{name}: streaming gives the same bits");
                assert!(damage.is_empty());
            }
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let source = Recipe::new((70, 50), 16, 100, &[6]).sparse(30).narrow().make();
    let relighter = CpuRelighter::load(&source).unwrap();
    let lighting = random_lighting(100, 3);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| relighter.relight(&lighting).unwrap())
    };
    assert_eq!(with(1), with(5));
}

#[test]
fn changing_lights_one_by_one_arrives_at_the_same_image() {
    let source = Recipe::new((50, 40), 16, 60, &[8]).sparse(50).narrow().make();
    let relighter = CpuRelighter::load(&source).unwrap();
    let (from, to) = (random_lighting(60, 1), random_lighting(60, 2));
    let mut kept = relighter.relight_kept(&from).unwrap();
    assert_eq!(kept.image, relighter.relight(&from).unwrap());
    for (column, weight) in to.weights().iter().enumerate() {
        relighter.change(&mut kept, &[(ColumnIndex(column as u32), *weight)]).unwrap();
    }
    // Both sum the same numbers, in another order: 60 columns and 8 components of f32 rounding.
    let difference = largest_difference(&kept.image, &relighter.relight(&to).unwrap());
    assert!(difference < 1e-5, "{difference}");
}

#[test]
fn a_thousand_changes_leave_no_trace() {
    let source = Recipe::new((20, 20), 16, 10, &[4]).sparse(20).make();
    let relighter = CpuRelighter::load(&source).unwrap();
    let lighting = random_lighting(10, 1);
    let mut kept = relighter.relight_kept(&lighting).unwrap();
    let before = kept.image.clone();
    let column = ColumnIndex(4);
    for i in 0..1000 {
        relighter.change(&mut kept, &[(column, [1e4 * i as f32, 0.1, 3.0])]).unwrap();
    }
    relighter.change(&mut kept, &[(column, lighting.weights()[4])]).unwrap();
    // Kept sums are f64: 1,000 changes of up to 1e7 leave less than 1e-6 behind.
    let difference = largest_difference(&kept.image, &before);
    assert!(difference < 1e-5, "{difference}");
}

#[test]
fn lightings_that_cannot_be_used_are_refused() {
    let source = Recipe::new((20, 20), 16, 10, &[4]).make();
    let relighter = CpuRelighter::load(&source).unwrap();
    assert!(Lighting::new(vec![[f32::NAN, 0.0, 0.0]; 10]).is_err());
    for columns in [0, 9, 11] {
        let lighting = Lighting::uniform(columns, [1.0; 3]).unwrap();
        assert!(relighter.relight(&lighting).is_err());
        assert!(relighter.relight_kept(&lighting).is_err());
        assert!(relight_streaming(&source, &lighting).is_err());
        assert!(relight_raw(&source, &[lighting]).is_err());
    }
    let mut kept = relighter.relight_kept(&random_lighting(10, 1)).unwrap();
    let before = kept.image.clone();
    assert!(relighter.change(&mut kept, &[(ColumnIndex(10), [1.0; 3])]).is_err());
    assert!(relighter.change(&mut kept, &[(ColumnIndex(0), [f32::INFINITY; 3])]).is_err());
    assert_eq!(kept.image, before);
}

#[test]
fn a_damaged_block_shows_its_base_layer_or_a_marked_hole_and_says_so() {
    let mut source = Recipe::new((48, 16), 16, 10, &[2, 3]).make();
    source.damaged.extend([(0, 1), (2, 0)]);
    let relighter = CpuRelighter::load(&source).unwrap();
    assert_eq!(relighter.damage().len(), 2);
    assert!(relighter.damage()[0].contains("block 0") && relighter.damage()[1].contains("block 2"));
    let lighting = random_lighting(10, 1);
    let relit = relighter.relight(&lighting).unwrap();
    let whole = Recipe::new((48, 16), 16, 10, &[2, 3]).make();
    let mut base = Recipe::new((48, 16), 16, 10, &[2, 3]).make();
    base.layers.iter_mut().for_each(|layers| layers.truncate(1));
    let (whole, base) = (direct(&whole, &lighting), direct(&base, &lighting));
    for (i, pixel) in relit.pixels.iter().enumerate() {
        let expected = match i % 48 / 16 {
            0 => base.pixels[i],
            1 => whole.pixels[i],
            _ => {
                assert!(*pixel == [1.0, 0.0, 1.0] || *pixel == [0.0; 3]);
                continue;
            }
        };
        for (a, b) in pixel.iter().zip(expected) {
            assert!((a - b).abs() < 1e-2 * (1.0 + b.abs()), "pixel {i}: {a} for {b}");
        }
    }
    assert_eq!(relight_streaming(&source, &lighting).unwrap(), (relit, relighter.damage().to_vec()));
}

#[test]
fn factors_that_do_not_fit_are_refused_by_name() {
    let mut source = Recipe::new((48, 16), 16, 10, &[2]).make();
    source.layers[1][0].left[3] = f32::NAN;
    let refused = CpuRelighter::load(&source).err().unwrap();
    assert!(matches!(&refused, Error::Input { place, .. } if place == "block 1"), "{refused}");
}

#[test]
fn loading_reads_each_layer_once() {
    let source = Recipe::new((48, 48), 16, 10, &[2, 1]).make();
    CpuRelighter::load(&source).unwrap();
    let mut log = source.log.lock().unwrap().clone();
    log.sort_unstable();
    let expected: Vec<_> = (0..9).flat_map(|block| [(block, 0), (block, 1)]).collect();
    assert_eq!(log, expected);
    assert_eq!(FactorSource::shape(&source).block_count(), 9);
}
