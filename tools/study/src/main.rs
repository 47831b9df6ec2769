//! `ltm-study`, which `ltm study` starts.

#![expect(clippy::print_stdout, reason = "a program's results go to standard output")]

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use ltm::Result;
use ltm::error::Error;
use ltm_cli::console::{Console, EXIT_CODES, finish, use_threads};
use ltm_study::{CorpusOptions, StudyOptions};

/// Measure what the program reaches: each study writes CSV, a plot and a table.
#[derive(Parser)]
#[command(name = "ltm study", version, after_help = format!("Examples:
  ltm study fig9 --out study        PSNR against bytes on disk
  ltm study all --quick             every study, tiny, in under a minute\n\n{EXIT_CODES}"))]
struct Arguments {
    #[arg(value_parser = parse_studies, help = help())]
    name: Studies,
    /// Tiny images and few samples: to see that it works, not to conclude from.
    #[arg(long)]
    quick: bool,
    /// Folder for the results.
    #[arg(long, default_value = "study")]
    out: PathBuf,
    /// Scenes of the corpus, by names of folders [default: all].
    #[arg(long, value_delimiter = ',')]
    scenes: Vec<String>,
    /// Pixels of the corpus' pictures.
    #[arg(long, value_parser = parse_size, default_value = "256x192")]
    size: (u32, u32),
    /// Samples per pixel of the corpus' pictures.
    #[arg(long, value_delimiter = ',', default_values_t = [16, 64, 256])]
    samples: Vec<u32>,
    /// Samples per pixel of their references.
    #[arg(long, default_value_t = 2048)]
    reference_samples: u32,
    /// Threads to use [default: one for each core].
    #[arg(long)]
    threads: Option<usize>,
}

/// The studies that a name stands for.
#[derive(Clone)]
struct Studies(Vec<ltm_study::Study>);

fn help() -> String {
    let names: Vec<_> = ltm_study::Study::ALL.iter().map(|study| study.name()).collect();
    format!("Which one: all, {}", names.join(", "))
}

fn parse_size(text: &str) -> Result<(u32, u32)> {
    let side = |text: &str| text.parse().ok().filter(|&side| side > 0);
    let sides = text.split_once('x').and_then(|(across, down)| Some((side(across)?, side(down)?)));
    sides.ok_or_else(|| Error::input("size", format!("'{text}' is no size"), "give it as 256x192"))
}

fn parse_studies(text: &str) -> Result<Studies> {
    match text {
        "all" => Ok(Studies(ltm_study::Study::ALL.to_vec())),
        name => name.parse().map(|study| Studies(vec![study])),
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    finish("ltm study", run(&arguments, &Console::new()))
}

fn run(options: &Arguments, console: &Console) -> Result<()> {
    use_threads(options.threads)?;
    let Arguments { scenes, size, samples, reference_samples, .. } = options;
    let corpus = CorpusOptions {
        scenes: scenes.clone(),
        size: *size,
        samples: samples.clone(),
        reference_samples: *reference_samples,
    };
    let settings = StudyOptions { out: options.out.clone(), quick: options.quick, corpus };
    let report = ltm_study::run(&options.name.0, &settings, console)?;
    println!("{}", report.markdown);
    for file in &report.files {
        println!("{}", file.display());
    }
    Ok(())
}
