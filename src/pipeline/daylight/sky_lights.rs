//! Which columns of a matrix are the sky's and the sun's, and what a moment puts on them.

use crate::daylight::{CieSky, Climate, SkyModel, SkyNow, SkyOptions, SkyTexels, Sun};
use crate::error::{Error, Result};
use crate::light::{Light, LightBasis, LightKind, Lighting};

/// Cosine between the sun and the nearest of its places below which this is too far away: some 12°.
const NEAR: f64 = 0.978;

/// The lights that daylight is put on.
pub(super) struct SkyLights<'a> {
    pub(super) sky: &'a Light,
    /// Whether what surfaces reflect has columns of its own, as many again.
    pub(super) is_split: bool,
    suns: Option<&'a Light>,
    texels: SkyTexels,
}

impl<'a> SkyLights<'a> {
    /// Those of a basis; `place` names the matrix in messages. Errors: no sky, several, several lights of suns, or suns beside a sky
    /// that is not split.
    pub(super) fn of(place: &str, basis: &'a LightBasis) -> Result<Self> {
        let refuse = |problem: String, hint: &str| Err(Error::input(place, problem, hint));
        let skies: Vec<&Light> = basis.lights().iter().filter(|light| light.kind.is_environment()).collect();
        let suns: Vec<&Light> =
            basis.lights().iter().filter(|light| matches!(light.kind, LightKind::Suns { .. })).collect();
        let [sky] = skies[..] else {
            let hint = "give the scene a [[light]] of kind \"environment\", such as patches = \"reinhart\"";
            return refuse(format!("has {} environments that could be the sky", skies.len()), hint);
        };
        if suns.len() > 1 {
            return refuse("has several lights of kind \"suns\"".into(), "leave one");
        }
        let is_split = matches!(sky.kind, LightKind::Patches { is_split: true, .. });
        let suns = suns.first().copied();
        if suns.is_some() && !is_split {
            let problem = format!("has places of the sun, but '{}' does not tell what surfaces reflect", sky.name);
            return refuse(
                problem,
                "say split = true for the sky: what surfaces reflect of the sun is in those columns",
            );
        }
        let count = sky.places.len() / (1 + usize::from(is_split));
        let texels = SkyTexels::new(&sky.places[..count], &sky.extents[..count]);
        Ok(Self { sky, is_split, suns, texels })
    }

    /// Directions of the sky.
    pub(super) fn texels(&self) -> &SkyTexels {
        &self.texels
    }

    /// Number of directions of the sky, each of two columns where the sky is split.
    pub(super) fn count(&self) -> usize {
        self.sky.places.len() / (1 + usize::from(self.is_split))
    }

    /// The weights of `lamps`, with radiances in the sky's columns, dark without any, and no sun.
    fn weights(&self, lamps: &Lighting, radiance: Option<&[f32]>) -> Vec<[f32; 3]> {
        let mut weights = lamps.weights().to_vec();
        for light in self.suns.into_iter().chain([self.sky]) {
            light.columns().for_each(|column| weights[column as usize] = [0.0; 3]);
        }
        let columns = self.sky.columns().zip(radiance.unwrap_or_default().iter().cycle());
        columns.for_each(|(column, radiance)| weights[column as usize] = [*radiance; 3]);
        weights
    }

    /// Gives what the sun of a moment adds to columns: column, weight, and whether the column has what comes straight from the sun. Errors:
    /// no place of the sun near where it stands.
    pub(super) fn put_sun(&self, place: &str, now: &SkyNow, mut put: impl FnMut(u32, f32, bool)) -> Result<()> {
        let spread = now.spread_sun(&self.texels);
        for &(texel, weight) in &spread {
            let column = self.sky.first_column + texel as u32;
            if self.suns.is_none() {
                put(column, weight, self.is_split);
            }
            if self.is_split {
                put(column + self.count() as u32, weight, false);
            }
        }
        let Some(suns) = self.suns.filter(|_| now.sun_is_up && !spread.is_empty()) else { return Ok(()) };
        let cosine = |place: &[f32; 3]| {
            let [x, y, z] = place.map(f64::from);
            now.towards_sun.dot([x, y, z].into())
        };
        let nearest = suns.places.iter().map(cosine).enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        let (place_of_sun, cosine) = nearest.unwrap_or_default();
        if cosine < NEAR {
            let problem = format!("'{}' has no place within 12° of the sun at some hour", suns.name);
            let hint = "give the latitude of the climate's site, or patches of the whole sky";
            return Err(Error::input(place, problem, hint));
        }
        put(suns.first_column + place_of_sun as u32, now.sun_irradiance as f32, true);
        Ok(())
    }
}

/// The lighting of a moment of a climate: sky and sun as they are then, all other lights as in `lamps`. `place` names the matrix in
/// messages; the hour is of the site's time, and between two steps of the climate the light is in proportion ([`Climate::at`]).
///
/// The sky's weights are radiances in W·sr⁻¹·m⁻², the sun's irradiances in W·m⁻², whatever unit lamps have.
///
/// # Errors
/// A basis without a sky, or with one that does not fit its places of the sun; a day that the climate does not have; options that are
/// out of range.
pub fn lighting_at(
    place: &str,
    lamps: &Lighting,
    basis: &LightBasis,
    climate: &Climate,
    (day, hour): ((u8, u8), f64),
    options: SkyOptions,
) -> Result<Lighting> {
    options.check()?;
    let lights = SkyLights::of(place, basis)?;
    let step = climate.at(day, hour)?;
    let now = SkyModel::new(climate, options).at(&step, &lights.texels);
    let mut weights = lights.weights(lamps, now.as_ref().map(|now| &now.radiance[..]));
    if let Some(now) = now {
        lights.put_sun(place, &now, |column, weight, _| {
            weights[column as usize].iter_mut().for_each(|channel| *channel += weight);
        })?;
    }
    Lighting::new(weights)
}

/// A standard sky of the CIE.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StandardSky {
    /// Its shape.
    pub sky: CieSky,
    /// Where the sun stands behind it; of no effect on uniform and overcast skies.
    pub sun: Sun,
    /// Illuminance of open ground by the sky alone, in lux.
    pub lux: f64,
}

/// The lighting of a standard sky, without the sun's own light; all other lights as in `lamps`. Units and `place` as of [`lighting_at`].
///
/// # Errors
/// A basis without a sky, or with one that does not fit its places of the sun; options or an illuminance that are out of range.
pub fn lighting_under(
    place: &str,
    lamps: &Lighting,
    basis: &LightBasis,
    standard: StandardSky,
    options: SkyOptions,
) -> Result<Lighting> {
    options.check()?;
    let StandardSky { sky, sun, lux } = standard;
    if !(lux >= 0.0 && lux.is_finite()) {
        return Err(Error::input("the sky", format!("{lux} is no illuminance"), "give lx, 0 or more"));
    }
    let lights = SkyLights::of(place, basis)?;
    let sun = Sun { azimuth: sun.azimuth - options.north_degrees.to_radians(), ..sun };
    let radiance = lights.texels.standard(sky, sun, lux, options.ground_reflectance);
    Lighting::new(lights.weights(lamps, Some(&radiance)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daylight::LUMENS_PER_WATT;
    use crate::light::{EnvironmentMapping, LightUnit, SkyPatches};

    const WEA: &str = "place Testville_XX\nlatitude 48.1\nlongitude -11.6\ntime_zone -15\nsite_elevation 515\n\
        weather_data_file_units 3\n6 21 3.5 0 0\n6 21 11.5 80000 12000\n6 21 12.5 60000 20000\n";

    /// A sky of patches with a lamp beside it.
    fn basis(is_split: bool) -> LightBasis {
        let patches = SkyPatches::of_subdivision(2).unwrap();
        let mapping = EnvironmentMapping::Patches(patches);
        let rows = 1 + usize::from(is_split);
        let texels = || (0..rows).flat_map(|_| 0..mapping.texel_count());
        let mut basis = LightBasis::new();
        basis.push(Light::unplaced("lamp", LightKind::Lamp)).unwrap();
        let sky = Light {
            name: "sky".into(),
            kind: LightKind::Patches { subdivision: 2, is_split },
            unit: LightUnit::Radiance,
            emission: [1.0; 3],
            first_column: 0,
            places: texels().map(|texel| mapping.middle(texel).to_array()).collect(),
            extents: texels().map(|texel| mapping.solid_angle(texel)).collect(),
        };
        basis.push(sky).unwrap();
        basis
    }

    /// Horizontal illuminance by the columns of the sky from `first` on, on open ground.
    fn horizontal_lux(basis: &LightBasis, lighting: &Lighting, row: usize) -> f64 {
        let sky = &basis.lights()[1];
        let count = SkyPatches::of_subdivision(2).unwrap().count() as usize;
        let weights = &lighting.weights()[sky.first_column as usize + row * count..][..count];
        let lit = weights.iter().zip(sky.places.iter().zip(&sky.extents));
        LUMENS_PER_WATT * lit.map(|(w, (p, extent))| f64::from(w[1] * p[1].max(0.0) * extent)).sum::<f64>()
    }

    /// Of a standard sky the ground has what was asked for, and the overcast one is, at the zenith, 9 / (7π) of the horizontal illuminance.
    #[test]
    fn standard_skies_light_open_ground_as_asked() {
        let lamps = Lighting::new(vec![[0.5; 3]; basis(true).column_count()]).unwrap();
        let sun = Sun { altitude: 0.7, azimuth: 1.0 };
        let under =
            |sky, lux| lighting_under("a", &lamps, &basis(true), StandardSky { sky, sun, lux }, SkyOptions::default());
        for sky in [CieSky::Uniform, CieSky::Overcast, CieSky::Clear, CieSky::Intermediate] {
            let lighting = under(sky, 8000.0).unwrap();
            for row in 0..2 {
                let found = horizontal_lux(&basis(true), &lighting, row);
                assert!((found / 8000.0 - 1.0).abs() < 1e-5, "{sky:?}: {found}");
            }
            assert_eq!(lighting.weights()[0], [0.5; 3], "lamps stay as they are");
        }
        let lighting = under(CieSky::Overcast, 10000.0).unwrap();
        let zenith = basis(true).lights()[1].nearest_texel([0.0, 1.0, 0.0]);
        let found = LUMENS_PER_WATT * f64::from(lighting.weights()[1 + zenith][0]);
        let wanted = 10000.0 * 9.0 / (7.0 * std::f64::consts::PI);
        assert!((found / wanted - 1.0).abs() < 0.01, "{found} for {wanted}");
        let clear = under(CieSky::Clear, 8000.0).unwrap();
        let basis = basis(true);
        let places = &basis.lights()[1].places;
        let radiance = |texel: &usize| clear.weights()[1 + texel][0];
        let brightest = (0..places.len()).max_by(|a, b| radiance(a).total_cmp(&radiance(b))).unwrap();
        let cosine = glam::Vec3::from(places[brightest]).dot(sun.towards().as_vec3());
        assert!(cosine > 0.98, "a clear sky is brightest {cosine} from the sun");
        assert!(under(CieSky::Clear, -1.0).is_err());
    }

    #[test]
    fn open_ground_has_the_illuminance_that_the_climate_states() {
        let climate = Climate::parse("a", WEA).unwrap();
        let lamps = Lighting::new(vec![[0.5; 3]; basis(true).column_count()]).unwrap();
        let at = |basis: &LightBasis, hour: f64| {
            let lamps = lamps.weights()[..basis.column_count()].to_vec();
            lighting_at("a", &Lighting::new(lamps).unwrap(), basis, &climate, ((6, 21), hour), SkyOptions::default())
        };
        for (hour, direct, diffuse) in [(11.5, 80000.0, 12000.0), (12.0, 70000.0, 16000.0), (12.5, 60000.0, 20000.0)] {
            let lighting = at(&basis(false), hour).unwrap();
            let step = climate.at((6, 21), hour).unwrap();
            let height = SkyModel::new(&climate, SkyOptions::default()).sun(&step).altitude.sin();
            let stated = diffuse + direct * height;
            let found = horizontal_lux(&basis(false), &lighting, 0);
            // The middles of the patches that share the sun stand a little above or below it.
            assert!((found / stated - 1.0).abs() < 0.02, "{hour}: {found} for {stated}");
            assert_eq!(lighting.weights()[0], [0.5; 3], "lamps stay as they are");
            // Of a split sky the sun is in what surfaces reflect and, without places of its own, in what comes straight.
            let split = at(&basis(true), hour).unwrap();
            for row in 0..2 {
                assert!((horizontal_lux(&basis(true), &split, row) / found - 1.0).abs() < 1e-5);
            }
        }
        let night = at(&basis(false), 0.5).unwrap();
        assert!(night.weights()[1..].iter().all(|weight| *weight == [0.0; 3]));
        let problem =
            lighting_at("a", &lamps, &basis(true), &climate, ((1, 1), 12.0), SkyOptions::default()).unwrap_err();
        assert!(problem.to_string().contains("no hours on day 1 of month 1"), "{problem}");
    }
}
