//! Another reader beside ours: every OBJ file of the cases that we read is read by tobj too. Where it reads another surface or
//! none, the reason stands here, and the test fails once it no longer holds.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use glam::Vec3;
use ltm::scene::{LoadOptions, Scene, load_with};

use super::obj;
use super::room::Folder;

/// What tobj makes of a file that we read.
#[derive(Clone, Debug, PartialEq)]
enum Reading {
    /// The same number of triangles, and the same area of each material.
    Same,
    /// Another surface.
    Differs(String),
    /// No surface: an error or a panic.
    Fails(String),
}

thread_local! {
    /// Of each file that is loaded on this thread; none while nobody asks.
    static READINGS: RefCell<Option<Vec<Reading>>> = const { RefCell::new(None) };
}

/// Compares a scene of one OBJ file, where that is asked for.
pub(super) fn note(path: &Path, scene: &Scene) {
    READINGS.with_borrow_mut(|readings| {
        if let Some(readings) = readings.as_mut().filter(|_| path.exists()) {
            readings.push(reading(path, scene));
        }
    });
}

/// Number of triangles that have an area, and the areas of the materials, in order.
type Surface = (usize, Vec<f64>);

fn surface<M: Ord>(triangles: impl Iterator<Item = (M, [Vec3; 3])>) -> Surface {
    let (mut count, mut areas) = (0, BTreeMap::new());
    for (material, [a, b, c]) in triangles {
        let [a, b, c] = [a, b, c].map(Vec3::as_dvec3);
        let area = 0.5 * (b - a).cross(c - a).length();
        if area > 0.0 {
            count += 1;
            *areas.entry(material).or_insert(0.0) += area;
        }
    }
    let mut areas: Vec<f64> = areas.into_values().collect();
    areas.sort_by(f64::total_cmp);
    (count, areas)
}

fn reading(path: &Path, scene: &Scene) -> Reading {
    let ours = surface(scene.mesh.triangles.iter().map(|t| (t.material.0, scene.mesh.corners(t))));
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    let models = match catch_unwind(AssertUnwindSafe(|| tobj::load_obj(path, &options))) {
        Ok(Ok((models, _))) => models,
        Ok(Err(error)) => return Reading::Fails(error.to_string()),
        Err(_) => return Reading::Fails("a panic".into()),
    };
    let theirs = surface(models.iter().flat_map(|model| {
        let mesh = &model.mesh;
        let at = |i: u32| Vec3::from_slice(&mesh.positions[3 * i as usize..][..3]);
        mesh.indices.chunks_exact(3).map(move |t| (mesh.material_id, [at(t[0]), at(t[1]), at(t[2])]))
    }));
    // Both sum what f32 holds.
    let near = |(a, b): (&f64, &f64)| (a / b - 1.0).abs() < 1e-4;
    let is_same = ours.0 == theirs.0 && ours.1.len() == theirs.1.len() && ours.1.iter().zip(&theirs.1).all(near);
    if is_same { Reading::Same } else { Reading::Differs(format!("{ours:?}, by tobj {theirs:?}")) }
}

/// Inputs of which tobj makes something else or nothing, and why; the rows of `obj::CASES` and their likes.
const OWN: &[(&str, &str)] = &[
    ("lines that end with CR, LF or both", "ends lines at LF alone: all of a file with CR is one line"),
    ("a byte order mark of UTF-8", "takes the mark for a part of the first word, here `mtllib`"),
    ("names in Latin-1", "reads UTF-8 alone"),
    (
        r"lines continued by `\`, negative indices, `f 1// 2//`",
        "knows no lines that go on, and no empty index before or behind `/`",
    ),
    ("concave polygons", "cuts every polygon as a fan, which leaves a concave one"),
    ("polygons that cross themselves", "cuts them as a fan as well, in halves of which one lies over the other"),
    ("faces of one or two corners", "gives the file up"),
    ("vertex 0, or one that is not there", "gives the file up"),
    ("vertices that are no numbers", "gives the file up"),
    ("normals that are no numbers", "gives the file up"),
    ("decimal commas", "gives the file up"),
    ("`mtllib` of several files", "takes the line for one name with blanks"),
    (
        "`mtllib` of names with blanks, bare, escaped or in quotation marks",
        r"keeps quotation marks and `\` as parts of the name",
    ),
    (
        "`mtllib` of a folder that is not there",
        "looks nowhere else, and faces of materials without description have none",
    ),
];

/// The same of the collections' files, by folder and name.
const FILES: &[(&str, &str)] = &[
    ("30-obj-tinyobj/issue-140-zero-face-idx.obj", "gives up a file with vertex 0"),
    ("30-obj-tinyobj/test-nan.obj", "gives up a file with vertices that are no numbers"),
    ("31-obj-quirks/bom.obj", "takes the byte order mark for a part of the first word"),
    ("31-obj-quirks/bom_obj_only.obj", "takes the byte order mark for a part of the first word"),
    ("31-obj-quirks/comma_decimal.obj", "gives up a file with decimal commas"),
    ("31-obj-quirks/concave0.obj", "cuts concave polygons as fans"),
    ("31-obj-quirks/concave3.obj", "cuts concave polygons as fans"),
    ("31-obj-quirks/concave5.obj", "cuts concave polygons as fans"),
    ("31-obj-quirks/cr.obj", "ends lines at LF alone"),
    ("31-obj-quirks/ind_normal.obj", "gives up a file with normals that are no numbers"),
    ("31-obj-quirks/kd_empty.obj", "gives up a material file with a statement without values"),
    ("31-obj-quirks/kd_spectral.obj", "gives up a material file with `Kd xyz`"),
    ("31-obj-quirks/missing_mtl.obj", "has no materials without their file"),
    ("31-obj-quirks/mtldot.obj", r"takes `.\` for a part of the name of the material file"),
    ("31-obj-quirks/mtlquote.obj", "takes quotation marks for parts of the name of the material file"),
    ("31-obj-quirks/negative_cont.obj", "knows no lines that go on"),
    ("31-obj-quirks/survey_far.obj", "keeps coordinates in f32"),
    ("33-survey-coordinates/survey_far.obj", "keeps coordinates in f32"),
];

/// Holds what was read against the reasons. Every input without a reason is read alike, and every reason is met.
fn hold(found: &BTreeMap<String, Vec<Reading>>, reasons: &[(&str, &str)]) {
    let reasons: BTreeMap<&str, &str> = reasons.iter().copied().collect();
    let others = |readings: &[Reading]| {
        readings.iter().filter(|reading| **reading != Reading::Same).cloned().collect::<Vec<_>>()
    };
    let mut wrong = Vec::new();
    for (input, readings) in found {
        let others = others(readings);
        match (others.is_empty(), reasons.get(input.as_str())) {
            (false, None) => wrong.push(format!("{input}: tobj reads it otherwise: {others:?}")),
            (true, Some(reason)) => wrong.push(format!("{input}: tobj reads it as we do, in spite of: {reason}")),
            _ => {}
        }
    }
    let known: BTreeSet<&str> = found.keys().map(String::as_str).collect();
    wrong.extend(reasons.keys().filter(|input| !known.contains(*input)).map(|input| format!("{input}: no such input")));
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

/// Every OBJ file that the cases write.
pub(super) fn own_files() {
    let mut found = BTreeMap::new();
    for case in obj::CASES {
        READINGS.set(Some(Vec::new()));
        (case.test)();
        let readings = READINGS.take().expect("they were asked for");
        if !readings.is_empty() {
            found.insert(case.input.to_owned(), readings);
        }
    }
    assert!(found.len() > 15, "{found:?}");
    hold(&found, OWN);
}

/// Every OBJ file below the folder of the collections that we read.
pub(super) fn files_of_collections(root: &Path) {
    let mut found = BTreeMap::new();
    for path in objects(root) {
        let folder = path.parent().expect("a folder");
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        let copy = Folder::copy_of(folder).with("seen by all.toml", obj::seen_by_all(&name));
        let options = LoadOptions { allow_missing: true, allow_outside: true, ..Default::default() };
        // What we refuse has tests of its own.
        if let Ok(loaded) = load_with(&copy.path("seen by all.toml"), options) {
            let input = path.strip_prefix(root).expect("within it").to_string_lossy().into_owned();
            found.insert(input, vec![reading(&copy.path(&name), &loaded.scene)]);
        }
    }
    assert!(found.len() > 40, "{:?}", found.keys());
    hold(&found, FILES);
}

fn objects(folder: &Path) -> Vec<PathBuf> {
    let (mut found, mut left) = (Vec::new(), vec![folder.to_owned()]);
    while let Some(folder) = left.pop() {
        for entry in std::fs::read_dir(&folder).expect("the folder") {
            let path = entry.expect("an entry").path();
            match path.is_dir() {
                true => left.push(path),
                false if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj")) => found.push(path),
                false => {}
            }
        }
    }
    found.sort();
    found
}
