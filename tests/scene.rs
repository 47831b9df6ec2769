//! Scenes: what files make of them, and what is refused. Real scenes are read where `LTM_SCENES` names their folder;
//! elsewhere those tests are listed as ignored, and so is that of glTF samples without `LTM_GLTF_SAMPLES`.

#[path = "scene/bad.rs"]
mod bad;
#[path = "scene/cameras.rs"]
mod cameras;
#[path = "scene/files.rs"]
mod files;
#[path = "scene/glb.rs"]
mod glb;
#[path = "scene/gltf.rs"]
mod gltf;
#[path = "scene/gltf_bad.rs"]
mod gltf_bad;
#[path = "scene/gltf_materials.rs"]
mod gltf_materials;
#[path = "scene/gltf_reference.rs"]
mod gltf_reference;
#[path = "scene/gltf_samples.rs"]
mod gltf_samples;
#[path = "scene/gltf_sky.rs"]
mod gltf_sky;
#[path = "scene/real.rs"]
mod real;
#[path = "transport/z_test.rs"]
mod z_test;

use std::path::PathBuf;
use std::process::ExitCode;

use libtest_mimic::{Arguments, Trial};

/// A folder of small scene files that is deleted at the end.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    fn with(self, name: &str, content: impl AsRef<[u8]>) -> Self {
        std::fs::write(self.path(name), content).expect("a temporary file");
        self
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn load(&self) -> ltm::Result<ltm::scene::LoadedScene> {
        ltm::scene::load(&self.path("scene.toml"))
    }
}

/// A floor and a lamp of 2 × 1 above it that faces down, without normals or texture coordinates.
const ROOM_OBJ: &str = "mtllib room.mtl
v -5 0 -5\nv -5 0 5\nv 5 0 5\nv 5 0 -5
v -1 3 0\nv 1 3 0\nv 1 3 1\nv -1 3 1
o floor\nusemtl ground\nf 1 2 3 4
o bulb\nusemtl lamp\nf 5 6 7 8
";

const ROOM_MTL: &str = "newmtl ground\nKd 0.5 0.4 0.3\nnewmtl lamp\nKd 0 0 0\nKe 3 2 1\n";

const ROOM_TOML: &str = "geometry = [\"room.obj\"]\n[camera]\neye = [0, 1, 4]\nlook_at = [0, 1, 0]\n";

/// The room with text behind its scene file.
fn room(more: &str) -> Folder {
    let folder = Folder::new().with("room.obj", ROOM_OBJ).with("room.mtl", ROOM_MTL);
    folder.with("scene.toml", format!("{ROOM_TOML}{more}"))
}

fn trial(name: &str, test: fn()) -> Trial {
    Trial::test(name, move || {
        test();
        Ok(())
    })
}

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let mut trials: Vec<Trial> = Vec::new();
    let of_gltf = gltf::TESTS
        .iter()
        .chain(gltf_materials::TESTS)
        .chain(gltf_bad::TESTS)
        .chain(gltf_sky::TESTS)
        .chain(gltf_reference::TESTS);
    for (name, test) in files::TESTS.iter().chain(cameras::TESTS).chain(bad::TESTS).chain(of_gltf) {
        trials.push(trial(name, *test));
    }
    let without_folder = std::env::var_os("LTM_SCENES").is_none();
    for (name, test) in real::TESTS {
        trials.push(trial(name, *test).with_ignored_flag(without_folder));
    }
    let without_samples = std::env::var_os("LTM_GLTF_SAMPLES").is_none();
    for (name, test) in gltf_samples::TESTS {
        trials.push(trial(name, *test).with_ignored_flag(without_samples));
    }
    libtest_mimic::run(&arguments, trials).exit_code()
}
