# SPDX-License-Identifier: GPL-3.0-or-later
"""The same room by us and by Cycles, one light group after the other.

Tolerances, beside the noise of 256 samples: 1 % of the mean of an image; 5 % of it for the root mean square over squares of
8 × 8 pixels, which is where shapes and shadows would differ.
"""

import subprocess
from math import pi

import bpy
import numpy
import pytest
import room

MEAN, CELLS = 0.01, 0.05


def small_lamps():
    """A light group in the room, and a sun and a world around it."""
    room.lamp("POINT", "bulb", (-1.2, -1.0, 2.5), group="inside", energy=60, color=(1.0, 0.8, 0.5), shadow_soft_size=0)
    down = {"energy": 200, "spot_size": 1.2, "spot_blend": 0.4, "shadow_soft_size": 0}
    room.lamp("SPOT", "spot", (1.0, -1.0, 2.9), (0.3, 0.2, 0.0), group="inside", **down)
    room.lamp("SUN", "sun", (0, 0, 9), (pi / 3, 0.3, 0.0), energy=1.5, angle=0.05)
    room.world((0.3, 0.5, 1.0), 0.4)
    return {"inside": ["bulb", "spot"], "sun": ["sun"], "World": ["World"]}


def large_lamps():
    """Area lights of every shape and a mesh that shines, out of the camera's sight. Without a world: of its light, ours keep
    off what falls on them, and those of Cycles do not."""
    shapes = {"RECTANGLE": 1.0, "DISK": 1.5, "ELLIPSE": 1.0, "SQUARE": 1.2}
    for number, (shape, size) in enumerate(shapes.items()):
        place = (2.5 * number - 3.75, -9.0, 2.5)
        lamp = room.lamp("AREA", shape.lower(), place, (pi / 2, 0.2, -0.1), shape=shape, size=size, size_y=2.0, energy=300)
        lamp.scale = (1.0, 1.3, 1.0)
    tube = [(-4.0, -7.5, 3.0), (4.0, -7.5, 3.0), (4.0, -7.3, 3.4), (-4.0, -7.3, 3.4)]
    room.mesh("tube", tube, [(3, 2, 1, 0)], room.glowing("glow", (0.4, 0.6, 1.0), 5.0))
    return {name: [name] for name in ("rectangle", "disk", "ellipse", "square", "tube")}


def only(scene, names):
    """Leaves only these lights in the scene."""
    for thing in scene.objects:
        if thing.type == "LIGHT":
            thing.hide_render = thing.name not in names
    if "glow" in bpy.data.materials and "tube" not in names:
        bpy.data.materials["glow"].node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value = 0.0
    if scene.world is not None and "World" not in names:
        scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0


@pytest.mark.parametrize("lamps", [small_lamps, large_lamps])
def test_every_light_group_is_as_cycles_renders_it(scene, program, tmp_path, lamps):
    # What shines by nodes comes first, for `only` darkens it for good.
    groups = dict(reversed(lamps().items()))
    scene.ltm.samples = 256
    assert bpy.ops.ltm.render() == {"FINISHED"}
    packed = next(tmp_path.glob("*.ltc"))
    for group, names in groups.items():
        image = tmp_path / f"{group}.exr"
        chosen = [word for name in names for word in ("--on", name)]
        subprocess.run([program, "relight", packed, "-o", image, "--device", "cpu", *chosen], check=True, capture_output=True)
        ours = room.read(image)
        only(scene, names)
        theirs = room.by_cycles(scene, tmp_path / f"{group}-cycles.exr")
        mean = theirs.mean()
        shift = ours.mean() / mean - 1.0
        spread = numpy.sqrt(numpy.mean((room.cells(ours) - room.cells(theirs)) ** 2)) / mean
        print(f"{group:10} mean {mean:.4f}, ours {100 * shift:+.2f} %, cells {100 * spread:.2f} %")
        assert mean > 1e-3, group
        assert abs(shift) < MEAN, group
        assert spread < CELLS, group


@pytest.mark.parametrize("turn", [0.0, 1.0])
def test_a_world_of_an_image_lies_as_it_does_in_cycles(scene, program, tmp_path, turn):
    """A sky that is bright to one side, through nodes that turn it."""
    nodes = room.world((1.0, 1.0, 1.0), 1.0).node_tree
    picture = bpy.data.images.new("sky", 64, 32, float_buffer=True)
    pixels = numpy.zeros((32, 64, 4), dtype=numpy.float32)
    pixels[..., 3] = 1.0
    # From below: rows 16 to 32 are above the horizon.
    pixels[20:28, 8:16] = (8.0, 2.0, 1.0, 1.0)
    pixels[18:30, 40:44] = (1.0, 2.0, 9.0, 1.0)
    picture.pixels[:] = pixels.ravel()
    around = nodes.nodes.new("ShaderNodeTexEnvironment")
    around.image = picture
    mapping, place = nodes.nodes.new("ShaderNodeMapping"), nodes.nodes.new("ShaderNodeTexCoord")
    mapping.inputs["Rotation"].default_value = (0.0, 0.0, turn)
    nodes.links.new(place.outputs["Generated"], mapping.inputs["Vector"])
    nodes.links.new(mapping.outputs["Vector"], around.inputs["Vector"])
    nodes.links.new(around.outputs["Color"], nodes.nodes["Background"].inputs["Color"])
    for name in ("walls", "left", "right"):
        bpy.data.objects.remove(bpy.data.objects[name])
    bpy.ops.mesh.primitive_plane_add(size=4.0)
    bpy.context.object.data.materials.append(bpy.data.materials["grey"])
    scene.ltm.samples, scene.ltm.sky_texels = 128, 64
    assert bpy.ops.ltm.render() == {"FINISHED"}
    image = tmp_path / "sky-ours.exr"
    subprocess.run([program, "relight", next(tmp_path.glob("*.ltc")), "-o", image, "--device", "cpu"], check=True, capture_output=True)
    ours, theirs = room.read(image), room.by_cycles(scene, tmp_path / "sky-cycles.exr")
    # Where the floor, the box and the ball are.
    ours, theirs = room.cells(ours)[5:], room.cells(theirs)[5:]
    spread = numpy.sqrt(numpy.mean((ours - theirs) ** 2)) / theirs.mean()
    print(f"world {100 * (ours.mean() / theirs.mean() - 1):+.2f} %, cells {100 * spread:.2f} %")
    assert abs(ours.mean() / theirs.mean() - 1) < 0.02
    assert spread < 0.08
