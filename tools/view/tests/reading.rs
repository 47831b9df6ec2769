//! A container that cannot be read for a while: a network that is away, a disk that was pulled out.

#[path = "../../../tests/relight_source/mod.rs"]
mod relight_source;

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ltm::container::{ContainerOptions, ContainerReader, ContainerWriter};
use ltm::files::Ranged;
use ltm::light::{Job, Light, LightBasis, LightKind, Lighting};
use ltm::matrix::{BlockReport, FactorSource};
use ltm_view::display::Display;
use ltm_view::worker::{Event, Means, Request, Worker};
use relight_source::Recipe;

#[derive(Debug)]
struct AwayAtTimes {
    file: File,
    is_away: Arc<AtomicBool>,
}

impl Ranged for AwayAtTimes {
    fn bytes(&self) -> io::Result<u64> {
        self.file.bytes()
    }

    fn fill(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
        match self.is_away.load(Ordering::Relaxed) {
            true => Err(io::Error::other("the network is away")),
            false => self.file.fill(buffer, offset),
        }
    }
}

/// A container of a few blocks and 16 lamps.
fn write(path: &Path) {
    let source = Recipe::new((37, 21), 16, 16, &[2, 3]).make();
    let mut basis = LightBasis::new();
    (0..16).for_each(|lamp| {
        basis.push(Light::unplaced(format!("lamp {lamp}"), LightKind::Lamp)).unwrap();
    });
    let job = Job { shape: source.shape, basis, provenance: Default::default() };
    let writer = ContainerWriter::create(path, &job, ContainerOptions::default()).unwrap();
    for id in source.shape.blocks() {
        let encoded = writer.encode(id, &source.join(id, 0..source.layer_count(id))).unwrap();
        writer.write_encoded(id, &encoded, &BlockReport::default()).unwrap();
    }
    writer.finish().unwrap();
}

fn wait_for<T>(worker: &Worker, what: &str, found: impl Fn(&Event) -> Option<T>) -> T {
    let begun = Instant::now();
    loop {
        if let Some(found) = worker.events().find_map(|event| found(&event)) {
            return found;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "no {what} came");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Whether the container fits the memory or not.
#[test]
fn what_cannot_be_read_is_said_and_tried_again_with_the_next_change() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.ltc");
    write(&path);
    for budget_bytes in [u64::MAX, 1] {
        let is_away = Arc::new(AtomicBool::new(false));
        let file = Box::new(AwayAtTimes { file: File::open(&path).unwrap(), is_away: is_away.clone() });
        let container = Arc::new(ContainerReader::open_ranged(&path, file).unwrap());
        let request = |generation| Request {
            generation,
            lighting: Arc::new(Lighting::of_scene(&container.job().basis)),
            display: Display::default(),
            compared: None,
            looked_at: [0.0; 2],
        };
        is_away.store(true, Ordering::Relaxed);
        let mut worker = Worker::asleep(container.clone(), Arc::new(|| {}));
        worker.wake(Means { device: None, budget_bytes });
        worker.request(request(1));
        let said = wait_for(&worker, "message", |event| match event {
            Event::Failed(said) => Some(said.clone()),
            _ => None,
        });
        assert!(said.contains("the network is away") && said.contains("tried again"), "{said}");
        // Once for each change, and no more.
        worker.ask_pixel([3, 4]);
        worker.request(request(2));
        std::thread::sleep(Duration::from_millis(200));
        let again = worker.events().filter(|event| matches!(event, Event::Failed(_))).count();
        assert!((1..=2).contains(&again), "said {again} times again");
        is_away.store(false, Ordering::Relaxed);
        worker.request(request(3));
        wait_for(&worker, "whole picture", |event| match event {
            Event::Picture(picture) => (picture.generation == 3 && picture.progress.is_complete()).then_some(()),
            _ => None,
        });
    }
}
