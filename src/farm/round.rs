//! The rounds of a farm, and what stands between two of them.

use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;
use sha2::{Digest, Sha256};

use crate::blob_store::BlobStore;
use crate::block_records::{Shard, hex, plan_prefix, range_prefix};
use crate::compress::Cut;
use crate::denoise::PictureWindows;
use crate::encoding::{Decode, Encode, decode, encode};
use crate::error::{Error, Result};
use crate::light::{DenoiseErrors, DenoisedLight};
use crate::matrix::MatrixShape;
use crate::pipeline::ReplacedEntries;

/// Extension of the names of what stands between rounds.
const REDUCED: &str = ".reduced";
/// What helps against a shard, or what stands before a round, that was changed.
pub(super) const CHECK: &str = "have all shards checked, then build again what is missing";

/// A round of units of work that do not know of each other. All units of a round are done before the next begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Round {
    /// Ranges of blocks are traced: with denoising its inputs are gathered, without it the blocks are analysed.
    Trace,
    /// Windows of the picture are denoised, from the inputs of their blocks and of those around them.
    Clean,
    /// Ranges of denoised blocks are analysed, of which a summary is kept.
    Analyse,
    /// Ranges of blocks are cut at the common slope and coded.
    Code,
}

impl Round {
    /// The rounds of a job with or without denoising.
    pub(super) fn all(denoise: bool) -> &'static [Self] {
        if denoise { &[Self::Trace, Self::Clean, Self::Analyse, Self::Code] } else { &[Self::Trace, Self::Code] }
    }

    /// All of them by their names.
    pub const NAMES: [(&'static str, Self); 4] =
        [("trace", Self::Trace), ("clean", Self::Clean), ("analyse", Self::Analyse), ("code", Self::Code)];

    /// Its name in command lines and files.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, round)| *round == self).map_or("", |(name, _)| name)
    }

    /// The round of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::NAMES.iter().find(|(other, _)| *other == name).map(|&(_, round)| round)
    }

    /// Its units for a matrix of this shape, of which these are the ranges of the plan: places of windows for [`Round::Clean`], else
    /// blocks.
    pub fn units(self, shape: MatrixShape, ranges: &[Range<u32>]) -> Vec<Range<u32>> {
        if self == Self::Clean { windows(shape) } else { ranges.to_vec() }
    }

    /// Extension of the names of its shards.
    pub(super) fn extension(self) -> &'static str {
        match self {
            Self::Trace => ".shard",
            Self::Clean => ".images",
            Self::Analyse => ".summaries",
            Self::Code => ".coded",
        }
    }
}

/// The windows of a picture that are denoised as one unit each, as ranges of places.
pub fn windows(shape: MatrixShape) -> Vec<Range<u32>> {
    PictureWindows::of(shape).ranges()
}

/// What the units of a round need to know of all units before: the smallest part of it that no unit knows by itself.
#[derive(Clone, Debug, Default, PartialEq, Encode, Decode)]
pub(super) struct Reduction {
    /// For each round that is done the names of its shards, in the order of their blocks.
    pub(super) shards: Vec<Vec<String>>,
    pub(super) guides: Option<GuideTerms>,
    pub(super) fit: Option<FitTerms>,
    pub(super) cut: Option<CutTerms>,
}

/// What denoising compares pixels by, and weighs tiles by.
#[derive(Clone, Debug, Default, PartialEq, Encode, Decode)]
pub(super) struct GuideTerms {
    pub(super) direct: Vec<f32>,
    pub(super) indirect: Vec<f32>,
    pub(super) mean_light: f64,
}

/// What the denoised picture says of all blocks.
#[derive(Clone, Debug, Default, PartialEq, Encode, Decode)]
pub(super) struct FitTerms {
    pub(super) map: Vec<f32>,
    pub(super) brightness: Vec<f64>,
    pub(super) errors: Option<(DenoiseErrors, Vec<DenoisedLight>)>,
}

/// The slope that was chosen for all blocks.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub(super) struct CutTerms {
    pub(super) cut: Cut,
    /// Energy of all blocks.
    pub(super) energy: f64,
    pub(super) replaced: ReplacedEntries,
}

/// Name prefix of what stands before a round of a plan.
fn reduction_prefix(fingerprint: &str, round: Round) -> String {
    format!("{}{}-", plan_prefix(fingerprint), round.name())
}

/// Hash of what the shards of a round after the first are made from. It takes up what stood before the round, so that shards made from
/// something else are never found.
pub(super) fn hash_of(plan: &str, round: Round, reduction: &str) -> [u8; 32] {
    let mut hash = Sha256::new();
    [plan, round.name(), reduction].iter().for_each(|text| hash.update(text));
    hash.finalize().into()
}

/// Hash of what a round's shards are made from, in hexadecimal digits: of the first round the plan's, of later ones [`hash_of`].
pub(super) fn fingerprint_of(plan: &str, round: Round, reduction: &str) -> String {
    if round == Round::Trace { plan.to_owned() } else { hex(&hash_of(plan, round, reduction)) }
}

/// What stands before a round, by its name in the depot.
#[derive(Clone, Debug)]
pub(super) struct NamedReduction {
    /// SHA-256 of the content, in hexadecimal digits.
    pub(super) hash: String,
    pub(super) content: Reduction,
}

/// Hashes of what stands before a round, for the names that a depot has.
pub(super) fn reductions(plan: &str, round: Round, depot: &BlobStore) -> Result<Vec<String>> {
    let prefix = reduction_prefix(plan, round);
    let names = depot.names(&prefix)?;
    let hash = |name: &String| Some(name.strip_prefix(&prefix)?.strip_suffix(REDUCED)?.to_owned());
    Ok(names.iter().filter_map(hash).collect())
}

impl Reduction {
    /// Writes what stands before a round into a depot.
    ///
    /// # Errors
    /// The depot cannot be written.
    pub(super) fn put(self, plan: &str, round: Round, depot: &BlobStore) -> Result<NamedReduction> {
        let bytes = encode(&self);
        let hash = hex(&Sha256::digest(&bytes));
        let name = reduction_prefix(plan, round) + &hash + REDUCED;
        depot.put(&name, &|out| out.write_all(&bytes).map_err(Error::io(&name, "write")))?;
        Ok(NamedReduction { hash, content: self })
    }

    /// Reads what stands before a round; `None` where the content is not that of the name.
    ///
    /// # Errors
    /// It cannot be read.
    pub(super) fn read(plan: &str, round: Round, hash: &str, depot: &BlobStore) -> Result<Option<Self>> {
        let name = reduction_prefix(plan, round) + hash + REDUCED;
        let bytes = depot.read(&name)?;
        let is_whole = hex(&Sha256::digest(&bytes)) == hash;
        Ok(decode(&bytes).ok().filter(|_| is_whole).map(|(reduction, _)| reduction))
    }

    /// The slope for all blocks, which the last round and the merge begin with.
    ///
    /// # Errors
    /// None was chosen.
    pub(super) fn cut_terms(&self, depot: &BlobStore) -> Result<CutTerms> {
        self.cut.ok_or_else(|| Error::damaged(depot.address(), "its cut is missing", CHECK))
    }

    /// The names of a round's shards that have one of these blocks or places, which ascend.
    pub(super) fn shards_with(&self, round: usize, wanted: &[u32]) -> Vec<&str> {
        let has = |name: &&String| {
            let Some(range) = range_in(name) else { return false };
            wanted.get(wanted.partition_point(|&key| key < range.start)).is_some_and(|&key| key < range.end)
        };
        self.shards.get(round).into_iter().flatten().filter(has).map(String::as_str).collect()
    }
}

/// The range that stands in the name of a shard.
fn range_in(name: &str) -> Option<Range<u32>> {
    let mut parts = name.split('-').skip(1);
    let mut number = || parts.next()?.parse().ok();
    Some(number()?..number()?)
}

/// What a depot has of a round.
#[derive(Debug, Default)]
pub(super) struct Present {
    /// Of each unit the name of its shard.
    pub(super) chosen: Vec<Option<String>>,
    /// All names of shards of the round but for the damaged ones.
    pub(super) whole: HashSet<String>,
    /// Names of shards whose content is another, where that was looked at.
    pub(super) damaged: Vec<String>,
}

/// The shards of a round that a depot has; with `check` those whose content is that of their name.
///
/// # Errors
/// The depot cannot be read.
pub(super) fn present(
    fingerprint: &str,
    round: Round,
    units: &[Range<u32>],
    depot: &BlobStore,
    check: bool,
) -> Result<Present> {
    // Of one unit only its own shards are listed.
    let prefix = match units {
        [unit] => range_prefix(fingerprint, unit),
        _ => plan_prefix(fingerprint),
    };
    let mut names = depot.names(&prefix)?;
    names.retain(|name| name.ends_with(round.extension()) && range_in(name).is_some());
    let is_whole = |name: &String| -> Result<bool> {
        let place = Path::new(depot.address()).join(name);
        Ok(!check || Shard::verify(&*depot.open_file(name)?, &place, name)?.is_ok())
    };
    let are_whole: Vec<bool> = names.par_iter().map(is_whole).collect::<Result<_>>()?;
    let mut found = Present::default();
    let mut by_range: HashMap<Range<u32>, String> = HashMap::new();
    for (name, is_whole) in names.into_iter().zip(are_whole) {
        match (is_whole, range_in(&name)) {
            (true, Some(range)) => {
                by_range.entry(range).or_insert_with(|| name.clone());
                found.whole.insert(name);
            }
            _ => found.damaged.push(name),
        }
    }
    found.chosen = units.iter().map(|unit| by_range.remove(unit)).collect();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_found_by_the_blocks_in_their_names() {
        let names = ["0123456789abcdef-00000000-00000005-aa.shard", "0123456789abcdef-00000005-00000012-bb.shard"];
        let reduction = Reduction { shards: vec![names.map(str::to_owned).to_vec()], ..Reduction::default() };
        assert_eq!(reduction.shards_with(0, &[4]), names[..1]);
        assert_eq!(reduction.shards_with(0, &[3, 11]), names);
        assert_eq!(reduction.shards_with(0, &[5, 6]), names[1..]);
        assert!(reduction.shards_with(0, &[12]).is_empty());
    }

    #[test]
    fn shards_of_a_round_that_began_from_something_else_have_other_names() {
        let of = |round, reduction| fingerprint_of("plan", round, reduction);
        assert_eq!(of(Round::Trace, "anything"), "plan");
        assert_ne!(of(Round::Clean, "a"), of(Round::Clean, "b"));
        assert_ne!(of(Round::Clean, "a"), of(Round::Code, "a"));
    }
}
