//! The study: everything that is claimed of this program, measured by one command each (`ltm study NAME`).
//!
//! A study renders what it needs (cached in its folder, so that studies share matrices), measures, and writes a CSV
//! file, a plot and a Markdown table. Every figure stands beside what it depends on: rows, columns, block, rank,
//! precision, samples, and the metric ([`Measured`]). Nothing here is used by the product.

mod ablation;
mod bench;
mod chart;
mod codecs;
mod corpus;
pub mod curve;
mod daylight;
mod dct;
mod equal;
mod example;
mod factors;
mod fig5;
mod fig6;
mod fig7;
mod fig9;
mod flip;
mod imports;
mod interval;
mod kernel_nystrom;
mod lamp;
mod large;
mod machine;
mod measured;
mod mitsuba;
mod mosaic;
mod noise;
mod oidn;
mod packing;
mod picture;
mod progressive;
mod python;
mod rank;
mod raw_image;
mod reference;
mod rivals;
mod scaling;
mod shared;
mod speed;
mod spots;
mod stated;
mod svd;
mod table;
mod timing;
mod visual_metrics;
mod zfp;

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Instant;

pub use corpus::CorpusOptions;
pub use measured::{Measured, Summary};

use bench::Bench;
use ltm::error::{Error, Result};
use ltm::files::write_file;
use ltm::resources::Progress;

/// The studies by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Study {
    /// The nonlinear map beside linear methods, as pictures (the paper, Fig. 5).
    Fig5,
    /// PSNR against columns kept (Fig. 6).
    Fig6,
    /// The full matrix and the packed one, as pictures (Figs. 7 and 8).
    Fig7,
    /// PSNR against bytes on disk (Fig. 9).
    Fig9,
    /// What each idea is worth at equal bytes, and general codecs beside.
    Ablation,
    /// Rank against the resolution of the light, signal and noise apart (§4).
    Rank,
    /// Error against a converged reference before and after compression.
    Noise,
    /// A picture at full size under one lamp, beside a denoiser's.
    Lamp,
    /// Relit images as one sees them, beside a denoiser's.
    Picture,
    /// Bytes and seconds of containers, and what is seen of packing itself.
    Packing,
    /// Scenes that others made, beside a denoiser's.
    Corpus,
    /// Samples and seconds that the raw matrix takes to be as near to the truth as packed images.
    Equal,
    /// Arrays of another renderer at equal bytes.
    Imports,
    /// The worked example of the guide.
    Example,
    /// Sensors under the patches of a sky, beside Radiance.
    Daylight,
    /// Seconds from a scene to estimates that can be mixed.
    Progressive,
    /// Seconds from a scene to relit images.
    Speed,
    /// Time and memory against sizes.
    Scaling,
    /// One basis of columns for several blocks against each block's own.
    Shared,
    /// Matrices of 9 and 36 GiB, from the scene to a container and back, within 1 GiB of memory.
    Large,
}

/// How to run studies.
#[derive(Clone, Debug)]
pub struct StudyOptions {
    /// Folder for results and the cache of matrices.
    pub out: PathBuf,
    /// Tiny images and few samples: for continuous integration, not for conclusions.
    pub quick: bool,
    /// What the study of a corpus measures.
    pub corpus: CorpusOptions,
}

/// What a study wrote.
#[derive(Clone, Debug, Default)]
pub struct StudyReport {
    /// Files, in the order of writing.
    pub files: Vec<PathBuf>,
    /// The tables as Markdown.
    pub markdown: String,
}

impl Study {
    /// Every study, in the order in which `all` runs them.
    pub const ALL: [Self; 20] = [
        // First, while the process holds no memory that could be taken for these jobs'.
        Self::Large,
        Self::Fig6,
        Self::Fig9,
        Self::Ablation,
        Self::Fig5,
        Self::Fig7,
        Self::Rank,
        Self::Noise,
        Self::Lamp,
        Self::Picture,
        Self::Packing,
        Self::Corpus,
        Self::Equal,
        Self::Imports,
        Self::Example,
        Self::Daylight,
        Self::Shared,
        Self::Progressive,
        Self::Speed,
        Self::Scaling,
    ];

    /// Its name in arguments and file names.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fig5 => "fig5",
            Self::Fig6 => "fig6",
            Self::Fig7 => "fig7",
            Self::Fig9 => "fig9",
            Self::Ablation => "ablation",
            Self::Rank => "rank",
            Self::Noise => "noise",
            Self::Lamp => "lamp",
            Self::Picture => "picture",
            Self::Packing => "packing",
            Self::Corpus => "corpus",
            Self::Equal => "equal",
            Self::Imports => "imports",
            Self::Example => "example",
            Self::Daylight => "daylight",
            Self::Progressive => "progressive",
            Self::Speed => "speed",
            Self::Scaling => "scaling",
            Self::Shared => "shared",
            Self::Large => "large",
        }
    }
}

/// Runs studies one after the other.
///
/// Errors: those of rendering, packing and writing; [`Error::Interrupted`] when the watch says so.
pub fn run(studies: &[Study], options: &StudyOptions, watch: &dyn Progress) -> Result<StudyReport> {
    let mut report = StudyReport::default();
    for &study in studies {
        let begun = Instant::now();
        let bench = Bench::new(study.name(), options, watch)?;
        let written = match study {
            Study::Fig5 => fig5::run(&bench)?,
            Study::Fig6 => fig6::run(&bench)?,
            Study::Fig7 => fig7::run(&bench)?,
            Study::Fig9 => fig9::run(&bench)?,
            Study::Ablation => ablation::run(&bench)?,
            Study::Rank => rank::run(&bench)?,
            Study::Noise => noise::run(&bench)?,
            Study::Lamp => lamp::run(&bench)?,
            Study::Picture => picture::run(&bench)?,
            Study::Packing => packing::run(&bench)?,
            Study::Corpus => corpus::run(&bench)?,
            Study::Equal => equal::run(&bench)?,
            Study::Imports => imports::run(&bench)?,
            Study::Example => example::run(&bench)?,
            Study::Daylight => daylight::run(&bench)?,
            Study::Progressive => progressive::run(&bench)?,
            Study::Speed => speed::run(&bench)?,
            Study::Scaling => scaling::run(&bench)?,
            Study::Shared => shared::run(&bench)?,
            Study::Large => large::run(&bench)?,
        };
        watch.note(&format!("{study}: {:.1} s", begun.elapsed().as_secs_f64()));
        report.files.extend(written.files);
        report.markdown += &written.markdown;
    }
    Ok(report)
}

impl StudyReport {
    /// Writes a table as `STEM.csv` and `STEM.md`.
    fn add_table(&mut self, folder: &Path, stem: &str, table: &table::Table) -> Result<()> {
        let markdown = table.to_markdown();
        self.add_text(folder, &format!("{stem}.csv"), &table.to_csv())?;
        self.add_text(folder, &format!("{stem}.md"), &markdown)?;
        self.markdown += &markdown;
        self.markdown.push('\n');
        Ok(())
    }

    /// Writes a table that is too long to read as `STEM.csv` alone.
    fn add_csv(&mut self, folder: &Path, stem: &str, table: &table::Table) -> Result<()> {
        self.add_text(folder, &format!("{stem}.csv"), &table.to_csv())
    }

    fn add_text(&mut self, folder: &Path, name: &str, text: &str) -> Result<()> {
        let path = folder.join(name);
        write_file(&path, true, text.as_bytes())?;
        self.files.push(path);
        Ok(())
    }

    /// Writes a chart as `STEM.png`.
    fn add_chart(&mut self, folder: &Path, stem: &str, chart: &chart::Chart) -> Result<()> {
        let path = folder.join(format!("{stem}.png"));
        chart.write(&path)?;
        self.files.push(path);
        Ok(())
    }

    /// Writes rows of large pictures as `STEM.jpg`.
    fn add_photograph(&mut self, folder: &Path, stem: &str, rows: &[Vec<mosaic::Picture>]) -> Result<()> {
        let path = folder.join(format!("{stem}.jpg"));
        mosaic::write(&path, rows, 1)?;
        self.files.push(path);
        Ok(())
    }

    /// Writes rows of pictures as `STEM.png`.
    fn add_pictures(&mut self, folder: &Path, stem: &str, rows: &[Vec<mosaic::Picture>], scale: u32) -> Result<()> {
        let path = folder.join(format!("{stem}.png"));
        mosaic::write(&path, rows, scale)?;
        self.files.push(path);
        Ok(())
    }
}

impl fmt::Display for Study {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Study {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|study| study.name() == text).ok_or_else(|| {
            let names: Vec<_> = Self::ALL.iter().map(|study| study.name()).collect();
            Error::input("study", format!("'{text}' is unknown"), format!("take one of all, {}", names.join(", ")))
        })
    }
}
