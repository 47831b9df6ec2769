//! Saving a view: into the `[camera]` of a scene file, whose other text stays as it is, or into a new scene file beside an OBJ or glTF file.

use std::fs;
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec2};
use toml_edit::{Array, DocumentMut, Item, Table, value};

use ltm::error::{Error, Result};
use ltm::files::write_file;
use ltm::scene::{Camera, Projection};

/// The file that a view of a scene is saved to: the scene file itself, or one beside it.
pub fn file_of(scene: &Path) -> PathBuf {
    let is_own = scene.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
    if is_own { scene.to_owned() } else { scene.with_extension("toml") }
}

/// Writes the camera of a scene whose zero lies at `origin`. What is replaced is given back: [`restore`] takes the save back.
///
/// # Errors
/// The file cannot be read or written; a file beside an OBJ or glTF file that is not a scene file of it.
pub fn save(scene: &Path, camera: &Camera, origin: DVec3) -> Result<Saved> {
    let path = file_of(scene);
    let before = match fs::read_to_string(&path) {
        Ok(text) => Some(text),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
        Err(error) => return Err(Error::io(&path, "read")(error)),
    };
    let place = path.display().to_string();
    let name = scene.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut document = match &before {
        Some(text) => text.parse::<DocumentMut>().map_err(|error| {
            let problem = format!("is no scene file ({})", error.message());
            Error::input(&place, problem, "move it away to save the view beside the scene")
        })?,
        None => new_scene_file(&name),
    };
    let names_scene = |item: &Item| {
        let is_name = |item: &toml_edit::Value| item.as_str() == Some(&name);
        item.as_value().is_some_and(is_name) || item.as_array().is_some_and(|list| list.iter().any(is_name))
    };
    let is_of_scene =
        path == *scene || ["scene", "geometry"].iter().any(|key| document.get(key).is_some_and(names_scene));
    if !is_of_scene {
        let problem = format!("is a scene file of something else than {name}");
        return Err(Error::input(&place, problem, "move it away to save the view beside the scene"));
    }
    set_camera(&mut document, camera, origin)?;
    write_file(&path, true, document.to_string().as_bytes())?;
    Ok(Saved { path, before })
}

/// A save, and what it replaced.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Saved {
    /// The file.
    pub path: PathBuf,
    before: Option<String>,
}

/// Takes a save back: the file is again what it was, or is gone.
///
/// # Errors
/// Those of the disk.
pub fn restore(saved: &Saved) -> Result<()> {
    match &saved.before {
        Some(text) => write_file(&saved.path, true, text.as_bytes()),
        None => fs::remove_file(&saved.path).map_err(Error::io(&saved.path, "remove")),
    }
}

/// A scene file of a file that has all but the camera.
fn new_scene_file(name: &str) -> DocumentMut {
    let mut document = DocumentMut::new();
    document["scene"] = value(name);
    document
}

/// Sets the place, the direction, the projection and the lens of `[camera]`, in the file's coordinates; its other keys stay.
fn set_camera(document: &mut DocumentMut, camera: &Camera, origin: DVec3) -> Result<()> {
    let table = document.entry("camera").or_insert(Item::Table(Table::new()));
    let Some(table) = table.as_table_like_mut() else {
        return Err(Error::input("camera", "is no table", "write [camera] with eye, look_at or direction"));
    };
    let vector = |v: [f64; 3]| value(Array::from_iter(v));
    // As f32 are written: not with the digits that f64 would add.
    let short = |v: f32| v.to_string().parse::<f64>().unwrap_or_else(|_| f64::from(v));
    table.insert("eye", vector((camera.eye.as_dvec3() + origin).to_array()));
    table.remove("look_at");
    table.insert("direction", vector(camera.forward.to_array().map(short)));
    table.insert("up", vector(camera.up.to_array().map(short)));
    let lens = ["aperture_radius", "focus_distance", "blades", "blade_rotation_degrees"];
    for key in ["projection", "view_height", "vertical_fov_degrees", "shift", "pixel_aspect"].iter().chain(&lens) {
        table.remove(key);
    }
    if camera.shift != Vec2::ZERO {
        table.insert("shift", value(Array::from_iter(camera.shift.to_array().map(short))));
    }
    if camera.pixel_aspect != 1.0 {
        table.insert("pixel_aspect", value(short(camera.pixel_aspect)));
    }
    if let Some(lens) = camera.lens {
        table.insert("aperture_radius", value(short(lens.radius)));
        table.insert("focus_distance", value(short(lens.focus_distance)));
        if lens.blades > 0 {
            table.insert("blades", value(i64::from(lens.blades)));
            table.insert("blade_rotation_degrees", value(short(lens.rotation_radians.to_degrees())));
        }
    }
    match camera.projection {
        Projection::Perspective { vertical_fov_radians } => {
            table.insert("vertical_fov_degrees", value(short(vertical_fov_radians.to_degrees())));
        }
        Projection::Orthographic { height } => {
            table.insert("projection", value("orthographic"));
            table.insert("view_height", value(short(height)));
        }
        Projection::Panorama => {
            table.insert("projection", value("panorama"));
        }
    }
    table.insert("width", value(i64::from(camera.width)));
    table.insert("height", value(i64::from(camera.height)));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use ltm::scene::{Lens, PixelFilter, load};

    const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";

    fn view() -> Camera {
        let (eye, direction) = (Vec3::new(0.5, 0.25, 3.0), Vec3::new(0.1, 0.2, -1.0));
        Camera::looking(eye, direction, Vec3::Y, 0.7, (320, 200), PixelFilter::Box).unwrap()
    }

    fn is_near(a: &Camera, b: &Camera) -> bool {
        let far = (a.eye - b.eye).length() + (a.forward - b.forward).length() + (a.up - b.up).length();
        // Degrees and decimals round.
        let fov = a.vertical_fov_radians().unwrap() - b.vertical_fov_radians().unwrap();
        far < 1e-5 && fov.abs() < 1e-6 && (a.width, a.height) == (b.width, b.height)
    }

    #[test]
    fn a_view_of_an_obj_file_is_a_scene_file_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("room.obj");
        fs::write(&scene, OBJ).unwrap();
        let origin = load(&scene).unwrap().scene.origin;
        let saved = save(&scene, &view(), origin).unwrap();
        assert_eq!(saved.path, folder.path().join("room.toml"));
        let text = fs::read_to_string(&saved.path).unwrap();
        assert!(text.contains("scene = \"room.obj\"") && text.contains("[camera]"), "{text}");
        assert!(is_near(&camera_of(&saved.path), &view()));
        let other = Camera { eye: view().eye + 1.0, ..view() };
        let second = save(&scene, &other, origin).unwrap();
        assert!(is_near(&camera_of(&saved.path), &other));
        restore(&second).unwrap();
        assert!(is_near(&camera_of(&saved.path), &view()));
        restore(&saved).unwrap();
        assert!(!saved.path.exists());
        fs::write(&saved.path, "geometry = [\"other.obj\"]\n").unwrap();
        assert!(save(&scene, &view(), origin).unwrap_err().to_string().contains("something else"));
    }

    #[test]
    fn a_view_keeps_shift_pixels_and_lens_of_its_camera() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("room.obj");
        fs::write(&scene, OBJ).unwrap();
        let lens = Lens { radius: 0.125, focus_distance: 2.5, blades: 6, rotation_radians: 0.0 };
        let seen = view().shifted(Vec2::new(0.25, -0.5)).unwrap().with_pixel_aspect(1.5).unwrap();
        let seen = seen.with_lens(lens).unwrap();
        let saved = save(&scene, &seen, load(&scene).unwrap().scene.origin).unwrap();
        let read = camera_of(&saved.path);
        assert_eq!((read.shift, read.pixel_aspect, read.lens), (seen.shift, seen.pixel_aspect, seen.lens));
        // A camera without them takes them out again.
        let saved = save(&scene, &view(), load(&scene).unwrap().scene.origin).unwrap();
        let read = camera_of(&saved.path);
        assert_eq!((read.shift, read.pixel_aspect, read.lens), (Vec2::ZERO, 1.0, None));
    }

    fn camera_of(path: &Path) -> Camera {
        load(path).unwrap().scene.camera
    }

    #[test]
    fn the_other_text_of_a_scene_file_stays() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("room.obj"), OBJ).unwrap();
        let scene = folder.path().join("a.toml");
        let text = "# mine\ngeometry = [\"room.obj\"]   # walls\n[camera]\neye = [0, 0, 5]\nlook_at = [0, 0, 0]\nfilter = \"tent\"\n\
                    [[light]]\nkind = \"point\" # lamp\nposition = [0, 0, 2]\n";
        fs::write(&scene, text).unwrap();
        save(&scene, &view(), DVec3::ZERO).unwrap();
        let after = fs::read_to_string(&scene).unwrap();
        for kept in ["# mine", "# walls", "filter = \"tent\"", "kind = \"point\" # lamp"] {
            assert!(after.contains(kept), "{after}");
        }
        assert!(!after.contains("look_at"));
        assert!(is_near(&load(&scene).unwrap().scene.camera, &view()));
    }
}
