//! Brightness of each light in the image, estimated from a few paths before any block is traced.

use glam::Vec3;
use rayon::prelude::*;

use super::accumulator::PixelSums;
use super::integrator::{Paths, trace_sample};
use super::planes::PlaneSums;
use super::sampler::Sampler;
use crate::light::{Clusters, Light};
use crate::scene::Scene;

/// Number of paths; they take some hundredths of a second. The result only weighs columns, so that a relative error of
/// a third does no harm.
const PATHS: u32 = 1 << 14;
/// Paths that are summed together. The sums are added in order, so that the result does not depend on the threads.
const AT_ONCE: u32 = 1 << 11;
/// Seed of these paths. It is fixed, so that neither the scene's seed nor its number of samples changes a job's
/// identity.
const SEED: u64 = 0x7363_616c_6573;

/// Total light of a light source, and the part of its emitters in view.
type Seen = [f64; 2];

/// The scales of the columns of a scene, see [`LightBasis::column_scales`](crate::light::LightBasis::column_scales). A
/// scale is the image's mean of the light that surfaces scatter, since an emitter in view says little of the rest.
/// Lights of which only the emitter is visible use the emission. Lights that no path finds get the mean scale of their
/// unit. All columns of a light share one value.
pub(super) fn measure(paths: &Paths<'_>) -> Vec<f32> {
    let Scene { basis, camera, .. } = &*paths.world.scene;
    let size = (camera.width, camera.height);
    let columns = basis.column_count();
    let lights = || basis.lights().iter().enumerate();
    let light_of: Vec<u32> = lights().flat_map(|(i, light)| light.columns().map(move |_| i as u32)).collect();
    let clusters = Clusters::of_basis(basis);
    let part = |begin: u32| {
        let mut seen: Vec<Seen> = vec![[0.0; 2]; basis.lights().len()];
        let (mut sums, mut planes) = (PixelSums::new(columns), PlaneSums::new(&clusters, &[]));
        for path in begin..begin + AT_ONCE {
            let sampler = Sampler::new(SEED, u64::from(path), 0);
            trace_sample(paths, pixel(path, size), 0, &sampler, &mut sums, Some(&mut planes));
        }
        let mut add = |which: usize, column: usize, sum: Vec3| {
            let sum = f64::from(sum.x + sum.y + sum.z);
            if sum.is_finite() {
                seen[light_of[column] as usize][which] += sum;
            }
        };
        sums.drain(|column, sum| add(0, column, sum));
        planes.drain_emission(|column, sum| add(1, column, sum));
        seen
    };
    let parts: Vec<Vec<Seen>> = (0..PATHS / AT_ONCE).into_par_iter().map(|i| part(i * AT_ONCE)).collect();
    let mean = |(i, light): (usize, &Light)| {
        let [all, in_view] = [0, 1].map(|which| parts.iter().map(|part| part[i][which]).sum::<f64>());
        // A difference of equal sums is only rounding.
        let scattered = if all - in_view > 1e-4 * all { all - in_view } else { 0.0 };
        let light_values = f64::from(3 * PATHS) * light.places.len() as f64;
        let told = if scattered > 0.0 { scattered } else { all };
        (told / light_values) as f32
    };
    let means: Vec<f32> = lights().map(mean).collect();
    let known = |mean: f32| mean.is_normal() && mean > 0.0;
    let usual = |is_like: &dyn Fn(&Light) -> bool| {
        let like = || lights().zip(&means).filter(|((_, light), mean)| known(**mean) && is_like(light));
        let logarithms: f64 = like().map(|(_, mean)| f64::from(*mean).ln()).sum();
        (like().count() > 0).then(|| (logarithms / like().count() as f64).exp() as f32)
    };
    let scale = |((_, light), &mean): ((usize, &Light), &f32)| {
        let of_unit = || usual(&|other| other.unit == light.unit).or_else(|| usual(&|_| true)).unwrap_or(1.0);
        std::iter::repeat_n(if known(mean) { mean } else { of_unit() }, light.places.len())
    };
    lights().zip(&means).flat_map(scale).collect()
}

/// Pixel of a path: Roberts' two-dimensional sequence (2018), which is evenly distributed for any number of points.
fn pixel(path: u32, (width, height): (u32, u32)) -> (u32, u32) {
    let place = |step: f64, length: u32| (((f64::from(path) + 0.5) * step).fract() * f64::from(length)) as u32;
    (place(0.754_877_666_246_692_7, width), place(0.569_840_290_998_053_2, height))
}
