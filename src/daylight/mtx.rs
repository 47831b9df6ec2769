//! Matrices in Radiance's files (`.mtx`): of `gendaymtx`, `rmtxop` and `dctimestep`.

use std::fmt::Write as _;
use std::path::Path;

use crate::error::{Error, Result};
use crate::files::{read_input, write_file};

/// Bytes of a matrix at most.
const MAX_BYTES: u64 = 16 << 30;

/// How values are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MtxFormat {
    /// As text.
    Ascii,
    /// In 32 bits, of the byte order that the header says.
    #[default]
    Float,
}

/// A matrix of values of several components: `gendaymtx` has a row for each patch, a column for each time, and red, green and blue.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RadianceMatrix {
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub columns: usize,
    /// Values of an entry.
    pub components: usize,
    /// The values: row after row, entry after entry.
    pub values: Vec<f32>,
}

impl RadianceMatrix {
    /// An entry's values.
    ///
    /// # Panics
    /// If there is no such entry.
    pub fn entry(&self, row: usize, column: usize) -> &[f32] {
        &self.values[(row * self.columns + column) * self.components..][..self.components]
    }

    /// Reads a file; double precision is read too.
    ///
    /// # Errors
    /// The file cannot be read, has no header of Radiance, another format, or another number of values than it says.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(&path.display().to_string(), &read_input(path, "read the matrix", MAX_BYTES)?)
    }

    /// As [`read`](Self::read), of the file's bytes; `place` names it in messages.
    ///
    /// # Errors
    /// Those of [`read`](Self::read).
    pub fn parse(place: &str, bytes: &[u8]) -> Result<Self> {
        let refuse = |problem: String| Error::input(place, problem, "give a matrix of gendaymtx, rmtxop or dctimestep");
        let end = bytes.windows(2).position(|pair| pair == b"\n\n").ok_or_else(|| refuse("has no header".into()))?;
        let header = String::from_utf8_lossy(&bytes[..end]);
        if !header.starts_with("#?") {
            return Err(refuse("does not begin with #?RADIANCE".into()));
        }
        let of = |key: &str| header.lines().rev().find_map(|line| line.strip_prefix(key)).map(str::trim);
        let size = |key: &str| of(key).and_then(|text| text.parse::<usize>().ok()).filter(|size| *size > 0);
        let sizes = [size("NROWS="), size("NCOLS="), Some(size("NCOMP=").unwrap_or(3))];
        let [Some(rows), Some(columns), Some(components)] = sizes else {
            return Err(refuse("has no NROWS and NCOLS in its header".into()));
        };
        let count = rows.checked_mul(columns).and_then(|n| n.checked_mul(components));
        let count = count.ok_or_else(|| refuse(format!("has {rows} × {columns} entries")))?;
        let (body, is_big) = (&bytes[end + 2..], of("BigEndian=") == Some("1"));
        let values: Vec<f32> = match of("FORMAT=") {
            Some("ascii") => String::from_utf8_lossy(body)
                .split_ascii_whitespace()
                .map(|word| word.parse().map_err(|_| refuse(format!("'{word}' is no number"))))
                .collect::<Result<_>>()?,
            Some("float") => body
                .as_chunks::<4>()
                .0
                .iter()
                .map(|b| if is_big { f32::from_be_bytes(*b) } else { f32::from_le_bytes(*b) })
                .collect(),
            Some("double") => body
                .as_chunks::<8>()
                .0
                .iter()
                .map(|b| (if is_big { f64::from_be_bytes(*b) } else { f64::from_le_bytes(*b) }) as f32)
                .collect(),
            other => return Err(refuse(format!("has the format '{}'", other.unwrap_or_default()))),
        };
        if values.len() != count {
            return Err(refuse(format!("has {} values, its header says {count}", values.len())));
        }
        Ok(Self { rows, columns, components, values })
    }

    /// Writes a file; `made_by` is a line for its header.
    ///
    /// # Errors
    /// The system refuses, or a file is there that may not be replaced.
    pub fn write(&self, path: &Path, format: MtxFormat, made_by: &str, overwrite: bool) -> Result<()> {
        let name = if format == MtxFormat::Ascii { "ascii" } else { "float" };
        let mut header = format!("#?RADIANCE\n{}\n", made_by.replace('\n', " "));
        let _ = write!(header, "NROWS={}\nNCOLS={}\nNCOMP={}\n", self.rows, self.columns, self.components);
        if format == MtxFormat::Float {
            header += "BigEndian=0\n";
        }
        let _ = write!(header, "FORMAT={name}\n\n");
        let mut bytes = header.into_bytes();
        match format {
            MtxFormat::Float => bytes.extend(self.values.iter().flat_map(|value| value.to_le_bytes())),
            MtxFormat::Ascii => {
                let mut text = String::new();
                for row in self.values.chunks_exact((self.columns * self.components).max(1)) {
                    for entry in row.chunks_exact(self.components.max(1)) {
                        let words: Vec<String> = entry.iter().map(f32::to_string).collect();
                        text += &words.join(" ");
                        text.push('\n');
                    }
                    if self.columns > 1 {
                        text.push('\n');
                    }
                }
                bytes.extend(text.into_bytes());
            }
        }
        write_file(path, overwrite, &bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_survives_its_files() {
        let matrix = RadianceMatrix {
            rows: 2,
            columns: 3,
            components: 3,
            values: (0..18).map(|i| i as f32 * 0.37 + 1e-9).collect(),
        };
        let folder = tempfile::tempdir().unwrap();
        for format in [MtxFormat::Ascii, MtxFormat::Float] {
            let path = folder.path().join(format!("{format:?}.mtx"));
            matrix.write(&path, format, "a test", false).unwrap();
            assert_eq!(RadianceMatrix::read(&path).unwrap(), matrix);
        }
        assert_eq!(matrix.entry(1, 2), &matrix.values[15..18]);
    }

    #[test]
    fn what_is_no_matrix_is_refused_in_a_line() {
        let of = |text: &str| RadianceMatrix::parse("a.mtx", text.as_bytes()).unwrap_err().to_string();
        assert!(of("").contains("has no header"));
        assert!(of("hello\n\n1").contains("#?RADIANCE"));
        assert!(of("#?RADIANCE\nNROWS=2\nFORMAT=ascii\n\n1").contains("NCOLS"));
        assert!(of("#?RADIANCE\nNROWS=2\nNCOLS=1\nNCOMP=1\nFORMAT=ascii\n\n1").contains("1 values, its header says 2"));
        assert!(of("#?RADIANCE\nNROWS=1\nNCOLS=1\nNCOMP=1\nFORMAT=ascii\n\nx").contains("'x'"));
        assert!(of("#?RADIANCE\nNROWS=1\nNCOLS=1\nNCOMP=1\nFORMAT=32-bit_rle_rgbe\n\nx").contains("rgbe"));
    }
}
