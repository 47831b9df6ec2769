//! A name that is being typed.

pub(super) struct Renaming {
    /// Which of the list gets the name.
    pub(super) index: usize,
    /// What stands in the field.
    pub(super) text: String,
}

impl Renaming {
    /// Begins with the name as it is.
    pub(super) fn of(index: usize, name: impl Into<String>) -> Self {
        Self { index, text: name.into() }
    }
}
