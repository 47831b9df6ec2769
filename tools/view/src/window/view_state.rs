//! What of the picture is seen, and what was asked of it.

use eframe::egui::TextureId;

use crate::camera_moves::CameraMove;
use crate::panorama::LookAround;
use crate::viewport::Viewport;

/// Shares of the field of view that a key turns by, and finely.
pub(super) const STEP: f32 = 1.0 / 12.0;
pub(super) const FINE_STEP: f32 = 1.0 / 200.0;

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
    /// How one looks around in it, where it is or may be a panorama.
    pub(super) look: Option<LookAround>,
    /// Whether one does; else it is flat.
    pub(super) is_around: bool,
    /// Size of the room for the picture, in points.
    pub(super) room: [f32; 2],
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
    /// How one looks around, if one does.
    pub(super) fn around(&self) -> Option<LookAround> {
        self.look.filter(|_| self.is_around)
    }

    fn around_mut(&mut self) -> Option<&mut LookAround> {
        self.look.as_mut().filter(|_| self.is_around)
    }

    /// The whole picture, or of a panorama what lay ahead of the camera.
    pub(super) fn fit(&mut self) {
        match self.around_mut() {
            Some(look) => *look = LookAround::default(),
            None => self.viewport.fit(),
        }
    }

    /// One pixel of the picture per physical pixel of the screen, of a panorama in the middle.
    pub(super) fn one_to_one(&mut self, width: u32, physical_pixels_per_point: f32) {
        let room = self.room;
        match self.around_mut() {
            Some(look) => look.one_to_one(width, room, physical_pixels_per_point),
            None => self.viewport.one_to_one(physical_pixels_per_point),
        }
    }

    /// Zooms about a place given in points from the middle of the view, in a panorama about the middle.
    pub(super) fn zoom_about(&mut self, place: [f32; 2], factor: f32) {
        match self.around_mut() {
            Some(look) => look.zoom(factor),
            None => self.viewport.zoom_about(place, factor),
        }
    }

    /// Moves the picture of this size with the pointer, by points.
    pub(super) fn pan(&mut self, points: [f32; 2], size: [u32; 2]) {
        let room = self.room;
        match self.around_mut() {
            Some(look) => look.drag(points, room),
            None => self.viewport.pan(points, size),
        }
    }

    /// Turns in a panorama to the right and up, by shares of the field of view.
    pub(super) fn turn(&mut self, shares: [f32; 2]) {
        if let Some(look) = self.around_mut() {
            let [right, up] = shares.map(|share| share * look.field);
            look.turn(right, up);
        }
    }

    /// The position in the middle of what is seen of a picture of this size.
    pub(super) fn looked_at(&self, size: [u32; 2]) -> [f32; 2] {
        self.around().map_or(self.viewport.centre, |look| look.sight(self.room, size).to_picture([0.0; 2]))
    }

    /// Looks as one did in another picture of the same view, where both may be panoramas.
    pub(super) fn look_as(&mut self, look: Option<LookAround>, is_around: bool) {
        if self.look.is_some() && look.is_some() {
            (self.look, self.is_around) = (look, is_around);
        }
    }

    /// Follows the same view as it was before. `scale`: how much larger the picture is, where it is of the same shape.
    pub(super) fn go_on(&mut self, old: Self, scale: Option<f32>) {
        (self.assumes_metres, self.beside) = (old.assumes_metres, old.beside);
        (self.moves_camera, self.moves, self.outline) = (old.moves_camera, old.moves, old.outline);
        self.look_as(old.look, old.is_around);
        if let Some(scale) = scale {
            self.viewport = old.viewport.scaled(scale);
            let place = |pixel: [u32; 2]| pixel.map(|at| ((at as f32 + 0.5) * scale) as u32);
            self.asked = old.asked.map(|asked| Asked { pixel: place(asked.pixel), ..asked });
        }
    }
}
