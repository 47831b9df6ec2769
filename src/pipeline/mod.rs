//! Joins the stages: the only module that knows them all.
//!
//! Each job is a function from paths and settings to a report; what a person sees while it runs is the business of the
//! [`Watch`](crate::host::Watch) that the caller passes in.

mod clean;
mod compare;
pub mod demo;
mod features;
mod fused;
#[cfg(feature = "gpu")]
mod gpu;
mod import;
mod maintain;
#[cfg(not(feature = "gpu"))]
mod no_gpu;
mod pack;
mod preview;
mod relight;
mod render;
mod rows;
mod selection;
mod spill;
mod unpack;

pub use compare::{BlockComparison, Place, compare_matrices, total_relative_l2};
pub use features::{FEATURE_CHANNELS, write_features};
pub use fused::render_packed;
pub use import::ImportedMatrix;
pub use maintain::{Verified, repair, verify, verify_container};
pub use pack::{PackOptions, PackReport, ReplacedEntries, Shortfall, pack};
pub use preview::{PreviewReport, preview};
pub use relight::{Device, RelightOptions, Relighter, relight, relight_matrix};
pub use render::{RenderOptions, RenderReport, job_of, render};
pub use selection::Selection;
pub use spill::check_container_output;
pub use unpack::{UnpackOptions, unpack_relit, unpack_to_exr, unpack_to_npy, unpack_to_store};
