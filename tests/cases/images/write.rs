//! Files made byte by byte, as the formats' texts say, by no library; and what the readers make of them.

use std::path::{Path, PathBuf};

use ltm::image::{LayerPattern, LightSet, RgbaImage, image_facts, read_rgba};
use ltm::pipeline::{ImageNoise, ImportedMatrix, PackOptions};
use ltm::resources::NoProgress;
use tempfile::TempDir;

/// The value at a pixel of the data window.
pub(super) type Value<'a> = dyn Fn(usize, usize) -> f32 + 'a;

/// A channel of 32-bit floats: name, pixels for one sample across and down, value at a pixel of the data window.
pub(super) struct Channel<'a> {
    pub(super) name: &'a [u8],
    pub(super) sampling: [usize; 2],
    pub(super) value: &'a Value<'a>,
}

/// An uncompressed OpenEXR file of one part.
pub(super) struct Exr {
    /// x, y, width, height.
    pub(super) data: [i32; 4],
    pub(super) display: [i32; 4],
    /// Name, type, bytes.
    pub(super) attributes: Vec<(&'static str, &'static str, Vec<u8>)>,
}

impl Exr {
    pub(super) fn new(width: i32, height: i32) -> Self {
        Self { data: [0, 0, width, height], display: [0, 0, width, height], attributes: Vec::new() }
    }

    pub(super) fn windows(data: [i32; 4], display: [i32; 4]) -> Self {
        Self { data, display, attributes: Vec::new() }
    }

    pub(super) fn with(mut self, name: &'static str, kind: &'static str, bytes: Vec<u8>) -> Self {
        self.attributes.push((name, kind, bytes));
        self
    }

    pub(super) fn chromaticities(self, values: [f32; 8]) -> Self {
        self.with("chromaticities", "chromaticities", values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }

    /// Channels with a sample for each pixel.
    pub(super) fn write(&self, path: &Path, channels: &[(&str, &Value<'_>)]) {
        let channels = channels.iter().map(|&(name, value)| Channel { name: name.as_bytes(), sampling: [1, 1], value });
        self.write_channels(path, channels.collect());
    }

    pub(super) fn write_channels(&self, path: &Path, mut channels: Vec<Channel<'_>>) {
        channels.sort_by_key(|channel| channel.name.to_vec());
        let mut list = Vec::new();
        for channel in &channels {
            list.extend([channel.name, &[0, 2, 0, 0, 0, 0, 0, 0, 0]].concat());
            list.extend(channel.sampling.iter().flat_map(|&s| (s as i32).to_le_bytes()));
        }
        list.push(0);
        let window =
            |[x, y, w, h]: [i32; 4]| [x, y, x + w - 1, y + h - 1].map(i32::to_le_bytes).as_flattened().to_vec();
        let mut attributes = vec![
            ("channels", "chlist", list),
            ("compression", "compression", vec![0]),
            ("dataWindow", "box2i", window(self.data)),
            ("displayWindow", "box2i", window(self.display)),
            ("lineOrder", "lineOrder", vec![0]),
            ("pixelAspectRatio", "float", 1.0f32.to_le_bytes().to_vec()),
            ("screenWindowCenter", "v2f", vec![0; 8]),
            ("screenWindowWidth", "float", 1.0f32.to_le_bytes().to_vec()),
        ];
        attributes.extend(self.attributes.iter().cloned());
        let mut bytes = vec![0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0];
        for (name, kind, value) in &attributes {
            bytes.extend(
                [name.as_bytes(), &[0], kind.as_bytes(), &[0], &(value.len() as i32).to_le_bytes(), value].concat(),
            );
        }
        bytes.push(0);
        let [_, _, width, height] = self.data.map(|v| v as usize);
        let mut lines = Vec::new();
        for y in 0..height {
            let mut line = Vec::new();
            for Channel { sampling: [across, down], value, .. } in &channels {
                if y % down == 0 {
                    line.extend((0..width).step_by(*across).flat_map(|x| value(x, y).to_le_bytes()));
                }
            }
            lines.push(
                [&(self.data[1] + y as i32).to_le_bytes(), &(line.len() as i32).to_le_bytes(), line.as_slice()]
                    .concat(),
            );
        }
        let mut at = bytes.len() + 8 * height;
        for line in &lines {
            bytes.extend((at as u64).to_le_bytes());
            at += line.len();
        }
        lines.iter().for_each(|line| bytes.extend(line));
        std::fs::write(path, bytes).unwrap();
    }
}

/// A layer's red, green and blue as the three values at every pixel.
pub(super) fn constant(layers: &[(&str, [f32; 3])], exr: &Exr, path: &Path) {
    let mut channels: Vec<(String, Box<Value<'static>>)> = Vec::new();
    for &(layer, colour) in layers {
        let dot = if layer.is_empty() { "" } else { "." };
        for (name, value) in ["R", "G", "B"].into_iter().zip(colour) {
            channels.push((format!("{layer}{dot}{name}"), Box::new(move |_, _| value)));
        }
    }
    let channels: Vec<(&str, &Value<'_>)> =
        channels.iter().map(|(name, value)| (name.as_str(), value.as_ref())).collect();
    exr.write(path, &channels);
}

/// A strings attribute.
pub(super) fn strings(texts: &[&str]) -> Vec<u8> {
    texts.iter().flat_map(|text| [&(text.len() as i32).to_le_bytes(), text.as_bytes()].concat()).collect()
}

/// A file of a temporary folder.
pub(super) fn file(name: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    (folder, path)
}

/// A picture and what is said of it.
pub(super) fn picture(path: &Path) -> (RgbaImage, String) {
    (read_rgba(path).unwrap(), image_facts(path).unwrap().notes.join("\n"))
}

/// An error of reading a picture: one line.
pub(super) fn refused_picture(path: &Path) -> String {
    let error = read_rgba(path).unwrap_err().to_string();
    assert!(!error.contains('\n'), "{error}");
    error
}

/// Images of lights: names, `[image][y][x]`, what is said.
pub(super) struct Lights {
    pub(super) names: Vec<String>,
    pub(super) size: (usize, usize),
    pub(super) images: Vec<Vec<[f32; 3]>>,
    pub(super) has_sum: bool,
    pub(super) warnings: String,
}

pub(super) fn lights(path: &Path, layers: Option<&str>) -> ltm::Result<Lights> {
    let pattern = layers.map(|layers| layers.parse::<LayerPattern>().unwrap());
    let set = LightSet::open(path, pattern.as_ref())?;
    let (width, height) = (set.width as usize, set.height as usize);
    let mut images = vec![vec![[f32::NAN; 3]; width * height]; set.images()];
    set.read(&mut |row| {
        for (x, value) in row.values.iter().enumerate() {
            let place = &mut images[row.image][row.y * width + row.x + x][row.channel];
            assert!(place.is_nan(), "a pixel is handed over once");
            *place = *value;
        }
        Ok(())
    })?;
    assert!(images.iter().flatten().flatten().all(|v| !v.is_nan()), "every pixel is handed over");
    let warnings = set.warnings.lines().join("\n");
    Ok(Lights { names: set.lights, size: (width, height), images, has_sum: set.has_sum, warnings })
}

/// The error of looking at images of lights or reading them: one line.
pub(super) fn refused(path: &Path) -> String {
    let error = lights(path, None).err().expect("it is refused").to_string();
    assert!(!error.contains('\n'), "{error}");
    error
}

/// The names of the columns of what is imported, the difference between the lights' sum and the image under all, the warnings.
pub(super) fn imported(path: &Path) -> (Vec<String>, Option<f64>, String) {
    let set = LightSet::open(path, None).unwrap();
    let beside = tempfile::tempdir().unwrap();
    let place = beside.path().join("x");
    let matrix =
        ImportedMatrix::read(&set, ImageNoise::Unknown, "test", &place, 32, &PackOptions::default(), &NoProgress)
            .unwrap();
    let names = matrix.job().basis.lights().iter().map(|light| light.name.clone()).collect();
    (names, matrix.sum_difference, matrix.warnings.lines().join("\n"))
}

pub(super) fn near(found: [f32; 3], wanted: [f32; 3], tolerance: f32) {
    assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() <= tolerance), "{found:?} for {wanted:?}");
}

pub(super) fn rgb([r, g, b, _]: [f32; 4]) -> [f32; 3] {
    [r, g, b]
}
