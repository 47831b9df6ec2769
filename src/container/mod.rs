//! `.ltc`: the block-indexed container of factors.
