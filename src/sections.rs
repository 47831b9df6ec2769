//! Tagged sections: metadata as a list of parts, each with a tag, a length and its bytes. A reader passes over a section that
//! it does not know, unless the tag says that it must know it.

use std::collections::HashSet;
use std::fmt;

/// Bytes before the body of a section: its tag and the length of the body.
const HEAD_BYTES: usize = 8;

/// The name of a section: four ASCII letters. As in PNG, a capital first letter marks a section that a reader must know.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Tag(pub(crate) [u8; 4]);

impl Tag {
    /// Whether a reader that does not know the section must refuse the file.
    fn is_required(self) -> bool {
        self.0[0].is_ascii_uppercase()
    }
}

impl fmt::Display for Tag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "'{}'", self.0.escape_ascii())
    }
}

/// Appends a section to `bytes`.
///
/// # Panics
/// If the body has 2³² bytes or more; a record has at most [`MAX_BYTES`](crate::encoding::MAX_BYTES).
pub(crate) fn append(bytes: &mut Vec<u8>, tag: Tag, body: &[u8]) {
    let length = u32::try_from(body.len()).expect("a record is shorter than 2³² bytes");
    bytes.extend(tag.0);
    bytes.extend(length.to_le_bytes());
    bytes.extend(body);
}

/// The sections that a reader knows, borrowed from the bytes that hold them.
#[derive(Debug)]
pub(crate) struct Sections<'a>(Vec<(Tag, &'a [u8])>);

impl<'a> Sections<'a> {
    /// Splits bytes into sections and keeps the `known` ones. Every length is checked before it is used.
    ///
    /// # Errors
    /// As text for the caller to place: a section that is cut short or claims more bytes than there are, a tag that is not
    /// four letters or stands twice, an unknown section that a reader must know.
    pub(crate) fn split(mut bytes: &'a [u8], known: &[Tag]) -> Result<Self, String> {
        let (mut sections, mut tags) = (Vec::new(), HashSet::new());
        while !bytes.is_empty() {
            let Some((head, rest)) = bytes.split_first_chunk::<HEAD_BYTES>() else {
                return Err(format!("a section is cut short: {} bytes of at least {HEAD_BYTES}", bytes.len()));
            };
            let [a, b, c, d, length @ ..] = *head;
            let (tag, length) = (Tag([a, b, c, d]), u32::from_le_bytes(length) as usize);
            if !tag.0.iter().all(u8::is_ascii_alphabetic) {
                return Err(format!("a section has the tag {tag}, which is not four letters"));
            }
            let Some((body, rest)) = rest.split_at_checked(length) else {
                return Err(format!("section {tag} claims {length} bytes, {} are left", rest.len()));
            };
            if !tags.insert(tag) {
                return Err(format!("section {tag} stands twice"));
            }
            match known.contains(&tag) {
                true => sections.push((tag, body)),
                false if tag.is_required() => {
                    return Err(format!(
                        "section {tag} is unknown and needed to read the file: a newer program wrote it"
                    ));
                }
                false => {}
            }
            bytes = rest;
        }
        Ok(Self(sections))
    }

    /// The body of a section, where it is there.
    pub(crate) fn body(&self, tag: Tag) -> Option<&'a [u8]> {
        self.0.iter().find(|section| section.0 == tag).map(|section| section.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: Tag = Tag(*b"Ones");
    const TWO: Tag = Tag(*b"twos");

    fn listed(sections: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
        let mut bytes = Vec::new();
        sections.iter().for_each(|(tag, body)| append(&mut bytes, Tag(**tag), body));
        bytes
    }

    #[test]
    fn a_section_is_tag_length_and_bytes_and_any_order_is_read() {
        let bytes = listed(&[(b"twos", b"two"), (b"Ones", b"")]);
        assert_eq!(bytes, b"twos\x03\0\0\0twoOnes\0\0\0\0");
        let sections = Sections::split(&bytes, &[ONE, TWO]).unwrap();
        assert_eq!((sections.body(ONE), sections.body(TWO)), (Some(&b""[..]), Some(&b"two"[..])));
        assert!(Sections::split(b"", &[ONE]).unwrap().body(ONE).is_none());
    }

    #[test]
    fn unknown_sections_are_passed_over_unless_a_reader_must_know_them() {
        let bytes = listed(&[(b"newx", b"what")]);
        assert!(Sections::split(&bytes, &[ONE]).unwrap().0.is_empty());
        let bytes = listed(&[(b"Newx", b"what")]);
        assert!(Sections::split(&bytes, &[ONE]).unwrap_err().contains("'Newx' is unknown"));
    }

    #[test]
    fn what_does_not_hold_together_is_refused() {
        let good = listed(&[(b"Ones", b"one"), (b"twos", b"two")]);
        for length in (1..good.len()).filter(|&length| length != 11) {
            assert!(Sections::split(&good[..length], &[ONE, TWO]).is_err(), "{length}");
        }
        let refused = |bytes: &[u8], words: &str| {
            let problem = Sections::split(bytes, &[ONE, TWO]).unwrap_err();
            assert!(problem.contains(words), "{problem}");
        };
        refused(b"Ones\xff\xff\xff\xffone", "claims 4294967295 bytes, 3 are left");
        refused(&listed(&[(b"Ones", b"one"), (b"twos", b""), (b"Ones", b"one")]), "'Ones' stands twice");
        refused(&listed(&[(b"news", b""), (b"news", b"")]), "'news' stands twice");
        refused(&listed(&[(b"On\0s", b"one")]), "not four letters");
    }
}
