//! Pictures on the way from one look to the next: numbered, or as a video where `ffmpeg` is installed.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::{self, JoinHandle};

use super::display::{Display, Shown};
use super::export::write_png;
use super::system;
use ltm::error::{Error, Result};
use ltm::files::Replacement;
use ltm::image::LinearImage;
use ltm::light::Lighting;
use ltm::look::Frames;

/// The encoder that is looked for on the path.
const ENCODER: &str = "ffmpeg";
/// Kinds of video by their endings, with what the encoder is told for each: H.264 for players everywhere, VP9 for pages. Qualities at which
/// grain and slow fades survive.
const KINDS: [(&str, &[&str]); 2] = [
    ("mp4", &["-c:v", "libx264", "-crf", "16", "-movflags", "+faststart", "-f", "mp4"]),
    ("webm", &["-c:v", "libvpx-vp9", "-crf", "20", "-b:v", "0", "-row-mt", "1", "-f", "webm"]),
];
/// Endings of what an animation is saved as, without and with an encoder.
const NUMBERED: [&str; 1] = ["png"];
const ALL: [&str; 3] = ["png", "mp4", "webm"];

/// An animation from look to look, each with its time in seconds, at this many frames a second: as `ltm relight --fps` makes it.
///
/// # Errors
/// Fewer than two looks, times that do not rise, and those of [`Frames::new`].
pub fn frames(looks: &[(f32, Lighting)], per_sec: f32) -> Result<Frames<'_>> {
    let rises = looks.windows(2).all(|pair| pair[0].0 < pair[1].0) && looks.iter().all(|(time, _)| time.is_finite());
    if looks.len() < 2 || !rises {
        return Err(Error::input("the animation", "needs two looks or more, each later than the one before", ""));
    }
    Frames::new("the animation", looks.iter().map(|(time, lighting)| (*time, lighting)).collect(), per_sec)
}

/// What an animation can be saved as on this machine: endings, that of numbered pictures first.
pub fn endings() -> &'static [&'static str] {
    if encoder().is_some() { &ALL } else { &NUMBERED }
}

/// Writes the frames as numbered PNGs, `night.png` as `night-0000.png` and so on, or as one video, by the ending; each as it is
/// shown. What was written, in words.
///
/// # Errors
/// A numbered file is there already; no encoder, or one that fails, with its last words; those of `relight`; the system refuses.
pub fn write(
    path: &Path,
    frames: &Frames<'_>,
    per_sec: f32,
    display: &Display,
    relight: impl Fn(&Lighting) -> Result<LinearImage>,
) -> Result<String> {
    let pictures = (0..frames.count()).map(|frame| relight(&frames.lighting(frame)?));
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
    if let Some((_, options)) = KINDS.iter().find(|(own, _)| *own == ending) {
        let Some(program) = encoder() else {
            let problem = format!("a video needs the program {ENCODER}, which is not on the path");
            return Err(Error::input(path.display().to_string(), problem, "install it, or save numbered PNGs"));
        };
        write_video(&program, path, options, pictures.map(|image| Ok(display.show(&image?))), per_sec)?;
        return Ok(format!("Wrote {}, {} frames", path.display(), frames.count()));
    }
    let paths = numbered(path, frames.count());
    if let Some(there) = paths.iter().find(|path| path.exists()) {
        let problem = "is there already, and frames replace nothing";
        return Err(Error::input(there.display().to_string(), problem, "give another name"));
    }
    for (image, path) in pictures.zip(&paths) {
        write_png(path, &image?, display)?;
    }
    let first = paths.first().map_or_else(String::new, |path| path.display().to_string());
    Ok(format!("Wrote {} frames from {first} on", frames.count()))
}

/// The files of numbered frames.
fn numbered(path: &Path, count: usize) -> Vec<PathBuf> {
    let stem = path.with_extension("").display().to_string();
    (0..count).map(|frame| PathBuf::from(format!("{stem}-{frame:04}.png"))).collect()
}

/// The encoder on the path, if there is one that may be run.
fn encoder() -> Option<PathBuf> {
    std::env::split_paths(&std::env::var_os("PATH")?)
        .map(|folder| folder.join(ENCODER))
        .find(|path| system::is_program(path))
}

/// Hands pictures of one size to the encoder one by one; the video takes its name when it is whole.
fn write_video(
    program: &Path,
    path: &Path,
    options: &[&str],
    pictures: impl Iterator<Item = Result<Shown>>,
    per_sec: f32,
) -> Result<()> {
    let replacement = Replacement::begin(path, true)?;
    let mut encoding: Option<Encoding> = None;
    for shown in pictures {
        let shown = shown?;
        let encoding = match &mut encoding {
            Some(begun) => begun,
            None => encoding.insert(Encoding::begin(program, path, &replacement, options, shown.size, per_sec)?),
        };
        let rgb: Vec<u8> = shown.rgba.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
        if encoding.child.stdin.as_mut().is_none_or(|input| input.write_all(&rgb).is_err()) {
            // It has ended before its time, and says why below.
            break;
        }
    }
    encoding.map_or(Ok(()), |encoding| encoding.finish(path))?;
    replacement.finish()
}

/// An encoder that runs. Dropped, it is ended.
struct Encoding {
    child: Child,
    words: Option<JoinHandle<String>>,
}

impl Encoding {
    fn begin(
        program: &Path,
        path: &Path,
        target: &Replacement,
        options: &[&str],
        [width, height]: [usize; 2],
        per_sec: f32,
    ) -> Result<Self> {
        let file = target.file().try_clone().map_err(Error::io(path, "write"))?;
        let mut command = Command::new(program);
        command.args(["-nostdin", "-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"]);
        command.args(["-s", &format!("{width}x{height}"), "-r", &per_sec.to_string(), "-i", "-"]);
        // Chroma of half the size wants even sides: an odd last row or column goes. Colours are BT.709's, and said to be.
        let filters = [
            "crop=trunc(iw/2)*2:trunc(ih/2)*2",
            "scale=out_color_matrix=bt709:out_range=tv:flags=accurate_rnd+full_chroma_int",
            "format=yuv420p",
        ];
        command.args(["-vf", &filters.join(",")]);
        command.args(["-colorspace", "bt709", "-color_primaries", "bt709"]);
        command.args(["-color_trc", "iec61966-2-1", "-color_range", "tv"]).args(options);
        // The file by its descriptor, in which an encoder can seek, under a name that is not yet the video's.
        command.arg("/dev/stdout").stdout(file).stdin(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(Error::io(program, "start"))?;
        let words = child.stderr.take().map(|mut stderr| {
            thread::spawn(move || {
                let mut bytes = Vec::new();
                // What could not be read is not said.
                let _ = stderr.read_to_end(&mut bytes);
                String::from_utf8_lossy(&bytes).into_owned()
            })
        });
        Ok(Self { child, words })
    }

    /// Waits for its end. Errors: it failed.
    fn finish(mut self, path: &Path) -> Result<()> {
        drop(self.child.stdin.take());
        let status = self.child.wait().map_err(Error::io(path, "wait for the encoder of"))?;
        let words = self.words.take().and_then(|words| words.join().ok()).unwrap_or_default();
        if status.success() {
            return Ok(());
        }
        let last = words.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("no message").trim();
        let problem = format!("{ENCODER} could not make it ({last})");
        Err(Error::input(path.display().to_string(), problem, "save numbered PNGs"))
    }
}

impl Drop for Encoding {
    fn drop(&mut self) {
        // Both fail where it has ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn even(value: f32) -> Lighting {
        Lighting::uniform(1, [value; 3]).unwrap()
    }

    #[test]
    fn frames_go_evenly_from_look_to_look() {
        let looks = [(1.0, even(0.0)), (2.0, even(4.0)), (4.0, even(0.0))];
        let made = frames(&looks, 2.0).unwrap();
        let values: Vec<f32> = (0..made.count()).map(|frame| made.lighting(frame).unwrap().weights()[0][0]).collect();
        assert_eq!(values, [0.0, 2.0, 4.0, 3.0, 2.0, 1.0, 0.0]);
        assert!(frames(&[(0.0, even(1.0))], 2.0).is_err());
        assert!(frames(&[(0.0, even(1.0)), (0.0, even(1.0))], 2.0).is_err());
        assert!(frames(&[(0.0, even(1.0)), (1e9, even(1.0))], 2.0).is_err());
        assert!(frames(&[(0.0, even(1.0)), (1.0, even(1.0))], 0.0).is_err());
    }

    #[test]
    fn numbered_frames_replace_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let looks = [(0.0, even(0.0)), (1.0, even(1.0))];
        let made = frames(&looks, 2.0).unwrap();
        let relight = |_: &Lighting| Ok(LinearImage::black(4, 2));
        let path = folder.path().join("night.png");
        let said = write(&path, &made, 2.0, &Display::default(), relight).unwrap();
        assert!(said.starts_with("Wrote 3 frames from") && said.contains("night-0000.png"), "{said}");
        assert!(folder.path().join("night-0002.png").is_file());
        let again = write(&path, &made, 2.0, &Display::default(), relight).unwrap_err().to_string();
        assert!(again.contains("night-0000.png: is there already"), "{again}");
    }

    #[test]
    fn a_video_that_cannot_be_made_says_why_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let (program, path) = (folder.path().join("encoder"), folder.path().join("night.mp4"));
        std::fs::write(&program, "#!/bin/sh\necho 'Unknown encoder' >&2\necho >&2\nexit 1\n").unwrap();
        std::fs::set_permissions(&program, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
        let shown = || Shown { size: [100; 2], rgba: vec![9; 40_000], histogram: Vec::new() };
        // More than a pipe holds, so that the encoder's end is met while it is written to.
        let error = write_video(&program, &path, &[], (0..50).map(|_| Ok(shown())), 24.0).unwrap_err();
        assert_eq!(
            error.to_string(),
            format!("{}: ffmpeg could not make it (Unknown encoder); save numbered PNGs", path.display())
        );
        std::fs::write(&program, "#!/bin/sh\nexec cat\n").unwrap();
        let stops = [Ok(shown()), Err(Error::input("the matrix", "is damaged", ""))];
        let error = write_video(&program, &path, &[], stops.into_iter(), 24.0).unwrap_err();
        assert!(error.to_string().contains("is damaged"), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing but the encoder is left");
        write_video(&program, &path, &[], [Ok(shown()), Ok(shown())].into_iter(), 24.0).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), vec![9; 60_000], "red, green and blue of both pictures");
    }
}
