//! The columns of `T` and what is put on them: the light basis, lightings `ℓ` over it, and the description of a job
//! that every file of ours carries.
//!
//! # Example
//!
//! ```
//! use ltm::light::{Light, LightBasis, LightKind, Lighting};
//!
//! let mut basis = LightBasis::new();
//! basis.push(Light::unplaced("lamp", LightKind::Lamp))?;
//! basis.push(Light::unplaced("panel", LightKind::AreaTexels { across: 4, down: 2 }))?;
//! assert_eq!(basis.find("panel").unwrap().columns(), 1..9);
//! assert_eq!(Lighting::of_scene(&basis).weights().len(), 9);
//! # Ok::<(), ltm::Error>(())
//! ```

mod basis;
mod clusters;
mod environment;
mod errors;
mod groups;
mod job;
mod lighting;
mod metadata;
pub mod names;
mod patches;
mod prior;
mod probes;

pub use basis::{Column, Light, LightBasis, LightKind, LightUnit};
pub use clusters::Clusters;
pub use environment::{EnvironmentMapping, turn_about_vertical};
pub use errors::{
    DenoiseErrors, DenoisedLight, ExposedError, LightErrors, LightLoss, StatedErrors, column_name, denoise_errors_line,
    denoised_light_lines, expected_error_line, exposed_error_line, light_errors_lines,
};
pub use groups::LightGroups;
pub use job::{DescribedSource, Job, JobHash, Provenance};
pub use lighting::{LightWeight, Lighting};
pub(crate) use metadata::{JOB_SECTIONS, decode_positional_job, job_of};
pub use metadata::{decode_job, encode_job};
pub use patches::SkyPatches;
pub use prior::LightingPrior;
// What studies and tests judge by.
#[doc(hidden)]
pub use prior::evaluation_lightings;
pub use probes::{PROBES, probe_lightings};
