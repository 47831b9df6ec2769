//! What the library advises, in the options of these programs.

use ltm::error::Hint;

/// A hint in flags.
pub fn in_flags(hint: &Hint) -> String {
    let words = match hint {
        Hint::Text(text) => text,
        Hint::Overwrite => "choose another name, or say --force to replace it",
        Hint::BeginAnew => {
            "finish it with the command that began it, choose another name, or say --force to begin anew"
        }
        Hint::Continue => "the same command continues",
        Hint::Repeat => "run the command again",
        Hint::Unfinished { partial } => {
            return format!("run its command again to finish it, or open {}", partial.display());
        }
        Hint::AllowOutside => "put it there, or allow it if you trust who wrote this (--allow-outside)",
        Hint::AllowMissing => {
            "put them there, take the maps out of the materials, or allow them to be missing (--allow-missing)"
        }
        Hint::AllowLostLights => "ask for a finer --target or a higher --rank, or say --force to write it all the same",
        Hint::ChooseCamera => "--camera chooses",
        Hint::SameRender => "give the scene file, --samples, --seed, --size and --camera that it was rendered with",
        Hint::MoreMemory => {
            "give it more, or take smaller blocks (block_side in a scene file, --block-side for images)"
        }
        Hint::RaiseMemoryLimit { .. } => {
            "raise --memory, or take smaller blocks (block_side in a scene file, --block-side for images)"
        }
        Hint::ChooseLayers => "--layers says which layers are lights",
        Hint::ChooseLayersOrFiles => {
            "say which are with --layers 'RGBA_(.+)', or name the files by a pattern such as 'room_{light}.exr'"
        }
        Hint::OneViewLayer => "name the layers of one view layer with --layers",
        Hint::OneView { pattern } => {
            return format!("choose the layers of one view, for example with --layers '{pattern}'");
        }
        Hint::LeaveLightOut => "leave it out (--layers says which layers are lights)",
        Hint::FlattenLights => {
            "save a.reshape(-1, *a.shape[-3:]): lights are one dimension; --texels ACROSSxDOWN makes them a grid again"
        }
        Hint::FewerLights => "choose some with --lights, or write a file for each with {light} in the name",
        Hint::ImagesForDenoiser => {
            "write the images with ltm-unpack --basis and keep their size and the names of their layers"
        }
        Hint::DenoiseMatrix => {
            "it takes a matrix whose samples were kept apart, the method auto, and neither --denoise off nor --keep-noise"
        }
        Hint::PackWithoutDenoising => "pack it as it is, with --denoise off",
        Hint::KeepNoise => "--keep-noise follows it further",
        Hint::HigherRank => "a higher --rank goes further",
        Hint::EndAboveZero => "give for example --error 2% or --time 60s",
        Hint::PackFirst => "make one with ltm-pack",
    };
    words.to_owned()
}

/// Reads a size such as `1024x768`.
///
/// # Errors
/// As text: not a size.
pub fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let (width, height) = text.split_once('x').ok_or("write WIDTHxHEIGHT, for example 1024x768")?;
    let side = |s: &str| s.parse().map_err(|e| format!("'{s}' is not a size ({e})"));
    Ok((side(width)?, side(height)?))
}
