//! Relighting on the GPU: the same answer as its CPU twin. Without an adapter these tests are listed as ignored, unless
//! `LTM_REQUIRE_GPU=1` demands one.

mod relight_source;
#[path = "relight_source/texels.rs"]
mod texels;

use libtest_mimic::{Arguments, Trial};
use ltm::error::Error;
use ltm::image::{LinearImage, ToneCurve, ToneMapping, false_colour};
use ltm::light::Lighting;
use ltm::matrix::BlockId;
use ltm::relight::{
    CpuRelighter, Detail, GpuRelighter, GpuScreen, GpuSettings, PagedGpuRelighter, PagedRelighter, ShownAs,
};
use relight_source::{MemoryFactors, Recipe, hard_shapes, largest_difference, random_lighting};
use texels::texels;

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
    // 273,375 components, four in a workgroup: above the 65,535 workgroups of one dimension.
    let source = Recipe::new((540, 540), 4, 2, &[15]).make();
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

fn the_screen_shows_what_the_twin_does_to_one_step_of_256() {
    // Ragged edges, several banks, and a hole.
    let mut source = Recipe::new((70, 50), 16, 20, &[3]).sparse(10).make();
    source.damaged.insert((4, 0));
    let (device, queue) = device_of_ones_own();
    let settings = GpuSettings { binding_bytes: 12_000, ..Default::default() };
    let gpu = GpuRelighter::on_device(device.clone(), queue.clone(), &source, settings).unwrap();
    assert!(gpu.bank_count() > 2, "{}", gpu.bank_count());
    let screen = GpuScreen::new(gpu).unwrap();
    let holes = ToneMapping::default().bytes(&screen.relighter().radiance().unwrap());
    let near = |shown_as: ShownAs, twin: Vec<[u8; 3]>| {
        let shown = texels(&device, &queue, screen.texture());
        for (i, (gpu, mut cpu)) in shown.iter().zip(twin).enumerate() {
            // A hole is no picture that could be exposed.
            if i / 70 < 16 && i % 70 >= 64 {
                cpu = holes[i];
            }
            // The device's powers and logarithms differ from ours by some units of the last place, which can move a
            // value over the edge between two steps.
            let near = gpu.iter().zip(cpu).all(|(gpu, cpu)| gpu.abs_diff(cpu) <= 1);
            assert!(near && gpu[3] == 255, "{shown_as:?}, pixel {i}: {gpu:?} for {cpu:?}");
        }
    };
    for seed in 0..2 {
        let lighting = random_lighting(20, seed);
        let mut relit = Some(&lighting);
        for curve in [ToneCurve::None, ToneCurve::Agx, ToneCurve::Filmic, ToneCurve::Neutral] {
            for exposure_stops in [-6.0, -1.0, 2.0] {
                for white_kelvin in [None, Some(3200.0)] {
                    let tone = ToneMapping { curve, exposure_stops, white_kelvin };
                    screen.show(relit.take(), ShownAs::Toned(tone)).unwrap();
                    let image = screen.relighter().radiance().unwrap();
                    near(ShownAs::Toned(tone), tone.bytes(&image));
                }
            }
        }
        let image = screen.relighter().radiance().unwrap();
        assert_eq!(image, screen.relighter().relight(&lighting).unwrap());
        for (low, high) in [(0.001, 64.0), (0.5, 0.75)] {
            let shown_as = ShownAs::FalseColour { low, high };
            screen.show(None, shown_as).unwrap();
            near(shown_as, ToneMapping::default().bytes(&false_colour(&image, low, high).unwrap()));
        }
    }
}

fn paged(source: &MemoryFactors, host_bytes: u64, gpu_bytes: u64) -> PagedGpuRelighter<'_> {
    PagedGpuRelighter::new(PagedRelighter::new(source, host_bytes), gpu_bytes, GpuSettings::default()).unwrap()
}

fn paged_equals_its_twin_in_every_hard_shape() {
    for (name, recipe) in hard_shapes() {
        for recipe in [recipe.clone(), recipe.narrow()] {
            let source = recipe.make();
            let (cpu, gpu) = (CpuRelighter::load(&source).unwrap(), GpuRelighter::new(&source).unwrap());
            let lighting_bytes = 12 * u64::from(recipe.columns);
            for sixths in [6, 5] {
                if sixths < 6 && recipe.ranks.iter().sum::<usize>() < 2 {
                    // Cannot be split.
                    continue;
                }
                // Few bytes more: arrays of single components are padded.
                let budget = (gpu.resident_bytes() - lighting_bytes) * sixths / 6 + lighting_bytes + 400;
                let paged = paged(&source, 0, budget);
                for seed in 0..2 {
                    let lighting = random_lighting(recipe.columns as usize, seed);
                    let (expected, relit) = (cpu.relight(&lighting).unwrap(), paged.relight(&lighting).unwrap());
                    let difference = largest_difference(&relit, &expected);
                    assert!(difference <= TOLERANCE, "{name}, narrow {}: {difference}", recipe.narrow);
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
        let paged = paged(&source, u64::MAX, budget);
        for _ in 0..3 {
            assert_eq!(paged.relight(&lighting).unwrap(), expected, "a {share}th of the memory");
        }
        assert!(paged.peak_bytes() <= budget, "{} of {budget}", paged.peak_bytes());
        let chunks = u64::from(source.shape.block_count()) * 2;
        assert_eq!(paged.host().reads().chunks, chunks, "host memory holds all: each chunk is read once");
    }
    // The lighting fits, and then not one component of a block.
    let refused = paged(&source, 0, 3_000).relight(&lighting).err();
    assert!(matches!(refused, Some(Error::Resources { .. })), "{refused:?}");
}

fn a_block_larger_than_a_bank_may_be_comes_in_pieces() {
    let source = Recipe::new((32, 64), 32, 500, &[20, 11]).sparse(90).narrow().make();
    let cpu = CpuRelighter::load(&source).unwrap();
    let lighting = random_lighting(500, 1);
    let expected = cpu.relight(&lighting).unwrap();
    let largest = GpuRelighter::new(&source).unwrap().resident_bytes() / 2;
    // Quarters of these budgets hold from half of a block down to less than its image.
    for budget in [2 * largest, largest, largest / 2] {
        let paged = paged(&source, u64::MAX, budget);
        for pieces in [1, 2] {
            let difference = largest_difference(&paged.relight(&lighting).unwrap(), &expected);
            assert!(difference <= TOLERANCE, "budget {budget}: {difference}");
            assert!(paged.uploads() >= 4 * pieces, "budget {budget}: {} uploads", paged.uploads());
        }
        assert!(paged.peak_bytes() <= budget, "{} of {budget}", paged.peak_bytes());
        assert_eq!(paged.host().reads().chunks, 4, "each chunk is read once");
    }
}

fn banks_that_fit_are_uploaded_once() {
    let source = Recipe::new((130, 70), 16, 100, &[3]).make();
    let budget = GpuRelighter::new(&source).unwrap().resident_bytes() * 2;
    source.take_log();
    let paged = paged(&source, 0, budget);
    paged.relight(&random_lighting(100, 1)).unwrap();
    assert_eq!(source.take_log(), source.chunks(0..source.shape.block_count(), 0..1));
    let (uploads, reads) = (paged.uploads(), paged.host().reads());
    paged.relight(&random_lighting(100, 2)).unwrap();
    assert_eq!((paged.uploads(), paged.host().reads()), (uploads, reads));
}

fn a_view_reads_its_base_layers_first_then_the_rest_and_nothing_else() {
    let source = Recipe::new((100, 80), 16, 50, &[2, 4]).sparse(40).narrow().make();
    let lighting = random_lighting(50, 1);
    let view: Vec<BlockId> = [9, 3, 10, 4].map(BlockId).into();
    let mut image = LinearImage::black(100, 80);
    let paged = paged(&source, u64::MAX, u64::MAX);
    let mut seen = Vec::new();
    for (detail, layers) in [(Detail::Base, 0..1), (Detail::Base, 0..0), (Detail::Whole, 1..2), (Detail::Base, 0..0)] {
        paged.relight_view(&lighting, &view, detail, &mut image).unwrap();
        let mut expected: Vec<_> =
            view.iter().flat_map(|id| layers.clone().map(|layer| (id.0, layer)).collect::<Vec<_>>()).collect();
        expected.sort_unstable();
        assert_eq!(source.take_log(), expected, "{detail:?}");
        seen.push((image.clone(), paged.uploads()));
    }
    assert_eq!((seen[0].1, seen[1].1), (seen[1].1, seen[0].1), "what is there is not uploaded again");
    assert_eq!(seen[2], seen[3], "and more detail than asked for is shown where it is at hand");
    for (count, (image, _)) in [(1, &seen[0]), (1, &seen[1]), (2, &seen[2])] {
        let whole = CpuRelighter::load(&source.first_layers(count)).unwrap().relight(&lighting).unwrap();
        for (i, (pixel, expected)) in image.pixels.iter().zip(&whole.pixels).enumerate() {
            let block = BlockId((i / 100 / 16 * 7 + i % 100 / 16) as u32);
            let expected = if view.contains(&block) { *expected } else { [0.0; 3] };
            // Radiance is of the order of 10 here, and TOLERANCE relative to the largest.
            let near = pixel.iter().zip(expected).all(|(a, b)| (a - b).abs() <= 1e-4);
            assert!(near, "{count} layers, pixel {i}: {pixel:?} for {expected:?}");
        }
    }
}

fn what_is_near_is_in_its_memory_before_it_is_seen() {
    let source = Recipe::new((100, 80), 16, 50, &[2, 4]).sparse(40).narrow().make();
    let lighting = random_lighting(50, 1);
    let whole = GpuRelighter::new(&source).unwrap();
    let expected = whole.relight(&lighting).unwrap();
    source.take_log();
    // Room for all; nothing stays with the host.
    let paged = paged(&source, 0, 3 * whole.resident_bytes());
    let (view, nearby): (Vec<_>, Vec<_>) = ((0..7).map(BlockId).collect(), (7..14).map(BlockId).collect());
    let mut image = LinearImage::black(100, 80);
    paged.relight_view(&lighting, &view, Detail::Whole, &mut image).unwrap();
    assert_eq!(source.take_log(), source.chunks(0..7, 0..2));
    paged.prefetch(&view, &nearby).unwrap();
    // The host keeps nothing here, so base layers, which come first, are read again with the rest.
    let bases = source.chunks(7..14, 0..1);
    let mut expected_log = [source.chunks(7..14, 0..2), bases].concat();
    expected_log.sort_unstable();
    assert_eq!(source.take_log(), expected_log);
    let before = (paged.uploads(), paged.uploaded_bytes(), paged.host().reads());
    paged.relight_view(&lighting, &nearby, Detail::Whole, &mut image).unwrap();
    assert_eq!((paged.uploads(), paged.uploaded_bytes(), paged.host().reads()), before, "nothing is left to do");
    let seen = 2 * 16 * 100;
    assert_eq!(image.pixels[..seen], expected.pixels[..seen]);
}

fn a_view_that_moves_stays_within_the_budget_and_what_it_left_goes_first() {
    let source = Recipe::new((160, 160), 16, 50, &[4]).sparse(10).make();
    let lighting = random_lighting(50, 1);
    let whole = GpuRelighter::new(&source).unwrap();
    let expected = whole.relight(&lighting).unwrap();
    let budget = whole.resident_bytes() / 2;
    let paged = paged(&source, 0, budget);
    let mut image = LinearImage::black(160, 160);
    let row = |y: u32| (10 * y..10 * y + 10).map(BlockId).collect::<Vec<_>>();
    // Two rows fit beside each other, ten do not.
    for y in (0..10).chain((0..10).rev()) {
        let view: Vec<BlockId> = (y..10.min(y + 2)).flat_map(row).collect();
        paged.relight_view(&lighting, &view, Detail::Whole, &mut image).unwrap();
        let before = paged.host().reads();
        paged.relight_view(&lighting, &view, Detail::Whole, &mut image).unwrap();
        assert_eq!(paged.host().reads(), before, "what is in view stays");
    }
    assert_eq!(image, expected);
    assert!(paged.peak_bytes() <= budget, "{} of {budget}", paged.peak_bytes());
}

fn damage_shows_as_on_the_cpu_where_it_is_paged() {
    let mut source = Recipe::new((48, 16), 16, 10, &[2, 3]).make();
    source.damaged.extend([(0, 1), (2, 0)]);
    let cpu = CpuRelighter::load(&source).unwrap();
    let lighting = random_lighting(10, 1);
    let paged = paged(&source, 0, u64::MAX);
    for _ in 0..2 {
        let difference = largest_difference(&paged.relight(&lighting).unwrap(), &cpu.relight(&lighting).unwrap());
        assert!(difference <= TOLERANCE, "{difference}");
        assert_eq!(paged.host().damage(), cpu.damage());
    }
}

fn factors_and_lightings_that_cannot_be_used_are_refused() {
    let mut source = Recipe::new((48, 16), 16, 10, &[2]).make();
    source.layers[1][0].left[3] = f32::NAN;
    let resident = GpuRelighter::new(&source).err().unwrap();
    let through = paged(&source, 0, u64::MAX);
    let refused = through.relight(&random_lighting(10, 1)).err().unwrap();
    for refused in [resident, refused] {
        assert!(matches!(&refused, Error::Input { place, .. } if place == "block 1"), "{refused}");
    }
    assert!(Lighting::new(vec![[1.0, f32::NAN, 1.0]; 10]).is_err());
    assert!(through.relight(&Lighting::uniform(9, [1.0; 3]).unwrap()).is_err());
    let mut small = LinearImage::black(10, 10);
    let relit = through.relight_view(&random_lighting(10, 1), &[BlockId(0)], Detail::Whole, &mut small);
    assert!(relit.is_err(), "an image of another size");
    let gpu = GpuRelighter::new(&Recipe::new((48, 16), 16, 10, &[2]).make()).unwrap();
    assert!(gpu.relight_into(&random_lighting(10, 1), &mut small).is_err(), "an image of another size");
    let mut image = LinearImage::black(48, 16);
    gpu.relight_into(&random_lighting(10, 1), &mut image).unwrap();
    assert_eq!(image, gpu.relight(&random_lighting(10, 1)).unwrap());
}

/// A device as a window would open it, and where it reports errors.
fn device_of_ones_own() -> (wgpu::Device, wgpu::Queue) {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::PRIMARY;
    let instance = wgpu::Instance::new(descriptor);
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).unwrap();
    pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default())).unwrap()
}

fn on_a_device_that_others_use_it_is_the_same() {
    let source = Recipe::new((130, 70), 16, 100, &[6]).sparse(30).narrow().make();
    let lighting = random_lighting(100, 1);
    let (device, queue) = device_of_ones_own();
    let settings = GpuSettings { subgroups: false, ..Default::default() };
    let own = GpuRelighter::with_settings(&source, settings).unwrap();
    let shared = GpuRelighter::on_device(device.clone(), queue.clone(), &source, settings).unwrap();
    assert_eq!(shared.relight(&lighting).unwrap(), own.relight(&lighting).unwrap());
    assert_eq!(shared.adapter(), own.adapter());
    // Its owner goes on using it, before and after the relighter is gone.
    let other = || {
        let usage = wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let descriptor = wgpu::BufferDescriptor { label: None, size: 64, usage, mapped_at_creation: false };
        queue.write_buffer(&device.create_buffer(&descriptor), 0, &[1; 64]);
        queue.submit([]);
        device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    };
    other();
    drop(shared);
    other();
    // A device without the feature has no subgroups to use, whatever is wished for.
    let wished = GpuRelighter::on_device(device, queue, &source, GpuSettings::default()).unwrap();
    assert!(!wished.uses_subgroups());
    assert_eq!(wished.relight(&lighting).unwrap(), own.relight(&lighting).unwrap());
}

fn threads_that_share_it_get_each_its_own_image() {
    let source = Recipe::new((130, 70), 16, 100, &[6]).sparse(30).make();
    let gpu = GpuRelighter::new(&source).unwrap();
    let alone: Vec<LinearImage> = (0..4).map(|seed| gpu.relight(&random_lighting(100, seed)).unwrap()).collect();
    std::thread::scope(|scope| {
        for (seed, alone) in (0..).zip(&alone) {
            let gpu = &gpu;
            scope.spawn(move || {
                for _ in 0..50 {
                    assert_eq!(gpu.relight(&random_lighting(100, seed)).unwrap(), *alone, "lighting {seed}");
                }
            });
        }
    });
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
    macro_rules! tests {
        ($($test:ident),+ $(,)?) => { [$((stringify!($test), $test as fn())),+] };
    }
    let tests = tests![
        equals_its_twin_in_every_hard_shape,
        many_small_banks_give_the_same_bits_as_one,
        more_components_than_one_row_of_workgroups_holds,
        damage_shows_as_on_the_cpu,
        with_and_without_subgroups_it_is_the_same,
        the_screen_shows_what_the_twin_does_to_one_step_of_256,
        what_does_not_fit_is_refused,
        paged_equals_its_twin_in_every_hard_shape,
        what_is_larger_than_its_memory_passes_through,
        a_block_larger_than_a_bank_may_be_comes_in_pieces,
        banks_that_fit_are_uploaded_once,
        a_view_reads_its_base_layers_first_then_the_rest_and_nothing_else,
        what_is_near_is_in_its_memory_before_it_is_seen,
        a_view_that_moves_stays_within_the_budget_and_what_it_left_goes_first,
        damage_shows_as_on_the_cpu_where_it_is_paged,
        factors_and_lightings_that_cannot_be_used_are_refused,
        on_a_device_that_others_use_it_is_the_same,
        threads_that_share_it_get_each_its_own_image,
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
