//! What the three programs share: progress bars, Ctrl-C, and the way out.

use std::borrow::Cow;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, OnceLock};
use std::time::{Duration, Instant};
#[cfg(unix)]
use std::{io::Write, os::fd::AsFd};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use ltm::error::Warning;
use ltm::resources::{PeakMemory, Progress};

use crate::words::in_flags;

/// Time between two lines of progress.
const LINES_APART: Duration = Duration::from_millis(100);
/// A stage shows a bar only when it has run this long.
const PATIENCE: Duration = Duration::from_millis(700);

static INTERRUPTED: AtomicBool = AtomicBool::new(false);
/// Whether a stage runs: only then is there a block at hand to finish.
static IN_STAGE: AtomicBool = AtomicBool::new(false);
/// Memory of the whole run, from the first console on.
static RUN_MEMORY: OnceLock<PeakMemory> = OnceLock::new();

/// The exit codes, for `--help`.
pub const EXIT_CODES: &str = "Exit codes: 0 success, 2 unusable arguments, 3 unusable input, 4 damaged file, \
5 input or output failed, 6 not enough memory or disk, 7 no GPU where one was demanded, 8 blocks are missing that others are to build, 70 a fault of the program, 130 interrupted.";

/// Exit code of a program that was interrupted.
const INTERRUPTED_CODE: i32 = 130;
/// Exit code of a fault of the program itself: that of BSD's `sysexits.h` for it.
const FAULT: i32 = 70;
/// Most threads that are started for each core: more cost time and bring nothing.
const THREADS_PER_CORE: usize = 4;
/// As many threads are started on any machine that wants them.
const MAX_THREADS_ANYWHERE: usize = 64;

/// Progress on standard error: a bar on a terminal, elsewhere nothing but notes, or lines for a program that reads them.
#[derive(Default)]
pub struct Console {
    stage: Mutex<Option<Stage>>,
    work: AtomicU64,
    in_lines: bool,
}

struct Stage {
    bar: ProgressBar,
    name: String,
    begun: Instant,
    shown: bool,
    /// When the last line was written.
    told: Instant,
}

impl Stage {
    /// `progress: NAME DONE/TOTAL`, at most so often, and at the end.
    fn tell(&mut self, every: Duration) {
        let (done, total) = (self.bar.position(), self.bar.length().unwrap_or(0));
        if self.told.elapsed() >= every || done == total {
            self.told = Instant::now();
            eprintln!("progress: {} {done}/{total}", plain(&self.name));
        }
    }
}

impl Console {
    /// A console whose jobs stop after the blocks at hand on the first Ctrl-C (or SIGTERM), and at once on the second. Outside of a
    /// stage, while files are opened for example, the first ends the program too: whatever it writes, the same command goes on.
    pub fn new() -> Self {
        report_faults();
        RUN_MEMORY.get_or_init(PeakMemory::start);
        end_with_the_reader();
        let _ = ctrlc::set_handler(|| {
            if INTERRUPTED.swap(true, Ordering::SeqCst) {
                end_at_once(INTERRUPTED_CODE);
            }
            // Written without the lock of standard error, which a thread may hold that is stuck.
            if !IN_STAGE.load(Ordering::SeqCst) {
                write_unlocked("\ninterrupted\n");
                end_at_once(INTERRUPTED_CODE);
            }
            write_unlocked("\nstopping after the blocks at hand; press Ctrl-C again to stop at once\n");
        });
        ltm::files::tell_missing_locks(|line| eprintln!("{line}"));
        Self::default()
    }

    /// With progress in lines (`progress: NAME DONE/TOTAL`) where `in_lines`, instead of a bar.
    pub fn telling(self, in_lines: bool) -> Self {
        Self { in_lines, ..self }
    }
}

impl Progress for Console {
    fn begin(&self, stage: &str, total: u64, unit: &str) {
        let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::hidden());
        let template = format!("{{msg}} [{{bar:32}}] {{pos}}/{{len}} {unit}, {{prefix}}, {{eta}} left");
        let style = ProgressStyle::with_template(&template).expect("the template is well formed");
        bar.set_style(style.progress_chars("=> "));
        bar.set_message(stage.to_owned());
        self.work.store(0, Ordering::Relaxed);
        let begun = Instant::now();
        IN_STAGE.store(true, Ordering::SeqCst);
        let mut stage = Stage { bar, name: stage.to_owned(), begun, shown: false, told: begun };
        if self.in_lines {
            stage.tell(Duration::ZERO);
        }
        *self.stage.lock().expect("no panic holds it") = Some(stage);
    }

    fn advance(&self, steps: u64, work: u64, work_unit: &str) {
        let total = self.work.fetch_add(work, Ordering::Relaxed) + work;
        let mut guard = self.stage.lock().expect("no panic holds it");
        let Some(stage) = guard.as_mut() else { return };
        if self.in_lines {
            stage.bar.inc(steps);
            return stage.tell(LINES_APART);
        }
        let elapsed = stage.begun.elapsed();
        if !stage.shown && elapsed > PATIENCE {
            stage.shown = true;
            stage.bar.set_draw_target(ProgressDrawTarget::stderr());
        }
        let rate = total as f64 / elapsed.as_secs_f64().max(1e-9);
        stage.bar.set_prefix(format!("{}{work_unit}/s", engineering(rate)));
        stage.bar.inc(steps);
    }

    fn end(&self) {
        IN_STAGE.store(false, Ordering::SeqCst);
        if let Some(stage) = self.stage.lock().expect("no panic holds it").take() {
            stage.bar.finish_and_clear();
            if stage.shown && !stage.bar.is_hidden() {
                eprintln!("{} took {:.1} s", stage.name, stage.begun.elapsed().as_secs_f64());
            }
        }
    }

    fn note(&self, line: &str) {
        match self.stage.lock().expect("no panic holds it").as_ref() {
            Some(stage) if stage.shown && !stage.bar.is_hidden() => stage.bar.suspend(|| eprintln!("{}", plain(line))),
            _ => eprintln!("{}", plain(line)),
        }
    }

    fn warn(&self, warning: &Warning) {
        self.note(&warning.worded(in_flags));
    }

    fn interrupted(&self) -> bool {
        INTERRUPTED.load(Ordering::SeqCst)
    }
}

/// Lets a closed pipe (`ltm info room.ltc | head`) end the program quietly, as it ends other tools: Rust's own setting
/// makes a panic of it.
fn end_with_the_reader() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    #[expect(unsafe_code, reason = "signals are set through the C interface only")]
    // SAFETY: the default action is installed before any other thread runs, and no handler of ours is called.
    unsafe {
        libc::signal(libc::SIGPIPE, libc::SIG_DFL);
    }
}

/// Ends the program without waiting for anything, not even for what is registered to run at its end.
pub(crate) fn end_at_once(code: i32) -> ! {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    #[expect(unsafe_code, reason = "there is no safe way to end a process without its exit handlers")]
    // SAFETY: the call does not return, and files of this program survive a process that ends at any instant.
    unsafe {
        libc::_exit(code);
    }
    #[cfg(not(all(target_os = "linux", target_env = "gnu")))]
    std::process::exit(code);
}

/// Writes to standard error past its lock and buffer.
pub(crate) fn write_unlocked(text: &str) {
    #[cfg(unix)]
    if let Ok(error) = std::io::stderr().as_fd().try_clone_to_owned() {
        let _ = std::fs::File::from(error).write_all(text.as_bytes());
    }
    #[cfg(not(unix))]
    eprint!("{text}");
}

/// Ends the program with one line where it would panic: what no check foresaw is a fault of the program, not of its input.
pub fn report_faults() {
    std::panic::set_hook(Box::new(|panic| {
        let said = panic.payload_as_str().unwrap_or("no reason was given");
        let place =
            panic.location().map_or_else(String::new, |at| format!(" at {}:{}", source_of(at.file()), at.line()));
        let program = std::env::args().next().unwrap_or_default();
        let name = std::path::Path::new(&program).file_name().map(|name| name.to_string_lossy().into_owned());
        let version = env!("CARGO_PKG_VERSION");
        eprintln!(
            "{}: fault of the program{place}: {}; please report this line, the version ({version}) and the command",
            plain(&name.unwrap_or_default()),
            plain(said),
        );
        std::process::exit(FAULT);
    }));
}

/// A source file without the folders of the machine that compiled it.
fn source_of(file: &str) -> &str {
    let after = |mark: &str| file.split_once(mark).and_then(|(_, rest)| rest.split_once('/')).map(|(_, rest)| rest);
    after("/registry/src/").or_else(|| after("/rustc/")).unwrap_or(file)
}

/// The peak of the program's anonymous memory since it began; none where the system does not tell.
pub fn peak_memory_bytes() -> Option<u64> {
    RUN_MEMORY.get().and_then(PeakMemory::so_far)
}

/// A text as one line that a terminal only shows: control characters, among them line ends, and marks that turn the
/// direction of writing are escaped. Names in files of others may hold any.
pub fn plain(text: &str) -> Cow<'_, str> {
    let is_harmful = |c: char| {
        let turns =
            matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
        c.is_control() || turns || matches!(c, '\u{2028}' | '\u{2029}' | '\u{feff}')
    };
    if !text.contains(is_harmful) {
        return Cow::Borrowed(text);
    }
    let escaped = |c: char| if is_harmful(c) { c.escape_default().to_string() } else { c.to_string() };
    Cow::Owned(text.chars().map(escaped).collect())
}

/// Prints one line to standard output, as [`plain`] shows it.
#[macro_export]
macro_rules! say {
    ($($what:tt)*) => { println!("{}", $crate::console::plain(&format!($($what)*))) };
}

/// A number with an SI prefix: 12.3 M.
fn engineering(value: f64) -> String {
    let (scaled, prefix) = match value {
        v if v >= 1e9 => (v / 1e9, "G"),
        v if v >= 1e6 => (v / 1e6, "M"),
        v if v >= 1e3 => (v / 1e3, "k"),
        v => (v, ""),
    };
    format!("{scaled:.1} {prefix}")
}

/// Ends the program: the error as one line on standard error, and its exit code.
pub fn finish(program: &str, result: ltm::Result<()>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{program}: {}", plain(&error.worded(in_flags)));
            ExitCode::from(error.exit_code())
        }
    }
}

/// Sets the number of worker threads.
pub fn use_threads(threads: Option<usize>) -> ltm::Result<()> {
    match threads {
        None => Ok(()),
        Some(0) => Err(ltm::Error::input("--threads", "0 threads cannot work", "give 1 or more")),
        Some(count) => {
            let cores = std::thread::available_parallelism().map_or(1, usize::from);
            let most = MAX_THREADS_ANYWHERE.max(THREADS_PER_CORE * cores);
            if count > most {
                let problem = format!("{count} threads are more than {cores} cores can use");
                return Err(ltm::Error::input("--threads", problem, format!("give {most} at most")));
            }
            // The pool exists already only if something ran before: then its size stays, which costs time, not results.
            let _ = rayon::ThreadPoolBuilder::new().num_threads(count).build_global();
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_command_a_terminal() {
        assert!(matches!(plain("Küche, 灯 1"), Cow::Borrowed(_)));
        assert_eq!(plain("a\u{1b}[2Jb\nc\u{202e}d\u{9b}"), "a\\u{1b}[2Jb\\nc\\u{202e}d\\u{9b}");
    }

    #[test]
    fn sources_are_named_without_the_machine_that_compiled_them() {
        assert_eq!(source_of("/cargo/registry/src/index-1/exr-1.7/src/lib.rs"), "exr-1.7/src/lib.rs");
        assert_eq!(source_of("src/image/read.rs"), "src/image/read.rs");
    }

    #[test]
    fn more_threads_than_help_are_refused() {
        let error = use_threads(Some(4000)).unwrap_err();
        assert!(error.to_string().contains("--threads"), "{error}");
    }
}
