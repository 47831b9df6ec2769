# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings, the menu in Render, the panels."""

import bpy
from bpy.props import BoolProperty, IntProperty, PointerProperty, StringProperty

from . import cycles_operators, operators


class LtmPreferences(bpy.types.AddonPreferences):
    bl_idname = __package__

    program: StringProperty(
        name="Program",
        description="The program ltm; looked for on the path and where cargo installs if this is empty",
        subtype="FILE_PATH",
    )

    def draw(self, context):
        self.layout.prop(self, "program")
        found = operators.find_program(context)
        icon = "CHECKMARK" if found else "ERROR"
        self.layout.label(text=found or "ltm was not found", icon=icon)


class LtmScene(bpy.types.PropertyGroup):
    folder: StringProperty(
        name="Folder", description="Where the files for ltm are written", subtype="DIR_PATH", default="//ltm"
    )
    samples: IntProperty(name="Samples", description="Paths for each pixel", default=64, min=1, max=65536)
    texels: IntProperty(
        name="Area Texels",
        description="Texels along the longer side of an area light, each of which the mixer can light by itself",
        default=4,
        min=1,
        max=64,
    )
    two_halves: BoolProperty(
        name="Two Halves",
        description="Cycles renders half the samples twice, with two seeds, so that the noise is known and is cleaned better",
        default=True,
    )
    groups_at_once: IntProperty(
        name="Lights at a Time",
        description="Lights of one render by Cycles; more are rendered in several. 0 for what half of the memory holds",
        default=0,
        min=0,
        max=65536,
    )
    sky_texels: IntProperty(name="World Texels", description="Texels of the world around", default=32, min=2, max=256)


class LtmLight(bpy.types.PropertyGroup):
    photometry: StringProperty(
        name="Photometry",
        description="IES or EULUMDAT file, whose light it gives: it says how strong, and the lamp's strength is not used",
        subtype="FILE_PATH",
    )
    texels: IntProperty(
        name="Texels", description="Texels along the longer side; 0 for those of the scene", default=0, min=0, max=64
    )


class LTM_PT_scene(bpy.types.Panel):
    bl_label = "Light Transport (ltm)"
    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, settings = self.layout, context.scene.ltm
        layout.use_property_split = True
        for name in ("folder", "samples", "texels", "sky_texels"):
            layout.prop(settings, name)
        column = layout.column(heading="Render with Cycles")
        column.prop(settings, "two_halves")
        column.prop(settings, "groups_at_once")
        draw_operators(layout)


class LTM_PT_light(bpy.types.Panel):
    bl_label = "Light Transport (ltm)"
    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "data"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return context.light is not None

    def draw(self, context):
        layout, light = self.layout, context.light
        layout.use_property_split = True
        layout.prop(light.ltm, "photometry")
        if light.type == "AREA":
            layout.prop(light.ltm, "texels")


class LTM_MT_render(bpy.types.Menu):
    bl_label = "Light Transport (ltm)"

    def draw(self, _context):
        draw_operators(self.layout)


def draw_operators(layout):
    # Invoked, so that the render leaves the window free.
    layout.operator_context = "INVOKE_DEFAULT"
    layout.operator(operators.LTM_OT_render.bl_idname, icon="LIGHT")
    layout.operator(cycles_operators.LTM_OT_render_cycles.bl_idname, icon="RENDER_STILL")
    layout.operator(cycles_operators.LTM_OT_open_render.bl_idname, icon="FILE_FOLDER")
    layout.operator(operators.LTM_OT_view.bl_idname)
    layout.operator(operators.LTM_OT_apply_look.bl_idname)
    layout.operator(operators.LTM_OT_look_nodes.bl_idname)
    layout.operator(operators.LTM_OT_export.bl_idname)
    layout.operator(operators.LTM_OT_add_luminaires.bl_idname)


def draw_menu(self, _context):
    self.layout.separator()
    self.layout.menu("LTM_MT_render")


CLASSES = (LtmPreferences, LtmScene, LtmLight, LTM_PT_scene, LTM_PT_light, LTM_MT_render)


def register():
    bpy.types.Scene.ltm = PointerProperty(type=LtmScene)
    bpy.types.Light.ltm = PointerProperty(type=LtmLight)
    bpy.types.TOPBAR_MT_render.append(draw_menu)


def unregister():
    bpy.types.TOPBAR_MT_render.remove(draw_menu)
    del bpy.types.Light.ltm
    del bpy.types.Scene.ltm
