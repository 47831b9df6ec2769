//! Cameras of scene files and of glTF files.

use glam::{Vec2, Vec3};
use ltm::scene::{BuiltIn, Camera, Lens, LoadOptions, Projection, survey};
use serde_json::json;

use super::{Folder, glb, room};

pub(super) const TESTS: &[(&str, fn())] = &[
    ("cameras_are_as_the_scene_file_says", cameras_are_as_the_scene_file_says),
    ("cameras_that_contradict_themselves_are_refused", contradictions),
    ("what_a_camera_has_beyond_the_plain_is_content", what_a_camera_has_is_content),
    ("orthographic_cameras_of_gltf_are_read", orthographic_cameras_of_gltf),
    ("lights_are_hidden_from_the_camera", lights_are_hidden),
];

fn with(camera: &str) -> Folder {
    facing("[0, -1, -1]", camera)
}

fn facing(direction: &str, camera: &str) -> Folder {
    let text = format!("geometry = [\"room.obj\"]\n[camera]\neye = [0, 1, 4]\ndirection = {direction}\n{camera}\n");
    room("").with("scene.toml", text)
}

fn camera(text: &str) -> Camera {
    survey(&facing("[0, 0, -1]", text).path("scene.toml"), &LoadOptions::default()).unwrap().scene.camera
}

fn cameras_are_as_the_scene_file_says() {
    let flat = camera("projection = \"orthographic\"\nview_height = 3\nshift = [0.25, 0]\nwidth = 40\nheight = 30");
    assert_eq!((flat.projection, flat.shift), (Projection::Orthographic { height: 3.0 }, Vec2::new(0.25, 0.0)));
    // Of 4 × 3, the middle lies 1 to the right.
    assert_eq!(flat.ray(Vec2::new(20.0, 15.0)), (Vec3::new(1.0, 1.0, 4.0), Vec3::NEG_Z));
    let around = camera("projection = \"panorama\"");
    assert_eq!((around.projection, around.width, around.height), (Projection::Panorama, 960, 480));
    assert!((around.direction(Vec2::new(720.0, 240.0)) - Vec3::X).length() < 1e-6);
    let lens =
        camera("aperture_radius = 0.0125\nfocus_distance = 3.5\nblades = 6\nblade_rotation_degrees = 90").lens.unwrap();
    let wanted = Lens { radius: 0.0125, focus_distance: 3.5, blades: 6, rotation_radians: std::f32::consts::FRAC_PI_2 };
    assert_eq!(lens, wanted);
    assert_eq!(camera("aperture_radius = 0\nfocus_distance = 3").lens, None);
    assert_eq!(camera("pixel_aspect = 1.5").pixel_aspect, 1.5);
}

fn contradictions() {
    for (text, word) in [
        ("projection = \"orthographic\"", "view_height"),
        ("view_height = 2", "orthographic"),
        ("projection = \"orthographic\"\nview_height = 2\nvertical_fov_degrees = 40", "vertical_fov_degrees"),
        ("projection = \"orthographic\"\nview_height = 0", "above 0"),
        ("projection = \"orthographic\"\nview_height = nan", "above 0"),
        ("projection = \"panorama\"\nvertical_fov_degrees = 40", "vertical_fov_degrees"),
        ("projection = \"panorama\"\nshift = [0.1, 0]", "panorama"),
        ("projection = \"panorama\"\naperture_radius = 0.1\nfocus_distance = 1", "panorama"),
        ("projection = \"fisheye\"", "panorama"),
        ("shift = [inf, 0]", "shift"),
        ("pixel_aspect = 0", "pixels"),
        ("aperture_radius = 0.1", "focus_distance"),
        ("focus_distance = 1", "aperture_radius"),
        ("aperture_radius = -0.1\nfocus_distance = 1", "above 0"),
        ("aperture_radius = 0.1\nfocus_distance = inf", "above 0"),
        ("aperture_radius = 0.1\nfocus_distance = 1\nblades = 2", "blades"),
    ] {
        let error = with(text).load().unwrap_err().to_string();
        assert!(error.contains(word) && error.contains("scene.toml") && !error.contains('\n'), "{text}: {error}");
    }
    // An orthographic view that looks past the room, and one whose plane lies behind it.
    let far = with("projection = \"orthographic\"\nview_height = 2\nshift = [0, 20]").load().unwrap_err().to_string();
    assert!(far.contains("sees nothing"), "{far}");
}

fn what_a_camera_has_is_content() {
    let content = |text: &str| with(text).load().unwrap().content;
    let lens = "aperture_radius = 0.1\nfocus_distance = 2";
    let all = [
        content(""),
        content("projection = \"panorama\"\nwidth = 640\nheight = 480"),
        content("projection = \"orthographic\"\nview_height = 2"),
        content("shift = [0.1, 0]"),
        content("shift = [0, 0.1]"),
        content("pixel_aspect = 1.1"),
        content(lens),
        content(&format!("{lens}\nblades = 5")),
        content(&format!("{lens}\nblades = 5\nblade_rotation_degrees = 1")),
    ];
    for (i, one) in all.iter().enumerate() {
        assert!(all[..i].iter().all(|other| other != one), "{i}");
    }
    // Plain cameras keep the identity that matrices of earlier versions name.
    let built_in = BuiltIn { width: 32, height: 24, texels: 4 }.named("mixed").unwrap();
    assert_eq!(built_in.content[..8], [86, 218, 131, 119, 41, 219, 240, 19]);
}

fn orthographic_cameras_of_gltf() {
    // What it sees of the room, a floor and a lamp seen along their planes, does not matter here.
    let with = |lens: serde_json::Value| {
        let mut file = glb::room();
        file.json["cameras"][0] = json!({ "type": "orthographic", "orthographic": lens });
        let folder = Folder::new().with("room.glb", file.to_glb());
        survey(&folder.path("room.glb"), &LoadOptions::default()).unwrap()
    };
    let loaded = with(json!({ "xmag": 3.0, "ymag": 2.0, "znear": 0.1, "zfar": 100.0 }));
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let camera = loaded.scene.camera;
    assert_eq!((camera.projection, camera.width, camera.height), (Projection::Orthographic { height: 4.0 }, 720, 480));
    // xmag and ymag are half the width and half the height (glTF 2.0, §3.10.3).
    let (corner, direction) = camera.ray(Vec2::ZERO);
    assert!((corner - Vec3::new(-3.0, 3.0, 4.0)).length() < 1e-5 && direction == Vec3::NEG_Z, "{corner} {direction}");
    for bad in [json!({}), json!({ "xmag": 0.0, "ymag": 1.0 }), json!({ "xmag": 1.0, "ymag": "wide" })] {
        let loaded = with(bad);
        let text = &loaded.warnings[0].text;
        assert!(text.contains("camera 'eye'") && text.contains("size of what it sees"), "{text}");
    }
}

fn lights_are_hidden() {
    let sky = "[[light]]\nkind = \"environment\"\ntexels = [2, 1]\n";
    let spot = "[[light]]\nkind = \"spot\"\nposition = [0, 2, 0]\nradius = 0.1\ncamera = false\n";
    let hidden = room(&format!("[[light]]\ncamera = false\n{sky}{spot}")).load().unwrap();
    assert_eq!(hidden.scene.unseen_lights, [0, 2]);
    let seen = room(&format!("[[light]]\ncamera = true\n{sky}{}", spot.replace("camera = false", ""))).load().unwrap();
    assert!(seen.scene.unseen_lights.is_empty());
    assert_ne!(hidden.content, seen.content);
    let sky_too = room(&format!("[[light]]\ncamera = false\n{sky}camera = false\n{spot}")).load().unwrap();
    assert_eq!(sky_too.scene.unseen_lights, [0, 1, 2]);
    assert_ne!(hidden.content, sky_too.content);
    let refused = room(&spot.replace("false", "true")).load().unwrap_err().to_string();
    assert!(refused.contains("light 1 \"spot\"") || refused.contains("light 1"), "{refused}");
    assert!(refused.contains("not seen by the camera"), "{refused}");
    // The lamp is all that this camera has before it.
    let facing = |more: &str| {
        let text = "geometry = [\"room.obj\"]\n[camera]\neye = [0, 2.5, 0.5]\ndirection = [0, 1, 0]\nup = [0, 0, 1]\n";
        room("").with("scene.toml", format!("{text}vertical_fov_degrees = 20\n[[light]]\n{more}\n")).load()
    };
    assert!(facing("").is_ok());
    let blind = facing("camera = false").unwrap_err().to_string();
    assert!(blind.contains("sees nothing"), "{blind}");
}
