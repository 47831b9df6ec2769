//! A room of one floor and one lamp above it, small enough for tests.

use std::fs;
use std::path::Path;

/// The lamp has texture coordinates, by which it can be cut into texels.
const OBJ: &str = "mtllib room.mtl
v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1
v -0.5 2 -0.5\nv 0.5 2 -0.5\nv 0.5 2 0.5\nv -0.5 2 0.5
vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1
usemtl floor\nf 4 3 2 1
usemtl lamp\nf 5/1 6/2 7/3 8/4
";

const MTL: &str = "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 3 2 1\n";

/// The scene file's beginning: 40 × 24 pixels.
const SCENE: &str = r#"
geometry = ["room.obj"]

[camera]
eye = [0.0, 1.0, 3.0]
look_at = [0.0, 0.5, 0.0]
vertical_fov_degrees = 50.0
width = 40
height = 24

"#;

/// Writes `room.toml` with what it says of samples and lights, and its geometry.
pub(crate) fn write_room(folder: &Path, rest: &str) {
    for (name, text) in [("room.obj", OBJ), ("room.mtl", MTL), ("room.toml", &format!("{SCENE}{rest}"))] {
        fs::write(folder.join(name), text).unwrap();
    }
}
