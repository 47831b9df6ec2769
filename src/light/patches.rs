//! The sky in patches: Tregenza's 145, and Reinhart's finer divisions of them, numbered as Radiance numbers them.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{Vec2, Vec3};

/// Patches of each of Tregenza's rows, from the horizon up (Tregenza 1987, *Subdivision of the sky hemisphere for luminance measurements*,
/// table 1); above them lies one at the zenith.
const ROWS: [u32; 7] = [30, 30, 24, 24, 18, 12, 6];

/// Patches of Tregenza's rows together.
const IN_ROWS: u32 = 144;

/// A division of all directions: the lower hemisphere, then rows of patches from the horizon to one at the zenith.
///
/// Of a subdivision `MF` each of Tregenza's rows has `MF` rows of `MF` times as many patches (Reinhart's MF:1 to MF:6; Bourgeois, Reinhart and
/// Ward 2008, *Standard daylight coefficient model for dynamic daylighting simulations*, §2), so that there are `144 · MF² + 2`. Directions
/// are unit vectors with +y at the zenith, −z at north and +x at east. The patches of a row are numbered from that around north towards east.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SkyPatches {
    subdivision: u32,
}

impl SkyPatches {
    /// Largest subdivision; it has 36,866 patches.
    pub const MAX_SUBDIVISION: u32 = 16;

    /// The division with this `MF`; 1 is Tregenza's. `None` for 0 and above [`MAX_SUBDIVISION`](Self::MAX_SUBDIVISION).
    pub fn of_subdivision(subdivision: u32) -> Option<Self> {
        (1..=Self::MAX_SUBDIVISION).contains(&subdivision).then_some(Self { subdivision })
    }

    /// The division with this number of patches, that of the lower hemisphere among them.
    pub fn of_count(count: u32) -> Option<Self> {
        (1..=Self::MAX_SUBDIVISION).map(|subdivision| Self { subdivision }).find(|patches| patches.count() == count)
    }

    /// `MF`.
    pub fn subdivision(self) -> u32 {
        self.subdivision
    }

    /// Number of patches, that of the lower hemisphere among them.
    pub fn count(self) -> u32 {
        IN_ROWS * self.subdivision * self.subdivision + 2
    }

    /// Number of rows below the patch at the zenith.
    fn rows(self) -> u32 {
        ROWS.len() as u32 * self.subdivision
    }

    /// Angle between two rows in radians; the patch at the zenith has it as its diameter.
    fn row_height(self) -> f32 {
        FRAC_PI_2 / (self.rows() as f32 + 0.5)
    }

    /// Patches of a row.
    fn in_row(self, row: u32) -> u32 {
        ROWS[(row / self.subdivision) as usize] * self.subdivision
    }

    /// Number of the first patch of a row.
    fn first_of(self, row: u32) -> u32 {
        1 + (0..row).map(|row| self.in_row(row)).sum::<u32>()
    }

    /// Row of a patch and its place in it; `None` for the lower hemisphere and the zenith.
    fn place(self, patch: u32) -> Option<(u32, u32)> {
        if patch == 0 || patch + 1 >= self.count() {
            return None;
        }
        let mut before = patch - 1;
        (0..self.rows()).find_map(|row| match before.checked_sub(self.in_row(row)) {
            Some(rest) => {
                before = rest;
                None
            }
            None => Some((row, before)),
        })
    }

    /// The patch that a unit direction falls into.
    pub fn patch_at(self, direction: Vec3) -> u32 {
        // NaN counts as below the horizon.
        if direction.y.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
            return 0;
        }
        let row = (direction.y.min(1.0).asin() / self.row_height()) as u32;
        if row >= self.rows() {
            return self.count() - 1;
        }
        let turn = direction.x.atan2(-direction.z).rem_euclid(TAU) / TAU * self.in_row(row) as f32;
        self.first_of(row) + (turn + 0.5) as u32 % self.in_row(row)
    }

    /// The unit direction at `offset ∈ [0, 1)²` of a patch, uniform over its solid angle.
    pub fn direction_at(self, patch: u32, offset: Vec2) -> Vec3 {
        let (turn, height) = match self.place(patch) {
            Some((row, at)) => {
                let (low, high) = self.heights(row);
                let turn = (at as f32 + offset.x - 0.5) / self.in_row(row) as f32;
                (turn, low + offset.y * (high - low))
            }
            None if patch == 0 => (offset.x, -offset.y),
            None => (offset.x, 1.0 - offset.y * (1.0 - (0.5 * self.row_height()).cos())),
        };
        towards(turn * TAU, height)
    }

    /// Sines of a row's lower and upper edge.
    fn heights(self, row: u32) -> (f32, f32) {
        ((row as f32 * self.row_height()).sin(), ((row + 1) as f32 * self.row_height()).sin())
    }

    /// Solid angle of a patch in steradians.
    pub fn solid_angle(self, patch: u32) -> f32 {
        match self.place(patch) {
            Some((row, _)) => {
                let (low, high) = self.heights(row);
                TAU * (high - low) / self.in_row(row) as f32
            }
            None if patch == 0 => TAU,
            // 2π (1 − cos r) with its digits.
            None => 4.0 * PI * (0.25 * self.row_height()).sin().powi(2),
        }
    }

    /// Altitude and azimuth of a patch's middle in radians, the azimuth from north towards east. That of the lower hemisphere is
    /// the nadir.
    pub fn middle(self, patch: u32) -> (f32, f32) {
        match self.place(patch) {
            Some((row, at)) => ((row as f32 + 0.5) * self.row_height(), TAU * at as f32 / self.in_row(row) as f32),
            None if patch == 0 => (-FRAC_PI_2, 0.0),
            None => (FRAC_PI_2, 0.0),
        }
    }

    /// The unit direction of a patch's middle.
    pub fn middle_direction(self, patch: u32) -> Vec3 {
        match self.place(patch) {
            Some(_) => {
                let (altitude, azimuth) = self.middle(patch);
                towards(azimuth, altitude.sin())
            }
            None if patch == 0 => Vec3::NEG_Y,
            None => Vec3::Y,
        }
    }
}

/// The unit direction at an azimuth with this sine of the altitude.
fn towards(azimuth: f32, height: f32) -> Vec3 {
    let ring = ((1.0 - height) * (1.0 + height)).max(0.0).sqrt();
    let (sin, cos) = azimuth.sin_cos();
    Vec3::new(ring * sin, height, -ring * cos)
}

#[cfg(test)]
#[expect(clippy::excessive_precision, reason = "reference values stand as Radiance prints them")]
mod tests {
    use super::*;

    fn of(subdivision: u32) -> SkyPatches {
        SkyPatches::of_subdivision(subdivision).unwrap()
    }

    /// The rows of `gendaymtx -m N` of Radiance 6.0a: 146, 578, 1298, 2306, 3602, 5186.
    #[test]
    fn the_patches_are_as_many_as_radiance_has() {
        for (subdivision, count) in [(1, 146), (2, 578), (3, 1298), (4, 2306), (5, 3602), (6, 5186)] {
            assert_eq!(of(subdivision).count(), count);
            assert_eq!(SkyPatches::of_count(count), Some(of(subdivision)));
        }
        assert_eq!((SkyPatches::of_subdivision(0), SkyPatches::of_count(145)), (None, None));
    }

    #[test]
    fn the_solid_angles_fill_the_sphere() {
        for subdivision in 1..=6 {
            let patches = of(subdivision);
            let sky: f64 = (1..patches.count()).map(|patch| f64::from(patches.solid_angle(patch))).sum();
            assert!((sky / std::f64::consts::TAU - 1.0).abs() < 1e-6, "{subdivision}: {sky}");
        }
    }

    /// `cnt 145 | rcalc -e MF:1 -f rskysrc.cal -e 'Rbin=recno;$1=Rbin;$2=Dx;$3=Dy;$4=Dz;$5=Romega'` of Radiance 6.0a, and `cnt 2305` with `MF:4`:
    /// patch, middle (z up) and solid angle.
    const RADIANCE: [(u32, u32, [f32; 3], f32); 14] = [
        (1, 1, [0.0, 0.994521895, 0.104528463], 0.0435449227),
        (1, 31, [0.0, 0.951056516, 0.309016994], 0.0416418006),
        (1, 75, [-0.433012702, -0.75, 0.5], 0.0473984151),
        (1, 140, [0.180056806, 0.103955845, 0.978147601], 0.0455168385),
        (1, 144, [-0.180056806, 0.103955845, 0.978147601], 0.0455168385),
        (4, 1, [0.0, 0.999620307, 0.0275543424], 0.00288438839),
        (4, 31, [0.999620307, 0.0, 0.0275543424], 0.00288438839),
        (4, 75, [-0.668876542, -0.742862659, 0.0275543424], 0.00288438839),
        (4, 121, [0.0, 0.996584493, 0.0825793455], 0.00287562859),
        (4, 140, [0.835806083, 0.542778817, 0.0825793455], 0.00287562859),
        (4, 144, [0.930391776, 0.357143941, 0.0825793455], 0.00287562859),
        (4, 145, [0.947808176, 0.307961545, 0.0825793455], 0.00287562859),
        (4, 1700, [-0.621898279, -0.211106019, 0.75410661], 0.00236880931),
        (4, 2304, [-0.0142577615, 0.0532106904, 0.998481516], 0.000794774251),
    ];

    /// Solid angles of the zenith by the same commands.
    const ZENITH: [(u32, f32); 2] = [(1, 0.0344199465), (4, 0.00238568132)];

    #[test]
    fn middles_and_solid_angles_are_those_of_radiance() {
        for (subdivision, patch, [x, y, z], solid_angle) in RADIANCE {
            let patches = of(subdivision);
            let (middle, wanted) = (patches.middle_direction(patch), Vec3::new(x, z, -y));
            assert!((middle - wanted).length() < 1e-4, "{subdivision}, {patch}: {middle} for {wanted}");
            assert!((patches.solid_angle(patch) / solid_angle - 1.0).abs() < 1e-4, "{subdivision}, {patch}");
            assert_eq!(patches.patch_at(middle), patch);
        }
        for (subdivision, solid_angle) in ZENITH {
            let zenith = of(subdivision).count() - 1;
            assert!((of(subdivision).solid_angle(zenith) / solid_angle - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn directions_of_a_patch_fall_into_it() {
        for subdivision in [1, 2, 3, 6] {
            let patches = of(subdivision);
            for patch in 0..patches.count() {
                for offset in [Vec2::new(0.01, 0.02), Vec2::new(0.5, 0.5), Vec2::new(0.98, 0.97)] {
                    let direction = patches.direction_at(patch, offset);
                    assert!((direction.length() - 1.0).abs() < 1e-6);
                    assert_eq!(patches.patch_at(direction), patch, "{subdivision}: {offset}");
                }
            }
        }
        assert_eq!(of(1).patch_at(Vec3::NAN), 0);
        assert_eq!(of(1).patch_at(Vec3::Y), 145);
    }
}
