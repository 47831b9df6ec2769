//! Denoising of images from few samples, for all lightings at once.
//!
//! The input are the images of a few clusters of columns (`light::Clusters`); every lighting's image is a sum of these.
//! The image is worked on from the top down. Light straight from emitters (direct) and all other light (indirect) are
//! filtered separately, each divided by the albedo:
//!
//! 0. Light is brought to the albedo that further camera rays have measured (`pixel_albedo`). Light that one half of a
//!    pixel's samples has and nothing around it has is spread over its surface (`outliers`).
//! 1. A few *guides*, mixtures of the cluster images by principal components ([`GuideStatistics`]), are filtered first.
//! 2. Each pixel of every image becomes the value of a local linear fit to its neighbours. Weights come from features
//!    (normal, albedo, inverse depth on the plane of the surface, shares) and from the filtered guides, relative to the
//!    noise. This is non-local means (Buades, Coll, Morel 2005) with features and guides instead of patches (Rousselle,
//!    Manzi, Zwicker 2013). The noise is known from the two halves of the samples. Each half of direct light is
//!    weighted by the guides of the other half.
//! 3. Each cluster image of indirect light is filtered again with weights of its own (`alone`), since one lamp has no
//!    edges where another has its shadows. Large images have a near and a far pass. The sum of all images is unchanged.
//! 4. What filtering has averaged away and both halves of the samples agree on is given back (`detail`).
//! 5. For each pixel and cluster the filtered value is mixed with the input to minimise the estimated risk (Stein
//!    1981). So at many samples nothing is averaged.
//!
//! Weights add up to 1: a firefly is spread over similar pixels, not clipped. An isolated firefly has no similar
//! pixels, and loses much of its light (decision 20). A linear fit instead of a mean keeps corners and contact shadows
//! dark, where all similar pixels lie to one side (`kernel`).

mod albedo;
mod constants;
mod denoise_inputs;
mod denoised_rows;
mod denoised_source;
mod denoiser;
mod detail;
mod errors;
mod external_images;
mod filter;
mod filter_radii;
mod guide_statistics;
mod guides;
mod image_rows;
mod kernel;
mod outliers;
mod per_image_filter;
mod picture_fit;
mod pixel_albedo;
mod pixel_tile;
mod row_stages;
mod shrinkage;
mod surfaces;
mod upsample_columns;
mod windows;

/// 0 up to the first bound, 1 from the second on, and linear between.
fn ramp((from, to): (f32, f32), value: f32) -> f32 {
    ((value - from) / (to - from)).clamp(0.0, 1.0)
}

/// Version of the denoiser's results, named by every interrupted pack. Raise it with every change of the results.
pub const DENOISER_VERSION: u32 = 23;

#[cfg(feature = "scene")]
pub(crate) use denoise_inputs::DenoiseInputs;
pub use denoised_rows::DenoisedRows;
pub(crate) use denoised_source::{DenoisedJob, DenoisedSource};
#[cfg(feature = "scene")]
pub(crate) use denoised_source::{blocks_read, mean_of};
pub use denoiser::{DenoisedRegion, Denoiser, DenoiserRows};
pub use errors::ErrorSums;
pub(crate) use external_images::{BASIS_LAYER, ExternalImages};
pub use filter_radii::FilterRadii;
pub use guide_statistics::{GuideStatistics, Guides};
pub use image_rows::{ImageRows, Pool, Region};
#[cfg(feature = "scene")]
pub(crate) use picture_fit::{PictureFit, PictureSums, WindowSums};
pub use shrinkage::ImageOrigin;
pub use upsample_columns::{ColumnUpsampler, TILE, tile_means};
#[cfg(feature = "scene")]
pub(crate) use windows::PictureWindows;
pub(crate) use windows::windows_of;
