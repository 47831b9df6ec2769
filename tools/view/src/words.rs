//! Errors as the window shows them: what the library advises, in the buttons of the window where it has them, else in the
//! options of the programs that made the file.

use ltm::Error;
use ltm::error::Hint;
use ltm_cli::words::in_flags;

/// An error as one line.
pub(crate) fn line(error: &Error) -> String {
    error.worded(in_window)
}

/// A hint for people who look at the window.
fn in_window(hint: &Hint) -> String {
    let words = match hint {
        Hint::Text(text) => text,
        Hint::Overwrite => "choose another name, or press Replace where the name is chosen",
        Hint::BeginAnew => "choose another name, or remove what is left of the other work",
        Hint::Continue | Hint::Repeat => "do it again",
        Hint::AllowOutside => "put it there, and open the lighting again",
        Hint::MoreMemory | Hint::RaiseMemoryLimit { .. } => {
            "close other programs, or start ltm view with more --memory"
        }
        Hint::PackFirst => "make one with ltm-pack, and open it",
        Hint::Unfinished { .. }
        | Hint::AllowMissing
        | Hint::AllowLostLights
        | Hint::ChooseCamera
        | Hint::SameRender
        | Hint::ChooseLayers
        | Hint::ChooseLayersOrFiles
        | Hint::OneViewLayer
        | Hint::OneView { .. }
        | Hint::LeaveLightOut
        | Hint::FlattenLights
        | Hint::FewerLights
        | Hint::ImagesForDenoiser
        | Hint::DenoiseMatrix
        | Hint::PackWithoutDenoising
        | Hint::KeepNoise
        | Hint::HigherRank
        | Hint::EndAboveZero => return in_flags(hint),
    };
    words.to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn advice_names_what_the_window_has() {
        let exists = Error::input("evening.toml", "exists already", Hint::Overwrite);
        assert_eq!(
            line(&exists),
            "evening.toml: exists already; choose another name, or press Replace where the name is chosen"
        );
        let unfinished = Error::input("room.ltc", "is not finished", Hint::Unfinished { partial: "room.part".into() });
        assert_eq!(line(&unfinished), format!("room.ltc: is not finished; {}", in_flags(unfinished.hint().unwrap())));
    }
}
