//! The work of the rounds after the first: each unit reads shards of earlier rounds where they lie, and leaves one of its own.

use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use rayon::prelude::*;

use super::publish::{BuildReport, go_on, publish, scratch_file};
use super::round::{CHECK, GuideTerms, Reduction, Round, fingerprint_of, hash_of};
use super::terms::Terms;
use crate::blob_store::BlobStore;
use crate::block_records::{
    Opener, Records, Shard, ShardContent, ShardHead, ShardSet, hex, open_spill, range_prefix, spill_path,
};
use crate::compress::{CandidateSummary, Compressor, CompressorPlan, LightErrorSums};
use crate::container::{BlockEncoder, MAX_LAYERS, WrittenBlock};
use crate::denoise::{DenoisedSource, Guides, PictureWindows, blocks_read};
use crate::error::{Error, Result};
use crate::files::{ContinuationFile, Ranged, free_bytes};
use crate::light::Clusters;
use crate::matrix::{BlockId, BlockReport, BlockSource, TracedBlock};
use crate::pipeline::{Analysed, SecondPass, need_of, plan_of};
use crate::resources::{Held, Progress, ResourceEstimate, Threads};

/// Shards whose heads are read at once.
pub(super) const AT_ONCE: usize = 8;
/// Objects of a store that are read from at the same time: those of two sets.
const HELD_OBJECTS: u64 = 8;

/// Where a worker keeps what is not finished.
#[derive(Clone, Copy, Debug, Default)]
pub struct WorkFolders<'a> {
    /// For files that vanish with the process; by default the system's for such files.
    pub scratch: Option<&'a Path>,
    /// For candidates of blocks from their analysis until they are coded, where there is room for them. Without it, or on another
    /// machine, coding analyses them again, to the same bytes.
    pub keep: Option<&'a Path>,
}

/// One unit of a round after the first.
pub(super) struct Unit<'a> {
    pub(super) terms: &'a Terms,
    pub(super) reduction: &'a Reduction,
    /// SHA-256 of the reduction, in hexadecimal digits.
    pub(super) reduction_hash: &'a str,
    pub(super) depot: &'a Arc<BlobStore>,
    pub(super) folders: WorkFolders<'a>,
}

/// Shards of a depot as one set, read where they lie.
///
/// # Errors
/// They cannot be read, or their heads are damaged.
pub(super) fn open_shards(depot: &Arc<BlobStore>, names: &[&str], blocks: u32) -> Result<ShardSet> {
    let opened = Arc::clone(depot);
    let opener: Opener = Arc::new(move |name: &str| opened.open_file(name));
    let head = |name: &&str| -> Result<Shard> { Ok(look(depot, name)?.0) };
    let mut set = ShardSet::in_depot(depot.address(), blocks, opener);
    for few in names.chunks(AT_ONCE) {
        let heads: Vec<Shard> = few.par_iter().map(head).collect::<Result<_>>()?;
        for shard in heads {
            // Each block is in one of them.
            set.add(shard);
        }
    }
    Ok(set)
}

fn look(depot: &BlobStore, name: &str) -> Result<(Shard, Box<dyn Ranged>)> {
    let place = Path::new(depot.address()).join(name);
    let file = depot.open_file(name)?;
    match Shard::look(&*file, &place, name)? {
        Ok(shard) => Ok((shard, file)),
        Err(problem) => Err(Error::damaged(place, problem, CHECK)),
    }
}

/// Hands on the summaries of shards, in the order of their names.
///
/// # Errors
/// They cannot be read or are damaged; those of `take`.
pub(super) fn summaries(
    depot: &BlobStore,
    names: &[String],
    mut take: impl FnMut(&str, ShardHead, &[u8]) -> Result<()>,
) -> Result<()> {
    let read = |name: &String| -> Result<(ShardHead, Vec<u8>)> {
        let (shard, file) = look(depot, name)?;
        let summary = shard.summary(&*file)?;
        Ok((shard.head, summary))
    };
    for few in names.chunks(AT_ONCE) {
        let read: Vec<_> = few.par_iter().map(read).collect::<Result<_>>()?;
        few.iter().zip(read).try_for_each(|(name, (head, summary))| take(name, head, &summary))?;
    }
    Ok(())
}

/// The error for a summary that is none.
pub(super) fn damaged_summary(depot: &BlobStore, name: &str) -> Error {
    Error::damaged(Path::new(depot.address()).join(name), "its summary is cut short", CHECK)
}

/// Candidates of blocks: read from shards, or made of denoised images.
pub(super) struct Candidates {
    pub(super) analysed: Analysed,
    /// What analyses, and the plan that candidates are cut by.
    pub(super) compressor: Compressor,
    /// The denoised images, unless shards have the candidates.
    made_of: Option<DenoisedSource>,
}

impl Candidates {
    /// The summary of a block's candidate, which is there from then on.
    pub(super) fn take(&self, id: BlockId, block: &mut TracedBlock) -> Result<CandidateSummary> {
        let Some(source) = &self.made_of else { return self.analysed.summary(id) };
        let make = |id: BlockId, block: &mut TracedBlock| source.read_block(id, block).map(|()| 0);
        Ok(self.analysed.take(&self.compressor, id, block, &make)?.0)
    }
}

impl Unit<'_> {
    fn blocks(&self) -> u32 {
        self.terms.job.shape.block_count()
    }

    /// The shards of an earlier round that have one of these blocks or places, which ascend.
    fn shards(&self, round: Round, wanted: &[u32]) -> Result<ShardSet> {
        let rounds = Round::all(self.terms.options.denoise);
        let number = rounds.iter().position(|&other| other == round).unwrap_or_default();
        open_shards(self.depot, &self.reduction.shards_with(number, wanted), self.blocks())
    }

    /// The compressor's plan, with what the denoised picture says.
    pub(super) fn plan(&self) -> Result<CompressorPlan> {
        let Terms { job, options, .. } = self.terms;
        let plan = plan_of(job, options)?;
        Ok(match &self.reduction.fit {
            Some(fit) => plan.for_lights_alone(&job.basis, &fit.brightness),
            None => plan,
        })
    }

    /// Threads that stay within the memory while blocks are analysed or coded.
    fn threads(&self, work: &str, plan: &CompressorPlan) -> Result<Threads> {
        let Terms { job, options, .. } = self.terms;
        let need = need_of(plan, job.shape, ResourceEstimate::of(&[]), options.denoised(job));
        self.threads_of(work, need)
    }

    fn threads_of(&self, work: &str, need: ResourceEstimate) -> Result<Threads> {
        let places = Held(160 * u64::from(self.blocks()));
        let need = need.and(&[&places, &Held(HELD_OBJECTS * self.depot.held_bytes())]);
        Threads::new(need.threads_within(&format!("{work} {}", self.depot.address()), self.terms.options.memory_bytes)?)
    }

    /// Candidates of these blocks, which ascend. `records` are those of an earlier analysis, or empty; `plan` is [`plan`](Self::plan).
    pub(super) fn candidates(
        &self,
        blocks: &[BlockId],
        records: ContinuationFile,
        plan: CompressorPlan,
    ) -> Result<Candidates> {
        let job = &self.terms.job;
        let keys: Vec<u32> = blocks.iter().map(|id| id.0).collect();
        let traced = Records::Shards(self.shards(Round::Trace, &keys)?);
        let compressor = plan.for_blocks()?;
        let Some(fit) = &self.reduction.fit else {
            return Ok(Candidates { analysed: Analysed { records: traced }, compressor, made_of: None });
        };
        let picture = PictureWindows::of(job.shape);
        let mut places: Vec<u32> = blocks.iter().map(|&id| picture.place(id)).collect();
        places.sort_unstable();
        let images = Records::Shards(self.shards(Round::Clean, &places)?);
        let path = Path::new(self.depot.address());
        let source = DenoisedSource::of_images(job, path, [traced, images], fit.map.clone())?;
        Ok(Candidates { analysed: Analysed { records: Records::File(records) }, compressor, made_of: Some(source) })
    }

    /// File for the candidates of a range: one that is kept between analysis and coding, if there is room for it, or one that vanishes.
    fn candidate_file(&self, range: &Range<u32>, plan: &CompressorPlan) -> Result<(ContinuationFile, bool)> {
        let blocks = self.blocks();
        if let Some(keep) = self.folders.keep.filter(|_| self.terms.options.denoise) {
            let of_analysis = fingerprint_of(&hex(&self.terms.fingerprint), Round::Analyse, &self.analysis_hash());
            let path = keep.join(range_prefix(&of_analysis, range) + "candidates");
            let needed = 2 * range.len() as u64 * plan.factor_bytes();
            let has_room = || free_bytes(keep).is_ok_and(|free| free > needed);
            // One that is there has its room.
            let is_there = spill_path(&path).exists();
            // Another process may hold it, which does the same work.
            if (is_there || has_room())
                && let Ok(file) = open_spill(&path, self.terms.fingerprint, blocks, true)
            {
                return Ok((file, true));
            }
        }
        Ok((scratch_file(self.folders.scratch, blocks)?.1, false))
    }

    /// What tells the denoised pictures of a plan apart: the names of their shards.
    fn analysis_hash(&self) -> String {
        self.reduction.shards.iter().take(2).flatten().map(String::as_str).collect()
    }

    fn head(&self, round: Round, blocks: &Range<u32>, parts: u32) -> ShardHead {
        let Terms { job, fingerprint, .. } = self.terms;
        let fingerprint = hash_of(&hex(fingerprint), round, self.reduction_hash);
        ShardHead { job: job.hash().0, fingerprint, blocks: blocks.clone(), parts, rays: 0, non_finite: 0 }
    }

    fn publish(&self, begun: Instant, head: &ShardHead, content: &ShardContent<'_>) -> Result<BuildReport> {
        let name = publish(head, content, self.depot)?;
        Ok(BuildReport { name, seconds: begun.elapsed().as_secs_f64(), rays: 0, non_finite: 0 })
    }

    /// Denoises a window.
    ///
    /// # Errors
    /// Those of reading shards, of the disk and of the depot; [`Error::Interrupted`], with nothing kept.
    pub(super) fn clean(&self, places: &Range<u32>, watch: &dyn Progress) -> Result<BuildReport> {
        let begun = Instant::now();
        let (job, blocks) = (&self.terms.job, self.blocks());
        let terms = self.reduction.guides.clone().unwrap_or_default();
        let GuideTerms { direct, indirect, mean_light } = terms;
        let guides = Guides::of_parts(Clusters::of_basis(&job.basis).count(), [direct, indirect]);
        let guides = guides.ok_or_else(|| Error::damaged(self.depot.address(), "its guides are none", CHECK))?;
        let window = PictureWindows::of(job.shape).blocks(places).to_vec();
        let across = window.iter().map(|id| id.0 % job.shape.blocks_across());
        let across = across.clone().max().unwrap_or(0) + 1 - across.min().unwrap_or(0);
        let need = DenoisedSource::need_of_windows(job, ResourceEstimate::of(&[]), across);
        let threads = self.threads_of("cleaning", need)?;
        let read: Vec<u32> = blocks_read(job.shape, places).iter().map(|id| id.0).collect();
        let traced = Records::Shards(self.shards(Round::Trace, &read)?);
        let (path, images) = scratch_file(self.folders.scratch, blocks)?;
        let source = DenoisedSource::of_window(job, &path, places, [traced, Records::File(images)], guides)?;
        let work = || -> Result<Vec<u8>> {
            source.filter(&threads, watch)?;
            let sums = source.window_sums(window.iter().copied(), mean_light, || go_on(watch, NOTHING_KEPT))?;
            Ok(sums.to_bytes())
        };
        let summary = work().map_err(nothing_kept)?;
        let Records::File(images) = source.into_images() else { unreachable!("they were made here") };
        let head = self.head(Round::Clean, places, 1);
        let extension = Round::Clean.extension();
        let content = ShardContent { records: &images, stride: blocks, first: 0, summary: &summary, extension };
        self.publish(begun, &head, &content)
    }

    /// Analyses a range of denoised blocks, and keeps a summary of each.
    ///
    /// # Errors
    /// As [`clean`](Self::clean).
    pub(super) fn analyse(&self, range: &Range<u32>, watch: &dyn Progress) -> Result<BuildReport> {
        let begun = Instant::now();
        let plan = self.plan()?;
        let threads = self.threads("analysing", &plan)?;
        let blocks: Vec<BlockId> = range.clone().map(BlockId).collect();
        let (file, _) = self.candidate_file(range, &plan)?;
        let candidates = self.candidates(&blocks, file, plan)?;
        let (_, summaries) = scratch_file(self.folders.scratch, range.len() as u32)?;
        watch.begin("analysing", blocks.len() as u64, "blocks");
        let analyse = |block: &mut TracedBlock, &id: &BlockId| -> Result<()> {
            go_on(watch, NOTHING_KEPT)?;
            let summary = candidates.take(id, block)?;
            summaries.append(id.0 - range.start, &[&summary.to_bytes()])?;
            watch.advance(1, 0, "B");
            Ok(())
        };
        let done = threads.run(|| blocks.par_iter().try_for_each_init(TracedBlock::default, analyse));
        watch.end();
        done?;
        let (head, extension) = (self.head(Round::Analyse, range, 1), Round::Analyse.extension());
        let (stride, first) = (range.len() as u32, range.start);
        self.publish(begun, &head, &ShardContent { records: &summaries, stride, first, summary: &[], extension })
    }

    /// Cuts and codes a range of blocks.
    ///
    /// # Errors
    /// As [`clean`](Self::clean).
    pub(super) fn code(&self, range: &Range<u32>, watch: &dyn Progress) -> Result<BuildReport> {
        let begun = Instant::now();
        let job = &self.terms.job;
        let terms = self.reduction.cut_terms(self.depot)?;
        let plan = self.plan()?;
        let threads = self.threads("coding", &plan)?;
        let blocks: Vec<BlockId> = range.clone().map(BlockId).collect();
        let (file, is_kept) = self.candidate_file(range, &plan)?;
        let candidates = self.candidates(&blocks, file, plan)?;
        let encoder = BlockEncoder::new(job, self.terms.options.container.codec.clone());
        let second = SecondPass::new(job, candidates.compressor.plan(), terms.cut);
        let lights = LightErrorSums::new(job.shape.columns(), terms.energy);
        let stride = range.len() as u32;
        let (_, layers) = scratch_file(self.folders.scratch, stride * MAX_LAYERS as u32)?;
        let written = Mutex::new(vec![None; blocks.len()]);
        watch.begin("coding", blocks.len() as u64, "blocks");
        let code = |block: &mut TracedBlock, &id: &BlockId| -> Result<()> {
            go_on(watch, NOTHING_KEPT)?;
            candidates.take(id, block)?;
            let coded = second.code(id, &candidates.analysed, &encoder)?;
            lights.add(&coded.columns);
            let at = id.0 - range.start;
            for (layer, bytes) in (0..).zip(coded.encoded.layers()) {
                layers.append(layer * stride + at, &[bytes])?;
            }
            let block = CodedRecord { written: coded.written, layers: coded.encoded.layers().len() as u32 };
            written.lock().unwrap_or_else(PoisonError::into_inner)[at as usize] = Some(block);
            watch.advance(1, coded.encoded.size().bytes() as u64, "B");
            Ok(())
        };
        let done = threads.run(|| blocks.par_iter().try_for_each_init(TracedBlock::default, code));
        watch.end();
        done?;
        let written = written.into_inner().unwrap_or_else(PoisonError::into_inner);
        let written: Vec<CodedRecord> = written.into_iter().flatten().collect();
        let parts = written.iter().map(|block| block.layers).max().unwrap_or(0).max(1);
        for key in (0..parts * stride).filter(|&key| !layers.has(key)) {
            layers.append(key, &[])?;
        }
        let mut summary: Vec<u8> = written.iter().flat_map(|block| block.to_bytes()).collect();
        summary.extend(lights.to_bytes());
        let (head, extension) = (self.head(Round::Code, range, parts), Round::Code.extension());
        let content = ShardContent { records: &layers, stride, first: range.start, summary: &summary, extension };
        let report = self.publish(begun, &head, &content)?;
        if is_kept {
            candidates.analysed.records.remove()?;
        }
        Ok(report)
    }
}

/// What is known of a coded block beside its layers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CodedRecord {
    pub(super) written: WrittenBlock,
    pub(super) layers: u32,
}

impl CodedRecord {
    pub(super) const BYTES: usize = 7 * size_of::<u64>();

    fn to_bytes(self) -> [u8; Self::BYTES] {
        let WrittenBlock { rank, sparse_entries, report } = self.written;
        let BlockReport { squared_error, squared_norm, noise_variance, uniform_error } = report;
        let numbers = [u64::from(self.layers), rank as u64, sparse_entries as u64];
        let values = [squared_error, squared_norm, noise_variance, uniform_error].map(f64::to_bits);
        let mut bytes = [0; Self::BYTES];
        for (to, from) in bytes.chunks_exact_mut(8).zip(numbers.into_iter().chain(values)) {
            to.copy_from_slice(&from.to_le_bytes());
        }
        bytes
    }

    pub(super) fn of(bytes: &[u8; Self::BYTES]) -> Self {
        let word = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| bytes[8 * at + i]));
        let value = |at: usize| f64::from_bits(word(at));
        let report = BlockReport {
            squared_error: value(3),
            squared_norm: value(4),
            noise_variance: value(5),
            uniform_error: value(6),
        };
        let written = WrittenBlock { rank: word(1) as usize, sparse_entries: word(2) as usize, report };
        Self { written, layers: word(0) as u32 }
    }
}

const NOTHING_KEPT: &str = "nothing is kept of the unit";

/// The error of a job that would keep a file, where that vanishes.
fn nothing_kept(error: Error) -> Error {
    match error {
        Error::Interrupted { .. } => Error::interrupted(NOTHING_KEPT),
        other => other,
    }
}
