"""Denoises images that were written for it with Intel's Open Image Denoise.

Reads description.json in the folder named by the first argument (width, height, images), albedo.f32, normal.f32 and
color-0.f32 onwards (RGB, little-endian, row by row), and writes clean-0.f32 onwards. The
albedo and the normals are taken as free of noise; the colours are high dynamic range, the quality is the highest. Prints the
seconds that denoising took, the first image, which prepares it, left out where there are more.
"""
import json
import os
import sys
import time

import numpy as np
import pyoidn

folder = sys.argv[1]
with open(os.path.join(folder, "description.json")) as file:
    described = json.load(file)
shape = (described["height"], described["width"], 3)


def image(name):
    return np.fromfile(os.path.join(folder, name + ".f32"), "<f4").reshape(shape)


albedo, normal = np.clip(image("albedo"), 0, 1), np.clip(image("normal"), -1, 1)
times = []
for which in range(described["images"]):
    color = np.maximum(image(f"color-{which}"), 0)
    begun = np.array([time.perf_counter(), time.process_time()])
    clean = pyoidn.denoise(color, albedo, normal, hdr=True, clean_aux=True, quality="high")
    times.append(np.array([time.perf_counter(), time.process_time()]) - begun)
    clean.astype("<f4").tofile(os.path.join(folder, f"clean-{which}.f32"))
print(*np.mean(times[1:] or times, axis=0))
