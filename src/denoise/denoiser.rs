//! Denoising of an image or a window of it, a strip of rows at a time from the top down.

use std::ops::Range;

use super::albedo;
use super::constants::*;
use super::denoised_rows::DenoisedRows;
use super::detail;
use super::errors::BlockErrors;
use super::filter::{Direct, Indirect};
use super::filter_radii::FilterRadii;
use super::guide_statistics::Guides;
use super::guides::mixture_planes;
use super::image_rows::{ImageRows, Pool, Region};
use super::per_image_filter;
use super::row_stages::{Stage, Step};
use super::shrinkage::{ImageOrigin, mixed};
use super::surfaces::Surfaces;

/// Least number of rows denoised in one step.
const STEP: usize = 64;

/// Rows of the input, for the caller to fill. For each row of pixels come the rows of all planes.
pub struct DenoiserRows<'a> {
    /// Light straight from emitters at the surface that a pixel sees. Planes are ordered by half of the samples, then
    /// cluster, then channel.
    pub direct: &'a mut [f32],
    /// All other light, without the emission seen by the camera. Ordered as `direct`.
    pub indirect: &'a mut [f32],
    /// The features of each pixel, see `matrix::Feature`.
    pub features: &'a mut [f32],
    /// Variance of the mean of each feature.
    pub feature_variance: &'a mut [f32],
}

/// What of an image is denoised.
#[derive(Clone, Debug)]
pub struct DenoisedRegion {
    /// Pixels of the image across and down.
    pub size: (usize, usize),
    /// Side of its blocks in pixels.
    pub block: usize,
    /// The pixels that are denoised.
    pub region: Region,
    /// Planes of features.
    pub features: usize,
    /// The group of each cluster: errors are told for each group.
    pub groups: Vec<u16>,
    /// Where the images come from.
    pub origin: ImageOrigin,
}

/// Images of clusters that are being denoised, from the top of the image down: [`wants`](Self::wants) says which rows come next,
/// [`strips`](Self::strips) takes them, [`denoise`](Self::denoise) gives what has been denoised.
///
/// The result is valid in a region that is at least [`FilterRadii::halo`] pixels away from the window's border, or ends where
/// the image ends. Elsewhere it is unspecified.
pub struct Denoiser<'a> {
    region: Region,
    /// The rows that are denoised next.
    next: Range<usize>,
    /// Block height in pixels; rows are asked for up to a multiple of it.
    block: usize,
    /// Block width in pixels.
    side: usize,
    groups: Vec<u16>,
    origin: ImageOrigin,
    read: Input,
    direct: Direct<'a>,
    indirect: Indirect<'a>,
    surfaces: Surfaces,
    pool: &'a Pool,
}

/// The part of the input that is held: demodulated light, and features.
struct Input {
    direct: ImageRows,
    indirect: ImageRows,
    features: ImageRows,
    feature_variance: ImageRows,
    /// One past the last row that has been filled.
    end: usize,
    /// Which rows of light are read around a step, and which are held.
    light: Stage,
    of_features: Stage,
}

impl<'a> Denoiser<'a> {
    /// Begins at the top of what is to be denoised.
    pub fn new(of: DenoisedRegion, reach: FilterRadii, guides: &'a Guides, pool: &'a Pool) -> Self {
        let DenoisedRegion { size, block: side, region, features, groups, origin } = of;
        let block = side.min(size.1);
        let light = reach.light(2 * 3 * guides.clusters());
        let step = step_of(block);
        let rows = |stage: Stage| ImageRows::none_yet(size, stage.planes, stage.rows(step) + block);
        let of_features = reach.features(features);
        let read = Input {
            direct: rows(light),
            indirect: rows(light),
            features: rows(of_features),
            feature_variance: rows(of_features),
            end: region.y.start.saturating_sub(light.reach),
            light,
            of_features,
        };
        let of_indirect =
            reach.indirect_stages(light.planes, mixture_planes(guides.indirect.len() / guides.clusters()));
        Self {
            next: region.y.start..region.y.start,
            block,
            side,
            groups,
            origin,
            read,
            direct: Direct::new(reach, guides, &region, size, step),
            indirect: Indirect::new(reach, guides, &region, size, step),
            surfaces: Surfaces::begin(of_indirect.surfaces, &region, size, step),
            region,
            pool,
        }
    }

    /// Upper bound of the bytes held for each pixel column, for a region that begins at the image's top.
    pub fn bytes_across(reach: FilterRadii, clusters: usize, features: usize, block: usize) -> u64 {
        let (step, light) = (step_of(block), reach.light(2 * 3 * clusters));
        let mixtures = mixture_planes(GUIDES.min(clusters));
        let bytes = |stage: &Stage| (4 * stage.planes * stage.rows(step)) as u64;
        let read = 2 * bytes(&light) + 2 * bytes(&reach.features(features));
        let held: u64 = reach.direct_stages(light.planes, mixtures).all().iter().map(bytes).sum::<u64>()
            + reach.indirect_stages(light.planes, mixtures).all().iter().map(bytes).sum::<u64>();
        // Rows arrive in whole blocks.
        let more = 4 * block * (2 * light.planes + 2 * features);
        // The mixed means, the denoised images, and the terms of the risk in three steps; the guides of several images
        // filtered by themselves, and the terms of each; the albedo.
        let passing = 4
            * (step * (light.planes + light.planes / 2 + 9)
                + per_image_filter::passing_rows(reach, step)
                + detail::passing_rows(step)
                + albedo::passing_rows(step));
        read + held + (more + passing) as u64
    }

    /// The rows that are needed before the next step can be denoised, or `None` at the end. The range is empty if they
    /// are all here already.
    pub fn wants(&mut self) -> Option<Range<usize>> {
        let begin = self.next.end;
        if begin >= self.region.y.end {
            return None;
        }
        // Ends at a border of blocks.
        let borders = (begin + step_of(self.block)).next_multiple_of(self.block);
        let borders = if borders - begin > step_of(self.block) { borders - self.block } else { borders };
        self.next = begin..borders.clamp(begin + 1, self.region.y.end);
        let read = &mut self.read;
        let height = read.features.height();
        let end = (self.next.end + read.light.reach).next_multiple_of(self.block).min(height).max(read.end);
        let wanted = read.end..end;
        let held = |kept: isize, rows: &ImageRows| {
            if rows.held().is_empty() { wanted.start..end } else { begin.saturating_add_signed(kept)..end }
        };
        for rows in [&mut read.direct, &mut read.indirect] {
            rows.hold(held(read.light.kept, rows));
        }
        for rows in [&mut read.features, &mut read.feature_variance] {
            rows.hold(held(read.of_features.kept, rows));
        }
        read.end = end;
        Some(wanted)
    }

    /// Lends the rows for filling, as one strip for each border. `borders` are the first rows of the strips.
    pub fn strips(&mut self, rows: &Range<usize>, borders: &[usize]) -> Vec<DenoiserRows<'_>> {
        let Input { direct, indirect, features, feature_variance, .. } = &mut self.read;
        let light = direct.strips_mut(rows, borders).into_iter().zip(indirect.strips_mut(rows, borders));
        let features = features.strips_mut(rows, borders).into_iter().zip(feature_variance.strips_mut(rows, borders));
        light
            .zip(features)
            .map(|((direct, indirect), (features, feature_variance))| DenoiserRows {
                direct,
                indirect,
                features,
                feature_variance,
            })
            .collect()
    }

    /// Denoises the next rows, once the rows `came` that [`wants`](Self::wants) asked for are filled.
    pub fn denoise(&mut self, came: &Range<usize>) -> DenoisedRows {
        let step = Step { region: &self.region, y: self.next.clone() };
        let part = step.part();
        let Input { direct, indirect, features, feature_variance, .. } = &mut self.read;
        let of_samples = |plane: usize, y: usize| albedo::of_samples(features, plane % 3, y);
        for light in [&mut *direct, &mut *indirect] {
            let rows = Region { x: 0..light.width(), y: came.clone() };
            light.change_rows(&rows, |y, plane, out| {
                out.iter_mut().zip(of_samples(plane, y)).for_each(|(o, a)| *o /= a)
            });
        }
        self.surfaces.advance(features, feature_variance, &step, self.pool);
        let planes = direct.planes() / 2;
        let mut images = self.pool.rows_like(features, planes, part.y.clone());
        images.clear(&part);
        let groups = self.groups.iter().max().map_or(0, |&last| usize::from(last) + 1);
        let mut errors = BlockErrors::none_yet(&part, self.side, groups);
        self.direct.advance(direct, &step, &self.surfaces, self.pool);
        self.indirect.advance(indirect, &step, &self.surfaces, self.pool);
        let albedo = albedo::of_filtered(features, feature_variance, &part, &self.surfaces, self.pool);
        for (light, means) in [(&*direct, self.direct.means()), (&*indirect, self.indirect.means())] {
            let denoised = mixed(light, means, self.origin, &part, self.pool);
            errors.add_change([light, &denoised], &self.groups, |channel, y, x| {
                of_samples(channel, y).skip(x.start).take(x.len()).collect()
            });
            images.change_rows(&part, |y, plane, out| {
                let [a, b] = [plane, planes + plane].map(|plane| &denoised.row(plane, y)[part.x.clone()]);
                let halves = a.iter().zip(b).zip(&albedo.row(plane % 3, y)[part.x.clone()]);
                out.iter_mut().zip(halves).for_each(|(o, ((a, b), albedo))| *o += 0.5 * (a + b) * albedo);
            });
            self.pool.keep(denoised);
        }
        self.pool.keep(albedo);
        errors.add_light(&images, &self.groups);
        DenoisedRows { images, errors }
    }
}

#[cfg(test)]
impl Denoiser<'_> {
    /// Bytes of all rows held.
    fn held_bytes(&self) -> usize {
        let Input { direct, indirect, features, feature_variance, .. } = &self.read;
        let read = [direct, indirect, features, feature_variance, self.surfaces.rows()];
        let all = read.into_iter().chain(self.direct.all_rows()).chain(self.indirect.all_rows());
        all.map(ImageRows::room_bytes).sum()
    }
}

fn step_of(block: usize) -> usize {
    block * (STEP / block).max(1)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::super::{ErrorSums, GuideStatistics};
    use super::*;

    const CLUSTERS: usize = 2;
    const REACH: FilterRadii = FilterRadii { stride: 3, far_step: None };
    /// The radii of small, larger and large images.
    const REACHES: [FilterRadii; 3] =
        [REACH, FilterRadii { stride: 4, far_step: None }, FilterRadii { stride: 4, far_step: Some(12) }];

    /// The complete input of an image.
    #[derive(Clone)]
    struct Window {
        direct: ImageRows,
        indirect: ImageRows,
        features: ImageRows,
        feature_variance: ImageRows,
    }

    /// A floor and a wall that meet in the middle. Cluster 1 lights the left third only. `noise` is the σ of each half.
    fn room((width, height): (usize, usize), noise: f32) -> (Window, ImageRows) {
        let mut random = Pcg64Mcg::seed_from_u64(3);
        let rows = |planes| ImageRows::zeros(width, height, planes);
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
        let halves = |light: &ImageRows| {
            let plane = |plane| (0..light.height()).flat_map(move |y| light.row(plane, y).to_vec());
            [0, 1].map(|half| (half * 3 * CLUSTERS..(half + 1) * 3 * CLUSTERS).flat_map(plane).collect::<Vec<f32>>())
        };
        let (direct, indirect) = (halves(&window.direct), halves(&window.indirect));
        let mut tally = GuideStatistics::new(CLUSTERS);
        tally.add([&direct[0], &direct[1]], [&indirect[0], &indirect[1]]);
        tally.guides()
    }

    fn mean_of_halves(halves: &ImageRows) -> ImageRows {
        let planes = halves.planes() / 2;
        let mut mean = ImageRows::zeros(halves.width(), halves.height(), planes);
        mean.fill_rows(&halves.whole(), |y, plane, out| {
            let pairs = halves.row(plane, y).iter().zip(halves.row(planes + plane, y));
            out.iter_mut().zip(pairs).for_each(|(o, (a, b))| *o = 0.5 * (a + b));
        });
        mean
    }

    /// Denoises in steps of the given block height with a used pool. Returns all rows of the image and the
    /// errors of all blocks. Each cluster is a group.
    fn denoise_in_steps(
        window: &Window,
        region: &Region,
        guides: &Guides,
        block: usize,
        reach: FilterRadii,
    ) -> DenoisedRows {
        let size = (window.features.width(), window.features.height());
        let pool = Pool::default();
        for planes in [1, 3, 4, 10, 12, 16, 16] {
            let mut used = ImageRows::zeros(size.0, size.1, planes);
            used.values_mut().fill(f32::NAN);
            pool.keep(used);
        }
        let groups = (0..CLUSTERS as u16).collect();
        let region =
            DenoisedRegion { size, block, region: region.clone(), features: 10, groups, origin: ImageOrigin::Traced };
        let mut denoising = Denoiser::new(region, reach, guides, &pool);
        let zeros = |planes| ImageRows::zeros(size.0, size.1, planes);
        let mut all = DenoisedRows { images: zeros(3 * CLUSTERS), errors: BlockErrors::default() };
        while let Some(wanted) = denoising.wants() {
            let borders: Vec<usize> = wanted.clone().step_by(block).collect();
            for (strip, &first) in denoising.strips(&wanted, &borders).into_iter().zip(&borders) {
                let rows = first..wanted.end.min(first + block);
                let put = |from: &ImageRows, to: &mut [f32]| {
                    let row = from.planes() * size.0;
                    to.copy_from_slice(&from.values()[rows.start * row..rows.end * row]);
                };
                put(&window.direct, strip.direct);
                put(&window.indirect, strip.indirect);
                put(&window.features, strip.features);
                put(&window.feature_variance, strip.feature_variance);
            }
            let denoised = denoising.denoise(&wanted);
            for y in denoised.rows() {
                let (from, to) = (&denoised.images, &mut all.images);
                (0..from.planes()).for_each(|plane| to.row_mut(plane, y).copy_from_slice(from.row(plane, y)));
            }
            all.errors.append(&denoised.errors);
            denoised.keep_in(&pool);
        }
        all
    }

    fn denoise(window: Window, region: &Region, guides: &Guides) -> DenoisedRows {
        denoise_in_steps(&window, region, guides, 32, REACH)
    }

    fn denoise_all(window: &Window) -> ImageRows {
        denoise(window.clone(), &window.features.whole(), &guides(window)).images
    }

    fn squared_error(a: &ImageRows, b: &ImageRows) -> f64 {
        a.values().iter().zip(b.values()).map(|(a, b)| f64::from(a - b).powi(2)).sum()
    }

    fn raw(window: &Window) -> ImageRows {
        let mut raw = mean_of_halves(&window.direct);
        let indirect = mean_of_halves(&window.indirect);
        raw.values_mut().iter_mut().zip(indirect.values()).for_each(|(d, i)| *d += i);
        raw
    }

    #[test]
    fn grain_goes_and_edges_of_surfaces_and_shadows_stay() {
        let (window, truth) = room((48, 40), 0.5);
        let before = squared_error(&raw(&window), &truth);
        let after = squared_error(&denoise_all(&window), &truth);
        assert!(after < before / 15.0, "{after} of {before}");
    }

    /// Estimates of noise and bias from the two halves, against the truth.
    #[test]
    fn noise_and_bias_are_known_from_the_halves() {
        let (window, truth) = room((48, 40), 0.5);
        let region = truth.whole();
        let denoised = denoise_in_steps(&window, &region, &guides(&window), 20, REACH);
        let all = |region: &Region| {
            let mut all = ErrorSums::default();
            denoised.errors(region).iter().for_each(|sums| all.add(sums));
            all
        };
        let sums = all(&region);
        let raw_error = squared_error(&raw(&window), &truth);
        assert!((sums.noise_before / raw_error - 1.0).abs() < 0.1, "{sums:?}, not {raw_error}");
        let error = squared_error(&denoised.images, &truth);
        let bias = (sums.changed - sums.noise_of_change).max(0.0);
        // Both are a small part of the initial noise, and so is the error of either.
        assert!((sums.noise_after + bias - error).abs() < 0.02 * raw_error, "{sums:?}, not {error}");
        let halves = [0..20, 20..40].map(|y| all(&Region { x: 0..48, y }));
        let mut both = halves[0];
        both.add(&halves[1]);
        assert!((both.light / sums.light - 1.0).abs() < 1e-9 && (both.changed / sums.changed - 1.0).abs() < 1e-9);
    }

    /// The far pass averages noise that one image has and the sum of all images has not.
    #[test]
    fn noise_of_single_images_is_less_with_a_far_pass() {
        let size = (160, 130);
        let ((mut window, truth), (exact, _)) = (room(size, 2.0), room(size, 0.0));
        window.direct = exact.direct;
        let guides = guides(&window);
        let [_, near, far] = REACHES.map(|reach| {
            let denoised = denoise_in_steps(&window, &truth.whole(), &guides, 32, reach);
            squared_error(&denoised.images, &truth)
        });
        assert!(far < 0.9 * near, "{far}, not less than {near}");
    }

    #[test]
    fn without_noise_nothing_changes() {
        let (window, truth) = room((48, 40), 0.0);
        let error = squared_error(&denoise_all(&window), &truth);
        let norm = squared_error(&truth, &ImageRows::zeros(48, 40, 3 * CLUSTERS));
        assert!(error < 1e-10 * norm, "{error} of {norm}");
    }

    #[test]
    fn a_firefly_does_not_stay_where_it_is() {
        let (mut window, _) = room((48, 40), 0.3);
        let guides = guides(&window);
        (0..3).for_each(|channel| window.indirect.row_mut(channel, 30)[20] += 50.0);
        let images = denoise(window.clone(), &window.features.whole(), &guides).images;
        assert!(images.row(0, 30)[20] < 3.0, "a mean of 25.8 became {}", images.row(0, 30)[20]);
    }

    /// A firefly looks like a detail, but the noise around it must not stay because of it.
    #[test]
    fn a_firefly_of_both_halves_keeps_no_grain_around_it() {
        let (window, truth) = room((48, 40), 0.5);
        let guides = guides(&window);
        let mut struck = window.clone();
        for plane in [0, 1, 2, 3 * CLUSTERS, 3 * CLUSTERS + 1, 3 * CLUSTERS + 2] {
            struck.indirect.row_mut(plane, 30)[36] += 15.0;
        }
        // The light is uniform there, so differences of neighbours are noise.
        let grain = |window: Window| -> f32 {
            let images = denoise(window, &truth.whole(), &guides).images;
            let pairs =
                |y: usize| images.row(0, y)[38..43].windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum::<f32>();
            (24..37).map(pairs).sum()
        };
        let (with, without) = (grain(struck), grain(window));
        assert!(with < 3.0 * without, "{with}, without the firefly {without}");
    }

    /// Scales the light of a pixel, in each half of the samples: by `bright` with probability 1 / `one_in`, else by
    /// `other`.
    fn in_few_samples(light: &mut ImageRows, seed: u64, one_in: u32, [bright, other]: [f32; 2]) {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        for y in 0..light.height() {
            for x in 0..light.width() {
                for half in 0..2 {
                    let scale = if random.random_range(0..one_in) == 0 { bright } else { other };
                    for plane in half * 3 * CLUSTERS..(half + 1) * 3 * CLUSTERS {
                        light.row_mut(plane, y)[x] *= scale;
                    }
                }
            }
        }
    }

    /// Half of the indirect light comes in a few bright samples. Their sum must be kept.
    #[test]
    fn fireflies_are_spread_and_not_cut() {
        let (mut window, _) = room((48, 40), 0.3);
        in_few_samples(&mut window.indirect, 4, 20, [10.5, 0.5]);
        let sum = |rows: &ImageRows| rows.values().iter().map(|&v| f64::from(v)).sum::<f64>();
        let before = sum(&raw(&window));
        let kept = sum(&denoise_all(&window)) / before;
        // The noise of that sum itself is 2 %.
        assert!((0.96..1.04).contains(&kept), "{kept} of the light");
    }

    /// All indirect light comes in a few samples. The dark pixels between them are no detail.
    #[test]
    fn light_of_few_samples_is_averaged_everywhere() {
        let (mut window, truth) = room((96, 80), 0.0);
        in_few_samples(&mut window.indirect, 5, 20, [20.0, 0.0]);
        let images = denoise_all(&window);
        for (found, expected) in images.values().iter().zip(truth.values()) {
            assert!(*found > 0.1 * expected, "{found}, not {expected}");
        }
    }

    /// Direct light comes in a few samples, like that of a sun among the texels of a sky. A guide favours bright
    /// samples of its own half. The edges that this makes must not count as edges of the light.
    #[test]
    fn direct_light_of_few_samples_has_no_edges_of_its_own() {
        let (mut window, truth) = room((96, 80), 0.0);
        in_few_samples(&mut window.direct, 6, 6, [6.0, 0.0]);
        let error = squared_error(&denoise_all(&window), &truth);
        let light = squared_error(&truth, &ImageRows::zeros(96, 80, 3 * CLUSTERS));
        // 0.020; if both halves were weighted by the guides of all samples, 0.116.
        assert!(error < 0.05 * light, "{error} of {light}");
    }

    /// Behind smooth glass a random part of a pixel's samples sees the reflection, and neighbours differ in how many
    /// do.
    #[test]
    fn the_albedo_of_few_samples_brings_no_grain_back_through_glass() {
        let (mut window, truth) = room((48, 40), 0.0);
        let mut random = Pcg64Mcg::seed_from_u64(7);
        for y in 0..40 {
            for x in 0..48 {
                let grain = 1.0 + 0.1 * (random.random::<f32>() - 0.5) * 12f32.sqrt();
                let variance = (0.1 * window.features.row(0, y)[x]).powi(2);
                (0..3).for_each(|channel| window.feature_variance.row_mut(channel, y)[x] = variance);
                let scale = |rows: &mut ImageRows, planes: usize| {
                    (0..planes).for_each(|plane| rows.row_mut(plane, y)[x] *= grain);
                };
                scale(&mut window.features, 3);
                scale(&mut window.direct, 6 * CLUSTERS);
                scale(&mut window.indirect, 6 * CLUSTERS);
            }
        }
        let mut through = window.clone();
        (0..40).for_each(|y| through.features.row_mut(8, y).fill(1.0));
        let [found, without] = [&through, &window].map(|window| squared_error(&denoise_all(window), &truth));
        assert!(found < 0.2 * without, "{found}, without glass {without}");
    }

    /// Pixels on the edge of two surfaces see parts of both, and may be averaged with either.
    #[test]
    fn the_edge_of_two_surfaces_keeps_no_grain() {
        let (mut window, _) = room((48, 40), 0.5);
        let edge = 20;
        let share = |x: usize| (x * 5 % 12) as f32 / 12.0;
        for x in 0..48 {
            let (floor, wall) = (share(x), 1.0 - share(x));
            let albedo = 0.8 * floor + 0.4 * wall;
            let seen = [albedo, albedo, albedo, 0.0, floor, wall];
            seen.iter().enumerate().for_each(|(plane, &v)| window.features.row_mut(plane, edge)[x] = v);
        }
        let grain = |window: &Window| -> f32 {
            let images = denoise_all(window);
            let light = |x: usize| images.row(0, edge)[x] / window.features.row(0, edge)[x];
            (18..47).map(|x| (light(x + 1) - light(x)).powi(2)).sum()
        };
        let certain = grain(&window);
        let samples = 16.0;
        for x in 0..48 {
            let variance = share(x) * (1.0 - share(x)) / samples;
            (4..6).for_each(|plane| window.feature_variance.row_mut(plane, edge)[x] = variance);
        }
        let known = grain(&window);
        assert!(known < 0.5 * certain, "{known}, as one surface {certain}");
    }

    /// A lamp's housing against a ceiling: the black part of a pixel on the edge says nothing of the light on the rest.
    #[test]
    fn what_is_black_takes_no_light_from_the_edge_beside_it() {
        let (mut window, mut truth) = room((48, 40), 1.0);
        let (edge, housing) = (30, 31..34);
        let black = |x: usize, y: usize| if y == edge { (x * 5 % 12) as f32 / 11.0 } else { 1.0 };
        for y in edge..housing.end {
            for x in 0..48 {
                let lit = 1.0 - black(x, y);
                let darken = |rows: &mut ImageRows, planes: Range<usize>| {
                    planes.for_each(|plane| rows.row_mut(plane, y)[x] *= lit);
                };
                darken(&mut window.features, 0..3);
                darken(&mut window.direct, 0..6 * CLUSTERS);
                darken(&mut window.indirect, 0..6 * CLUSTERS);
                darken(&mut truth, 0..3 * CLUSTERS);
                (0..3).for_each(|channel| window.feature_variance.row_mut(channel, y)[x] = lit * (1.0 - lit) / 16.0);
            }
        }
        let images = denoise_all(&window);
        let light = |rows: &ImageRows| rows.row(0, edge)[18..47].iter().sum::<f32>();
        let kept = light(&images) / light(&truth);
        assert!((0.97..1.03).contains(&kept), "{kept} of the edge's light");
    }

    /// On an edge a pixel may see a small part of each surface, and be like none of its neighbours.
    #[test]
    fn a_pixel_like_no_other_does_not_keep_its_grain() {
        let (mut window, _) = room((48, 40), 0.3);
        (3..6).for_each(|plane| window.features.row_mut(plane, 30)[20] = 0.6);
        for light in [&mut window.direct, &mut window.indirect] {
            (0..3).for_each(|channel| light.row_mut(channel, 30)[20] += 5.0);
        }
        let images = denoise_all(&window);
        let (found, beside) = (images.row(0, 30)[20], images.row(0, 30)[23]);
        assert!((found - beside).abs() < 2.0, "{found}, and {beside} beside it");
    }

    /// A vertical strip of mirror, whose albedo the samples know badly.
    fn mirrored(size: (usize, usize)) -> Window {
        let (mut window, _) = room(size, 0.5);
        for y in 0..size.1 {
            window.features.row_mut(8, y)[10..20].fill(1.0);
            (0..3).for_each(|channel| window.feature_variance.row_mut(channel, y)[10..20].fill(0.01));
        }
        window
    }

    #[test]
    fn images_do_not_depend_on_how_many_rows_are_denoised_at_once() {
        let window = mirrored((40, 330));
        let guides = guides(&window);
        for reach in REACHES {
            let whole = denoise_in_steps(&window, &window.features.whole(), &guides, 330, reach);
            for block in [32, 50, 128] {
                let denoised = denoise_in_steps(&window, &window.features.whole(), &guides, block, reach);
                assert_eq!(denoised.images, whole.images, "blocks of {block}, {reach:?}");
            }
            // A part of it whose surroundings lie within the image.
            let part = Region { x: 0..40, y: 150..200 };
            let denoised = denoise_in_steps(&window, &part, &guides, 32, reach);
            for y in part.y {
                (0..3 * CLUSTERS)
                    .for_each(|plane| assert_eq!(denoised.images.row(plane, y), whole.images.row(plane, y)));
            }
        }
    }

    #[test]
    fn memory_is_no_more_than_what_is_said() {
        let (width, block) = (40, 32);
        let (window, _) = room((width, 500), 0.5);
        let guides = guides(&window);
        for reach in REACHES {
            let pool = Pool::default();
            let groups = (0..CLUSTERS as u16).collect();
            let region = window.features.whole();
            let whole =
                DenoisedRegion { size: (width, 500), block, region, features: 10, groups, origin: ImageOrigin::Traced };
            let mut denoising = Denoiser::new(whole, reach, &guides, &pool);
            let said = Denoiser::bytes_across(reach, CLUSTERS, 10, block) as usize * width;
            while let Some(wanted) = denoising.wants() {
                // Mirrors everywhere, so that the filtered albedo is held as well.
                denoising.strips(&wanted, &[wanted.start]).into_iter().for_each(|strip| strip.features.fill(1.0));
                let denoised = denoising.denoise(&wanted);
                denoised.keep_in(&pool);
                let held = denoising.held_bytes() + pool.bytes();
                assert!(held <= said, "{held} of {said} at {wanted:?}");
                assert!(held > said / 3, "{said} for {held}");
            }
        }
    }

    #[test]
    fn windows_and_threads_give_the_same_images() {
        let size = (190, 24);
        let window = mirrored(size);
        let guides = guides(&window);
        let whole = denoise(window.clone(), &window.features.whole(), &guides).images;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        assert_eq!(pool.install(|| denoise(window.clone(), &window.features.whole(), &guides).images), whole);
        // Its right part, with the halo it needs.
        let (inside, left) = (130, 130 - REACH.halo());
        let cut = |rows: &ImageRows| {
            let mut part = ImageRows::zeros(size.0 - left, size.1, rows.planes());
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
        let part = denoise(part, &Region { x: inside - left..size.0 - left, y: 0..size.1 }, &guides).images;
        for plane in 0..whole.planes() {
            for y in 0..size.1 {
                assert_eq!(part.row(plane, y)[inside - left..], whole.row(plane, y)[inside..], "row {y}");
            }
        }
    }
}
