//! The store: what is written comes back, nothing is lost, nothing is silently wrong.

#[path = "store/blocks.rs"]
mod blocks;
#[path = "store/damage.rs"]
mod damage;
#[path = "store/faults.rs"]
mod faults;
#[path = "store/files.rs"]
mod files;
#[path = "store/format.rs"]
mod format;
#[path = "store/kill.rs"]
mod kill;
#[path = "store/mapped.rs"]
mod mapped;
#[path = "store/memory.rs"]
mod memory;
#[path = "store/storages.rs"]
mod storages;
