//! The programs' allocator.

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::console::{end_at_once, write_unlocked};

/// Exit code of a program that the system refuses memory: that of [`ltm::Error::Resources`].
const NO_MEMORY: i32 = 6;

/// Bytes from which glibc maps a piece by itself, unless it is told otherwise.
const MAPPED_AT_FIRST: usize = 128 << 10;

/// Bytes from which a piece of memory is the system's own again once it is freed. Smaller ones are used again, since fresh memory
/// from the system is slow (decision 81).
const MAPPED_FROM: usize = 4 << 20;

/// Bytes that are free at the end of a heap before they go back to the system.
const TRIMMED_FROM: usize = 8 << 20;

/// Keeps the programs within the memory that they state (decisions 44 and 81): the system's allocator, told to give large pieces back.
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
        give_back_large_pieces(layout.size());
        // SAFETY: the caller keeps to the contract of `alloc`, which is that of the allocator within.
        given(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        give_back_large_pieces(layout.size());
        // SAFETY: as above.
        given(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, bytes: usize) -> *mut u8 {
        // SAFETY: as above; the pointer is one that the allocator within gave.
        given(unsafe { System.realloc(pointer, layout, bytes) }, bytes)
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Tells glibc, before it is asked for the first large piece, to map each by itself for good. Left alone, it keeps what was freed and
/// raises the bound with it, so that blocks come to lie between small pieces that live on, and their memory never returns.
fn give_back_large_pieces(bytes: usize) {
    static TOLD: AtomicBool = AtomicBool::new(false);
    if bytes < MAPPED_AT_FIRST || TOLD.load(Ordering::Relaxed) || TOLD.swap(true, Ordering::Relaxed) {
        return;
    }
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    #[expect(unsafe_code, reason = "the C library's allocator is set through its own interface only")]
    // SAFETY: calls with a parameter and a value of the C library's own; it locks what it changes.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, MAPPED_FROM as libc::c_int);
        libc::mallopt(libc::M_TRIM_THRESHOLD, TRIMMED_FROM as libc::c_int);
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
