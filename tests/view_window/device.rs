//! The worker with a device: what it relights, within and beyond its budget.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use ltm::container::ContainerReader;
use ltm::light::Lighting;
use ltm::relight::CpuRelighter;
use ltm::view::worker::{Event, Means, Session, SharedDevice};

use super::{request, room, whole_picture};

/// Tests of this file; they need an adapter.
pub(crate) const TESTS: [(&str, fn()); 1] = [(
    "the_device_relights_within_its_budget_and_beyond_and_the_cpu_keeps_nothing_beside_it",
    the_device_relights_within_its_budget_and_beyond_and_the_cpu_keeps_nothing_beside_it,
)];

/// Both add the same f32 products in another order; see the tests of the relighters.
const TOLERANCE: f32 = 1.0 / 131_072.0;

fn device() -> SharedDevice {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::PRIMARY;
    let instance = wgpu::Instance::new(descriptor);
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).unwrap();
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default())).unwrap();
    SharedDevice { device, queue }
}

fn the_device_relights_within_its_budget_and_beyond_and_the_cpu_keeps_nothing_beside_it() {
    let reader = ContainerReader::open(room()).unwrap();
    let whole = CpuRelighter::load(&reader).unwrap();
    let scene = Lighting::of_scene(&reader.job().basis);
    let half = Lighting::new(scene.weights().iter().map(|weight| weight.map(|v| v / 2.0)).collect()).unwrap();
    for (budget_bytes, paged) in [(u64::MAX, false), (whole.factor_bytes() / 2, true)] {
        let means = Means { device: Some(device()), budget_bytes };
        let session = Session::open(room(), means, Arc::new(|| ())).unwrap();
        for (generation, lighting) in [(1, &scene), (2, &half), (3, &scene)] {
            let lighting = Arc::new(lighting.clone());
            session.worker.request(request(generation, &lighting));
            let picture = whole_picture(&session);
            let expected = whole.relight(&lighting).unwrap();
            let peak = expected.values().iter().fold(0.0f32, |peak, v| peak.max(v.abs()));
            let pairs = picture.image.values().iter().zip(expected.values());
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
