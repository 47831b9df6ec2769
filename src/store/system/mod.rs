//! What each system does for large files in a way of its own: memory maps whose file may be cut, holes, advice on the page cache. A
//! port begins here; `portable.rs` does without all of it, with the same bytes.

#[cfg(target_os = "linux")]
mod linux;
#[cfg(target_os = "linux")]
mod linux_map;
#[cfg(not(target_os = "linux"))]
mod portable;

#[cfg(target_os = "linux")]
pub(super) use linux::{clears, expect, is_local, next_data, release, reserve, will_read};
#[cfg(target_os = "linux")]
pub(super) use linux_map::GuardedMap;
#[cfg(not(target_os = "linux"))]
pub(super) use portable::{NoMap as GuardedMap, clears, expect, is_local, next_data, release, reserve, will_read};
