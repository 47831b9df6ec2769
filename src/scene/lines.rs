//! Lines of text files that other programs and people write: any ends of lines, a byte order mark, any encoding that keeps
//! ASCII.

use std::borrow::Cow;
use std::io::{BufRead, ErrorKind};

/// Longest line. A line is held as text.
pub(super) const MAX_LINE_BYTES: usize = 16 << 20;

/// Why a line could not be read.
#[derive(Debug)]
pub(super) enum LineError {
    /// The system refuses to read.
    Io(std::io::Error),
    /// The text is none that has lines, in words.
    Unreadable(&'static str),
}

/// Reads a file line by line. A line ends with a line feed, a carriage return, or both.
pub(super) struct Lines<'a> {
    reader: &'a mut dyn BufRead,
    /// Lines read.
    pub(super) count: usize,
    /// Whether the last one ended with a carriage return, which a line feed may follow.
    after_return: bool,
}

impl<'a> Lines<'a> {
    pub(super) fn of(reader: &'a mut dyn BufRead) -> Self {
        Self { reader, count: 0, after_return: false }
    }

    /// Reads the next line, without its end; false where there is none.
    pub(super) fn next(&mut self, line: &mut Vec<u8>) -> Result<bool, LineError> {
        line.clear();
        loop {
            let bytes = match self.reader.fill_buf() {
                Ok(bytes) => bytes,
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Err(error) => return Err(LineError::Io(error)),
            };
            if bytes.is_empty() {
                if !line.is_empty() {
                    self.count += 1;
                    self.check(line)?;
                }
                return Ok(!line.is_empty());
            }
            if std::mem::take(&mut self.after_return) && bytes[0] == b'\n' {
                self.reader.consume(1);
                continue;
            }
            let end = bytes.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
            let taken = end.unwrap_or(bytes.len());
            if line.len() + taken > MAX_LINE_BYTES {
                self.count += 1;
                return Err(LineError::Unreadable("the line is too long to be one"));
            }
            line.extend_from_slice(&bytes[..taken]);
            self.after_return = end.is_some_and(|at| bytes[at] == b'\r');
            self.reader.consume(taken + usize::from(end.is_some()));
            if end.is_some() {
                self.count += 1;
                self.check(line)?;
                return Ok(true);
            }
        }
    }

    /// Takes the mark off the first line, and refuses what is no text of single bytes.
    fn check(&self, line: &mut Vec<u8>) -> Result<(), LineError> {
        if self.count > 1 {
            return Ok(());
        }
        if line.starts_with(b"\xEF\xBB\xBF") {
            line.drain(..3);
        }
        if line.starts_with(b"\xFF\xFE") || line.starts_with(b"\xFE\xFF") || line.contains(&0) {
            return Err(LineError::Unreadable("the file is UTF-16 or no text; save it as UTF-8"));
        }
        Ok(())
    }
}

/// A line as text: UTF-8, else each byte a letter of Latin-1, so that names stay told apart.
pub(super) fn text_of(line: &[u8]) -> Cow<'_, str> {
    match str::from_utf8(line) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(line.iter().map(|&byte| char::from(byte)).collect()),
    }
}

/// What of a line stands before a comment. Not for names, in which `#` is a letter.
pub(super) fn without_comment(text: &str) -> &str {
    text.split('#').next().unwrap_or_default().trim_end()
}

/// A name without the quotation marks around it.
pub(super) fn unquoted(name: &str) -> &str {
    let name = name.trim();
    name.strip_prefix('"').and_then(|rest| rest.strip_suffix('"')).unwrap_or(name).trim()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &[u8]) -> Result<Vec<String>, LineError> {
        // A buffer of a few bytes, so that lines and their ends fall across its ends.
        let mut reader = std::io::BufReader::with_capacity(3, text);
        let (mut lines, mut line, mut found) = (Lines::of(&mut reader), Vec::new(), Vec::new());
        while lines.next(&mut line)? {
            found.push(text_of(&line).into_owned());
        }
        assert_eq!(lines.count, found.len());
        Ok(found)
    }

    #[test]
    fn all_ends_of_lines_are_ends() {
        assert_eq!(lines(b"ab\ncd\n\nef").unwrap(), ["ab", "cd", "", "ef"]);
        assert_eq!(lines(b"ab\r\ncd\r\n\r\nef\r\n").unwrap(), ["ab", "cd", "", "ef"]);
        assert_eq!(lines(b"ab\rcd\r\ref\r").unwrap(), ["ab", "cd", "", "ef"]);
        assert_eq!(lines(b"").unwrap(), [""; 0]);
    }

    #[test]
    fn marks_and_encodings_are_told() {
        assert_eq!(lines(b"\xEF\xBB\xBFv 0\nv 1").unwrap(), ["v 0", "v 1"]);
        assert_eq!(lines(b"g K\xC3\xBCche\ng K\xFCche").unwrap(), ["g Küche", "g Küche"]);
        for text in [&b"\xFF\xFEv\0 \0\n\0"[..], b"\xFE\xFF\0v\0 \0\n", b"v\0\0\0 \0\0\0"] {
            assert!(matches!(lines(text), Err(LineError::Unreadable(_))));
        }
        assert_eq!((unquoted(" \"a b\" "), unquoted("a\""), unquoted("\"")), ("a b", "a\"", "\""));
    }
}
