//! From blocks of entries to blocks of factors.
