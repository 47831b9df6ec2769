# SPDX-License-Identifier: GPL-3.0-or-later
"""A room of matte walls with a box and a ball in it, lamps for it, and its picture by Cycles."""

from math import pi, radians

import bpy
import numpy

WIDTH, HEIGHT = 96, 72


def matte(name, colour):
    """A Lambertian material: the coat of the usual one reflects nothing."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    inputs = material.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = (*colour, 1.0)
    inputs["Specular IOR Level"].default_value = 0.0
    inputs["Roughness"].default_value = 1.0
    return material


def glowing(name, colour, strength):
    material = matte(name, (0.0, 0.0, 0.0))
    inputs = material.node_tree.nodes["Principled BSDF"].inputs
    inputs["Emission Color"].default_value = (*colour, 1.0)
    inputs["Emission Strength"].default_value = strength
    return material


def mesh(name, vertices, faces, material):
    data = bpy.data.meshes.new(name)
    data.from_pydata(vertices, [], faces)
    data.materials.append(material)
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def furnish(scene):
    """Floor, ceiling, back and side walls, 4 × 4 × 3 m, open to −y; a box, a ball; a camera."""
    low, high = (-2.0, -2.0, 0.0), (2.0, 2.0, 3.0)
    corner = [(x, y, z) for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])]
    grey, red, green = (matte(n, c) for n, c in (("grey", (0.7, 0.7, 0.7)), ("red", (0.6, 0.1, 0.1)), ("green", (0.1, 0.5, 0.2))))
    mesh("walls", corner, [(0, 1, 3, 2), (4, 6, 7, 5), (2, 3, 7, 6)], grey)
    mesh("left", corner, [(0, 2, 6, 4)], red)
    mesh("right", corner, [(1, 5, 7, 3)], green)
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=(-0.8, 0.6, 0.5), rotation=(0, 0, 0.4))
    bpy.context.object.data.materials.append(grey)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.5, location=(0.8, 0.2, 0.5), segments=48, ring_count=24)
    bpy.context.object.data.materials.append(green)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.angle = radians(40)
    camera.location, camera.rotation_euler = (0.0, -7.0, 1.5), (pi / 2, 0.0, 0.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT


def lamp(kind, name, location, rotation=(0.0, 0.0, 0.0), group="", **settings):
    """A lamp; `settings` are those of its data."""
    data = bpy.data.lights.new(name, kind)
    for key, value in settings.items():
        setattr(data, key, value)
    thing = bpy.data.objects.new(name, data)
    thing.location, thing.rotation_euler = location, rotation
    bpy.context.scene.collection.objects.link(thing)
    if group:
        groups = bpy.context.view_layer.lightgroups
        if group not in groups:
            groups.add(name=group)
        thing.lightgroup = group
    return thing


def world(colour, strength):
    found = bpy.data.worlds.new("sky")
    found.use_nodes = True
    node = found.node_tree.nodes["Background"]
    node.inputs["Color"].default_value, node.inputs["Strength"].default_value = (*colour, 1.0), strength
    bpy.context.scene.world = found
    return found


def read(path):
    """An image as rows from the top, RGB."""
    image = bpy.data.images.load(str(path))
    try:
        width, height = image.size
        return numpy.array(image.pixels[:], dtype=float).reshape(height, width, -1)[::-1, :, :3].copy()
    finally:
        bpy.data.images.remove(image)


def by_cycles(scene, path, samples=256):
    """The scene as Cycles renders it, without what makes its pictures darker or smoother than they are."""
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.seed = "CPU", samples, 1
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.light_sampling_threshold = 0.0
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = 11
    cycles.blur_glossy, cycles.pixel_filter_type = 0.0, "BOX"
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGB", "32"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return read(path)


def cells(image, side=8):
    """Means over squares of pixels, in which there is less noise."""
    height, width, _ = image.shape
    return image.reshape(height // side, side, width // side, side, 3).mean(axis=(1, 3))
