//! The second pass of a pack, on one machine or on many: the common slope from all summaries, then each candidate cut at it, coded,
//! and measured; in the end what all blocks together say.

use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;

use super::{Analysed, PackReport, ReplacedEntries, Shortfall};
use crate::compress::{
    Candidate, CandidateSummary, ColumnErrors, CompressSettings, CompressorPlan, Cut, LightErrorSums, Target,
    cut_of_size,
};
use crate::container::codec::band_steps;
use crate::container::{
    BlockEncoder, ContainerReport, ContainerSummary, EncodedBlock, LightLayout, WrittenBlock, overhead_bytes,
};
use crate::error::{Error, Hint, Result};
use crate::light::{DenoiseErrors, DenoisedLight, ExposedError, Job, LightErrors, LightLoss, StatedErrors};
use crate::matrix::{BlockId, FactoredBlock, MatrixShape};

/// Blocks, spread evenly, that are encoded for each guess at the slope for a file of a given size; all blocks of a
/// small image.
const SAMPLE_BLOCKS: usize = 48;

/// Cuts candidates at one slope and codes them.
pub(crate) struct SecondPass {
    pub(crate) cut: Cut,
    band_steps: Arc<[i8]>,
}

/// A block as it is stored.
pub(crate) struct FinishedBlock {
    pub(crate) encoded: EncodedBlock,
    /// What a reader will get.
    pub(crate) stored: FactoredBlock,
    pub(crate) written: WrittenBlock,
    pub(crate) columns: ColumnErrors,
}

impl SecondPass {
    /// At a cut that was chosen.
    pub(crate) fn new(job: &Job, plan: &CompressorPlan, cut: Cut) -> Self {
        // How much finer bands of right sides are stored: by what their errors do to the lightings of the prior. Where a rank is given
        // there are no steps that they could be finer than.
        let band_steps = match plan.settings().has_fixed_rank() {
            true => Arc::default(),
            false => band_steps(&LightLayout::of(&job.basis), plan.prior()).into(),
        };
        Self { cut, band_steps }
    }

    /// Cuts the candidate of a block, codes it, and measures what a reader will get.
    ///
    /// # Errors
    /// Those of reading the candidate and of the codec.
    pub(crate) fn code(&self, id: BlockId, analysed: &Analysed, encoder: &BlockEncoder) -> Result<FinishedBlock> {
        let (candidate, residual) = analysed.read(id)?;
        let factored = self.kept_of(&candidate, &self.cut);
        let encoded = encoder.encode_divided(id, &factored)?;
        let stored = encoder.decode(id, &encoded)?;
        let (report, columns) = residual.report(&candidate.whole(), &stored);
        let written = WrittenBlock { rank: factored.rank(), sparse_entries: factored.sparse.len(), report };
        Ok(FinishedBlock { encoded, stored, written, columns })
    }

    /// The factors that a cut keeps of a candidate, with their step refinement.
    fn kept_of(&self, candidate: &Candidate, cut: &Cut) -> FactoredBlock {
        FactoredBlock { right_band_steps: Arc::clone(&self.band_steps), ..candidate.cut(cut) }
    }
}

/// What a file's size is estimated with.
pub(crate) struct Sizing<'a> {
    pub(crate) job: &'a Job,
    pub(crate) report: &'a ContainerReport,
    pub(crate) encoder: &'a BlockEncoder,
}

impl Sizing<'_> {
    /// Blocks whose candidates [`second_pass`](Self::second_pass) reads for a file of a given size.
    pub(crate) fn sample(shape: MatrixShape) -> Vec<BlockId> {
        let blocks = shape.block_count() as usize;
        (0..blocks).step_by(blocks.div_ceil(SAMPLE_BLOCKS)).map(|i| BlockId(i as u32)).collect()
    }

    /// The second pass at the cut for the target; where that is a number of bytes, the one of the largest file that is not larger, for
    /// which `read` gives the candidates of the sample. On the current thread pool.
    ///
    /// # Errors
    /// Those of `read` and of the codec.
    pub(crate) fn second_pass(
        &self,
        plan: &CompressorPlan,
        analysed: &[CandidateSummary],
        read: &(impl Fn(BlockId) -> Result<Candidate> + Sync),
    ) -> Result<SecondPass> {
        let second = SecondPass::new(self.job, plan, plan.choose(analysed.iter()));
        match plan.settings().target {
            Target::Bytes(bytes) if second.cut.slope > 0.0 => {
                let cut = cut_of_size(second.cut, bytes, |cut| self.bytes_at(&second, cut, read))?;
                Ok(SecondPass { cut, ..second })
            }
            _ => Ok(second),
        }
    }

    /// Estimated bytes of a cut's file, from the sample of blocks.
    fn bytes_at(
        &self,
        second: &SecondPass,
        cut: &Cut,
        read: &(impl Fn(BlockId) -> Result<Candidate> + Sync),
    ) -> Result<f64> {
        let sample = Self::sample(self.job.shape);
        let encode = |&id: &BlockId| -> Result<(usize, usize)> {
            let size = self.encoder.encode_divided(id, &second.kept_of(&read(id)?, cut))?.size();
            Ok((size.bytes(), size.layer_bytes.len()))
        };
        let sizes = sample.par_iter().map(encode).collect::<Result<Vec<_>>>()?;
        let share = f64::from(self.job.shape.block_count()) / sample.len() as f64;
        let bytes = share * sizes.iter().map(|(bytes, _)| *bytes as f64).sum::<f64>();
        let layers = share * sizes.iter().map(|(_, layers)| *layers as f64).sum::<f64>();
        Ok(bytes + overhead_bytes(self.job, self.report, layers.round() as u64) as f64)
    }
}

/// Energy of all blocks, by which the unit of [`LightErrorSums`] is chosen.
pub(crate) fn energy_of(analysed: &[CandidateSummary]) -> f64 {
    analysed.iter().map(CandidateSummary::energy).sum()
}

/// All blocks after the second pass.
pub(crate) struct PackedBlocks {
    pub(crate) cut: Cut,
    pub(crate) replaced: ReplacedEntries,
    pub(crate) stored: Vec<WrittenBlock>,
    pub(crate) denoising: Option<(DenoiseErrors, Vec<DenoisedLight>)>,
    pub(crate) exposed: Option<ExposedError>,
}

/// What they say together.
pub(crate) struct Concluded {
    blocks: PackedBlocks,
    target: Target,
    /// What was replaced is no light, and who gives a rank has said what it may cost.
    is_asked: bool,
    lights: LightErrors,
    lossy_lights: Vec<LightLoss>,
    /// What the file states.
    pub(crate) errors: StatedErrors,
}

impl PackedBlocks {
    pub(crate) fn conclude(self, job: &Job, settings: &CompressSettings, lights: &LightErrorSums) -> Concluded {
        let lossy_lights = lights.lossy_lights(&job.basis);
        let (denoising, denoised_lights) = self.denoising.clone().unzip();
        let lights = lights.errors(self.cut.expected_relative_l2);
        let errors = StatedErrors {
            lights: Some(lights),
            denoising,
            denoised_lights: denoised_lights.unwrap_or_default(),
            exposed: self.exposed,
        };
        let is_asked = self.replaced.count() > 0 || settings.has_fixed_rank();
        Concluded { blocks: self, target: settings.target, is_asked, lights, lossy_lights, errors }
    }
}

impl Concluded {
    /// # Errors
    /// So little is left of a light that the file is not wanted.
    pub(crate) fn check_lights(&self, path: &Path, allow_lost_lights: bool) -> Result<()> {
        let refuses = !(allow_lost_lights || self.is_asked);
        match self.lossy_lights.first().filter(|loss| loss.is_severe() && refuses) {
            Some(lost) => {
                let problem = format!("{lost}: it is not written");
                Err(Error::input(path.display().to_string(), problem, Hint::AllowLostLights))
            }
            None => Ok(()),
        }
    }

    /// The report on the file that was written.
    pub(crate) fn report(self, job: &Job, summary: &ContainerSummary, seconds: f64) -> PackReport {
        let PackedBlocks { cut, replaced, stored, exposed, .. } = self.blocks;
        let sum = |part: fn(&WrittenBlock) -> f64| stored.iter().map(part).sum::<f64>();
        let (error, norm) = (sum(|s| s.report.squared_error), sum(|s| s.report.squared_norm));
        let is_reached = match self.target {
            // The total of all blocks was estimated from a sample.
            Target::Bytes(bytes) => summary.file_bytes <= bytes,
            _ => cut.reaches_target,
        };
        PackReport {
            seconds,
            raw_bytes: job.shape.raw_bytes(),
            packed_bytes: summary.file_bytes,
            mean_rank: sum(|s| s.rank as f64) / stored.len() as f64,
            sparse_entries: stored.iter().map(|s| s.sparse_entries as u64).sum(),
            relative_l2: (error / norm.max(f64::MIN_POSITIVE)).sqrt(),
            denoising: self.errors.denoising,
            exposed,
            lights: self.lights,
            lossy_lights: self.lossy_lights,
            short_of_target: (!is_reached).then(|| Shortfall {
                target: self.target,
                psnr_db: cut.expected_psnr_db,
                relative_l2: cut.expected_relative_l2,
                file_bytes: summary.file_bytes,
                noise_heeded: cut.noise_factor.is_some() && stored.iter().any(|s| s.report.noise_variance.is_finite()),
            }),
            replaced,
            blocks_kept: 0,
            peak_memory_bytes: None,
        }
    }
}
