//! `ltm build`, and `ltm merge --plan`.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use ltm::blob_store::BlobStore;
use ltm::farm::{FarmJob, Next, Round, Shards, WorkFolders, find_unit};
use ltm::files::check_output;
use ltm::resources::{Progress, parse_bytes};
use ltm::{Error, Result};

use crate::maintain::Merge;
use crate::plan::Planned;
use crate::render::print_packed;
use ltm_cli::console::Console;
use ltm_cli::{names, say};

#[derive(Args)]
pub(crate) struct Build {
    /// The plan, as ltm plan wrote it.
    #[arg(long)]
    plan: PathBuf,
    /// Blocks to trace, FIRST..END.
    #[arg(long, value_parser = crate::render::parse_range, required_unless_present = "range", conflicts_with = "round")]
    blocks: Option<Range<u32>>,
    /// The range of the plan of this number, from 0; in the round clean the window of this number.
    #[arg(long, conflicts_with = "blocks")]
    range: Option<usize>,
    /// The round whose unit it is, as ltm merge --rounds lists it.
    #[arg(long, value_parser = round_parser(), default_value = "trace")]
    round: Round,
    /// The place for the shards: a folder, or s3://BUCKET/PREFIX.
    #[arg(long)]
    out: String,
    /// The scene file, where it does not lie where the plan says.
    #[arg(long)]
    scene: Option<PathBuf>,
    /// Read a shard that is there, and build the range again where its bytes have changed.
    #[arg(long)]
    check: bool,
    /// Folder for what is built until it is whole [default: the system's for such files].
    #[arg(long)]
    scratch: Option<PathBuf>,
    /// Folder that keeps what the round analyse makes of blocks until they are coded: coding on this machine is shorter then.
    #[arg(long)]
    keep: Option<PathBuf>,
    /// Memory to stay within, for example 1GiB [default: what the system has].
    #[arg(long, value_parser = parse_bytes)]
    memory: Option<u64>,
}

/// Reads the name of a round.
fn round_parser() -> impl TypedValueParser<Value = Round> {
    let names = PossibleValuesParser::new(Round::NAMES.map(|(name, _)| name));
    names.try_map(|name| Round::named(&name).ok_or("it is no round"))
}

/// How missing ranges are listed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Listing {
    /// A line for each range of the plan, FIRST..END; with --rounds for each unit, its round and its number.
    Ranges,
    /// Numbers of the plan's ranges as one line, 0-3,7: what Slurm's --array takes. With --rounds the round stands before them.
    Array,
}

pub(crate) fn build(options: &Build, console: &Console) -> Result<()> {
    let plan = Planned::read(&options.plan)?;
    let round = options.round;
    let unit = match (&options.blocks, options.range) {
        (Some(blocks), _) => blocks.clone(),
        (None, number) => {
            let (number, units) = (number.unwrap_or_default(), plan.units(round)?);
            units.get(number).cloned().ok_or_else(|| {
                let problem =
                    format!("has {} units in round {}, and none of number {number}", units.len(), round.name());
                Error::input(options.plan.display().to_string(), problem, "numbers begin at 0")
            })?
        }
    };
    let said = match round {
        Round::Trace => format!("{}..{}", unit.start, unit.end),
        _ => format!("{} {}..{}", round.name(), unit.start, unit.end),
    };
    let depot = Arc::new(BlobStore::open(&options.out)?);
    // Before the scene is loaded: a unit that is there costs a look or two.
    if let Some(name) = find_unit(&plan.fingerprint, round, &unit, &depot, options.check)? {
        say!("{said}: there already, {name}");
        return Ok(());
    }
    let job = plan.load(options.scene.as_deref(), options.memory, false, console)?;
    let folders = WorkFolders { scratch: options.scratch.as_deref(), keep: options.keep.as_deref() };
    let report = job.build_unit(round, unit, &depot, folders, console)?;
    match round {
        Round::Trace => {
            let rate = report.rays as f64 / report.seconds / 1e6;
            say!("{said}: {} in {:.1} s, {rate:.2} M rays/s", report.name, report.seconds);
        }
        _ => say!("{said}: {} in {:.1} s", report.name, report.seconds),
    }
    if report.non_finite > 0 {
        say!("{} contributions were not finite and were dropped", report.non_finite);
    }
    Ok(())
}

/// Merges the shards of a plan.
pub(crate) fn merge(options: &Merge, plan: &Path, console: &Console) -> Result<()> {
    let [address] = &*options.parts else {
        let problem = format!("{} places were given", options.parts.len());
        return Err(Error::input("ltm merge --plan", problem, "name the one place that the shards are in"));
    };
    let plan = Planned::read(plan)?;
    let depot = BlobStore::open(&address.to_string_lossy())?;
    let output = &options.output;
    if options.list.is_none() {
        names::check_container(output)?;
        check_output(output, options.force)?;
    }
    let job = plan.load(options.scene.as_deref(), options.memory, options.force, console)?;
    if options.rounds {
        return merge_rounds(options, &plan, job, &Arc::new(depot), console);
    }
    let cache = FarmJob::cache_path(output);
    let shards = job.shards(&depot, &cache, console)?;
    for refused in &shards.refused {
        console.note(&format!("refused: {}: {}", refused.name, refused.problem));
    }
    if let Some(listing) = options.list {
        return list(&plan, &shards, listing);
    }
    if !shards.missing.is_empty() {
        // Nothing else goes to standard output then.
        list(&plan, &shards, Listing::Ranges)?;
    } else if shards.non_finite > 0 {
        say!("{} contributions were not finite and were dropped", shards.non_finite);
    }
    let count = shards.count;
    let packed = job.merge(shards, output, console)?;
    depot.remove_copies(&cache, None)?;
    say!("{}: {count} shards merged in {:.1} s", output.display(), packed.seconds);
    print_packed(output, &packed)
}

/// Says what the next round lacks, or writes the container where all rounds are done.
fn merge_rounds(
    options: &Merge,
    plan: &Planned,
    job: FarmJob,
    depot: &Arc<BlobStore>,
    console: &Console,
) -> Result<()> {
    let (round, units, of) = match job.next(&plan.ranges, depot, options.check, console)? {
        Next::Build { round, units, of, damaged } => {
            damaged
                .iter()
                .for_each(|name| console.note(&format!("damaged: {name}: build its unit again with --check")));
            (round, units, of)
        }
        Next::Merge(_) if options.list.is_some() => return Ok(()),
        Next::Merge(coded) => {
            let packed = job.assemble(&coded, depot, &options.output, console)?;
            say!("{}: merged in {:.1} s", options.output.display(), packed.seconds);
            return print_packed(&options.output, &packed);
        }
    };
    match options.list {
        Some(Listing::Array) => say!("{} {}", round.name(), runs(&units)),
        _ => units.iter().for_each(|unit| say!("{} {unit}", round.name())),
    }
    match options.list {
        Some(_) => Ok(()),
        None => Err(Error::Incomplete {
            place: depot.address().to_owned(),
            missing: format!("{} of {of} units of round {} are missing", units.len(), round.name()),
            hint: "build them by ltm build --round, then merge again".into(),
        }),
    }
}

/// Ascending numbers as 0-3,7.
fn runs(numbers: &[usize]) -> String {
    let runs = numbers.chunk_by(|a, b| a + 1 == *b).map(|run| match run {
        [one] => one.to_string(),
        [first, .., last] => format!("{first}-{last}"),
        [] => String::new(),
    });
    runs.collect::<Vec<_>>().join(",")
}

/// Prints the ranges of the plan that have blocks in no shard: nothing else goes to standard output.
fn list(plan: &Planned, shards: &Shards, listing: Listing) -> Result<()> {
    let numbers = plan.having(&shards.missing);
    match listing {
        Listing::Ranges => {
            numbers.iter().map(|&number| &plan.ranges[number]).for_each(|r| say!("{}..{}", r.start, r.end))
        }
        Listing::Array => say!("{}", runs(&numbers)),
    }
    Ok(())
}
