//! Keeping a job within the memory and the disk it was given: fewer threads, or a refusal before anything is begun.

use std::fs;
use std::path::Path;

use super::Progress;
use super::memory::available_bytes;
use crate::error::{Error, Hint, Result};
use crate::files::{allocated_bytes, folder_of, free_bytes};

/// The program itself, its threads and its tables.
pub(crate) const PROGRAM_BYTES: u64 = 24 << 20;

/// One over the share of a thread's memory that is in pieces small enough for the allocator to keep. Most of it are
/// blocks and copies of them.
const KEPT_PART: u64 = 4;

/// Resources that a job needs: an upper bound of anonymous memory (a fixed part plus a part for each thread that works
/// on a block, or a separate stage if that is more), and disk space.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ResourceEstimate {
    pub(crate) fixed_bytes: u64,
    pub(crate) per_thread_bytes: u64,
    /// Of a stage during which no thread works on a block; what those gave back in small pieces, the allocator keeps for a while.
    pub(crate) alone_bytes: u64,
    /// What is refused where the disk has not so much.
    pub(crate) disk_bytes: u64,
    /// What no input passes, where that is more than a job is likely to take; else 0.
    pub(crate) most_disk_bytes: u64,
}

impl ResourceEstimate {
    /// Memory for a number of threads.
    pub(crate) fn bytes(self, threads: usize) -> u64 {
        let of_threads = self.per_thread_bytes * threads as u64;
        let alone = if self.alone_bytes > 0 { self.alone_bytes + of_threads / KEPT_PART } else { 0 };
        self.fixed_bytes + of_threads.max(alone)
    }

    /// Admits a job that writes `output`: the number of threads that stay within the memory, after one line on what is
    /// needed. `there` names files of an earlier run whose space the job will use.
    ///
    /// # Errors
    /// The memory is too small for one thread, or the disk has no room.
    pub(crate) fn admit(
        self,
        job: &str,
        output: &Path,
        there: &[&Path],
        budget_bytes: Option<u64>,
        watch: &dyn Progress,
    ) -> Result<usize> {
        let threads = self.threads_within(job, budget_bytes)?;
        let folder = folder_of(output);
        let taken: u64 =
            there.iter().filter_map(|path| fs::metadata(path).ok()).map(|file| allocated_bytes(&file)).sum();
        let more = self.disk_bytes.saturating_sub(taken);
        if more > 0 {
            let free = free_bytes(folder)?;
            if more > free {
                return Err(Error::Resources {
                    what: format!("{job} {}", output.display()),
                    needed: format!("{} of disk", human_bytes(more)),
                    available: format!("only {} are free in {}", human_bytes(free), folder.display()),
                    hint: "make room, or name an output on another disk".into(),
                });
            }
        }
        let with = match (self.per_thread_bytes, threads) {
            (0, _) => String::new(),
            (_, 1) => " with 1 thread".to_owned(),
            _ => format!(" with {threads} threads"),
        };
        let disk = match (self.disk_bytes, self.most_disk_bytes.saturating_sub(taken)) {
            (0, _) => String::new(),
            (_, most) if most > more => {
                format!(" and likely {} of disk, {} at most", human_bytes(more), human_bytes(most))
            }
            _ => format!(" and {} of disk", human_bytes(more)),
        };
        let memory = human_bytes(self.bytes(threads));
        watch.note(&format!("{}: {job}{with}, needs up to {memory} of memory{disk}", output.display()));
        Ok(threads)
    }

    /// The number of threads, at most those of the current pool, whose memory fits a budget. Without one, it must fit
    /// the memory that the system, and the container around the program, have available.
    ///
    /// # Errors
    /// Not even one thread does.
    pub(crate) fn threads_within(self, job: &str, budget_bytes: Option<u64>) -> Result<usize> {
        let wanted = rayon::current_num_threads();
        let limit = budget_bytes.or_else(|| available_bytes(Path::new("/"))).unwrap_or(u64::MAX);
        match (1..=wanted).rev().find(|&threads| self.bytes(threads) <= limit) {
            Some(threads) => Ok(threads),
            None => Err(Error::Resources {
                what: job.to_owned(),
                needed: format!("{} of memory", human_bytes(self.bytes(1))),
                available: match budget_bytes {
                    Some(budget) => format!("only {} are allowed", human_bytes(budget)),
                    None => format!("only {} are available", human_bytes(limit)),
                },
                hint: match budget_bytes {
                    Some(_) => Hint::RaiseMemoryLimit { needed_bytes: self.bytes(1) },
                    None => Hint::MoreMemory,
                },
            }),
        }
    }
}

/// The memory that a job was given or, without such, that the system has.
pub fn budget_bytes(memory_bytes: Option<u64>) -> u64 {
    memory_bytes.or_else(|| available_bytes(Path::new("/"))).unwrap_or(u64::MAX)
}

/// Holds what a caller is about to allocate to the memory that it was given or, without such, that the system has.
///
/// # Errors
/// [`Error::Resources`] where it does not fit.
pub fn hold_to_memory(job: &str, bytes: u64, memory_bytes: Option<u64>) -> Result<()> {
    ResourceEstimate { fixed_bytes: bytes, ..ResourceEstimate::default() }.threads_within(job, memory_bytes).map(|_| ())
}

/// Bytes with a binary unit.
pub fn human_bytes(bytes: u64) -> String {
    const UNITS: [&str; 4] = ["B", "KiB", "MiB", "GiB"];
    let mut value = bytes as f64;
    let mut unit = 0;
    while value >= 1024.0 && unit + 1 < UNITS.len() {
        value /= 1024.0;
        unit += 1;
    }
    if unit == 0 { format!("{bytes} B") } else { format!("{value:.1} {}", UNITS[unit]) }
}

/// Reads a size such as `512MiB`, `1.5GiB`, `2G` or plain bytes.
///
/// # Errors
/// As text: not a number, an unknown unit, or a size of nothing.
pub fn parse_bytes(text: &str) -> Result<u64, String> {
    let split = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let number: f64 = number.parse().map_err(|_| format!("'{text}' is not a size; write 512MiB or 1.5GiB"))?;
    let factor = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 1.0,
        "k" | "kb" | "kib" => 1024.0,
        "m" | "mb" | "mib" => 1024f64.powi(2),
        "g" | "gb" | "gib" => 1024f64.powi(3),
        "t" | "tb" | "tib" => 1024f64.powi(4),
        _ => return Err(format!("'{unit}' is not a unit; write KiB, MiB, GiB or TiB")),
    };
    let bytes = (number * factor) as u64;
    if bytes == 0 { Err(format!("'{text}' is nothing")) } else { Ok(bytes) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_are_given_up_before_the_job_is() {
        let need = ResourceEstimate { fixed_bytes: 100, per_thread_bytes: 50, ..ResourceEstimate::default() };
        let most = rayon::current_num_threads();
        assert_eq!(need.threads_within("a job", Some(need.bytes(most))).unwrap(), most);
        assert_eq!(need.threads_within("a job", Some(150)).unwrap(), 1);
        let error = need.threads_within("a job", Some(149)).unwrap_err().to_string();
        assert!(error.contains("150 B") && error.contains("149 B"), "{error}");
        // A stage by itself takes the place of the threads.
        let staged = ResourceEstimate { alone_bytes: 80, ..need };
        assert_eq!((staged.bytes(1), staged.bytes(2), staged.bytes(3)), (192, 205, 250));
    }

    #[test]
    fn a_disk_without_room_is_refused_and_space_that_is_taken_already_counts() {
        let folder = tempfile::tempdir().unwrap();
        let (output, partial) = (folder.path().join("x"), folder.path().join("x.part"));
        let admit = |bytes| {
            let need = ResourceEstimate { disk_bytes: bytes, ..ResourceEstimate::default() };
            need.admit("writing", &output, &[&partial], None, &crate::resources::NoProgress)
        };
        let free = free_bytes(folder.path()).unwrap();
        assert!(admit(free / 2).is_ok());
        let error = admit(u64::MAX).unwrap_err();
        assert!(matches!(error, Error::Resources { .. }) && error.to_string().contains("of disk"), "{error}");
        fs::write(&partial, vec![1; 1 << 22]).unwrap();
        fs::File::open(&partial).unwrap().sync_all().unwrap();
        assert!(allocated_bytes(&fs::metadata(&partial).unwrap()) >= 1 << 22);
    }

    #[test]
    fn sizes_are_read_and_written() {
        assert_eq!(parse_bytes("1GiB"), Ok(1 << 30));
        assert_eq!(parse_bytes("1.5 MiB"), Ok(3 << 19));
        assert_eq!(parse_bytes("77"), Ok(77));
        assert!(parse_bytes("lots").is_err() && parse_bytes("1 parsec").is_err() && parse_bytes("0").is_err());
        assert_eq!(human_bytes(1536), "1.5 KiB");
    }
}
