//! The `[[light]]` entries of a scene file: each becomes one or more lights of the basis.

use std::collections::HashMap;
use std::path::Path;

use glam::{DVec3, Mat3, Quat, Vec3};

use super::assembly::{Assembly, Panel};
use super::file::{LightEntry, LightEntryKind, Luminaire, MappingEntry, PatchesEntry, SideEntry};
use super::folders::Folders;
use super::memory::MemoryBound;
use super::names::UniqueNames;
use super::photometry::{self, MAX_PHOTOMETRY_BYTES, Photometry};
use super::rectangle::{self, Corner};
use super::resolve_materials::{Emission, colour};
use super::{AreaEmitter, AreaLayout, Emitter, PointEmitter, SpotCone, SunPlaces, Surface, Vertex, names, sun_places};
use crate::decimal::{list, of_f32, of_f64};
use crate::error::{Error, Result, Warnings};
use crate::files::read_input;
use crate::image::{LUMENS_PER_WATT, image_facts, read_image};
use crate::light::names::fits;
use crate::light::{EnvironmentMapping, Light, LightBasis, LightKind, LightUnit, SkyPatches};

/// Half angle under which the sun is seen from the earth, in degrees.
const SUN_RADIUS_DEGREES: f32 = 0.2665;

/// Memory of a column in the basis, with its weight in the scene's lighting, twice: as they are made, they are copied.
const COLUMN_BYTES: u64 = 64;

/// A scene under construction, with what its lights are chosen by.
pub(super) struct LightBuilder<'a> {
    pub(super) assembly: &'a mut Assembly,
    /// Emission of each material.
    pub(super) emissions: &'a [Option<Emission>],
    pub(super) objects: &'a [String],
    /// Index into `objects` for every triangle.
    pub(super) object_of: &'a [u32],
    pub(super) folders: &'a Folders,
    /// Origin that positions in the scene are relative to.
    pub(super) origin: DVec3,
    /// Weights that differ from their light's emission: first column, weights.
    pub(super) weights: Vec<(u32, Vec<[f32; 3]>)>,
    /// What is left for environment maps and photometric files while they are read.
    pub(super) memory: MemoryBound,
    pub(super) warnings: Warnings,
}

/// Triangles that become one light.
struct LightGroup {
    name: String,
    emission: Emission,
    triangles: Vec<u32>,
}

impl LightBuilder<'_> {
    /// Adds the lights of one entry; `place` names it in messages.
    pub(super) fn add(&mut self, entry: &LightEntry, place: &str) -> Result<()> {
        entry.check_keys(place)?;
        if let Some(emission) = entry.emission {
            colour(emission, "emission", f32::MAX, place)?;
        }
        let before = self.assembly.emitters.len() as u32;
        self.add_kind(entry, place)?;
        match (entry.camera, entry.kind) {
            (Some(true), LightEntryKind::Point | LightEntryKind::Spot | LightEntryKind::Ies) => {
                let problem = "points, spots and luminaires are not seen by the camera, whatever radius they have";
                Err(Error::input(place, problem, "leave 'camera' out"))
            }
            (Some(false), _) => {
                self.assembly.unseen_lights.extend(before..self.assembly.emitters.len() as u32);
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn add_kind(&mut self, entry: &LightEntry, place: &str) -> Result<()> {
        match entry.kind {
            LightEntryKind::Surface => self.surfaces(entry, place),
            LightEntryKind::Panel => self.panel(entry, place),
            LightEntryKind::Environment => self.environment(entry, place),
            LightEntryKind::Suns => self.suns(entry, place),
            LightEntryKind::Point => self.point(entry, place),
            LightEntryKind::Spot => self.spot(entry, place),
            LightEntryKind::Sun => self.sun(entry, place),
            LightEntryKind::Ies => self.luminaire(entry, place),
        }
    }

    /// Makes a light of each object's surfaces of each emissive material, named after the object, and after the material too
    /// where an object has several. `two_sided` says which materials emit from their backs too.
    pub(super) fn instances(&mut self, two_sided: &[bool], place: &str) -> Result<()> {
        let mut groups: Vec<((u32, u32), Vec<u32>)> = Vec::new();
        let mut group_of: HashMap<(u32, u32), usize> = HashMap::new();
        let mut lit_materials: HashMap<u32, usize> = HashMap::new();
        for (index, triangle) in self.assembly.mesh.triangles.iter().enumerate() {
            let key = (self.object_of[index], triangle.material.0);
            if self.emissions[key.1 as usize].is_none() {
                continue;
            }
            let slot = *group_of.entry(key).or_insert_with(|| {
                *lit_materials.entry(key.0).or_default() += 1;
                groups.push((key, Vec::new()));
                groups.len() - 1
            });
            groups[slot].1.push(index as u32);
        }
        self.admit_columns(groups.len() as u64, place)?;
        // Materials may have the same name, or the one of an object.
        let lights = self.assembly.basis.lights().iter().map(|light| &light.name);
        let mut names = UniqueNames::beside(self.objects.iter().chain(lights).cloned());
        for ((object, material), triangles) in groups {
            let Some(emission) = self.emissions[material as usize] else { continue };
            let mut name = self.objects[object as usize].clone();
            if lit_materials[&object] > 1 {
                name = format!("{name} {}", self.assembly.materials[material as usize].name);
                name = names.unique(name);
            }
            let side = if two_sided[material as usize] { SideEntry::Both } else { SideEntry::Front };
            self.surface(name, emission, triangles, None, side, place)?;
        }
        Ok(())
    }

    /// Refuses columns that a matrix cannot have or that do not fit the memory.
    fn admit_columns(&mut self, more: u64, place: &str) -> Result<()> {
        check_columns(&self.assembly.basis, more, place)?;
        self.memory.take(more * COLUMN_BYTES, Path::new(place))
    }

    fn surfaces(&mut self, entry: &LightEntry, place: &str) -> Result<()> {
        let (across, down) = texels(entry.texels.unwrap_or([1, 1]), place)?;
        let groups = self.groups(entry, place)?;
        if groups.len() > 1 && entry.name.is_some() {
            let problem = format!("the name is for one light, but {} are chosen", groups.len());
            let hint = "leave the name out, choose one, or say join = true";
            return Err(Error::input(place, problem, hint));
        }
        let texels = u64::from(across) * u64::from(down);
        self.admit_columns(texels.saturating_mul(groups.len() as u64), place)?;
        for group in groups {
            let name = entry.name.clone().unwrap_or(group.name);
            let mut emission = group.emission;
            emission.radiance = entry.emission.map_or(emission.radiance, Vec3::from);
            let side = entry.side.unwrap_or_default();
            self.surface(name, emission, group.triangles, entry.texels.map(|_| (across, down)), side, place)?;
        }
        Ok(())
    }

    /// The triangles that an entry chooses, one group for each material, each object, or all joined.
    fn groups(&self, entry: &LightEntry, place: &str) -> Result<Vec<LightGroup>> {
        let fits = |pattern: &Option<String>, name: &str| pattern.as_ref().is_none_or(|p| fits(p, name));
        let mut groups: Vec<LightGroup> = Vec::new();
        let mut group_of: HashMap<u32, usize> = HashMap::new();
        let (mut named, mut dark) = (0, None);
        for (index, triangle) in self.assembly.mesh.triangles.iter().enumerate() {
            let material = triangle.material.0;
            let object = self.object_of.get(index).copied().unwrap_or(u32::MAX);
            let material_name = &self.assembly.materials[material as usize].name;
            let object_name = self.objects.get(object as usize).map_or("", String::as_str);
            if !fits(&entry.material, material_name) || !fits(&entry.object, object_name) {
                continue;
            }
            named += 1;
            if triangle.emitter.is_some() {
                continue;
            }
            let stated = self.emissions.get(material as usize).copied().flatten();
            let own = entry.emission.map(|e| Emission { radiance: e.into(), pattern: None });
            let Some(emission) = stated.or(own) else {
                dark = Some(material_name);
                continue;
            };
            let by_object = entry.object.is_some() && entry.material.is_none();
            let (key, name) = match entry.join.unwrap_or(false) {
                true => (0, material_name),
                false if by_object => (object, &self.objects[object as usize]),
                false => (material, material_name),
            };
            let slot = *group_of.entry(key).or_insert(groups.len());
            match groups.get_mut(slot) {
                Some(group) => {
                    if group.emission != emission && entry.emission.is_none() {
                        let problem = format!("'{}' joins surfaces of different emission", group.name);
                        return Err(Error::input(place, problem, "state an emission for all of them, or do not join"));
                    }
                    if group.emission.pattern != emission.pattern {
                        // The stated emission is that of all.
                        group.emission.pattern = None;
                    }
                    group.triangles.push(index as u32);
                }
                None => groups.push(LightGroup { name: name.clone(), emission, triangles: vec![index as u32] }),
            }
        }
        if !groups.is_empty() {
            return Ok(groups);
        }
        let wanted = entry.material.as_deref().or(entry.object.as_deref()).unwrap_or("*");
        Err(match dark {
            Some(name) => {
                let hint = "state an emission here, or a Ke in the material file";
                Error::input(place, format!("the material '{name}' does not emit"), hint)
            }
            None if named > 0 => {
                let problem = format!("all that fits \"{wanted}\" belongs to earlier lights");
                Error::input(place, problem, "take this entry out or choose other surfaces")
            }
            None => {
                let materials = self.assembly.materials.iter().map(|m| m.name.as_str());
                let known = materials.chain(self.objects.iter().map(String::as_str));
                let hint = match names::nearest(wanted, known) {
                    Some(name) => format!("did you mean '{name}'?"),
                    None => "look up the names in the OBJ and MTL files".into(),
                };
                Error::input(place, format!("no surface fits \"{wanted}\""), hint)
            }
        })
    }

    fn surface(
        &mut self,
        name: String,
        emission: Emission,
        triangles: Vec<u32>,
        texels: Option<(u32, u32)>,
        side: SideEntry,
        place: &str,
    ) -> Result<()> {
        if side == SideEntry::Back {
            triangles.iter().for_each(|&index| self.assembly.mesh.turn_over(index));
        }
        let two_sided = side == SideEntry::Both;
        let mesh = &self.assembly.mesh;
        let corner = |vertex: &Vertex| Corner { position: vertex.position, uv: vertex.uv };
        let corners = |&index: &u32| mesh.vertices_of(&mesh.triangles[index as usize]).map(corner);
        let all: Vec<_> = triangles.iter().map(corners).collect();
        let radiance = emission.radiance.to_array();
        let (light, layout) = match texels {
            Some(texels) => {
                let cutout = |&index: &u32| {
                    let material = self.assembly.mesh.triangles[index as usize].material;
                    self.assembly.materials[material.0 as usize].cutout
                };
                if triangles.iter().any(|index| cutout(index) != cutout(&triangles[0])) {
                    let problem = format!("'{name}' cannot be cut into texels: different maps cut out its faces");
                    return Err(Error::input(place, problem, "choose faces of one material"));
                }
                let found = rectangle::find(&all).map_err(|reason| {
                    let problem = format!("'{name}' cannot be cut into texels: {reason}");
                    let hint = "choose a flat rectangle, or put a light of kind \"panel\" in its place";
                    Error::input(place, problem, hint)
                })?;
                let rectangle::Rectangle { origin, edge_u, edge_v, normal } = found;
                let panel = Panel { origin, edge_u, edge_v, normal, texels, two_sided };
                (panel.light(&name, radiance), panel.layout())
            }
            None => (lamp(&name, &all, radiance, place)?, AreaLayout::Whole),
        };
        let emitter = AreaEmitter { triangles, layout, two_sided, pattern: emission.pattern };
        self.assembly.light(Emitter::Area(emitter), light)
    }

    fn panel(&mut self, entry: &LightEntry, place: &str) -> Result<()> {
        let name = entry.name.clone().unwrap_or_else(|| "panel".into());
        let origin = local(entry.origin, self.origin, "origin", place)?;
        let edge_u = direction(required(entry.edge_u, "edge_u", place)?, "edge_u", place)?;
        let edge_v = direction(required(entry.edge_v, "edge_v", place)?, "edge_v", place)?;
        let cosine = edge_u.normalize().dot(edge_v.normalize());
        if cosine.abs() > 1e-3 {
            let problem = "edge_u and edge_v are not perpendicular";
            return Err(Error::input(place, problem, "a panel is a rectangle; give perpendicular edges"));
        }
        let mut normal = edge_u.cross(edge_v).normalize_or_zero();
        if let Some(faces) = entry.faces {
            let faces = direction(faces, "faces", place)?.normalize();
            if faces.dot(normal).abs() < 1e-3 {
                return Err(Error::input(place, "'faces' lies in the panel's plane", "let it point to the lit side"));
            }
            normal *= faces.dot(normal).signum();
        }
        if entry.side == Some(SideEntry::Back) {
            normal = -normal;
        }
        let texels = texels(entry.texels.unwrap_or([32, 32]), place)?;
        self.admit_columns(u64::from(texels.0) * u64::from(texels.1), place)?;
        let two_sided = entry.side == Some(SideEntry::Both);
        let panel = Panel { origin, edge_u, edge_v, normal, texels, two_sided };
        let material = self.assembly.material(&name, Surface::Black);
        self.assembly.panel(&name, panel, material, entry.emission.unwrap_or([1.0; 3]))
    }

    fn environment(&mut self, entry: &LightEntry, place: &str) -> Result<()> {
        if self.assembly.emitters.iter().any(|e| matches!(e, Emitter::Environment(_))) {
            return Err(Error::input(place, "there is an environment already", "a scene has one at most"));
        }
        let name = entry.name.clone().unwrap_or_else(|| "environment".into());
        let is_split = entry.split.unwrap_or(false);
        let (across, down) = texels(entry.texels.unwrap_or([32, 16]), place)?;
        let mapping = match entry.mapping.unwrap_or_default() {
            _ if entry.patches.is_some() && (entry.mapping.is_some() || entry.texels.is_some()) => {
                let problem = "has patches beside a mapping or texels";
                return Err(Error::input(place, problem, "give patches and subdivision, or mapping and texels"));
            }
            _ if entry.patches.is_some() => EnvironmentMapping::Patches(patches(entry, place)?),
            _ if is_split || entry.subdivision.is_some() => {
                let key = if is_split { "split" } else { "subdivision" };
                let hint = "say patches = \"reinhart\", or leave it out";
                return Err(Error::input(place, format!("only a sky of patches has '{key}'"), hint));
            }
            MappingEntry::LatLong => EnvironmentMapping::LatLong { across, down },
            MappingEntry::Octahedral if across == down => EnvironmentMapping::Octahedral { side: across },
            MappingEntry::Octahedral => {
                let hint = "give the same number twice, or mapping = \"lat_long\"";
                return Err(Error::input(place, "an octahedral environment is a square of texels", hint));
            }
        };
        self.admit_columns(u64::from(mapping.texel_count()) * (1 + u64::from(is_split)), place)?;
        let turn = finite(entry.turn_degrees.unwrap_or(0.0), "turn_degrees", place)?.to_radians();
        let emission = entry.emission.unwrap_or([1.0; 3]);
        let rotation = entry.cube.as_ref().map_or_else(|| Quat::from_rotation_y(turn), |cube| cube.rotation);
        self.assembly.environment(&name, mapping, rotation, is_split, emission)?;
        let scale = |[r, g, b]: [f32; 3]| [r * emission[0], g * emission[1], b * emission[2]];
        let first = self.assembly.basis.lights().last().map_or(0, |light| light.first_column);
        if let Some(cube) = &entry.cube {
            self.weights.push((first, cube.weights(mapping).into_iter().map(scale).collect()));
        }
        if let Some(map) = &entry.map {
            let path = self.folders.find(map, place)?;
            let facts = image_facts(&path)?;
            self.memory.check(facts.needs_bytes, &path)?;
            self.warnings.extend(facts.notes.iter().map(|note| format!("{}: {note}", path.display())));
            let image = read_image(&path)?;
            let mut weights: Vec<_> =
                mapping.resample((image.width, image.height), &image.pixels, 0.0).into_iter().map(scale).collect();
            if is_split {
                weights.extend_from_within(..);
            }
            self.weights.push((first, weights));
        }
        Ok(())
    }

    /// Reads the photometric file of an entry.
    fn photometry(&mut self, entry: &LightEntry, place: &str) -> Result<Photometry> {
        let file = entry.file.as_ref().ok_or_else(|| missing("file", place))?;
        let path = self.folders.find(file, place)?;
        let bytes = read_input(&path, "read the photometric file", MAX_PHOTOMETRY_BYTES)?;
        let photometry = photometry::parse(&path, &bytes)?;
        for remark in &photometry.remarks {
            if self.warnings.iter().all(|warning| warning.text != *remark) {
                self.warnings.push(remark.as_str());
            }
        }
        Ok(photometry)
    }

    fn point(&mut self, entry: &LightEntry, place: &str) -> Result<()> {
        let position = self.position(entry, place)?;
        let emitter = match ball_radius(entry, place)? {
            radius if radius > 0.0 => PointEmitter::Ball { position, radius, cone: None },
            _ => PointEmitter::Point { position },
        };
        self.point_like("point", emitter, [1.0; 3], entry, place)
    }

    fn spot(&mut self, entry: &LightEntry, place: &str) -> Result<()> {
        let outer = finite(entry.outer_degrees.unwrap_or(30.0), "outer_degrees", place)?;
        let inner = finite(entry.inner_degrees.unwrap_or(0.8 * outer), "inner_degrees", place)?;
        if !(0.0 <= inner && inner <= outer && 0.0 < outer && outer <= 180.0) {
            let problem = format!("inner_degrees {inner} and outer_degrees {outer} are no cones");
            return Err(Error::input(place, problem, "they must obey 0 ≤ inner ≤ outer ≤ 180"));
        }
        let (inner_radians, outer_radians) = (inner.to_radians(), outer.to_radians());
        let (direction, position) = (axis(entry, place)?, self.position(entry, place)?);
        let emitter = match ball_radius(entry, place)? {
            radius if radius > 0.0 => {
                let cone = Some(SpotCone { direction, inner_radians, outer_radians });
                PointEmitter::Ball { position, radius, cone }
            }
            _ => PointEmitter::Spot { position, direction, inner_radians, outer_radians },
        };
        self.point_like("spot", emitter, [1.0; 3], entry, place)
    }

    fn sun(&mut self, entry: &LightEntry, place: &str) -> Result<()> {
        let towards = direction(required(entry.towards, "towards", place)?, "towards", place)?.normalize();
        let degrees = entry.angular_radius_degrees.unwrap_or(SUN_RADIUS_DEGREES);
        if !(0.0..=90.0).contains(&degrees) {
            let problem = format!("angular_radius_degrees {degrees}");
            return Err(Error::input(place, problem, "give 0 to 90; the sun has 0.2665"));
        }
        let emitter = PointEmitter::Sun { towards, angular_radius_radians: degrees.to_radians() };
        self.point_like("sun", emitter, [1.0; 3], entry, place)
    }

    /// Places of the sun: the middles of a sky's patches, or those that it takes over a year at a latitude.
    fn suns(&mut self, entry: &LightEntry, place: &str) -> Result<()> {
        let degrees = entry.angular_radius_degrees.unwrap_or(SUN_RADIUS_DEGREES);
        if !(0.0..=2.0).contains(&degrees) {
            let problem = format!("angular_radius_degrees {degrees}");
            return Err(Error::input(place, problem, "give 0 to 2; the sun has 0.2665, parallel light 0"));
        }
        let towards = match (entry.latitude_degrees, entry.patches) {
            (Some(latitude), None) if entry.subdivision.is_none() => {
                let step = entry.step_degrees.unwrap_or(2.0);
                if !((-90.0..=90.0).contains(&latitude) && (0.1..=15.0).contains(&step)) {
                    let problem = format!("latitude_degrees {latitude}, step_degrees {step}");
                    return Err(Error::input(place, problem, "give −90 to 90, and a step of 0.1 to 15"));
                }
                sun_places::at_latitude(latitude.to_radians(), step.to_radians())
            }
            (None, Some(_)) if entry.step_degrees.is_none() => sun_places::of_patches(patches(entry, place)?),
            _ => {
                let hint = "give latitude_degrees (and step_degrees), or patches (and subdivision)";
                return Err(Error::input(place, "says not where the sun stands, or twice", hint));
            }
        };
        self.admit_columns(towards.len() as u64, place)?;
        let turn = finite(entry.turn_degrees.unwrap_or(0.0), "turn_degrees", place)?.to_radians();
        let towards = towards.into_iter().map(|towards| Quat::from_rotation_y(turn) * towards).collect();
        let suns = SunPlaces { towards, angular_radius_radians: degrees.to_radians() };
        self.assembly.suns(entry.name.as_deref().unwrap_or("suns"), suns, entry.emission.unwrap_or([0.0; 3]))
    }

    fn luminaire(&mut self, entry: &LightEntry, place: &str) -> Result<()> {
        let Luminaire { photometry, world_from_luminaire } = match &entry.luminaire {
            Some(luminaire) => luminaire.clone(),
            None => {
                let turn = finite(entry.turn_degrees.unwrap_or(0.0), "turn_degrees", place)?.to_radians();
                let photometry = self.photometry(entry, place)?;
                Luminaire { photometry, world_from_luminaire: hung(axis(entry, place)?, turn) }
            }
        };
        // Read, kept with the emitter, and in the tracer's own form.
        self.memory.take(3 * size_of_val(&*photometry.profile.intensity) as u64, Path::new(place))?;
        let own = [photometry.peak_candela / LUMENS_PER_WATT; 3];
        let (position, profile) = (self.position(entry, place)?, photometry.profile);
        self.point_like("ies", PointEmitter::Ies { position, world_from_luminaire, profile }, own, entry, place)
    }

    fn position(&self, entry: &LightEntry, place: &str) -> Result<Vec3> {
        local(entry.position, self.origin, "position", place)
    }

    /// Adds a light of one column, of the entry's emission or its `own`, under the entry's name or that of its kind.
    fn point_like(
        &mut self,
        kind: &str,
        emitter: PointEmitter,
        own: [f32; 3],
        entry: &LightEntry,
        place: &str,
    ) -> Result<()> {
        self.admit_columns(1, place)?;
        self.assembly.point(entry.name.as_deref().unwrap_or(kind), emitter, entry.emission.unwrap_or(own))
    }
}

/// The patches of a sky.
fn patches(entry: &LightEntry, place: &str) -> Result<SkyPatches> {
    let subdivision = match (entry.patches, entry.subdivision) {
        (Some(PatchesEntry::Tregenza), Some(subdivision)) if subdivision != 1 => {
            let problem = format!("Tregenza's patches have no subdivision of {subdivision}");
            return Err(Error::input(place, problem, "say patches = \"reinhart\""));
        }
        (Some(PatchesEntry::Tregenza), _) => 1,
        (_, subdivision) => subdivision.unwrap_or(4),
    };
    SkyPatches::of_subdivision(subdivision).ok_or_else(|| {
        let hint = format!("give 1 to {}; 4 has 2,306 patches", SkyPatches::MAX_SUBDIVISION);
        Error::input(place, format!("subdivision {subdivision}"), hint)
    })
}

/// Radius of a point or a spot; 0 where none is stated.
fn ball_radius(entry: &LightEntry, place: &str) -> Result<f32> {
    let radius = finite(entry.radius.unwrap_or(0.0), "radius", place)?;
    if radius < 0.0 {
        return Err(Error::input(
            place,
            format!("radius {radius}"),
            "give a length of at least 0, in the unit of the geometry",
        ));
    }
    Ok(radius)
}

/// Where a light points, down if it does not say.
fn axis(entry: &LightEntry, place: &str) -> Result<Vec3> {
    Ok(direction(entry.direction.unwrap_or([0.0, -1.0, 0.0]), "direction", place)?.normalize())
}

/// Axes of a luminaire whose nadir points along `down`, turned about it. x is as near to the world's +x as possible (to
/// +z if the luminaire points along x).
fn hung(down: Vec3, turn_radians: f32) -> Mat3 {
    let reference = if down.x.abs() < 0.999 { Vec3::X } else { Vec3::Z };
    let z = -down;
    let x = Quat::from_axis_angle(z, turn_radians) * reference.reject_from(z).normalize();
    Mat3::from_cols(x, z.cross(x), z)
}

/// The light of an emitter in one piece: its centre and area.
fn lamp(name: &str, triangles: &[[Corner; 3]], radiance: [f32; 3], place: &str) -> Result<Light> {
    let (mut area, mut moment) = (0.0f64, DVec3::ZERO);
    for [a, b, c] in triangles {
        let part = 0.5 * f64::from((b.position - a.position).cross(c.position - a.position).length());
        area += part;
        moment += part * (a.position + b.position + c.position).as_dvec3() / 3.0;
    }
    if area.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
        return Err(Error::input(place, format!("the light '{name}' has no area"), "choose surfaces of some size"));
    }
    Ok(Light {
        name: name.into(),
        kind: LightKind::Lamp,
        unit: LightUnit::Radiance,
        emission: radiance,
        first_column: 0,
        places: vec![(moment / area).as_vec3().into()],
        extents: vec![area as f32],
    })
}

/// Errors: more columns than a matrix can have, saying what they would need.
fn check_columns(basis: &LightBasis, more: u64, place: &str) -> Result<()> {
    let columns = (basis.column_count() as u64).saturating_add(more);
    if columns <= u64::from(LightBasis::MAX_COLUMNS) {
        return Ok(());
    }
    // One row of three channels in f32 for every pixel of a small image, to give an idea.
    let tebibytes = columns as f64 * 640.0 * 480.0 * 3.0 * 4.0 / (1u64 << 40) as f64;
    Err(Error::Resources {
        what: place.into(),
        needed: format!("{columns} columns ({tebibytes:.0} TiB for an image of 640 × 480)"),
        available: format!("a matrix has at most {} columns", LightBasis::MAX_COLUMNS),
        hint: "give fewer texels".into(),
    })
}

fn texels([across, down]: [u32; 2], place: &str) -> Result<(u32, u32)> {
    match across > 0 && down > 0 {
        true => Ok((across, down)),
        false => Err(Error::input(place, format!("texels [{across}, {down}]"), "give at least one each way")),
    }
}

fn missing(key: &str, place: &str) -> Error {
    Error::input(place, format!("the key '{key}' is missing"), "formats/scene.md lists the keys of each kind of light")
}

fn required<T>(value: Option<T>, key: &str, place: &str) -> Result<T> {
    value.ok_or_else(|| missing(key, place))
}

fn finite(value: f32, key: &str, place: &str) -> Result<f32> {
    match value.is_finite() {
        true => Ok(value),
        false => Err(Error::input(place, format!("{key} is not finite"), "give a finite number")),
    }
}

/// A place of the file's coordinates, counted from the scene's origin.
fn local(value: Option<[f64; 3]>, origin: DVec3, key: &str, place: &str) -> Result<Vec3> {
    let whole = required(value, key, place)?;
    let local = (DVec3::from(whole) - origin).as_vec3();
    match local.is_finite() {
        true => Ok(local),
        false => {
            Err(Error::input(place, format!("{key} {} is not finite", list(whole, of_f64)), "give finite numbers"))
        }
    }
}

fn point(values: [f32; 3], key: &str, place: &str) -> Result<Vec3> {
    let point = Vec3::from(values);
    match point.is_finite() {
        true => Ok(point),
        false => {
            Err(Error::input(place, format!("{key} {} is not finite", list(values, of_f32)), "give finite numbers"))
        }
    }
}

fn direction(values: [f32; 3], key: &str, place: &str) -> Result<Vec3> {
    let direction = point(values, key, place)?;
    match direction.try_normalize() {
        Some(_) => Ok(direction),
        None => Err(Error::input(place, format!("{key} has no length"), "give a vector that is not zero")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn luminaires_hang_with_their_nadir_along_the_direction() {
        for down in [Vec3::NEG_Y, Vec3::X, Vec3::new(0.3, -0.8, 0.2).normalize()] {
            for turn in [0.0, 0.4, 3.0] {
                let axes = hung(down, turn);
                assert!((axes * Vec3::NEG_Z - down).length() < 1e-5);
                assert!((axes.determinant() - 1.0).abs() < 1e-5);
            }
        }
        assert!((hung(Vec3::NEG_Y, 0.0) * Vec3::X - Vec3::X).length() < 1e-6);
    }
}
