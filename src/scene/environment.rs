//! Directions and texels of an environment: the two mappings of [`EnvironmentMapping`] and their inverses.
//!
//! Directions are unit vectors in the environment's own axes, +y at the zenith. Inside a texel, positions are laid
//! uniformly over its solid angle, so a uniform `offset` gives directions of constant density `1 / solid_angle`.

use std::f32::consts::{FRAC_PI_4, PI, TAU};

use glam::{Vec2, Vec3};

use super::EnvironmentMapping;
use crate::image::LinearImage;

impl EnvironmentMapping {
    /// Number of texels, which are the columns of the light.
    pub fn texel_count(self) -> u32 {
        let (across, down) = self.layout();
        across * down
    }

    /// Texels (across, down), row by row.
    pub fn layout(self) -> (u32, u32) {
        match self {
            Self::LatLong { across, down } => (across, down),
            Self::Octahedral { side } => (side, side),
        }
    }

    /// The texel that a unit direction falls into.
    pub fn texel_at(self, direction: Vec3) -> u32 {
        let (across, down) = self.layout();
        let at = self.image_position(direction) * Vec2::new(across as f32, down as f32);
        // Float to integer conversion saturates, so a coordinate of exactly 1 (or NaN) still gives a texel.
        (at.y as u32).min(down - 1) * across + (at.x as u32).min(across - 1)
    }

    /// The unit direction at `offset ∈ [0, 1)²` of a texel; offset (0, 0) is the texel's first corner in row order.
    pub fn direction_at(self, texel: u32, offset: Vec2) -> Vec3 {
        let across = self.layout().0;
        let (column, row) = ((texel % across) as f32, (texel / across) as f32);
        match self {
            Self::LatLong { across, down } => {
                // Uniform in the cosine of the polar angle between the row's edges: uniform in solid angle.
                let (upper, lower) = (row * PI / down as f32, (row + 1.0) * PI / down as f32);
                // A difference of cosines as a product of sines, exact for thin rows near the poles.
                let span = 2.0 * (0.5 * (upper + lower)).sin() * (0.5 * (lower - upper)).sin();
                let y = (upper.cos() - offset.y * span).clamp(-1.0, 1.0);
                let ring = ((1.0 - y) * (1.0 + y)).sqrt();
                let (sin, cos) = ((column + offset.x) * TAU / across as f32).sin_cos();
                Vec3::new(ring * sin, y, -ring * cos)
            }
            Self::Octahedral { side } => from_square(Vec2::new(column + offset.x, row + offset.y) / side as f32),
        }
    }

    /// Solid angle of a texel in steradians.
    pub fn solid_angle(self, texel: u32) -> f32 {
        match self {
            Self::LatLong { across, down } => {
                let half_row = 0.5 * std::f64::consts::PI / f64::from(down);
                let middle = f64::from(2 * (texel / across) + 1) * half_row;
                let turn = std::f64::consts::TAU / f64::from(across);
                (turn * 2.0 * middle.sin() * half_row.sin()) as f32
            }
            Self::Octahedral { side } => 4.0 * PI / (side as f32 * side as f32),
        }
    }

    /// Averages of a lat-long image over the solid angle of every texel: the weights with which the columns show it.
    ///
    /// The image lies as a [`LatLong`](Self::LatLong) mapping does: zenith at its top, −z at its left edge.
    pub fn texel_averages(self, image: &LinearImage) -> Vec<[f32; 3]> {
        let (width, height) = (image.width as usize, image.height as usize);
        let pixels = Self::LatLong { across: image.width, down: image.height };
        let texels = self.texel_count() as usize;
        // Enough points that every texel gets about sixteen, so that coarse images reach all texels.
        let cuts = ((16 * texels) as f32 / (width * height).max(1) as f32).sqrt().ceil().max(1.0) as usize;
        let mut sums = vec![[0.0f64; 4]; texels];
        for row in 0..height {
            let weight = f64::from(pixels.solid_angle((row * width) as u32));
            for column in 0..width {
                let pixel = row * width + column;
                for cut in 0..cuts * cuts {
                    let offset = Vec2::new((cut % cuts) as f32 + 0.5, (cut / cuts) as f32 + 0.5) / cuts as f32;
                    let sum = &mut sums[self.texel_at(pixels.direction_at(pixel as u32, offset)) as usize];
                    for (channel, value) in image.pixels[pixel].iter().enumerate() {
                        sum[channel] += weight * f64::from(*value);
                    }
                    sum[3] += weight;
                }
            }
        }
        let nearest = |texel: usize| {
            let at = pixels.texel_at(self.direction_at(texel as u32, Vec2::splat(0.5)));
            image.pixels.get(at as usize).copied().unwrap_or_default()
        };
        let average = |(texel, [r, g, b, weight]): (usize, [f64; 4])| match weight > 0.0 {
            true => [r, g, b].map(|v| (v / weight) as f32),
            false => nearest(texel),
        };
        sums.into_iter().enumerate().map(average).collect()
    }

    /// Position of a unit direction in the environment's image, `[0, 1]²` from its top left.
    ///
    /// A lat-long image has the zenith at its top, −z at its left edge, +x at a quarter of its width.
    pub fn image_position(self, direction: Vec3) -> Vec2 {
        match self {
            Self::LatLong { .. } => {
                let turn = direction.x.atan2(-direction.z);
                let turn = if turn < 0.0 { turn + TAU } else { turn };
                let polar = direction.x.hypot(direction.z).atan2(direction.y);
                Vec2::new(turn / TAU, polar / PI)
            }
            Self::Octahedral { .. } => to_square(direction),
        }
    }
}

/// Equal-area octahedral map of a unit direction to `[0, 1]²`: the zenith in the centre, the nadir in the corners, +x
/// to the right, −z to the top (Clarberg, *Fast equal-area mapping of the (hemi)sphere using SIMD*, 2008).
fn to_square(direction: Vec3) -> Vec2 {
    let height = direction.y.abs();
    // √(1 − |y|), written so that it keeps its digits near the poles.
    let radius = ((direction.x * direction.x + direction.z * direction.z) / (1.0 + height)).sqrt().min(1.0);
    let minor = radius * direction.z.abs().atan2(direction.x.abs()) / (2.0 * FRAC_PI_4);
    let major = radius - minor;
    let (u, v) = if direction.y < 0.0 { (1.0 - minor, 1.0 - major) } else { (major, minor) };
    Vec2::new(0.5 + 0.5 * u.copysign(direction.x), 0.5 + 0.5 * v.copysign(direction.z))
}

/// Inverse of [`to_square`].
fn from_square(position: Vec2) -> Vec3 {
    let (u, v) = (2.0 * position.x - 1.0, 2.0 * position.y - 1.0);
    let above = 1.0 - (u.abs() + v.abs());
    let radius = 1.0 - above.abs();
    let turn = if radius == 0.0 { 0.0 } else { ((v.abs() - u.abs()) / radius + 1.0) * FRAC_PI_4 };
    let ring = radius * (2.0 - radius * radius).max(0.0).sqrt();
    let (sin, cos) = turn.sin_cos();
    Vec3::new((ring * cos).copysign(u), (1.0 - radius * radius).copysign(above), (ring * sin).copysign(v))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAPPINGS: [EnvironmentMapping; 4] = [
        EnvironmentMapping::LatLong { across: 32, down: 16 },
        EnvironmentMapping::LatLong { across: 5, down: 3 },
        EnvironmentMapping::Octahedral { side: 16 },
        EnvironmentMapping::Octahedral { side: 7 },
    ];

    #[test]
    fn directions_of_a_texel_fall_into_it() {
        for mapping in MAPPINGS {
            for texel in 0..mapping.texel_count() {
                for offset in [[0.01, 0.01], [0.5, 0.5], [0.99, 0.02], [0.3, 0.98]] {
                    let direction = mapping.direction_at(texel, offset.into());
                    assert!((direction.length() - 1.0).abs() < 1e-5, "{mapping:?} {texel} {offset:?}: {direction}");
                    assert_eq!(mapping.texel_at(direction), texel, "{mapping:?} {offset:?}");
                }
            }
        }
    }

    #[test]
    fn solid_angles_cover_the_sphere() {
        for mapping in MAPPINGS {
            let sum: f64 = (0..mapping.texel_count()).map(|t| f64::from(mapping.solid_angle(t))).sum();
            assert!((sum - 4.0 * std::f64::consts::PI).abs() < 1e-5, "{mapping:?}: {sum}");
        }
    }

    #[test]
    fn solid_angles_are_what_uniform_directions_find() {
        // 200,000 directions over 35 or 49 texels: about 4,000 a texel, so 5 σ is 8 % of a texel of average size and
        // 12 % of one half as large.
        let directions = (0..200_000u32).map(|i| {
            let (a, b) = (f64::from(i) + 0.5, f64::from(i) * 0.618_033_988_749_894_9);
            let y = 1.0 - 2.0 * a / 200_000.0;
            let (sin, cos) = (b.fract() * std::f64::consts::TAU).sin_cos();
            let ring = (1.0 - y * y).sqrt();
            Vec3::new((ring * cos) as f32, y as f32, (ring * sin) as f32)
        });
        let directions: Vec<_> = directions.collect();
        for mapping in [EnvironmentMapping::LatLong { across: 7, down: 5 }, EnvironmentMapping::Octahedral { side: 7 }]
        {
            let mut counts = vec![0u32; mapping.texel_count() as usize];
            directions.iter().for_each(|d| counts[mapping.texel_at(*d) as usize] += 1);
            for (texel, count) in counts.iter().enumerate() {
                let found = 4.0 * PI * *count as f32 / directions.len() as f32;
                let stated = mapping.solid_angle(texel as u32);
                assert!((found / stated - 1.0).abs() < 0.12, "{mapping:?} {texel}: {found} for {stated}");
            }
        }
    }

    #[test]
    fn the_axes_lie_where_the_documentation_says() {
        let lat_long = EnvironmentMapping::LatLong { across: 4, down: 2 };
        let near = |mapping: EnvironmentMapping, direction: Vec3, x: f32, y: f32| {
            let at = mapping.image_position(direction.normalize());
            assert!((at - Vec2::new(x, y)).length() < 2e-3, "{mapping:?} {direction}: {at}");
        };
        near(lat_long, Vec3::new(0.001, 0.0, -1.0), 0.0, 0.5);
        near(lat_long, Vec3::X, 0.25, 0.5);
        near(lat_long, Vec3::Z, 0.5, 0.5);
        near(lat_long, Vec3::new(0.3, 0.3, 0.3), 0.375, 0.304);
        let octahedral = EnvironmentMapping::Octahedral { side: 4 };
        near(octahedral, Vec3::Y, 0.5, 0.5);
        near(octahedral, Vec3::X, 1.0, 0.5);
        near(octahedral, Vec3::NEG_Z, 0.5, 0.0);
        near(octahedral, Vec3::new(1e-4, -1.0, 1e-4), 1.0, 1.0);
    }

    #[test]
    fn averages_keep_an_images_flux_and_place() {
        let mut image = LinearImage::black(64, 32);
        for (i, pixel) in image.pixels.iter_mut().enumerate() {
            *pixel = [1.0 + (i % 64) as f32, (i / 64) as f32, 0.25];
        }
        let from = EnvironmentMapping::LatLong { across: 64, down: 32 };
        let flux = |mapping: EnvironmentMapping, weights: &[[f32; 3]], c: usize| -> f64 {
            let texels = weights.iter().enumerate();
            texels.map(|(t, w)| f64::from(w[c]) * f64::from(mapping.solid_angle(t as u32))).sum()
        };
        for mapping in MAPPINGS {
            let weights = mapping.texel_averages(&image);
            assert!(weights.iter().all(|w| (w[2] - 0.25).abs() < 1e-6));
            // Whole pixels fall to one texel or another: a few per cent where the two grids do not meet.
            for channel in 0..3 {
                let (found, stated) = (flux(mapping, &weights, channel), flux(from, &image.pixels, channel));
                assert!((found / stated - 1.0).abs() < 0.03, "{mapping:?}: {found} for {stated}");
            }
        }
        let exact = EnvironmentMapping::LatLong { across: 32, down: 16 }.texel_averages(&image);
        assert!((exact[5][0] - 11.5).abs() < 1e-4, "{:?}", exact[5]);
        assert_eq!(from.texel_averages(&image).len(), 64 * 32);
    }

    #[test]
    fn no_direction_gives_a_texel_out_of_range() {
        for mapping in MAPPINGS {
            for direction in [Vec3::Y, Vec3::NEG_Y, Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z, Vec3::NAN, Vec3::ZERO] {
                assert!(mapping.texel_at(direction) < mapping.texel_count());
            }
        }
    }
}
