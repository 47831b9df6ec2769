# SPDX-License-Identifier: GPL-3.0-or-later
"""What `ltm-pack` makes of light groups that Cycles rendered, beside Intel's Open Image Denoise on each group.

    pip install bpy==4.2.0 numpy OpenEXR pyoidn flip-evaluator      # Python 3.11
    cargo build --release -p ltm-cli && python tools/blender/measure_light_groups.py --ltm target/release --out light-groups.csv

Two rooms with five lamps, 256 × 192 pixels, Blender's own settings but for the samples, which all pixels have alike. 64 samples: once, or
twice 32 with two seeds; the reference has 1,024 and another seed, and noise of its own. Images of each lamp alone and of all together,
exposed to the reference's 95th luminance percentile; clip is PSNR in dB after clipping to [0, 1], FLIP is taken after a tone curve
(extended Reinhard, white at 4, times 1.6) and sRGB, at 67 pixels a degree. The constant of `--estimate-noise` was chosen on `lounge`;
`gallery` took no part.
"""

import argparse
import csv
import math
import os
import platform
import subprocess
import tempfile
from pathlib import Path

import bpy
import flip_evaluator
import numpy as np
import OpenEXR
import pyoidn

WIDTH, HEIGHT = 256, 192
ROOMS = ["lounge", "gallery"]
RENDERS = [("once", 64, 1), ("first", 32, 2), ("second", 32, 3), ("reference", 1024, 9)]
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)


def material(name, colour, roughness=0.8, metallic=0.0, pattern=None, scale=0.0):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    surface = made.node_tree.nodes["Principled BSDF"].inputs
    surface["Base Color"].default_value = (*colour, 1.0)
    surface["Roughness"].default_value = roughness
    surface["Metallic"].default_value = metallic
    if pattern:
        texture = made.node_tree.nodes.new(pattern)
        texture.inputs["Scale"].default_value = scale
        made.node_tree.links.new(texture.outputs[0], surface["Base Color"])
    return made


def put(make, of, is_smooth=False, **where):
    make(**where)
    thing = bpy.context.object
    thing.data.materials.append(of)
    if is_smooth:
        bpy.ops.object.shade_smooth()
    return thing


def lamp(scene, name, kind, energy, location, rotation=(0.0, 0.0, 0.0), **settings):
    data = bpy.data.lights.new(name, kind)
    data.energy = energy
    for key, value in settings.items():
        setattr(data, key, value)
    thing = bpy.data.objects.new(name, data)
    thing.location, thing.rotation_euler, thing.lightgroup = location, rotation, name
    scene.collection.objects.link(thing)
    scene.view_layers[0].lightgroups.add(name=name)


def furnish(room):
    """A room of the given name, its lamps and its camera, as the open scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.use_denoising, scene.cycles.use_adaptive_sampling = "CPU", False, False
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    is_lounge = room == "lounge"
    white, red = material("white", (0.8, 0.8, 0.78)), material("red", (0.7, 0.15, 0.1))
    metal, glossy = material("metal", (0.9, 0.7, 0.4), 0.25, 1.0), material("glossy", (0.2, 0.3, 0.7), 0.2)
    pattern = ("ShaderNodeTexChecker", 12.0) if is_lounge else ("ShaderNodeTexBrick", 6.0)
    floor = material("floor", (0.5, 0.5, 0.5), 0.5, 0.0, *pattern)
    mesh, quarter = bpy.ops.mesh, math.pi / 2
    put(mesh.primitive_plane_add, floor, size=6)
    put(mesh.primitive_plane_add, white, size=6, location=(0, 3, 3), rotation=(quarter, 0, 0))
    put(mesh.primitive_plane_add, red, size=6, location=(-3, 0, 3), rotation=(0, quarter, 0))
    put(mesh.primitive_plane_add, white, size=6, location=(3, 0, 3), rotation=(0, -quarter, 0))
    put(mesh.primitive_plane_add, white, size=6, location=(0, 0, 4 if is_lounge else 5), rotation=(2 * quarter, 0, 0))
    if is_lounge:
        put(mesh.primitive_cube_add, white, size=1.2, location=(-1.2, 0.8, 0.6), rotation=(0, 0, 0.4))
        put(mesh.primitive_uv_sphere_add, metal, True, radius=0.6, location=(0.9, 0.2, 0.6), segments=48, ring_count=24)
        put(mesh.primitive_monkey_add, glossy, True, size=1.2, location=(0.2, 1.4, 0.9), rotation=(0, 0, 0.3))
    else:
        for i, of in enumerate([white, glossy, metal, red, white]):
            thing = put(mesh.primitive_cube_add, of, size=0.5, location=(i - 2, 1.2, 0.25 * (1 + 0.5 * i)))
            thing.scale = (1, 1, 1 + 0.5 * i)
        put(mesh.primitive_torus_add, glossy, True, location=(0, -0.3, 0.35), major_radius=0.7, minor_radius=0.25)
    lamp(scene, "ceiling", "AREA", 120, (0, 0, 3.9), size=1.2)
    lamp(scene, "spot", "SPOT", 400, (-1.5, -1.5, 3.5), (0.5, -0.4, 0), spot_size=0.9, spot_blend=0.2, shadow_soft_size=0.05)
    lamp(scene, "lamp", "POINT", 60, (2, 1.5, 1.2), shadow_soft_size=0.08, color=(1, 0.7, 0.4))
    lamp(scene, "wall", "AREA", 60, (-2.8, 1, 2), (0, -quarter, 0), shape="RECTANGLE", size=0.3, size_y=2, color=(0.5, 0.7, 1))
    lamp(scene, "bulb", "POINT", 25, (-0.3, -0.8, 1.8), shadow_soft_size=0.03)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location, camera.rotation_euler, camera.data.lens = (0, -6.5, 2), (math.radians(86), 0, 0), 35
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.view_layers[0].cycles.denoising_store_passes = True
    settings = scene.render.image_settings
    settings.file_format, settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
    return scene


def layers(path):
    """The pixels of each layer of an OpenEXR file; light groups by their names."""
    found = {}
    for name, channel in OpenEXR.File(str(path)).channels().items():
        pixels = np.ascontiguousarray(channel.pixels[..., :3] if channel.pixels.ndim == 3 else channel.pixels)
        found[name.split("Combined_")[-1]] = pixels
    return found


def packed(program, folder, name, *arguments):
    """What a container of these images shows, and its size in bytes."""
    container, images = folder / f"{name}.ltc", folder / f"{name}.exr"
    subprocess.run([program / "ltm-pack", *arguments, "-o", container], check=True, stdout=subprocess.DEVNULL)
    subprocess.run([program / "ltm-unpack", container, "-o", images], check=True, stdout=subprocess.DEVNULL)
    return layers(images), container.stat().st_size


def measure(image, reference):
    """FLIP, and PSNR clip in dB."""
    exposure = 1.0 / max(float(np.percentile(reference @ LUMINANCE, 95)), 1e-12)
    clipped = [np.clip(v * exposure, 0, 1) for v in (image, reference)]
    psnr = -10 * math.log10(max(float(np.mean((clipped[0] - clipped[1]) ** 2)), 1e-30))

    def shown(linear):
        c = np.maximum(linear * exposure, 0)
        c = np.clip(c * (1 + c / 16) / (1 + c) * 1.6, 0, 1)
        return np.where(c <= 0.0031308, 12.92 * c, 1.055 * np.power(np.maximum(c, 1e-9), 1 / 2.4) - 0.055).astype(np.float32)

    flip = flip_evaluator.evaluate(shown(reference), shown(image), "LDR", applyMagma=False, computeMeanError=True)[1]
    return flip, psnr


def write_header(out, about, script, settings=""):
    """The lines that begin a CSV file: what it is, what made it, on which machine, and of which commit, the one that is checked out."""
    out.write(f"# {about}\n")
    out.write(f"# Command: `python tools/blender/{script}`; its text says what the columns are\n")
    out.write(f"# Machine: {platform.machine()}, {os.cpu_count()} threads; Blender {bpy.app.version_string}{settings}\n")
    asked = ["git", "rev-parse", "--short=10", "HEAD"]
    said = subprocess.run(asked, cwd=Path(__file__).parent, capture_output=True, text=True, check=False)
    out.write(f"# Built from commit {said.stdout.strip() or 'unknown'}.\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ltm", type=Path, default=Path("target/release"), help="the folder of ltm-pack and ltm-unpack")
    parser.add_argument("--out", type=Path, default=Path("light-groups.csv"))
    parser.add_argument("--renders", type=Path, help="where renders are kept between runs")
    options = parser.parse_args()
    program = options.ltm.resolve()
    with tempfile.TemporaryDirectory() as temporary, open(options.out, "w", newline="") as out:
        about = "Light groups of Cycles, cleaned for all lights at once, beside a denoiser on each group"
        write_header(out, about, "measure_light_groups.py")
        table = csv.writer(out, lineterminator="\n")
        table.writerow(["room", "method", "bytes", "flip", "flip_worst", "psnr_clip_db", "psnr_clip_worst_db"])
        renders = options.renders or Path(temporary)
        renders.mkdir(parents=True, exist_ok=True)
        for room in ROOMS:
            scene = furnish(room)
            paths = {}
            for name, samples, seed in RENDERS:
                paths[name] = renders / f"{room}-{name}.exr"
                if not paths[name].exists():
                    scene.cycles.samples, scene.cycles.seed = samples, seed
                    scene.render.filepath = str(paths[name])
                    bpy.ops.render.render(write_still=True)
            reference, once = layers(paths["reference"]), layers(paths["once"])
            albedo = once["ViewLayer.Denoising Albedo"]
            normal = np.ascontiguousarray(np.dstack([once[f"ViewLayer.Denoising Normal.{axis}"] for axis in "XYZ"]))
            lamps = [light.name for light in scene.view_layers[0].lightgroups]
            denoised = {name: pyoidn.denoise(once[name], albedo, normal, hdr=True) for name in lamps}
            folder = Path(temporary) / room
            folder.mkdir()
            ways = {
                "rendered twice, --second": packed(program, folder, "twice", paths["first"], "--second", paths["second"]),
                "rendered once, --estimate-noise": packed(program, folder, "once", paths["once"], "--estimate-noise"),
                "rendered once, not cleaned": packed(program, folder, "raw", paths["once"]),
                "denoiser on each group": (denoised, ""),
                "as rendered": (once, ""),
            }
            for way, (images, size) in ways.items():
                pairs = [(images[name], reference[name]) for name in lamps]
                pairs.append(tuple(sum(each) for each in zip(*pairs)))
                flips, psnrs = zip(*(measure(image, truth) for image, truth in pairs))
                row = [np.mean(flips), max(flips), np.mean(psnrs), min(psnrs)]
                table.writerow([room, way, size, *(f"{value:.4f}" for value in row)])
                print(f"{room:8} {way:32} FLIP {row[0]:.4f}, worst {row[1]:.4f}; clip {row[2]:.2f} dB, worst {row[3]:.2f}")


if __name__ == "__main__":
    main()
