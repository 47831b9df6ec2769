//! `ltm`: light transport matrices. Trace a scene once, compress the matrix, relight it at once.
//!
//! A scene under `n` basis lights is a matrix `T`: one row for each pixel and colour channel, one column for each basis
//! light (a lamp, a texel of an area light, a texel of the environment). Every lighting is then one product, `c = T ℓ`.
//! `T` is larger than memory, so everything here works on one *block* at a time: a square of pixels with all its
//! channels and all columns.
//!
//! ```text
//! scene ──► trace ─────► store ─────► compress ─────► container ─────► relight ─────► image
//! OBJ+TOML   one pass     .ltm         low rank +      .ltc             c = L (R ℓ)    EXR, PNG
//! lights     fills all    mmap, tiled, sparse, rank    block index,     CPU or wgpu,
//!            columns      columns      from the noise  checksums        paged
//!            of a block   contiguous
//! ```
//!
//! # In ten lines
//!
//! ```
//! use ltm::{Lighting, LinearImage, MemoryMatrix, PackOptions};
//!
//! // An image for each lamp, as any renderer gives them; or `ltm::render` of a scene file.
//! let image = |light: f32| LinearImage { width: 8, height: 8, pixels: vec![[light; 3]; 64] };
//! let matrix = MemoryMatrix::from_images([("desk 1", image(0.5)), ("desk 2", image(0.5)), ("sky", image(0.25))])?;
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("room.ltc");
//! ltm::pack(&matrix, &path, &PackOptions::default())?;
//!
//! let matrix = ltm::open(&path)?;
//! let evening = Lighting::of_scene(matrix.basis()).with("desk*", 0.0)?.with("sky", [0.2, 0.3, 0.5])?;
//! let relit = matrix.relight(&evening)?;
//! assert!((relit.pixels[0][2] - 0.125).abs() < 1e-3);
//! # Ok::<(), ltm::Error>(())
//! ```
//!
//! That is all that most programs need. The modules are what it is made of: [`pipeline`] has the jobs with progress, budgets and
//! more choices, [`container`] and [`store`] the files, [`relight`] products on CPU and GPU, [`scene`] and [`look`] what people write,
//! [`image`] what comes out. Modules that are public only for the programs of this repository are hidden, and may change.
//!
//! Method: Lebedev, Karpuhin, Ilyin, Ignatenko, *Compression of light transport matrix* (GraphiCon); "the paper" and
//! its section numbers in this documentation mean that text.
//!
//! # Features
//!
//! `scene` (on by default): scene files, lighting files and the tracer. Without it matrices come from elsewhere. `gpu`: relighting on
//! a GPU. `s3`: shards and containers in an object store. The rest works without them.
//!
//! # Who may know whom
//!
//! The stages never import each other; [`pipeline`] joins them. `tests/house.rs` reads this table and holds the code
//! to it.
//!
//! | module | may import |
//! |---|---|
//! | `error`, `decimal`, `encoding`, `sections`, `simd` | nothing |
//! | `files` | `error` |
//! | `matrix` | `error`, `encoding` |
//! | `image` | `error`, `files`, `matrix`, `resources` |
//! | `light` | `error`, `encoding`, `sections`, `matrix` |
//! | `daylight` | `error`, `files`, `light`, `image` |
//! | `look` | `error`, `files`, `light`, `image` |
//! | `scene` | `error`, `decimal`, `files`, `matrix`, `light`, `image` |
//! | `trace` | `error`, `matrix`, `light`, `scene`, `resources` |
//! | `compress` | `error`, `encoding`, `matrix`, `light`, `resources`, `simd` |
//! | `store` | `error`, `files`, `matrix`, `light`, `resources` |
//! | `container` | `error`, `encoding`, `sections`, `files`, `matrix`, `light`, `resources` |
//! | `relight` | `error`, `matrix`, `light`, `image` |
//! | `share` | `error`, `decimal`, `matrix`, `light` |
//! | `resources`, `blob_store` | `error`, `files` |
//! | `block_records` | `error`, `files`, `resources` |
//! | `denoise` | `error`, `files`, `matrix`, `image`, `light`, `compress`, `resources`, `block_records`, `simd` |
//! | `error_estimate` | `error`, `matrix`, `image`, `light`, `store`, `resources`, `denoise` |
//! | `pipeline` | `error`, `encoding`, `files`, `matrix`, `image`, `light`, `scene`, `trace`, `store`, `denoise`, `compress`, `container`, `relight`, `share`, `resources`, `blob_store`, `block_records`, `error_estimate`, `daylight` |
//! | `memory_matrix` | `error`, `matrix`, `image`, `light` |
//! | `open` | `error`, `matrix`, `image`, `light`, `store`, `container`, `relight`, `pipeline`, `resources`, `blob_store` |
//! | `make` | `error`, `light`, `scene`, `pipeline`, `resources` |
//! | `sample_budget` | `error`, `block_records`, `container`, `matrix`, `light`, `scene`, `trace`, `store`, `denoise`, `resources`, `error_estimate`, `pipeline` |
//! | `farm` | `error`, `encoding`, `files`, `matrix`, `light`, `scene`, `trace`, `compress`, `container`, `denoise`, `resources`, `blob_store`, `block_records`, `pipeline` |
//!
//! # Which crate is used where
//!
//! What is outside the library, by the rooms that may name it; tests may use anything. The same test reads this table, and
//! wants every dependency in it.
//!
//! | crate | rooms |
//! |---|---|
//! | `wgpu`, `pollster` | `relight/gpu` |
//! | `draco_core`, `meshoptimizer_rs` | `scene/gltf` |
//! | `earcut` | `scene` |
//! | `faer` | `denoise`, `compress`, `pipeline` |
//! | `rand`, `rand_pcg` | `compress`, `light`, `pipeline`, `relight` |
//! | `glam` | `daylight`, `light`, `scene`, `trace` |
//! | `obvhs` | `trace` |
//! | `serde`, `toml` | `look`, `scene` |
//! | `serde_json` | `look`, `scene` |
//! | `exr`, `image`, `regex_lite`, `zip` | `image` |
//! | `flate2` | `image`, `share` |
//! | `bincode` | `encoding` |
//! | `zstd` | `container` |
//! | `half` | `compress`, `image`, `store` |
//! | `libc` | `store` |
//! | `memmap2` | `store`, `trace` |
//! | `rustix` | `files`, `store` |
//! | `sha2` | `block_records`, `container`, `denoise`, `farm`, `light`, `memory_matrix`, `pipeline`, `scene`, `share`, `store` |
//! | `crc32fast` | `block_records`, `container`, `files`, `pipeline`, `share`, `store` |
//! | `bytemuck` | `block_records`, `denoise`, `compress`, `image`, `matrix`, `pipeline`, `relight`, `scene`, `store`, `trace` |
//! | `pulp` | `denoise`, `container`, `pipeline`, `relight`, `store`, `trace`, `simd` |
//! | `rayon` | `error_estimate`, `farm`, `denoise`, `compress`, `container`, `resources`, `image`, `pipeline`, `relight`, `trace` |
//! | `tempfile` | `denoise`, `farm`, `pipeline`, `trace` |
//! | `object_store`, `reqwest`, `rustls`, `tokio` | `blob_store` |
//! | `thiserror` | `blob_store`, `error`, `trace` |
//! | `std::fs` | `block_records`, `container`, `blob_store`, `files`, `resources`, `image`, `look`, `pipeline`, `scene`, `store`, `trace` |
//! | `std::os` | `files`, `store` |
//! | `std::thread` | `resources`, `image`, `pipeline`, `store` |
//! | `std::env` | `files` |
//! | `std::process` | `blob_store` |
//! | `std::net` | none |

#![cfg_attr(docsrs, feature(doc_cfg))]
#![warn(clippy::missing_errors_doc, clippy::missing_panics_doc, clippy::return_self_not_must_use)]

#[doc(hidden)]
pub mod blob_store;
mod block_records;
pub mod compress;
pub mod container;
pub mod daylight;
#[cfg_attr(not(feature = "scene"), expect(dead_code, reason = "scenes have most numbers that are written out"))]
mod decimal;
#[doc(hidden)]
pub mod denoise;
mod encoding;
pub mod error;
#[doc(hidden)]
#[cfg_attr(not(feature = "scene"), expect(dead_code, reason = "only renders of scenes are asked for an error"))]
pub mod error_estimate;
#[cfg(feature = "scene")]
#[doc(hidden)]
pub mod farm;
#[doc(hidden)]
pub mod files;
pub mod image;
pub mod light;
#[cfg(feature = "scene")]
pub mod look;
mod make;
pub mod matrix;
mod memory_matrix;
mod open;
pub mod pipeline;
pub mod relight;
pub mod resources;
#[cfg(feature = "scene")]
pub mod sample_budget;
#[cfg(feature = "scene")]
pub mod scene;
mod sections;
#[doc(hidden)]
pub mod share;
mod simd;
pub mod store;
#[cfg(feature = "scene")]
#[doc(hidden)]
pub mod trace;

pub use error::{Error, Result};
pub use image::LinearImage;
pub use light::Lighting;
pub use make::pack;
#[cfg(feature = "scene")]
pub use make::{load_scene, render};
pub use memory_matrix::MemoryMatrix;
pub use open::{Matrix, MatrixFile, open};
pub use pipeline::{PackOptions, PackReport};
#[cfg(feature = "scene")]
pub use scene::LoadedScene;

/// Vectors and matrices of the scene's and the image's interfaces.
pub use glam;
/// The GPU interface that [`relight`] shares devices and textures with.
#[cfg(feature = "gpu")]
pub use wgpu;
