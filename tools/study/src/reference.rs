//! The lightings under which images are compared, and what the reference shows under each.

use ltm::error::{Error, Result};
use ltm::image::LinearImage;
use ltm::light::{Job, LightBasis, Lighting, evaluation_lightings};
use ltm::matrix::BlockSource;
use ltm::relight::relight_raw;
use ltm::store::StoreReader;

/// Seed of the lightings.
pub(super) const LIGHTINGS_SEED: u64 = 9;

/// A lighting is left out if the reference's image under it is, in relative L2, less than this part of that with
/// every column on.
const DARK: f64 = 1e-6;

/// Said in the notes of every table that has means over lightings.
pub(super) const LIGHTINGS_NOTE: &str = "Lightings: twelve for each scene (all on, the scene's own, gradients, spots of \
several widths, a pattern, one column, columns at random), without those whose image in the reference is less than a \
millionth of that with everything on, as of a spot at the part of the sky below the floor: nothing is there to compare.";

/// Said in the notes of tables of lightings of which half are narrow.
pub(super) const HALF_NARROW_NOTE: &str = "Lightings: twelve for each scene, of which six are narrow: two spots of 0.06 of the light's \
width, two of 0.04, two single columns; the others are all on, the scene's own, a gradient, one half, two soft spots, a coarse pattern; \
without those that light less than a millionth of what all columns do.";

const BROAD: [&str; 6] = ["all on", "of the scene", "gradient across", "half", "two soft spots", "coarse pattern"];
const NARROW: [&str; 3] = ["narrow spot", "tiny spot", "one column"];

/// Lightings, and the reference's image under each.
pub(super) struct Judged {
    pub(super) names: Vec<&'static str>,
    pub(super) lightings: Vec<Lighting>,
    pub(super) references: Vec<LinearImage>,
}

/// Said in the notes of tables of lightings that the prior is not made of.
pub(super) const APART_NOTE: &str = "Lightings: eight of which none has a width that the compressor's prior is made of: two gradients, \
one half, two soft spots (0.25 of the light), a wide one (0.15), a narrow one (0.06), a coarse pattern, columns at random; without those \
that light less than a millionth of what all columns do.";

impl Judged {
    /// Those of a reference matrix that light something. The first has every column on.
    pub(super) fn of(reference: &StoreReader) -> Result<Self> {
        Self::among(reference, evaluation_lightings(&reference.job().basis, LIGHTINGS_SEED), |_| true)
    }

    /// Those of which half are narrow, see [`HALF_NARROW_NOTE`]. The first has every column on.
    pub(super) fn half_narrow(reference: &StoreReader) -> Result<Self> {
        let basis = &reference.job().basis;
        let of = |seed, names: &'static [&str]| {
            evaluation_lightings(basis, seed).into_iter().filter(move |(name, _)| names.contains(name))
        };
        let narrow = of(LIGHTINGS_SEED, &NARROW).chain(of(LIGHTINGS_SEED + 1, &NARROW));
        Self::among(reference, of(LIGHTINGS_SEED, &BROAD).chain(narrow).collect(), |_| true)
    }

    /// Those of which none has a width that the prior is made of, see [`APART_NOTE`].
    pub(super) fn apart(reference: &StoreReader, seed: u64) -> Result<Self> {
        let shared = ["all on", "of the scene", "tiny spot", "one column"];
        Self::among(reference, evaluation_lightings(&reference.job().basis, seed), |name| !shared.contains(&name))
    }

    /// Of a matrix whose lights are these.
    pub(super) fn of_lights(reference: &dyn BlockSource, basis: &LightBasis) -> Result<Self> {
        Self::among(reference, evaluation_lightings(basis, LIGHTINGS_SEED), |_| true)
    }

    /// Of these lightings, which have no names, those that light something beside what all columns do.
    pub(super) fn lit(reference: &dyn BlockSource, lightings: Vec<Lighting>, all_on: &LinearImage) -> Result<Self> {
        let images = relight_raw(reference, &lightings)?;
        let least = DARK * norm(all_on);
        let (lightings, references): (Vec<_>, Vec<_>) =
            lightings.into_iter().zip(images).filter(|(_, image)| norm(image) > least).unzip();
        Ok(Self { names: vec![""; lightings.len()], lightings, references })
    }

    /// Of lightings, of which the first has every column on.
    fn among(
        reference: &dyn BlockSource,
        lightings: Vec<(&'static str, Lighting)>,
        wanted: impl Fn(&str) -> bool,
    ) -> Result<Self> {
        let (names, lightings): (Vec<_>, Vec<_>) = lightings.into_iter().unzip();
        let references = relight_raw(reference, &lightings)?;
        let all_on = norm(&references[0]);
        let mut judged = Self { names: Vec::new(), lightings: Vec::new(), references: Vec::new() };
        for ((name, lighting), image) in names.into_iter().zip(lightings).zip(references) {
            if wanted(name) && norm(&image) > DARK * all_on {
                judged.names.push(name);
                judged.lightings.push(lighting);
                judged.references.push(image);
            }
        }
        Ok(judged)
    }
}

pub(super) fn norm(image: &LinearImage) -> f64 {
    image.values().iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt()
}

/// The lighting of a scene of which all lights are off but this one.
pub(super) fn alone(job: &Job, name: &str) -> Result<Lighting> {
    let (basis, scene) = (&job.basis, &job.provenance.source);
    let light = basis.find(name).ok_or_else(|| Error::input(scene, format!("has no light '{name}'"), ""))?;
    let columns = light.columns();
    let weights = basis.scene_weights().into_iter().enumerate();
    Lighting::new(weights.map(|(j, weight)| if columns.contains(&(j as u32)) { weight } else { [0.0; 3] }).collect())
}
