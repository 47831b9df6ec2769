# SPDX-License-Identifier: GPL-3.0-or-later
"""Light groups of scene files that Cycles renders, cleaned by `ltm-pack --clean-to`, beside Open Image Denoise on each group; and the
correlation of the noise of neighbouring pixels.

    pip install bpy==4.2.0 numpy OpenEXR pyoidn flip-evaluator      # Python 3.11
    cargo build --release -p ltm-cli
    python tools/blender/measure_corpus_groups.py --ltm target/release --corpus FOLDER --renders KEPT kitchen bathroom

Each scene is a folder with a `scene.toml` of OBJ or glTF files; 160 × 120 pixels, a light group for each light, Blender's own settings but for
the samples, which all pixels have alike: 16 and 64, once or twice half of them with two seeds; the reference has 512. Images are compared as
in `measure_light_groups.py`.
"""

import argparse
import subprocess
import tempfile
import tomllib
from math import pi, radians
from pathlib import Path

import bpy
import numpy as np
import pyoidn
from mathutils import Matrix, Vector

from measure_light_groups import layers, measure

WIDTH, HEIGHT, REFERENCE = 160, 120, 512
RENDERS = [("once16", 16, 1), ("first16", 8, 2), ("second16", 8, 3), ("once64", 64, 4), ("first64", 32, 5), ("second64", 32, 6)]
# A sun of the scene files is a radiance over its disc's share; Blender's is dimmer by this, so that it does not drown the lamps.
SUN = 0.2
STEPS = {"right": (1, 0), "below": (0, 1), "diagonal": (1, 1), "two to the right": (2, 0)}


def axes(v):
    """A vector of glTF's axes in those of Blender."""
    return Vector((v[0], -v[2], v[1]))


def towards(direction):
    return Vector(direction).normalized().to_track_quat("-Z", "Y")


def load(folder):
    """The scene of a folder as Blender's open scene."""
    tree = tomllib.loads((folder / "scene.toml").read_text(encoding="utf-8"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene, layer = bpy.context.scene, bpy.context.view_layer
    files = tree["geometry"] if isinstance(tree["geometry"], list) else [tree["geometry"]]
    for file in (folder / name for name in files):
        bpy.ops.wm.obj_import(filepath=str(file)) if file.suffix == ".obj" else bpy.ops.import_scene.gltf(filepath=str(file))
    for thing in [thing for thing in scene.objects if thing.type in {"LIGHT", "CAMERA"}]:
        bpy.data.objects.remove(thing)
    unit = tree.get("metres_per_unit", 1.0)
    for thing in scene.objects:
        if thing.parent is None and unit != 1.0:
            thing.matrix_world = Matrix.Scale(unit, 4) @ thing.matrix_world
    for light in tree["light"]:
        layer.lightgroups.add(name=light["name"])
        add_light(scene, light).lightgroup = light["name"]
    view = tree["camera"]
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.sensor_fit, camera.data.angle_y = "VERTICAL", radians(view["vertical_fov_degrees"])
    camera.location, camera.rotation_mode = axes(view["eye"]), "QUATERNION"
    camera.rotation_quaternion = towards(axes(view["look_at"]) - axes(view["eye"]))
    scene.collection.objects.link(camera)
    scene.camera, scene.render.engine = camera, "CYCLES"
    scene.cycles.device, scene.cycles.use_denoising, scene.cycles.use_adaptive_sampling = "CPU", False, False
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    layer.cycles.denoising_store_passes = True
    settings = scene.render.image_settings
    settings.file_format, settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
    return scene


def add_light(scene, light):
    """Blender's light or world for an entry of a scene file."""
    name, kind, emission = light["name"], light["kind"], light["emission"]
    strongest = max(emission)
    colour = [value / strongest for value in emission]
    if kind == "environment":
        scene.world = bpy.data.worlds.new(name)
        scene.world.use_nodes = True
        inputs = scene.world.node_tree.nodes["Background"].inputs
        inputs["Color"].default_value, inputs["Strength"].default_value = (*colour, 1.0), strongest
        return scene.world
    data = bpy.data.lights.new(name, {"panel": "AREA"}.get(kind, kind.upper()))
    thing = bpy.data.objects.new(name, data)
    data.color, thing.rotation_mode = colour, "QUATERNION"
    if kind == "panel":
        across, along = axes(light["edge_u"]), axes(light["edge_v"])
        data.shape, data.size, data.size_y = "RECTANGLE", across.length, along.length
        data.energy = pi * across.length * along.length * strongest
        faces = axes(light["faces"]) if "faces" in light else across.cross(along)
        back, side = -faces.normalized(), across.normalized()
        thing.location = axes(light["origin"]) + (across + along) / 2
        thing.rotation_quaternion = Matrix((side, back.cross(side), back)).transposed().to_quaternion()
    elif kind == "sun":
        data.energy, data.angle = SUN * strongest, 0.01
        thing.rotation_quaternion = towards(-axes(light["towards"]))
    else:
        data.energy, data.shadow_soft_size = 4 * pi * strongest, light.get("radius", 0.03)
        thing.location = axes(light["position"])
        if kind == "spot":
            data.spot_size, data.spot_blend = 2 * radians(light["outer_degrees"]), 0.3
            thing.rotation_quaternion = towards(axes(light["direction"]))
    scene.collection.objects.link(thing)
    return thing


def render(folder, renders):
    """Renders what is not there of a scene."""
    missing = [r for r in [*RENDERS, ("reference", REFERENCE, 9)] if not (renders / f"{folder.name}-{r[0]}.exr").is_file()]
    scene = load(folder) if missing else None
    for name, samples, seed in missing:
        scene.cycles.samples, scene.cycles.seed = samples, seed
        scene.render.filepath = str(renders / f"{folder.name}-{name}.exr")
        bpy.ops.render.render(write_still=True)


def correlations(first, second):
    """Of the noise of neighbouring pixels, from two renderings of a light."""
    noise = (first - second).mean(axis=-1)
    noise = np.clip(noise / (np.median(np.abs(noise)) + 1e-12), -3, 3)
    rows, columns = noise.shape
    power = np.mean(noise * noise)
    return {name: np.mean(noise[: rows - y, : columns - x] * noise[y:, x:]) / power for name, (x, y) in STEPS.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ltm", type=Path, default=Path("target/release"), help="the folder of ltm-pack")
    parser.add_argument("--corpus", type=Path, required=True, help="the folder of the scenes' folders")
    parser.add_argument("--renders", type=Path, required=True, help="where renders are kept between runs")
    parser.add_argument("scenes", nargs="+")
    options = parser.parse_args()
    options.renders.mkdir(parents=True, exist_ok=True)
    for name in options.scenes:
        render(options.corpus / name, options.renders)
        at = {of: options.renders / f"{name}-{of}.exr" for of in [render[0] for render in RENDERS] + ["reference"]}
        reference = layers(at["reference"])
        for samples in (16, 64):
            once = layers(at[f"once{samples}"])
            lamps = [light for light in once if not light.startswith("ViewLayer")]
            albedo = once["ViewLayer.Denoising Albedo"]
            normal = np.ascontiguousarray(np.dstack([once[f"ViewLayer.Denoising Normal.{axis}"] for axis in "XYZ"]))
            halves = [at[f"{half}{samples}"] for half in ("first", "second")]
            ways = {"denoiser on each group": {lamp: pyoidn.denoise(once[lamp], albedo, normal, hdr=True) for lamp in lamps}}
            for way, inputs in {"--second": [halves[0], "--second", halves[1]], "--estimate-noise": [at[f"once{samples}"]]}.items():
                with tempfile.TemporaryDirectory() as folder:
                    clean = Path(folder) / "clean.exr"
                    command = [options.ltm.resolve() / "ltm-pack", *inputs, "--clean-to", clean]
                    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
                    ways[way] = layers(clean)
            least = None
            for way, images in ways.items():
                pairs = [(images[lamp], reference[lamp]) for lamp in lamps]
                pairs.append(tuple(sum(each) for each in zip(*pairs)))
                flip, clip = (np.mean(values) for values in zip(*(measure(*pair) for pair in pairs)))
                least = least or (flip, clip)
                told = f"FLIP {flip:.4f}, {flip / least[0]:.3f} of the denoiser's; clip {clip:.2f} dB, {clip - least[1]:+.2f}"
                print(f"{name:12} {samples:3} samples {way:24} {told}", flush=True)
            first, second = map(layers, halves)
            found = [correlations(first[lamp], second[lamp]) for lamp in lamps]
            ranges = [f"{step} {min(f[step] for f in found):+.3f} to {max(f[step] for f in found):+.3f}" for step in STEPS]
            print(f"{name:12} {samples:3} samples noise of neighbours: {', '.join(ranges)}", flush=True)


if __name__ == "__main__":
    main()
