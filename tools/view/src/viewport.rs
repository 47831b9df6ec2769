//! Where the picture stands in the window: pan, zoom, fit, one to one.

/// Pixels of the picture shown as points of the screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewport {
    /// Screen points per picture pixel.
    pub zoom: f32,
    /// Picture position, in pixels, in the middle of the view.
    pub centre: [f32; 2],
    /// Whether the picture is fitted to the view as the view changes.
    pub fitted: bool,
}

/// Smallest and largest zoom, in screen points per pixel.
const ZOOM_RANGE: (f32, f32) = (1.0 / 64.0, 128.0);

impl Default for Viewport {
    fn default() -> Self {
        Self { zoom: 1.0, centre: [0.0; 2], fitted: true }
    }
}

impl Viewport {
    /// Follows the view's size, in points, while fitted: the whole picture, as large as it goes.
    pub fn follow(&mut self, view: [f32; 2], picture: [u32; 2]) {
        if self.fitted {
            let picture = picture.map(|v| v as f32);
            let zoom = (view[0] / picture[0]).min(view[1] / picture[1]);
            self.zoom = zoom.clamp(ZOOM_RANGE.0, ZOOM_RANGE.1);
            self.centre = picture.map(|v| v / 2.0);
        }
    }

    /// The same view of the same picture in more pixels, `factor` times as many along each side.
    #[must_use]
    pub fn scaled(self, factor: f32) -> Self {
        Self { zoom: self.zoom / factor, centre: self.centre.map(|at| at * factor), ..self }
    }

    /// Fits the picture from now on.
    pub fn fit(&mut self) {
        self.fitted = true;
    }

    /// One picture pixel per physical pixel of the screen, about the middle of the view.
    pub fn one_to_one(&mut self, physical_pixels_per_point: f32) {
        self.fitted = false;
        self.zoom = 1.0 / physical_pixels_per_point;
    }

    /// Zooms by a factor about a place given in points from the middle of the view, which keeps its pixel.
    pub fn zoom_about(&mut self, place: [f32; 2], factor: f32) {
        let before = self.to_picture(place);
        self.zoom = (self.zoom * factor).clamp(ZOOM_RANGE.0, ZOOM_RANGE.1);
        let after = self.to_picture(place);
        self.fitted = false;
        self.centre = [0, 1].map(|axis| self.centre[axis] + before[axis] - after[axis]);
    }

    /// Moves the picture with the pointer, by points. Its edges cannot leave the middle of the view.
    pub fn pan(&mut self, points: [f32; 2], picture: [u32; 2]) {
        self.fitted = false;
        self.centre =
            [0, 1].map(|axis| (self.centre[axis] - points[axis] / self.zoom).clamp(0.0, picture[axis] as f32));
    }

    /// The picture position, in pixels, at a place in points from the middle of the view.
    pub fn to_picture(&self, place: [f32; 2]) -> [f32; 2] {
        [0, 1].map(|axis| self.centre[axis] + place[axis] / self.zoom)
    }

    /// The place, in points from the middle of the view, of a picture position in pixels.
    pub fn to_view(&self, position: [f32; 2]) -> [f32; 2] {
        [0, 1].map(|axis| (position[axis] - self.centre[axis]) * self.zoom)
    }

    /// The pixel at a place, if the picture is there.
    pub fn pixel_at(&self, place: [f32; 2], picture: [u32; 2]) -> Option<[u32; 2]> {
        let position = self.to_picture(place);
        let inside = (0..2).all(|axis| position[axis] >= 0.0 && position[axis] < picture[axis] as f32);
        inside.then(|| position.map(|v| v as u32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fitting_shows_the_whole_picture_and_follows_the_view() {
        let mut viewport = Viewport::default();
        viewport.follow([800.0, 600.0], [400, 100]);
        assert_eq!((viewport.zoom, viewport.centre), (2.0, [200.0, 50.0]));
        viewport.follow([400.0, 600.0], [400, 100]);
        assert_eq!(viewport.zoom, 1.0);
        assert_eq!(viewport.to_view([0.0, 0.0]), [-200.0, -50.0]);
        viewport.one_to_one(2.0);
        viewport.follow([800.0, 600.0], [400, 100]);
        assert_eq!(viewport.zoom, 0.5, "no longer fitted");
    }

    #[test]
    fn zooming_keeps_the_pixel_under_the_pointer() {
        let mut viewport = Viewport { zoom: 1.5, centre: [30.0, 40.0], fitted: true };
        for factor in [1.1, 3.0, 0.01, 1e9, 1e-12] {
            let before = viewport.to_picture([120.0, -7.0]);
            viewport.zoom_about([120.0, -7.0], factor);
            let after = viewport.to_picture([120.0, -7.0]);
            let size = 1.0 + before[0].abs() + 120.0 / viewport.zoom;
            assert!((before[0] - after[0]).abs() < 1e-5 * size && (before[1] - after[1]).abs() < 1e-5 * size);
            assert!((ZOOM_RANGE.0..=ZOOM_RANGE.1).contains(&viewport.zoom));
        }
    }

    #[test]
    fn more_pixels_of_a_picture_stand_where_fewer_stood() {
        let viewport = Viewport { zoom: 6.0, centre: [30.0, 40.0], fitted: false };
        let finer = viewport.scaled(2.0);
        assert_eq!(finer.to_view([70.0, 20.0]), viewport.to_view([35.0, 10.0]));
    }

    #[test]
    fn only_places_on_the_picture_have_a_pixel() {
        let mut viewport = Viewport::default();
        viewport.follow([100.0, 100.0], [10, 10]);
        assert_eq!(viewport.pixel_at([-50.0, -50.0], [10, 10]), Some([0, 0]));
        assert_eq!(viewport.pixel_at([49.9, 49.9], [10, 10]), Some([9, 9]));
        assert_eq!(viewport.pixel_at([50.1, 0.0], [10, 10]), None);
        assert_eq!(viewport.pixel_at([-50.1, 0.0], [10, 10]), None);
        viewport.pan([1e9, 0.0], [10, 10]);
        assert_eq!(viewport.centre, [0.0, 5.0]);
    }
}
