//! What can be asked of the codec.

/// Settings of the codec.
#[derive(Clone, Debug, PartialEq)]
pub struct CodecSettings {
    /// Squared error, in squared quantisation steps, that a bit is worth. At high rates a uniform quantiser gives
    /// `2 ln 2 / 12 ≈ 0.12`; 0 rounds to nearest.
    pub lambda: f32,
    /// Whether a block is split into a base layer and a refinement where that pays.
    pub layered: bool,
}

impl CodecSettings {
    /// These as `name=value`, in words that never change: they tell an interrupted file from that of other settings.
    pub fn identity(&self) -> String {
        let Self { lambda, layered } = self;
        format!("lambda={lambda} layered={layered}")
    }
}

impl Default for CodecSettings {
    fn default() -> Self {
        Self { lambda: 0.15, layered: true }
    }
}
