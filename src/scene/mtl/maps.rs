//! The statement of a map: options, and the name of an image.

use glam::Vec2;

use super::super::lines::unquoted;

/// An image that a material names.
#[derive(Clone, Debug, PartialEq)]
pub(in super::super) struct MtlMap {
    /// File name as written, without quotation marks.
    pub(in super::super) file: String,
    /// Factor of the texture coordinates (`-s`).
    pub(in super::super) scale: Vec2,
    /// Offset of the texture coordinates, added after the factor (`-o`).
    pub(in super::super) offset: Vec2,
    /// Factor of what it raises (`-bm`).
    pub(in super::super) raised: f32,
    /// Whether it ends at its edges (`-clamp on`).
    pub(in super::super) is_clamped: bool,
}

/// Words behind an option: of any kind, or up to so many numbers.
enum Follow {
    Word,
    Numbers(usize),
}

/// The options of the format and those that programs added.
fn followers(option: &str) -> Option<Follow> {
    Some(match option {
        "-blendu" | "-blendv" | "-cc" | "-clamp" | "-imfchan" | "-type" | "-colorspace" => Follow::Word,
        "-boost" | "-bm" | "-texres" => Follow::Numbers(1),
        "-mm" => Follow::Numbers(2),
        "-o" | "-s" | "-t" => Follow::Numbers(3),
        _ => return None,
    })
}

impl MtlMap {
    /// Reads what follows the statement's key (`-s 2 2 1 -bm 0.5 my wood.png`). None where no image is named.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let mut map =
            Self { file: String::new(), scale: Vec2::ONE, offset: Vec2::ZERO, raised: 1.0, is_clamped: false };
        let mut rest = text.trim();
        while rest.starts_with('-') {
            let Some((option, after)) = rest.split_once(char::is_whitespace) else {
                if followers(rest).is_some() {
                    return None;
                }
                break;
            };
            match map.take_option(option, after) {
                Some(after) => rest = after,
                // What begins with a dash and is no option is the name.
                None => break,
            }
        }
        // Some programs write the options last.
        for (at, _) in rest.match_indices(" -") {
            let (name, options) = (&rest[..at], rest[at..].trim_start());
            let option = options.split_whitespace().next().unwrap_or_default();
            if name.contains('.') && followers(option).is_some() {
                let mut left = options;
                while let Some((option, after)) = left.split_once(char::is_whitespace) {
                    match map.take_option(option, after) {
                        Some(after) => left = after,
                        None => break,
                    }
                }
                rest = name;
                break;
            }
        }
        map.file = unquoted(rest).to_owned();
        (!map.file.is_empty()).then_some(map)
    }

    /// Reads what follows an option, and returns what is left. None where that is not an option of a map.
    fn take_option<'a>(&mut self, option: &str, after: &'a str) -> Option<&'a str> {
        let mut rest = after.trim_start();
        let mut numbers = Vec::new();
        // Of an unknown option: its numbers, or else one word if there is something behind it.
        let follow = followers(option);
        let most = match follow {
            Some(Follow::Word) => 0,
            Some(Follow::Numbers(most)) => most,
            None => usize::MAX,
        };
        while numbers.len() < most {
            let (word, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
            let Ok(number) = word.parse::<f32>() else { break };
            numbers.push(number);
            rest = after.trim_start();
        }
        if matches!(follow, Some(Follow::Word)) || (follow.is_none() && numbers.is_empty()) {
            let (word, after) = match rest.split_once(char::is_whitespace) {
                Some(split) => split,
                None if follow.is_some() => (rest, ""),
                None => return None,
            };
            self.is_clamped |= option == "-clamp" && word == "on";
            rest = after.trim_start();
        }
        let pair = |missing: f32| Vec2::new(numbers[0], numbers.get(1).copied().unwrap_or(missing));
        if !numbers.is_empty() && numbers.iter().all(|v| v.is_finite()) {
            match option {
                "-s" => self.scale = pair(1.0),
                "-o" => self.offset = pair(0.0),
                "-bm" => self.raised = numbers[0],
                _ => {}
            }
        }
        Some(rest)
    }

    /// Whether it uses the texture coordinates without a transform.
    pub(in super::super) fn is_plain(&self) -> bool {
        self.scale == Vec2::ONE && self.offset == Vec2::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(text: &str) -> Option<String> {
        MtlMap::parse(text).map(|map| map.file)
    }

    #[test]
    fn maps_are_found_behind_their_options_and_before_them() {
        let names = [
            ("wood.png", "wood.png"),
            ("-s 2 2 1 -clamp on tex\\my wood.png", "tex\\my wood.png"),
            ("-bm 0.5 4.png", "4.png"),
            ("-colorspace sRGB -o 0.1 diffuse.jpg", "diffuse.jpg"),
            ("-colorspace linear -bm 3 bumpmap.jpg", "bumpmap.jpg"),
            ("-s 0.1 0.2 specular.jpg", "specular.jpg"),
            ("-blendu on -bm 0.2 -mm 0 1 -o 0 0 0 -s 1 1 1 textures/Wood Dark.png", "textures/Wood Dark.png"),
            ("-imfchan l -texres 512 a b.png", "a b.png"),
            ("-future 1 2 3 4 5 a.png", "a.png"),
            ("-future word a.png", "a.png"),
            ("wood.png -s 2 2 2", "wood.png"),
            ("my wood.png -clamp on -o 0.5 0 0", "my wood.png"),
            ("wood -s.png", "wood -s.png"),
            ("-wood.png", "-wood.png"),
            ("\"my wood.png\"", "my wood.png"),
            ("wood #2.png", "wood #2.png"),
        ];
        for (text, name) in names {
            assert_eq!(file(text).as_deref(), Some(name), "{text}");
        }
        assert_eq!((file(""), file("-s 1 1 1"), file("-clamp on")), (None, None, None));
    }

    #[test]
    fn where_maps_lie_is_read() {
        let map = |text: &str| MtlMap::parse(text).unwrap();
        assert_eq!(map("-s 4 2 1 -o 0.5 a.png").scale, Vec2::new(4.0, 2.0));
        assert_eq!(map("-s 4 2 1 -o 0.5 a.png").offset, Vec2::new(0.5, 0.0));
        assert_eq!(map("a.png -s 3 3 3").scale, Vec2::splat(3.0));
        assert!(map("-clamp on a.png").is_clamped && !map("-clamp off a.png").is_clamped);
        assert!(map("-s 1 1 1 -o 0 0 0 -mm 0 1 a.png").is_plain() && !map("-o 0.5 0 a.png").is_plain());
    }
}
