# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's lamps as `[[light]]` entries of a scene file, and back."""

from dataclasses import dataclass, field
from math import acos, atan2, cos, degrees, pi, sin

import bpy
from mathutils import Vector

from . import units

# Corners of the polygon that stands for a disc.
CORNERS = 64


@dataclass
class Lamp:
    """A lamp that stands in the scene."""

    object: bpy.types.Object
    name: str
    # Keys of its entry.
    entry: dict
    # What a watt (of a sun: a unit of strength) of white light is in the entry's unit; 0 where a file says how strong it is.
    per_watt: float
    # Corners of a disc in the axes of glTF, counter-clockwise as seen from its lit side.
    polygon: list = field(default_factory=list)


def renders(thing, view_layer):
    """Whether an object is there in a render of this view layer."""
    shown = any(not collection.hide_render for collection in thing.users_collection)
    return shown and not thing.hide_render and thing.name in view_layer.objects


def collect(context, texels, remarks):
    """All lamps of the scene. `texels` is how many an area light has along its longer side."""
    lamps = []
    for thing in context.view_layer.objects:
        if thing.type != "LIGHT" or not renders(thing, context.view_layer):
            continue
        lamps.append(lamp(thing, thing.matrix_world, thing.name, texels, remarks))
    counts = {}
    for instance in context.evaluated_depsgraph_get().object_instances:
        if instance.is_instance and instance.object.type == "LIGHT" and not instance.object.hide_render:
            original = instance.object.original
            counts[original.name] = counts.get(original.name, 1) + 1
            name = f"{original.name} {counts[original.name]}"
            lamps.append(lamp(original, instance.matrix_world.copy(), name, texels, remarks))
    seen = sum(lamp.object.visible_camera and lamp.object.data.type in {"POINT", "SPOT"} for lamp in lamps)
    if seen:
        remarks.append(f"{seen} points and spots are set to be seen by the camera, which they never are here")
    return lamps


def lamp(thing, matrix, name, texels, remarks):
    """The lamp of an object that stands at `matrix`."""
    light = thing.data
    position = units.finite(units.axes(matrix.translation))
    turn = matrix.to_3x3()
    down = units.finite(units.axes(-(turn @ Vector((0, 0, 1))).normalized()))
    if light.ltm.photometry:
        file = bpy.path.abspath(light.ltm.photometry)
        entry = {"kind": "ies", "file": file, "position": position, "direction": down}
        entry["turn_degrees"] = turn_degrees(Vector(down), Vector(units.axes(turn @ Vector((1, 0, 0)))))
        return Lamp(thing, name, {"name": name, **entry}, 0.0)
    per_watt, polygon = node_strength(light, name, remarks), []
    if light.type == "SUN":
        entry = {"kind": "sun", "towards": [-v for v in down], "angular_radius_degrees": degrees(light.angle / 2)}
    elif light.type == "AREA":
        across = turn @ Vector((light.size, 0, 0))
        is_long = light.shape in {"RECTANGLE", "ELLIPSE"}
        along = turn @ Vector((0, light.size_y if is_long else light.size, 0))
        area = across.cross(along).length
        if light.spread < pi - 1e-3:
            remarks.append(f"'{name}': the spread is not used; it shines to all of its side")
        if light.shape in {"DISK", "ELLIPSE"}:
            per_watt *= units.radiance_per_watt(area * pi / 4)
            # The polygon is smaller than the disc, and as strong.
            per_watt *= pi / (CORNERS / 2 * sin(2 * pi / CORNERS))
            polygon = disc(matrix.translation, across, along)
            entry = {"kind": "surface"}
        else:
            per_watt *= units.radiance_per_watt(area)
            origin = matrix.translation - across / 2 - along / 2
            entry = {"kind": "panel", "origin": units.finite(units.axes(origin)), "faces": down}
            entry.update(edge_u=units.finite(units.axes(across)), edge_v=units.finite(units.axes(along)))
            entry["texels"] = cut(across.length, along.length, light.ltm.texels or texels)
    else:
        entry = {"kind": "point", "position": position}
        if light.shadow_soft_size > 0.0:
            entry["radius"] = light.shadow_soft_size
        per_watt *= units.intensity_per_watt()
        if light.type == "SPOT":
            inner = degrees(acos(min(1.0, units.full_light(light.spot_size / 2, light.spot_blend))))
            outer = degrees(light.spot_size / 2)
            entry.update(kind="spot", direction=down, outer_degrees=outer, inner_degrees=min(inner, outer))
    if light.type in {"SUN", "AREA"} and not thing.visible_camera:
        entry["camera"] = False
    entry["emission"] = [per_watt * light.energy * c for c in tint(light)]
    return Lamp(thing, name, {"name": name, **entry}, per_watt, polygon)


def tint(light):
    """Its colour, linear, with that of its temperature where it has one."""
    white = getattr(light, "temperature_color", (1, 1, 1)) if getattr(light, "use_temperature", False) else (1, 1, 1)
    return [c * w for c, w in zip(light.color, white)]


def node_strength(light, name, remarks):
    """What its exposure and its nodes multiply its strength by; nodes beyond an even emission are not used."""
    strength = 2.0 ** getattr(light, "exposure", 0.0)
    if not light.use_nodes or not light.node_tree:
        return strength
    emission = next((node for node in light.node_tree.nodes if node.type == "EMISSION"), None)
    if emission is None or any(socket.is_linked for socket in emission.inputs):
        remarks.append(f"'{name}': its nodes are not used, but its colour and strength")
        return strength
    red, green, blue = emission.inputs["Color"].default_value[:3]
    if max(abs(red - green), abs(green - blue)) > 1e-6:
        remarks.append(f"'{name}': the colour of its emission node is taken as grey")
    return strength * emission.inputs["Strength"].default_value * (red + green + blue) / 3


def cut(across, along, texels):
    """Texels that are about square, `texels` of them along the longer side."""
    longer = max(across, along, 1e-9)
    return [max(1, round(texels * across / longer)), max(1, round(texels * along / longer))]


def disc(centre, across, along):
    """The corners of an ellipse with these axes, whose light leaves along −z of the lamp."""
    turns = [-2 * pi * i / CORNERS for i in range(CORNERS)]
    return [units.axes(centre + across / 2 * cos(t) + along / 2 * sin(t)) for t in turns]


def turn_degrees(down, side):
    """How far a luminaire that shines along `down` is turned about that direction, of which `side` is its x axis; all in the
    axes of glTF. At 0 its x axis lies as near to the world's +x as that allows."""
    z = -down
    reference = Vector((1, 0, 0)) if abs(down.x) < 0.999 else Vector((0, 0, 1))
    x = (reference - z * reference.dot(z)).normalized()
    return degrees(atan2(side.dot(z.cross(x)), side.dot(x)))


def set_strength(light, per_watt, weight):
    """Gives a lamp the energy and the colour that have this weight; a colour that stays in proportion is left as it is."""
    strengths = [w / per_watt for w in weight]
    now, strongest = tint(light), max(strengths)
    if strongest <= 0.0:
        light.energy = 0.0
        return
    ratio = sum(s * c for s, c in zip(strengths, now)) / max(sum(c * c for c in now), 1e-12)
    if max(abs(s - ratio * c) for s, c in zip(strengths, now)) < 1e-3 * strongest:
        light.energy = ratio
        return
    if getattr(light, "use_temperature", False):
        light.use_temperature = False
    light.color = [s / strongest for s in strengths]
    light.energy = strongest
