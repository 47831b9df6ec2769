//! Opening a matrix, stored or packed, by its path.

use std::path::Path;
use std::sync::OnceLock;

use crate::blob_store::is_object;
use crate::container::ContainerReader;
use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::light::{Job, LightBasis, Lighting};
use crate::matrix::{Block, BlockId, BlockSource, MatrixShape, PixelRect, TracedBlock};
use crate::pipeline::{check_matrix_path, open_container};
use crate::relight::{CpuRelighter, relight_raw, relight_region_streaming};
use crate::resources::budget_bytes;
use crate::store::StoreReader;

/// A file that holds a matrix.
pub enum MatrixFile {
    /// A container (`.ltc`), here or in an object store.
    Container(Box<ContainerReader>),
    /// A stored matrix (`.ltm`), finished or not (`.ltm.part`).
    Stored(Box<StoreReader>),
}

impl MatrixFile {
    /// Opens either kind, by its name or else by what it holds.
    ///
    /// # Errors
    /// The file cannot be read, is neither, or is damaged where it says what it is.
    pub fn open(path: &Path) -> Result<Self> {
        let is = |wanted: &str| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(wanted));
        if is_object(path) {
            if is("ltm") {
                check_matrix_path(path)?;
            }
            return open_container(path).map(Box::new).map(Self::Container);
        }
        if is("ltc") {
            return ContainerReader::open(path).map(Box::new).map(Self::Container);
        }
        if is("ltm") || is("part") {
            return StoreReader::open(path).map(Box::new).map(Self::Stored);
        }
        match ContainerReader::open(path) {
            Err(Error::Input { .. }) => StoreReader::open(path).map(Box::new).map(Self::Stored),
            other => other.map(Box::new).map(Self::Container),
        }
    }

    /// What it is a matrix of.
    pub fn job(&self) -> &Job {
        match self {
            Self::Container(container) => container.job(),
            Self::Stored(matrix) => matrix.job(),
        }
    }
}

/// An open matrix, stored or packed: what [`open`] gives.
pub struct Matrix {
    file: MatrixFile,
    /// The factors of a container once they were asked for; none where they do not fit the memory, or are not whole.
    factors: OnceLock<Option<CpuRelighter>>,
}

/// Opens a matrix: a container, a stored matrix, or a container in an object store (`s3://BUCKET/NAME`).
///
/// ```no_run
/// let matrix = ltm::open("room.ltc")?;
/// let evening = ltm::Lighting::of_scene(matrix.basis()).with("desk*", 0.0)?;
/// let image = matrix.relight(&evening)?;
/// println!("{} × {}: {:?} …", image.width, image.height, image.pixels[0]);
/// # Ok::<(), ltm::Error>(())
/// ```
///
/// # Errors
/// Those of [`MatrixFile::open`].
pub fn open(path: impl AsRef<Path>) -> Result<Matrix> {
    Ok(Matrix { file: MatrixFile::open(path.as_ref())?, factors: OnceLock::new() })
}

impl Matrix {
    /// The file.
    pub fn file(&self) -> &MatrixFile {
        &self.file
    }

    /// Its pixels, its columns, and the blocks that it is cut into.
    pub fn shape(&self) -> MatrixShape {
        self.file.job().shape
    }

    /// Its lights, in column order.
    pub fn basis(&self) -> &LightBasis {
        &self.file.job().basis
    }

    /// The image `T ℓ` under a lighting. Of a container the first call reads the factors and keeps them, where they fit the memory
    /// that the system has; each call after that is one product. Of a stored matrix every call reads all of it.
    ///
    /// # Errors
    /// A lighting over other lights; a block that is damaged, missing or cannot be read.
    pub fn relight(&self, lighting: &Lighting) -> Result<LinearImage> {
        let container = match &self.file {
            MatrixFile::Container(container) => container,
            MatrixFile::Stored(matrix) => {
                return Ok(relight_raw(&**matrix, std::slice::from_ref(lighting))?.remove(0));
            }
        };
        if let Some(factors) = self.factors(container)? {
            return factors.relight(lighting);
        }
        let (width, height) = (self.shape().width(), self.shape().height());
        let mut image = LinearImage::black(width, height);
        let whole = PixelRect { x: 0, y: 0, width, height };
        relight_region_streaming(&**container, std::slice::from_ref(lighting), whole, &mut image.pixels)?;
        Ok(image)
    }

    /// One block of `T`: rows (all pixels of red, then of green, then of blue; pixels row by row) × columns, column by column.
    ///
    /// # Errors
    /// The block is damaged, missing or cannot be read.
    pub fn read_block(&self, id: BlockId) -> Result<Block> {
        match &self.file {
            MatrixFile::Container(container) => Ok(container.read_block(id)?.expand()),
            MatrixFile::Stored(matrix) => {
                let mut traced = TracedBlock::default();
                matrix.read_block(id, &mut traced)?;
                Ok(traced.block)
            }
        }
    }

    /// The factors, kept; none where they do not fit the memory, or where some are damaged: reading block by block then says which.
    fn factors(&self, container: &ContainerReader) -> Result<Option<&CpuRelighter>> {
        if self.factors.get().is_none() {
            // No lock is held meanwhile: a thread of the pool that waits takes up other work, which may relight too.
            let fits = container.factors_bytes() <= budget_bytes(None);
            let read = if fits { Some(CpuRelighter::load(container)?) } else { None };
            let _ = self.factors.set(read.filter(|read| read.damage().is_empty()));
        }
        Ok(self.factors.get().and_then(Option::as_ref))
    }
}
