//! The file of a set of lights written again with other images of them, which add up to its picture under all lights.

use std::path::Path;

use exr::meta::attribute::SampleType;
use exr::prelude::f16;

use super::layers::Layers;
use super::{LightSet, Source};
use crate::error::{Error, Result};
use crate::image::open_exr::{ChannelPlace, check_lines, read_meta, rewrite_lines};
use crate::image::primaries::{ColourMatrix, inverse};

/// As [`FetchRow`](crate::image::FetchRow), on any thread: `(image, channel, y, row)`.
pub type GiveRow<'a> = dyn FnMut(usize, usize, usize, &mut [f32]) -> Result<()> + Send + 'a;

impl LightSet {
    /// Writes the OpenEXR file of the lights again at `to`, with the images that `fetch` gives of them, and of what the picture under all
    /// lights has beyond them (the image after the last light). That picture becomes their sum: of the values as they are stored, so that
    /// who adds up the layers of a file in 32 bits gets it to the last digits. A noisy picture beside a denoised one
    /// becomes the same sum. Values are linear Rec. 709, as [`read`](Self::read) gives them, and come out in the file's own colours. All other layers,
    /// and names, types, compression, windows and attributes, stay.
    ///
    /// # Errors
    /// Lights that are not the layers of a single OpenEXR file, or are of several colour spaces; what cannot be written so (levels of
    /// detail, deep or subsampled parts, integers); those of `fetch`; the system refuses to write.
    pub fn rewrite(
        &self,
        to: &Path,
        overwrite: bool,
        (fetch, wrote): (&mut GiveRow<'_>, &mut (dyn FnMut() + Send)),
    ) -> Result<()> {
        self.single_file(to)?.rewrite(self.lights.len(), to, overwrite, (fetch, wrote))
    }

    /// The errors of [`rewrite`](Self::rewrite) that are known before it.
    ///
    /// # Errors
    /// Those of [`rewrite`](Self::rewrite) but for what reading and writing gives.
    pub fn check_rewrite(&self, to: &Path) -> Result<()> {
        let layers = self.single_file(to)?;
        layers.colours_back()?;
        let lights = self.lights.len();
        check_lines(&layers.path, &|place| layers.is_changed(place, lights))
    }

    fn single_file(&self, to: &Path) -> Result<&Layers> {
        match &self.source {
            Source::Layers(layers) => Ok(layers),
            Source::Files(_) | Source::Several(_) | Source::Array(_) => {
                let problem = "cannot be written: only the lights of one OpenEXR file are written as they came";
                Err(Error::input(to.display().to_string(), problem, "give one OpenEXR file with light groups"))
            }
        }
    }
}

/// How the values of a layer are stored.
#[derive(Clone, Copy, Debug)]
struct Stored {
    part: usize,
    /// Its place among three colours; none where one channel is all.
    colour: Option<usize>,
    is_half: bool,
}

impl Stored {
    fn rounded(self, value: f32) -> f32 {
        if self.is_half { f16::from_f32(value).to_f32() } else { value }
    }
}

impl Layers {
    /// Whether a channel is written anew.
    fn is_changed(&self, place: ChannelPlace, lights: usize) -> bool {
        self.beauty.contains_key(&place) || self.targets.get(&place).is_some_and(|(image, _)| *image < lights)
    }

    fn rewrite(
        &self,
        lights: usize,
        to: &Path,
        overwrite: bool,
        (fetch, wrote): (&mut GiveRow<'_>, &mut (dyn FnMut() + Send)),
    ) -> Result<()> {
        let meta = read_meta(&self.path)?;
        let is_half =
            |(part, channel): ChannelPlace| meta.headers[part].channels.list[channel].sample_type == SampleType::F16;
        let back = self.colours_back()?;
        // For each light how each of three colours is stored.
        let mut stored: Vec<[Option<Stored>; 3]> = vec![[None; 3]; lights];
        for (&place, &(image, colour)) in self.targets.iter().filter(|(_, (image, _))| *image < lights) {
            let found = Stored { part: place.0, colour, is_half: is_half(place) };
            match colour {
                Some(colour) => stored[image][colour] = Some(found),
                None => stored[image] = [Some(found); 3],
            }
        }
        let mut rows = [(); 3].map(|()| vec![0.0; self.frame.width as usize]);
        let mut get = |image: usize, colour: usize, y: usize, out: &mut [f32]| match &back {
            None => fetch(image, colour, y, out),
            Some(matrix) => {
                (0..3).try_for_each(|channel| fetch(image, channel, y, &mut rows[channel]))?;
                let of = |x: usize| (0..3).map(|c| matrix[colour][c] * f64::from(rows[c][x])).sum::<f64>() as f32;
                out.iter_mut().enumerate().for_each(|(x, value)| *value = of(x));
                Ok(())
            }
        };
        let is_changed = |place: ChannelPlace| self.is_changed(place, lights);
        let (mut row, mut sum) = (vec![0.0f32; self.frame.width as usize], Vec::new());
        rewrite_lines(&self.path, to, overwrite, &is_changed, &mut |place, at, values| {
            let Some(inside) = self.parts[place.0].data.clip(&self.frame, at, values.len()) else { return Ok(()) };
            if inside.x == 0 {
                wrote();
            }
            let (own, new) = (inside.skipped..inside.skipped + inside.length, inside.x..inside.x + inside.length);
            let Some(&colour) = self.beauty.get(&place) else {
                let (image, colour) = self.targets[&place];
                // A grey is any of its colours.
                get(image, colour.unwrap_or(1), inside.y, &mut row)?;
                values[own].copy_from_slice(&row[new]);
                return Ok(());
            };
            sum.clear();
            sum.resize(row.len(), 0.0f64);
            for (image, stored) in stored.iter().enumerate() {
                let Some(stored) = stored[colour.unwrap_or(1)] else { continue };
                get(image, stored.colour.unwrap_or(1), inside.y, &mut row)?;
                let data = &self.parts[stored.part].data;
                let seen = |x: usize| data.covers(&self.frame, (x, inside.y));
                let pixels = sum.iter_mut().zip(&row).enumerate().filter(|(x, _)| seen(*x));
                pixels.for_each(|(_, (sum, &value))| *sum += f64::from(stored.rounded(value)));
            }
            get(lights, colour.unwrap_or(1), inside.y, &mut row)?;
            sum.iter_mut().zip(&row).for_each(|(sum, &value)| *sum += f64::from(value));
            values[own].iter_mut().zip(&sum[new]).for_each(|(value, sum)| *value = *sum as f32);
            Ok(())
        })
    }

    /// What brings Rec. 709 to the colours of the parts that hold the lights and their sum; none where they are it.
    fn colours_back(&self) -> Result<Option<ColourMatrix>> {
        let parts = self.targets.keys().chain(self.beauty.keys()).map(|place| place.0);
        let mut matrices = parts.map(|part| self.parts[part].matrix);
        let first = matrices.next().flatten();
        let refuse = |problem: &str| {
            let hint = "write all light groups in one colour space";
            Err(Error::input(self.path.display().to_string(), problem, hint))
        };
        if matrices.any(|matrix| matrix != first) {
            return refuse("its lights are of several colour spaces");
        }
        match first.map(|matrix| inverse(&matrix)) {
            None => Ok(None),
            Some(Some(matrix)) => Ok(Some(matrix)),
            Some(None) => refuse("its colours cannot be turned back"),
        }
    }
}
