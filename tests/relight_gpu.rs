//! Relighting on the GPU: the same answer as its CPU twin. Without an adapter these tests are listed as ignored, unless
//! `LTM_REQUIRE_GPU=1` demands one.

mod relight_source;

use libtest_mimic::{Arguments, Trial};
use ltm::error::Error;
use ltm::image::{ToneCurve, ToneMapping};
use ltm::light::Lighting;
use ltm::relight::{CpuRelighter, GpuRelighter, GpuSettings, PagedGpuRelighter, PagedRelighter};
use relight_source::{Recipe, hard_shapes, largest_difference, random_lighting};

/// Both add the same f32 products in another order: with some thousand columns and a few dozen components of uneven
/// sign, 2⁻²⁴ each, the sum stays within 2⁻¹⁷ of the largest pixel.
const TOLERANCE: f32 = 1.0 / 131_072.0;

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
    let split =
        GpuRelighter::with_settings(&source, GpuSettings { binding_bytes: 40_000, ..Default::default() }).unwrap();
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
    let refused =
        GpuRelighter::with_settings(&source, GpuSettings { binding_bytes: 1000, ..Default::default() }).err().unwrap();
    assert!(matches!(refused, Error::Resources { .. }), "{refused}");
}

fn with_and_without_subgroups_it_is_the_same() {
    for (name, recipe) in hard_shapes() {
        let source = recipe.narrow().make();
        let plain = GpuSettings { subgroups: false, ..Default::default() };
        let plain = GpuRelighter::with_settings(&source, plain).unwrap();
        let offered = GpuRelighter::new(&source).unwrap();
        assert!(!plain.uses_subgroups());
        let lighting = random_lighting(source.shape.columns(), 1);
        let difference = largest_difference(&offered.relight(&lighting).unwrap(), &plain.relight(&lighting).unwrap());
        assert!(difference <= TOLERANCE, "{name}: {difference}, subgroups {}", offered.uses_subgroups());
    }
}

fn the_shown_image_is_the_twins_to_one_step_of_256() {
    let source = Recipe::new((70, 50), 16, 20, &[3]).sparse(10).make();
    let gpu = GpuRelighter::new(&source).unwrap();
    let lighting = random_lighting(20, 1);
    let image = gpu.relight(&lighting).unwrap();
    for curve in [ToneCurve::None, ToneCurve::Agx, ToneCurve::Filmic, ToneCurve::Neutral] {
        for exposure_stops in [-6.0, -1.0, 2.0] {
            for white_kelvin in [None, Some(3200.0)] {
                let tone = ToneMapping { curve, exposure_stops, white_kelvin };
                let shown = gpu.relight_shown(&lighting, tone).unwrap();
                for (i, (gpu, cpu)) in shown.iter().zip(tone.bytes(&image)).enumerate() {
                    // The device's powers and logarithms differ from ours by some units of the last place, which can
                    // move a value over the edge between two steps.
                    let near = gpu.iter().zip(cpu).all(|(gpu, cpu)| gpu.abs_diff(cpu) <= 1);
                    assert!(near && gpu[3] == 255, "{tone:?}, pixel {i}: {gpu:?} for {cpu:?}");
                }
            }
        }
    }
}

fn what_is_larger_than_its_memory_passes_through() {
    let source = Recipe::new((260, 140), 16, 100, &[3, 3]).sparse(30).narrow().make();
    let lighting = random_lighting(100, 1);
    let whole = GpuRelighter::new(&source).unwrap();
    let expected = whole.relight(&lighting).unwrap();
    for share in [1, 3, 10] {
        let budget = whole.resident_bytes() / share;
        let host = PagedRelighter::new(&source, u64::MAX);
        let paged = PagedGpuRelighter::new(host, budget, GpuSettings::default()).unwrap();
        for _ in 0..3 {
            assert_eq!(paged.relight(&lighting).unwrap(), expected, "a {share}th of the memory");
        }
        assert!(paged.peak_bytes() <= budget, "{} of {budget}", paged.peak_bytes());
        let chunks = source.shape.blocks().count() as u64 * 2;
        assert_eq!(paged.host().reads().chunks, chunks, "host memory holds all: each chunk is read once");
    }
    let host = PagedRelighter::new(&source, 0);
    let refused = PagedGpuRelighter::new(host, 20_000, GpuSettings::default()).unwrap().relight(&lighting).err();
    assert!(matches!(refused, Some(Error::Resources { .. })), "{refused:?}");
}

fn banks_that_fit_are_uploaded_once() {
    let source = Recipe::new((130, 70), 16, 100, &[3]).make();
    let host = PagedRelighter::new(&source, 0);
    let budget = GpuRelighter::new(&source).unwrap().resident_bytes() * 2;
    let paged = PagedGpuRelighter::new(host, budget, GpuSettings::default()).unwrap();
    paged.relight(&random_lighting(100, 1)).unwrap();
    let (uploads, reads) = (paged.uploads(), paged.host().reads());
    paged.relight(&random_lighting(100, 2)).unwrap();
    assert_eq!((paged.uploads(), paged.host().reads()), (uploads, reads));
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
    let tests: [(&str, fn()); 9] = [
        ("equals_its_twin_in_every_hard_shape", equals_its_twin_in_every_hard_shape),
        ("many_small_banks_give_the_same_bits_as_one", many_small_banks_give_the_same_bits_as_one),
        ("more_components_than_one_row_of_workgroups_holds", more_components_than_one_row_of_workgroups_holds),
        ("damage_shows_as_on_the_cpu", damage_shows_as_on_the_cpu),
        ("with_and_without_subgroups_it_is_the_same", with_and_without_subgroups_it_is_the_same),
        ("the_shown_image_is_the_twins_to_one_step_of_256", the_shown_image_is_the_twins_to_one_step_of_256),
        ("what_is_larger_than_its_memory_passes_through", what_is_larger_than_its_memory_passes_through),
        ("banks_that_fit_are_uploaded_once", banks_that_fit_are_uploaded_once),
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
