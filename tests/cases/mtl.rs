//! MTL of many exporters: what is read of the statements, and what each program means by them.

use std::f32::consts::PI;
use std::path::Path;

use glam::{Vec2, Vec3};
use ltm::scene::{FloatTexture, LoadedScene, Material, Paint, Placing, Relief, Surface};

use super::Outcome::{Converted, Read, Warned};
use super::room::{FACES, Folder, MATERIALS, VERTICES, seen};
use super::{Case, Collection};

pub(super) const CASES: &[Case] = &[
    Case { format: "MTL", input: "statements in other upper and lower case", outcome: Read, test: keys_in_any_case },
    Case { format: "MTL", input: "text before the first `newmtl`", outcome: Warned, test: text_before },
    Case {
        format: "MTL",
        input: "a bare `Ns`, `Kd 1 x 1`, `Kd nan 0 0`, `Kd xyz`, `Kd spectral`, negative colours",
        outcome: Warned,
        test: bad_values,
    },
    Case {
        format: "MTL",
        input: "options of maps, known and unknown, before the name or behind it",
        outcome: Read,
        test: options,
    },
    Case { format: "MTL", input: "`-s` and `-o`, of each map its own", outcome: Read, test: placed_maps },
    Case { format: "MTL", input: "a map scaled by 0", outcome: Warned, test: flat_maps },
    Case { format: "MTL", input: "`-clamp on`", outcome: Read, test: clamped_maps },
    Case { format: "MTL", input: "`map_Ks` and `map_Ns`", outcome: Read, test: maps_of_gloss },
    Case { format: "MTL", input: "Blender: a map of roughness as `map_Ns`", outcome: Converted, test: roughness_as_ns },
    Case {
        format: "MTL",
        input: "images with blanks, `#` or quotation marks in their names",
        outcome: Read,
        test: names_of_images,
    },
    Case {
        format: "MTL",
        input: "images by `\\`, in other upper and lower case",
        outcome: Converted,
        test: respelled_images,
    },
    Case { format: "MTL", input: "images in folders of another machine", outcome: Converted, test: moved_images },
    Case {
        format: "MTL",
        input: "Maya: opaque materials (`illum 4`, `Tf 1 1 1`, `Ni 1.00`, no `d`)",
        outcome: Converted,
        test: maya_opaque,
    },
    Case { format: "MTL", input: "Maya: glass (`Tf` below 1)", outcome: Converted, test: maya_glass },
    Case {
        format: "MTL",
        input: "Maya: textures (`Kd 0 0 0` beside `map_Kd`)",
        outcome: Converted,
        test: maya_textures,
    },
    Case {
        format: "MTL",
        input: "photogrammetry, MeshLab: `Tr 1.000000` of opaque materials",
        outcome: Converted,
        test: opacity_as_tr,
    },
    Case { format: "MTL", input: "Blender: `Kd` beside `map_Kd`", outcome: Converted, test: blender_kd },
    Case {
        format: "MTL",
        input: "3ds Max: `Material #25`, `Kd 0.588` beside `map_Kd`, `Tf 1 1 1` with `illum 2`",
        outcome: Converted,
        test: max,
    },
    Case { format: "MTL", input: "others: a `Kd` between 0 and 1 beside `map_Kd`", outcome: Converted, test: other_kd },
    Case {
        format: "MTL",
        input: "SketchUp: `d` of an untextured glass without `illum` or `Ni`",
        outcome: Read,
        test: sketchup_glass,
    },
    Case { format: "MTL", input: "Rhino: `Tf 0 0 0`, `d 1` and no `illum`", outcome: Read, test: rhino },
    Case { format: "MTL", input: "Revit by IfcOpenShell: panes of `d 0.1`, no name", outcome: Read, test: revit_panes },
    Case {
        format: "MTL",
        input: "Mineways: a first line without `#`, `map_d` beside `map_Kd`",
        outcome: Read,
        test: mineways,
    },
    Case {
        format: "MTL",
        input: "`d` or `Tr` of glass by `illum` (4, 6, 7, 9) of `Ni` 1.1 or more",
        outcome: Converted,
        test: panes,
    },
    Case { format: "MTL", input: "the same of a closed body", outcome: Converted, test: bodies },
    Case { format: "MTL", input: "`d` and `Tr` otherwise", outcome: Read, test: shares },
    Case {
        format: "MTL",
        input: "`d 0`, `Tr 1` or glass of index 1 without `Ks`, `Tf`: what nobody would see",
        outcome: Warned,
        test: unseen,
    },
    Case {
        format: "MTL",
        input: "`[[material]]` with `kind`, `opacity` or `colour_times_map`",
        outcome: Read,
        test: overruled,
    },
    Case {
        format: "MTL",
        input: "`map_Pr`, `map_Pm`, `norm`, `map_Bump` and `bump`",
        outcome: Read,
        test: maps_of_numbers,
    },
    Case { format: "MTL", input: "the same maps, missing", outcome: Warned, test: missing_maps_of_numbers },
    Case { format: "MTL", input: "`map_d` between 0 and 1", outcome: Read, test: opacity_by_map },
];

pub(super) const COLLECTIONS: &[Collection] = &[Collection { folder: "32-mtl-dialects", test: dialects }];

const LAMP: &str = "\nnewmtl panel\nKd 0 0 0\nKe 10 10 10\n";

/// The room with a floor of this description, and a lamp.
fn floor_of(text: &str) -> Folder {
    Folder::of_mtl(format!("{text}{LAMP}"))
}

/// The same with texture coordinates, beside an image of a half.
fn textured(text: &str) -> Folder {
    let faces = FACES.replace("f 1 4 3 2", "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 4/4 3/3 2/2");
    floor_of(text).with("room.obj", format!("mtllib room.mtl\n{VERTICES}{faces}")).with_grey("wood.png")
}

fn material<'a>(loaded: &'a LoadedScene, name: &str) -> &'a Material {
    loaded.scene.materials.iter().find(|material| material.name == name).expect("the material")
}

/// What multiplies the image of the floor.
fn factor(loaded: &LoadedScene) -> [f32; 3] {
    match material(loaded, "grey").surface {
        Surface::Lambert { reflectance: Paint::Textured(_, factor) }
        | Surface::Coated { reflectance: Paint::Textured(_, factor), .. } => factor.to_array(),
        other => panic!("no image: {other:?}"),
    }
}

fn keys_in_any_case() {
    floor_of("NEWMTL grey\nkd 0.5 0.5 0.5\nKS 0 0 0\nILLUM 1").shows(1.0, &[]);
}

fn text_before() {
    let text = "# By hand\nNs 20\nKd 1 1 1\nnewmtl grey\nKd 0.5 0.5 0.5\n";
    floor_of(text).shows(1.0, &["room.mtl: 2 statements before the first newmtl", "line 2"]);
}

fn bad_values() {
    let bad = [
        "Ns",
        "d",
        "map_Kd",
        "Ks 1 x 1",
        "Ks 1 2",
        "Ke nan 0 0",
        "Ks xyz 0.4 0.4 0.4",
        "Ks spectral a.rfl",
        "Ke -1 0 0",
        "illum two",
    ];
    for statement in bad {
        let text = format!("newmtl grey\nKd 0.5 0.5 0.5\n{statement}\n");
        let key = statement.split(' ').next().expect("a key");
        floor_of(&text).shows(1.0, &["room.mtl: 1 values", "line 3", &format!("'{key}'")]);
    }
}

fn options() {
    let options = [
        "-colorspace sRGB wood.png",
        "-colorspace linear -bm 0.5 wood.png",
        "-blendu on -blendv off -boost 2 wood.png",
        "-mm 0 1 -texres 512 -imfchan l -cc on wood.png",
        "-clamp off wood.png",
        "-type sphere wood.png",
        "-t 0 0 0 wood.png",
        "-projection uv wood.png",
        "-weight 0.5 2 wood.png",
        "wood.png -s 1 1 1",
        "wood.png -colorspace sRGB",
    ];
    for map in options {
        // 188 of 255 in sRGB is 0.503.
        textured(&format!("newmtl grey\nKd 1 1 1\nmap_Kd {map}\n")).shows(1.0057, &[]);
    }
}

fn placed_maps() {
    let loaded = textured("newmtl grey\nKd 1 1 1\nmap_Kd -s 4 2 1 -o 0.5 0.25 0 wood.png\n").loads(&[]);
    // Coordinates are scaled, then moved, as the importers of Blender and three.js do.
    let mut corners: Vec<[f32; 2]> =
        loaded.scene.mesh.vertices[..4].iter().map(|vertex| vertex.uv.to_array()).collect();
    corners.sort_by(|a, b| a.partial_cmp(b).expect("numbers"));
    assert_eq!(corners, [[0.5, 0.25], [0.5, 2.25], [4.5, 0.25], [4.5, 2.25]]);
    // Others lie by what is left: where the first map has (u, v) → (4u + 0.5, 2v + 0.25), this one has (2u, −2v + 1).
    let text =
        "newmtl grey\nKd 1 1 1\nmap_Kd -s 4 2 1 -o 0.5 0.25 0 wood.png\nillum 1\nbump -s 2 -2 1 -o 0 1 0 wood.png\n";
    let loaded = textured(text).loads(&[]);
    let Some(Relief::Heights(id, _)) = material(&loaded, "grey").relief else { panic!("no heights") };
    let Placing { scale, offset, is_clamped } = loaded.scene.textures[id.0 as usize].placing;
    let (u, v) = (0.3, 0.8);
    let found = Vec2::new(4.0 * u + 0.5, 2.0 * v + 0.25) * scale + offset;
    assert!((found - Vec2::new(2.0 * u, -2.0 * v + 1.0)).length() < 1e-6 && !is_clamped, "{found}");
}

fn flat_maps() {
    textured("newmtl grey\nKd 1 1 1\nmap_Kd -s 0 0 0 wood.png\n").shows(1.0057, &["'grey'", "scaled by 0"]);
}

/// What a coat, a mirror or a metal reflects at normal incidence, and its roughness.
fn gloss(loaded: &LoadedScene) -> (Vec3, f32) {
    let at = Vec2::splat(0.5);
    let textures = &loaded.scene.textures;
    match material(loaded, "grey").surface {
        Surface::Principled(found) => {
            let paint = if found.metallic.at(textures, at) == 1.0 { found.base } else { found.specular };
            (paint.at(textures, at), found.roughness.at(textures, at))
        }
        Surface::Mirror { reflectance } => (reflectance.at(textures, at), 0.0),
        Surface::RoughConductor { specular, alpha } => (specular.at(textures, at), alpha.sqrt()),
        Surface::Coated { specular, alpha, .. } => (specular, alpha.sqrt()),
        other => panic!("{other:?}"),
    }
}

fn maps_of_gloss() {
    // 188 of 255 is a colour of 0.5028, and the number 0.7373: 0.7373 of an exponent of 100 is a GGX α of √(2 / 75.73), a roughness of its root.
    let (colour, number) = (0.502_886_5f32, 188.0f32 / 255.0);
    let rough = |exponent: f32| (2.0 / (exponent * number + 2.0)).powf(0.25);
    let base = "newmtl grey\nKd 0.25 0.25 0.25\n";
    for (text, specular, roughness) in [
        // Of a lacquer of index 1.5, 4 %, times Ks and its map.
        ("Ks 0.5 0.5 0.5\nNs 100\nmap_Ks wood.png\n", 0.04 * 0.5 * colour, (2.0f32 / 102.0).powf(0.25)),
        ("Ks 0.5 0.5 0.5\nNs 100\nmap_Ns wood.png\n", 0.04 * 0.5, rough(100.0)),
        ("Ks 0 0 0\nNs 100\nmap_Ks wood.png\nmap_Ns wood.png\n", 0.04 * colour, rough(100.0)),
        ("map_Ks wood.png\nmap_Ns wood.png\n", 0.04 * colour, rough(1000.0)),
        ("illum 3\nKs 0.2 0.2 0.2\nNs 100\nmap_Ks wood.png\n", 0.2 * colour, (2.0f32 / 102.0).powf(0.25)),
        // Mirrors and metals.
        ("illum 3\nKs 0.8 0.8 0.8\nmap_Ks wood.png\n", 0.8 * colour, 0.0),
        ("illum 3\nKs 0.8 0.8 0.8\nNs 100\nmap_Ks wood.png\nmap_Ns wood.png\n", 0.8 * colour, rough(100.0)),
        ("illum 3\nKs 0.8 0.8 0.8\nNs 1000\nmap_Ns wood.png\n", 0.8, rough(1000.0)),
    ] {
        let (found, alpha) = gloss(&textured(&format!("{base}{text}")).loads(&[]));
        // Roughness has eight bits.
        assert!((found - Vec3::splat(specular)).abs().max_element() < 1e-3 * specular, "{text}: {found} {specular}");
        assert!((alpha - roughness).abs() < 0.5 / 255.0 + 1e-6, "{text}: {alpha} {roughness}");
    }
    // Where nothing shines, and where Pr or Pm say what does, they are not used; nor is a map that is missing.
    let loaded = textured(&format!("{base}illum 1\nmap_Ks wood.png\nmap_Ns wood.png\n")).loads(&[]);
    assert!(matches!(material(&loaded, "grey").surface, Surface::Lambert { .. }));
    let loaded = textured(&format!("{base}Pr 0.5\nmap_Ks wood.png\n")).loads(&[]);
    assert!(matches!(material(&loaded, "grey").surface, Surface::Coated { .. }));
    let text = format!("{base}illum 2\nmap_Ns none.png\n");
    let loaded = textured(&text).loads(&["1 textures of roughness", "none.png"]);
    assert!(matches!(material(&loaded, "grey").surface, Surface::Lambert { .. }));
}

fn roughness_as_ns() {
    let text = "# Blender 4.2.0 MTL File: 'a.blend'\nnewmtl grey\nKs 0.5 0.5 0.5\nNs 100\nmap_Ns wood.png\n";
    let (_, roughness) = gloss(&textured(text).loads(&[]));
    assert!((roughness - 188.0 / 255.0).abs() < 1e-6, "{roughness}");
}

fn maps_of_numbers() {
    let text = "newmtl grey\nKd 0.5 0.5 0.5\nPr 1\nPm 0.5\nmap_Pr wood.png\nmap_Pm wood.png\nmap_Bump -bm 2 wood.png\n";
    let loaded = textured(text).loads(&[]);
    let grey = material(&loaded, "grey");
    let Surface::Principled(found) = grey.surface else { panic!("{:?}", grey.surface) };
    let at = |level: FloatTexture| level.at(&loaded.scene.textures, Vec2::splat(0.5));
    // 188 of 255, which is a number here.
    assert!((at(found.roughness) - 188.0 / 255.0).abs() < 1e-6 && (at(found.metallic) - 94.0 / 255.0).abs() < 1e-6);
    // Grey is a map of heights, which is even here: the floor looks as without.
    assert!(
        matches!(grey.relief, Some(Relief::Heights(_, factor)) if (factor - 0.02).abs() < 1e-6),
        "{:?}",
        grey.relief
    );
    textured("newmtl grey\nKd 0.5 0.5 0.5\nillum 1\nbump wood.png\n").shows(1.0, &[]);
    let alone = textured("newmtl grey\nKd 0.5 0.5 0.5\nmap_Pm wood.png\n").loads(&[]);
    let Surface::Principled(found) = material(&alone, "grey").surface else { panic!("a map of metal alone") };
    let metal = found.metallic.at(&alone.scene.textures, Vec2::splat(0.5));
    assert!((metal - 188.0 / 255.0).abs() < 1e-6, "{metal}");
}

fn missing_maps_of_numbers() {
    let text = "newmtl grey\nKd 0.5 0.5 0.5\nillum 1\nnorm none.png\nbump gone.png\n";
    textured(text).shows(1.0, &["2 textures of roughness, metal or normals are missing", "none.png", "'grey'"]);
}

fn opacity_by_map() {
    // 188 of 255 of the light meets the floor, and below it is nothing.
    textured("newmtl grey\nKd 0.5 0.5 0.5\nillum 1\nmap_d wood.png\n").shows(188.0 / 255.0, &[]);
}

fn clamped_maps() {
    let loaded = textured("newmtl grey\nKd 1 1 1\nillum 1\nmap_Kd -s 2 2 2 -clamp on ramp.png\n");
    let ramp: Vec<u8> = (0..4).flat_map(|x| [60 * x; 3]).collect();
    image::RgbImage::from_raw(4, 1, ramp)
        .expect("four pixels")
        .save(loaded.path("ramp.png"))
        .expect("a temporary image");
    let loaded = loaded.loads(&[]);
    let Surface::Lambert { reflectance } = material(&loaded, "grey").surface else { panic!("no image") };
    let at = |u: f32| reflectance.at(&loaded.scene.textures, Vec2::new(u, 0.5)).x;
    // Beyond its edges the last texels go on; the first and the last do not mix there.
    assert_eq!((at(-0.7), at(0.0), at(1.0), at(1.6)), (at(0.125), at(0.125), at(0.875), at(0.875)));
    assert!(at(0.125) == 0.0 && at(0.875) > 0.4, "{} {}", at(0.125), at(0.875));
}

fn names_of_images() {
    for name in ["my wood.png", "\"my wood.png\"", "./maps//my wood.png", "wood #2.png"] {
        let text = format!("newmtl grey\nKd 1 1 1\nmap_Kd {name}\n");
        textured(&text)
            .with_grey("my wood.png")
            .with_grey("maps/my wood.png")
            .with_grey("wood #2.png")
            .shows(1.0057, &[]);
    }
}

fn respelled_images() {
    for name in ["WOOD.PNG", "maps\\Bark.png", "MAPS\\bark.PNG"] {
        let text = format!("newmtl grey\nKd 1 1 1\nmap_Kd {name}\n");
        textured(&text).with_grey("maps/Bark.png").shows(1.0057, &["1 texture name differs"]);
    }
}

fn moved_images() {
    for name in [
        "C:\\Users\\x\\wood.png",
        "/Users/x/3D/ TEXTURES/wood.png",
        "..\\other\\wood.png",
        "D:\\maps\\bark.png",
        "/home/x/bark.png",
    ] {
        let text = format!("newmtl grey\nKd 1 1 1\nmap_Kd {name}\n");
        textured(&text)
            .with_grey("maps/bark.png")
            .shows(1.0057, &["1 texture is not where it is said to be", ".png is read from"]);
    }
    textured("newmtl grey\nmap_Kd /home/x/none.png\n").refused(&["none.png", "missing", "'grey'"]);
}

fn maya_opaque() {
    let text = "newmtl grey\nillum 4\nKd 0.50 0.50 0.50\nKa 0.00 0.00 0.00\nTf 1.00 1.00 1.00\nNi 1.00\n\
        newmtl panel\nillum 4\nKd 0 0 0\nTf 1.00 1.00 1.00\nNi 1.00\nKe 10 10 10\n";
    Folder::of_mtl(text).shows(1.0, &["room.mtl", "Maya"]);
}

/// A pane of this description at half the height, under a light that is seen by it alone.
fn under_a_pane(text: &str) -> Folder {
    let pane = "v -4 1.5 -4\nv 4 1.5 -4\nv 4 1.5 4\nv -4 1.5 4\nusemtl pane\nf -4 -1 -2 -3\n";
    Folder::of_mtl(text).with("room.obj", format!("mtllib room.mtl\n{VERTICES}{FACES}{pane}"))
}

fn maya_glass() {
    let maya = "newmtl grey\nillum 4\nKd 0.5 0.5 0.5\nTf 1.00 1.00 1.00\nNi 1.00\nnewmtl panel\nillum 4\nTf 1 1 1\nNi 1.00\n\
        Ke 10 10 10\nnewmtl pane\nillum 4\nKd 0.5 0.5 0.5\nTf 0.20 0.40 0.60\nNi 1.00\n";
    let loaded = under_a_pane(maya).load().expect("it loads");
    // A sheet that lets 1 - Tf through.
    let Surface::ThinDielectric { transmittance, .. } = material(&loaded, "pane").surface else { panic!("no sheet") };
    assert!(transmittance.abs_diff_eq([0.8, 0.6, 0.4].into(), 1e-6), "{transmittance}");
    let lines = loaded.warnings.lines().join("\n");
    assert!(loaded.warnings.len() == 2 && lines.contains("Maya") && lines.contains("'pane'"), "{lines}");
}

fn maya_textures() {
    let text = "newmtl grey\nillum 4\nKd 0.00 0.00 0.00\nTf 1.00 1.00 1.00\nmap_Kd wood.png\nNi 1.00\n\
        newmtl panel\nillum 4\nKd 0 0 0\nTf 1 1 1\nNi 1.00\nKe 10 10 10\n";
    textured("").with("room.mtl", text).shows(1.0057, &["Maya"]);
}

fn opacity_as_tr() {
    for illumination in [0, 1, 2] {
        let text = format!("newmtl grey\nKd 0.5 0.5 0.5\nKs 0 0 0\nTr 1.000000\nillum {illumination}\nNs 1.000000\n");
        floor_of(&text).shows(1.0, &["'Tr' 1", "opacity"]);
    }
}

fn blender_kd() {
    for head in
        ["# Blender MTL File: 'a.blend'", "# Blender3D MTL File: a.blend", "# Blender 4.2.0 MTL File: 'a.blend'"]
    {
        for kd in ["0.640000 0.640000 0.640000", "0.115065 0.115065 0.115065", "0.8 0.4 0.1"] {
            let text =
                format!("{head}\n# Material Count: 1\nnewmtl grey\nKd {kd}\nd 1.000000\nillum 1\nmap_Kd wood.png\n");
            textured(&text).shows(1.0057, &["'grey'", "Blender", "colour_times_map"]);
        }
    }
}

fn max() {
    let text = "# 3ds Max Wavefront OBJ Exporter v0.97b - (c)2007 guruware\nnewmtl Material #25\n\tNs 10.0000\n\tNi 1.5000\n\td 1.0000\n\
        \tTr 0.0000\n\tTf 1.0000 1.0000 1.0000\n\tillum 2\n\tKa 0.5882 0.5882 0.5882\n\tKd 0.5882 0.5882 0.5882\n\tKs 0 0 0\n\
        \tKe 0 0 0\n\tmap_Ka wood.png\n\tmap_Kd wood.png\n";
    let obj = |text: &str| text.replace("usemtl grey", "usemtl Material #25");
    let faces = FACES.replace("f 1 4 3 2", "vt 0 0\nvt 1 0\nvt 1 1\nf 1/1 4/2 3/3 2/2");
    let folder = textured(text).with("room.obj", obj(&format!("mtllib room.mtl\n{VERTICES}{faces}")));
    folder.shows(1.0057, &["'Material #25'", "grey that exporters write", "colour_times_map"]);
}

fn other_kd() {
    let loaded = textured("newmtl grey\nKd 0.9 0.6 0.3\nmap_Kd wood.png\n").loads(&[
        "'grey'",
        "map_Kd times Kd",
        "colour_times_map",
    ]);
    assert_eq!(factor(&loaded), [0.9, 0.6, 0.3]);
    // White and black, or none, are no question.
    for kd in ["Kd 1 1 1\n", "Kd 0 0 0\n", ""] {
        let loaded = textured(&format!("newmtl grey\n{kd}map_Kd wood.png\n")).loads(&[]);
        assert_eq!(factor(&loaded), [1.0; 3]);
    }
}

/// A floor that a pane of this description is above.
fn pane_of(text: &str) -> LoadedScene {
    under_a_pane(&format!("{MATERIALS}newmtl pane\n{text}")).load().unwrap_or_else(|error| panic!("{error}"))
}

fn sketchup_glass() {
    let text = "# Alias OBJ Material File\n# Exported from SketchUp, (c) 2000-2012 Trimble\nnewmtl pane\nKa 0 0 0\nKd 0.576 0.576 0.576\n\
        Ks 0.33 0.33 0.33\nd 0.31\n";
    let loaded = under_a_pane(&format!("{text}{MATERIALS}")).loads(&["'pane'", "that share of the light"]);
    assert_eq!(material(&loaded, "pane").opacity, 0.31);
}

fn rhino() {
    let text = "# Rhino\nnewmtl grey\nKa 0.0000 0.0000 0.0000\nKd 0.5000 0.5000 0.5000\nKs 0 0 0\nTf 0.0000 0.0000 0.0000\nd 1.0000\nNs 0\n";
    floor_of(text).shows(1.0, &[]);
}

fn revit_panes() {
    let text =
        "Kd 0 0.501960784313725 0.752941176470588\nKs 0.00390625 0.00390625 0.00390625\nNs 12\nd 0.100000023841858\n";
    let loaded = pane_of(text);
    assert!((material(&loaded, "pane").opacity - 0.1).abs() < 1e-6);
}

fn mineways() {
    let text = "Wavefront OBJ material file\n# Contains 1 material\n\nnewmtl grey\nNs 0\nKa 0.2 0.2 0.2\nKd 1 1 1\nKs 0 0 0\n\
        map_Kd wood.png\nmap_d wood.png\nillum 2\n# d 1\n# Tr 0\n";
    let loaded = textured(text).loads(&[]);
    assert!(material(&loaded, "grey").opacity_map.is_some() && factor(&loaded) == [1.0; 3]);
}

/// The light that a floor keeps under a pane, of what it has without; its own light that comes back from the pane is below 3 %.
fn kept(loaded: LoadedScene) -> f64 {
    let mut scene = loaded.scene;
    // From below the pane.
    scene.camera.eye.y = 1.0;
    seen(scene)[0] / super::room::floor()
}

fn panes() {
    for text in ["Kd 1 1 1\nd 0.2\nillum 9\nNi 1.45\n", "Kd 1 1 1\nTr 0.65\nillum 7\nNi 1.5\n"] {
        let loaded = pane_of(text);
        assert!(loaded.warnings.len() == 1 && loaded.warnings[0].text.contains("thin glass"), "{:?}", loaded.warnings);
        // A clear pane of index 1.5 reflects 2F / (1 + F) of 0.0769 at normal incidence, a little more at the slants of the lamp, and
        // sends back some of the floor's light.
        let kept = kept(loaded);
        assert!((0.89..0.96).contains(&kept), "{text}: {kept}");
    }
    // Without an illum of glass that bends light, a share dissolves into the background, whatever the gloss: here black.
    for text in ["Kd 0 0 0\nd 0.35\nillum 2\nKs 0.9 0.9 0.9\nNi 1.021455\n", "Kd 0 0 0\nTr 0.65\nillum 7\nNi 1\n"] {
        let loaded = pane_of(text);
        assert!(loaded.warnings.len() == 1 && loaded.warnings[0].text.contains("that share"), "{:?}", loaded.warnings);
        let kept = kept(loaded);
        assert!((kept - 0.65).abs() < 0.03, "{text}: {kept}");
    }
}

fn bodies() {
    // A block under the lamp, closed and wound outwards.
    let corners = [[-1, 1, -1], [1, 1, -1], [1, 1, 1], [-1, 1, 1], [-1, 2, -1], [1, 2, -1], [1, 2, 1], [-1, 2, 1]];
    let block: String = corners.map(|[x, y, z]| format!("v {x} {y} {z}\n")).concat();
    let faces =
        "usemtl pane\nf -8 -7 -6 -5\nf -4 -1 -2 -3\nf -8 -4 -3 -7\nf -7 -3 -2 -6\nf -6 -2 -1 -5\nf -5 -1 -4 -8\n";
    let with = |text: &str| {
        let obj = format!("mtllib room.mtl\n{VERTICES}{FACES}{block}{faces}");
        Folder::of_mtl(format!("{MATERIALS}newmtl pane\n{text}")).with("room.obj", obj)
    };
    let loaded = with("Kd 0.36 1 1\nKs 1 1 1\nNs 488\nd 0.5\nNi 1.55\nillum 7\n").loads(&["'pane'", "body of glass"]);
    let Surface::Dielectric { ior, transmittance } = material(&loaded, "pane").surface else { panic!("no body") };
    // Each of two crossings takes the root of 1 - 0.5 (1 - 0.36).
    assert!(ior == 1.55 && (transmittance.x - 0.68f32.sqrt()).abs() < 1e-6, "{ior} {transmittance}");
    // Without an index that bends it is a share.
    let loaded = with("Kd 1 1 1\nKs 1 1 1\nd 0.5\nNi 1.000000\nillum 7\n").loads(&["that share"]);
    assert_eq!(material(&loaded, "pane").opacity, 0.5);
}

fn shares() {
    let wood = "newmtl grey\nKd 0.5 0.5 0.5\n\nnewmtl panel\nKd 0 0 0\nKe 10 10 10\n";
    for (name, text) in [
        ("pane", "Kd 0 0 0\nd 0.65\nillum 2\nKs 0 0 0\n"),
        ("curtain", "Kd 0 0 0\nd 0.4\nillum 2\nKs 0.5 0.5 0.5\n"),
        ("leaves", "Kd 0 0 0\nTr 0.6\n"),
        ("paint", "Kd 0 0 0\nd 0.4\nillum 1\n"),
    ] {
        let obj = format!(
            "mtllib room.mtl\n{VERTICES}{FACES}v -4 1.5 -4\nv 4 1.5 -4\nv 4 1.5 4\nv -4 1.5 4\nusemtl {name}\nf -4 -1 -2 -3\n"
        );
        let loaded = Folder::of_mtl(format!("{wood}newmtl {name}\n{text}"))
            .with("room.obj", obj)
            .loads(&["that share of the light"]);
        let opacity = material(&loaded, name).opacity;
        let right = if name == "pane" { 0.65 } else { 0.4 };
        assert!((opacity - right).abs() < 1e-6, "{name}: {opacity}");
        // The rest passes straight: black, it sends nothing back but its gloss.
        let kept = kept(loaded);
        assert!((kept - f64::from(1.0 - opacity)).abs() < 0.03, "{name}: {kept}");
    }
}

fn unseen() {
    for text in [
        "d 0\n",
        "d 0\nTr 0\n",
        "illum 4\nNi 1.0\nKs 0 0 0\nTf 1 1 1\nnewmtl other\nillum 2\n",
        "d 0.001\nKs 0.5 0.5 0.5\n",
        "Tr 1\nd 0\n",
    ] {
        let text = format!("newmtl grey\nKd 0.5 0.5 0.5\n{text}");
        let folder = floor_of(&text.replace("Ks 0.5 0.5 0.5", "Ks 0 0 0"));
        folder.shows(1.0, &["'grey'", "nobody would see"]);
    }
    // What is of glass by its name is seen by what it reflects.
    let named = FACES.replace("grey", "glass");
    let folder = Folder::of_mtl(format!("newmtl glass\nd 0\nKd 0 0 0{LAMP}"))
        .with("room.obj", format!("mtllib room.mtl\n{VERTICES}{named}"));
    let loaded = folder.loads(&["'glass'", "thin glass"]);
    assert!(matches!(material(&loaded, "glass").surface, Surface::ThinDielectric { .. }));
}

fn overruled() {
    let pane = format!("{MATERIALS}newmtl pane\nKd 1 1 1\nd 0.35\n");
    let with = |more: &str| under_a_pane(&pane).scene(&format!("[[material]]\nmatch = \"pane\"\n{more}")).loads(&[]);
    let loaded = with("opacity = 0.25\n");
    let found = material(&loaded, "pane");
    assert!(
        found.opacity == 0.25 && matches!(found.surface, Surface::Lambert { .. } | Surface::Coated { .. }),
        "{found:?}"
    );
    let loaded = with("kind = \"lambert\"\n");
    assert!(
        material(&loaded, "pane").opacity == 1.0
            && matches!(material(&loaded, "pane").surface, Surface::Lambert { .. })
    );
    let loaded = with("kind = \"thin_dielectric\"\nopacity = 0.5\n");
    assert!(
        material(&loaded, "pane").opacity == 0.5
            && matches!(material(&loaded, "pane").surface, Surface::ThinDielectric { .. })
    );
    let wood = "# Blender MTL File: 'a'\nnewmtl grey\nKd 0.64 0.5 0.4\nmap_Kd wood.png\n";
    for (times, right) in [(true, [0.64, 0.5, 0.4]), (false, [1.0; 3])] {
        let loaded =
            textured(wood).scene(&format!("[[material]]\nmatch = \"gr*\"\ncolour_times_map = {times}\n")).loads(&[]);
        assert_eq!(factor(&loaded), right);
    }
    under_a_pane(&pane).scene("[[material]]\nmatch = \"pane\"\nopacity = 1.5\n").refused(&[
        "\"pane\"",
        "opacity 1.5",
        "0 to 1",
    ]);
}

/// The floors are opaque: `Kd / π / 4` under a point of intensity 1 at 2 m.
fn dialects(folder: &Path) {
    let copy = Folder::copy_of(folder);
    for (name, said) in [("maya", "Maya"), ("scan", "'Tr' 1")] {
        let text = std::fs::read_to_string(folder.join(format!("{name}.toml"))).expect("a scene file");
        let text = text.replace("vertical_fov_degrees = 20", "vertical_fov_degrees = 1");
        std::fs::write(copy.path("scene.toml"), text).expect("a scene file");
        let loaded = copy.loads(&[said]);
        let found = seen(loaded.scene);
        for (found, kd) in found.into_iter().zip([0.6, 0.3, 0.2]) {
            assert!((found * 4.0 * f64::from(PI) / kd - 1.0).abs() < 0.01, "{name}: {found} for {kd}");
        }
    }
}
