//! Relighting: `c = T ℓ` from factors, block by block.
//!
//! A block `L R + S` gives the pixels of colour channel `ch` as `c_ch = L_ch (R ℓ_ch) + S_ch ℓ_ch` (the paper, §3.4,
//! "on-fly reconstruction"), where `L_ch` are the rows of that channel. Three kernels do the work, each once for the
//! CPU and once in `shaders/` under the same name. `project` computes `y = R ℓ` for the three channels in one pass over
//! `R`, `reconstruct` computes `L y`, and `scatter` adds the sparse entries.
//!
//! Right sides are kept as they are stored, as coefficients of the transform `D` over the texels of a light, most of which are
//! 0: `R ℓ = (R D)(Dᵀ ℓ)`, where `Dᵀ ℓ` is computed once for a picture. They are the whole numbers of the file, so
//! that nothing is rounded but the sums, in f32. Left sides take 8 or 16 bits for each value. Both are a [`CompactBlock`]. If
//! factors exceed a budget they are streamed; [`Pager`] decides which stay.
//!
//! ```
//! use ltm::container::ContainerReader;
//! use ltm::relight::CpuRelighter;
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("room.ltc");
//! # let matrix = ltm::MemoryMatrix::from_images([("desk", ltm::LinearImage::black(8, 8))])?;
//! # ltm::pack(&matrix, &path, &ltm::PackOptions::default())?;
//!
//! // The factors are read once; each relighting after that is one product.
//! let container = ContainerReader::open(&path)?;
//! let relighter = CpuRelighter::load(&container)?;
//! let image = relighter.relight(&ltm::Lighting::of_scene(&container.job().basis))?;
//! assert_eq!(image.pixels.len(), 64);
//! # Ok::<(), ltm::Error>(())
//! ```

mod adjoint;
mod compact;
mod cpu;
mod damage;
#[cfg(feature = "gpu")]
mod gpu;
mod lighting;
mod paged;
mod pager;
mod pixel_rows;
mod project;
#[cfg(test)]
mod random;
mod raw;
mod reconstruct;
mod region;
mod right;
mod scatter;
mod tiles;

pub use adjoint::{adjoint_raw, adjoint_streaming};
pub use compact::CompactBlock;
pub use cpu::{CpuRelighter, Relit, relight_streaming};
#[cfg(feature = "gpu")]
pub use gpu::{GpuAdapter, GpuRelighter, GpuScreen, GpuSettings, PagedGpuRelighter, ShownAs};
pub use paged::{PagedRelighter, Reads};
pub use pager::{Admission, Detail, Pager, plan};
pub use pixel_rows::pixel_rows;
pub use raw::relight_raw;
pub use region::{relight_region_raw, relight_region_streaming};
