//! A scene under construction: geometry, materials and lights are added, and stay consistent with each other.

use glam::{Quat, Vec3};

use super::shapes;
use super::{
    AreaEmitter, AreaLayout, Emitter, EnvironmentEmitter, Material, MaterialId, Mesh, PointEmitter, SunPlaces, Surface,
    Texture, Triangle,
};
use crate::error::Result;
use crate::light::{EnvironmentMapping, Light, LightBasis, LightKind, LightUnit};

/// Parts of a scene so far.
#[derive(Debug, Default)]
pub(super) struct Assembly {
    pub(super) mesh: Mesh,
    pub(super) materials: Vec<Material>,
    pub(super) textures: Vec<Texture>,
    pub(super) emitters: Vec<Emitter>,
    /// See [`Scene::unseen_lights`](super::Scene::unseen_lights).
    pub(super) unseen_lights: Vec<u32>,
    pub(super) basis: LightBasis,
}

/// A rectangle that emits to one side, cut into texels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Panel {
    pub(super) origin: Vec3,
    pub(super) edge_u: Vec3,
    pub(super) edge_v: Vec3,
    pub(super) normal: Vec3,
    pub(super) texels: (u32, u32),
    pub(super) two_sided: bool,
}

impl Assembly {
    pub(super) fn material(&mut self, name: &str, surface: Surface) -> MaterialId {
        self.materials.push(Material::new(name, surface));
        MaterialId(self.materials.len() as u32 - 1)
    }

    /// Appends a mesh of one material.
    pub(super) fn add(&mut self, shape: shapes::TriangleList, material: MaterialId) {
        let first = self.mesh.vertices.len() as u32;
        self.mesh.vertices.extend(shape.vertices);
        self.mesh.triangles.extend(shape.triangles.into_iter().map(|vertices| Triangle {
            vertices: vertices.map(|v| v + first),
            material,
            emitter: None,
        }));
    }

    /// Appends a light with its emitter and marks the emitter's triangles.
    pub(super) fn light(&mut self, emitter: Emitter, light: Light) -> Result<()> {
        self.basis.push(light)?;
        let index = self.emitters.len() as u32;
        if let Emitter::Area(area) = &emitter {
            for &triangle in &area.triangles {
                self.mesh.triangles[triangle as usize].emitter = Some(index);
            }
        }
        self.emitters.push(emitter);
        Ok(())
    }

    /// Appends a rectangle and makes it a light of `across × down` columns, in units of radiance.
    pub(super) fn panel(&mut self, name: &str, panel: Panel, material: MaterialId, emission: [f32; 3]) -> Result<()> {
        let first = self.mesh.triangles.len() as u32;
        let front = panel.edge_u.cross(panel.edge_v).dot(panel.normal) > 0.0;
        let mut shape = shapes::rectangle(panel.origin, panel.edge_u, panel.edge_v);
        if !front {
            shape.turn_over();
        }
        self.add(shape, material);
        let emitter = AreaEmitter {
            triangles: vec![first, first + 1],
            layout: panel.layout(),
            two_sided: panel.two_sided,
            pattern: None,
        };
        self.light(Emitter::Area(emitter), panel.light(name, emission))
    }

    /// Appends a mesh and makes it a lamp of one column, in units of radiance. `place` is its centre.
    pub(super) fn lamp(
        &mut self,
        name: &str,
        shape: shapes::TriangleList,
        material: MaterialId,
        (place, emission): (Vec3, [f32; 3]),
    ) -> Result<()> {
        let first = self.mesh.triangles.len() as u32;
        self.add(shape, material);
        let triangles: Vec<u32> = (first..self.mesh.triangles.len() as u32).collect();
        let area = triangles.iter().map(|&index| {
            let [a, b, c] = self.mesh.corners(&self.mesh.triangles[index as usize]);
            0.5 * (b - a).cross(c - a).length()
        });
        let light = Light {
            name: name.into(),
            kind: LightKind::Lamp,
            unit: LightUnit::Radiance,
            emission,
            first_column: 0,
            places: vec![place.into()],
            extents: vec![area.sum()],
        };
        let emitter = AreaEmitter { triangles, layout: AreaLayout::Whole, two_sided: false, pattern: None };
        self.light(Emitter::Area(emitter), light)
    }

    /// Appends an environment of which every texel is a column, in units of radiance.
    pub(super) fn environment(
        &mut self,
        name: &str,
        mapping: EnvironmentMapping,
        rotation: Quat,
        is_split: bool,
        emission: [f32; 3],
    ) -> Result<()> {
        let copies = 1 + u32::from(is_split);
        let texels = (0..copies).flat_map(|_| 0..mapping.texel_count());
        let kind = match mapping {
            EnvironmentMapping::Patches(patches) => LightKind::Patches { subdivision: patches.subdivision(), is_split },
            _ => mapping.into(),
        };
        let light = Light {
            name: name.into(),
            kind,
            unit: LightUnit::Radiance,
            emission,
            first_column: 0,
            places: texels.clone().map(|t| (rotation * mapping.middle(t)).into()).collect(),
            extents: texels.map(|t| mapping.solid_angle(t)).collect(),
        };
        let world_from_environment = glam::Mat3::from_quat(rotation);
        self.light(Emitter::Environment(EnvironmentEmitter { mapping, world_from_environment, is_split }), light)
    }

    /// Appends places of the sun, each of which is a column, in units of irradiance.
    pub(super) fn suns(&mut self, name: &str, suns: SunPlaces, emission: [f32; 3]) -> Result<()> {
        let solid_angle = 4.0 * std::f32::consts::PI * (0.5 * suns.angular_radius_radians).sin().powi(2);
        let light = Light {
            name: name.into(),
            kind: LightKind::Suns { count: suns.towards.len() as u32 },
            unit: LightUnit::Irradiance,
            emission,
            first_column: 0,
            places: suns.towards.iter().map(|towards| towards.to_array()).collect(),
            extents: vec![solid_angle; suns.towards.len()],
        };
        self.light(Emitter::Suns(suns), light)
    }

    /// Appends a point-like light.
    pub(super) fn point(&mut self, name: &str, emitter: PointEmitter, emission: [f32; 3]) -> Result<()> {
        let (kind, unit, place, extent) = match &emitter {
            PointEmitter::Point { position } => (LightKind::Point, LightUnit::Intensity, *position, 0.0),
            PointEmitter::Spot { position, .. } => (LightKind::Spot, LightUnit::Intensity, *position, 0.0),
            PointEmitter::Ball { position, radius, cone } => {
                let kind = if cone.is_some() { LightKind::Spot } else { LightKind::Point };
                // The area of the disc that it shows.
                (kind, LightUnit::Intensity, *position, std::f32::consts::PI * radius * radius)
            }
            PointEmitter::Ies { position, .. } => (LightKind::Ies, LightUnit::Intensity, *position, 0.0),
            PointEmitter::Sun { towards, angular_radius_radians } => {
                // 2π (1 − cos r) as 4π sin²(r/2), which keeps its digits for the sun's quarter of a degree.
                let solid_angle = 4.0 * std::f32::consts::PI * (0.5 * angular_radius_radians).sin().powi(2);
                (LightKind::Sun, LightUnit::Irradiance, *towards, solid_angle)
            }
        };
        let light = Light {
            name: name.into(),
            kind,
            unit,
            emission,
            first_column: 0,
            places: vec![place.into()],
            extents: vec![extent],
        };
        self.light(Emitter::Point(emitter), light)
    }
}

impl Panel {
    pub(super) fn layout(&self) -> AreaLayout {
        let &Self { origin, edge_u, edge_v, normal, texels: (across, down), .. } = self;
        AreaLayout::Texels { origin, edge_u, edge_v, normal, across, down }
    }

    /// Its light, with the centre and the area of every texel.
    pub(super) fn light(&self, name: &str, emission: [f32; 3]) -> Light {
        let (across, down) = self.texels;
        let centre = |i: u32| {
            let (u, v) = ((i % across) as f32 + 0.5, (i / across) as f32 + 0.5);
            (self.origin + self.edge_u * (u / across as f32) + self.edge_v * (v / down as f32)).to_array()
        };
        let texels = across as usize * down as usize;
        let area = self.edge_u.cross(self.edge_v).length() / texels as f32;
        Light {
            name: name.into(),
            kind: LightKind::AreaTexels { across, down },
            unit: LightUnit::Radiance,
            emission,
            first_column: 0,
            places: (0..texels as u32).map(centre).collect(),
            extents: vec![area; texels],
        }
    }
}
