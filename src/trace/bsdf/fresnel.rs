//! How much light a boundary reflects.

use glam::Vec3;

/// Schlick's approximation from the reflectances at normal and at grazing incidence (Schlick 1994).
pub(super) fn schlick(normal: Vec3, grazing: f32, cosine: f32) -> Vec3 {
    let m = (1.0 - cosine.clamp(0.0, 1.0)).max(0.0);
    let m5 = (m * m) * (m * m) * m;
    normal + (Vec3::splat(grazing) - normal) * m5
}

/// Unpolarised reflectance of a smooth dielectric boundary, and the cosine of the refracted direction; `ior` is the far
/// side's index over the near one's. (1, 0) at total reflection.
pub(super) fn dielectric_reflectance(cosine: f32, ior: f32) -> (f32, f32) {
    let sin2_inside = (1.0 - cosine * cosine).max(0.0) / (ior * ior);
    if sin2_inside >= 1.0 {
        return (1.0, 0.0);
    }
    let cos_inside = (1.0 - sin2_inside).sqrt();
    let parallel = (ior * cosine - cos_inside) / (ior * cosine + cos_inside);
    let perpendicular = (cosine - ior * cos_inside) / (cosine + ior * cos_inside);
    (0.5 * (parallel * parallel + perpendicular * perpendicular), cos_inside)
}

/// Reflectance of a sheet, with all reflections between its faces: `R + T²R / (1 − R²) = 2R / (1 + R)`.
pub(super) fn thin_reflectance(cosine: f32, ior: f32) -> f32 {
    let (r, _) = dielectric_reflectance(cosine, ior);
    2.0 * r / (1.0 + r)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_reflectances() {
        // Normal incidence on glass: ((n − 1)/(n + 1))² = 0.04 for n = 1.5, the same from inside.
        assert!((dielectric_reflectance(1.0, 1.5).0 - 0.04).abs() < 1e-6);
        assert!((dielectric_reflectance(1.0, 1.0 / 1.5).0 - 0.04).abs() < 1e-6);
        // Grazing light is reflected; beyond the critical angle (41.8°) all of it, from inside.
        assert!((dielectric_reflectance(0.0, 1.5).0 - 1.0).abs() < 1e-6);
        assert_eq!(dielectric_reflectance(0.7, 1.0 / 1.5).0, 1.0);
        // No boundary reflects nothing.
        assert!(dielectric_reflectance(0.3, 1.0).0.abs() < 1e-10);
        assert!((thin_reflectance(1.0, 1.5) - 0.08 / 1.04).abs() < 1e-6);
    }
}
