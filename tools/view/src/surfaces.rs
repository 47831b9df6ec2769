//! What is known of the surfaces in view: how much of the light on them they send on.

use std::path::Path;

use ltm::container::ContainerReader;
use ltm::error::{Error, Result};
use ltm::matrix::{BlockSource, FEATURE_PLANES, FactorSource, Feature};
use ltm::store::StoreReader;

/// Least share of a pixel's samples on a surface, and most by mirrors, glass and emitters, with which the pixel shows that
/// surface alone.
const SURFACE_SHARE: f32 = 0.95;
const OTHER_SHARE: f32 = 0.05;
/// Albedo below which a surface tells nothing of the light on it.
const LEAST_ALBEDO: f32 = 0.02;

/// The albedo of each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Surfaces {
    albedo: Vec<Option<[f32; 3]>>,
}

impl Surfaces {
    /// Reads them from the matrix that a container was made of: `room.ltm` beside `room.ltc`.
    ///
    /// Errors: there is no such file, it is another scene's or view's, it knows nothing of its samples, or cannot be read.
    pub fn beside(container_path: &Path, container: &ContainerReader) -> Result<Self> {
        let path = container_path.with_extension("ltm");
        let matrix = StoreReader::open(&path)?;
        let shape = BlockSource::shape(&matrix);
        let refuse = |problem: &str| Err(Error::input(path.display().to_string(), problem, ""));
        let job = matrix.job();
        let same_view = (shape.width(), shape.height()) == (container.shape().width(), container.shape().height());
        if !same_view || job.provenance.content != container.job().provenance.content {
            return refuse("is the matrix of another scene or view");
        }
        let mut surfaces = Self { albedo: vec![None; shape.width() as usize * shape.height() as usize] };
        let (mut reused, mut known) = (None, false);
        for id in shape.blocks().filter(|&id| matrix.is_committed(id)) {
            let Some(block) = matrix.read_planes(id, reused.take())? else { continue };
            known = true;
            let rect = shape.rect(id);
            let pixels = rect.pixels();
            for inside in 0..pixels {
                let plane = |plane: usize| block.features[plane * pixels + inside];
                let (x, y) = (inside as u32 % rect.width, inside as u32 / rect.width);
                let at = (rect.y + y) as usize * shape.width() as usize + (rect.x + x) as usize;
                surfaces.albedo[at] = albedo_of(plane);
            }
            reused = Some(block);
        }
        if known { Ok(surfaces) } else { refuse("does not know what its samples are") }
    }

    /// Surfaces of known albedo; none for a pixel that shows something else.
    pub fn of_albedo(albedo: Vec<Option<[f32; 3]>>) -> Self {
        Self { albedo }
    }

    /// The albedo of a pixel, where it shows one surface that reflects enough of each colour.
    pub fn albedo(&self, pixel: usize) -> Option<[f32; 3]> {
        self.albedo.get(pixel).copied().flatten()
    }
}

/// The albedo of a pixel by its planes of features.
fn albedo_of(plane: impl Fn(usize) -> f32) -> Option<[f32; 3]> {
    let share = |feature: Feature| plane(feature.planes().start);
    let surface = share(Feature::Surface);
    let is_plain =
        surface >= SURFACE_SHARE && share(Feature::Emitter) <= OTHER_SHARE && share(Feature::Specular) <= OTHER_SHARE;
    debug_assert!(Feature::Albedo.planes().end <= FEATURE_PLANES);
    let first = Feature::Albedo.planes().start;
    let albedo = [0, 1, 2].map(|ch: usize| plane(first + ch) / surface.max(SURFACE_SHARE));
    (is_plain && albedo.iter().all(|v| *v >= LEAST_ALBEDO)).then_some(albedo)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_pixels_that_show_one_surface_have_an_albedo() {
        let planes = |albedo: f32, emitter: f32, specular: f32, surface: f32| {
            let mut planes = [0.0; FEATURE_PLANES];
            planes[Feature::Albedo.planes()].fill(albedo);
            planes[Feature::Emitter.planes().start] = emitter;
            planes[Feature::Specular.planes().start] = specular;
            planes[Feature::Surface.planes().start] = surface;
            albedo_of(|plane| planes[plane])
        };
        assert_eq!(planes(0.5, 0.0, 0.0, 1.0), Some([0.5; 3]));
        assert_eq!(planes(0.5, 0.5, 0.0, 1.0), None, "a lamp in view");
        assert_eq!(planes(0.5, 0.0, 0.5, 1.0), None, "a mirror");
        assert_eq!(planes(0.5, 0.0, 0.0, 0.5), None, "an edge against the sky");
        assert_eq!(planes(0.01, 0.0, 0.0, 1.0), None, "too black to tell");
    }
}
