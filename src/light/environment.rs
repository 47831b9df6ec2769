//! Directions and texels of an environment: the two mappings of [`EnvironmentMapping`] and their inverses.
//!
//! Directions are unit vectors in the environment's own axes, +y at the zenith. Inside a texel, positions are laid
//! uniformly over its solid angle, so a uniform `offset` gives directions of constant density `1 / solid_angle`.

use std::f32::consts::{FRAC_PI_4, PI, TAU};

use glam::{Vec2, Vec3};

use super::{Light, LightKind, SkyPatches};

/// How an environment's columns lie on the sphere of directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EnvironmentMapping {
    /// Latitude–longitude, rows from zenith (+y) to nadir; column 0 begins at −z and turns towards +x.
    LatLong {
        /// Texels around.
        across: u32,
        /// Texels from zenith to nadir.
        down: u32,
    },
    /// Equal-area octahedral square.
    Octahedral {
        /// Texels along each side.
        side: u32,
    },
    /// Tregenza's or Reinhart's patches.
    Patches(SkyPatches),
}

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
            Self::Patches(patches) => (patches.count(), 1),
        }
    }

    /// The texel that a unit direction falls into.
    pub fn texel_at(self, direction: Vec3) -> u32 {
        if let Self::Patches(patches) = self {
            return patches.patch_at(direction);
        }
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
            Self::Patches(patches) => patches.direction_at(texel, offset),
        }
    }

    /// The unit direction of a texel's middle.
    pub fn middle(self, texel: u32) -> Vec3 {
        match self {
            Self::LatLong { .. } | Self::Octahedral { .. } => self.direction_at(texel, Vec2::splat(0.5)),
            Self::Patches(patches) => patches.middle_direction(texel),
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
            Self::Patches(patches) => patches.solid_angle(texel),
        }
    }

    /// The weights with which the columns show a lat-long map of `size` (width, height): the mean over each texel, scaled so
    /// that the whole energy `∫ L dω` of every channel is the map's own. Negative and non-finite values count as 0.
    ///
    /// The map lies as a [`LatLong`](Self::LatLong) mapping does, the zenith at its top and −z at its left edge, turned by
    /// `turn_radians` about the vertical, from −z towards +x.
    ///
    /// # Panics
    /// If there is not one pixel for each place of `size`, row by row.
    pub fn resample(self, size: (u32, u32), pixels: &[[f32; 3]], turn_radians: f32) -> Vec<[f32; 3]> {
        let (width, height) = (size.0 as usize, size.1 as usize);
        assert_eq!(pixels.len(), width * height, "one pixel for each place");
        let texels = self.texel_count() as usize;
        if pixels.is_empty() {
            return vec![[0.0; 3]; texels];
        }
        let grid = Self::LatLong { across: size.0, down: size.1 };
        let cuts = ((POINTS_A_TEXEL * texels) as f32 / pixels.len() as f32).sqrt().ceil().max(1.0) as usize;
        let inside = |cut: usize| (cut as f32 + 0.5) / cuts as f32;
        let around: Vec<(f32, f32)> = (0..width * cuts)
            .map(|i| (((i / cuts) as f32 + inside(i % cuts)) * TAU / size.0 as f32 + turn_radians).sin_cos())
            .collect();
        let (mut sums, mut total) = (vec![[0.0f64; 4]; texels], [0.0f64; 3]);
        for (row, pixels) in pixels.chunks_exact(width).enumerate() {
            let first = (row * width) as u32;
            let weight = f64::from(grid.solid_angle(first)) / (cuts * cuts) as f64;
            for y in (0..cuts).map(|cut| grid.direction_at(first, Vec2::new(0.0, inside(cut))).y) {
                let ring = ((1.0 - y) * (1.0 + y)).sqrt();
                for (i, (sin, cos)) in around.iter().enumerate() {
                    let sum = &mut sums[self.texel_at(Vec3::new(ring * sin, y, -ring * cos)) as usize];
                    for (channel, value) in radiance(pixels[i / cuts]).into_iter().enumerate() {
                        sum[channel] += weight * f64::from(value);
                        total[channel] += weight * f64::from(value);
                    }
                    sum[3] += weight;
                }
            }
        }
        let nearest = |texel: usize| {
            let direction = turn_about_vertical(self.middle(texel as u32), -turn_radians);
            radiance(pixels[grid.texel_at(direction) as usize]).map(f64::from)
        };
        let means: Vec<[f64; 3]> = (sums.iter().enumerate())
            .map(
                |(texel, &[r, g, b, weight])| if weight > 0.0 { [r, g, b].map(|v| v / weight) } else { nearest(texel) },
            )
            .collect();
        let mut kept = [0.0f64; 3];
        for (texel, mean) in means.iter().enumerate() {
            let solid_angle = f64::from(self.solid_angle(texel as u32));
            (0..3).for_each(|channel| kept[channel] += mean[channel] * solid_angle);
        }
        let scale = [0, 1, 2].map(|channel| if kept[channel] > 0.0 { total[channel] / kept[channel] } else { 0.0 });
        means.iter().map(|mean| [0, 1, 2].map(|channel: usize| (mean[channel] * scale[channel]) as f32)).collect()
    }

    /// Position of a unit direction in the environment's image, `[0, 1]²` from its top left.
    ///
    /// A lat-long image has the zenith at its top, −z at its left edge, +x at a quarter of its width. That of patches is a row of them.
    pub fn image_position(self, direction: Vec3) -> Vec2 {
        match self {
            Self::LatLong { .. } => {
                let turn = direction.x.atan2(-direction.z);
                let turn = if turn < 0.0 { turn + TAU } else { turn };
                let polar = direction.x.hypot(direction.z).atan2(direction.y);
                Vec2::new(turn / TAU, polar / PI)
            }
            Self::Octahedral { .. } => to_square(direction),
            Self::Patches(patches) => {
                Vec2::new((patches.patch_at(direction) as f32 + 0.5) / patches.count() as f32, 0.5)
            }
        }
    }
}

/// Sample points for each texel at least, so that coarse maps reach all texels.
const POINTS_A_TEXEL: usize = 16;

fn radiance(pixel: [f32; 3]) -> [f32; 3] {
    pixel.map(|value| if value.is_finite() { value.max(0.0) } else { 0.0 })
}

/// A direction turned about the vertical, from −z towards +x.
pub fn turn_about_vertical(direction: Vec3, radians: f32) -> Vec3 {
    let (sin, cos) = radians.sin_cos();
    Vec3::new(direction.x * cos - direction.z * sin, direction.y, direction.z * cos + direction.x * sin)
}

impl LightKind {
    /// How its columns lie on the sphere of directions; none for lights that are no environment.
    pub fn environment(self) -> Option<EnvironmentMapping> {
        match self {
            Self::LatLong { across, down } => Some(EnvironmentMapping::LatLong { across, down }),
            Self::Octahedral { side } => Some(EnvironmentMapping::Octahedral { side }),
            Self::Patches { subdivision, .. } => {
                SkyPatches::of_subdivision(subdivision).map(EnvironmentMapping::Patches)
            }
            Self::Lamp
            | Self::AreaTexels { .. }
            | Self::Point
            | Self::Spot
            | Self::Sun
            | Self::Suns { .. }
            | Self::Ies
            | Self::Image => None,
        }
    }
}

impl Light {
    /// As [`unplaced`](Self::unplaced); the texels of an environment stand in their directions.
    pub fn of_texels(name: impl Into<String>, kind: LightKind) -> Self {
        let mut light = Self::unplaced(name, kind);
        if let Some(sky) = kind.environment() {
            // A sky whose reflected light has columns of its own has each texel twice.
            let texels = || (0..light.places.len() as u32).map(|column| column % sky.texel_count());
            let (places, extents) =
                (texels().map(|texel| sky.middle(texel).to_array()), texels().map(|texel| sky.solid_angle(texel)));
            (light.places, light.extents) = (places.collect(), extents.collect());
        }
        light
    }
}

impl From<EnvironmentMapping> for LightKind {
    fn from(mapping: EnvironmentMapping) -> Self {
        match mapping {
            EnvironmentMapping::LatLong { across, down } => Self::LatLong { across, down },
            EnvironmentMapping::Octahedral { side } => Self::Octahedral { side },
            EnvironmentMapping::Patches(patches) => {
                Self::Patches { subdivision: patches.subdivision(), is_split: false }
            }
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
    fn a_resampled_map_keeps_its_energy_and_its_place() {
        let pixels: Vec<[f32; 3]> = (0..64 * 32).map(|i| [1.0 + (i % 64) as f32, (i / 64) as f32, 0.25]).collect();
        let grid = EnvironmentMapping::LatLong { across: 64, down: 32 };
        let energy = |mapping: EnvironmentMapping, weights: &[[f32; 3]], c: usize| -> f64 {
            let texels = weights.iter().enumerate();
            texels.map(|(t, w)| f64::from(w[c]) * f64::from(mapping.solid_angle(t as u32))).sum()
        };
        for mapping in MAPPINGS {
            for turn in [0.0, 0.3, -2.0, 7.0] {
                let weights = mapping.resample((64, 32), &pixels, turn);
                assert!(weights.iter().all(|w| (w[2] - 0.25).abs() < 1e-6));
                for channel in 0..3 {
                    let (found, stated) = (energy(mapping, &weights, channel), energy(grid, &pixels, channel));
                    // The weights are rounded to 32 bits.
                    assert!((found / stated - 1.0).abs() < 1e-6, "{mapping:?}: {found} for {stated}");
                }
            }
        }
        let exact = EnvironmentMapping::LatLong { across: 32, down: 16 }.resample((64, 32), &pixels, 0.0);
        assert!((exact[5][0] - 11.5).abs() < 1e-4, "{:?}", exact[5]);
    }

    #[test]
    fn a_turned_map_moves_its_sun_from_north_to_east() {
        let mut pixels = vec![[0.0; 3]; 64 * 32];
        // At −z, a little above the horizon.
        pixels[14 * 64] = [100.0; 3];
        for mapping in MAPPINGS {
            for turn in [0.0, 1.0, 3.0] {
                let weights = mapping.resample((64, 32), &pixels, turn);
                let brightest = (0..weights.len()).max_by(|&a, &b| weights[a][0].total_cmp(&weights[b][0])).unwrap();
                let (sin, cos) = (turn + 0.5 * TAU / 64.0).sin_cos();
                let direction = Vec3::new(sin, 0.15, -cos).normalize();
                assert_eq!(brightest as u32, mapping.texel_at(direction), "{mapping:?} by {turn}");
                assert!((turn_about_vertical(Vec3::NEG_Z, turn).x - turn.sin()).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn what_is_no_radiance_counts_as_none() {
        let weights = MAPPINGS[0].resample((1, 1), &[[f32::NAN, -1.0, 2.0]], 0.0);
        assert!(weights.iter().all(|w| w[0] == 0.0 && w[1] == 0.0 && (w[2] - 2.0).abs() < 1e-5));
        assert_eq!(MAPPINGS[0].resample((0, 0), &[], 0.0).len(), 512);
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
