//! What the library advises, in the keyword arguments of this package.

use ltm::error::Hint;

/// A hint in keyword arguments.
pub(crate) fn in_arguments(hint: &Hint) -> String {
    let words = match hint {
        Hint::Text(text) => text,
        Hint::Overwrite => "choose another name, or overwrite=True",
        Hint::BeginAnew => {
            "finish it with the call that began it, choose another name, or begin anew with overwrite=True"
        }
        Hint::Continue => "the same call continues",
        Hint::Repeat => "make the call again",
        Hint::Unfinished { partial } => {
            return format!("make its call again to finish it, or open {}", partial.display());
        }
        Hint::AllowOutside => "put it there, or allow it if you trust who wrote this (allow_outside=True)",
        Hint::AllowMissing => {
            "put them there, take the maps out of the materials, or allow them to be missing (allow_missing=True)"
        }
        Hint::AllowLostLights => {
            "ask for a finer target or a higher rank, or give overwrite=True to write it all the same"
        }
        Hint::ChooseCamera => "camera=NAME chooses",
        Hint::SameRender => "give the scene, with the samples, seed, size and camera that it was rendered with",
        Hint::MoreMemory => "give it more, or take smaller blocks (block_side=)",
        Hint::RaiseMemoryLimit { .. } => "raise memory=, or take smaller blocks (block_side=)",
        Hint::KeepNoise => "keep_noise=True follows it further",
        Hint::HigherRank => "a higher rank= goes further",
        Hint::ImagesForDenoiser => {
            "write the images with ltm.write_basis and keep their size and the names of their layers"
        }
        Hint::DenoiseMatrix => {
            "it takes a matrix whose samples were kept apart, and neither denoise=False nor keep_noise=True"
        }
        Hint::PackWithoutDenoising => "pack it as it is, with denoise=False",
        Hint::PackFirst => "make one with ltm.pack",
        // Of work that this package does not offer.
        Hint::ChooseLayers
        | Hint::ChooseLayersOrFiles
        | Hint::OneViewLayer
        | Hint::OneView { .. }
        | Hint::LeaveLightOut
        | Hint::FlattenLights
        | Hint::FewerLights
        | Hint::EndAboveZero => return hint.to_string(),
    };
    words.to_owned()
}
