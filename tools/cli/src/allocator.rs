//! The programs' allocator.

use std::alloc::{GlobalAlloc, Layout};
use std::io::Write;

#[cfg(not(feature = "jemalloc"))]
use std::alloc::System as Inner;
#[cfg(feature = "jemalloc")]
use tikv_jemallocator::Jemalloc as Inner;

use crate::console::{end_at_once, write_unlocked};

/// Exit code of a program that the system refuses memory: that of [`ltm::Error::Resources`].
const NO_MEMORY: i32 = 6;

/// Keeps the programs within the memory that they state, with an allocator chosen in decision 44.
///
/// Where the system refuses memory all the same (`ulimit -v` counts what is only reserved), it ends the program with one
/// line and the exit code of memory: Rust would abort, with a trace. Files survive a program that ends at any instant.
struct Ending;

#[global_allocator]
static ALLOCATOR: Ending = Ending;

#[expect(unsafe_code, reason = "an allocator has no safe interface")]
// SAFETY: every call is passed on as it came, and what comes back is passed back, unless the program ends.
unsafe impl GlobalAlloc for Ending {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps to the contract of `alloc`, which is that of the allocator within.
        given(unsafe { Inner.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        given(unsafe { Inner.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, bytes: usize) -> *mut u8 {
        // SAFETY: as above; the pointer is one that the allocator within gave.
        given(unsafe { Inner.realloc(pointer, layout, bytes) }, bytes)
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { Inner.dealloc(pointer, layout) }
    }
}

/// What was asked for; ends the program where that is nothing.
fn given(pointer: *mut u8, bytes: usize) -> *mut u8 {
    if pointer.is_null() {
        refused(bytes);
    }
    pointer
}

/// Says, without any memory, that there is none.
#[cold]
fn refused(bytes: usize) -> ! {
    let mut line = [0u8; 160];
    let mut rest = &mut line[..];
    let _ = writeln!(
        rest,
        "the system refuses {bytes} bytes of memory; allow it more (ulimit -v, its container), or close others"
    );
    let unused = rest.len();
    if let Ok(text) = std::str::from_utf8(&line[..line.len() - unused]) {
        write_unlocked(text);
    }
    end_at_once(NO_MEMORY);
}
