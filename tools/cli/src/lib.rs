//! What the programs share: progress on a terminal, Ctrl-C, exit codes, the allocator, names of outputs, the
//! options of packing, and how advice is worded.

mod allocator;
pub mod compression;
pub mod console;
pub mod names;
pub mod words;
