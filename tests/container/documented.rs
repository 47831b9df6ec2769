//! The metadata and the start of a chunk are what `formats/ltc.md` says.

use std::path::Path;

use ltm::container::codec::{CodecSettings, LayerPart, encode_layer};
use ltm::container::{BlockLayout, ContainerOptions, ContainerReader, ContainerWriter};
use ltm::light::{Job, Light, LightBasis, LightKind, LightUnit, Provenance, StatedErrors};
use ltm::matrix::{BlockId, ColumnIndex, FactoredBlock, MatrixShape, SparseEntry};

use super::{DENOISED_LIGHT, STATED, block, formats, job, light, small_job};

/// The rows of a table of `formats/ltc.md` under `### heading`, without its first.
fn document_rows(heading: &str) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(formats("ltc.md")).unwrap();
    let section = text.split(&format!("\n### {heading}\n")).nth(1).unwrap().split("\n#").next().unwrap();
    let cells = |line: &str| line.trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>();
    section.lines().filter(|line| line.starts_with("| ")).skip(1).map(cells).collect()
}

/// The fields of such a table, with their types.
fn document_fields(heading: &str) -> Vec<(String, String)> {
    document_rows(heading).into_iter().map(|row| (row[0].clone(), row[1].clone())).collect()
}

/// A value as the document's types write it.
enum Value {
    Integer(u64),
    Text(&'static str),
    Floats(Vec<f32>),
    List(usize, Vec<u8>),
    Raw(Vec<u8>),
}

fn integer(value: u64) -> Vec<u8> {
    match value {
        0..251 => vec![value as u8],
        251..0x1_0000 => [&[251], &(value as u16).to_le_bytes()[..]].concat(),
        0x1_0000..0x1_0000_0000 => [&[252], &(value as u32).to_le_bytes()[..]].concat(),
        _ => [&[253], &value.to_le_bytes()[..]].concat(),
    }
}

/// Bytes of a table's fields in its order, each checked to have the stated type.
fn written_as_documented(heading: &str, values: &[(&str, Value)]) -> Vec<u8> {
    let fields = document_fields(heading);
    assert_eq!(fields.len(), values.len(), "{heading}");
    let bytes = fields.iter().zip(values).map(|((field, kind), (name, value))| {
        assert_eq!(field, name, "{heading}");
        let (word, bytes) = match value {
            Value::Integer(value) => ("integer", integer(*value)),
            Value::Text(text) => ("text", [integer(text.len() as u64), text.as_bytes().to_vec()].concat()),
            Value::Floats(floats) => ("float", floats.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Value::List(length, items) => ("list", [integer(*length as u64), items.clone()].concat()),
            Value::Raw(bytes) => ("", bytes.clone()),
        };
        assert!(kind.contains(word), "{heading}, {field}: {kind} is no {word}");
        bytes
    });
    bytes.collect::<Vec<_>>().concat()
}

/// The sections of a container without their compression.
fn sections_of(path: &Path) -> Vec<u8> {
    let file = std::fs::read(path).unwrap();
    let number = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
    let (metadata, end) = (number(file.len() - 40), file.len() - 64);
    let body = &file[metadata + 8..metadata + number(end + 20)];
    match number(metadata + 4) {
        1 => zstd::bulk::decompress(body, number(metadata)).unwrap(),
        _ => body.to_vec(),
    }
}

/// A section as the document has it.
fn section(tag: &str, body: &[u8]) -> Vec<u8> {
    let sizes: Vec<String> = document_rows("Section").into_iter().map(|row| format!("{} {}", row[0], row[1])).collect();
    assert_eq!(sizes, ["tag 4", "length 4", "body `length`"]);
    [tag.as_bytes(), &(body.len() as u32).to_le_bytes(), body].concat()
}

/// The job of the test below, with one light, as the document has it.
fn documented_job(panel: &Light) -> Vec<u8> {
    let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let light = written_as_documented(
        "Light",
        &[
            ("name", Value::Text("panel")),
            ("kind", Value::Raw(vec![1, 20, 15])),
            ("unit", Value::Raw(vec![2])),
            ("emission", Value::Floats(vec![1.0, 2.0, 3.0])),
            ("first column", Value::Integer(0)),
            ("places", Value::List(300, floats(panel.places.as_flattened()))),
            ("extents", Value::List(300, floats(&panel.extents))),
        ],
    );
    written_as_documented(
        "Job",
        &[
            ("width", Value::Integer(300)),
            ("height", Value::Integer(200)),
            ("columns", Value::Integer(300)),
            ("block side", Value::Integer(256)),
            ("lights", Value::List(1, light)),
            ("source", Value::Text("room")),
            ("content", Value::Raw(vec![9; 32])),
            ("program", Value::Text("p")),
            ("samples per pixel", Value::Integer(70_000)),
            ("seed", Value::Integer(1 << 40)),
            ("settings", Value::Text("s")),
            ("metres per unit", Value::Floats(vec![0.5])),
        ],
    )
}

#[test]
fn the_metadata_is_written_as_the_document_says() {
    let mut basis = LightBasis::new();
    let mut panel = light("panel", LightKind::AreaTexels { across: 20, down: 15 });
    panel.unit = LightUnit::Irradiance;
    panel.emission = [1.0, 2.0, 3.0];
    basis.push(panel.clone()).unwrap();
    basis.set_scene_weights(0, vec![[0.25; 3]; 300]).unwrap();
    basis.set_column_scales(vec![1e-6; 300]).unwrap();
    let provenance = Provenance {
        source: "room".into(),
        content: [9; 32],
        program: "p".into(),
        samples_per_pixel: 70_000,
        seed: 1 << 40,
        settings: "s".into(),
        metres_per_unit: 0.5,
    };
    let job = Job { shape: MatrixShape::new(300, 200, 300, 256).unwrap(), basis, provenance };
    let report = ltm::container::ContainerReport {
        program: "a".into(),
        method: "b".into(),
        target: "c".into(),
        prior: "d".into(),
        settings: "e".into(),
        provenance: vec![("f".into(), "g".into())],
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltc");
    let options = ContainerOptions { report, partial: true, ..Default::default() };
    let mut writer = ContainerWriter::create(&path, &job, options).unwrap();
    let stated = StatedErrors { denoised_lights: vec![DENOISED_LIGHT], ..STATED };
    writer.state_errors(stated.clone());
    writer.finish().unwrap();
    assert_eq!(*ContainerReader::open(&path).unwrap().errors(), stated);
    let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let weights = Value::List(1, [integer(0), integer(300), floats(&[0.25; 900])].concat());
    let weights = written_as_documented("Scene weights", &[("scene weights", weights)]);
    let scales = Value::List(300, floats(&[1e-6; 300]));
    let scales = written_as_documented("Column scales", &[("column scales", scales)]);
    let report = written_as_documented(
        "Report",
        &[
            ("program", Value::Text("a")),
            ("method", Value::Text("b")),
            ("target", Value::Text("c")),
            ("prior", Value::Text("d")),
            ("settings", Value::Text("e")),
            ("provenance", Value::List(1, vec![1, b'f', 1, b'g'])),
        ],
    );
    let errors = written_as_documented(
        "Light errors",
        &[
            ("prior", Value::Floats(vec![0.5])),
            ("all on", Value::Floats(vec![0.25])),
            ("random", Value::Floats(vec![0.125])),
            ("single mean", Value::Floats(vec![2.0])),
            ("single worst", Value::Floats(vec![3.0])),
            ("worst column", Value::Integer(66)),
            ("noise mean", Value::Floats(vec![4.0])),
            ("noise worst", Value::Floats(vec![5.0])),
        ],
    );
    let denoising = written_as_documented(
        "Cleaning errors",
        &[
            ("noise before", Value::Floats(vec![1.5])),
            ("noise after", Value::Floats(vec![0.75])),
            ("bias", Value::Floats(vec![0.0625])),
        ],
    );
    let fields = [
        ("noise before", Value::Floats(vec![2.5])),
        ("noise after", Value::Floats(vec![0.375])),
        ("bias", Value::Floats(vec![0.03125])),
        ("light kept", Value::Floats(vec![0.875])),
    ];
    let light = Value::List(1, written_as_documented("Cleaned light", &fields));
    let denoised_lights = written_as_documented("Cleaned lights", &[("lights", light)]);
    let exposed = written_as_documented(
        "Exposed error",
        &[("asked", Value::Floats(vec![0.75])), ("reached", Value::Floats(vec![0.5]))],
    );
    let records = [
        ("Job", documented_job(&panel)),
        ("Scene weights", weights),
        ("Column scales", scales),
        ("Report", report),
        ("Light errors", errors),
        ("Cleaning errors", denoising),
        ("Cleaned lights", denoised_lights),
        ("Exposed error", exposed),
    ];
    let documented = document_rows("Sections");
    assert_eq!(documented.iter().map(|row| row[1].as_str()).collect::<Vec<_>>(), records.each_ref().map(|r| r.0));
    let sections = documented.iter().zip(&records).map(|(row, (_, record))| section(row[0].trim_matches('`'), record));
    assert_eq!(sections_of(&path), sections.collect::<Vec<_>>().concat());
    // Every kind and unit has its name in the document, in order.
    let kinds = &document_fields("Light")[1].1;
    let rest = |part: &&str| part.ends_with(')') && !part.contains('(');
    assert_eq!(kinds.split(", ").filter(|part| !rest(part)).count(), 11, "{kinds}");
}

/// What is known of errors does not hang on what else is.
#[test]
fn each_error_is_kept_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltc");
    let StatedErrors { lights, denoising, exposed, .. } = STATED;
    for known in 0..16 {
        let stated = StatedErrors {
            lights: lights.filter(|_| known & 1 > 0),
            denoising: denoising.filter(|_| known & 2 > 0),
            exposed: exposed.filter(|_| known & 4 > 0),
            denoised_lights: vec![DENOISED_LIGHT; if known & 8 > 0 { job().basis.lights().len() } else { 0 }],
        };
        let options = ContainerOptions { partial: true, overwrite: true, ..Default::default() };
        let mut writer = ContainerWriter::create(&path, &job(), options).unwrap();
        writer.state_errors(stated.clone());
        writer.finish().unwrap();
        assert_eq!(*ContainerReader::open(&path).unwrap().errors(), stated);
    }
}

/// The start of a chunk, as the document's table has it.
#[test]
fn a_chunk_begins_as_the_document_says() {
    let text = std::fs::read_to_string(formats("ltc.md")).unwrap();
    let section = text.split("\n## Chunk\n").nth(1).unwrap().split("\n#").next().unwrap();
    let rows = section.lines().filter(|line| line.starts_with("| ")).skip(1);
    let rows: Vec<Vec<&str>> = rows.map(|line| line.split('|').map(str::trim).collect()).collect();
    let layout = BlockLayout::of(&small_job(), BlockId(0));
    let factors = FactoredBlock {
        sparse: (0..200).map(|i| SparseEntry { column: ColumnIndex(i % 67), row: i, value: i as f32 + 1.0 }).collect(),
        ..block(&job(), BlockId(3))
    };
    let mut sorted = factors.sparse.clone();
    sorted.sort_by_key(|entry| (entry.column, entry.row));
    let factors = FactoredBlock { sparse: sorted, ..factors };
    let part = LayerPart { shared: 2, ..Default::default() };
    let bytes = encode_layer(&layout, &factors, part, &CodecSettings::default()).unwrap();
    let (mut at, mut read) = (0, Vec::new());
    for row in &rows {
        let mut value = 0usize;
        match row[2] {
            "byte" => {
                value = usize::from(bytes[at]);
                at += 1;
            }
            "number" => {
                for shift in (0..).step_by(7) {
                    value |= usize::from(bytes[at] & 127) << shift;
                    at += 1;
                    if bytes[at - 1] < 128 {
                        break;
                    }
                }
            }
            other => panic!("{other}"),
        }
        read.push((row[1], value));
    }
    let names: Vec<_> = read.iter().map(|(name, _)| *name).collect();
    assert_eq!(names, ["coding", "shared", "rank", "sparse entries", "side", "low bits"]);
    let values: Vec<_> = read.iter().map(|(_, value)| *value).collect();
    assert_eq!(values[..4], [3, 2, 4, 200]);
    // Twice the bytes of the side stream, and whether the coefficients have 8 states of 4 bytes or one.
    let (side, states) = (values[4] / 2, [1, 8][values[4] % 2]);
    assert!(side > 100 && at + side + values[5] + 4 * states <= bytes.len());
}
