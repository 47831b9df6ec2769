//! Export of the images that are denoised to an EXR, and import of the result of any other denoiser.

use std::io::Read;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use crate::error::{Error, Hint, Result};
use crate::files::open_input;
use crate::image::{LayerPattern, LightRow, LightSet};
use crate::light::{Clusters, Job};
use crate::matrix::{CHANNELS, PixelRect};
use crate::resources::MemoryNeed;

/// Prefix of layer names; two or more digits follow, the index of the cluster.
pub(crate) const BASIS_LAYER: &str = "basis.";

/// Denoised images from a file.
pub(crate) struct ExternalImages {
    path: PathBuf,
    set: LightSet,
    /// The cluster of each image.
    clusters: Vec<usize>,
    /// SHA-256 of the file.
    pub(crate) hash: [u8; 32],
}

impl MemoryNeed for ExternalImages {
    /// What reading it takes.
    fn fixed_bytes(&self) -> u64 {
        let images =
            (self.clusters.len() * CHANNELS * 4) as u64 * u64::from(self.set.width) * u64::from(self.set.height);
        images + self.set.fixed_bytes()
    }
}

impl ExternalImages {
    /// Opens a file and checks that it has the images of this job.
    ///
    /// # Errors
    /// No EXR, another size, an image that is missing or not known.
    pub(crate) fn open(path: &Path, job: &Job) -> Result<Self> {
        let refuse = |problem: String| Error::input(path.display().to_string(), problem, Hint::ImagesForDenoiser);
        let pattern: LayerPattern = r"^basis\.([0-9]+)$".parse().expect("the expression is valid");
        let set = LightSet::open(path, Some(&pattern))?;
        let (width, height) = (job.shape.width(), job.shape.height());
        if (set.width, set.height) != (width, height) {
            return Err(refuse(format!("it is {} × {} pixels, the matrix {width} × {height}", set.width, set.height)));
        }
        let count = Clusters::of_basis(&job.basis).count();
        let clusters: Vec<usize> = set.lights.iter().map(|name| name.parse().unwrap_or(usize::MAX)).collect();
        if let Some(missing) = (0..count).find(|cluster| !clusters.contains(cluster)) {
            return Err(refuse(format!("layer {BASIS_LAYER}{missing:02} is missing, of {count}")));
        }
        if clusters.len() != count {
            return Err(refuse(format!("it has {} layers {BASIS_LAYER}…, the matrix needs {count}", clusters.len())));
        }
        let hash = hash_of(path)?;
        Ok(Self { path: path.to_owned(), set, clusters, hash })
    }

    /// The images: clusters × channels × pixels of the whole picture.
    ///
    /// # Errors
    /// The file cannot be read or has changed; a value that is not finite.
    pub(crate) fn read(&self) -> Result<BasisImages> {
        let (width, height) = (self.set.width as usize, self.set.height as usize);
        let mut values = vec![0.0f32; self.clusters.len() * CHANNELS * width * height];
        self.set.read(&mut |LightRow { image, channel, x, y, values: row }| {
            // The layer after those of the clusters, if there is one, is the image under all lights.
            if let Some(cluster) = self.clusters.get(image) {
                if row.iter().any(|value| !value.is_finite()) {
                    let place = format!("{}, layer {BASIS_LAYER}{cluster:02}, row {y}", self.path.display());
                    return Err(Error::input(place, "holds a value that is not finite", "denoise the images again"));
                }
                values[((cluster * CHANNELS + channel) * height + y) * width + x..][..row.len()].copy_from_slice(row);
            }
            Ok(())
        })?;
        Ok(BasisImages { width, height, values })
    }
}

/// SHA-256 of a file.
fn hash_of(path: &Path) -> Result<[u8; 32]> {
    let mut file = open_input(path, "open")?;
    let (mut hash, mut buffer) = (Sha256::new(), vec![0u8; 1 << 16]);
    loop {
        match file.read(&mut buffer).map_err(Error::io(path, "read"))? {
            0 => return Ok(hash.finalize().into()),
            length => hash.update(&buffer[..length]),
        }
    }
}

/// See [`ExternalImages::read`].
pub(crate) struct BasisImages {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl BasisImages {
    /// The pixels of a rectangle as bytes, plane by plane.
    pub(crate) fn bytes_of(&self, rect: PixelRect) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(4 * self.values.len() / (self.width * self.height) * rect.pixels());
        for plane in self.values.chunks_exact(self.width * self.height) {
            for y in rect.y..rect.y + rect.height {
                let row = &plane[y as usize * self.width + rect.x as usize..][..rect.width as usize];
                bytes.extend_from_slice(bytemuck::cast_slice(row));
            }
        }
        bytes
    }
}
