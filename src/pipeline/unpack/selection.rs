//! Selection of a part of a matrix: blocks or a crop of the image, and lights.

use std::ops::Range;

use super::source::UnpackSource;
use crate::error::{Error, Result};
use crate::light::names::meant;
use crate::light::{Job, Light, LightBasis};
use crate::matrix::{BlockId, CHANNELS, ColumnIndex, MatrixShape, PixelRect};

/// A part of a matrix; the default is all of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// Only these blocks. The rest of the image stays black, or missing in a stored matrix.
    pub blocks: Option<Range<u32>>,
    /// Only these pixels: the result has their size.
    pub crop: Option<PixelRect>,
    /// Only lights whose names match one of these patterns (`*` stands for any text); all if empty.
    pub lights: Vec<String>,
}

/// A selection checked against a job.
#[derive(Clone, Debug)]
pub(super) struct Selected {
    pub(super) rect: PixelRect,
    pub(super) blocks: Vec<BlockId>,
    pub(super) lights: Vec<Light>,
    is_whole: bool,
}

impl Selection {
    /// Errors: blocks or pixels outside the image, a pattern that matches no light.
    pub(super) fn of(&self, job: &Job) -> Result<Selected> {
        let shape = job.shape;
        let whole = PixelRect { x: 0, y: 0, width: shape.width(), height: shape.height() };
        let rect = self.crop.unwrap_or(whole);
        let inside = |at: u32, size: u32, limit: u32| size > 0 && at.checked_add(size).is_some_and(|end| end <= limit);
        if !inside(rect.x, rect.width, shape.width()) || !inside(rect.y, rect.height, shape.height()) {
            let problem = format!("the image has {} × {} pixels", shape.width(), shape.height());
            let place = format!("crop {},{},{}x{}", rect.x, rect.y, rect.width, rect.height);
            return Err(Error::input(place, problem, "give pixels inside it"));
        }
        let range = self.blocks.clone().unwrap_or(0..shape.block_count());
        if range.is_empty() || range.end > shape.block_count() {
            let problem = format!("the image has blocks 0..{}", shape.block_count());
            return Err(Error::input(
                format!("blocks {}..{}", range.start, range.end),
                problem,
                "give a range inside it",
            ));
        }
        let blocks = range.map(BlockId).filter(|&id| overlap(shape.rect(id), rect).is_some()).collect();
        let mut wanted = vec![self.lights.is_empty(); job.basis.lights().len()];
        for pattern in &self.lights {
            let found = meant(pattern, job.basis.lights().iter().map(|light| light.name.as_str()));
            found.iter().for_each(|&light| wanted[light] = true);
            if found.is_empty() {
                let names: Vec<_> = job.basis.lights().iter().take(12).map(|light| light.name.as_str()).collect();
                let hint = format!("the lights are {}", names.join(", "));
                return Err(Error::input(format!("light '{pattern}'"), "no light matches", hint));
            }
        }
        let all = job.basis.lights().iter().zip(wanted);
        let lights: Vec<Light> = all.filter(|(_, wanted)| *wanted).map(|(light, _)| light.clone()).collect();
        let is_whole = rect == whole && lights.len() == job.basis.lights().len();
        Ok(Selected { rect, blocks, lights, is_whole })
    }
}

impl Selected {
    /// The job of the selected pixels and lights: unchanged if that is all of them.
    pub(super) fn job(&self, job: &Job) -> Result<Job> {
        if self.is_whole {
            return Ok(job.clone());
        }
        let mut basis = LightBasis::new();
        for light in &self.lights {
            let first_column = basis.column_count() as u32;
            basis.push(light.clone())?;
            if let Some((_, weights)) = job.basis.own_scene_weights().iter().find(|own| own.0 == light.first_column) {
                basis.set_scene_weights(first_column, weights.clone())?;
            }
        }
        let PixelRect { x, y, width, height } = self.rect;
        let shape = MatrixShape::new(width, height, basis.column_count() as u32, job.shape.block_side())?;
        let mut provenance = job.provenance.clone();
        provenance.settings += &format!("; pixels {x},{y},{width}x{height} and {} lights of it", self.lights.len());
        Ok(Job { shape, basis, provenance })
    }

    /// The selected columns of the whole matrix, in order.
    pub(super) fn columns(&self) -> Vec<ColumnIndex> {
        self.lights.iter().flat_map(|light| light.columns().map(ColumnIndex)).collect()
    }

    /// The blocks of [`job`](Self::job) that the selected blocks cover.
    pub(super) fn target_blocks(&self, job: &Job, target: &Job) -> Vec<BlockId> {
        let filled = |id: &BlockId| {
            let rect = self.in_source(target.shape.rect(*id));
            job.shape
                .blocks()
                .filter(|&id| overlap(job.shape.rect(id), rect).is_some())
                .all(|id| self.blocks.contains(&id))
        };
        match self.blocks.len() == job.shape.block_count() as usize {
            true => target.shape.blocks().collect(),
            false => target.shape.blocks().filter(filled).collect(),
        }
    }

    /// Fills `entries`, which are 0, with a block of the selection, column-major.
    pub(super) fn fill(
        &self,
        source: &dyn UnpackSource,
        target: PixelRect,
        columns: &[ColumnIndex],
        entries: &mut [f32],
    ) -> Result<()> {
        let wanted = self.in_source(target);
        let shape = source.job().shape;
        for id in self.blocks.iter().copied() {
            let rect = shape.rect(id);
            let Some(part) = overlap(rect, wanted) else { continue };
            source.visit(id, columns, &mut |place, values| {
                let target_column = &mut entries[place * target.rows()..][..target.rows()];
                for channel in 0..CHANNELS {
                    for y in part.y..part.y + part.height {
                        let from = (channel * rect.height as usize + (y - rect.y) as usize) * rect.width as usize;
                        let to = (channel * wanted.height as usize + (y - wanted.y) as usize) * wanted.width as usize;
                        let (from, to) = (from + (part.x - rect.x) as usize, to + (part.x - wanted.x) as usize);
                        let width = part.width as usize;
                        target_column[to..to + width].copy_from_slice(&values[from..from + width]);
                    }
                }
            })?;
        }
        Ok(())
    }

    fn in_source(&self, target: PixelRect) -> PixelRect {
        PixelRect { x: target.x + self.rect.x, y: target.y + self.rect.y, ..target }
    }
}

/// Intersection of two rectangles.
pub(super) fn overlap(a: PixelRect, b: PixelRect) -> Option<PixelRect> {
    let (x, y) = (a.x.max(b.x), a.y.max(b.y));
    let (right, bottom) = ((a.x + a.width).min(b.x + b.width), (a.y + a.height).min(b.y + b.height));
    (x < right && y < bottom).then(|| PixelRect { x, y, width: right - x, height: bottom - y })
}
