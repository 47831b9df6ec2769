//! Where the picture stands in its room: flat, by the viewport, or a panorama as one looks around in it.

use eframe::egui::epaint::Vertex;
use eframe::egui::{Color32, Mesh, Painter, Pos2, Rect, Shape, TextureId, pos2, vec2};

use super::document::Document;
use crate::panorama::Sight;
use crate::viewport::Viewport;

/// Position of the image on the screen.
pub(super) struct Place {
    /// The room for it.
    pub(super) view: Rect,
    /// The picture in it; all of the room, where one looks around.
    pub(super) picture: Rect,
    size: [u32; 2],
    viewport: Viewport,
    /// What is seen of the panorama, where one looks around.
    sight: Option<Sight>,
}

impl Place {
    pub(super) fn of(view: Rect, document: &Document) -> Self {
        let (size, viewport) = (document.size(), document.front.view.viewport);
        let sight = document.front.view.around().map(|look| look.sight(view.size().into(), size));
        let picture = match sight {
            Some(_) => view,
            None => {
                let corner = view.center() + viewport.to_view([0.0, 0.0]).into();
                Rect::from_min_size(corner, size.map(|v| v as f32 * viewport.zoom).into())
            }
        };
        Self { view, picture, size, viewport, sight }
    }

    /// Offset from the centre of the view, in points.
    pub(super) fn offset_of(&self, at: Pos2) -> [f32; 2] {
        (at - self.view.center()).into()
    }

    /// The place of a picture position on the screen; none behind who looks around.
    pub(super) fn to_screen(&self, position: [f32; 2]) -> Option<Pos2> {
        let offset = match &self.sight {
            Some(sight) => sight.to_view(position)?,
            None => self.viewport.to_view(position),
        };
        Some(self.view.center() + offset.into())
    }

    /// The picture position at a place on the screen.
    pub(super) fn to_picture(&self, at: Pos2) -> [f32; 2] {
        match &self.sight {
            Some(sight) => sight.to_picture(self.offset_of(at)),
            None => self.viewport.to_picture(self.offset_of(at)),
        }
    }

    /// The pixel at a place on the screen, if the picture is there.
    pub(super) fn pixel_at(&self, at: Pos2) -> Option<[u32; 2]> {
        match &self.sight {
            Some(sight) => Some(sight.pixel_at(self.offset_of(at))),
            None => self.viewport.pixel_at(self.offset_of(at), self.size),
        }
    }

    /// Parts of a side of an area in the picture: one where lines stay straight.
    pub(super) fn parts_of_side(&self) -> usize {
        if self.sight.is_some() { 32 } else { 1 }
    }

    /// Draws an image of the picture's shape where that stands, from a share of its width on.
    pub(super) fn draw(&self, painter: &Painter, texture: TextureId, from: f32) {
        let part = Rect::from_min_max(
            pos2(self.picture.left() + from * self.picture.width(), self.picture.top()),
            self.picture.max,
        );
        let Some(sight) = &self.sight else {
            let whole = Rect::from_min_max(pos2(from, 0.0), pos2(1.0, 1.0));
            painter.image(texture, part, whole, Color32::WHITE);
            return;
        };
        // The texture goes on from its right edge to its left one, but not from its upper one to its lower one. It may have fewer texels.
        let most = painter.ctx().input(|input| input.max_texture_side) as u32;
        let step = self.size[0].max(self.size[1]).div_ceil(most.max(1)).max(1);
        let half_texel = 0.5 / self.size[1].div_ceil(step) as f32;
        let mut mesh = Mesh::with_texture(texture);
        for cell in sight.cells([part.min, part.max].map(|corner| self.offset_of(corner))) {
            let first = mesh.vertices.len() as u32;
            mesh.vertices.extend(cell.map(|(place, [across, down])| Vertex {
                pos: self.view.center() + vec2(place[0], place[1]),
                uv: pos2(across, down.clamp(half_texel, 1.0 - half_texel)),
                color: Color32::WHITE,
            }));
            mesh.add_triangle(first, first + 1, first + 2);
            mesh.add_triangle(first + 2, first + 1, first + 3);
        }
        painter.add(Shape::mesh(mesh));
    }
}
