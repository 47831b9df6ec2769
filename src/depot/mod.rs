//! Where many machines leave files for each other: a folder that all of them see.
//!
//! A depot knows whole files only: one is there complete or not at all, and is never changed afterwards. Nothing in it is a lock: who
//! writes a file that another writes too gives it the same bytes under the same name.

mod folder;

use std::io::Write;
use std::path::{Path, PathBuf};

use self::folder::Folder;
use crate::error::Result;

/// Writes the content of a file; may be called again where a try failed.
pub type Content<'a> = &'a dyn Fn(&mut dyn Write) -> Result<()>;

/// A place for files, by its address.
#[derive(Debug)]
pub struct Depot {
    address: String,
    place: Place,
}

#[derive(Debug)]
enum Place {
    Folder(Folder),
}

impl Depot {
    /// The depot at an address: the path of a folder, which need not be there yet.
    ///
    /// # Errors
    /// An address that is none.
    pub fn open(address: &str) -> Result<Self> {
        Ok(Self { address: address.to_owned(), place: Place::Folder(Folder::new(address)?) })
    }

    /// Its address, for messages.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Names that begin so, in order. Nothing is there where the depot is not.
    ///
    /// # Errors
    /// It cannot be looked into.
    pub fn names(&self, prefix: &str) -> Result<Vec<String>> {
        let mut names = match &self.place {
            Place::Folder(folder) => folder.names(prefix)?,
        };
        names.sort();
        Ok(names)
    }

    /// Puts a file there, complete or not at all; one of that name is replaced.
    ///
    /// # Errors
    /// Those of `content`; it cannot be written.
    pub fn put(&self, name: &str, content: Content) -> Result<()> {
        match &self.place {
            Place::Folder(folder) => folder.put(name, content),
        }
    }

    /// A file of it as one on this machine: itself, or a copy in `cache`, which is kept for the next time.
    ///
    /// # Errors
    /// It cannot be read, or the copy not be written.
    pub fn local(&self, name: &str, _cache: &Path) -> Result<PathBuf> {
        match &self.place {
            Place::Folder(folder) => Ok(folder.path(name)),
        }
    }
}
