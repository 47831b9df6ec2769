//! A matrix in memory: an image for each column.

use std::borrow::Cow;

use sha2::{Digest, Sha256};

use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::light::{DescribedSource, Job, Light, LightBasis, LightKind, Provenance};
use crate::matrix::{BlockId, BlockSource, CHANNELS, MatrixShape, TracedBlock};

/// Values that are hashed at a time.
const HASHED_PIXELS: usize = 1 << 16;

/// A matrix in memory, of one image for each column: what [`pack`](crate::pack()) compresses where no file holds it.
///
/// ```
/// use ltm::{LinearImage, MemoryMatrix};
///
/// let desk = LinearImage { width: 2, height: 1, pixels: vec![[0.5; 3], [0.1; 3]] };
/// let matrix = MemoryMatrix::from_images([("desk", desk), ("ceiling", LinearImage::black(2, 1))])?;
/// assert_eq!(matrix.basis().lights()[1].name, "ceiling");
/// # Ok::<(), ltm::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct MemoryMatrix<'a> {
    job: Job,
    /// Image by image, each row by row.
    values: Cow<'a, [[f32; CHANNELS]]>,
}

impl MemoryMatrix<'static> {
    /// A matrix of the images of lights, each by its name: linear Rec. 709, all of one size.
    ///
    /// # Errors
    /// No images, images of different sizes, names that are empty or taken, more than a matrix can have.
    pub fn from_images<N: Into<String>>(images: impl IntoIterator<Item = (N, LinearImage)>) -> Result<Self> {
        let (mut basis, mut values, mut size) = (LightBasis::new(), Vec::new(), None);
        for (name, image) in images {
            let name = name.into();
            let (width, height) = *size.get_or_insert((image.width, image.height));
            let pixels = width as usize * height as usize;
            if (image.width, image.height) != (width, height) || image.pixels.len() != pixels {
                let problem = format!("is not of {width} × {height} pixels, as the first one is");
                return Err(Error::input(format!("the image of light '{name}'"), problem, "give images of one size"));
            }
            basis.push(Light::unplaced(name, LightKind::Image))?;
            values.extend_from_slice(&image.pixels);
        }
        let size = size.ok_or_else(|| Error::input("the images", "there are none", "give one for each light"))?;
        Self::from_array(values, size, basis)
    }

    /// A matrix of the pixels that `pixel` gives for x, y (from the top) and column.
    ///
    /// # Errors
    /// Those of [`from_array`](Self::from_array).
    pub fn from_fn(
        (width, height): (u32, u32),
        basis: LightBasis,
        pixel: impl Fn(u32, u32, usize) -> [f32; CHANNELS],
    ) -> Result<Self> {
        let columns = 0..basis.column_count();
        let image = |column| (0..height).flat_map(move |y| (0..width).map(move |x| (x, y, column)));
        let values: Vec<_> = columns.flat_map(image).map(|(x, y, column)| pixel(x, y, column)).collect();
        Self::from_array(values, (width, height), basis)
    }
}

impl<'a> MemoryMatrix<'a> {
    /// A matrix of an array, columns × height × width of RGB, kept or borrowed.
    ///
    /// # Errors
    /// Another number of values than the columns of `basis` have pixels; no pixels, or more than a matrix can have.
    pub fn from_array(
        values: impl Into<Cow<'a, [[f32; CHANNELS]]>>,
        (width, height): (u32, u32),
        basis: LightBasis,
    ) -> Result<Self> {
        let (values, columns) = (values.into(), basis.column_count());
        let shape = MatrixShape::new(width, height, columns as u32, MatrixShape::DEFAULT_BLOCK_SIDE)?;
        let needed = u128::from(width) * u128::from(height) * columns as u128;
        if values.len() as u128 != needed {
            let problem = format!("has {} pixels, {columns} columns of {width} × {height} have {needed}", values.len());
            return Err(Error::input("the array", problem, "give one image for each column"));
        }
        let content = values.chunks(HASHED_PIXELS).fold(Sha256::new(), |mut hash, values| {
            let bytes: Vec<u8> = values.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect();
            hash.update(&bytes);
            hash
        });
        let program = format!("ltm {}", env!("CARGO_PKG_VERSION"));
        let provenance =
            Provenance { source: "images".into(), program, content: content.finalize().into(), ..Default::default() };
        Ok(Self { job: Job { shape, basis, provenance }, values })
    }

    /// The same, cut into blocks of another side.
    ///
    /// # Errors
    /// Those of [`MatrixShape::new`].
    pub fn with_block_side(mut self, block_side: u32) -> Result<Self> {
        let shape = self.job.shape;
        self.job.shape = MatrixShape::new(shape.width(), shape.height(), shape.columns() as u32, block_side)?;
        Ok(self)
    }

    /// The same, said to be of another source and program.
    #[must_use]
    pub fn made_by(mut self, source: impl Into<String>, program: impl Into<String>) -> Self {
        (self.job.provenance.source, self.job.provenance.program) = (source.into(), program.into());
        self
    }

    /// The lights, in column order.
    pub fn basis(&self) -> &LightBasis {
        &self.job.basis
    }
}

impl DescribedSource for MemoryMatrix<'_> {
    fn job(&self) -> &Job {
        &self.job
    }
}

impl BlockSource for MemoryMatrix<'_> {
    fn shape(&self) -> MatrixShape {
        self.job.shape
    }

    fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> Result<()> {
        let shape = self.job.shape;
        let (rect, width) = (shape.rect(id), shape.width() as usize);
        target.block.reset(rect.rows(), shape.columns());
        (target.noise, target.planes) = (None, None);
        let images = self.values.chunks_exact(width * shape.height() as usize);
        for (image, column) in images.zip(target.block.entries_mut().chunks_exact_mut(rect.rows())) {
            for (channel, plane) in column.chunks_exact_mut(rect.pixels()).enumerate() {
                for (y, row) in plane.chunks_exact_mut(rect.width as usize).enumerate() {
                    let pixels = &image[(rect.y as usize + y) * width + rect.x as usize..];
                    row.iter_mut().zip(pixels).for_each(|(entry, pixel)| *entry = pixel[channel]);
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: u32, height: u32, light: f32) -> LinearImage {
        let pixels = (0..width * height).map(|i| [light, i as f32, 0.5]).collect();
        LinearImage { width, height, pixels }
    }

    #[test]
    fn a_block_has_the_pixels_of_its_place_from_every_image() {
        let images = [("a", image(5, 3, 1.0)), ("b", image(5, 3, 2.0))];
        let matrix = MemoryMatrix::from_images(images).unwrap().with_block_side(2).unwrap();
        let mut traced = TracedBlock::default();
        // The last block: one pixel, x 4 and y 2.
        matrix.read_block(BlockId(5), &mut traced).unwrap();
        assert_eq!(traced.block.entries(), [1.0, 14.0, 0.5, 2.0, 14.0, 0.5]);
        let basis = matrix.basis().clone();
        let same = |x, y, column: usize| [1.0 + column as f32, (x + 5 * y) as f32, 0.5];
        let same = MemoryMatrix::from_fn((5, 3), basis, same).unwrap().with_block_side(2).unwrap();
        assert_eq!(same.job().hash(), matrix.job().hash());
        same.read_block(BlockId(1), &mut traced).unwrap();
        let other = &mut TracedBlock::default();
        matrix.read_block(BlockId(1), other).unwrap();
        assert_eq!(traced.block.entries(), other.block.entries());
    }

    #[test]
    fn images_that_are_no_matrix_are_refused() {
        let none: [(&str, LinearImage); 0] = [];
        assert!(MemoryMatrix::from_images(none).is_err());
        let error = MemoryMatrix::from_images([("a", image(5, 3, 1.0)), ("b", image(3, 5, 1.0))]).unwrap_err();
        assert!(error.to_string().contains("'b'"), "{error}");
        assert!(MemoryMatrix::from_images([("a", image(2, 2, 1.0)), ("a", image(2, 2, 1.0))]).is_err());
        let basis = MemoryMatrix::from_images([("a", image(2, 2, 1.0))]).unwrap().basis().clone();
        assert!(MemoryMatrix::from_array(vec![[0.0; 3]; 3], (2, 2), basis).is_err());
    }
}
