//! What a shell is given: words of its language.

use std::path::Path;

/// A path as a word of a POSIX shell. A name that begins with `-` is told from an option by the folder before it.
pub fn word(path: &Path) -> String {
    let text = path.display().to_string();
    quoted(&if text.starts_with('-') { format!("./{text}") } else { text })
}

/// A text as a word of a POSIX shell.
pub fn quoted(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+=:@%,".contains(c);
    if !text.is_empty() && text.chars().all(plain) { text.into() } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shell_reads_the_word_as_the_path() {
        for (path, expected) in [
            ("a/b-1.ltc", "a/b-1.ltc"),
            ("a b.ltc", "'a b.ltc'"),
            ("it's.ltc", r"'it'\''s.ltc'"),
            ("-o.ltc", "./-o.ltc"),
            ("$HOME", "'$HOME'"),
        ] {
            assert_eq!(word(Path::new(path)), expected);
        }
    }
}
