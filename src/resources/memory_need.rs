//! What types say of the memory that they take, and how jobs add it up.

use super::budget::{PROGRAM_BYTES, ResourceEstimate};

/// A part of a job that states the memory it takes, before it takes it. Each type states its own; jobs add up their parts.
pub trait MemoryNeed {
    /// Upper bound of the bytes that it holds once, however many threads work.
    fn fixed_bytes(&self) -> u64 {
        0
    }

    /// Upper bound of the bytes that it takes for each thread that works on a block.
    fn thread_bytes(&self) -> u64 {
        0
    }
}

impl<T: MemoryNeed> MemoryNeed for &T {
    fn fixed_bytes(&self) -> u64 {
        T::fixed_bytes(self)
    }

    fn thread_bytes(&self) -> u64 {
        T::thread_bytes(self)
    }
}

/// A part that there may be.
impl<T: MemoryNeed> MemoryNeed for Option<T> {
    fn fixed_bytes(&self) -> u64 {
        self.as_ref().map_or(0, T::fixed_bytes)
    }

    fn thread_bytes(&self) -> u64 {
        self.as_ref().map_or(0, T::thread_bytes)
    }
}

/// Bytes that a job holds once and that have no type of their own.
pub(crate) struct Held(pub(crate) u64);

impl MemoryNeed for Held {
    fn fixed_bytes(&self) -> u64 {
        self.0
    }
}

/// Bytes that a job takes for each thread and that have no type of their own.
pub(crate) struct PerThread(pub(crate) u64);

impl MemoryNeed for PerThread {
    fn thread_bytes(&self) -> u64 {
        self.0
    }
}

impl ResourceEstimate {
    /// The program and some parts, all at the same time.
    pub(crate) fn of(parts: &[&dyn MemoryNeed]) -> Self {
        Self { fixed_bytes: PROGRAM_BYTES, ..Self::default() }.and(parts)
    }

    /// The program and some parts on one thread, whatever the number of threads in the pool.
    pub(crate) fn of_one_thread(parts: &[&dyn MemoryNeed]) -> Self {
        let all = Self::of(parts);
        Self { fixed_bytes: all.fixed_bytes.saturating_add(all.per_thread_bytes), per_thread_bytes: 0, ..all }
    }

    /// These, and some parts beside them.
    pub(crate) fn and(self, parts: &[&dyn MemoryNeed]) -> Self {
        parts.iter().fold(self, |sum, part| Self {
            fixed_bytes: sum.fixed_bytes.saturating_add(part.fixed_bytes()),
            per_thread_bytes: sum.per_thread_bytes.saturating_add(part.thread_bytes()),
            ..sum
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_add_up_and_one_thread_takes_its_share_once() {
        let parts: [&dyn MemoryNeed; 3] = [&Held(100), &PerThread(7), &Some(PerThread(5))];
        let need = ResourceEstimate::of(&parts);
        assert_eq!((need.fixed_bytes, need.per_thread_bytes), (PROGRAM_BYTES + 100, 12));
        let alone = ResourceEstimate::of_one_thread(&parts).and(&[&None::<Held>]);
        assert_eq!((alone.fixed_bytes, alone.per_thread_bytes), (PROGRAM_BYTES + 112, 0));
        assert_eq!(need.and(&[&Held(u64::MAX)]).fixed_bytes, u64::MAX);
    }
}
