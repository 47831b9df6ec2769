//! Where many machines leave files for each other: a folder that all of them see, or a prefix of an object store.
//!
//! A depot knows whole files only: one is there complete or not at all, and is never changed afterwards. Nothing in it is a lock: who
//! writes a file that another writes too gives it the same bytes under the same name.
//!
//! A store is found and entered as its own tools are: AWS_ENDPOINT_URL, AWS_REGION, AWS_ALLOW_HTTP; AWS_ACCESS_KEY_ID with
//! AWS_SECRET_ACCESS_KEY and AWS_SESSION_TOKEN, a web identity, the credentials of a container or of the machine; AWS_SKIP_SIGNATURE
//! where none are wanted.

mod folder;
#[cfg(feature = "s3")]
mod multipart_upload;
#[cfg(feature = "s3")]
mod read_ahead;
#[cfg(feature = "s3")]
mod s3;

use std::fs;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
#[cfg(feature = "s3")]
use std::sync::Arc;

use self::folder::Folder;
#[cfg(feature = "s3")]
use self::s3::{Bucket, Object};
use crate::error::{Error, Result};
use crate::files::{Ranged, open_input};

/// Begins the address of an object or of a prefix of objects.
const STORE: &str = "s3://";

/// Most bytes that are read at once.
const MAX_WHOLE_BYTES: u64 = 1 << 30;

/// Writes the content of a file; may be called again where a try failed.
pub type Content<'a> = &'a dyn Fn(&mut dyn Write) -> Result<()>;

/// A place for files, by its address.
#[derive(Debug)]
pub struct BlobStore {
    address: String,
    place: Backend,
}

#[derive(Debug)]
enum Backend {
    Folder(Folder),
    #[cfg(feature = "s3")]
    Bucket(Arc<Bucket>),
}

/// Whether a path is the address of an object in a store, and no file.
pub fn is_object(path: &Path) -> bool {
    path.as_os_str().as_encoded_bytes().starts_with(STORE.as_bytes())
}

/// An object of a store, `s3://BUCKET/NAME`, to be read by ranges as it is now.
///
/// # Errors
/// An address that is none; it is not there; the store refuses or does not answer; this program was built without stores.
pub fn open_object(address: &Path) -> Result<Box<dyn Ranged>> {
    let text = address.to_string_lossy();
    let (parent, name) = match text.trim_end_matches('/').rsplit_once('/') {
        Some((parent, name)) if parent.len() >= STORE.len() => (parent, name),
        _ => return Err(Error::input(text, "names no object", "write s3://BUCKET/NAME")),
    };
    BlobStore::open(parent)?.open_file(name)
}

impl BlobStore {
    /// The depot at an address: the path of a folder, which need not exist yet, or `s3://BUCKET/PREFIX`.
    ///
    /// # Errors
    /// An address that is none; settings of a store that cannot be used; this program was built without stores.
    pub fn open(address: &str) -> Result<Self> {
        let place =
            if is_object(Path::new(address)) { bucket(address)? } else { Backend::Folder(Folder::new(address)?) };
        Ok(Self { address: address.to_owned(), place })
    }

    /// Its address, for messages.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Memory that writing to it or reading from it takes at most.
    pub fn held_bytes(&self) -> u64 {
        match &self.place {
            Backend::Folder(_) => 0,
            #[cfg(feature = "s3")]
            Backend::Bucket(_) => multipart_upload::HELD_BYTES.max(read_ahead::HELD_BYTES),
        }
    }

    /// Names that begin so, in order. Nothing is there where the folder or the prefix is not.
    ///
    /// # Errors
    /// It cannot be looked into.
    pub fn names(&self, prefix: &str) -> Result<Vec<String>> {
        let mut names = match &self.place {
            Backend::Folder(folder) => folder.names(prefix)?,
            #[cfg(feature = "s3")]
            Backend::Bucket(bucket) => bucket.names(prefix)?,
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
            Backend::Folder(folder) => folder.put(name, content),
            #[cfg(feature = "s3")]
            Backend::Bucket(bucket) => multipart_upload::Upload::put(bucket, name, content),
        }
    }

    /// A file of it, where it is.
    ///
    /// # Errors
    /// It is not there, or cannot be opened.
    pub fn open_file(&self, name: &str) -> Result<Box<dyn Ranged>> {
        match &self.place {
            Backend::Folder(folder) => Ok(Box::new(open_input(&folder.path(name), "open")?)),
            #[cfg(feature = "s3")]
            Backend::Bucket(bucket) => Ok(Box::new(Object::open(bucket.clone(), name)?)),
        }
    }

    /// A whole file of it, of at most a gibibyte.
    ///
    /// # Errors
    /// It is not there, is larger, or cannot be read.
    pub fn read(&self, name: &str) -> Result<Vec<u8>> {
        let file = self.open_file(name)?;
        let failed = || Error::io(Path::new(&self.address).join(name), "read");
        let bytes = file.bytes().map_err(failed())?;
        if bytes > MAX_WHOLE_BYTES {
            let problem = format!("{bytes} bytes are too many to be read at once");
            return Err(Error::damaged(Path::new(&self.address).join(name), problem, "remove it"));
        }
        let mut content = vec![0; bytes as usize];
        file.fill(&mut content, 0).map_err(failed())?;
        Ok(content)
    }

    /// A file of the depot as a local file: itself, or a copy in `cache`, which is kept.
    ///
    /// # Errors
    /// It cannot be read, or the copy not be written.
    #[cfg_attr(not(feature = "s3"), expect(unused_variables, reason = "folders need no copies"))]
    pub fn local(&self, name: &str, cache: &Path) -> Result<PathBuf> {
        match &self.place {
            Backend::Folder(folder) => Ok(folder.path(name)),
            #[cfg(feature = "s3")]
            Backend::Bucket(bucket) => {
                fs::create_dir_all(cache).map_err(Error::io(cache, "create"))?;
                let path = cache.join(name);
                bucket.copy(name, &path)?;
                Ok(path)
            }
        }
    }

    /// Removes a copy that [`local`](Self::local) made, or all of them; whether there was any. The files of the depot stay.
    ///
    /// # Errors
    /// The system refuses.
    pub fn remove_copies(&self, cache: &Path, name: Option<&str>) -> Result<bool> {
        if matches!(self.place, Backend::Folder(_)) {
            return Ok(false);
        }
        let path = name.map_or_else(|| cache.to_owned(), |name| cache.join(name));
        let removed = if name.is_some() { fs::remove_file(&path) } else { fs::remove_dir_all(&path) };
        match removed {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(false),
            Err(error) => Err(Error::io(&path, "remove")(error)),
        }
    }
}

#[cfg(feature = "s3")]
fn bucket(address: &str) -> Result<Backend> {
    Ok(Backend::Bucket(Arc::new(Bucket::new(address)?)))
}

#[cfg(not(feature = "s3"))]
fn bucket(address: &str) -> Result<Backend> {
    Err(Error::input(address, "this program was built without object stores", "build it with the feature s3"))
}
