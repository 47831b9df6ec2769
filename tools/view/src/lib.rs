//! The window: a light mixer over a container.
//!
//! What the window knows is kept apart from how it looks: all modules but the private `window` are plain state with tests of
//! their own.

pub mod animation;
pub mod camera_moves;
pub mod daylight;
mod device_renderer;
pub mod difference;
pub mod display;
pub mod export;
pub mod file_watch;
pub mod groups;
pub mod history;
pub mod live;
pub mod looks;
pub mod meter;
mod metered;
pub mod mixer;
mod paged_renderer;
pub mod panorama;
pub mod pattern;
pub mod pdf;
pub mod photometry;
pub mod reach;
pub mod recent;
mod renderer;
pub mod residency;
pub mod rows;
pub mod saved_view;
pub mod seen;
pub mod shared_lights;
pub mod sheet;
pub mod snapshots;
pub mod sun;
pub mod surfaces;
mod system;
#[cfg(test)]
mod test_lights;
pub mod unsaved;
pub mod viewport;
pub mod work;
pub mod worker;

mod window;
mod words;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

pub use window::{App, run};

/// The device that the window relights on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RelightOn {
    /// On the device that draws the window, unless that is a processor in disguise, which our own code outruns.
    #[default]
    Auto,
    /// On the CPU.
    Cpu,
    /// On the device that draws the window, whatever it is.
    Gpu,
}

/// Options of the window.
#[derive(Clone, Debug, Default)]
pub struct WindowOptions {
    /// Container to open, or scene to render.
    pub path: Option<PathBuf>,
    /// Containers of further views, as tabs beside it.
    pub beside: Vec<PathBuf>,
    /// How a scene is rendered.
    pub live: live::LiveChoices,
    /// Where to save a PNG of the window once its picture stands; the window closes then.
    pub screenshot: Option<PathBuf>,
    /// Frames to wait before that.
    pub frames: u32,
    /// Size of the window, in points.
    pub size: Option<[f32; 2]>,
    /// The device to relight on.
    pub relight_on: RelightOn,
    /// Whether a device that relights shows the pictures too; none: unless it is a processor in disguise, whose kernels
    /// need longer for that than reading back and our own code.
    pub shown_on_device: Option<bool>,
    /// Memory for factors, in bytes; none: half of what the machine has. A container that needs more is read as it is
    /// shown.
    pub budget_bytes: Option<u64>,
    /// Set once the window and its device are there: until then a display that does not answer can keep
    /// [`run`] waiting for as long as it likes.
    pub opened: Arc<AtomicBool>,
    /// Whether files are chosen in the desktop's own dialogues, as far as there are any.
    pub native_dialogs: bool,
    /// Folder in which the list of recent files and work that no file has yet are kept; none: they go with the window.
    pub state_folder: Option<PathBuf>,
}
