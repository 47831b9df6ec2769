# SPDX-License-Identifier: GPL-3.0-or-later
"""Bringing a mixed lighting back to Blender's lamps, materials and world."""

import json
import tomllib
from fnmatch import fnmatchcase

import bpy

from . import glb, lamps, light_sources, world
from .weights import differs, rescale


def apply(context, lights, surfaces):
    """Gives everything that shines the weight that it has in `lights`, the list of `ltm info --json --lighting`.

    `surfaces` is the GLB file of the export, which says what shines. Returns how many changed, and remarks.
    """
    remarks, changed, materials = [], 0, {}
    known = {lamp.name: lamp for lamp in lamps.collect(context, 1, [])}
    shining = {item.name: item for item in (glb.shining(surfaces) if surfaces.is_file() else [])}
    for light in lights:
        name, weight, before = light["name"], light["weight"], light["scene_weight"]
        if not light["is_even"] and differs(weight, before):
            remarks.append(f"'{name}': its pattern is not brought back, but its mean")
        if name in known:
            changed += set_lamp(known[name], weight, before, remarks)
        elif light["kind"] in {"lat-long", "octahedral"} and context.scene.world is not None:
            changed += world.set_strength(context.scene.world, weight, before, remarks)
        elif name in shining:
            wanted = materials.setdefault(shining[name].material, (name, weight, before))
            if differs(wanted[1], weight):
                remarks.append(f"'{name}' has the material of '{wanted[0]}', and gets its strength")
        else:
            remarks.append(f"'{name}' is not in this scene")
    for material, (_, weight, before) in materials.items():
        changed += set_material(material, weight, before, remarks)
    return changed, remarks


def apply_to_cycles(context, lights, entries):
    """Gives what Cycles rendered the weights that it has in `lights`, multiples of what was rendered; `entries` are those of
    `cycles_job.described`. Returns how many changed, and remarks.
    """
    remarks, changed, materials, lit = [], 0, {}, {}
    stated = {entry["name"]: entry for entry in entries}
    known = light_sources.by_key(bpy.data.objects)
    for light in lights:
        name, weight, entry = light["name"], light["weight"], stated.get(light["name"])
        if entry is None:
            if differs(weight, light["scene_weight"]):
                remarks.append(f"'{name}' is none of the lights that were rendered, and is not brought back")
            continue
        before = entry["emission"] or [1.0] * 3
        wanted = [w * b for w, b in zip(weight, before)]
        if entry["kind"] == "world":
            found = light_sources.world_of(context)
            changed += world.set_strength(found, wanted, before, remarks) if found is not None else 0
        elif entry["kind"] == "lamp":
            thing = known.get(tuple(entry["objects"][0]))
            if thing is None or thing.type != "LIGHT":
                remarks.append(f"'{name}' is not in this scene")
                continue
            first = lit.setdefault(thing.data.name, (name, wanted))
            if first[0] != name:
                if differs(first[1], wanted):
                    remarks.append(f"'{name}' has the data of '{first[0]}', and gets its strength")
            elif differs(wanted, [c * thing.data.energy for c in lamps.tint(thing.data)]):
                lamps.set_strength(thing.data, 1.0, wanted)
                changed += 1
        for material, emission in entry["materials"]:
            if emission is not None and not any(emission):
                # It shines by nodes that are not looked into.
                if differs(weight, light["scene_weight"]):
                    remarks.append(f"the material '{material}' keeps its strength: other nodes decide it")
                continue
            before = emission or [1.0] * 3
            wanted = [w * b for w, b in zip(weight, before)]
            first = materials.setdefault(material, (name, wanted))
            if first[0] == name:
                changed += set_material(material, wanted, before, remarks)
            elif differs(first[1], wanted):
                remarks.append(f"'{name}' has the material of '{first[0]}', and gets its strength")
    return changed, remarks


def apply_groups(context, file, objects_of=None):
    """Gives objects and the world the groups of a look file as Cycles' light groups: of a light in several, the smallest.

    `objects_of` are the objects of lights that are several. Returns how many groups there are, and remarks.
    """
    text = file.read_text(encoding="utf-8")
    look = json.loads(text) if file.suffix.lower() == ".json" else tomllib.loads(text)
    stated = {name: [n for n in names if isinstance(n, str)] for name, names in look.get("groups", {}).items() if isinstance(names, list)}
    scene = context.scene
    things = {thing.name: [thing] for thing in scene.objects}
    if scene.world is not None:
        # As the export calls it.
        things["World"] = [scene.world]
    things.update(objects_of or {})
    # Of the look's wildcards, brackets are none.
    def fits(name, pattern):
        # A name comes before its reading as wildcards.
        return name == pattern if pattern in things else fnmatchcase(name, pattern.replace("[", "[[]"))

    members = {
        group: [name for name in things if any(fits(name, pattern) for pattern in patterns)]
        for group, patterns in stated.items()
    }
    remarks = [f"no object of the group '{group}' is in this scene" for group, found in members.items() if not found]
    known = {group.name for group in context.view_layer.lightgroups}
    for group, found in sorted(members.items(), key=lambda entry: -len(entry[1])):
        # Blender cuts longer names.
        name = group.encode()[:63].decode(errors="ignore")
        if found and name not in known:
            context.view_layer.lightgroups.add(name=name)
            known.add(name)
        for thing in (thing for light in found for thing in things[light]):
            thing.lightgroup = name
    return sum(map(bool, members.values())), remarks


def set_lamp(lamp, weight, before, remarks):
    if lamp.per_watt <= 0.0:
        if differs(weight, before):
            remarks.append(f"'{lamp.name}': its photometric file says how strong it is")
        return 0
    if not differs(weight, lamp.entry["emission"]):
        return 0
    lamps.set_strength(lamp.object.data, lamp.per_watt, weight)
    return 1


def set_material(name, weight, before, remarks):
    """Gives a material's emission a weight, by the factor to the one it was exported with where its colour is a texture."""
    material = bpy.data.materials.get(name)
    if material is None:
        return 0
    node = emissive_node(material)
    if node is None:
        if differs(weight, before):
            remarks.append(f"the material '{name}' keeps its strength: it has no emission node")
        return 0
    colour, strength = emissive_inputs(node)
    if strength.is_linked:
        if differs(weight, before):
            remarks.append(f"the material '{name}' keeps its strength: other nodes decide it")
        return 0
    if colour.is_linked:
        return int(rescale(material, strength, weight, before))
    if not differs(weight, [c * strength.default_value for c in colour.default_value[:3]]):
        return 0
    strongest = max(weight)
    if strongest > 0.0:
        colour.default_value = [w / strongest for w in weight] + [1.0]
    strength.default_value = strongest
    return 1


def emissive_node(material):
    """The node by which a material shines; none where it has none of the usual ones."""
    nodes = material.node_tree.nodes if material.use_nodes else []
    node = next((n for n in nodes if n.type == "EMISSION"), None)
    return node or next((n for n in nodes if n.type == "BSDF_PRINCIPLED"), None)


def emissive_inputs(node):
    """Its colour and its strength."""
    names = ("Color", "Strength") if node.type == "EMISSION" else ("Emission Color", "Emission Strength")
    return [node.inputs[name] for name in names]


def emission_of(material):
    """Strength times colour of a material; none where other nodes decide them."""
    node = emissive_node(material)
    if node is None:
        return None
    colour, strength = emissive_inputs(node)
    if colour.is_linked or strength.is_linked:
        return None
    return [c * strength.default_value for c in colour.default_value[:3]]
