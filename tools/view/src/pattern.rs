//! Patterns of texelled lights: painting, shapes, images, rotation.

use std::borrow::Cow;
use std::f32::consts::TAU;
use std::sync::Arc;

use glam::Vec2;
use serde::{Deserialize, Serialize};

use ltm::image::LinearImage;
use ltm::light::{EnvironmentMapping, LightKind, turn_about_vertical};

/// Points along each side of a texel that a shape or a turned environment is sampled at.
const CUTS: usize = 4;

/// Colours that the texels of one light are multiplied by, row by row. Cheap to clone: copies share until one changes.
#[derive(Clone, Debug, PartialEq)]
pub struct Pattern {
    size: (u32, u32),
    texels: Arc<Vec<[f32; 3]>>,
}

/// A brush that paints on texels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brush {
    /// Radius, in texels.
    pub radius_texels: f32,
    /// From 0, soft to the middle, to 1, a hard edge.
    pub hardness: f32,
    /// How much of the colour one touch lays down, 0 to 1.
    pub flow: f32,
    /// What is painted: 0 is dark, 1 the light as it was.
    pub colour: [f32; 3],
}

/// A shape that is laid over a light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shape {
    /// Kind of the shape.
    pub kind: ShapeKind,
    /// Its middle, in fractions of the light's width and height.
    pub centre: [f32; 2],
    /// Its width and height, in the same fractions.
    pub size: [f32; 2],
    /// Colour inside.
    pub inside: [f32; 3],
    /// Colour outside.
    pub outside: [f32; 3],
}

/// The shapes there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ShapeKind {
    /// An ellipse.
    Disc,
    /// A rectangle along the axes.
    Rectangle,
    /// From outside at the left to inside at the right, over the shape's width.
    Gradient,
}

impl Pattern {
    /// A pattern of ones.
    pub fn white((across, down): (u32, u32)) -> Self {
        Self::filled((across, down), [1.0; 3])
    }

    /// One colour everywhere.
    pub fn filled((across, down): (u32, u32), colour: [f32; 3]) -> Self {
        Self { size: (across, down), texels: Arc::new(vec![colour; across as usize * down as usize]) }
    }

    /// Texels (across, down).
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// The texels, row by row.
    pub fn texels(&self) -> &[[f32; 3]] {
        &self.texels
    }

    /// The texels, to change them.
    pub fn texels_mut(&mut self) -> &mut [[f32; 3]] {
        Arc::make_mut(&mut self.texels).as_mut_slice()
    }

    /// Paints along a line between two positions in texels, in touches a quarter of the radius apart. `wraps` where
    /// the left edge continues at the right, as a lat-long environment's does.
    pub fn stroke(&mut self, brush: &Brush, from: [f32; 2], to: [f32; 2], wraps: bool) {
        let length = (to[0] - from[0]).hypot(to[1] - from[1]);
        let steps = (length / (brush.radius_texels * 0.25).max(0.25)).ceil().clamp(1.0, 4096.0) as usize;
        for step in 1..=steps {
            let t = step as f32 / steps as f32;
            self.touch(brush, [0, 1].map(|axis| from[axis] + t * (to[axis] - from[axis])), wraps);
        }
    }

    /// One touch of the brush at a position in texels.
    pub fn touch(&mut self, brush: &Brush, at: [f32; 2], wraps: bool) {
        let (across, down) = (self.size.0 as i64, self.size.1 as i64);
        // A brush smaller than a texel still paints the texel that it is on.
        let radius = brush.radius_texels.max(0.5);
        if !at.iter().all(|v| v.is_finite()) || !radius.is_finite() {
            return;
        }
        let range = |middle: f32| (middle - radius).floor() as i64..=(middle + radius).floor() as i64;
        let texels = Arc::make_mut(&mut self.texels);
        for row in range(at[1]).filter(|row| (0..down).contains(row)) {
            for column in range(at[0]) {
                let inside = (0..across).contains(&column);
                if !(inside || wraps && (-across..2 * across).contains(&column)) {
                    continue;
                }
                let distance = (column as f32 + 0.5 - at[0]).hypot(row as f32 + 0.5 - at[1]) / radius;
                let edge = ((1.0 - distance) / (1.0 - brush.hardness).max(1e-3)).clamp(0.0, 1.0);
                let hit = distance <= 1.0 || column == at[0].floor() as i64 && row == at[1].floor() as i64;
                let edge = if hit && radius <= 0.75 { 1.0 } else { edge * edge * (3.0 - 2.0 * edge) };
                let texel = &mut texels[(row * across + column.rem_euclid(across)) as usize];
                for (value, colour) in texel.iter_mut().zip(brush.colour) {
                    *value += (colour - *value) * edge * brush.flow;
                }
            }
        }
    }

    /// A shape, its edges averaged over each texel.
    pub fn of_shape((across, down): (u32, u32), shape: &Shape) -> Self {
        Self::sampled((across, down), |x, y| {
            let share = shape.share([x / across as f32, y / down as f32]);
            [0, 1, 2].map(|ch| shape.outside[ch] + (shape.inside[ch] - shape.outside[ch]) * share)
        })
    }

    /// An image laid over a light: averaged over each texel, and on environments, whose images are lat-long with the zenith
    /// at the top, as [`EnvironmentMapping::resample`] lays them. Texels between the pixels of a coarse image take the
    /// nearest one. Negative and non-finite values count as 0.
    pub fn of_image(kind: LightKind, image: &LinearImage) -> Self {
        let size = kind.layout();
        let (width, height) = (image.width as usize, image.height as usize);
        if width == 0 || height == 0 {
            return Self::filled(size, [0.0; 3]);
        }
        if let Some(mapping) = kind.environment() {
            let mut texels = mapping.resample((image.width, image.height), &image.pixels, 0.0);
            if matches!(kind, LightKind::Patches { is_split: true, .. }) {
                texels.extend_from_within(..);
            }
            return Self { size, texels: Arc::new(texels) };
        }
        let clean = |pixel: [f32; 3]| pixel.map(|v| if v.is_finite() { v.max(0.0) } else { 0.0 });
        let mut sums = vec![[0.0f64; 4]; size.0 as usize * size.1 as usize];
        for row in 0..height {
            for column in 0..width {
                let at = [(column as f32 + 0.5) / width as f32, (row as f32 + 0.5) / height as f32];
                let sum = &mut sums[texel_index(size, at)];
                for (channel, value) in clean(image.pixels[row * width + column]).into_iter().enumerate() {
                    sum[channel] += f64::from(value);
                }
                sum[3] += 1.0;
            }
        }
        let nearest = |texel: usize| {
            let (column, row) = (texel % size.0 as usize, texel / size.0 as usize);
            let at = [(column as f32 + 0.5) / size.0 as f32, (row as f32 + 0.5) / size.1 as f32];
            clean(image.pixels[texel_index((image.width, image.height), at)])
        };
        let texels = sums.iter().enumerate().map(|(texel, &[r, g, b, weight])| match weight > 0.0 {
            true => [r, g, b].map(|v| (v / weight) as f32),
            false => nearest(texel),
        });
        Self { size, texels: Arc::new(texels.collect()) }
    }

    /// The environment turned to the right about the vertical; other lights as they are.
    pub fn turned(&self, kind: LightKind, radians: f32) -> Cow<'_, Self> {
        let mapping = kind.environment().filter(|mapping| radians != 0.0 && mapping.layout() == self.size);
        let Some(mapping) = mapping else { return Cow::Borrowed(self) };
        if let EnvironmentMapping::LatLong { across, .. } = mapping {
            return Cow::Owned(self.shifted(radians / TAU * across as f32));
        }
        Cow::Owned(Self::sampled(self.size, |x, y| {
            let texel = y as u32 * self.size.0 + x as u32;
            let direction = mapping.direction_at(texel, Vec2::new(x.fract(), y.fract()));
            self.texels[mapping.texel_at(turn_about_vertical(direction, -radians)) as usize]
        }))
    }

    /// Moved to the right around the ring by a fraction of texels, linearly between texels: each row keeps its sum.
    fn shifted(&self, columns: f32) -> Self {
        let across = self.size.0 as usize;
        let columns = columns.rem_euclid(across as f32);
        let (whole, part) = (columns as usize % across, columns.fract());
        let mut texels = vec![[0.0; 3]; self.texels.len()];
        for (new, old) in texels.chunks_exact_mut(across).zip(self.texels.chunks_exact(across)) {
            for (column, texel) in new.iter_mut().enumerate() {
                let here = old[(column + across - whole) % across];
                let left = old[(column + 2 * across - whole - 1) % across];
                *texel = [0, 1, 2].map(|ch| here[ch] * (1.0 - part) + left[ch] * part);
            }
        }
        Self { size: self.size, texels: Arc::new(texels) }
    }

    /// The averages over each texel of a function of positions in texels.
    fn sampled(size: (u32, u32), mut value: impl FnMut(f32, f32) -> [f32; 3]) -> Self {
        let mut texels = Vec::with_capacity(size.0 as usize * size.1 as usize);
        for row in 0..size.1 {
            for column in 0..size.0 {
                let mut sum = [0.0; 3];
                for cut in 0..CUTS * CUTS {
                    let offset = |i: usize| (i as f32 + 0.5) / CUTS as f32;
                    let sample = value(column as f32 + offset(cut % CUTS), row as f32 + offset(cut / CUTS));
                    sum = [0, 1, 2].map(|ch| sum[ch] + sample[ch]);
                }
                texels.push(sum.map(|v| v / (CUTS * CUTS) as f32));
            }
        }
        Self { size, texels: Arc::new(texels) }
    }
}

impl Shape {
    /// How much of the inside's colour a position has, 0 to 1.
    fn share(&self, at: [f32; 2]) -> f32 {
        let [x, y] = [0, 1].map(|axis| (at[axis] - self.centre[axis]) / self.size[axis].abs().max(1e-6));
        match self.kind {
            ShapeKind::Disc => f32::from(u8::from(x * x + y * y <= 0.25)),
            ShapeKind::Rectangle => f32::from(u8::from(x.abs() <= 0.5 && y.abs() <= 0.5)),
            ShapeKind::Gradient => (x + 0.5).clamp(0.0, 1.0),
        }
    }
}

/// Index of the texel at a position in fractions of the light's size.
fn texel_index((across, down): (u32, u32), at: [f32; 2]) -> usize {
    let cell = |fraction: f32, count: u32| ((fraction * count as f32) as usize).min(count as usize - 1);
    cell(at[1], down) * across as usize + cell(at[0], across)
}

#[cfg(test)]
mod tests {
    use std::f32::consts::{FRAC_PI_2, PI};

    use super::*;

    fn sum(pattern: &Pattern) -> f32 {
        pattern.texels().iter().map(|t| t[0]).sum()
    }

    #[test]
    fn a_stroke_paints_what_it_passes_and_nothing_else() {
        let mut pattern = Pattern::white((16, 8));
        let before = pattern.clone();
        let brush = Brush { radius_texels: 1.5, hardness: 1.0, flow: 1.0, colour: [0.0, 0.5, 2.0] };
        pattern.stroke(&brush, [2.5, 4.5], [13.5, 4.5], false);
        for column in 2..14 {
            assert_eq!(pattern.texels()[4 * 16 + column], brush.colour);
        }
        assert_eq!(pattern.texels()[16 + 7], [1.0; 3]);
        assert_eq!(before, Pattern::white((16, 8)), "copies do not change with it");
    }

    #[test]
    fn a_small_brush_still_paints_its_texel_and_a_wide_one_wraps() {
        let mut pattern = Pattern::white((8, 4));
        let brush = Brush { radius_texels: 0.01, hardness: 0.0, flow: 1.0, colour: [0.0; 3] };
        pattern.touch(&brush, [7.9, 1.1], true);
        assert_eq!(pattern.texels()[8 + 7], [0.0; 3]);
        let wide = Brush { radius_texels: 2.0, hardness: 1.0, ..brush };
        pattern.touch(&wide, [0.0, 2.0], true);
        assert_eq!(pattern.texels()[2 * 8 + 7], [0.0; 3]);
        let mut other = Pattern::white((8, 4));
        other.touch(&wide, [0.0, 2.0], false);
        assert_eq!(other.texels()[2 * 8 + 7], [1.0; 3]);
        other.touch(&wide, [f32::NAN, 2.0], false);
        other.touch(&wide, [-1e30, 1e30], true);
    }

    #[test]
    fn a_disc_has_the_area_of_a_disc() {
        let shape =
            Shape { kind: ShapeKind::Disc, centre: [0.5; 2], size: [0.5; 2], inside: [1.0; 3], outside: [0.0; 3] };
        let pattern = Pattern::of_shape((64, 64), &shape);
        // The samples lie 1/256 apart: the area is off by about their spacing times the rim, π/2.
        assert!((sum(&pattern) / 4096.0 - PI / 16.0).abs() < FRAC_PI_2 / 256.0);
        let gradient = Shape { kind: ShapeKind::Gradient, size: [1.0; 2], ..shape };
        assert!((sum(&Pattern::of_shape((8, 8), &gradient)) / 64.0 - 0.5).abs() < 1e-5);
    }

    #[test]
    fn turning_an_environment_keeps_its_energy_and_comes_back() {
        let kind = LightKind::LatLong { across: 12, down: 3 };
        let mut pattern = Pattern::white((12, 3));
        pattern.texels_mut()[14] = [9.0; 3];
        let quarter = pattern.turned(kind, FRAC_PI_2);
        assert_eq!(quarter.texels()[17], [9.0; 3]);
        let part = pattern.turned(kind, 0.123).into_owned();
        assert!((sum(&part) - sum(&pattern)).abs() < 1e-4);
        assert_eq!(pattern.turned(kind, TAU).texels()[14], [9.0; 3]);
        assert_eq!(*pattern.turned(LightKind::AreaTexels { across: 12, down: 3 }, 1.0), pattern);
    }

    #[test]
    fn a_turned_octahedral_environment_moves_its_sun() {
        let kind = LightKind::Octahedral { side: 32 };
        let mut pattern = Pattern::filled((32, 32), [0.0; 3]);
        let mapping = kind.environment().unwrap();
        let direction = glam::Vec3::new(0.5, 0.3, -0.7).normalize();
        pattern.texels_mut()[mapping.texel_at(direction) as usize] = [100.0; 3];
        let turned = pattern.turned(kind, FRAC_PI_2);
        let brightest = (0..1024).max_by(|&a, &b| turned.texels()[a][0].total_cmp(&turned.texels()[b][0])).unwrap();
        assert_eq!(brightest as u32, mapping.texel_at(turn_about_vertical(direction, FRAC_PI_2)));
        assert!((sum(&turned) / 100.0 - 1.0).abs() < 0.3, "a quarter turn maps texels onto texels");
    }

    #[test]
    fn an_image_keeps_its_mean_on_a_light_and_on_the_sphere() {
        let pixels: Vec<[f32; 3]> = (0..64 * 32).map(|i| [((i * 7919) % 101) as f32, 1.0, 0.0]).collect();
        let image = LinearImage { width: 64, height: 32, pixels };
        let mean = sum(&Pattern::of_image(LightKind::AreaTexels { across: 8, down: 4 }, &image)) / 32.0;
        let of_image = image.pixels.iter().map(|p| p[0]).sum::<f32>() / 2048.0;
        assert!((mean / of_image - 1.0).abs() < 1e-5);
        let sphere = Pattern::of_image(LightKind::Octahedral { side: 64 }, &image);
        assert!(sphere.texels().iter().all(|t| (t[1] - 1.0).abs() < 1e-6));
        let broken = LinearImage { width: 1, height: 1, pixels: vec![[f32::NAN, -1.0, 2.0]] };
        let pattern = Pattern::of_image(LightKind::LatLong { across: 4, down: 2 }, &broken);
        assert_eq!(pattern.texels()[5], [0.0, 0.0, 2.0]);
    }
}
