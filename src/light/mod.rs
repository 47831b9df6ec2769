//! The columns of `T` and what is put on them: the light basis, lightings `ℓ` over it, and the description of a job
//! that every file of ours carries.

mod basis;
mod clusters;
mod environment;
mod errors;
mod job;
mod lighting;
mod metadata;
pub mod names;
mod prior;
mod probes;

pub use basis::{Column, Light, LightBasis, LightKind, LightUnit};
pub use clusters::Clusters;
pub use environment::{EnvironmentMapping, turn_about_vertical};
pub use errors::{
    CleaningErrors, ExposedError, LightErrors, LightLoss, StatedErrors, cleaning_errors_line, column_name,
    expected_error_line, exposed_error_line, light_errors_lines,
};
pub use job::{Job, JobHash, Provenance};
pub use lighting::Lighting;
pub(crate) use metadata::{JOB_SECTIONS, decode_positional_job, job_of};
pub use metadata::{decode_job, encode_job};
pub use prior::{LightingPrior, evaluation_lightings};
pub use probes::{PROBES, probe_lightings};
