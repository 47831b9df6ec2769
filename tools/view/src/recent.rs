//! Files that were opened before, newest first, kept from one run to the next.

use std::path::{Path, PathBuf};

use ltm::error::{Error, Result};
use ltm::files::write_file;

/// Files of each kind that are remembered.
const MOST: usize = 12;

/// Name of the list in its folder.
const FILE: &str = "recent.txt";

/// Kind of a remembered file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecentKind {
    /// A container.
    Container,
    /// A lighting file.
    Look,
}

/// The list, and where it is kept.
#[derive(Clone, Debug, Default)]
pub struct Recent {
    folder: Option<PathBuf>,
    entries: Vec<(RecentKind, PathBuf)>,
}

impl RecentKind {
    fn word(self) -> &'static str {
        match self {
            Self::Container => "container",
            Self::Look => "look",
        }
    }
}

impl Recent {
    /// The list that stands in a folder; an unreadable one is empty. Without a folder nothing outlives the run.
    pub fn load(folder: Option<PathBuf>) -> Self {
        let text = folder.as_ref().and_then(|folder| std::fs::read_to_string(folder.join(FILE)).ok());
        let entry = |line: &str| {
            let (word, path) = line.split_once('\t')?;
            let kind = [RecentKind::Container, RecentKind::Look].into_iter().find(|kind| kind.word() == word)?;
            (!path.is_empty()).then(|| (kind, PathBuf::from(path)))
        };
        let entries = text.iter().flat_map(|text| text.lines()).filter_map(entry).collect();
        Self { folder, entries }
    }

    /// The files of a kind, newest first.
    pub fn of(&self, kind: RecentKind) -> impl Iterator<Item = &Path> {
        self.entries.iter().filter(move |entry| entry.0 == kind).map(|entry| entry.1.as_path())
    }

    /// Puts a file at the top of its kind and keeps the list.
    ///
    /// Errors: the list cannot be written; it is changed all the same.
    pub fn add(&mut self, kind: RecentKind, path: &Path) -> Result<()> {
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        self.entries.retain(|entry| *entry != (kind, path.clone()));
        self.entries.insert(0, (kind, path));
        let mut seen = 0;
        self.entries.retain(|entry| {
            seen += usize::from(entry.0 == kind);
            entry.0 != kind || seen <= MOST
        });
        let Some(folder) = &self.folder else { return Ok(()) };
        std::fs::create_dir_all(folder).map_err(Error::io(folder, "create the folder"))?;
        // A path with a line break or in another encoding cannot stand in the list.
        let writable = |entry: &&(RecentKind, PathBuf)| entry.1.to_str().is_some_and(|path| !path.contains('\n'));
        let line = |(kind, path): &(RecentKind, PathBuf)| format!("{}\t{}\n", kind.word(), path.display());
        let text: String = self.entries.iter().filter(writable).map(line).collect();
        write_file(&folder.join(FILE), true, text.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_comes_first_and_the_list_outlives_the_run() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("state");
        let mut recent = Recent::load(Some(inside.clone()));
        for i in 0..20 {
            recent.add(RecentKind::Container, Path::new(&format!("/{i}.ltc"))).unwrap();
            recent.add(RecentKind::Look, Path::new("/one\ttab.toml")).unwrap();
        }
        recent.add(RecentKind::Container, Path::new("/15.ltc")).unwrap();
        let again = Recent::load(Some(inside));
        let containers: Vec<_> = again.of(RecentKind::Container).collect();
        assert_eq!(containers.len(), MOST);
        assert_eq!(containers[..3], ["/15.ltc", "/19.ltc", "/18.ltc"].map(Path::new));
        assert_eq!(again.of(RecentKind::Look).collect::<Vec<_>>(), [Path::new("/one\ttab.toml")]);
    }
}
