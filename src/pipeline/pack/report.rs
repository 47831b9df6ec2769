//! Result of a pack, and its text for people.

use crate::compress::{AUTOMATIC_DB, CandidateSummary, Target};
use crate::encoding::{Decode, Encode};
use crate::error::{Hint, Warning, Wording};
use crate::light::{DenoiseErrors, ExposedError, LightErrors, LightLoss};
use crate::matrix::{BlockId, ColumnIndex};
use crate::resources::human_bytes;

/// Result of a pack.
#[derive(Clone, Debug)]
pub struct PackReport {
    /// Wall-clock seconds.
    pub seconds: f64,
    /// Bytes of the matrix in f32.
    pub raw_bytes: u64,
    /// Bytes of the container.
    pub packed_bytes: u64,
    /// Mean rank over blocks.
    pub mean_rank: f64,
    /// Entries kept outside the low-rank part.
    pub sparse_entries: u64,
    /// `‖T − T'‖_F / ‖T‖_F` of the stored container against the source, measured to about 1 %: see [`Residual`](crate::compress::Residual).
    pub relative_l2: f64,
    /// Errors of denoising, if images were denoised: see [`denoise_errors_line`](crate::light::denoise_errors_line).
    pub denoising: Option<DenoiseErrors>,
    /// The error of exposed images that was reached, if one was asked for.
    pub exposed: Option<ExposedError>,
    /// Errors of lightings of every kind: see [`light_errors_lines`](crate::light::light_errors_lines).
    pub lights: LightErrors,
    /// Lights whose images alone have large errors, the worst first.
    pub lossy_lights: Vec<LightLoss>,
    /// How near the target was reached, if it was not.
    pub short_of_target: Option<Shortfall>,
    /// Unusable entries, and their replacements.
    pub replaced: ReplacedEntries,
    /// Blocks found analysed by an earlier, interrupted run.
    pub blocks_kept: u64,
    /// Peak resident anonymous memory, where the system tells.
    pub peak_memory_bytes: Option<u64>,
}

/// Counts of unusable entries of a matrix. The container has other values in their place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub struct ReplacedEntries {
    /// Entries that were no number, now 0.
    pub nan: u64,
    /// Entries that were infinite or too large, now the largest of their block that is usable.
    pub huge: u64,
    /// Position of the first: block, column, and row in the block.
    pub first: Option<(BlockId, ColumnIndex, u32)>,
}

impl ReplacedEntries {
    pub(crate) fn of(analysed: &[CandidateSummary], blocks: &[BlockId]) -> Self {
        let mut all = Self::default();
        for (summary, &id) in analysed.iter().zip(blocks) {
            all.nan += u64::from(summary.replaced.nan);
            all.huge += u64::from(summary.replaced.huge);
            all.first = all.first.or(summary.replaced.first.map(|(column, row)| (id, column, row)));
        }
        all
    }

    /// Number of replaced entries.
    pub fn count(self) -> u64 {
        self.nan + self.huge
    }
}

/// One line for people.
impl std::fmt::Display for ReplacedEntries {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { nan, huge, first } = self;
        write!(f, "{} entries were replaced: {nan} that are not a number by 0, {huge} ", self.count())?;
        write!(f, "infinite or above 1e15 by the largest of their block")?;
        match first {
            Some((id, column, row)) => write!(f, "; the first is in {id}, {column}, row {row}"),
            None => Ok(()),
        }
    }
}

/// A target that was not reached, and the expected error of images under the prior, against the matrix with its noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shortfall {
    /// The target asked for.
    pub target: Target,
    /// Expected PSNR in dB, see [`Target::PsnrDb`].
    pub psnr_db: f64,
    /// Expected relative L2 error.
    pub relative_l2: f64,
    /// Bytes of the container.
    pub file_bytes: u64,
    /// Whether the noise may have prevented it; otherwise it was the rank.
    pub noise_heeded: bool,
}

impl Shortfall {
    /// How near, and what goes further.
    pub fn warning(&self) -> Warning {
        let (reached, asked) = match self.target {
            Target::RelativeL2(asked) => (format!("relative L2 {:.4}", self.relative_l2), format!("{asked}")),
            Target::PsnrDb(asked) => (format!("{:.1} dB", self.psnr_db), format!("{asked} dB")),
            Target::Bytes(asked) => {
                let (bytes, over) = (human_bytes(self.file_bytes), self.file_bytes.saturating_sub(asked));
                let further = match self.relative_l2 < 0.999 {
                    true => "a smaller target leaves out more",
                    false => "nothing is left in it that could be left out",
                };
                let text = format!("the file has {bytes}, {over} B more than the target, {}", human_bytes(asked));
                return Warning::new(text, further);
            }
            Target::Slope(asked) => (format!("{:.1} dB", self.psnr_db), format!("slope {asked}")),
            Target::Automatic if self.noise_heeded => {
                let at = self.psnr_db;
                let text = format!("stopped at the noise of the samples, {at:.1} dB from the matrix");
                return Warning::new(text, Hint::KeepNoise);
            }
            Target::Automatic => (format!("{:.1} dB", self.psnr_db), format!("{AUTOMATIC_DB} dB")),
        };
        let (stopped_by, left_out, further) = match self.noise_heeded {
            true => ("the noise of the samples", ": what is left out is mostly noise", Hint::KeepNoise),
            false => ("the rank", "", Hint::HigherRank),
        };
        let text =
            format!("{stopped_by} stopped it at {reached} from the matrix, short of the target, {asked}{left_out}");
        Warning::new(text, further)
    }
}

/// [`Shortfall::warning`] as one line.
impl std::fmt::Display for Shortfall {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.warning().fmt(f)
    }
}

impl PackReport {
    /// One line on what was reached, for people, one more where it is short of its target, and one for each lossy light: hints in the
    /// words of a front end.
    #[must_use]
    pub fn worded(&self, wording: Wording) -> String {
        let ratio = self.raw_bytes as f64 / self.packed_bytes as f64;
        let mut lines = format!(
            "{} from {}, ratio {ratio:.0}×, mean rank {:.2}, {} sparse entries, error {:.5} relative L2 of the matrix",
            human_bytes(self.packed_bytes),
            human_bytes(self.raw_bytes),
            self.mean_rank,
            self.sparse_entries,
            self.relative_l2,
        );
        if let Some(shortfall) = &self.short_of_target {
            lines += &format!("\n{}", shortfall.warning().worded(wording));
        }
        self.lossy_lights.iter().for_each(|loss| lines += &format!("\nwarning: {loss}"));
        lines
    }
}

/// [`PackReport::worded`] in the words of this library.
impl std::fmt::Display for PackReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.worded(Hint::to_string))
    }
}
