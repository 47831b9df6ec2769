//! `c = L (R ℓ)`: images from factors, on the CPU or the GPU.
