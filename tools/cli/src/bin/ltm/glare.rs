//! `ltm glare`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use ltm::daylight::{GLARE_CLASSES, GLARE_LIMITS, GlareOptions, GlareSource, SeenGlare, points_of_picture};
use ltm::files::{csv_quoted, write_file};
use ltm::image::read_image;
use ltm::resources::Progress;
use ltm::{Error, Result};
use ltm_cli::console::Console;
use ltm_cli::say;

/// Vertical illuminance in lux and DGP below which the daylight glare probability was not found.
const LEAST: (f64, f64) = (380.0, 0.2);

#[derive(Args)]
pub(crate) struct Glare {
    /// Pictures of radiance (EXR, HDR, PFM): square fisheyes of 180°, or panoramas twice as wide as high.
    #[arg(required = true)]
    pictures: Vec<PathBuf>,
    /// In panoramas, how far the eye is turned from the middle of the picture, RIGHT or RIGHT,UP in degrees.
    #[arg(long, value_parser = parse_turn, default_value = "0", allow_hyphen_values = true)]
    turn: Turn,
    /// Luminance above which a pixel is part of a source of glare, in cd/m².
    #[arg(long, default_value = "2000")]
    threshold: f64,
    /// Write a table, a line for each picture (CSV); replaced if it is there.
    #[arg(short, long)]
    output: Option<PathBuf>,
}

/// Degrees to the right and up.
#[derive(Clone, Copy, Debug)]
struct Turn([f64; 2]);

fn parse_turn(text: &str) -> Result<Turn, String> {
    let (right, up) = text.split_once(',').unwrap_or((text, "0"));
    let number = |word: &str| word.trim().parse::<f64>().ok().filter(|degrees| degrees.is_finite());
    match (number(right), number(up)) {
        (Some(right), Some(up)) => Ok(Turn([right, up])),
        _ => Err("write RIGHT or RIGHT,UP in degrees, such as -40,10".into()),
    }
}

pub(crate) fn run(options: &Glare, console: &Console) -> Result<()> {
    let mut table =
        "picture,dgp,class,eye_lux,sources,brightest_cd_per_m2,brightest_sr,brightest_position_index\n".to_owned();
    let mut worst: Option<(f64, String)> = None;
    for path in &options.pictures {
        let place = path.display().to_string();
        refuse_screens(path, &place)?;
        let points = points_of_picture(&place, &read_image(path)?, options.turn.0)?;
        let asked = GlareOptions { threshold: options.threshold, ..GlareOptions::default() };
        let glare = SeenGlare::of_points(&points, asked)?;
        let SeenGlare { probability, eye_lux, sources } = &glare;
        let class = GLARE_CLASSES[GLARE_LIMITS.iter().filter(|limit| *probability >= f64::from(**limit)).count()];
        say!("{place}: DGP {probability:.3}, {class}; {eye_lux:.0} lx at the eye, {} sources of glare", sources.len());
        sources.iter().for_each(|source| say!("{place}: {}", words_of(source)));
        if *eye_lux < LEAST.0 || *probability < LEAST.1 {
            console.note(&format!("warning: {place}: DGP was found above 380 lx at the eye and from 0.2 on"));
        }
        let _ = write!(table, "{},{probability:.4},{class},{eye_lux:.1},{}", csv_quoted(&place), sources.len());
        let _ = match sources.first() {
            Some(GlareSource { luminance, solid_angle, position_index, .. }) => {
                writeln!(table, ",{luminance:.1},{solid_angle:.6},{position_index:.4}")
            }
            None => writeln!(table, ",,,"),
        };
        if worst.as_ref().is_none_or(|(other, _)| probability > other) {
            worst = Some((*probability, place));
        }
    }
    if let (Some((probability, place)), 2..) = (&worst, options.pictures.len()) {
        say!("{} pictures: DGP at most {probability:.3}, of {place}", options.pictures.len());
    }
    match &options.output {
        Some(path) => write_file(path, true, table.as_bytes()),
        None => Ok(()),
    }
}

/// Errors: a picture for screens by its name, whose values are no radiances.
fn refuse_screens(path: &Path, place: &str) -> Result<()> {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default().to_ascii_lowercase();
    match ["png", "jpg", "jpeg", "tif", "tiff"].contains(&&*extension) {
        true => Err(Error::input(place, "is a picture for screens and no radiance", "give EXR, HDR or PFM")),
        false => Ok(()),
    }
}

/// A source in words.
fn words_of(source: &GlareSource) -> String {
    let GlareSource { direction, luminance, solid_angle, position_index } = source;
    let side = |degrees: f64, [positive, negative]: [&str; 2]| {
        format!("{:.0}° {}", degrees.abs(), if degrees < 0.0 { negative } else { positive })
    };
    let across = side(direction.x.atan2(direction.z).to_degrees(), ["right", "left"]);
    let up = side(direction.y.clamp(-1.0, 1.0).asin().to_degrees(), ["up", "down"]);
    format!("{luminance:.0} cd/m² over {solid_angle:.4} sr, {across} and {up}, position index {position_index:.2}")
}
