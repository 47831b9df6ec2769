//! Buffers and what URIs name: the binary chunk, data URIs, files beside the glTF file.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::super::folders::Folders;
use super::super::memory::MemoryBound;
use super::document::MAX_BYTES;
use super::tree::{JsonItem, JsonTree};
use super::{base64, compressed, plain};
use crate::error::{Error, Hint, Result};
use crate::files::read_input;

/// The bytes of all buffers of a file.
pub(super) struct Buffers<'a> {
    pub(super) tree: &'a JsonTree,
    /// Of each buffer its bytes, or why there are none, which counts once they are asked for.
    data: Vec<std::result::Result<Vec<u8>, Absent>>,
    /// What of the views is compressed, decoded, or why it cannot be.
    decoded: HashMap<usize, std::result::Result<Vec<u8>, String>>,
}

/// Extensions that compress buffer views.
const COMPRESSED: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Why a buffer cannot be used, and what to do about it.
struct Absent {
    problem: String,
    hint: Hint,
}

/// A parsed URI.
pub(super) enum Uri {
    /// The bytes are in the URI.
    Data(Vec<u8>),
    /// A file beside the glTF file: its name there.
    File(String),
}

/// Reads all buffers. Errors: what does not fit the memory, and files that the system does not let be read.
pub(super) fn load<'a>(
    path: &Path,
    tree: &'a JsonTree,
    mut binary: Option<Vec<u8>>,
    folders: &Folders,
    memory: &mut MemoryBound,
) -> Result<Buffers<'a>> {
    let mut data = Vec::new();
    for index in 0..tree.count("buffers") {
        let buffer = tree.item("buffers", index)?;
        let binary = if index == 0 { binary.take() } else { None };
        data.push(read(path, &buffer, binary, folders, memory)?);
    }
    let mut buffers = Buffers { tree, data, decoded: HashMap::new() };
    for index in 0..tree.count("bufferViews") {
        // A view that nothing uses may be as it likes.
        let Some(stated) = tree.item("bufferViews", index).ok().and_then(|view| compression(&view)) else { continue };
        let decoded = match buffers.decode(&stated, path, memory) {
            Err(error @ Error::Resources { .. }) => return Err(error),
            Err(Error::Input { problem, .. }) => Err(problem),
            Err(other) => Err(other.to_string()),
            Ok(bytes) => Ok(bytes),
        };
        buffers.decoded.insert(index, decoded);
    }
    Ok(buffers)
}

/// The compression extension of a view, if it has one.
fn compression<'a>(view: &JsonItem<'a>) -> Option<JsonItem<'a>> {
    COMPRESSED.iter().find_map(|name| view.extension(name).ok().flatten())
}

/// The bytes of a buffer, as long as it says.
fn read(
    path: &Path,
    buffer: &JsonItem<'_>,
    binary: Option<Vec<u8>>,
    folders: &Folders,
    memory: &mut MemoryBound,
) -> Result<std::result::Result<Vec<u8>, Absent>> {
    let absent = |problem: String| {
        let hint = "export the file again with all its data";
        Ok(Err(Absent { problem, hint: hint.into() }))
    };
    let mut bytes = match buffer.text("uri")? {
        None => match binary {
            Some(bytes) => bytes,
            None => return absent("has no data".into()),
        },
        Some(text) => match uri(text) {
            Err(problem) => return absent(problem.into()),
            Ok(Uri::Data(bytes)) => {
                memory.take(bytes.len() as u64, path)?;
                bytes
            }
            Ok(Uri::File(name)) => {
                let file: PathBuf = path.parent().unwrap_or(Path::new("")).join(&name);
                let Ok(found) = std::fs::metadata(&file) else {
                    return absent(format!("is the file \"{}\", which is missing", plain(&name)));
                };
                if let Err(Error::Input { problem, hint, .. }) = folders.reach.admit(&file, "") {
                    return Ok(Err(Absent { problem, hint }));
                }
                memory.take(found.len(), &file)?;
                read_input(&file, "read the buffer", MAX_BYTES)?
            }
        },
    };
    let length = buffer.whole("byteLength")?.unwrap_or(bytes.len());
    if bytes.len() < length {
        return absent(format!("is truncated: it should have {length} bytes, and has {}", bytes.len()));
    }
    bytes.truncate(length);
    Ok(Ok(bytes))
}

/// What a URI means. Errors: what is neither a data URI nor the name of a file in the same folder or below.
pub(super) fn uri(text: &str) -> Result<Uri, &'static str> {
    if let Some(data) = text.strip_prefix("data:") {
        let (kind, encoded) = data.split_once(',').ok_or("is a data URI without data")?;
        let bytes = match kind.ends_with(";base64") {
            true => base64::decode(encoded).ok_or("is a data URI whose base 64 is damaged")?,
            false => unescaped(encoded).ok_or("is a data URI with damaged escapes")?,
        };
        return Ok(Uri::Data(bytes));
    }
    let name = unescaped(text).and_then(|bytes| String::from_utf8(bytes).ok());
    let name = name.ok_or("has a URI with damaged escapes")?.replace('\\', "/");
    let leaves = name.starts_with('/') || name.split('/').any(|part| part == "..");
    if leaves || name.contains(':') || name.contains('\0') || name.is_empty() {
        return Err("names a file that is not in the folder of the glTF file");
    }
    Ok(Uri::File(name))
}

/// The bytes of a text with its `%20`s as the characters that they mean.
fn unescaped(text: &str) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((&byte, after)) = rest.split_first() {
        rest = after;
        if byte == b'%' {
            let digits = std::str::from_utf8(after.get(..2)?).ok()?;
            bytes.push(u8::from_str_radix(digits, 16).ok()?);
            rest = &after[2..];
        } else {
            bytes.push(byte);
        }
    }
    Some(bytes)
}

impl<'a> Buffers<'a> {
    pub(super) fn refuse(&self, what: String) -> Error {
        Error::input(self.tree.place(), what, "export the file again")
    }

    /// Bytes of all buffers.
    pub(super) fn len(&self) -> usize {
        self.data.iter().flatten().chain(self.decoded.values().flatten()).map(Vec::len).sum()
    }

    /// The bytes of a view. Errors: it is not there, has no data, goes past their end, or cannot be decoded.
    pub(super) fn view(&self, index: usize) -> Result<&[u8]> {
        match self.decoded.get(&index) {
            Some(Ok(bytes)) => Ok(bytes),
            Some(Err(problem)) => {
                let problem = format!("buffer view {index}: {problem}");
                Err(Error::input(self.tree.place(), problem, "export the file again without compression"))
            }
            None => {
                let view = self.tree.item("bufferViews", index)?;
                self.part(&view, &format!("buffer view {index}"))
            }
        }
    }

    /// How far apart the elements of a view begin, if it says so.
    pub(super) fn stride(&self, index: usize) -> Result<Option<usize>> {
        let view = self.tree.item("bufferViews", index)?;
        let compressed = compression(&view).map(|stated| stated.whole("byteStride")).transpose()?.flatten();
        // Zero is how older exporters say that elements follow each other.
        Ok(view.whole("byteStride")?.filter(|stride| *stride != 0).or(compressed))
    }

    /// The bytes of the buffer that `stated` names, from its offset on.
    fn part(&self, stated: &JsonItem<'_>, what: &str) -> Result<&[u8]> {
        let buffer = stated.index("buffer", "buffers")?.ok_or_else(|| stated.refuse("buffer", "is missing"))?;
        let whole = match &self.data[buffer] {
            Ok(bytes) => bytes,
            Err(Absent { problem, hint }) => {
                return Err(Error::input(self.tree.place(), format!("buffer {buffer} {problem}"), hint.clone()));
            }
        };
        let offset = stated.whole("byteOffset")?.unwrap_or(0);
        let length = stated.whole("byteLength")?.ok_or_else(|| stated.refuse("byteLength", "is missing"))?;
        offset.checked_add(length).and_then(|end| whole.get(offset..end)).ok_or_else(|| {
            let bytes = whole.len();
            self.refuse(format!("{what} goes past the end of buffer {buffer}, which has {bytes} bytes"))
        })
    }

    /// The bytes of a compressed view.
    fn decode(&self, stated: &JsonItem<'_>, path: &Path, memory: &mut MemoryBound) -> Result<Vec<u8>> {
        let whole = |key: &str| stated.whole(key)?.ok_or_else(|| stated.refuse(key, "is missing"));
        let (count, stride) = (whole("count")?, whole("byteStride")?);
        let bytes = self.part(stated, "what is compressed")?;
        memory.check((count as u64).saturating_mul(stride as u64), path)?;
        let (mode, filter) = (stated.text("mode")?.unwrap_or(""), stated.text("filter")?.unwrap_or("NONE"));
        let decoded = compressed::meshopt(bytes, mode, filter, count, stride)
            .map_err(|problem| Error::input(self.tree.place(), problem, ""))?;
        memory.take(decoded.len() as u64, path)?;
        Ok(decoded)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_stay_in_the_folder() {
        let file = |text: &str| match uri(text) {
            Ok(Uri::File(name)) => Some(name),
            _ => None,
        };
        assert_eq!(file("a%20b.bin").as_deref(), Some("a b.bin"));
        assert_eq!(file("textures/wood.png").as_deref(), Some("textures/wood.png"));
        for outside in ["/etc/passwd", "../a.bin", "a/../../b", "a/%2e%2e/b", "file:///a", "http://a/b", "", "a%2"] {
            assert_eq!(file(outside), None, "{outside}");
        }
        assert!(matches!(uri("data:application/octet-stream;base64,Zm9v"), Ok(Uri::Data(bytes)) if bytes == b"foo"));
        assert!(matches!(uri("data:text/plain,foo%0A"), Ok(Uri::Data(bytes)) if bytes == b"foo\n"));
        assert!(uri("data:text/plain").is_err() && uri("data:,%").is_err());
    }
}
