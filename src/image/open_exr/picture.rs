//! The one picture of a file: a sky, a texture, a light by itself.

use std::path::{Path, PathBuf};

use exr::prelude::Vec2;
use rayon::prelude::*;

use super::chroma::{Plane, colour, luminance_weights};
use super::colours::{refused, space_of};
use super::windows_of;
use super::{
    Channel, ChannelPlace, Colours, ExrLayer, ExrLine, Window, channels, chunk_bytes, layers, read_lines, read_meta,
};
use crate::error::{Error, Result};
use crate::image::RgbaImage;
use crate::image::primaries::{ColourMatrix, converted};
use crate::image::rgba::{RETURNED_BYTES, refuse};

/// Names of the layer that is the picture itself, beside which others are parts of it: the first that is there.
const MAIN: [&str; 9] = ["", "combined", "rgba", "beauty", "rgb", "image", "color", "ci", "c"];

/// What is known of a picture before its pixels are read.
#[derive(Clone, Debug)]
pub(in crate::image) struct ExrPicture {
    path: PathBuf,
    /// Channels of each part.
    counts: Vec<usize>,
    colours: Colours,
    alpha: Option<ChannelPlace>,
    /// Samples of chroma in a row and a column: one for so many pixels.
    sampling: [(usize, usize); 2],
    weights: [f32; 3],
    matrix: Option<ColourMatrix>,
    chunk_bytes: u64,
    /// Window of its pixels.
    pub(in crate::image) data: Window,
    /// The whole picture.
    pub(in crate::image) display: Window,
    /// Notes on what was chosen and converted, for people.
    pub(in crate::image) notes: Vec<String>,
}

impl ExrPicture {
    /// Looks at a file.
    ///
    /// # Errors
    /// A file that cannot be read, has no picture, or whose picture cannot be told.
    pub(in crate::image) fn open(path: &Path) -> Result<Self> {
        let meta = read_meta(path)?;
        let all = channels(&meta);
        let mut notes = Vec::new();
        let (colours, alpha) = chosen(&all, &mut notes).map_err(|problem| refuse(path, &problem))?;
        let places = places_of(colours);
        let part = places[0].0;
        if places.iter().chain(&alpha).any(|place| place.0 != part) {
            return Err(refuse(path, "the colours of its picture are in parts of their own"));
        }
        let header = &meta.headers[part];
        let sampling = |(part, channel): ChannelPlace| meta.headers[part].channels.list[channel].sampling;
        let is_chroma =
            |place: ChannelPlace| matches!(colours, Colours::Chroma(places) if places[1..].contains(&place));
        if places.iter().chain(&alpha).any(|&place| !is_chroma(place) && sampling(place) != Vec2(1, 1)) {
            return Err(refuse(path, "its colours have fewer samples than pixels"));
        }
        let space = space_of(header).map_err(|problem| refused(path, problem))?;
        notes.extend(space.note);
        let of_chroma = match colours {
            Colours::Chroma(places) => {
                [places[1], places[2]].map(|place| (sampling(place).0.max(1), sampling(place).1.max(1)))
            }
            _ => [(1, 1); 2],
        };
        if of_chroma != [(1, 1); 2] {
            notes.push("its colours are interpolated: it has fewer samples of chroma than of luminance".into());
        }
        let weights = luminance_weights(&space.primaries).filter(|_| matches!(colours, Colours::Chroma(_)));
        let (data, display) = windows_of(header);
        Ok(Self {
            path: path.to_owned(),
            counts: meta.headers.iter().map(|header| header.channels.list.len()).collect(),
            colours,
            alpha,
            sampling: of_chroma,
            weights: weights.unwrap_or([0.0, 1.0, 0.0]),
            matrix: space.matrix,
            chunk_bytes: chunk_bytes(&meta),
            data,
            display,
            notes,
        })
    }

    /// A note on how pixels are padded or cropped if the frame and the file's pixels differ; `None` if they agree.
    ///
    /// # Errors
    /// The file has no pixel of its frame.
    pub(in crate::image) fn note_of_frame(&self) -> Result<Option<String>> {
        let (data, display) = (&self.data, &self.display);
        if data == display {
            return Ok(None);
        }
        if !data.meets(display) {
            let problem = format!("its pixels ({data}) lie outside its display window ({display})");
            return Err(Error::input(
                self.path.display().to_string(),
                problem,
                "write it with the frame that it shows",
            ));
        }
        let what = if display.holds(data) { "the rest is black" } else { "what lies beyond is left out" };
        Ok(Some(format!("its data window of {data} lies in a display window of {display}: {what}")))
    }

    /// Bytes of memory that [`read`](Self::read) takes at most, with what it returns as one or the other kind of image.
    pub(in crate::image) fn needs_bytes(&self, frame: &Window) -> u64 {
        let pixels = |window: &Window| window.width.saturating_mul(window.height);
        let planes = if matches!(self.colours, Colours::Chroma(_)) { pixels(&self.data).saturating_mul(24) } else { 0 };
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let threads = cores.max(rayon::current_num_threads()) as u64 + 2;
        let chunks = self.chunk_bytes.saturating_mul(5 * threads);
        pixels(frame).saturating_mul(RETURNED_BYTES).saturating_add(planes).saturating_add(chunks)
    }

    /// Reads the pixels of a frame; black and clear where the file has none.
    ///
    /// # Errors
    /// A file that cannot be read, is damaged or has changed.
    pub(in crate::image) fn read(&self, frame: &Window) -> Result<RgbaImage> {
        let (width, height) = (frame.width as usize, frame.height as usize);
        // Not touched before chunks are decoded.
        let mut pixels = vec![[0.0f32; 4]; width * height];
        if let Colours::Chroma(places) = self.colours {
            self.read_chroma(places, frame, &mut pixels)?;
        }
        self.read_plain(frame, &mut pixels)?;
        let has_alpha = self.alpha.is_some();
        pixels.par_iter_mut().for_each(|pixel| {
            let [r, g, b, a] = *pixel;
            let [r, g, b] = self.matrix.as_ref().map_or([r, g, b], |matrix| converted(matrix, [r, g, b]));
            *pixel = [r, g, b, if has_alpha { a } else { 1.0 }];
        });
        Ok(RgbaImage {
            width: width as u32,
            height: height as u32,
            pixels,
            has_alpha,
            is_8_bit: false,
            is_encoded: false,
        })
    }

    /// Reads the channels that stand in pixels as they are.
    fn read_plain(&self, frame: &Window, pixels: &mut [[f32; 4]]) -> Result<()> {
        let mut targets: Vec<(ChannelPlace, std::ops::Range<usize>)> = match self.colours {
            Colours::Rgb([r, g, b]) => vec![(r, 0..1), (g, 1..2), (b, 2..3)],
            Colours::Grey(grey) => vec![(grey, 0..3)],
            Colours::Chroma(_) => Vec::new(),
        };
        targets.extend(self.alpha.map(|alpha| (alpha, 3..4)));
        if targets.is_empty() {
            return Ok(());
        }
        let wanted = |place: ChannelPlace| targets.iter().any(|(target, _)| *target == place);
        read_lines(&self.path, &self.counts, &wanted, &mut |line: ExrLine<'_>| {
            let Some(inside) = self.data.clip(frame, (line.x, line.y), line.values.len()) else { return Ok(()) };
            let row = &mut pixels[inside.y * frame.width as usize + inside.x..][..inside.length];
            for (_, slots) in targets.iter().filter(|(target, _)| *target == line.place) {
                for (pixel, value) in row.iter_mut().zip(&line.values[inside.skipped..]) {
                    pixel[slots.clone()].fill(*value);
                }
            }
            Ok(())
        })
    }

    /// Reads luminance and chroma, and makes colours of them.
    fn read_chroma(&self, places: [ChannelPlace; 3], frame: &Window, pixels: &mut [[f32; 4]]) -> Result<()> {
        let (width, height) = (self.data.width as usize, self.data.height as usize);
        let sampling = [(1, 1), self.sampling[0], self.sampling[1]];
        let mut planes = sampling.map(|(across, down)| Plane::new(width / across, height / down));
        read_lines(&self.path, &self.counts, &|place| places.contains(&place), &mut |line: ExrLine<'_>| {
            let index = places.iter().position(|place| *place == line.place).expect("only these are wanted");
            let (plane, (across, down)) = (&mut planes[index], sampling[index]);
            let at = line.y / down * plane.width + line.x / across;
            let changed = || refuse(&self.path, "it changed while it was read");
            plane.values.get_mut(at..at + line.values.len()).ok_or_else(changed)?.copy_from_slice(line.values);
            Ok(())
        })?;
        let [luma, red, blue] = [0, 1, 2].map(|i: usize| {
            let plane = std::mem::take(&mut planes[i]);
            if sampling[i] == (1, 1) { plane } else { plane.grown(sampling[i]) }
        });
        for y in 0..height {
            let Some(inside) = self.data.clip(frame, (0, y), width) else { continue };
            let row = &mut pixels[inside.y * frame.width as usize + inside.x..][..inside.length];
            for (x, pixel) in (inside.skipped..).zip(row) {
                let stored = [&luma, &red, &blue].map(|plane| plane.values[y * width + x]);
                pixel[..3].copy_from_slice(&colour(stored, self.weights));
            }
        }
        Ok(())
    }
}

fn places_of(colours: Colours) -> Vec<ChannelPlace> {
    match colours {
        Colours::Rgb(places) | Colours::Chroma(places) => places.to_vec(),
        Colours::Grey(place) => vec![place],
    }
}

/// The colours and the alpha of the picture among all that a file holds. Errors: as text for the caller to place.
fn chosen(all: &[Channel], notes: &mut Vec<String>) -> Result<(Colours, Option<ChannelPlace>), String> {
    let layers = layers(all);
    let mut candidates: Vec<(&ExrLayer, Colours)> = layers.iter().filter_map(|l| Some((l, l.colours?))).collect();
    if candidates.iter().any(|(_, colours)| matches!(colours, Colours::Rgb(_))) {
        candidates.retain(|(_, colours)| !matches!(colours, Colours::Grey(_)));
    }
    if candidates.is_empty() {
        // One channel alone is a picture in grey, whatever its name.
        let others: Vec<&Channel> = all.iter().filter(|channel| !channel.name.eq_ignore_ascii_case("A")).collect();
        return match others.as_slice() {
            [only] => Ok((Colours::Grey(only.place), None)),
            _ => Err("it has no layer of red, green and blue".into()),
        };
    }
    // The first view is the one that readers of one view show.
    let view = candidates[0].0.view.as_ref();
    let eye = candidates.iter().find(|(layer, _)| layer.view.as_deref() == Some("left")).map(|(layer, _)| &layer.view);
    let view = eye.map_or(view, Option::as_ref);
    let count = candidates.len();
    candidates.retain(|(layer, _)| layer.view.as_ref() == view);
    if let Some(view) = view.filter(|_| candidates.len() < count) {
        notes.push(format!("it holds several views; '{}' is read", view.escape_debug()));
    }
    let rank = |layer: &ExrLayer| {
        let last = layer.stem.rsplit_once('.').map_or(layer.stem.as_str(), |(_, last)| last).to_lowercase();
        let rank = MAIN.iter().position(|main| *main == last);
        // The picture of a view layer comes after one of the whole file.
        (rank.is_none(), layer.stem.contains('.'), rank)
    };
    let best = candidates.iter().map(|(layer, _)| rank(layer)).min().expect("there is one");
    let same = candidates.iter().filter(|(layer, _)| rank(layer) == best).count();
    let (layer, colours) = *candidates.iter().find(|(layer, _)| rank(layer) == best).expect("it was found");
    if same > 1 || (best.0 && candidates.len() > 1) {
        let (count, name) = (candidates.len(), layer.name.escape_debug());
        notes.push(format!("it holds {count} pictures; '{name}' is read"));
    }
    Ok((colours, layer.alpha))
}
