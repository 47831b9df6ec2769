//! Arrays, and a file for each light.

use std::io::Write;
use std::path::Path;

use ltm::container::ContainerReader;
use ltm::image::LightSet;
use ltm::pipeline::{self, ImageNoise, ImportedMatrix, PackOptions, Selection, UnpackOptions};
use ltm::resources::NoProgress;

use super::write::{Exr, constant, file, lights, refused};

/// An array of the NumPy format, version 1.
fn npy(descr: &str, fortran: &str, shape: &str, body: &[u8]) -> Vec<u8> {
    let text = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': ({shape}), }}\n");
    [b"\x93NUMPY\x01\x00".as_slice(), &(text.len() as u16).to_le_bytes(), text.as_bytes(), body].concat()
}

fn floats32(count: usize) -> Vec<u8> {
    (0..count).flat_map(|i| (i as f32).to_le_bytes()).collect()
}

fn npz(path: &Path, members: &[(&str, Vec<u8>)]) {
    let mut zip = zip::ZipWriter::new(std::fs::File::create(path).unwrap());
    for (name, bytes) in members {
        zip.start_file(format!("{name}.npy"), zip::write::SimpleFileOptions::default()).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap();
}

fn texts(names: &[&str], length: usize) -> Vec<u8> {
    let padded = names.iter().flat_map(|name| name.chars().chain(std::iter::repeat('\0')).take(length));
    padded.flat_map(|c| (c as u32).to_le_bytes()).collect()
}

pub(super) fn floats() {
    let (_folder, path) = file("a.npy");
    let halves: Vec<u8> = (0..24).flat_map(|i| exr::prelude::f16::from_f32(i as f32).to_le_bytes()).collect();
    let doubles: Vec<u8> = (0..24).flat_map(|i| f64::from(i).to_le_bytes()).collect();
    for (descr, body) in [("<f2", halves), ("<f4", floats32(24)), ("<f8", doubles)] {
        std::fs::write(&path, npy(descr, "False", "2, 1, 4, 3", &body)).unwrap();
        let found = lights(&path, None).unwrap();
        assert_eq!((found.names.len(), found.size), (2, (4, 1)));
        assert_eq!(found.images[1][2], [18.0, 19.0, 20.0], "{descr}");
    }
}

pub(super) fn lights_last() {
    let (_folder, path) = file("a.npy");
    std::fs::write(&path, npy("<f4", "False", "24, 32, 3, 3", &floats32(24 * 32 * 9))).unwrap();
    let error = refused(&path);
    assert!(error.contains("[24, 32, 3, 3]") && error.contains("numpy.moveaxis(a, -1, 0)"), "{error}");
}

pub(super) fn narrow() {
    let (_folder, path) = file("a.npz");
    let images = || npy("<f4", "False", "2, 5, 3, 3", &floats32(90));
    npz(&path, &[("images", images()), ("lights", npy("<U1", "False", "2,", &texts(&["a", "b"], 1)))]);
    let found = lights(&path, None).unwrap();
    assert_eq!((found.names, found.size), (vec!["a".to_owned(), "b".into()], (3, 5)));
    npz(&path, &[("images", images())]);
    assert!(refused(&path).contains("2 × 5 rows of 3 lights"));
}

pub(super) fn other_shapes() {
    let (_folder, path) = file("a.npy");
    for (shape, count, hint) in [
        ("3, 4, 5", 60, "three colours"),
        ("3, 4, 5, 1", 60, "numpy.repeat"),
        ("3, 4, 5, 4", 240, "a[..., :3]"),
        ("2, 3, 4, 5", 120, "transpose(0, 2, 3, 1)"),
        ("4, 5, 3, 7", 420, "numpy.moveaxis(a, -1, 0)"),
        ("2, 2, 4, 5, 3", 240, "`take_for_texels`"),
        ("7,", 7, "[lights, height, width, 3]"),
    ] {
        std::fs::write(&path, npy("<f4", "False", shape, &floats32(count))).unwrap();
        let error = refused(&path);
        assert!(error.contains(hint), "{shape}: {error}");
    }
}

pub(super) fn other_types() {
    let (_folder, path) = file("a.npy");
    for (descr, fortran, word) in [
        ("<i4", "False", "<i4"),
        (">f4", "False", ">f4"),
        ("|u1", "False", "|u1"),
        ("|O", "False", "|O"),
        ("<f4", "True", "Fortran"),
    ] {
        std::fs::write(&path, npy(descr, fortran, "2, 1, 4, 3", &floats32(24))).unwrap();
        assert!(refused(&path).contains(word), "{descr}");
    }
}

pub(super) fn names() {
    let (_folder, path) = file("a.npz");
    let images = || npy("<f4", "False", "2, 1, 4, 3", &floats32(24));
    npz(&path, &[("images", images()), ("lights", npy("<U5", "False", "2,", &texts(&["Küche", "照明"], 5)))]);
    assert_eq!(lights(&path, None).unwrap().names, ["Küche", "照明"]);
    let bytes = [b"key\0\0\0".as_slice(), "Küche".as_bytes()].concat();
    npz(&path, &[("images", images()), ("lights", npy("|S6", "False", "2,", &bytes))]);
    assert_eq!(lights(&path, None).unwrap().names, ["key", "Küche"]);
}

pub(super) fn bad_names() {
    let (_folder, path) = file("a.npz");
    for (names, word) in [(["a", ""], "light 1 is empty"), (["a", "a"], "'a'")] {
        let images = npy("<f4", "False", "2, 1, 4, 3", &floats32(24));
        npz(&path, &[("images", images), ("lights", npy("<U1", "False", "2,", &texts(&names, 1)))]);
        assert!(refused(&path).contains(word), "{names:?}");
    }
}

pub(super) fn other_archives() {
    let (_folder, path) = file("a.npz");
    npz(
        &path,
        &[
            ("key", npy("<f4", "False", "1, 4, 3", &floats32(12))),
            ("fill", npy("<f4", "False", "1, 4, 3", &floats32(12))),
        ],
    );
    let error = refused(&path);
    assert!(error.contains("key, fill") && error.contains("images=numpy.stack"), "{error}");
}

/// One grey pixel as a portable float map.
fn map(path: &Path, value: f32) {
    std::fs::write(path, [b"Pf 1 1 -1\n".as_slice(), &value.to_le_bytes()].concat()).unwrap();
}

pub(super) fn numbers() {
    let folder = tempfile::tempdir().unwrap();
    for number in 1..=16 {
        map(&folder.path().join(format!("frame_{number}.pfm")), number as f32);
    }
    let found = lights(&folder.path().join("frame_{light}.pfm"), None).unwrap();
    let wanted: Vec<f32> = (1..=16).map(|number| number as f32).collect();
    assert_eq!(found.images.iter().map(|image| image[0][0]).collect::<Vec<_>>(), wanted);
    assert_eq!(found.names[9], "10");
    // Layers, too.
    let path = folder.path().join("a.exr");
    let names: Vec<String> = (0..12).map(|number| format!("RADIANCE_GROUP_{number}")).collect();
    let layers: Vec<(&str, [f32; 3])> =
        names.iter().zip(0u8..).map(|(name, i)| (name.as_str(), [f32::from(i); 3])).collect();
    constant(&layers, &Exr::new(1, 1), &path);
    let found = lights(&path, None).unwrap();
    assert!(found.images.iter().zip(0u8..).all(|(image, i)| image[0][0] == f32::from(i)), "{:?}", found.names);
}

pub(super) fn hidden() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    map(&at("1.pfm"), 1.0);
    map(&at("2.pfm"), 2.0);
    for name in ["._1.pfm", "._2.pfm", ".DS_Store", "Thumbs.db"] {
        std::fs::write(at(name), "no image").unwrap();
    }
    std::fs::create_dir(at("old.pfm")).unwrap();
    assert_eq!(lights(folder.path(), None).unwrap().names, ["1", "2"]);
}

pub(super) fn unread() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for (name, format) in [("1.tif", "TIFF"), ("1.TIFF", "TIFF"), ("1.CR2", "raw")] {
        std::fs::write(at(name), "x").unwrap();
        let error = refused(folder.path());
        assert!(error.contains(name) && error.contains(format) && error.contains("OpenEXR"), "{error}");
        std::fs::remove_file(at(name)).unwrap();
    }
    // None is lost without a word, and one that is there as another file is none.
    map(&at("1.pfm"), 1.0);
    std::fs::write(at("2.tif"), "x").unwrap();
    assert!(refused(folder.path()).contains("2.tif"));
    map(&at("2.pfm"), 2.0);
    assert_eq!(lights(folder.path(), None).unwrap().names, ["1", "2"]);
}

pub(super) fn encoded() {
    let folder = tempfile::tempdir().unwrap();
    image::RgbImage::from_raw(1, 1, vec![255, 188, 0]).unwrap().save(folder.path().join("a.png")).unwrap();
    let found = lights(folder.path(), None).unwrap();
    // 188 is half of white, by IEC 61966-2-1.
    assert!((found.images[0][0][1] - 0.503).abs() < 1e-3 && found.images[0][0][0] == 1.0);
    assert!(found.warnings.contains("1 file is decoded from sRGB"), "{}", found.warnings);
}

pub(super) fn scaled() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.pfm"), [b"Pf 1 1 -2\n".as_slice(), &3.0f32.to_le_bytes()].concat()).unwrap();
    let found = lights(folder.path(), None).unwrap();
    assert_eq!(found.images[0][0], [3.0; 3]);
    assert!(found.warnings.contains("a.pfm: its scale of 2 is left alone"), "{}", found.warnings);
}

pub(super) fn sizes() {
    let folder = tempfile::tempdir().unwrap();
    map(&folder.path().join("1.pfm"), 1.0);
    std::fs::write(folder.path().join("2.pfm"), [b"Pf 2 1 -1\n".as_slice(), &[0; 8]].concat()).unwrap();
    let error = refused(folder.path());
    assert!(error.contains("2.pfm") && error.contains("2 × 1 pixels"), "{error}");
}

/// They are lights as they are called; what is written for each lies in the folder that was named, and a name comes before its
/// reading as a pattern.
pub(super) fn odd_names() {
    let (folder, path) = file("a.npz");
    let names = ["/lights/key", "../../evil", "a:b|c", "Lamp*", "Lamp*1"];
    let lit = npy("<f4", "False", "5, 1, 4, 3", &floats32(60));
    npz(&path, &[("images", lit), ("lights", npy("<U12", "False", "5,", &texts(&names, 12)))]);
    assert_eq!(lights(&path, None).unwrap().names, names);
    let out = folder.path().join("out");
    std::fs::create_dir(&out).unwrap();
    let packed = out.join("a.ltc");
    let set = LightSet::open(&path, None).unwrap();
    let options = PackOptions::default();
    let matrix = ImportedMatrix::read(&set, ImageNoise::Unknown, "a", &packed, 32, &options, &NoProgress).unwrap();
    pipeline::pack(&matrix, matrix.job(), &packed, &options, &NoProgress).unwrap();
    let container = ContainerReader::open(&packed).unwrap();
    let written = |lights: &[&str]| {
        let selection =
            Selection { lights: lights.iter().map(|&light| light.to_owned()).collect(), ..Selection::default() };
        let options = UnpackOptions { selection, overwrite: true, ..UnpackOptions::default() };
        let mut written =
            pipeline::unpack_to_exr(&container, &out.join("x_{light}.exr"), &options, &NoProgress).unwrap();
        written.sort();
        written
    };
    let all = written(&[]);
    assert_eq!(all.len(), 5);
    for path in &all {
        assert_eq!(path.canonicalize().unwrap().parent(), Some(&*out.canonicalize().unwrap()), "{}", path.display());
    }
    assert_eq!(written(&["Lamp*"]).len(), 1, "the light of that name");
    assert_eq!(written(&["L*"]).len(), 2);
}
