//! What stopped, killed and competing jobs leave behind: it is continued, refused or denoised, and never taken for something else.

use std::fs;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use ltm::container::{ContainerOptions, ContainerReader, ContainerWriter, merge};
use ltm::files::ContinuationFile;
use ltm::light::{DescribedSource, Light, LightBasis, LightKind};
use ltm::matrix::BlockId;
use ltm::pipeline::{self, PackOptions, RenderOptions, UnpackOptions};
use ltm::resources::{NoProgress, Progress};
use ltm::scene::{BuiltIn, LoadedScene};
use ltm::store::{Precision, StoreOptions, StoreReader, partial_path};
use ltm::{Error, MemoryMatrix};
use tempfile::TempDir;

/// Six blocks.
fn room() -> LoadedScene {
    let mut loaded = BuiltIn { width: 72, height: 40, texels: 8 }.named("mixed").unwrap();
    loaded.settings.samples_per_pixel = 4;
    loaded
}

fn render(folder: &TempDir, precision: Precision) -> StoreReader {
    let path = folder.path().join(format!("{precision}.ltm"));
    let store = StoreOptions { precision, ..StoreOptions::default() };
    pipeline::render(room(), &path, &RenderOptions { store, ..RenderOptions::default() }, &NoProgress).unwrap();
    StoreReader::open(&path).unwrap()
}

fn forced() -> PackOptions {
    let container = ContainerOptions { overwrite: true, ..ContainerOptions::default() };
    PackOptions { container, ..PackOptions::default() }
}

fn pack(matrix: &StoreReader, path: &Path, options: &PackOptions, watch: &dyn Progress) -> ltm::Result<u64> {
    pipeline::pack(matrix, matrix.job(), path, options, watch).map(|report| report.blocks_kept)
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Asks to stop when so many steps are done, or a stage begins, and remembers what was said.
#[derive(Default)]
struct StopAfter {
    steps_left: AtomicU64,
    stage: Option<&'static str>,
    /// Steps of that stage.
    steps_there: u64,
    said: Mutex<Vec<String>>,
}

impl StopAfter {
    fn steps(steps: u64) -> Self {
        Self { steps_left: AtomicU64::new(steps), ..Self::default() }
    }

    fn at(stage: &'static str) -> Self {
        Self { stage: Some(stage), ..Self::steps(u64::MAX) }
    }
}

impl Progress for StopAfter {
    fn begin(&self, stage: &str, _: u64, _: &str) {
        if self.stage == Some(stage) {
            self.steps_left.store(self.steps_there, Ordering::SeqCst);
        }
    }
    fn advance(&self, steps: u64, _: u64, _: &str) {
        let left = |left: u64| Some(left.saturating_sub(steps));
        let _ = self.steps_left.fetch_update(Ordering::SeqCst, Ordering::SeqCst, left);
    }
    fn end(&self) {}
    fn note(&self, line: &str) {
        self.said.lock().unwrap().push(line.to_owned());
    }
    fn interrupted(&self) -> bool {
        self.steps_left.load(Ordering::SeqCst) == 0
    }
}

#[test]
fn files_of_someone_else_beside_the_output_are_never_touched() {
    let folder = tempfile::tempdir().unwrap();
    let matrix = render(&folder, Precision::F32);
    let path = folder.path().join("a.ltc");
    let own_words = "a user's own words, longer than any mark of ours";
    for name in ["a.ltc.part", "a.ltc.spill"] {
        let foreign = folder.path().join(name);
        fs::write(&foreign, own_words).unwrap();
        for options in [PackOptions::default(), forced()] {
            let error = pack(&matrix, &path, &options, &NoProgress).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains("another program"), "{error}");
            assert_eq!(fs::read_to_string(&foreign).unwrap(), own_words);
        }
        fs::remove_file(&foreign).unwrap();
    }
    let (path, foreign) = (folder.path().join("b.ltm"), folder.path().join("b.ltm.part"));
    fs::write(&foreign, own_words).unwrap();
    for overwrite in [false, true] {
        let store = StoreOptions { overwrite, ..StoreOptions::default() };
        let options = RenderOptions { store, ..RenderOptions::default() };
        assert!(pipeline::render(room(), &path, &options, &NoProgress).is_err());
        assert_eq!(fs::read_to_string(&foreign).unwrap(), own_words);
    }
}

#[test]
fn a_pack_of_one_precision_is_not_continued_with_another() {
    let folder = tempfile::tempdir().unwrap();
    let (half, full) = (render(&folder, Precision::F16), render(&folder, Precision::F32));
    let (whole, path) = (folder.path().join("whole.ltc"), folder.path().join("a.ltc"));
    pack(&full, &whole, &PackOptions::default(), &NoProgress).unwrap();
    assert!(matches!(
        pack(&half, &path, &PackOptions::default(), &StopAfter::steps(3)),
        Err(Error::Interrupted { .. })
    ));
    let spill = fs::read(folder.path().join("a.ltc.spill")).unwrap();
    let error = pack(&full, &path, &PackOptions::default(), &NoProgress).unwrap_err().to_string();
    assert!(error.contains("other input or settings"), "{error}");
    assert_eq!(fs::read(folder.path().join("a.ltc.spill")).unwrap(), spill, "hours of work may be in it");
    assert_eq!(pack(&full, &path, &forced(), &NoProgress).unwrap(), 0);
    assert!(fs::read(&path).unwrap() == fs::read(&whole).unwrap());
}

#[test]
fn blocks_of_two_matrices_of_one_job_are_never_mixed() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let rendered = render(&folder, Precision::F32);
    // The same job with other entries: a coarse container taken apart again.
    let mut coarse = PackOptions::default();
    coarse.compress.rank = 1;
    pack(&rendered, &at("coarse.ltc"), &coarse, &NoProgress).unwrap();
    let container = ContainerReader::open(&at("coarse.ltc")).unwrap();
    pipeline::unpack_to_store(&container, &at("other.ltm"), &UnpackOptions::default(), &NoProgress).unwrap();
    let other = StoreReader::open(&at("other.ltm")).unwrap();
    assert_eq!(rendered.job().hash(), other.job().hash());

    let options = PackOptions::default();
    pack(&other, &at("whole.ltc"), &options, &NoProgress).unwrap();
    let stop = StopAfter { steps_there: 3, ..StopAfter::at("packing") };
    assert!(matches!(pack(&rendered, &at("a.ltc"), &options, &stop), Err(Error::Interrupted { .. })));
    let error = pack(&other, &at("a.ltc"), &options, &NoProgress).unwrap_err().to_string();
    assert!(error.contains("other input or settings"), "{error}");
    assert_eq!(pack(&other, &at("a.ltc"), &forced(), &NoProgress).unwrap(), 0);
    assert!(fs::read(at("a.ltc")).unwrap() == fs::read(at("whole.ltc")).unwrap());

    let unpack = |matrix: &StoreReader, watch: &dyn Progress| {
        pipeline::unpack_to_store(matrix, &at("b.ltm"), &UnpackOptions::default(), watch)
    };
    assert!(matches!(unpack(&rendered, &StopAfter::steps(2)), Err(Error::Interrupted { .. })));
    let error = unpack(&other, &NoProgress).unwrap_err().to_string();
    assert!(error.contains("other input or settings"), "{error}");
    assert_eq!(unpack(&rendered, &NoProgress).unwrap(), 6);
}

#[test]
fn what_a_pack_left_that_was_killed_after_its_last_step_is_denoised() {
    let folder = tempfile::tempdir().unwrap();
    let matrix = render(&folder, Precision::F32);
    let (path, spill) = (folder.path().join("a.ltc"), folder.path().join("a.ltc.spill"));
    // Stopped in the second pass, so that every block is analysed.
    assert!(pack(&matrix, &path, &PackOptions::default(), &StopAfter::at("packing")).is_err());
    let spilled = fs::read(&spill).unwrap();
    pack(&matrix, &path, &PackOptions::default(), &NoProgress).unwrap();
    let (finished, made) = (fs::read(&path).unwrap(), fs::metadata(&path).unwrap().modified().unwrap());
    fs::write(&spill, &spilled).unwrap();
    fs::File::options().write(true).open(&spill).unwrap().set_modified(made).unwrap();
    let error = pack(&matrix, &path, &PackOptions::default(), &NoProgress).unwrap_err().to_string();
    assert!(error.contains("exists already"), "{error}");
    assert_eq!(names(folder.path()), ["a.ltc", "f32.ltm"]);
    assert!(fs::read(&path).unwrap() == finished);
}

#[test]
fn a_byte_that_flips_between_writing_and_assembling_is_damage() {
    let folder = tempfile::tempdir().unwrap();
    let matrix = render(&folder, Precision::F32);
    let (packed, path) = (folder.path().join("packed.ltc"), folder.path().join("a.ltc"));
    pack(&matrix, &packed, &PackOptions::default(), &NoProgress).unwrap();
    let packed = ContainerReader::open(&packed).unwrap();
    let writer = || ContainerWriter::create(&path, packed.job(), ContainerOptions::default()).unwrap();
    let begun = writer();
    for id in packed.job().shape.blocks() {
        begun.write_block(id, &packed.read_block(id).unwrap(), &packed.block_report(id)).unwrap();
    }
    let part = fs::File::options().read(true).write(true).open(folder.path().join("a.ltc.part")).unwrap();
    let (mut byte, at) = ([0], part.metadata().unwrap().len() / 2);
    part.read_exact_at(&mut byte, at).unwrap();
    part.write_all_at(&[!byte[0]], at).unwrap();
    let error = begun.finish().unwrap_err();
    assert!(matches!(error, Error::Damaged { .. }) && error.to_string().contains("checksum"), "{error}");
    assert!(!path.exists());
    // The next run takes up what is whole, and only that.
    let again = writer();
    let kept = packed.job().shape.blocks().filter(|&id| again.written(id).is_some()).count();
    assert!((1..packed.job().shape.block_count() as usize).contains(&kept), "{kept}");
}

#[test]
fn a_partial_file_that_is_deleted_meanwhile_does_not_spoil_the_pack() {
    struct Deletes(PathBuf);
    impl Progress for Deletes {
        fn begin(&self, stage: &str, _: u64, _: &str) {
            if stage == "packing" {
                fs::remove_file(&self.0).unwrap();
            }
        }
        fn advance(&self, _: u64, _: u64, _: &str) {}
        fn end(&self) {}
        fn note(&self, _: &str) {}
        fn interrupted(&self) -> bool {
            false
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let matrix = render(&folder, Precision::F32);
    let path = folder.path().join("a.ltc");
    pack(&matrix, &path, &PackOptions::default(), &Deletes(folder.path().join("a.ltc.part"))).unwrap();
    ContainerReader::open(&path).unwrap();
}

#[test]
fn an_interrupted_unpack_is_continued_by_the_same_command_only() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let matrix = render(&folder, Precision::F32);
    pack(&matrix, &at("a.ltc"), &PackOptions::default(), &NoProgress).unwrap();
    let mut other = PackOptions::default();
    other.compress.rank = 3;
    pack(&matrix, &at("b.ltc"), &other, &NoProgress).unwrap();
    let open = |name: &str| ContainerReader::open(&at(name)).unwrap();
    let (path, options) = (at("a.ltm"), UnpackOptions::default());
    let unpack = |name: &str, watch: &dyn Progress| pipeline::unpack_to_store(&open(name), &path, &options, watch);
    assert_eq!(unpack("a.ltc", &NoProgress).unwrap(), 6);
    let whole = fs::read(&path).unwrap();
    fs::remove_file(&path).unwrap();
    let before = names(folder.path());

    assert!(matches!(unpack("a.ltc", &StopAfter::steps(2)), Err(Error::Interrupted { .. })));
    assert!(partial_path(&path).exists());
    let error = unpack("b.ltc", &NoProgress).unwrap_err().to_string();
    assert!(error.contains("other input or settings"), "{error}");
    // A render of the same job must not go on with blocks of a container.
    let error = pipeline::render(room(), &path, &RenderOptions::default(), &NoProgress).unwrap_err().to_string();
    assert!(error.contains("made in another way"), "{error}");
    let watch = StopAfter::steps(100);
    assert_eq!(unpack("a.ltc", &watch).unwrap(), 6);
    assert!(watch.said.lock().unwrap().iter().any(|line| line.contains("continuing")));
    assert!(fs::read(&path).unwrap() == whole);
    // Killed right after the file had its name: the next command finds what was left.
    let note = at("a.ltm.part.origin");
    let left = ContinuationFile::open(&note, *b"LTMorig1", open("a.ltc").fingerprint(), 1, false).unwrap();
    left.append(0, &[]).unwrap();
    drop(left);
    let made = fs::metadata(&path).unwrap().modified().unwrap();
    fs::File::options().write(true).open(&note).unwrap().set_modified(made).unwrap();
    assert!(unpack("a.ltc", &NoProgress).unwrap_err().to_string().contains("exists already"));
    fs::remove_file(&path).unwrap();
    assert_eq!(names(folder.path()), before, "the note of the origin went with the file");

    // Nor an unpack with blocks of a render.
    let stopped = pipeline::render(room(), &path, &RenderOptions::default(), &StopAfter::steps(2));
    assert!(matches!(stopped, Err(Error::Interrupted { .. })));
    let error = unpack("a.ltc", &NoProgress).unwrap_err().to_string();
    assert!(error.contains("made in another way"), "{error}");
}

#[test]
fn an_interrupted_unpack_to_a_file_for_each_light_is_continued() {
    let folder = tempfile::tempdir().unwrap();
    let mut basis = LightBasis::new();
    for name in ["a", "b", "c"] {
        basis.push(Light::unplaced(name, LightKind::Point)).unwrap();
    }
    let value = |x: u32, y: u32, channel, column| ((1024 * (3 * column + channel) + (32 * y + x) as usize) % 97) as f32;
    let pixel = |x, y, column| [0, 1, 2].map(|channel| value(x, y, channel, column));
    let source = MemoryMatrix::from_fn((32, 32), basis, pixel).unwrap();
    let container = folder.path().join("a.ltc");
    ltm::pack(&source, &container, &PackOptions::default()).unwrap();
    let container = ContainerReader::open(&container).unwrap();
    let images = folder.path().join("images");
    fs::create_dir(&images).unwrap();
    let pattern = images.join("{light}.exr");
    let unpack = |watch: &dyn Progress| pipeline::unpack_to_exr(&container, &pattern, &UnpackOptions::default(), watch);
    // One block, then the images: stopped after two of three.
    assert!(matches!(unpack(&StopAfter::steps(3)), Err(Error::Interrupted { .. })));
    assert_eq!(names(&images).len(), 3, "two images and what says so: {:?}", names(&images));
    let written = unpack(&NoProgress).unwrap();
    assert_eq!(names(&images), ["a.exr", "b.exr", "c.exr"]);
    assert!(written.iter().all(|path| path.exists()));
    let error = unpack(&NoProgress).unwrap_err().to_string();
    assert!(error.contains("exists already"), "{error}");
}

#[test]
fn a_file_cut_short_while_it_is_written_is_noticed() {
    struct Cuts(PathBuf);
    impl Progress for Cuts {
        fn begin(&self, _: &str, _: u64, _: &str) {}
        fn advance(&self, _: u64, _: u64, _: &str) {
            fs::File::options().write(true).open(&self.0).unwrap().set_len(9000).unwrap();
        }
        fn end(&self) {}
        fn note(&self, _: &str) {}
        fn interrupted(&self) -> bool {
            false
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltm");
    let cut = pipeline::render(room(), &path, &RenderOptions::default(), &Cuts(partial_path(&path)));
    let error = cut.unwrap_err().to_string();
    assert!(error.contains("another program changed its length"), "{error}");
    assert!(!path.exists());
    // The same command finds what was lost and makes it again.
    pipeline::render(room(), &path, &RenderOptions::default(), &NoProgress).unwrap();
    assert!(ltm::store::verify(&path, |_, _| true).unwrap().is_complete());
}

#[test]
fn a_merge_of_containers_takes_good_copies_and_refuses_contradictions() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let matrix = render(&folder, Precision::F32);
    pack(&matrix, &at("a.ltc"), &PackOptions::default(), &NoProgress).unwrap();
    let whole = fs::read(at("a.ltc")).unwrap();
    // Behind the header of 64 bytes stand the chunks.
    let mut broken = whole.clone();
    broken[100] ^= 1;
    fs::write(at("broken.ltc"), &broken).unwrap();
    let join = |parts: &[&str], go_on: bool| {
        let parts: Vec<PathBuf> = parts.iter().map(|name| at(name)).collect();
        let parts: Vec<&Path> = parts.iter().map(PathBuf::as_path).collect();
        merge(&parts, &at("all.ltc"), true, |_, _| go_on)
    };
    join(&["broken.ltc", "a.ltc"], true).unwrap();
    let merged = ContainerReader::open(&at("all.ltc")).unwrap();
    let single = ContainerReader::open(&at("a.ltc")).unwrap();
    for id in merged.job().shape.blocks() {
        assert_eq!(merged.read_block(id).unwrap(), single.read_block(id).unwrap());
    }
    assert!(matches!(join(&["broken.ltc"], true), Err(Error::Damaged { .. })));
    assert!(matches!(join(&["a.ltc"], false), Err(Error::Interrupted { .. })));
    // Also while the joined file is written, half of the steps.
    let before = names(folder.path());
    let stopped = merge(&[&at("a.ltc")], &at("stopped.ltc"), false, |done, all| done < all / 2 + 2);
    assert!(matches!(stopped, Err(Error::Interrupted { .. })), "{stopped:?}");
    assert_eq!(names(folder.path()), before);
    // Of the same job and settings, but with other bytes in one block.
    let writer = ContainerWriter::create(
        &at("other.ltc"),
        single.job(),
        ContainerOptions { report: single.report().clone(), ..ContainerOptions::default() },
    );
    let writer = writer.unwrap();
    for id in single.job().shape.blocks() {
        let mut block = single.read_block(id).unwrap();
        if id == BlockId(2) {
            block.left.iter_mut().for_each(|v| *v *= 2.0);
        }
        writer.write_block(id, &block, &single.block_report(id)).unwrap();
    }
    writer.finish().unwrap();
    let error = join(&["a.ltc", "other.ltc"], true).unwrap_err().to_string();
    assert!(error.contains("differs from that in"), "{error}");
}

#[test]
fn entries_that_cannot_be_computed_with_are_counted_and_said() {
    let folder = tempfile::tempdir().unwrap();
    let matrix = render(&folder, Precision::F32);
    let job = matrix.job();
    let pixel = |x, y, column| match (x, y, column) {
        (5, 0, 0) => [f32::NAN, 0.5, 0.5],
        (7, 0, 0) => [f32::INFINITY, 0.5, 0.5],
        (9, 0, 0) => [1e16, 0.5, 0.5],
        _ => [0.5; 3],
    };
    // One block.
    let source = MemoryMatrix::from_fn((32, 32), job.basis.clone(), pixel).unwrap();
    let watch = StopAfter::steps(1000);
    let path = folder.path().join("a.ltc");
    let report = pipeline::pack(&source, source.job(), &path, &PackOptions::default(), &watch).unwrap();
    assert_eq!((report.replaced.nan, report.replaced.huge), (1, 2));
    let said = watch.said.lock().unwrap();
    let line = said.iter().find(|line| line.contains("were replaced")).expect("a line says so");
    assert!(line.contains("3 entries") && line.contains("row 5"), "{line}");
}
