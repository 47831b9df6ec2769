//! The library's errors as the exceptions that Python users expect.

use std::any::Any;
use std::io::ErrorKind as IoKind;
use std::panic::{AssertUnwindSafe, catch_unwind};

use ltm::Error;
use ltm::error::ErrorKind;
use pyo3::create_exception;
use pyo3::exceptions::{
    PyException, PyFileNotFoundError, PyKeyboardInterrupt, PyMemoryError, PyOSError, PyPermissionError, PyRuntimeError,
    PyValueError,
};
use pyo3::prelude::*;

use crate::words::in_arguments;

create_exception!(ltm, DamagedError, PyException, "A file is damaged or cut short: repair it or make it again.");
create_exception!(ltm, NoGpuError, PyException, "A GPU was demanded and cannot be used.");

/// The exception for an error, with its one line as text.
pub(crate) fn exception(error: &Error) -> PyErr {
    let text = error.worded(in_arguments);
    if let Error::Io { source, .. } = error {
        return match source.kind() {
            IoKind::NotFound => PyFileNotFoundError::new_err(text),
            IoKind::PermissionDenied => PyPermissionError::new_err(text),
            // It was longer when it was opened.
            IoKind::UnexpectedEof => DamagedError::new_err(text),
            _ => PyOSError::new_err(text),
        };
    }
    match error.kind() {
        ErrorKind::Input => PyValueError::new_err(text),
        ErrorKind::Damaged => DamagedError::new_err(text),
        ErrorKind::Resources => PyMemoryError::new_err(text),
        ErrorKind::Interrupted => PyKeyboardInterrupt::new_err(text),
        ErrorKind::NoGpu => NoGpuError::new_err(text),
        _ => PyOSError::new_err(text),
    }
}

/// The exception for a panic of ours.
pub(crate) fn panic_exception(panic: &(dyn Any + Send)) -> PyErr {
    let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
    PyRuntimeError::new_err(format!("internal error: {}", text.unwrap_or("of unknown kind")))
}

/// Runs `work` without the interpreter's lock; errors and panics become exceptions.
pub(crate) fn unlocked<T: Send>(py: Python<'_>, work: impl FnOnce() -> ltm::Result<T> + Send) -> PyResult<T> {
    match py.detach(|| catch_unwind(AssertUnwindSafe(work))) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => Err(exception(&error)),
        Err(panic) => Err(panic_exception(&*panic)),
    }
}
