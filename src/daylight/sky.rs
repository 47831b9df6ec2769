//! What the sky and the sun of a climate put on the columns of a matrix.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::sun::Sun;
use super::{CieSky, Climate, ClimateStep, LUMENS_PER_WATT, PerezSky, sun_at};
use crate::error::{Error, Result};
use crate::light::EnvironmentMapping;

/// Patches that the sun is spread over, as many as `gendaymtx` takes.
const SUN_PATCHES: usize = 4;

/// Choices of a sky.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkyOptions {
    /// Reflectance of the ground that is seen below the horizon.
    pub ground_reflectance: f64,
    /// How far the scene's north, −z, is turned from the site's towards east, in degrees.
    pub north_degrees: f64,
}

impl SkyOptions {
    /// Checks the values.
    ///
    /// # Errors
    /// A reflectance outside of 0 to 1; an angle that is not finite.
    pub fn check(&self) -> Result<()> {
        if !(0.0..=1.0).contains(&self.ground_reflectance) {
            let problem = format!("{} is no reflectance", self.ground_reflectance);
            return Err(Error::input("the ground", problem, "give 0 to 1"));
        }
        if !self.north_degrees.is_finite() {
            return Err(Error::input("north", format!("{} is no angle", self.north_degrees), "give degrees"));
        }
        Ok(())
    }
}

impl Default for SkyOptions {
    fn default() -> Self {
        Self { ground_reflectance: 0.2, north_degrees: 0.0 }
    }
}

/// Directions of columns with their solid angles.
#[derive(Clone, Debug)]
pub struct SkyTexels {
    /// Altitude and azimuth in radians; the azimuth from −z towards +x.
    angles: Vec<(f64, f64)>,
    directions: Vec<DVec3>,
    solid_angles: Vec<f64>,
}

impl SkyTexels {
    /// Texels in unit directions, with their solid angles in steradians.
    pub fn new(directions: &[[f32; 3]], solid_angles: &[f32]) -> Self {
        let directions: Vec<DVec3> = directions.iter().map(|d| Vec3::from(*d).as_dvec3().normalize()).collect();
        let angles = directions.iter().map(|d| (d.y.clamp(-1.0, 1.0).asin(), d.x.atan2(-d.z))).collect();
        Self { angles, directions, solid_angles: solid_angles.iter().map(|angle| f64::from(*angle)).collect() }
    }

    /// Those of an environment.
    pub fn of_mapping(mapping: EnvironmentMapping) -> Self {
        let texels = 0..mapping.texel_count();
        let directions: Vec<_> = texels.clone().map(|texel| mapping.middle(texel).to_array()).collect();
        Self::new(&directions, &texels.map(|texel| mapping.solid_angle(texel)).collect::<Vec<_>>())
    }

    /// Radiance of each texel, in W·sr⁻¹·m⁻², under a standard sky that lights open ground by so many lux, the sun's own light not among
    /// them. What is below the horizon is ground of this reflectance.
    pub fn standard(&self, sky: CieSky, sun: Sun, lux: f64, ground_reflectance: f64) -> Vec<f32> {
        let ground = ground_reflectance * lux / (PI * LUMENS_PER_WATT);
        self.lit_by(lux, ground, |texel| {
            let from_sun = self.directions[texel].dot(sun.towards()).clamp(-1.0, 1.0).acos();
            sky.relative_luminance(self.angles[texel].0, from_sun, sun.altitude)
        })
    }

    /// The radiance of the ground below the horizon, and above it what is in proportion to `relative` and lights open ground by so many lux:
    /// by these texels, however few there are, and not by the continuous sky.
    fn lit_by(&self, lux: f64, ground: f64, relative: impl Fn(usize) -> f64) -> Vec<f32> {
        let mut radiance = vec![ground; self.angles.len()];
        let mut sum = 0.0;
        for (texel, (value, angles)) in radiance.iter_mut().zip(&self.angles).enumerate() {
            if angles.0 > 0.0 {
                *value = relative(texel);
                sum += *value * angles.0.sin() * self.solid_angles[texel];
            }
        }
        // A sky that is dark by the model is uniform.
        let scale = lux / (LUMENS_PER_WATT * if sum > 1e-6 { sum } else { PI });
        for (value, angles) in radiance.iter_mut().zip(&self.angles) {
            if angles.0 > 0.0 {
                *value = scale * if sum > 1e-6 { *value } else { 1.0 };
            }
        }
        radiance.into_iter().map(|value| value as f32).collect()
    }
}

/// The light of one time.
#[derive(Clone, Debug)]
pub struct SkyNow {
    /// Radiance of each texel, without the sun.
    pub radiance: Vec<f32>,
    /// Irradiance by the sun of a plane across its light.
    pub sun_irradiance: f64,
    /// Unit direction towards the sun.
    pub towards_sun: DVec3,
    /// Whether any of the sun is above the horizon.
    pub sun_is_up: bool,
}

/// The skies of a climate.
#[derive(Clone, Copy, Debug)]
pub struct SkyModel<'a> {
    climate: &'a Climate,
    options: SkyOptions,
}

impl<'a> SkyModel<'a> {
    /// The skies of a climate.
    pub fn new(climate: &'a Climate, options: SkyOptions) -> Self {
        Self { climate, options }
    }

    /// Radiance of each texel of an environment at a step, the sun spread over the four nearest: the column of `gendaymtx`, without its tint.
    ///
    /// # Panics
    /// If there is no such step.
    pub fn sky(&self, step: usize, texels: &SkyTexels) -> Vec<f32> {
        let Some(mut now) = self.at(&self.climate.steps[step], texels) else {
            return vec![0.0; texels.directions.len()];
        };
        for (texel, radiance) in now.spread_sun(texels) {
            now.radiance[texel] += radiance;
        }
        now.radiance
    }

    /// The sun at a step, in the scene's axes.
    pub fn sun(&self, step: &ClimateStep) -> Sun {
        let sun = sun_at(&self.climate.site, step.day_of_year, step.hour);
        Sun { azimuth: sun.azimuth - self.options.north_degrees.to_radians(), ..sun }
    }

    /// The light at a step; `None` at night.
    pub fn at(&self, step: &ClimateStep, texels: &SkyTexels) -> Option<SkyNow> {
        let sun = self.sun(step);
        let sky = PerezSky::new(step.measured, sun.altitude, step.day_of_year, step.dew_point)?;
        let horizontal = sky.diffuse_illuminance + sky.direct_illuminance * sun.altitude.sin().max(0.0);
        let ground = self.options.ground_reflectance * horizontal / (PI * LUMENS_PER_WATT);
        let radiance = texels.lit_by(sky.diffuse_illuminance, ground, |texel| {
            let (altitude, azimuth) = texels.angles[texel];
            sky.relative_luminance(altitude, azimuth - sun.azimuth)
        });
        Some(SkyNow {
            radiance,
            sun_irradiance: sky.direct_illuminance / LUMENS_PER_WATT,
            towards_sun: sun.towards(),
            sun_is_up: sun.is_up(),
        })
    }
}

impl SkyNow {
    /// What the sun adds to the radiance of texels where it has no columns of its own: the four nearest above the horizon share its
    /// irradiance, by 1 / (1.002 − cosine) as in `gendaymtx`.
    pub fn spread_sun(&self, texels: &SkyTexels) -> Vec<(usize, f32)> {
        if self.sun_irradiance * LUMENS_PER_WATT <= 1e-4 {
            return Vec::new();
        }
        let mut nearest: Vec<(usize, f64)> = Vec::with_capacity(SUN_PATCHES + 1);
        for (texel, direction) in
            texels.directions.iter().enumerate().filter(|(texel, _)| texels.angles[*texel].0 > 0.0)
        {
            let cosine = direction.dot(self.towards_sun);
            if nearest.len() < SUN_PATCHES || cosine > nearest[nearest.len() - 1].1 {
                let at = nearest.partition_point(|(_, other)| *other >= cosine);
                nearest.insert(at, (texel, cosine));
                nearest.truncate(SUN_PATCHES);
            }
        }
        let weight = |cosine: f64| 1.0 / (1.002 - cosine);
        let sum: f64 = nearest.iter().map(|(_, cosine)| weight(*cosine)).sum();
        let share = |&(texel, cosine): &(usize, f64)| {
            (texel, (weight(cosine) / sum * self.sun_irradiance / texels.solid_angles[texel]) as f32)
        };
        nearest.iter().map(share).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::Climate;
    use super::*;
    use crate::light::SkyPatches;

    const HEADER: &str = "place Testville_XX\nlatitude 48.1\nlongitude -11.6\ntime_zone -15\nsite_elevation 515\n\
        weather_data_file_units ";
    const IRRADIANCE: &str =
        "1\n3 21 6.5 20 30\n3 21 9.5 500 120\n3 21 12.5 0 180\n6 21 12.5 850 100\n12 21 15.5 5 40\n";
    const HORIZONTAL: &str =
        "2\n3 21 6.5 20 30\n3 21 9.5 240 120\n3 21 12.5 0 180\n6 21 12.5 770 100\n12 21 15.5 5 40\n";
    const ILLUMINANCE: &str = "3\n3 21 6.5 1500 3500\n3 21 9.5 50000 15000\n3 21 12.5 0 22000\n6 21 12.5 88000 12000\n";

    fn patches(subdivision: u32) -> EnvironmentMapping {
        EnvironmentMapping::Patches(SkyPatches::of_subdivision(subdivision).unwrap())
    }

    /// Compares some patches and the sum of all with `gendaymtx -of -c 1 1 1 -m MF FILE` of Radiance 6.0a, to 10⁻³.
    fn is_radiances(climate: &Climate, options: SkyOptions, step: usize, subdivision: u32, known: &[(usize, f32)]) {
        let sky = SkyModel::new(climate, options).sky(step, &SkyTexels::of_mapping(patches(subdivision)));
        for &(patch, wanted) in known {
            let found = if patch == SUM { sky.iter().sum() } else { sky[patch] };
            let near = (found - wanted).abs() <= 1e-3 * wanted.abs().max(1e-3);
            assert!(near, "step {step}, MF {subdivision}, patch {patch}: {found} for {wanted}");
        }
    }

    /// Stands for the sum over all patches.
    const SUM: usize = usize::MAX;

    fn wea(text: &str) -> Climate {
        Climate::parse("a.wea", &format!("{HEADER}{text}")).unwrap()
    }

    #[test]
    fn skies_of_direct_normal_irradiance_are_those_of_gendaymtx() {
        let (climate, usual) = (wea(IRRADIANCE), SkyOptions::default());
        let of = |step, known: &[_]| is_radiances(&climate, usual, step, 1, known);
        of(0, &[(0, 1.200856), (1, 5.331236), (20, 4.78036), (75, 4.845072), (145, 4.485497), (SUM, 1111.888)]);
        of(1, &[(0, 14.46711), (1, 35.6086), (45, 59.98032), (100, 16.42531), (145, 14.9572), (SUM, 11446.41)]);
        of(2, &[(0, 7.601442), (1, 23.27088), (20, 28.27384), (75, 39.94725), (145, 42.6175), (SUM, 5022.235)]);
        of(3, &[(0, 33.09829), (1, 31.59952), (45, 27.74188), (100, 26.17394), (145, 24.75313), (SUM, 14594.62)]);
        of(4, &[(0, 1.557268), (20, 12.19137), (45, 8.064597), (100, 10.35488), (145, 7.707478), (SUM, 1106.204)]);
        let of = |step, known: &[_]| is_radiances(&climate, usual, step, 4, known);
        of(1, &[(0, 14.46711), (500, 32.76161), (1200, 38.52978), (2305, 15.04677), (SUM, 171915.3)]);
        of(3, &[(0, 33.09829), (500, 18.77618), (1200, 29.01226), (2305, 25.02207), (SUM, 220178.9)]);
    }

    #[test]
    fn skies_of_horizontal_irradiance_and_of_illuminance_are_those_of_gendaymtx() {
        let (horizontal, usual) = (wea(HORIZONTAL), SkyOptions::default());
        is_radiances(
            &horizontal,
            usual,
            0,
            1,
            &[(0, 2.005888), (1, 0.0), (75, 8.287554), (145, 11.12191), (SUM, 6548.818)],
        );
        is_radiances(&horizontal, usual, 3, 1, &[(0, 33.04551), (1, 31.59952), (SUM, 14573.9)]);
        is_radiances(&horizontal, usual, 4, 4, &[(500, 9.623809), (1200, 11.01212), (2305, 4.310761), (SUM, 30796.47)]);
        let lux = wea(ILLUMINANCE);
        is_radiances(
            &lux,
            usual,
            0,
            1,
            &[(0, 1.255973), (1, 6.918543), (20, 8.307119), (145, 4.356576), (SUM, 1364.117)],
        );
        is_radiances(
            &lux,
            usual,
            1,
            1,
            &[(0, 13.96196), (1, 34.19827), (45, 54.46723), (100, 13.69946), (SUM, 11117.21)],
        );
        is_radiances(&lux, usual, 2, 4, &[(0, 7.824378), (500, 27.61102), (1200, 45.29817), (SUM, 83089.16)]);
        is_radiances(&lux, usual, 3, 1, &[(0, 32.67246), (1, 29.01608), (75, 23.80673), (SUM, 14295.5)]);
    }

    /// Its dew points of three hours are averaged: `gendaymtx` over this file.
    #[test]
    fn skies_of_an_epw_file_are_those_of_gendaymtx() {
        let rows = [(11, 12.0, 600, 150), (12, 15.5, 700, 160), (13, 18.0, 300, 250), (14, -2.0, 5, 90)];
        let row = |(hour, dew_point, direct, diffuse): (u32, f32, u32, u32)| {
            format!("1999,6,21,{hour},60,?,20,{dew_point},50,101325,0,0,300,0,{direct},{diffuse},0,0,0,0,180,2,5,5\n")
        };
        let header = "LOCATION,Testville,-,DEU,Test,000000,48.10,11.60,1.0,515.0\nDESIGN CONDITIONS,0\n\
            TYPICAL/EXTREME PERIODS,0\nGROUND TEMPERATURES,0\nHOLIDAYS/DAYLIGHT SAVINGS,No,0,0,0\nCOMMENTS 1,none\n\
            COMMENTS 2,none\nDATA PERIODS,1,1,Data,Sunday, 6/21, 6/21\n";
        let climate = Climate::parse("a.epw", &format!("{header}{}", rows.map(row).concat())).unwrap();
        let of = |step, known: &[_]| is_radiances(&climate, SkyOptions::default(), step, 1, known);
        of(0, &[(0, 25.74364), (1, 42.40877), (45, 46.30147), (100, 22.13076), (SUM, 13471.89)]);
        of(1, &[(0, 30.1649), (1, 39.05169), (45, 43.68415), (100, 27.66908), (SUM, 14241.35)]);
        of(2, &[(0, 20.97879), (1, 35.39368), (45, 59.4072), (100, 77.86483), (SUM, 11116.51)]);
        of(3, &[(0, 4.238777), (1, 14.61501), (45, 16.72522), (100, 21.03028), (SUM, 2785.676)]);
    }

    /// `gendaymtx -r 30 -g .5 .5 .5 -c 1 1 1 -of`.
    #[test]
    fn a_turned_site_and_its_ground_are_those_of_gendaymtx() {
        let options = SkyOptions { ground_reflectance: 0.5, north_degrees: 30.0 };
        let known =
            [(0, 36.167778), (1, 34.247623), (20, 35.59143), (45, 31.072468), (75, 18.032343), (100, 14.745902)];
        is_radiances(&wea(IRRADIANCE), options, 1, 1, &known);
    }

    #[test]
    fn the_night_is_dark() {
        let climate = wea("1\n6 21 2.5 0 0\n");
        assert!(
            SkyModel::new(&climate, SkyOptions::default())
                .sky(0, &SkyTexels::of_mapping(patches(1)))
                .iter()
                .all(|value| *value == 0.0)
        );
    }

    /// The horizontal illuminance of a measured sky is what was measured, whatever the texels.
    #[test]
    fn the_sky_of_other_texels_gives_the_same_horizontal_illuminance() {
        let climate = wea(ILLUMINANCE);
        let model = SkyModel::new(&climate, SkyOptions::default());
        for mapping in [
            EnvironmentMapping::LatLong { across: 64, down: 32 },
            EnvironmentMapping::Octahedral { side: 32 },
            patches(2),
        ] {
            let texels = SkyTexels::of_mapping(mapping);
            let now = model.at(&climate.steps[1], &texels).unwrap();
            let up = now.radiance.iter().zip(&texels.directions).zip(&texels.solid_angles);
            let sum: f64 = up.map(|((l, d), omega)| f64::from(*l) * d.y.max(0.0) * omega).sum();
            assert!((sum * LUMENS_PER_WATT / 15000.0 - 1.0).abs() < 1e-5, "{mapping:?}: {sum}");
            assert!((now.sun_irradiance * LUMENS_PER_WATT / 50000.0 - 1.0).abs() < 1e-9);
            let spread = now.spread_sun(&texels);
            let irradiance: f64 = spread.iter().map(|(t, l)| f64::from(*l) * texels.solid_angles[*t]).sum();
            assert!((irradiance / now.sun_irradiance - 1.0).abs() < 1e-5);
        }
    }
}
