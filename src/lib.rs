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
//! `scene` (on by default): scene files, lighting files and the tracer. Without it matrices come from elsewhere. `gpu` (on by
//! default): relighting on a GPU. `s3`: shards and containers in an object store. The rest works without them.
//!
//! # Who may know whom
//!
//! The stages never import each other; [`pipeline`] joins them. `tests/house.rs` reads this table and holds the code
//! to it.
//!
//! | module | may import |
//! |---|---|
//! | `error`, `encoding`, `vectors` | nothing |
//! | `files`, `matrix` | `error` |
//! | `image` | `error`, `files`, `matrix` |
//! | `light` | `error`, `encoding`, `matrix` |
//! | `look` | `error`, `files`, `light`, `image` |
//! | `scene` | `error`, `files`, `matrix`, `light`, `image` |
//! | `trace` | `error`, `matrix`, `light`, `scene` |
//! | `clean`, `compress` | `error`, `matrix`, `light`, `vectors` |
//! | `store` | `error`, `files`, `matrix`, `light` |
//! | `container` | `error`, `encoding`, `files`, `matrix`, `light` |
//! | `relight` | `error`, `matrix`, `light`, `image` |
//! | `share` | `error`, `matrix`, `light` |
//! | `host`, `depot` | `error`, `files` |
//! | `memory_matrix` | `error`, `matrix`, `image`, `light` |
//! | `pipeline` | `error`, `files`, `matrix`, `image`, `light`, `scene`, `trace`, `store`, `clean`, `compress`, `container`, `relight`, `share`, `host`, `depot` |
//! | `open` | `error`, `matrix`, `image`, `light`, `store`, `container`, `relight`, `pipeline`, `host`, `depot` |
//! | `make` | `error`, `light`, `scene`, `pipeline`, `host` |
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
//! | `faer` | `clean`, `compress` |
//! | `rand`, `rand_pcg` | `compress`, `light`, `pipeline`, `relight` |
//! | `glam` | `light`, `scene`, `trace` |
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
//! | `sha2` | `container`, `light`, `memory_matrix`, `pipeline`, `scene`, `share`, `store` |
//! | `crc32fast` | `container`, `files`, `pipeline`, `share`, `store` |
//! | `bytemuck` | `clean`, `compress`, `image`, `matrix`, `pipeline`, `relight`, `scene`, `store`, `trace` |
//! | `pulp` | `clean`, `container`, `relight`, `store`, `trace`, `vectors` |
//! | `rayon` | `clean`, `compress`, `container`, `host`, `image`, `pipeline`, `relight`, `trace` |
//! | `tempfile` | `pipeline`, `trace` |
//! | `object_store`, `reqwest`, `rustls`, `tokio` | `depot` |
//! | `thiserror` | `depot`, `trace` |
//! | `std::fs` | `container`, `depot`, `files`, `host`, `image`, `look`, `pipeline`, `scene`, `store`, `trace` |
//! | `std::os` | `container`, `files`, `host`, `pipeline`, `store` |
//! | `std::thread` | `host`, `image`, `pipeline`, `store` |
//! | `std::env` | `files` |
//! | `std::process` | `depot` |
//! | `std::net` | none |

#![cfg_attr(docsrs, feature(doc_cfg))]
#![warn(clippy::missing_errors_doc, clippy::missing_panics_doc, clippy::return_self_not_must_use)]

#[doc(hidden)]
pub mod clean;
pub mod compress;
pub mod container;
#[doc(hidden)]
pub mod depot;
mod encoding;
pub mod error;
#[doc(hidden)]
pub mod files;
pub mod host;
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
#[cfg(feature = "scene")]
pub mod scene;
#[doc(hidden)]
pub mod share;
pub mod store;
#[cfg(feature = "scene")]
#[doc(hidden)]
pub mod trace;
mod vectors;

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
