//! Environments as six square images, the faces of a cube around the scene.

use glam::{Quat, Vec2, Vec3};

use crate::light::EnvironmentMapping;

/// Points of the cube for each texel of an environment, at least: some for every texel, the small ones at the poles too.
const POINTS_A_TEXEL: usize = 256;

/// For each face (+x, −x, +y, −y, +z, −z), as it is seen from inside: where its right side and its upper side point.
const FACES: [[Vec3; 3]; 6] = [
    [Vec3::X, Vec3::Z, Vec3::Y],
    [Vec3::NEG_X, Vec3::NEG_Z, Vec3::Y],
    [Vec3::Y, Vec3::NEG_X, Vec3::NEG_Z],
    [Vec3::NEG_Y, Vec3::NEG_X, Vec3::Z],
    [Vec3::Z, Vec3::NEG_X, Vec3::Y],
    [Vec3::NEG_Z, Vec3::X, Vec3::Y],
];

/// Radiance from all directions, and how it is turned.
#[derive(Clone, Debug)]
pub(super) struct CubeMap {
    /// Pixels along a side.
    pub(super) side: usize,
    /// The pixels of each face, row by row from the top.
    pub(super) faces: [Vec<[f32; 3]>; 6],
    /// Rotation from the cube's axes to the world's.
    pub(super) rotation: Quat,
}

impl CubeMap {
    /// The weights of an environment's columns, in the cube's axes, that represent the cube: the mean over each texel,
    /// scaled so that the total energy `∫ L dω` of every channel is the cube's own.
    pub(super) fn weights(&self, mapping: EnvironmentMapping) -> Vec<[f32; 3]> {
        let texels = mapping.texel_count() as usize;
        let pixels = self.faces.len() * self.side * self.side;
        let cuts = ((POINTS_A_TEXEL * texels) as f32 / pixels as f32).sqrt().ceil().max(1.0) as usize;
        let (mut sums, mut angles) = (vec![[0.0f64; 3]; texels], vec![0.0f64; texels]);
        let mut energy = [0.0f64; 3];
        self.each_point(cuts, |direction, angle, radiance| {
            let texel = mapping.texel_at(direction) as usize;
            angles[texel] += angle;
            for channel in 0..3 {
                let part = angle * f64::from(radiance[channel]);
                sums[texel][channel] += part;
                energy[channel] += part;
            }
        });
        let means: Vec<[f64; 3]> =
            sums.iter().zip(&angles).map(|(sum, angle)| sum.map(|v| v / angle.max(1e-30))).collect();
        let mut shown = [0.0f64; 3];
        for (texel, mean) in means.iter().enumerate() {
            let angle = f64::from(mapping.solid_angle(texel as u32));
            shown.iter_mut().zip(mean).for_each(|(sum, v)| *sum += angle * v);
        }
        let scale = [0, 1, 2].map(|channel| if shown[channel] > 0.0 { energy[channel] / shown[channel] } else { 1.0 });
        means.iter().map(|mean| [0, 1, 2].map(|channel| (mean[channel] * scale[channel]) as f32)).collect()
    }

    /// The mean radiance over all directions.
    pub(super) fn mean(&self) -> [f64; 3] {
        let (mut sum, mut whole) = ([0.0f64; 3], 0.0);
        self.each_point(1, |_, angle, radiance| {
            whole += angle;
            sum.iter_mut().zip(radiance).for_each(|(sum, v)| *sum += angle * f64::from(v));
        });
        sum.map(|sum| sum / whole)
    }

    /// The points that each pixel is cut into both ways: direction, solid angle, radiance.
    fn each_point(&self, cuts: usize, mut take: impl FnMut(Vec3, f64, [f32; 3])) {
        let points = self.side * cuts;
        for (pixels, [forward, right, up]) in self.faces.iter().zip(FACES) {
            for y in 0..points {
                for x in 0..points {
                    let at = (Vec2::new(x as f32, y as f32) + 0.5) * (2.0 / points as f32) - 1.0;
                    let place = forward + at.x * right - at.y * up;
                    let distance = place.length();
                    // A plane at distance 1, of which a point has a square of this side.
                    let angle = f64::from(2.0 / points as f32).powi(2) / f64::from(distance).powi(3);
                    take(place / distance, angle, pixels[y / cuts * self.side + x / cuts]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_are_seen_from_inside_a_right_handed_world() {
        for [forward, right, up] in FACES {
            assert_eq!(forward.cross(up), right);
        }
    }

    #[test]
    fn the_points_cover_the_sphere() {
        let cube = CubeMap { side: 64, faces: [(); 6].map(|()| vec![[1.0; 3]; 64 * 64]), rotation: Quat::IDENTITY };
        let mut whole = 0.0;
        cube.each_point(1, |_, angle, _| whole += angle);
        // The midpoint rule over 1/r³ errs by the square of a pixel's size.
        assert!((whole / (4.0 * std::f64::consts::PI) - 1.0).abs() < 1e-3, "{whole}");
        let weights = cube.weights(EnvironmentMapping::LatLong { across: 32, down: 16 });
        assert!(weights.iter().flatten().all(|w| (w - 1.0).abs() < 1e-3), "{weights:?}");
    }
}
