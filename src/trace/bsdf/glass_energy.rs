//! Light that scatters between the facets of rough glass.
//!
//! As for reflection ([`energy`](super::energy)), the light that one facet does not send away returns by a lobe that is
//! proportional to `1 − E` on the sides of both directions. It goes to both sides: from the rarer side the share that one
//! facet transmits of what it sends away in the mean, from the denser side what reciprocity then wants,
//! `b₂ = b₁ L̄₁ / (L̄₂ n²)`, of which `L̄` are the mean losses of the two sides (Kulla and Conty 2017, *Revisiting physically based shading at
//! Imageworks*, "dielectrics").

use std::sync::OnceLock;

use glam::Vec3;

use super::fresnel::dielectric_reflectance;
use super::microfacet::Ggx;
use super::nodes::node_below;

/// Nodes over the cosine.
const COSINES: usize = 33;
/// Rows over the square root of α.
const ROWS: usize = 65;
/// Indices of refraction from 1 to 10, evenly over their logarithm.
const INDICES: usize = 128;
const MOST_INDEX: f32 = 10.0;
/// Points of the midpoint rule: rings and turns.
const POINTS: [u32; 2] = [24, 12];
const LEAST_COSINE: f32 = 1e-3;

/// What one roughness of a boundary loses. The first of each pair is the rarer side, the second the denser.
#[derive(Clone, Debug)]
pub(super) struct GlassRow {
    lost: [[f32; COSINES]; 2],
    mean_lost: [f32; 2],
    /// What one facet transmits from the rarer side, of what it sends away, in the mean.
    transmitted: f32,
}

static TABLES: [OnceLock<Vec<GlassRow>>; INDICES] = [const { OnceLock::new() }; INDICES];

impl GlassRow {
    /// The row nearest to an index of refraction, of either side over the other, and a roughness.
    pub(super) fn of(ior: f32, alpha: f32) -> &'static Self {
        let index = ior.max(1.0 / ior).min(MOST_INDEX).ln() / MOST_INDEX.ln() * (INDICES - 1) as f32;
        let index = (index.round() as usize).min(INDICES - 1);
        let table = TABLES[index].get_or_init(|| {
            let ior = MOST_INDEX.powf(index as f32 / (INDICES - 1) as f32);
            (0..ROWS).map(|row| Self::integrate(ior, (row as f32 / (ROWS - 1) as f32).powi(2).max(1e-4))).collect()
        });
        let row = alpha.clamp(0.0, 1.0).sqrt() * (ROWS - 1) as f32;
        &table[(row.round() as usize).min(ROWS - 1)]
    }

    /// Share of the light that one facet does not send away, for a viewer on a side.
    #[inline(always)]
    pub(super) fn lost(&self, inside: bool, cosine: f32) -> f32 {
        let (node, share) = node_below(cosine, COSINES);
        let at = &self.lost[usize::from(inside)];
        at[node] + (at[node + 1] - at[node]) * share
    }

    /// Its cosine-weighted mean.
    #[inline(always)]
    pub(super) fn mean_lost(&self, inside: bool) -> f32 {
        self.mean_lost[usize::from(inside)]
    }

    /// Share of what several facets send away that goes to the other side of a boundary of an index, of either side over the
    /// other.
    #[inline(always)]
    pub(super) fn transmitted(&self, inside: bool, ior: f32) -> f32 {
        let index = ior.max(1.0 / ior);
        let ratio = self.mean_lost[0] / (self.mean_lost[1] * index * index);
        let from_outside = self.transmitted.min(1.0 / ratio);
        if inside { from_outside * ratio } else { from_outside }
    }

    fn integrate(ior: f32, alpha: f32) -> Self {
        let mut row = Self { lost: [[0.0; COSINES]; 2], mean_lost: [0.0; 2], transmitted: 0.0 };
        for (side, relative) in [ior, 1.0 / ior].into_iter().enumerate() {
            let mut passed = [0.0; COSINES];
            for (node, passed) in passed.iter_mut().enumerate() {
                let cosine = (node as f32 / (COSINES - 1) as f32).max(LEAST_COSINE);
                let [reflected, transmitted] = sent_away(relative, alpha, cosine);
                row.lost[side][node] = (1.0 - reflected - transmitted).max(0.0);
                *passed = transmitted;
            }
            row.mean_lost[side] = mean(&row.lost[side]).max(1e-7);
            if side == 0 {
                row.transmitted = mean(&passed) / (1.0 - row.mean_lost[0]);
            }
        }
        row
    }
}

/// What one facet reflects and transmits, by the midpoint rule over visible normals.
fn sent_away(ior: f32, alpha: f32, cosine: f32) -> [f32; 2] {
    let ggx = Ggx { alpha };
    let wo = Vec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
    ggx.mean_of(wo, POINTS[0], POINTS[1], |half| {
        let o = wo.dot(half).max(0.0);
        let (reflectance, cos_inside) = dielectric_reflectance(o, ior);
        let mirrored = 2.0 * o * half - wo;
        let reflected = if mirrored.z > 0.0 { reflectance * ggx.kept(wo, mirrored) } else { 0.0 };
        let refracted = (o / ior - cos_inside) * half - wo / ior;
        let passed = if refracted.z < 0.0 { (1.0 - reflectance) * ggx.kept(wo, refracted) } else { 0.0 };
        [reflected, passed]
    })
}

/// `∫ 2μ f(μ) dμ` of what is linear between nodes.
fn mean(at: &[f32; COSINES]) -> f32 {
    let h = 1.0 / (COSINES - 1) as f32;
    let cell = |i: usize| 2.0 * h * (i as f32 * h * 0.5 * (at[i] + at[i + 1]) + h * (at[i] / 6.0 + at[i + 1] / 3.0));
    (0..COSINES - 1).map(cell).sum()
}
