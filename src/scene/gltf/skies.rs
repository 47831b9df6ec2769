//! `EXT_lights_image_based`: the surroundings as a cube map, of which the first images, which are not blurred, are read.

use std::f64::consts::PI;
use std::path::Path;

use glam::Quat;

use super::super::cube_map::CubeMap;
use super::super::file::{LightEntry, LightEntryKind};
use super::super::folders::Folders;
use super::super::memory::MemoryBound;
use super::buffers::Buffers;
use super::lamps::EXPORTERS_LUMENS_PER_WATT;
use super::materials::image_source;
use super::nodes;
use super::plain;
use super::tree::{JsonItem, JsonTree};
use crate::error::{Error, Result, Warnings};
use crate::image::{ImageFacts, RgbaImage, embedded_facts, image_facts, read_embedded, read_rgba};
use crate::scene::source::ImageSource;

const NAME: &str = "EXT_lights_image_based";

/// Pixels along a side of a face at most: more than any environment has texels.
const MAX_SIDE: u32 = 2048;

/// Share by which the mean of the images may differ from that of the coefficients before a line says so: 8 bits and the
/// steps of the pixels are good for some hundredths.
const MEANS_DIFFER: f64 = 0.1;

/// The surroundings of the scene that is shown first, if it has any. Errors: a light that is not there, images that are
/// missing, not square or of different sizes, numbers that are negative or not finite.
pub(super) fn of(
    path: &Path,
    tree: &JsonTree,
    buffers: &Buffers<'_>,
    folders: &Folders,
    memory: &mut MemoryBound,
    warnings: &mut Warnings,
) -> Result<Option<LightEntry>> {
    let scene = match nodes::shown(tree)? {
        Some(scene) => scene.extension(NAME)?,
        None => None,
    };
    let Some(stated) = scene else { return Ok(None) };
    let refuse = |problem: &str| {
        let place = format!("{}, image-based light", path.display());
        Error::input(place, problem, "mend the light and export the file again")
    };
    let lights = match tree.root().extension(NAME)? {
        Some(all) => all.objects("lights")?,
        None => Vec::new(),
    };
    let light = stated.whole("light").ok().flatten().and_then(|index| lights.get(index));
    let light = light.ok_or_else(|| refuse("the scene names a light that is not there"))?;
    let intensity = light.number("intensity").unwrap_or(Some(f32::NAN)).unwrap_or(1.0);
    if !(intensity >= 0.0 && intensity.is_finite()) {
        return Err(refuse("its intensity is negative or not finite"));
    }
    let rotation = light.numbers("rotation").unwrap_or(Some([f32::NAN; 4])).unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let length = Quat::from_array(rotation).length();
    if !(0.5..2.0).contains(&length) {
        return Err(refuse("its rotation is no unit quaternion"));
    }
    let rotation = Quat::from_array(rotation).normalize();
    let images = light.value("specularImages").and_then(|all| all[0].as_array()).filter(|images| images.len() == 6);
    let images = images.ok_or_else(|| refuse("has not the six images of a cube"))?;
    let (mut side, mut faces) = (0, [(); 6].map(|()| Vec::new()));
    for (face, image) in faces.iter_mut().zip(images) {
        let index = image.as_u64().and_then(|index| usize::try_from(index).ok());
        let index = index.filter(|&index| index < tree.count("images"));
        let index = index.ok_or_else(|| refuse("names an image that is not there"))?;
        let place = format!("{}, image-based light", path.display());
        let source = image_source(path, buffers, index, &place, warnings)?;
        let image = read(&source, &place, folders, memory, warnings)?;
        if image.width != image.height || (side != 0 && side != image.width) {
            return Err(refuse("its six images are not squares of one size"));
        }
        side = image.width;
        *face = image.pixels.iter().map(|&pixel| radiance(pixel)).collect();
        memory.take((face.len() * size_of::<[f32; 3]>()) as u64, path)?;
    }
    let cube = CubeMap { side: side as usize, faces, rotation };
    let name = light.name().map_or_else(|| "environment".into(), plain);
    warnings.extend(compare_means(path, &name, &cube, light));
    Ok(Some(LightEntry {
        kind: LightEntryKind::Environment,
        name: Some(name),
        emission: Some([intensity / EXPORTERS_LUMENS_PER_WATT; 3]),
        cube: Some(cube),
        ..LightEntry::default()
    }))
}

fn read(
    source: &ImageSource,
    place: &str,
    folders: &Folders,
    memory: &MemoryBound,
    warnings: &mut Warnings,
) -> Result<RgbaImage> {
    match source {
        ImageSource::Embedded(name, bytes) => {
            admit(&embedded_facts(name, bytes)?, name, place, memory)?;
            read_embedded(name, bytes)
        }
        ImageSource::File(folder, name) => {
            let file = folder.join(name);
            if !file.is_file() {
                let problem = format!("its image is the file \"{}\", which is missing", plain(name));
                return Err(Error::input(place, problem, "put it there, or export the file again with its images"));
            }
            folders.reach.admit(&file, place)?;
            let facts = image_facts(&file)?;
            admit(&facts, &file, place, memory)?;
            warnings.extend(facts.notes.iter().map(|note| format!("{}: {note}", file.display())));
            read_rgba(&file)
        }
        ImageSource::Colours(_) => Err(Error::input(place, "has colours for an image", "export the file again")),
    }
}

fn admit(facts: &ImageFacts, file: &Path, place: &str, memory: &MemoryBound) -> Result<()> {
    if facts.width.max(facts.height) > MAX_SIDE {
        let problem = format!("an image has {} × {} pixels", facts.width, facts.height);
        return Err(Error::input(place, problem, format!("give squares of at most {MAX_SIDE} a side")));
    }
    memory.check(facts.needs_bytes, file)
}

/// RGBD: colours, decoded from sRGB, over alpha, which is 1 where an image has none. No alpha is no light.
fn radiance([r, g, b, a]: [f32; 4]) -> [f32; 3] {
    if a > 0.0 { [r / a, g / a, b / a] } else { [0.0; 3] }
}

/// A message if the mean of the images differs from that of the irradiance. Coefficient 0 is `π ∫ L Y₀₀ dω`, so that
/// the mean radiance is `Y₀₀ / π` of it, with `Y₀₀ = 1 / √(4π)` (Ramamoorthi, Hanrahan, *An efficient representation
/// for irradiance environment maps*, 2001).
fn compare_means(path: &Path, name: &str, cube: &CubeMap, light: &JsonItem<'_>) -> Option<String> {
    let coefficients = light.value("irradianceCoefficients");
    let mean = |values: [f64; 3]| values.iter().sum::<f64>() / 3.0;
    let stated = [0, 1, 2].map(|i| coefficients.and_then(|all| all[0][i].as_f64()).unwrap_or(f64::NAN));
    let (images, stated) = (mean(cube.mean()), mean(stated) / (4.0 * PI).sqrt() / PI);
    let differs = (images - stated).abs() > MEANS_DIFFER * images.max(stated);
    (differs || !stated.is_finite()).then(|| {
        format!(
            "{}: the images of the image-based light '{name}' have a mean of {images:.3}, its irradiance coefficients one of \
             {stated:.3}; the images are used",
            path.display()
        )
    })
}
