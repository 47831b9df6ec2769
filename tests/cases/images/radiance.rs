//! Radiance HDR.

use super::write::{file, lights, near, picture, refused_picture, rgb};

/// 3 × 2 pixels of which no two are alike, flat.
const PIXELS: [[u8; 4]; 6] =
    [[128, 0, 0, 129], [0, 128, 0, 129], [0, 0, 128, 129], [128, 128, 0, 130], [0, 128, 128, 130], [128, 0, 128, 130]];
const COLOURS: [[f32; 3]; 6] =
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [2.0, 2.0, 0.0], [0.0, 2.0, 2.0], [2.0, 0.0, 2.0]];

fn flat(head: &str, size: &str, pixels: &[[u8; 4]]) -> Vec<u8> {
    [head.as_bytes(), size.as_bytes(), b"\n", pixels.as_flattened()].concat()
}

/// One grey pixel of value 1 under lines of a head: what it becomes, and what is said.
fn one(lines: &str) -> ([f32; 3], String) {
    let (_folder, path) = file("a.hdr");
    std::fs::write(&path, flat(&format!("#?RADIANCE\n{lines}\n"), "-Y 1 +X 1", &[[128, 128, 128, 129]])).unwrap();
    let (image, said) = picture(&path);
    (rgb(image.pixels[0]), said)
}

pub(super) fn exposure() {
    let (found, said) = one("FORMAT=32-bit_rle_rgbe\nEXPOSURE=4\nrpict -x 16\nEXPOSURE= 2.000000e+00\n");
    assert_eq!(found, [0.125; 3]);
    assert!(said.contains("EXPOSURE of 8 is divided out"), "{said}");
    assert_eq!(one("EXPOSURE=1.0\n"), ([1.0; 3], String::new()));
    // Of lights, too, each file by its own.
    let folder = tempfile::tempdir().unwrap();
    for (name, exposure) in [("key", 4), ("fill", 1)] {
        let head = format!("#?RADIANCE\nEXPOSURE={exposure}\n\n");
        std::fs::write(folder.path().join(format!("{name}.hdr")), flat(&head, "-Y 2 +X 3", &PIXELS)).unwrap();
    }
    let found = lights(folder.path(), None).unwrap();
    assert_eq!(found.names, ["fill", "key"]);
    assert_eq!(found.images[0], COLOURS);
    assert_eq!(found.images[1], COLOURS.map(|colour| colour.map(|v| v / 4.0)));
    assert!(found.warnings.contains("key.hdr: its EXPOSURE of 4"), "{}", found.warnings);
}

pub(super) fn correction() {
    let (found, said) = one("COLORCORR= 2 1 0.5\nEXPOSURE=2\nCOLORCORR=2 1 1\n");
    assert_eq!(found, [0.125, 0.5, 1.0]);
    assert!(said.contains("COLORCORR of 4 1 0.5"), "{said}");
}

pub(super) fn no_exposure() {
    let (_folder, path) = file("a.hdr");
    for line in
        ["EXPOSURE=0", "EXPOSURE=-1", "EXPOSURE=nan", "EXPOSURE=inf", "EXPOSURE=", "COLORCORR=1 0 1", "COLORCORR=1 1"]
    {
        std::fs::write(&path, flat(&format!("#?RADIANCE\n{line}\n\n"), "-Y 1 +X 1", &[[1, 2, 3, 128]])).unwrap();
        let error = refused_picture(&path);
        assert!(error.contains("a.hdr") && error.contains(line.split('=').next().unwrap()), "{error}");
    }
    // A product beyond numbers.
    std::fs::write(&path, flat(&format!("#?RADIANCE\n{}\n", "EXPOSURE=1e30\n".repeat(20)), "-Y 1 +X 1", &[[1; 4]]))
        .unwrap();
    assert!(refused_picture(&path).contains("exposures"));
}

/// XYZ of (4, 2, 1) by IEC 61966-2-1, in 8 bits and an exponent.
pub(super) fn xyze() {
    let (_folder, path) = file("a.hdr");
    std::fs::write(&path, flat("#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n", "-Y 1 +X 1", &[[162, 150, 81, 130]])).unwrap();
    let (image, said) = picture(&path);
    near(rgb(image.pixels[0]), [4.0, 2.0, 1.0], 0.04);
    assert!(said.contains("CIE XYZ"), "{said}");
}

/// White stays white, and red of Rec. 2020 is that of ITU-R BT.2087.
pub(super) fn primaries() {
    let (white, said) = one("PRIMARIES= 0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.3290\n");
    near(white, [1.0; 3], 1e-5);
    assert!(said.contains("Rec. 2020"), "{said}");
    let (_folder, path) = file("a.hdr");
    let head = "#?RADIANCE\nPRIMARIES=0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.3290\n\n";
    std::fs::write(&path, flat(head, "-Y 1 +X 1", &[[128, 0, 0, 129]])).unwrap();
    near(rgb(picture(&path).0.pixels[0]), [1.6605, -0.1246, -0.0182], 1e-3);
    assert_eq!(one("PRIMARIES=0.640 0.330 0.300 0.600 0.150 0.060 0.3127 0.3290\n"), ([1.0; 3], String::new()));
}

/// The pixels of the picture in the order in which the axes say that they are stored.
pub(super) fn orders() {
    let (_folder, path) = file("a.hdr");
    for (size, order) in [
        ("-Y 2 +X 3", [0, 1, 2, 3, 4, 5]),
        ("-Y 2 -X 3", [2, 1, 0, 5, 4, 3]),
        ("+Y 2 +X 3", [3, 4, 5, 0, 1, 2]),
        ("+Y 2 -X 3", [5, 4, 3, 2, 1, 0]),
        ("+X 3 -Y 2", [0, 3, 1, 4, 2, 5]),
        ("-X 3 -Y 2", [2, 5, 1, 4, 0, 3]),
        ("+X 3 +Y 2", [3, 0, 4, 1, 5, 2]),
        ("-X 3 +Y 2", [5, 2, 4, 1, 3, 0]),
    ] {
        std::fs::write(&path, flat("#?RADIANCE\n\n", size, &order.map(|i| PIXELS[i]))).unwrap();
        let (image, said) = picture(&path);
        assert_eq!((image.width, image.height, said.as_str()), (3, 2, ""), "{size}");
        assert_eq!(image.pixels.into_iter().map(rgb).collect::<Vec<_>>(), COLOURS, "{size}");
    }
}

pub(super) fn line_ends() {
    let (_folder, path) = file("a.hdr");
    let head = "#?RADIANCE\r\nFORMAT=32-bit_rle_rgbe\r\nEXPOSURE=2\r\n\r\n-Y 2 +X 3\r\n";
    std::fs::write(&path, [head.as_bytes(), PIXELS.as_flattened()].concat()).unwrap();
    assert_eq!(rgb(picture(&path).0.pixels[3]), [1.0, 1.0, 0.0]);
}

pub(super) fn signatures() {
    let (_folder, path) = file("a.hdr");
    for head in [
        "#?RGBE\n\n",
        "#?RADIANCE\nSOFTWARE=x\n\n",
        "FORMAT=32-bit_rle_rgbe\n\n",
        "#?AUTOPANO\nFORMAT=32-bit_rle_rgbe\n\n",
    ] {
        std::fs::write(&path, flat(head, "-Y 2 +X 3", &PIXELS)).unwrap();
        assert_eq!(picture(&path).0.pixels.into_iter().map(rgb).collect::<Vec<_>>(), COLOURS, "{head}");
    }
}

/// A scanline of 300 pixels of one colour and 4 of another, three ways.
pub(super) fn encodings() {
    let (_folder, path) = file("a.hdr");
    let [first, last] = [[64u8, 128, 32, 130], [8, 9, 10, 136]];
    let flat_line = [vec![first; 300], vec![last; 4]].concat();
    // 299 = 43 + 1 · 256 repeats.
    let old = [first, [1, 1, 1, 43], [1, 1, 1, 1], last, last, [1, 1, 1, 2]];
    let mut new = vec![2, 2, 1, 48];
    for component in 0..4 {
        new.extend([128 + 127, first[component], 128 + 127, first[component], 128 + 46, first[component]]);
        new.extend([4, last[component], last[component], last[component], last[component]]);
    }
    for body in [flat_line.as_flattened(), old.as_flattened(), &new] {
        // Two scanlines of one kind, then one of another, as each is by itself.
        let bytes = [b"#?RADIANCE\n\n-Y 3 +X 304\n", body, body, old.as_flattened()].concat();
        std::fs::write(&path, bytes).unwrap();
        let image = picture(&path).0;
        for (i, pixel) in image.pixels.iter().enumerate() {
            let wanted = if i % 304 < 300 { [1.0, 2.0, 0.5] } else { [8.0, 9.0, 10.0] };
            assert_eq!(rgb(*pixel), wanted, "pixel {i}");
        }
    }
}

pub(super) fn damaged() {
    let (_folder, path) = file("a.hdr");
    let whole = flat("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n", "-Y 2 +X 3", &PIXELS);
    for length in 1..whole.len() {
        std::fs::write(&path, &whole[..length]).unwrap();
        assert!(refused_picture(&path).contains("a.hdr"), "cut at {length}");
    }
    let new_line = |body: &[u8]| [b"#?RADIANCE\n\n-Y 1 +X 8\n", [2, 2, 0, 8].as_slice(), body].concat();
    for bytes in [
        flat("#?RADIANCE\nFORMAT=32-bit_rle_yuv\n\n", "-Y 2 +X 3", &PIXELS),
        flat("#?RADIANCE\n\n", "-Y 2 +Y 3", &PIXELS),
        new_line(&[0, 1]),
        new_line(&[128 + 9, 1, 128 + 8, 1, 128 + 8, 1, 128 + 8, 1]),
        [b"#?RADIANCE\n\n-Y 1 +X 8\n".as_slice(), &[2, 2, 0, 9, 136, 1, 136, 1, 136, 1, 136, 1]].concat(),
    ] {
        std::fs::write(&path, bytes).unwrap();
        refused_picture(&path);
    }
}

/// Weights of the columns of a sky, and what is said.
pub(super) fn sky_of(folder: &std::path::Path, map: &str) -> (Vec<[f32; 3]>, String) {
    std::fs::write(folder.join("floor.obj"), "v -1 0 -1\nv -1 0 1\nv 1 0 1\nv 1 0 -1\nf 1 2 3 4\n").unwrap();
    let scene = format!(
        "geometry = [\"floor.obj\"]\n[camera]\neye = [0, 5, 0]\nlook_at = [0, 0, 0]\nup = [0, 0, -1]\n[[light]]\nkind = \
         \"environment\"\nmap = \"{map}\"\ntexels = [4, 2]\n"
    );
    let path = folder.join("scene.toml");
    std::fs::write(&path, scene).unwrap();
    sky_weights(&path)
}

pub(super) fn sky_weights(path: &std::path::Path) -> (Vec<[f32; 3]>, String) {
    let loaded = ltm::scene::load(path).unwrap();
    (loaded.scene.basis.scene_weights(), loaded.warnings.lines().join("\n"))
}

pub(super) fn sky() {
    let folder = tempfile::tempdir().unwrap();
    let pixels = vec![[128, 128, 128, 131]; 8];
    std::fs::write(folder.path().join("sky.hdr"), flat("#?RADIANCE\nEXPOSURE=4\n\n", "-Y 2 +X 4", &pixels)).unwrap();
    let (weights, said) = sky_of(folder.path(), "sky.hdr");
    weights.iter().for_each(|weight| near(*weight, [1.0; 3], 1e-5));
    assert!(said.contains("sky.hdr: its EXPOSURE of 4"), "{said}");
}
