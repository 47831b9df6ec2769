//! Collections of images as people have them. The right values are those of their notes.

use std::path::Path;

use super::radiance::sky_weights;
use super::write::{imported, lights, near, picture, refused, rgb};

fn names_of(path: &Path) -> Vec<String> {
    let mut names = lights(path, None).unwrap().names;
    names.sort();
    names
}

pub(super) fn names(folder: &Path) {
    let (found, difference, warnings) = imported(&folder.join("blender_names.exr"));
    let wanted = std::fs::read_to_string(folder.join("names.txt")).unwrap();
    let mut wanted: Vec<&str> = wanted.lines().collect();
    let mut found: Vec<&str> = found.iter().map(String::as_str).collect();
    wanted.sort();
    found.sort();
    assert_eq!(found, wanted);
    assert!(difference.unwrap() < 1e-6 && warnings.is_empty(), "{warnings}");
    assert_eq!(names_of(&folder.join("plain_names.exr")).len(), 8);
    assert_eq!(names_of(&folder.join("no_combined.exr")), ["fill", "key"]);
    assert_eq!(imported(&folder.join("one_group.exr")).0, ["key", "Rest"]);
}

pub(super) fn view_layers(folder: &Path) {
    assert!(refused(&folder.join("two.exr")).contains("`LayerPattern`"));
    assert_eq!(names_of(&folder.join("groups_in_bg_only.exr")), ["fill", "key"]);
}

pub(super) fn windows(folder: &Path) {
    let found = lights(&folder.join("auto_{light}.exr"), None).unwrap();
    assert_eq!((found.names.as_slice(), found.size), (&["fill".to_owned(), "key".into()][..], (32, 24)));
    for (i, pixel) in found.images[0].iter().enumerate() {
        let inside = (4..20).contains(&(i % 32)) && (6..16).contains(&(i / 32));
        assert_eq!(*pixel == [0.0; 3], !inside, "pixel {i}");
    }
    assert!(lights(&folder.join("over_{light}.exr"), None).unwrap().warnings.contains("32 × 24"));
    assert!(lights(&folder.join("region_{light}.exr"), None).unwrap().warnings.contains("64 × 48"));
    assert!(refused(&folder.join("t_{light}.exr")).contains("display window"));
}

pub(super) fn denoised(folder: &Path) {
    for name in ["arnold_denoise.exr", "arnold_variance.exr"] {
        let (names, difference, warnings) = imported(&folder.join(name));
        assert_eq!(names, ["fill", "key"], "{name}");
        assert!(difference.unwrap() < 1e-6 && warnings.is_empty(), "{warnings}");
    }
}

fn relative_l2(a: &[[f32; 4]], b: &[[f32; 4]]) -> f64 {
    let square = |pixels: &mut dyn Iterator<Item = f32>| pixels.map(|v| f64::from(v).powi(2)).sum::<f64>();
    let pairs = a.iter().flatten().zip(b.iter().flatten());
    (square(&mut pairs.map(|(a, b)| a - b)) / square(&mut b.iter().flatten().copied())).sqrt()
}

pub(super) fn chromaticities(folder: &Path) {
    let [rec_709, xyz, chroma] =
        ["a_Rec709.exr", "b_XYZ.exr", "c_Rec709YC.exr"].map(|name| picture(&folder.join(name)).0.pixels);
    // 16-bit floats of either; alpha is 1 in both.
    assert!(relative_l2(&xyz, &rec_709) < 6e-4);
    // Colours of every second pixel, in a picture of small coloured lights.
    assert!(relative_l2(&chroma, &rec_709) < 0.07);
    let (names, difference, warnings) = imported(&folder.join("acescg_groups.exr"));
    assert_eq!(names, ["fill", "key"]);
    assert!(difference.unwrap() < 1e-6 && warnings.contains("ACEScg"), "{warnings}");
}

pub(super) fn stereo(folder: &Path) {
    let path = folder.join("blender_stereo.exr");
    assert!(refused(&path).contains("'left' and 'right'"));
    assert_eq!(lights(&path, Some(r"^ViewLayer\.Combined_(.+)\.left$")).unwrap().names, ["fill", "key"]);
}

pub(super) fn light_mix(folder: &Path) {
    for name in ["vray.exr", "corona.exr"] {
        let (names, difference, _) = imported(&folder.join(name));
        assert_eq!(names, ["Fill", "Key"], "{name}");
        assert!(difference.unwrap() < 1e-6);
    }
    assert_eq!(names_of(&folder.join("lux.exr")), ["0", "1"]);
    let (names, difference, _) = imported(&folder.join("vray_auto.exr"));
    assert_eq!(names, ["Environment", "Fill", "Key", "Rest", "Self_Illumination"]);
    assert!(difference.unwrap() < 1e-6);
}

pub(super) fn hdr(folder: &Path) {
    let read = |name: &str| {
        let image = picture(&folder.join(format!("{name}_key.hdr"))).0;
        ((image.width, image.height), image.pixels.into_iter().map(rgb).collect::<Vec<_>>())
    };
    let plain = read("plain");
    for name in ["cols", "crlf", "exposure1", "flat", "flip_x", "flip_y", "noformat", "nomagic", "rgbe"] {
        assert_eq!(read(name), plain, "{name}");
    }
    let divided =
        |by: [f32; 3]| plain.1.iter().map(|&pixel| [0, 1, 2].map(|i: usize| pixel[i] / by[i])).collect::<Vec<_>>();
    assert_eq!(read("exposure2").1, divided([2.0; 3]));
    assert_eq!(read("colorcorr").1, divided([2.0, 1.0, 0.5]));
    read("xyze").1.iter().for_each(|pixel| near(*pixel, [4.0, 2.0, 1.0], 0.04));
    let (long, old) = (read("oldrle_long"), read("oldrle"));
    assert_eq!((long.0, old.0), ((300, 8), (16, 8)));
    assert!(long.1.chunks(300).zip(old.1.chunks(16)).all(|(a, b)| a[299] == b[15] && a[0] == b[0]));
    let pair = lights(&folder.join("pair_{light}.hdr"), None).unwrap();
    let quarter = pair.images[1].iter().map(|pixel| pixel.map(|v| v / 4.0)).collect::<Vec<_>>();
    assert_eq!(pair.images[0], quarter);
    let [plain, exposed] = ["sky_plain.toml", "sky_exposure4.toml"].map(|name| sky_weights(&folder.join(name)).0);
    assert_eq!(plain.len(), exposed.len());
    plain.iter().zip(&exposed).for_each(|(a, b)| near(*a, *b, 1e-5));
}

pub(super) fn skies(folder: &Path) {
    let weights = |name: &str| sky_weights(&folder.join(name)).0;
    let (cropped, full) = (weights("upper_cropped.toml"), weights("upper_full.toml"));
    cropped.iter().zip(&full).for_each(|(a, b)| near(*a, *b, 1e-5));
    assert!(weights("lower_full.toml")[0] == [0.0; 3]);
}

pub(super) fn numpy(folder: &Path) {
    let base = lights(&folder.join("base.npy"), None).unwrap();
    for name in ["f64.npy", "v2.npy", "v3.npy", "view.npy", "trailing.npy"] {
        assert_eq!(lights(&folder.join(name), None).unwrap().size, base.size, "{name}");
    }
    for name in ["named.npz", "more.npz", "cjk.npz", "compressed.npz", "bytesnames.npz"] {
        assert_eq!(lights(&folder.join(name), None).unwrap().names.len(), 3, "{name}");
    }
    for name in [
        "arr0.npz",
        "be.npy",
        "dupnames.npz",
        "emptyname.npz",
        "fortran.npy",
        "grey.npy",
        "grey1.npy",
        "grid5d.npy",
        "hwcl.npy",
        "i32.npy",
        "lchw.npy",
        "obj.npy",
        "perlight.npz",
        "rgba.npy",
        "u16.npy",
        "u8.npy",
    ] {
        assert!(refused(&folder.join(name)).contains(name), "{name}");
    }
}

pub(super) fn olat(folder: &Path) {
    let found = lights(&folder.join("pfm/frame_{light}.pfm"), None).unwrap();
    let wanted: Vec<String> = (1..=16).map(|number| number.to_string()).collect();
    assert_eq!(found.names, wanted);
    // Image k holds the number k.
    assert!(found.images.iter().zip(1u8..).all(|(image, number)| image[0] == [f32::from(number); 3]));
    assert_eq!(lights(&folder.join("png8"), None).unwrap().names, wanted);
    assert_eq!(lights(&folder.join("mac"), None).unwrap().names, ["1", "2"]);
    assert_eq!(lights(&folder.join("mixed"), None).unwrap().names, ["1", "2", "3"]);
    assert!(refused(&folder.join("tiff16")).contains("TIFF"));
}

pub(super) fn light_names(folder: &Path) {
    assert_eq!(lights(&folder.join("usd.npz"), None).unwrap().names.len(), 6);
}
