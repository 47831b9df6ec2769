//! The one error type. Each kind is a decision for the caller, and an exit code of the programs.

use std::path::{Path, PathBuf};

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
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// What the user gave cannot be used: fix the input and run again.
    #[error("{place}: {problem}{}{hint}", if hint.is_empty() { "" } else { "; " })]
    Input {
        /// File, argument or named object that is wrong.
        place: String,
        /// The problem.
        problem: String,
        /// The remedy, or empty.
        hint: String,
    },
    /// A file of ours is damaged or cut short: repair it or make it again.
    #[error("{}: {problem}; {hint}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What does not hold, naming the block or the offset.
        problem: String,
        /// The remedy.
        hint: String,
    },
    /// The operating system refused: look at permissions, space, the path.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The action that failed, as a verb phrase ("create", "read block 3").
        action: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The work does not fit the memory or the disk it was given: give more, or ask for less.
    #[error("{what} needs {needed}, but {available}; {hint}")]
    Resources {
        /// The job.
        what: String,
        /// The amount needed, with its unit.
        needed: String,
        /// What there is, as a clause ("only 3.0 GiB are free on /data").
        available: String,
        /// The remedy.
        hint: String,
    },
    /// Parts are missing that others are to make: make them, then go on.
    #[error("{place}: {missing}; {hint}")]
    Incomplete {
        /// Where it was looked for.
        place: String,
        /// The missing part.
        missing: String,
        /// The remedy.
        hint: String,
    },
    /// The user stopped the work: what is committed is kept.
    #[error("interrupted: {0}")]
    Interrupted(String),
    /// The accelerator cannot be used: the caller goes on with the CPU.
    #[error("no GPU: {0}")]
    NoGpu(String),
}

/// Result with the crate's [`enum@Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// An [`Error::Input`] from its three parts.
    pub fn input(place: impl Into<String>, problem: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Input { place: place.into(), problem: problem.into(), hint: hint.into() }
    }

    /// An [`Error::Damaged`] from its three parts.
    pub fn damaged(path: impl AsRef<Path>, problem: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Damaged { path: path.as_ref().to_owned(), problem: problem.into(), hint: hint.into() }
    }

    /// For `map_err`: an [`Error::Io`] with the action and the file.
    pub fn io(path: impl AsRef<Path>, action: impl Into<String>) -> impl FnOnce(std::io::Error) -> Self {
        let (path, action) = (path.as_ref().to_owned(), action.into());
        move |source| Self::Io { path, action, source }
    }

    /// Kind of the error, by what can be done about it.
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Input { .. } => ErrorKind::Input,
            Self::Damaged { .. } => ErrorKind::Damaged,
            Self::Io { .. } => ErrorKind::Io,
            Self::Resources { .. } => ErrorKind::Resources,
            Self::Incomplete { .. } => ErrorKind::Incomplete,
            Self::Interrupted(_) => ErrorKind::Interrupted,
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
            Self::Interrupted(_) => 130,
        }
    }
}
