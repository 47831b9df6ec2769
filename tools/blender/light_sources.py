# SPDX-License-Identifier: GPL-3.0-or-later
"""What gives light in a scene that Cycles renders: lamps, emissive materials, the world."""

from dataclasses import dataclass, field

import bpy

from . import lamps, world

WITH_SURFACES = {"MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD", "VOLUME"}


@dataclass
class LightSource:
    """What the mixer shows as one light."""

    name: str
    # lamp, material or world.
    kind: str
    # The objects that shine, none of the world.
    objects: list = field(default_factory=list)
    # The materials by which they do.
    materials: list = field(default_factory=list)
    # The light group that it is in as the user has set it.
    group: str = ""
    # Strength times colour as it is rendered; none where nodes decide it.
    emission: list | None = None


def collect(context, remarks):
    """All that gives light in what the view layer renders, each with a name of its own."""
    found = rendered_objects(context)
    sources = [of_lamp(thing) for thing in found if thing.type == "LIGHT" and gives_light(thing.data)]
    sources += of_materials(context, found, remarks)
    sources += of_world(context)
    names = set()
    for source in sources:
        source.name = unused(names, source.name)
    return sources


def of_lamp(thing):
    emission = [c * thing.data.energy for c in lamps.tint(thing.data)]
    return LightSource(thing.name, "lamp", [thing], [], thing.lightgroup, emission)


def gives_light(light):
    """Whether a lamp gives any: a portal shows where that of the world comes in."""
    is_portal = light.type == "AREA" and getattr(getattr(light, "cycles", None), "is_portal", False)
    return light.energy != 0.0 and not is_portal


def of_world(context):
    """The world, if it gives light."""
    found = world_of(context)
    even = world.even_colour(found) if found is not None else [0.0]
    if even is not None and not any(even):
        return []
    return [LightSource("World", "world", [], [], found.lightgroup, even)]


def world_of(context):
    """The world that the view layer is rendered with."""
    return getattr(context.view_layer, "world_override", None) or context.scene.world


def of_materials(context, found, remarks):
    """The objects of each emissive material; of materials that one object has, all together. Objects of several of the user's light
    groups are a light for each.
    """
    depsgraph = context.evaluated_depsgraph_get()
    override = context.view_layer.material_override
    materials_of, first = {}, {}

    def root(material):
        while first[material] != material:
            material = first[material]
        return material

    for thing in (thing for thing in found if thing.type in WITH_SURFACES):
        used = [override] if override else used_materials(thing, depsgraph)
        shining = [material for material in used if shines(material)]
        if not shining:
            continue
        materials_of[thing] = shining
        for material in shining:
            first.setdefault(material, material)
            first[root(material)] = root(shining[0])
    groups = {}
    for thing, shining in materials_of.items():
        groups.setdefault((root(shining[0]), thing.lightgroup), []).append(thing)
    several = {of: len([1 for other, _ in groups if other == of]) > 1 for of, _ in groups}
    sources = []
    for (material, group), things in groups.items():
        materials = list(dict.fromkeys(m for thing in things for m in materials_of[thing]))
        name = f"{material.name} {group or 'without a group'}" if several[material] else material.name
        if len(materials) > 1:
            others = ", ".join(f"'{other.name}'" for other in materials if other != material)
            remarks.append(f"'{name}': {others} shine on the same objects, and are mixed as one light")
        sources.append(LightSource(name, "material", things, materials, group))
    return sources


def rendered_objects(context):
    """The objects that a render of the view layer shows, straight or as instances."""
    found = {}

    def add(things):
        found.update((thing, None) for thing in things if not thing.hide_render)

    def walk(layer):
        if layer.exclude or layer.collection.hide_render:
            return
        add(layer.collection.objects)
        for child in layer.children:
            walk(child)

    def instanced(collection, seen):
        if collection is None or collection in seen or collection.hide_render:
            return
        seen.add(collection)
        add(collection.objects)
        for child in collection.children:
            instanced(child, seen)

    walk(context.view_layer.layer_collection)
    seen, before = set(), -1
    # What is instanced may instance others.
    while before != len(found):
        before = len(found)
        for thing in list(found):
            if thing.instance_type == "COLLECTION":
                instanced(thing.instance_collection, seen)
    for instance in context.evaluated_depsgraph_get().object_instances:
        if instance.is_instance:
            add([instance.object.original])
    return list(found)


def used_materials(thing, depsgraph):
    """The materials of an object: of its slots, and those that its modifiers give it."""
    slots = [slot.material for slot in thing.material_slots]
    data = getattr(thing.evaluated_get(depsgraph), "data", None)
    evaluated = [m.original for m in getattr(data, "materials", []) if m is not None]
    return list(dict.fromkeys(m for m in slots + evaluated if m is not None))


def shines(material):
    """Whether a material emits light, as far as its nodes tell: what is linked may."""
    if not material.use_nodes or material.node_tree is None:
        return False
    outputs = [n for n in material.node_tree.nodes if n.type == "OUTPUT_MATERIAL" and n.target in {"ALL", "CYCLES"}]
    return any(any(map(emits, reached_from(output))) for output in outputs)


def reached_from(node):
    """The nodes whose output goes into a node, groups opened."""
    found, waiting = set(), [node]
    while waiting:
        node = waiting.pop()
        if node in found:
            continue
        found.add(node)
        if node.type == "GROUP" and node.node_tree is not None:
            waiting += [inner for inner in node.node_tree.nodes if inner.type == "GROUP_OUTPUT"]
        waiting += [link.from_node for socket in node.inputs for link in socket.links]
    return found


# The inputs that say how strong a node shines, and in which colour.
EMISSIVE = {
    "EMISSION": [("Strength", "Color")],
    "BSDF_PRINCIPLED": [("Emission Strength", "Emission Color")],
    "PRINCIPLED_VOLUME": [("Emission Strength", "Emission Color"), ("Blackbody Intensity", "Blackbody Tint")],
    "VOLUME_COEFFICIENTS": [(None, "Emission Coefficients")],
}


def emits(node):
    return any(strength_of(node, s) and strength_of(node, c) for s, c in EMISSIVE.get(node.type, []))


def strength_of(node, name):
    """Whether an input may be above 0."""
    socket = node.inputs.get(name) if name else None
    if socket is None or socket.is_linked:
        return True
    value = socket.default_value
    return value != 0.0 if isinstance(value, (int, float)) else any(v != 0.0 for v in list(value)[:3])


def unused(names, name):
    """The name, with a number where another light has it."""
    numbered = (f"{name} {number}" for number in range(2, len(names) + 3))
    chosen = name if name not in names else next(n for n in numbered if n not in names)
    names.add(chosen)
    return chosen


def key(thing):
    """What tells an object from others, in a copy of the file as well: its name, and the library that it is linked from."""
    return [thing.name, thing.library.name if thing.library else ""]


def by_key(things):
    return {tuple(key(thing)): thing for thing in things}


def object_of(entry):
    """The object of a key, none where it is gone."""
    return by_key(bpy.data.objects).get(tuple(entry))
