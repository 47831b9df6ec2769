//! The light basis: which column of `T` is which light.

use std::collections::HashMap;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use super::SkyPatches;
use crate::encoding::{Decode, Encode};
use crate::error::{Error, Result};
use crate::matrix::{ColumnIndex, MatrixShape};

/// What a light is, and how its columns are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub enum LightKind {
    /// An emissive material or object group: one column.
    Lamp,
    /// A rectangular emitter split by its UV into `across × down` texels, row by row; texel (0, 0) has the smallest UV.
    AreaTexels {
        /// Texels along u.
        across: u32,
        /// Texels along v.
        down: u32,
    },
    /// A latitude–longitude environment of `across × down` texels, row by row from the zenith.
    LatLong {
        /// Texels around.
        across: u32,
        /// Texels from zenith to nadir.
        down: u32,
    },
    /// An environment on the equal-area octahedral square of `side × side` texels, row by row.
    Octahedral {
        /// Texels along each side of the square.
        side: u32,
    },
    /// A point light: one column.
    Point,
    /// A spot light: one column.
    Spot,
    /// A sun, parallel or of small angular radius: one column.
    Sun,
    /// A luminaire with a photometric (IES) distribution: one column.
    Ies,
    /// A light known only by its rendered image: one column.
    Image,
    /// A sky of Tregenza's or Reinhart's patches, see [`SkyPatches`]: a column for each of the `144 · MF² + 2`, the
    /// lower hemisphere first.
    Patches {
        /// `MF`.
        subdivision: u32,
        /// Whether there is a second row of columns: the first has the light that comes straight from the sky, the second what other surfaces
        /// reflect of it.
        is_split: bool,
    },
    /// Places of the sun, parallel or of small angular radius: a column for each, which has the light that comes straight from there and
    /// nothing that other surfaces reflect of it.
    Suns {
        /// Number of places.
        count: u32,
    },
}

/// The unit of a weight 1 on a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub enum LightUnit {
    /// Radiance, W·sr⁻¹·m⁻² per channel.
    Radiance,
    /// Radiant intensity, W·sr⁻¹ per channel.
    Intensity,
    /// Irradiance on a plane facing the light, W·m⁻² per channel.
    Irradiance,
    /// Multiples of the light as it was rendered.
    Multiple,
}

/// One light: a name, what it is, and the contiguous columns that it owns.
#[derive(Clone, Debug, PartialEq, Encode, Decode)]
pub struct Light {
    /// Name, unique in the basis.
    pub name: String,
    /// What it is and how its columns are laid out.
    pub kind: LightKind,
    /// Unit of a weight 1.
    pub unit: LightUnit,
    /// RGB weight with which the scene file lights it: the emission in `unit`.
    pub emission: [f32; 3],
    /// First of its columns.
    pub first_column: u32,
    /// Place of each of its columns in world space: the centre of the emitter or texel; for environments and suns the
    /// direction towards it.
    pub places: Vec<[f32; 3]>,
    /// Extent of each of its columns: area in square scene units, solid angle in steradians for environments and suns,
    /// 0 for point-like lights.
    pub extents: Vec<f32>,
}

impl Light {
    /// A light of radiance 1 whose columns have extent 1 and stand nowhere in particular: for a matrix that comes without
    /// a scene.
    pub fn unplaced(name: impl Into<String>, kind: LightKind) -> Self {
        let (across, down) = kind.layout();
        let columns = (across * down) as usize;
        Self {
            name: name.into(),
            kind,
            unit: LightUnit::Radiance,
            emission: [1.0; 3],
            first_column: 0,
            places: vec![[0.0; 3]; columns],
            extents: vec![1.0; columns],
        }
    }

    /// The columns of the light.
    pub fn columns(&self) -> Range<u32> {
        self.first_column..self.first_column + self.places.len() as u32
    }

    /// Texels (across, down) of its column layout; (1, 1) for lights of one column.
    pub fn layout(&self) -> (u32, u32) {
        self.kind.layout()
    }

    /// The texel of an environment whose direction is nearest to one in the world, 0 of a light without columns.
    pub fn nearest_texel(&self, direction: [f32; 3]) -> usize {
        let nearness = |place: &[f32; 3]| (0..3).map(|i| place[i] * direction[i]).sum::<f32>();
        let places = self.places.iter().enumerate();
        places.max_by(|(_, a), (_, b)| nearness(a).total_cmp(&nearness(b))).map_or(0, |(texel, _)| texel)
    }
}

impl LightKind {
    /// Whether its texels are directions of an environment.
    pub fn is_environment(self) -> bool {
        matches!(self, Self::LatLong { .. } | Self::Octahedral { .. } | Self::Patches { .. })
    }

    /// Whether daylight of a climate lights it: a sky, or places of the sun.
    pub fn is_daylight(self) -> bool {
        self.is_environment() || matches!(self, Self::Suns { .. })
    }

    /// Texels (across, down); (1, 1) for lights of one column.
    pub fn layout(self) -> (u32, u32) {
        match self {
            Self::AreaTexels { across, down } | Self::LatLong { across, down } => (across, down),
            Self::Octahedral { side } => (side, side),
            Self::Patches { subdivision, is_split } => {
                // What is no division has no columns, so that no light can have it.
                (SkyPatches::of_subdivision(subdivision).map_or(0, SkyPatches::count), 1 + u32::from(is_split))
            }
            Self::Suns { count } => (count, 1),
            Self::Lamp | Self::Point | Self::Spot | Self::Sun | Self::Ies | Self::Image => (1, 1),
        }
    }

    /// One word for programs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lamp => "lamp",
            Self::AreaTexels { .. } => "area",
            Self::LatLong { .. } => "lat-long",
            Self::Octahedral { .. } => "octahedral",
            Self::Point => "point",
            Self::Spot => "spot",
            Self::Sun => "sun",
            Self::Ies => "ies",
            Self::Image => "image",
            Self::Patches { .. } => "patches",
            Self::Suns { .. } => "suns",
        }
    }
}

impl fmt::Display for LightKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (across, down) = self.layout();
        match self {
            Self::Lamp => f.write_str("lamp"),
            Self::AreaTexels { .. } => write!(f, "area light of {across} × {down} texels"),
            Self::LatLong { .. } => write!(f, "environment, lat-long, {across} × {down} texels"),
            Self::Octahedral { .. } => write!(f, "environment, octahedral, {across} × {down} texels"),
            Self::Point => f.write_str("point light"),
            Self::Spot => f.write_str("spot light"),
            Self::Sun => f.write_str("sun"),
            Self::Ies => f.write_str("luminaire with a measured distribution"),
            Self::Image => f.write_str("light known by its picture"),
            Self::Patches { subdivision: 1, .. } => write!(f, "environment, {across} patches of Tregenza"),
            Self::Patches { subdivision, .. } => {
                write!(f, "environment, {across} patches of Reinhart, MF {subdivision}")
            }
            Self::Suns { count } => write!(f, "sun in {count} places"),
        }
    }
}

impl fmt::Display for LightUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Radiance => "W/(sr·m²)",
            Self::Intensity => "W/sr",
            Self::Irradiance => "W/m²",
            Self::Multiple => "times as rendered",
        })
    }
}

/// One column seen through its light.
#[derive(Clone, Copy, Debug)]
pub struct Column<'a> {
    /// The light that owns it.
    pub light: &'a Light,
    /// Its texel (across, down) in the light's layout.
    pub texel: (u32, u32),
    /// Place, see [`Light::places`].
    pub place: [f32; 3],
    /// Extent, see [`Light::extents`].
    pub extent: f32,
}

/// All lights of a job, in column order, covering every column exactly once.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightBasis {
    /// Shared with the lightings over them, which are many where the lights are.
    lights: Arc<Vec<Light>>,
    /// Index of each light by its name.
    by_name: HashMap<String, usize>,
    /// Weights in the scene's lighting that are not their light's emission: first column, weights.
    scene_weights: Vec<(u32, Vec<[f32; 3]>)>,
    /// See [`column_scales`](Self::column_scales).
    column_scales: Vec<f32>,
}

impl LightBasis {
    /// Largest number of columns.
    pub const MAX_COLUMNS: u32 = MatrixShape::MAX_COLUMNS;

    /// An empty basis, to [`push`](Self::push) lights to.
    pub fn new() -> Self {
        Self::default()
    }

    /// Appends a light with one column for each of `places`; its `first_column` is set here.
    ///
    /// # Errors
    /// An empty or taken name, a layout that does not have as many texels as there are places, extents of
    /// another length, values that are not finite, or more columns than a matrix can have.
    pub fn push(&mut self, mut light: Light) -> Result<()> {
        let refuse = |problem: &str| Err(Error::input(format!("light '{}'", light.name), problem, ""));
        if light.name.is_empty() {
            return refuse("has no name");
        }
        if self.find(&light.name).is_some() {
            return refuse("the name is taken by another light; rename one of them");
        }
        let (across, down) = light.layout();
        if u64::from(across) * u64::from(down) != light.places.len() as u64 || light.places.is_empty() {
            return refuse("the number of columns does not fit its layout");
        }
        if light.extents.len() != light.places.len() {
            return refuse("extents and places differ in number");
        }
        let finite = light.emission.iter().chain(light.places.iter().flatten()).chain(&light.extents);
        if !finite.into_iter().all(|v| v.is_finite()) {
            return refuse("has a place, extent or emission that is not finite");
        }
        if self.column_count() + light.places.len() > Self::MAX_COLUMNS as usize {
            return refuse("brings the number of columns above what a matrix can have");
        }
        light.first_column = self.column_count() as u32;
        self.by_name.insert(light.name.clone(), self.lights.len());
        Arc::make_mut(&mut self.lights).push(light);
        Ok(())
    }

    /// Says how the scene lights a light's columns where its emission does not: an environment's map, one weight for
    /// each texel. `first_column` is the light's.
    ///
    /// # Errors
    /// No light begins there, it has another number of columns, or a weight is not finite.
    pub fn set_scene_weights(&mut self, first_column: u32, weights: Vec<[f32; 3]>) -> Result<()> {
        let refuse = |problem: &str| Err(Error::input(format!("weights of column {first_column}"), problem, ""));
        match self.lights.binary_search_by_key(&first_column, |light| light.first_column) {
            Err(_) => refuse("no light begins at this column"),
            Ok(light) if self.lights[light].places.len() != weights.len() => {
                refuse("their number is not that of the light's columns")
            }
            Ok(_) if !weights.iter().flatten().all(|v| v.is_finite()) => refuse("one is not finite"),
            Ok(_) => {
                self.scene_weights.retain(|(column, _)| *column != first_column);
                self.scene_weights.push((first_column, weights));
                self.scene_weights.sort_by_key(|(column, _)| *column);
                Ok(())
            }
        }
    }

    /// The weights given to [`set_scene_weights`](Self::set_scene_weights), in column order.
    pub(crate) fn own_scene_weights(&self) -> &[(u32, Vec<[f32; 3]>)] {
        &self.scene_weights
    }

    /// The weight of each column in the scene's own lighting.
    pub fn scene_weights(&self) -> Vec<[f32; 3]> {
        let emission = |light: &Light| std::iter::repeat_n(light.emission, light.places.len());
        let mut weights: Vec<_> = self.lights.iter().flat_map(emission).collect();
        for (first, own) in &self.scene_weights {
            weights[*first as usize..][..own.len()].copy_from_slice(own);
        }
        weights
    }

    /// Sets the scales of the columns, see [`column_scales`](Self::column_scales); empty if unknown.
    ///
    /// # Errors
    /// Another number than that of the columns, a scale that is not finite and above 0, or several within a light.
    pub fn set_column_scales(&mut self, scales: Vec<f32>) -> Result<()> {
        let refuse = |problem: String| Err(Error::input("column scales", problem, ""));
        if !scales.is_empty() && scales.len() != self.column_count() {
            return refuse(format!("are {}, the columns {}", scales.len(), self.column_count()));
        }
        if let Some(scale) = scales.iter().find(|scale| !(scale.is_normal() && **scale > 0.0)) {
            return refuse(format!("have one of {scale}"));
        }
        if let Some(light) = self.lights.iter().filter(|_| !scales.is_empty()).find(|light| {
            let own = &scales[light.first_column as usize..light.columns().end as usize];
            own.iter().any(|scale| *scale != own[0])
        }) {
            return refuse(format!("differ between the columns of light '{}'", light.name));
        }
        self.column_scales = scales;
        Ok(())
    }

    /// Divisor of each column before columns are compared, denoised and compressed: the mean of its image under a
    /// weight of 1, with one value for all columns of a light. Columns of any unit then count alike (column
    /// equilibration; Golub and Van Loan, *Matrix Computations*, §3.5.2). Empty if unknown; columns then count as they
    /// are.
    pub fn column_scales(&self) -> &[f32] {
        &self.column_scales
    }

    /// The lights in column order.
    pub fn lights(&self) -> &[Light] {
        &self.lights
    }

    /// The same for a lighting to keep.
    pub(super) fn shared_lights(&self) -> Arc<Vec<Light>> {
        Arc::clone(&self.lights)
    }

    /// Number of columns.
    pub fn column_count(&self) -> usize {
        self.lights.last().map_or(0, |light| light.columns().end as usize)
    }

    /// Whether there are several lights of one column each and nothing tells where: all stand at one place.
    pub fn is_unplaced(&self) -> bool {
        let places = || self.lights.iter().map(|light| light.places.as_slice());
        self.lights.len() > 1 && places().all(|here| here.len() == 1 && here == self.lights[0].places)
    }

    /// The light of this name.
    pub fn find(&self, name: &str) -> Option<&Light> {
        self.by_name.get(name).map(|&index| &self.lights[index])
    }

    /// A column seen through its light. Panics if there is no such column.
    pub fn column(&self, column: ColumnIndex) -> Column<'_> {
        let light = &self.lights[self.lights.partition_point(|light| light.columns().end <= column.0)];
        let texel = column.0 - light.first_column;
        let across = light.layout().0;
        Column {
            light,
            texel: (texel % across, texel / across),
            place: light.places[texel as usize],
            extent: light.extents[texel as usize],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lamp(name: &str, kind: LightKind, columns: usize) -> Light {
        Light {
            name: name.into(),
            kind,
            unit: LightUnit::Radiance,
            emission: [1.0; 3],
            first_column: 77,
            places: vec![[0.0; 3]; columns],
            extents: vec![1.0; columns],
        }
    }

    #[test]
    fn columns_are_found_through_their_light() {
        let mut basis = LightBasis::new();
        basis.push(lamp("a", LightKind::Lamp, 1)).unwrap();
        basis.push(lamp("b", LightKind::AreaTexels { across: 3, down: 2 }, 6)).unwrap();
        basis.push(lamp("c", LightKind::Point, 1)).unwrap();
        assert_eq!(basis.column_count(), 8);
        let column = basis.column(ColumnIndex(5));
        assert_eq!((column.light.name.as_str(), column.texel), ("b", (1, 1)));
        assert_eq!(basis.column(ColumnIndex(0)).light.name, "a");
        assert_eq!(basis.column(ColumnIndex(7)).light.name, "c");
    }

    #[test]
    fn the_scene_lights_a_column_by_its_own_weight_or_its_lights_emission() {
        let mut basis = LightBasis::new();
        basis.push(lamp("a", LightKind::Lamp, 1)).unwrap();
        basis.push(lamp("sky", LightKind::LatLong { across: 2, down: 1 }, 2)).unwrap();
        basis.set_scene_weights(1, vec![[3.0; 3], [4.0; 3]]).unwrap();
        assert_eq!(basis.scene_weights(), [[1.0; 3], [3.0; 3], [4.0; 3]]);
        for (first, weights) in [(2, vec![[1.0; 3]; 2]), (1, vec![[1.0; 3]; 3]), (0, vec![[f32::NAN; 3]])] {
            assert!(basis.set_scene_weights(first, weights).is_err());
        }
    }

    #[test]
    fn lights_that_do_not_fit_are_refused() {
        let mut basis = LightBasis::new();
        basis.push(lamp("a", LightKind::Lamp, 1)).unwrap();
        assert!(basis.push(lamp("a", LightKind::Lamp, 1)).is_err());
        assert!(basis.push(lamp("", LightKind::Lamp, 1)).is_err());
        assert!(basis.push(lamp("b", LightKind::Octahedral { side: 2 }, 3)).is_err());
        let nan = Light { emission: [f32::NAN; 3], ..lamp("c", LightKind::Lamp, 1) };
        assert!(basis.push(nan).is_err());
    }
}
