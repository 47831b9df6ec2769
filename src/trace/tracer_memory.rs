//! The memory that tracing takes.

use super::TraceSettings;
use super::accumulator::{NoiseSums, PixelMeans, PixelSums};
use super::photons::Photons;
use super::planes::PlaneSums;
use crate::matrix::{CHANNELS, MatrixShape};
use crate::resources::MemoryNeed;
use crate::scene::{Scene, Triangle};

/// Bytes for each triangle of the BVH while it is built, about.
const BVH_TRIANGLE_BYTES: usize = 450;

/// What a [`Tracer`](super::Tracer) takes: once for the scene with its photons, and for each block that is traced beside its entries.
#[derive(Clone, Copy, Debug)]
pub struct TracerMemory<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Shape of the matrix.
    pub shape: MatrixShape,
    /// Number of clusters of its columns.
    pub clusters: usize,
    /// How it is traced.
    pub settings: TraceSettings,
}

impl TracerMemory<'_> {
    /// Arrays and textures of the scene, and the BVH.
    fn scene_bytes(&self) -> u64 {
        let mesh = &self.scene.mesh;
        let textures: u64 = self.scene.textures.iter().map(|texture| texture.texels.bytes()).sum();
        let vertices = size_of_val(&*mesh.vertices);
        textures + (vertices + mesh.triangles.len() * (BVH_TRIANGLE_BYTES + size_of::<Triangle>())) as u64
    }

    /// The photons, while the last of them are sorted.
    pub fn photon_bytes(&self) -> u64 {
        let pixels = u64::from(self.shape.width()) * u64::from(self.shape.height());
        Photons::needs_bytes(self.scene, pixels, self.settings)
    }
}

impl MemoryNeed for TracerMemory<'_> {
    fn fixed_bytes(&self) -> u64 {
        self.scene_bytes() + self.photon_bytes()
    }

    /// Sums and means of the current pixels, noise and planes. Noise and planes stay with the block.
    fn thread_bytes(&self) -> u64 {
        let (rows, columns) = (self.shape.max_block_rows() as u64, self.shape.columns() as u64);
        let sums = PixelSums::needs_bytes(columns) + PixelMeans::needs_bytes(columns);
        let planes = PlaneSums::needs_bytes(rows / CHANNELS as u64, columns, self.clusters as u64);
        sums + NoiseSums::needs_bytes(rows, columns) + planes
    }
}
