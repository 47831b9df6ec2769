//! What the programs share: progress on a terminal, Ctrl-C, exit codes, the allocator, names of outputs, numbered files, the
//! options of packing, how advice is worded, and their man pages and completions. What is left out of them by default is decision 80.

mod allocator;
pub mod compression;
pub mod console;
pub mod documentation;
pub mod names;
pub mod sequence;
pub mod shell;
pub mod words;
