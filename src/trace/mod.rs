//! Fills one block of `T` with all its columns, for the price of one image (the paper, §3.1).
//!
//! ```text
//! tracer ── for each pixel and sample ──► integrator ──► world (bvh, surfaces), bsdf, lights
//!    ▲                                        │      ▲
//!    │                                        │      └── photons, sent before the first block
//!    └── block and noise ◄── accumulator ◄────┤ (column, RGB)
//!    └── layers, features ◄────── planes ◄────┘ (how it came, cluster, RGB)
//! ```

mod accumulator;
pub mod bsdf;
pub mod bvh;
mod camera_ray;
mod cap;
mod frame;
mod further_rays;
mod guiding;
mod integrator;
mod lights;
mod outline;
mod photon_targets;
mod photons;
mod pixel_filter;
mod planes;
mod relief;
mod sampler;
mod scales;
mod segment;
mod settings;
#[cfg(test)]
#[path = "../../tests/transport/statistics.rs"]
mod statistics;
mod tracer;
mod tracer_memory;
mod vertex;
mod vertex_light;
mod world;

pub use photons::{PhotonCost, Sending};
pub use settings::TraceSettings;
pub use tracer::{BlockStats, Tracer};
pub use tracer_memory::TracerMemory;

/// Version of the tracer's results, named by every matrix, so that blocks of two versions are never mixed. Raise it
/// with every change of an entry.
pub const TRACER_VERSION: u32 = 17;
