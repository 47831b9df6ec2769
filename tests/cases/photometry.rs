//! Photometric files: IES and EULUMDAT. Right values are by hand from the formats' texts: most files have 1,000, 800, 400 and 0 cd
//! at 0, 30, 60 and 90 degrees from the nadir.

use std::path::Path;

use ltm::error::Warnings;
use ltm::image::LUMENS_PER_WATT;
use ltm::scene::{Emitter, IesProfile, LoadedScene, PointEmitter, load};

use super::Outcome::{Converted, Read, Refused, Warned};
use super::{Case, Collection, Outcome};

const fn ies(input: &'static str, outcome: Outcome, test: fn()) -> Case {
    Case { format: "IES", input, outcome, test }
}

const fn ldt(input: &'static str, outcome: Outcome, test: fn()) -> Case {
    Case { format: "EULUMDAT", input, outcome, test }
}

pub(super) const CASES: &[Case] = &[
    ies("LM-63-1986 to 1995: the factors of candela, ballast, and ballast and lamp", Read, early_factors),
    ies("LM-63-2002: a number other than 1 after the ballast factor (\"future use\")", Warned, future_use),
    ies("LM-63-2019: the number after the ballast factor (how the file was made)", Read, file_generation),
    ies("LM-63-2019 in a glTF file (`EXT_lights_ies`)", Read, in_gltf),
    ies("`TILT = NONE` in any case and with spaces, `INCLUDE`, a tilt file", Read, tilts),
    ies("UTF-8 with its mark, UTF-16, Latin-1, lines ended by CR alone, ctrl-Z", Read, texts),
    ies("decimal commas, and commas between numbers", Read, commas),
    ies("an angle that stands there twice, numbers left over", Read, repeated),
    ies("lumens of −1 (absolute), candelas a little below zero", Read, absolute),
    ies("half circles 0 to 180, 90 to 270, 180 to 360 and −90 to 90 degrees", Read, half_circles),
    ies("circles that begin elsewhere, or end a step before they close", Converted, open_circles),
    ies("uplights, and peaks off the nadir", Read, uplights),
    ies("planes that cover no symmetry, angles that decrease, words for numbers, too few numbers", Refused, bad_ies),
    ldt("lines ended by LF, CR LF or CR, a mark of UTF-8, UTF-16, blank lines at the end", Read, ldt_texts),
    ldt("decimal commas, whole numbers with a fraction, units behind numbers", Read, ldt_numbers),
    ldt("a conversion factor that is blank or 0", Converted, no_factor),
    ldt("lamps of −1 (absolute), several lamps, several sets of lamps", Read, lamps),
    ldt("each symmetry, with the plane of 360 degrees or without", Read, symmetries),
    ldt("too few lines, words for numbers, symmetries that there are not", Refused, bad_ldt),
];

pub(super) const COLLECTIONS: &[Collection] = &[
    Collection { folder: "11-ies-quirks", test: ies_quirks },
    Collection { folder: "14-ldt-quirks", test: ldt_quirks },
];

const FLOOR: &str = "v -20 0 -20\nv 20 0 -20\nv 20 0 20\nv -20 0 20\nf 1 4 3 2\n";

/// A scene of a floor under a luminaire of this file.
fn scene(name: &str, bytes: &[u8]) -> ltm::Result<LoadedScene> {
    let folder = tempfile::tempdir().unwrap();
    let toml = format!(
        "geometry = [\"floor.obj\"]\n[camera]\neye = [0, 5, 0.01]\nlook_at = [0, 0, 0]\n[[light]]\nkind = \"ies\"\n\
         file = \"{name}\"\nposition = [0, 2, 0]\n"
    );
    std::fs::write(folder.path().join("floor.obj"), FLOOR).unwrap();
    std::fs::write(folder.path().join("scene.toml"), toml).unwrap();
    std::fs::write(folder.path().join(name), bytes).unwrap();
    load(&folder.path().join("scene.toml"))
}

/// What a file says: its peak in candela, and its web.
struct Luminaire {
    peak: f32,
    web: IesProfile,
    warnings: Warnings,
}

impl Luminaire {
    fn of(loaded: LoadedScene) -> Self {
        let peak = loaded.scene.basis.lights()[0].emission[0] * LUMENS_PER_WATT;
        let Emitter::Point(PointEmitter::Ies { profile, .. }) = &loaded.scene.emitters[0] else {
            panic!("{:?}", loaded.scene.emitters)
        };
        Self { peak, web: profile.clone(), warnings: loaded.warnings }
    }

    /// Candela at the angles of a measured direction, or of one that follows from it.
    fn at(&self, vertical: f32, horizontal: f32) -> f32 {
        let IesProfile { vertical_radians, horizontal_radians, intensity } = &self.web;
        let place = |angles: &[f32], wanted: f32| {
            let found = angles.iter().position(|a| (a.to_degrees() - wanted).abs() < 1e-2);
            found.unwrap_or_else(|| panic!("{wanted}° is not in {angles:?}"))
        };
        let row = if horizontal_radians.len() == 1 { 0 } else { place(horizontal_radians, horizontal) };
        intensity[row * vertical_radians.len() + place(vertical_radians, vertical)] * self.peak
    }

    fn near(&self, peak: f32) {
        assert!((self.peak - peak).abs() < 1e-3 * peak, "{} cd for {peak}", self.peak);
        assert!(self.warnings.is_empty(), "{:?}", self.warnings);
    }
}

fn read(name: &str, bytes: impl AsRef<[u8]>) -> Luminaire {
    Luminaire::of(scene(name, bytes.as_ref()).unwrap_or_else(|error| panic!("{error}")))
}

fn refused(name: &str, bytes: impl AsRef<[u8]>, words: &str) {
    let error = scene(name, bytes.as_ref()).map(|_| ()).expect_err("it is to be refused").to_string();
    assert!(error.contains(words) && error.contains(name) && !error.contains('\n'), "{error} for {words}");
}

/// An IES file of one plane after a change.
fn plain(change: impl Fn(String) -> String) -> String {
    let head = "IESNA:LM-63-1995\n[TEST] 1\n[MANUFAC] none\nTILT=NONE\n";
    change(format!("{head}1 1000 1 4 1 1 2 0 0 0\n1 1 10\n0 30 60 90\n0\n1000 800 400 0\n"))
}

/// One of several planes: what it has at 60° is stated for each.
fn planes(angles: &str, at_60: &[f32]) -> String {
    let rows: String = at_60.iter().map(|v| format!("1000 800 {v} 0\n")).collect();
    let count = at_60.len();
    format!("IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 4 {count} 1 2 0 0 0\n1 1 10\n0 30 60 90\n{angles}\n{rows}")
}

fn early_factors() {
    for head in ["IESNA:LM-63-1995", "IESNA:LM-63-1991", "IESNA91", "a lamp of 1986"] {
        let file = plain(|text| text.replace("IESNA:LM-63-1995", head).replace("1 1 10\n", "0.9 0.5 10\n"));
        read("a.ies", &file).near(450.0);
        read("a.ies", file.replace("1 1000 1 4", "1 1000 2.5 4")).near(1125.0);
    }
    read("a.ies", "TILT=NONE\n1 1000 1 4 1 1 2 0 0 0\n1 0.5 10\n0 30 60 90\n0\n1000 800 400 0\n").near(500.0);
}

fn future_use() {
    let file =
        |second: &str| plain(|text| text.replace("1995", "2002").replace("1 1 10\n", &format!("0.9 {second} 10\n")));
    read("a.ies", file("1")).near(900.0);
    let found = read("a.ies", file("0.5"));
    assert!((found.peak - 900.0).abs() < 1e-2, "{}", found.peak);
    let [said] = &found.warnings.lines()[..] else { panic!("{:?}", found.warnings) };
    assert!(said.contains("LM-63-2002") && said.contains("not multiplied: 0.5"), "{said}");
}

fn file_generation() {
    for head in ["IES:LM-63-2019", "IESNA:LM-63-2019", "IES: LM-63-19", "\u{feff}IES:LM-63-2019"] {
        for generation in ["1.00000", "1.00001", "1.00010", "1.10000"] {
            let file = plain(|text| {
                text.replace("IESNA:LM-63-1995", head).replace("1 1 10\n", &format!("0.9 {generation} 10\n"))
            });
            read("a.ies", file).near(900.0);
        }
    }
}

fn in_gltf() {
    let file = plain(|text| text.replace("IESNA:LM-63-1995", "IES:LM-63-2019").replace("1 1 10", "1 1.1 10"));
    let corners = [[-1.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]];
    let corners: Vec<u8> = corners.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
    let gltf = serde_json::json!({
        "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0, 1] }], "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "nodes": [{ "mesh": 0 }, { "translation": [0, 2, 0], "extensions": { "EXT_lights_ies": { "light": 0 } } }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }], "buffers": [{ "byteLength": 36, "uri": "a.bin" }],
        "extensionsUsed": ["EXT_lights_ies"], "extensions": { "EXT_lights_ies": { "lights": [{ "uri": "a.ies" }] } },
    });
    let folder = tempfile::tempdir().unwrap();
    let files = [("a.gltf", gltf.to_string().into_bytes()), ("a.bin", corners), ("a.ies", file.into_bytes())];
    files.iter().for_each(|(name, bytes)| std::fs::write(folder.path().join(name), bytes).unwrap());
    let found = Luminaire::of(load(&folder.path().join("a.gltf")).unwrap());
    assert!((found.peak - 1000.0).abs() < 0.1, "{}", found.peak);
}

fn tilts() {
    for tilt in ["TILT= NONE ", "TILT = NONE", "Tilt=None", "  TILT=NONE", "TILT=LAMP.TLT"] {
        read("a.ies", plain(|text| text.replace("TILT=NONE", tilt))).near(1000.0);
    }
    let included = "TILT=INCLUDE\n1\n3\n0 45 90\n1 .9 .8\n";
    read("a.ies", plain(|text| text.replace("TILT=NONE\n", included))).near(1000.0);
}

fn texts() {
    let text = plain(|text| text);
    let wide = |mark: &str, bytes: fn(u16) -> [u8; 2]| -> Vec<u8> {
        format!("{mark}{text}").encode_utf16().flat_map(bytes).collect()
    };
    let crlf = text.replace('\n', "\r\n");
    for bytes in [
        format!("\u{feff}{text}").into_bytes(),
        // With the mark right before the TILT line.
        format!("\u{feff}{}", &text[text.find("TILT").unwrap()..]).into_bytes(),
        wide("\u{feff}", u16::to_le_bytes),
        wide("\u{feff}", u16::to_be_bytes),
        wide("", u16::to_le_bytes),
        text.replace("none", "Stra\u{e9}e 60").chars().map(|c| c as u8).collect(),
        text.replace('\n', "\r").into_bytes(),
        format!("{crlf}\u{1a}").into_bytes(),
        format!("{}\u{1a}", crlf.trim_end()).into_bytes(),
        format!("{crlf}\u{1a}\u{1a}\0\0\0").into_bytes(),
    ] {
        let found = read("a.ies", &bytes);
        found.near(1000.0);
        assert_eq!([found.at(30.0, 0.0), found.at(60.0, 0.0)].map(f32::round), [800.0, 400.0]);
    }
}

fn commas() {
    let separated =
        |text: String| text.replace("0 30 60 90", "0,30,60,90").replace("1000 800 400 0", "1000, 800, 400, 0");
    read("a.ies", plain(separated)).near(1000.0);
    read("a.ies", plain(|text| text.replace("1 1 10", "1,1,10").replace("0 30 60 90", "0,30 60,90"))).near(1000.0);
    let decimal = |text: String| {
        let text =
            text.replace("1 1000 1 4 1 1 2 0 0 0", "1 1000,0 1,5 4 1 1 2 0,1 0,1 0").replace("1 1 10", "1,0 0,5 10,5");
        text.replace("0 30 60 90", "0,0 30,0 60,0 90,0").replace("1000 800 400 0", "1000,5 800,25 400,0 0,0")
    };
    let found = read("a.ies", plain(decimal));
    found.near(1000.5 * 1.5 * 0.5);
    assert!((found.at(30.0, 0.0) - 800.25 * 0.75).abs() < 0.1);
}

fn repeated() {
    read("a.ies", plain(|text| text.replace("1000 800 400 0", "1000 800 400 0 7 7 7"))).near(1000.0);
    let twice = plain(|text| {
        text.replace("1 1000 1 4", "1 1000 1 5").replace("60 90", "60 90 90").replace("400 0\n", "400 0 0\n")
    });
    let found = read("a.ies", twice);
    found.near(1000.0);
    assert_eq!(found.web.vertical_radians.len(), 4);
    let planes = read("a.ies", planes("0 90 90", &[400.0, 200.0, 200.0]));
    assert_eq!(planes.web.horizontal_radians.len(), 5);
}

fn absolute() {
    read("a.ies", plain(|text| text.replace("1 1000 1 4", "1 -1 1 4").replace("400 0\n", "400 -0.3\n"))).near(1000.0);
}

/// At 60° a half has 300, 600 and 200 cd; what is across the plane of its ends mirrors it.
fn half_circles() {
    for (angles, wanted) in [
        ("0 90 180", [300.0, 600.0, 200.0, 600.0]),
        ("90 180 270", [600.0, 300.0, 600.0, 200.0]),
        ("180 270 360", [200.0, 600.0, 300.0, 600.0]),
        ("-90 0 90", [600.0, 200.0, 600.0, 300.0]),
        ("-180 -90 0", [200.0, 600.0, 300.0, 600.0]),
    ] {
        let found = read("a.ies", planes(angles, &[300.0, 600.0, 200.0]));
        found.near(1000.0);
        let around = [0.0, 90.0, 180.0, 270.0].map(|horizontal| found.at(60.0, horizontal).round());
        assert_eq!(around, wanted, "{angles}");
    }
    let quarter = read("a.ies", planes("0 90", &[300.0, 600.0]));
    assert_eq!([0.0, 90.0, 180.0, 270.0].map(|h| quarter.at(60.0, h).round()), [300.0, 600.0, 300.0, 600.0]);
}

fn open_circles() {
    let around = |angles: &str, at_60: &[f32]| {
        let found = read("a.ies", planes(angles, at_60));
        found.near(1000.0);
        assert_eq!(found.at(60.0, 360.0), found.at(60.0, 0.0));
        [0.0, 90.0, 180.0, 270.0].map(|horizontal| found.at(60.0, horizontal).round())
    };
    let whole = [100.0, 200.0, 300.0, 400.0];
    assert_eq!(around("0 90 180 270", &whole), whole);
    assert_eq!(around("0 90 180 270 360", &[100.0, 200.0, 300.0, 400.0, 100.0]), whole);
    assert_eq!(around("0 45 90 135 180 225 270 315", &[100., 0., 200., 0., 300., 0., 400., 0.]), whole);
    assert_eq!(around("-90 0 90 180 270", &[400.0, 100.0, 200.0, 300.0, 400.0]), whole);
    assert_eq!(around("180 270 360 450 540", &[300.0, 400.0, 100.0, 200.0, 300.0]), whole);
    let thirds = read("a.ies", planes("0 120 240", &[100.0, 200.0, 300.0]));
    assert_eq!([0.0, 120.0, 240.0].map(|h| thirds.at(60.0, h).round()), [100.0, 200.0, 300.0]);
    // Without a plane at 0°, it is between its neighbours.
    let turned = read("a.ies", planes("45 135 225 315", &[100.0, 200.0, 300.0, 400.0]));
    assert_eq!(turned.at(60.0, 0.0).round(), 250.0);
}

fn uplights() {
    let up = plain(|text| text.replace("0 30 60 90", "90 120 150 180").replace("1000 800 400 0", "0 400 800 1000"));
    let found = read("a.ies", up);
    found.near(1000.0);
    assert_eq!([found.at(90.0, 0.0), found.at(180.0, 0.0)].map(f32::round), [0.0, 1000.0]);
    let side = plain(|text| text.replace("1000 800 400 0", "100 500 1000 0"));
    let found = read("a.ies", side);
    found.near(1000.0);
    assert_eq!(found.at(0.0, 0.0).round(), 100.0);
}

fn bad_ies() {
    refused("a.ies", planes("0 45 120", &[1.0, 2.0, 3.0]), "do not cover");
    refused("a.ies", planes("10 55 100", &[1.0, 2.0, 3.0]), "do not cover");
    refused("a.ies", plain(|text| text.replace("30 60", "60 30")), "do not increase");
    refused("a.ies", plain(|text| text.replace("30 60", "30 sixty")), "word where a number");
    refused("a.ies", plain(|text| text.replace("1000 800 400 0", "1000 800 400")), "ends before its numbers");
    refused("a.ies", plain(|text| text.replace("TILT=NONE", "")), "no TILT line");
    refused("a.ies", plain(|text| text.replace("1000 800 400 0", "0 0 0 0")), "no light");
    refused("a.ies", "", "no TILT line");
}

/// A EULUMDAT file of one plane with 500, 400, 200 and 0 cd for 1,000 lm, after changes of its lines, which count from 1.
fn eulumdat(changes: &[(usize, &str)]) -> Vec<String> {
    let head = "maker 1 1 1 0 4 30 r lum 1 x.ldt today 100 100 50 90 90 0 0 0 0 100 100 1.0 0 1 1 LED 1000 4000 80 10";
    let mut lines: Vec<String> = head.split(' ').map(String::from).collect();
    lines.extend((0..10).map(|_| "0.5".to_owned()));
    lines.extend(["0", "0", "30", "60", "90", "500", "400", "200", "0"].map(String::from));
    changes.iter().for_each(|(line, text)| lines[line - 1] = (*text).to_owned());
    lines
}

fn ldt_texts() {
    let lines = eulumdat(&[]);
    let crlf = lines.join("\r\n");
    let wide: Vec<u8> = format!("\u{feff}{crlf}").encode_utf16().flat_map(u16::to_le_bytes).collect();
    for bytes in [
        crlf.clone().into_bytes(),
        lines.join("\n").into_bytes(),
        lines.join("\r").into_bytes(),
        format!("\u{feff}{crlf}\r\n\r\n\r\n\u{1a}").into_bytes(),
        wide,
    ] {
        let found = read("a.ldt", bytes);
        found.near(500.0);
        assert_eq!([found.at(30.0, 0.0), found.at(60.0, 0.0)].map(f32::round), [400.0, 200.0]);
    }
}

fn ldt_numbers() {
    let read = |changes: &[(usize, &str)]| read("a.ldt", eulumdat(changes).join("\r\n"));
    read(&[(24, "1,0"), (29, "1000,0"), (32, "10,5"), (48, "500,5")]).near(500.5);
    read(&[(4, "1.0"), (6, "4.00"), (26, "1.0"), (3, "1.0"), (5, "0.00")]).near(500.0);
    read(&[(29, "1000 lm")]).near(500.0);
    read(&[(29, "1000lm"), (32, "10 W")]).near(500.0);
}

fn no_factor() {
    for factor in ["", "0", "0.0", "1"] {
        read("a.ldt", eulumdat(&[(24, factor)]).join("\r\n")).near(500.0);
    }
    read("a.ldt", eulumdat(&[(24, "0.5")]).join("\r\n")).near(250.0);
}

fn lamps() {
    let file = |changes: &[(usize, &str)]| eulumdat(changes).join("\r\n");
    read("a.ldt", file(&[(27, "-1"), (29, "2000")])).near(1000.0);
    // The flux is that of all lamps of the set.
    read("a.ldt", file(&[(27, "2"), (29, "4000")])).near(2000.0);
    // Sets are alternatives, of which the first is lit.
    let mut lines = eulumdat(&[(26, "2")]);
    lines.splice(32..32, ["1", "B", "3000", "4000", "80", "10"].map(String::from));
    read("a.ldt", lines.join("\r\n")).near(500.0);
}

/// A EULUMDAT file of these planes, and what the stored ones have at 60°.
fn symmetric(symmetry: u32, angles: &[u32], at_60: &[f32]) -> Luminaire {
    let mut lines = eulumdat(&[(3, &symmetry.to_string()), (4, &angles.len().to_string())]);
    lines.truncate(42);
    lines.extend(angles.iter().map(u32::to_string));
    lines.extend(["0", "30", "60", "90"].map(String::from));
    lines.extend(at_60.iter().flat_map(|v| ["500".into(), "400".into(), v.to_string(), "0".into()]));
    read("a.ldt", lines.join("\r\n"))
}

fn symmetries() {
    let open = [0, 90, 180, 270];
    let closed = [0, 90, 180, 270, 360];
    let around = |found: Luminaire| [0.0, 90.0, 180.0, 270.0].map(|horizontal| found.at(60.0, horizontal).round());
    assert_eq!(around(symmetric(0, &open, &[100.0, 200.0, 300.0, 400.0])), [100.0, 200.0, 300.0, 400.0]);
    assert_eq!(around(symmetric(0, &closed, &[100.0, 200.0, 300.0, 400.0, 100.0])), [100.0, 200.0, 300.0, 400.0]);
    for planes in [&open[..], &closed] {
        assert_eq!(around(symmetric(2, planes, &[100.0, 200.0, 300.0])), [100.0, 200.0, 300.0, 200.0]);
        assert_eq!(around(symmetric(4, planes, &[100.0, 200.0])), [100.0, 200.0, 100.0, 200.0]);
        // Stored are 270°, 0° and 90°.
        assert_eq!(around(symmetric(3, planes, &[100.0, 200.0, 300.0])), [200.0, 300.0, 200.0, 100.0]);
    }
    let every_15: Vec<u32> = (0..24).map(|i| 15 * i).collect();
    symmetric(1, &every_15, &[200.0]).near(500.0);
}

fn bad_ldt() {
    let lines = eulumdat(&[]);
    refused("a.ldt", lines[..20].join("\n"), "ends before line");
    refused("a.ldt", lines[..lines.len() - 1].join("\n"), "ends before line");
    refused("a.ldt", eulumdat(&[(48, "many")]).join("\n"), "line 48 has no number");
    refused("a.ldt", eulumdat(&[(3, "5")]).join("\n"), "line 3");
    refused("a.ldt", eulumdat(&[(4, "1.5")]).join("\n"), "line 4");
    refused("a.ldt", "", "ends before line");
}

/// Peaks of all files of a folder; `wanted` names those that differ from `usual`.
fn peaks(folder: &Path, extension: &str, usual: f32, wanted: &[(&str, f32)]) {
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if path.extension().is_some_and(|e| e == extension) {
            let found = read(&name, std::fs::read(&path).unwrap());
            let wanted =
                wanted.iter().find(|(stem, _)| *stem == name.split('.').next().unwrap()).map_or(usual, |(_, w)| *w);
            assert!((found.peak - wanted).abs() < 1e-3 * wanted, "{name}: {} cd for {wanted}", found.peak);
            assert!(found.warnings.is_empty(), "{name}: {:?}", found.warnings);
            count += 1;
        }
    }
    assert!(count > 10, "{count} files");
}

fn ies_quirks(folder: &Path) {
    peaks(folder, "ies", 1000.0, &[("lm2002_ballast09", 900.0), ("lm1995_lampfactor", 500.0)]);
}

fn ldt_quirks(folder: &Path) {
    peaks(folder, "ldt", 500.0, &[("absolute", 1000.0), ("two_lamps", 2000.0)]);
}
