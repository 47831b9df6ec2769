# SPDX-License-Identifier: GPL-3.0-or-later
"""The open scene as the files that ltm renders: GLB, scene file, look with the light groups."""

from dataclasses import dataclass
from pathlib import Path

import bpy

from . import cameras, glb, lamps, toml_text, weights, world
from .not_exported import NotExported

# What a look begins with that no one has saved.
OWN_LOOK = "# The light groups of the scene, written with each render.\n"


@dataclass
class Written:
    """What an export wrote."""

    scene: Path
    # Look with the light groups, none where there are none.
    groups: Path | None
    # Names of the lights.
    lights: list
    # What is left out or simplified.
    remarks: list


def folder(scene):
    """The folder of a scene's files: as it is set, beside the .blend file; in the temporary one where that is not saved."""
    stated = scene.ltm.folder
    if stated.startswith("//") and not bpy.data.filepath:
        return Path(bpy.app.tempdir) / "ltm"
    return Path(bpy.path.abspath(stated))


def stem(scene):
    """The name of its files, without an ending."""
    name = Path(bpy.data.filepath).stem or "untitled"
    name = name if len(bpy.data.scenes) == 1 else f"{name}-{scene.name}"
    return "".join(c if c.isalnum() or c in "-_ ." else "_" for c in name)


def packed(scene):
    """Where the rendered scene is, or will be."""
    return folder(scene) / f"{stem(scene)}.ltc"


def write(context):
    """Writes the scene of a context. Raises NotExported."""
    scene, remarks = context.scene, []
    where, name = folder(scene), stem(scene)
    try:
        where.mkdir(parents=True, exist_ok=True)
        return _write(context, where, name, remarks)
    except OSError as error:
        raise NotExported(f"{where}: {error.strerror or error}") from error


def _write(context, where, name, remarks):
    scene = context.scene
    camera = cameras.entry(scene, remarks)
    surfaces = where / f"{name}.glb"
    glb.write(surfaces)
    if not glb.has_surfaces(surfaces):
        raise NotExported("the scene has no surfaces to render: add a mesh")
    geometry = [surfaces.name]
    materials = [{**entry, "match": toml_text.pattern(entry["match"])} for entry in glb.glass(surfaces)]
    lights = [emitter(shining, scene) for shining in glb.shining(surfaces)]
    unseen = [thing.name for thing in scene.objects if thing.type == "MESH" and not (thing.hide_render or thing.visible_camera)]
    unlit = [name for name in unseen if all(light["object"] != toml_text.pattern(name) for light in lights)]
    if unlit:
        remarks.append(f"{len(unlit)} objects that the camera does not see are seen here, as they are no lights: {unlit[0]}")
    found = lamps.collect(context, scene.ltm.texels, remarks)
    discs = [lamp for lamp in found if lamp.polygon]
    if discs:
        file = where / f"{name}-discs.obj"
        file.write_text(discs_obj(discs), encoding="utf-8")
        geometry.append(file.name)
        materials.append({"match": "ltm disc *", "kind": "black"})
        for number, lamp in enumerate(discs, 1):
            lamp.entry["material"] = f"ltm disc {number}"
    lights += [lamp.entry for lamp in found]
    sky = world.entry(scene, scene.ltm.sky_texels, where / f"{name}-world.exr", remarks)
    lights += [sky] if sky else []
    if not lights:
        raise NotExported("the scene has no light: add a lamp, an emissive material or a world")
    rename_doubles(lights)
    parts = [toml_text.table("# Written by the Blender add-on of ltm.", {"name": name, "geometry": geometry, "metres_per_unit": 1.0})]
    parts.append(toml_text.table("[camera]", camera))
    parts.append(toml_text.table("[render]", {"samples_per_pixel": scene.ltm.samples}))
    parts += [toml_text.table("[[light]]", entry) for entry in lights]
    parts += [toml_text.table("[[material]]", entry) for entry in materials]
    file = where / f"{name}.toml"
    file.write_text("\n".join(parts), encoding="utf-8")
    groups = write_groups(scene, lights, where / f"{name}.look.toml")
    weights.begin_anew([*bpy.data.materials, *bpy.data.worlds])
    return Written(file, groups, [entry["name"] for entry in lights], remarks)


def emitter(shining, scene):
    """The entry of a node's surfaces that shine."""
    side = "both" if shining.two_sided else "front"
    object_, material = toml_text.pattern(shining.object), toml_text.pattern(shining.material)
    entry = {"name": shining.name, "object": object_, "material": material, "side": side}
    thing = scene.objects.get(shining.object)
    if thing is not None and not thing.visible_camera:
        entry["camera"] = False
    return entry


def rename_doubles(lights):
    """Gives what has a name that is taken a number; a lamp and a mesh of a library may share one."""
    names = {}
    for entry in lights:
        entry["name"] = glb.unique(names, entry["name"])


def discs_obj(discs):
    """The discs of round area lights as OBJ."""
    lines, first = [], 1
    for number, lamp in enumerate(discs, 1):
        lines += [f"o ltm disc {number}", f"usemtl ltm disc {number}"]
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in lamp.polygon]
        lines.append("f " + " ".join(str(first + i) for i in range(len(lamp.polygon))))
        first += len(lamp.polygon)
    return "\n".join(lines) + "\n"


def groups_of(scene, lights):
    """The light groups of Cycles: for each the names of the lights in it."""
    groups = {}
    for entry in lights:
        thing = scene.world if entry["kind"] == "environment" else scene.objects.get(entry["name"])
        thing = thing or scene.objects.get(entry.get("object", ""))
        if thing is not None and thing.lightgroup:
            groups.setdefault(thing.lightgroup, []).append(toml_text.pattern(entry["name"]))
    return groups


def write_groups(scene, lights, file):
    """Writes a look with the light groups; none where there are none."""
    return write_look(groups_of(scene, [{"kind": "surface", **entry} for entry in lights]), file)


def write_look(groups, file):
    """Writes a look with groups in place of the one that an earlier render has left; a look that was saved there since stays, and the groups
    go beside it. Returns the file; none where there are no groups.
    """
    if file.exists() and not file.read_text(encoding="utf-8", errors="replace").startswith(OWN_LOOK):
        file = file.with_name(file.name.removesuffix(".look.toml") + "-groups.look.toml")
    if not groups:
        file.unlink(missing_ok=True)
        return None
    file.write_text(OWN_LOOK + toml_text.table("[groups]", groups), encoding="utf-8")
    return file
