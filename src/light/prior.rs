//! The lighting prior: a covariance over the columns, and the lightings by which results are evaluated.
//!
//! The error that matters is that of relit images. If `K = E[ℓ ℓᵀ]` over the lightings that will be used, the expected
//! squared error of a block `A` replaced by `B` is `‖(A − B) K^½‖²`. So compression weighs the columns by `K`.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::{LightBasis, LightKind, Lighting};

/// Weight of "everything on" in the mixture of [`LightingPrior::of_basis`].
const ALL_ON: f64 = 0.3;
/// Weight of "one whole light on", where there are several.
const ONE_LIGHT: f64 = 0.15;
/// Soft shapes: (weight, width as a fraction of the light).
const SHAPES: [(f64, f64); 3] = [(0.2, 0.35), (0.1, 0.12), (0.05, 0.04)];
/// Weight of independent columns, times the number of columns.
const WHITE_TIMES_COLUMNS: f64 = 2.0;
/// Bounds on the weight of independent columns: the lower one for texels by the thousand, the upper one for lamps that
/// are switched one by one.
const WHITE_BOUNDS: (f64, f64) = (0.002, 0.3);
/// Columns of the factor; what it does not reach is counted as independent.
const FACTOR_WIDTH: usize = 128;
/// Share of a light in the image with all on below which its own image is not exposed any brighter: a street lamp by day has 10⁻⁴.
const MIN_SHARE: f64 = 1e-5;
/// Number of lamps that a textured light counts for if each light alone is weighted. It is above 1 because users paint
/// textured lights instead of switching them. Tuned: decision 37.
const PAINTED: f64 = 4.0;
/// Entries of the factor, at most.
const FACTOR_ENTRIES: usize = 1 << 26;

/// A covariance of lightings as `K = F Fᵀ + diag(d)`, with a mean diagonal of 1.
#[derive(Clone, Debug, PartialEq)]
pub struct LightingPrior {
    columns: usize,
    /// `F`: columns × width, column-major.
    factor: Vec<f32>,
    /// `d`: one value per column.
    independent: Vec<f32>,
    white_square: Option<f64>,
}

/// Where a column stands among those that shapes of light can cover together.
struct Site {
    /// Columns of one group are lit by common shapes: the texels of one light, or all positioned lamps.
    group: u32,
    /// Place inside the group, scaled so that the group has an extent of about 1.
    place: [f64; 3],
}

impl LightingPrior {
    /// The prior of a basis: all on, each light alone, Gaussian shapes of 0.35, 0.12 and 0.04 of a light's extent, and
    /// single columns. Lamps are covered by shapes in space (groups of neighbours) and are switched singly.
    pub fn of_basis(basis: &LightBasis) -> Self {
        Self::of_sites(&sites(basis), &|_, _| 1.0)
    }

    /// The same, of single columns that stand at these places, in a space of extent 1.
    pub fn of_places(places: &[[f64; 3]]) -> Self {
        Self::of_sites(&places.iter().map(|&place| Site { group: 0, place }).collect::<Vec<_>>(), &|_, _| 1.0)
    }

    /// The prior of these sites, the covariance of each two (and of each with itself) multiplied by `times`.
    fn of_sites(sites: &[Site], times: &dyn Fn(&Site, &Site) -> f64) -> Self {
        let groups = sites.iter().map(|site| site.group + 1).max().unwrap_or(0);
        let one_light = if groups > 1 { ONE_LIGHT } else { 0.0 };
        let white = (WHITE_TIMES_COLUMNS / sites.len().max(1) as f64).clamp(WHITE_BOUNDS.0, WHITE_BOUNDS.1);
        let total = ALL_ON + one_light + SHAPES.iter().map(|s| s.0).sum::<f64>() + white;
        let smooth = |a: &Site, b: &Site| {
            let mut sum = ALL_ON;
            if a.group == b.group {
                let d2: f64 = (0..3).map(|k| (a.place[k] - b.place[k]).powi(2)).sum();
                sum += one_light;
                sum += SHAPES.iter().map(|(weight, width)| weight * (-0.5 * d2 / (width * width)).exp()).sum::<f64>();
            }
            times(a, b) * sum / total
        };
        let (factor, rest) = pivoted_cholesky(sites, smooth);
        let independent =
            rest.iter().zip(sites).map(|(r, site)| (r + times(site, site) * white / total) as f32).collect();
        Self { columns: sites.len(), factor, independent, white_square: None }
    }

    /// The prior with each light alone added, exposed as all of them together are. An image under one lamp counts as
    /// much as one under all, however little of it is visible. A textured light alone gets every lighting of its
    /// texels' prior. `shares` are the lights' shares of the brightness of the image with all on. With a single light
    /// nothing changes.
    ///
    /// # Panics
    /// If there are not as many shares as lights.
    pub fn of_lights_alone(basis: &LightBasis, shares: &[f64]) -> Self {
        let lights = basis.lights();
        assert_eq!(lights.len(), shares.len());
        if lights.len() < 2 {
            return Self::of_basis(basis);
        }
        let sites = sites(basis);
        // How much more a light counts by being alone; sites of a group of texels are those of one light.
        // A light that does not reach the image has no error there.
        let of_share =
            |&share: &f64| if share > 0.0 { share.max(MIN_SHARE).powi(-2) / lights.len() as f64 } else { 0.0 };
        let added: Vec<f64> = shares.iter().map(of_share).collect();
        let mut painted = vec![0.0; sites.iter().map(|site| site.group as usize + 1).max().unwrap_or(0)];
        for (light, added) in lights.iter().zip(&added).filter(|(light, _)| light.places.len() > 1) {
            painted[sites[light.columns().start as usize].group as usize] = PAINTED * added;
        }
        let times = |a: &Site, b: &Site| if a.group == b.group { 1.0 + painted[a.group as usize] } else { 1.0 };
        let mut prior = Self::of_sites(&sites, &times);
        for (light, &added) in lights.iter().zip(&added).filter(|(light, _)| light.places.len() == 1) {
            prior.independent[light.columns().start as usize] += added as f32;
        }
        prior.scaled().with_white(basis, shares)
    }

    /// This, with a mean diagonal of 1.
    fn scaled(mut self) -> Self {
        let variances = self.variances();
        let scale = variances.len() as f32 / variances.iter().sum::<f32>();
        self.factor.iter_mut().for_each(|f| *f *= scale.sqrt());
        self.independent.iter_mut().for_each(|d| *d *= scale);
        self
    }

    /// This, of which it is known how white its lightings are: the square of the mean of an image, as the lights' shares make it.
    fn with_white(mut self, basis: &LightBasis, shares: &[f64]) -> Self {
        let of_columns = basis.lights().iter().zip(shares).flat_map(|(light, share)| {
            let each = share / light.places.len() as f64;
            light.places.iter().map(move |_| each)
        });
        let of_columns: Vec<f64> = of_columns.collect();
        self.white_square = Some(self.energy(&of_columns));
        self
    }

    /// `wᵀ K w`.
    pub(crate) fn energy(&self, weights: &[f64]) -> f64 {
        let sum = |values: &[f32]| values.iter().zip(weights).map(|(&v, w)| f64::from(v) * w).sum::<f64>();
        let independent: f64 = self.independent.iter().zip(weights).map(|(&d, w)| f64::from(d) * w * w).sum();
        independent + self.factor.chunks_exact(self.columns.max(1)).map(|column| sum(column).powi(2)).sum::<f64>()
    }

    /// Every column equally likely and independent: plain least squares.
    pub fn flat(columns: usize) -> Self {
        Self { columns, factor: Vec::new(), independent: vec![1.0; columns], white_square: None }
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Number of columns of the factor `F`.
    pub fn width(&self) -> usize {
        self.factor.len().checked_div(self.columns).unwrap_or(0)
    }

    /// `F`: columns × width, column-major.
    pub fn factor(&self) -> &[f32] {
        &self.factor
    }

    /// `d`: one value per column.
    pub fn independent(&self) -> &[f32] {
        &self.independent
    }

    /// Squared white of a lighting in the mean, over that of all columns on; where it is known.
    pub fn white_square(&self) -> Option<f64> {
        self.white_square
    }

    /// The diagonal of `K`: how strongly each column is lit, squared, in the mean.
    pub fn variances(&self) -> Vec<f32> {
        let mut sum = self.independent.clone();
        for column in self.factor.chunks_exact(self.columns.max(1)) {
            sum.iter_mut().zip(column).for_each(|(s, f)| *s += f * f);
        }
        sum
    }

    /// `count` normal draws of a lighting with covariance `K`: columns × count, column-major.
    pub fn draws(&self, count: usize, seed: u64) -> Vec<f32> {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut draws = Vec::with_capacity(self.columns * count);
        for _ in 0..count {
            let begin = draws.len();
            draws.extend(self.independent.iter().map(|d| d.sqrt() * normal(&mut random)));
            for column in self.factor.chunks_exact(self.columns.max(1)) {
                let g = normal(&mut random);
                draws[begin..].iter_mut().zip(column).for_each(|(s, f)| *s += g * f);
            }
        }
        draws
    }
}

/// A standard normal number (Box and Muller 1958).
fn normal(random: &mut Pcg64Mcg) -> f32 {
    let radius = (-2.0 * (1.0 - random.random::<f64>()).ln()).sqrt();
    (radius * (std::f64::consts::TAU * random.random::<f64>()).cos()) as f32
}

fn sites(basis: &LightBasis) -> Vec<Site> {
    let directed = |kind| kind == LightKind::Sun;
    let single = |places: &[[f32; 3]]| places.len() == 1;
    let mut sites = Vec::with_capacity(basis.column_count());
    // Lamps share a group each for places and for directions, scaled by their common extent.
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for light in basis.lights().iter().filter(|l| single(&l.places) && !directed(l.kind)) {
        for k in 0..3 {
            low[k] = low[k].min(f64::from(light.places[0][k]));
            high[k] = high[k].max(f64::from(light.places[0][k]));
        }
    }
    let extent = (0..3).map(|k| high[k] - low[k]).fold(1e-30, f64::max);
    let (mut lamps, mut suns, mut groups) = (None, None, 0);
    let mut next_group = || {
        groups += 1;
        groups - 1
    };
    for light in basis.lights() {
        let (across, down) = light.layout();
        let group = match (single(&light.places), directed(light.kind)) {
            (true, true) => *suns.get_or_insert_with(&mut next_group),
            (true, false) => *lamps.get_or_insert_with(&mut next_group),
            (false, _) => next_group(),
        };
        for (texel, place) in light.places.iter().enumerate() {
            let place = place.map(f64::from);
            let place = match light.kind {
                LightKind::AreaTexels { .. } => {
                    let (u, v) = (texel as u32 % across, texel as u32 / across);
                    [(f64::from(u) + 0.5) / f64::from(across), (f64::from(v) + 0.5) / f64::from(down), 0.0]
                }
                // Directions lie on a sphere of diameter 1.
                LightKind::LatLong { .. }
                | LightKind::Octahedral { .. }
                | LightKind::Patches { .. }
                | LightKind::Sun
                | LightKind::Suns { .. } => {
                    let norm = place.iter().map(|v| v * v).sum::<f64>().sqrt().max(1e-30);
                    place.map(|v| 0.5 * v / norm)
                }
                LightKind::Lamp | LightKind::Point | LightKind::Spot | LightKind::Ies | LightKind::Image => {
                    [0, 1, 2].map(|k| (place[k] - low[k]) / extent)
                }
            };
            sites.push(Site { group, place });
        }
    }
    sites
}

/// Cholesky factorisation with the largest remaining variance as pivot, stopped after [`FACTOR_WIDTH`] columns
/// (Harbrecht, Peters, Schneider 2012): `K ≈ F Fᵀ`, and the variances that are left.
fn pivoted_cholesky(sites: &[Site], kernel: impl Fn(&Site, &Site) -> f64) -> (Vec<f32>, Vec<f64>) {
    let n = sites.len();
    let width = FACTOR_WIDTH.min(n).min(FACTOR_ENTRIES / n.max(1)).max(1);
    let mut rest: Vec<f64> = sites.iter().map(|s| kernel(s, s)).collect();
    let mut factor: Vec<f32> = Vec::with_capacity(n * width);
    for done in 0..width.min(n) {
        let (pivot, &variance) = rest.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).expect("n is not 0");
        if variance < 1e-6 {
            break;
        }
        let mut column: Vec<f64> = sites.iter().map(|s| kernel(s, &sites[pivot])).collect();
        for k in 0..done {
            let earlier = &factor[k * n..][..n];
            let at_pivot = f64::from(earlier[pivot]);
            column.iter_mut().zip(earlier).for_each(|(c, &e)| *c -= at_pivot * f64::from(e));
        }
        let scale = variance.sqrt();
        for (c, r) in column.iter_mut().zip(&mut rest) {
            *c /= scale;
            *r = (*r - *c * *c).max(0.0);
        }
        rest[pivot] = 0.0;
        factor.extend(column.iter().map(|&c| c as f32));
    }
    (factor, rest)
}

/// The twelve lightings by which a compressed matrix is evaluated, with their names. Eight are smooth or coarse: all
/// on, the scene's own, two gradients, one half, two wide soft spots in colour, a wide spot, a coarse coloured pattern.
/// Four are narrow: a spot (width 0.06 of the light), a tiny one (0.04), a single column, and every column at random.
/// Each acts on all lights at once; positions and colours are drawn from `seed`.
///
/// # Panics
/// Never: the weights are finite.
pub fn evaluation_lightings(basis: &LightBasis, seed: u64) -> Vec<(&'static str, Lighting)> {
    let sites = sites(basis);
    let mut random = Pcg64Mcg::seed_from_u64(seed ^ 0x6576_616c);
    let groups = sites.iter().map(|site| site.group as usize + 1).max().unwrap_or(0);
    let centres: Vec<[f64; 3]> = (0..8 * groups)
        .map(|i| {
            let members: Vec<&Site> = sites.iter().filter(|s| s.group as usize == i % groups).collect();
            members[random.random_range(0..members.len())].place
        })
        .collect();
    let spot = |which: usize, width: f64, site: &Site| {
        let centre = centres[which * groups + site.group as usize];
        let d2: f64 = (0..3).map(|k| (site.place[k] - centre[k]).powi(2)).sum();
        (-0.5 * d2 / (width * width)).exp() as f32
    };
    let palette: Vec<[f32; 3]> = (0..64).map(|_| [0; 3].map(|_| random.random_range(0.1..1.0))).collect();
    let single = random.random_range(0..sites.len().max(1));
    let noise: Vec<[f32; 3]> = sites.iter().map(|_| [random.random::<f32>(); 3]).collect();
    let grey = |v: f32| [v; 3];
    let lighting = |weight: &dyn Fn(usize, &Site) -> [f32; 3]| {
        Lighting::new(sites.iter().enumerate().map(|(j, s)| weight(j, s)).collect()).expect("finite weights")
    };
    let mixed = |a: f32, b: f32| [a + 0.2 * b, 0.6 * a + 0.5 * b, 0.2 * a + b];
    vec![
        ("all on", lighting(&|_, _| grey(1.0))),
        ("of the scene", Lighting::of_scene(basis)),
        ("gradient across", lighting(&|_, s| grey((s.place[0] as f32).abs()))),
        ("gradient down", lighting(&|_, s| grey((s.place[1] as f32).abs()))),
        ("half", lighting(&|_, s| grey(if s.place[0] + s.place[2] > 0.4 { 1.0 } else { 0.0 }))),
        ("two soft spots", lighting(&|_, s| mixed(spot(0, 0.25, s), spot(1, 0.25, s)))),
        ("wide spot", lighting(&|_, s| grey(spot(2, 0.15, s)))),
        (
            "coarse pattern",
            lighting(&|_, s| palette[s.place.iter().fold(0, |i, p| i * 4 + ((p * 4.0) as i64).rem_euclid(4) as usize)]),
        ),
        ("narrow spot", lighting(&|_, s| grey(spot(3, 0.06, s)))),
        ("tiny spot", lighting(&|_, s| grey(spot(4, 0.04, s)))),
        ("one column", lighting(&|j, _| grey(if j == single { 1.0 } else { 0.0 }))),
        ("random columns", lighting(&|j, _| noise[j])),
    ]
}

#[cfg(test)]
mod tests {
    use super::super::{Light, LightUnit};
    use super::*;

    fn panel(across: u32, down: u32) -> LightBasis {
        let columns = (across * down) as usize;
        let mut basis = LightBasis::new();
        basis
            .push(Light {
                name: "panel".into(),
                kind: LightKind::AreaTexels { across, down },
                unit: LightUnit::Radiance,
                emission: [1.0; 3],
                first_column: 0,
                places: vec![[0.0; 3]; columns],
                extents: vec![1.0; columns],
            })
            .unwrap();
        basis
    }

    fn with(lights: &[(&str, LightKind)]) -> LightBasis {
        let mut basis = LightBasis::new();
        for &(name, kind) in lights {
            basis.push(Light::unplaced(name, kind)).unwrap();
        }
        basis
    }

    /// What is new of an error of a hundredth of a lighting's light, in the scale of the prior before.
    fn added(basis: &LightBasis, shares: &[f64], lighting: &[f64]) -> f64 {
        let (before, prior) = (LightingPrior::of_basis(basis), LightingPrior::of_lights_alone(basis, shares));
        let variances = prior.variances();
        assert!((variances.iter().sum::<f32>() / variances.len() as f32 - 1.0).abs() < 1e-3, "{variances:?}");
        // What both have in common tells the scale: the covariance of different lights.
        let (first, last) = (0, variances.len() - 1);
        let covariance = |prior: &LightingPrior| {
            prior.factor().chunks_exact(prior.columns()).map(|f| f64::from(f[first] * f[last])).sum::<f64>()
        };
        prior.energy(lighting) * covariance(&before) / covariance(&prior) - before.energy(lighting)
    }

    const TEXELS: LightKind = LightKind::AreaTexels { across: 4, down: 4 };

    /// A panel, an equally bright lamp, and a lamp of which a hundredth is visible. Alone, an error of a hundredth of
    /// each light counts the same; under the panel it counts four times as much in each of its lightings.
    #[test]
    fn each_light_alone_counts_as_exposed_as_all_together() {
        let basis = with(&[("panel", TEXELS), ("near", LightKind::Lamp), ("far", LightKind::Lamp)]);
        let shares = [0.495, 0.495, 0.01];
        for lamp in [1, 2] {
            let mut error = vec![0.0; 18];
            error[15 + lamp] = 0.01 * shares[lamp];
            let added = added(&basis, &shares, &error);
            assert!((added / (1e-4 / 3.0) - 1.0).abs() < 1e-2, "{added}");
        }
        for texels in [vec![1.0 / 16.0; 16], [vec![0.125; 8], vec![0.0; 8]].concat()] {
            let lighting = [texels, vec![0.0; 2]].concat();
            let expected = PAINTED * 1e-4 / 3.0 * LightingPrior::of_basis(&basis).energy(&lighting);
            let error: Vec<f64> = lighting.iter().map(|l| 0.01 * 0.495 * l).collect();
            let added = added(&basis, &shares, &error);
            assert!((added / expected - 1.0).abs() < 1e-2, "{added} over {expected}");
        }
        // Of one light there is nothing to choose between.
        assert_eq!(LightingPrior::of_lights_alone(&panel(4, 4), &[1.0]), LightingPrior::of_basis(&panel(4, 4)));
    }

    /// A lamp in another room has no image to be seen alone.
    #[test]
    fn a_light_that_does_not_reach_the_image_takes_no_weight() {
        let basis = with(&[("near", LightKind::Lamp), ("far", LightKind::Lamp), ("outside", LightKind::Lamp)]);
        let weights = |outside: f64| {
            let variances = LightingPrior::of_lights_alone(&basis, &[0.9, 0.1, outside]).variances();
            [variances[0], variances[1], variances[2]]
        };
        let dark = weights(0.0);
        assert!(dark[1] > 10.0 * dark[0] && dark[2] < dark[0], "{dark:?}");
        let faint = weights(1e-3);
        assert!(faint[2] > 1000.0 * faint[1], "{faint:?}");
    }

    /// Lights that are alike leave each other's covariance alone, and count alone as much as one among others.
    #[test]
    fn of_two_panels_each_alone_counts_too() {
        let (basis, shares) = (with(&[("left", TEXELS), ("right", TEXELS)]), [0.5, 0.5]);
        let lighting = [vec![1.0 / 16.0; 16], vec![0.0; 16]].concat();
        let before = LightingPrior::of_basis(&basis).energy(&lighting);
        let added = added(&basis, &shares, &lighting.iter().map(|l| 0.01 * 0.5 * l).collect::<Vec<_>>());
        assert!((added / (PAINTED * 1e-4 / 2.0 * before) - 1.0).abs() < 1e-2, "{added}");
        let even = vec![1.0 / 32.0; 32];
        let prior = LightingPrior::of_lights_alone(&basis, &shares);
        assert!((prior.white_square().unwrap() / prior.energy(&even) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_prior_is_normalised_and_its_draws_have_its_covariance() {
        let prior = LightingPrior::of_basis(&panel(8, 6));
        let variances = prior.variances();
        assert!(variances.iter().all(|v| (v - 1.0).abs() < 1e-3), "{variances:?}");
        // 4,000 draws: a standard error of √(2 / 4000) = 0.022 on each; four of them.
        let draws = prior.draws(4000, 1);
        let second = |i: usize, j: usize| draws.chunks_exact(48).map(|d| f64::from(d[i] * d[j])).sum::<f64>() / 4000.0;
        let f = |i: usize, j: usize| prior.factor().chunks_exact(48).map(|c| f64::from(c[i] * c[j])).sum::<f64>();
        assert!((second(3, 3) - 1.0).abs() < 0.09);
        assert!((second(3, 40) - f(3, 40)).abs() < 0.09);
        assert!(f(3, 4) > f(3, 40) && f(3, 40) > 0.3);
    }

    #[test]
    fn there_are_twelve_evaluation_lightings_and_they_differ() {
        let lightings = evaluation_lightings(&panel(16, 16), 1);
        assert_eq!(lightings.len(), 12);
        let lit = |i: usize| lightings[i].1.weights().iter().filter(|w| w[0] > 0.01).count();
        assert_eq!((lit(0), lit(10)), (256, 1));
        assert!(lit(9) < 20, "{}", lit(9));
    }
}
