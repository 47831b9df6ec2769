//! Settings of the tracer.

/// Quality of tracing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TraceSettings {
    /// Paths for each pixel. Powers of two from 2 on cover texels most evenly; with 1 the noise is unknown.
    pub samples_per_pixel: u32,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Longest path in segments: 1 sees only lights, 2 direct light, 3 one bounce. Thin sheets passed straight do not
    /// count.
    pub max_depth: u32,
}
