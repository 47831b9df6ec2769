//! Where a study works: its folder, its watch, and matrices that are rendered once and shared.

use std::fs;
use std::path::{Path, PathBuf};

use super::{CorpusOptions, StudyOptions, machine};
use ltm::error::{Error, Result};
use ltm::files::write_file;
use ltm::pipeline::{self, RenderOptions, job_of};
use ltm::resources::{Progress, SilentProgress};
use ltm::scene::{self, BuiltIn, LoadedScene};
use ltm::store::StoreReader;

/// The Conference Room with a panel: a scene that is not built in, but is measured where its files are.
pub(super) const CONFERENCE: &str = "conference";

/// Its scene files, by texels along a side of the panel.
const CONFERENCE_FILES: [(u32, &str); 2] = [
    (32, include_str!("../../../examples/scenes/conference-panel-32.toml")),
    (64, include_str!("../../../examples/scenes/conference-panel-64.toml")),
];

/// The Conference Room with its ceiling luminaires, one column each.
pub(super) const CONFERENCE_LAMPS: &str = "conference-24";
/// The same, seen from a corner.
pub(super) const CONFERENCE_CORNER: &str = "conference-24-corner";
/// The same, one luminaire replaced by a panel of texels.
pub(super) const CONFERENCE_PANEL: &str = "conference-panel";
/// Boxes and rooms that are files.
pub(super) const GLOSSY: &str = "cornell-glossy";
pub(super) const MIRROR: &str = "cornell-mirror";
pub(super) const WATER: &str = "cornell-water";
pub(super) const SHIRLEY: &str = "erw5-scene3";
pub(super) const CLASSROOM: &str = "erw5-scene8";
pub(super) const CORNELL: &str = "cornell-original";

/// Scene files by name. Lights of texels get as many as are wanted.
const FILES: [(&str, &str); 9] = [
    (CONFERENCE_LAMPS, include_str!("../../../examples/scenes/conference-24.toml")),
    (CONFERENCE_CORNER, include_str!("../../../examples/scenes/conference-24-corner.toml")),
    (CONFERENCE_PANEL, CONFERENCE_FILES[0].1),
    (GLOSSY, include_str!("../../../examples/scenes/cornell-glossy.toml")),
    (MIRROR, include_str!("../../../examples/scenes/cornell-mirror.toml")),
    (WATER, include_str!("../../../examples/scenes/cornell-water.toml")),
    (SHIRLEY, include_str!("../../../examples/scenes/erw5-scene3.toml")),
    (CLASSROOM, include_str!("../../../examples/scenes/erw5-scene8.toml")),
    (CORNELL, include_str!("../../../examples/scenes/cornell-original.toml")),
];

/// A scene file as it is published.
pub(super) fn scene_text(name: &str) -> &'static str {
    FILES.iter().find(|file| file.0 == name).map_or("", |file| file.1)
}

/// The place of one study.
pub(super) struct Bench<'a> {
    pub(super) out: PathBuf,
    pub(super) quick: bool,
    pub(super) watch: &'a dyn Progress,
    pub(super) corpus: CorpusOptions,
    study: &'static str,
}

/// A matrix of a built-in scene or of the Conference Room.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wanted {
    pub(super) scene: &'static str,
    pub(super) size: (u32, u32),
    pub(super) texels: u32,
    pub(super) samples: u32,
    pub(super) seed: u64,
    pub(super) block_side: u32,
}

impl<'a> Bench<'a> {
    pub(super) fn new(study: &'static str, options: &StudyOptions, watch: &'a dyn Progress) -> Result<Self> {
        let bench =
            Self { out: options.out.clone(), quick: options.quick, watch, corpus: options.corpus.clone(), study };
        bench.start_cache()?;
        Ok(bench)
    }

    /// What every table begins with.
    pub(super) fn notes(&self, more: &[&str]) -> Vec<String> {
        let quick = if self.quick { " --quick" } else { "" };
        let mut notes =
            vec![format!("Command: `ltm study {}{quick}`.", self.study), format!("Machine: {}.", machine::describe())];
        notes.extend(machine::commit().map(|commit| format!("Built from commit {commit}.")));
        notes.extend(more.iter().map(|note| (*note).to_owned()));
        notes
    }

    /// The caption under a chart: command and machine.
    pub(super) fn caption(&self, more: &str) -> String {
        let quick = if self.quick { " --quick" } else { "" };
        format!("ltm study {}{quick} · {more} · {}", self.study, machine::describe())
    }

    /// A file in the cache folder.
    pub(super) fn cached(&self, name: &str) -> PathBuf {
        self.out.join("cache").join(name)
    }

    /// A matrix, rendered now or by an earlier study with the same tracer.
    pub(super) fn matrix(&self, wanted: Wanted) -> Result<StoreReader> {
        self.rendered(&wanted.file_name(), self.loaded(wanted)?)
    }

    /// A matrix of a scene file that has this light alone, so that it gets all samples.
    pub(super) fn matrix_alone(&self, wanted: Wanted, light: &str) -> Result<StoreReader> {
        let loaded = self.file(wanted.scene, wanted.texels, Some(light))?;
        self.rendered(&format!("{light}-alone-{}", wanted.file_name()), wanted.applied_to(loaded))
    }

    /// A loaded scene's matrix, rendered now or by an earlier study with the same tracer.
    pub(super) fn rendered(&self, name: &str, loaded: LoadedScene) -> Result<StoreReader> {
        self.stop_if_interrupted()?;
        let path = self.cached(name);
        if let Ok(matrix) = StoreReader::open(&path)
            && matrix.job().hash() == job_of(&loaded)?.hash()
        {
            return Ok(matrix);
        }
        let mut options = RenderOptions::default();
        options.store.overwrite = true;
        pipeline::render(loaded, &path, &options, &self.silent())?;
        StoreReader::open(&path)
    }

    /// Errors: the user asked to stop.
    pub(super) fn stop_if_interrupted(&self) -> Result<()> {
        match self.watch.interrupted() {
            true => Err(Error::interrupted(format!("the study {} is not finished; its matrices are kept", self.study))),
            false => Ok(()),
        }
    }

    /// The scene of a matrix.
    pub(super) fn loaded(&self, wanted: Wanted) -> Result<LoadedScene> {
        let (width, height) = wanted.size;
        let loaded = match wanted.scene {
            CONFERENCE => self.conference(wanted.texels)?,
            name if FILES.iter().any(|file| file.0 == name) => self.file(name, wanted.texels, None)?,
            name => BuiltIn { width, height, texels: wanted.texels }.named(name)?,
        };
        Ok(wanted.applied_to(loaded))
    }

    /// Some scenes and, where its files are and in earnest, the Conference Room.
    pub(super) fn with_conference(&self, scenes: &[&'static str]) -> Vec<&'static str> {
        let there = !self.quick && self.conference(32).is_ok();
        scenes.iter().copied().chain(there.then_some(CONFERENCE)).collect()
    }

    /// Whether a scene is built in, or its files are there.
    pub(super) fn has(&self, name: &str) -> bool {
        !FILES.iter().any(|file| file.0 == name) || self.file(name, 16, None).is_ok()
    }

    /// A scene file with so many texels along the sides of its lights, and with all its lights or this one.
    fn file(&self, name: &str, texels: u32, only: Option<&str>) -> Result<LoadedScene> {
        let line = |line: &str| match (line.split_once(" = "), only) {
            (Some(("texels", _)), _) => format!("texels = [{texels}, {texels}]"),
            (Some(("material", _)), Some(light)) => format!("material = \"{light}\""),
            _ => line.to_owned(),
        };
        let text = match only {
            // A panel is no material: the lamps beside it go.
            Some(light) if scene_text(name).contains(&format!("name = \"{light}\"")) => {
                scene_text(name).replace("[[light]]\nmaterial = \"lum_*\"\n", "")
            }
            _ => scene_text(name).to_owned(),
        };
        let lines: Vec<String> = text.lines().map(line).collect();
        self.scene(&format!("{name}-{texels}-{}.toml", only.unwrap_or("all")), &lines.join("\n"))
    }

    fn conference(&self, texels: u32) -> Result<LoadedScene> {
        let Some((_, text)) = CONFERENCE_FILES.iter().find(|file| file.0 == texels) else {
            return Err(Error::input(
                CONFERENCE,
                format!("has no panel of {texels} × {texels} texels"),
                "take 32 or 64",
            ));
        };
        self.scene(&format!("conference-panel-{texels}.toml"), text)
    }

    /// Loads a scene file of this text, which is written beside the matrices.
    fn scene(&self, name: &str, text: &str) -> Result<LoadedScene> {
        let path = self.cached(name);
        write_file(&path, true, text.as_bytes())?;
        scene::load(&path)
    }

    /// A watch for jobs inside the study: their notes would drown its own.
    pub(super) fn silent(&self) -> SilentProgress<'_> {
        SilentProgress(self.watch)
    }

    /// What another build of the program compressed is not used: every number is of this one. Matrices that it rendered are, for their
    /// job names the version of the tracer ([`rendered`](Self::rendered)).
    fn start_cache(&self) -> Result<()> {
        let folder = self.out.join("cache");
        fs::create_dir_all(&folder).map_err(Error::io(&folder, "create the folder"))?;
        let mark = folder.join("made-by");
        let program = program_mark();
        if fs::read_to_string(&mark).is_ok_and(|text| text == program) {
            return Ok(());
        }
        for entry in fs::read_dir(&folder).map_err(Error::io(&folder, "list"))?.flatten() {
            let stale = |extension| matches!(extension, "ltc" | "rival" | "part");
            if entry.path().extension().and_then(|e| e.to_str()).is_some_and(stale) {
                fs::remove_file(entry.path()).map_err(Error::io(entry.path(), "remove"))?;
            }
        }
        write_file(&mark, true, program.as_bytes())
    }
}

/// Size and time of the running program.
fn program_mark() -> String {
    let metadata = std::env::current_exe().and_then(|path| path.metadata());
    metadata.map_or(String::new(), |m| format!("{} bytes, {:?}\n", m.len(), m.modified().ok()))
}

impl Wanted {
    /// A scene with the size and settings that are wanted.
    fn applied_to(self, loaded: LoadedScene) -> LoadedScene {
        let mut loaded = loaded.sized(self.size.0, self.size.1);
        loaded.settings.samples_per_pixel = self.samples;
        loaded.settings.seed = self.seed;
        loaded.settings.block_side = self.block_side;
        loaded
    }

    fn file_name(self) -> String {
        let Self { scene, size: (width, height), texels, samples, seed, block_side } = self;
        format!("{scene}-{width}x{height}-{texels}t-{samples}s-{seed}-{block_side}b.ltm")
    }
}

/// Bytes of a file.
pub(super) fn file_bytes(path: &Path) -> Result<u64> {
    Ok(fs::metadata(path).map_err(Error::io(path, "look at"))?.len())
}
