//! The compute shaders: their sources, entry points and the arrays bound to them, in order.

/// Threads of a workgroup in every kernel; a test compares it with the shaders'.
pub(super) const THREADS: u32 = 64;

/// A shader with one entry point of its own name.
#[derive(Clone, Copy)]
pub(super) struct Kernel<B: 'static> {
    pub name: &'static str,
    pub source: &'static str,
    /// The bindings at 0, 1, …
    pub bindings: &'static [B],
}

/// The bindings of the kernels that relight.
#[derive(Clone, Copy, Debug)]
pub(super) enum KernelBuffer {
    Sizes,
    Lighting,
    Components,
    Cells,
    Blocks,
    Factors,
    Rows,
    Entries,
    Projected,
    Image,
}

/// What the kernel that shows an image is bound to.
#[derive(Clone, Copy, Debug)]
pub(super) enum ToneBinding {
    ToneMapping,
    Blocks,
    Image,
    Screen,
}

/// The dimension over which the threads of a kernel are distributed.
#[derive(Clone, Copy, Debug)]
pub(super) enum SpreadOver {
    /// A workgroup for each component.
    Components,
    /// A thread for each row that has sparse entries.
    SparseRows,
    /// A thread for four pixels of each block.
    Pixels,
}

/// The sources of a kernel, one after the other, behind the declarations that all share.
macro_rules! wgsl {
    ($($file:literal),+) => {
        concat!(include_str!("../../../shaders/layout.wgsl"), $(include_str!(concat!("../../../shaders/", $file))),+)
    };
}

/// The kernels that relight, in the order in which they run, and what each is spread over.
pub(super) const KERNELS: [(Kernel<KernelBuffer>, SpreadOver); 3] = [
    (PROJECT, SpreadOver::Components),
    (
        Kernel {
            name: "reconstruct",
            source: wgsl!("factors.wgsl", "reconstruct.wgsl"),
            bindings: &[
                KernelBuffer::Sizes,
                KernelBuffer::Blocks,
                KernelBuffer::Components,
                KernelBuffer::Factors,
                KernelBuffer::Projected,
                KernelBuffer::Image,
            ],
        },
        SpreadOver::Pixels,
    ),
    (
        Kernel {
            name: "scatter",
            source: wgsl!("scatter.wgsl"),
            bindings: &[
                KernelBuffer::Sizes,
                KernelBuffer::Lighting,
                KernelBuffer::Rows,
                KernelBuffer::Entries,
                KernelBuffer::Image,
            ],
        },
        SpreadOver::SparseRows,
    ),
];

const PROJECT: Kernel<KernelBuffer> = Kernel {
    name: "project",
    source: wgsl!("factors.wgsl", "dot.wgsl", "project.wgsl"),
    bindings: &[
        KernelBuffer::Sizes,
        KernelBuffer::Lighting,
        KernelBuffer::Components,
        KernelBuffer::Factors,
        KernelBuffer::Projected,
        KernelBuffer::Cells,
    ],
};

/// Takes the place of the first kernel where the device has subgroups.
pub(super) const PROJECT_SUBGROUPS: Kernel<KernelBuffer> =
    Kernel { source: wgsl!("factors.wgsl", "dot.wgsl", "project_subgroups.wgsl"), ..PROJECT };

/// Puts what they have made on a screen.
pub(super) const TONE: Kernel<ToneBinding> = Kernel {
    name: "tone",
    source: wgsl!("tone.wgsl"),
    bindings: &[ToneBinding::ToneMapping, ToneBinding::Blocks, ToneBinding::Image, ToneBinding::Screen],
};
