//! From radiance to the colours on the screen, and the histogram.

use std::sync::LazyLock;

use rayon::prelude::*;

use ltm::image::{LinearImage, ToneCurve, ToneMapping, ToneTables, false_colour};
use ltm::relight::ShownAs;

/// White point that is shown where none was chosen, in kelvin: near that of Rec. 709.
pub const NEUTRAL_KELVIN: f32 = 6500.0;

/// Stops below and above 1 that histogram and false colour cover.
pub const STOPS_SHOWN: (f32, f32) = (-10.0, 6.0);

/// Bins of the histogram.
pub const BINS: usize = 128;

/// Settings by which radiance is displayed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Display {
    /// Exposure, white balance and curve.
    pub tone: ToneMapping,
    /// Whether luminance is shown as false colour instead, over [`STOPS_SHOWN`] after exposure.
    pub false_colour: bool,
}

/// A picture as it is shown.
#[derive(Clone, Debug, PartialEq)]
pub struct Shown {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Opaque sRGB, row by row, 4 bytes a pixel.
    pub rgba: Vec<u8>,
    /// For red, green, blue: the share of pixels in each of [`BINS`] steps of [`STOPS_SHOWN`], after exposure.
    pub histogram: Vec<[f32; 3]>,
}

/// The curves with their names, in the order in which they are offered.
pub const CURVES: [(ToneCurve, &str); 4] = [
    (ToneCurve::None, "sRGB"),
    (ToneCurve::Agx, "AgX"),
    (ToneCurve::Filmic, "Filmic"),
    (ToneCurve::Neutral, "Neutral"),
];

impl Display {
    /// The next way to show radiance, or the one before: the curves of [`CURVES`], then false colour.
    pub fn next(self, back: bool) -> Self {
        let ways = CURVES.len() + 1;
        let curve = CURVES.iter().position(|(curve, _)| *curve == self.tone.curve).unwrap_or(0);
        let now = if self.false_colour { CURVES.len() } else { curve };
        let next = (now + if back { ways - 1 } else { 1 }) % ways;
        match CURVES.get(next) {
            Some(&(curve, _)) => Self { tone: ToneMapping { curve, ..self.tone }, false_colour: false },
            None => Self { false_colour: true, ..self },
        }
    }

    /// Luminances, before exposure, at the ends of the false colours.
    pub fn luminance_range(self) -> (f32, f32) {
        let at = |stops: f32| (stops - self.tone.exposure_stops).exp2();
        (at(STOPS_SHOWN.0), at(STOPS_SHOWN.1))
    }

    /// What a device is to do so that it shows what [`show`](Self::show) does.
    pub fn shown_as(self) -> ShownAs {
        let (low, high) = self.luminance_range();
        match self.false_colour {
            false => ShownAs::Toned(self.tone),
            true if low > 0.0 && high > low && high.is_finite() => ShownAs::FalseColour { low, high },
            // Exposures beyond what a float can hold leave no range to colour.
            true => ShownAs::Toned(ToneMapping::default()),
        }
    }

    /// The histogram alone: that of [`Shown`].
    pub fn histogram(self, image: &LinearImage) -> Vec<[f32; 3]> {
        let (gains, bins) = (self.tone.gains(), &*BIN_TABLE);
        let rows = image.pixels.par_chunks((image.width as usize).max(1));
        let counts = rows.fold(no_counts, |mut counts, row| {
            row.iter().for_each(|pixel| bins.count(&mut counts, [0, 1, 2].map(|ch: usize| pixel[ch] * gains[ch])));
            counts
        });
        shares(counts.reduce(no_counts, add_counts), image.pixels.len())
    }

    /// The picture as it is shown, on all threads.
    pub fn show(&self, image: &LinearImage) -> Shown {
        let (gains, curve) = (self.tone.gains(), self.tone.curve);
        let (width, height) = (image.width as usize, image.height as usize);
        let mut rgba = vec![255; width * height * 4];
        let (tables, bins) = (ToneTables::shared(), &*BIN_TABLE);
        let (low, high) = self.luminance_range();
        // Exposures beyond what a float can hold leave no range to colour.
        let coloured = if self.false_colour { false_colour(image, low, high).ok() } else { None };
        let pixels = coloured.as_ref().map_or(&image.pixels, |coloured| &coloured.pixels);
        let counts = rgba
            .par_chunks_mut((width * 4).max(1))
            .zip(image.pixels.par_chunks(width.max(1)))
            .zip(pixels.par_chunks(width.max(1)))
            .fold(no_counts, |mut counts, ((row, pixels), coloured)| {
                for ((bytes, pixel), colour) in row.chunks_exact_mut(4).zip(pixels).zip(coloured) {
                    let exposed = [0, 1, 2].map(|ch: usize| pixel[ch] * gains[ch]);
                    bins.count(&mut counts, exposed);
                    let shown = match self.false_colour {
                        true => colour.map(|value| tables.srgb(value)),
                        false => tables.encode(curve, exposed),
                    };
                    bytes[..3].copy_from_slice(&shown);
                }
                counts
            })
            .reduce(no_counts, add_counts);
        Shown { size: [width, height], rgba, histogram: shares(counts, width * height) }
    }
}

fn no_counts() -> Vec<[u32; 3]> {
    vec![[0; 3]; BINS]
}

fn add_counts(mut sum: Vec<[u32; 3]>, counts: Vec<[u32; 3]>) -> Vec<[u32; 3]> {
    for (sum, count) in sum.as_flattened_mut().iter_mut().zip(counts.as_flattened()) {
        *sum += count;
    }
    sum
}

fn shares(counts: Vec<[u32; 3]>, pixels: usize) -> Vec<[f32; 3]> {
    counts.into_iter().map(|bin| bin.map(|count| count as f32 / pixels.max(1) as f32)).collect()
}

/// The bins of the histogram: the stop from a value's exponent, and the position within it from a table over the first
/// bits of its mantissa. A picture has millions of values, and a logarithm would cost more than everything else that is
/// done with them.
struct Bins(Vec<u8>);

impl Bins {
    const BITS: u32 = 12;
    const PER_STOP: i32 = (BINS as f32 / (STOPS_SHOWN.1 - STOPS_SHOWN.0)) as i32;

    fn new() -> Self {
        let part = |i: usize| (1.0 + i as f32 / (1 << Self::BITS) as f32).log2() * Self::PER_STOP as f32;
        Self((0..1 << Self::BITS).map(|i| part(i) as u8).collect())
    }

    /// Counts an exposed pixel.
    fn count(&self, counts: &mut [[u32; 3]], exposed: [f32; 3]) {
        for (channel, value) in exposed.into_iter().enumerate() {
            counts[self.of(value)][channel] += 1;
        }
    }

    /// Bin of a value; all that is not above the least falls into the first, not a number too.
    fn of(&self, value: f32) -> usize {
        let bits = value.max(f32::MIN_POSITIVE).to_bits();
        let stop = (bits >> 23) as i32 - 127 - STOPS_SHOWN.0 as i32;
        let within = self.0[(bits >> (23 - Self::BITS)) as usize & ((1 << Self::BITS) - 1)];
        (stop * Self::PER_STOP + i32::from(within)).clamp(0, BINS as i32 - 1) as usize
    }
}

static BIN_TABLE: LazyLock<Bins> = LazyLock::new(Bins::new);

#[cfg(test)]
mod tests {
    use super::*;
    use ltm::image::encode_srgb;

    fn exposed(exposure_stops: f32) -> Display {
        Display { tone: ToneMapping { exposure_stops, ..Default::default() }, ..Default::default() }
    }

    #[test]
    fn a_stop_doubles_and_bytes_are_those_of_srgb() {
        let pixels = (0..4096).map(|i| [i as f32 / 4095.0, 0.0, f32::NAN]).collect();
        let image = LinearImage { width: 64, height: 64, pixels };
        let shown = exposed(1.0).show(&image);
        for (bytes, pixel) in shown.rgba.chunks_exact(4).zip(&image.pixels) {
            let exact = encode_srgb(pixel[0] * 2.0) * 255.0;
            // Rounding to a byte and to a step of the table, where sRGB is steepest: 12.92 · 255 / 2¹⁴ / 2.
            assert!((f32::from(bytes[0]) - exact).abs() <= 0.5 + 0.11, "{exact}");
            assert_eq!(bytes[1..], [0, 0, 255]);
        }
    }

    #[test]
    fn every_curve_is_shown_as_a_written_image_would_be() {
        let pixels = (0..512).map(|i| [i as f32 / 100.0, 0.3, 0.01]).collect();
        let image = LinearImage { width: 32, height: 16, pixels };
        for (curve, name) in CURVES {
            let tone = ToneMapping { curve, exposure_stops: -0.7, white_kelvin: Some(4000.0) };
            let shown = Display { tone, false_colour: false }.show(&image);
            for (bytes, &pixel) in shown.rgba.chunks_exact(4).zip(&image.pixels) {
                for (byte, value) in bytes.iter().zip(tone.display(pixel)) {
                    // As above.
                    assert!((f32::from(*byte) - value * 255.0).abs() <= 0.5 + 0.11, "{name}: {value}");
                }
            }
        }
    }

    #[test]
    fn the_histogram_counts_every_pixel() {
        let image = LinearImage { width: 3, height: 1, pixels: vec![[0.0; 3], [1.0, 1e9, -4.0], [0.5; 3]] };
        let histogram = Display::default().show(&image).histogram;
        for channel in 0..3 {
            assert!((histogram.iter().map(|bin| bin[channel]).sum::<f32>() - 1.0).abs() < 1e-6);
        }
        assert_eq!(Display::default().histogram(&image), histogram);
        let bins = Bins::new();
        assert!(histogram[bins.of(1.0)][0] > 0.3 && histogram[BINS - 1][1] > 0.3);
        let (low, high) = STOPS_SHOWN;
        for value in (1..40_000).map(|i| (i as f32 * 0.0005).exp2() * low.exp2()) {
            let exact = (value.log2() - low) / (high - low) * BINS as f32;
            // The table's steps are 2⁻¹² of a stop's range, on which the curve rises by at most 8 · 1.45 bins.
            let (below, above) = ((exact - 0.01) as usize, ((exact + 0.01) as usize).min(BINS - 1));
            assert!((below.min(BINS - 1)..=above).contains(&bins.of(value)), "{value}");
        }
    }

    #[test]
    fn all_ways_to_show_come_in_turn_and_back() {
        let first = exposed(2.0);
        let mut display = first;
        let mut seen = 0;
        loop {
            assert_eq!(display.next(false).next(true).false_colour, display.false_colour);
            display = display.next(false);
            seen += 1;
            if display == first {
                break;
            }
        }
        assert_eq!(seen, CURVES.len() + 1);
    }

    #[test]
    fn false_colours_end_where_the_histogram_does() {
        let (low, high) = exposed(3.0).luminance_range();
        let image = LinearImage { width: 2, height: 1, pixels: vec![[low; 3], [high; 3]] };
        let shown = Display { false_colour: true, ..exposed(3.0) }.show(&image);
        assert_eq!(shown.rgba, [0, 0, 0, 255, 255, 255, 255, 255]);
        for absurd in [1e9, -1e9, f32::NAN] {
            Display { false_colour: true, ..exposed(absurd) }.show(&image);
        }
    }

    #[test]
    fn automatic_exposure_shows_most_of_the_picture_in_colour_too() {
        let grey = LinearImage { width: 100, height: 1, pixels: (0..100).map(|i| [i as f32; 3]).collect() };
        let gain = ltm::image::exposure_for(&grey).exp2();
        assert!((84.0 * gain - 0.7).abs() < 1e-3, "{gain}");
        // Blue of the same height is exposed alike, though its luminance is a fourteenth.
        let blue = LinearImage { pixels: grey.pixels.iter().map(|pixel| [0.0, 0.0, pixel[0]]).collect(), ..grey };
        assert_eq!(ltm::image::exposure_for(&blue).exp2(), gain);
        // A tenth of the picture far above the rest: a stop darker, no more.
        let lamps = (0..100).map(|i| [if i < 90 { 1.0 } else { 1000.0 }; 3]).collect();
        let lamps = LinearImage { width: 100, height: 1, pixels: lamps };
        assert!((ltm::image::exposure_for(&lamps).exp2() - 0.35).abs() < 1e-3);
        assert_eq!(ltm::image::exposure_for(&LinearImage::black(2, 2)), 0.0);
    }
}
