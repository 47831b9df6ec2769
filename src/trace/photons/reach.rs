//! Where photons are worth to be gathered.
//!
//! Mirrors and glass throw some light nearly everywhere, and most of that comes from lamps that paths hit well: there
//! photons have little weight, and looking for them takes more time than their light is worth. So photons are gathered in cells
//! only in which one of them has some weight, or comes from a lamp that no path hits. Elsewhere the radius is 0, and paths
//! have the weight 1: as the cells are the same for all paths, nothing is lost and nothing counts twice.

use glam::{UVec3, Vec3};

use super::radius::RadiusField;
use crate::scene::bounds;

/// Cells along the longest side.
const CELLS: f32 = 64.0;

/// Weight of a photon on a Lambertian surface from which on it is gathered. Decision 62.
pub(super) const MIN_WEIGHT: f32 = 0.05;

/// The cells, one bit each.
#[derive(Debug)]
pub(super) struct Reach {
    low: Vec3,
    per_unit: f32,
    sides: UVec3,
    bits: Vec<u64>,
}

impl Reach {
    /// Bytes of the cells at most, while they are found.
    pub(super) const MOST_BYTES: u64 = (CELLS as u64 + 1).pow(3) * 5;

    /// The cells around the places of photons of some weight, dilated by the radius there.
    pub(super) fn around(places: &[Vec3], radius: &RadiusField) -> Self {
        if places.is_empty() {
            return Self { low: Vec3::ZERO, per_unit: 0.0, sides: UVec3::ZERO, bits: Vec::new() };
        }
        let (low, high) = bounds(places.iter().copied());
        let longest = (high - low).max_element().max(f32::MIN_POSITIVE);
        // One more on each side, for what lies within the radius of the outermost.
        let largest = radius.largest();
        let margin = largest + longest / CELLS;
        let (low, high) = (low - margin, high + margin);
        let per_unit = CELLS / (high - low).max_element();
        let sides = ((high - low) * per_unit).as_uvec3() + 1;
        let words = (sides.x as usize * sides.y as usize * sides.z as usize).div_ceil(64);
        let mut own = Self { low, per_unit, sides, bits: vec![0; words] };
        let mut occupied: Vec<UVec3> = places.iter().filter_map(|&place| own.cell(place)).collect();
        occupied.sort_unstable_by_key(|cell| own.index(*cell));
        occupied.dedup();
        // The radius at the middle of each cell, looked up once.
        let mut radii = vec![f32::NAN; 64 * words];
        let reach = (largest * per_unit).ceil() as u32 + 1;
        for &cell in &occupied {
            let (first, last) = (cell.saturating_sub(UVec3::splat(reach)), (cell + reach).min(sides - 1));
            for z in first.z..=last.z {
                for y in first.y..=last.y {
                    for x in first.x..=last.x {
                        let other = UVec3::new(x, y, z);
                        let index = own.index(other);
                        if radii[index].is_nan() {
                            radii[index] = radius.at(own.middle(other)) * per_unit;
                        }
                        let apart = (other.as_ivec3() - cell.as_ivec3()).abs().as_vec3() - 1.0;
                        if apart.max(Vec3::ZERO).length() <= radii[index] {
                            own.bits[index / 64] |= 1 << (index % 64);
                        }
                    }
                }
            }
        }
        own
    }

    /// Whether photons are gathered there.
    #[inline(always)]
    pub(super) fn holds(&self, position: Vec3) -> bool {
        self.cell(position).is_some_and(|cell| {
            let index = self.index(cell);
            self.bits[index / 64] >> (index % 64) & 1 == 1
        })
    }

    #[inline(always)]
    fn cell(&self, position: Vec3) -> Option<UVec3> {
        let at = (position - self.low) * self.per_unit;
        // Casts saturate; NaN becomes 0.
        let cell = at.max(Vec3::ZERO).as_uvec3();
        (at.cmpge(Vec3::ZERO).all() && cell.cmplt(self.sides).all()).then_some(cell)
    }

    #[inline(always)]
    fn index(&self, cell: UVec3) -> usize {
        (cell.z as usize * self.sides.y as usize + cell.y as usize) * self.sides.x as usize + cell.x as usize
    }

    fn middle(&self, cell: UVec3) -> Vec3 {
        self.low + (cell.as_vec3() + 0.5) / self.per_unit
    }
}
