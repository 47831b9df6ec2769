//! Light groups in OpenEXR files: where the image of which light stands.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use super::roles::{Named, Roles, roles};
use super::{LayerMatch, LayerPattern, LayerRole, LightRow, LightSet, Source, TakeRow, hand_over_black};
use crate::error::{Error, Hint, Result, Warning, Warnings};
use crate::files::natural_order;
use crate::image::open_exr::{
    Channel, ChannelPlace, Colours, ExrLayer, ExrLine, Window, channels, chunk_bytes, common_frame, converted_rows,
    layers, matrices, note_of_frame, read_lines, read_meta, windows_of,
};
use crate::image::primaries::ColourMatrix;

/// Positions of the images in a file.
#[derive(Clone, Debug)]
pub(super) struct Layers {
    pub(super) path: PathBuf,
    /// For each channel that is wanted, the image and the colour that it is; no colour: all three.
    pub(super) targets: HashMap<ChannelPlace, (usize, Option<usize>)>,
    /// The channels that show all lights to people: those of the sum, or of the denoised picture beside it.
    pub(super) beauty: HashMap<ChannelPlace, Option<usize>>,
    pub(super) parts: Vec<ExrPart>,
    /// The part of each image.
    parts_of_images: Vec<usize>,
    pub(super) frame: Window,
    chunk_bytes: u64,
}

/// A part of the file.
#[derive(Clone, Debug)]
pub(super) struct ExrPart {
    channels: usize,
    /// Window of its pixels.
    pub(super) data: Window,
    /// Matrix to Rec. 709, if it has other primaries.
    pub(super) matrix: Option<ColourMatrix>,
}

fn refuse(path: &Path, problem: String, hint: impl Into<Hint>) -> Error {
    Error::input(path.display().to_string(), problem, hint)
}

/// Looks at the layers of an OpenEXR file, multi-part or interleaved.
pub(super) fn open(path: &Path, pattern: Option<&LayerPattern>) -> Result<LightSet> {
    let meta = read_meta(path)?;
    let mut all = layers(&channels(&meta));
    all.sort_by(|a, b| natural_order(&a.name, &b.name));
    let coloured: Vec<&ExrLayer> = all.iter().filter(|layer| layer.colours.is_some()).collect();
    let named: Vec<Named<'_>> = coloured.iter().map(|layer| named(layer)).collect();
    let found = roles(&named, pattern).map_err(|(problem, hint)| refuse(path, problem, hint))?;
    let mut warnings: Warnings = passed_over(&named, &found).into_iter().collect();
    let mut roles = found.roles.into_iter();
    let (mut matches, mut lights, mut images, mut sum) = (Vec::new(), Vec::new(), Vec::new(), None);
    for layer in &all {
        let role = layer.colours.and_then(|_| roles.next()).unwrap_or(LayerRole::Ignored);
        match &role {
            LayerRole::Light(light) => {
                lights.push(light.clone());
                images.push(layer);
            }
            LayerRole::Sum => sum = Some(layer),
            LayerRole::Ignored => {}
        }
        matches.push(LayerMatch { layer: layer.name.clone(), role });
    }
    images.extend(sum);
    // A noisy picture beside a denoised one is written too: it is what tells a reader what is beyond the lights.
    let beauty = sum.into_iter().flat_map(|sum| [sum, beauty_of(&all, sum)]).filter_map(places_of).flatten().collect();
    let (matrices, notes) = matrices(path, &meta)?;
    warnings.extend(notes.iter().map(|note| format!("{}: {note}", path.display())));
    let mut targets = HashMap::new();
    let mut parts_of_images = Vec::new();
    for (image, layer) in images.iter().enumerate() {
        let Some(places) = places_of(layer) else {
            let problem = format!("layer '{}' holds luminance and chroma", layer.name);
            return Err(refuse(path, problem, "write it as red, green and blue"));
        };
        let part = places[0].0.0;
        if places.iter().any(|(place, _)| place.0 != part) {
            let problem = format!("the colours of layer '{}' are in parts of their own", layer.name);
            return Err(refuse(path, problem, "write each layer into one part"));
        }
        let sampling = |(part, channel): ChannelPlace| meta.headers[part].channels.list[channel].sampling;
        if places.iter().any(|(place, _)| (sampling(*place).0, sampling(*place).1) != (1, 1)) {
            let problem = format!("layer '{}' is subsampled", layer.name);
            return Err(refuse(path, problem, "write it without subsampling"));
        }
        parts_of_images.push(part);
        targets.extend(places.into_iter().map(|(place, colour)| (place, (image, colour))));
    }
    let windows: Vec<(Window, Window)> = parts_of_images.iter().map(|&part| windows_of(&meta.headers[part])).collect();
    let frame = common_frame(&windows).map_err(|other| {
        let problem = format!("layer '{}' is of another picture (display window) than the others", images[other].name);
        refuse(path, problem, "write all layers with one display window")
    })?;
    let (width, height) = super::size_of_frame(path, &frame)?;
    warnings.extend(note_of_frame(&frame, &windows));
    let parts = meta.headers.iter().zip(matrices).map(|(header, matrix)| ExrPart {
        channels: header.channels.list.len(),
        data: windows_of(header).0,
        matrix,
    });
    let parts = parts.collect();
    let source = Layers {
        path: path.to_owned(),
        targets,
        beauty,
        parts,
        parts_of_images,
        frame,
        chunk_bytes: chunk_bytes(&meta),
    };
    Ok(LightSet { width, height, lights, has_sum: sum.is_some(), matches, warnings, source: Source::Layers(source) })
}

/// The channels of a layer, each with the colour that it is; no colour: all three. None for luminance with chroma, and for no picture.
fn places_of(layer: &ExrLayer) -> Option<Vec<(ChannelPlace, Option<usize>)>> {
    match layer.colours {
        Some(Colours::Rgb(places)) => Some((0..3).map(|colour| (places[colour], Some(colour))).collect()),
        Some(Colours::Grey(place)) => Some(vec![(place, None)]),
        Some(Colours::Chroma(_)) | None => None,
    }
}

/// The layer that people look at: of a noisy sum the denoised picture of the same view layer.
fn beauty_of<'a>(all: &'a [ExrLayer], sum: &'a ExrLayer) -> &'a ExrLayer {
    let path = sum.stem.to_lowercase().strip_suffix("noisy image").map(str::to_owned);
    let is_beside = |layer: &&ExrLayer| {
        path.as_ref().is_some_and(|path| layer.stem.to_lowercase() == format!("{path}combined"))
            && layer.view == sum.view
            && places_of(layer).is_some()
    };
    all.iter().find(is_beside).unwrap_or(sum)
}

fn named(layer: &ExrLayer) -> Named<'_> {
    let is_grey = matches!(layer.colours, Some(Colours::Grey(_)));
    Named { name: &layer.name, stem: &layer.stem, view: layer.view.as_deref(), is_grey }
}

/// A line that names layers of colours which no one can miss: without an image under all lights nothing says whether they
/// belong to them.
fn passed_over(layers: &[Named<'_>], found: &Roles) -> Option<Warning> {
    let has_sum = found.roles.contains(&LayerRole::Sum);
    let is_left = |(layer, role): &(&Named<'_>, &LayerRole)| **role == LayerRole::Ignored && !layer.is_grey;
    let left: Vec<String> =
        layers.iter().zip(&found.roles).filter(is_left).map(|(layer, _)| format!("'{}'", layer.name)).collect();
    let text = || format!("{} are taken for passes that are no lights", left.join(", "));
    (found.is_by_elimination && !has_sum && !left.is_empty()).then(|| Warning::new(text(), Hint::ChooseLayers))
}

/// What a renderer's passes say of the surfaces in view: albedo, normal, depth.
const FEATURES: [(&str, &[&str]); 3] = [("albedo", &["R", "G", "B"]), ("normal", &["X", "Y", "Z"]), ("depth", &["Z"])];

/// Where albedo (image 0), normal (1) and depth (2) stand in an OpenEXR file, as far as it has them, and its size. Passes made for
/// denoisers come first; else the layer of the shortest name. The image of a light is none of them, whatever its name.
pub(super) fn open_features(path: &Path) -> Result<Option<(Layers, (u32, u32))>> {
    let meta = read_meta(path)?;
    let channels = channels(&meta);
    let all = layers(&channels);
    let coloured: Vec<Named<'_>> = all.iter().filter(|layer| layer.colours.is_some()).map(named).collect();
    let roles = roles(&coloured, None).map(|found| found.roles).unwrap_or_default();
    let is_light =
        |name: &str| coloured.iter().zip(&roles).any(|(l, role)| l.name == name && matches!(role, LayerRole::Light(_)));
    let (mut targets, mut window) = (HashMap::new(), None);
    for (image, (word, names)) in FEATURES.iter().enumerate() {
        let mut layers: Vec<&str> = channels.iter().map(|channel| channel.layer.as_str()).collect();
        layers.retain(|layer| layer.to_lowercase().contains(word) && !is_light(layer));
        layers.sort_by_key(|layer| (!layer.to_lowercase().contains("denois"), layer.len(), *layer));
        let Some(&layer) = layers.first() else { continue };
        let of_layer: Vec<&Channel> = channels.iter().filter(|channel| channel.layer == layer).collect();
        for (index, name) in names.iter().enumerate() {
            // Normals may be stored as colours, and a depth alone under any name.
            let is_named = |channel: &&&Channel| {
                let is = |name: &str| channel.name.eq_ignore_ascii_case(name);
                is(name)
                    || (*word == "normal" && is(["R", "G", "B"][index]))
                    || (names.len() == 1 && of_layer.len() == 1)
            };
            let Some(found) = of_layer.iter().find(is_named) else { continue };
            let (part, channel) = found.place;
            let here = windows_of(&meta.headers[part]).0;
            let sampling = meta.headers[part].channels.list[channel].sampling;
            if *window.get_or_insert(here) == here && (sampling.0, sampling.1) == (1, 1) {
                targets.insert(found.place, (image, Some(index)));
            }
        }
    }
    let Some(frame) = window else { return Ok(None) };
    let size = super::size_of_frame(path, &frame)?;
    let part = |header: &exr::meta::header::Header| ExrPart {
        channels: header.channels.list.len(),
        data: windows_of(header).0,
        matrix: None,
    };
    let parts = meta.headers.iter().map(part).collect();
    let chunk_bytes = chunk_bytes(&meta);
    // All of them have the whole frame.
    let parts_of_images = Vec::new();
    let (path, beauty) = (path.to_owned(), HashMap::new());
    Ok(Some((Layers { path, targets, beauty, parts, parts_of_images, frame, chunk_bytes }, size)))
}

/// The colours of a row of one image, until all three are there.
type Waiting = BTreeMap<usize, (usize, [Vec<f32>; 3])>;

impl Layers {
    /// Bytes of the largest chunk of the file.
    pub(super) fn chunk_bytes(&self) -> u64 {
        self.chunk_bytes
    }

    /// Hands over the rows of the images, in the order of the file; first what its parts do not hold of the frame.
    pub(super) fn read(&self, take: &mut TakeRow<'_>) -> Result<()> {
        for (image, &part) in self.parts_of_images.iter().enumerate() {
            hand_over_black(image, &self.parts[part].data, &self.frame, take)?;
        }
        let counts: Vec<usize> = self.parts.iter().map(|part| part.channels).collect();
        let mut waiting = Waiting::new();
        read_lines(&self.path, &counts, &|place| self.targets.contains_key(&place), &mut |line: ExrLine<'_>| {
            self.hand_over(&line, &mut waiting, take)
        })
    }

    fn hand_over(&self, line: &ExrLine<'_>, waiting: &mut Waiting, take: &mut TakeRow<'_>) -> Result<()> {
        let Some(&(image, colour)) = self.targets.get(&line.place) else { return Ok(()) };
        let part = &self.parts[line.place.0];
        let Some(inside) = part.data.clip(&self.frame, (line.x, line.y), line.values.len()) else { return Ok(()) };
        let values = &line.values[inside.skipped..][..inside.length];
        let mut give =
            |channel: usize, values: &[f32]| take(LightRow { image, channel, x: inside.x, y: inside.y, values });
        match (colour, &part.matrix) {
            (Some(colour), None) => give(colour, values),
            // A grey of any primaries is the grey of all.
            (None, _) => (0..3).try_for_each(|channel| give(channel, values)),
            (Some(colour), Some(matrix)) => {
                let (known, rows) = waiting.entry(image).or_default();
                rows[colour] = values.to_vec();
                *known += 1;
                if *known < 3 {
                    return Ok(());
                }
                let (_, mut rows) = waiting.remove(&image).expect("it was just there");
                converted_rows(matrix, &mut rows);
                rows.iter().enumerate().try_for_each(|(channel, row)| give(channel, row))
            }
        }
    }
}
