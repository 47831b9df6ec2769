//! The compute shaders: their sources, entry points and the arrays bound to them, in order.

/// Threads of a workgroup in every kernel.
pub(super) const THREADS: u32 = 64;

/// A shader with one entry point of its own name.
pub(super) struct Kernel {
    pub name: &'static str,
    pub source: &'static str,
    /// What is bound at 0, 1, …, by its name in the shader.
    pub bindings: &'static [&'static str],
}

/// All kernels, in the order in which they run.
pub(super) const KERNELS: &[Kernel] = &[
    Kernel {
        name: "project",
        source: include_str!("../../../shaders/project.wgsl"),
        bindings: &["sizes", "lighting", "components", "factors", "projected"],
    },
    Kernel {
        name: "reconstruct",
        source: include_str!("../../../shaders/reconstruct.wgsl"),
        bindings: &["sizes", "blocks", "components", "factors", "projected", "image"],
    },
    Kernel {
        name: "scatter",
        source: include_str!("../../../shaders/scatter.wgsl"),
        bindings: &["sizes", "lighting", "rows", "entries", "image"],
    },
];
