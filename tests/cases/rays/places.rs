//! Scenes far away: the same picture, and reports in the coordinates of the file.

use glam::{DVec3, Vec3};
use ltm::pipeline::job_of;
use ltm::scene::{Camera, LoadedScene, in_file, stated_origin};

use super::files::{Scene, load, quad, rendered};

/// A room with a lamp of each kind, seen at once.
fn room(offset: DVec3) -> LoadedScene {
    let mut scene = Scene::new(offset);
    scene.add("grey", &quad(DVec3::new(-5.0, 0.0, -5.0), 10.0 * DVec3::Z, 10.0 * DVec3::X, 3));
    scene.add("mirror", &quad(DVec3::new(-2.0, 0.5, -3.0), 4.0 * DVec3::X, 2.0 * DVec3::Y, 1));
    scene.add("lamp", &quad(DVec3::new(-0.25, 3.0, -0.25), 0.5 * DVec3::X, 0.5 * DVec3::Z, 1));
    let more = format!(
        "[[light]]\nmaterial = \"lamp\"\ntexels = [2, 2]\n\
        [[light]]\nkind = \"panel\"\norigin = {}\nedge_u = [0.5, 0, 0]\nedge_v = [0, 0, 0.5]\nfaces = [0, -1, 0]\n\
        texels = [2, 1]\n[[light]]\nkind = \"spot\"\nposition = {}\n",
        scene.place(DVec3::new(1.5, 2.5, 0.5)),
        scene.place(DVec3::new(-1.5, 2.5, 0.25)),
    );
    scene.load((DVec3::new(0.5, 1.75, 4.0), DVec3::new(0.0, 0.5, -1.0)), 60.0, 24, &more)
}

/// Of halves and quarters far away nothing is lost in f64: the same bytes.
pub(super) fn survey() {
    let here = room(DVec3::ZERO);
    let right = rendered(&here, 16, 5);
    assert!(right.pixels.iter().filter(|pixel| pixel[0] > 0.0).count() > 150);
    for offset in
        [DVec3::new(691_000.0, 0.0, 5_335_000.0), DVec3::new(-20_000.0, 4_000.0, 300.0), DVec3::new(0.0, 5e8, 0.0)]
    {
        let there = room(offset);
        assert_eq!(there.scene.origin, offset);
        assert_eq!(there.content, here.content, "{offset}");
        assert_eq!(rendered(&there, 16, 5).pixels, right.pixels, "{offset}");
    }
}

/// Two nodes with places of their own in survey coordinates, 0.3 apart, which is less than f32 tells apart there.
pub(super) fn gltf_nodes() {
    let folder = tempfile::tempdir().unwrap();
    let text = |x: f64, z: f64| {
        let node =
            |name: &str, dx: f64| format!(r#"{{"name":"{name}","mesh":0,"translation":[{:?},0,{z:?}]}}"#, x + dx);
        // A triangle, as three positions in base64: (0,0,0), (1,0,0), (0,0,-1).
        let data = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAAAAAAIC/";
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0,1]}}],"nodes":[{},{}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"material":0}}]}}],
            "materials":[{{"emissiveFactor":[1,1,1]}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,-1],"max":[1,0,0]}}],
            "bufferViews":[{{"buffer":0,"byteLength":36}}],
            "buffers":[{{"byteLength":36,"uri":"data:application/octet-stream;base64,{data}"}}]}}"#,
            node("a", 0.125),
            node("b", 0.375),
        )
    };
    let read = |name: &str, x: f64, z: f64| {
        let path = folder.path().join(name);
        std::fs::write(&path, text(x, z)).unwrap();
        load(&path).scene
    };
    let (near, far) = (read("near.gltf", 0.0, 0.0), read("far.gltf", 691_000.0, 5_335_000.0));
    assert_eq!(far.origin, DVec3::new(691_000.0, 0.0, 5_335_000.0));
    assert_eq!(near.mesh.vertices, far.mesh.vertices);
    let first = |node: usize| far.mesh.corners(&far.mesh.triangles[node])[0];
    assert_eq!((first(0), first(1)), (Vec3::X * 0.125, Vec3::X * 0.375));
}

/// The origin and the places from there are the file's places, and the words of a job say where its camera stood.
pub(super) fn reports() {
    let offset = DVec3::new(691_000.237, 0.0, 5_335_000.137);
    let loaded = room(offset);
    let scene = &loaded.scene;
    assert_eq!(scene.origin, DVec3::new(691_000.0, 0.0, 5_335_000.0));
    let light = scene.basis.find("spot").unwrap();
    let place = in_file(scene.origin, Vec3::from(light.places[0]));
    assert!((place - (offset + DVec3::new(-1.5, 2.5, 0.25))).length() < 1e-6, "{place}");
    let job = job_of(&loaded).unwrap();
    let settings = &job.provenance.settings;
    assert!(settings.contains("eye = [691000.737, 1.75, 5335004.137]"), "{settings}");
    assert_eq!(stated_origin(settings), scene.origin);
    let camera = Camera::of_words(settings, (24, 24)).unwrap();
    assert_eq!(camera.eye, scene.camera.eye);
    // Where a camera that looks at the lamp sees it does not depend on where the room stands.
    let towards = |loaded: &LoadedScene| {
        let settings = job_of(loaded).unwrap().provenance.settings;
        let camera = Camera::of_words(&settings, (24, 24)).unwrap();
        let light = loaded.scene.basis.find("spot").unwrap().places[0];
        camera.position((Vec3::from(light) - camera.eye).normalize()).unwrap()
    };
    assert!(towards(&loaded).distance(towards(&room(DVec3::ZERO))) < 1e-3);
}

/// Their bytes, their words and their hashes are those of coordinates as they are written.
pub(super) fn near_zero() {
    for offset in [DVec3::ZERO, DVec3::new(12.5, -3.0, 30.25)] {
        let loaded = room(offset);
        assert_eq!(loaded.scene.origin, DVec3::ZERO);
        let corner = loaded.scene.mesh.vertices[0].position;
        assert_eq!(corner, (offset + DVec3::new(-5.0, 0.0, -5.0)).as_vec3());
        let words = job_of(&loaded).unwrap().provenance.settings;
        assert!(!words.contains("origin"), "{words}");
    }
}
