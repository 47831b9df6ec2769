//! What decides the entries of `T`, as bytes that never change with names in the code: a scene's identity.

use glam::{Mat3, Vec2, Vec3};
use sha2::{Digest, Sha256};

use super::emitter::{AreaEmitter, AreaLayout, EnvironmentEmitter, IesProfile};
use super::{
    Camera, Emitter, FloatTexture, Lens, Material, Paint, PixelFilter, Placing, PointEmitter, PrincipledSurface,
    Projection, Relief, Scene, Sensor, SpotCone, SunPlaces, Surface, Texels, TextureId,
};
use crate::light::EnvironmentMapping;

/// Version of these bytes: to be raised with every change of them.
const VERSION: &[u8] = b"ltm scene 3";

/// Added to the kind of a part that has more than older versions knew, which then follows.
const BEYOND_PLAIN: u64 = 16;

/// SHA-256 over everything that decides the entries of `T` apart from the samples: geometry, materials, textures,
/// camera, emitters, path depth. Names do not count.
///
/// Every variant has a number and every field its bytes. Structs are taken apart by name, so that a field that is added must be
/// named here.
pub fn content_hash(scene: &Scene, max_depth: u32) -> [u8; 32] {
    let mut parts = Parts(Sha256::new());
    parts.bytes(VERSION);
    let Scene {
        name: _,
        origin: _,
        mesh,
        materials,
        textures,
        camera,
        sensors,
        shows_irradiance,
        emitters,
        unseen_lights,
        basis: _,
        metres_per_unit: _,
    } = scene;
    parts.bytes(bytemuck::cast_slice(&mesh.vertices.iter().map(|v| v.position).collect::<Vec<_>>()));
    parts.bytes(bytemuck::cast_slice(&mesh.vertices.iter().map(|v| v.normal).collect::<Vec<_>>()));
    parts.bytes(bytemuck::cast_slice(&mesh.vertices.iter().map(|v| v.uv).collect::<Vec<_>>()));
    let triangles: Vec<[u32; 5]> = mesh
        .triangles
        .iter()
        .map(|t| [t.vertices[0], t.vertices[1], t.vertices[2], t.material.0, t.emitter.map_or(u32::MAX, |e| e)])
        .collect();
    parts.bytes(bytemuck::cast_slice(&triangles));
    parts.whole(materials.len() as u64);
    materials.iter().for_each(|material| parts.material(material));
    parts.whole(textures.len() as u64);
    for texture in textures {
        parts.whole(texture.width.into());
        parts.whole(texture.height.into());
        let Placing { scale, offset, is_clamped } = texture.placing;
        let is_plain = texture.placing == Placing::PLAIN;
        let beyond = if is_plain { 0 } else { BEYOND_PLAIN };
        match &texture.texels {
            Texels::Colours8(texels) => parts.kind(beyond, bytemuck::cast_slice(texels)),
            Texels::Numbers8(texels) => parts.kind(beyond + 1, bytemuck::cast_slice(texels)),
            Texels::Floats(texels) => parts.kind(beyond + 2, bytemuck::cast_slice(texels)),
        }
        if !is_plain {
            [scale.x, scale.y, offset.x, offset.y].into_iter().for_each(|number| parts.number(number));
            parts.whole(is_clamped.into());
        }
    }
    parts.camera(camera);
    parts.whole(emitters.len() as u64);
    emitters.iter().for_each(|emitter| parts.emitter(emitter));
    if *shows_irradiance {
        parts.whole(u64::MAX - 2);
    }
    if let Some(sensors) = sensors {
        parts.whole(u64::MAX - 1);
        for Sensor { position, normal } in sensors.points() {
            [position, normal].into_iter().for_each(|vector| parts.vector(*vector));
        }
    }
    if !unseen_lights.is_empty() {
        // No depth is as large, so that it tells the two apart.
        parts.whole(u64::MAX);
        parts.bytes(bytemuck::cast_slice(unseen_lights));
    }
    parts.whole(max_depth.into());
    parts.0.finalize().into()
}

/// The hash of the parts so far.
struct Parts(Sha256);

impl Parts {
    fn bytes(&mut self, bytes: &[u8]) {
        self.whole(bytes.len() as u64);
        self.0.update(bytes);
    }

    fn kind(&mut self, kind: u64, bytes: &[u8]) {
        self.whole(kind);
        self.bytes(bytes);
    }

    fn whole(&mut self, number: u64) {
        self.0.update(number.to_le_bytes());
    }

    /// Its bits: 0 and −0 differ, which costs a hash and loses nothing.
    fn number(&mut self, number: f32) {
        self.0.update(number.to_bits().to_le_bytes());
    }

    fn vector(&mut self, vector: Vec3) {
        vector.to_array().into_iter().for_each(|v| self.number(v));
    }

    fn matrix(&mut self, matrix: &Mat3) {
        matrix.to_cols_array().into_iter().for_each(|v| self.number(v));
    }

    fn texture(&mut self, texture: Option<TextureId>) {
        self.whole(texture.map_or(u64::MAX, |id| id.0.into()));
    }

    fn paint(&mut self, paint: &Paint) {
        let (texture, factor) = match *paint {
            Paint::Constant(colour) => (None, colour),
            Paint::Textured(texture, factor) => (Some(texture), factor),
        };
        self.texture(texture);
        self.vector(factor);
    }

    fn number_or_texture(&mut self, value: &FloatTexture) {
        let (texture, channel, number) = match *value {
            FloatTexture::Constant(number) => (None, 0, number),
            FloatTexture::Textured(texture, channel, factor) => (Some(texture), channel, factor),
        };
        self.texture(texture);
        self.whole(channel.into());
        self.number(number);
    }

    fn principled(&mut self, surface: &PrincipledSurface) {
        let PrincipledSurface {
            base,
            metallic,
            roughness,
            specular,
            transmission,
            ior,
            is_thin,
            translucency,
            translucent,
            coat,
            sheen,
        } = surface;
        [base, translucent].into_iter().for_each(|paint| self.paint(paint));
        [metallic, roughness, transmission, translucency].into_iter().for_each(|value| self.number_or_texture(value));
        let (specular_map, specular) = match *specular {
            Paint::Constant(colour) => (None, colour),
            Paint::Textured(map, factor) => (Some(map), factor),
        };
        [specular, sheen.0].into_iter().for_each(|colour| self.vector(colour));
        [*ior, coat.0, coat.1, sheen.1].into_iter().for_each(|number| self.number(number));
        self.whole(u64::from(*is_thin) + if specular_map.is_none() { 0 } else { BEYOND_PLAIN });
        specular_map.iter().for_each(|map| self.texture(Some(*map)));
    }

    fn material(&mut self, material: &Material) {
        let Material { name: _, surface, cutout, opacity, opacity_map, absorption, relief } = material;
        match surface {
            Surface::Lambert { reflectance } => {
                self.whole(0);
                self.paint(reflectance);
            }
            Surface::Mirror { reflectance } => {
                self.whole(1);
                self.paint(reflectance);
            }
            Surface::RoughConductor { specular, alpha } => {
                self.whole(2);
                self.paint(specular);
                self.number(*alpha);
            }
            Surface::Dielectric { ior, transmittance } => {
                self.whole(3);
                self.number(*ior);
                self.vector(*transmittance);
            }
            Surface::ThinDielectric { ior, transmittance } => {
                self.whole(4);
                self.number(*ior);
                self.vector(*transmittance);
            }
            Surface::Coated { reflectance, specular, alpha } => {
                self.whole(5);
                self.paint(reflectance);
                self.vector(*specular);
                self.number(*alpha);
            }
            Surface::Black => self.whole(6),
            Surface::Principled(surface) => {
                self.whole(7);
                self.principled(surface);
            }
        }
        self.texture(*cutout);
        self.number(*opacity);
        self.texture(*opacity_map);
        self.vector(*absorption);
        let (kind, texture, factor) = match *relief {
            None => (0, None, 0.0),
            Some(Relief::Normals(texture, factor)) => (1, Some(texture), factor),
            Some(Relief::Heights(texture, factor)) => (2, Some(texture), factor),
        };
        self.whole(kind);
        self.texture(texture);
        self.number(factor);
    }

    fn camera(&mut self, camera: &Camera) {
        let Camera { eye, forward, right, up, projection, shift, pixel_aspect, lens, width, height, filter } = camera;
        [eye, forward, right, up].into_iter().for_each(|vector| self.vector(*vector));
        let (projection, extent) = match *projection {
            Projection::Perspective { vertical_fov_radians } => (0, vertical_fov_radians),
            Projection::Orthographic { height } => (1, height),
            Projection::Panorama => (2, 0.0),
        };
        self.number(extent);
        self.whole((*width).into());
        self.whole((*height).into());
        let (kind, size) = match filter {
            PixelFilter::Box => (0, 0.0),
            PixelFilter::Tent { radius } => (1, *radius),
            PixelFilter::Gaussian { deviation } => (2, *deviation),
        };
        // Cameras of older versions had no more than that, and keep their bytes; what others have follows a kind of its own.
        let is_plain = projection == 0 && *shift == Vec2::ZERO && *pixel_aspect == 1.0 && lens.is_none();
        self.whole(kind + if is_plain { 0 } else { BEYOND_PLAIN });
        self.number(size);
        if is_plain {
            return;
        }
        self.whole(projection);
        [shift.x, shift.y, *pixel_aspect].into_iter().for_each(|number| self.number(number));
        self.whole(lens.is_some().into());
        if let Some(Lens { radius, focus_distance, blades, rotation_radians }) = *lens {
            [radius, focus_distance, rotation_radians].into_iter().for_each(|number| self.number(number));
            self.whole(blades.into());
        }
    }

    fn emitter(&mut self, emitter: &Emitter) {
        match emitter {
            Emitter::Area(AreaEmitter { triangles, layout, two_sided, pattern }) => {
                self.whole(0);
                self.bytes(bytemuck::cast_slice(triangles));
                self.layout(layout);
                self.whole((*two_sided).into());
                self.whole(pattern.is_some().into());
                pattern.iter().for_each(|pattern| self.paint(pattern));
            }
            Emitter::Point(point) => {
                self.whole(1);
                self.point(point);
            }
            Emitter::Environment(EnvironmentEmitter { mapping, world_from_environment, is_split }) => {
                self.whole(2);
                let (kind, across, down) = match *mapping {
                    EnvironmentMapping::LatLong { across, down } => (0, across, down),
                    EnvironmentMapping::Octahedral { side } => (1, side, side),
                    EnvironmentMapping::Patches(patches) => (2, patches.subdivision(), u32::from(*is_split)),
                };
                [kind, across, down].into_iter().for_each(|number| self.whole(number.into()));
                self.matrix(world_from_environment);
            }
            Emitter::Suns(SunPlaces { towards, angular_radius_radians }) => {
                self.whole(3);
                self.bytes(bytemuck::cast_slice(towards));
                self.number(*angular_radius_radians);
            }
        }
    }

    fn layout(&mut self, layout: &AreaLayout) {
        match layout {
            AreaLayout::Whole => self.whole(0),
            AreaLayout::Texels { origin, edge_u, edge_v, normal, across, down } => {
                self.whole(1);
                [origin, edge_u, edge_v, normal].into_iter().for_each(|vector| self.vector(*vector));
                [across, down].into_iter().for_each(|number| self.whole((*number).into()));
            }
        }
    }

    fn point(&mut self, point: &PointEmitter) {
        match point {
            PointEmitter::Point { position } => {
                self.whole(0);
                self.vector(*position);
            }
            PointEmitter::Spot { position, direction, inner_radians, outer_radians } => {
                self.whole(1);
                self.vector(*position);
                self.vector(*direction);
                self.number(*inner_radians);
                self.number(*outer_radians);
            }
            PointEmitter::Sun { towards, angular_radius_radians } => {
                self.whole(2);
                self.vector(*towards);
                self.number(*angular_radius_radians);
            }
            PointEmitter::Ball { position, radius, cone } => {
                self.whole(4);
                self.vector(*position);
                self.number(*radius);
                self.whole(cone.is_some().into());
                if let Some(SpotCone { direction, inner_radians, outer_radians }) = cone {
                    self.vector(*direction);
                    self.number(*inner_radians);
                    self.number(*outer_radians);
                }
            }
            PointEmitter::Ies { position, world_from_luminaire, profile } => {
                self.whole(3);
                self.vector(*position);
                self.matrix(world_from_luminaire);
                let IesProfile { vertical_radians, horizontal_radians, intensity } = profile;
                for angles in [vertical_radians, horizontal_radians, intensity] {
                    self.bytes(bytemuck::cast_slice(angles));
                }
            }
        }
    }
}
