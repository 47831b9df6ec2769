# SPDX-License-Identifier: GPL-3.0-or-later
"""What the add-on does at the press of a button."""

import json
import subprocess
from pathlib import Path

import bpy
from bpy.props import BoolProperty, CollectionProperty, StringProperty
from bpy_extras.io_utils import ImportHelper
from mathutils import Matrix

from . import cycles_job, finding, light_sources, look_nodes, looks, scene_file
from .finding import MISSING, find_program
from .watched import Watched


def export(operator, context):
    """Writes the scene; none, with an error reported, where it cannot be."""
    try:
        written = scene_file.write(context)
    except scene_file.NotExported as problem:
        operator.report({"ERROR"}, str(problem))
        return None
    for remark in written.remarks:
        operator.report({"WARNING"}, remark)
    return written


class LTM_OT_export(bpy.types.Operator):
    """Write the scene as files that ltm renders, without rendering it"""

    bl_idname = "ltm.export"
    bl_label = "Export Scene File"

    def execute(self, context):
        written = export(self, context)
        if written is None:
            return {"CANCELLED"}
        self.report({"INFO"}, f"{written.scene}: {len(written.lights)} lights")
        return {"FINISHED"}


class LTM_OT_render(Watched, bpy.types.Operator):
    """Export the scene, render the light of every lamp by itself, and open the mixer"""

    bl_idname = "ltm.render"
    bl_label = "Render"

    open_mixer: BoolProperty(name="Open the Mixer", default=True, options={"SKIP_SAVE"})

    def start(self, context):
        """Exports and starts the program; whether it runs."""
        found = find_program(context)
        if found is None:
            self.report({"ERROR"}, MISSING)
            return False
        written = export(self, context)
        if written is None:
            return False
        self.packed = scene_file.packed(context.scene)
        arguments = [found, "render", written.scene, "-o", self.packed, "--pack", "--force", "--progress"]
        return self.begin(arguments)

    def finish(self, context):
        """Reports how the run ended."""
        if not self.succeeded():
            return {"CANCELLED"}
        cycles_job.lights_file(self.packed).unlink(missing_ok=True)
        self.report({"INFO"}, f"{self.packed} is rendered")
        self.show(context)
        return {"FINISHED"}


class LTM_OT_view(bpy.types.Operator):
    """Open the rendered scene in the mixer"""

    bl_idname = "ltm.view"
    bl_label = "Open Mixer"

    @classmethod
    def poll(cls, context):
        return scene_file.packed(context.scene).is_file()

    def execute(self, context):
        is_open = finding.open_mixer(self, context, scene_file.packed(context.scene))
        return {"FINISHED"} if is_open else {"CANCELLED"}


def said_by(operator, context, *arguments):
    """What the program says to these arguments; none, with an error reported, where it fails."""
    found = find_program(context)
    if found is None:
        operator.report({"ERROR"}, MISSING)
        return None
    done = subprocess.run([found, *map(str, arguments)], capture_output=True, encoding="utf-8", errors="replace")
    if done.returncode != 0:
        operator.report({"ERROR"}, (done.stderr.strip().splitlines() or ["ltm ended without a word"])[-1])
        return None
    return done.stdout


def weights_of(operator, context, packed, file, look):
    """What the lights of a container have by a look file; none, with an error reported, where it cannot be told."""
    named = ["--look", look] if look else []
    said = said_by(operator, context, "info", packed, "--json", "--lighting", file, *named)
    return None if said is None else json.loads(said)["lights"]


class LookChooser(ImportHelper):
    """What operators have in common that are given a look file."""

    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(default="*.toml;*.json", options={"HIDDEN"})
    look: StringProperty(name="Look", description="A named look of the file; none for its own rules")


class LTM_OT_apply_look(bpy.types.Operator, LookChooser):
    """Give the lamps, emissive materials and the world the strengths and colours of a look that the mixer saved"""

    bl_idname = "ltm.apply_look"
    bl_label = "Apply Look"

    def execute(self, context):
        packed = scene_file.packed(context.scene)
        lights = weights_of(self, context, packed, self.filepath, self.look)
        if lights is None:
            return {"CANCELLED"}
        by_cycles, objects_of = cycles_job.lights_file(packed), {}
        if by_cycles.is_file():
            entries = json.loads(by_cycles.read_text(encoding="utf-8"))
            known = light_sources.by_key(bpy.data.objects)
            for entry in (entry for entry in entries if entry["kind"] != "world"):
                found = [known.get(tuple(key)) for key in entry["objects"]]
                objects_of[entry["name"]] = [thing for thing in found if thing is not None]
            changed, remarks = looks.apply_to_cycles(context, lights, entries)
        else:
            changed, remarks = looks.apply(context, lights, packed.with_suffix(".glb"))
        groups, more = looks.apply_groups(context, Path(self.filepath), objects_of)
        for remark in remarks + more:
            self.report({"WARNING"}, remark)
        self.report({"INFO"}, f"{changed} lights changed" + (f", {groups} light groups" if groups else ""))
        return {"FINISHED"}


class LTM_OT_look_nodes(bpy.types.Operator, LookChooser):
    """Make compositor nodes of a look that the mixer saved: the image of each light times its weight, added up"""

    bl_idname = "ltm.look_nodes"
    bl_label = "Look as Nodes"

    @classmethod
    def poll(cls, context):
        return scene_file.packed(context.scene).is_file()

    def execute(self, context):
        packed = scene_file.packed(context.scene)
        lights = weights_of(self, context, packed, self.filepath, self.look)
        layers = packed.with_suffix(".lights.exr")
        if lights is None or said_by(self, context, "relight", packed, "--layers", "lights", "-o", layers) is None:
            return {"CANCELLED"}
        weights, remarks = look_nodes.factors(lights)
        image = bpy.data.images.load(str(layers), check_existing=True)
        image.reload()
        name = self.look or Path(self.filepath).stem
        node = look_nodes.build(look_nodes.tree_of(context.scene), name, weights, image)
        for remark in remarks:
            self.report({"WARNING"}, remark)
        self.report({"INFO"}, f"{len(node.inputs)} lights in the group '{name}'; link its output where you want it")
        return {"FINISHED"}


class LTM_OT_add_luminaires(bpy.types.Operator):
    """Add a lamp for each photometric file (IES, EULUMDAT), shining down from the 3D cursor"""

    bl_idname = "ltm.add_luminaires"
    bl_label = "Add Luminaires"
    bl_options = {"REGISTER", "UNDO"}

    directory: StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    filter_glob: StringProperty(default="*.ies;*.ldt", options={"HIDDEN"})

    def invoke(self, context, _event):
        if self.files:
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        for number, file in enumerate(self.files):
            path = Path(self.directory) / file.name
            lamp = bpy.data.lights.new(path.stem, "POINT")
            lamp.ltm.photometry = str(path)
            thing = bpy.data.objects.new(path.stem, lamp)
            # Beside each other, for they would hide each other.
            thing.matrix_world = context.scene.cursor.matrix @ Matrix.Translation((float(number), 0.0, 0.0))
            context.collection.objects.link(thing)
            thing.select_set(True)
        return {"FINISHED"}


class LTM_FH_luminaires(bpy.types.FileHandler):
    bl_idname = "LTM_FH_luminaires"
    bl_label = "Luminaires (IES, EULUMDAT)"
    bl_import_operator = "ltm.add_luminaires"
    bl_file_extensions = ".ies;.ldt"

    @classmethod
    def poll_drop(cls, context):
        return context.area is not None and context.area.type == "VIEW_3D"


CLASSES = (
    LTM_OT_export,
    LTM_OT_render,
    LTM_OT_view,
    LTM_OT_apply_look,
    LTM_OT_look_nodes,
    LTM_OT_add_luminaires,
    LTM_FH_luminaires,
)
