//! Buffers and what URIs name: the binary chunk, data URIs, files beside the glTF file.

use std::path::{Path, PathBuf};

use gltf::Document;
use gltf::buffer::{Source, View};

use super::super::folders::Folders;
use super::super::memory::Memory;
use super::document::MOST_BYTES;
use super::{base64, plain};
use crate::error::{Error, Result};
use crate::files::read_input;

/// The bytes of all buffers of a file.
pub(super) struct Buffers {
    /// The file, for messages.
    pub(super) place: String,
    data: Vec<Vec<u8>>,
}

/// What a URI means.
pub(super) enum Uri {
    /// The bytes are in the URI.
    Data(Vec<u8>),
    /// A file beside the glTF file: its name there.
    File(String),
}

/// Reads all buffers.
pub(super) fn load(
    path: &Path,
    document: &Document,
    mut binary: Option<Vec<u8>>,
    folders: &Folders,
    memory: &mut Memory,
) -> Result<Buffers> {
    let place = path.display().to_string();
    let mut data = Vec::new();
    for (index, buffer) in document.buffers().enumerate() {
        let refuse = |problem: String| {
            Error::input(place.as_str(), format!("buffer {index} {problem}"), "export the file again with all its data")
        };
        let mut bytes = match buffer.source() {
            Source::Bin if index == 0 => binary.take().ok_or_else(|| refuse("has no data".into()))?,
            Source::Bin => return Err(refuse("has no data".into())),
            Source::Uri(text) => match uri(text).map_err(|problem| refuse(problem.into()))? {
                Uri::Data(bytes) => {
                    memory.take(bytes.len() as u64, path)?;
                    bytes
                }
                Uri::File(name) => {
                    let file: PathBuf = path.parent().unwrap_or(Path::new("")).join(&name);
                    let length = std::fs::metadata(&file)
                        .map_err(|_| refuse(format!("is the file \"{}\", which is missing", plain(&name))))?
                        .len();
                    folders.reach.admit(&file, &place)?;
                    memory.take(length, &file)?;
                    read_input(&file, "read the buffer", MOST_BYTES)?
                }
            },
        };
        if bytes.len() < buffer.length() {
            let (stated, found) = (buffer.length(), bytes.len());
            return Err(refuse(format!("is truncated: it should have {stated} bytes, and has {found}")));
        }
        bytes.truncate(buffer.length());
        data.push(bytes);
    }
    Ok(Buffers { place, data })
}

/// What a URI means. Errors: what is neither a data URI in base 64 nor the name of a file in the same folder or below.
pub(super) fn uri(text: &str) -> Result<Uri, &'static str> {
    if let Some(data) = text.strip_prefix("data:") {
        let (_, encoded) = data.split_once(";base64,").ok_or("is a data URI without base 64")?;
        return base64::decode(encoded).map(Uri::Data).ok_or("is a data URI whose base 64 is damaged");
    }
    let name = unescaped(text).ok_or("has a URI with damaged escapes")?.replace('\\', "/");
    let leaves = name.starts_with('/') || name.split('/').any(|part| part == "..");
    if leaves || name.contains(':') || name.contains('\0') || name.is_empty() {
        return Err("names a file that is not in the folder of the glTF file");
    }
    Ok(Uri::File(name))
}

/// A text with its `%20`s as the characters that they mean.
fn unescaped(text: &str) -> Option<String> {
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
    String::from_utf8(bytes).ok()
}

impl Buffers {
    pub(super) fn refuse(&self, what: String) -> Error {
        Error::input(self.place.as_str(), what, "export the file again")
    }

    /// Bytes of all buffers.
    pub(super) fn len(&self) -> usize {
        self.data.iter().map(Vec::len).sum()
    }

    /// The bytes of a view.
    pub(super) fn view(&self, view: &View<'_>) -> Result<&[u8]> {
        let whole = &self.data[view.buffer().index()];
        let end = view.offset().checked_add(view.length());
        end.and_then(|end| whole.get(view.offset()..end)).ok_or_else(|| {
            let (index, buffer) = (view.index(), view.buffer().index());
            self.refuse(format!(
                "buffer view {index} goes past the end of buffer {buffer}, which has {} bytes",
                whole.len()
            ))
        })
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
        assert!(uri("data:text/plain,foo").is_err());
    }
}
