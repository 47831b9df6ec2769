//! The worker with a device: what it relights, within and beyond its budget.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use eframe::egui::{Key, Modifiers, vec2};
use ltm::container::ContainerReader;
use ltm::image::{ToneCurve, ToneMapping};
use ltm::light::Lighting;
use ltm::relight::CpuRelighter;
use ltm_view::display::Display;
use ltm_view::worker::{Event, Means, Request, Seen, Session, SharedDevice};

use super::controls::pixel_at;
use super::driver::{Driver, PATIENCE};
use super::panoramas::write_panorama;
use super::texels::texels;
use super::{request, room, values, values_of, whole_picture};

/// Tests of this file; they need an adapter.
pub(crate) const TESTS: [(&str, fn()); 4] = [
    (
        "a_snapshot_that_is_asked_for_too_early_waits_for_its_values",
        a_snapshot_that_is_asked_for_too_early_waits_for_its_values,
    ),
    (
        "the_device_relights_within_its_budget_and_beyond_and_the_cpu_keeps_nothing_beside_it",
        the_device_relights_within_its_budget_and_beyond_and_the_cpu_keeps_nothing_beside_it,
    ),
    (
        "the_device_shows_what_the_cpu_would_and_its_values_follow_a_drag",
        the_device_shows_what_the_cpu_would_and_its_values_follow_a_drag,
    ),
    ("a_panorama_that_the_device_shows_is_looked_around_in", a_panorama_that_the_device_shows_is_looked_around_in),
];

/// Both add the same f32 products in another order; see the tests of the relighters.
const TOLERANCE: f32 = 1.0 / 131_072.0;

fn device(shows: bool) -> SharedDevice {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::PRIMARY;
    let instance = wgpu::Instance::new(descriptor);
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).unwrap();
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default())).unwrap();
    SharedDevice { device, queue, shows }
}

/// The device's texture is known to the window twice, flat and as one looks around; neither is lost with the other.
fn a_panorama_that_the_device_shows_is_looked_around_in() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("around.ltc");
    write_panorama(&path);
    let mut driver = Driver::open_on_device(&path, Some(true));
    let at = driver.find("picture").center() + vec2(1.0, 1.0);
    for says in [true, false, true] {
        assert_eq!(driver.says("80° wide"), says);
        assert_eq!(pixel_at(&mut driver, at), "96, 48");
        driver.key(Key::E, Modifiers::NONE);
        driver.settle();
        driver.key(Key::P, Modifiers::NONE);
        driver.settle();
    }
}

fn the_device_relights_within_its_budget_and_beyond_and_the_cpu_keeps_nothing_beside_it() {
    let reader = ContainerReader::open(room()).unwrap();
    let whole = CpuRelighter::load(&reader).unwrap();
    let scene = Lighting::of_scene(&reader.job().basis);
    let half = Lighting::new(scene.weights().iter().map(|weight| weight.map(|v| v / 2.0)).collect()).unwrap();
    let small = whole.factor_bytes() / 2;
    for (budget_bytes, paged, shows) in [(u64::MAX, false, true), (u64::MAX, false, false), (small, true, false)] {
        let means = Means { device: Some(device(shows)), budget_bytes };
        let session = Session::open(room(), means, Arc::new(|| ())).unwrap();
        for (generation, lighting) in [(1, &scene), (2, &half), (3, &scene)] {
            let lighting = Arc::new(lighting.clone());
            session.worker.request(request(generation, &lighting));
            let picture = whole_picture(&session);
            let expected = whole.relight(&lighting).unwrap();
            let peak = expected.values().iter().fold(0.0f32, |peak, v| peak.max(v.abs()));
            let image = values(&session, &picture);
            let pairs = image.values().iter().zip(expected.values());
            let most = pairs.fold(0.0f32, |most, (a, b)| most.max((a - b).abs()));
            assert!(most <= TOLERANCE * peak, "paged {paged}: {most} of {peak}");
        }
        // A further picture is asked for when all is loaded, so that its coming says that the rest was counted.
        session.worker.request(request(4, &Arc::new(half.clone())));
        whole_picture(&session);
        let meter = session.worker.meter();
        let on_device = meter.device_bytes.load(Ordering::Relaxed);
        assert!(on_device > 0 && on_device <= budget_bytes, "{on_device} of {budget_bytes}");
        assert_eq!(meter.resident_bytes.load(Ordering::Relaxed), 0, "paged {paged}");
        let failed = session.worker.events().find_map(|event| match event {
            Event::Failed(message) => Some(message),
            _ => None,
        });
        assert_eq!(failed, None);
    }
}

fn the_device_shows_what_the_cpu_would_and_its_values_follow_a_drag() {
    let shared = device(true);
    let means = Means { device: Some(shared.clone()), budget_bytes: u64::MAX };
    let session = Session::open(room(), means, Arc::new(|| ())).unwrap();
    let scene = Arc::new(Lighting::of_scene(session.basis()));
    session.worker.request(request(1, &scene));
    // What streams in is the CPU's; then the device takes over.
    while !matches!(whole_picture(&session).seen, Seen::Texture(_)) {}
    let tone = |curve, exposure_stops| ToneMapping { curve, exposure_stops, white_kelvin: None };
    let displays = [
        Display { tone: tone(ToneCurve::None, 0.0), false_colour: false },
        Display { tone: tone(ToneCurve::Agx, 2.5), false_colour: false },
        Display { tone: tone(ToneCurve::None, 3.0), false_colour: true },
        Display { tone: tone(ToneCurve::None, 1e9), false_colour: true },
    ];
    for (generation, display) in (2..).zip(displays) {
        session.worker.request(Request { display, ..request(generation, &scene) });
        let picture = whole_picture(&session);
        let Seen::Texture(texture) = &picture.seen else { panic!("{generation}: the CPU shows it") };
        let shown = texels(&shared.device, &shared.queue, texture);
        let (image, histogram) = values_of(&session, generation);
        let twin = display.show(&image);
        assert_eq!(histogram, twin.histogram);
        let most = shown.as_flattened().iter().zip(&twin.rgba).map(|(a, b)| a.abs_diff(*b)).max();
        // Powers, logarithms and the twin's tables differ by little, which can move a value over the edge of a step.
        assert!(most <= Some(1), "{display:?}: {most:?}");
    }
    // A drag of half a second: pictures come, and values among them, the last of which are those of its end.
    let begun = std::time::Instant::now();
    let (mut pictures, mut valued, mut generation) = (0, Vec::new(), 10);
    let mut ended = false;
    while valued.last() != Some(&generation) {
        ended |= begun.elapsed().as_secs_f64() > 0.5;
        assert!(begun.elapsed() < PATIENCE, "values of {generation} do not come, but of {valued:?}");
        if !ended {
            generation += 1;
            let part = 1.0 + generation as f32 / 100.0;
            let dragged = scene.weights().iter().map(|weight| weight.map(|v| v * part)).collect();
            session.worker.request(request(generation, &Arc::new(Lighting::new(dragged).unwrap())));
        }
        for event in session.worker.events() {
            match event {
                Event::Picture(_) => pictures += 1,
                Event::Values { generation, .. } => valued.push(generation),
                _ => {}
            }
        }
        std::thread::sleep(std::time::Duration::from_millis(8));
    }
    assert!(valued.len() >= 2 && pictures > 2 * valued.len(), "{pictures} pictures, values of {valued:?}");
}

fn a_snapshot_that_is_asked_for_too_early_waits_for_its_values() {
    let mut driver = Driver::open_on_device(room(), Some(true));
    let come = driver.pictures();
    driver.click(driver.find("ceiling, on").center());
    driver.key(Key::K, Modifiers::NONE);
    driver.settle();
    assert!(driver.pictures() > come);
    driver.click(driver.find("ceiling, on").center());
    driver.settle();
    driver.key(Key::C, Modifiers::NONE);
    driver.settle();
    let kept = driver.texture("compared");
    assert!(kept.chunks_exact(4).all(|pixel| pixel == [0, 0, 0, 255]), "without the light it is dark");
}
