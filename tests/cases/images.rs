//! Images of other renderers: Radiance HDR, OpenEXR, arrays, files by the number.

#[path = "images/collections.rs"]
mod collections;
#[path = "images/files.rs"]
mod files;
#[path = "images/open_exr.rs"]
mod open_exr;
#[path = "images/radiance.rs"]
mod radiance;
#[path = "images/write.rs"]
mod write;

use super::Outcome::{self, Converted, Read, Refused, Warned};
use super::{Case, Collection};

const RADIANCE: &str = "Radiance HDR";
const EXR: &str = "OpenEXR";
const NUMPY: &str = "NumPy";
const FILES: &str = "Files by the number";

const fn case(format: &'static str, input: &'static str, outcome: Outcome, test: fn()) -> Case {
    Case { format, input, outcome, test }
}

pub(super) const CASES: &[Case] = &[
    case(RADIANCE, "`EXPOSURE`, once or several times", Converted, radiance::exposure),
    case(RADIANCE, "`COLORCORR`", Converted, radiance::correction),
    case(RADIANCE, "`EXPOSURE` of 0, below, or no number", Refused, radiance::no_exposure),
    case(RADIANCE, "XYZE", Converted, radiance::xyze),
    case(RADIANCE, "`PRIMARIES` other than those of Rec. 709", Converted, radiance::primaries),
    case(RADIANCE, "the axes in each of the eight orders", Read, radiance::orders),
    case(RADIANCE, "lines that end with CR LF", Read, radiance::line_ends),
    case(RADIANCE, "`#?RGBE`, no signature, no `FORMAT`", Read, radiance::signatures),
    case(RADIANCE, "flat, run-length encoded as of 1985 and as of 1991", Read, radiance::encodings),
    case(RADIANCE, "cut short, damaged, another `FORMAT`", Refused, radiance::damaged),
    case(RADIANCE, "a sky's map with `EXPOSURE`", Converted, radiance::sky),
    case(EXR, "`chromaticities` of ACEScg and other primaries", Converted, open_exr::acescg),
    case(EXR, "`chromaticities` of CIE XYZ", Converted, open_exr::xyz),
    case(EXR, "`chromaticities` that span no colour space", Refused, open_exr::no_space),
    case(EXR, "`colorInteropID` or `oiio:ColorSpace` without `chromaticities`", Converted, open_exr::named_space),
    case(EXR, "skies and textures: a data window inside the display window", Converted, open_exr::cropped_picture),
    case(EXR, "skies and textures: a data window beyond the display window", Warned, open_exr::overscan_picture),
    case(EXR, "all pixels outside the display window", Refused, open_exr::outside),
    case(EXR, "lights with different data windows", Converted, open_exr::cropped_lights),
    case(EXR, "lights with one data window, a region or overscan", Warned, open_exr::one_window),
    case(EXR, "lights with different display windows", Refused, open_exr::other_frames),
    case(EXR, "`View.Combined.R`, `r g b`, `Y`, one channel alone", Read, open_exr::named_colours),
    case(EXR, "`Y RY BY`, chroma for every second pixel", Converted, open_exr::chroma),
    case(EXR, "light groups in luminance and chroma", Refused, open_exr::chroma_layers),
    case(EXR, "several pictures without a main one", Warned, open_exr::several_pictures),
    case(EXR, "names in UTF-8 and Latin-1", Read, open_exr::names_in),
    case(EXR, "names of any script, written", Read, open_exr::names_out),
    case(EXR, "stereo: skies and textures", Warned, open_exr::stereo_picture),
    case(EXR, "stereo: light groups", Refused, open_exr::stereo_lights),
    case(EXR, "light groups of two view layers", Refused, open_exr::two_view_layers),
    case(EXR, "light groups whose names hold those of passes", Read, open_exr::pass_names),
    case(EXR, "a denoised Combined beside a Noisy Image", Read, open_exr::noisy_image),
    case(EXR, "denoised copies, variances, LightMix and other sums", Read, open_exr::copies_and_sums),
    case(EXR, "lights of Karma, RenderMan, Redshift and Octane by their names", Read, open_exr::renderers),
    case(EXR, "a light that is the sum of the others", Warned, open_exr::sum_of_others),
    case(NUMPY, "float16, float32, float64 `[lights, height, width, 3]`", Read, files::floats),
    case(NUMPY, "`[height, width, 3, 3]`, as `ltm.open` shows three columns", Refused, files::lights_last),
    case(NUMPY, "images 3 pixels wide with as many names", Read, files::narrow),
    case(NUMPY, "grey, alpha, colours first, lights last, grids", Refused, files::other_shapes),
    case(NUMPY, "integers, big-endian, Fortran order, objects", Refused, files::other_types),
    case(NUMPY, "names as text of any script or as bytes", Read, files::names),
    case(NUMPY, "names that are empty or the same", Refused, files::bad_names),
    case(NUMPY, "an archive without `images`", Refused, files::other_archives),
    case(FILES, "`frame_2` and `frame_10`, layers of such names", Read, files::numbers),
    case(FILES, "`._1.exr`, `.DS_Store`, folders", Read, files::hidden),
    case(FILES, "TIFF, a camera's raw", Refused, files::unread),
    case(FILES, "PNG, JPEG, TGA, BMP", Converted, files::encoded),
    case(FILES, "a portable float map with a scale", Warned, files::scaled),
    case(FILES, "files of different sizes", Refused, files::sizes),
    case(FILES, "names of lights with `/`, `..` or `*`", Read, files::odd_names),
];

pub(super) const COLLECTIONS: &[Collection] = &[
    Collection { folder: "20-exr-lightgroup-names", test: collections::names },
    Collection { folder: "21-exr-two-viewlayers", test: collections::view_layers },
    Collection { folder: "22-exr-datawindow", test: collections::windows },
    Collection { folder: "23-exr-denoised", test: collections::denoised },
    Collection { folder: "26-exr-chromaticities", test: collections::chromaticities },
    Collection { folder: "27-exr-stereo", test: collections::stereo },
    Collection { folder: "28-lightmix", test: collections::light_mix },
    Collection { folder: "40-hdr-quirks", test: collections::hdr },
    Collection { folder: "41-env-datawindow", test: collections::skies },
    Collection { folder: "50-numpy", test: collections::numpy },
    Collection { folder: "51-olat", test: collections::olat },
    Collection { folder: "53-light-names", test: collections::light_names },
];
