//! Planes of a block: features, and direct and indirect light of clusters, summed while a pixel's samples are traced.
//!
//! Their cost, and why not every column has them: decision 25.

use glam::Vec3;

use super::accumulator::{PixelSums, RUN, Run};
use crate::light::Clusters;
use crate::matrix::{BlockPlanes, CHANNELS, FEATURE_PLANES, Feature, SeenEmission};

/// Relative standard deviation of a pixel's albedo above which further camera rays look at it, and the largest number
/// of such rays. Tuned: decision 51.
const ALBEDO_NOISE: f32 = 0.01;
const MAX_FURTHER: u32 = 48;

/// How light reached the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LightPath {
    /// Emission seen straight, or by mirrors and smooth glass only.
    Emission,
    /// Scattered once; the light reached that surface straight or through thin sheets.
    Direct,
    /// All other paths.
    Indirect,
}

/// The features of one sample at its first non-specular vertex. Where surfaces before that let a part of the light through, all but the
/// albedo that the sample's own light met are those of all these surfaces, each with its share: which of them a path meets is chance.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SampleFeatures {
    /// Of the surface that the path met.
    pub(super) albedo: Vec3,
    /// Of all surfaces.
    pub(super) pixel_albedo: Vec3,
    pub(super) normal: Vec3,
    pub(super) depth: f32,
    pub(super) sees_emitter: bool,
    pub(super) specular: bool,
    /// Share of surfaces that scatter or absorb.
    pub(super) surface: f32,
    /// Number of the material of the largest share, from 1 on.
    pub(super) material: u32,
    /// That share.
    pub(super) largest: f32,
    /// Whether all surfaces are in already.
    pub(super) is_whole: bool,
}

impl SampleFeatures {
    #[inline(always)]
    fn values(&self) -> [f32; FEATURE_PLANES] {
        let share = |is: bool| if is { 1.0 } else { 0.0 };
        let (a, n, all) = (self.albedo, self.normal, self.pixel_albedo);
        let [emitter, specular] = [self.sees_emitter, self.specular].map(share);
        let material = self.material as f32;
        [a.x, a.y, a.z, n.x, n.y, n.z, self.depth, emitter, specular, self.surface, material, all.x, all.y, all.z]
    }
}

/// Light of one cluster in one pixel: by half, then direct and indirect; RGB and padding.
type ClusterLight = [[[f32; 4]; 2]; 2];

/// Sums over the samples of one pixel, the clusters of the columns, and the means of a run of pixels.
pub(super) struct PlaneSums<'a> {
    of_column: &'a [u16],
    /// Factor on each column before clusters are summed; empty if all are 1.
    factors: &'a [f32],
    light: Vec<ClusterLight>,
    emission: PixelSums,
    features: FeatureSums,
    /// Those and the features of further camera rays; none if there were none.
    further: FeatureSums,
    /// Planes of the run. Light is ordered by half, direct before indirect, then cluster and channel; then come
    /// features and their variances. A pixel's values lie pages apart in the block, and each visit to a page costs more
    /// than what is written there.
    lines: Vec<[f32; RUN]>,
    /// Number of pixels already copied into the block.
    carried: usize,
}

/// Sums of features as differences from the first sample, so that squares of large depths keep their precision.
#[derive(Clone, Copy, Debug, Default)]
struct FeatureSums {
    first: [f32; FEATURE_PLANES],
    sum: [f32; FEATURE_PLANES],
    squares: [f32; FEATURE_PLANES],
    count: u32,
}

impl FeatureSums {
    #[inline(always)]
    fn add(&mut self, values: [f32; FEATURE_PLANES]) {
        if self.count == 0 {
            self.first = values;
        }
        for (plane, value) in values.into_iter().enumerate() {
            let difference = value - self.first[plane];
            self.sum[plane] += difference;
            self.squares[plane] += difference * difference;
        }
        self.count += 1;
    }

    fn mean(&self, plane: usize) -> f32 {
        self.first[plane] + self.sum[plane] / self.count as f32
    }

    /// Variance of the mean.
    fn variance(&self, plane: usize) -> f32 {
        let (count, mean) = (self.count as f32, self.sum[plane] / self.count as f32);
        ((self.squares[plane] / count - mean * mean) / (count - 1.0)).max(0.0)
    }

    /// Number of further samples that would bring the noise of the pixel's albedo down to [`ALBEDO_NOISE`].
    fn further(&self) -> u32 {
        let channels = Feature::PixelAlbedo.planes();
        let sum = |of: &dyn Fn(usize) -> f32| channels.clone().map(of).sum::<f32>();
        let (noise, albedo) = (sum(&|plane| self.variance(plane)), sum(&|plane| self.mean(plane)));
        if self.count < 2 || albedo <= 0.0 || self.sum[Feature::Specular.planes().start] > 0.0 {
            return 0;
        }
        let times = CHANNELS as f32 * noise / (ALBEDO_NOISE * albedo).powi(2) - 1.0;
        ((times * self.count as f32).clamp(0.0, MAX_FURTHER as f32)) as u32
    }
}

impl<'a> PlaneSums<'a> {
    pub(super) fn new(clusters: &'a Clusters, factors: &'a [f32]) -> Self {
        let of_column = clusters.of_column();
        Self {
            of_column,
            factors,
            light: vec![ClusterLight::default(); clusters.count()],
            emission: PixelSums::new(of_column.len()),
            features: FeatureSums::default(),
            further: FeatureSums::default(),
            lines: vec![[0.0; RUN]; lines(clusters.count())],
            carried: 0,
        }
    }

    /// Bytes of the sums, and of the planes that they fill in a block of `pixels`.
    pub(super) fn needs_bytes(pixels: u64, columns: u64, clusters: u64) -> u64 {
        let sums = size_of::<ClusterLight>() as u64 * clusters + PixelSums::needs_bytes(columns);
        let sums = sums + (size_of::<[f32; RUN]>() * lines(clusters as usize)) as u64;
        sums + BlockPlanes::fixed_bytes(pixels, clusters) + emission_bytes(pixels, columns)
    }

    /// Adds a contribution to its layer.
    #[inline(always)]
    pub(super) fn add(&mut self, half: usize, layer: LightPath, column: u32, value: Vec3) {
        let layer = match layer {
            LightPath::Emission => return self.emission.add(half, column, value),
            LightPath::Direct => 0,
            LightPath::Indirect => 1,
        };
        let cluster = self.of_column.get(column as usize).copied().unwrap_or(u16::MAX);
        if let Some(light) = self.light.get_mut(usize::from(cluster)) {
            let [r, g, b, _] = &mut light[half & 1][layer];
            let value = value * self.factors.get(column as usize).copied().unwrap_or(1.0);
            *r += value.x;
            *g += value.y;
            *b += value.z;
        }
    }

    /// The emission seen by the current pixel.
    pub(super) fn emission(&self) -> &PixelSums {
        &self.emission
    }

    /// Passes each column of the emission with the sum of all samples to `each`, and clears it.
    pub(super) fn drain_emission(&mut self, each: impl FnMut(usize, Vec3)) {
        self.emission.drain(each);
    }

    /// Adds the features of one sample.
    #[inline(always)]
    pub(super) fn add_features(&mut self, sample: &SampleFeatures) {
        self.features.add(sample.values());
    }

    /// Number of further camera rays that the current pixel wants, once its samples are in.
    pub(super) fn wants_further(&self) -> u32 {
        self.features.further()
    }

    /// Adds the features of one more camera ray.
    pub(super) fn add_further(&mut self, sample: &SampleFeatures) {
        if self.further.count == 0 {
            self.further = self.features;
        }
        self.further.add(sample.values());
    }

    /// Forgets the further camera rays of the current pixel.
    pub(super) fn drop_further(&mut self) {
        self.further = FeatureSums::default();
    }

    /// Moves the means of pixel `pixel` of `run` out of the sums. `samples` are the numbers in each half, neither of
    /// them 0.
    pub(super) fn take(&mut self, planes: &mut BlockPlanes, run: Run, pixel: usize, samples: [u32; 2]) {
        let (clusters, scales) = (self.light.len(), samples.map(|count| 1.0 / count as f32));
        let (light_lines, feature_lines) = self.lines.split_at_mut(LIGHTS * CHANNELS * clusters);
        for (cluster, light) in self.light.iter_mut().enumerate() {
            let light = std::mem::take(light).into_iter().zip(scales);
            let light = light.flat_map(|(layers, scale)| layers.map(|sum| (sum, scale)));
            for (part, (sum, scale)) in light.enumerate() {
                let lines = &mut light_lines[(part * clusters + cluster) * CHANNELS..][..CHANNELS];
                lines.iter_mut().zip(sum).for_each(|(line, sum)| line[pixel] = sum * scale);
            }
        }
        let count = (samples[0] + samples[1]) as f32;
        let (own, further) = (std::mem::take(&mut self.features), std::mem::take(&mut self.further));
        let all = if further.count > 0 { further } else { own };
        for feature in Feature::ALL {
            for plane in feature.planes() {
                let sums = if feature.is_of_light() { &own } else { &all };
                let value = if feature == Feature::Material { sums.first[plane] } else { sums.mean(plane) };
                (feature_lines[plane][pixel], feature_lines[FEATURE_PLANES + plane][pixel]) =
                    (value, sums.variance(plane));
            }
        }
        if feature_lines[Feature::Emitter.planes().start][pixel] > 0.0 {
            self.emission.drain(|column, sum| {
                let value = (sum / count).to_array();
                let pixel = (run.first + pixel) as u32;
                planes.emission.push(SeenEmission { pixel, column: column as u32, value });
            });
            let most = BlockPlanes::most_seen(run.pixels as u64, self.of_column.len() as u64) as usize;
            if planes.emission.len() > 2 * most {
                self.carry_until(planes, run, pixel + 1);
                keep_brightest(planes, self.of_column, self.factors, most);
            }
        }
    }

    /// Copies a run into the block, every value of it.
    pub(super) fn carry(&mut self, planes: &mut BlockPlanes, run: Run) {
        self.carry_until(planes, run, run.count);
        self.carried = 0;
    }

    fn carry_until(&mut self, planes: &mut BlockPlanes, run: Run, end: usize) {
        let BlockPlanes { direct: [direct, direct_odd], indirect: [indirect, indirect_odd], .. } = planes;
        let light = [direct, indirect, direct_odd, indirect_odd];
        let all = light.into_iter().chain([&mut planes.features, &mut planes.feature_variance]);
        let planes = all.flat_map(|planes| planes.chunks_exact_mut(run.pixels));
        for (plane, line) in planes.zip(&self.lines) {
            plane[run.first + self.carried..run.first + end].copy_from_slice(&line[self.carried..end]);
        }
        self.carried = end;
    }
}

/// Planes of light for each cluster and channel: two halves, direct and indirect.
const LIGHTS: usize = 4;

/// Number of planes of a block with this many clusters.
fn lines(clusters: usize) -> usize {
    LIGHTS * CHANNELS * clusters + 2 * FEATURE_PLANES
}

/// Bytes of a block's emission while it is traced: twice what is kept, plus what one pixel may add.
fn emission_bytes(pixels: u64, columns: u64) -> u64 {
    size_of::<SeenEmission>() as u64 * (2 * BlockPlanes::most_seen(pixels, columns) + columns)
}

/// Clears `planes` for a block of `pixels` and reserves memory for the emission that its samples may see.
pub(super) fn begin(planes: &mut BlockPlanes, clusters: &Clusters, pixels: usize) {
    planes.reset(pixels, clusters.count());
    let most = emission_bytes(pixels as u64, clusters.of_column().len() as u64);
    planes.emission.reserve_exact(most as usize / size_of::<SeenEmission>());
}

/// Reduces the planes of a traced block to what is stored.
pub(super) fn finish(planes: &mut BlockPlanes, clusters: &Clusters, factors: &[f32]) {
    let most = BlockPlanes::most_seen(planes.pixels() as u64, clusters.of_column().len() as u64);
    keep_brightest(planes, clusters.of_column(), factors, most as usize);
    planes.round();
}

/// Keeps the brightest of the emission, each column multiplied by its factor, and counts the rest as indirect.
fn keep_brightest(planes: &mut BlockPlanes, of_column: &[u16], factors: &[f32], most: usize) {
    if planes.emission.len() <= most {
        return;
    }
    let factor = |seen: &SeenEmission| factors.get(seen.column as usize).copied().unwrap_or(1.0);
    let brightness = |seen: &SeenEmission| factor(seen) * seen.value.iter().sum::<f32>();
    let place = |seen: &SeenEmission| (seen.pixel, seen.column);
    let brighter = |a: &SeenEmission, b: &SeenEmission| {
        brightness(b).total_cmp(&brightness(a)).then_with(|| place(a).cmp(&place(b)))
    };
    planes.emission.select_nth_unstable_by(most, brighter);
    let pixels = planes.pixels();
    // In a fixed order, so that sums are the same.
    planes.emission[most..].sort_unstable_by_key(place);
    for seen in planes.emission.drain(most..) {
        let (cluster, factor) = (usize::from(of_column[seen.column as usize]), factor(&seen));
        for (channel, value) in seen.value.into_iter().enumerate() {
            let at = (cluster * CHANNELS + channel) * pixels + seen.pixel as usize;
            planes.indirect.iter_mut().for_each(|half| half[at] += factor * value);
        }
    }
    planes.emission.sort_unstable_by_key(place);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_faintest_emission_beyond_the_most_counts_as_indirect() {
        let seen = |pixel, column, value| SeenEmission { pixel, column, value: [value; CHANNELS] };
        let mut planes = BlockPlanes::default();
        planes.reset(2, 2);
        let brightest = [seen(0, 1, 3.0), seen(1, 0, 4.0)];
        planes.emission = vec![seen(0, 0, 1.0), brightest[0], brightest[1], seen(1, 3, 2.0)];
        keep_brightest(&mut planes, &[0, 0, 1, 1], &[], 2);
        assert_eq!(planes.emission, brightest);
        for half in &planes.indirect {
            // Column-major: cluster 0 has pixels 0, 1 of each channel, then cluster 1.
            assert_eq!(*half, [1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.0, 2.0, 0.0, 2.0]);
        }
    }

    #[test]
    fn features_have_the_mean_and_the_variance_of_that_mean() {
        let clusters = Clusters::default();
        let mut sums = PlaneSums::new(&clusters, &[]);
        let mut planes = BlockPlanes::default();
        planes.reset(1, 0);
        for depth in [1000.0, 1001.0, 1002.0, 1005.0] {
            sums.add_features(&SampleFeatures {
                depth,
                surface: if depth < 1001.5 { 1.0 } else { 0.0 },
                ..Default::default()
            });
        }
        let run = Run { first: 0, count: 1, pixels: 1 };
        sums.take(&mut planes, run, 0, [2, 2]);
        sums.carry(&mut planes, run);
        let only = |values: &[f32]| values[0];
        assert_eq!(only(planes.feature(Feature::Depth)), 1002.0);
        assert_eq!(only(planes.feature(Feature::Surface)), 0.5);
        // Deviations −2, −1, 0, 3: their squares over 4 · 3. And ±½ over 4 · 3.
        assert!((only(planes.variance(Feature::Depth)) - 14.0 / 12.0).abs() < 1e-5);
        assert!((only(planes.variance(Feature::Surface)) - 1.0 / 12.0).abs() < 1e-6);
    }
}
