//! What the programs share: progress on a terminal, Ctrl-C, exit codes, the allocator, names of outputs, and the
//! options of packing.

mod allocator;
pub mod compression;
pub mod console;
pub mod names;
