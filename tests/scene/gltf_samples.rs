//! glTF files that others made, in the folder that `LTM_GLTF_SAMPLES` names: every one is rendered under a white sky, or refused
//! for the reason that is listed. Tried with the models of Debian's package
//! `assimp-testmodels`, many of them Khronos's samples, and of the crate `easy-gltf`.

use std::path::{Path, PathBuf};

use ltm::light::LightKind;
use ltm::matrix::{BlockId, MatrixShape, TracedBlock};
use ltm::scene::{LoadOptions, load_with, survey};
use ltm::trace::{TraceSettings, Tracer};

pub(super) const TESTS: &[(&str, fn())] = &[("sample_files_are_rendered_or_refused_for_a_reason", sample_files)];

/// What is refused: the end of a file's path, and what the one line says.
const REFUSED: &[(&str, &str)] = &[
    // glTF 1.
    ("glTF/BoxTextured-glTF/BoxTextured.gltf", "another version than 2"),
    ("glTF/BoxTextured-glTF-Binary/BoxTextured.glb", "version 1"),
    ("glTF/BoxTextured-glTF-Embedded/BoxTextured.gltf", "another version than 2"),
    ("glTF/BoxTextured-glTF-MaterialsCommon/BoxTextured.gltf", "another version than 2"),
    ("glTF/CesiumMilkTruck/CesiumMilkTruck.gltf", "another version than 2"),
    ("glTF/IncorrectVertexArrays/Cube_v1.gltf", "another version than 2"),
    ("glTF/TwoBoxes/TwoBoxes.gltf", "another version than 2"),
    // Required extensions that are not read.
    ("glTF2/BoxTextured-glTF-techniqueWebGL/BoxTextured.gltf", "KHR_technique_webgl"),
    // Points and lines.
    ("Mesh_PrimitiveMode/Mesh_PrimitiveMode_00.gltf", "no triangles"),
    ("Mesh_PrimitiveMode/Mesh_PrimitiveMode_01.gltf", "no triangles"),
    ("Mesh_PrimitiveMode/Mesh_PrimitiveMode_02.gltf", "no triangles"),
    ("Mesh_PrimitiveMode/Mesh_PrimitiveMode_03.gltf", "no triangles"),
    ("Mesh_PrimitiveMode/Mesh_PrimitiveMode_07.gltf", "no triangles"),
    ("Mesh_PrimitiveMode/Mesh_PrimitiveMode_08.gltf", "no triangles"),
    ("Mesh_PrimitiveMode/Mesh_PrimitiveMode_09.gltf", "no triangles"),
    ("Mesh_PrimitiveMode/Mesh_PrimitiveMode_10.gltf", "no triangles"),
    // Made to be wrong.
    ("glTF2/BoxWithInfinites-glTF-Binary/BoxWithInfinites.glb", "position 0 is not finite"),
    ("glTF2/IndexOutOfRange/AllIndicesOutOfRange.gltf", "asks for vertex 65535 of 24"),
    ("glTF2/IndexOutOfRange/IndexOutOfRange.gltf", "asks for vertex 255 of 24"),
    ("glTF2/MissingBin/BoxTextured.gltf", "missing"),
    ("glTF2/RecursiveNodes/RecursiveNodes.gltf", "reached twice"),
    ("glTF2/SchemaFailures/sceneWrongType.gltf", "scene: is no index"),
    ("glTF2/TestNoRootNode/NoScene.gltf", "scenes[0] is not there"),
    // A scene without nodes shows nothing.
    ("glTF2/TestNoRootNode/SceneWithoutNodes.gltf", "no triangles"),
    ("glTF2/wrongTypes/badArray.gltf", "meshes[0].primitives: is no list"),
    ("glTF2/wrongTypes/badExtension.gltf", "KHR_texture_transform: is no object"),
    ("glTF2/wrongTypes/badObject.gltf", "pbrMetallicRoughness: is no object"),
    ("glTF2/wrongTypes/badUint.gltf", "baseColorTexture.index: is no index"),
];

/// All glTF files below a folder.
fn files_below(folder: &Path) -> Vec<PathBuf> {
    let (mut found, mut folders) = (Vec::new(), vec![folder.to_owned()]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gltf") || e.eq_ignore_ascii_case("glb"))
            {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// Renders a file, as its own camera or one from above sees it, under a white sky; the mean of the sky's column.
fn mean_under_a_sky(path: &Path) -> ltm::Result<f64> {
    let camera = survey(path, &LoadOptions { allow_missing: true, ..Default::default() })?.scene.camera;
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    let text = format!(
        "geometry = [{path:?}]\n[camera]\neye = {:?}\ndirection = {:?}\nup = {:?}\nwidth = 16\nheight = 16\n\
         vertical_fov_degrees = {}\n[[light]]\nkind = \"environment\"\ntexels = [1, 1]\n",
        camera.eye.to_array(),
        camera.forward.to_array(),
        camera.up.to_array(),
        camera.vertical_fov_radians().unwrap_or(1.0).to_degrees(),
    );
    std::fs::write(&scene, text).unwrap();
    let options = LoadOptions { allow_missing: true, allow_outside: true, ..Default::default() };
    let loaded = load_with(&scene, options)?;
    let lights = loaded.scene.basis.lights();
    let sky = lights.iter().find(|light| matches!(light.kind, LightKind::LatLong { .. })).expect("the sky");
    let column = sky.first_column as usize;
    let shape = MatrixShape::new(16, 16, loaded.scene.basis.column_count() as u32, 16)?;
    let settings = TraceSettings { samples_per_pixel: 4, seed: 1, max_depth: 6 };
    let mut traced = TracedBlock::default();
    Tracer::new(loaded.scene, shape, settings)?.trace_block(BlockId(0), &mut traced);
    let rows = traced.block.rows();
    let entries = &traced.block.entries()[column * rows..][..rows];
    Ok(entries.iter().map(|&entry| f64::from(entry)).sum::<f64>() / rows as f64)
}

fn sample_files() {
    let folder = PathBuf::from(std::env::var_os("LTM_GLTF_SAMPLES").expect("the test is ignored without it"));
    let files = files_below(&folder);
    assert!(!files.is_empty(), "{} has no glTF files", folder.display());
    let mut wrong = Vec::new();
    for path in &files {
        let reason = REFUSED.iter().find(|(end, _)| path.ends_with(end)).map(|(_, reason)| *reason);
        match (mean_under_a_sky(path), reason) {
            // Something is in view and reflects, no more than comes; glints of polished metal average out above 1.
            (Ok(mean), None) if mean > 0.02 && mean < 1.1 => {}
            (Ok(mean), None) => wrong.push(format!("{}: a mean of {mean} under a sky of 1", path.display())),
            (Ok(_), Some(reason)) => wrong.push(format!("{}: was read; '{reason}' was expected", path.display())),
            (Err(error), Some(reason)) if error.to_string().contains(reason) => {}
            (Err(error), _) => wrong.push(error.to_string()),
        }
    }
    assert!(wrong.is_empty(), "of {} files:\n{}", files.len(), wrong.join("\n"));
}
