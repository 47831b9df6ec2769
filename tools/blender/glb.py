# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene's surfaces as a GLB file, and which of them shine."""

import json
import struct
from dataclasses import dataclass

import bpy


@dataclass
class Shining:
    """A node's surfaces of an emissive material, as the file has them."""

    # The node, as ltm names it: what is instanced has a number.
    object: str
    material: str
    name: str
    two_sided: bool
    emission: list


def write(path):
    """Exports the active scene's surfaces, as they are rendered, without cameras and lamps."""
    bpy.ops.export_scene.gltf(
        filepath=str(path),
        export_format="GLB",
        use_active_scene=True,
        use_renderable=True,
        export_apply=True,
        export_yup=True,
        export_cameras=False,
        export_lights=False,
        export_animations=False,
        export_skins=False,
        export_morph=False,
    )


def shining(path):
    """What shines in a GLB file, in the order of its nodes."""
    file = read(path)
    nodes, meshes, materials = (file.get(key, []) for key in ("nodes", "meshes", "materials"))
    found, names, waiting = [], {}, list(reversed(file["scenes"][file.get("scene", 0)].get("nodes", [])))
    while waiting:
        node = nodes[waiting.pop()]
        waiting.extend(reversed(node.get("children", [])))
        mesh = meshes[node["mesh"]] if "mesh" in node else {}
        name = unique(names, node.get("name") or mesh.get("name", ""))
        used = [p["material"] for p in mesh.get("primitives", []) if "material" in p]
        lit = [index for index in dict.fromkeys(used) if any(emission(materials[index]))]
        for index in lit:
            material = materials[index]["name"]
            own = name if len(lit) == 1 else f"{name} {material}"
            two_sided = materials[index].get("doubleSided", False)
            found.append(Shining(name, material, own, two_sided, emission(materials[index])))
    return found


def glass(path):
    """`[[material]]` entries for what is of glass in a GLB file.

    The exporter writes no thickness, which would make it a sheet; in Cycles every such surface refracts. Cycles colours what
    passes by the square root of the base colour, so that two crossings have that.
    """
    entries = []
    for material in read(path).get("materials", []):
        share = material.get("extensions", {}).get("KHR_materials_transmission", {}).get("transmissionFactor", 0.0)
        pbr = material.get("pbrMetallicRoughness", {})
        if share >= 0.5 and pbr.get("metallicFactor", 1.0) < 0.5:
            tint = [max(0.0, c) ** 0.5 for c in pbr.get("baseColorFactor", (1.0, 1.0, 1.0))[:3]]
            entries.append({"match": material["name"], "kind": "dielectric", "transmittance": tint})
    return entries


def has_surfaces(path):
    """Whether a GLB file has any mesh."""
    return bool(read(path).get("meshes"))


def read(path):
    """The tree of a GLB file."""
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + length])


def emission(material):
    """Radiance of a material of a glTF file."""
    strength = material.get("extensions", {}).get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
    return [c * strength for c in material.get("emissiveFactor", (0.0, 0.0, 0.0))]


def unique(names, name):
    """The name, with a number where it was given before, as ltm numbers nodes."""
    names[name] = names.get(name, 0) + 1
    if names[name] == 1:
        return name
    number = names[name]
    while f"{name} {number}" in names:
        number += 1
    names[f"{name} {number}"], names[name] = 1, number
    return f"{name} {number}"
