//! A lighting as the coefficients that right factors are multiplied with.

use rayon::prelude::*;

use crate::light::Lighting;
use crate::matrix::{CHANNELS, ColumnTile, ColumnTransform};

/// Dense numbers of right factors come in groups of so many.
pub(super) const GROUP: usize = 16;

/// A lighting with the weights of each channel apart, and its coefficients, tile by tile: computed once for a picture.
pub(crate) struct LightingCoefficients {
    channels: [Vec<f32>; CHANNELS],
    tiles: Vec<LightingTile>,
}

/// The coefficients of a tile.
#[derive(Default)]
pub(crate) struct LightingTile {
    /// End of what is not 0; of a tile without light nothing is kept.
    pub used: usize,
    /// A plane for each channel, with zeros up to a multiple of [`GROUP`].
    planes: Vec<f32>,
    /// The same, of each coefficient its channels.
    interleaved: Vec<[f32; CHANNELS + 1]>,
}

impl LightingTile {
    #[inline(always)]
    pub(super) fn planes(&self) -> [&[f32]; CHANNELS] {
        let plane = self.planes.len() / CHANNELS;
        let (red, rest) = self.planes.split_at(plane);
        let (green, blue) = rest.split_at(plane);
        [red, green, blue]
    }

    #[inline(always)]
    pub(super) fn interleaved(&self) -> &[[f32; CHANNELS + 1]] {
        &self.interleaved
    }
}

impl LightingCoefficients {
    /// For factors whose columns are divided by these scales; of no scales all are 1.
    ///
    /// # Panics
    /// If lighting and transform have different numbers of columns.
    pub(crate) fn new(lighting: &Lighting, scales: &[f32], transform: &ColumnTransform) -> Self {
        assert_eq!(lighting.weights().len(), transform.columns());
        let channels = scaled_channels(lighting, scales);
        let make = |&tile| pulp::Arch::new().dispatch(MakeTile { transform, tile, channels: &channels });
        let tiles = match transform.tiles() {
            [one] => vec![make(one)],
            tiles => tiles.par_iter().map(make).collect(),
        };
        Self { channels, tiles }
    }

    /// The weights of the columns, see [`scaled_channels`].
    pub(crate) fn channels(&self) -> &[Vec<f32>; CHANNELS] {
        &self.channels
    }

    pub(super) fn tiles(&self) -> &[LightingTile] {
        &self.tiles
    }
}

/// The weights of each channel apart, times the scales of their columns; of no scales all are 1.
pub(super) fn scaled_channels(lighting: &Lighting, scales: &[f32]) -> [Vec<f32>; CHANNELS] {
    [0, 1, 2].map(|channel| {
        let mut weights = lighting.channel(channel);
        weights.iter_mut().zip(scales).for_each(|(weight, scale)| *weight *= scale);
        weights
    })
}

/// Makes a tile, compiled for the vectors that the machine has. Not a closure: what wraps one is compiled without them.
struct MakeTile<'a> {
    transform: &'a ColumnTransform,
    tile: ColumnTile,
    channels: &'a [Vec<f32>; CHANNELS],
}

impl pulp::NullaryFnOnce for MakeTile<'_> {
    type Output = LightingTile;

    #[inline(always)]
    fn call(self) -> LightingTile {
        let Self { transform, tile, channels } = self;
        let length = padded(tile);
        let mut planes = vec![0.0; CHANNELS * length];
        let mut used = 0;
        for (channel, plane) in channels.iter().zip(planes.chunks_exact_mut(length)) {
            used = used.max(transform.weights(tile, channel, plane));
        }
        if used == 0 {
            return LightingTile::default();
        }
        let mut interleaved = vec![[0.0; CHANNELS + 1]; tile.len()];
        for (channel, plane) in planes.chunks_exact(length).enumerate() {
            interleaved.iter_mut().zip(plane).for_each(|(weights, &weight)| weights[channel] = weight);
        }
        LightingTile { used, planes, interleaved }
    }
}

/// Coefficients of a tile with room up to a whole group.
pub(super) fn padded(tile: ColumnTile) -> usize {
    tile.len().next_multiple_of(GROUP)
}

/// The sum of all lanes: short chains of additions, in the same order on every machine.
#[inline(always)]
pub(super) fn total<const N: usize>(lanes: [f32; N]) -> f32 {
    const WIDTH: usize = 8;
    let mut sum = 0.0;
    for i in 0..WIDTH {
        let mut of_lane = 0.0;
        for j in 0..N / WIDTH {
            of_lane += lanes[i + WIDTH * j];
        }
        sum += of_lane;
    }
    sum
}
