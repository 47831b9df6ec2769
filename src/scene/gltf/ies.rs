//! `EXT_lights_ies`: measured luminaires as a scene file would state them.

use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, Mat3};

use super::super::file::{LightEntry, LightEntryKind, Luminaire};
use super::super::folders::Folders;
use super::super::photometry::{self, MAX_PHOTOMETRY_BYTES};
use super::buffers::{Buffers, Uri, uri};
use super::nodes::Placed;
use super::plain;
use super::tree::JsonTree;
use crate::error::{Error, Result, Warnings};
use crate::files::read_input;
use crate::image::LUMENS_PER_WATT;

const NAME: &str = "EXT_lights_ies";

/// The luminaires of the nodes. Their candelas are measured, so that a watt has as many lumens as in IES files elsewhere.
/// Errors: a profile that is missing or no IES file; a multiplier or colour that is negative or not finite.
pub(super) fn of(
    path: &Path,
    tree: &JsonTree,
    nodes: &[Placed<'_>],
    buffers: &Buffers<'_>,
    folders: &Folders,
    warnings: &mut Warnings,
) -> Result<Vec<LightEntry>> {
    let mut luminaires = Vec::new();
    for placed in nodes {
        let Some(stated) = placed.node.extension(NAME)? else { continue };
        let refuse = |problem: &str| {
            let place = format!("{}, luminaire '{}'", path.display(), placed.name);
            Error::input(place, problem, "mend the luminaire and export the file again")
        };
        let index = stated.whole("light").ok().flatten().ok_or_else(|| refuse("names no light profile"))?;
        let profiles = match tree.root().extension(NAME)? {
            Some(all) => all.objects("lights")?,
            None => Vec::new(),
        };
        let profile = profiles.get(index).ok_or_else(|| refuse("names a light profile that is not there"))?;
        let bytes = if let Some(text) = profile.text("uri")? {
            from_uri(path, text, folders, &refuse)?
        } else {
            let view = profile.index("bufferView", "bufferViews").ok().flatten();
            let bytes = buffers.view(view.ok_or_else(|| refuse("has a light profile without data"))?)?;
            match bytes.len() as u64 <= MAX_PHOTOMETRY_BYTES {
                true => bytes.to_vec(),
                false => return Err(refuse("has a light profile that is too large")),
            }
        };
        let place = PathBuf::from(format!("{}, light profile {index}", path.display()));
        let photometry = photometry::parse(&place, &bytes)?;
        warnings.extend(photometry.remarks.iter().cloned());
        let multiplier = stated.number("multiplier")?.unwrap_or(1.0);
        let colour = stated.numbers("color").unwrap_or(Some([f32::NAN; 3])).unwrap_or([1.0; 3]);
        let factors = colour.map(|c: f32| c * multiplier);
        let emission = factors.map(|factor| factor * photometry.peak_candela / LUMENS_PER_WATT);
        if !emission.iter().all(|v| *v >= 0.0 && v.is_finite()) {
            return Err(refuse("its multiplier or colour is negative or not finite"));
        }
        let world_from_luminaire =
            axes(placed.world).ok_or_else(|| refuse("its node has no size, so that it points nowhere"))?;
        let is_named = placed.mesh.is_some() || placed.light.is_some();
        let name = if is_named { format!("{} luminaire", placed.name) } else { placed.name.clone() };
        luminaires.push(LightEntry {
            kind: LightEntryKind::Ies,
            name: Some(name),
            emission: Some(emission),
            position: Some(placed.world.w_axis.truncate().to_array()),
            luminaire: Some(Luminaire { photometry, world_from_luminaire }),
            ..LightEntry::default()
        });
    }
    Ok(luminaires)
}

/// What a URI holds: itself, or a file in the glTF file's folder or below.
fn from_uri(path: &Path, text: &str, folders: &Folders, refuse: &dyn Fn(&str) -> Error) -> Result<Vec<u8>> {
    let name = match uri(text).map_err(|problem| refuse(&format!("its light profile {problem}")))? {
        Uri::Data(bytes) => return Ok(bytes),
        Uri::File(name) => name,
    };
    let file = path.parent().unwrap_or(Path::new("")).join(&name);
    if !file.is_file() {
        return Err(refuse(&format!("its light profile is the file \"{}\", which is missing", plain(&name))));
    }
    folders.reach.admit(&file, &path.display().to_string())?;
    read_input(&file, "read the light profile", MAX_PHOTOMETRY_BYTES)
}

/// The node's axes without its scale, which are the luminaire's: its nadir is −z, and the plane of 0° holds +x.
fn axes(world: DMat4) -> Option<Mat3> {
    let linear = DMat3::from_mat4(world);
    let z = linear.z_axis.try_normalize()?;
    let x = linear.x_axis.reject_from_normalized(z).try_normalize()?;
    Some(DMat3::from_cols(x, z.cross(x), z).as_mat3())
}
