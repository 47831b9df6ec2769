//! The filter of one window of the image.

use std::ops::Range;

use super::constants::*;
use super::guide::{Guide, GuideWidths, mixtures, weights};
use super::kernel::{square, weighted_means};
use super::rows::Rows;
use super::shrink::mix_in;
use super::surfaces::Surfaces;
use super::tally::Guides;

/// Pixels around a window that what comes out of its inside depends on.
pub const HALO: usize = 56;

/// What is known of a window of the image. Light: two halves of the samples, of each all clusters, of each three channels.
/// Features as in `matrix::BlockPlanes`.
#[derive(Clone, Debug)]
pub struct Window {
    /// Light that falls straight from emitters on what a pixel sees.
    pub direct: Rows,
    /// All other light but emission seen.
    pub indirect: Rows,
    /// What a pixel sees, see `matrix::Feature`.
    pub features: Rows,
    /// Variances of those.
    pub feature_variance: Rows,
}

/// Bytes that [`clean`] takes at most for each pixel of a window.
pub fn pixel_bytes(clusters: u64) -> u64 {
    // Both kinds of light, raw; what is filtered, in two steps; terms of the risk; features, guides.
    4 * (6 * clusters * 5 + 2 * clusters * 2 + 80)
}

/// The cleaned images of the clusters: three planes each, direct and indirect light together. Right for pixels that are
/// [`HALO`] away from the window's rim, or whose image ends there.
pub fn clean(window: Window, guides: &Guides) -> Rows {
    let Window { mut direct, mut indirect, features, feature_variance } = window;
    let surfaces = Surfaces::new(&features, &feature_variance);
    let albedo = |channel: usize, y: usize| features.row(channel, y).iter().map(|a| a.max(LEAST_ALBEDO));
    let divide = |light: &mut Rows| {
        let width = light.width();
        light.fill_rows(|y, out| {
            for (plane, out) in out.chunks_exact_mut(width).enumerate() {
                out.iter_mut().zip(albedo(plane % 3, y)).for_each(|(o, a)| *o /= a);
            }
        });
    };
    divide(&mut direct);
    let direct = mean_of_halves(&clean_direct(direct, &guides.direct, &surfaces));
    divide(&mut indirect);
    let mut images = mean_of_halves(&clean_indirect(indirect, &guides.indirect, &surfaces));
    let width = images.width();
    images.fill_rows(|y, out| {
        for (plane, out) in out.chunks_exact_mut(width).enumerate() {
            let parts = direct.row(plane, y).iter().zip(albedo(plane % 3, y));
            out.iter_mut().zip(parts).for_each(|(o, (d, a))| *o = (*o + d) * a);
        }
    });
    images
}

fn clean_direct(light: Rows, mix: &[f32], surfaces: &Surfaces) -> Rows {
    let raw = mixtures(&light, mix);
    let guide = Guide::of_halves(&raw, RAW_NOISE_REACH);
    let widths = GuideWidths { noise: DIRECT_PILOT_NOISE, relative: DIRECT_PILOT_RELATIVE };
    let pilot = weighted_means(&raw, &square(DIRECT_PILOT, 1), 0.0, alike(surfaces, &guide, &widths, (1, None)));
    let guide = Guide::of_halves(&pilot, FILTERED_NOISE_REACH);
    let widths = GuideWidths { noise: DIRECT_NOISE, relative: DIRECT_RELATIVE };
    let weigh = alike(surfaces, &guide, &widths, (1, Some(DIRECT)));
    let mut means = weighted_means(&light, &square(DIRECT, 1), SLOPE, weigh);
    mix_in(&light, &mut means, RISK_REACH);
    means
}

fn clean_indirect(light: Rows, mix: &[f32], surfaces: &Surfaces) -> Rows {
    let raw = mixtures(&light, mix);
    let guide = Guide::of_halves(&raw, RAW_NOISE_REACH);
    let widths = GuideWidths { noise: INDIRECT_PILOT_NOISE, relative: INDIRECT_PILOT_RELATIVE };
    let pilot = wide_then_narrow(&raw, PILOT_SLOPE, |radius| alike(surfaces, &guide, &widths, (1, Some(radius))));
    let guide = Guide::of_halves(&pilot, FILTERED_NOISE_REACH);
    let widths = GuideWidths { noise: INDIRECT_NOISE, relative: INDIRECT_RELATIVE };
    let mut means = wide_then_narrow(&light, SLOPE, |radius| alike(surfaces, &guide, &widths, (0, Some(radius))));
    mix_in(&light, &mut means, RISK_REACH);
    means
}

/// A wide filter that reads some of the pixels, then a narrow one that reads all.
fn wide_then_narrow<W>(light: &Rows, slope: f32, weigh: impl Fn(isize) -> W) -> Rows
where
    W: Fn(usize, (isize, isize), Range<usize>, &mut [f32]) + Sync,
{
    let wide = weighted_means(light, &square(INDIRECT_WIDE, INDIRECT_STRIDE), slope, weigh(INDIRECT_WIDE));
    weighted_means(&wide, &square(INDIRECT_NARROW, 1), slope, weigh(INDIRECT_NARROW))
}

/// Weights by the guide, compared over patches of a reach, by what is seen, and by the distance within a radius.
fn alike<'a>(
    surfaces: &'a Surfaces,
    guide: &'a Guide,
    widths: &'a GuideWidths,
    (patch, radius): (usize, Option<isize>),
) -> impl Fn(usize, (isize, isize), Range<usize>, &mut [f32]) + Sync + 'a {
    move |y, offset, span, out| {
        guide.add_patch_distances(y, offset, span.clone(), (widths, patch), out);
        let near = radius.map_or(0.0, |radius| nearness(offset, radius));
        out.iter_mut().for_each(|distance| *distance = distance.max(0.0) + near);
        surfaces.add_distances(y, offset, span, out);
        weights(out);
    }
}

fn nearness((across, down): (isize, isize), radius: isize) -> f32 {
    let width = radius as f32 * NEARNESS;
    (across * across + down * down) as f32 / (2.0 * width * width)
}

fn mean_of_halves(halves: &Rows) -> Rows {
    let (width, planes) = (halves.width(), halves.planes() / 2);
    let mut mean = Rows::zeros(width, halves.height(), planes);
    mean.fill_rows(|y, out| {
        for (plane, out) in out.chunks_exact_mut(width).enumerate() {
            let pairs = halves.row(plane, y).iter().zip(halves.row(planes + plane, y));
            out.iter_mut().zip(pairs).for_each(|(o, (a, b))| *o = 0.5 * (a + b));
        }
    });
    mean
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::super::Tally;
    use super::*;

    const CLUSTERS: usize = 2;

    /// A floor and a wall that meet in the middle; cluster 1 lights the left third alone. Each half has noise of this size.
    fn room((width, height): (usize, usize), noise: f32) -> (Window, Rows) {
        let mut random = Pcg64Mcg::seed_from_u64(3);
        let rows = |planes| Rows::zeros(width, height, planes);
        let light = 2 * 3 * CLUSTERS;
        let mut window =
            Window { direct: rows(light), indirect: rows(light), features: rows(10), feature_variance: rows(10) };
        let mut truth = rows(3 * CLUSTERS);
        for y in 0..height {
            for x in 0..width {
                let floor = y > height / 2;
                let albedo = if floor { 0.8 } else { 0.4 };
                let features = [albedo, albedo, albedo, 0.0, f32::from(floor), f32::from(!floor), 4.0, 0.0, 0.0, 1.0];
                features.iter().enumerate().for_each(|(plane, &v)| window.features.row_mut(plane, y)[x] = v);
                for plane in 0..3 * CLUSTERS {
                    let lit = plane < 3 || x < width / 3;
                    let direct = if lit { 1.0 + plane as f32 * 0.1 } else { 0.0 } * albedo;
                    let indirect = (0.3 + if floor { 0.2 } else { 0.0 }) * albedo;
                    truth.row_mut(plane, y)[x] = direct + indirect;
                    for half in 0..2 {
                        let mut draw = || 1.0 + noise * (random.random::<f32>() - 0.5) * 12f32.sqrt();
                        window.direct.row_mut(half * 3 * CLUSTERS + plane, y)[x] = direct * draw();
                        window.indirect.row_mut(half * 3 * CLUSTERS + plane, y)[x] = indirect * draw();
                    }
                }
            }
        }
        (window, truth)
    }

    fn guides(window: &Window) -> Guides {
        let mut tally = Tally::new(CLUSTERS);
        tally.add(window);
        tally.guides()
    }

    fn squared_error(a: &Rows, b: &Rows) -> f64 {
        a.values().iter().zip(b.values()).map(|(a, b)| f64::from(a - b).powi(2)).sum()
    }

    fn raw(window: &Window) -> Rows {
        let mut raw = mean_of_halves(&window.direct);
        let indirect = mean_of_halves(&window.indirect);
        raw.values_mut().iter_mut().zip(indirect.values()).for_each(|(d, i)| *d += i);
        raw
    }

    #[test]
    fn grain_goes_and_edges_of_surfaces_and_shadows_stay() {
        let (window, truth) = room((48, 40), 0.5);
        let before = squared_error(&raw(&window), &truth);
        let after = squared_error(&clean(window.clone(), &guides(&window)), &truth);
        assert!(after < before / 15.0, "{after} of {before}");
    }

    #[test]
    fn without_noise_nothing_changes() {
        let (window, truth) = room((48, 40), 0.0);
        let error = squared_error(&clean(window.clone(), &guides(&window)), &truth);
        let norm = squared_error(&truth, &Rows::zeros(48, 40, 3 * CLUSTERS));
        assert!(error < 1e-10 * norm, "{error} of {norm}");
    }

    #[test]
    fn a_firefly_does_not_stay_where_it_is() {
        let (mut window, _) = room((48, 40), 0.3);
        let guides = guides(&window);
        (0..3).for_each(|channel| window.indirect.row_mut(channel, 30)[20] += 50.0);
        let images = clean(window, &guides);
        assert!(images.row(0, 30)[20] < 3.0, "a mean of 25.8 became {}", images.row(0, 30)[20]);
    }

    /// Half of the indirect light comes in a few bright samples: together they keep it.
    #[test]
    fn fireflies_are_spread_and_not_cut() {
        let (mut window, _) = room((48, 40), 0.3);
        let mut random = Pcg64Mcg::seed_from_u64(4);
        for y in 0..window.indirect.height() {
            for x in 0..window.indirect.width() {
                for half in 0..2 {
                    let scale = if random.random_range(0..20) == 0 { 10.5 } else { 0.5 };
                    for plane in half * 3 * CLUSTERS..(half + 1) * 3 * CLUSTERS {
                        window.indirect.row_mut(plane, y)[x] *= scale;
                    }
                }
            }
        }
        let sum = |rows: &Rows| rows.values().iter().map(|&v| f64::from(v)).sum::<f64>();
        let before = sum(&raw(&window));
        let kept = sum(&clean(window.clone(), &guides(&window))) / before;
        // Their own noise is 2 % of the sum.
        assert!((0.96..1.04).contains(&kept), "{kept} of the light");
    }

    /// On an edge a pixel may see a bit of each surface, and be like none of its neighbours.
    #[test]
    fn a_pixel_like_no_other_does_not_keep_its_grain() {
        let (mut window, _) = room((48, 40), 0.3);
        (3..6).for_each(|plane| window.features.row_mut(plane, 30)[20] = 0.6);
        for light in [&mut window.direct, &mut window.indirect] {
            (0..3).for_each(|channel| light.row_mut(channel, 30)[20] += 5.0);
        }
        let images = clean(window.clone(), &guides(&window));
        let (found, beside) = (images.row(0, 30)[20], images.row(0, 30)[23]);
        assert!((found - beside).abs() < 2.0, "{found}, and {beside} beside it");
    }

    #[test]
    fn windows_and_threads_give_the_same_images() {
        let size = (190, 24);
        let (window, _) = room(size, 0.5);
        let guides = guides(&window);
        let whole = clean(window.clone(), &guides);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        assert_eq!(pool.install(|| clean(window.clone(), &guides)), whole);
        // Its right part, with as much around it as is needed.
        let (inside, left) = (130, 130 - HALO);
        let cut = |rows: &Rows| {
            let mut part = Rows::zeros(size.0 - left, size.1, rows.planes());
            for plane in 0..rows.planes() {
                (0..size.1).for_each(|y| part.row_mut(plane, y).copy_from_slice(&rows.row(plane, y)[left..]));
            }
            part
        };
        let part = Window {
            direct: cut(&window.direct),
            indirect: cut(&window.indirect),
            features: cut(&window.features),
            feature_variance: cut(&window.feature_variance),
        };
        let part = clean(part, &guides);
        for plane in 0..whole.planes() {
            for y in 0..size.1 {
                assert_eq!(part.row(plane, y)[inside - left..], whole.row(plane, y)[inside..], "row {y}");
            }
        }
    }
}
