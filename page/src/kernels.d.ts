// What the program puts in front of the page's modules: the kernels of shaders/, joined.
declare const KERNELS: { reconstruct: string; scatter: string; tone: string };
