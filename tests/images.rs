//! Images and arrays of all kinds that other programs write, value by value, and forged ones.

use std::io::{Cursor, Write};
use std::path::Path;

use exr::prelude::{
    Blocks, ChannelDescription, Compression, Encoding, Image, Layer, LayerAttributes, LineOrder, SpecificChannels,
    Vec2, WritableImage, f16,
};
use ltm::Error;
use ltm::image::{LayerPattern, LightSet, image_facts, read_image, read_rgba};

const WIDTH: usize = 21;
const HEIGHT: usize = 13;

/// Values that 16-bit floats hold exactly, of neighbours that differ.
fn colour(x: usize, y: usize) -> (f32, f32, f32) {
    ((x + 2 * y) as f32 / 16.0, (3 * x + y) as f32 / 8.0, (x * y) as f32 / 4.0)
}

fn colour_at(at: Vec2<usize>) -> (f32, f32, f32) {
    colour(at.x(), at.y())
}

type Colours =
    SpecificChannels<fn(Vec2<usize>) -> (f32, f32, f32), (ChannelDescription, ChannelDescription, ChannelDescription)>;

fn encoding(compression: Compression, blocks: Blocks) -> Encoding {
    Encoding { compression, blocks, line_order: LineOrder::Increasing }
}

/// A layer of red, green and blue in 32-bit floats.
fn layer(name: Option<&str>, size: (usize, usize), encoding: Encoding) -> Layer<Colours> {
    let attributes = LayerAttributes { layer_name: name.map(Into::into), ..LayerAttributes::default() };
    Layer::new(size, attributes, encoding, SpecificChannels::rgb(colour_at as fn(Vec2<usize>) -> _))
}

#[test]
fn openexr_files_of_every_lossless_kind_give_the_same_values() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    for compression in
        [Compression::Uncompressed, Compression::RLE, Compression::ZIP1, Compression::ZIP16, Compression::PIZ]
    {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(8, 5))] {
            let image = Image::from_layer(layer(None, (WIDTH, HEIGHT), encoding(compression, blocks)));
            image.write().to_file(&path).unwrap();
            let read = read_rgba(&path).unwrap();
            assert_eq!((read.width as usize, read.height as usize, read.has_alpha), (WIDTH, HEIGHT, false));
            for (i, pixel) in read.pixels.iter().enumerate() {
                let (r, g, b) = colour(i % WIDTH, i / WIDTH);
                assert_eq!(*pixel, [r, g, b, 1.0], "{compression}, {blocks:?}, pixel {i}");
            }
        }
    }
}

#[test]
fn lossy_openexr_files_of_16_bit_floats_are_read_nearly() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    // The method keeps what a value lacks of its neighbour in a block of 4 × 4: large steps, or from zero, it loses.
    let smooth = |x: usize, y: usize| {
        let (r, g, b) = colour(x, y);
        [8.0 + r / 8.0, 8.0 + g / 16.0, 8.0 + b / 16.0]
    };
    let pixels = SpecificChannels::rgb(|at: Vec2<usize>| smooth(at.x(), at.y()).map(f16::from_f32).into());
    for compression in [Compression::B44, Compression::B44A] {
        let encoding = encoding(compression, Blocks::ScanLines);
        let layer = Layer::new((WIDTH, HEIGHT), LayerAttributes::default(), encoding, pixels.clone());
        Image::from_layer(layer).write().to_file(&path).unwrap();
        let read = read_image(&path).unwrap();
        for (i, pixel) in read.pixels.iter().enumerate() {
            for (found, wanted) in pixel.iter().zip(smooth(i % WIDTH, i / WIDTH)) {
                assert!((found - wanted).abs() <= 0.02 * wanted, "{compression}, pixel {i}: {found} for {wanted}");
            }
        }
    }
}

/// The display window is the picture: pixels of the data window lie where they belong, black where there are none.
#[test]
fn the_display_window_of_an_openexr_file_is_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let mut windowed = layer(None, (WIDTH, HEIGHT), encoding(Compression::ZIP16, Blocks::ScanLines));
    windowed.attributes.layer_position = Vec2(-3, 7);
    let mut image = Image::from_layer(windowed);
    image.attributes.display_window.position = Vec2(0, 0);
    image.attributes.display_window.size = Vec2(64, 48);
    image.write().to_file(&path).unwrap();
    let read = read_image(&path).unwrap();
    assert_eq!((read.width, read.height), (64, 48));
    for (i, pixel) in read.pixels.iter().enumerate() {
        let (x, y) = (i % 64 + 3, (i / 64).wrapping_sub(7));
        let (r, g, b) = if x < WIDTH && y < HEIGHT { colour(x, y) } else { (0.0, 0.0, 0.0) };
        assert_eq!(*pixel, [r, g, b], "pixel {i}");
    }
}

/// The first part may be a small depth pass: size and pixels are those of the part with colours.
#[test]
fn a_part_without_colours_before_the_image_does_not_give_it_its_size() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let depth = SpecificChannels::build().with_channel("Z").with_pixel_fn(|_: Vec2<usize>| (1.0f32,));
    let attributes = |name: &str| LayerAttributes { layer_name: Some(name.into()), ..LayerAttributes::default() };
    let plain = encoding(Compression::Uncompressed, Blocks::ScanLines);
    let small = Layer::new((2, 2), attributes("depth"), plain, depth);
    let image =
        Image::empty(exr::prelude::ImageAttributes::new(exr::prelude::IntegerBounds::from_dimensions((WIDTH, HEIGHT))))
            .with_layer(small)
            .with_layer(layer(Some("colour"), (WIDTH, HEIGHT), plain));
    image.write().to_file(&path).unwrap();
    let facts = image_facts(&path).unwrap();
    assert_eq!((facts.width as usize, facts.height as usize), (WIDTH, HEIGHT));
    let read = read_rgba(&path).unwrap();
    assert_eq!((read.width as usize, read.height as usize, read.pixels.len()), (WIDTH, HEIGHT, WIDTH * HEIGHT));
    let (r, g, b) = colour(20, 12);
    assert_eq!(read.pixels.last(), Some(&[r, g, b, 1.0]));
}

#[test]
fn an_image_without_pixels_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.hdr");
    for size in ["-Y 0 +X 0", "-Y 5 +X 0", "-Y 0 +X 5"] {
        std::fs::write(&path, format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{size}\n")).unwrap();
        let error = read_rgba(&path).unwrap_err().to_string();
        assert!(
            error.contains("a.hdr") && (error.contains("no pixels") || error.contains("cannot be read")),
            "{error}"
        );
    }
}

#[test]
fn what_reading_takes_is_known_before_and_grows_with_the_size() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.hdr");
    std::fs::write(&path, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16384 +X 16384\n").unwrap();
    let facts = image_facts(&path).unwrap();
    assert!(facts.needs_bytes > 16_384 * 16_384 * 28, "{facts:?}");
    std::fs::write(&path, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16385 +X 2\n").unwrap();
    assert!(image_facts(&path).unwrap_err().to_string().contains("16385"));
}

/// The values of all images of a set: `[image][channel][y][x]`.
fn values(path: &Path) -> ltm::Result<(Vec<String>, Vec<f32>)> {
    let set = LightSet::open(path, None::<&LayerPattern>)?;
    let (width, height) = (set.width as usize, set.height as usize);
    let mut all = vec![f32::NAN; set.images() * 3 * height * width];
    set.read(&mut |row| {
        let at = ((row.image * 3 + row.channel) * height + row.y) * width + row.x;
        all[at..at + row.values.len()].copy_from_slice(row.values);
        Ok(())
    })?;
    Ok((set.lights, all))
}

fn array(descr: &str, fortran: bool, shape: &str, body: &[u8]) -> Vec<u8> {
    let fortran = if fortran { "True" } else { "False" };
    let text = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': ({shape}), }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.bytes());
    bytes.extend(body);
    bytes
}

/// Two images of 2 × 1 pixels: their values as they stand in an array, and plane by plane.
const STORED: [f32; 12] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, -0.5, 0.25, 8.0, 16.0, 0.0, 2.5];
const PLANES: [f32; 12] = [1.0, 4.0, 2.0, 5.0, 3.0, 6.0, -0.5, 16.0, 0.25, 0.0, 8.0, 2.5];

#[test]
fn numpy_arrays_of_each_float_are_read_and_other_orders_and_types_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    let halves: Vec<u8> = STORED.iter().flat_map(|v| f16::from_f32(*v).to_le_bytes()).collect();
    let floats: Vec<u8> = STORED.iter().flat_map(|v| v.to_le_bytes()).collect();
    let doubles: Vec<u8> = STORED.iter().flat_map(|v| f64::from(*v).to_le_bytes()).collect();
    for (descr, body) in [("<f2", &halves), ("<f4", &floats), ("<f8", &doubles)] {
        std::fs::write(&path, array(descr, false, "2, 1, 2, 3", body)).unwrap();
        let (names, found) = values(&path).unwrap();
        assert_eq!(
            (names.as_slice(), found.as_slice()),
            (&["light 0".to_owned(), "light 1".into()][..], &PLANES[..]),
            "{descr}"
        );
    }
    let refused = |bytes: Vec<u8>, words: &str| {
        std::fs::write(&path, bytes).unwrap();
        let error = values(&path).unwrap_err();
        assert!(matches!(error, Error::Input { .. }) && error.to_string().contains(words), "{error}");
    };
    refused(array("<f4", true, "2, 1, 2, 3", &floats), "Fortran");
    refused(array(">f4", false, "2, 1, 2, 3", &floats), ">f4");
    refused(array("<i4", false, "2, 1, 2, 3", &floats), "<i4");
    refused(array("<f4", false, "2, 2, 3", &floats), "[2, 2, 3]");
    refused(array("<f4", false, "2, 1, 2, 4", &floats), "[2, 1, 2, 4]");
    refused(array("<f4", false, "3, 1, 2, 3", &floats), "cut short");
    // 60 bytes that claim 16 million lights are refused by the file's length, before a name is made.
    refused(array("<f4", false, "16777216, 1, 1, 3", &[]), "262144 lights at most");
    refused(array("<f4", false, "262144, 65536, 65536, 3", &[]), "cut short");
    refused([b"\x93NUMPY\x01\x00\x14\x00".as_slice(), &[b'{'; 20]].concat(), "not that of a plain array");
}

fn archive(path: &Path, members: &[(&str, Vec<u8>)]) {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in members {
        let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
        zip.start_file(*name, options).unwrap();
        zip.write_all(bytes).unwrap();
    }
    std::fs::write(path, zip.finish().unwrap().into_inner()).unwrap();
}

#[test]
fn names_in_a_numpy_archive_are_the_lights_and_must_be_as_many() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let floats: Vec<u8> = STORED.iter().flat_map(|v| v.to_le_bytes()).collect();
    let images = || array("<f4", false, "2, 1, 2, 3", &floats);
    let texts = |names: &[&str]| -> Vec<u8> {
        let padded = names.iter().flat_map(|name| name.chars().chain(std::iter::repeat('\0')).take(5));
        padded.flat_map(|c| (c as u32).to_le_bytes()).collect()
    };
    archive(&path, &[("images.npy", images()), ("lights.npy", array("<U5", false, "2,", &texts(&["Küche", "灯"])))]);
    assert_eq!(values(&path).unwrap(), (vec!["Küche".to_owned(), "灯".into()], PLANES.to_vec()));
    archive(&path, &[("images.npy", images())]);
    assert_eq!(values(&path).unwrap().0, ["light 0", "light 1"]);
    let refused = |members: &[(&str, Vec<u8>)], words: &str| {
        archive(&path, members);
        let error = values(&path).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    refused(&[("lights.npy", array("<U5", false, "2,", &texts(&["a", "b"])))], "'images'");
    refused(&[("images.npy", images()), ("lights.npy", array("<U5", false, "1,", &texts(&["a"])))], "2 images");
    refused(&[("images.npy", images()), ("lights.npy", array("<i4", false, "2,", &[0; 8]))], "<i4");
    refused(&[("images.npy", images()), ("lights.npy", array("<U5", false, "2,", &texts(&["a", "a"])))], "'a'");
    // A stream that unpacks to names without end is not read further than there are images.
    let bomb = array("<U1", false, "100000000,", &vec![0; 1 << 22]);
    refused(&[("images.npy", images()), ("lights.npy", bomb)], "2 images");
    refused(&[("images.npy", array("<f4", false, "4294967295, 4294967295, 2, 3", &[]))], "shape");
}

#[test]
fn a_radiance_file_may_be_a_light() {
    let folder = tempfile::tempdir().unwrap();
    let mut flat = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n".to_vec();
    flat.extend([128, 64, 0, 129, 128, 128, 128, 132]);
    std::fs::write(folder.path().join("room key.hdr"), &flat).unwrap();
    let (names, found) = values(&folder.path().join("room {light}.hdr")).unwrap();
    assert_eq!((names, found), (vec!["key".to_owned()], vec![1.0, 8.0, 0.5, 8.0, 0.0, 8.0]));
}
