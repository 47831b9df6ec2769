//! Daylight from scene files to a year's measures: against analytic illuminances, and against the product with each hour's sky.

use std::fs;
use std::path::{Path, PathBuf};

use ltm::compress::Target;
use ltm::container::ContainerReader;
use ltm::daylight::{ANNUAL_MEASURES, Climate, Schedule, SkyModel, SkyOptions, SkyTexels};
use ltm::light::{LightKind, Lighting};
use ltm::matrix::{BlockId, ColumnIndex};
use ltm::pipeline::{self, Blinds, DaylightOptions, DaylightSource, PackOptions, RenderOptions, SunLimit};
use ltm::resources::NoProgress;
use ltm::scene::LoadOptions;
use ltm::store::StoreReader;

/// A box of 4 × 4 × 3 with an opening of 2 × 2 in the middle of its ceiling, of one material.
const ROOF_LIGHT: &str = "mtllib box.mtl\nusemtl all\n\
    v -2 0 -2\nv 2 0 -2\nv 2 0 2\nv -2 0 2\nv -2 3 -2\nv 2 3 -2\nv 2 3 2\nv -2 3 2\nv -1 3 -1\nv 1 3 -1\nv 1 3 1\nv -1 3 1\n\
    f 4 3 2 1\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\nf 5 6 10 9\nf 6 7 11 10\nf 7 8 12 11\nf 8 5 9 12\n";

/// A folder with the box, of a reflectance.
fn folder(reflectance: f32) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("box.obj"), ROOF_LIGHT).unwrap();
    let material = format!("newmtl all\nKd {reflectance} {reflectance} {reflectance}\n");
    fs::write(folder.path().join("box.mtl"), material).unwrap();
    folder
}

/// Renders a scene file of the box into a matrix there.
fn rendered(folder: &Path, text: &str, samples: u32) -> PathBuf {
    let scene = folder.join("scene.toml");
    fs::write(&scene, format!("geometry = [\"box.obj\"]\n{text}")).unwrap();
    let mut loaded = pipeline::load_scene(&scene, LoadOptions::default()).unwrap();
    loaded.settings.samples_per_pixel = samples;
    let path = folder.join("a.ltm");
    let mut options = RenderOptions::default();
    options.store.overwrite = true;
    pipeline::render(loaded, &path, &options, &NoProgress).unwrap();
    path
}

/// The columns of the first block of a matrix: the red values of its pixels.
fn columns(path: &Path) -> Vec<Vec<f32>> {
    let matrix = StoreReader::open(path).unwrap();
    let columns = matrix.job().shape.columns() as u32;
    let block = matrix.read_columns(BlockId(0), 0..columns).unwrap();
    let pixels = block.rows() / 3;
    (0..columns).map(|column| block.view().column(ColumnIndex(column))[..pixels].to_vec()).collect()
}

/// Sum of the columns of a range at a pixel.
fn sum(columns: &[Vec<f32>], pixel: usize) -> f64 {
    columns.iter().map(|column| f64::from(column[pixel])).sum()
}

/// Share of a horizontal plane's cosine-weighted hemisphere that a parallel rectangle `a × b` above its corner fills, at a height (Howell,
/// *A catalog of radiation heat transfer configuration factors*, B-3).
fn corner_factor(a: f64, b: f64, height: f64) -> f64 {
    let (a, b) = (a / height, b / height);
    let part = |a: f64, b: f64| a / (1.0 + a * a).sqrt() * (b / (1.0 + a * a).sqrt()).atan();
    (part(a, b) + part(b, a)) / (2.0 * std::f64::consts::PI)
}

const GRID: &str =
    "[[grid]]\nname = \"floor\"\norigin = [-2, 0.01, -0.5]\nedge_u = [4, 0, 0]\nedge_v = [0, 0, 1]\nspacing = 1\n";
const PATCHES: &str = "[[light]]\nkind = \"environment\"\nname = \"sky\"\npatches = \"reinhart\"\nsubdivision = 2\n";

/// Under a uniform sky of radiance 1 the sky component through an opening is π times the form factor of the opening (the sky component of
/// CIE 171:2006, §5.9, under a uniform sky).
#[test]
fn the_sky_component_through_an_opening_is_the_analytic_one() {
    let folder = folder(0.0);
    let found = columns(&rendered(folder.path(), &format!("{GRID}{PATCHES}"), 1 << 14));
    let height = 3.0 - 0.01;
    for (pixel, x) in [-1.5f64, -0.5, 0.5, 1.5].into_iter().enumerate() {
        // The opening reaches from −1 − x to 1 − x, and from −1 to 1.
        let (left, right) = (-1.0 - x, 1.0 - x);
        let half = |edge: f64| edge.signum() * corner_factor(edge.abs(), 1.0, height);
        let wanted = std::f64::consts::PI * 2.0 * (half(right) - half(left));
        let found = sum(&found, pixel);
        assert!((found / wanted - 1.0).abs() < 0.01, "{x}: {found} for {wanted}");
    }
}

/// The daylight factor below an opening, against the integral of the overcast sky's luminance, (1 + 2 sin γ) / 3 of the zenith's, over it; open
/// ground has 7π / 9 of the zenith's luminance (Moon and Spencer 1942).
#[test]
fn the_daylight_factor_below_an_opening_is_the_analytic_one() {
    let folder = folder(0.0);
    let path = rendered(folder.path(), &format!("{GRID}{PATCHES}"), 1 << 14);
    let matrix = StoreReader::open(&path).unwrap();
    let climate = Climate::parse("a.wea", WEA).unwrap();
    let options = DaylightOptions::default();
    let source = DaylightSource::Stored(&matrix);
    let year = pipeline::daylight(&source, "a.ltm", &climate, &options, None, &NoProgress).unwrap();
    let factor = ANNUAL_MEASURES.iter().position(|(name, _)| *name == "daylight_factor").unwrap();
    let (steps, height) = (200, 3.0 - 0.01);
    for (pixel, x) in [-1.5f64, -0.5, 0.5, 1.5].into_iter().enumerate() {
        let mut lit = 0.0;
        for i in 0..steps * steps {
            let across = [i % steps, i / steps].map(|at| (at as f64 + 0.5) * 2.0 / steps as f64 - 1.0);
            let square = (across[0] - x).powi(2) + across[1].powi(2) + height * height;
            let sine = height / square.sqrt();
            lit += (1.0 + 2.0 * sine) / 3.0 * sine * sine / square * (2.0 / steps as f64).powi(2);
        }
        let wanted = 100.0 * lit / (7.0 * std::f64::consts::PI / 9.0);
        let found = f64::from(year.measures[pixel].values[factor]);
        assert!((found / wanted - 1.0).abs() < 0.015, "{x}: {found} % for {wanted} %");
    }
}

/// A parallel sun gives the sine of its altitude where a straight line leads to it, and nothing elsewhere.
#[test]
fn the_sun_through_an_opening_is_the_analytic_one() {
    let folder = folder(0.5);
    let suns = "[[light]]\nkind = \"suns\"\npatches = \"reinhart\"\nsubdivision = 1\nangular_radius_degrees = 0\n";
    let sky = PATCHES.replace("subdivision = 2", "subdivision = 1\nsplit = true");
    let path = rendered(folder.path(), &format!("{GRID}{sky}{suns}"), 16);
    let found = columns(&path);
    let matrix = StoreReader::open(&path).unwrap();
    let light = matrix.job().basis.lights().last().unwrap();
    assert_eq!((light.kind, light.places.len()), (LightKind::Suns { count: 145 }, 145));
    let mut lit = 0;
    for (column, [x, y, z]) in light.columns().zip(&light.places) {
        for (pixel, at) in [-1.5f32, -0.5, 0.5, 1.5].into_iter().enumerate() {
            let along = (3.0 - 0.01) / y;
            let (meets, depth) = (at + x * along, z * along);
            if (meets.abs() - 1.0).abs() < 1e-3 || (depth.abs() - 1.0).abs() < 1e-3 {
                continue;
            }
            let wanted = if meets.abs() < 1.0 && depth.abs() < 1.0 { *y } else { 0.0 };
            let found = found[column as usize][pixel];
            assert!((found - wanted).abs() < 1e-5, "{at}, sun at {x} {y} {z}: {found} for {wanted}");
            lit += usize::from(wanted > 0.0);
        }
    }
    assert!(lit > 20, "only {lit} are lit");
}

/// The same paths fill both: what is split adds up to the whole, and the first row is what black surfaces leave.
#[test]
fn a_split_sky_adds_up_to_the_whole() {
    let (grey, black) = (folder(0.5), folder(0.0));
    let split = format!("{GRID}{}", PATCHES.replace("subdivision = 2", "subdivision = 1\nsplit = true"));
    let whole = format!("{GRID}{}", PATCHES.replace("subdivision = 2", "subdivision = 1"));
    let (parts, all) = (columns(&rendered(grey.path(), &split, 256)), columns(&rendered(grey.path(), &whole, 256)));
    let direct = columns(&rendered(black.path(), &split, 256));
    assert_eq!((parts.len(), all.len()), (292, 146));
    for patch in 0..146 {
        for pixel in 0..4 {
            let (sum, all) = (parts[patch][pixel] + parts[patch + 146][pixel], all[patch][pixel]);
            assert!((sum - all).abs() <= 1e-5 * all.max(1.0), "patch {patch}: {sum} for {all}");
            assert_eq!((parts[patch][pixel], 0.0), (direct[patch][pixel], direct[patch + 146][pixel]));
        }
    }
    assert!(sum(&parts[146..], 1) > 0.1 * sum(&parts[..146], 1));
}

/// A pixel that shows irradiance shows what a sensor in its place does.
#[test]
fn a_picture_of_irradiance_shows_what_sensors_do() {
    let folder = folder(0.3);
    let camera = "[camera]\neye = [0.5, 2, 0]\nlook_at = [0.5, 0, 0]\nup = [0, 0, 1]\nvertical_fov_degrees = 0.1\nwidth = 1\n\
        height = 1\nirradiance = true\n";
    let sensor = GRID.replace("0.01", "0");
    let of_sensor = columns(&rendered(folder.path(), &format!("{sensor}{PATCHES}"), 1 << 13));
    let of_pixel = columns(&rendered(folder.path(), &format!("{camera}{PATCHES}"), 1 << 13));
    let (sensor, pixel) = (sum(&of_sensor, 2), sum(&of_pixel, 0));
    assert!((pixel / sensor - 1.0).abs() < 0.02, "{pixel} for {sensor}");
}

const WEA: &str = "place A_B\nlatitude 48.1\nlongitude -11.6\ntime_zone -15\nsite_elevation 515\nweather_data_file_units 1\n\
    3 21 6.5 20 30\n3 21 9.5 500 120\n3 21 12.5 0 180\n6 21 12.5 850 100\n6 21 19.5 50 40\n6 21 23.5 0 0\n";

/// The illuminance of a pixel at a step by the product with that step's own weights, from the columns of the matrix.
fn lux_of_step(matrix: &StoreReader, climate: &Climate, step: usize) -> Vec<f32> {
    let basis = &matrix.job().basis;
    let sky = &basis.lights()[0];
    let suns = basis.lights().iter().find(|light| matches!(light.kind, LightKind::Suns { .. }));
    let is_split = matches!(sky.kind, LightKind::Patches { is_split: true, .. });
    let count = sky.places.len() / if is_split { 2 } else { 1 };
    let texels = SkyTexels::new(&sky.places[..count], &sky.extents[..count]);
    let mut weights = vec![[0.0; 3]; basis.column_count()];
    if let Some(now) = SkyModel::new(climate, SkyOptions::default()).at(&climate.steps[step], &texels) {
        for row in 0..sky.places.len() / count {
            (0..count).for_each(|texel| weights[row * count + texel] = [now.radiance[texel]; 3]);
        }
        // Beside places of the sun, the sun's share is in the second row of a split sky alone.
        let rows = if suns.is_some() { 1..2 } else { 0..1 + usize::from(is_split) };
        for (texel, radiance) in now.spread_sun(&texels) {
            rows.clone().for_each(|row| weights[row * count + texel].iter_mut().for_each(|weight| *weight += radiance));
        }
        if let Some(suns) = suns {
            let cosine = |place: &[f32; 3]| glam::Vec3::from(*place).as_dvec3().dot(now.towards_sun);
            let nearest =
                (0..suns.places.len()).max_by(|a, b| cosine(&suns.places[*a]).total_cmp(&cosine(&suns.places[*b])));
            weights[suns.first_column as usize + nearest.unwrap()] = [now.sun_irradiance as f32; 3];
        }
    }
    let image = ltm::relight::relight_raw(matrix, &[Lighting::new(weights).unwrap()]).unwrap().remove(0);
    image.pixels.iter().map(|[r, g, b]| 179.0 * (0.265 * r + 0.67 * g + 0.065 * b)).collect()
}

#[test]
fn a_year_of_hours_is_the_product_with_the_sky_of_each_hour() {
    let folder = folder(0.5);
    let climate = Climate::parse("a.wea", WEA).unwrap();
    let suns = "[[light]]\nkind = \"suns\"\nlatitude_degrees = 48.1\nstep_degrees = 4\n";
    let split = PATCHES.replace("subdivision = 2", "subdivision = 1\nsplit = true");
    for lights in [PATCHES.to_owned(), format!("{split}{suns}")] {
        let path = rendered(folder.path(), &format!("{GRID}{lights}"), 1024);
        let matrix = StoreReader::open(&path).unwrap();
        let hours = folder.path().join("hours.npy");
        let options = DaylightOptions {
            schedule: Schedule::parse_hours("8-18").unwrap(),
            overwrite: true,
            ..DaylightOptions::default()
        };
        let source = DaylightSource::Stored(&matrix);
        let year = pipeline::daylight(&source, "a.ltm", &climate, &options, Some(&hours), &NoProgress).unwrap();
        let wanted: Vec<Vec<f32>> = (0..6).map(|step| lux_of_step(&matrix, &climate, step)).collect();
        let bytes = fs::read(&hours).unwrap();
        let values: Vec<f32> =
            bytes[bytes.len() - 4 * 6 * 4..].as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        for pixel in 0..4 {
            for step in 0..6 {
                let (found, wanted) = (values[pixel * 6 + step], wanted[step][pixel]);
                assert!((found - wanted).abs() <= 1e-4 * wanted.max(1.0), "{pixel}, {step}: {found} for {wanted}");
            }
            // Of the six steps three are in the time of use.
            let mean = (wanted[1][pixel] + wanted[2][pixel] + wanted[3][pixel]) / 3.0;
            let measures = year.measures[pixel].values;
            assert!((measures[6] - mean).abs() <= 1e-3 * mean, "{} for {mean}", measures[6]);
            assert_eq!(measures[7].is_nan(), lights == PATCHES);
        }
        // The container gives the same within what compression leaves out, and does not tell hours of direct sun.
        let packed = folder.path().join("a.ltc");
        let mut pack = PackOptions::default();
        (pack.compress.target, pack.compress.rank, pack.compress.noise_factor) = (Target::PsnrDb(120.0), 256, None);
        pack.container.overwrite = true;
        pipeline::pack(&matrix, matrix.job(), &packed, &pack, &NoProgress).unwrap();
        let container = ContainerReader::open(&packed).unwrap();
        let source = DaylightSource::Container(&container);
        let from_container = pipeline::daylight(&source, "a.ltc", &climate, &options, None, &NoProgress).unwrap();
        for (a, b) in from_container.measures.iter().zip(&year.measures) {
            for measure in [6, ANNUAL_MEASURES.len() - 1] {
                let (found, wanted) = (a.values[measure], b.values[measure]);
                assert!((found / wanted - 1.0).abs() < 0.03, "{found} for {wanted}");
            }
            assert!(a.values[7].is_nan());
        }
    }
}

/// A sensor alone sees what it sees among all; of a lamp above black surfaces it sees the intensity over the square of the distance, by the
/// cosine to its normal, from the matrix and from the container of it.
#[test]
fn a_sensor_sees_its_hours_of_daylight_and_the_analytic_light_of_lamps() {
    let folder = folder(0.0);
    let climate = Climate::parse("a.wea", WEA).unwrap();
    let lamp = "[[light]]\nkind = \"point\"\nname = \"lamp\"\nposition = [0.5, 2, 0]\nemission = [8, 8, 8]\n";
    let path = rendered(folder.path(), &format!("{GRID}{lamp}{PATCHES}"), 256);
    let matrix = StoreReader::open(&path).unwrap();
    let (hours, options) = (folder.path().join("hours.npy"), DaylightOptions::default());
    let source = DaylightSource::Stored(&matrix);
    pipeline::daylight(&source, "a.ltm", &climate, &options, Some(&hours), &NoProgress).unwrap();
    let bytes = fs::read(&hours).unwrap();
    let values: Vec<f32> =
        bytes[bytes.len() - 4 * 6 * 4..].as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let packed = folder.path().join("a.ltc");
    let mut pack = PackOptions::default();
    (pack.compress.target, pack.compress.rank, pack.compress.noise_factor) = (Target::PsnrDb(120.0), 256, None);
    pipeline::pack(&matrix, matrix.job(), &packed, &pack, &NoProgress).unwrap();
    let container = ContainerReader::open(&packed).unwrap();
    for (source, near) in [(source, 1e-4), (DaylightSource::Container(&container), 0.03)] {
        let sensors = [3, 1, 2];
        let years = pipeline::sensor_years(&source, "a", &climate, &options, &sensors, &NoProgress).unwrap();
        for (sensor, year) in sensors.into_iter().zip(&years) {
            for (found, wanted) in year.daylight.iter().zip(&values[sensor * 6..]) {
                assert!((found - wanted).abs() <= near * wanted.max(1.0), "{sensor}: {found} for {wanted}");
            }
            let (across, up) = (sensor as f32 - 1.5 - 0.5, 2.0 - 0.01);
            let wanted = 179.0 * 8.0 * up / (across * across + up * up).powf(1.5);
            let found = year.lights[matrix.job().basis.lights().iter().position(|light| light.name == "lamp").unwrap()];
            assert!((found / wanted - 1.0).abs() < near, "{sensor}: {found} for {wanted}");
            assert_eq!(year.lights.iter().filter(|lux| **lux > 0.0).count(), 1, "the sky is no lamp");
        }
        let problem = pipeline::sensor_years(&source, "a", &climate, &options, &[4], &NoProgress).unwrap_err();
        assert!(problem.to_string().contains("a: has 4 sensors, none of number 5"), "{problem}");
    }
}

/// Direct sun on the floor below the opening, where the line to the nearest place of the sun meets it: more than 1,000 lx at some of the four
/// sensors, by the sine of its altitude.
#[test]
fn blinds_are_closed_where_the_analytic_sun_reaches_too_many_sensors() {
    let folder = folder(0.5);
    let climate = Climate::parse("a.wea", WEA).unwrap();
    let suns = "[[light]]\nkind = \"suns\"\nlatitude_degrees = 48.1\nstep_degrees = 2\nangular_radius_degrees = 0\n";
    let split = PATCHES.replace("subdivision = 2", "subdivision = 1\nsplit = true");
    let north = GRID.replace("-0.5]", "-1.5]");
    let path = rendered(folder.path(), &format!("{north}{split}{suns}"), 64);
    let matrix = StoreReader::open(&path).unwrap();
    let basis = &matrix.job().basis;
    let places = &basis.lights().iter().find(|light| matches!(light.kind, LightKind::Suns { .. })).unwrap().places;
    let sky = &basis.lights()[0];
    let texels = SkyTexels::new(&sky.places[..146], &sky.extents[..146]);
    let model = SkyModel::new(&climate, SkyOptions::default());
    let lit = |step: usize| {
        let Some(now) = model.at(&climate.steps[step], &texels).filter(|now| now.sun_irradiance > 0.0) else {
            return 0;
        };
        let cosine = |place: &[f32; 3]| glam::Vec3::from(*place).as_dvec3().dot(now.towards_sun);
        let sun = places.iter().max_by(|a, b| cosine(a).total_cmp(&cosine(b))).unwrap();
        let [x, y, z] = sun.map(f64::from);
        let along = (3.0 - 0.01) / y;
        let is_lit = |at: &f64| (at + x * along).abs() < 1.0 && (z * along - 1.0).abs() < 1.0;
        let is_bright = 179.0 * now.sun_irradiance * y > 1000.0;
        [-1.5, -0.5, 0.5, 1.5].iter().filter(|at| is_bright && is_lit(at)).count()
    };
    let counts: Vec<usize> = (0..6).map(lit).collect();
    assert!(counts.iter().any(|count| *count > 0) && counts.contains(&0), "{counts:?}");
    let (source, options) = (DaylightSource::Stored(&matrix), DaylightOptions::default());
    for share in [0.02, 0.3, 0.6] {
        let limit = SunLimit { share, ..SunLimit::default() };
        let closed = pipeline::steps_above_sun_limit(&source, "a", &climate, &options, limit, &NoProgress).unwrap();
        let wanted: Vec<bool> = counts.iter().map(|count| *count as f64 > share * 4.0).collect();
        assert_eq!(closed, wanted, "{share} {counts:?}");
    }
    let none = SunLimit { lux: -1.0, share: 0.02 };
    let problem = pipeline::steps_above_sun_limit(&source, "a", &climate, &options, none, &NoProgress).unwrap_err();
    assert!(problem.to_string().contains("are no limit"), "{problem}");
    let path = rendered(folder.path(), &format!("{GRID}{PATCHES}"), 2);
    let matrix = StoreReader::open(&path).unwrap();
    let (source, limit) = (DaylightSource::Stored(&matrix), SunLimit::default());
    let problem = pipeline::steps_above_sun_limit(&source, "a", &climate, &options, limit, &NoProgress).unwrap_err();
    assert!(problem.to_string().contains("a: does not tell direct sun"), "{problem}");
}

/// A year with blinds has, hour by hour, what the product of the matrix of that hour's state has; direct sun and the daylight factor stay
/// those of open blinds. The closed state is a room of other reflectance.
#[test]
fn a_year_with_blinds_is_each_hour_that_of_its_state() {
    let (open, closed) = (folder(0.5), folder(0.0));
    let climate = Climate::parse("a.wea", WEA).unwrap();
    let lamp = "[[light]]\nkind = \"point\"\nname = \"lamp\"\nposition = [0.5, 2, 0]\n";
    let split = PATCHES.replace("subdivision = 2", "subdivision = 1\nsplit = true");
    let text = format!("{GRID}{split}{lamp}");
    let paths = [&open, &closed].map(|folder| rendered(folder.path(), &text, 1024));
    let [open_matrix, closed_matrix] = paths.map(|path| StoreReader::open(&path).unwrap());
    let is_closed = [false, true, false, true, false, false];
    let blinds = Blinds { source: DaylightSource::Stored(&closed_matrix), place: "closed.ltm", closed: &is_closed };
    let options = DaylightOptions { blinds: Some(blinds), overwrite: true, ..DaylightOptions::default() };
    let source = DaylightSource::Stored(&open_matrix);
    let hours = open.path().join("hours.npy");
    let of = |options: &DaylightOptions<'_>, hours: Option<&Path>| {
        pipeline::daylight(&source, "a.ltm", &climate, options, hours, &NoProgress)
    };
    let (year, plain) = (of(&options, Some(&hours)).unwrap(), of(&DaylightOptions::default(), None).unwrap());
    let bytes = fs::read(&hours).unwrap();
    let values: Vec<f32> =
        bytes[bytes.len() - 4 * 6 * 4..].as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let sensors = pipeline::sensor_years(&source, "a.ltm", &climate, &options, &[0, 1, 2, 3], &NoProgress).unwrap();
    for (pixel, sensor) in sensors.iter().enumerate() {
        let mut sum = 0.0;
        for (step, is_closed) in is_closed.into_iter().enumerate() {
            let matrix = if is_closed { &closed_matrix } else { &open_matrix };
            let (found, wanted) = (values[pixel * 6 + step], lux_of_step(matrix, &climate, step)[pixel]);
            assert!((found - wanted).abs() <= 1e-4 * wanted.max(1.0), "{pixel}, {step}: {found} for {wanted}");
            assert_eq!(sensor.daylight[step], found);
            sum += if [1, 2, 3].contains(&step) { wanted } else { 0.0 };
        }
        let (measures, plain) = (year.measures[pixel].values, plain.measures[pixel].values);
        assert!((measures[6] - sum / 3.0).abs() <= 1e-3 * sum, "{} for {}", measures[6], sum / 3.0);
        assert!(measures[6] < plain[6]);
        assert_eq!((measures[7], measures[11]), (plain[7], plain[11]), "direct sun and the daylight factor");
        let lamp = open_matrix.job().basis.lights().iter().position(|light| light.name == "lamp").unwrap();
        assert!(sensor.closed_lights[lamp] > 0.0 && sensor.closed_lights[lamp] < sensor.lights[lamp]);
    }
    let problem =
        |blinds: Blinds<'_>| of(&DaylightOptions { blinds: Some(blinds), ..options }, None).unwrap_err().to_string();
    let text = problem(Blinds { closed: &is_closed[..5], ..blinds });
    assert!(text.contains("closed.ltm: blinds have 5 steps, the climate 6"), "{text}");
    let other = rendered(closed.path(), &format!("{}{split}", GRID.replace("spacing = 1", "spacing = 0.5")), 2);
    let other = StoreReader::open(&other).unwrap();
    let text = problem(Blinds { source: DaylightSource::Stored(&other), ..blinds });
    assert!(text.contains("has 8 × 2 places in blocks of 32, a.ltm has 4 × 1 places in blocks of 32"), "{text}");
}

#[test]
fn what_cannot_be_lit_by_a_climate_is_told_in_a_line() {
    let folder = folder(0.5);
    let climate = Climate::parse("a.wea", WEA).unwrap();
    let problem = |lights: &str| {
        let path = rendered(folder.path(), &format!("{GRID}{lights}"), 2);
        let matrix = StoreReader::open(&path).unwrap();
        let source = DaylightSource::Stored(&matrix);
        let options = DaylightOptions::default();
        pipeline::daylight(&source, "a.ltm", &climate, &options, None, &NoProgress).unwrap_err().to_string()
    };
    let suns = |key: &str| format!("[[light]]\nkind = \"suns\"\n{key}\n");
    let lamp = "[[light]]\nkind = \"point\"\nposition = [0, 1, 0]\n";
    assert!(problem(lamp).contains("has 0 environments"));
    assert!(problem(&format!("{PATCHES}{}", suns("latitude_degrees = 48"))).contains("split = true"));
    let split = PATCHES.replace("subdivision = 2", "subdivision = 1\nsplit = true");
    assert!(problem(&format!("{split}{}", suns("latitude_degrees = -60"))).contains("no place within 12°"));
}

#[test]
fn bad_grids_skies_and_suns_of_scene_files_are_told_in_a_line() {
    let folder = folder(0.5);
    fs::write(folder.path().join("good.pts"), "0 0 1 0 0 1\n# none\n\n1 1 1 0 0 -2\n").unwrap();
    fs::write(folder.path().join("bad.pts"), "0 0 1 0 0 1\n0 0 1 0\n").unwrap();
    fs::write(folder.path().join("flat.pts"), "0 0 1 0 0 0\n").unwrap();
    fs::write(folder.path().join("none.pts"), "\n").unwrap();
    let scene = folder.path().join("scene.toml");
    let load = |text: &str, grid: Option<&str>| {
        fs::write(&scene, format!("geometry = [\"box.obj\"]\n{text}")).unwrap();
        let options = LoadOptions { grid: grid.map(str::to_owned), ..LoadOptions::default() };
        pipeline::load_scene(&scene, options)
    };
    let points = |file: &str| format!("[[grid]]\nname = \"a\"\npoints = \"{file}\"\n{PATCHES}");
    let sensors = load(&points("good.pts"), Some("a")).unwrap().scene.sensors.unwrap();
    // Radiance's z is up: the second looks down.
    assert_eq!((sensors.size(), sensors.points()[1].position), ((2, 1), glam::Vec3::new(1.0, 1.0, -1.0)));
    assert_eq!(sensors.points()[1].normal, glam::Vec3::NEG_Y);
    let problem = |text: &str, grid: Option<&str>| load(text, grid).unwrap_err().to_string();
    assert!(problem(&points("bad.pts"), None).contains("bad.pts, line 2: is no point"));
    assert!(problem(&points("flat.pts"), None).contains("flat.pts, line 1: has a normal without length"));
    assert!(problem(&points("none.pts"), None).contains("has no points"));
    assert!(problem(&format!("{GRID}{PATCHES}"), Some("desk")).contains("has no grid 'desk'; it has 'floor'"));
    for name in ["../floor", "/x/floor", "camera", ".."] {
        let text = GRID.replace("floor", name);
        assert!(problem(&format!("{text}{PATCHES}"), None).contains("cannot name a file"), "{name}");
    }
    assert!(problem(&format!("{GRID}{GRID}{PATCHES}"), None).contains("grid 2 has the name 'floor' of another"));
    assert!(problem(&GRID.replace("spacing = 1", "spacing = 0"), None).contains("spacing 0"));
    assert!(problem(&GRID.replace("spacing = 1\n", ""), None).contains("lacks a key"));
    assert!(problem(&GRID.replace("edge_v = [0, 0, 1]", "edge_v = [1, 0, 0]"), None).contains("span no plane"));
    assert!(problem(&format!("{GRID}faces = [1, 0, 0]"), None).contains("'faces' lies in the plane"));
    let light = |text: &str| problem(&format!("{GRID}{PATCHES}{text}\n"), None);
    assert!(light("texels = [8, 4]").contains("patches beside a mapping or texels"));
    assert!(
        problem(&format!("{GRID}[[light]]\nkind = \"environment\"\nsplit = true\n"), None)
            .contains("only a sky of patches")
    );
    assert!(problem(&format!("{GRID}{}", PATCHES.replace("= 2", "= 17")), None).contains("subdivision 17"));
    assert!(
        problem(&format!("{GRID}{}", PATCHES.replace("reinhart", "tregenza")), None).contains("no subdivision of 2")
    );
    for keys in ["", "latitude_degrees = 40\npatches = \"reinhart\"", "patches = \"reinhart\"\nstep_degrees = 2"] {
        assert!(
            light(&format!("[[light]]\nkind = \"suns\"\n{keys}")).contains("says not where the sun stands"),
            "{keys}"
        );
    }
    assert!(light("[[light]]\nkind = \"suns\"\nlatitude_degrees = 95").contains("latitude_degrees 95"));
}
