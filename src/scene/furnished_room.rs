//! The room of the demonstration: furnished, by day and by lamplight, made of simple shapes and two painted textures.

use glam::{DVec3, Quat, Vec2, Vec3};

use super::assembly::{Assembly, Panel};
use super::shapes::{TriangleList, ball, cuboid, rectangle, turned};
use super::{
    Camera, LoadedScene, MaterialId, Paint, PixelFilter, Placing, PointEmitter, RenderSettings, Scene, Surface, Texels,
    Texture, TextureId,
};
use crate::error::{Result, Warnings};
use crate::light::EnvironmentMapping;

/// Half the room's width and depth, and its height, in metres.
const HALF: Vec2 = Vec2::new(3.0, 2.5);
const HEIGHT: f32 = 2.7;
/// Thickness of the wall with the window, and where the window is in it: along z, and in height.
const WALL: f32 = 0.25;
const WINDOW_Z: (f32, f32) = (-1.7, 0.7);
const WINDOW_Y: (f32, f32) = (0.8, 2.3);
/// Texels of the sky and of the panel in the ceiling, across and down.
const SKY_TEXELS: (u32, u32) = (16, 8);
const PANEL_TEXELS: (u32, u32) = (12, 8);
/// Sides of round things.
const SIDES: u32 = 48;
/// Side of the square textures in texels.
const TEXTURE_SIDE: u32 = 256;

/// A room of 6 m × 5 m with a window, seen at 1280 × 720 pixels: a sky of 16 × 8 texels, a sun, a ceiling panel of 12 × 8 texels,
/// three pendants over a table, a floor lamp, and a spot on a picture. Its own lighting has all of them on.
///
/// # Panics
/// Never: the scene is valid.
pub fn furnished_room() -> LoadedScene {
    built().expect("the furnished room is valid")
}

fn built() -> Result<LoadedScene> {
    let mut assembly = Assembly::default();
    let materials = Materials::of(&mut assembly);
    shell(&mut assembly, &materials);
    seats(&mut assembly, &materials);
    dining(&mut assembly, &materials);
    shelf(&mut assembly, &materials);
    small_things(&mut assembly, &materials);
    lights(&mut assembly, &materials)?;
    let (eye, look_at) = (Vec3::new(2.7, 1.5, 2.3), Vec3::new(-0.85, 0.98, -1.35));
    let fov_degrees = 46.0f32;
    let camera = Camera::looking(eye, look_at - eye, Vec3::Y, fov_degrees.to_radians(), (1280, 720), PixelFilter::Box)?;
    let Assembly { mesh, materials, textures, emitters, unseen_lights, basis } = assembly;
    let scene = Scene {
        name: "furnished room".into(),
        origin: DVec3::ZERO,
        mesh,
        materials,
        textures,
        camera,
        sensors: None,
        shows_irradiance: false,
        emitters,
        unseen_lights,
        basis,
        metres_per_unit: 1.0,
    };
    Ok(LoadedScene::new(scene, RenderSettings { samples_per_pixel: 16, ..Default::default() }, Warnings::new()))
}

/// What things are made of.
struct Materials {
    wall: MaterialId,
    accent: MaterialId,
    parquet: MaterialId,
    wood: MaterialId,
    dark_wood: MaterialId,
    fabric: MaterialId,
    cushion: MaterialId,
    rug: MaterialId,
    rug_border: MaterialId,
    painting: MaterialId,
    metal: MaterialId,
    ceramic: MaterialId,
    leaf: MaterialId,
    books: [MaterialId; 5],
    black: MaterialId,
}

impl Materials {
    fn of(assembly: &mut Assembly) -> Self {
        assembly.textures.push(texture("parquet", Vec2::new(3.0, 2.5), parquet_at));
        assembly.textures.push(texture("painting", Vec2::ONE, painting_at));
        let painted = |texture| Paint::Textured(TextureId(texture), Vec3::ONE);
        let coated = |reflectance, alpha| Surface::Coated { reflectance, specular: Vec3::splat(0.04), alpha };
        let matte = |r, g, b| Surface::Lambert { reflectance: Paint::Constant(Vec3::new(r, g, b)) };
        let colour = |r, g, b| Paint::Constant(Vec3::new(r, g, b));
        let steel = Surface::RoughConductor { specular: colour(0.78, 0.74, 0.68), alpha: 0.12 };
        let books =
            [[0.45, 0.10, 0.08], [0.08, 0.16, 0.34], [0.62, 0.52, 0.30], [0.10, 0.28, 0.20], [0.68, 0.66, 0.62]];
        Self {
            wall: assembly.material("wall", matte(0.78, 0.76, 0.72)),
            accent: assembly.material("accent wall", matte(0.16, 0.27, 0.30)),
            parquet: assembly.material("parquet", coated(painted(0), 0.15)),
            wood: assembly.material("wood", coated(colour(0.46, 0.30, 0.17), 0.12)),
            dark_wood: assembly.material("dark wood", coated(colour(0.10, 0.06, 0.035), 0.12)),
            fabric: assembly.material("fabric", matte(0.42, 0.42, 0.44)),
            cushion: assembly.material("cushion", matte(0.70, 0.38, 0.10)),
            rug: assembly.material("rug", matte(0.60, 0.54, 0.45)),
            rug_border: assembly.material("rug border", matte(0.36, 0.11, 0.09)),
            painting: assembly.material("painting", Surface::Lambert { reflectance: painted(1) }),
            metal: assembly.material("metal", steel),
            ceramic: assembly.material("ceramic", coated(colour(0.55, 0.60, 0.58), 0.03)),
            leaf: assembly.material("leaf", matte(0.10, 0.27, 0.07)),
            books: books.map(|[r, g, b]| assembly.material("book", matte(r, g, b))),
            black: assembly.material("lamp", Surface::Black),
        }
    }
}

/// A square texture, repeated `scale` times.
fn texture(name: &str, scale: Vec2, at: impl Fn(Vec2) -> Vec3) -> Texture {
    let side = TEXTURE_SIDE;
    let texel = |index: u32| {
        let place = Vec2::new((index % side) as f32 + 0.5, (index / side) as f32 + 0.5) / side as f32;
        let colour = at(place).clamp(Vec3::ZERO, Vec3::ONE) * 255.0;
        [colour.x as u8, colour.y as u8, colour.z as u8, 255]
    };
    Texture {
        name: name.into(),
        width: side,
        height: side,
        texels: Texels::Colours8((0..side * side).map(texel).collect()),
        placing: Placing { scale, ..Placing::PLAIN },
    }
}

/// A number from 0 to 1 that looks like chance and is not.
fn scattered(index: u32) -> f32 {
    let mixed = index.wrapping_mul(0x9e37_79b1) ^ 0x85eb_ca6b;
    let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x2c1b_3c6d);
    ((mixed ^ (mixed >> 13)) >> 8) as f32 / (1 << 24) as f32
}

/// Planks of eight rows, each of its own brown, with dark joints.
fn parquet_at(place: Vec2) -> Vec3 {
    const ROWS: f32 = 8.0;
    let row = (place.y * ROWS).floor();
    let along = place.x * 2.0 + scattered(row as u32);
    let plank = along.floor() as u32 % 2 + 2 * row as u32;
    let (across, ahead) = ((place.y * ROWS).fract(), along.fract());
    let is_joint = across < 0.03 || ahead < 0.006;
    let grain = 0.04 * (place.y * 190.0 + 5.0 * (along * 3.0 + row).sin()).sin();
    let shade = if is_joint { 0.45 } else { 0.82 + 0.28 * scattered(plank + 100) + grain };
    Vec3::new(0.72, 0.55, 0.38) * shade
}

/// Two hills and a sun.
fn painting_at(place: Vec2) -> Vec3 {
    let hill = |base: f32, height: f32, wave: f32, shift: f32| base + height * (place.x * wave + shift).sin();
    let sky = Vec3::new(0.94, 0.80, 0.60).lerp(Vec3::new(0.55, 0.66, 0.72), 1.0 - place.y);
    match place {
        _ if place.y > hill(0.80, 0.06, 7.0, 1.0) => Vec3::new(0.17, 0.24, 0.24),
        _ if place.y > hill(0.64, 0.09, 5.0, 4.0) => Vec3::new(0.36, 0.47, 0.44),
        _ if place.distance(Vec2::new(0.68, 0.36)) < 0.13 => Vec3::new(0.93, 0.45, 0.25),
        _ => sky,
    }
}

/// A box by two opposite corners.
fn block(from: Vec3, to: Vec3) -> TriangleList {
    cuboid(0.5 * (from + to), 0.5 * (to - from).abs(), 0.0)
}

/// Floor, walls, ceiling, and the wall with the window, with its frame and sill.
fn shell(assembly: &mut Assembly, materials: &Materials) {
    let (right, up, depth) = (Vec3::X * 2.0 * HALF.x, Vec3::Y * HEIGHT, Vec3::Z * 2.0 * HALF.y);
    let corner = Vec3::new(-HALF.x, 0.0, -HALF.y);
    assembly.add(rectangle(corner, depth, right), materials.parquet);
    assembly.add(rectangle(corner + up, right, depth), materials.wall);
    assembly.add(rectangle(corner, right, up), materials.accent);
    assembly.add(rectangle(corner + depth, up, right), materials.wall);
    assembly.add(rectangle(corner + right, depth, up), materials.wall);
    let (outer, inner) = (-HALF.x - WALL, -HALF.x);
    let ((near, far), (sill, lintel)) = (WINDOW_Z, WINDOW_Y);
    let mut piece = |y: (f32, f32), z: (f32, f32)| {
        assembly.add(block(Vec3::new(outer, y.0, z.0), Vec3::new(inner, y.1, z.1)), materials.wall);
    };
    piece((0.0, sill), (-HALF.y, HALF.y));
    piece((lintel, HEIGHT), (-HALF.y, HALF.y));
    piece((sill, lintel), (-HALF.y, near));
    piece((sill, lintel), (far, HALF.y));
    let frame =
        |y: (f32, f32), z: (f32, f32)| block(Vec3::new(outer + 0.08, y.0, z.0), Vec3::new(outer + 0.13, y.1, z.1));
    const BAR: f32 = 0.05;
    let middle = 0.5 * (near + far);
    for z in [near, middle - 0.5 * BAR, far - BAR] {
        assembly.add(frame((sill, lintel), (z, z + BAR)), materials.wall);
    }
    for y in [sill, lintel - BAR] {
        assembly.add(frame((y, y + BAR), (near, far)), materials.wall);
    }
    let board = block(Vec3::new(inner - 0.1, sill - 0.03, near - 0.05), Vec3::new(inner + 0.12, sill, far + 0.05));
    assembly.add(board, materials.wood);
}

/// A sofa below the picture, an armchair by the window, a low table on a rug.
fn seats(assembly: &mut Assembly, materials: &Materials) {
    let mut of = |from: [f32; 3], to: [f32; 3], material| assembly.add(block(from.into(), to.into()), material);
    of([-1.95, 0.001, -1.45], [0.75, 0.008, 0.75], materials.rug_border);
    of([-1.85, 0.008, -1.35], [0.65, 0.014, 0.65], materials.rug);
    // The sofa.
    of([-1.75, 0.10, -2.40], [0.45, 0.40, -1.50], materials.fabric);
    of([-1.75, 0.40, -2.40], [0.45, 0.82, -2.16], materials.fabric);
    of([-1.97, 0.10, -2.40], [-1.75, 0.60, -1.50], materials.fabric);
    of([0.45, 0.10, -2.40], [0.67, 0.60, -1.50], materials.fabric);
    of([-1.74, 0.401, -2.15], [-0.66, 0.50, -1.48], materials.fabric);
    of([-0.64, 0.401, -2.15], [0.44, 0.50, -1.48], materials.fabric);
    for x in [-1.85, 0.55] {
        for z in [-2.30, -1.60] {
            of([x - 0.03, 0.0, z - 0.03], [x + 0.03, 0.10, z + 0.03], materials.dark_wood);
        }
    }
    // The low table.
    of([-1.15, 0.36, -0.75], [-0.05, 0.40, -0.15], materials.wood);
    for x in [-1.10, -0.14] {
        for z in [-0.70, -0.24] {
            of([x, 0.014, z], [x + 0.04, 0.36, z + 0.04], materials.dark_wood);
        }
    }
    for (x, turn, material) in [(-1.45, 0.25, materials.cushion), (0.16, -0.3, materials.rug_border)] {
        assembly.add(cuboid(Vec3::new(x, 0.66, -2.06), Vec3::new(0.21, 0.17, 0.06), turn), material);
    }
}

/// A table with four chairs at the right.
fn dining(assembly: &mut Assembly, materials: &Materials) {
    let mut of = |from: [f32; 3], to: [f32; 3], material| assembly.add(block(from.into(), to.into()), material);
    of([1.30, 0.71, -1.75], [2.70, 0.75, -0.85], materials.wood);
    for x in [1.34, 2.61] {
        for z in [-1.71, -0.94] {
            of([x, 0.0, z], [x + 0.05, 0.71, z + 0.05], materials.wood);
        }
    }
    for x in [1.45, 2.10] {
        for (seat, back) in [(-2.10, -2.13), (-0.92, -0.50)] {
            of([x, 0.42, seat], [x + 0.42, 0.46, seat + 0.42], materials.dark_wood);
            of([x, 0.46, back], [x + 0.42, 0.92, back + 0.03], materials.dark_wood);
            for (dx, dz) in [(0.0, 0.0), (0.38, 0.0), (0.0, 0.38), (0.38, 0.38)] {
                of([x + dx, 0.0, seat + dz], [x + dx + 0.04, 0.42, seat + dz + 0.04], materials.dark_wood);
            }
        }
    }
    let bowl = [(0.0, 0.0), (0.07, 0.0), (0.16, 0.07), (0.15, 0.07), (0.07, 0.012), (0.0, 0.012)];
    assembly.add(turned(Vec3::new(2.0, 0.75, -1.3), &bowl, SIDES), materials.ceramic);
    for (dx, dz) in [(0.03, 0.02), (-0.05, -0.01), (0.0, -0.06)] {
        assembly.add(ball(Vec3::new(2.0 + dx, 0.81, -1.3 + dz), 0.04, 3), materials.cushion);
    }
}

/// A bookcase at the back wall, between sofa and table.
fn shelf(assembly: &mut Assembly, materials: &Materials) {
    let (left, right, front) = (0.95, 2.05, -2.18);
    let mut of = |from: [f32; 3], to: [f32; 3], material| assembly.add(block(from.into(), to.into()), material);
    let boards = [0.0, 0.45, 0.85, 1.25, 1.65];
    for y in boards {
        of([left, y, -2.49], [right, y + 0.03, front], materials.dark_wood);
    }
    for x in [left, right - 0.03] {
        of([x, 0.0, -2.49], [x + 0.03, 1.68, front], materials.dark_wood);
    }
    let mut number = 0;
    for y in &boards[..4] {
        let mut x = left + 0.05;
        let end = right - 0.12 - 0.35 * scattered(number + 7);
        while x < end {
            number += 1;
            let (thick, high) = (0.022 + 0.035 * scattered(number), 0.22 + 0.11 * scattered(number + 500));
            let deep = front - 0.03 - 0.05 * scattered(number + 900);
            let book = materials.books[(scattered(number + 300) * 4.99) as usize];
            of([x, y + 0.03, -2.44], [x + thick, y + 0.03 + high, deep], book);
            x += thick + 0.002;
        }
    }
}

/// The picture, a vase, a plant at the window, cups.
fn small_things(assembly: &mut Assembly, materials: &Materials) {
    let (left, right, low, high) = (-1.35, 0.05, 1.15, 2.05);
    assembly.add(
        block(Vec3::new(left - 0.04, low - 0.04, -2.5), Vec3::new(right + 0.04, high + 0.04, -2.47)),
        materials.dark_wood,
    );
    let canvas = rectangle(Vec3::new(left, low, -2.468), Vec3::X * (right - left), Vec3::Y * (high - low));
    assembly.add(canvas, materials.painting);
    let vase = [
        (0.0, 0.0),
        (0.05, 0.0),
        (0.085, 0.10),
        (0.075, 0.18),
        (0.03, 0.25),
        (0.045, 0.30),
        (0.035, 0.30),
        (0.02, 0.25),
        (0.0, 0.2),
    ];
    assembly.add(turned(Vec3::new(-0.35, 0.40, -0.45), &vase, SIDES), materials.metal);
    let cup = [(0.0, 0.0), (0.03, 0.0), (0.042, 0.08), (0.038, 0.08), (0.027, 0.008), (0.0, 0.008)];
    for (x, z) in [(-0.85, -0.35), (-0.72, -0.55)] {
        assembly.add(turned(Vec3::new(x, 0.40, z), &cup, SIDES), materials.ceramic);
    }
    let pot = [(0.0, 0.0), (0.15, 0.0), (0.21, 0.38), (0.19, 0.38), (0.18, 0.33), (0.0, 0.33)];
    let place = Vec3::new(-2.55, 0.0, -1.95);
    assembly.add(turned(place, &pot, SIDES), materials.ceramic);
    for leaf in 0..26 {
        let (turn, lean) = (leaf as f32 * 2.4, 0.25 + 0.75 * scattered(leaf));
        let length = 0.75 + 0.45 * scattered(leaf + 50);
        let across = Vec3::new(turn.cos(), 0.0, turn.sin());
        let foot = place + Vec3::Y * 0.33 + across * 0.04;
        let tip = (across * lean * 0.5 + Vec3::Y * (1.0 - 0.4 * lean)) * length;
        let side = tip.cross(across).normalize() * 0.05;
        let mut blade = rectangle(foot - side, side * 2.0, tip);
        // A leaf is a pointed sheet: its upper corners meet.
        blade.vertices[2].position = foot + tip + side * 0.1;
        blade.vertices[3].position = foot + tip - side * 0.1;
        assembly.add(blade, materials.leaf);
    }
}

/// Sky, sun, panel, pendants, floor lamp and the picture's spot.
fn lights(assembly: &mut Assembly, materials: &Materials) -> Result<()> {
    let panel = Panel {
        origin: Vec3::new(-1.6, HEIGHT - 0.01, -1.2),
        edge_u: Vec3::X * 2.1,
        edge_v: Vec3::Z * 1.4,
        normal: Vec3::NEG_Y,
        texels: PANEL_TEXELS,
        two_sided: false,
    };
    assembly.panel("ceiling panel", panel, materials.black, [1.5, 1.45, 1.35])?;
    for (number, x) in [1.55, 2.0, 2.45].into_iter().enumerate() {
        let bulb = Vec3::new(x, 1.52, -1.3);
        let shade = [(0.13, -0.02), (0.10, 0.10), (0.02, 0.16)];
        assembly.add(turned(bulb, &shade, SIDES), materials.metal);
        assembly
            .add(block(bulb + Vec3::new(-0.004, 0.16, -0.004), Vec3::new(x + 0.004, HEIGHT, -1.296)), materials.black);
        let name = format!("pendant {}", number + 1);
        assembly.lamp(&name, ball(bulb, 0.045, 2), materials.black, (bulb, [55.0, 38.0, 21.0]))?;
    }
    let foot = Vec3::new(-2.35, 0.0, -2.1);
    let stand = [(0.0, 0.0), (0.15, 0.0), (0.15, 0.02), (0.012, 0.03), (0.012, 1.42), (0.0, 1.42)];
    assembly.add(turned(foot, &stand, SIDES), materials.metal);
    assembly.add(turned(foot, &[(0.22, 1.35), (0.15, 1.68)], SIDES), materials.rug);
    let bulb = foot + Vec3::Y * 1.5;
    assembly.lamp("floor lamp", ball(bulb, 0.06, 2), materials.black, (bulb, [70.0, 46.0, 24.0]))?;
    let (spot, middle) = (Vec3::new(-0.65, 2.62, -1.35), Vec3::new(-0.65, 1.55, -2.47));
    let direction = (middle - spot).normalize();
    let spot = PointEmitter::Spot { position: spot, direction, inner_radians: 0.30, outer_radians: 0.55 };
    assembly.point("picture spot", spot, [3.0, 2.6, 2.1])?;
    let towards = Vec3::new(-0.72, 0.52, 0.38).normalize();
    assembly.point("sun", PointEmitter::Sun { towards, angular_radius_radians: 0.01 }, [22.0, 19.0, 15.0])?;
    let (across, down) = SKY_TEXELS;
    let mapping = EnvironmentMapping::LatLong { across, down };
    assembly.environment("sky", mapping, Quat::IDENTITY, false, [1.0; 3])?;
    let first = assembly.basis.lights().last().map_or(0, |sky| sky.first_column);
    let texel = |texel| sky_at(mapping.direction_at(texel, Vec2::splat(0.5)));
    assembly.basis.set_scene_weights(first, (0..mapping.texel_count()).map(texel).collect())
}

/// A clear sky, and a garden below the horizon.
fn sky_at(direction: Vec3) -> [f32; 3] {
    let (horizon, zenith) = (Vec3::new(3.6, 3.7, 3.8), Vec3::new(1.1, 1.9, 3.6));
    match direction.y {
        y if y > 0.0 => horizon.lerp(zenith, y.sqrt()).into(),
        _ => [0.35, 0.42, 0.24],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::validate;

    #[test]
    fn the_furnished_room_passes_the_checks_of_scenes() {
        let loaded = furnished_room();
        assert_eq!(validate(&loaded.scene).unwrap(), Warnings::new());
        let names: Vec<&str> = loaded.scene.basis.lights().iter().map(|light| light.name.as_str()).collect();
        let lamps = ["pendant 1", "pendant 2", "pendant 3", "floor lamp", "picture spot"];
        assert_eq!(names[1..6], lamps);
        assert_eq!((names[0], names[6], names[7]), ("ceiling panel", "sun", "sky"));
        assert_eq!(loaded.scene.basis.column_count(), 96 + 6 + 128);
        assert_eq!((loaded.scene.camera.width, loaded.scene.camera.height), (1280, 720));
    }

    #[test]
    fn accent_wall_floor_and_painting_face_the_room() {
        let scene = furnished_room().scene;
        let inside = Vec3::new(0.0, 1.4, 0.0);
        let faces = ["accent wall", "parquet", "painting"];
        for triangle in &scene.mesh.triangles {
            let name = scene.materials[triangle.material.0 as usize].name.as_str();
            let [a, b, c] = scene.mesh.corners(triangle);
            if faces.contains(&name) {
                assert!((b - a).cross(c - a).dot(inside - a) > 0.0, "{name}");
            }
        }
    }
}
