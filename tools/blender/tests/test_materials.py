# SPDX-License-Identifier: GPL-3.0-or-later
"""Balls of one material each, by us and by Cycles from the same file: where the models agree, and how far they differ."""

import subprocess

import bpy
import numpy
import pytest
import room


MATERIALS = {
    "matte": {"Base Color": (0.5, 0.5, 0.5, 1.0), "Specular IOR Level": 0.0, "Roughness": 1.0},
    "mirror": {"Base Color": (0.9, 0.9, 0.9, 1.0), "Metallic": 1.0, "Roughness": 0.0},
    "glass": {"Base Color": (1.0, 1.0, 1.0, 1.0), "Transmission Weight": 1.0, "Roughness": 0.0, "IOR": 1.45, "Specular IOR Level": 0.5},
    "metal": {"Base Color": (0.9, 0.6, 0.3, 1.0), "Metallic": 1.0, "Roughness": 0.3},
    "plastic": {"Base Color": (0.1, 0.3, 0.7, 1.0), "Specular IOR Level": 0.5, "Roughness": 0.3},
    "lacquer": {"Base Color": (0.6, 0.05, 0.05, 1.0), "Coat Weight": 1.0, "Coat Roughness": 0.1},
}

# Largest difference of the mean over the ball's pixels. Matte, mirror and glass are the same models; a rough metal of ours
# loses what bounces between its facets, and the base below a coat is lit through it otherwise.
TOLERANCES = {"matte": 0.01, "mirror": 0.02, "glass": 0.02, "metal": 0.03, "plastic": 0.03, "lacquer": 0.03}


def ball_of(inputs, bulb):
    """A large ball in the room, under a panel and a sky, and a bulb where one is wanted, and the pixels that show it."""
    for name in ("Cube", "Sphere"):
        bpy.data.objects.remove(bpy.data.objects[name])
    bpy.ops.mesh.primitive_uv_sphere_add(radius=1.0, location=(0.0, 0.0, 1.2), segments=64, ring_count=32)
    bpy.ops.object.shade_smooth()
    material = room.matte("ball", (0.5, 0.5, 0.5))
    for name, value in inputs.items():
        material.node_tree.nodes["Principled BSDF"].inputs[name].default_value = value
    bpy.context.object.data.materials.append(material)
    room.world((0.6, 0.8, 1.0), 0.6)
    if bulb:
        room.lamp("POINT", "bulb", (-1.5, -3.0, 3.5), energy=300, shadow_soft_size=0)
    rows, columns = numpy.mgrid[: room.HEIGHT, : room.WIDTH]
    return (rows - room.HEIGHT * 0.573) ** 2 + (columns - room.WIDTH / 2) ** 2 < 14**2


@pytest.mark.parametrize("name", MATERIALS)
def test_a_ball_of_every_material_is_about_as_bright_as_in_cycles(scene, program, tmp_path, name):
    # What a point casts through glass or off a mirror Cycles does not find.
    shown = ball_of(MATERIALS[name], bulb=name not in ("mirror", "glass"))
    scene.ltm.samples = 256
    assert bpy.ops.ltm.render() == {"FINISHED"}
    image = tmp_path / "ours.exr"
    packed = next(tmp_path.glob("*.ltc"))
    subprocess.run([program, "relight", packed, "-o", image, "--device", "cpu"], check=True, capture_output=True)
    ours, theirs = room.read(image)[shown], room.by_cycles(scene, tmp_path / "cycles.exr")[shown]
    difference = ours.mean() / theirs.mean() - 1.0
    print(f"{name}: ours {100 * difference:+.2f} %")
    assert abs(difference) < TOLERANCES[name]
