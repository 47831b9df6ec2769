//! The images that cleaning works on, out to an EXR and back: so that a denoiser of one's own serves every lighting.

use std::io::Read;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::features::{FEATURE_CHANNELS, unknown};
use super::strip::{Strip, strip_bytes};
use crate::error::{Error, Hint, Result};
use crate::files::open_input;
use crate::host::{Need, PROGRAM_BYTES, Watch};
use crate::image::{ImageSize, LayerPattern, LightRow, LightSet, exr_rows_need_bytes, write_exr_channels};
use crate::light::{Clusters, Job};
use crate::matrix::{BlockPlanes, BlockSource, CHANNELS, FEATURE_PLANES, PixelRect};
use crate::store::{self, StoreReader};

/// Begins the name of each layer; two or more digits follow, the number of the cluster.
const LAYER: &str = "basis.";

/// Writes the images of the clusters of columns of a matrix as one EXR of 32-bit channels: layers `basis.00` onwards with R,
/// G, B, and [`FEATURE_CHANNELS`]. An image is the sum of the columns of a cluster (`light::Clusters`) in their unit, without
/// the emitters in view, which are exact as they are. `pack` takes the file back, cleaned
/// ([`PackOptions::basis`](super::PackOptions::basis)). Returns the number of images.
///
/// # Errors
/// The matrix lacks blocks or knows nothing of its samples; a block is damaged; the memory is too small;
/// [`Error::Interrupted`]; what writing refuses.
pub fn write_basis(matrix: &StoreReader, path: &Path, memory_bytes: Option<u64>, watch: &dyn Watch) -> Result<usize> {
    let shape = BlockSource::shape(matrix);
    let clusters = Clusters::of_basis(&matrix.job().basis).count();
    let size = ImageSize { width: shape.width() as usize, height: shape.height() as usize };
    let planes = CHANNELS * clusters + FEATURE_PLANES;
    let mut strip = Strip::new(shape, planes, |id| {
        let planes = matrix.read_planes(id, None)?.ok_or_else(|| unknown(id.to_string()))?;
        let mut values = images_of(&planes, matrix.job().provenance.samples_per_pixel);
        values.extend_from_slice(&planes.features);
        Ok(Some(values))
    });
    let reading = store::requirements(matrix.job(), &matrix.options()).memory_bytes;
    let rows = strip_bytes(shape, planes) + exr_rows_need_bytes(planes.div_ceil(3), size);
    let need = Need { fixed_bytes: PROGRAM_BYTES + reading + rows, ..Need::default() };
    need.threads_within("writing the basis images", memory_bytes)?;
    let layers = (0..clusters).flat_map(|k| ["R", "G", "B"].map(|colour| format!("{LAYER}{k:02}.{colour}")));
    let names: Vec<String> = layers.chain(FEATURE_CHANNELS.map(str::to_owned)).collect();
    watch.begin("writing the basis images", u64::from(shape.blocks_down()), "rows of blocks");
    let written = write_exr_channels(path, &names, size, &mut |channel, y, row| strip.copy_row(channel, y, row, watch));
    watch.end();
    written.map(|()| clusters)
}

/// The images of a block, direct and indirect light together: the mean of the halves, of which the first has one sample more
/// where their number is odd.
fn images_of(planes: &BlockPlanes, samples: u32) -> Vec<f32> {
    let second = if samples > 1 { (samples / 2) as f32 / samples as f32 } else { 0.5 };
    let mean = |halves: &[Vec<f32>; 2], i: usize| halves[0][i] + second * (halves[1][i] - halves[0][i]);
    (0..planes.direct[0].len()).map(|i| mean(&planes.direct, i) + mean(&planes.indirect, i)).collect()
}

/// Cleaned images that a file brings.
pub(super) struct Basis {
    path: PathBuf,
    set: LightSet,
    /// The cluster of each image.
    clusters: Vec<usize>,
    /// SHA-256 of the file.
    pub(super) hash: [u8; 32],
}

impl Basis {
    /// Looks at a file and checks that it has the images of this job.
    ///
    /// # Errors
    /// No EXR, another size, an image that is missing or not known.
    pub(super) fn open(path: &Path, job: &Job) -> Result<Self> {
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
            return Err(refuse(format!("layer {LAYER}{missing:02} is missing, of {count}")));
        }
        if clusters.len() != count {
            return Err(refuse(format!("it has {} layers {LAYER}…, the matrix needs {count}", clusters.len())));
        }
        let hash = hash_of(path)?;
        Ok(Self { path: path.to_owned(), set, clusters, hash })
    }

    /// Bytes that reading it takes at most.
    pub(super) fn needs_bytes(&self) -> u64 {
        let images =
            (self.clusters.len() * CHANNELS * 4) as u64 * u64::from(self.set.width) * u64::from(self.set.height);
        images + self.set.needs_bytes()
    }

    /// The images: clusters × channels × pixels of the whole picture.
    ///
    /// # Errors
    /// The file cannot be read or has changed; a value that is not finite.
    pub(super) fn read(&self) -> Result<BasisImages> {
        let (width, height) = (self.set.width as usize, self.set.height as usize);
        let mut values = vec![0.0f32; self.clusters.len() * CHANNELS * width * height];
        self.set.read(&mut |LightRow { image, channel, x, y, values: row }| {
            // Beyond the clusters' comes the image under all lights, where the file has one.
            if let Some(cluster) = self.clusters.get(image) {
                if row.iter().any(|value| !value.is_finite()) {
                    let place = format!("{}, layer {LAYER}{cluster:02}, row {y}", self.path.display());
                    return Err(Error::input(place, "holds a value that is not finite", "clean the images again"));
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

/// See [`Basis::read`].
pub(super) struct BasisImages {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl BasisImages {
    /// The pixels of a rectangle as bytes, plane by plane.
    pub(super) fn bytes_of(&self, rect: PixelRect) -> Vec<u8> {
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
