//! What the caller may do about an error or a warning, as a value: each front end words it with its own options.

use std::fmt;
use std::path::PathBuf;

/// What the caller may do. `Display` words it in the options and functions of this library; a program that offers them under
/// other names (a command line, Python, a window) matches the variants and words them itself, see
/// [`Error::worded`](super::Error::worded). A new variant is a breaking change on purpose: whoever words hints shall word it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Hint {
    /// Words that name no option. Empty: there is nothing to add.
    Text(String),
    /// An output exists: choose another name, or replace it.
    Overwrite,
    /// An unfinished file is of another job: finish that job, choose another name, or begin anew.
    BeginAnew,
    /// Repeating the work continues it.
    Continue,
    /// Repeating the work mends it.
    Repeat,
    /// The file is not finished: finish it, or open what is there of it.
    Unfinished {
        /// The file that holds what is done.
        partial: PathBuf,
    },
    /// Put the file into the folder, or allow files outside of it.
    AllowOutside,
    /// Put the textures there, or allow them to be missing.
    AllowMissing,
    /// Ask for less loss, or allow lights that are hardly what they are.
    AllowLostLights,
    /// A camera can be chosen by name.
    ChooseCamera,
    /// Give the scene and the settings that the matrix was rendered with.
    SameRender,
    /// Give the system more memory, or take smaller blocks.
    MoreMemory,
    /// Raise the limit of memory that was given, or take smaller blocks.
    RaiseMemoryLimit {
        /// Bytes that would do.
        needed_bytes: u64,
    },
    /// Say which layers of an image file are lights.
    ChooseLayers,
    /// Say which layers are lights, or give a file for each light.
    ChooseLayersOrFiles,
    /// Choose the layers of one view layer.
    OneViewLayer,
    /// Choose the layers of one view.
    OneView {
        /// A pattern of layers that would do.
        pattern: String,
    },
    /// Leave a light out.
    LeaveLightOut,
    /// Lights of an array are one dimension; texels of a light make them a grid again.
    FlattenLights,
    /// Choose some of the lights, or write a file for each.
    FewerLights,
    /// Images to be denoised come from this matrix.
    ImagesForDenoiser,
    /// Denoised images are for a matrix that is denoised.
    DenoiseMatrix,
    /// Pack the matrix without denoising it.
    PackWithoutDenoising,
    /// Follow the matrix through its noise.
    KeepNoise,
    /// Allow a higher rank.
    HigherRank,
    /// Give an error or a time above 0 as the end of a render.
    EndAboveZero,
    /// Write containers by packing.
    PackFirst,
}

impl Hint {
    /// Whether there is nothing to say.
    pub fn is_empty(&self) -> bool {
        matches!(self, Self::Text(text) if text.is_empty())
    }
}

impl From<String> for Hint {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<&str> for Hint {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

/// In the words of this library.
impl fmt::Display for Hint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Text(text) => text,
            Self::Overwrite => "choose another name, or set `overwrite` to replace it",
            Self::BeginAnew => {
                "finish it with the options that began it, choose another name, or set `overwrite` to begin anew"
            }
            Self::Continue => "the same call continues",
            Self::Repeat => "call it again",
            Self::Unfinished { partial } => {
                return write!(f, "call what makes it again to finish it, or open {}", partial.display());
            }
            Self::AllowOutside => "put it there, or set `allow_outside` if you trust who wrote this",
            Self::AllowMissing => "put them there, take the maps out of the materials, or set `allow_missing`",
            Self::AllowLostLights => {
                "ask for a finer `target` or a higher `rank`, or set `allow_lost_lights` to write it all the same"
            }
            Self::ChooseCamera => "`LoadOptions::camera` chooses",
            Self::SameRender => "give the scene, with the samples, seed, size and camera that it was rendered with",
            Self::MoreMemory => "give it more, or take a smaller `block_side`",
            Self::RaiseMemoryLimit { .. } => "raise `memory_bytes`, or take a smaller `block_side`",
            Self::ChooseLayers => "a `LayerPattern` says which layers are lights",
            Self::ChooseLayersOrFiles => {
                "say which are with a `LayerPattern` such as 'RGBA_(.+)', or name the files by a pattern such as \
                 'room_{light}.exr'"
            }
            Self::OneViewLayer => "name the layers of one view layer with a `LayerPattern`",
            Self::OneView { pattern } => {
                return write!(f, "choose the layers of one view, for example with the `LayerPattern` '{pattern}'");
            }
            Self::LeaveLightOut => "leave it out (a `LayerPattern` says which layers are lights)",
            Self::FlattenLights => {
                "save a.reshape(-1, *a.shape[-3:]): lights are one dimension; `take_for_texels` makes them a grid again"
            }
            Self::FewerLights => "select some, or write a file for each with {light} in the name",
            Self::ImagesForDenoiser => {
                "write the images with `pipeline::write_basis` and keep their size and the names of their layers"
            }
            Self::DenoiseMatrix => {
                "it takes a matrix whose samples were kept apart, `Method::Auto`, `denoise`, and a `noise_factor`"
            }
            Self::PackWithoutDenoising => "pack it as it is, with `denoise` off",
            Self::KeepNoise => "without a `noise_factor` packing follows it further",
            Self::HigherRank => "a higher `rank` goes further",
            Self::EndAboveZero => "give for example an error of 0.02, or 60 seconds",
            Self::PackFirst => "make one with `pipeline::pack`",
        })
    }
}

/// Words a hint for the users of one front end.
pub type Wording = fn(&Hint) -> String;

/// The wording of this library.
pub(super) fn in_own_words(hint: &Hint) -> String {
    hint.to_string()
}

/// One line for the user about something that is taken otherwise than they may expect, and what they may do about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Warning {
    /// What is the matter, and where.
    pub text: String,
    /// What to do about it, or empty.
    pub hint: Hint,
}

impl Warning {
    /// A warning with what to do about it.
    pub fn new(text: impl Into<String>, hint: impl Into<Hint>) -> Self {
        Self { text: text.into(), hint: hint.into() }
    }

    /// As one line, its hint in the words of a front end.
    #[must_use]
    pub fn worded(&self, wording: Wording) -> String {
        with_hint(&self.text, &self.hint, wording)
    }
}

/// A line that names no option.
impl From<String> for Warning {
    fn from(text: String) -> Self {
        Self::new(text, "")
    }
}

impl From<&str> for Warning {
    fn from(text: &str) -> Self {
        Self::new(text, "")
    }
}

/// As one line in the words of this library.
impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.worded(in_own_words))
    }
}

/// The warnings of one piece of work, in order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Warnings(Vec<Warning>);

impl Warnings {
    /// None.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds one.
    pub fn push(&mut self, warning: impl Into<Warning>) {
        self.0.push(warning.into());
    }

    /// Takes all of another.
    pub fn append(&mut self, other: &mut Self) {
        self.0.append(&mut other.0);
    }

    /// As lines in the words of a front end.
    #[must_use]
    pub fn worded(&self, wording: Wording) -> Vec<String> {
        self.0.iter().map(|warning| warning.worded(wording)).collect()
    }

    /// As lines in the words of this library.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        self.worded(in_own_words)
    }
}

impl std::ops::Deref for Warnings {
    type Target = [Warning];

    fn deref(&self) -> &[Warning] {
        &self.0
    }
}

impl<W: Into<Warning>> Extend<W> for Warnings {
    fn extend<I: IntoIterator<Item = W>>(&mut self, warnings: I) {
        self.0.extend(warnings.into_iter().map(Into::into));
    }
}

impl<W: Into<Warning>> FromIterator<W> for Warnings {
    fn from_iter<I: IntoIterator<Item = W>>(warnings: I) -> Self {
        Self(warnings.into_iter().map(Into::into).collect())
    }
}

impl IntoIterator for Warnings {
    type Item = Warning;
    type IntoIter = std::vec::IntoIter<Warning>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}

/// A text and what to do about it, as one line.
pub(super) fn with_hint(text: &str, hint: &Hint, wording: Wording) -> String {
    if hint.is_empty() { text.to_owned() } else { format!("{text}; {}", wording(hint)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_warning_is_one_line_with_its_hint_in_the_words_that_are_asked_for() {
        let warning = Warning::new("room: camera 'door' of 2 is used", Hint::ChooseCamera);
        assert_eq!(warning.to_string(), "room: camera 'door' of 2 is used; `LoadOptions::camera` chooses");
        assert_eq!(warning.worded(|_| "choose".into()), "room: camera 'door' of 2 is used; choose");
        assert_eq!(Warning::from("plain").to_string(), "plain");
    }
}
