//! The compute shaders: their sources, entry points and the arrays bound to them, in order.

/// Threads of a workgroup in every kernel; a test compares it with the shaders'.
pub(super) const THREADS: u32 = 64;

/// A shader with one entry point of its own name.
#[derive(Clone, Copy)]
pub(super) struct Kernel {
    pub name: &'static str,
    pub source: &'static str,
    /// What is bound at 0, 1, …, by its name in the shader.
    pub bindings: &'static [&'static str],
}

/// The sources of a kernel, one after the other, behind the declarations that all share.
macro_rules! wgsl {
    ($($file:literal),+) => {
        concat!(include_str!("../../../shaders/layout.wgsl"), $(include_str!(concat!("../../../shaders/", $file))),+)
    };
}

/// The kernels that relight, in the order in which they run.
pub(super) const KERNELS: [Kernel; 3] = [
    Kernel {
        name: "project",
        source: wgsl!("dot.wgsl", "project.wgsl"),
        bindings: &["sizes", "lighting", "components", "factors", "projected"],
    },
    Kernel {
        name: "reconstruct",
        source: wgsl!("reconstruct.wgsl"),
        bindings: &["sizes", "blocks", "components", "factors", "projected", "image"],
    },
    Kernel {
        name: "scatter",
        source: wgsl!("scatter.wgsl"),
        bindings: &["sizes", "lighting", "rows", "entries", "image"],
    },
];

/// Puts what they have made on a screen.
pub(super) const TONE: Kernel =
    Kernel { name: "tone", source: wgsl!("tone.wgsl"), bindings: &["tone_mapping", "blocks", "image", "screen"] };

/// Takes the place of the first kernel where the device has subgroups.
pub(super) const PROJECT_SUBGROUPS: Kernel =
    Kernel { source: wgsl!("dot.wgsl", "project_subgroups.wgsl"), ..KERNELS[0] };
