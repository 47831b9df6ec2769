//! A panorama as one looks around in it: which of its places is seen where. Both are cameras of a scene ([`Camera`]), the panorama with its
//! viewing direction in the middle, the view one that looks to some side of it; so both agree with what was rendered.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{Vec2, Vec3};

use ltm::scene::{Camera, PixelFilter, Projection};

/// Fields of view along the larger side of the view, in radians: at first, at least, at most.
const FIRST_FIELD: f32 = 80.0 / 360.0 * TAU;
const FIELD_RANGE: (f32, f32) = (30.0 / 360.0 * TAU, 100.0 / 360.0 * TAU);

/// Side of the cells that a view is drawn by, in points, and of those around the poles, where the panorama turns fast.
const CELL: f32 = 16.0;
const LEAST_CELL: f32 = 1.0;
/// Cells are cut as long as a pole is nearer than so many of their sides.
const NEAR_SIDES: f32 = 4.0;

/// A direction to look, and how wide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LookAround {
    /// Radians to the right of where the camera looked, −π to π.
    pub yaw: f32,
    /// Radians up, −π/2 to π/2.
    pub pitch: f32,
    /// Field of view along the larger side of the view, in radians.
    pub field: f32,
}

impl Default for LookAround {
    fn default() -> Self {
        Self { yaw: 0.0, pitch: 0.0, field: FIRST_FIELD }
    }
}

impl LookAround {
    /// Turns by radians to the right and up; not beyond straight up and down.
    pub fn turn(&mut self, right: f32, up: f32) {
        let yaw = self.yaw + right;
        self.yaw = yaw - TAU * (yaw / TAU).round();
        self.pitch = (self.pitch + up).clamp(-FRAC_PI_2, FRAC_PI_2);
    }

    /// Turns with the pointer, which has moved by points in a view of some size.
    pub fn drag(&mut self, points: [f32; 2], view: [f32; 2]) {
        let focal = self.focal(view);
        self.turn(-points[0] / focal, points[1] / focal);
    }

    /// Makes what is in the middle larger by a factor.
    pub fn zoom(&mut self, factor: f32) {
        let field = 2.0 * ((0.5 * self.field).tan() / factor).atan();
        self.field = field.clamp(FIELD_RANGE.0, FIELD_RANGE.1);
    }

    /// One pixel of a panorama so wide per physical pixel of the screen in the middle of the view, as far as the field of view allows.
    pub fn one_to_one(&mut self, width: u32, view: [f32; 2], physical_pixels_per_point: f32) {
        let seen = TAU * self.focal(view) / width as f32;
        self.zoom(1.0 / (seen * physical_pixels_per_point));
    }

    /// Points of a radian in the middle of a view.
    fn focal(&self, view: [f32; 2]) -> f32 {
        0.5 * larger(view) / (0.5 * self.field).tan()
    }

    /// What is seen so of a panorama in a view of this size, in points.
    pub fn sight(&self, view: [f32; 2], panorama: [u32; 2]) -> Sight {
        let (sin_yaw, cos_yaw) = self.yaw.sin_cos();
        let (sin_pitch, cos_pitch) = self.pitch.sin_cos();
        let level = Vec3::new(sin_yaw, 0.0, -cos_yaw);
        let straight = camera(Vec3::NEG_Z, Vec3::X, Vec3::Y);
        // A square that the larger side of the view fills.
        let turned = camera(
            level * cos_pitch + Vec3::Y * sin_pitch,
            Vec3::new(cos_yaw, 0.0, sin_yaw),
            Vec3::Y * cos_pitch - level * sin_pitch,
        );
        Sight {
            panorama: Camera { width: panorama[0], height: panorama[1], ..straight },
            seen: Camera { projection: Projection::Perspective { vertical_fov_radians: self.field }, ..turned },
            half: 0.5 * larger(view).max(1.0),
        }
    }
}

fn larger(view: [f32; 2]) -> f32 {
    view[0].max(view[1])
}

/// A camera of two pixels across and down; a panorama.
fn camera(forward: Vec3, right: Vec3, up: Vec3) -> Camera {
    Camera {
        eye: Vec3::ZERO,
        forward,
        right,
        up,
        projection: Projection::Panorama,
        shift: Vec2::ZERO,
        pixel_aspect: 1.0,
        lens: None,
        width: 2,
        height: 2,
        filter: PixelFilter::Box,
    }
}

/// What is seen of a panorama. Places in the view are points from its middle, positions in the panorama pixels from its top left.
#[derive(Clone, Copy, Debug)]
pub struct Sight {
    panorama: Camera,
    seen: Camera,
    /// Half of the view's larger side, in points.
    half: f32,
}

/// A corner of a cell: its place in the view, and what is seen there, as shares of the panorama's width and height.
pub type CellCorner = ([f32; 2], [f32; 2]);

impl Sight {
    /// The position that is seen at a place.
    pub fn to_picture(&self, place: [f32; 2]) -> [f32; 2] {
        let direction = self.seen.direction(Vec2::ONE + Vec2::from(place) / self.half);
        self.panorama.position(direction).unwrap_or_default().to_array()
    }

    /// The place at which a position is seen, also beside the view; none behind it.
    pub fn to_view(&self, position: [f32; 2]) -> Option<[f32; 2]> {
        self.place_of(self.panorama.direction(position.into()))
    }

    fn place_of(&self, direction: Vec3) -> Option<[f32; 2]> {
        Some(((self.seen.position(direction)? - Vec2::ONE) * self.half).to_array())
    }

    /// The pixel that is seen at a place.
    pub fn pixel_at(&self, place: [f32; 2]) -> [u32; 2] {
        let [x, y] = self.to_picture(place);
        [x as u32 % self.panorama.width, (y as u32).min(self.panorama.height - 1)]
    }

    /// The cells that the part of the view between two corners is drawn by, row by row from the top left: four corners each. Shares of the width
    /// run on beyond 0 and 1 where a cell lies on the seam.
    pub fn cells(&self, [least, most]: [[f32; 2]; 2]) -> Vec<[CellCorner; 4]> {
        let poles = [Vec3::Y, Vec3::NEG_Y].map(|pole| self.place_of(pole));
        let mut cells = Vec::new();
        let mut top = least[1];
        while top < most[1] {
            let bottom = (top + CELL).min(most[1]);
            let mut left = least[0];
            while left < most[0] {
                let right = (left + CELL).min(most[0]);
                self.cut([[left, top], [right, bottom]], &poles, &mut cells);
                left = right;
            }
            top = bottom;
        }
        cells
    }

    fn cut(&self, [least, most]: [[f32; 2]; 2], poles: &[Option<[f32; 2]>; 2], cells: &mut Vec<[CellCorner; 4]>) {
        let (least, most) = (Vec2::from(least), Vec2::from(most));
        let (middle, side) = (0.5 * (least + most), (most - least).max_element());
        let is_near = |pole: &[f32; 2]| middle.distance((*pole).into()) < NEAR_SIDES * side;
        if side > LEAST_CELL && poles.iter().flatten().any(is_near) {
            for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let edges = |at: usize, axis: usize| match at {
                    0 => (least[axis], middle[axis]),
                    _ => (middle[axis], most[axis]),
                };
                let ((left, right), (top, bottom)) = (edges(x, 0), edges(y, 1));
                self.cut([[left, top], [right, bottom]], poles, cells);
            }
            return;
        }
        let size = [self.panorama.width as f32, self.panorama.height as f32];
        let share = |place: [f32; 2]| {
            let position = self.to_picture(place);
            [position[0] / size[0], position[1] / size[1]]
        };
        let places = [[least.x, least.y], [most.x, least.y], [least.x, most.y], [most.x, most.y]];
        let first = share(places[0])[0];
        cells.push(places.map(|place| {
            let [across, down] = share(place);
            (place, [across - (across - first).round(), down])
        }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [720, 360];
    const VIEW: [f32; 2] = [300.0, 200.0];

    fn looking(yaw: f32, pitch: f32, field: f32) -> LookAround {
        let [yaw, pitch, field] = [yaw, pitch, field].map(f32::to_radians);
        LookAround { yaw, pitch, field }
    }

    fn middle(yaw: f32, pitch: f32) -> [f32; 2] {
        looking(yaw, pitch, 80.0).sight(VIEW, SIZE).to_picture([0.0, 0.0])
    }

    fn is_near(found: [f32; 2], expected: [f32; 2], what: &str) {
        // Half a hundredth of a pixel: f32 holds directions to some 1e-7, and an arc cosine near the poles much less.
        let far = (0..2).map(|axis| (found[axis] - expected[axis]).abs()).fold(0.0, f32::max);
        assert!(far < 5e-3, "{what}: {found:?} for {expected:?}");
    }

    #[test]
    fn what_is_seen_is_what_the_camera_saw_there() {
        // Two pixels a degree.
        is_near(middle(0.0, 0.0), [360.0, 180.0], "ahead");
        is_near(middle(90.0, 0.0), [540.0, 180.0], "right");
        is_near(middle(-90.0, 0.0), [180.0, 180.0], "left");
        is_near(middle(0.0, 45.0), [360.0, 90.0], "half up");
        is_near(middle(179.0, 0.0), [718.0, 180.0], "before the seam");
        is_near(middle(-179.0, 0.0), [2.0, 180.0], "behind it");
        assert!(middle(0.0, 90.0)[1] < 0.1 && middle(0.0, -90.0)[1] > 359.9, "the poles");
        // A field of view of 90° ends 45° aside, along the larger side.
        let wide = looking(0.0, 0.0, 90.0).sight(VIEW, SIZE);
        is_near(wide.to_picture([150.0, 0.0]), [450.0, 180.0], "the right edge");
        let tall = looking(0.0, 0.0, 90.0).sight([200.0, 300.0], SIZE);
        is_near(tall.to_picture([0.0, -150.0]), [360.0, 90.0], "the upper edge");
        let around = looking(170.0, 0.0, 90.0).sight(VIEW, SIZE);
        is_near(around.to_picture([150.0, 0.0]), [70.0, 180.0], "beyond the seam");
        // Straight up, what lay ahead of the camera is below.
        let up = looking(0.0, 90.0, 90.0).sight([200.0, 200.0], SIZE);
        is_near(up.to_picture([0.0, 100.0]), [360.0, 90.0], "below straight up");
        is_near(up.to_picture([100.0, 0.0]), [540.0, 90.0], "to the right of it");
    }

    #[test]
    fn a_place_is_the_inverse_of_a_position() {
        let mut seen = 0;
        for (yaw, pitch, field) in [(0.0, 0.0, 80.0), (123.0, 40.0, 30.0), (-179.0, -70.0, 100.0), (180.0, 90.0, 60.0)]
        {
            let sight = looking(yaw, pitch, field).sight(VIEW, SIZE);
            for (x, y) in (0..36).flat_map(|x| (0..18).map(move |y| (x, y))) {
                let position = [20.0 * x as f32 + 9.5, 20.0 * y as f32 + 10.5];
                let Some(place) = sight.to_view(position) else { continue };
                // Along the edge of what is before the view, f32 has few digits left of a place.
                if place[0].abs().max(place[1].abs()) > 1e3 {
                    continue;
                }
                seen += 1;
                is_near(sight.to_picture(place), position, "there and back");
                let near = [place[0].round(), place[1].round()];
                let back = sight.to_view(sight.to_picture(near)).unwrap();
                is_near(back, near, "back and there");
            }
            let behind = looking(yaw + 180.0, -pitch, field).sight(VIEW, SIZE).to_picture([0.0, 0.0]);
            assert_eq!(sight.to_view(behind), None);
        }
        assert!(seen > 500, "{seen}");
    }

    #[test]
    fn turns_and_zooms_have_their_bounds() {
        let mut look = LookAround::default();
        look.turn(350.0_f32.to_radians(), 7.0);
        assert!((look.yaw.to_degrees() + 10.0).abs() < 1e-3 && look.pitch == FRAC_PI_2);
        look.turn(0.0, -7.0);
        assert_eq!(look.pitch, -FRAC_PI_2);
        look.zoom(100.0);
        assert_eq!(look.field, FIELD_RANGE.0);
        look.zoom(0.01);
        assert_eq!(look.field, FIELD_RANGE.1);
        // What was taken hold of goes with the pointer.
        let mut look = looking(10.0, 0.0, 60.0);
        let before = look.sight(VIEW, SIZE).to_picture([0.0, 0.0]);
        look.drag([3.0, -2.0], VIEW);
        is_near(look.sight(VIEW, SIZE).to_view(before).unwrap(), [3.0, -2.0], "dragged");
        look.one_to_one(5760, [1000.0, 500.0], 2.0);
        let sight = look.sight([1000.0, 500.0], [5760, 2880]);
        let [left, right] = [-0.5, 0.5].map(|x| sight.to_picture([x, 0.0])[0]);
        assert!((right - left - 2.0).abs() < 1e-2, "{left} to {right}");
    }

    #[test]
    fn every_place_has_its_pixel() {
        let seam = looking(180.0, 0.0, 80.0).sight(VIEW, SIZE);
        assert_eq!(seam.pixel_at([-1e-3, 0.1]), [719, 180]);
        assert_eq!(seam.pixel_at([1e-3, 0.1]), [0, 180]);
        for (pitch, row) in [(90.0, 0), (-90.0, 359)] {
            assert_eq!(looking(33.0, pitch, 80.0).sight(VIEW, SIZE).pixel_at([0.0, 0.0])[1], row);
        }
    }

    #[test]
    fn cells_tile_the_view_and_lie_as_the_panorama_does() {
        let part = [[-150.0, -100.0], [150.0, 90.0]];
        for (yaw, pitch, field) in [(0.0, 0.0, 100.0), (180.0, 10.0, 30.0), (30.0, 88.0, 60.0), (0.0, -80.0, 100.0)] {
            let sight = looking(yaw, pitch, field).sight(VIEW, SIZE);
            let cells = sight.cells(part);
            let area: f32 =
                cells.iter().map(|cell| (cell[3].0[0] - cell[0].0[0]) * (cell[3].0[1] - cell[0].0[1])).sum();
            assert!((area - 300.0 * 190.0).abs() < 1.0, "{area}");
            for cell in &cells {
                let mean = |axis: usize| cell.iter().map(|(_, share)| share[axis]).sum::<f32>() / 4.0;
                let place = [0, 1].map(|axis| 0.5 * (cell[0].0[axis] + cell[3].0[axis]));
                let exact = sight.to_picture(place);
                let at = [mean(0).rem_euclid(1.0) * 720.0, mean(1) * 360.0];
                let Some(drawn) = sight.to_view(at) else { panic!("{at:?} is behind") };
                // Within half a point, which is most where a small view is wide; in the cells at a pole within their side.
                let far = (drawn[0] - place[0]).hypot(drawn[1] - place[1]);
                let is_at_pole = cell[3].0[0] - cell[0].0[0] <= LEAST_CELL && !(2.0..358.0).contains(&exact[1]);
                assert!(far < if is_at_pole { 1.5 } else { 0.5 }, "{far} at {place:?} of {yaw}, {pitch}");
            }
        }
    }
}
