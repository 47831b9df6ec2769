//! The window: a light mixer over a container.
//!
//! What the window knows is kept apart from how it looks. [`mixer`], [`groups`], [`pattern`], [`history`],
//! [`snapshots`], [`viewport`] and [`reach`] are plain state with tests of their own and are always built; the window
//! over them needs the feature `view`.

pub mod display;
pub mod groups;
pub mod history;
pub mod mixer;
pub mod pattern;
pub mod planck;
pub mod reach;
pub mod snapshots;
pub mod viewport;
pub mod worker;
