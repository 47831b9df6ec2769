//! `ltm study`.

use std::path::PathBuf;

use clap::Args;
use ltm::Result;
use ltm::study::{self, StudyOptions};

use crate::console::Console;

#[derive(Args)]
pub(crate) struct Study {
    #[arg(value_parser = parse_studies, help = help())]
    name: Studies,
    /// Tiny images and few samples: to see that it works, not to conclude from.
    #[arg(long)]
    quick: bool,
    /// Folder for the results.
    #[arg(long, default_value = "study")]
    out: PathBuf,
}

/// The studies that a name stands for.
#[derive(Clone)]
struct Studies(Vec<study::Study>);

fn help() -> String {
    let names: Vec<_> = study::Study::ALL.iter().map(|study| study.name()).collect();
    format!("Which one: all, {}", names.join(", "))
}

fn parse_studies(text: &str) -> Result<Studies> {
    match text {
        "all" => Ok(Studies(study::Study::ALL.to_vec())),
        name => name.parse().map(|study| Studies(vec![study])),
    }
}

pub(crate) fn run(options: &Study, console: &Console) -> Result<()> {
    let settings = StudyOptions { out: options.out.clone(), quick: options.quick };
    let report = study::run(&options.name.0, &settings, console)?;
    println!("{}", report.markdown);
    for file in &report.files {
        println!("{}", file.display());
    }
    Ok(())
}
