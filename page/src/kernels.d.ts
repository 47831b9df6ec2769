// What the program puts in front of the page's modules: the kernels of shaders/, joined.
declare const KERNELS: { project: string; reconstruct: string; scatter: string; tone: string };
