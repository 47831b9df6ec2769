//! Normals of smoothing groups: OBJ files that have no normals may say which faces are round (`s`, Wavefront's *Object Files*,
//! "Grouping").

use std::collections::HashMap;

use glam::{DVec3, Vec3};

/// Bytes for each corner of a smoothed face.
pub(super) const SMOOTHING_BYTES: usize = 120;
/// Cosine of 75°. Edges that turn by more stay: exporters write one group over boxes as well. Decision 64.
const CREASE: f64 = 0.258_819;

/// The faces at each vertex of each group.
#[derive(Default)]
pub(super) struct GroupNormals {
    /// Unit normals, and the angles of their faces there.
    faces: HashMap<(u32, u32), Vec<(DVec3, f64)>>,
}

impl GroupNormals {
    /// Adds a face of a group by its vertices and their positions.
    pub(super) fn add(&mut self, group: u32, corners: &[(u32, DVec3)]) {
        let at = |i: usize| corners[i % corners.len()].1;
        let normal = normal_of(corners);
        for (i, &(vertex, here)) in corners.iter().enumerate() {
            let [before, after] = [at(i + corners.len() - 1) - here, at(i + 1) - here];
            let angle = if before == DVec3::ZERO || after == DVec3::ZERO { 0.0 } else { before.angle_between(after) };
            self.faces.entry((vertex, group)).or_default().push((normal, angle));
        }
    }

    /// The normal of a face of a group at one of its vertices: the mean of the faces there that turn less than the crease against it,
    /// weighed by their angles (Thürmer and Wüthrich 1998, *Computing vertex normals from polygonal facets*). Zero where faces cancel
    /// each other.
    pub(super) fn at(&self, group: u32, vertex: u32, face: DVec3) -> Vec3 {
        let faces = self.faces.get(&(vertex, group)).map_or(&[][..], Vec::as_slice);
        let near = faces.iter().filter(|(normal, _)| normal.dot(face) > CREASE);
        near.map(|(normal, angle)| *normal * *angle).sum::<DVec3>().normalize_or_zero().as_vec3()
    }
}

/// Unit normal of a polygon; zero if it has none.
pub(super) fn normal_of(corners: &[(u32, DVec3)]) -> DVec3 {
    let at = |i: usize| corners[i].1 - corners[0].1;
    (1..corners.len() - 1).map(|i| at(i).cross(at(i + 1))).sum::<DVec3>().normalize_or_zero()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: i32, y: i32, z: i32) -> DVec3 {
        DVec3::new(f64::from(x), f64::from(y), f64::from(z))
    }

    #[test]
    fn the_top_of_a_pyramid_leans_to_no_side_however_its_faces_are_cut() {
        let top = (0, at(0, 0, 1));
        let [a, b, c, d] = [(1, at(2, 0, 0)), (2, at(0, 2, 0)), (3, at(-2, 0, 0)), (4, at(0, -2, 0))];
        let middle = (5, at(1, 1, 0));
        let mut normals = GroupNormals::default();
        for face in [[top, a, middle], [top, middle, b], [top, b, c], [top, c, d], [top, d, a]] {
            normals.add(1, &face);
        }
        let found = normals.at(1, 0, normal_of(&[top, b, c]));
        assert!((found - Vec3::Z).length() < 1e-6, "{found}");
        // Another group has none of it.
        assert_eq!(normals.at(2, 0, DVec3::Z), Vec3::ZERO);
    }

    #[test]
    fn the_edges_of_a_box_stay() {
        let corner = (0, at(0, 0, 0));
        let (x, y, z) = ((1, at(1, 0, 0)), (2, at(0, 1, 0)), (3, at(0, 0, 1)));
        let mut normals = GroupNormals::default();
        let faces = [[corner, y, x], [corner, x, z], [corner, z, y]];
        faces.iter().for_each(|face| normals.add(1, face));
        for (face, right) in faces.iter().zip([Vec3::NEG_Z, Vec3::NEG_Y, Vec3::NEG_X]) {
            assert_eq!(normals.at(1, 0, normal_of(face)), right);
        }
    }
}
