//! A farm's rounds: which units are missing, what is put together between two rounds, and the container in the end.
//!
//! Nobody needs to remember anything: what is done is what lies in the depot. Whoever asks what comes next puts together what the next
//! round needs where all units of a round are there; a second one who asks makes the same of it.

use std::cell::RefCell;
use std::collections::{BTreeMap, HashSet};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use rayon::prelude::*;

use super::job::FarmJob;
use super::publish::{BuildReport, go_on, scratch_file};
use super::round::{
    CutTerms, FitTerms, GuideTerms, NamedReduction, Reduction, Round, fingerprint_of, present, reductions, windows,
};
use super::terms::Terms;
use super::units::{AT_ONCE, CodedRecord, Unit, WorkFolders, damaged_summary, open_shards, summaries};
use crate::blob_store::BlobStore;
use crate::block_records::ShardSet;
use crate::compress::{CandidateSummary, LightErrorSums, Target};
use crate::container::{BlockEncoder, WrittenBlock, write_encoded_blocks};
use crate::denoise::{ColumnUpsampler, GuideStatistics, PictureFit, PictureSums, WindowSums, mean_of};
use crate::error::{Error, Result};
use crate::light::Clusters;
use crate::matrix::{BlockId, TracedBlock};
use crate::pipeline::{PackReport, PackedBlocks, ReplacedEntries, Sizing, check_container_output, energy_of, need_of};
use crate::resources::{Held, Progress, ResourceEstimate, Threads, hold_to_memory};
use crate::trace::Tracer;

/// Shards of which sections are fetched at once while the container is written.
const SECTIONS_AT_ONCE: usize = 32;
/// What is left of a merge that stops.
const SHARDS_KEPT: &str = "the shards are kept";

/// What is to be done with a job.
pub enum Next {
    /// Units of this round, by their numbers, which are not in the depot; of so many in all.
    Build {
        /// The round.
        round: Round,
        /// Numbers of the units.
        units: Vec<usize>,
        /// Units of the round.
        of: usize,
        /// Names of shards whose content is not that of their name.
        damaged: Vec<String>,
    },
    /// All rounds are done.
    Merge(Box<CodedShards>),
}

/// The coded blocks of a job in a depot.
pub struct CodedShards {
    names: Vec<String>,
    reduction: Reduction,
}

/// Name of the shard of a unit in the depot, if it is there, for the plan with this fingerprint; by looks at names only, unless `check`
/// asks to verify the content.
///
/// # Errors
/// The depot cannot be read.
pub fn find_unit(
    plan: &str,
    round: Round,
    unit: &Range<u32>,
    depot: &BlobStore,
    check: bool,
) -> Result<Option<String>> {
    let reduction = match round {
        Round::Trace => String::new(),
        _ => match reductions(plan, round, depot)?.into_iter().next() {
            Some(hash) => hash,
            None => return Ok(None),
        },
    };
    let found = present(&fingerprint_of(plan, round, &reduction), round, std::slice::from_ref(unit), depot, check)?;
    Ok(found.chosen.into_iter().flatten().next())
}

impl FarmJob {
    /// The rounds that the job is built in.
    pub fn rounds(&self) -> &'static [Round] {
        Round::all(self.denoises())
    }

    /// The units of a round, for these ranges of the plan: see [`Round::units`].
    pub fn units(&self, round: Round, ranges: &[Range<u32>]) -> Vec<Range<u32>> {
        round.units(self.terms.job.shape, ranges)
    }

    /// Does a unit of a round, and leaves its shard in the depot.
    ///
    /// # Errors
    /// A unit that the round has not; [`Error::Incomplete`] where the round before is not done; those of reading and writing the depot
    /// and of the disk; [`Error::Interrupted`], with nothing kept.
    pub fn build_unit(
        self,
        round: Round,
        unit: Range<u32>,
        depot: &Arc<BlobStore>,
        folders: WorkFolders<'_>,
        watch: &dyn Progress,
    ) -> Result<BuildReport> {
        if round == Round::Trace {
            return self.build(unit, depot, folders.scratch, watch);
        }
        let count = self.terms.job.shape.block_count();
        let is_window = || windows(self.terms.job.shape).contains(&unit);
        let is_unit = unit.start < unit.end && unit.end <= count && (round != Round::Clean || is_window());
        if !is_unit || !self.rounds().contains(&round) {
            let problem = format!("has no unit {}..{} in round {}", unit.start, unit.end, round.name());
            return Err(Error::input("the matrix", problem, "take those that are listed as missing"));
        }
        let plan = self.fingerprint();
        let mut reduction = None;
        for hash in reductions(&plan, round, depot)? {
            if let Some(content) = Reduction::read(&plan, round, &hash, depot)? {
                reduction = Some(NamedReduction { hash, content });
                break;
            }
        }
        let Some(reduction) = reduction else {
            return Err(Error::Incomplete {
                place: depot.address().to_owned(),
                missing: format!("what round {} begins with is not there", round.name()),
                hint: "ask what is missing, which makes it or lists the units".into(),
            });
        };
        let work =
            Unit { terms: &self.terms, reduction: &reduction.content, reduction_hash: &reduction.hash, depot, folders };
        match round {
            Round::Clean => work.clean(&unit, watch),
            Round::Analyse => work.analyse(&unit, watch),
            _ => work.code(&unit, watch),
        }
    }

    /// What comes next. Where a round is done, what the next one begins with is put together and left in the depot. With `check` the
    /// content of all shards is held to their names.
    ///
    /// # Errors
    /// Ranges that are not all blocks in order; those of the depot and of choosing the slope; [`Error::Interrupted`].
    pub fn next(
        &self,
        ranges: &[Range<u32>],
        depot: &Arc<BlobStore>,
        check: bool,
        watch: &dyn Progress,
    ) -> Result<Next> {
        let (plan, shape) = (self.fingerprint(), self.terms.job.shape);
        let begins = std::iter::once(0).chain(ranges.iter().map(|range| range.end));
        let follow = ranges.iter().zip(begins).all(|(range, begin)| range.start == begin && range.end > begin);
        if !follow || ranges.last().is_none_or(|last| last.end != shape.block_count()) {
            let problem = "its ranges are not all blocks in order";
            return Err(Error::input("the plan", problem, "make the plan again"));
        }
        let mut reduction = NamedReduction { hash: String::new(), content: Reduction::default() };
        for (number, &round) in self.rounds().iter().enumerate() {
            let units = self.units(round, ranges);
            let found = present(&fingerprint_of(&plan, round, &reduction.hash), round, &units, depot, check)?;
            let missing: Vec<usize> = (0..units.len()).filter(|&unit| found.chosen[unit].is_none()).collect();
            if !missing.is_empty() {
                return Ok(Next::Build { round, units: missing, of: units.len(), damaged: found.damaged });
            }
            let names: Vec<String> = found.chosen.into_iter().flatten().collect();
            let Some(&next) = self.rounds().get(number + 1) else {
                return Ok(Next::Merge(Box::new(CodedShards { names, reduction: reduction.content })));
            };
            reduction = match self.reduction_there(next, &reduction.content, &found.whole, depot)? {
                Some(there) => there,
                None => self.reduce(round, names, reduction, depot, watch)?.put(&plan, next, depot)?,
            };
        }
        unreachable!("the last round has none after it")
    }

    /// What stands before a round already, of shards that are there.
    fn reduction_there(
        &self,
        round: Round,
        before: &Reduction,
        there: &HashSet<String>,
        depot: &BlobStore,
    ) -> Result<Option<NamedReduction>> {
        let plan = self.fingerprint();
        for hash in reductions(&plan, round, depot)? {
            let Some(content) = Reduction::read(&plan, round, &hash, depot)? else { continue };
            let earlier = before.shards.len();
            let goes_on = content.shards.len() == earlier + 1 && content.shards[..earlier] == before.shards;
            if goes_on && content.shards[earlier].iter().all(|name| there.contains(name)) {
                return Ok(Some(NamedReduction { hash, content }));
            }
        }
        Ok(None)
    }

    /// Puts together what a round that is done gives to the next.
    fn reduce(
        &self,
        round: Round,
        names: Vec<String>,
        before: NamedReduction,
        depot: &Arc<BlobStore>,
        watch: &dyn Progress,
    ) -> Result<Reduction> {
        let (blocks, columns) = (u64::from(self.terms.job.shape.block_count()), self.terms.job.shape.columns() as u64);
        let clusters = Clusters::of_basis(&self.terms.job.basis).count() as u64;
        // Sums of a window for the fit of columns, or a few kilobytes for each block.
        let sums = if clusters < columns { ColumnUpsampler::needs_bytes(clusters, columns) } else { 0 };
        let held = 8192 * blocks + AT_ONCE as u64 * (2 * sums + depot.held_bytes());
        hold_to_memory("what follows from a round", held, self.terms.options.memory_bytes)?;
        let mut reduction = before.content;
        reduction.shards.push(names);
        let names = reduction.shards.last().cloned().unwrap_or_default();
        watch.begin(&format!("after round {}", round.name()), names.len() as u64, "shards");
        let reduced = match round {
            Round::Trace if self.denoises() => {
                self.guides(&names, depot, watch).map(|guides| reduction.guides = Some(guides))
            }
            Round::Clean => self.fit(&names, depot, watch).map(|PictureFit { map, brightness, errors }| {
                reduction.fit = Some(FitTerms { map, brightness, errors });
            }),
            _ => {
                let unit = Unit {
                    terms: &self.terms,
                    reduction: &reduction,
                    reduction_hash: &before.hash,
                    depot,
                    folders: WorkFolders::default(),
                };
                // Of blocks that were traced and analysed at once, the summary is the second record.
                let part = u32::from(round == Round::Trace);
                cut(&unit, &names, part, watch).map(|cut| reduction.cut = Some(cut))
            }
        };
        watch.end();
        reduced.map(|()| reduction)
    }

    fn guides(&self, names: &[String], depot: &BlobStore, watch: &dyn Progress) -> Result<GuideTerms> {
        let job = &self.terms.job;
        let clusters = Clusters::of_basis(&job.basis).count();
        let (mut tally, mut lights) = (GuideStatistics::new(clusters), Vec::new());
        summaries(depot, names, |name, head, summary| {
            let damaged = || damaged_summary(depot, name);
            let (own, rest) = GuideStatistics::from_bytes(clusters, summary).ok_or_else(damaged)?;
            if rest.len() != size_of::<f64>() * head.blocks.len() {
                return Err(damaged());
            }
            tally.merge(&own);
            let values = rest.as_chunks::<{ size_of::<f64>() }>().0.iter().map(|bytes| f64::from_ne_bytes(*bytes));
            lights.extend(head.blocks.map(BlockId).zip(values));
            watch.advance(1, summary.len() as u64, "B");
            Ok(())
        })?;
        let guides = tally.guides();
        let [direct, indirect] = guides.parts().map(<[f32]>::to_vec);
        let mean_light = match clusters < job.shape.columns() {
            true => mean_of(job.shape, clusters, lights.into_iter()),
            false => 0.0,
        };
        Ok(GuideTerms { direct, indirect, mean_light })
    }

    fn fit(&self, names: &[String], depot: &BlobStore, watch: &dyn Progress) -> Result<PictureFit> {
        let job = &self.terms.job;
        let mut sums = PictureSums::new(job);
        summaries(depot, names, |name, head, summary| {
            let own: Option<WindowSums> = sums.window_of(head.blocks.len(), summary);
            sums.add(&head.blocks, own.ok_or_else(|| damaged_summary(depot, name))?);
            watch.advance(1, summary.len() as u64, "B");
            Ok(())
        })?;
        Ok(sums.fit(&job.basis))
    }

    /// Makes the container of coded blocks: byte for byte that of [`render_packed`](crate::pipeline::render_packed).
    ///
    /// # Errors
    /// Those of the depot and of the container; so little is left of a light that it is not wanted; [`Error::Interrupted`].
    pub fn assemble(
        self,
        coded: &CodedShards,
        depot: &Arc<BlobStore>,
        path: &Path,
        watch: &dyn Progress,
    ) -> Result<PackReport> {
        let begun = Instant::now();
        let measuring = self.measuring_need();
        let Terms { mut job, options, .. } = self.terms;
        check_container_output(path, options.container.overwrite)?;
        measuring.threads_within("merging", options.memory_bytes)?;
        let max_depth = self.loaded.settings.max_depth;
        job.basis.set_column_scales(Tracer::measure_column_scales(self.loaded.scene, max_depth)?)?;
        let CodedShards { names, reduction } = coded;
        let terms = reduction.cut_terms(depot)?;
        let lights = LightErrorSums::new(job.shape.columns(), terms.energy);
        let mut blocks: Vec<(WrittenBlock, usize)> = Vec::new();
        let mut firsts = Vec::new();
        watch.begin("merging", 2 * names.len() as u64, "shards");
        let read = summaries(depot, names, |name, head, summary| {
            let damaged = || damaged_summary(depot, name);
            let records = summary.split_at_checked(CodedRecord::BYTES * head.blocks.len()).ok_or_else(damaged)?;
            let coded = records.0.as_chunks::<{ CodedRecord::BYTES }>().0.iter().map(CodedRecord::of);
            firsts.push(head.blocks.start);
            blocks.extend(coded.map(|block| (block.written, block.layers as usize)));
            lights.add_bytes(records.1).ok_or_else(damaged)?;
            watch.advance(1, summary.len() as u64, "B");
            go_on(watch, SHARDS_KEPT)
        });
        let packed = read.and_then(|()| {
            let stored = blocks.iter().map(|(written, _)| *written).collect();
            let denoising = reduction.fit.as_ref().and_then(|fit| fit.errors.clone());
            let packed = PackedBlocks { cut: terms.cut, replaced: terms.replaced, stored, denoising, exposed: None };
            let whole = packed.conclude(&job, &options.compress, &lights);
            whole.check_lights(path, options.allow_lost_lights)?;
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            let sections = Sections {
                set: open_shards(depot, &names, job.shape.block_count())?,
                firsts,
                layers: blocks.iter().map(|(_, layers)| *layers).collect(),
                fetched: RefCell::default(),
                watch,
            };
            let chunk = |id: BlockId, layer: usize| sections.chunk(id, layer);
            let container = options.container_options();
            let summary = write_encoded_blocks(path, &job, &container, &whole.errors, &blocks, chunk)?;
            Ok(whole.report(&job, &summary, begun.elapsed().as_secs_f64()))
        });
        watch.end();
        packed
    }
}

/// The slope for all blocks, from their summaries.
fn cut(unit: &Unit<'_>, names: &[String], part: u32, watch: &dyn Progress) -> Result<CutTerms> {
    let Terms { job, options, .. } = unit.terms;
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let blocks = job.shape.block_count();
    let set = open_shards(unit.depot, &names, blocks)?;
    let read = |id: u32| -> Result<CandidateSummary> {
        let key = part * blocks + id;
        CandidateSummary::from_bytes(&set.read(key)?).map_err(|problem| set.damaged(key, &problem))
    };
    let mut analysed = Vec::with_capacity(blocks as usize);
    let each = (blocks as usize).div_ceil(names.len().max(1));
    for few in (0..blocks).collect::<Vec<_>>().chunks(each.max(1)) {
        go_on(watch, SHARDS_KEPT)?;
        analysed.extend(few.par_iter().map(|&id| read(id)).collect::<Result<Vec<_>>>()?);
        watch.advance(1, 0, "B");
    }
    let plan = unit.plan()?;
    let encoder = BlockEncoder::new(job, options.container.codec.clone());
    let report = options.container_options().report;
    let sizing = Sizing { job, report: &report, encoder: &encoder };
    let second = match options.compress.target {
        // The candidates of some blocks are coded to know how large the file becomes.
        Target::Bytes(_) => {
            let sample = Sizing::sample(job.shape);
            let need = need_of(&plan, job.shape, ResourceEstimate::of(&[]), options.denoised(job));
            let need = need.and(&[&Held(2 * unit.depot.held_bytes())]);
            let threads = Threads::new(need.threads_within("choosing the slope", options.memory_bytes)?)?;
            let candidates = unit.candidates(&sample, scratch_file(None, blocks)?.1, plan)?;
            let take = |block: &mut TracedBlock, id: &BlockId| candidates.take(*id, block).map(drop);
            threads.run(|| {
                sample.par_iter().try_for_each_init(TracedBlock::default, take)?;
                sizing.second_pass(candidates.compressor.plan(), &analysed, &|id| Ok(candidates.analysed.read(id)?.0))
            })?
        }
        _ => sizing.second_pass(&plan, &analysed, &|id| Err(set.damaged(id.0, "no candidate is wanted")))?,
    };
    let ids: Vec<BlockId> = job.shape.blocks().collect();
    let replaced = ReplacedEntries::of(&analysed, &ids);
    if replaced.count() > 0 {
        watch.note(&format!("{}: {replaced}", unit.depot.address()));
    }
    Ok(CutTerms { cut: second.cut, energy: energy_of(&analysed), replaced })
}

/// Layers of coded blocks, in the order of a container: those of several shards are fetched at once.
struct Sections<'a> {
    set: ShardSet,
    /// First block of each shard.
    firsts: Vec<u32>,
    /// Layers of each block.
    layers: Vec<usize>,
    fetched: RefCell<BTreeMap<u32, Vec<u8>>>,
    watch: &'a dyn Progress,
}

impl Sections<'_> {
    /// A layer of a block.
    fn chunk(&self, id: BlockId, layer: usize) -> Result<Vec<u8>> {
        if let Some(bytes) = self.fetched.borrow_mut().remove(&id.0) {
            return Ok(bytes);
        }
        go_on(self.watch, SHARDS_KEPT)?;
        let blocks = self.layers.len() as u32;
        let shard = self.firsts.partition_point(|&first| first <= id.0).saturating_sub(1);
        let end = self.firsts.get(shard + SECTIONS_AT_ONCE).copied().unwrap_or(blocks);
        let wanted: Vec<u32> = (id.0..end).filter(|&block| layer < self.layers[block as usize]).collect();
        let set = &self.set;
        let fetch = |&block: &u32| -> Result<(u32, Vec<u8>)> { Ok((block, set.read(layer as u32 * blocks + block)?)) };
        let mut fetched: BTreeMap<u32, Vec<u8>> = wanted.par_iter().map(fetch).collect::<Result<_>>()?;
        if layer == 0 {
            self.watch.advance(SECTIONS_AT_ONCE.min(self.firsts.len() - shard) as u64, 0, "B");
        }
        let chunk = fetched.remove(&id.0).unwrap_or_default();
        *self.fetched.borrow_mut() = fetched;
        Ok(chunk)
    }
}
