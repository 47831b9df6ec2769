# SPDX-License-Identifier: GPL-3.0-or-later
"""Mixing what Cycles renders, and multi-layer OpenEXR files that are there already."""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from . import cycles_job, program, scene_file
from .finding import MISSING, find_program
from .not_exported import NotExported
from .watched import Watched


def find_packer(context):
    """The program ltm-pack; none where it is not there."""
    found = find_program(context)
    return program.beside(found, "ltm-pack") if found else None


class LTM_OT_run_cycles(Watched, bpy.types.Operator):
    """Render the scene by Cycles with a light group for each light, and open the mixer"""

    bl_idname = "ltm.run_cycles"
    bl_label = "Render with Cycles"
    bl_options = {"INTERNAL"}

    open_mixer: BoolProperty(name="Open the Mixer", default=True, options={"SKIP_SAVE"})

    job = None

    def start(self, context):
        """Plans, writes the files and starts Blender; whether it runs."""
        packer = find_packer(context)
        if packer is None:
            self.report({"ERROR"}, MISSING)
            return False
        where, self.packed = scene_file.folder(context.scene), scene_file.packed(context.scene)
        try:
            planned = cycles_job.plan(context)
            self.job = cycles_job.Job(context, planned, where)
            rendering = (self.job.blender(), False)
            self.run = program.Chain(rendering, (self.job.packer(packer, self.packed), True))
        except (NotExported, OSError, RuntimeError) as problem:
            stated = f"{where}: {problem.strerror}" if isinstance(problem, OSError) else str(problem)
            self.report({"ERROR"}, stated)
            self.end()
            return False
        for remark in planned.remarks:
            self.report({"WARNING"}, remark)
        self.report({"INFO"}, "; ".join(planned.described()))
        return True

    def finish(self, context):
        """Reports how the run ended, and takes its files away."""
        try:
            if not self.succeeded():
                return {"CANCELLED"}
            self.job.keep(self.packed)
        except OSError as problem:
            self.report({"ERROR"}, f"{self.packed}: {problem.strerror}")
            return {"CANCELLED"}
        finally:
            self.end()
        self.report({"INFO"}, f"{self.packed} is rendered: {len(self.job.lights)} lights")
        self.show(context)
        return {"FINISHED"}

    def cancel(self, context):
        Watched.cancel(self, context)
        self.end()

    def end(self):
        if self.job is not None:
            self.job.remove()


class LTM_OT_render_cycles(bpy.types.Operator):
    """Render the scene by Cycles as it is set, the light of each lamp, emissive material and the world by itself, and open the mixer"""

    bl_idname = "ltm.render_cycles"
    bl_label = "Render with Cycles"

    planned = None

    def invoke(self, context, _event):
        try:
            self.planned = cycles_job.plan(context)
        except NotExported as problem:
            self.report({"ERROR"}, str(problem))
            return {"CANCELLED"}
        return context.window_manager.invoke_props_dialog(self, width=460)

    def draw(self, context):
        self.layout.prop(context.scene.ltm, "two_halves")
        self.layout.prop(context.scene.ltm, "groups_at_once")
        planned = cycles_job.plan(context)
        for line in planned.described():
            self.layout.label(text=line)
        for remark in planned.remarks:
            self.layout.label(text=remark, icon="ERROR")

    def execute(self, _context):
        if bpy.app.background:
            return bpy.ops.ltm.run_cycles()
        bpy.ops.ltm.run_cycles("INVOKE_DEFAULT")
        return {"FINISHED"}


class LTM_OT_pack_render(Watched, bpy.types.Operator):
    """Make a container of a multi-layer OpenEXR file with light groups, and open the mixer"""

    bl_idname = "ltm.pack_render"
    bl_label = "Open Render"
    bl_options = {"INTERNAL"}

    filepath: StringProperty(subtype="FILE_PATH")
    clean: BoolProperty(name="Clean", default=True)
    overwrite: BoolProperty(name="Overwrite", default=False)
    open_mixer: BoolProperty(name="Open the Mixer", default=True, options={"SKIP_SAVE"})

    def start(self, context):
        packer = find_packer(context)
        if packer is None:
            self.report({"ERROR"}, MISSING)
            return False
        render = Path(bpy.path.abspath(self.filepath))
        self.packed = render.with_suffix(".ltc")
        if self.packed.exists() and not self.overwrite:
            self.report({"ERROR"}, f"{self.packed} is there already: turn on Overwrite to replace it")
            return False
        arguments = [packer, render, "-o", self.packed, "--force", "--progress"]
        arguments += ["--estimate-noise"] if self.clean else []
        return self.begin(arguments)

    def finish(self, context):
        if not self.succeeded():
            return {"CANCELLED"}
        self.report({"INFO"}, f"{self.packed} is made")
        self.show(context)
        return {"FINISHED"}


class LTM_OT_open_render(bpy.types.Operator, ImportHelper):
    """Open a multi-layer OpenEXR file with light groups in the mixer"""

    bl_idname = "ltm.open_render"
    bl_label = "Open Render…"

    filename_ext = ".exr"
    filter_glob: StringProperty(default="*.exr", options={"HIDDEN"})
    clean: BoolProperty(
        name="Clean", description="Clean the light groups of their noise, which is estimated from the file", default=True
    )

    overwrite: BoolProperty(name="Overwrite", description="Replace a container beside the file", default=False)

    def execute(self, _context):
        choices = {"filepath": self.filepath, "clean": self.clean, "overwrite": self.overwrite}
        if bpy.app.background:
            return bpy.ops.ltm.pack_render(**choices)
        bpy.ops.ltm.pack_render("INVOKE_DEFAULT", **choices)
        return {"FINISHED"}


CLASSES = (LTM_OT_run_cycles, LTM_OT_render_cycles, LTM_OT_pack_render, LTM_OT_open_render)
