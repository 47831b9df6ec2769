# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders a copy of a scene by Cycles with a light group for each light: a program that Blender runs beside the open window.

    blender --background --python render_light_groups.py -- job.json

`cycles_job.py` writes the job. Lines `progress: STAGE DONE/TOTAL` go to standard error, for who watches; an error is a line that begins
with `ltm:`.
"""

import json
import os
import re
import sys
from pathlib import Path

import bpy

SAMPLES = re.compile(r"Sample (\d+)/(\d+)")
TILES = re.compile(r"Rendered (\d+)/(\d+) Tiles")
# Of one render.
STEPS = 1000


def main(file):
    job = json.loads(Path(file).read_text(encoding="utf-8"))
    # Blender writes a line for each step of its work.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    bpy.ops.wm.open_mainfile(filepath=job["blend"], load_ui=False, use_scripts=job["scripts"])
    scene = bpy.data.scenes[job["scene"]]
    prepare(scene, scene.view_layers[job["view_layer"]])
    layer = scene.view_layers[0]
    group_everything(scene, layer, job)
    renders = job["renders"]
    for number, render in enumerate(renders):
        watch(f"rendering by Cycles, {number + 1} of {len(renders)}" if len(renders) > 1 else "rendering by Cycles")
        while layer.lightgroups:
            layer.active_lightgroup_index = 0
            with bpy.context.temp_override(scene=scene, view_layer=layer):
                bpy.ops.scene.view_layer_remove_lightgroup()
        for index in range(render["first"], render["end"]):
            layer.lightgroups.add(name=job["groups"][index])
        settings(scene, render)
        scene.render.filepath = render["file"]
        bpy.ops.render.render(write_still=True, scene=scene.name)
        if not Path(render["file"]).is_file():
            raise RuntimeError("Cycles ended without a picture")


def prepare(scene, layer):
    """Leaves of a scene one view layer without passes of its own, one view, and no work on the picture after Cycles."""
    while len(scene.view_layers) > 1:
        scene.view_layers.remove(next(other for other in scene.view_layers if other != layer))
    layer = scene.view_layers[0]
    # Names of channels are cut at 64 bytes, and each begins with this one.
    layer.name = "V"
    for name in (key for key in layer.bl_rna.properties.keys() if key.startswith("use_pass_")):
        setattr(layer, name, name == "use_pass_combined")
    for name in (key for key in layer.cycles.bl_rna.properties.keys() if key.startswith("use_pass_")):
        setattr(layer.cycles, name, False)
    layer.cycles.denoising_store_passes, layer.use, layer.samples = True, True, 0
    while layer.aovs:
        layer.aovs.remove(layer.aovs[0])
    render = scene.render
    render.engine, scene.cycles.use_denoising = "CYCLES", False
    render.use_compositing = render.use_sequencer = render.use_multiview = render.use_single_layer = False
    render.use_freestyle = False
    render.use_file_extension, render.use_overwrite, render.use_placeholder = True, True, False
    image = render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format = "OPEN_EXR_MULTILAYER"
    image.color_depth, image.exr_codec, image.color_management = "32", "ZIP", "FOLLOW_SCENE"


def group_everything(scene, layer, job):
    """Gives what shines the name of its group, of which a render has those that its view layer lists."""
    known = {(thing.name, thing.library.name if thing.library else ""): thing for thing in bpy.data.objects}
    for thing in known.values():
        thing.lightgroup = ""
    found = getattr(layer, "world_override", None) or scene.world
    if found is not None:
        found.lightgroup = ""
    for name, keys in zip(job["groups"], job["members"]):
        if keys is None:
            found.lightgroup = name
        for key in keys or []:
            known[tuple(key)].lightgroup = name


def settings(scene, render):
    """What differs between one half of the samples and the other."""
    cycles = scene.cycles
    cycles.seed, cycles.use_animated_seed = render["seed"], False
    cycles.samples, cycles.time_limit = render["samples"], render["seconds"]
    cycles.adaptive_threshold, cycles.adaptive_min_samples = render["threshold"], render["least"]


def watch(stage):
    """Tells how far a render is."""

    def tell(status, *_):
        samples, tiles = SAMPLES.search(status), TILES.search(status)
        if not samples and not tiles:
            return
        share = int(samples[1]) / max(1, int(samples[2])) if samples else 0.0
        if tiles:
            share = (int(tiles[1]) + share) / max(1, int(tiles[2]))
        sys.stderr.write(f"progress: {stage} {round(STEPS * min(1.0, share))}/{STEPS}\n")
        sys.stderr.flush()

    bpy.app.handlers.render_stats.clear()
    bpy.app.handlers.render_stats.append(tell)
    tell("Sample 0/1")


if __name__ == "__main__":
    code = 0
    try:
        main(sys.argv[-1])
    except (RuntimeError, KeyError, OSError, ValueError, AttributeError, TypeError) as error:
        words = " ".join(str(error).removeprefix("Error: ").split())
        sys.stderr.write(f"ltm: Cycles did not render: {words}\n")
        code = 1
    sys.stderr.flush()
    # Without Blender's own end, which has nothing to save here.
    os._exit(code)
