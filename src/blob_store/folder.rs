//! A depot that is a folder, of this machine or of a shared file system.

use std::fs;
use std::io::ErrorKind;
use std::path::PathBuf;

use super::Content;
use crate::error::{Error, Result};
use crate::files::{replace, sync_folder};

#[derive(Debug)]
pub(super) struct Folder(PathBuf);

impl Folder {
    pub(super) fn new(address: &str) -> Result<Self> {
        let path = PathBuf::from(address.strip_prefix("file://").unwrap_or(address));
        if let Some((scheme, _)) = address.split_once("://").filter(|(scheme, _)| *scheme != "file") {
            return Err(Error::input(
                address,
                format!("{scheme}:// is not known"),
                "name a folder, or s3://BUCKET/PREFIX",
            ));
        }
        if path.exists() && !path.is_dir() {
            return Err(Error::input(address, "is not a folder", "name a folder for the shards"));
        }
        Ok(Self(path))
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    pub(super) fn names(&self, prefix: &str) -> Result<Vec<String>> {
        let entries = match fs::read_dir(&self.0) {
            Ok(entries) => entries,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            Err(error) => return Err(Error::io(&self.0, "look into")(error)),
        };
        let mut names = Vec::new();
        for entry in entries {
            let name = entry.map_err(Error::io(&self.0, "look into"))?.file_name();
            names.extend(name.into_string().ok().filter(|name| name.starts_with(prefix)));
        }
        Ok(names)
    }

    pub(super) fn put(&self, name: &str, content: Content) -> Result<()> {
        if !self.0.exists() {
            fs::create_dir_all(&self.0).map_err(Error::io(&self.0, "create"))?;
            sync_folder(&self.0)?;
        }
        replace(&self.path(name), true, |file| content(file))
    }
}
