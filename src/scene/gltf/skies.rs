//! `EXT_lights_image_based`: the surroundings as a cube map, of which the first images, which are not blurred, are read.

use std::f64::consts::PI;
use std::path::Path;

use glam::Quat;
use gltf::Document;
use serde_json::Value;

use super::super::cube_map::CubeMap;
use super::super::file::{LightEntry, LightEntryKind};
use super::super::folders::Folders;
use super::super::memory::Memory;
use super::buffers::Buffers;
use super::lamps::EXPORTERS_LUMENS_PER_WATT;
use super::materials::{ImageSource, image_source};
use super::plain;
use crate::error::{Error, Result};
use crate::image::{ImageFacts, RgbaImage, embedded_facts, image_facts, read_embedded, read_rgba};

const NAME: &str = "EXT_lights_image_based";

/// Pixels along a side of a face at most: more than any environment has texels.
const MOST_SIDE: u32 = 2048;

/// Share by which the mean of the images may differ from that of the coefficients before a line says so: 8 bits and the
/// steps of the pixels are good for some hundredths.
const MEANS_DIFFER: f64 = 0.1;

/// The surroundings of the scene that is shown first, if it has any. Errors: a light that is not there, images that are
/// missing, not square or of different sizes, numbers that are negative or not finite.
pub(super) fn of(
    path: &Path,
    document: &Document,
    buffers: &Buffers,
    folders: &Folders,
    memory: &mut Memory,
    warnings: &mut Vec<String>,
) -> Result<Option<LightEntry>> {
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let Some(stated) = scene.as_ref().and_then(|scene| scene.extension_value(NAME)) else { return Ok(None) };
    let refuse = |problem: &str| {
        let place = format!("{}, image-based light", path.display());
        Error::input(place, problem, "mend the light and export the file again")
    };
    let light = document.extension_value(NAME).zip(stated["light"].as_u64());
    let light = light.and_then(|(all, index)| all["lights"].get(usize::try_from(index).ok()?));
    let light = light.ok_or_else(|| refuse("the scene names a light that is not there"))?;
    let intensity = light.get("intensity").map_or(Some(1.0), Value::as_f64).unwrap_or(f64::NAN) as f32;
    if !(intensity >= 0.0 && intensity.is_finite()) {
        return Err(refuse("its intensity is negative or not finite"));
    }
    let rotation = [0, 1, 2, 3].map(|i| {
        let stated = light.get("rotation").map_or(Some([0.0, 0.0, 0.0, 1.0][i]), |v| v[i].as_f64());
        stated.map_or(f32::NAN, |v| v as f32)
    });
    let length = Quat::from_array(rotation).length();
    if !(0.5..2.0).contains(&length) {
        return Err(refuse("its rotation is no unit quaternion"));
    }
    let rotation = Quat::from_array(rotation).normalize();
    let images = light["specularImages"][0].as_array().filter(|images| images.len() == 6);
    let images = images.ok_or_else(|| refuse("has not the six images of a cube"))?;
    let (mut side, mut faces) = (0, [(); 6].map(|()| Vec::new()));
    for (face, image) in faces.iter_mut().zip(images) {
        let index = image.as_u64().and_then(|index| usize::try_from(index).ok());
        let index = index.filter(|&index| index < document.images().len());
        let index = index.ok_or_else(|| refuse("names an image that is not there"))?;
        let place = format!("{}, image-based light", path.display());
        let source = image_source(path, document, buffers, index, &place)?;
        let image = read(&source, &place, folders, memory, warnings)?;
        if image.width != image.height || (side != 0 && side != image.width) {
            return Err(refuse("its six images are not squares of one size"));
        }
        side = image.width;
        *face = image.pixels.iter().map(|&pixel| radiance(pixel)).collect();
        memory.take((face.len() * size_of::<[f32; 3]>()) as u64, path)?;
    }
    let cube = CubeMap { side: side as usize, faces, rotation };
    let name = light["name"].as_str().filter(|name| !name.is_empty()).map_or_else(|| "environment".into(), plain);
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
    memory: &Memory,
    warnings: &mut Vec<String>,
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

fn admit(facts: &ImageFacts, file: &Path, place: &str, memory: &Memory) -> Result<()> {
    if facts.width.max(facts.height) > MOST_SIDE {
        let problem = format!("an image has {} × {} pixels", facts.width, facts.height);
        return Err(Error::input(place, problem, format!("give squares of at most {MOST_SIDE} a side")));
    }
    memory.check(facts.needs_bytes, file)
}

/// RGBD: colours, decoded from sRGB, over alpha, which is 1 where an image has none. No alpha is no light.
fn radiance([r, g, b, a]: [f32; 4]) -> [f32; 3] {
    if a > 0.0 { [r / a, g / a, b / a] } else { [0.0; 3] }
}

/// A line where the mean of the images is not that of the irradiance: coefficient 0 is `π ∫ L Y₀₀ dω`, so that the mean
/// radiance is `Y₀₀ / π` of it, with `Y₀₀ = 1 / √(4π)` (Ramamoorthi, Hanrahan, *An efficient representation for irradiance
/// environment maps*, 2001).
fn compare_means(path: &Path, name: &str, cube: &CubeMap, light: &Value) -> Option<String> {
    let first = &light["irradianceCoefficients"][0];
    let mean = |values: [f64; 3]| values.iter().sum::<f64>() / 3.0;
    let stated = [0, 1, 2].map(|i| first[i].as_f64().unwrap_or(f64::NAN));
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
