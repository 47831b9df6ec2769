//! A lighting: the vector `ℓ`, an RGB weight for each column.

use super::LightBasis;
use crate::error::{Error, Result};

/// The vector `ℓ`: one linear Rec. 709 weight for each column, in the unit of its light.
#[derive(Clone, Debug, PartialEq)]
pub struct Lighting {
    weights: Vec<[f32; 3]>,
}

impl Lighting {
    /// A lighting from its weights.
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
            None => Ok(Self { weights }),
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
        Self { weights: basis.scene_weights() }
    }

    /// The same with all columns dark but those of `columns`.
    #[must_use]
    pub fn only(&self, columns: impl IntoIterator<Item = u32>) -> Self {
        let mut weights = vec![[0.0; 3]; self.weights.len()];
        for column in columns {
            weights[column as usize] = self.weights[column as usize];
        }
        Self { weights }
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
