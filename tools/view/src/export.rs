//! Writing what is seen: PNG as shown, EXR as radiance, an EXR with a layer for each light, and the command that makes
//! the picture again.

use std::path::{Path, PathBuf};

use super::display::{CURVES, Display};
use super::mixer::Mix;
use ltm::container::ContainerReader;
use ltm::error::{Error, Result};
use ltm::image::{LinearImage, write_exr, write_exr_layers, write_rgb_png, write_toned_png};
use ltm::relight::{CpuRelighter, relight_streaming};
use ltm_cli::shell::word;

/// Largest file of layers that is made in memory, in bytes.
const MAX_LAYER_BYTES: u64 = 4 << 30;

/// Writes the picture as it is shown, in false colour too.
///
/// Errors: the system refuses.
pub fn write_png(path: &Path, image: &LinearImage, display: &Display) -> Result<()> {
    if display.false_colour {
        let shown = display.show(image);
        return write_rgba(path, shown.size, &shown.rgba);
    }
    write_toned_png(path, image, display.tone)
}

/// Writes the radiance, 32 bits for each channel. Errors: the system refuses.
pub fn write_radiance(path: &Path, image: &LinearImage) -> Result<()> {
    write_exr(path, image)
}

/// Writes opaque 8-bit pixels, 4 bytes each, as a PNG. Errors: the system refuses, or the size does not fit.
pub fn write_rgba(path: &Path, [width, height]: [usize; 2], rgba: &[u8]) -> Result<()> {
    let rgb = rgba.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
    write_rgb_png(path, width as u32, height as u32, rgb)
}

/// Writes a layer for each light that shines, at its present setting: together they are the picture. Without a loaded
/// relighter the container is read once for each light.
///
/// Errors: no light shines, too many for memory, a container that cannot be read, or the system refuses.
pub fn write_layers(
    path: &Path,
    container: &ContainerReader,
    relighter: Option<&CpuRelighter>,
    mix: &Mix,
) -> Result<()> {
    let job = container.job();
    let basis = &job.basis;
    let shining: Vec<usize> = (0..basis.lights().len()).filter(|&light| mix.shines(light)).collect();
    let pixels = u64::from(job.shape.width()) * u64::from(job.shape.height());
    let needed = shining.len() as u64 * pixels * 12;
    if shining.is_empty() {
        return Err(Error::input(path.display().to_string(), "no light shines", "switch one on"));
    }
    if needed > MAX_LAYER_BYTES {
        return Err(Error::Resources {
            what: format!("{} layers", shining.len()),
            needed: format!("{} MiB", needed >> 20),
            available: format!("{} MiB are set aside for it", MAX_LAYER_BYTES >> 20),
            hint: "switch lights off, or use ltm-unpack".into(),
        });
    }
    let mut images = Vec::new();
    for &light in &shining {
        let lighting = alone(mix, light).lighting(basis)?;
        images.push(match relighter {
            Some(relighter) => relighter.relight(&lighting)?,
            None => relight_streaming(container, &lighting)?.0,
        });
    }
    let named: Vec<_> = shining.iter().map(|&light| basis.lights()[light].name.as_str()).zip(&images).collect();
    write_exr_layers(path, &named)
}

/// The mix with one of its lights alone.
fn alone(mix: &Mix, light: usize) -> Mix {
    let mut alone = mix.clone();
    alone.clear_solo();
    alone.lights[light].solo = true;
    alone
}

/// The command that makes the picture from the container and a saved lighting file. False colour is part of it where
/// pixels have units, given by the lumens of a watt.
pub fn command_line(
    container: &Path,
    look: &Path,
    png: &Path,
    display: &Display,
    lumens_per_watt: Option<f32>,
) -> String {
    let tone = display.tone;
    let mut words = vec!["ltm".to_owned(), "relight".into(), word(container), "--lighting".into()];
    words.extend([word(look), "-o".into(), word(png)]);
    if let (true, Some(gain)) = (display.false_colour, lumens_per_watt) {
        let (low, high) = display.luminance_range();
        words.extend(["--false-colour=luminance".into(), format!("--scale={:?}..{:?}", low * gain, high * gain)]);
        return words.join(" ");
    }
    words.push(format!("--exposure={:?}", tone.exposure_stops));
    let name = CURVES.iter().find(|(curve, _)| *curve == tone.curve).map_or("none", |(_, name)| *name);
    words.push(format!("--tone={}", if name == "sRGB" { "none".into() } else { name.to_lowercase() }));
    words.extend(tone.white_kelvin.map(|kelvin| format!("--white-balance={kelvin:?}")));
    words.join(" ")
}

/// What stands in a file that can be exported, under the name with its ending.
pub fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let has = path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    if has { path.to_owned() } else { PathBuf::from(format!("{}.{ending}", path.display())) }
}

/// As [`with_ending`], with the first of several endings where it has none of them.
pub fn with_one_of(path: &Path, endings: &[&str]) -> PathBuf {
    let has = path.extension().is_some_and(|e| endings.iter().any(|ending| e.eq_ignore_ascii_case(ending)));
    if has { path.to_owned() } else { with_ending(path, endings.first().unwrap_or(&"")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ltm::image::{ToneCurve, ToneMapping};

    #[test]
    fn the_command_is_one_that_a_shell_reads_as_meant() {
        let tone = ToneMapping { curve: ToneCurve::Agx, exposure_stops: 1.5, white_kelvin: Some(3200.0) };
        let display = Display { tone, false_colour: false };
        let line = |display| {
            command_line(Path::new("/a b/it's.ltc"), Path::new("l.toml"), Path::new("x.png"), display, Some(2.0))
        };
        let command = r"ltm relight '/a b/it'\''s.ltc' --lighting l.toml -o x.png";
        assert_eq!(line(&display), format!("{command} --exposure=1.5 --tone=agx --white-balance=3200.0"));
        let coloured = Display { tone: ToneMapping { exposure_stops: 0.0, ..tone }, false_colour: true };
        assert_eq!(line(&coloured), format!("{command} --false-colour=luminance --scale=0.001953125..128.0"));
    }

    #[test]
    fn endings_are_added_once() {
        assert_eq!(with_ending(Path::new("a.PNG"), "png"), Path::new("a.PNG"));
        assert_eq!(with_ending(Path::new("v1.2"), "png"), Path::new("v1.2.png"));
        assert_eq!(with_one_of(Path::new("a.PDF"), &["csv", "pdf"]), Path::new("a.PDF"));
        assert_eq!(with_one_of(Path::new("a.png"), &["csv", "pdf"]), Path::new("a.png.csv"));
    }
}
