//! Relighting on the CPU, on all threads, with the same bits for any number of them.

use std::sync::Arc;

use rayon::prelude::*;

use super::compact::CompactBlock;
use super::damage::read_compact;
use super::lighting::{LightingCoefficients, scaled_channels};
use super::project::project;
use super::reconstruct::reconstruct;
use super::scatter::scatter;
use super::tiles::{ImageTile, for_each_tile};
use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::light::Lighting;
use crate::matrix::{BlockId, CHANNELS, ColumnIndex, ColumnTransform, FactorSource, MatrixShape, TILE_COEFFICIENTS};

/// All factors of a matrix, in memory in compact form.
pub struct CpuRelighter {
    shape: MatrixShape,
    /// One for each block; none where nothing of it could be read.
    blocks: Vec<Option<CompactBlock>>,
    /// What columns of the blocks are divided by; empty where all are 1.
    scales: Vec<f32>,
    transform: Arc<ColumnTransform>,
    damage: Vec<String>,
}

/// An image with what is needed to change a few of its lights without relighting from nothing.
#[derive(Clone, Debug)]
pub struct Relit {
    /// The image.
    pub image: LinearImage,
    /// The current weights of the lights.
    weights: Vec<[f32; CHANNELS]>,
    /// `R ℓ` of each block, kept in f64 so that any number of changes adds no visible rounding.
    projected: Vec<Vec<[f64; CHANNELS]>>,
}

impl CpuRelighter {
    /// Reads all factors of `source`. A damaged block keeps the layers before the damage, or becomes a hole; each is
    /// reported by [`damage`](Self::damage).
    ///
    /// # Errors
    /// What the source reports other than damage, and factors that do not fit the shape or are not finite.
    pub fn load(source: &dyn FactorSource) -> Result<Self> {
        let (shape, transform) = (source.shape(), source.column_transform());
        let read: Vec<_> = (0..shape.block_count())
            .into_par_iter()
            .map(|id| read_compact(source, &transform, BlockId(id)))
            .collect::<Result<_>>()?;
        let (blocks, damage): (Vec<_>, Vec<_>) = read.into_iter().unzip();
        let scales = source.column_scales().to_vec();
        Ok(Self { shape, blocks, scales, transform, damage: damage.into_iter().flatten().collect() })
    }

    /// Reads some blocks again with the layers that `source` has by now, as a container streams in.
    ///
    /// # Errors
    /// As [`load`](Self::load); the blocks stay as they were then.
    ///
    /// # Panics
    /// If the source has another shape, other scales of columns or another transform.
    pub fn refine(&mut self, source: &dyn FactorSource, ids: &[BlockId]) -> Result<()> {
        let transform = &*self.transform;
        assert_eq!((source.shape(), source.column_scales()), (self.shape, self.scales.as_slice()));
        assert_eq!(*source.column_transform(), *transform);
        let read: Vec<_> =
            ids.par_iter().map(|&id| Ok((id, read_compact(source, transform, id)?))).collect::<Result<_>>()?;
        for (id, (block, damage)) in read {
            self.blocks[id.index()] = block;
            self.damage.extend(damage.filter(|line| !self.damage.contains(line)));
        }
        Ok(())
    }

    /// Shape of the matrix.
    pub fn shape(&self) -> MatrixShape {
        self.shape
    }

    /// One line for each block that is shown with fewer layers than it has, or as a hole.
    pub fn damage(&self) -> &[String] {
        &self.damage
    }

    /// What columns of the blocks are divided by; empty where all are 1.
    pub(super) fn column_scales(&self) -> &[f32] {
        &self.scales
    }

    /// The transform in whose coefficients right sides are held.
    pub(super) fn column_transform(&self) -> &ColumnTransform {
        &self.transform
    }

    fn coefficients(&self, lighting: &Lighting) -> LightingCoefficients {
        LightingCoefficients::new(lighting, &self.scales, &self.transform)
    }

    /// The factors of a block, of columns divided by their scales; none where nothing of it could be read.
    pub(super) fn block(&self, id: BlockId) -> Option<&CompactBlock> {
        self.blocks[id.index()].as_ref()
    }

    /// Bytes that the factors take in memory: what one full relight reads.
    pub fn factor_bytes(&self) -> u64 {
        self.blocks.iter().flatten().map(|block| block.bytes() as u64).sum()
    }

    /// Mean rank over all blocks.
    pub fn mean_rank(&self) -> f64 {
        let ranks: usize = self.blocks.iter().flatten().map(CompactBlock::rank).sum();
        ranks as f64 / self.blocks.len() as f64
    }

    /// The image under `lighting`.
    ///
    /// # Errors
    /// A lighting with another number of columns than the matrix.
    pub fn relight(&self, lighting: &Lighting) -> Result<LinearImage> {
        let mut image = LinearImage::black(self.shape.width(), self.shape.height());
        self.relight_into(lighting, &mut image)?;
        Ok(image)
    }

    /// As [`relight`](Self::relight), into an image of the same size, all of whose pixels are set.
    ///
    /// # Errors
    /// A lighting with another number of columns than the matrix, or an image of another size.
    pub fn relight_into(&self, lighting: &Lighting, image: &mut LinearImage) -> Result<()> {
        check_columns(self.shape, lighting)?;
        check_size(self.shape, image)?;
        self.draw(&self.coefficients(lighting), image)
    }

    /// The image under a lighting, of the matrix's size.
    fn draw(&self, lighting: &LightingCoefficients, image: &mut LinearImage) -> Result<()> {
        for_each_tile(image, self.shape, |mut tile| {
            relight_block(self.blocks[tile.id.index()].as_ref(), lighting, &mut tile);
            Ok(())
        })
    }

    /// The image under `lighting`, kept so that [`change`](Self::change) can alter it.
    ///
    /// # Errors
    /// A lighting with another number of columns than the matrix.
    pub fn relight_kept(&self, lighting: &Lighting) -> Result<Relit> {
        check_columns(self.shape, lighting)?;
        let coefficients = self.coefficients(lighting);
        let projected = self
            .blocks
            .par_iter()
            .map_init(Vec::new, |scratch, block| {
                let Some(block) = block else { return Vec::new() };
                pulp::Arch::new().dispatch(Project { block, lighting: &coefficients, projected: scratch });
                scratch.iter().map(|sums| sums.map(f64::from)).collect()
            })
            .collect();
        let mut image = LinearImage::black(self.shape.width(), self.shape.height());
        self.draw(&coefficients, &mut image)?;
        Ok(Relit { image, weights: lighting.weights().to_vec(), projected })
    }

    /// Puts new weights on some columns of a kept image: costs the tiles of `R` that those columns are in and one pass over
    /// `L`, not a pass over `R`. Blocks that the columns do not reach are not touched.
    ///
    /// # Errors
    /// A column that the matrix does not have, a weight that is not finite, or an image that was not relit
    /// with a matrix of this shape; nothing is changed then.
    pub fn change(&self, relit: &mut Relit, changes: &[(ColumnIndex, [f32; CHANNELS])]) -> Result<()> {
        check_size(self.shape, &relit.image)?;
        if relit.projected.len() != self.blocks.len() || relit.weights.len() != self.shape.columns() {
            return Err(Error::input("kept image", "belongs to another matrix", "relight it anew"));
        }
        let mut weights = relit.weights.clone();
        for &(column, weight) in changes {
            let Some(target) = weights.get_mut(column.index()) else {
                let problem = format!("does not exist; the matrix has {} columns", self.shape.columns());
                return Err(Error::input(column.to_string(), problem, ""));
            };
            *target = weight;
        }
        let lighting = Lighting::new(weights)?;
        let mut columns: Vec<u32> = changes.iter().map(|(column, _)| column.0).collect();
        columns.sort_unstable();
        columns.dedup();
        let deltas: Vec<(u32, [f64; CHANNELS])> = columns
            .into_iter()
            .map(|column| {
                let (new, old) = (lighting.weights()[column as usize], relit.weights[column as usize]);
                let scale = f64::from(self.scales.get(column as usize).copied().unwrap_or(1.0));
                (column, [0, 1, 2].map(|ch| scale * (f64::from(new[ch]) - f64::from(old[ch]))))
            })
            .collect();
        let tiles = self.changed_tiles(&deltas);
        let reached: Vec<bool> = self
            .blocks
            .par_iter()
            .zip(&mut relit.projected)
            .map(|(block, projected)| block.as_ref().is_some_and(|block| block.change(&deltas, &tiles, projected)))
            .collect();
        let channels = scaled_channels(&lighting, &self.scales);
        let projected = &relit.projected;
        for_each_tile(&mut relit.image, self.shape, |mut tile| {
            if let (true, Some(block)) = (reached[tile.id.index()], &self.blocks[tile.id.index()]) {
                let sums: Vec<_> = projected[tile.id.index()].iter().map(|sums| sums.map(|sum| sum as f32)).collect();
                finish_block(block, &sums, &channels, &mut tile);
            }
            Ok::<_, Error>(())
        })?;
        relit.weights.copy_from_slice(lighting.weights());
        Ok(())
    }

    /// The coefficients of changes of columns in each tile that has any.
    fn changed_tiles(&self, deltas: &[(u32, [f64; CHANNELS])]) -> Vec<ChangedTile> {
        let mut changes: Vec<_> =
            deltas.iter().map(|&(column, delta)| (self.transform.tile_of(column as usize), (column, delta))).collect();
        changes.sort_by_key(|&(tile, _)| tile);
        let of_tile = |changes: &[(usize, (u32, [f64; CHANNELS]))]| {
            let index = changes[0].0;
            let tile = self.transform.tiles()[index];
            let mut weights = vec![[0.0; CHANNELS]; TILE_COEFFICIENTS];
            let changes = changes.iter().map(|&(_, (column, delta))| (column as usize, delta));
            self.transform.few_weights(tile, changes, &mut weights[..tile.len()]);
            ChangedTile { index, weights }
        };
        changes.chunk_by(|a, b| a.0 == b.0).map(of_tile).collect()
    }
}

/// The coefficients of a change in one tile.
struct ChangedTile {
    index: usize,
    /// One for each place of the tile, and zeros behind them.
    weights: Vec<[f64; CHANNELS]>,
}

impl CompactBlock {
    /// Adds `R Δ` of the changed columns; says whether the block's pixels can have changed.
    fn change(
        &self,
        deltas: &[(u32, [f64; CHANNELS])],
        tiles: &[ChangedTile],
        projected: &mut [[f64; CHANNELS]],
    ) -> bool {
        let mut reached = false;
        for tile in tiles {
            reached |= self.right.change(tile.index, &tile.weights, projected);
        }
        let has_entries = |column: u32| self.sparse.ends.binary_search_by_key(&column, |end| end.0).is_ok();
        reached || deltas.iter().any(|&(column, _)| has_entries(column))
    }
}

/// Relights without keeping factors: each thread holds one block at a time. Returns the image and one line for each
/// damaged block.
///
/// # Errors
/// As [`CpuRelighter::load`] and [`CpuRelighter::relight`].
///
/// # Panics
/// If another thread that relights has panicked.
pub fn relight_streaming(source: &dyn FactorSource, lighting: &Lighting) -> Result<(LinearImage, Vec<String>)> {
    let shape = source.shape();
    check_columns(shape, lighting)?;
    let transform = source.column_transform();
    let lighting = LightingCoefficients::new(lighting, source.column_scales(), &transform);
    let mut image = LinearImage::black(shape.width(), shape.height());
    let damage = std::sync::Mutex::new(Vec::new());
    for_each_tile(&mut image, shape, |mut tile| {
        let (block, damaged) = read_compact(source, &transform, tile.id)?;
        relight_block(block.as_ref(), &lighting, &mut tile);
        if let Some(line) = damaged {
            damage.lock().expect("no thread panics with it").push((tile.id, line));
        }
        Ok::<_, Error>(())
    })?;
    let mut damage = damage.into_inner().expect("no thread panics with it");
    damage.sort();
    Ok((image, damage.into_iter().map(|(_, line)| line).collect()))
}

/// Refuses a lighting with another number of columns than the matrix.
pub(crate) fn check_columns(shape: MatrixShape, lighting: &Lighting) -> Result<()> {
    let (has, needs) = (lighting.weights().len(), shape.columns());
    if has == needs {
        return Ok(());
    }
    Err(Error::input("lighting", format!("has {has} columns, the matrix {needs}"), "make it over the matrix's lights"))
}

/// Refuses an image of another size than the matrix.
pub(crate) fn check_size(shape: MatrixShape, image: &LinearImage) -> Result<()> {
    let (width, height) = (shape.width(), shape.height());
    if (image.width, image.height) == (width, height) {
        return Ok(());
    }
    let problem = format!("is {} × {} pixels, the matrix {width} × {height}", image.width, image.height);
    Err(Error::input("target image", problem, ""))
}

/// Sets the pixels of one block; a missing block becomes a marked hole.
pub(crate) fn relight_block(block: Option<&CompactBlock>, lighting: &LightingCoefficients, tile: &mut ImageTile) {
    match block {
        None => tile.mark_as_hole(),
        Some(block) if block.is_empty() => tile.clear(),
        Some(block) => {
            let mut projected = Vec::new();
            pulp::Arch::new().dispatch(Project { block, lighting, projected: &mut projected });
            finish_block(block, &projected, lighting.channels(), tile);
        }
    }
}

/// The rows of a block under a lighting, channel-planar: the bits that [`relight_block`] sets.
pub(super) fn relit_planes(block: &CompactBlock, lighting: &LightingCoefficients) -> Vec<f32> {
    let (mut projected, mut planes) = (Vec::new(), Vec::new());
    let arch = pulp::Arch::new();
    arch.dispatch(Project { block, lighting, projected: &mut projected });
    let channels = lighting.channels();
    arch.dispatch(ProductRows { block, projected: &projected, channels, planes: &mut planes });
    planes
}

fn finish_block(
    block: &CompactBlock,
    projected: &[[f32; CHANNELS]],
    channels: &[Vec<f32>; CHANNELS],
    tile: &mut ImageTile,
) {
    pulp::Arch::new().dispatch(Finish { block, projected, channels, tile });
}

/// `y = R ℓ`, compiled for the vectors that the machine has. Not a closure: what wraps one is compiled without them.
struct Project<'a> {
    block: &'a CompactBlock,
    lighting: &'a LightingCoefficients,
    projected: &'a mut Vec<[f32; CHANNELS]>,
}

impl pulp::NullaryFnOnce for Project<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        project(self.block, self.lighting, self.projected);
    }
}

/// `L y + S ℓ`, compiled as [`Project`].
struct ProductRows<'a> {
    block: &'a CompactBlock,
    projected: &'a [[f32; CHANNELS]],
    channels: &'a [Vec<f32>; CHANNELS],
    planes: &'a mut Vec<f32>,
}

impl pulp::NullaryFnOnce for ProductRows<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        reconstruct(self.block, self.projected, self.planes);
        scatter(self.block, self.channels, self.planes);
    }
}

/// `L y + S ℓ` and the block's pixels, compiled as [`Project`].
struct Finish<'a, 'b> {
    block: &'a CompactBlock,
    projected: &'a [[f32; CHANNELS]],
    channels: &'a [Vec<f32>; CHANNELS],
    tile: &'a mut ImageTile<'b>,
}

impl pulp::NullaryFnOnce for Finish<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let mut planes = Vec::new();
        reconstruct(self.block, self.projected, &mut planes);
        scatter(self.block, self.channels, &mut planes);
        self.tile.set(&planes);
    }
}
