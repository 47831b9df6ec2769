//! Daylight: climates, the place of the sun, the luminance of the sky, and what a year of them gives.
//!
//! The models are those of Radiance's `gendaymtx`, to whose numbers the tests hold them; so are the axes, turned: +y is the zenith, −z north
//! and +x east (Radiance's (x, y, z) is (x, z, −y) here). A sky is a weight for each column of an environment, in W·sr⁻¹·m⁻²; a candela a square
//! metre is 1/179 of that ([`LUMENS_PER_WATT`]).
//!
//! ```
//! use ltm::daylight::{Climate, SkyModel, SkyOptions, SkyTexels};
//! use ltm::light::{EnvironmentMapping, SkyPatches};
//!
//! let text = "place Testville_XX\nlatitude 48.1\nlongitude -11.6\ntime_zone -15\nsite_elevation 515\n\
//!     weather_data_file_units 1\n6 21 12.5 850 100\n";
//! let climate = Climate::parse("test.wea", text)?;
//! let patches = EnvironmentMapping::Patches(SkyPatches::of_subdivision(1).unwrap());
//! let sky = SkyModel::new(&climate, SkyOptions::default()).sky(0, &SkyTexels::of_mapping(patches));
//! assert_eq!(sky.len(), 146);
//! # Ok::<(), ltm::Error>(())
//! ```

mod calendar;
mod cie;
mod climate;
mod dimming;
mod eye_picture;
mod glare;
mod measures;
mod mtx;
mod perez;
mod schedule;
mod site;
mod sky;
mod sun;

pub use calendar::DAYS_BEFORE_MONTH;
pub use cie::CieSky;
pub use climate::{Climate, ClimateStep, Measured};
pub use dimming::{Dimming, LampYear, number_with_unit, settled_light};
pub use eye_picture::{GlareOptions, GlareSource, SeenGlare, SeenPoint, points_of_picture, position_index};
pub use glare::{EyeGlare, GLARE_CLASSES, GLARE_LIMITS, glare_limits_lux, simplified_glare_probability};
pub use measures::{ANNUAL_MEASURES, AnnualMeasures, EN_17037, HourSums, SpatialMeasures, Thresholds};
pub use mtx::{MtxFormat, RadianceMatrix};
pub use perez::PerezSky;
pub use schedule::Schedule;
pub use site::Site;
pub use sky::{SkyModel, SkyNow, SkyOptions, SkyTexels};
pub use sun::{Sun, sun_at};

/// [`image::LUMENS_PER_WATT`](crate::image::LUMENS_PER_WATT), in the precision of the models here.
pub const LUMENS_PER_WATT: f64 = crate::image::LUMENS_PER_WATT as f64;

/// What each channel brings to luminance, as Radiance weighs them.
pub const LUMINANCE_WEIGHTS: [f32; 3] = [0.265, 0.670, 0.065];
