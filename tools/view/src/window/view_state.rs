//! What of the picture is seen, and what was asked of it.

use eframe::egui::TextureId;

use crate::camera_moves::CameraMove;
use crate::viewport::Viewport;

/// A pixel that was asked about, with what each light brings there.
pub(super) struct Asked {
    pub(super) pixel: [u32; 2],
    pub(super) lights: Vec<f32>,
}

/// What stands beside the picture that it is compared with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Beside {
    /// Either at its side of the wipe.
    #[default]
    Wipe,
    /// The other one whole.
    Other,
    /// The difference of the two.
    Difference,
}

#[derive(Default)]
pub(super) struct ViewState {
    pub(super) viewport: Viewport,
    /// The pixel under the pointer.
    pub(super) hovered: Option<[u32; 2]>,
    pub(super) asked: Option<Asked>,
    /// Whether the next answer about a pixel selects its strongest light.
    pub(super) select_strongest: bool,
    pub(super) beside: Beside,
    /// Whether a scene that does not say how long its unit is counts as one in metres.
    pub(super) assumes_metres: bool,
    /// Whether the pointer may move the camera: the scene is at hand.
    pub(super) moves_camera: bool,
    /// How the pointer has moved it in this frame.
    pub(super) moves: Vec<CameraMove>,
    /// What is shown instead of the picture while that is of an older view.
    pub(super) outline: Option<TextureId>,
}

impl ViewState {
    /// Follows the same view as it was before. `scale`: how much larger the picture is, where it is of the same shape.
    pub(super) fn go_on(&mut self, old: Self, scale: Option<f32>) {
        (self.assumes_metres, self.beside) = (old.assumes_metres, old.beside);
        (self.moves_camera, self.moves, self.outline) = (old.moves_camera, old.moves, old.outline);
        if let Some(scale) = scale {
            self.viewport = old.viewport.scaled(scale);
            let place = |pixel: [u32; 2]| pixel.map(|at| ((at as f32 + 0.5) * scale) as u32);
            self.asked = old.asked.map(|asked| Asked { pixel: place(asked.pixel), ..asked });
        }
    }
}
