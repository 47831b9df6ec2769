//! `ltm relight`.

use std::cell::Cell;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use ltm::files::check_output;
use ltm::image::LinearImage;
use ltm::light::names::{meant, suggest};
use ltm::light::{Job, Lighting};
use ltm::look::Look;
use ltm::pipeline::{
    Device, PASSES, RelightOptions, Relighter, open_container, relight_matrix, relight_passes, relit_layers_need_bytes,
    write_relit_layers,
};
use ltm::resources::{NoProgress, Progress, parse_bytes};
use ltm::store::StoreReader;
use ltm::{Error, Result};

use crate::input::{Kind, kind_of, load_look};
use crate::moment::{DaylightArguments, Moment};
use crate::picture::{Format, Picture, Writer, format_of};
use ltm_cli::console::Console;
use ltm_cli::say;
use ltm_cli::sequence::{self, frame_path};

#[derive(Args)]
pub(crate) struct Relight {
    /// The container or matrix; of a sequence of containers `#` stands for the digits of a frame's number.
    input: PathBuf,
    /// The image to write, .exr or .png; for an animation or a sequence with `#` in place of the frame's number.
    #[arg(short, long)]
    output: PathBuf,
    /// A look file (TOML or JSON) [default: the scene's own lighting].
    #[arg(short, long, value_name = "FILE")]
    lighting: Option<PathBuf>,
    /// A named look of the look file [default: its rules outside of named looks].
    #[arg(long, value_name = "NAME", requires = "lighting")]
    look: Option<String>,
    /// Read images that the look file names outside of its folder and of LTM_SCENES: for looks whose author you trust.
    #[arg(long, requires = "lighting")]
    allow_outside: bool,
    /// Only lights whose name matches this (`*` stands for anything); may be given several times [default: all].
    #[arg(long, value_name = "PATTERN")]
    on: Vec<String>,
    /// Write one layer for each light, or for each group of the look file, into one EXR; or of a matrix emission seen, direct
    /// and indirect light (passes); or what its pixels show beside light (features: albedo, normal, depth, shares of
    /// emitters), for denoisers.
    #[arg(long, value_enum)]
    layers: Option<Layers>,
    /// Frames per second of an animation.
    #[arg(long, default_value = "25", value_name = "RATE")]
    fps: f32,
    /// Only these frames of an animation or a sequence, FIRST..END.
    #[arg(long, value_parser = sequence::parse_range)]
    frames: Option<std::ops::Range<usize>>,
    #[command(flatten)]
    daylight: DaylightArguments,
    #[command(flatten)]
    picture: Picture,
    /// Where to compute.
    #[arg(long, value_enum, default_value = "auto")]
    device: DeviceName,
    /// Memory to stay within, for example 64MiB: factors are read as they are needed [default: all are kept].
    #[arg(long, value_parser = parse_bytes)]
    memory: Option<u64>,
    /// Show a damaged container as far as it can be read. It is an error still; without this, no image is written.
    #[arg(long)]
    allow_damage: bool,
    /// Memory of the GPU to stay within [default: all factors are kept there].
    #[arg(long, value_parser = parse_bytes)]
    gpu_memory: Option<u64>,
}

#[derive(Clone, Copy, ValueEnum)]
enum DeviceName {
    Auto,
    Cpu,
    Gpu,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Layers {
    Lights,
    Groups,
    Passes,
    Features,
}

pub(crate) fn run(options: &Relight, console: &Console) -> Result<()> {
    let format = format_of(&options.output)?;
    check_output(&frame_path(&options.output, 0).unwrap_or_else(|| options.output.clone()), true)?;
    if options.layers == Some(Layers::Features) {
        return write_features(options, format, console);
    }
    if let Some(frames) = sequence::frames(&options.input, options.frames.as_ref())? {
        return relight_sequence(options, &frames, format, console);
    }
    let daylight = options.daylight.moment(console)?;
    match kind_of(&options.input)? {
        Kind::Container => {
            if options.layers == Some(Layers::Passes) {
                return Err(only_a_matrix(&options.input, "passes"));
            }
            let container = open_container(&options.input)?;
            let task = Task::new(options, container.job(), format, daylight.as_ref(), None)?;
            let relighter = Relighter::open(&container, task.settings(), console)?;
            task.run(&|lighting| relit(options, &options.input, &relighter, lighting), console)?;
            say!("{}: relit by {}", options.output.display(), relighter.description());
            let damage = relighter.damage();
            damage.iter().for_each(|line| console.note(line));
            shown_as_they_were(&options.input, damage.len())?;
        }
        Kind::Matrix => {
            let matrix = StoreReader::open(&options.input)?;
            let task = Task::new(options, matrix.job(), format, daylight.as_ref(), None)?;
            if options.layers == Some(Layers::Passes) {
                return task.write_passes(&matrix);
            }
            let unusable = Cell::new(0usize);
            let relight = |lighting: &Lighting| {
                let image = relight_matrix(&matrix, lighting, task.memory())?;
                unusable.set(unusable.get() + image.values().iter().filter(|value| !value.is_finite()).count());
                Ok(image)
            };
            task.run(&relight, console)?;
            if unusable.get() > 0 {
                let (input, count) = (options.input.display(), unusable.get());
                console.note(&format!("{input}: {count} values of the image are infinite or not a number"));
            }
            say!("{}: relit by the raw matrix", options.output.display());
        }
    }
    Ok(())
}

/// The image of a lighting, if the container is whole or need not be.
fn relit(options: &Relight, input: &Path, relighter: &Relighter<'_>, lighting: &Lighting) -> Result<LinearImage> {
    let image = relighter.relight(lighting)?;
    let damage = relighter.damage();
    match damage.first() {
        Some(first) if !options.allow_damage => {
            let problem = format!("damaged blocks: {}; {first}", damage.len());
            Err(Error::damaged(input, problem, "--allow-damage writes the image with the others"))
        }
        _ => Ok(image),
    }
}

/// Relights the containers of a sequence by one look. The first frame that is asked for exposes all; an animated look goes on with the frames
/// that are there, whichever of them are asked for.
fn relight_sequence(options: &Relight, frames: &[(usize, PathBuf)], format: Format, console: &Console) -> Result<()> {
    let place = options.output.display().to_string();
    if options.layers.is_some() {
        return Err(Error::input("--layers", "are of one container, not of a sequence", "give one frame's container"));
    }
    let named = |frame: usize| {
        let hint = "put #### into the output's name";
        frame_path(&options.output, frame).ok_or_else(|| Error::input(&*place, "would be that of every frame", hint))
    };
    named(0)?;
    let all = sequence::frames(&options.input, None)?.unwrap_or_default();
    let daylight = options.daylight.moment(console)?;
    let (mut writer, mut damaged): (Option<Writer>, usize) = (None, 0);
    console.begin("frames", frames.len() as u64, "frames");
    let written = frames.iter().try_for_each(|(frame, input)| {
        if console.interrupted() {
            return Err(Error::interrupted(format!("frames before {frame} are written")));
        }
        if !matches!(kind_of(input)?, Kind::Container) {
            let hint = "pack the frames: ltm-pack FRAMES -o frames.####.ltc";
            return Err(Error::input(input.display().to_string(), "a sequence is of containers", hint));
        }
        let container = open_container(input)?;
        let at = all.partition_point(|(other, _)| other < frame);
        let task = Task::new(options, container.job(), format, daylight.as_ref(), Some(at))?;
        let relighter = Relighter::open(&container, task.settings(), &NoProgress)?;
        let image = relit(options, input, &relighter, &task.lighting)?;
        let damage = relighter.damage();
        damage.iter().for_each(|line| console.note(&format!("{}: {line}", input.display())));
        damaged += damage.len();
        let mut say = |line: String| say!("{place}: {line}");
        writer
            .get_or_insert_with(|| options.picture.writer(format, &image, &mut say))
            .write(&named(*frame)?, &image)?;
        console.advance(1, 1, "frames");
        Ok(())
    });
    console.end();
    written?;
    say!("{place}: {} frames", frames.len());
    shown_as_they_were(&options.input, damaged)
}

/// Refuses to call pictures whole that were made with damaged blocks.
fn shown_as_they_were(input: &Path, damaged: usize) -> Result<()> {
    if damaged == 0 {
        return Ok(());
    }
    let problem = format!("{damaged} damaged blocks are not shown as they were");
    Err(Error::damaged(input, problem, "pack it again to have all"))
}

fn write_features(options: &Relight, format: Format, console: &Console) -> Result<()> {
    let place = options.output.display().to_string();
    if format != Format::Exr {
        return Err(Error::input(place, "features go into one EXR", "name the image x.exr"));
    }
    if !matches!(kind_of(&options.input)?, Kind::Matrix) {
        return Err(only_a_matrix(&options.input, "features"));
    }
    let matrix = StoreReader::open(&options.input)?;
    let missing = ltm::pipeline::write_features(&matrix, &options.output, options.memory, console)?;
    if missing > 0 {
        console.note(&format!("{}: {missing} blocks are not rendered yet and left black", options.input.display()));
    }
    println!("{place}: features of the matrix");
    Ok(())
}

/// What is asked of a container that only a matrix knows.
fn only_a_matrix(input: &Path, what: &str) -> Error {
    let hint = "give the .ltm that it was packed from, or render the scene without --pack, of few samples";
    Error::input(input.display().to_string(), format!("a container holds no {what}"), hint)
}

/// What is to be relit, resolved over the lights at hand.
struct Task<'a> {
    options: &'a Relight,
    job: &'a Job,
    lighting: Lighting,
    look: Option<Look>,
    /// The daylight beside the lamps.
    daylight: Option<&'a Moment>,
    /// The columns that are on.
    on: Option<Vec<u32>>,
    /// Frames of an animation; none for a still.
    frames: usize,
}

impl<'a> Task<'a> {
    /// `frame` is the place of a container in a sequence.
    fn new(
        options: &'a Relight,
        job: &'a Job,
        format: Format,
        daylight: Option<&'a Moment>,
        frame: Option<usize>,
    ) -> Result<Self> {
        let load = |path| load_look(path, &job.basis, options.allow_outside);
        let look = options.lighting.as_deref().map(load).transpose()?;
        let lamps = match (&look, &options.look) {
            (Some(look), Some(name)) => look.named(name)?.clone(),
            (Some(look), None) => match (frame, look.keys().next()) {
                (Some(frame), Some(_)) => {
                    let frames = look.frames(options.fps)?;
                    frames.lighting(frame.min(frames.count() - 1))?
                }
                _ => look.lighting().clone(),
            },
            (None, _) => Lighting::of_scene(&job.basis),
        };
        let lighting = match &daylight {
            Some(moment) => moment.lighting(job, &lamps, None)?,
            None => lamps,
        };
        let on = if options.on.is_empty() { None } else { Some(chosen(job, &options.on)?) };
        let place = options.output.display().to_string();
        let is_animation = frame.is_none() && frame_path(&options.output, 0).is_some();
        let frames = match (&daylight, &look) {
            _ if !is_animation => 0,
            (Some(moment), _) => moment.frames().unwrap_or(0),
            (None, Some(look)) => look.frames(options.fps)?.count(),
            (None, None) => 0,
        };
        if is_animation && frames == 0 {
            let (problem, hint) = match &daylight {
                Some(_) => ("an animation is of a whole day", "leave HH:MM out of --at"),
                None => {
                    ("an animation needs keys to go between", "give a look file with [[key]], or --climate with a day")
                }
            };
            return Err(Error::input(place, problem, hint));
        }
        if !is_animation && daylight.is_some_and(|moment| moment.frames().is_some()) {
            let hint = match frame {
                Some(_) => "add HH:MM: each frame of a sequence is lit as at one time",
                None => "add HH:MM, or put #### into the output's name",
            };
            return Err(Error::input("--at", "is a day without a time", hint));
        }
        if options.frames.is_some() && frames == 0 && frame.is_none() {
            return Err(Error::input(place, "--frames is of an animation", "put #### into the name"));
        }
        let range = options.frames.as_ref().filter(|_| frame.is_none());
        if let Some(range) = range.filter(|range| range.is_empty() || range.end > frames) {
            let problem = format!("there are no frames {}..{}", range.start, range.end);
            return Err(Error::input(place, problem, format!("the animation has frames 0..{frames}")));
        }
        if options.layers.is_some() && (format != Format::Exr || frames > 0) {
            return Err(Error::input(place, "layers go into one EXR", "name the image x.exr"));
        }
        options.picture.check(format, &options.output, job)?;
        let mut task = Self { options, job, lighting, look, daylight, on, frames };
        task.lighting = task.restricted(task.lighting.clone());
        Ok(task)
    }

    /// A lighting with only the lights that are on.
    fn restricted(&self, lighting: Lighting) -> Lighting {
        match &self.on {
            Some(columns) => lighting.only(columns.iter().copied()),
            None => lighting,
        }
    }

    /// Memory that is taken beside relighting one image: the look's lightings and two more, and what writes the image or
    /// its layers.
    fn beside_bytes(&self) -> u64 {
        let lightings = self.look.as_ref().map_or(0, Look::bytes) + 2 * self.lighting.weights().len() as u64 * 12;
        let layers = match self.options.layers {
            None | Some(Layers::Features) => 1,
            Some(Layers::Passes) => PASSES.len() + 1,
            Some(Layers::Lights) => self.job.basis.lights().len(),
            Some(Layers::Groups) => self.look.as_ref().map_or(0, |look| look.groups().len()) + 1,
        };
        lightings + relit_layers_need_bytes(layers, self.job.shape)
    }

    /// How a container is relit.
    fn settings(&self) -> RelightOptions {
        let device = match self.options.device {
            DeviceName::Auto => Device::Auto,
            DeviceName::Cpu => Device::Cpu,
            DeviceName::Gpu => Device::Gpu,
        };
        RelightOptions { device, ..self.memory() }
    }

    /// What relighting must stay within, and what is taken beside it.
    fn memory(&self) -> RelightOptions {
        RelightOptions {
            memory_bytes: self.options.memory,
            beside_bytes: self.beside_bytes(),
            gpu_memory_bytes: self.options.gpu_memory,
            ..RelightOptions::default()
        }
    }

    fn run(&self, relight: &dyn Fn(&Lighting) -> Result<LinearImage>, console: &Console) -> Result<()> {
        let output = &self.options.output;
        let mut say = |line: String| say!("{}: {line}", output.display());
        if let Some(layers) = self.options.layers {
            return self.write_layers(layers, relight);
        }
        let picture = &self.options.picture;
        if self.frames == 0 {
            let image = relight(&self.lighting)?;
            return picture.writer(format_of(output)?, &image, &mut say).write(output, &image);
        }
        let brightest = self.brightest_key(relight)?;
        let writer = picture.writer(format_of(output)?, &brightest, &mut say);
        let range = self.options.frames.clone().unwrap_or(0..self.frames);
        console.begin("frames", range.len() as u64, "frames");
        let written = range.clone().try_for_each(|frame| {
            if console.interrupted() {
                return Err(Error::interrupted(format!("frames before {frame} are written")));
            }
            let path = frame_path(output, frame).unwrap_or_else(|| output.clone());
            let lighting = self.restricted(self.lighting_of(frame)?);
            writer.write(&path, &relight(&lighting)?)?;
            console.advance(1, 1, "frames");
            Ok(())
        });
        console.end();
        written?;
        say(format!("{} frames", range.len()));
        Ok(())
    }

    /// The lighting of a frame of the animation.
    fn lighting_of(&self, frame: usize) -> Result<Lighting> {
        match (&self.daylight, &self.look) {
            (Some(moment), _) => moment.lighting(self.job, &self.lighting, Some(frame)),
            (None, Some(look)) => look.frames(self.options.fps)?.lighting(frame),
            (None, None) => Ok(self.lighting.clone()),
        }
    }

    /// The brightest of the images at the keys, or that of noon, or a black one where none is needed.
    fn brightest_key(&self, relight: &dyn Fn(&Lighting) -> Result<LinearImage>) -> Result<LinearImage> {
        let mut brightest = LinearImage::black(1, 1);
        let sum = |image: &LinearImage| image.luminances().map(f64::from).sum::<f64>();
        if !self.options.picture.looks_at_images() {
            return Ok(brightest);
        }
        if self.daylight.is_some() {
            return relight(&self.lighting);
        }
        if let Some(look) = &self.look {
            for lighting in look.keys() {
                let image = relight(lighting)?;
                if sum(&image) > sum(&brightest) {
                    brightest = image;
                }
            }
        }
        Ok(brightest)
    }

    fn write_layers(&self, layers: Layers, relight: &dyn Fn(&Lighting) -> Result<LinearImage>) -> Result<()> {
        let columns: Vec<(String, Vec<u32>)> = match layers {
            Layers::Lights => {
                self.job.basis.lights().iter().map(|light| (light.name.clone(), light.columns().collect())).collect()
            }
            Layers::Groups => self.groups()?,
            Layers::Features | Layers::Passes => unreachable!("written before anything is relit"),
        };
        // Lights that are off are left out, but a file needs one layer.
        let weights = self.lighting.weights();
        let shines =
            |(_, columns): &(String, Vec<u32>)| columns.iter().any(|&column| weights[column as usize] != [0.0; 3]);
        let mut layers: Vec<(String, Vec<u32>)> = columns.into_iter().filter(shines).collect();
        if layers.is_empty() {
            layers.push(("dark".to_owned(), Vec::new()));
        }
        let names: Vec<String> = layers.iter().map(|(name, _)| name.clone()).collect();
        // Groups may share lights, so that the picture is not the sum of the layers.
        let mut relit = |layer: usize| match layers.get(layer) {
            Some((_, columns)) => relight(&self.lighting.only(columns.iter().copied())),
            None => relight(&self.lighting),
        };
        write_relit_layers(&self.options.output, self.job.shape, &names, &mut relit)
    }

    /// Writes how the light of the image came.
    fn write_passes(&self, matrix: &StoreReader) -> Result<()> {
        let output = &self.options.output;
        let mut images = Vec::from(relight_passes(matrix, &self.lighting, self.memory())?);
        let mut whole = LinearImage::black(self.job.shape.width(), self.job.shape.height());
        for pass in &images {
            for (sum, pixel) in whole.pixels.iter_mut().zip(&pass.pixels) {
                (0..3).for_each(|channel| sum[channel] += pixel[channel]);
            }
        }
        images.push(whole);
        let (names, mut take) = (PASSES.map(str::to_owned), |pass: usize| {
            Ok(std::mem::replace(&mut images[pass], LinearImage::black(0, 0)))
        });
        write_relit_layers(output, self.job.shape, &names, &mut take)?;
        say!("{}: emission seen, direct and indirect light of the raw matrix", output.display());
        Ok(())
    }

    /// The groups of the look file, and the lights of none of them as "others".
    fn groups(&self) -> Result<Vec<(String, Vec<u32>)>> {
        let mut groups = self.look.as_ref().map_or_else(Vec::new, |look| look.groups().to_vec());
        if groups.is_empty() {
            let hint = "give a look file with [groups], or take --layers lights";
            return Err(Error::input("--layers groups", "there are no groups", hint));
        }
        let mut others = vec![true; self.job.shape.columns()];
        groups.iter().flat_map(|(_, columns)| columns).for_each(|&column| others[column as usize] = false);
        let others: Vec<u32> = (0..).zip(others).filter(|(_, other)| *other).map(|(column, _)| column).collect();
        if !others.is_empty() {
            groups.push(("others".to_owned(), others));
        }
        Ok(groups)
    }
}

/// The columns of the lights that one of the patterns matches.
fn chosen(job: &Job, patterns: &[String]) -> Result<Vec<u32>> {
    let mut columns = Vec::new();
    for pattern in patterns {
        let lights = job.basis.lights();
        let matching = meant(pattern, lights.iter().map(|light| light.name.as_str()));
        if matching.is_empty() {
            let names = job.basis.lights().iter().map(|light| light.name.as_str());
            return Err(Error::input(format!("light '{pattern}'"), "no light matches", suggest(pattern, names)));
        }
        columns.extend(matching.into_iter().flat_map(|light| lights[light].columns()));
    }
    Ok(columns)
}
