//! The store: what is written comes back, nothing is lost, nothing is silently wrong.

#[path = "store/blocks.rs"]
mod blocks;
#[path = "store/files.rs"]
mod files;
