//! Relighting on the GPU: the same answer as its CPU twin. Without an adapter these tests are listed as ignored, unless
//! `LTM_REQUIRE_GPU=1` demands one.

mod relight_source;

use libtest_mimic::{Arguments, Trial};
use ltm::error::Error;
use ltm::light::Lighting;
use ltm::relight::{CpuRelighter, GpuRelighter, GpuSettings};
use relight_source::{Recipe, largest_difference, random_lighting};

/// Both add the same f32 products in another order: with some thousand columns and a few dozen components of uneven
/// sign, 2⁻²⁴ each, the sum stays within 2⁻¹⁷ of the largest pixel.
const TOLERANCE: f32 = 1.0 / 131_072.0;

fn hard_shapes() -> Vec<(&'static str, Recipe)> {
    vec![
        ("rank 0", Recipe::new((40, 20), 16, 5, &[0])),
        ("no layers", Recipe::new((40, 20), 16, 5, &[])),
        ("rank 1", Recipe::new((40, 20), 16, 5, &[1])),
        ("ragged edges", Recipe::new((37, 53), 16, 70, &[5, 3]).sparse(40)),
        ("one pixel", Recipe::new((1, 1), 32, 9, &[2]).sparse(5)),
        ("one column", Recipe::new((33, 31), 32, 1, &[1]).sparse(9)),
        ("4,096 columns", Recipe::new((32, 16), 16, 4096, &[7]).sparse(500)),
        ("largest rank", Recipe::new((8, 8), 8, 192, &[192])),
        ("sparse only", Recipe::new((20, 20), 8, 33, &[0]).sparse(100)),
        ("largest blocks", Recipe::new((300, 260), 256, 12, &[3])),
    ]
}

fn equals_its_twin_in_every_hard_shape() {
    for (name, recipe) in hard_shapes() {
        for recipe in [recipe.clone(), recipe.narrow()] {
            let source = recipe.make();
            let (cpu, gpu) = (CpuRelighter::load(&source).unwrap(), GpuRelighter::new(&source).unwrap());
            for seed in 0..2 {
                let lighting = random_lighting(recipe.columns as usize, seed);
                let difference = largest_difference(&gpu.relight(&lighting).unwrap(), &cpu.relight(&lighting).unwrap());
                assert!(difference <= TOLERANCE, "{name}, narrow {}: {difference}", recipe.narrow);
            }
        }
    }
}

fn many_small_banks_give_the_same_bits_as_one() {
    let source = Recipe::new((130, 70), 16, 100, &[6]).sparse(30).narrow().make();
    let whole = GpuRelighter::new(&source).unwrap();
    let split = GpuRelighter::with_settings(&source, GpuSettings { binding_bytes: 40_000 }).unwrap();
    assert!(whole.bank_count() == 1 && split.bank_count() > 5, "{}", split.bank_count());
    let lighting = random_lighting(100, 1);
    assert_eq!(whole.relight(&lighting).unwrap(), split.relight(&lighting).unwrap());
}

fn more_components_than_one_row_of_workgroups_holds() {
    // 72,900 components, above the 65,535 workgroups of one dimension.
    let source = Recipe::new((540, 540), 4, 2, &[4]).make();
    let (cpu, gpu) = (CpuRelighter::load(&source).unwrap(), GpuRelighter::new(&source).unwrap());
    assert_eq!(gpu.bank_count(), 1);
    let lighting = random_lighting(2, 1);
    let difference = largest_difference(&gpu.relight(&lighting).unwrap(), &cpu.relight(&lighting).unwrap());
    assert!(difference <= TOLERANCE, "{difference}");
}

fn damage_shows_as_on_the_cpu() {
    let mut source = Recipe::new((48, 16), 16, 10, &[2, 3]).make();
    source.damaged.extend([(0, 1), (2, 0)]);
    let (cpu, gpu) = (CpuRelighter::load(&source).unwrap(), GpuRelighter::new(&source).unwrap());
    assert_eq!(gpu.damage(), cpu.damage());
    let lighting = random_lighting(10, 1);
    let difference = largest_difference(&gpu.relight(&lighting).unwrap(), &cpu.relight(&lighting).unwrap());
    assert!(difference <= TOLERANCE, "{difference}");
}

fn what_does_not_fit_is_refused() {
    let source = Recipe::new((20, 20), 16, 10, &[4]).make();
    let gpu = GpuRelighter::new(&source).unwrap();
    assert!(gpu.relight(&Lighting::uniform(9, [1.0; 3]).unwrap()).is_err());
    let refused = GpuRelighter::with_settings(&source, GpuSettings { binding_bytes: 1000 }).err().unwrap();
    assert!(matches!(refused, Error::Resources { .. }), "{refused}");
}

fn main() {
    let arguments = Arguments::from_args();
    let missing = match GpuRelighter::new(&Recipe::new((1, 1), 1, 1, &[1]).make()) {
        Ok(relighter) => {
            eprintln!("adapter: {}", relighter.adapter());
            None
        }
        Err(error) => {
            eprintln!("{error}");
            Some(error)
        }
    };
    let required = std::env::var("LTM_REQUIRE_GPU").is_ok_and(|value| value == "1");
    let tests: [(&str, fn()); 5] = [
        ("equals_its_twin_in_every_hard_shape", equals_its_twin_in_every_hard_shape),
        ("many_small_banks_give_the_same_bits_as_one", many_small_banks_give_the_same_bits_as_one),
        ("more_components_than_one_row_of_workgroups_holds", more_components_than_one_row_of_workgroups_holds),
        ("damage_shows_as_on_the_cpu", damage_shows_as_on_the_cpu),
        ("what_does_not_fit_is_refused", what_does_not_fit_is_refused),
    ];
    let trials = tests.into_iter().map(|(name, test)| {
        let ignored = missing.is_some() && !required;
        Trial::test(name, move || {
            test();
            Ok(())
        })
        .with_ignored_flag(ignored)
    });
    libtest_mimic::run(&arguments, trials.collect()).exit();
}
