//! A texture of the device that relights, made known to egui.

use eframe::egui::TextureId;
use eframe::egui_wgpu::RenderState;

/// Known as long as this lives.
pub(super) struct ScreenTexture {
    texture: wgpu::Texture,
    id: TextureId,
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
        let mut renderer = state.renderer.write();
        let id = renderer.register_native_texture_with_sampler_options(&state.device, &view, sampler);
        drop(renderer);
        Self { texture, id, state }
    }

    pub(super) fn shows(&self, texture: &wgpu::Texture) -> bool {
        self.texture == *texture
    }

    pub(super) fn id(&self) -> TextureId {
        self.id
    }
}

impl Drop for ScreenTexture {
    fn drop(&mut self) {
        self.state.renderer.write().free_texture(&self.id);
    }
}
