//! Weighted means of neighbours, and local linear fits. For each tile of pixels the weights of every offset are
//! computed once, and then applied to every image.

use pulp::{Simd, WithSimd};

use super::constants::{BESIDE, MAX_LEVERAGE};
use super::image_rows::{ImageRows, Region};
use super::pixel_tile::{Offset, PixelTile, TILE_HEIGHT, TILE_PIXELS, TILE_WIDTH, TileWindow, load};

/// Weights below this count as 0, since sums of them would have no inverse.
const MIN_WEIGHT: f32 = 1e-20;

/// A source of neighbour weights.
pub(super) trait Weigh: Sync {
    /// Inputs of the weights around one tile.
    type Ready: Default + Send;

    /// Which planes have weights of their own.
    fn weighed(&self) -> Weighed {
        Weighed::Together
    }

    /// Fills `ready` for the neighbours of a tile within a radius, replacing those of another tile.
    fn make_ready(&self, tile: PixelTile, reach: usize, ready: &mut Self::Ready);

    /// Writes the weights of one offset for the pixels of a tile, row by row. The first part is asked for first.
    /// Weights of neighbours outside the image are ignored. Implementations are to be inlined, so that they are
    /// compiled for the chosen instruction set.
    fn weigh<S: Simd>(&self, simd: S, ready: &mut Self::Ready, of: Neighbours, out: &mut [f32; TILE_PIXELS]);
}

/// One weight query: filter part, offset, and the offset's index.
#[derive(Clone, Copy, Debug)]
pub(super) struct Neighbours {
    /// Index of the part, among those that have weights of their own.
    pub(super) part: usize,
    /// Distance from the pixel to the neighbour.
    pub(super) offset: Offset,
    /// Index of that offset.
    pub(super) index: usize,
}

/// Which planes share weights. Planes are ordered by half of the samples, then image, then channel ([`plane_of`]).
#[derive(Clone, Copy, Debug)]
pub(super) enum Weighed {
    /// One set of weights for all planes.
    Together,
    /// One set for each half of the samples.
    Halves,
    /// One set for each of `count` images, from `first` on.
    Images { first: usize, count: usize },
}

impl Weighed {
    /// Number of sets of weights.
    fn parts(self) -> usize {
        match self {
            Self::Together => 1,
            Self::Halves => 2,
            Self::Images { count, .. } => count,
        }
    }

    /// Number of planes in one part, of `all` planes.
    fn planes(self, all: usize) -> usize {
        match self {
            Self::Together => all,
            Self::Halves => all / 2,
            Self::Images { .. } => IMAGE,
        }
    }

    /// Index, among all planes, of one plane of a part.
    fn plane(self, part: usize, plane: usize, all: usize) -> usize {
        match self {
            Self::Together => plane,
            Self::Halves => part * (all / 2) + plane,
            Self::Images { first, .. } => plane_of(first + part, plane, all),
        }
    }
}

/// The offsets that a filter reads.
pub(super) struct Offsets {
    radius: usize,
    each: Vec<Offset>,
}

impl Offsets {
    /// A square of the given radius in pixels, of which every `stride`th pixel is read. The centre is included.
    fn square(radius: usize, stride: usize) -> Self {
        debug_assert!(radius.is_multiple_of(stride));
        let steps = || (-(radius as isize)..=radius as isize).step_by(stride);
        Self { radius, each: steps().flat_map(|y| steps().map(move |x| (x, y))).collect() }
    }

    /// The offsets of such a square that lie within its inscribed circle.
    pub(super) fn disc(radius: usize, stride: usize) -> Self {
        let Self { radius, mut each } = Self::square(radius, stride);
        let reach = radius as f32 + 0.5 * stride as f32;
        each.retain(|&(x, y)| (x as f32).hypot(y as f32) <= reach);
        Self { radius, each }
    }

    /// Largest distance in pixels, across or down.
    pub(super) fn radius(&self) -> usize {
        self.radius
    }

    /// Number of offsets.
    pub(super) fn count(&self) -> usize {
        self.each.len()
    }

    /// A disc of which beyond `dense` pixels only one in `thin` is read: 2 as on a chessboard, 5 in knight's moves.
    pub(super) fn thinned(radius: usize, dense: usize, thin: usize) -> Self {
        let Self { radius, mut each } = Self::disc(radius, 1);
        let (dense, thin) = (dense as isize, thin as isize);
        each.retain(|&(x, y)| (x.abs() <= dense && y.abs() <= dense) || (x + (thin / 2) * y) % thin == 0);
        Self { radius, each }
    }
}

/// Distance of each offset in memory, in a plane whose rows are `row` values apart.
fn taps(offsets: &[Offset], row: usize) -> Vec<isize> {
    offsets.iter().map(|(across, down)| down * row as isize + across).collect()
}

/// The arguments of one filter.
#[derive(Clone, Copy)]
pub(super) struct Means<'a, W> {
    pub(super) images: &'a ImageRows,
    pub(super) offsets: &'a Offsets,
    /// Leverage of the slope correction for each effective sample ([`Moments::tilts`]).
    pub(super) slope: f32,
    pub(super) weigher: &'a W,
}

/// Planes of one image: three channels in two halves.
pub(super) const IMAGE: usize = 6;

/// Index of a plane of an image among `planes` planes, which are ordered by half, then image, then channel.
pub(super) fn plane_of(image: usize, plane: usize, planes: usize) -> usize {
    plane / 3 * (planes / 2) + 3 * image + plane % 3
}

impl<W: Weigh> Means<'_, W> {
    /// Fills each pixel of a region with the weighted mean of its neighbours in each plane, corrected for slope. The
    /// pixel itself has the weight of its most similar neighbour. So one that is like none, on the edge of two surfaces
    /// say, loses its noise and takes the value of its direct neighbours.
    pub(super) fn fill(&self, region: &Region, means: &mut ImageRows) {
        let (width, planes) = (self.images.width(), self.images.planes());
        // Taps of tiles at the image's border, and of all others.
        let taps = [TileWindow::stride(self.offsets.radius), planes * width].map(|row| taps(&self.offsets.each, row));
        let taps = taps.each_ref().map(Vec::as_slice);
        means.fill_tiles(region, (TILE_WIDTH, TILE_HEIGHT), |memory: &mut TileScratch<W::Ready>, (x, y), out| {
            memory.weights.resize(self.offsets.each.len() * WEIGHTS, 0.0);
            pulp::Arch::new().dispatch(TileOfMeans { of: self, tile: PixelTile { x, y }, taps, memory, out });
        });
    }
}

/// Values from the weights of one offset to those of the next. A cache line is added, since otherwise the weights of
/// one pixel would compete for the same few cache lines.
const WEIGHTS: usize = TILE_PIXELS + 16;

/// Buffers reused from tile to tile, since fresh memory from the system is slow.
struct TileScratch<R> {
    ready: R,
    /// [`WEIGHTS`] values for each offset.
    weights: Vec<f32>,
    cut: TileWindow,
}

impl<R: Default> Default for TileScratch<R> {
    fn default() -> Self {
        Self { ready: R::default(), weights: Vec::new(), cut: TileWindow::default() }
    }
}

struct TileOfMeans<'a, W: Weigh> {
    of: &'a Means<'a, W>,
    tile: PixelTile,
    /// Distance of each offset in a plane of a cut, and in a plane of the images.
    taps: [&'a [isize]; 2],
    memory: &'a mut TileScratch<W::Ready>,
    /// The rows of all planes, for each row of pixels.
    out: Vec<&'a mut [f32]>,
}

impl<W: Weigh> WithSimd for TileOfMeans<'_, W> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let Means { images, offsets, weigher, .. } = *self.of;
        weigher.make_ready(self.tile, offsets.radius, &mut self.memory.ready);
        let weighed = weigher.weighed();
        let planes = weighed.planes(images.planes());
        for part in 0..weighed.parts() {
            let groups = (0..planes).step_by(IMAGE).map(|some| {
                std::array::from_fn(|at| weighed.plane(part, (some + at).min(planes - 1), images.planes()))
            });
            let is_lit: Vec<([usize; IMAGE], bool)> = groups.map(|some| (some, self.is_lit(some))).collect();
            // What the other parts share is made with the weights of the first.
            if part == 0 || is_lit.iter().any(|&(_, is_lit)| is_lit) {
                self.weigh(simd, part);
            }
            for (some, is_lit) in is_lit {
                if is_lit { self.add_up(simd, some) } else { self.leave_dark(some) }
            }
        }
    }
}

impl<W: Weigh> TileOfMeans<'_, W> {
    /// Fills the weights of a part, normalised to 1 for each pixel and corrected for slope.
    #[inline(always)]
    fn weigh<S: Simd>(&mut self, simd: S, part: usize) {
        let TileScratch { ready, weights: all, .. } = &mut *self.memory;
        let Means { images, offsets, slope, weigher, .. } = *self.of;
        let mut own = 0;
        for (index, (&offset, weights)) in offsets.each.iter().zip(all.chunks_exact_mut(WEIGHTS)).enumerate() {
            let Some(weights) = weights.first_chunk_mut::<TILE_PIXELS>() else { continue };
            if offset == (0, 0) {
                // The centre is not among the offsets that are summed below.
                own = index;
                weights.fill(0.0);
                continue;
            }
            weigher.weigh(simd, ready, Neighbours { part, offset, index }, weights);
            if offset.0.abs() <= 1 && offset.1.abs() <= 1 {
                for w in weights.iter_mut() {
                    *w += BESIDE;
                }
            }
            forget_outside(images, self.tile, offset, weights);
        }
        for row in (0..TILE_PIXELS).step_by(TILE_WIDTH) {
            let mut moments = Moments::default();
            for x in (0..TILE_WIDTH).step_by(S::F32_LANES) {
                moments.add_up(simd, &all[row..], x, &offsets.each);
            }
            let own_row = &mut all[own * WEIGHTS + row..][..TILE_WIDTH];
            let tilts = moments.tilts(own_row, slope);
            for x in (0..TILE_WIDTH).step_by(S::F32_LANES) {
                tilts.apply(simd, &mut all[row..], x, &offsets.each);
            }
        }
    }

    /// Whether all reads lie within the rows held, including vectors that begin in them.
    fn is_inside(&self) -> bool {
        let (PixelTile { x, y }, images, radius) = (self.tile, self.of.images, self.of.offsets.radius);
        let (right, bottom, held) = (x + TILE_WIDTH + radius, y + TILE_HEIGHT + radius, images.held());
        x >= radius && y >= radius + held.start && right <= images.width() && bottom <= held.end
    }

    /// Whether there is anything but 0 in these planes within the radius of the tile. Of many lights, most light no more than a part of
    /// the picture.
    fn is_lit(&self, some: [usize; IMAGE]) -> bool {
        let (PixelTile { x, y }, images, radius) = (self.tile, self.of.images, self.of.offsets.radius);
        let (held, width) = (images.held(), images.width());
        // Beyond what is held, the rows at its border are repeated.
        let rows = y.saturating_sub(radius).clamp(held.start, held.end - 1)..(y + TILE_HEIGHT + radius).min(held.end);
        let columns = x.saturating_sub(radius).min(width - 1)..(x + TILE_WIDTH + radius).min(width);
        some.iter().any(|&plane| rows.clone().any(|y| images.row(plane, y)[columns.clone()].iter().any(|&v| v != 0.0)))
    }

    /// Writes what [`add_up`](Self::add_up) finds where there is no light.
    fn leave_dark(&mut self, some: [usize; IMAGE]) {
        for rows in self.out.chunks_exact_mut(self.of.images.planes()) {
            some.iter().for_each(|&plane| rows[plane].fill(0.0));
        }
    }

    /// Adds up the weighted neighbours in these planes. A plane may be listed several times.
    #[inline(always)]
    fn add_up<S: Simd>(&mut self, simd: S, some: [usize; IMAGE]) {
        let images = self.of.images;
        let (PixelTile { x, y }, planes) = (self.tile, images.planes());
        let is_inside = self.is_inside();
        let TileScratch { weights, cut, .. } = &mut *self.memory;
        let (values, begins, row, taps) = if is_inside {
            let begins = some.map(|plane| images.begin_of(plane, y) + x);
            (images.values(), begins, planes * images.width(), self.taps[1])
        } else {
            let radius = self.of.offsets.radius;
            cut.fill(images, some, self.tile, radius);
            let begins = std::array::from_fn(|plane| plane * cut.plane_length() + cut.at((0, 0)));
            (cut.values(), begins, TileWindow::stride(radius), self.taps[0])
        };
        let mut out = [[0.0f32; TILE_WIDTH]; IMAGE];
        for (y, rows) in self.out.chunks_exact_mut(planes).enumerate() {
            for x in (0..TILE_WIDTH).step_by(2 * S::F32_LANES) {
                let weights = &weights[y * TILE_WIDTH + x..];
                let at = begins.map(|begin| begin + y * row + x);
                let sums = add_up_vectors(simd, values, at, weights, taps);
                for (out, sums) in out.iter_mut().zip(&sums) {
                    S::as_mut_simd_f32s(&mut out[x..x + 2 * S::F32_LANES]).0.copy_from_slice(sums);
                }
            }
            for (plane, out) in some.iter().zip(&out) {
                let row = &mut *rows[*plane];
                row.copy_from_slice(&out[..row.len()]);
            }
        }
    }
}

/// Weighted sums of two vectors of pixels in each of six planes. `taps` has the distance of each neighbour in memory, ascending.
/// Written out so that the sums stay in registers, and each neighbour's place is checked once for all planes; fused multiply–add on every
/// machine, so that the bits are the same.
#[inline(always)]
fn add_up_vectors<S: Simd>(
    simd: S,
    values: &[f32],
    at: [usize; IMAGE],
    weights: &[f32],
    taps: &[isize],
) -> [[S::f32s; 2]; IMAGE] {
    let two = 2 * S::F32_LANES;
    let zero = simd.splat_f32s(0.0);
    let [mut of_a, mut of_b, mut of_c, mut of_d, mut of_e, mut of_f] = [[zero; 2]; IMAGE];
    let (first, last) = (taps.first().copied().unwrap_or(0), taps.last().copied().unwrap_or(0));
    let begins = (last - first) as usize;
    let [a, b, c, d, e, f] = at.map(|at| &values[at.wrapping_add_signed(first)..][..begins + two]);
    let add = |[low, high]: [S::f32s; 2], [w_low, w_high]: [S::f32s; 2], values: &[f32]| {
        let values = S::as_simd_f32s(values).0;
        [simd.mul_add_f32s(w_low, values[0], low), simd.mul_add_f32s(w_high, values[1], high)]
    };
    for (&tap, weights) in taps.iter().zip(weights.chunks(WEIGHTS)) {
        let weights = S::as_simd_f32s(&weights[..two]).0;
        let weights = [weights[0], weights[1]];
        let tap = (tap - first) as usize;
        assert!(tap <= begins, "taps ascend");
        of_a = add(of_a, weights, &a[tap..][..two]);
        of_b = add(of_b, weights, &b[tap..][..two]);
        of_c = add(of_c, weights, &c[tap..][..two]);
        of_d = add(of_d, weights, &d[tap..][..two]);
        of_e = add(of_e, weights, &e[tap..][..two]);
        of_f = add(of_f, weights, &f[tap..][..two]);
    }
    [of_a, of_b, of_c, of_d, of_e, of_f]
}

/// Sets the weights of neighbours outside the image to 0.
#[inline(always)]
fn forget_outside(images: &ImageRows, tile: PixelTile, (across, down): Offset, weights: &mut [f32; TILE_PIXELS]) {
    let (width, height) = (images.width() as isize, images.height() as isize);
    let (x, y) = (tile.x as isize + across, tile.y as isize + down);
    if x >= 0 && y >= 0 && x + TILE_WIDTH as isize <= width && y + TILE_HEIGHT as isize <= height {
        return;
    }
    for (row, weights) in weights.chunks_exact_mut(TILE_WIDTH).enumerate() {
        let in_rows = (0..height).contains(&(y + row as isize));
        for (column, weight) in weights.iter_mut().enumerate() {
            if !in_rows || !(0..width).contains(&(x + column as isize)) {
                *weight = 0.0;
            }
        }
    }
}

/// Sums over the neighbours of a row of pixels, without the pixel itself: the weights; the weights times the offset and
/// its products; the squared weights; and the largest weight.
#[derive(Default)]
struct Moments([[f32; TILE_WIDTH]; 8]);

/// Factor on the weight of an offset: `constant − across · x − down · y`.
struct Tilts([[f32; TILE_WIDTH]; 3]);

impl Moments {
    /// Adds a vector of pixels that begins at `x`.
    #[inline(always)]
    fn add_up<S: Simd>(&mut self, simd: S, weights: &[f32], x: usize, offsets: &[Offset]) {
        let zero = simd.splat_f32s(0.0);
        let [mut sum, mut most, mut squares] = [zero; 3];
        let [mut m_x, mut m_y, mut m_xx, mut m_xy, mut m_yy] = [zero; 5];
        for (&(across, down), weights) in offsets.iter().zip(weights.chunks(WEIGHTS)) {
            let (w, across, down) = (load::<S>(weights, x), across as f32, down as f32);
            let (w_x, w_y) = (simd.mul_f32s(w, simd.splat_f32s(across)), simd.mul_f32s(w, simd.splat_f32s(down)));
            sum = simd.add_f32s(sum, w);
            most = simd.max_f32s(most, w);
            squares = simd.mul_add_f32s(w, w, squares);
            m_x = simd.add_f32s(m_x, w_x);
            m_y = simd.add_f32s(m_y, w_y);
            m_xx = simd.mul_add_f32s(w_x, simd.splat_f32s(across), m_xx);
            m_xy = simd.mul_add_f32s(w_x, simd.splat_f32s(down), m_xy);
            m_yy = simd.mul_add_f32s(w_y, simd.splat_f32s(down), m_yy);
        }
        let all = [sum, m_x, m_y, m_xx, m_xy, m_yy, squares, most];
        for (out, sums) in self.0.iter_mut().zip(all) {
            S::as_mut_simd_f32s(&mut out[x..x + S::F32_LANES]).0[0] = sums;
        }
    }

    /// Factors that normalise the weights to a sum of 1, together with `own`, the weights of the pixels themselves,
    /// which become the largest weight.
    ///
    /// They also turn the weights of a mean into those of a local linear fit (Fan and Gijbels 1996, section 2.2;
    /// Bitterli et al. 2016 for images of samples). A mean is biased where neighbours lie to one side and the light has
    /// a slope, above all at the border of a surface. The fit is not, but its noise is higher by the factor `1 + t`.
    /// Here `t = mᵀ C⁻¹ m` is the leverage of the mean offset `m` with the covariance `C` of the offsets. So the
    /// correction is scaled down to a leverage of at most `slope` times the effective number of samples of the mean,
    /// and never above [`MOST_LEVERAGE`].
    #[inline(always)]
    fn tilts(&self, own: &mut [f32], slope: f32) -> Tilts {
        let Self([sums, m_x, m_y, m_xx, m_xy, m_yy, squares, most]) = self;
        let mut tilts = [[0.0f32; TILE_WIDTH]; 3];
        for (i, own) in own.iter_mut().enumerate() {
            // A pixel without any neighbour keeps its value.
            *own = if most[i] > MIN_WEIGHT { most[i] } else { 1.0 };
            let scale = 1.0 / (sums[i] + *own);
            let squares = (squares[i] + *own * *own) * scale * scale;
            // Each weight is multiplied by `1 − (C⁻¹ m)ᵀ (offset − m)`, or by a smaller correction.
            let moments = [m_x[i], m_y[i], m_xx[i], m_xy[i], m_yy[i]].map(|moment| moment * scale);
            let tilt = tilt(moments, squares, slope);
            for term in 0..3 {
                tilts[term][i] = tilt[term] * scale;
            }
        }
        Tilts(tilts)
    }
}

impl Tilts {
    /// Multiplies a vector of weights that begins at `x`, for all offsets.
    #[inline(always)]
    fn apply<S: Simd>(&self, simd: S, weights: &mut [f32], x: usize, offsets: &[Offset]) {
        let [tilt_x, tilt_y, constant] = self.0.each_ref().map(|tilts| load::<S>(tilts, x));
        for (&(across, down), weights) in offsets.iter().zip(weights.chunks_mut(WEIGHTS)) {
            let of_x = simd.mul_f32s(simd.splat_f32s(across as f32), tilt_x);
            let of_y = simd.mul_f32s(simd.splat_f32s(down as f32), tilt_y);
            let factor = simd.sub_f32s(simd.sub_f32s(constant, of_x), of_y);
            let vector = &mut S::as_mut_simd_f32s(&mut weights[x..x + S::F32_LANES]).0[0];
            *vector = simd.mul_f32s(*vector, factor);
        }
    }
}

/// Factors of the offset across and the offset down, and the constant that their sum is subtracted from.
#[inline(always)]
fn tilt([x, y, xx, xy, yy]: [f32; 5], squares: f32, slope: f32) -> [f32; 3] {
    if squares <= 0.0 {
        return [0.0, 0.0, 1.0];
    }
    // Where all neighbours lie on a line, the covariance has no inverse.
    let ridge = 1e-2 + 1e-3 * (xx + yy);
    let (a, b, c) = (xx - x * x + ridge, xy - x * y, yy - y * y + ridge);
    let determinant = a * c - b * b;
    let (tilt_x, tilt_y) = ((c * x - b * y) / determinant, (a * y - b * x) / determinant);
    let leverage = tilt_x * x + tilt_y * y;
    let most = (slope / squares).min(MAX_LEVERAGE);
    let scale = if leverage > most { (most / leverage).sqrt() } else { 1.0 };
    [scale * tilt_x, scale * tilt_y, 1.0 + scale * leverage]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Test weights from the positions of a pixel and its neighbour.
    struct ByPlace<F>(F);

    impl<F: Fn((usize, usize), Offset) -> f32 + Sync> Weigh for ByPlace<F> {
        type Ready = PixelTile;

        fn make_ready(&self, tile: PixelTile, _: usize, ready: &mut PixelTile) {
            *ready = tile;
        }

        fn weigh<S: Simd>(&self, _: S, tile: &mut PixelTile, of: Neighbours, out: &mut [f32; TILE_PIXELS]) {
            for (i, out) in out.iter_mut().enumerate() {
                *out = self.0((tile.x + i % TILE_WIDTH, tile.y + i / TILE_WIDTH), of.offset);
            }
        }
    }

    fn means(images: &ImageRows, region: &Region, offsets: &Offsets, slope: f32, weigher: &impl Weigh) -> ImageRows {
        let mut means = ImageRows::zeros(images.width(), images.height(), images.planes());
        Means { images, offsets, slope, weigher }.fill(region, &mut means);
        means
    }

    /// Light that rises from the border of a surface: a mean brightens the border, a linear fit does not.
    #[test]
    fn a_slope_at_the_rim_is_no_bias() {
        let (width, height) = (20, 3);
        let mut ramp = ImageRows::zeros(width, height, 1);
        (0..height).for_each(|y| (0..width).for_each(|x| ramp.row_mut(0, y)[x] = x as f32));
        let even = ByPlace(|_, _| 1.0);
        let rim = |slope: f32| means(&ramp, &ramp.whole(), &Offsets::square(5, 1), slope, &even).row(0, 1)[0];
        assert!((rim(0.0) - 2.5).abs() < 0.1, "{}", rim(0.0));
        assert!(rim(1.0).abs() < 0.05, "{}", rim(1.0));
        // A mean of few samples can afford only a part of the correction.
        assert!((0.5..2.0).contains(&rim(0.02)), "{}", rim(0.02));
    }

    fn uneven((x, y): (usize, usize), (across, down): Offset) -> f32 {
        1.0 / (1.0 + ((y * 7 + x * 3) as isize + across * 5 + down).unsigned_abs() as f32 % 4.0)
    }

    #[test]
    fn weights_of_a_plane_add_up_to_one() {
        let mut flat = ImageRows::zeros(20, 9, 1);
        flat.values_mut().fill(3.0);
        let means = means(&flat, &flat.whole(), &Offsets::square(4, 1), 1.0, &ByPlace(uneven));
        assert!(means.values().iter().all(|v| (v - 3.0).abs() < 1e-3), "{means:?}");
    }

    /// Test weights: the first half of the samples looks to the left, the second to the right.
    struct ByHalf;

    impl Weigh for ByHalf {
        type Ready = ();

        fn weighed(&self) -> Weighed {
            Weighed::Halves
        }

        fn make_ready(&self, _: PixelTile, _: usize, (): &mut ()) {}

        fn weigh<S: Simd>(&self, _: S, (): &mut (), of: Neighbours, out: &mut [f32; TILE_PIXELS]) {
            let looks = if of.part == 0 { (-1, 0) } else { (1, 0) };
            out.fill(if of.offset == looks { 1e6 } else { 0.0 });
        }
    }

    #[test]
    fn each_half_of_the_samples_may_have_weights_of_its_own() {
        // More planes than are added up at once.
        let (width, half) = (20, 8);
        let mut images = ImageRows::zeros(width, 3, 2 * half);
        let value = |plane: usize, x: usize| (plane + x) as f32;
        for plane in 0..2 * half {
            (0..3).for_each(|y| (0..width).for_each(|x| images.row_mut(plane, y)[x] = value(plane, x)));
        }
        let means = means(&images, &images.whole(), &Offsets::square(1, 1), 0.0, &ByHalf);
        for plane in 0..2 * half {
            let expected = value(plane, 10) + if plane < half { -0.5 } else { 0.5 };
            let found = means.row(plane, 1)[10];
            assert!((found - expected).abs() < 1e-3, "plane {plane}: {found}, not {expected}");
        }
    }

    /// Tiny weights, whose sums have no inverse.
    #[test]
    fn a_pixel_that_is_hardly_like_any_other_keeps_its_value() {
        let mut images = ImageRows::zeros(20, 9, 1);
        images.values_mut().iter_mut().enumerate().for_each(|(i, v)| *v = i as f32);
        let hardly = ByPlace(|_, _| 1e-42);
        let means = means(&images, &images.whole(), &Offsets::disc(6, 3), 1.0, &hardly);
        let is_kept = means.values().iter().zip(images.values()).all(|(mean, value)| (mean - value).abs() < 1e-6);
        assert!(is_kept, "{means:?}");
    }

    /// Against plain sums over neighbours, for images of several planes that are larger than a tile, and for regions.
    #[test]
    fn means_are_those_of_the_neighbours_with_their_weights() {
        let (width, height, planes) = (71, 19, 9);
        let mut images = ImageRows::zeros(width, height, planes);
        images.values_mut().iter_mut().enumerate().for_each(|(i, v)| *v = (i * i % 101) as f32);
        let offsets = Offsets::square(6, 3);
        for region in [images.whole(), Region { x: 3..50, y: 5..17 }] {
            let means = means(&images, &region, &offsets, 0.0, &ByPlace(uneven));
            for y in region.y.clone() {
                for x in region.x.clone() {
                    let inside = |&&(across, down): &&Offset| {
                        x.checked_add_signed(across).is_some_and(|x| x < width)
                            && y.checked_add_signed(down).is_some_and(|y| y < height)
                    };
                    let weight = |&offset: &Offset| uneven((x, y), offset);
                    let near: Vec<&Offset> = offsets.each.iter().filter(inside).collect();
                    let others = || near.iter().filter(|offset| ***offset != (0, 0));
                    let most = others().map(|offset| weight(offset)).fold(0.0, f32::max);
                    let sum = most + others().map(|offset| weight(offset)).sum::<f32>();
                    for plane in 0..planes {
                        let at = |(across, down): Offset| {
                            images.row(plane, y.strict_add_signed(down))[x.strict_add_signed(across)]
                        };
                        let of_others: f32 = others().map(|&&offset| weight(&offset) * at(offset)).sum();
                        let right = (of_others + most * at((0, 0))) / sum;
                        let found = means.row(plane, y)[x];
                        assert!((found - right).abs() < 1e-3 * right.max(1.0), "{x}, {y}: {found}, not {right}");
                    }
                }
            }
        }
    }
}
