//! The filter of one window of the image.

use pulp::Simd;

use super::alone::{self, Alone};
use super::constants::*;
use super::errors::{self, ErrorSums, add_squares};
use super::guide::{Guide, GuideCut, GuideWidths, mixtures, weights};
use super::kernel::{Neighbours, Offset, Offsets, Weigh, weighted_means};
use super::reach::Reach;
use super::rows::{Pool, Region, Rows};
use super::shrink::{RISK_REACH, mix_in};
use super::surfaces::{Surfaces, SurfacesCut};
use super::tally::Guides;
use super::tile::{TILE_PIXELS, Tile};

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

/// Some rows of pixels of a window, to be filled: of each row the rows of all planes.
pub struct WindowStrip<'a> {
    /// See [`Window::direct`].
    pub direct: &'a mut [f32],
    /// See [`Window::indirect`].
    pub indirect: &'a mut [f32],
    /// See [`Window::features`].
    pub features: &'a mut [f32],
    /// See [`Window::feature_variance`].
    pub feature_variance: &'a mut [f32],
}

impl Window {
    /// Of pixels across and down, with any values.
    pub fn of_size((width, height): (usize, usize), clusters: usize, features: usize, pool: &Pool) -> Self {
        let light = 2 * 3 * clusters;
        Self {
            direct: pool.rows(width, height, light),
            indirect: pool.rows(width, height, light),
            features: pool.rows(width, height, features),
            feature_variance: pool.rows(width, height, features),
        }
    }

    /// Cut before each of these rows of pixels but the first, which is row 0.
    pub fn strips_mut(&mut self, borders: &[usize]) -> Vec<WindowStrip<'_>> {
        let light = self.direct.strips_mut(borders).into_iter().zip(self.indirect.strips_mut(borders));
        let features = self.features.strips_mut(borders).into_iter().zip(self.feature_variance.strips_mut(borders));
        light
            .zip(features)
            .map(|((direct, indirect), (features, feature_variance))| WindowStrip {
                direct,
                indirect,
                features,
                feature_variance,
            })
            .collect()
    }
}

/// Bytes that [`clean`] takes at most for each pixel of a window, with what the pool keeps.
pub fn pixel_bytes(clusters: u64) -> u64 {
    // Direct and indirect light and one filter's result in two halves of three channels, the cleaned images; features, guides and
    // squares; of one cluster the three terms of the risk, in three steps; of some clusters what each by itself reads and makes.
    4 * (3 * 6 * clusters + 3 * clusters + 120 + 3 * 3 + alone::PLANES as u64)
}

/// What [`clean`] makes of a window.
#[derive(Clone, Debug, PartialEq)]
pub struct Cleaned {
    /// Three planes for each cluster, direct and indirect light together.
    pub images: Rows,
    squares: Rows,
}

impl Cleaned {
    /// What cleaning did to a part of the region that is right.
    pub fn errors(&self, region: &Region) -> ErrorSums {
        ErrorSums::of(&self.images, &self.squares, region)
    }

    /// Gives its memory back.
    pub fn keep_in(self, pool: &Pool) {
        pool.keep(self.images);
        pool.keep(self.squares);
    }
}

/// The cleaned images of the clusters. Right for a region that is [`Reach::halo`] away from the window's rim, or where the image ends
/// there; elsewhere there is anything.
pub fn clean(window: Window, region: &Region, guides: &Guides, (reach, pool): (Reach, &Pool)) -> Cleaned {
    let Window { direct, indirect, features, feature_variance } = window;
    let (width, height) = (features.width(), features.height());
    let filter = Filter { surfaces: Surfaces::new(&features, &feature_variance, pool), region, reach, pool };
    let albedo = |plane: usize, y: usize| -> Vec<f32> {
        features.row(plane % 3, y).iter().map(|a| a.max(LEAST_ALBEDO)).collect()
    };
    let planes = direct.planes() / 2;
    let mut images = pool.rows(width, height, planes);
    let mut squares = pool.rows(width, height, errors::PLANES);
    images.clear(region);
    squares.clear(region);
    for (mut light, is_direct) in [(direct, true), (indirect, false)] {
        let whole = light.whole();
        light.change_rows(&whole, |y, plane, out| out.iter_mut().zip(albedo(plane, y)).for_each(|(o, a)| *o /= a));
        let cleaned =
            if is_direct { filter.direct(&light, &guides.direct) } else { filter.indirect(&light, &guides.indirect) };
        add_squares(&light, &cleaned, albedo, region, &mut squares);
        pool.keep(light);
        images.change_rows(region, |y, plane, out| {
            let [a, b] = [plane, planes + plane].map(|plane| &cleaned.row(plane, y)[region.x.clone()]);
            let albedo = albedo(plane, y);
            let halves = a.iter().zip(b).zip(&albedo[region.x.clone()]);
            out.iter_mut().zip(halves).for_each(|(o, ((a, b), albedo))| *o += 0.5 * (a + b) * albedo);
        });
        pool.keep(cleaned);
    }
    [features, feature_variance, filter.surfaces.into_rows()].into_iter().for_each(|done| pool.keep(done));
    Cleaned { images, squares }
}

/// What filters both kinds of light.
struct Filter<'a> {
    surfaces: Surfaces,
    region: &'a Region,
    reach: Reach,
    pool: &'a Pool,
}

impl Filter<'_> {
    fn direct(&self, light: &Rows, mix: &[f32]) -> Rows {
        let filtered = self.region.grown(RISK_REACH, light);
        let guide = {
            let compared = filtered.grown(self.reach.direct() + PATCH, light);
            let pilot = compared.grown(FILTERED_NOISE_REACH, light);
            let raw_compared = pilot.grown(self.reach.direct_pilot() + PATCH, light);
            let raw = mixtures(light, mix, &raw_compared.grown(RAW_NOISE_REACH, light), self.pool);
            let widths = GuideWidths { noise: DIRECT_PILOT_NOISE, relative: DIRECT_PILOT_RELATIVE };
            let alike = self.alike(Guide::of_halves(&raw, RAW_NOISE_REACH, &raw_compared, self.pool), widths, PATCH);
            let means = weighted_means(
                &raw,
                &pilot,
                &self.reach.direct_offsets(self.reach.direct_pilot()),
                0.0,
                &alike,
                self.pool,
            );
            self.guide_of(means, &compared, [raw, alike.guide.into_rows()])
        };
        let widths = GuideWidths { noise: DIRECT_NOISE, relative: DIRECT_RELATIVE };
        let alike = Alike { radius: Some(self.reach.direct()), ..self.alike(guide, widths, PATCH) };
        let offsets = self.reach.direct_offsets(self.reach.direct());
        let means = weighted_means(light, &filtered, &offsets, SLOPE, &alike, self.pool);
        self.pool.keep(alike.guide.into_rows());
        self.trusted(light, means)
    }

    fn indirect(&self, light: &Rows, mix: &[f32]) -> Rows {
        let filtered = self.region.grown(self.reach.common(), light);
        let guide = {
            let compared = self.region.grown(self.reach.light(), light);
            let pilot = compared.grown(FILTERED_NOISE_REACH, light);
            let raw_compared = pilot.grown(self.reach.indirect() + PATCH, light);
            let raw = mixtures(light, mix, &raw_compared.grown(RAW_NOISE_REACH, light), self.pool);
            let widths = GuideWidths { noise: INDIRECT_PILOT_NOISE, relative: INDIRECT_PILOT_RELATIVE };
            let guide = Guide::of_halves(&raw, RAW_NOISE_REACH, &raw_compared, self.pool);
            let mut alike = self.alike(guide, widths, PATCH);
            let means = self.wide_then_narrow(&raw, &pilot, PILOT_SLOPE, &mut alike);
            self.guide_of(means, &compared, [raw, alike.guide.into_rows()])
        };
        let widths = GuideWidths { noise: INDIRECT_NOISE, relative: INDIRECT_RELATIVE };
        let mut alike = self.alike(guide, widths, 0);
        let mut means = self.wide_then_narrow(light, &filtered, SLOPE, &mut alike);
        self.pool.keep(alike.guide.into_rows());
        let alone = Alone {
            surfaces: &self.surfaces,
            widths: GuideWidths { noise: ALONE_NOISE, relative: ALONE_RELATIVE },
            slope: ALONE_SLOPE,
            offsets: self.reach.alone(),
        };
        alone.filter(&mut means, &self.region.grown(RISK_REACH, light), self.pool);
        self.trusted(light, means)
    }

    /// A wide filter that reads some of the pixels, then a narrow one that reads all.
    fn wide_then_narrow(&self, light: &Rows, region: &Region, slope: f32, alike: &mut Alike<'_>) -> Rows {
        let offsets = Offsets::disc(self.reach.wide(), self.reach.stride);
        alike.radius = Some(self.reach.wide());
        let wide = weighted_means(light, &region.grown(INDIRECT_NARROW, light), &offsets, slope, &*alike, self.pool);
        let offsets = Offsets::disc(INDIRECT_NARROW, 1);
        alike.radius = Some(INDIRECT_NARROW);
        let narrow = weighted_means(&wide, region, &offsets, slope, &*alike, self.pool);
        self.pool.keep(wide);
        narrow
    }

    fn alike(&self, guide: Guide, widths: GuideWidths, patch: usize) -> Alike<'_> {
        Alike { surfaces: &self.surfaces, guide, widths, patch, radius: None }
    }

    /// The guide that filtered mixtures make; what made them is done with.
    fn guide_of(&self, means: Rows, compared: &Region, done: [Rows; 2]) -> Guide {
        let guide = Guide::of_halves(&means, FILTERED_NOISE_REACH, compared, self.pool);
        [means].into_iter().chain(done).for_each(|done| self.pool.keep(done));
        guide
    }

    /// The means as far as they may be trusted beside the light that they are of.
    fn trusted(&self, light: &Rows, mut means: Rows) -> Rows {
        mix_in(light, &mut means, self.region, self.pool);
        means
    }
}

/// Weights by the guide, compared over patches, by what is seen, and by the distance within a radius.
struct Alike<'a> {
    surfaces: &'a Surfaces,
    guide: Guide,
    widths: GuideWidths,
    patch: usize,
    radius: Option<usize>,
}

impl Weigh for Alike<'_> {
    type Ready = (GuideCut, SurfacesCut);

    fn ready(&self, tile: Tile, reach: usize) -> Self::Ready {
        (self.guide.around(tile, reach, self.patch), self.surfaces.around(tile, reach))
    }

    #[inline(always)]
    fn weigh<S: Simd>(
        &self,
        simd: S,
        (guide, surfaces): &mut Self::Ready,
        Neighbours { offset, .. }: Neighbours,
        out: &mut [f32; TILE_PIXELS],
    ) {
        guide.distances(simd, offset, &self.widths, out);
        let near = self.radius.map_or(0.0, |radius| nearness(offset, radius));
        for distance in out.iter_mut() {
            *distance = distance.max(0.0) + near;
        }
        surfaces.add_distances(simd, offset, out);
        weights(out);
    }
}

pub(super) fn nearness((across, down): Offset, radius: usize) -> f32 {
    let width = radius as f32 * NEARNESS;
    (across * across + down * down) as f32 / (2.0 * width * width)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::super::Tally;
    use super::*;

    const CLUSTERS: usize = 2;
    const REACH: Reach = Reach { stride: 3 };

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
        let halves = |light: &Rows| {
            let plane = |plane| (0..light.height()).flat_map(move |y| light.row(plane, y).to_vec());
            [0, 1].map(|half| (half * 3 * CLUSTERS..(half + 1) * 3 * CLUSTERS).flat_map(plane).collect::<Vec<f32>>())
        };
        let (direct, indirect) = (halves(&window.direct), halves(&window.indirect));
        let mut tally = Tally::new(CLUSTERS);
        tally.add([&direct[0], &direct[1]], [&indirect[0], &indirect[1]]);
        tally.guides()
    }

    fn mean_of_halves(halves: &Rows) -> Rows {
        let planes = halves.planes() / 2;
        let mut mean = Rows::zeros(halves.width(), halves.height(), planes);
        mean.fill_rows(&halves.whole(), |y, plane, out| {
            let pairs = halves.row(plane, y).iter().zip(halves.row(planes + plane, y));
            out.iter_mut().zip(pairs).for_each(|(o, (a, b))| *o = 0.5 * (a + b));
        });
        mean
    }

    /// With memory that others have used.
    fn clean(window: Window, region: &Region, guides: &Guides) -> Cleaned {
        let pool = Pool::default();
        for planes in [1, 3, 4, 10, 12, 16, 16] {
            let mut used = Rows::zeros(window.features.width(), window.features.height(), planes);
            used.values_mut().fill(f32::NAN);
            pool.keep(used);
        }
        super::clean(window, region, guides, (REACH, &pool))
    }

    fn clean_all(window: &Window) -> Rows {
        clean(window.clone(), &window.features.whole(), &guides(window)).images
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
        let after = squared_error(&clean_all(&window), &truth);
        assert!(after < before / 15.0, "{after} of {before}");
    }

    /// What the halves say of noise and bias, against the truth.
    #[test]
    fn noise_and_bias_are_known_from_the_halves() {
        let (window, truth) = room((48, 40), 0.5);
        let region = truth.whole();
        let cleaned = clean(window.clone(), &region, &guides(&window));
        let sums = cleaned.errors(&region);
        let raw_error = squared_error(&raw(&window), &truth);
        assert!((sums.noise_before / raw_error - 1.0).abs() < 0.1, "{sums:?}, not {raw_error}");
        let error = squared_error(&cleaned.images, &truth);
        let bias = (sums.changed - sums.noise_of_change).max(0.0);
        // Of the noise that was there both are a small part, and so is the error of either.
        assert!((sums.noise_after + bias - error).abs() < 0.02 * raw_error, "{sums:?}, not {error}");
        let halves = [0..20, 20..40].map(|y| cleaned.errors(&Region { x: 0..48, y }));
        let mut both = halves[0];
        both.add(&halves[1]);
        assert!((both.light / sums.light - 1.0).abs() < 1e-9 && (both.changed / sums.changed - 1.0).abs() < 1e-9);
    }

    #[test]
    fn without_noise_nothing_changes() {
        let (window, truth) = room((48, 40), 0.0);
        let error = squared_error(&clean_all(&window), &truth);
        let norm = squared_error(&truth, &Rows::zeros(48, 40, 3 * CLUSTERS));
        assert!(error < 1e-10 * norm, "{error} of {norm}");
    }

    #[test]
    fn a_firefly_does_not_stay_where_it_is() {
        let (mut window, _) = room((48, 40), 0.3);
        let guides = guides(&window);
        (0..3).for_each(|channel| window.indirect.row_mut(channel, 30)[20] += 50.0);
        let images = clean(window.clone(), &window.features.whole(), &guides).images;
        assert!(images.row(0, 30)[20] < 3.0, "a mean of 25.8 became {}", images.row(0, 30)[20]);
    }

    /// It looks like a detail: the grain around it must not stay for that.
    #[test]
    fn a_firefly_of_both_halves_keeps_no_grain_around_it() {
        let (window, truth) = room((48, 40), 0.5);
        let guides = guides(&window);
        let mut struck = window.clone();
        for plane in [0, 1, 2, 3 * CLUSTERS, 3 * CLUSTERS + 1, 3 * CLUSTERS + 2] {
            struck.indirect.row_mut(plane, 30)[36] += 15.0;
        }
        // Light is even there: what neighbours differ by is grain.
        let grain = |window: Window| -> f32 {
            let images = clean(window, &truth.whole(), &guides).images;
            let pairs =
                |y: usize| images.row(0, y)[38..43].windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum::<f32>();
            (24..37).map(pairs).sum()
        };
        let (with, without) = (grain(struck), grain(window));
        assert!(with < 3.0 * without, "{with}, without the firefly {without}");
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
        let kept = sum(&clean_all(&window)) / before;
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
        let images = clean_all(&window);
        let (found, beside) = (images.row(0, 30)[20], images.row(0, 30)[23]);
        assert!((found - beside).abs() < 2.0, "{found}, and {beside} beside it");
    }

    #[test]
    fn windows_and_threads_give_the_same_images() {
        let size = (190, 24);
        let (window, _) = room(size, 0.5);
        let guides = guides(&window);
        let whole = clean(window.clone(), &window.features.whole(), &guides).images;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        assert_eq!(pool.install(|| clean(window.clone(), &window.features.whole(), &guides).images), whole);
        // Its right part, with as much around it as is needed.
        let (inside, left) = (130, 130 - REACH.halo());
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
        let part = clean(part, &Region { x: inside - left..size.0 - left, y: 0..size.1 }, &guides).images;
        for plane in 0..whole.planes() {
            for y in 0..size.1 {
                assert_eq!(part.row(plane, y)[inside - left..], whole.row(plane, y)[inside..], "row {y}");
            }
        }
    }
}
