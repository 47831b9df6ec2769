//! Joins the stages: the only module that knows them all.
//!
//! Each job is a function from paths and settings to a report; what a person sees while it runs is the business of the
//! [`Watch`] that the caller passes in.

mod budget;
pub mod demo;
mod import;
mod maintain;
mod memory;
mod pack;
mod preview;
mod relight;
mod render;
mod spill;
mod unpack;
mod watch;

pub use budget::{human_bytes, parse_bytes};
pub use import::{ImportedMatrix, read_lights};
pub use maintain::repair;
pub use memory::PeakMemory;
pub use pack::{PackOptions, PackReport, pack};
pub use preview::{PreviewReport, preview};
pub use relight::{Device, RelightOptions, Relighter, relight};
pub use render::{RenderOptions, RenderReport, job_of, render};
pub use unpack::{UnpackOptions, unpack_to_exr, unpack_to_npy, unpack_to_store};
pub use watch::{Quiet, Watch};
