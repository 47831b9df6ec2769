"""Renders a scene that was written for it by Mitsuba 3 and times the rendering.

Reads scene.json in the folder named by the first argument, takes the variant that the second names, and for each of the
sample counts after it writes SAMPLES.f32 (RGB, little-endian, row by row) and prints the samples, the seconds of
mi.render alone, and its processors' seconds over all threads: loading the scene, compiling its kernels and starting Python are not counted.
"""
import json
import os
import sys
import time

folder, variant = sys.argv[1], sys.argv[2]

import mitsuba as mi

mi.set_variant(variant)
mi.set_log_level(mi.LogLevel.Error)

import numpy as np

with open(os.path.join(folder, "scene.json")) as file:
    described = json.load(file)

camera = described["camera"]
scene = {
    "type": "scene",
    "integrator": {"type": "path", "max_depth": described["max_depth"], "rr_depth": 6},
    "sensor": {
        "type": "perspective",
        "fov": camera["vertical_fov_degrees"],
        "fov_axis": "y",
        "near_clip": 1e-3,
        "to_world": mi.ScalarTransform4f().look_at(origin=camera["eye"], target=camera["target"], up=camera["up"]),
        "film": {
            "type": "hdrfilm", "width": camera["width"], "height": camera["height"], "pixel_format": "rgb",
            "component_format": "float32", "rfilter": {"type": "box"},
        },
        # The best of its five samplers in equal time: decision 45.
        "sampler": {"type": "multijitter"},
    },
}
for name, part in described["parts"].items():
    shape = {
        "type": "ply", "filename": os.path.join(folder, part["file"]), "face_normals": part["flat"], "bsdf": part["bsdf"],
    }
    if part["radiance"]:
        shape["emitter"] = {"type": "area", "radiance": {"type": "rgb", "value": part["radiance"]}}
    scene[name] = shape
scene = mi.load_dict(scene)


def render(samples, seed):
    return np.array(mi.render(scene, spp=samples, seed=seed), dtype="<f4")


for samples in map(int, sys.argv[3:]):
    if not variant.startswith("scalar"):
        render(samples, 1)
    begun, of_processors = time.perf_counter(), time.process_time()
    image = render(samples, 0)
    seconds, of_processors = time.perf_counter() - begun, time.process_time() - of_processors
    image.tofile(os.path.join(folder, f"{samples}.f32"))
    print(samples, seconds, of_processors, flush=True)
