//! Jobs: the only module that knows all stages.
//!
//! Each job is a function from paths and settings to a report. Progress goes to the [`Progress`](crate::resources::Progress) that
//! the caller passes in.
//!
//! ```
//! use ltm::resources::NoProgress;
//! use ltm::pipeline::{self, RelightOptions};
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("room.ltc");
//! # let matrix = ltm::MemoryMatrix::from_images([("desk", ltm::LinearImage::black(8, 8))])?;
//! # ltm::pack(&matrix, &path, &ltm::PackOptions::default())?;
//!
//! let container = pipeline::open_container(&path)?;
//! let lightings = [ltm::Lighting::of_scene(&container.job().basis)];
//! let options = RelightOptions { memory_bytes: Some(1 << 30), ..RelightOptions::default() };
//! let (images, done_by) = pipeline::relight(&container, &lightings, options, &NoProgress)?;
//! println!("{} images by {done_by}", images.len());
//! # Ok::<(), ltm::Error>(())
//! ```

mod clean;
mod column_scales;
mod compare;
mod daylight;
#[cfg(feature = "scene")]
pub mod demo;
mod features;
mod import;
mod open;
mod pack;
mod relight;
#[cfg(feature = "scene")]
mod render;
mod row_spill;
mod share;
mod unpack;
mod verify;

pub use clean::{CleanOptions, clean_images};
pub use compare::{BlockComparison, WorstEntry, compare_matrices, total_relative_l2};
pub use daylight::{
    Blinds, DaylightOptions, DaylightSource, DaylightYear, SensorYear, StandardSky, SunLimit, daylight, lighting_at,
    lighting_under, sensor_years, steps_above_sun_limit, write_glare, write_glare_hours, write_ill, write_measures,
};
pub use features::{FEATURE_CHANNELS, Features, write_basis, write_features};
pub use import::{ImageNoise, ImportedMatrix, SecondImages};
pub use open::{check_matrix_path, open_container};
#[cfg(feature = "scene")]
pub(crate) use pack::{
    Analysed, FirstPass, PackSource, PackedBlocks, Packing, SecondPass, Sizing, energy_of, need_of, plan_of,
};
pub use pack::{PackOptions, PackReport, ReplacedEntries, Shortfall, check_container_output, pack};
pub use relight::{
    Device, PASSES, RelightOptions, Relighter, passes_need_bytes, relight, relight_matrix, relight_passes,
    relit_layers_need_bytes, write_relit_layers,
};
#[cfg(all(test, feature = "scene"))]
pub(crate) use render::samples_path;
#[cfg(feature = "scene")]
pub use render::{
    Estimate, PreviewReport, ProgressiveRender, RenderOptions, RenderReport, RenderStage, SceneView, early_path,
    job_of, load_scene, preview, render, render_packed, render_views, repair,
};
#[cfg(feature = "scene")]
pub(crate) use render::{note_samples, samples_of_unfinished, settings_of, tracer_of, tracing_need};
pub use share::{DATA_NAME, PAGE_NAME, ShareOptions, ShareReport, ShareView, data_name, share};
pub use unpack::{
    ColumnWeights, Selection, UnpackOptions, UnpackSource, unpack_relit, unpack_to_exr, unpack_to_npy, unpack_to_store,
};
pub use verify::{Verified, admit_merge, verify, verify_container};
