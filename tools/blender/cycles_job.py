# SPDX-License-Identifier: GPL-3.0-or-later
"""A render by Cycles with a light group for each light, planned: how many renders, what they take, and the files for them.

The open scene is left as it is: light groups are given in a copy of the file, which another Blender renders in the background.
"""

import json
import os
import shutil
import sys
import tempfile
from dataclasses import dataclass, field
from math import sqrt
from pathlib import Path

import bpy

from . import light_sources, looks, scene_file, toml_text, weights
from .not_exported import NotExported

SCRIPT = Path(__file__).with_name("render_light_groups.py")
# Bytes of a pixel of a light group: three values in Cycles, as many in Blender's picture, and as much again on the way to the file.
BYTES_PER_PIXEL = 48
# Bytes of a pixel of a light group on disk while it lasts: in the file, and again as the packer reads it.
DISK_BYTES_PER_PIXEL = 24
# Memory of a machine that does not tell.
UNKNOWN_MEMORY = 16 << 30
# Lights that are cleaned at once.
MOST_CLEANED = 32
# Between the seeds of two halves: a large prime.
SEED_STEP = 15_485_863
GIB = float(1 << 30)


@dataclass
class Plan:
    """What will be rendered."""

    sources: list
    # Samples of each half.
    samples: int
    halves: int
    # Light groups that a render has at most.
    at_once: int
    size: tuple
    remarks: list = field(default_factory=list)

    def parts(self):
        """Ranges of lights, one for each render."""
        count = len(self.sources)
        return [(first, min(first + self.at_once, count)) for first in range(0, count, self.at_once)]

    def disk_bytes(self):
        """Disk that the render takes until it is packed."""
        width, height = self.size
        return width * height * len(self.sources) * self.halves * DISK_BYTES_PER_PIXEL

    def described(self):
        """What will be done, in lines."""
        width, height = self.size
        groups = min(self.at_once, len(self.sources))
        count = len(self.sources)
        lines = [f"{count} light{'s' if count > 1 else ''}, {width} × {height} pixels, {self.samples * self.halves} samples"]
        if self.halves == 2:
            lines.append(f"In two halves of {self.samples} samples with two seeds, so that the noise is known")
        memory = width * height * groups * BYTES_PER_PIXEL / GIB
        lines.append(f"About {memory:.1f} GiB of memory and meanwhile {self.disk_bytes() / GIB:.1f} GiB of disk for light groups")
        if len(self.parts()) > 1:
            lines.append(f"{groups} lights at a time: the scene is rendered {len(self.parts())} times over")
        if len(self.sources) > MOST_CLEANED:
            lines.append(f"Of more than {MOST_CLEANED} lights the noise stays: they are not cleaned")
        return lines


def plan(context):
    """Plans the render of a context. Raises NotExported."""
    scene, remarks = context.scene, []
    if scene.render.engine != "CYCLES":
        raise NotExported("the scene is not rendered by Cycles: choose it in Properties › Render › Render Engine")
    if scene.camera is None:
        raise NotExported("the scene has no camera: add one (Add › Camera)")
    sources = light_sources.collect(context, remarks)
    if not sources:
        raise NotExported("the scene has no light: add a lamp, an emissive material or a world")
    if scene.render.use_multiview:
        remarks.append("stereo is rendered as one view, that of the camera itself")
    others = sum(layer.use and layer != context.view_layer for layer in scene.view_layers)
    if others:
        remarks.append(f"only the view layer '{context.view_layer.name}' is rendered, of {others + 1}")
    unsaved = [image.name for image in bpy.data.images if image.is_dirty and image.source not in {"VIEWER"}]
    if unsaved:
        remarks.append(f"changes of {len(unsaved)} images that are not saved are not rendered: '{unsaved[0]}'")
    samples = samples_of(scene, context.view_layer)
    halves = 2 if scene.ltm.two_halves and samples > 1 else 1
    size = picture_size(scene.render)
    at_once = scene.ltm.groups_at_once or fitting(size)
    return Plan(sources, samples // halves, halves, at_once, size, remarks)


def samples_of(scene, layer):
    """Samples of a pixel, of which a view layer may have its own."""
    samples, mode = scene.cycles.samples, scene.cycles.use_layer_samples
    if layer.samples == 0 or mode == "IGNORE":
        return samples
    return min(samples, layer.samples) if mode == "BOUND" else layer.samples


def picture_size(render):
    """Pixels across and down."""
    width, height = (round(v * render.resolution_percentage / 100) for v in (render.resolution_x, render.resolution_y))
    if render.use_border and render.use_crop_to_border:
        width = round(width * (render.border_max_x - render.border_min_x))
        height = round(height * (render.border_max_y - render.border_min_y))
    return max(1, width), max(1, height)


def fitting(size):
    """Light groups that fit into half of the machine's memory."""
    try:
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        memory = UNKNOWN_MEMORY
    return max(1, int(memory / 2 / BYTES_PER_PIXEL / (size[0] * size[1])))


class Job:
    """The files of a planned render, in a folder of their own until `remove`."""

    def __init__(self, context, planned, where):
        where.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(where).free
        if planned.disk_bytes() > free:
            needed = f"the render needs {planned.disk_bytes() / GIB:.1f} GiB of disk for a while"
            raise NotExported(f"{needed}, and {free / GIB:.1f} GiB are free in {where}: make room or choose another folder")
        self.plan = planned
        # What is said of the scene is said now: it may be worked on while Cycles renders.
        self.lights, self.user_groups = list(map(described, planned.sources)), groups_of(planned.sources)
        self.folder = Path(tempfile.mkdtemp(prefix="ltm-cycles-", dir=where))
        try:
            self._write(context)
        except BaseException:
            self.remove()
            raise

    def _write(self, context):
        scene, cycles = context.scene, context.scene.cycles
        blend = self.folder / "copy.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True, compress=False, relative_remap=True)
        sources, halves = self.plan.sources, self.plan.halves
        groups = [f"ltm{index:06}" for index in range(len(sources))]
        renders = []
        for half in range(halves):
            for number, (first, end) in enumerate(self.plan.parts()):
                renders.append({
                    "file": str(self.folder / f"half{half + 1}-{number + 1:04}.exr"),
                    "first": first,
                    "end": end,
                    "samples": self.plan.samples,
                    "seed": (seed_of(scene) + half * SEED_STEP) % (1 << 31),
                    # Half the samples have √2 times the noise: each half ends where the whole would.
                    "threshold": min(1.0, cycles.adaptive_threshold * sqrt(halves)),
                    "least": cycles.adaptive_min_samples // halves,
                    # Each render of some of the lights ends where that of all would.
                    "seconds": cycles.time_limit / halves,
                })
        job = {
            "blend": str(blend),
            "scripts": not bpy.app.autoexec_fail,
            "scene": scene.name,
            "view_layer": context.view_layer.name,
            "groups": groups,
            "members": [None if s.kind == "world" else list(map(light_sources.key, s.objects)) for s in sources],
            "renders": renders,
        }
        self.file, self.names = self.folder / "job.json", self.folder / "names.json"
        write_json(self.file, job)
        write_json(self.names, dict(zip(groups, (source.name for source in sources))))

    def blender(self):
        """The command that renders."""
        if bpy.app.binary_path:
            return [bpy.app.binary_path, "--background", "--python", SCRIPT, "--", self.file]
        # Blender as a module of Python.
        return [sys.executable, SCRIPT, self.file]

    def packer(self, program, output):
        """The command that makes the container of what was rendered."""
        pattern = [self.folder / f"half{half + 1}-*.exr" for half in range(self.plan.halves)]
        second = ["--second", pattern[1]] if self.plan.halves == 2 else ["--estimate-noise"]
        return [program, pattern[0], *second, "--names", self.names, "-o", output, "--force", "--progress"]

    def keep(self, packed):
        """Writes beside the container what its lights are, and the user's light groups as groups of a look."""
        write_json(lights_file(packed), self.lights)
        scene_file.write_look(self.user_groups, packed.with_suffix(".look.toml"))
        weights.begin_anew([*bpy.data.materials, *bpy.data.worlds])

    def remove(self):
        shutil.rmtree(self.folder, ignore_errors=True)


def seed_of(scene):
    """The seed of the frame."""
    moves = scene.frame_current if scene.cycles.use_animated_seed else 0
    return scene.cycles.seed + moves


def write_json(file, tree):
    file.write_text(json.dumps(tree, ensure_ascii=False, indent=1), encoding="utf-8")


def lights_file(packed):
    """Where it stands what the lights of a container that Cycles rendered are in the scene."""
    return packed.with_suffix(".lights.json")


def described(source):
    """A light as it is rendered, for `looks.apply_to_cycles`."""
    return {
        "name": source.name,
        "kind": source.kind,
        "objects": list(map(light_sources.key, source.objects)),
        "materials": [[material.name, looks.emission_of(material)] for material in source.materials],
        "emission": source.emission,
    }


def groups_of(sources):
    """The user's light groups: for each the names of the lights in it, as patterns."""
    groups = {}
    for source in sources:
        if source.group:
            groups.setdefault(source.group, []).append(toml_text.pattern(source.name))
    return groups
