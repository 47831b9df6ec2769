//! Joins the stages: the only module that knows them all.
//!
//! Each job is a function from paths and settings to a report; what a person sees while it runs is the business of the
//! [`Watch`](crate::host::Watch) that the caller passes in.
//!
//! # Example
//!
//! ```
//! use ltm::host::Quiet;
//! use ltm::pipeline::{self, RelightOptions};
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("room.ltc");
//! # let matrix = ltm::MemoryMatrix::from_images([("desk", ltm::LinearImage::black(8, 8))])?;
//! # ltm::pack(&matrix, &path, &ltm::PackOptions::default())?;
//!
//! let container = pipeline::open_container(&path)?;
//! let lightings = [ltm::Lighting::of_scene(&container.job().basis)];
//! let options = RelightOptions { memory_bytes: Some(1 << 30), ..RelightOptions::default() };
//! let (images, done_by) = pipeline::relight(&container, &lightings, options, &Quiet)?;
//! println!("{} images by {done_by}", images.len());
//! # Ok::<(), ltm::Error>(())
//! ```

mod analysis;
mod basis;
mod clean;
mod column_scales;
mod compare;
#[cfg(feature = "scene")]
pub mod demo;
#[cfg_attr(not(feature = "scene"), expect(dead_code, reason = "only renders of scenes are asked for an error"))]
mod exposed;
#[cfg(feature = "scene")]
mod farm;
mod features;
#[cfg(feature = "scene")]
mod fused;
mod gather;
#[cfg(feature = "gpu")]
mod gpu;
mod grain;
mod import;
mod imported_features;
#[cfg(not(feature = "gpu"))]
mod no_gpu;
mod open;
mod pack;
mod pack_report;
mod passes;
#[cfg(feature = "scene")]
mod preview;
mod records;
mod relight;
#[cfg(feature = "scene")]
mod render;
#[cfg(feature = "scene")]
mod repair;
mod rows;
mod selection;
#[cfg_attr(not(feature = "scene"), expect(dead_code, reason = "only jobs of scenes are cut into shards"))]
mod shard;
mod share;
mod spill;
#[cfg(feature = "scene")]
mod stop;
mod strip;
mod unpack;
mod unpack_source;
mod verify;
#[cfg(feature = "scene")]
mod worker;

pub use basis::write_basis;
pub use compare::{BlockComparison, Place, compare_matrices, total_relative_l2};
pub use exposed::Promise;
#[cfg(feature = "scene")]
pub use farm::{BuildReport, FarmJob, Probe, ProbedBlock, RefusedShard, Shards};
pub use features::{FEATURE_CHANNELS, Features, write_features};
#[cfg(feature = "scene")]
pub use fused::render_packed;
pub use import::{ImageNoise, ImportedMatrix, SecondImages};
pub use open::{check_matrix_path, open_container};
pub use pack::{PackOptions, pack};
pub use pack_report::{PackReport, ReplacedEntries, Shortfall};
pub use passes::{PASSES, passes_need_bytes, relight_passes};
#[cfg(feature = "scene")]
pub use preview::{PreviewReport, preview};
pub(crate) use relight::factors_bytes;
pub use relight::{
    Device, RelightOptions, Relighter, relight, relight_matrix, relit_layers_need_bytes, write_relit_layers,
};
#[cfg(feature = "scene")]
pub use render::{RenderOptions, RenderReport, job_of, load_scene, render};
#[cfg(feature = "scene")]
pub use repair::repair;
pub use selection::Selection;
pub use share::{DATA_NAME, PAGE_NAME, ShareOptions, ShareReport, share};
pub use spill::check_container_output;
#[cfg(feature = "scene")]
pub use stop::{Chosen, RenderTo, StopRule, choose_samples, expected_error, parse_error, parse_seconds};
pub use unpack::{UnpackOptions, unpack_relit, unpack_to_exr, unpack_to_npy, unpack_to_store};
pub use unpack_source::{UnpackSource, Weights};
pub use verify::{Verified, admit_merge, verify, verify_container};
