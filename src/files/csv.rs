//! Text in tables of comma-separated values (RFC 4180).

use std::borrow::Cow;

/// A field of a table, in quotes where it needs them.
pub fn csv_field(text: &str) -> Cow<'_, str> {
    if text.contains([',', '"', '\n', '\r']) { csv_quoted(text).into() } else { text.into() }
}

/// A field of a table in quotes.
pub fn csv_quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}
