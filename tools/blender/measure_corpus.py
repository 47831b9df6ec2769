# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes that others made, by us and by Cycles from the same files: every light alone and all together.

    pip install bpy==4.2.0 'numpy<2' OpenEXR pyoidn flip-evaluator pillow      # Python 3.11
    cargo build --release -p ltm-cli && python tools/blender/measure_corpus.py CORPUS --ltm target/release --out cycles.csv

CORPUS is a folder of scenes, each a folder with a `scene.toml`, or with one glTF file that has its own camera and lights. Cycles gets the
files by Blender's own importers (`mend` says what is changed in them), and camera and lights of the scene file: panels are rectangles that emit on one side, points, spots and
suns are Blender's, and what no `[[light]]` chooses does not emit. Cycles renders all lights at once as light groups, without clamping,
filtered gloss or a bound of bounces that matters, and Open Image Denoise cleans each group with albedo and normals; ours is the container
of `ltm render --pack --target 80dB`. Images are exposed to the 95th percentile of Cycles' luminance and judged as in `measure_light_groups.py`.

A row of the CSV file is one light of a scene, or all: `ratio` is our mean over that of Cycles' image as it was rendered, of linear values;
`flip` the mean FLIP; `noise` the FLIP between Cycles' image as rendered and cleaned. `--montages` names a folder of pictures: ours, Cycles, FLIP.
"""

import argparse
import csv
import fnmatch
import math
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import bpy  # It brings bmesh and mathutils.
import bmesh
import flip_evaluator
import numpy as np
import pyoidn
from mathutils import Matrix, Vector
from PIL import Image

from measure_light_groups import LUMINANCE, layers, measure, write_header


def axes(vector):
    """A vector of a scene file, whose up is +y, in Blender's axes."""
    x, y, z = vector
    return Vector((x, -z, y))


def looking(direction, up):
    """The turn of a camera or lamp, which looks along its own −z, towards `direction`."""
    back = -axes(direction).normalized()
    right = axes(up).cross(back)
    right = (right if right.length > 1e-6 else back.orthogonal()).normalized()
    return Matrix((right, back.cross(right), back)).transposed().to_4x4()


def link(name, data, matrix, group=None):
    thing = bpy.data.objects.new(name, data)
    thing.matrix_world = matrix
    bpy.context.scene.collection.objects.link(thing)
    if group:
        join_group(thing, group)
    return thing


def join_group(thing, name):
    groups = bpy.context.view_layer.lightgroups
    if name not in groups:
        groups.add(name=name)
    thing.lightgroup = name


def read_geometry(path):
    if path.suffix == ".obj":
        before = set(bpy.data.meshes)
        bpy.ops.wm.obj_import(filepath=str(path))
        # Without normals and smoothing groups faces are flat, by the format's text; Blender smooths them.
        if not any(line.startswith((b"s ", b"vn ")) for line in path.read_bytes().splitlines()):
            for mesh in set(bpy.data.meshes) - before:
                mesh.shade_flat()
    else:
        bpy.ops.import_scene.gltf(filepath=str(path))


def mend():
    """What makes surfaces black or magenta in Cycles, mended: missing images, normals on the other side of their faces, and faces that lie
    on one another, which shadow each other there."""
    for material in (material for material in bpy.data.materials if material.use_nodes):
        for node in [node for node in material.node_tree.nodes if node.type == "TEX_IMAGE"]:
            if node.image and not node.image.size[0]:
                material.node_tree.nodes.remove(node)
    for mesh in (mesh for mesh in bpy.data.meshes if mesh.has_custom_normals):
        normals = np.zeros((len(mesh.loops), 3), np.float32)
        mesh.corner_normals.foreach_get("vector", normals.ravel())
        faces, counts = np.zeros((len(mesh.polygons), 3), np.float32), np.zeros(len(mesh.polygons), np.int32)
        mesh.polygons.foreach_get("normal", faces.ravel())
        mesh.polygons.foreach_get("loop_total", counts)
        of_face = np.repeat(np.arange(len(counts)), counts)
        agreement = np.bincount(of_face, (normals * faces[of_face]).sum(axis=1), len(counts))
        if (agreement < 0).any():
            normals[(agreement < 0)[of_face]] *= -1
            mesh.normals_split_custom_set(normals.tolist())
    for mesh in bpy.data.meshes:
        drop_doubles(mesh)


def drop_doubles(mesh):
    """Keeps one of several faces with the same corners."""
    corners = np.zeros((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", corners.ravel())
    places = np.unique(corners, axis=0, return_inverse=True)[1].ravel()
    seen, doubles = set(), []
    for face in mesh.polygons:
        key = frozenset(places[list(face.vertices)].tolist())
        if key in seen:
            doubles.append(face.index)
        seen.add(key)
    if doubles:
        edited = bmesh.new()
        edited.from_mesh(mesh)
        edited.faces.ensure_lookup_table()
        bmesh.ops.delete(edited, geom=[edited.faces[index] for index in doubles], context="FACES_ONLY")
        edited.to_mesh(mesh)
        edited.free()


def add_camera(entry):
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit, camera.angle = "VERTICAL", math.radians(entry.get("vertical_fov_degrees", 45))
    eye = Vector(entry["eye"])
    direction = entry.get("direction") or Vector(entry["look_at"]) - eye
    place = Matrix.Translation(axes(eye)) @ looking(direction, entry.get("up", (0, 1, 0)))
    bpy.context.scene.camera = link("camera", camera, place)


def strength_of(rgb):
    """A colour of at most 1, and the strength that goes with it."""
    strength = max(max(rgb), 1e-9)
    return [c / strength for c in rgb], strength


def add_lamp(kind, name, entry, matrix, watts, **settings):
    lamp = bpy.data.lights.new(name, kind)
    lamp.color, strength = strength_of(entry.get("emission", (1, 1, 1)))
    lamp.energy = strength * watts
    for key, value in settings.items():
        setattr(lamp, key, value)
    link(name, lamp, matrix, name)


def add_panel(name, entry):
    """A rectangle that emits on one side and absorbs on both."""
    origin, u, v = (axes(entry[key]) for key in ("origin", "edge_u", "edge_v"))
    if u.cross(v).dot(axes(entry["faces"])) < 0:
        u, v, origin = v, u, origin
    data = bpy.data.meshes.new(name)
    data.from_pydata([origin, origin + u, origin + u + v, origin + v], [], [(0, 1, 2, 3)])
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    geometry, mix, shine, black, out = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("NewGeometry", "MixShader", "Emission", "BsdfDiffuse", "OutputMaterial")
    )
    colour, strength = strength_of(entry.get("emission", (1, 1, 1)))
    shine.inputs["Color"].default_value, shine.inputs["Strength"].default_value = (*colour, 1), strength
    black.inputs["Color"].default_value = (0, 0, 0, 1)
    tree.links.new(geometry.outputs["Backfacing"], mix.inputs[0])
    tree.links.new(shine.outputs[0], mix.inputs[1])
    tree.links.new(black.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], out.inputs["Surface"])
    data.materials.append(material)
    link(name, data, Matrix.Identity(4), name)


def add_light(entry):
    """A light of the scene file that is no surface of its geometry."""
    kind = entry["kind"]
    name = entry.get("name", kind)
    if kind == "environment":
        world = bpy.data.worlds.new(name)
        world.use_nodes = True
        colour, strength = strength_of(entry.get("emission", (1, 1, 1)))
        inputs = world.node_tree.nodes["Background"].inputs
        inputs["Color"].default_value, inputs["Strength"].default_value = (*colour, 1), strength
        bpy.context.scene.world = world
        groups = bpy.context.view_layer.lightgroups
        groups.add(name=name)
        world.lightgroup = name
    elif kind == "panel":
        add_panel(name, entry)
    elif kind == "sun":
        towards = Vector(entry["towards"])
        angle = math.radians(2 * entry.get("angular_radius_degrees", 0.2665))
        add_lamp("SUN", name, entry, looking(-towards, (0.3, 0.9, 0.1)), 1.0, angle=angle)
    elif kind in {"point", "spot"}:
        place = Matrix.Translation(axes(entry["position"]))
        settings = {"shadow_soft_size": entry.get("radius", 0.0)}
        if kind == "spot":
            place = place @ looking(entry.get("direction", (0, -1, 0)), (0.3, 0.9, 0.1))
            outer = entry.get("outer_degrees", 30)
            edge, full = (math.cos(math.radians(a)) for a in (outer, entry.get("inner_degrees", 0.8 * outer)))
            settings.update(spot_size=math.radians(2 * outer), spot_blend=blend_of(edge, full))
        add_lamp(kind.upper(), name, entry, place, 4 * math.pi, use_soft_falloff=False, **settings)
    else:
        raise SystemExit(f"'{name}': lights of kind {kind} are not made here")


def blend_of(edge, full):
    """Blender's blend of a spot that shines fully within the cosine `full` of its axis and not at all beyond `edge`."""
    return (full - edge) / (1 - edge)


def sources(material):
    """Nodes of a material that emit, with the input that says how strong."""
    if not material or not material.use_nodes:
        return []
    inputs = {"BSDF_PRINCIPLED": "Emission Strength", "EMISSION": "Strength", "BACKGROUND": "Strength"}
    return [node.inputs[inputs[node.type]] for node in material.node_tree.nodes if node.type in inputs]


def shines(material):
    for strength in sources(material):
        colour = strength.node.inputs["Emission Color" if strength.node.type == "BSDF_PRINCIPLED" else "Color"]
        if strength.default_value > 0 and (colour.is_linked or max(colour.default_value[:3]) > 0):
            return True
    return False


def matches(name, pattern):
    return fnmatch.fnmatchcase(name, pattern)


def choose_surfaces(entries):
    """Emissive materials become light groups by the entries that choose them; others go dark."""
    for material in list(bpy.data.materials):
        users = [thing for thing in bpy.context.scene.objects if thing.type == "MESH" and material.name in thing.data.materials]
        if not shines(material) or not users:
            continue
        fitting = [e for e in entries if matches(material.name, e.get("material", "*"))]
        for strength in sources(material):
            if not fitting:
                strength.default_value = 0.0
        for thing in users if fitting else []:
            join_group(thing, fitting[0].get("name", material.name))


def override(entry):
    """A `[[material]]` of the scene file, as far as the corpus has them: emission 0 of what is unlit, which is matte then."""
    for material in bpy.data.materials:
        if not matches(material.name, entry["match"]) or not material.use_nodes:
            continue
        tree = material.node_tree
        image = next((node for node in tree.nodes if node.type == "TEX_IMAGE"), None)
        surface = tree.nodes.new("ShaderNodeBsdfPrincipled")
        surface.inputs["Roughness"].default_value, surface.inputs["Specular IOR Level"].default_value = 1.0, 0.0
        if image:
            tree.links.new(image.outputs["Color"], surface.inputs["Base Color"])
        out = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
        tree.links.new(surface.outputs[0], out.inputs["Surface"])
        for node in [node for node in tree.nodes if node.type in {"EMISSION", "BACKGROUND"}]:
            tree.nodes.remove(node)


def furnish(folder):
    """The scene of this folder as Blender's open scene; gives the file that `ltm` renders."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    described = folder / "scene.toml"
    if not described.exists():
        described = next(path for path in sorted(folder.iterdir()) if path.suffix in {".glb", ".gltf"})
        read_geometry(described)
        mend()
        bpy.context.scene.camera = next(thing for thing in bpy.context.scene.objects if thing.type == "CAMERA")
        for thing in list(bpy.context.scene.objects):
            emits = thing.type == "MESH" and any(shines(slot) for slot in thing.data.materials)
            if emits or thing.type == "LIGHT":
                join_group(thing, thing.name)
        return described
    entry = tomllib.loads(described.read_text())
    for name in entry["geometry"]:
        read_geometry(folder / name)
    mend()
    # The scene file's camera and lights stand for those of its glTF files.
    for thing in [thing for thing in bpy.context.scene.objects if thing.type in {"LIGHT", "CAMERA"}]:
        bpy.data.objects.remove(thing)
    for each in entry.get("material", []):
        override(each)
    lights = entry.get("light", [])
    choose_surfaces([light for light in lights if light.get("kind", "surface") == "surface"])
    for light in lights:
        if light.get("kind", "surface") != "surface":
            add_light(light)
    add_camera(entry["camera"])
    return described


def by_cycles(path, size, samples):
    """The layers of the open scene, rendered, or as they were rendered before."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = size
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.seed = "CPU", samples, 1
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.light_sampling_threshold = 0.0
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = 64
    cycles.transparent_max_bounces = 256
    cycles.blur_glossy, cycles.pixel_filter_type = 0.0, "BOX"
    camera = scene.camera.data
    camera.clip_start, camera.clip_end = 1e-4, 1e7
    bpy.context.view_layer.cycles.denoising_store_passes = True
    settings = scene.render.image_settings
    settings.file_format, settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return layers(path)


def cleaned(found, names):
    albedo = found["ViewLayer.Denoising Albedo"]
    normal = np.ascontiguousarray(np.dstack([found[f"ViewLayer.Denoising Normal.{axis}"] for axis in "XYZ"]))
    return {name: pyoidn.denoise(found[name], albedo, normal, hdr=True) for name in names}


def by_us(program, scene, folder, name, size, samples):
    """What our container shows of each light, by the lights' names."""
    container, images = folder / f"{name}.ltc", folder / f"{name}-ours.exr"
    size, samples = f"{size[0]}x{size[1]}", str(samples)
    begun = time.monotonic()
    # So many decibels that compression is no part of the difference.
    render = ["render", scene, "--pack", "--target", "80dB", "--allow-missing", "--force", "--size", size, "--samples", samples, "-o", container]
    subprocess.run([program / "ltm", *render], check=True, stdout=subprocess.DEVNULL)
    relight = ["relight", container, "-o", images, "--layers", "lights", "--device", "cpu"]
    subprocess.run([program / "ltm", *relight], check=True, stdout=subprocess.DEVNULL)
    print(f"{name}: ours {time.monotonic() - begun:.0f} s", flush=True)
    return {key.removesuffix(".RGB"): image for key, image in layers(images).items()}


def shown(image, exposure):
    c = np.clip(image * exposure, 0, None)
    c = np.clip(c * (1 + c / 16) / (1 + c) * 1.6, 0, 1)
    return np.where(c <= 0.0031308, 12.92 * c, 1.055 * np.power(np.maximum(c, 1e-9), 1 / 2.4) - 0.055).astype(np.float32)


def rows_of(name, ours, theirs, raw, montage):
    """A row for each light and one for all, and their picture."""
    # What is shut in and reaches nothing is left out.
    lights = [light for light in theirs if light in ours and (raw[light].any() or ours[light].any())]
    lost = sorted(set(theirs) ^ set(ours))
    if lost:
        print(f"{name}: not in both: {lost}", file=sys.stderr)
    pairs = {"all": tuple(sum(part[light] for light in lights) for part in (ours, theirs, raw))}
    pairs.update({light: (ours[light], theirs[light], raw[light]) for light in lights})
    strips = []
    for light, (own, other, noisy) in pairs.items():
        exposure = 1.0 / max(float(np.percentile(other @ LUMINANCE, 95)), 1e-12)
        flip, noise = measure(own, other)[0], measure(noisy, other)[0]
        pair = [shown(own, exposure), shown(other, exposure)]
        where = flip_evaluator.evaluate(pair[1], pair[0], "LDR", applyMagma=True, computeMeanError=False)[0]
        strips.append(np.concatenate([*pair, np.asarray(where, np.float32)], axis=1))
        ratio = float(own.mean(dtype=float) / max(noisy.mean(dtype=float), 1e-12))
        yield [name, "all" if light == "all" else "one", light, ratio, flip, noise]
    if montage:
        montage.mkdir(parents=True, exist_ok=True)
        Image.fromarray((np.concatenate(strips) * 255 + 0.5).astype(np.uint8)).save(montage / f"{name}.png")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("corpus", type=Path)
    parser.add_argument("--ltm", type=Path, default=Path("target/release"), help="the folder of the program ltm")
    parser.add_argument("--out", type=Path, default=Path("cycles.csv"))
    parser.add_argument("--renders", type=Path, default=Path("cycles"), help="where renders of Cycles are kept between runs")
    parser.add_argument("--montages", type=Path)
    parser.add_argument("--only", action="append", help="a scene's folder; may be given several times")
    parser.add_argument("--size", default="160x120")
    parser.add_argument("--samples", type=int, default=256, help="of ours")
    parser.add_argument("--cycles-samples", type=int, default=512)
    options = parser.parse_args()
    program, corpus = options.ltm.resolve(), options.corpus.resolve()
    size = [int(n) for n in options.size.split("x")]
    options.renders.mkdir(parents=True, exist_ok=True)
    renders = options.renders.resolve()
    folders = [f for f in sorted(corpus.iterdir()) if (f / "scene.toml").exists() or list(f.glob("*.glb"))]
    with open(options.out, "w", newline="") as out:
        settings = f"; {options.size} pixels, {options.samples} samples, Cycles {options.cycles_samples}"
        write_header(out, "Scenes that others made, by us and by Cycles, light by light", "measure_corpus.py", settings)
        table = csv.writer(out, lineterminator="\n")
        table.writerow(["scene", "of", "light", "ratio", "flip", "noise"])
        for folder in folders:
            name = folder.name
            if options.only and name not in options.only:
                continue
            kept = renders / f"{name}-{options.size}-{options.cycles_samples}.exr"
            begun = time.monotonic()
            if kept.exists():
                found, scene = layers(kept), folder / "scene.toml"
                scene = scene if scene.exists() else next(iter(sorted(folder.glob("*.gl*"))))
            else:
                scene = furnish(folder)
                found = by_cycles(kept, size, options.cycles_samples)
                print(f"{name}: Cycles {time.monotonic() - begun:.0f} s", flush=True)
            groups = [key for key in found if not key.startswith(("ViewLayer", "Composite"))]
            theirs = cleaned(found, groups)
            ours = by_us(program, scene, renders, name, size, options.samples)
            for row in rows_of(name, ours, theirs, found, options.montages):
                table.writerow([*row[:3], *(f"{value:.4f}" for value in row[3:])])
                print(f"{row[0]:18} {row[2]:18} ratio {row[3]:.3f}  FLIP {row[4]:.4f}  noise {row[5]:.4f}", flush=True)
            out.flush()


if __name__ == "__main__":
    main()
