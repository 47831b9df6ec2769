//! Scenes that need no file: small rooms in the manner of Cornell's, one for each kind of light transport.

use glam::{DVec3, Quat, Vec3};

use super::assembly::{Assembly, Panel};
use super::{Camera, LoadedScene, MaterialId, Paint, PixelFilter, RenderSettings, Scene, Surface, shapes};
use crate::error::{Error, Result, Warnings};
use crate::light::EnvironmentMapping;

/// Names of the built-in scenes, the first being the one shown when none is asked for.
pub const BUILT_IN_NAMES: [&str; 5] = ["mixed", "diffuse", "reflections", "caustics", "environment"];

/// Half the room's width, its height, and half its depth, in metres.
const ROOM: Vec3 = Vec3::new(1.34, 2.0, 1.0);

/// Sizes of a built-in scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BuiltIn {
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Texels along each side of the ceiling light, or around the environment, which is half as many high.
    pub texels: u32,
}

impl Default for BuiltIn {
    fn default() -> Self {
        Self { width: 256, height: 192, texels: 32 }
    }
}

/// The default scene: a ceiling light of 32 × 32 texels in view, a mirror ball and a glass ball, 256 × 192 pixels.
///
/// # Panics
/// Never: the scene is valid.
pub fn built_in() -> LoadedScene {
    built_in_named("mixed").expect("the built-in scene of default size is valid")
}

/// A built-in scene of default size.
///
/// # Errors
/// A name that is not in [`BUILT_IN_NAMES`].
pub fn built_in_named(name: &str) -> Result<LoadedScene> {
    BuiltIn::default().named(name)
}

impl BuiltIn {
    /// A built-in scene of these sizes, all in metres:
    ///
    /// - `mixed`: light in view, mirror ball, glass ball, a white box;
    /// - `diffuse`: two white boxes, the light out of view;
    /// - `reflections`: a glossy floor and a mirror ball, the light out of view;
    /// - `caustics`: two glass balls, the light out of view;
    /// - `environment`: balls and a box on a floor under an environment.
    ///
    /// # Errors
    /// An unknown name, an image or light of size 0, more columns than a matrix can have.
    pub fn named(self, name: &str) -> Result<LoadedScene> {
        let mut assembly = Assembly::default();
        let white = assembly.material("white", lambert(0.73, 0.73, 0.73));
        let floor = |assembly: &mut Assembly| match name {
            "reflections" => {
                let specular = Paint::Constant(Vec3::splat(0.6));
                assembly.material("floor", Surface::RoughConductor { specular, alpha: 0.1 })
            }
            _ => white,
        };
        match name {
            "mixed" => {
                let floor = floor(&mut assembly);
                self.room(&mut assembly, white, floor)?;
                let (mirror, glass) = (mirror(&mut assembly), glass(&mut assembly));
                assembly.add(shapes::ball(Vec3::new(-0.62, 0.42, -0.38), 0.42, 5), mirror);
                assembly.add(shapes::ball(Vec3::new(0.55, 0.36, 0.28), 0.36, 5), glass);
                assembly.add(shapes::cuboid(Vec3::new(0.45, 0.55, -0.55), Vec3::new(0.26, 0.55, 0.26), 0.35), white);
            }
            "diffuse" => {
                let floor = floor(&mut assembly);
                self.room(&mut assembly, white, floor)?;
                assembly.add(shapes::cuboid(Vec3::new(-0.45, 0.6, -0.35), Vec3::new(0.3, 0.6, 0.3), 0.3), white);
                assembly.add(shapes::cuboid(Vec3::new(0.45, 0.3, 0.25), Vec3::new(0.3, 0.3, 0.3), -0.28), white);
            }
            "reflections" => {
                let floor = floor(&mut assembly);
                self.room(&mut assembly, white, floor)?;
                let mirror = mirror(&mut assembly);
                assembly.add(shapes::ball(Vec3::new(-0.5, 0.45, -0.2), 0.45, 5), mirror);
                assembly.add(shapes::cuboid(Vec3::new(0.5, 0.35, 0.05), Vec3::new(0.28, 0.35, 0.28), -0.3), white);
            }
            "caustics" => {
                let floor = floor(&mut assembly);
                self.room(&mut assembly, white, floor)?;
                let glass = glass(&mut assembly);
                assembly.add(shapes::ball(Vec3::new(-0.5, 0.5, -0.25), 0.4, 5), glass);
                assembly.add(shapes::ball(Vec3::new(0.5, 0.36, 0.2), 0.3, 5), glass);
            }
            "environment" => {
                let ground = assembly.material("ground", lambert(0.5, 0.48, 0.45));
                let side = Vec3::new(6.0, 0.0, 6.0);
                assembly.add(shapes::rectangle(-side, Vec3::Z * 12.0, Vec3::X * 12.0), ground);
                let (mirror, clay) = (mirror(&mut assembly), assembly.material("clay", lambert(0.6, 0.35, 0.25)));
                let reflectance = Paint::Constant(Vec3::new(0.1, 0.25, 0.55));
                let coat = Surface::Coated { reflectance, specular: Vec3::splat(0.04), alpha: 0.05 };
                let coated = assembly.material("coated", coat);
                assembly.add(shapes::ball(Vec3::new(-0.75, 0.4, 0.0), 0.4, 5), mirror);
                assembly.add(shapes::ball(Vec3::new(0.15, 0.35, 0.35), 0.35, 5), coated);
                assembly.add(shapes::cuboid(Vec3::new(0.8, 0.5, -0.4), Vec3::new(0.3, 0.5, 0.3), 0.5), clay);
                let mapping = EnvironmentMapping::LatLong { across: self.texels, down: self.texels.div_ceil(2) };
                self.check_columns(mapping.layout())?;
                assembly.environment("sky", mapping, Quat::IDENTITY, false, [1.0; 3])?;
            }
            _ => {
                let known = BUILT_IN_NAMES.join(", ");
                return Err(Error::input(name, "is not a built-in scene", format!("there are {known}")));
            }
        }
        let (eye, look_at, fov_degrees) = match name {
            "mixed" => (Vec3::new(0.0, 1.0, 3.9), Vec3::new(0.0, 1.0, 0.0), 38.0f32),
            "environment" => (Vec3::new(0.0, 1.5, 4.0), Vec3::new(0.0, 0.4, 0.0), 30.0),
            // The upper edge of the image meets the back wall 0.2 m below the ceiling, so the light stays out of view;
            // the lower edge meets the floor, not the open front.
            _ => (Vec3::new(0.0, 1.0, 3.4), Vec3::new(0.0, 0.63, 0.0), 32.0),
        };
        let size = (self.width, self.height);
        let camera = Camera::looking(eye, look_at - eye, Vec3::Y, fov_degrees.to_radians(), size, PixelFilter::Box)?;
        let Assembly { mesh, materials, textures, emitters, unseen_lights, basis } = assembly;
        let scene = Scene {
            name: name.into(),
            origin: DVec3::ZERO,
            mesh,
            materials,
            textures,
            camera,
            emitters,
            unseen_lights,
            sensors: None,
            shows_irradiance: false,
            basis,
            metres_per_unit: 1.0,
        };
        Ok(LoadedScene::new(scene, RenderSettings::default(), Warnings::new()))
    }

    /// The room without its front wall, and its ceiling light.
    fn room(self, assembly: &mut Assembly, white: MaterialId, floor: MaterialId) -> Result<()> {
        self.check_columns((self.texels, self.texels))?;
        let red = assembly.material("red", lambert(0.63, 0.065, 0.05));
        let green = assembly.material("green", lambert(0.14, 0.45, 0.091));
        let lamp = assembly.material("lamp", Surface::Black);
        let (right, up, depth) = (Vec3::X * 2.0 * ROOM.x, Vec3::Y * ROOM.y, Vec3::Z * 2.0 * ROOM.z);
        let corner = Vec3::new(-ROOM.x, 0.0, -ROOM.z);
        assembly.add(shapes::rectangle(corner, depth, right), floor);
        assembly.add(shapes::rectangle(corner + up, right, depth), white);
        assembly.add(shapes::rectangle(corner, right, up), white);
        assembly.add(shapes::rectangle(corner, up, depth), red);
        assembly.add(shapes::rectangle(corner + right, depth, up), green);
        let panel = Panel {
            origin: Vec3::new(-0.4, ROOM.y - 0.01, -0.4),
            edge_u: Vec3::X * 0.8,
            edge_v: Vec3::Z * 0.8,
            normal: Vec3::NEG_Y,
            texels: (self.texels, self.texels),
            two_sided: false,
        };
        assembly.panel("ceiling", panel, lamp, [12.0, 11.0, 9.0])
    }

    fn check_columns(self, (across, down): (u32, u32)) -> Result<()> {
        // A square of a side below 4,096 has at most as many texels as a matrix has columns, which the basis checks.
        if across == 0 || across > 4096 || down > 4096 {
            let hint = "give 1 to 4096 texels along a side";
            return Err(Error::input("built-in scene", format!("a light of {across} × {down} texels"), hint));
        }
        Ok(())
    }
}

fn lambert(r: f32, g: f32, b: f32) -> Surface {
    Surface::Lambert { reflectance: Paint::Constant(Vec3::new(r, g, b)) }
}

fn mirror(assembly: &mut Assembly) -> MaterialId {
    assembly.material("mirror", Surface::Mirror { reflectance: Paint::Constant(Vec3::splat(0.95)) })
}

fn glass(assembly: &mut Assembly) -> MaterialId {
    assembly.material("glass", Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rooms_light_faces_down_and_its_walls_face_in() {
        let scene = built_in().scene;
        let inside = Vec3::new(0.0, 1.0, 0.0);
        for triangle in &scene.mesh.triangles {
            let [a, b, c] = scene.mesh.corners(triangle);
            let normal = (b - a).cross(c - a).normalize();
            match scene.materials[triangle.material.0 as usize].name.as_str() {
                "red" | "green" | "lamp" => assert!(normal.dot(inside - a) > 0.0, "{normal}"),
                _ => {}
            }
            if triangle.emitter.is_some() {
                assert!((normal - Vec3::NEG_Y).length() < 1e-6);
            }
        }
        assert!((2.0 * ROOM.x / ROOM.y - 256.0 / 192.0).abs() < 0.01, "the open front fills a 4:3 image");
    }

    #[test]
    fn unknown_names_and_sizes_are_refused() {
        assert!(built_in_named("nothing").unwrap_err().to_string().contains("caustics"));
        for texels in [0, 5000] {
            assert!(BuiltIn { texels, ..BuiltIn::default() }.named("mixed").is_err());
            assert!(BuiltIn { texels, ..BuiltIn::default() }.named("environment").is_err());
        }
        assert!(BuiltIn { width: 0, ..BuiltIn::default() }.named("mixed").is_err());
    }

    #[test]
    fn scenes_of_different_content_have_different_hashes() {
        let mut hashes: Vec<_> = BUILT_IN_NAMES.iter().map(|n| built_in_named(n).unwrap().content).collect();
        hashes.push(BuiltIn { texels: 16, ..BuiltIn::default() }.named("mixed").unwrap().content);
        hashes.push(BuiltIn { width: 255, ..BuiltIn::default() }.named("mixed").unwrap().content);
        assert_eq!(built_in().content, hashes[0]);
        hashes.sort();
        hashes.dedup();
        assert_eq!(hashes.len(), BUILT_IN_NAMES.len() + 2);
    }
}
