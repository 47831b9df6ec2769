//! How a stored matrix will be read.

/// The access pattern to expect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Access {
    /// Whole blocks, for packing and relighting: the system reads ahead.
    #[default]
    Blocks,
    /// A few columns of a block: it does not, for most of what it would read is not wanted.
    Columns,
}
