//! Random numbers keyed by (seed, pixel, sample): Owen-scrambled Sobol points, padded pair by pair.
//!
//! A pair of dimensions is the two-dimensional Sobol sequence, a (0, 2)-sequence: any aligned run of 2^m of its points
//! puts exactly one into every elementary interval of area 2^−m. So the samples of a pixel cover the texels of a light
//! evenly, in every aligned power of two of them. Each use draws its own pair, whose points are shuffled and scrambled
//! by hashes of (seed, pixel, half, use) (Burley 2020, *Practical hash-based Owen scrambling*), which keeps the net.

use glam::Vec2;

/// What a pair of random numbers is for. Uses repeat for every vertex of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Dimension {
    /// Position in the pixel.
    Pixel,
    /// Direction of scattering.
    Scatter,
    /// Point on a light.
    Light,
    /// Choice between lobes, and whether the path goes on.
    Choice,
}

/// Added to the number of a vertex for the choice of its kind, where a surface is of two.
pub(super) const KIND_DIMENSION: u32 = 1 << 17;

/// Number, in place of a vertex, of the pair of [`Dimension::Pixel`] that chooses a point of the lens.
pub(super) const LENS_DIMENSION: u32 = 1;

const USES: u32 = 4;

/// The random numbers of one sample of one pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sampler {
    key: u64,
    index: u32,
}

impl Sampler {
    /// Sample `sample` of pixel `pixel`. Even and odd samples are two independent sequences, so that the difference of
    /// their means shows the noise of each.
    #[inline(always)]
    pub(super) fn new(seed: u64, pixel: u64, sample: u32) -> Self {
        let half = u64::from(sample & 1);
        Self { key: mix(mix(seed ^ 0x6c74_6d00).wrapping_add(pixel << 1 | half)), index: sample >> 1 }
    }

    /// Other random numbers, for a path that leaves this one at a vertex.
    pub(super) fn branch(&self, vertex: u32) -> Self {
        Self { key: mix(self.key ^ u64::from(vertex + 1).wrapping_mul(0xd1b5_4a32_d192_ed03)), index: self.index }
    }

    /// The pair for `purpose` at vertex `vertex` of the path.
    #[inline(always)]
    pub(super) fn pair(&self, purpose: Dimension, vertex: u32) -> Vec2 {
        self.member(purpose, vertex, 0, 1)
    }

    /// Pair `member` of `count` (a power of two) that one sample draws for `purpose` at `vertex`; those of all samples
    /// form one sequence.
    #[inline(always)]
    pub(super) fn member(&self, purpose: Dimension, vertex: u32, member: u32, count: u32) -> Vec2 {
        let hash = mix(self.key ^ u64::from(vertex * USES + purpose as u32 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let (a, b) = (hash as u32, (hash >> 32) as u32);
        let index = self.index.wrapping_mul(count).wrapping_add(member);
        // Scrambling the index itself shuffles the samples and maps aligned runs to aligned runs.
        let index = scramble(index, a ^ 0xa511_e9b3);
        let x = scramble(index.reverse_bits(), a);
        let y = scramble(sobol_second(index).reverse_bits(), b);
        Vec2::new(unit(x), unit(y))
    }
}

/// Owen scrambling in which the most significant bit decides first: the hash of Laine and Karras (2011) with Vegdahl's
/// constants. Every bit is changed by a function of the higher bits only. It works on the reversed number, in which
/// multiplication carries from higher to lower bits.
#[inline(always)]
fn scramble(bits: u32, seed: u32) -> u32 {
    let mut x = bits.reverse_bits();
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^= x.wrapping_mul(0x53a2_2864);
    x.reverse_bits()
}

/// The second Sobol dimension of an index, bits reversed: Pascal's triangle modulo 2, which is the fifth Kronecker
/// power of `[[1, 1], [0, 1]]` and so takes five steps.
#[inline(always)]
fn sobol_second(index: u32) -> u32 {
    let mut x = index;
    x ^= (x & 0xaaaa_aaaa) >> 1;
    x ^= (x & 0xcccc_cccc) >> 2;
    x ^= (x & 0xf0f0_f0f0) >> 4;
    x ^= (x & 0xff00_ff00) >> 8;
    x ^= (x & 0xffff_0000) >> 16;
    x
}

/// To [0, 1) with 24 bits.
#[inline(always)]
fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Finaliser of SplitMix64 (Steele, Lea and Flood 2014).
#[inline(always)]
fn mix(key: u64) -> u64 {
    let z = key.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cells of a `2^a × 2^b` grid over the unit square, with how many of `points` each holds.
    fn cells(points: &[Vec2], a: u32, b: u32) -> Vec<u32> {
        let (across, down) = (1u32 << a, 1u32 << b);
        let mut counts = vec![0; (across * down) as usize];
        for p in points {
            let (x, y) = ((p.x * across as f32) as u32, (p.y * down as f32) as u32);
            counts[(y * across + x) as usize] += 1;
        }
        counts
    }

    #[test]
    fn every_power_of_two_of_samples_hits_every_elementary_interval_once() {
        for m in [2, 5, 8, 10] {
            for pixel in 0..20 {
                let samples = 0..1u32 << m;
                let points: Vec<Vec2> =
                    samples.map(|i| Sampler::new(7, pixel, 2 * i).pair(Dimension::Light, 3)).collect();
                for a in 0..=m {
                    assert!(cells(&points, a, m - a).iter().all(|&n| n == 1), "2^{m} points, {a} bits across");
                }
            }
        }
    }

    #[test]
    fn members_of_all_samples_form_one_net() {
        let points: Vec<Vec2> = (0..64u32)
            .flat_map(|i| (0..4).map(move |j| Sampler::new(1, 9, 2 * i + 1).member(Dimension::Light, 0, j, 4)))
            .collect();
        for a in 0..=8 {
            assert!(cells(&points, a, 8 - a).iter().all(|&n| n == 1));
        }
    }

    #[test]
    fn points_of_different_keys_are_independent() {
        // Correlation of n independent pairs has deviation 1/√n = 0.0039; five of them.
        let n = 65_536;
        let correlation = |f: &dyn Fn(u32) -> (f32, f32)| {
            let sum: f64 = (0..n).map(f).map(|(a, b)| f64::from(a - 0.5) * f64::from(b - 0.5)).sum();
            12.0 * sum / f64::from(n)
        };
        let at =
            |pixel: u32, sample, vertex| Sampler::new(3, u64::from(pixel), sample).pair(Dimension::Scatter, vertex);
        assert!(correlation(&|i| (at(i, 0, 0).x, at(i, 1, 0).x)).abs() < 0.02, "halves");
        assert!(correlation(&|i| (at(i, 0, 0).x, at(i + 1, 0, 0).x)).abs() < 0.02, "neighbours");
        assert!(correlation(&|i| (at(i, 0, 0).y, at(i, 0, 1).y)).abs() < 0.02, "vertices");
        assert!(correlation(&|i| (at(i, 0, 0).x, at(i, 0, 0).y)).abs() < 0.02, "dimensions");
    }
}
