//! Mitsuba 3 (Jakob et al. 2022) as a rival: the same scene, rendered again by it for one lighting.
//!
//! The scene is written as PLY files and a description; a Python that has the package, named by `LTM_MITSUBA` or else
//! the `python3` on the path, renders it with the script beside this file.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::python::Python;
use super::raw_image::read_f32;
use ltm::error::{Error, Result};
use ltm::files::write_file;
use ltm::image::LinearImage;
use ltm::scene::{Emitter, FloatTexture, LoadedScene, Mesh, Paint, PrincipledSurface, Surface, Triangle};

const SCRIPT: &str = include_str!("render_with_mitsuba.py");
const COLUMNS_SCRIPT: &str = include_str!("render_columns_with_mitsuba.py");

/// One rendered image.
#[derive(Clone, Debug)]
pub(super) struct Rendered {
    /// Of rendering alone.
    pub(super) seconds: f64,
    /// Of all threads.
    pub(super) cpu_seconds: f64,
    pub(super) image: LinearImage,
}

/// Its variants that run on a processor: the vectorising compiler, which is its fastest there, and the plain one.
pub(super) const VARIANTS: [(&str, &str); 2] =
    [("llvm_ad_rgb", "Mitsuba 3 (llvm_ad_rgb)"), ("scalar_rgb", "Mitsuba 3 (scalar_rgb)")];

/// What runs it.
pub(super) const MITSUBA: Python = Python { package: "mitsuba", variable: "LTM_MITSUBA" };

/// Renders the scene in its own lighting with each number of samples; `folder` takes what it needs for that.
///
/// Errors: materials or lights that have no twin there; files that cannot be written; a script that fails, with its
/// last line.
pub(super) fn render(loaded: &LoadedScene, folder: &Path, variant: &str, samples: &[u32]) -> Result<Vec<Rendered>> {
    fs::create_dir_all(folder).map_err(Error::io(folder, "create the folder"))?;
    write_scene(loaded, folder)?;
    let arguments: Vec<String> = [variant.to_owned()].into_iter().chain(samples.iter().map(u32::to_string)).collect();
    let printed = MITSUBA.run(SCRIPT, folder, &arguments)?;
    let camera = &loaded.scene.camera;
    let timed = printed.lines().filter_map(|line| {
        let mut words = line.split(' ');
        Some((words.next()?.parse().ok()?, words.next()?.parse().ok()?, words.next()?.parse().ok()?))
    });
    let read = |(samples, seconds, cpu_seconds): (u32, f64, f64)| -> Result<Rendered> {
        let image = read_f32(&folder.join(format!("{samples}.f32")), camera.width, camera.height)?;
        Ok(Rendered { seconds, cpu_seconds, image })
    };
    let images = timed.map(read).collect::<Result<Vec<_>>>()?;
    match images.len() == samples.len() {
        true => Ok(images),
        false => Err(Error::input(variant, "Mitsuba made fewer images than asked", "try the variant by hand")),
    }
}

/// All columns of one of the script's own scenes, as an array in the folder, rendered now or before.
///
/// Errors: a script that fails, with its last line.
pub(super) fn columns(
    scene: &str,
    folder: &Path,
    (width, height): (u32, u32),
    texels: u32,
    samples: u32,
    seed: u64,
) -> Result<PathBuf> {
    let path = folder.join(format!("{scene}-{samples}-{seed}.npy"));
    if !path.exists() {
        let numbers = [width, height, texels, samples].map(|number| number.to_string());
        let arguments: Vec<String> = [scene.to_owned()].into_iter().chain(numbers).chain([seed.to_string()]).collect();
        MITSUBA.run(COLUMNS_SCRIPT, folder, &arguments)?;
    }
    Ok(path)
}

/// `scene.json` and a PLY file for each material and light.
fn write_scene(loaded: &LoadedScene, folder: &Path) -> Result<()> {
    let scene = &loaded.scene;
    // Faces with normals of their own and those without lie apart: a PLY file has them for all or for none.
    let mut groups: BTreeMap<(u32, Option<u32>, bool), Vec<&Triangle>> = BTreeMap::new();
    for triangle in &scene.mesh.triangles {
        let flat = scene.mesh.vertices[triangle.vertices[0] as usize].normal.length_squared() == 0.0;
        groups.entry((triangle.material.0, triangle.emitter, flat)).or_default().push(triangle);
    }
    let mut parts = Map::new();
    for ((material, emitter, flat), triangles) in groups {
        let name = format!("part-{}", parts.len());
        let file = format!("{name}.ply");
        let path = folder.join(&file);
        write_file(&path, true, &ply(&scene.mesh, &triangles, !flat))?;
        let material = &scene.materials[material as usize];
        let radiance = emitter.map(|light| radiance(loaded, light as usize)).transpose()?;
        parts.insert(name, json!({ "file": file, "flat": flat, "bsdf": masked(bsdf(material.surface)?, material.opacity), "radiance": radiance }));
    }
    let camera = &scene.camera;
    let described = json!({
        "max_depth": loaded.settings.max_depth,
        "camera": {
            "eye": camera.eye.to_array(),
            "target": (camera.eye + camera.forward).to_array(),
            "up": camera.up.to_array(),
            "vertical_fov_degrees": camera.vertical_fov_radians().map(f32::to_degrees),
            "width": camera.width,
            "height": camera.height,
        },
        "parts": parts,
    });
    let path = folder.join("scene.json");
    write_file(&path, true, described.to_string().as_bytes())
}

/// Radiance of a light whose columns all have the same.
fn radiance(loaded: &LoadedScene, light: usize) -> Result<[f32; 3]> {
    let refuse = || Err(Error::input(&loaded.scene.name, "has a light that is not a plain area light", ""));
    let Some(Emitter::Area(_)) = loaded.scene.emitters.get(light) else { return refuse() };
    let columns = loaded.scene.basis.lights()[light].columns();
    let weights = &loaded.lighting.weights()[columns.start as usize..columns.end as usize];
    match weights.split_first() {
        Some((first, rest)) if rest.iter().all(|w| w == first) => Ok(*first),
        _ => refuse(),
    }
}

/// The twin of a surface that lets some of the light pass.
fn masked(bsdf: Value, opacity: f32) -> Value {
    if opacity < 1.0 { json!({ "type": "mask", "opacity": opacity, "bsdf": bsdf }) } else { bsdf }
}

/// The twin of a surface, as the dictionary of a plugin.
fn bsdf(surface: Surface) -> Result<Value> {
    let rgb = |value: [f32; 3]| json!({ "type": "rgb", "value": value });
    let two_sided = |bsdf: Value| json!({ "type": "twosided", "bsdf": bsdf });
    let constant = |paint: Paint| match paint {
        Paint::Constant(colour) => Ok(rgb(colour.to_array())),
        Paint::Textured(..) => Err(Error::input("material", "has a texture, which is not written for Mitsuba", "")),
    };
    Ok(match surface {
        Surface::Lambert { reflectance } => {
            two_sided(json!({ "type": "diffuse", "reflectance": constant(reflectance)? }))
        }
        Surface::Mirror { reflectance } => two_sided(
            json!({ "type": "conductor", "material": "none", "specular_reflectance": constant(reflectance)? }),
        ),
        Surface::Dielectric { ior, .. } => json!({ "type": "dielectric", "int_ior": ior, "ext_ior": 1.0 }),
        Surface::ThinDielectric { ior, .. } => json!({ "type": "thindielectric", "int_ior": ior, "ext_ior": 1.0 }),
        Surface::Black => json!({ "type": "diffuse", "reflectance": rgb([0.0; 3]) }),
        Surface::Principled(PrincipledSurface {
            base: Paint::Constant(base),
            roughness: FloatTexture::Constant(roughness),
            transmission,
            metallic,
            ior,
            is_thin: false,
            ..
        }) if transmission.is(1.0) && metallic.is(0.0) => json!({
            "type": "roughdielectric", "distribution": "ggx", "alpha": roughness * roughness, "int_ior": ior, "ext_ior": 1.0,
            "specular_transmittance": rgb(base.map(f32::sqrt).to_array())
        }),
        Surface::RoughConductor { .. } | Surface::Coated { .. } | Surface::Principled(_) => {
            return Err(Error::input("material", "is glossy in a way that Mitsuba has no exact twin of", ""));
        }
    })
}

/// A binary PLY file of these triangles, each with its own three vertices.
fn ply(mesh: &Mesh, triangles: &[&Triangle], with_normals: bool) -> Vec<u8> {
    let mut properties = String::from("property float x\nproperty float y\nproperty float z\n");
    if with_normals {
        properties += "property float nx\nproperty float ny\nproperty float nz\n";
    }
    let (vertices, faces) = (3 * triangles.len(), triangles.len());
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\n{properties}element face {faces}\n\
property list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    for vertex in triangles.iter().flat_map(|triangle| triangle.vertices) {
        let put = |v: glam::Vec3| v.to_array().map(f32::to_le_bytes).concat();
        bytes.extend(put(mesh.vertices[vertex as usize].position));
        if with_normals {
            bytes.extend(put(mesh.vertices[vertex as usize].normal));
        }
    }
    for face in 0..faces as u32 {
        bytes.push(3);
        bytes.extend([0, 1, 2].map(|corner| (3 * face + corner).to_le_bytes()).concat());
    }
    bytes
}
