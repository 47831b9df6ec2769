# SPDX-License-Identifier: GPL-3.0-or-later
"""The world of Blender as an environment, and back."""

from math import pi

import bpy

from . import units
from .weights import differs, rescale

# Pixels across the image of a world that is more than one colour.
ACROSS = 512
SAMPLES = 16


def entry(scene, texels, file, remarks):
    """The `[[light]]` entry of the scene's world, none where it is dark. What is more than one colour is rendered into `file`."""
    if scene.world is None:
        return None
    common = {"name": "World", "kind": "environment", "texels": [texels, max(1, texels // 2)]}
    # Cycles' part of the world; without Cycles every world is seen.
    visibility = getattr(scene.world, "cycles_visibility", None)
    if visibility is not None and not visibility.camera:
        common["camera"] = False
    even = even_colour(scene.world)
    if even is not None:
        return {**common, "emission": units.finite(even)} if any(even) else None
    if not bake(scene.world, file):
        remarks.append("the world is left out: Cycles, which renders it to an image, is not there")
        return None
    return {**common, "map": file.name}


def background(world):
    """The background node of a world, if there is one and only one that its output shows."""
    nodes = [node for node in world.node_tree.nodes if node.type == "BACKGROUND"] if world.use_nodes else []
    return nodes[0] if len(nodes) == 1 else None


def even_colour(world):
    """Radiance of a world of one colour, none where it is more."""
    if not world.use_nodes:
        return list(world.color)
    node = background(world)
    shown = [link.from_node for link in world.node_tree.links if link.to_node.type == "OUTPUT_WORLD"]
    if not shown:
        return [0.0] * 3
    if node is None or shown != [node] or any(socket.is_linked for socket in node.inputs):
        return None
    return [c * node.inputs["Strength"].default_value for c in node.inputs["Color"].default_value[:3]]


def bake(world, file):
    """Renders a world as an image whose left edge looks to +y of Blender, as ltm's maps begin; whether that worked."""
    scene = bpy.data.scenes.new("ltm world")
    lens = bpy.data.cameras.new("ltm world")
    camera = bpy.data.objects.new("ltm world", lens)
    try:
        try:
            scene.render.engine = "CYCLES"
        except TypeError:
            return False
        scene.world = world
        scene.collection.objects.link(camera)
        scene.camera = camera
        lens.type = "PANO"
        # From Blender 5 on the lens has it, before Cycles' part of the lens.
        pano = lens if hasattr(lens, "panorama_type") else lens.cycles
        pano.panorama_type = "EQUIRECTANGULAR"
        # It looks to −y, level; the middle of the image is there.
        camera.rotation_euler = (pi / 2, 0, pi)
        render = scene.render
        render.resolution_x, render.resolution_y, render.resolution_percentage = ACROSS, ACROSS // 2, 100
        scene.cycles.samples, scene.cycles.use_denoising = SAMPLES, False
        render.image_settings.file_format = "OPEN_EXR"
        render.image_settings.color_mode = "RGB"
        render.filepath = str(file)
        render.use_compositing = render.use_sequencer = False
        bpy.ops.render.render(scene=scene.name, write_still=True)
        return file.is_file()
    finally:
        bpy.data.scenes.remove(scene)
        bpy.data.objects.remove(camera)
        bpy.data.cameras.remove(lens)


def set_strength(world, weight, before, remarks):
    """Gives a world a weight, a mean over all directions; the colour too where it has but one, else by the factor to the weight it was
    exported with. How many changed.
    """
    even = even_colour(world)
    if even is not None and not differs(weight, even):
        return 0
    if not world.use_nodes:
        world.color = [min(1.0, w) for w in weight]
        return 1
    node = background(world)
    if node is None:
        if differs(weight, before):
            remarks.append("the world keeps its strength: it has no single background node")
        return 0
    strength = node.inputs["Strength"]
    if even is not None:
        strongest = max(weight)
        if strongest > 0.0:
            node.inputs["Color"].default_value = [w / strongest for w in weight] + [1.0]
        strength.default_value = strongest
        return 1
    if strength.is_linked:
        if differs(weight, before):
            remarks.append("the world keeps its strength: other nodes decide it")
        return 0
    return int(rescale(world, strength, weight, before))
