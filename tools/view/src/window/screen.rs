//! A texture of the device that relights, made known to egui.

use eframe::egui::TextureId;
use eframe::egui_wgpu::RenderState;

use super::sampling::Sampling;

/// Known as long as this lives.
pub(super) struct ScreenTexture {
    texture: wgpu::Texture,
    id: TextureId,
    /// As one looks around in a panorama.
    around: TextureId,
    state: RenderState,
}

impl ScreenTexture {
    pub(super) fn new(state: RenderState, texture: wgpu::Texture) -> Self {
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        // As textures from the memory of the CPU are shown: pixels as squares when they are large.
        let sampler = wgpu::SamplerDescriptor {
            mag_filter: wgpu::FilterMode::Nearest,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        };
        let around = wgpu::SamplerDescriptor {
            address_mode_u: wgpu::AddressMode::Repeat,
            mag_filter: wgpu::FilterMode::Linear,
            ..sampler.clone()
        };
        let mut renderer = state.renderer.write();
        let mut register =
            |sampler| renderer.register_native_texture_with_sampler_options(&state.device, &view, sampler);
        let (id, around) = (register(sampler), register(around));
        drop(renderer);
        Self { texture, id, around, state }
    }

    pub(super) fn shows(&self, texture: &wgpu::Texture) -> bool {
        self.texture == *texture
    }

    pub(super) fn id(&self, sampling: Sampling) -> TextureId {
        if sampling == Sampling::Around { self.around } else { self.id }
    }
}

impl Drop for ScreenTexture {
    fn drop(&mut self) {
        let mut renderer = self.state.renderer.write();
        renderer.free_texture(&self.id);
        renderer.free_texture(&self.around);
    }
}
