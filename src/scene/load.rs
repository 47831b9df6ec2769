//! From a scene file to a scene that can be traced.

use std::ffi::OsStr;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::assembly::Assembly;
use super::camera_entry;
use super::file::{self, CameraEntry, GridEntry, LightEntry, LightEntryKind, MaterialEntry, RenderEntry, SceneFile};
use super::folders::Folders;
use super::gltf::{FileCamera, is_gltf, seeing_all};
use super::lights::LightBuilder;
use super::loaded::{listed, position_of_camera};
use super::memory::MemoryBound;
use super::resolve_materials::{Decided, MaterialResolver};
use super::source::{Description, Geometry, SourceMaterial};
use super::textures::Textures;
use super::{Camera, LoadedScene, NamedCamera, RenderSettings, Scene, Sensors, names, sensors, validate};
use crate::error::{Error, Hint, Result, Warning, Warnings};
use crate::files::read_input_text;
use crate::light::names::fits;
use crate::matrix::MatrixShape;

/// Bytes of a scene file at most.
const MAX_TEXT_BYTES: u64 = 64 << 20;
/// Size of a block in f32 above which a warning is given, in bytes.
const LARGE_BLOCK_BYTES: u64 = 1 << 30;

/// Reads a scene file (TOML, or glTF with its own camera and lights; see `formats/scene.md`) and everything that it names, and checks the result.
///
/// Relative paths are looked up beside the scene file, then in the folder that `LTM_SCENES` names; files elsewhere are refused.
/// What can be mended is mended and becomes a warning.
///
/// # Errors
/// One line that names the file and what is wrong in it. No error quotes what stands in a file that the scene names.
pub fn load(path: &Path) -> Result<LoadedScene> {
    load_with(path, LoadOptions::default())
}

/// Whether a file is a scene by its name: a scene file, glTF, or OBJ.
pub fn is_scene_file(path: &Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default().to_ascii_lowercase();
    ["toml", "glb", "gltf", "obj"].contains(&&*extension)
}

/// The names of the `[[grid]]` entries of a scene file, and whether it has a camera. A glTF file has no grids.
///
/// # Errors
/// The file cannot be read or is no scene file.
pub fn grid_names(path: &Path) -> Result<(Vec<String>, bool)> {
    if is_gltf(path) {
        return Ok((Vec::new(), true));
    }
    let file = file::parse(path, &read_input_text(path, "read the scene", MAX_TEXT_BYTES)?)?;
    Ok((file.grid.into_iter().map(|grid| grid.name).collect(), file.camera.is_some()))
}

/// Texels of the sky over a scene without lights: enough to turn it and to put a sun into it.
const EVEN_SKY_TEXELS: [u32; 2] = [16, 8];

/// What a scene is allowed to lack, to read and to take.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LoadOptions {
    /// Whether texture files that materials name may be missing: the materials' colours stand for them, with a warning.
    pub allow_missing: bool,
    /// Whether files may be read that lie neither in the scene's folder nor in that of `LTM_SCENES`: a scene of someone else
    /// could name any.
    pub allow_outside: bool,
    /// Memory that geometry, textures and maps stay within, with what reading them takes; none: any amount.
    pub memory_bytes: Option<u64>,
    /// Which `[[grid]]` of a scene file stands for its camera, by name; none: the camera, or the first grid where there is none.
    pub grid: Option<String>,
    /// Which camera of a glTF file is used, by the name of its node or its own; none: the first.
    pub camera: Option<String>,
}

/// As [`load`], with options.
///
/// # Errors
/// Those of [`load`]; [`Error::Resources`] where the memory is too small.
pub fn load_with(path: &Path, options: LoadOptions) -> Result<LoadedScene> {
    let Unchecked { scene, settings, cameras, mut warnings } = put_together(path, &options)?;
    warnings.extend(check_whole(path, &scene).map_err(|error| with_missing(error, &warnings))?);
    // Tracing and compressing hold whole blocks, one for each worker.
    let block_bytes = u64::from(settings.block_side).pow(2) * 3 * 4 * scene.basis.column_count() as u64;
    if block_bytes > LARGE_BLOCK_BYTES {
        let (side, columns) = (settings.block_side, scene.basis.column_count());
        let gib = block_bytes as f64 / (1u64 << 30) as f64;
        warnings.push(format!(
            "a block of {side} × {side} pixels under {columns} columns takes {gib:.1} GiB; a smaller block_side takes less"
        ));
    }
    Ok(LoadedScene { cameras, ..LoadedScene::new(scene, settings, warnings) })
}

/// The error with the line of what is missing, which may be why: the lamps of an OBJ file are in its material file.
fn with_missing(error: Error, warnings: &[Warning]) -> Error {
    let is_missing = |text: &str| text.contains("the material file") && text.contains("missing");
    let missing = warnings.iter().map(|warning| &warning.text).find(|text| is_missing(text));
    match (error, missing) {
        (Error::Input { place, problem, hint }, Some(line)) => Error::input(place, format!("{problem}; {line}"), hint),
        (error, _) => error,
    }
}

/// As [`validate()`]; of a glTF file without light it says what its users do.
pub(super) fn check_whole(path: &Path, scene: &Scene) -> Result<Warnings> {
    if is_gltf(path) && scene.emitters.is_empty() {
        let hint = "give a material emission or add a lamp (KHR_lights_punctual), or name the file as geometry of a \
            scene file with [[light]] entries";
        return Err(Error::input(path.display().to_string(), "has no light", hint));
    }
    validate(scene)
}

/// A scene before it is checked as a whole.
pub(super) struct Unchecked {
    pub(super) scene: Scene,
    settings: RenderSettings,
    /// Cameras of a glTF file, by the names of their nodes.
    pub(super) cameras: Vec<NamedCamera>,
    pub(super) warnings: Warnings,
}

/// Reads a scene without the checks of the whole.
pub(super) fn put_together(path: &Path, options: &LoadOptions) -> Result<Unchecked> {
    let memory = MemoryBound::of(options.memory_bytes.unwrap_or(u64::MAX));
    if is_gltf(path) || is_obj(path) {
        return load_geometry(path, options, memory, false);
    }
    load_toml(path, options, memory)
}

/// A scene whose geometry has been read.
struct Read<'a> {
    place: &'a str,
    folders: &'a Folders,
    name: String,
    geometry: Geometry,
    /// The scene's, from which the geometry and the camera are counted.
    origin: DVec3,
    overrides: &'a [MaterialEntry],
    entries: &'a [LightEntry],
    camera: Camera,
    sensors: Option<Arc<Sensors>>,
    shows_irradiance: bool,
    settings: RenderSettings,
    metres_per_unit: f32,
    memory: MemoryBound,
    warnings: Warnings,
    /// Whether each emissive object is a light of its own, before the entries.
    by_instance: bool,
    /// Whether an even sky lights it where nothing else does.
    has_sky: bool,
}

fn load_toml(path: &Path, options: &LoadOptions, mut memory: MemoryBound) -> Result<Unchecked> {
    let place = path.display().to_string();
    if options.camera.is_some() {
        let problem = "a camera is chosen by name, but a scene file has one only, [camera]";
        return Err(Error::input(place, problem, "leave the name out, or give the glTF file itself"));
    }
    let text = read_input_text(path, "read the scene", MAX_TEXT_BYTES)?;
    // The text, its tree and the records made of it.
    memory.check((text.len() as u64).saturating_mul(64), path)?;
    let SceneFile {
        name,
        scene,
        geometry: files,
        metres_per_unit,
        camera,
        grid: grids,
        render,
        light: entries,
        material: overrides,
    } = file::parse(path, &text)?;
    let folders = Folders::of(path, options.allow_outside);
    let settings = settings(&render, &place)?;
    if let Some(base) = scene {
        if !(files.is_none()
            && entries.is_empty()
            && grids.is_empty()
            && overrides.is_empty()
            && metres_per_unit.is_none())
        {
            let problem = "names a scene, and has geometry, lights, grids, materials or a unit as well";
            return Err(Error::input(place, problem, "leave only [camera] and [render] beside 'scene'"));
        }
        let base = load_scene_of(&place, &folders.find(&base, &place)?, options, memory, camera.is_some())?;
        return with_camera_of(&place, (name, camera), settings, base);
    }
    let Some(files) = files else {
        return Err(Error::input(
            place,
            "names no geometry",
            "give geometry = [\"room.obj\"], or scene = \"room.glb\"",
        ));
    };
    let metres_per_unit = metres_per_unit.unwrap_or(0.0);
    if !(metres_per_unit >= 0.0 && metres_per_unit.is_finite()) {
        return Err(Error::input(place, "metres_per_unit is not a length", "give a number above 0, or leave it out"));
    }

    let mut warnings = Warnings::new();
    let mut geometry = Geometry::default();
    for name in &files {
        let extras = geometry.read(&folders.find(name, &place)?, &folders, &mut memory, &mut warnings)?;
        if !extras.lamps.is_empty() {
            let count = extras.lamps.len();
            warnings.push(format!("{name}: {count} lamps of the file are not used; state them as [[light]] entries"));
        }
    }
    let origin = geometry.settle(&place, &mut warnings);
    let shows_irradiance = camera.as_ref().and_then(|camera| camera.irradiance).unwrap_or(false);
    let (camera, sensors) = match (choose_grid(&grids, options.grid.as_deref(), camera.is_none(), &place)?, camera) {
        (Some((grid, place)), _) => {
            let sensors = sensors::sensors(grid, origin, &folders, &place)?;
            (Camera::of_sensors(sensors.size()), Some(Arc::new(sensors)))
        }
        (None, Some(camera)) => (camera_entry::camera(&camera, origin, &place)?, None),
        (None, None) => {
            warnings.push(format!("{place}: has no [camera]: one from which all of it is seen is used"));
            (seeing_all(&geometry.mesh)?, None)
        }
    };
    for (index, entry) in entries.iter().enumerate() {
        replace(entry, &mut geometry, &light_place(&place, index, entry))?;
    }
    build(
        Read {
            place: &place,
            folders: &folders,
            name: name.unwrap_or_else(|| stem(path)),
            geometry,
            origin,
            overrides: &overrides,
            entries: &entries,
            camera,
            sensors,
            shows_irradiance,
            settings,
            metres_per_unit,
            memory,
            warnings,
            by_instance: false,
            has_sky: false,
        },
        options,
    )
}

/// A scene that a scene file names, with the file's name, camera and settings in place of its own.
fn with_camera_of(
    place: &str,
    (name, camera): (Option<String>, Option<CameraEntry>),
    settings: RenderSettings,
    mut base: Unchecked,
) -> Result<Unchecked> {
    base.settings = settings;
    if let Some(name) = name {
        base.scene.name = name;
    }
    if let Some(camera) = camera {
        base.scene.camera = camera_entry::camera(&camera, base.scene.origin, place)?;
        base.scene.shows_irradiance = camera.irradiance.unwrap_or(false);
    }
    Ok(base)
}

/// Whether a file is an OBJ file, by its name.
fn is_obj(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("obj"))
}

/// The scene that a scene file at `place` names.
fn load_scene_of(
    place: &str,
    path: &Path,
    options: &LoadOptions,
    memory: MemoryBound,
    has_other_camera: bool,
) -> Result<Unchecked> {
    if !(is_gltf(path) || is_obj(path)) {
        let problem = format!("{} is neither an OBJ nor a glTF file", path.display());
        return Err(Error::input(place, problem, "give scene = \"room.glb\", or geometry and lights of your own"));
    }
    load_geometry(path, options, memory, has_other_camera)
}

/// Only scene files have grids of sensors.
fn refuse_grid(place: &str, options: &LoadOptions) -> Result<()> {
    let Some(grid) = &options.grid else { return Ok(()) };
    let hint = "name the file as geometry of a scene file with a [[grid]]";
    Err(Error::input(place, format!("is no scene file and has no grid '{grid}'"), hint))
}

/// A glTF or OBJ file as a scene of its own: its camera, or one that has all of it in view; its lamps and all that emits in it or, in an OBJ file
/// where nothing emits, an even sky. `has_other_camera`: the caller has one that replaces it.
fn load_geometry(
    path: &Path,
    options: &LoadOptions,
    mut memory: MemoryBound,
    has_other_camera: bool,
) -> Result<Unchecked> {
    let place = path.display().to_string();
    refuse_grid(&place, options)?;
    let folders = Folders::of(path, options.allow_outside);
    let (mut warnings, mut geometry) = (Warnings::new(), Geometry::default());
    let extras = geometry.read(path, &folders, &mut memory, &mut warnings)?;
    if geometry.mesh.triangles.is_empty() {
        let hint = if is_obj(path) { "give a file with faces" } else { "give a file with meshes of triangles" };
        return Err(Error::input(place, "has no triangles", hint));
    }
    let origin = geometry.settle(&place, &mut warnings);
    let seen = |of: &FileCamera| {
        let camera = of.camera(origin).ok()?;
        Some(NamedCamera { name: of.name.clone(), own_name: of.own_name.clone(), camera })
    };
    let cameras = extras.cameras.iter().filter_map(seen).collect();
    // Which camera of the file is used does not matter where another replaces it.
    let mut told = Warnings::new();
    let camera = choose_camera(&extras.cameras, options.camera.as_deref(), &geometry, origin, &place, &mut told)?;
    if !has_other_camera {
        warnings.append(&mut told);
    }
    let made = build(
        Read {
            place: &place,
            folders: &folders,
            name: stem(path),
            geometry,
            origin,
            overrides: &[],
            entries: &extras.lamps,
            camera,
            sensors: None,
            shows_irradiance: false,
            settings: RenderSettings::default(),
            // The unit of glTF is the metre; OBJ files say none.
            metres_per_unit: if is_obj(path) { 0.0 } else { 1.0 },
            memory,
            warnings,
            by_instance: true,
            has_sky: is_obj(path),
        },
        options,
    )?;
    Ok(Unchecked { cameras, ..made })
}

/// The camera of that name, else the first, else one that sees everything; which one is said where there is a choice.
fn choose_camera(
    cameras: &[FileCamera],
    name: Option<&str>,
    geometry: &Geometry,
    origin: DVec3,
    place: &str,
    warnings: &mut Warnings,
) -> Result<Camera> {
    let names: Vec<_> = cameras.iter().map(|camera| (&*camera.name, camera.own_name.as_deref())).collect();
    let chosen = match name {
        Some(name) => Some(&cameras[position_of_camera(place, &names, name)?]),
        None => cameras.first(),
    };
    let Some(chosen) = chosen else {
        warnings.push(format!("{place}: has no camera: one from which all of it is seen is used"));
        return seeing_all(&geometry.mesh);
    };
    if cameras.len() > 1 {
        let (count, list) = (cameras.len(), listed(names.iter().map(|(node, _)| *node)));
        let text = format!("{place}: camera '{}' of {count} is used ({list})", chosen.name);
        warnings.push(Warning::new(text, Hint::ChooseCamera));
    }
    chosen.camera(origin).map_err(|error| match error {
        Error::Input { problem, hint, .. } => Error::input(format!("{place}, camera '{}'", chosen.name), problem, hint),
        other => other,
    })
}

/// The grid of that name, or the first where there is no camera; none: the camera.
fn choose_grid<'a>(
    grids: &'a [GridEntry],
    name: Option<&str>,
    needs_one: bool,
    place: &str,
) -> Result<Option<(&'a GridEntry, String)>> {
    let names = grids.iter().map(|grid| grid.name.as_str());
    if let Some((index, grid)) =
        grids.iter().enumerate().find(|(i, grid)| names.clone().take(*i).any(|n| n == grid.name))
    {
        let problem = format!("grid {} has the name '{}' of another", index + 1, grid.name);
        return Err(Error::input(place, problem, "rename one of them"));
    }
    // Results are named after grids, and after the camera.
    let is_plain = |name: &str| name != "camera" && Path::new(name).file_name() == Some(OsStr::new(name));
    if let Some(grid) = grids.iter().find(|grid| !is_plain(&grid.name)) {
        let problem = format!("a grid has the name '{}', which cannot name a file of results", grid.name);
        return Err(Error::input(place, problem, "choose a name without slashes that is not 'camera'"));
    }
    let found = match name {
        None if !needs_one || grids.is_empty() => return Ok(None),
        None => grids.first(),
        Some(wanted) => grids.iter().find(|grid| grid.name == wanted),
    };
    let Some(found) = found else {
        let list = names.map(|name| format!("'{name}'")).collect::<Vec<_>>().join(", ");
        let hint = if grids.is_empty() { "it has none; add a [[grid]]".into() } else { format!("it has {list}") };
        return Err(Error::input(place, format!("has no grid '{}'", name.unwrap_or_default()), hint));
    };
    Ok(Some((found, format!("{place}, grid '{}'", found.name))))
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Makes materials and lights.
fn build(read: Read<'_>, options: &LoadOptions) -> Result<Unchecked> {
    let Read { place, folders, name, geometry, origin, overrides, entries, camera, settings, metres_per_unit, .. } =
        read;
    let (sensors, shows_irradiance) = (read.sensors, read.shows_irradiance && options.grid.is_none());
    let textures = Textures::within(read.memory, folders.reach.clone());
    let mut workshop =
        MaterialResolver { textures, warnings: read.warnings, overrides, folders, place, decided: Decided::default() };
    let mut assembly = Assembly { mesh: geometry.mesh, ..Assembly::default() };
    let mut emissions = Vec::new();
    for source in &geometry.materials {
        let (material, emission) = workshop.make(source)?;
        assembly.materials.push(material);
        emissions.push(emission);
    }
    workshop.textures.report(place, options.allow_missing, &mut workshop.warnings)?;
    let known = geometry.materials.iter().map(|m| m.name.as_str());
    for entry in overrides {
        if !known.clone().any(|name| fits(&entry.pattern, name)) {
            let nearest = names::nearest(&entry.pattern, known);
            let hint = nearest.map_or("look up the names in the MTL files".into(), |n| format!("did you mean '{n}'?"));
            let place = format!("{place}, material \"{}\"", entry.pattern);
            return Err(Error::input(place, "no material has such a name", hint));
        }
    }
    let MaterialResolver { textures, mut warnings, decided, .. } = workshop;
    decided.report(&mut warnings);
    let memory = textures.memory;
    assembly.textures = textures.list;

    let mut lights = LightBuilder {
        assembly: &mut assembly,
        emissions: &emissions,
        objects: geometry.objects.as_slice(),
        object_of: &geometry.object_of,
        folders,
        origin,
        weights: Vec::new(),
        memory,
        warnings: Warnings::new(),
    };
    if read.by_instance {
        let both = |m: &SourceMaterial| matches!(&m.description, Description::Gltf(g) if g.two_sided);
        lights.instances(&geometry.materials.iter().map(both).collect::<Vec<_>>(), place)?;
    }
    // Places of the sun are the last lights: what is drawn at random stands before them.
    let (last, first): (Vec<_>, Vec<_>) =
        entries.iter().enumerate().partition(|(_, entry)| entry.kind == LightEntryKind::Suns);
    for (index, entry) in first.into_iter().chain(last) {
        lights.add(entry, &light_place(place, index, entry))?;
    }
    if !read.by_instance && entries.is_empty() && emissions.iter().any(Option::is_some) {
        lights.add(&LightEntry::default(), place)?;
    }
    if read.has_sky && lights.assembly.emitters.is_empty() {
        lights.warnings.push(format!("{place}: no material emits light: an even sky lights it"));
        let (kind, texels) = (LightEntryKind::Environment, Some(EVEN_SKY_TEXELS));
        lights.add(&LightEntry { kind, texels, name: Some("sky".into()), ..LightEntry::default() }, place)?;
    }
    let weights = std::mem::take(&mut lights.weights);
    warnings.append(&mut lights.warnings);
    warn_of_unused(&assembly, emissions.iter().map(Option::is_some), &mut warnings);
    let Assembly { mesh, materials, textures, emitters, unseen_lights, mut basis } = assembly;
    for (first, weights) in weights {
        basis.set_scene_weights(first, weights)?;
    }
    let scene = Scene {
        name,
        origin,
        mesh,
        materials,
        textures,
        camera,
        sensors,
        shows_irradiance,
        emitters,
        unseen_lights,
        basis,
        metres_per_unit,
    };
    Ok(Unchecked { scene, settings, cameras: Vec::new(), warnings })
}

fn light_place(place: &str, index: usize, entry: &LightEntry) -> String {
    let name = entry.name.as_deref().or(entry.material.as_deref()).or(entry.object.as_deref());
    format!("{place}, light {}{}", index + 1, name.map(|n| format!(" \"{n}\"")).unwrap_or_default())
}

/// Takes out the surfaces that a panel replaces.
fn replace(entry: &LightEntry, geometry: &mut Geometry, place: &str) -> Result<()> {
    let Some(pattern) = entry.replaces.as_ref().filter(|_| entry.kind == LightEntryKind::Panel) else {
        return Ok(());
    };
    let replaced: Vec<bool> = geometry.materials.iter().map(|m| fits(pattern, &m.name)).collect();
    let before = geometry.mesh.triangles.len();
    geometry.retain(|triangle| !replaced[triangle.material.0 as usize]);
    if geometry.mesh.triangles.len() < before {
        return Ok(());
    }
    let nearest = names::nearest(pattern, geometry.materials.iter().map(|m| m.name.as_str()));
    let hint = nearest.map_or("look up the names in the MTL files".into(), |n| format!("did you mean '{n}'?"));
    Err(Error::input(place, format!("there is no surface of material \"{pattern}\" to replace"), hint))
}

fn warn_of_unused(assembly: &Assembly, emits: impl Iterator<Item = bool>, warnings: &mut Warnings) {
    let mut unlit = vec![false; assembly.materials.len()];
    for triangle in assembly.mesh.triangles.iter().filter(|t| t.emitter.is_none()) {
        unlit[triangle.material.0 as usize] = true;
    }
    for ((material, unlit), emits) in assembly.materials.iter().zip(unlit).zip(emits) {
        if emits && unlit {
            warnings.push(format!(
                "material '{}' emits, but no [[light]] chooses all of it: the rest is dark",
                material.name
            ));
        }
    }
}

fn settings(entry: &RenderEntry, place: &str) -> Result<RenderSettings> {
    let default = RenderSettings::default();
    let within = |key: &str, value: Option<u32>, default: u32, most: u32| match value {
        Some(value) if !(1..=most).contains(&value) => {
            let place = format!("{place}, [render]");
            Err(Error::input(place, format!("{key} = {value}"), format!("give a number from 1 to {most}")))
        }
        value => Ok(value.unwrap_or(default)),
    };
    Ok(RenderSettings {
        samples_per_pixel: within(
            "samples_per_pixel",
            entry.samples_per_pixel,
            default.samples_per_pixel,
            RenderSettings::MAX_SAMPLES_PER_PIXEL,
        )?,
        seed: entry.seed.unwrap_or(default.seed),
        block_side: within("block_side", entry.block_side, default.block_side, MatrixShape::MAX_BLOCK_SIDE)?,
        max_depth: within("max_depth", entry.max_depth, default.max_depth, 1024)?,
    })
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::light::LightKind;

    /// A folder with an OBJ file of a wall and two lamps, whose material emits or not, and with a scene file.
    fn folder(emission: &str, scene: &str) -> (tempfile::TempDir, PathBuf, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let [obj, toml] = ["room.obj", "room.toml"].map(|name| folder.path().join(name));
        let text = "mtllib room.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n\
                    o wall\nusemtl grey\nf 1 2 3 4\no left\nusemtl lamp\nf 1 2 3\no right\nusemtl lamp\nf 1 3 4\n";
        std::fs::write(&obj, text).unwrap();
        std::fs::write(
            folder.path().join("room.mtl"),
            format!("newmtl grey\nKd 0.5 0.5 0.5\nnewmtl lamp\n{emission}\n"),
        )
        .unwrap();
        std::fs::write(&toml, scene).unwrap();
        (folder, obj, toml)
    }

    fn names(loaded: &LoadedScene) -> Vec<&str> {
        loaded.scene.basis.lights().iter().map(|light| light.name.as_str()).collect()
    }

    /// The middle of the box of the wall and the lamps is in view of a camera that nobody has stated.
    fn sees_all(loaded: &LoadedScene) {
        let camera = &loaded.scene.camera;
        for corner in [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] {
            let at = camera.position_of(corner.into()).unwrap();
            assert!(at.cmpge(glam::Vec2::ZERO).all() && at.x <= camera.width as f32 && at.y <= camera.height as f32);
        }
    }

    #[test]
    fn an_obj_file_is_a_scene_with_a_light_for_each_object_that_emits_or_with_a_sky() {
        let (_lit, obj, _) = folder("Kd 0 0 0\nKe 3 3 3", "");
        let loaded = load(&obj).unwrap();
        assert_eq!(names(&loaded), ["left", "right"]);
        sees_all(&loaded);
        let (_dark, obj, _) = folder("Kd 0.1 0.1 0.1", "");
        let loaded = load(&obj).unwrap();
        assert_eq!(names(&loaded), ["sky"]);
        assert!(loaded.scene.basis.lights()[0].kind != LightKind::Lamp);
        assert!(loaded.warnings.iter().any(|warning| warning.text.contains("an even sky lights it")));
    }

    #[test]
    fn a_scene_file_names_a_scene_and_gives_it_a_camera() {
        let text = "scene = \"room.obj\"\n[camera]\neye = [0.5, 0.5, 4]\nlook_at = [0.5, 0.5, 0]\nwidth = 96\nheight = 64\n\
                    [render]\nsamples_per_pixel = 7\n";
        let (_folder, obj, toml) = folder("Kd 0 0 0\nKe 3 3 3", text);
        let loaded = load(&toml).unwrap();
        assert_eq!((names(&loaded), loaded.settings.samples_per_pixel), (names(&load(&obj).unwrap()), 7));
        assert_eq!((loaded.scene.camera.width, loaded.scene.camera.eye), (96, glam::Vec3::new(0.5, 0.5, 4.0)));
        assert!(!loaded.warnings.iter().any(|warning| warning.text.contains("camera")), "{:?}", loaded.warnings);
        let refused = |text: &str| {
            std::fs::write(&toml, text).unwrap();
            load(&toml).unwrap_err().to_string()
        };
        assert!(refused("scene = \"room.obj\"\ngeometry = [\"room.obj\"]\n").contains("leave only [camera]"));
        assert!(refused("scene = \"room.mtl\"\n").contains("neither an OBJ nor a glTF file"));
        assert!(refused("name = \"nothing\"\n").contains("names no geometry"));
    }

    #[test]
    fn a_scene_file_without_a_camera_gets_one_that_sees_all() {
        let text = "geometry = [\"room.obj\"]\n[[light]]\nkind = \"point\"\nposition = [0.5, 0.5, 2]\n";
        let (_folder, _, toml) = folder("Kd 0 0 0", text);
        let loaded = load(&toml).unwrap();
        sees_all(&loaded);
        assert!(loaded.warnings.iter().any(|warning| warning.text.contains("has no [camera]")));
    }
}
