//! `.ltm`: the memory-mapped tiled column store.
