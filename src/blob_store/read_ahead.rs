//! Reading ahead of an object: a request takes tens of milliseconds whatever it asks for, and a block has a few kilobytes.

use std::collections::VecDeque;
use std::io::Result;
use std::ops::Range;
use std::sync::{Arc, Condvar, Mutex, PoisonError};

/// Bytes of the first request anywhere; each that goes on where another ended asks for twice as many.
const MIN_READ_BYTES: u64 = 64 << 10;
const MAX_READ_BYTES: u64 = 2 << 20;
/// Bytes that are kept, the last used.
const KEPT: usize = 16 << 20;
/// Requests under way at most.
const FLYING: usize = 8;
/// Memory that all of it takes at most: what is kept, and each request in pieces and as a whole.
pub(super) const HELD_BYTES: u64 = KEPT as u64 + 2 * FLYING as u64 * MAX_READ_BYTES;

/// Parts of an object that were fetched.
#[derive(Debug, Default)]
pub(super) struct Ahead {
    state: Mutex<State>,
    landed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    /// The last used is the last.
    parts: VecDeque<Part>,
    flying: Vec<Range<u64>>,
}

#[derive(Clone, Debug)]
struct Part {
    offset: u64,
    bytes: Arc<Vec<u8>>,
}

impl Part {
    fn end(&self) -> u64 {
        self.offset + self.bytes.len() as u64
    }
}

impl Ahead {
    /// Fills `buffer` from `offset` of an object of `length` bytes, of which `fetch` gives a range.
    ///
    /// # Errors
    /// Those of `fetch`.
    pub(super) fn fill(
        &self,
        buffer: &mut [u8],
        offset: u64,
        length: u64,
        fetch: &dyn Fn(Range<u64>) -> Result<Vec<u8>>,
    ) -> Result<()> {
        let mut filled = 0;
        while filled < buffer.len() {
            let at = offset + filled as u64;
            let part = self.part_at(at, (buffer.len() - filled) as u64, length, fetch)?;
            let from = &part.bytes[(at - part.offset) as usize..];
            let step = from.len().min(buffer.len() - filled);
            buffer[filled..filled + step].copy_from_slice(&from[..step]);
            filled += step;
        }
        Ok(())
    }

    /// A part that holds the byte at `at`, of which so many that follow are wanted too.
    fn part_at(
        &self,
        at: u64,
        wanted: u64,
        length: u64,
        fetch: &dyn Fn(Range<u64>) -> Result<Vec<u8>>,
    ) -> Result<Part> {
        let lock = || self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let mut state = lock();
        let range = loop {
            if let Some(part) = state.find(at) {
                return Ok(part);
            }
            if state.flying.len() < FLYING && !state.flying.iter().any(|range| range.contains(&at)) {
                break state.request(at, wanted, length);
            }
            state = self.landed.wait(state).unwrap_or_else(PoisonError::into_inner);
        };
        state.flying.push(range.clone());
        drop(state);
        let fetched = fetch(range.clone());
        let mut state = lock();
        state.flying.retain(|flying| *flying != range);
        self.landed.notify_all();
        let part = Part { offset: range.start, bytes: Arc::new(fetched?) };
        state.keep(part.clone());
        Ok(part)
    }
}

impl State {
    fn find(&mut self, at: u64) -> Option<Part> {
        let found = self.parts.iter().position(|part| (part.offset..part.end()).contains(&at))?;
        let part = self.parts.remove(found)?;
        self.parts.push_back(part.clone());
        Some(part)
    }

    /// The range to fetch for a byte that is not there.
    fn request(&self, at: u64, wanted: u64, length: u64) -> Range<u64> {
        // Whether somebody has read to here, or nearly.
        let before = self.parts.iter().filter(|part| (part.end()..part.end() + MIN_READ_BYTES).contains(&at));
        let step = before.map(|part| 2 * part.bytes.len() as u64).max().unwrap_or(0);
        let end = (at + step.max(wanted).clamp(MIN_READ_BYTES, MAX_READ_BYTES)).min(length);
        // Not what is there or comes already.
        let others = self.parts.iter().map(|part| part.offset).chain(self.flying.iter().map(|range| range.start));
        at..others.filter(|start| *start > at).fold(end, u64::min)
    }

    fn keep(&mut self, part: Part) {
        self.parts.push_back(part);
        while self.parts.iter().map(|part| part.bytes.len()).sum::<usize>() > KEPT {
            self.parts.pop_front();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENGTH: u64 = 40 << 20;

    fn byte(at: u64) -> u8 {
        (at.wrapping_mul(2_654_435_761) >> 13) as u8
    }

    /// Reads, and checks what it reads; gives the requests that were made.
    fn reading(ahead: &Ahead, places: impl IntoIterator<Item = (u64, usize)>) -> Vec<Range<u64>> {
        let requests = Mutex::new(Vec::new());
        let fetch = |range: Range<u64>| {
            requests.lock().unwrap().push(range.clone());
            Ok(range.map(byte).collect())
        };
        for (offset, bytes) in places {
            let mut buffer = vec![0; bytes];
            ahead.fill(&mut buffer, offset, LENGTH, &fetch).unwrap();
            assert!(buffer.iter().zip(offset..).all(|(b, at)| *b == byte(at)));
        }
        requests.into_inner().unwrap()
    }

    #[test]
    fn who_reads_on_asks_for_more_and_who_jumps_for_little() {
        let requests =
            reading(&Ahead::default(), (0..LENGTH).step_by(5000).map(|at| (at, 5000.min((LENGTH - at) as usize))));
        assert!(requests.len() < 30, "{} requests", requests.len());
        assert!(requests.windows(2).all(|w| w[0].end == w[1].start), "no byte twice");
        let jumps = reading(&Ahead::default(), (0..20).map(|i| ((i * 7919 % 40) << 20, 3000)));
        assert_eq!(jumps.len(), 20);
        assert!(jumps.iter().all(|range| range.end - range.start == MIN_READ_BYTES));
        // The last bytes, and a read that is longer than any request.
        let ends = reading(&Ahead::default(), [(LENGTH - 10, 10), (1, 5 << 20)]);
        assert_eq!(ends[0], LENGTH - 10..LENGTH);
        assert_eq!(ends.iter().skip(1).map(|range| range.end - range.start).collect::<Vec<_>>(), [MAX_READ_BYTES; 3]);
    }

    #[test]
    fn what_was_read_is_kept_within_bounds() {
        let ahead = Ahead::default();
        assert_eq!(reading(&ahead, [(5, 100), (50, 100), (5, 100)]).len(), 1);
        reading(&ahead, [(0, LENGTH as usize)]);
        let kept: usize = ahead.state.lock().unwrap().parts.iter().map(|part| part.bytes.len()).sum();
        assert!(kept <= KEPT && kept > KEPT / 2, "{kept}");
    }

    #[test]
    fn threads_share_what_is_under_way_and_a_request_that_fails_is_made_again() {
        let (ahead, requests) = (Ahead::default(), Mutex::new(0));
        let fetch = |range: Range<u64>| {
            let number = {
                let mut requests = requests.lock().unwrap();
                *requests += 1;
                *requests
            };
            std::thread::sleep(std::time::Duration::from_millis(20));
            if number == 1 { Err(std::io::Error::other("the first")) } else { Ok(range.map(byte).collect()) }
        };
        let failed = std::thread::scope(|scope| {
            let read = || ahead.fill(&mut [0; 100], 1000, LENGTH, &fetch).is_err();
            let readers: Vec<_> = (0..6).map(|_| scope.spawn(read)).collect();
            readers.into_iter().map(|reader| reader.join().unwrap()).filter(|failed| *failed).count()
        });
        assert_eq!((failed, requests.into_inner().unwrap()), (1, 2));
    }
}
