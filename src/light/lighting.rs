//! A lighting: the vector `ℓ`, an RGB weight for each column.

use std::sync::Arc;

use super::names::{meant, suggest};
use super::{Light, LightBasis};
use crate::error::{Error, Result};

/// The vector `ℓ`: one linear Rec. 709 weight for each column, in the unit of its light.
///
/// ```
/// use ltm::Lighting;
/// use ltm::light::{Light, LightBasis, LightKind};
///
/// let mut basis = LightBasis::new();
/// for name in ["desk left", "desk right", "ceiling"] {
///     basis.push(Light::unplaced(name, LightKind::Lamp))?;
/// }
/// let evening = Lighting::of_scene(&basis).with("desk*", 0.0)?.with("ceiling", [1.0, 0.7, 0.4])?;
/// assert_eq!(evening.weights(), [[0.0; 3], [0.0; 3], [1.0, 0.7, 0.4]]);
/// # Ok::<(), ltm::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Lighting {
    weights: Vec<[f32; 3]>,
    /// The lights whose columns these are, where that is known.
    lights: Option<Arc<Vec<Light>>>,
}

/// Lightings are equal where their weights are.
impl PartialEq for Lighting {
    fn eq(&self, other: &Self) -> bool {
        self.weights == other.weights
    }
}

/// The weight of a light: a number for all three channels, or one for each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightWeight(pub [f32; 3]);

impl From<f32> for LightWeight {
    fn from(weight: f32) -> Self {
        Self([weight; 3])
    }
}

impl From<[f32; 3]> for LightWeight {
    fn from(weight: [f32; 3]) -> Self {
        Self(weight)
    }
}

impl Lighting {
    /// A lighting from its weights. It knows nothing of names, see [`with`](Self::with).
    ///
    /// # Errors
    /// A weight that is not finite, naming the column.
    pub fn new(weights: Vec<[f32; 3]>) -> Result<Self> {
        match weights.iter().position(|w| !w.iter().all(|v| v.is_finite())) {
            Some(column) => {
                let [r, g, b] = weights[column];
                let problem = format!("weight ({r}, {g}, {b}) is not finite");
                Err(Error::input(format!("lighting, column {column}"), problem, "give every light a finite weight"))
            }
            None => Ok(Self { weights, lights: None }),
        }
    }

    /// Every column with the same weight.
    ///
    /// # Errors
    /// A weight that is not finite.
    pub fn uniform(columns: usize, weight: [f32; 3]) -> Result<Self> {
        Self::new(vec![weight; columns])
    }

    /// The lighting of the scene file: every light with its own emission, an environment with its map.
    pub fn of_scene(basis: &LightBasis) -> Self {
        Self { weights: basis.scene_weights(), lights: Some(basis.shared_lights()) }
    }

    /// Every light off.
    pub fn off(basis: &LightBasis) -> Self {
        Self { weights: vec![[0.0; 3]; basis.column_count()], lights: Some(basis.shared_lights()) }
    }

    /// The same with another weight, in the unit of the light, on every column of the lights that a pattern means: the light of
    /// that name or, where there is none, those whose names fit it (`*` stands for any letters, `?` for one).
    ///
    /// # Errors
    /// The pattern means no light (with the nearest names); the weight is not finite; the lighting was made of weights alone and
    /// knows no names.
    pub fn with(mut self, pattern: &str, weight: impl Into<LightWeight>) -> Result<Self> {
        let (place, LightWeight(weight)) = (|| format!("light '{pattern}'"), weight.into());
        if !weight.iter().all(|value| value.is_finite()) {
            let [r, g, b] = weight;
            let problem = format!("weight ({r}, {g}, {b}) is not finite");
            return Err(Error::input(place(), problem, "give it a finite weight"));
        }
        let Some(lights) = &self.lights else {
            let hint = "begin with `Lighting::of_scene` or `Lighting::off`";
            return Err(Error::input(place(), "the lighting was made of weights alone, without names", hint));
        };
        let names = || lights.iter().map(|light| light.name.as_str());
        let found = meant(pattern, names());
        if found.is_empty() {
            return Err(Error::input(place(), "no light is called so", suggest(pattern, names())));
        }
        for columns in found.into_iter().map(|light| lights[light].columns()) {
            self.weights[columns.start as usize..columns.end as usize].fill(weight);
        }
        Ok(self)
    }

    /// The same with all columns dark but those of `columns`.
    #[must_use]
    pub fn only(&self, columns: impl IntoIterator<Item = u32>) -> Self {
        let mut weights = vec![[0.0; 3]; self.weights.len()];
        for column in columns {
            weights[column as usize] = self.weights[column as usize];
        }
        Self { weights, lights: self.lights.clone() }
    }

    /// One weight per column.
    pub fn weights(&self) -> &[[f32; 3]] {
        &self.weights
    }

    /// The weights of one channel (0 red, 1 green, 2 blue): one value per column.
    pub fn channel(&self, channel: usize) -> Vec<f32> {
        self.weights.iter().map(|w| w[channel]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::LightKind;
    use super::*;

    fn basis() -> LightBasis {
        let mut basis = LightBasis::new();
        basis.push(Light::unplaced("lamp 1", LightKind::Lamp)).unwrap();
        basis.push(Light::unplaced("panel", LightKind::AreaTexels { across: 2, down: 1 })).unwrap();
        basis.push(Light::unplaced("lamp 2", LightKind::Lamp)).unwrap();
        basis.push(Light::unplaced("lamp *", LightKind::Lamp)).unwrap();
        basis
    }

    #[test]
    fn a_pattern_sets_all_columns_of_the_lights_that_it_means() {
        let of = |pattern: &str| {
            let lighting = Lighting::off(&basis()).with(pattern, [1.0, 2.0, 3.0]).unwrap();
            lighting.channel(1).iter().map(|weight| *weight == 2.0).collect::<Vec<_>>()
        };
        assert_eq!(of("panel"), [false, true, true, false, false]);
        assert_eq!(of("lamp ?"), [true, false, false, true, true]);
        assert_eq!(of("lamp *"), [false, false, false, false, true], "the name is the light's own");
        assert_eq!(of("*"), [true; 5]);
    }

    #[test]
    fn what_no_light_is_called_and_what_is_no_weight_is_refused() {
        let error = Lighting::of_scene(&basis()).with("panels", 1.0).unwrap_err().to_string();
        assert!(error.starts_with("light 'panels': no light is called so; the nearest names are 'panel'"), "{error}");
        assert!(Lighting::of_scene(&basis()).with("panel", f32::NAN).is_err());
        let nameless = Lighting::uniform(5, [1.0; 3]).unwrap();
        assert_eq!(nameless, Lighting::of_scene(&basis()));
        assert!(nameless.with("panel", 1.0).is_err());
    }
}
