//! Fills one block of `T` with all its columns.
