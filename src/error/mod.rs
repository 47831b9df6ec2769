//! The one error type. Each kind is a decision for the caller, and an exit code of the programs.
//!
//! # Example
//!
//! ```
//! use ltm::error::{Error, ErrorKind, Hint};
//!
//! let error = Error::input("room.ltc", "exists already", Hint::Overwrite);
//! assert_eq!(error.kind(), ErrorKind::Input);
//! assert_eq!(error.to_string(), "room.ltc: exists already; choose another name, or set `overwrite` to replace it");
//! // A program with options of its own says so in its own words.
//! let wording = |hint: &Hint| if *hint == Hint::Overwrite { "press Replace".into() } else { hint.to_string() };
//! assert_eq!(error.worded(wording), "room.ltc: exists already; press Replace");
//! ```

mod hint;

use std::fmt;
use std::path::{Path, PathBuf};

pub use hint::{Hint, Warning, Warnings, Wording};
use hint::{in_own_words, with_hint};

/// What a program can do about an [`enum@Error`]; see its variants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// [`Error::Input`].
    Input,
    /// [`Error::Damaged`].
    Damaged,
    /// [`Error::Io`].
    Io,
    /// [`Error::Resources`].
    Resources,
    /// [`Error::Incomplete`].
    Incomplete,
    /// [`Error::Interrupted`].
    Interrupted,
    /// [`Error::NoGpu`].
    NoGpu,
}

/// What went wrong, where, and what to do about it, as one line.
#[derive(Debug)]
#[non_exhaustive]
pub enum Error {
    /// What the user gave cannot be used: fix the input and run again.
    Input {
        /// File, argument or named object that is wrong.
        place: String,
        /// The problem.
        problem: String,
        /// What to do about it, or empty.
        hint: Hint,
    },
    /// A file of ours is damaged or cut short: repair it or make it again.
    Damaged {
        /// The file.
        path: PathBuf,
        /// What does not hold, naming the block or the offset.
        problem: String,
        /// What to do about it.
        hint: Hint,
    },
    /// The operating system refused: look at permissions, space, the path.
    Io {
        /// The file.
        path: PathBuf,
        /// The action that failed, as a verb phrase ("create", "read block 3").
        action: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The work does not fit the memory or the disk it was given: give more, or ask for less.
    Resources {
        /// The job.
        what: String,
        /// The amount needed, with its unit.
        needed: String,
        /// What there is, as a clause ("only 3.0 GiB are free on /data").
        available: String,
        /// What to do about it.
        hint: Hint,
    },
    /// Parts are missing that others are to make: make them, then go on.
    Incomplete {
        /// Where it was looked for.
        place: String,
        /// The missing part.
        missing: String,
        /// What to do about it.
        hint: Hint,
    },
    /// The user stopped the work.
    Interrupted {
        /// What there is of it ("room.ltm.part keeps the finished blocks").
        kept: String,
        /// What to do about it, or empty.
        hint: Hint,
    },
    /// The accelerator cannot be used: the caller goes on with the CPU.
    NoGpu(String),
}

/// As one line in the words of this library.
impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.worded(in_own_words))
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        if let Self::Io { source, .. } = self { Some(source) } else { None }
    }
}

/// Result with the crate's [`enum@Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// An [`Error::Input`] from its three parts.
    pub fn input(place: impl Into<String>, problem: impl Into<String>, hint: impl Into<Hint>) -> Self {
        Self::Input { place: place.into(), problem: problem.into(), hint: hint.into() }
    }

    /// An [`Error::Damaged`] from its three parts.
    pub fn damaged(path: impl AsRef<Path>, problem: impl Into<String>, hint: impl Into<Hint>) -> Self {
        Self::Damaged { path: path.as_ref().to_owned(), problem: problem.into(), hint: hint.into() }
    }

    /// An [`Error::Interrupted`] of work that keeps nothing, or goes on only with other options.
    pub fn interrupted(kept: impl Into<String>) -> Self {
        Self::Interrupted { kept: kept.into(), hint: "".into() }
    }

    /// An [`Error::Interrupted`] of work that goes on when it is begun again.
    pub fn interrupted_keeping(kept: impl Into<String>) -> Self {
        Self::Interrupted { kept: kept.into(), hint: Hint::Continue }
    }

    /// For `map_err`: an [`Error::Io`] that names the action and the file.
    pub fn io(path: impl AsRef<Path>, action: impl Into<String>) -> impl FnOnce(std::io::Error) -> Self {
        let (path, action) = (path.as_ref().to_owned(), action.into());
        move |source| Self::Io { path, action, source }
    }

    /// What to do about it; none for those of which a program knows as much as we do.
    pub fn hint(&self) -> Option<&Hint> {
        match self {
            Self::Input { hint, .. }
            | Self::Damaged { hint, .. }
            | Self::Resources { hint, .. }
            | Self::Incomplete { hint, .. }
            | Self::Interrupted { hint, .. } => Some(hint).filter(|hint| !hint.is_empty()),
            Self::Io { .. } | Self::NoGpu(_) => None,
        }
    }

    /// As one line, its hint in the words of a front end. `Display` is this in the words of the library.
    #[must_use]
    pub fn worded(&self, wording: Wording) -> String {
        let text = match self {
            Self::Input { place, problem, .. } => format!("{place}: {problem}"),
            Self::Damaged { path, problem, .. } => format!("{}: {problem}", path.display()),
            Self::Io { path, action, source } => format!("{}: cannot {action}: {source}", path.display()),
            Self::Resources { what, needed, available, .. } => format!("{what} needs {needed}, but {available}"),
            Self::Incomplete { place, missing, .. } => format!("{place}: {missing}"),
            Self::Interrupted { kept, .. } => format!("interrupted: {kept}"),
            Self::NoGpu(reason) => format!("no GPU: {reason}"),
        };
        self.hint().map_or_else(|| text.clone(), |hint| with_hint(&text, hint, wording))
    }

    /// What can be done about it.
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Input { .. } => ErrorKind::Input,
            Self::Damaged { .. } => ErrorKind::Damaged,
            Self::Io { .. } => ErrorKind::Io,
            Self::Resources { .. } => ErrorKind::Resources,
            Self::Incomplete { .. } => ErrorKind::Incomplete,
            Self::Interrupted { .. } => ErrorKind::Interrupted,
            Self::NoGpu(_) => ErrorKind::NoGpu,
        }
    }

    /// Exit code of the programs for this error. 0 is success; 2 is clap's, for unusable arguments.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Input { .. } => 3,
            Self::Damaged { .. } => 4,
            Self::Io { .. } => 5,
            Self::Resources { .. } => 6,
            Self::NoGpu(_) => 7,
            Self::Incomplete { .. } => 8,
            Self::Interrupted { .. } => 130,
        }
    }
}
