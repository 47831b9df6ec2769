//! How an image is shown and written: the options of `ltm relight` that concern pictures.

use std::path::Path;

use clap::{Args, ValueEnum};
use ltm::image::{self, KELVIN_RANGE, LUMENS_PER_WATT, LinearImage, ToneCurve, ToneMapping};
use ltm::light::{Job, LightUnit};
use ltm::{Error, Result};

/// Where automatic exposure puts the 95th percentile of luminance.
const WHITE: f32 = 0.9;

#[derive(Args)]
#[command(next_help_heading = "Picture")]
pub(crate) struct Picture {
    /// Tone curve of a PNG.
    #[arg(long, value_enum)]
    tone: Option<ToneName>,
    /// Exposure of a PNG in stops [default: as bright as its 95th percentile allows; for an animation, that of its
    /// brightest key].
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true)]
    exposure: Option<f32>,
    /// Temperature of the light that shall look white in a PNG.
    #[arg(long, value_name = "KELVIN")]
    white_balance: Option<f32>,
    /// Show luminance in cd/m², or the illuminance in lx of matte surfaces of the given --reflectance, in false colours.
    #[arg(long, value_enum, value_name = "QUANTITY")]
    false_colour: Option<Quantity>,
    /// Lowest and highest value of the false colours, LOW..HIGH [default: three decades below the brightest].
    #[arg(long, value_parser = parse_scale, requires = "false_colour")]
    scale: Option<(f32, f32)>,
    /// Reflectance of the surfaces whose illuminance is shown.
    #[arg(long, requires = "false_colour")]
    reflectance: Option<f32>,
}

#[derive(Clone, Copy, ValueEnum)]
enum ToneName {
    None,
    Agx,
    Filmic,
    Neutral,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Quantity {
    Luminance,
    Illuminance,
}

/// What file a name asks for.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Format {
    Exr,
    Png,
}

/// How images are to be written, after the first exposure was decided.
pub(crate) enum Writer {
    Exr,
    Toned(ToneMapping),
    FalseColour {
        /// What a luminance of 1 in the image is in the shown quantity.
        factor: f32,
        low: f32,
        high: f32,
    },
}

pub(crate) fn format_of(path: &Path) -> Result<Format> {
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("exr") => Ok(Format::Exr),
        Some("png") => Ok(Format::Png),
        _ => {
            let problem = "the name ends neither in .exr nor in .png";
            Err(Error::input(path.display().to_string(), problem, "name the image x.exr or x.png"))
        }
    }
}

impl Picture {
    /// Whether automatic exposure needs an image to look at.
    pub(crate) fn looks_at_images(&self) -> bool {
        if self.false_colour.is_some() { self.scale.is_none() } else { self.exposure.is_none() }
    }

    /// Refuses what does not go together, before anything is computed.
    pub(crate) fn check(&self, format: Format, output: &Path, job: &Job) -> Result<()> {
        let shown = self.tone.is_some() || self.exposure.is_some() || self.white_balance.is_some();
        if format == Format::Exr && (shown || self.false_colour.is_some()) {
            let problem = "an EXR holds linear radiance as it is";
            return Err(Error::input(output.display().to_string(), problem, "write a .png to show it"));
        }
        if let Some(kelvin) = self.white_balance.filter(|kelvin| !KELVIN_RANGE.contains(kelvin)) {
            let hint = format!("give {} to {}", KELVIN_RANGE.start(), KELVIN_RANGE.end());
            return Err(Error::input("--white-balance", format!("{kelvin} K is out of range"), hint));
        }
        if let Some(stops) = self.exposure.filter(|stops| !(-60.0..=60.0).contains(stops)) {
            return Err(Error::input("--exposure", format!("{stops} stops are out of range"), "give −60 to 60"));
        }
        let Some(quantity) = self.false_colour else { return Ok(()) };
        if shown {
            let problem = "false colours stand for values, not for what is seen";
            return Err(Error::input("--false-colour", problem, "leave out --tone, --exposure and --white-balance"));
        }
        if let Some(light) = job.basis.lights().iter().find(|light| light.unit == LightUnit::Multiple) {
            let problem = "is known only as an image, without unit";
            return Err(Error::input(format!("light '{}'", light.name), problem, "show it with --tone"));
        }
        let hint = "give the surfaces' --reflectance, above 0 and up to 1";
        match (quantity, self.reflectance) {
            (Quantity::Luminance, Some(_)) => {
                let problem = "luminance is that of the picture, whatever reflects it";
                Err(Error::input("--reflectance", problem, "leave it out, or show the illuminance"))
            }
            (Quantity::Illuminance, None) => {
                let problem = "a picture shows what surfaces reflect, not what they receive";
                Err(Error::input("illuminance", problem, hint))
            }
            (Quantity::Illuminance, Some(reflectance)) if !(reflectance > 0.0 && reflectance <= 1.0) => {
                Err(Error::input("--reflectance", format!("{reflectance} is no reflectance"), hint))
            }
            _ => Ok(()),
        }
    }

    /// Decides how to write, exposing for `brightest` where nothing else is asked for; says what it chose.
    pub(crate) fn writer(&self, format: Format, brightest: &LinearImage, say: &mut dyn FnMut(String)) -> Writer {
        match (format, self.false_colour) {
            (Format::Exr, _) => Writer::Exr,
            (Format::Png, None) => self.toned(brightest, say),
            (Format::Png, Some(quantity)) => self.in_false_colours(quantity, brightest, say),
        }
    }

    fn toned(&self, brightest: &LinearImage, say: &mut dyn FnMut(String)) -> Writer {
        let curve = match self.tone {
            None | Some(ToneName::None) => ToneCurve::None,
            Some(ToneName::Agx) => ToneCurve::Agx,
            Some(ToneName::Filmic) => ToneCurve::Filmic,
            Some(ToneName::Neutral) => ToneCurve::Neutral,
        };
        let exposure_stops = self.exposure.unwrap_or(0.0);
        let tone = ToneMapping { curve, exposure_stops, white_kelvin: self.white_balance };
        if self.exposure.is_some() {
            return Writer::Toned(tone);
        }
        let tone = tone.auto_exposed(brightest, WHITE);
        say(format!("exposed by {:.2} stops", tone.exposure_stops));
        Writer::Toned(tone)
    }

    fn in_false_colours(&self, quantity: Quantity, brightest: &LinearImage, say: &mut dyn FnMut(String)) -> Writer {
        let (factor, unit) = match quantity {
            Quantity::Luminance => (LUMENS_PER_WATT, "cd/m²"),
            // A matte surface of reflectance ρ under illuminance E has the luminance ρ E / π.
            Quantity::Illuminance => {
                (LUMENS_PER_WATT * std::f32::consts::PI / self.reflectance.unwrap_or(1.0), "lx on matte surfaces")
            }
        };
        let (low, high) = self.scale.unwrap_or_else(|| {
            let peak = brightest.luminances().fold(0.0, f32::max) * factor;
            let high = if peak > 0.0 { 10f32.powf(peak.log10().ceil()) } else { 1.0 };
            (high / 1000.0, high)
        });
        let steps = image::false_colour_scale(low, high).map(|(name, value)| format!("{name} {}", short(value)));
        say(format!("{} {unit}", steps.join(", ")));
        Writer::FalseColour { factor, low, high }
    }
}

/// A value with three digits that count.
fn short(value: f32) -> String {
    let digits = 2 - value.abs().log10().floor() as i32;
    let unit = 10f32.powi(-digits);
    format!("{:.*}", digits.max(0) as usize, (value / unit).round() * unit)
}

impl Writer {
    pub(crate) fn write(&self, path: &Path, picture: &LinearImage) -> Result<()> {
        match self {
            Self::Exr => image::write_exr(path, picture),
            Self::Toned(tone) => image::write_toned_png(path, picture, *tone),
            Self::FalseColour { factor, low, high } => {
                let shown = image::false_colour(picture, low / factor, high / factor)?;
                image::write_toned_png(path, &shown, ToneMapping::default())
            }
        }
    }
}

fn parse_scale(text: &str) -> Result<(f32, f32), String> {
    let value = |s: &str| s.parse::<f32>().map_err(|e| format!("'{s}' is no number ({e})"));
    let (low, high) = text.split_once("..").ok_or("write LOW..HIGH, for example 1..1000")?;
    let (low, high) = (value(low)?, value(high)?);
    if low > 0.0 && high > low && high.is_finite() { Ok((low, high)) } else { Err("give 0 < LOW < HIGH".into()) }
}
