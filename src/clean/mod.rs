//! Cleaning: the grain of few samples taken out of images, for all lightings at once.
//!
//! What is cleaned are the images of a few clusters of columns (`light::Clusters`), from the top of the image down;
//! every lighting's image is then a sum of these. Light that comes straight from emitters and all other light are
//! filtered apart, each divided by the albedo of what it falls on:
//!
//! 1. A few *guides*, mixtures of the clusters' images by principal components ([`Tally`]), are filtered first.
//! 2. Each pixel of every image becomes the value of a plane through its neighbours, weighted by how alike they are: in what
//!    they see (normal, albedo, inverse depth on the plane of the surface, shares) and in the filtered guides, as far as the
//!    noise lets one say so: non-local means (Buades, Coll, Morel 2005) with features and guides in place of patches
//!    (Rousselle, Manzi, Zwicker 2013). The noise is known from the two halves of the samples; of direct light each half is weighed by
//!    the guides of the other.
//! 3. What is left of grain in one cluster's image, where weights that are common to all may not average it, its own finds
//!    (`alone`): a lamp has no edges where the others have their shadows. In large images near first, then far. The sum of all stays
//!    as it was.
//! 4. Pixel by pixel and cluster by cluster the mean is mixed with what was there, as far as the estimated risk falls
//!    (Stein 1981), so that at many samples nothing is averaged.
//!
//! Weights add up to one, so that fireflies are spread over what is alike, not cut; one that stands alone has no like and loses
//! much of its light to the weights. Of whole images about 1 % is lost at worst, as by other denoisers. A plane, not a mean, so
//! that corners and contact shadows, where all that is alike lies to one side, are not brightened (`kernel`).

mod albedo;
mod alone;
mod cleaning;
mod constants;
mod errors;
mod filter;
mod guide;
mod kernel;
mod map_fit;
mod reach;
mod rows;
mod shrink;
mod stage;
mod surfaces;
mod tally;
mod tile;

/// Version of what cleaning makes of images; every interrupted pack names it. To be raised with every change of that.
pub const CLEANER_VERSION: u32 = 18;

pub use cleaning::{Cleaned, CleanedRegion, Cleaning, Strip};
pub use errors::ErrorSums;
pub use map_fit::{MapFit, TILE, tile_means};
pub use reach::Reach;
pub use rows::{Pool, Region, Rows};
pub use tally::{Guides, Tally};
