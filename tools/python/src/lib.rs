//! `ltm._ltm`: the native half of the Python package `ltm`. It speaks in arrays of exact types and shapes; what users
//! write (slices, dictionaries, names) is turned into those by `python/ltm`.
//!
//! No work is done with the interpreter's lock held, and none on the threads of the global pool, which a forked process
//! would lack: see [`threads`].

mod daylight;
mod errors;
mod gpu;
mod light;
mod live;
mod make;
mod matrix;
mod slice;
mod threads;
mod watch;
mod words;

use pyo3::prelude::*;

/// Native half of `ltm`.
#[pymodule]
mod _ltm {
    #[pymodule_export]
    use super::daylight::glare;
    #[pymodule_export]
    use super::errors::{DamagedError, NoGpuError};
    #[pymodule_export]
    use super::gpu::gpu;
    #[pymodule_export]
    use super::live::LiveRender;
    #[pymodule_export]
    use super::make::{merge, pack_array, pack_store, render, verify, write_array, write_basis};
    #[pymodule_export]
    use super::matrix::Native;

    use super::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("BUILT_IN_SCENES", ltm::scene::BUILT_IN_NAMES.to_vec())
    }
}
