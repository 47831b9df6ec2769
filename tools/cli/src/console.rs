//! What the three programs share: progress bars, Ctrl-C, and the way out.

use std::io::Write;
#[cfg(unix)]
use std::os::fd::AsFd;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use ltm::host::Watch;

/// A stage shows a bar only when it has run this long.
const PATIENCE: Duration = Duration::from_millis(700);

static INTERRUPTED: AtomicBool = AtomicBool::new(false);
/// Whether a stage runs: only then is there a block at hand to finish.
static IN_STAGE: AtomicBool = AtomicBool::new(false);

/// The exit codes, for `--help`.
pub const EXIT_CODES: &str = "Exit codes: 0 success, 2 unusable arguments, 3 unusable input, 4 damaged file, \
5 input or output failed, 6 not enough memory or disk, 7 no GPU where one was demanded, 130 interrupted.";

/// Progress on standard error: a bar on a terminal, nothing but notes elsewhere.
#[derive(Default)]
pub struct Console {
    stage: Mutex<Option<Stage>>,
    work: AtomicU64,
}

/// Keeps what the programs say of memory true. Matrices are allocated on cache lines, and glibc finds no use for the room
/// that they leave: packing 216 MiB of 24 columns grew by 0.3 MiB with each block, to five times its stated need, and 9 GiB
/// peaked at 563 MiB. mimalloc holds freed blocks of a render long enough to pass its need by an eighth.
#[global_allocator]
static ALLOCATOR: tikv_jemallocator::Jemalloc = tikv_jemallocator::Jemalloc;

struct Stage {
    bar: ProgressBar,
    name: String,
    begun: Instant,
    shown: bool,
}

impl Console {
    /// A console whose jobs stop after the blocks at hand on the first Ctrl-C (or SIGTERM), and at once on the second. Outside of a
    /// stage, while files are opened for example, the first ends the program too: whatever it writes, the same command goes on.
    pub fn new() -> Self {
        end_with_the_reader();
        let _ = ctrlc::set_handler(|| {
            if INTERRUPTED.swap(true, Ordering::SeqCst) {
                end_at_once();
            }
            // Written without the lock of standard error, which a thread may hold that is stuck.
            if !IN_STAGE.load(Ordering::SeqCst) {
                write_unlocked("\ninterrupted\n");
                end_at_once();
            }
            write_unlocked("\nstopping after the blocks at hand; press Ctrl-C again to stop at once\n");
        });
        ltm::files::tell_missing_locks(|line| eprintln!("{line}"));
        Self::default()
    }
}

impl Watch for Console {
    fn begin(&self, stage: &str, total: u64, unit: &str) {
        let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::hidden());
        let template = format!("{{msg}} [{{bar:32}}] {{pos}}/{{len}} {unit}, {{prefix}}, {{eta}} left");
        let style = ProgressStyle::with_template(&template).expect("the template is well formed");
        bar.set_style(style.progress_chars("=> "));
        bar.set_message(stage.to_owned());
        self.work.store(0, Ordering::Relaxed);
        let begun = Instant::now();
        IN_STAGE.store(true, Ordering::SeqCst);
        *self.stage.lock().expect("no panic holds it") =
            Some(Stage { bar, name: stage.to_owned(), begun, shown: false });
    }

    fn advance(&self, steps: u64, work: u64, work_unit: &str) {
        let total = self.work.fetch_add(work, Ordering::Relaxed) + work;
        let mut guard = self.stage.lock().expect("no panic holds it");
        let Some(stage) = guard.as_mut() else { return };
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
            Some(stage) if stage.shown && !stage.bar.is_hidden() => stage.bar.suspend(|| eprintln!("{line}")),
            _ => eprintln!("{line}"),
        }
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
fn end_at_once() -> ! {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    #[expect(unsafe_code, reason = "there is no safe way to end a process without its exit handlers")]
    // SAFETY: the call does not return, and files of this program survive a process that ends at any instant.
    unsafe {
        libc::_exit(130);
    }
    #[cfg(not(all(target_os = "linux", target_env = "gnu")))]
    std::process::exit(130);
}

/// Writes to standard error past its lock and buffer.
fn write_unlocked(text: &str) {
    #[cfg(unix)]
    if let Ok(error) = std::io::stderr().as_fd().try_clone_to_owned() {
        let _ = std::fs::File::from(error).write_all(text.as_bytes());
    }
    #[cfg(not(unix))]
    eprint!("{text}");
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
            eprintln!("{program}: {error}");
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
            // The pool exists already only if something ran before: then its size stays, which costs time, not results.
            let _ = rayon::ThreadPoolBuilder::new().num_threads(count).build_global();
            Ok(())
        }
    }
}
