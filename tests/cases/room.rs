//! A floor under a lamp, as files say it in many ways, and what is seen of it.

use std::path::{Path, PathBuf};

use ltm::matrix::{BlockSource, MatrixShape, TracedBlock};
use ltm::scene::{LoadedScene, MaterialId, Scene, load};
use ltm::trace::{TraceSettings, Tracer};

use super::reference;

/// The floor under the lamp by the solid angle of the lamp: `Kd · L · F` with the configuration factor of four rectangles of 1 by 1
/// at a distance of 3, and `Kd` 0.5, `L` 10.
pub(super) fn floor() -> f64 {
    let (a, b) = (1.0f64 / 3.0, 1.0f64 / 3.0);
    let part = |a: f64, b: f64| a / a.hypot(1.0) * (b / a.hypot(1.0)).atan();
    let quarter = (part(a, b) + part(b, a)) / (2.0 * std::f64::consts::PI);
    0.5 * 10.0 * 4.0 * quarter
}

/// Vertices of a floor of 10 by 10 and of a lamp of 2 by 2 at a height of 3.
pub(super) const VERTICES: &str = "v -5 0 -5\nv 5 0 -5\nv 5 0 5\nv -5 0 5\nv -1 3 -1\nv 1 3 -1\nv 1 3 1\nv -1 3 1\n";
/// The floor faces up, the lamp down.
pub(super) const FACES: &str = "usemtl grey\nf 1 4 3 2\nusemtl panel\nf 5 6 7 8\n";
pub(super) const MATERIALS: &str = "newmtl grey\nKd 0.5 0.5 0.5\n\nnewmtl panel\nKd 0 0 0\nKe 10 10 10\n";

const CAMERA: &str = "geometry = [\"room.obj\"]\n[camera]\neye = [0.05, 2.9, 0.05]\nlook_at = [0, 0, 0]\nup = [0, 0, -1]\n\
    vertical_fov_degrees = 2\nwidth = 4\nheight = 4\n";

/// A folder of small scene files that is deleted at the end.
pub(super) struct Folder(tempfile::TempDir);

impl Folder {
    pub(super) fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    /// The plain room.
    pub(super) fn room() -> Self {
        let obj = format!("mtllib room.mtl\n{VERTICES}{FACES}");
        Self::new().with("room.obj", obj).with("room.mtl", MATERIALS).with("scene.toml", CAMERA)
    }

    /// The files of another folder and of those within it.
    pub(super) fn copy_of(other: &Path) -> Self {
        let mut folder = Self::new();
        let mut left = vec![other.to_owned()];
        while let Some(inner) = left.pop() {
            for entry in std::fs::read_dir(inner).expect("the folder") {
                let path = entry.expect("an entry").path();
                if path.is_dir() {
                    left.push(path);
                    continue;
                }
                let name = path.strip_prefix(other).expect("within it").to_string_lossy().into_owned();
                folder = folder.with(&name, std::fs::read(&path).expect("a file"));
            }
        }
        folder
    }

    /// The room with other geometry, whose material file is `room.mtl`.
    pub(super) fn of_obj(obj: impl AsRef<[u8]>) -> Self {
        Self::room().with("room.obj", obj)
    }

    /// The room with other materials.
    pub(super) fn of_mtl(mtl: impl AsRef<[u8]>) -> Self {
        Self::room().with("room.mtl", mtl)
    }

    /// The room with more behind its scene file.
    pub(super) fn scene(self, more: &str) -> Self {
        self.with("scene.toml", format!("{CAMERA}{more}"))
    }

    pub(super) fn with(self, name: &str, content: impl AsRef<[u8]>) -> Self {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a temporary folder");
        std::fs::write(path, content).expect("a temporary file");
        self
    }

    /// An image of one colour, of 188 of 255 in sRGB, which is a half.
    pub(super) fn with_grey(self, name: &str) -> Self {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a temporary folder");
        image::RgbImage::from_pixel(2, 2, image::Rgb([188; 3])).save(path).expect("a temporary image");
        self
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(super) fn load(&self) -> ltm::Result<LoadedScene> {
        let loaded = load(&self.path("scene.toml"))?;
        reference::note(&self.path("room.obj"), &loaded.scene);
        Ok(loaded)
    }

    /// What is loaded, and that no line or one line with these parts in it says something about it.
    pub(super) fn loads(&self, parts: &[&str]) -> LoadedScene {
        let loaded = self.load().unwrap_or_else(|error| panic!("{error}"));
        let count = usize::from(!parts.is_empty());
        assert_eq!(loaded.warnings.len(), count, "{:?}", loaded.warnings);
        for part in parts {
            assert!(loaded.warnings[0].text.contains(part), "no \"{part}\" in {:?}", loaded.warnings);
        }
        loaded
    }

    /// That the floor has its right value, within noise, and that these parts of one line are said.
    pub(super) fn shows(&self, share: f64, parts: &[&str]) {
        let found = seen(self.loads(parts).scene);
        // 256 samples of a lamp that is seen whole: the noise is below 1 %.
        assert!((found[0] / (floor() * share) - 1.0).abs() < 0.02, "{found:?} for {}", floor() * share);
    }

    /// That the file is refused in a line with these parts in it.
    pub(super) fn refused(&self, parts: &[&str]) {
        let error = self.load().expect_err("it is refused").to_string();
        assert!(!error.contains('\n'), "{error}");
        for part in parts {
            assert!(error.contains(part), "no \"{part}\" in {error}");
        }
    }
}

/// The mean of the picture under the scene's own light, by channel.
pub(super) fn seen(scene: Scene) -> [f64; 3] {
    let (width, height) = (scene.camera.width, scene.camera.height);
    let weights = scene.basis.scene_weights();
    let shape = MatrixShape::new(width, height, scene.basis.column_count() as u32, 32).expect("a shape");
    let settings = TraceSettings { samples_per_pixel: 256, seed: 1, max_depth: 4 };
    let tracer = Tracer::new(scene, shape, settings).expect("a tracer");
    let mut sums = [0.0; 3];
    for id in tracer.shape().blocks() {
        let mut traced = TracedBlock::default();
        tracer.trace_block(id, &mut traced);
        let view = traced.block.view();
        for (column, weight) in weights.iter().enumerate() {
            for row in 0..view.rows() {
                let channel = row / (view.rows() / 3);
                sums[channel] += f64::from(view.at(row, column) * weight[channel]);
            }
        }
    }
    sums.map(|sum| sum / f64::from(width * height))
}

/// Area of what has a material, by the names of a scene's materials.
pub(super) fn area_of(scene: &Scene, name: &str) -> f32 {
    let named = |id: MaterialId| scene.materials[id.0 as usize].name == name;
    let triangles = scene.mesh.triangles.iter().filter(|t| named(t.material));
    triangles.map(|t| scene.mesh.corners(t)).map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum()
}

/// The OBJ files of a folder, in the order of their names.
pub(super) fn files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("the folder");
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).collect();
    files.retain(|path| path.extension().is_some_and(|found| found == ending));
    files.sort();
    files
}
