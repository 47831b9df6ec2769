//! The window's knowledge of lights, held against relit pictures.

#[path = "../../../tests/relight_source/mod.rs"]
mod relight_source;

use ltm::image::luminance;
use ltm::light::{Light, LightBasis, LightKind, LightUnit, Lighting};
use ltm::look;
use ltm::matrix::BlockId;
use ltm::relight::{CpuRelighter, pixel_rows};
use ltm_view::history::History;
use ltm_view::looks::{self, Saved};
use ltm_view::mixer::{Mix, Tint};
use ltm_view::pattern::{Brush, Pattern};
use ltm_view::reach::{TexelReach, per_light};
use relight_source::{MemoryFactors, Recipe};

/// Two lamps that make a group, a texelled panel, an environment: 1 + 1 + 6 + 8 columns.
fn basis() -> LightBasis {
    let mut basis = LightBasis::new();
    for (name, kind) in [
        ("lamp 1", LightKind::Lamp),
        ("lamp 2", LightKind::Lamp),
        ("panel", LightKind::AreaTexels { across: 3, down: 2 }),
        ("sky", LightKind::LatLong { across: 4, down: 2 }),
    ] {
        let columns = (kind.layout().0 * kind.layout().1) as usize;
        let light = Light {
            name: name.into(),
            kind,
            unit: LightUnit::Radiance,
            emission: [1.0, 0.8, 0.6],
            first_column: 0,
            places: vec![[0.0; 3]; columns],
            extents: vec![1.0; columns],
        };
        basis.push(light).unwrap();
    }
    basis
}

fn factors() -> MemoryFactors {
    Recipe::new((37, 21), 16, 16, &[5]).sparse(9).make()
}

/// A mix in which everything is used: stops, tints, a painted panel, a turned sky.
fn mixed(basis: &LightBasis) -> Mix {
    let mut mix = Mix::of_scene(basis);
    mix.groups.group_mut(0).stops = -0.5;
    mix.lights[0].stops = 1.3;
    mix.lights[1].tint = Tint::Kelvin(3200.0);
    let mut painted = Pattern::white((3, 2));
    let brush = Brush { radius_texels: 1.0, hardness: 0.3, flow: 0.7, colour: [2.0, 0.1, 0.0] };
    painted.stroke(&brush, [0.2, 0.4], [2.5, 1.5], false);
    mix.lights[2].pattern = Some(painted);
    let mut sky = Pattern::white((4, 2));
    sky.texels_mut()[1] = [40.0, 30.0, 20.0];
    mix.lights[3].pattern = Some(sky);
    mix.lights[3].turn_radians = 0.9;
    mix
}

/// Sums of a few thousand products in f32 and 16-bit factors (2⁻¹¹ each): a thousandth of the picture's mean.
fn near(a: f32, b: f32, scale: f32) -> bool {
    (a - b).abs() <= 1e-3 * scale
}

#[test]
fn contributions_are_the_mean_luminances_of_the_lights_own_pictures() {
    let (basis, source) = (basis(), factors());
    let mix = mixed(&basis);
    let relighter = CpuRelighter::load(&source).unwrap();
    let reach = TexelReach::measure(&source);
    let contributions = reach.contributions(&basis, &mix.lighting(&basis).unwrap());
    for (light, &contribution) in contributions.iter().enumerate() {
        let mut alone = mix.clone();
        alone.toggle_solo(light, false);
        let image = relighter.relight(&alone.lighting(&basis).unwrap()).unwrap();
        let count = image.pixels.len() as f32;
        let mean = image.luminances().sum::<f32>() / count;
        let scale = image.luminances().map(f32::abs).sum::<f32>() / count;
        assert!(near(contribution, mean, scale), "light {light}: {contribution} against {mean}");
    }
}

#[test]
fn the_lights_at_a_pixel_add_up_to_the_pixel() {
    let (basis, source) = (basis(), factors());
    let lighting = mixed(&basis).lighting(&basis).unwrap();
    for [x, y] in [[0, 0], [36, 20], [15, 16], [16, 15], [33, 3]] {
        let rows = pixel_rows(&source, [x, y]).unwrap();
        let id = BlockId(y / 16 * 3 + x / 16);
        let rect = source.shape.rect(id);
        let inside = ((y - rect.y) * rect.width + x - rect.x) as usize;
        let exact = source.join(id, 0..1).expand();
        let mut pixel = [0.0; 3];
        for (column, weight) in lighting.weights().iter().enumerate() {
            for channel in 0..3 {
                let entry = exact.view().at(channel * rect.pixels() + inside, column);
                // The same five products in the same order, perhaps fused: a few units of the last place.
                assert!((rows[column][channel] - entry).abs() <= 1e-5, "{x}, {y}, column {column}");
                pixel[channel] += entry * weight[channel];
            }
        }
        let lights = per_light(&basis, &rows, &lighting);
        let scale = lights.iter().map(|v| v.abs()).sum::<f32>();
        assert!((lights.iter().sum::<f32>() - luminance(pixel)).abs() <= 1e-4 * scale, "{x}, {y}: {lights:?}");
    }
}

#[test]
fn a_drag_of_a_hundred_frames_is_undone_at_once_and_gives_the_scenes_picture_again() {
    let (basis, source) = (basis(), factors());
    let mut mix = Mix::of_scene(&basis);
    let mut history = History::new(mix.clone());
    for frame in 0..100 {
        mix.lights[0].stops = frame as f32 * 0.05;
        history.observe(&mix, frame < 99);
    }
    let undone = history.undo().unwrap();
    assert!(!history.can_undo());
    let lighting = undone.lighting(&basis).unwrap();
    assert_eq!(lighting, Lighting::of_scene(&basis));
    let relighter = CpuRelighter::load(&source).unwrap();
    assert_eq!(relighter.relight(&lighting).unwrap(), relighter.relight(&Lighting::of_scene(&basis)).unwrap());
}

/// The formula of a weight takes a dozen roundings in each direction; 2⁻²⁴ each.
fn same_lighting(a: &Lighting, b: &Lighting) {
    let peak = a.weights().iter().flatten().copied().fold(0.0, f32::max);
    for (column, (a, b)) in a.weights().iter().zip(b.weights()).enumerate() {
        for channel in 0..3 {
            let bound = 1e-5 * a[channel].abs() + 1e-7 * peak;
            assert!((a[channel] - b[channel]).abs() <= bound, "column {column}: {a:?} against {b:?}");
        }
    }
}

#[test]
fn a_saved_look_is_what_relight_reads_and_comes_back_as_a_mix() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("evening look.toml");
    let basis = basis();
    let mut mix = mixed(&basis);
    for _ in 0..2 {
        let lighting = mix.lighting(&basis).unwrap();
        looks::save(&path, &basis, &Saved::of(mix.clone()), true).unwrap();
        same_lighting(&lighting, look::load(&path, &basis).unwrap().lighting());
        let read = looks::load(&path, &basis).unwrap().mix;
        same_lighting(&lighting, &read.lighting(&basis).unwrap());
        assert!(
            matches!(read.lights[1].tint, Tint::Kelvin(kelvin) if (kelvin - 3200.0).abs() < 1.0),
            "{:?}",
            read.lights[1]
        );
        assert!(read == mix, "stops of the group, solo, and the turn of the sky are kept");
        // Once more from what was read.
        mix = read;
        mix.toggle_solo(1, true);
        mix.lights[0].on = false;
    }
}

#[test]
fn a_look_that_was_edited_is_read_by_its_rules() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("edited.toml");
    let basis = basis();
    looks::save(&path, &basis, &Saved::of(mixed(&basis)), true).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains("[[mixer.group]]") && text.contains("turn_radians = 0.9"), "{text}");
    // The lamp's own stops and its group's, as the rule has them.
    std::fs::write(&path, text.replacen("stops = 0.79", "stops = 1.79", 1)).unwrap();
    let read = looks::load(&path, &basis).unwrap().mix;
    assert!((read.lights[0].stops - 1.8).abs() < 1e-2 && read.groups.group(0).stops == 0.0, "{:?}", read.lights[0]);
    same_lighting(look::load(&path, &basis).unwrap().lighting(), &read.lighting(&basis).unwrap());
}

#[test]
fn what_is_not_heard_is_off_in_the_rules_and_comes_back_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("solo.toml");
    let basis = basis();
    let mut mix = mixed(&basis);
    mix.toggle_solo(2, false);
    mix.lights[2].tint = Tint::Colour([0.2, 0.0, 0.9]);
    looks::save(&path, &basis, &Saved::of(mix.clone()), true).unwrap();
    let lighting = look::load(&path, &basis).unwrap().lighting().clone();
    same_lighting(&mix.lighting(&basis).unwrap(), &lighting);
    let lit: Vec<usize> = (0..16).filter(|&column| lighting.weights()[column] != [0.0; 3]).collect();
    assert!(lit.iter().all(|column| (2..8).contains(column)), "{lit:?}");
    let mut read = looks::load(&path, &basis).unwrap().mix;
    assert!(read == mix);
    read.toggle_solo(2, false);
    assert!(read.shines(0) && read.lights[1].tint == Tint::Kelvin(3200.0), "what was silent is kept too");
}
