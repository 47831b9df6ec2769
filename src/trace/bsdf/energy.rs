//! Directional albedo of GGX reflection, and the light that scatters between microfacets.
//!
//! A single-scattering microfacet model drops light that is shadowed by further facets. Kulla and Conty (2017,
//! *Revisiting physically based shading at Imageworks*) return it by a second lobe, `(1 − E(θi)) (1 − E(θo)) / (π (1 − Ē))`,
//! where `E` is the directional albedo of the lobe without a Fresnel term and `Ē` its cosine-weighted mean. It is
//! reciprocal, and a surface that reflects all at every facet reflects all.
//!
//! With Schlick's Fresnel term, `E` of a lobe is `F₀ a + b`: two numbers for each roughness and angle (Karis 2013, *Real
//! shading in Unreal Engine 4*). They are integrated once by the midpoint rule over visible normals
//! (decision 60).

use std::sync::LazyLock;

use glam::Vec3;

use super::microfacet::Ggx;
use super::nodes::node_below;

/// Nodes over the cosine, from 0 to 1.
const COSINES: usize = 32;
/// Rows that are integrated, over the square root of α, and those between them.
const INTEGRATED: usize = 33;
const ROWS: usize = 32 * (INTEGRATED - 1) + 1;
/// Points of the midpoint rule: rings and turns.
const POINTS: [u32; 2] = [40, 16];
/// Cosine of the first node: at 0 no normal is visible.
const LEAST_COSINE: f32 = 1e-3;

/// Directional albedo of one roughness.
#[derive(Clone, Copy, Debug)]
pub(super) struct AlbedoRow {
    /// `[a, b]` at each node.
    at: [[f32; 2]; COSINES],
    /// Cosine-weighted means of both.
    mean: [f32; 2],
}

static TABLE: LazyLock<Vec<AlbedoRow>> = LazyLock::new(|| {
    let integrated: Vec<AlbedoRow> =
        (0..INTEGRATED).map(|row| AlbedoRow::integrate((row as f32 / (INTEGRATED - 1) as f32).powi(2))).collect();
    let step = (ROWS - 1) / (INTEGRATED - 1);
    let between = |row: usize| {
        let first = (row / step).min(INTEGRATED - 2);
        let share = (row - first * step) as f32 / step as f32;
        AlbedoRow::mix(&integrated[first], &integrated[first + 1], share)
    };
    (0..ROWS).map(between).collect()
});

impl AlbedoRow {
    /// The row nearest to a roughness.
    #[inline(always)]
    pub(super) fn of(alpha: f32) -> &'static Self {
        let row = alpha.clamp(0.0, 1.0).sqrt() * (ROWS - 1) as f32 + 0.5;
        &TABLE[(row as usize).min(ROWS - 1)]
    }

    /// `(a, b)`, so that the single-scattering albedo is `F₀ a + b`.
    #[inline(always)]
    pub(super) fn at(&self, cosine: f32) -> (f32, f32) {
        let (node, share) = node_below(cosine, COSINES);
        let ([a0, b0], [a1, b1]) = (self.at[node], self.at[node + 1]);
        (a0 + (a1 - a0) * share, b0 + (b1 - b0) * share)
    }

    /// The cosine-weighted means of both.
    #[inline(always)]
    pub(super) fn mean(&self) -> (f32, f32) {
        (self.mean[0], self.mean[1])
    }

    /// Integrates `G₂/G₁` and its product with Schlick's fifth power over visible normals.
    fn integrate(alpha: f32) -> Self {
        let ggx = Ggx { alpha };
        let at = std::array::from_fn(|node| {
            if alpha == 0.0 {
                let grazing = (1.0 - node as f32 / (COSINES - 1) as f32).powi(5);
                return [1.0 - grazing, grazing];
            }
            let cosine = (node as f32 / (COSINES - 1) as f32).max(LEAST_COSINE);
            let wo = Vec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
            ggx.mean_of(wo, POINTS[0], POINTS[1], |half| {
                let wi = 2.0 * wo.dot(half) * half - wo;
                let kept = if wi.z > 0.0 { ggx.kept(wo, wi) } else { 0.0 };
                let grazing = (1.0 - wo.dot(half).clamp(0.0, 1.0)).powi(5);
                [kept * (1.0 - grazing), kept * grazing]
            })
        });
        Self::with_mean(at)
    }

    fn mix(first: &Self, second: &Self, share: f32) -> Self {
        let between = |a: f32, b: f32| a + (b - a) * share;
        Self::with_mean(std::array::from_fn(|node| {
            [0, 1].map(|part| between(first.at[node][part], second.at[node][part]))
        }))
    }

    /// The means `∫ 2μ E(μ) dμ` of what is linear between nodes, so that energy is kept exactly.
    fn with_mean(at: [[f32; 2]; COSINES]) -> Self {
        let h = 1.0 / (COSINES - 1) as f64;
        let mean = [0, 1].map(|part| {
            let cell = |i: usize| {
                let (x, low, high) = (i as f64 * h, f64::from(at[i][part]), f64::from(at[i + 1][part]));
                // ∫ 2 (x + t) (low + (high − low) t/h) dt from 0 to h.
                2.0 * h * (x * 0.5 * (low + high) + h * (low / 6.0 + high / 3.0))
            };
            (0..COSINES - 1).map(cell).sum::<f64>() as f32
        });
        Self { at, mean }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smooth_surfaces_lose_nothing_and_rough_ones_what_is_known() {
        let row = AlbedoRow::of(1e-3);
        for cosine in [0.1f32, 0.5, 1.0] {
            let (a, b) = row.at(cosine);
            let grazing = (1.0 - cosine).powi(5);
            // Linear between 32 nodes: the error of the fifth power is below h²/8 · 20.
            assert!((a + b - 1.0).abs() < 1e-3 && (b - grazing).abs() < 3e-3, "{cosine}: {a} {b}");
        }
        // The mean of Schlick's fifth power is 1/21.
        assert!((row.mean().1 - 1.0 / 21.0).abs() < 1e-3, "{:?}", row.mean());
        // At α = 1 and normal incidence `D = 1/π` and `G₂ = 2μ/(1 + μ)`: `∫ D G₂/4 dω = ∫ μ/(1 + μ) dμ = 1 − ln 2`.
        let (a, b) = AlbedoRow::of(1.0).at(1.0);
        let known = 1.0 - std::f32::consts::LN_2;
        assert!((a + b - known).abs() < 2e-3, "{} {known}", a + b);
    }
}
