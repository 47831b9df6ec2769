//! `ltm relight`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use ltm::container::ContainerReader;
use ltm::light::names::fits;
use ltm::light::{Job, Lighting};
use ltm::pipeline::{self, Device};
use ltm::store::StoreReader;
use ltm::{Error, Result};

use crate::console::Console;
use crate::input::{Kind, kind_of};

#[derive(Args)]
pub(crate) struct Relight {
    /// The container or matrix.
    input: PathBuf,
    /// The image to write, .exr or .png.
    #[arg(short, long)]
    output: PathBuf,
    /// Only lights whose name matches this (`*` stands for anything); may be given several times [default: all].
    #[arg(long)]
    on: Vec<String>,
    /// Where to compute.
    #[arg(long, value_enum, default_value = "auto")]
    device: DeviceName,
}

#[derive(Clone, Copy, ValueEnum)]
enum DeviceName {
    Auto,
    Cpu,
    Gpu,
}

pub(crate) fn run(options: &Relight, console: &Console) -> Result<()> {
    let device = match options.device {
        DeviceName::Auto => Device::Auto,
        DeviceName::Cpu => Device::Cpu,
        DeviceName::Gpu => Device::Gpu,
    };
    let (image, by) = match kind_of(&options.input)? {
        Kind::Container => {
            let container = ContainerReader::open(&options.input)?;
            let lighting = chosen(container.job(), &options.on)?;
            let (mut images, by) = pipeline::relight(&container, &[lighting], device, console)?;
            (images.remove(0), by)
        }
        Kind::Matrix => {
            let matrix = StoreReader::open(&options.input)?;
            let lighting = chosen(matrix.job(), &options.on)?;
            (ltm::relight::relight_raw(&matrix, &[lighting])?.remove(0), "the raw matrix".to_owned())
        }
    };
    match options.output.extension().and_then(|e| e.to_str()) {
        Some("exr") => ltm::image::write_exr(&options.output, &image)?,
        Some("png") => ltm::image::write_png(&options.output, &image, 0.9)?,
        _ => {
            let problem = "the name ends neither in .exr nor in .png";
            return Err(Error::input(options.output.display().to_string(), problem, "name the image x.exr or x.png"));
        }
    }
    println!("{}: relit by {by}", options.output.display());
    Ok(())
}

/// The scene's own lighting, with only the lights on whose names match one of the patterns.
fn chosen(job: &Job, patterns: &[String]) -> Result<Lighting> {
    if patterns.is_empty() {
        return Ok(Lighting::of_scene(&job.basis));
    }
    let mut weights = vec![[0.0; 3]; job.shape.columns()];
    for pattern in patterns {
        let mut found = false;
        for light in job.basis.lights().iter().filter(|light| fits(pattern, &light.name)) {
            found = true;
            light.columns().for_each(|column| weights[column as usize] = light.emission);
        }
        if !found {
            let names: Vec<_> = job.basis.lights().iter().take(12).map(|light| light.name.as_str()).collect();
            let problem = "no light matches";
            return Err(Error::input(
                format!("light '{pattern}'"),
                problem,
                format!("the lights are {}", names.join(", ")),
            ));
        }
    }
    Lighting::new(weights)
}
