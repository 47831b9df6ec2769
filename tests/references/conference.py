"""Makes conference.f32, with which tests/scene/real.rs compares: the Conference Room by Mitsuba 3, scalar_rgb.

    pip install mitsuba numpy
    LTM_SCENES=... python tests/references/conference.py tests/references
    LTM_SCENES=... python tests/references/conference.py --times     # beside cargo bench --bench trace -- conference

The room of examples/scenes/conference-24.toml, small, under three lightings of radiance 1: all lamps, and two alone. The
file holds, as little-endian f32, the mean images, then the variance of those means from independent renders:
[mean, variance][lighting][channel][y][x].
"""
import functools
import math
import os
import sys
import tempfile
import time

import drjit as dr
import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
WIDTH, HEIGHT, RENDERS, SAMPLES, DEPTH = 32, 24, 16, 128, 12
FOLDER = os.path.join(os.environ["LTM_SCENES"], "conference")
LIGHTINGS = [None, "lum_05", "lum_17"]


@functools.lru_cache(None)
def parts(path):
    """Corners by material, as OBJ indices."""
    positions, faces, material = [], {}, None
    with open(path, errors="replace") as file:
        for line in file:
            words = line.split()
            if not words:
                continue
            if words[0] == "v":
                positions.append([float(w) for w in words[1:4]])
            elif words[0] == "usemtl":
                material = words[1]
            elif words[0] == "f":
                corners = [int(w.split("/")[0]) for w in words[1:]]
                corners = [c - 1 if c > 0 else len(positions) + c for c in corners]
                for k in range(1, len(corners) - 1):
                    faces.setdefault(material, []).append([corners[0], corners[k], corners[k + 1]])
    return np.array(positions, dtype=np.float64), {name: np.array(f) for name, f in faces.items()}


def colours(path):
    """Kd by material."""
    found, material = {}, None
    with open(path) as file:
        for line in file:
            words = line.split()
            if words[:1] == ["newmtl"]:
                material = words[1]
            elif words[:1] == ["Kd"]:
                found[material] = [float(w) for w in words[1:4]]
    return found


def shape(folder, name, positions, faces):
    path = os.path.join(folder, name + ".ply")
    corners = positions[faces.reshape(-1)].astype("<f4")
    triangles = np.empty(len(faces), dtype=[("n", "u1"), ("i", "<i4", 3)])
    triangles["n"], triangles["i"] = 3, np.arange(len(corners)).reshape(-1, 3)
    header = "ply\nformat binary_little_endian 1.0\n" + f"element vertex {len(corners)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    with open(path, "wb") as file:
        file.write(header.encode() + corners.tobytes() + triangles.tobytes())
    return {"type": "ply", "filename": path, "face_normals": True}


def rgb(values):
    return {"type": "rgb", "value": list(values)}


def scene(folder, lit, width=WIDTH, height=HEIGHT, samples=SAMPLES):
    camera = mi.ScalarTransform4f().look_at(origin=[-460, 500, -1000], target=[0, 400, 0], up=[0, 1, 0])
    described = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": DEPTH, "rr_depth": 6},
        "sensor": {
            "type": "perspective", "fov": 45.0, "fov_axis": "y", "near_clip": 1e-1, "far_clip": 1e5, "to_world": camera,
            "film": {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgb",
                     "component_format": "float32", "rfilter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": samples},
        },
    }
    kd = colours(os.path.join(FOLDER, "conference.mtl"))
    positions, faces = parts(os.path.join(FOLDER, "conference.obj"))
    for name, f in faces.items():
        # As the scene file has it: no highlights, and one wall that returns less than all light.
        colour = [0.9] * 3 if name == "mesh30_SG" else kd.get(name, [0.5] * 3)
        bsdf = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(colour)}}
        described["room_" + name] = {**shape(folder, "room_" + name, positions, f), "bsdf": bsdf}
    positions, faces = parts(os.path.join(FOLDER, "conference_luminaires.obj"))
    for name, f in faces.items():
        if not name.startswith("lum_"):
            continue
        lamp = {**shape(folder, name, positions, f), "bsdf": {"type": "diffuse", "reflectance": rgb([0.0] * 3)}}
        if lit is None or name == lit:
            lamp["emitter"] = {"type": "area", "radiance": rgb([1.0] * 3)}
        described[name] = lamp
    return mi.load_dict(described)


def main(target):
    means, variances = [], []
    for index, lit in enumerate(LIGHTINGS):
        with tempfile.TemporaryDirectory() as folder:
            loaded = scene(folder, lit)
            renders = [np.array(mi.render(loaded, seed=1000 * index + s), dtype=np.float64) for s in range(RENDERS)]
        images = np.stack(renders)
        means.append(images.mean(axis=0).transpose(2, 0, 1))
        variances.append(images.var(axis=0, ddof=1).transpose(2, 0, 1) / RENDERS)
        print(lit or "all", means[-1].mean(), flush=True)
    data = np.stack([np.stack(means), np.stack(variances)]).astype("<f4")
    data.tofile(os.path.join(target, "conference.f32"))


def timed(lit, samples):
    """Relative error, and processor seconds on one thread, of one render of 64×48 pixels."""
    with tempfile.TemporaryDirectory() as folder:
        loaded = scene(folder, lit, 64, 48)
    pair, seconds = [], []
    for seed in range(2):
        start = time.process_time()
        pair.append(np.array(mi.render(loaded, seed=seed, spp=samples), dtype=np.float64))
        seconds.append(time.process_time() - start)
    a, b = pair
    return math.sqrt(0.5 * ((a - b) ** 2).sum() / ((0.5 * (a + b)) ** 2).sum()), min(seconds)


def times():
    """All lamps on in one image, and the 24 images of one lamp each, which are what T holds."""
    dr.set_thread_count(1)
    mi.set_log_level(mi.LogLevel.Error)
    for samples in [16, 64, 256]:
        error, s = timed(None, samples)
        print(f"all: {samples} samples {s:.3f} s  error {error:.4f}  error²·s {error * error * s:.3e}", flush=True)
    lamps = [timed(f"lum_{lamp:02d}", 32) for lamp in range(24)]
    error, s = math.sqrt(sum(e * e for e, _ in lamps) / len(lamps)), sum(s for _, s in lamps)
    print(f"each alone: 32 samples {s:.3f} s  rms error {error:.4f}  error²·s {error * error * s:.3e}", flush=True)


if __name__ == "__main__":
    times() if sys.argv[1] == "--times" else main(sys.argv[1])
