//! OpenEXR: windows, colours, layers, names, views.

use super::radiance::sky_of;
use super::write::{
    Channel, Exr, constant, file, imported, lights, near, picture, refused, refused_picture, rgb, strings,
};

const ACESCG: [f32; 8] = [0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767];
/// Red of ACEScg in Rec. 709 by Bradford's adaptation, as OpenColorIO's and colour-science's matrices have it.
const ACESCG_RED: [f32; 3] = [1.70505, -0.13026, -0.02400];

pub(super) fn acescg() {
    let (_folder, path) = file("a.exr");
    let exr = Exr::new(4, 3).chromaticities(ACESCG);
    constant(&[("", [2.0, 0.0, 0.0])], &exr, &path);
    let (image, said) = picture(&path);
    near(rgb(image.pixels[5]), ACESCG_RED.map(|v| 2.0 * v), 1e-4);
    assert!(said.contains("ACEScg"), "{said}");
    // Layers as well, and the sum with them: white stays white.
    constant(&[("", [2.0, 1.0, 1.0]), ("RGBA_key", [1.0; 3]), ("RGBA_red", [1.0, 0.0, 0.0])], &exr, &path);
    let found = lights(&path, None).unwrap();
    assert_eq!((found.names.as_slice(), found.has_sum), (&["key".to_owned(), "red".into()][..], true));
    near(found.images[0][7], [1.0; 3], 1e-5);
    near(found.images[1][7], ACESCG_RED, 1e-4);
    assert!(found.warnings.contains("a.exr: its colours are converted from ACEScg"), "{}", found.warnings);
    // Those of Rec. 709 say nothing.
    let own = [0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290];
    constant(&[("", [2.0, 0.5, 0.25])], &Exr::new(4, 3).chromaticities(own), &path);
    assert_eq!((rgb(picture(&path).0.pixels[0]), picture(&path).1.as_str()), ([2.0, 0.5, 0.25], ""));
}

/// Tristimulus values are colours as they stand: those of white are IEC 61966-2-1's.
pub(super) fn xyz() {
    let (_folder, path) = file("a.exr");
    let third = 1.0 / 3.0;
    let exr = Exr::new(4, 3).chromaticities([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, third, third]);
    constant(&[("", [0.9505, 1.0, 1.0890])], &exr, &path);
    let (image, said) = picture(&path);
    near(rgb(image.pixels[0]), [1.0; 3], 1e-3);
    assert!(said.contains("CIE XYZ"), "{said}");
    let (weights, said) = sky_of(path.parent().unwrap(), "a.exr");
    weights.iter().for_each(|weight| near(*weight, [1.0; 3], 1e-3));
    assert!(said.contains("CIE XYZ"), "{said}");
}

pub(super) fn no_space() {
    let (_folder, path) = file("a.exr");
    for bad in [[0.3; 8], [0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3, 0.0], [f32::NAN; 8]] {
        constant(&[("", [1.0; 3]), ("RGBA_key", [1.0; 3])], &Exr::new(2, 2).chromaticities(bad), &path);
        assert!(refused_picture(&path).contains("no colour space"));
        assert!(refused(&path).contains("no colour space"));
    }
}

pub(super) fn named_space() {
    let (_folder, path) = file("a.exr");
    for (attribute, word, wanted) in [
        ("colorInteropID", "lin_ap1_scene", ACESCG_RED),
        ("oiio:ColorSpace", "ACEScg", ACESCG_RED),
        ("oiio:ColorSpace", "lin_rec709_scene", [1.0, 0.0, 0.0]),
        ("colorInteropID", "srgb_rec709_scene", [1.0, 0.0, 0.0]),
    ] {
        constant(&[("", [1.0, 0.0, 0.0])], &Exr::new(2, 2).with(attribute, "string", word.into()), &path);
        let (image, said) = picture(&path);
        near(rgb(image.pixels[0]), wanted, 1e-4);
        assert_eq!(said.is_empty(), word == "lin_rec709_scene", "{word}: {said}");
    }
}

/// A value that says where a pixel of the data window is.
fn placed(x: usize, y: usize) -> f32 {
    (1 + x + 10 * y) as f32
}

fn write_placed(exr: &Exr, path: &std::path::Path) {
    exr.write(path, &[("R", &placed), ("G", &placed), ("B", &placed)]);
}

pub(super) fn cropped_picture() {
    let (_folder, path) = file("a.exr");
    write_placed(&Exr::windows([12, 21, 3, 2], [10, 20, 8, 4]), &path);
    let (image, said) = picture(&path);
    assert_eq!((image.width, image.height, image.has_alpha), (8, 4, false));
    for (i, pixel) in image.pixels.iter().enumerate() {
        let inside = (2..5).contains(&(i % 8)) && (1..3).contains(&(i / 8));
        let wanted = if inside { placed(i % 8 - 2, i / 8 - 1) } else { 0.0 };
        assert_eq!(*pixel, [wanted, wanted, wanted, 1.0], "pixel {i}");
    }
    assert!(said.contains("3 × 2 pixels from 12, 21 on") && said.contains("the rest is black"), "{said}");
    // A panorama without its lower half: its light comes from above.
    let folder = path.parent().unwrap();
    let white = |_: usize, _: usize| 1.0;
    Exr::windows([0, 0, 8, 2], [0, 0, 8, 4]).write(&path, &[("R", &white), ("G", &white), ("B", &white)]);
    let (weights, said) = sky_of(folder, "a.exr");
    assert!(weights[..4].iter().all(|w| (w[0] - 1.0).abs() < 1e-5) && weights[4..].iter().all(|w| w[0] == 0.0));
    assert!(said.contains("a.exr: its data window of 8 × 2 pixels"), "{said}");
}

pub(super) fn overscan_picture() {
    let (_folder, path) = file("a.exr");
    write_placed(&Exr::windows([-2, -1, 9, 6], [0, 0, 4, 3]), &path);
    let (image, said) = picture(&path);
    assert_eq!((image.width, image.height), (4, 3));
    for (i, pixel) in image.pixels.iter().enumerate() {
        assert_eq!(pixel[0], placed(i % 4 + 2, i / 4 + 1), "pixel {i}");
    }
    assert!(said.contains("what lies beyond is left out"), "{said}");
}

pub(super) fn outside() {
    let (_folder, path) = file("a.exr");
    write_placed(&Exr::windows([0, 0, 9, 6], [0, 6, 9, 6]), &path);
    assert!(refused_picture(&path).contains("outside its display window"));
}

pub(super) fn cropped_lights() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_placed(&Exr::windows([0, 0, 8, 5], [0, 0, 8, 5]), &at("a_key.exr"));
    write_placed(&Exr::windows([5, 2, 2, 2], [0, 0, 8, 5]), &at("a_fill.exr"));
    let found = lights(&at("a_{light}.exr"), None).unwrap();
    assert_eq!((found.names.as_slice(), found.size), (&["fill".to_owned(), "key".into()][..], (8, 5)));
    for (i, (fill, key)) in found.images[0].iter().zip(&found.images[1]).enumerate() {
        let inside = (5..7).contains(&(i % 8)) && (2..4).contains(&(i / 8));
        let wanted = if inside { placed(i % 8 - 5, i / 8 - 2) } else { 0.0 };
        assert_eq!((fill[0], key[0]), (wanted, placed(i % 8, i / 8)), "pixel {i}");
    }
    assert!(found.warnings.contains("put back in their places"), "{}", found.warnings);
    // None of which has all of the picture, and one beyond it.
    write_placed(&Exr::windows([-1, 0, 2, 2], [0, 0, 8, 5]), &at("a_key.exr"));
    let found = lights(&at("a_{light}.exr"), None).unwrap();
    assert_eq!(found.size, (9, 5));
    assert_eq!((found.images[0][2 * 9 + 6][1], found.images[1][0][1], found.images[1][2][1]), (1.0, 1.0, 0.0));
}

pub(super) fn one_window() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for window in [[2, 1, 3, 2], [-2, -2, 12, 9]] {
        for name in ["a_key.exr", "a_fill.exr"] {
            write_placed(&Exr::windows(window, [0, 0, 8, 5]), &at(name));
        }
        let found = lights(&at("a_{light}.exr"), None).unwrap();
        assert_eq!(found.size, (window[2] as usize, window[3] as usize));
        assert_eq!(found.images[1][1][2], placed(1, 0));
        assert!(found.warnings.contains("of a picture of 8 × 5 pixels"), "{}", found.warnings);
    }
}

pub(super) fn other_frames() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_placed(&Exr::windows([0, 0, 8, 5], [0, 0, 8, 5]), &at("a_key.exr"));
    write_placed(&Exr::windows([0, 0, 8, 5], [1, 1, 8, 5]), &at("a_fill.exr"));
    let error = refused(&at("a_{light}.exr"));
    assert!(error.contains("a_key.exr") && error.contains("display window"), "{error}");
    write_placed(&Exr::new(7, 5), &at("a_fill.exr"));
    assert!(refused(&at("a_{light}.exr")).contains("8 × 5 pixels"));
}

pub(super) fn named_colours() {
    let (_folder, path) = file("a.exr");
    let value = |v: f32| move |_: usize, _: usize| v;
    let (one, two, four, other) = (value(1.0), value(2.0), value(4.0), value(9.0));
    let exr = Exr::new(3, 2);
    exr.write(
        &path,
        &[
            ("ViewLayer.Combined.R", &one),
            ("ViewLayer.Combined.G", &two),
            ("ViewLayer.Combined.B", &four),
            ("ViewLayer.Normal.X", &other),
            ("ViewLayer.Normal.Y", &other),
            ("ViewLayer.Normal.Z", &other),
            ("ViewLayer.DiffDir.R", &other),
            ("ViewLayer.DiffDir.G", &other),
            ("ViewLayer.DiffDir.B", &other),
        ],
    );
    assert_eq!((rgb(picture(&path).0.pixels[5]), picture(&path).1.as_str()), ([1.0, 2.0, 4.0], ""));
    exr.write(&path, &[("r", &one), ("g", &two), ("b", &four), ("a", &value(0.5))]);
    assert_eq!((picture(&path).0.pixels[5], picture(&path).0.has_alpha), ([1.0, 2.0, 4.0, 0.5], true));
    for grey in ["Y", "R", "Z", "beauty.Y"] {
        exr.write(&path, &[(grey, &two)]);
        assert_eq!(picture(&path).0.pixels[5], [2.0, 2.0, 2.0, 1.0], "{grey}");
    }
    exr.write(&path, &[("R", &one), ("G", &two)]);
    assert!(refused_picture(&path).contains("no layer of red, green and blue"));
    // Lights of one channel each.
    exr.write(&path, &[("key.Y", &one), ("fill.Y", &two)]);
    let found = lights(&path, None).unwrap();
    assert_eq!(found.names, ["fill", "key"]);
    assert_eq!((found.images[0][0], found.images[1][0]), ([2.0; 3], [1.0; 3]));
}

/// A slow gradient of colours, stored as the format says: luminance by Rec. 709's weights, shares of red and blue.
pub(super) fn chroma() {
    let (_folder, path) = file("a.exr");
    let (width, height) = (48, 40);
    let colour = |x: usize, y: usize| {
        let (u, v) = (x as f32 / width as f32, y as f32 / height as f32);
        [0.5 + 0.4 * u, 0.6 - 0.2 * v, 0.3 + 0.3 * u * v]
    };
    let luma = |x: usize, y: usize| {
        let [r, g, b] = colour(x, y);
        0.2126 * r + 0.7152 * g + 0.0722 * b
    };
    let red = |x: usize, y: usize| (colour(x, y)[0] - luma(x, y)) / luma(x, y);
    let blue = |x: usize, y: usize| (colour(x, y)[2] - luma(x, y)) / luma(x, y);
    for sampling in [[2, 2], [1, 1], [2, 1]] {
        let channels = vec![
            Channel { name: b"Y", sampling: [1, 1], value: &luma },
            Channel { name: b"RY", sampling, value: &red },
            Channel { name: b"BY", sampling, value: &blue },
        ];
        Exr::windows([2, 2, width, height], [0, 0, width + 2, height + 2]).write_channels(&path, channels);
        let (image, said) = picture(&path);
        assert_eq!(said.contains("interpolated"), sampling != [1, 1], "{said}");
        // Away from the edge on the right and below, beyond which chroma is continued evenly.
        for y in 0..height as usize - 16 {
            for x in 0..width as usize - 16 {
                let found = image.pixels[(y + 2) * (width as usize + 2) + x + 2];
                near(rgb(found), colour(x, y), 4e-3);
            }
        }
        assert_eq!(rgb(image.pixels[0]), [0.0; 3]);
    }
}

pub(super) fn chroma_layers() {
    let (_folder, path) = file("a.exr");
    let one = |_: usize, _: usize| 1.0;
    let channel = |name, sampling| Channel { name, sampling, value: &one };
    let channels =
        vec![channel(b"RGBA_key.Y", [1, 1]), channel(b"RGBA_key.RY", [2, 2]), channel(b"RGBA_key.BY", [2, 2])];
    Exr::new(4, 4).write_channels(&path, channels);
    let error = refused(&path);
    assert!(error.contains("'RGBA_key'") && error.contains("red, green and blue"), "{error}");
}

pub(super) fn several_pictures() {
    let (_folder, path) = file("a.exr");
    constant(&[("left wall", [1.0; 3]), ("right wall", [2.0; 3])], &Exr::new(2, 2), &path);
    let (image, said) = picture(&path);
    assert_eq!(rgb(image.pixels[0]), [1.0; 3]);
    assert!(said.contains("holds 2 pictures; 'left wall' is read"), "{said}");
}

pub(super) fn names_in() {
    let (_folder, path) = file("a.exr");
    let one = |_: usize, _: usize| 1.0;
    let mut names: Vec<Vec<u8>> = Vec::new();
    for colour in ["R", "G", "B"] {
        names.push(format!("V.Combined_Küche_Ost.{colour}").into_bytes());
        names.push(format!("V.Combined_照明.{colour}").into_bytes());
        // Latin-1.
        names.push([b"V.Combined_B\xfcro.".as_slice(), colour.as_bytes()].concat());
    }
    let channels = names.iter().map(|name| Channel { name, sampling: [1, 1], value: &one }).collect();
    Exr::new(2, 2).write_channels(&path, channels);
    let mut names = lights(&path, None).unwrap().names;
    names.sort();
    assert_eq!(names, ["Büro", "Küche_Ost", "照明"]);
}

/// The names are bytes of UTF-8 in the file, and come back.
pub(super) fn names_out() {
    let (_folder, path) = file("a.exr");
    let size = ltm::image::ImageSize { width: 2, height: 1 };
    let layers = ["Combined_Küche_Ost", "Combined_照明"].map(str::to_owned);
    let mut fetch = |image: usize, _: usize, _: usize, row: &mut [f32]| {
        row.fill(image as f32);
        Ok(())
    };
    ltm::image::write_exr_rows(&path, true, &layers, size, &mut fetch).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    for layer in &layers {
        let name = format!("{layer}.R\0");
        assert!(bytes.windows(name.len()).any(|window| window == name.as_bytes()), "{layer}");
    }
    let found = lights(&path, None).unwrap();
    assert_eq!((found.names, found.images[1][0]), (vec!["Küche_Ost".to_owned(), "照明".into()], [1.0; 3]));
    let long = ["x".repeat(300)];
    let error = ltm::image::write_exr_rows(&path, true, &long, size, &mut fetch).unwrap_err().to_string();
    assert!(error.contains("255 bytes"), "{error}");
}

const EYES: [(&str, [f32; 3]); 4] = [
    ("V.Combined.left", [1.0; 3]),
    ("V.Combined.right", [2.0; 3]),
    ("V.Combined_key.left", [1.0; 3]),
    ("V.Combined_key.right", [2.0; 3]),
];

pub(super) fn stereo_picture() {
    let (_folder, path) = file("a.exr");
    constant(&EYES[..2], &Exr::new(2, 2), &path);
    let (image, said) = picture(&path);
    assert!(image.pixels[0][0] == 1.0 && said.contains("several views; 'left' is read"), "{said}");
    // By the list of views, the first of which is not named in its channels.
    let exr = Exr::new(2, 2).with("multiView", "stringvector", strings(&["main", "other"]));
    constant(&[("", [1.0; 3]), ("other", [2.0; 3])], &exr, &path);
    let (image, said) = picture(&path);
    assert!(image.pixels[0][0] == 1.0 && said.contains("'main' is read"), "{said}");
}

pub(super) fn stereo_lights() {
    let (_folder, path) = file("a.exr");
    constant(&EYES, &Exr::new(2, 2), &path);
    let error = refused(&path);
    assert!(
        error.contains("'left' and 'right'") && error.contains(r"`LayerPattern` '^V\.Combined_(.+)\.left$'"),
        "{error}"
    );
    let right = lights(&path, Some(r"^V\.Combined_(.+)\.right$")).unwrap();
    assert_eq!((right.names, right.has_sum, right.images[1][0]), (vec!["key".to_owned()], true, [2.0; 3]));
    let exr = Exr::new(2, 2).with("multiView", "stringvector", strings(&["main", "other"]));
    constant(&[("RGBA_key", [1.0; 3]), ("RGBA_key.other", [2.0; 3])], &exr, &path);
    assert!(refused(&path).contains("'main' and 'other'"));
}

pub(super) fn two_view_layers() {
    let (_folder, path) = file("a.exr");
    let two = ["A.Combined", "A.Combined_a", "B.Combined", "B.Combined_b"].map(|name| (name, [1.0; 3]));
    constant(&two, &Exr::new(2, 2), &path);
    assert!(refused(&path).contains("`LayerPattern`"));
    constant(&[two[1], two[3]], &Exr::new(2, 2), &path);
    assert!(refused(&path).contains("two view layers"));
    // Only one of them has lights.
    constant(&two[..3], &Exr::new(2, 2), &path);
    assert_eq!(lights(&path, None).unwrap().names, ["a"]);
}

pub(super) fn pass_names() {
    let (_folder, path) = file("a.exr");
    let names = ["UV strip", "chaos_key", "diffuser panel", "emitter", "env_dome", "key", "shadowbox"];
    let mut layers: Vec<(&str, [f32; 3])> = names.iter().map(|&name| (name, [1.0; 3])).collect();
    layers.extend([
        ("beauty", [7.0; 3]),
        ("diffuse_direct", [3.0; 3]),
        ("albedo", [0.5; 3]),
        ("VRayReflection", [0.5; 3]),
    ]);
    constant(&layers, &Exr::new(2, 2), &path);
    let found = lights(&path, None).unwrap();
    assert_eq!((found.names.iter().map(String::as_str).collect::<Vec<_>>(), found.has_sum), (names.to_vec(), true));
}

pub(super) fn noisy_image() {
    let (_folder, path) = file("a.exr");
    let layers = [
        ("V.Combined", [2.5; 3]),
        ("V.Noisy Image", [3.0; 3]),
        ("V.Combined_key", [1.0; 3]),
        ("V.Combined_fill", [2.0; 3]),
        ("V.Denoising Albedo", [0.5; 3]),
    ];
    constant(&layers, &Exr::new(2, 2), &path);
    let (names, difference, warnings) = imported(&path);
    assert_eq!((names, difference), (vec!["fill".to_owned(), "key".into()], Some(0.0)));
    assert!(!warnings.contains("Rest") && !warnings.contains("denois"), "{warnings}");
}

pub(super) fn copies_and_sums() {
    let (_folder, path) = file("a.exr");
    let lit = |layers: &[&str]| {
        let layers: Vec<_> = layers.iter().map(|&layer| (layer, [1.0; 3])).collect();
        constant(&layers, &Exr::new(2, 2), &path);
        let mut names = lights(&path, None).unwrap().names;
        names.sort();
        names
    };
    let arnold = ["", "RGBA_key", "RGBA_key_denoise", "RGBA_denoise", "RGBA_key_variance", "variance"];
    assert_eq!(lit(&arnold), ["key"]);
    let vray = ["", "VRayLightMix", "VRayLighting", "VRayLightSelect_Key", "VRayLightSelect_Fill"];
    assert_eq!(lit(&vray), ["Fill", "Key"]);
    let corona = ["", "CShading_Beauty", "CShading_LightMix", "CShading_LightSelect_Key"];
    assert_eq!(lit(&corona), ["Key"]);
    let mix = ["", "LightMix", "LightMix_Key", "Environment", "Rest", "Self_Illumination"];
    assert_eq!(lit(&mix), ["Environment", "Key", "Rest", "Self_Illumination"]);
    assert_eq!(lit(&["RGB_IMAGEPIPELINE", "RADIANCE_GROUP#0", "RADIANCE_GROUP#1"]), ["0", "1"]);
}

pub(super) fn renderers() {
    let (_folder, path) = file("a.exr");
    // Each layer is what its light gives: of two lights the picture is 2.
    let lit = |layers: &[(&str, f32)]| {
        let layers: Vec<_> = layers.iter().map(|&(layer, value)| (layer, [value; 3])).collect();
        constant(&layers, &Exr::new(2, 2), &path);
        let found = lights(&path, None).unwrap();
        assert!(found.has_sum, "{layers:?}");
        let mut names = found.names;
        names.sort();
        names
    };
    let karma = [("C", 2.0), ("C_Key", 1.0), ("C_Fill", 1.0), ("directdiffuse_Key", 0.5), ("directdiffuse", 1.0)];
    assert_eq!(lit(&karma), ["Fill", "Key"]);
    let renderman = [("Ci", 2.0), ("Ci_key", 1.0), ("Ci_fill", 1.0), ("specular_key", 0.5), ("albedo", 0.8)];
    assert_eq!(lit(&renderman), ["fill", "key"]);
    let redshift = [("", 2.0), ("Beauty_key", 1.0), ("Beauty_other", 1.0), ("GI_key", 0.5), ("Cryptomatte00", 0.3)];
    assert_eq!(lit(&redshift), ["key", "other"]);
    let octane = [("Beauty", 2.0), ("Light pass 1", 1.0), ("Light pass 1 direct", 0.5), ("Sunlight", 1.0)];
    assert_eq!(lit(&octane), ["Light pass 1", "Sunlight"]);
}

pub(super) fn sum_of_others() {
    let (_folder, path) = file("a.exr");
    let layers =
        [("a", [1.0, 2.0, 0.5]), ("b", [0.5, 0.0, 1.0]), ("c", [0.0, 0.25, 0.0]), ("everything", [1.5, 2.25, 1.5])];
    constant(&layers, &Exr::new(2, 2), &path);
    let (_, _, warnings) = imported(&path);
    assert!(warnings.contains("'everything' is the sum of the others"), "{warnings}");
    constant(&layers[..3], &Exr::new(2, 2), &path);
    assert!(!imported(&path).2.contains("is the sum"));
}
