//! Scenes as people have them: an OBJ file, its materials and a scene file, in a folder of their own.

use std::fmt::Write as _;
use std::path::Path;

use glam::DVec3;
use ltm::image::LinearImage;
use ltm::light::Lighting;
use ltm::matrix::MatrixShape;
use ltm::scene::LoadedScene;
use ltm::trace::{TraceSettings, Tracer};

/// A folder with a scene in it.
pub(super) struct Scene {
    folder: tempfile::TempDir,
    vertices: String,
    faces: String,
    count: usize,
    /// What is added to every place.
    pub(super) offset: DVec3,
    /// What every place is multiplied by, before.
    pub(super) scale: f64,
}

/// Materials that the scenes have: a grey floor, a black lamp of radiance 1, and others.
const MATERIALS: &str = "newmtl grey\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 1 1 1\nnewmtl white\nKd 0.9 0.9 0.9\n\
    newmtl black\nKd 0 0 0\nnewmtl mirror\nKd 0 0 0\nKs 1 1 1\nillum 3\n";

impl Scene {
    pub(super) fn new(offset: DVec3) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.mtl"), MATERIALS).unwrap();
        Self { folder, vertices: String::new(), faces: String::new(), count: 0, offset, scale: 1.0 }
    }

    fn moved(&self, place: DVec3) -> DVec3 {
        place * self.scale + self.offset
    }

    /// Adds faces of one material, whose corners run counter-clockwise as seen from the front.
    pub(super) fn add(&mut self, material: &str, faces: &[Vec<DVec3>]) {
        writeln!(self.faces, "usemtl {material}").unwrap();
        for face in faces {
            self.faces.push('f');
            for &corner in face {
                let DVec3 { x, y, z } = self.moved(corner);
                writeln!(self.vertices, "v {x} {y} {z}").unwrap();
                self.count += 1;
                write!(self.faces, " {}", self.count).unwrap();
            }
            self.faces.push('\n');
        }
    }

    /// Writes and loads it, seen from `eye` towards `at`, with more text in the scene file.
    pub(super) fn load(&self, (eye, at): (DVec3, DVec3), degrees: f64, side: u32, more: &str) -> LoadedScene {
        let text = format!("mtllib a.mtl\n{}{}", self.vertices, self.faces);
        std::fs::write(self.folder.path().join("a.obj"), text).unwrap();
        let direction = (at - eye).normalize().to_array();
        let up = if direction[1].abs() > 0.9 { [0.0, 0.0, -1.0] } else { [0.0, 1.0, 0.0] };
        let eye = self.moved(eye).to_array();
        let text = format!(
            "geometry = [\"a.obj\"]\n[camera]\neye = {eye:?}\ndirection = {direction:?}\nup = {up:?}\n\
            vertical_fov_degrees = {degrees:?}\nwidth = {side}\nheight = {side}\n{more}"
        );
        let path = self.folder.path().join("a.toml");
        std::fs::write(&path, text).unwrap();
        load(&path)
    }

    /// A place as a scene file states it.
    pub(super) fn place(&self, place: DVec3) -> String {
        format!("{:?}", self.moved(place).to_array())
    }
}

pub(super) fn load(path: &Path) -> LoadedScene {
    ltm::scene::load(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// A parallelogram cut into `cuts × cuts`, seen from the side of `u × v`.
pub(super) fn quad(origin: DVec3, u: DVec3, v: DVec3, cuts: u32) -> Vec<Vec<DVec3>> {
    let at = |i: u32, j: u32| origin + u * (f64::from(i) / f64::from(cuts)) + v * (f64::from(j) / f64::from(cuts));
    let face = |k: u32| {
        let (i, j) = (k % cuts, k / cuts);
        vec![at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]
    };
    (0..cuts * cuts).map(face).collect()
}

/// The picture of a scene in its own light.
pub(super) fn rendered(loaded: &LoadedScene, samples_per_pixel: u32, max_depth: u32) -> LinearImage {
    let scene = loaded.scene.clone();
    let (width, height) = (scene.camera.width, scene.camera.height);
    let shape = MatrixShape::new(width, height, scene.basis.column_count() as u32, 32).unwrap();
    let lighting = Lighting::of_scene(&scene.basis);
    let settings = TraceSettings { samples_per_pixel, seed: 7, max_depth };
    let tracer = Tracer::new(scene, shape, settings).unwrap();
    let pixels = tracer.trace_image(lighting.weights(), || false).unwrap();
    LinearImage { width, height, pixels }
}
