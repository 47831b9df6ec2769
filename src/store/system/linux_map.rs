//! Memory maps that survive truncation of their file: a file cut under a map is an error and not a signal.
//!
//! Touching a page that the file no longer has raises SIGBUS, which by default ends the process; so does a disk that
//! fails to read it. Checking the length before each access would leave a gap between check and access. So one handler
//! for SIGBUS is installed with the first map. If the address lies in one of our maps, the handler records from where
//! on the map is lost, maps zeros in place of the rest, and returns. Borrowers check afterwards whether their range
//! lies before that. Any other address is passed to the previous handler. A handler that is installed later must
//! likewise pass on what is not its own.
#![expect(unsafe_code, reason = "memory maps, and the signal that comes with them")]

use std::fs::File;
use std::io;
use std::mem::MaybeUninit;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Once, OnceLock};

use memmap2::{Advice, Mmap, UncheckedAdvice};

use crate::store::access::Access;

/// Maps that may be open at a time; beyond that files are read without.
const MAX_MAPS: usize = 64;
/// Bytes before and after a touched page that the system maps with it, if they are in memory (Linux: `fault_around_bytes`).
const MAPPED_AROUND: usize = 1 << 16;

/// Where a map lies. All that the handler reads is atomic, and stays when the map is gone.
struct Slot {
    taken: AtomicBool,
    start: AtomicUsize,
    /// 0 while nothing is mapped.
    end: AtomicUsize,
    /// The first address whose page the file did not have, if any.
    lost: AtomicUsize,
}

static SLOTS: [Slot; MAX_MAPS] = [const {
    Slot {
        taken: AtomicBool::new(false),
        start: AtomicUsize::new(0),
        end: AtomicUsize::new(0),
        lost: AtomicUsize::new(usize::MAX),
    }
}; MAX_MAPS];
static PAGE: AtomicUsize = AtomicUsize::new(4096);
static PREVIOUS: OnceLock<libc::sigaction> = OnceLock::new();

/// A file mapped for reading, as long as it was then.
pub(in crate::store) struct GuardedMap {
    map: Mmap,
    slot: &'static Slot,
}

impl GuardedMap {
    /// Maps a file.
    ///
    /// # Errors
    /// The system refuses, or too many maps are open.
    pub(in crate::store) fn new(file: &File) -> io::Result<Self> {
        install();
        let claim =
            |slot: &&Slot| slot.taken.compare_exchange(false, true, Ordering::Acquire, Ordering::Relaxed).is_ok();
        let slot = SLOTS.iter().find(claim).ok_or(io::ErrorKind::QuotaExceeded)?;
        // SAFETY: others may change the file while it is mapped. Every value of a byte is valid for the types that are
        // read, the content is checked by its checksum, and a page that vanishes becomes zeros, see above.
        let map = unsafe { Mmap::map(file) }.inspect_err(|_| slot.taken.store(false, Ordering::Release))?;
        let start = map.as_ptr() as usize;
        slot.lost.store(usize::MAX, Ordering::SeqCst);
        slot.start.store(start, Ordering::SeqCst);
        slot.end.store(start + map.len(), Ordering::SeqCst);
        Ok(Self { map, slot })
    }

    /// The mapped bytes.
    pub(in crate::store) fn bytes(&self) -> &[u8] {
        &self.map
    }

    /// Bytes from the start that have not been lost so far.
    pub(in crate::store) fn intact_bytes(&self) -> usize {
        (self.slot.lost.load(Ordering::SeqCst).saturating_sub(self.map.as_ptr() as usize)).min(self.map.len())
    }

    /// Says how the map will be read.
    pub(in crate::store) fn will_be_read(&self, access: Access) {
        // Sequential advice makes the kernel read ahead farther (decision 41). Without it the bytes are the same.
        let advice = if access == Access::Blocks { Advice::Sequential } else { Advice::Random };
        let _ = self.map.advise(advice);
    }

    /// Lets the pages of a range go, and what the system has mapped around it: they come back from the file when they are
    /// touched again.
    pub(in crate::store) fn let_go(&self, start: usize, end: usize) {
        let page = PAGE.load(Ordering::Relaxed);
        let start = start.saturating_sub(MAPPED_AROUND) / page * page;
        // Of the zeros in the place of what was lost none are dropped, for they would come back as more zeros.
        let end = (end + MAPPED_AROUND).min(self.intact_bytes()) / page * page;
        if start < end {
            // SAFETY: the map is shared and read-only; a page that is dropped is read from the file again.
            let _ = unsafe { self.map.unchecked_advise_range(UncheckedAdvice::DontNeed, start, end - start) };
        }
    }
}

impl Drop for GuardedMap {
    fn drop(&mut self) {
        self.slot.end.store(0, Ordering::SeqCst);
        self.slot.taken.store(false, Ordering::Release);
    }
}

/// Installs the handler, once for the process.
fn install() {
    static INSTALLED: Once = Once::new();
    INSTALLED.call_once(|| {
        // SAFETY: plain calls into the C library with valid pointers; the handler is one, see there.
        unsafe {
            PAGE.store(libc::sysconf(libc::_SC_PAGESIZE).max(4096) as usize, Ordering::Relaxed);
            let mut previous = MaybeUninit::<libc::sigaction>::zeroed();
            if libc::sigaction(libc::SIGBUS, std::ptr::null(), previous.as_mut_ptr()) != 0 {
                return;
            }
            // Known before the handler may need it.
            let _ = PREVIOUS.set(previous.assume_init());
            let mut action = MaybeUninit::<libc::sigaction>::zeroed().assume_init();
            action.sa_sigaction = on_bus_error as *const () as usize;
            action.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
            libc::sigemptyset(&raw mut action.sa_mask);
            libc::sigaction(libc::SIGBUS, &raw const action, std::ptr::null_mut());
        }
    });
}

/// Puts zeros in the place of the rest of the map that was touched. Calls only what a signal handler may: atomics, the
/// system call `mmap`, and the handler that was there before.
extern "C" fn on_bus_error(signal: libc::c_int, info: *mut libc::siginfo_t, context: *mut libc::c_void) {
    // SAFETY: the system calls with valid pointers; `si_addr` is set for SIGBUS.
    let address = unsafe { (*info).si_addr() } as usize;
    let page_bytes = PAGE.load(Ordering::Relaxed);
    for slot in &SLOTS {
        let (start, end) = (slot.start.load(Ordering::SeqCst), slot.end.load(Ordering::SeqCst));
        if address < start || address >= end {
            continue;
        }
        let page = address / page_bytes * page_bytes;
        // Noted first: another thread that meets the zeros finds the note.
        slot.lost.fetch_min(page, Ordering::SeqCst);
        // SAFETY: the pages from `page` to the map's end are ours, only ever read, and nobody unmaps a map that a thread
        // is reading. `errno` is put back, for the interrupted code may be about to look at it.
        unsafe {
            let errno = *libc::__errno_location();
            let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_FIXED;
            let length = end.next_multiple_of(page_bytes) - page;
            let zeros = libc::mmap(page as *mut libc::c_void, length, libc::PROT_READ, flags, -1, 0);
            *libc::__errno_location() = errno;
            if zeros != libc::MAP_FAILED {
                return;
            }
        }
    }
    pass_on(signal, info, context);
}

/// Not ours: to whoever was there before, and to the default, which ends the process, where nobody was.
fn pass_on(signal: libc::c_int, info: *mut libc::siginfo_t, context: *mut libc::c_void) {
    let previous = PREVIOUS.get();
    let handler = previous.map_or(libc::SIG_DFL, |previous| previous.sa_sigaction);
    // SAFETY: a handler that is neither the default nor to be ignored is a function of the kind that its flags say.
    unsafe {
        if handler == libc::SIG_DFL || handler == libc::SIG_IGN {
            // The touch is repeated when this returns, and then ends the process as it would have without us.
            libc::signal(signal, libc::SIG_DFL);
        } else if previous.is_some_and(|previous| previous.sa_flags & libc::SA_SIGINFO != 0) {
            type Informed = extern "C" fn(libc::c_int, *mut libc::siginfo_t, *mut libc::c_void);
            std::mem::transmute::<usize, Informed>(handler)(signal, info, context);
        } else {
            std::mem::transmute::<usize, extern "C" fn(libc::c_int)>(handler)(signal);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::FileExt;

    const LENGTH: usize = 1 << 20;

    fn file() -> File {
        let file = tempfile::tempfile().unwrap();
        file.write_all_at(&vec![7; LENGTH], 0).unwrap();
        file
    }

    /// One test, for maps are counted for the whole process.
    #[test]
    fn a_lost_page_reads_as_zeros_and_is_noted_and_maps_beyond_the_most_are_refused() {
        let file = file();
        let map = GuardedMap::new(&file).unwrap();
        assert_eq!((map.bytes()[0], map.bytes()[LENGTH - 1]), (7, 7));
        assert_eq!(map.intact_bytes(), LENGTH);
        file.set_len(10_000).unwrap();
        assert_eq!(std::hint::black_box(map.bytes())[LENGTH / 2], 0);
        assert_eq!(map.intact_bytes(), LENGTH / 2);
        // The page that the end lies in is still there, the next one is not.
        assert_eq!(std::hint::black_box(map.bytes())[9_999], 7);
        assert_eq!(std::hint::black_box(map.bytes())[12_288], 0);
        assert_eq!(map.intact_bytes(), 12_288);
        map.let_go(0, LENGTH);
        assert_eq!(std::hint::black_box(map.bytes())[9_999], 7);
        assert_eq!(std::hint::black_box(map.bytes())[LENGTH - 1], 0);

        for _ in 0..3 {
            let mut maps = Vec::new();
            while let Ok(map) = GuardedMap::new(&file) {
                assert_eq!(map.intact_bytes(), 10_000);
                maps.push(map);
                assert!(maps.len() < MAX_MAPS);
            }
            // Other tests may hold some.
            assert!(maps.len() > MAX_MAPS / 2);
        }
    }
}
