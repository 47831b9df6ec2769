//! What is known of the surfaces in view: how much of the light on them they send on, how they lie, how far they are.

use std::path::Path;

use ltm::container::ContainerReader;
use ltm::error::{Error, Result};
use ltm::image::encode_srgb;
use ltm::matrix::{FactorSource, Feature};
use ltm::pipeline::Features;
use ltm::store::StoreReader;

use super::display::Shown;

/// Least share of a pixel's samples on a surface, and most by mirrors, glass and emitters, with which the pixel shows that
/// surface alone.
const SURFACE_SHARE: f32 = 0.95;
const OTHER_SHARE: f32 = 0.05;
/// Albedo below which a surface tells nothing of the light on it.
const MIN_ALBEDO: f32 = 0.02;

/// Features of each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Surfaces {
    albedo: Vec<Option<[f32; 3]>>,
    features: Option<Features>,
}

impl Surfaces {
    /// Reads them from the matrix that a container was made of: `room.ltm` beside `room.ltc`.
    ///
    /// Errors: there is no such file, it is another scene's or view's, it knows nothing of its samples, or cannot be read.
    pub fn beside(container_path: &Path, container: &ContainerReader) -> Result<Self> {
        let path = container_path.with_extension("ltm");
        let matrix = StoreReader::open(&path)?;
        let job = matrix.job();
        let same_view =
            (job.shape.width(), job.shape.height()) == (container.shape().width(), container.shape().height());
        if !same_view || job.provenance.content != container.job().provenance.content {
            return Err(Error::input(path.display().to_string(), "is the matrix of another scene or view", ""));
        }
        let features = Features::read(&matrix)?;
        let (planes, pixels) = (features.planes(), features.size().0 as usize * features.size().1 as usize);
        let albedo = (0..pixels).map(|pixel| albedo_of(|plane| planes[plane * pixels + pixel])).collect();
        Ok(Self { albedo, features: Some(features) })
    }

    /// Surfaces of known albedo; none for a pixel that shows something else.
    pub fn of_albedo(albedo: Vec<Option<[f32; 3]>>) -> Self {
        Self { albedo, features: None }
    }

    /// A feature of a pixel, in its own units, over the samples that show a surface: one of a single plane three times. None where there is no
    /// surface.
    pub fn value(&self, feature: Feature, pixel: usize) -> Option<[f32; 3]> {
        let planes = self.features.as_ref()?.planes();
        let pixels = self.albedo.len();
        let share = planes[Feature::Surface.planes().start * pixels + pixel];
        let of = feature.planes();
        let plane = |axis: usize| planes[(of.start + axis.min(of.len() - 1)) * pixels + pixel] / share;
        (share > 0.0).then(|| [plane(0), plane(1), plane(2)])
    }

    /// A feature as a picture: albedo in its colours, normals from −1 to 1 in red, green and blue, depth the darker the farther.
    pub fn shown(&self, feature: Feature) -> Option<Shown> {
        let features = self.features.as_ref()?;
        let (width, height) = features.size();
        let pixels = width as usize * height as usize;
        let depths = match feature {
            Feature::Depth => 0..pixels,
            _ => 0..0,
        };
        let depths = depths.filter_map(|pixel| self.value(feature, pixel)).map(|depth| depth[0]);
        let (near, far) = depths.fold((f32::INFINITY, 0.0), |(near, far): (f32, f32), d| (near.min(d), far.max(d)));
        let colour = |value: [f32; 3]| match feature {
            Feature::Albedo | Feature::PixelAlbedo => value.map(encode_srgb),
            Feature::Normal => value.map(|v| 0.5 + 0.5 * v),
            Feature::Depth => value.map(|depth| 0.1 + 0.9 * (far - depth) / (far - near).max(f32::MIN_POSITIVE)),
            Feature::Emitter | Feature::Specular | Feature::Surface | Feature::Material => value,
        };
        let mut rgba = vec![0; 4 * pixels];
        for (pixel, bytes) in rgba.chunks_exact_mut(4).enumerate() {
            let [r, g, b] = self.value(feature, pixel).map_or([0.0; 3], colour).map(|v| (v * 255.0 + 0.5) as u8);
            bytes.copy_from_slice(&[r, g, b, 255]);
        }
        Some(Shown { size: [width as usize, height as usize], rgba, histogram: Vec::new() })
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
    let first = Feature::Albedo.planes().start;
    let albedo = [0, 1, 2].map(|ch: usize| plane(first + ch) / surface.max(SURFACE_SHARE));
    (is_plain && albedo.iter().all(|v| *v >= MIN_ALBEDO)).then_some(albedo)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ltm::matrix::FEATURE_PLANES;

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
