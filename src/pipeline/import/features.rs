//! Feature planes for denoising, from the passes of two renderings.

use std::path::Path;

use sha2::{Digest, Sha256};

use crate::error::Result;
use crate::image::{FeaturePasses, LightRow};
use crate::matrix::{CHANNELS, FEATURE_PLANES, Feature, PixelRect};
use crate::pipeline::row_spill::{RowPlace, RowSpill};
use crate::resources::Threads;

/// Images of one rendering: albedo, normal, depth.
const IMAGES: usize = 3;
/// Depths from here on mean that nothing is visible: Blender writes 10¹⁰ there.
const FARTHEST: f32 = 1e9;

/// Albedo, normal and depth of one or two renderings, kept in a file.
#[derive(Debug)]
pub(super) struct ImportedFeatures {
    rows: RowSpill,
    size: (usize, usize),
    /// Which rendering has which image. Without any, albedo is 1 and all pixels are alike.
    has: [[bool; IMAGES]; 2],
}

impl ImportedFeatures {
    /// Bytes of disk for the images.
    pub(super) fn disk_bytes(width: u32, height: u32) -> u64 {
        RowSpill::bytes(2 * IMAGES, width as usize, height as usize)
    }

    /// Reads the passes of two renderings of one size, where there are any.
    ///
    /// # Errors
    /// Those of reading, and of the disk.
    pub(super) fn read(
        passes: [Option<&FeaturePasses>; 2],
        (width, height): (u32, u32),
        beside: &Path,
        threads: usize,
    ) -> Result<Self> {
        let size = (width as usize, height as usize);
        let rows = RowSpill::create(beside, 2 * IMAGES, size.0, size.1)?;
        let mut has = [[false; IMAGES]; 2];
        for (rendering, passes) in passes.iter().enumerate() {
            let Some(passes) = passes else { continue };
            let mut take = |row: LightRow<'_>| {
                has[rendering][row.image] = true;
                // Values that are not finite count as not visible.
                let values: Vec<f32> = row.values.iter().map(|v| if v.is_finite() { *v } else { 0.0 }).collect();
                rows.write(
                    RowPlace { image: rendering * IMAGES + row.image, channel: row.channel, y: row.y, x: row.x },
                    &values,
                )
            };
            Threads::new(threads)?.run(|| passes.read(&mut take))?;
        }
        Ok(Self { rows, size, has })
    }

    /// Adds the images to the content hash of a matrix.
    ///
    /// # Errors
    /// Those of the disk.
    pub(super) fn add_to(&self, content: &mut Sha256) -> Result<()> {
        let mut row = vec![0.0; self.size.0];
        for image in 0..2 * IMAGES {
            for (channel, y) in (0..CHANNELS).flat_map(|channel| (0..self.size.1).map(move |y| (channel, y))) {
                self.rows.read(RowPlace { image, channel, y, x: 0 }, &mut row)?;
                content.update(bytemuck::cast_slice(&row));
            }
        }
        Ok(())
    }

    /// The features of a rectangle of pixels, and their variances. For the mean of two renderings the variance is a
    /// quarter of the squared difference; for one rendering it is 0.
    ///
    /// # Errors
    /// Those of the disk.
    pub(super) fn of(&self, rect: PixelRect) -> Result<(Vec<f32>, Vec<f32>)> {
        let each: Vec<Vec<f32>> = match self.has.map(|has| has.contains(&true)) {
            [true, true] => vec![self.planes(0, rect)?, self.planes(1, rect)?],
            [_, true] => vec![self.planes(1, rect)?],
            _ => vec![self.planes(0, rect)?],
        };
        Ok(match &each[..] {
            [a, b] => {
                let pairs = || a.iter().zip(b);
                (
                    pairs().map(|(a, b)| 0.5 * (a + b)).collect(),
                    pairs().map(|(a, b)| 0.25 * (a - b) * (a - b)).collect(),
                )
            }
            _ => (each[0].clone(), vec![0.0; each[0].len()]),
        })
    }

    fn planes(&self, rendering: usize, rect: PixelRect) -> Result<Vec<f32>> {
        let pixels = rect.pixels();
        let mut planes = vec![0.0; FEATURE_PLANES * pixels];
        let has = self.has[rendering];
        for (image, feature) in [Feature::Albedo, Feature::Normal, Feature::Depth].into_iter().enumerate() {
            for (channel, plane) in feature.planes().enumerate() {
                let plane = &mut planes[plane * pixels..][..pixels];
                if !has[image] {
                    plane.fill(if feature == Feature::Albedo { 1.0 } else { 0.0 });
                    continue;
                }
                for (y, row) in plane.chunks_exact_mut(rect.width as usize).enumerate() {
                    let (image, y, x) = (rendering * IMAGES + image, rect.y as usize + y, rect.x as usize);
                    self.rows.read(RowPlace { image, channel, y, x }, row)?;
                }
            }
        }
        let [albedo, depth, surface] = [Feature::Albedo, Feature::Depth, Feature::Surface].map(Feature::planes);
        planes[albedo.start * pixels..albedo.end * pixels].iter_mut().for_each(|v| *v = v.max(0.0));
        for pixel in 0..pixels {
            let depth = &mut planes[depth.start * pixels + pixel];
            if *depth >= FARTHEST || *depth < 0.0 {
                *depth = 0.0;
            }
            let seen = !has[2] || *depth > 0.0;
            planes[surface.start * pixels + pixel] = f32::from(u8::from(seen));
        }
        Ok(planes)
    }
}
